//! Which balls overlap: the distance of their centres is less than the sum of their radii (seed 000, section 4; manager.md, step 5).
//!
//! The paper tests every pair of what is visible. Here the pairs of objects at rest are found once for a database, by walking its tree against
//! itself: two branches whose balls are apart have no pair, so the cost is n log n and the pairs found, however unlike the sizes are (a
//! grid needs one size of cell). Moved objects ask the tree every frame, and are compared with one another in a sweep along the axis on which they
//! spread most.

use super::eyepoint::{Near, Views, bits};
use super::walk::Flags;
use crate::scene::blocks::{BLOCK, Blocks};
use fearless_simd::Level;
use proto::scene::Sphere;

/// Two that overlap, and the views in which both are seen. Nodes are slots, and after these the moved objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Pair {
    pub(super) nodes: [u32; 2],
    pub(super) views: Views,
}

/// A moved object that is seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mover {
    /// Which moved object.
    pub(super) moved: u32,
    /// Where the database has it.
    pub(super) slot: u32,
    pub(super) ball: Sphere,
    /// Views that see it.
    pub(super) views: Views,
}

/// Finds overlaps; keeps those of objects at rest.
#[derive(Clone, Debug, Default)]
pub(super) struct Overlaps {
    /// Of which database the kept pairs are.
    serial: u64,
    /// Slots of objects that overlap where the database has them, the smaller first.
    at_rest: Vec<[u32; 2]>,
    /// Of this frame.
    pub(super) pairs: Vec<Pair>,
    order: Vec<(f64, u32)>,
    near: Near,
    branches: Vec<u32>,
}

/// Whether two balls have a point in common that isn't on the surface of one.
fn overlap(a: Sphere, b: Sphere) -> bool {
    let reach = a.radius + b.radius;
    b.centre.distance_squared(a.centre) < reach * reach
}

impl Overlaps {
    /// Finds all pairs of which both are seen in some view: objects at rest whose flags are set, and `movers`.
    pub(super) fn find(&mut self, level: Level, blocks: &Blocks, flags: &Flags, views: usize, movers: &[Mover]) {
        if self.serial != blocks.serial() {
            self.serial = blocks.serial();
            self.at_rest.clear();
            if blocks.count() > 0 {
                self.join(level, blocks, 0, 0);
            }
        }
        self.pairs.clear();
        let seen = |slot: u32| {
            let (block, k) = (slot as usize / BLOCK, slot as usize % BLOCK);
            (0..views).fold(0, |mask, view| mask | (flags.seen(view, block) >> k & 1) << view)
        };
        for &nodes in &self.at_rest {
            let views = seen(nodes[0]) & seen(nodes[1]);
            if views != 0 {
                self.pairs.push(Pair { nodes, views });
            }
        }
        for (node, mover) in (blocks.count() as u32..).zip(movers) {
            self.ask(level, blocks, mover.ball);
            while let Some(slot) = self.branches.pop() {
                let views = seen(slot) & mover.views;
                if views != 0 {
                    self.pairs.push(Pair { nodes: [slot, node], views });
                }
            }
        }
        self.sweep(blocks.count() as u32, movers);
    }

    /// Bytes that are kept from frame to frame.
    pub(super) fn bytes(&self) -> usize {
        self.at_rest.capacity() * size_of::<[u32; 2]>() + self.pairs.capacity() * size_of::<Pair>()
    }

    /// Adds the pairs of objects below one branch and below another, or both below the same one. As deep as the tree, twice.
    fn join(&mut self, level: Level, blocks: &Blocks, a: u32, b: u32) {
        let of = |index: u32| &blocks.tree.branches[index as usize];
        let is_leaf = |index: u32| of(index).is_leaf(index as usize);
        if a != b && !overlap(of(a).ball, of(b).ball) {
            return;
        }
        let below = |index: u32| [index + 1, of(index + 1).next];
        match (is_leaf(a), is_leaf(b)) {
            (true, true) => self.join_blocks(level, blocks, of(a).first, of(b).first, of(b).ball),
            (false, _) if a == b => {
                let [low, high] = below(a);
                self.join(level, blocks, low, low);
                self.join(level, blocks, low, high);
                self.join(level, blocks, high, high);
            }
            (a_is_leaf, b_is_leaf) => {
                if !a_is_leaf && (b_is_leaf || of(a).range().len() >= of(b).range().len()) {
                    below(a).into_iter().for_each(|a| self.join(level, blocks, a, b));
                } else {
                    below(b).into_iter().for_each(|b| self.join(level, blocks, a, b));
                }
            }
        }
    }

    fn join_blocks(&mut self, level: Level, blocks: &Blocks, a: u32, b: u32, around_b: Sphere) {
        for slot in blocks.slots_of(a as usize / BLOCK) {
            let ball = blocks.ball(slot);
            if overlap(ball, around_b) {
                for k in self.of_block(level, blocks, b as usize / BLOCK, ball) {
                    let other = b + k as u32;
                    if a != b || (slot as u32) < other {
                        let (low, high) = (other.min(slot as u32), other.max(slot as u32));
                        self.at_rest.push([low, high]);
                    }
                }
            }
        }
    }

    /// The objects of a block that overlap a ball.
    fn of_block(
        &mut self,
        level: Level,
        blocks: &Blocks,
        block: usize,
        ball: Sphere,
    ) -> impl Iterator<Item = usize> + use<> {
        self.near.load(level, blocks, block, ball.centre);
        bits(self.near.touching(level, ball.radius) & super::eyepoint::lowest(blocks.slots_of(block).len()))
    }

    /// Leaves the slots of all objects that overlap a ball in `branches`.
    fn ask(&mut self, level: Level, blocks: &Blocks, ball: Sphere) {
        let mut found = std::mem::take(&mut self.branches);
        found.clear();
        let mut index = 0;
        while let Some(branch) = blocks.tree.branches.get(index) {
            if !overlap(branch.ball, ball) {
                index = branch.next as usize;
                continue;
            }
            if branch.is_leaf(index) {
                found.extend(
                    self.of_block(level, blocks, branch.first as usize / BLOCK, ball).map(|k| branch.first + k as u32),
                );
            }
            index += 1;
        }
        self.branches = found;
    }

    /// Adds the pairs of movers, whose nodes begin at `first`.
    fn sweep(&mut self, first: u32, movers: &[Mover]) {
        let axis = crate::scene::bvh::longest_axis(movers.iter().map(|mover| mover.ball.centre));
        let low = |mover: &Mover| mover.ball.centre[axis] - mover.ball.radius;
        self.order.clear();
        self.order.extend((0..).zip(movers).map(|(k, mover)| (low(mover), k)));
        self.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (place, &(_, k)) in self.order.iter().enumerate() {
            let mover = &movers[k as usize];
            let end = mover.ball.centre[axis] + mover.ball.radius;
            for &(_, other) in self.order[place + 1..].iter().take_while(|(low, _)| *low <= end) {
                let views = mover.views & movers[other as usize].views;
                if views != 0 && overlap(mover.ball, movers[other as usize].ball) {
                    self.pairs.push(Pair { nodes: [first + k.min(other), first + k.max(other)], views });
                }
            }
        }
    }
}
