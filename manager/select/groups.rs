//! Groups: what overlaps, directly or by way of others (manager.md, step 5). Union-find, with the smallest member as the root, so that the
//! result does not depend on the order in which pairs come. Only what is in some pair is looked at, since nearly everything stands alone.

/// Parent of what is in no pair.
const ALONE: u32 = u32::MAX;

/// See the module's head.
#[derive(Clone, Debug, Default)]
pub(super) struct Groups {
    /// By node.
    parents: Vec<u32>,
    /// Nodes of which the parent is set.
    touched: Vec<u32>,
    /// After [`Self::finish`]: root in the upper half, node in the lower, ascending.
    members: Vec<u64>,
}

impl Groups {
    /// All of `nodes` alone.
    pub(super) fn clear(&mut self, nodes: usize) {
        for node in self.touched.drain(..) {
            self.parents[node as usize] = ALONE;
        }
        self.members.clear();
        if self.parents.len() < nodes {
            self.parents.resize(nodes, ALONE);
        }
    }

    /// Two that overlap.
    pub(super) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        let (low, high) = (a.min(b), a.max(b));
        self.parents[high as usize] = low;
    }

    /// With every step the path is halved.
    fn root(&mut self, mut node: u32) -> u32 {
        if self.parents[node as usize] == ALONE {
            self.parents[node as usize] = node;
            self.touched.push(node);
        }
        loop {
            let parent = self.parents[node as usize];
            let above = self.parents[parent as usize];
            if above == parent {
                return parent;
            }
            self.parents[node as usize] = above;
            node = above;
        }
    }

    /// To be called when all pairs are in.
    pub(super) fn finish(&mut self) {
        for k in 0..self.touched.len() {
            let node = self.touched[k];
            let root = self.root(node);
            self.members.push(u64::from(root) << 32 | u64::from(node));
        }
        self.members.sort_unstable();
    }

    /// The groups of more than one, by their smallest members; each ascending.
    pub(super) fn iter(&self) -> impl Iterator<Item = impl Iterator<Item = u32> + Clone> {
        self.members.chunk_by(|a, b| a >> 32 == b >> 32).map(|group| group.iter().map(|&member| member as u32))
    }

    /// Nodes that are in some pair.
    pub(super) fn overlapping(&self) -> usize {
        self.touched.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn groups_are_connected_components(pairs in prop::collection::vec((0u32..60, 0u32..60), 0..60)) {
            let pairs: Vec<_> = pairs.into_iter().filter(|(a, b)| a != b).collect();
            let mut groups = Groups::default();
            groups.clear(60);
            groups.join(3, 4);
            groups.finish();
            groups.clear(60); // nothing is left of an earlier frame
            pairs.iter().for_each(|&(a, b)| groups.join(a, b));
            groups.finish();
            // The plainest way: everybody takes the smallest number of those it can reach, until nothing changes.
            let mut reached: Vec<u32> = (0..60).collect();
            while pairs.iter().any(|&(a, b)| {
                let (a, b) = (a as usize, b as usize);
                let least = reached[a].min(reached[b]);
                let is_new = reached[a] != reached[b];
                (reached[a], reached[b]) = (least, least);
                is_new
            }) {}
            let expected: Vec<Vec<u32>> = (0..60)
                .map(|root| (0..60u32).filter(|&node| reached[node as usize] == root).collect::<Vec<_>>())
                .filter(|group| group.len() > 1)
                .collect();
            let found: Vec<Vec<u32>> = groups.iter().map(Iterator::collect).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
