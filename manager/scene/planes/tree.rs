//! A hierarchy of boxes: the broad phase of the search for faces that lie over each other.
//!
//! Built like the culling tree ([`crate::scene::bvh`]: median cuts, ties by index, depth-first branches), but over boxes,
//! which fit flat faces far better than balls, and with another question: which items may touch which. Boxes of items are
//! not kept; whoever asks looks at the items of a leaf itself.

use glam::DVec3;
use proto::scene::Box3;
use std::ops::Range;

/// Most items of a leaf: two leaves are at most 64 pairs, about what finding two smaller leaves costs.
const LEAF_ITEMS: usize = 8;

#[derive(Clone, Copy, Debug)]
struct Branch {
    bounds: Box3,
    first: u32,
    end: u32,
    /// The branch after this one and all below it.
    next: u32,
}

/// See the module's head.
#[derive(Clone, Debug, Default)]
pub(super) struct BoxTree {
    branches: Vec<Branch>,
    items: Vec<u32>,
}

/// Whether two boxes have a point in common.
pub(super) fn touch(a: &Box3, b: &Box3) -> bool {
    a.min.cmple(b.max).all() && b.min.cmple(a.max).all()
}

impl BoxTree {
    /// The tree over `items` with these boxes, an item being an index into `boxes`.
    pub(super) fn build(boxes: &[Box3], items: Vec<u32>) -> Self {
        let mut tree = Self { branches: Vec::with_capacity(items.len() / 2 + 1), items };
        if !tree.items.is_empty() {
            tree.grow(boxes, 0..tree.items.len());
        }
        tree
    }

    // The recursion is as deep as log₂ of the number of items.
    fn grow(&mut self, boxes: &[Box3], range: Range<usize>) -> Box3 {
        let own = self.branches.len();
        let nothing = Box3 { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };
        let (first, end) = (range.start as u32, range.end as u32);
        self.branches.push(Branch { bounds: nothing, first, end, next: 0 });
        let around = |items: &[u32]| {
            items.iter().fold(nothing, |sum, &i| Box3 {
                min: sum.min.min(boxes[i as usize].min),
                max: sum.max.max(boxes[i as usize].max),
            })
        };
        let bounds = if range.len() > LEAF_ITEMS {
            let half = range.len() / 2;
            let whole = around(&self.items[range.clone()]);
            let extent = whole.max - whole.min;
            let axis =
                [0, 1, 2].into_iter().fold(0, |best, axis| if extent[axis] > extent[best] { axis } else { best });
            let middle = |i: u32| boxes[i as usize].min[axis] + boxes[i as usize].max[axis];
            self.items[range.clone()]
                .select_nth_unstable_by(half, |&a, &b| middle(a).total_cmp(&middle(b)).then(a.cmp(&b)));
            let middle = range.start + half;
            self.grow(boxes, range.start..middle);
            self.grow(boxes, middle..range.end);
            whole
        } else {
            around(&self.items[range])
        };
        self.branches[own].bounds = bounds;
        self.branches[own].next = self.branches.len() as u32;
        bounds
    }

    /// Round everything.
    pub(super) fn bounds(&self) -> Option<Box3> {
        self.branches.first().map(|branch| branch.bounds)
    }

    fn items_of(&self, branch: usize) -> &[u32] {
        let Branch { first, end, .. } = self.branches[branch];
        &self.items[first as usize..end as usize]
    }

    fn is_leaf(&self, branch: usize) -> bool {
        self.branches[branch].next as usize == branch + 1
    }

    /// The leaves all of whose branches upward `may` be of interest, to be looked at one by one.
    pub(super) fn leaves(&self, mut may: impl FnMut(&Box3) -> bool, mut leaf: impl FnMut(&[u32])) {
        let mut at = 0;
        while let Some(branch) = self.branches.get(at) {
            if !may(&branch.bounds) {
                at = branch.next as usize;
                continue;
            }
            if self.is_leaf(at) {
                leaf(self.items_of(at));
            }
            at += 1;
        }
    }

    /// All pairs of leaves that touch, each once; the same leaf twice for the pairs inside it. Ends early when `pair`
    /// says false.
    pub(super) fn touching(&self, mut pair: impl FnMut(&[u32], &[u32], bool) -> bool) {
        let mut open: Vec<(usize, usize)> = if self.branches.is_empty() { Vec::new() } else { vec![(0, 0)] };
        while let Some((a, b)) = open.pop() {
            let halves = |branch: usize| (branch + 1, self.branches[branch + 1].next as usize);
            if a == b {
                if self.is_leaf(a) {
                    if !pair(self.items_of(a), self.items_of(a), true) {
                        return;
                    }
                } else {
                    let (left, right) = halves(a);
                    open.extend([(left, right), (right, right), (left, left)]);
                }
            } else if touch(&self.branches[a].bounds, &self.branches[b].bounds) {
                let large = |branch: usize| if self.is_leaf(branch) { 0 } else { self.items_of(branch).len() };
                match (large(a), large(b)) {
                    (0, 0) => {
                        if !pair(self.items_of(a), self.items_of(b), false) {
                            return;
                        }
                    }
                    (x, y) if x >= y => {
                        let (left, right) = halves(a);
                        open.extend([(left, b), (right, b)]);
                    }
                    _ => {
                        let (left, right) = halves(b);
                        open.extend([(a, left), (a, right)]);
                    }
                }
            }
        }
    }
}
