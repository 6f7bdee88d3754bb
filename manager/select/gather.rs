//! From visual flags to entries to be sorted: the subobjects of all that is seen, with the steps of their powers.
//!
//! Blocks come nearest first, and a block's subobjects lie one after another: powers are worked out for a whole stretch of them, as vectors, once for all
//! views. What is copied into a view's list are runs of objects, for the largest of a block come first, and what is seen of it are mostly the first few.

use super::eyepoint::{Eyepoint, Near, Objects, bits};
use super::sort::{Entry, Steps, entry};
use super::spread::Plan;
use super::walk::{Flags, SeenBlock};
use crate::scene::blocks::{BLOCK, Blocks};
use fearless_simd::{Level, Simd, dispatch};
use glam::DVec3;

/// What one processor gathers.
#[derive(Clone, Debug, Default)]
pub(super) struct Gathered {
    /// By view, then by list.
    pub(super) lists: Vec<Vec<Entry>>,
    steps: Vec<u32>,
    near: Near,
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
        self.lists.resize_with(lists.max(self.lists.len()), Vec::new);
        self.lists.iter_mut().for_each(Vec::clear);
    }
}

impl Gather<'_> {
    /// Gathers what the eyepoint's views see whole of these blocks.
    pub(super) fn blocks(&self, out: &mut Gathered, eyepoint: &Eyepoint, steps: Steps, seen: &[SeenBlock]) {
        let Self { blocks, flags, .. } = *self;
        for &SeenBlock { block, .. } in seen {
            let block = block as usize;
            let whole = |view: usize| flags.seen(view, block) & !flags.partly(view, block);
            let any = bits(eyepoint.views).fold(0, |any, view| any | whole(view));
            if any == 0 {
                continue;
            }
            let slot = block * BLOCK;
            let [from, to] =
                [any.trailing_zeros(), 64 - any.leading_zeros()].map(|k| blocks.first[slot + k as usize] as usize);
            steps_of(self.level, blocks, block, from..to, eyepoint.apex, steps, &mut out.steps);
            if self.plan.is_some() {
                out.near.load(self.level, blocks, block, eyepoint.apex);
            }
            for view in bits(eyepoint.views) {
                let Gathered { lists, steps: found, near } = &mut *out;
                let mut copy = |list: usize, objects: Objects| {
                    let list = &mut lists[view * self.lists + list];
                    runs(objects, |start, end| {
                        let [a, b] = [start, end].map(|k| blocks.first[slot + k] as usize);
                        let pieces = found[a - from..b - from].iter().zip(&blocks.ids[a..b]);
                        list.extend(pieces.map(|(&step, &id)| entry(step, id)));
                    });
                };
                match self.plan {
                    None => copy(0, whole(view)),
                    Some(plan) => plan.split(view, block, whole(view), near, steps, copy),
                }
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

/// Steps of the powers of a block's subobjects, by place. Replaces the content of `out`.
fn steps_of(
    level: Level,
    blocks: &Blocks,
    block: usize,
    places: std::ops::Range<usize>,
    apex: DVec3,
    steps: Steps,
    out: &mut Vec<u32>,
) {
    let grid = blocks.grids[block];
    let balls = &blocks.pieces;
    out.resize(places.len(), 0);
    let [x, y, z, radius] = [&balls.x, &balls.y, &balls.z, &balls.radius].map(|list| &list[places.clone()]);
    let out = &mut out[..];
    dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
        // The operations of `power`, in its order.
        for ((((out, &x), &y), &z), &radius) in out.iter_mut().zip(x).zip(y).zip(z).zip(radius) {
            let x = (grid.origin.x + f64::from(x) * grid.unit) - apex.x;
            let y = (grid.origin.y + f64::from(y) * grid.unit) - apex.y;
            let z = (grid.origin.z + f64::from(z) * grid.unit) - apex.z;
            let radius = f64::from(radius) * grid.unit;
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
