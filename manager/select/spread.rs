//! Mixing: from groups to as many lists as are wanted (manager.md, step 7).
//!
//! Groups stand in the order of the nearest power of their objects, and neighbours are mixed: the row of groups is cut where the sum of their predicted
//! costs passes the next list's share. Neither objects nor groups are sorted for that. Each object's cost goes into one of
//! 4096 bins over the range of powers, a group's into the bin of its nearest member, and the cuts are between bins; so a list is a shell of space, and
//! which list an object is in follows from its own power, unless it is in a group with a nearer one. Costs are whole nanoseconds, so that sums don't
//! depend on who adds first.
//!
//! The paper merges the sorted lists of a group's objects, and then the lists of neighbouring groups. Here subobjects are sorted when it is
//! known which list they are in, once: a merge of hundreds of lists with a heap takes several times as long as sorting what is in them by buckets.

use super::cost::{CostModel, covered};
use super::eyepoint::{Eyepoint, Near, Objects, Views, bits};
use super::groups::Groups;
use super::overlap::{Mover, Overlaps};
use super::sort::{Steps, unordered};
use super::walk::{Flags, SeenBlock};
use crate::scene::blocks::{BLOCK, Blocks};
use fearless_simd::{Level, Simd, dispatch};
use proto::scene::Sphere;
use std::num::NonZeroUsize;

const BIN_BITS: u32 = 12;
const BINS: usize = 1 << BIN_BITS;

/// Which list each object is in.
#[derive(Clone, Debug, Default)]
pub(super) struct Plan {
    level: Option<Level>,
    /// Lists of a view.
    lists: usize,
    /// By view, by bin: the list of what stands alone there.
    tables: Vec<u16>,
    /// By view, by block: objects whose group decides.
    grouped: Vec<Objects>,
    blocks: usize,
    /// By view: slots of these and their lists, ascending.
    lists_of: Vec<Vec<(u32, u16)>>,
    /// By view: the lists of movers, by their place among the movers.
    pub(super) movers: Vec<Vec<u16>>,
    /// By view, by list, ns.
    pub(super) costs: Vec<u64>,
    /// By view: objects that overlap another, and groups of such.
    pub(super) marked: Vec<[u64; 2]>,
    /// By view, then by bin, ns.
    bins: Vec<u64>,
    groups: Groups,
    /// By slot: what is fixed of its cost, and what a pixel takes, ns.
    parts: Vec<[f32; 2]>,
    /// Of which database these are.
    serial: u64,
    near: Near,
}

/// What a plan is made from.
pub(super) struct Seen<'a> {
    pub(super) blocks: &'a Blocks,
    pub(super) flags: &'a Flags,
    pub(super) model: CostModel,
    /// Display elements to a radian.
    pub(super) elements: f64,
    pub(super) movers: &'a [Mover],
}

#[inline(always)]
fn bin(steps: Steps, squared: f64, radius: f64) -> usize {
    (steps.of(squared - radius * radius) >> (32 - BIN_BITS)) as usize
}

#[inline(always)]
fn nanoseconds([fixed, pixel]: [f32; 2], radius: f64, squared: f64, elements: f64) -> f64 {
    f64::from(fixed) + f64::from(pixel) * covered(radius, squared, elements)
}

/// One object: its bin, and its cost in ns, at least 1 and never so large that sums overflow.
fn of_ball(parts: [f32; 2], ball: Sphere, eyepoint: &Eyepoint, steps: Steps, elements: f64) -> (usize, u64) {
    let from = ball.centre - eyepoint.apex;
    let squared = (from.x * from.x) + (from.y * from.y) + (from.z * from.z);
    (bin(steps, squared, ball.radius), whole(nanoseconds(parts, ball.radius, squared, elements)))
}

/// A thousand seconds at most.
fn whole(nanoseconds: f64) -> u64 {
    nanoseconds.clamp(1.0, 1e12) as u64
}

impl Plan {
    /// Begins a frame's plan.
    pub(super) fn begin(&mut self, level: Level, seen: &Seen<'_>, views: usize, lists: NonZeroUsize) {
        let blocks = seen.blocks;
        if self.serial != blocks.serial() {
            self.serial = blocks.serial();
            self.parts.clear();
            self.parts
                .extend((0..blocks.count()).map(|slot| seen.model.parts(blocks.content(slot)).map(|part| part as f32)));
            self.grouped.clear();
        }
        (self.level, self.lists, self.blocks) = (Some(level), lists.get(), blocks.block_count());
        // What the last frame marked.
        for (view, list) in self.lists_of.iter_mut().enumerate() {
            for (slot, _) in list.drain(..) {
                if let Some(word) = self.grouped.get_mut(view * self.blocks + slot as usize / BLOCK) {
                    *word = 0;
                }
            }
        }
        self.grouped.resize((views * self.blocks).max(self.grouped.len()), 0);
        self.lists_of.resize_with(views, Vec::new);
        self.movers.resize_with(views, Vec::new);
        self.marked.clear();
        self.marked.resize(views, [0; 2]);
        self.costs.clear();
        self.costs.resize(views * self.lists, 0);
        self.tables.resize(views * BINS, 0);
        self.bins.clear();
        self.bins.resize(views * BINS, 0);
    }

    /// Plans the views of an eyepoint.
    pub(super) fn add(
        &mut self,
        seen: &Seen<'_>,
        eyepoint: &Eyepoint,
        steps: Steps,
        shown: &[SeenBlock],
        overlaps: &Overlaps,
    ) {
        let level = self.level.expect("a plan is begun first");
        for &SeenBlock { block, .. } in shown {
            self.add_block(level, seen, eyepoint, steps, block as usize);
        }
        for view in bits(eyepoint.views) {
            self.add_view(seen, eyepoint, steps, overlaps, view);
        }
    }

    /// The costs of a block's objects, to their own bins.
    fn add_block(&mut self, level: Level, seen: &Seen<'_>, eyepoint: &Eyepoint, steps: Steps, block: usize) {
        self.near.load(level, seen.blocks, block, eyepoint.apex);
        let slots = seen.blocks.slots_of(block);
        let parts = &self.parts[slots];
        let near = &self.near;
        let (mut bin_of, mut cost_of) = ([0u32; BLOCK], [0.0f64; BLOCK]);
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for k in 0..parts.len() {
                bin_of[k] = bin(steps, near.squared[k], near.radius[k]) as u32;
                cost_of[k] = nanoseconds(parts[k], near.radius[k], near.squared[k], seen.elements);
            }
        }));
        for view in bits(eyepoint.views) {
            let bins = &mut self.bins[view * BINS..(view + 1) * BINS];
            for k in bits(seen.flags.seen(view, block)) {
                bins[bin_of[k] as usize] += whole(cost_of[k]);
            }
        }
    }

    fn add_view(&mut self, seen: &Seen<'_>, eyepoint: &Eyepoint, steps: Steps, overlaps: &Overlaps, view: usize) {
        let Self { bins, groups, parts, .. } = self;
        let bins = &mut bins[view * BINS..(view + 1) * BINS];
        let slots = seen.blocks.count();
        let of_node = |node: u32| {
            let node = node as usize;
            if node < slots {
                of_ball(parts[node], seen.blocks.ball(node), eyepoint, steps, seen.elements)
            } else {
                let mover = &seen.movers[node - slots];
                of_ball(parts[mover.slot as usize], mover.ball, eyepoint, steps, seen.elements)
            }
        };
        let movers = || (slots as u32..).zip(seen.movers).filter(|(_, mover)| mover.views >> view & 1 == 1);
        for (node, _) in movers() {
            let (bin, cost) = of_node(node);
            bins[bin] += cost;
        }
        groups.clear(slots + seen.movers.len());
        for pair in overlaps.pairs.iter().filter(|pair| pair.views >> view & 1 == 1) {
            groups.join(pair.nodes[0], pair.nodes[1]);
        }
        groups.finish();
        // A group's cost goes to the bin of its nearest member.
        let mut count = 0;
        for group in groups.iter() {
            let nearest = group.clone().map(|node| of_node(node).0).min().unwrap_or(0);
            for (bin, cost) in group.map(of_node) {
                bins[bin] -= cost;
                bins[nearest] += cost;
            }
            count += 1;
        }
        self.marked[view] = [groups.overlapping() as u64, count];

        let table = &mut self.tables[view * BINS..(view + 1) * BINS];
        let costs = &mut self.costs[view * self.lists..(view + 1) * self.lists];
        let total: u64 = bins.iter().sum();
        let mut before = 0;
        for (list, &cost) in table.iter_mut().zip(&*bins) {
            // Where the middle of the bin's stretch of the whole cost falls.
            let middle = u128::from(before) + u128::from(cost / 2);
            let number = (middle * self.lists as u128 / u128::from(total.max(1))) as usize;
            *list = number.min(self.lists - 1) as u16;
            costs[usize::from(*list)] += cost;
            before += cost;
        }

        let (own, of_movers) = (&mut self.lists_of[view], &mut self.movers[view]);
        of_movers.clear();
        of_movers.resize(seen.movers.len(), 0);
        for (node, _) in movers() {
            of_movers[node as usize - slots] = table[of_node(node).0];
        }
        for group in groups.iter() {
            let nearest = group.clone().map(|node| of_node(node).0).min().unwrap_or(0);
            for node in group {
                match (node as usize).checked_sub(slots) {
                    Some(mover) => of_movers[mover] = table[nearest],
                    None => {
                        own.push((node, table[nearest]));
                        self.grouped[view * self.blocks + node as usize / BLOCK] |= 1 << (node as usize % BLOCK);
                    }
                }
            }
        }
        own.sort_unstable();
    }

    /// The first and the last list of what stands alone in a block.
    fn between(&self, view: usize, steps: Steps, seen: &SeenBlock) -> [u16; 2] {
        // A little more than the block's range: rounding may have put an object beyond it.
        let [nearest, farthest] = [seen.nearest, seen.farthest].map(unordered);
        let margin = (nearest.abs() + farthest.abs()) * 1e-9;
        let of = |power: f64| self.tables[view * BINS + (steps.of(power) >> (32 - BIN_BITS)) as usize];
        [of(nearest - margin), of(farthest + margin)]
    }

    /// Whether, for each of these views, all of a block that stands alone is in one list: then [`Self::split`] doesn't look where it is.
    pub(super) fn is_in_one_list(&self, views: Views, steps: Steps, seen: &SeenBlock) -> bool {
        bits(views).all(|view| {
            let [first, last] = self.between(view, steps, seen);
            first == last
        })
    }

    /// Calls `copy` with each list and those of a block's `objects` that are in it. `near` holds the block, unless it is in one list.
    pub(super) fn split(
        &self,
        view: usize,
        seen: &SeenBlock,
        objects: Objects,
        near: &Near,
        steps: Steps,
        mut copy: impl FnMut(usize, Objects),
    ) {
        let (table, block) = (&self.tables[view * BINS..(view + 1) * BINS], seen.block as usize);
        let grouped = self.grouped[view * self.blocks + block] & objects;
        let [first, last] = self.between(view, steps, seen);
        let mut lists = [first; BLOCK];
        if first != last {
            for k in bits(objects & !grouped) {
                lists[k] = table[bin(steps, near.squared[k], near.radius[k])];
            }
        }
        let of_groups = &self.lists_of[view];
        for k in bits(grouped) {
            lists[k] = self.list_of(of_groups, (block * BLOCK + k) as u32);
        }
        let mut left = objects;
        if first == last {
            let same = bits(grouped).filter(|&k| lists[k] == first).fold(objects & !grouped, |mask, k| mask | 1 << k);
            if same != 0 {
                copy(usize::from(first), same);
            }
            left &= !same;
        }
        while left != 0 {
            let list = lists[left.trailing_zeros() as usize];
            let same = bits(left).filter(|&k| lists[k] == list).fold(0, |mask, k| mask | 1 << k);
            copy(usize::from(list), same);
            left &= !same;
        }
    }

    /// The list of one object.
    pub(super) fn list_of_slot(
        &self,
        view: usize,
        slot: usize,
        ball: Sphere,
        eyepoint: &Eyepoint,
        steps: Steps,
    ) -> usize {
        if self.grouped[view * self.blocks + slot / BLOCK] >> (slot % BLOCK) & 1 == 1 {
            return usize::from(self.list_of(&self.lists_of[view], slot as u32));
        }
        let (bin, _) = of_ball([0.0; 2], ball, eyepoint, steps, 0.0);
        usize::from(self.tables[view * BINS + bin])
    }

    fn list_of(&self, of_groups: &[(u32, u16)], slot: u32) -> u16 {
        let at = of_groups.partition_point(|&(other, _)| other < slot);
        of_groups[at].1
    }

    /// The groups of the view that was planned last, of nodes.
    #[cfg(test)]
    pub(super) fn last_groups(&self) -> impl Iterator<Item = Vec<u32>> {
        self.groups.iter().map(Iterator::collect)
    }

    /// Bytes that are kept from frame to frame.
    pub(super) fn bytes(&self) -> usize {
        self.parts.capacity() * size_of::<[f32; 2]>() + self.grouped.capacity() * size_of::<Objects>()
    }
}

/// Who draws which list.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Channels {
    /// By list: its channel.
    pub of_list: Vec<usize>,
    /// By channel: the sum of its lists' costs, ns.
    pub costs: Vec<u64>,
}

/// Assigns lists of these costs to channels: the longest first, each to the channel that has the least to do (Graham's rule: never worse than 4/3 of
/// the best). Ties go to the smaller number.
pub fn longest_first(costs: &[u64], channels: NonZeroUsize) -> Channels {
    let mut order: Vec<usize> = (0..costs.len()).collect();
    order.sort_by_key(|&list| (std::cmp::Reverse(costs[list]), list));
    let mut found = Channels { of_list: vec![0; costs.len()], costs: vec![0; channels.get()] };
    for list in order {
        let channel = (0..channels.get()).min_by_key(|&channel| (found.costs[channel], channel)).unwrap_or(0);
        found.of_list[list] = channel;
        found.costs[channel] = found.costs[channel].saturating_add(costs[list]);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_lists_go_first_and_to_whom_has_least() {
        let found = longest_first(&[3, 7, 5, 4, 1], NonZeroUsize::new(2).unwrap());
        assert_eq!(found, Channels { of_list: vec![0, 0, 1, 1, 1], costs: vec![10, 10] });
        assert_eq!(longest_first(&[], NonZeroUsize::MIN).costs, [0]);
    }
}
