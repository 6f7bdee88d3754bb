//! The walk through the tree, for all views of one eyepoint at once, and the visual flags that it sets.
//!
//! Seed 002, claims 1, 6 and 7: a processor is given a node, drops it with all below if its ball is outside of every view (or too far for its
//! largest object to span anything), and otherwise returns the pointers to the nodes below before it does the node's own features. A view in which a
//! branch lies wholly inside is not asked again below it. Subtrees of a few blocks are one processor's from there on, since handing out a
//! node costs more than asking it.
//!
//! Features are the objects of a block: a word of visual flags per view, and another for those that lie across a border or are not shown
//! whole, whose subobjects are asked one by one here and now. They are few; the others' subobjects are taken without a look.

use super::Counters;
use super::eyepoint::{Near, Objects, Views, bits, lowest};
use super::frustum::{Frustum, Where};
use super::sort::{PowerRange, ordered};
use super::world::{Body, World};
use crate::scene::blocks::BLOCK;
use fearless_simd::Level;
use glam::DVec3;
use std::sync::atomic::{AtomicU64, Ordering};

/// Subtrees of so many objects are not handed out in parts: 32 blocks take some ten microseconds, handing a node out a tenth of one.
const WHOLE_OBJECTS: usize = 32 * BLOCK;

/// A node that is to be looked at.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Node {
    /// Which branch of the tree.
    pub(super) branch: u32,
    /// Set where all objects are known to be large enough.
    large: bool,
    /// Views that it may lie across the borders of.
    across: Views,
    /// Views that it lies inside of.
    inside: Views,
}

impl Node {
    /// The tree's base.
    pub(super) fn root(views: Views) -> Self {
        Self { branch: 0, large: false, across: views, inside: 0 }
    }
}

/// A block of which something is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct SeenBlock {
    /// The least power that anything in it can have, as ordered bits.
    pub(super) nearest: u64,
    /// The greatest.
    pub(super) farthest: u64,
    pub(super) block: u32,
}

/// A subobject of an object that isn't seen whole.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenPiece {
    pub(super) view: u32,
    pub(super) slot: u32,
    pub(super) place: u32,
}

/// What one processor finds.
#[derive(Clone, Debug, Default)]
pub(super) struct Found {
    pub(super) blocks: Vec<SeenBlock>,
    pub(super) pieces: Vec<SeenPiece>,
    /// Of all that is seen, for the eyepoint of this walk.
    pub(super) range: PowerRange,
    /// By view.
    pub(super) counters: Vec<Counters>,
    near: Near,
    nodes: Vec<Node>,
    leaves: Vec<Node>,
}

/// Room for so many elements altogether.
pub(super) fn room<T>(list: &mut Vec<T>, count: usize) {
    list.reserve_exact(count.saturating_sub(list.len()));
}

impl Found {
    /// Room for so many blocks and pieces.
    pub(super) fn make_room(&mut self, blocks: usize, pieces: usize) {
        room(&mut self.blocks, blocks);
        room(&mut self.pieces, pieces);
        room(&mut self.nodes, WHOLE_OBJECTS);
        room(&mut self.leaves, WHOLE_OBJECTS);
    }

    pub(super) fn clear(&mut self, views: usize) {
        self.blocks.clear();
        self.pieces.clear();
        self.counters.clear();
        self.counters.resize(views, Counters::default());
    }
}

/// The visual flags of all objects at rest: by view, then by block, a bit for each object.
#[derive(Debug, Default)]
pub(super) struct Flags {
    blocks: usize,
    /// Something of it is seen.
    seen: Vec<AtomicU64>,
    /// … but its subobjects were asked one by one.
    partly: Vec<AtomicU64>,
}

impl Flags {
    /// Makes room. Flags of blocks that were not visited hold what they held.
    pub(super) fn fit(&mut self, views: usize, blocks: usize) {
        if self.blocks != blocks || self.seen.len() < views * blocks {
            self.blocks = blocks;
            for list in [&mut self.seen, &mut self.partly] {
                list.clear();
                list.resize_with(views * blocks, AtomicU64::default);
            }
        }
    }

    pub(super) fn seen(&self, view: usize, block: usize) -> Objects {
        self.seen[view * self.blocks + block].load(Ordering::Relaxed)
    }

    pub(super) fn partly(&self, view: usize, block: usize) -> Objects {
        self.partly[view * self.blocks + block].load(Ordering::Relaxed)
    }

    /// One processor visits a block, and who reads it waits for all of them: no order is needed.
    fn set(&self, view: usize, block: usize, seen: Objects, partly: Objects) {
        self.seen[view * self.blocks + block].store(seen, Ordering::Relaxed);
        self.partly[view * self.blocks + block].store(partly, Ordering::Relaxed);
    }

    pub(super) fn bytes(&self) -> usize {
        (self.seen.capacity() + self.partly.capacity()) * size_of::<AtomicU64>()
    }

    /// Forgets a block.
    pub(super) fn clear(&self, views: usize, block: usize) {
        (0..views).for_each(|view| self.set(view, block, 0, 0));
    }
}

/// A walk for one eyepoint. What it finds does not depend on who looks at which node.
pub(super) struct Walk<'a, W> {
    pub(super) world: &'a W,
    pub(super) apex: DVec3,
    /// By view of the frame.
    pub(super) frusta: &'a [Frustum],
    /// An object whose radius is so many times smaller than its distance is left out.
    pub(super) reach: Option<f64>,
    pub(super) level: Level,
    /// By block: objects that have moved. The walk passes them by.
    pub(super) moved: &'a [Objects],
    /// By block: objects of which not every subobject is shown at all times. Empty: none.
    pub(super) conditional: &'a [Objects],
    pub(super) flags: &'a Flags,
}

impl<W: World> Walk<'_, W> {
    /// Looks at a node; `point` is called with the nodes below that others may look at.
    pub(super) fn look(&self, found: &mut Found, node: Node, point: &mut dyn FnMut(Node)) {
        let branch = self.world.blocks().tree.branches[node.branch as usize];
        if branch.range().len() <= WHOLE_OBJECTS || branch.is_leaf(node.branch as usize) {
            return self.whole(found, node);
        }
        if let Some(node) = self.test(&mut found.counters, node) {
            self.below(node).into_iter().for_each(point);
        }
    }

    /// Does a subtree: first the pointers, then the features.
    fn whole(&self, found: &mut Found, node: Node) {
        let (mut nodes, mut leaves) = (std::mem::take(&mut found.nodes), std::mem::take(&mut found.leaves));
        nodes.push(node);
        while let Some(node) = nodes.pop() {
            if let Some(node) = self.test(&mut found.counters, node) {
                let branch = &self.world.blocks().tree.branches[node.branch as usize];
                if branch.is_leaf(node.branch as usize) {
                    leaves.push(node);
                } else {
                    let [low, high] = self.below(node);
                    nodes.extend([high, low]);
                }
            }
        }
        for leaf in leaves.drain(..) {
            self.block(found, leaf);
        }
        (found.nodes, found.leaves) = (nodes, leaves);
    }

    /// The two nodes below an inner node.
    fn below(&self, node: Node) -> [Node; 2] {
        let low = node.branch + 1;
        let high = self.world.blocks().tree.branches[low as usize].next;
        [low, high].map(|branch| Node { branch, ..node })
    }

    /// The node with what is known now, or nothing if all below is left out.
    fn test(&self, counters: &mut [Counters], mut node: Node) -> Option<Node> {
        let blocks = self.world.blocks();
        let branch = &blocks.tree.branches[node.branch as usize];
        for view in bits(node.across) {
            let counters = &mut counters[view];
            counters.branches_tested += 1;
            match self.frusta[view].ball(branch.ball) {
                Where::Outside => {
                    counters.branches_outside += 1;
                    node.across &= !(1 << view);
                }
                Where::Inside => {
                    counters.branches_inside += 1;
                    node.across &= !(1 << view);
                    node.inside |= 1 << view;
                }
                Where::Across => {}
            }
        }
        if node.across | node.inside == 0 {
            return None;
        }
        if let Some(reach) = self.reach.filter(|_| !node.large) {
            /// More than rounding can do to a distance of this size.
            const MARGIN: f64 = 1e-9;
            let [least, most] = blocks.sizes[node.branch as usize].map(f64::from);
            let (distance, radius) = (branch.ball.centre.distance(self.apex), branch.ball.radius);
            let margin = (distance + radius) * MARGIN;
            if most * reach < distance - radius - margin {
                for view in bits(node.across | node.inside) {
                    counters[view].objects_small += branch.range().len() as u64;
                }
                return None;
            }
            node.large = least * reach > distance + radius + margin;
        }
        Some(node)
    }

    /// Sets the visual flags of a block's objects.
    fn block(&self, found: &mut Found, node: Node) {
        let blocks = self.world.blocks();
        let branch = &blocks.tree.branches[node.branch as usize];
        let block = branch.first as usize / BLOCK;
        let here = lowest(branch.range().len()) & !self.moved[block];
        let mut large = u64::MAX;
        if node.across != 0 || (self.reach.is_some() && !node.large) {
            found.near.load(self.level, blocks, block, self.apex);
            if let Some(first) = bits(node.across | node.inside).next() {
                found.counters[first].objects_measured += branch.range().len() as u64;
            }
        }
        if let Some(reach) = self.reach.filter(|_| !node.large) {
            large = found.near.large(self.level, reach);
        }
        let conditional = self.conditional.get(block).copied().unwrap_or(0);
        let mut any = 0;
        for view in bits(node.across | node.inside) {
            let (mut seen, mut partly) = (here, here & conditional);
            if node.across >> view & 1 == 1 {
                let (outside, inside) = found.near.ask(self.level, &self.frusta[view]);
                (seen, partly) = (here & !outside, here & !outside & (!inside | conditional));
                found.counters[view].objects_tested += u64::from(here.count_ones());
            }
            found.counters[view].objects_small += u64::from((seen & !large).count_ones());
            (seen, partly) = (seen & large, partly & large);
            for k in bits(partly) {
                let slot = block * BLOCK + k;
                let is_inside =
                    node.inside >> view & 1 == 1 || self.frusta[view].ball(blocks.ball(slot)) == Where::Inside;
                if !self.one_by_one(found, view, slot, is_inside) {
                    seen &= !(1 << k);
                    partly &= !(1 << k);
                }
            }
            self.flags.set(view, block, seen, partly);
            found.counters[view].objects_visible += u64::from(seen.count_ones());
            any |= seen;
        }
        if any != 0 {
            let range = PowerRange::of(branch.ball, self.apex);
            found.range = found.range.and(range);
            let [nearest, farthest] = [range.least, range.most].map(ordered);
            found.blocks.push(SeenBlock { nearest, farthest, block: block as u32 });
        }
    }

    /// Asks the subobjects of an object; says whether any is seen.
    fn one_by_one(&self, found: &mut Found, view: usize, slot: usize, is_inside: bool) -> bool {
        let blocks = self.world.blocks();
        let places = blocks.places(slot);
        let first = self.world.first_piece(blocks.object(slot));
        let Found { pieces, counters, .. } = found;
        let before = pieces.len();
        let mut take = |piece: usize| {
            let place = places.start + piece;
            if self.world.is_shown(first + piece as u32) {
                pieces.push(SeenPiece { view: view as u32, slot: slot as u32, place: place as u32 });
            }
        };
        if is_inside {
            (0..places.len()).for_each(take);
        } else {
            self.world.across(Body::AtRest(slot), &self.frusta[view], &mut counters[view], &mut take);
        }
        pieces.len() > before
    }
}
