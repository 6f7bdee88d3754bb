//! From visual flags to entries to be sorted: the subobjects of all that is seen, with the steps of their powers.
//!
//! Blocks come nearest first, and a block's subobjects lie one after another: powers are worked out for a whole stretch of them, as vectors, once for all
//! views. What is copied into a view's list are runs of objects, for the largest of a block come first, and what is seen of it are mostly the first few.
//!
//! Sorting goes along: no block to come has anything nearer than its ball, so what is nearer than that is final. Every few thousand entries it is parted from
//! what isn't, sorted, and put behind what was sorted before. That way nothing larger than a second-level cache is ever sorted.

use super::eyepoint::{Eyepoint, Near, Objects, bits};
use super::sort::{self, Entry, Steps, entry, unordered};
use super::spread::Plan;
use super::walk::{Flags, SeenBlock, room};
use crate::scene::blocks::{BLOCK, Blocks, Grid, PieceBalls};
use fearless_simd::{Level, Simd, dispatch};
use glam::DVec3;
use std::ops::Range;
use std::time::{Duration, Instant};

/// New entries from which on it is worth while to sort what is final; 64 KB.
const SETTLE_FROM: usize = 8192;

/// A list that is being sorted while it grows.
#[derive(Clone, Debug, Default)]
pub(super) struct Growing {
    /// Sorted, and before all of `open`.
    pub(super) sorted: Vec<Entry>,
    open: Vec<Entry>,
    /// What was left open last time.
    left: usize,
}

/// What one processor gathers.
#[derive(Clone, Debug, Default)]
pub(super) struct Gathered {
    /// By view, then by list.
    pub(super) lists: Vec<Growing>,
    /// How long sorting took.
    pub(super) sorting: Duration,
    scratch: sort::Scratch,
    parted: Vec<Entry>,
    steps: Vec<u32>,
    near: Near,
}

impl Growing {
    /// Adds an entry.
    pub(super) fn push(&mut self, entry: Entry) {
        self.open.push(entry);
    }

    /// Sorts what is below a step, or all: no such entry may come later.
    fn settle(
        &mut self,
        below: Option<u32>,
        parted: &mut Vec<Entry>,
        scratch: &mut sort::Scratch,
        power: impl Fn(u32) -> u64,
    ) {
        let limit = below.map_or(Entry::MAX, |below| entry(below, 0));
        parted.resize(self.open.len(), 0);
        let (mut left, mut gone) = (0, 0);
        // Both are written and one is kept, for which it is can't be foreseen.
        for i in 0..self.open.len() {
            let entry = self.open[i];
            (self.open[left], parted[gone]) = (entry, entry);
            let is_final = entry < limit;
            gone += usize::from(is_final);
            left += usize::from(!is_final);
        }
        self.open.truncate(left);
        self.left = left;
        parted.truncate(gone);
        sort::append(parted, scratch, power, &mut self.sorted);
    }
}

/// What gathering reads.
pub(super) struct Gather<'a> {
    pub(super) blocks: &'a Blocks,
    pub(super) flags: &'a Flags,
    pub(super) level: Level,
    /// Lists of a view, and which object is in which; `None`: there is one.
    pub(super) plan: Option<&'a Plan>,
    /// Lists of a view.
    pub(super) lists: usize,
}

impl Gathered {
    pub(super) fn clear(&mut self, lists: usize) {
        self.lists.resize_with(lists.max(self.lists.len()), Growing::default);
        for list in &mut self.lists {
            list.sorted.clear();
            list.open.clear();
            list.left = 0;
        }
        self.sorting = Duration::ZERO;
    }

    /// Sorts what is below a step, of lists that have grown long enough; or, without a step, all that is left of all.
    fn settle(
        &mut self,
        lists: Range<usize>,
        below: Option<u32>,
        view_of: impl Fn(usize) -> usize,
        powers: &impl Fn(usize, u32) -> u64,
    ) {
        let started = Instant::now();
        let mut is_any = false;
        for number in lists {
            let list = &mut self.lists[number];
            if below.is_none() || list.open.len() >= 2 * list.left + SETTLE_FROM {
                let view = view_of(number);
                list.settle(below, &mut self.parted, &mut self.scratch, |id| powers(view, id));
                is_any = true;
            }
        }
        if is_any {
            self.sorting += started.elapsed();
        }
    }

    /// Room for so many entries of a list, wherever they are put on their way.
    pub(super) fn make_room(&mut self, list: usize, entries: usize) {
        let list = &mut self.lists[list];
        room(&mut list.sorted, entries);
        room(&mut list.open, entries);
        room(&mut self.parted, entries);
        self.scratch.make_room(entries);
    }

    /// Most subobjects of a block that there is room for.
    pub(super) fn steps_room(&self) -> usize {
        self.steps.capacity()
    }

    /// Room for so many subobjects of a block.
    pub(super) fn make_room_for_steps(&mut self, count: usize) {
        room(&mut self.steps, count);
    }

    /// Sorts what is left of these lists.
    pub(super) fn finish(&mut self, count: usize, per_view: usize, powers: impl Fn(usize, u32) -> u64) {
        self.settle(0..count, None, |list| list / per_view, &powers);
    }
}

impl Gather<'_> {
    /// Gathers what the eyepoint's views see whole of these blocks.
    ///
    /// The blocks of one call are nearest first, and those of a later call no nearer than the last of these.
    pub(super) fn blocks(
        &self,
        out: &mut Gathered,
        eyepoint: &Eyepoint,
        steps: Steps,
        seen: &[SeenBlock],
        powers: &impl Fn(usize, u32) -> u64,
    ) {
        let Self { blocks, flags, .. } = *self;
        for seen in seen {
            let block = seen.block as usize;
            let whole = |view: usize| flags.seen(view, block) & !flags.partly(view, block);
            let any = bits(eyepoint.views).fold(0, |any, view| any | whole(view));
            if any == 0 {
                continue;
            }
            let slot = block * BLOCK;
            let first = blocks.first[slot];
            let place = |k: usize| (blocks.first[slot + k] - first) as usize;
            let [from, to] = [any.trailing_zeros(), 64 - any.leading_zeros()].map(|k| place(k as usize));
            let pieces = blocks.pieces_of(block);
            steps_of(self.level, pieces, blocks.grids[block], from..to, eyepoint.apex, steps, &mut out.steps);
            if self.plan.is_some_and(|plan| !plan.is_in_one_list(eyepoint.views, steps, seen)) {
                out.near.load(self.level, blocks, block, eyepoint.apex);
            }
            for view in bits(eyepoint.views) {
                let Gathered { lists, steps: found, near, .. } = &mut *out;
                let mut copy = |list: usize, objects: Objects| {
                    let list = &mut lists[view * self.lists + list];
                    runs(objects, |start, end| {
                        let (a, b) = (place(start), place(end));
                        let pieces = found[a - from..b - from].iter().zip(&pieces.ids[a..b]);
                        list.open.extend(pieces.map(|(&step, &id)| entry(step, id)));
                    });
                };
                match self.plan {
                    None => copy(0, whole(view)),
                    Some(plan) => plan.split(view, seen, whole(view), near, steps, copy),
                }
            }
        }
        if let Some(last) = seen.last() {
            // Rounding may have put a subobject a little before its block's ball.
            let nearest = unordered(last.nearest);
            let below = steps.of(nearest - nearest.abs() * 1e-9);
            for view in bits(eyepoint.views) {
                out.settle(view * self.lists..(view + 1) * self.lists, Some(below), |_| view, powers);
            }
        }
    }
}

/// Calls `run` with the beginning and the end of each run of set bits.
fn runs(mut mask: Objects, mut run: impl FnMut(usize, usize)) {
    let mut at = 0;
    while mask != 0 {
        let skip = mask.trailing_zeros();
        let ones = (mask >> skip).trailing_ones();
        run((at + skip) as usize, (at + skip + ones) as usize);
        at += skip + ones;
        mask = mask.checked_shr(skip + ones).unwrap_or(0);
    }
}

/// Steps of the powers of some of a block's subobjects. Replaces the content of `out`.
fn steps_of(
    level: Level,
    pieces: PieceBalls<'_>,
    grid: Grid,
    places: Range<usize>,
    apex: DVec3,
    steps: Steps,
    out: &mut Vec<u32>,
) {
    out.resize(places.len(), 0);
    let [x, y, z, radius] = [pieces.x, pieces.y, pieces.z, pieces.radius].map(|column| &column[places.clone()]);
    let out = &mut out[..];
    dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
        // The operations of `power`, in its order.
        for ((((out, &x), &y), &z), &radius) in out.iter_mut().zip(x).zip(y).zip(z).zip(radius) {
            let x = (grid.origin.x + f64::from(f32::from_bits(x)) * grid.unit) - apex.x;
            let y = (grid.origin.y + f64::from(f32::from_bits(y)) * grid.unit) - apex.y;
            let z = (grid.origin.z + f64::from(f32::from_bits(z)) * grid.unit) - apex.z;
            let radius = f64::from(f32::from_bits(radius)) * grid.unit;
            *out = steps.of((x * x) + (y * y) + (z * z) - radius * radius);
        }
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_the_runs_of_ones() {
        for (mask, expected) in [
            (0, vec![]),
            (1, vec![(0, 1)]),
            (u64::MAX, vec![(0, 64)]),
            (0b0110_0101, vec![(0, 1), (2, 3), (5, 7)]),
            (1 << 63 | 1 << 62, vec![(62, 64)]),
        ] {
            let mut found = Vec::new();
            runs(mask, |start, end| found.push((start, end)));
            assert_eq!(found, expected, "{mask:b}");
        }
    }
}
