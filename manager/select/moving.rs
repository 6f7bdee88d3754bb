//! Objects that have moved: they are not in the tree, and are asked in batches of 64, as a block is.

use super::Counters;
use super::eyepoint::{Eyepoint, Near, bits, lowest};
use super::frustum::Frustum;
use super::overlap::Mover;
use super::world::{Body, World};
use crate::scene::blocks::BLOCK;
use fearless_simd::Level;

/// A subobject of a mover.
#[derive(Clone, Copy, Debug)]
pub(super) struct MovedPiece {
    pub(super) view: u32,
    /// Its object's place among the movers.
    pub(super) mover: u32,
    /// Counted from the object's first.
    pub(super) piece: u32,
}

/// What is seen of moved objects.
#[derive(Clone, Debug, Default)]
pub(super) struct Moving {
    /// Of the objects, by eyepoint and in the world's order.
    pub(super) movers: Vec<Mover>,
    pub(super) pieces: Vec<MovedPiece>,
    near: Near,
}

impl Moving {
    pub(super) fn clear(&mut self) {
        self.movers.clear();
        self.pieces.clear();
    }

    /// Asks all moved objects for the views of an eyepoint.
    pub(super) fn find<W: World>(
        &mut self,
        world: &W,
        level: Level,
        eyepoint: &Eyepoint,
        frusta: &[Frustum],
        reach: Option<f64>,
        counters: &mut [Counters],
    ) {
        let count = world.moved_count();
        for from in (0..count).step_by(BLOCK) {
            let batch = from..count.min(from + BLOCK);
            for moved in batch.clone() {
                self.near.put(moved - from, world.moved_ball(moved), eyepoint.apex);
            }
            self.near.measure_all(level);
            let here = lowest(batch.len());
            let large = reach.map_or(here, |reach| self.near.large(level, reach));
            let (mut seen_by, mut any) = ([0; BLOCK], 0);
            for view in bits(eyepoint.views) {
                let (outside, inside) = self.near.ask(level, &frusta[view]);
                let counters = &mut counters[view];
                counters.objects_tested += batch.len() as u64;
                counters.objects_small += u64::from((here & !outside & !large).count_ones());
                for k in bits(here & !outside & large) {
                    let before = self.pieces.len();
                    self.one(world, from + k, view, inside >> k & 1 == 1, &frusta[view], counters);
                    if self.pieces.len() > before {
                        counters.objects_visible += 1;
                        seen_by[k] |= 1 << view;
                        any |= 1 << k;
                    }
                }
            }
            // Pieces know the moved object so far; they are to know the mover.
            let first = self.movers.len() as u32;
            let mut number = [0; BLOCK];
            for (place, k) in bits(any).enumerate() {
                number[k] = first + place as u32;
                let moved = (from + k) as u32;
                let slot = world.blocks().slot(world.moved_object(from + k)) as u32;
                self.movers.push(Mover { moved, slot, ball: world.moved_ball(from + k), views: seen_by[k] });
            }
            let batch_pieces = self.pieces.iter_mut().rev().take_while(|piece| piece.mover & UNNUMBERED != 0);
            for piece in batch_pieces {
                piece.mover = number[(piece.mover & !UNNUMBERED) as usize - from];
            }
        }
    }

    fn one<W: World>(
        &mut self,
        world: &W,
        moved: usize,
        view: usize,
        is_inside: bool,
        frustum: &Frustum,
        counters: &mut Counters,
    ) {
        let object = world.moved_object(moved);
        let first = world.first_piece(object);
        let pieces = &mut self.pieces;
        let mut take = |piece: usize| {
            if world.is_shown(first + piece as u32) {
                pieces.push(MovedPiece { view: view as u32, mover: moved as u32 | UNNUMBERED, piece: piece as u32 });
            }
        };
        if is_inside {
            let blocks = world.blocks();
            (0..blocks.places(blocks.slot(object)).len()).for_each(take);
        } else {
            world.across(Body::Moved(moved), frustum, counters, &mut take);
        }
    }
}

/// Marks a piece whose mover has no number yet.
const UNNUMBERED: u32 = 1 << 31;
