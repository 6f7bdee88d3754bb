//! Faces side by side before a backdrop: an outline, mostly.
//!
//! Where the nearer faces don't overlap each other, and what is behind them is the background or one [`super::sheet`], nothing
//! has to be cut up: of each face of the sheet is seen its area less what the nearer faces take of it. Each of these areas is that
//! of one triangle cut by another's lines.

use super::ExactFace;
use super::cells::TooMany;
use super::polygon::{Polygon, SQUARE, Sides};
use super::prepare::Faces;
use super::regions::{NOTHING, Sum};
use super::sheet::Sheets;

/// Most nearer faces. A guess: they are compared pair by pair, and more seldom are side by side.
const NEARER_MAX: usize = 8;

/// Buffers.
#[derive(Debug)]
pub(super) struct Mosaic {
    /// The parts of the pixel that the nearer faces cover.
    pieces: [Polygon; NEARER_MAX],
    both: Polygon,
    room: Polygon,
    sides: [Sides; 3],
}

impl Default for Mosaic {
    fn default() -> Self {
        let (both, room) = (Polygon::EMPTY, Polygon::EMPTY);
        Self { pieces: [Polygon::EMPTY; NEARER_MAX], both, room, sides: Default::default() }
    }
}

impl Mosaic {
    /// The pixel's colour if that is all there is in it. The shared edges are known, and no face is of a model that
    /// needs mixing.
    pub(super) fn colour(
        &mut self,
        faces: &[ExactFace<'_>],
        order: &Faces,
        sheets: &mut Sheets,
        background: [f64; 3],
    ) -> Result<Option<[f64; 3]>, TooMany> {
        let most = order.len().min(NEARER_MAX);
        // The first face was asked before.
        let backdrop = (1..=most.min(order.len() - 1)).find(|k| sheets.covers_from(faces, order, *k));
        let nearer = match backdrop {
            Some(k) if sheets.found().all(|member| member >= k) => k,
            None if order.len() <= most => order.len(),
            _ => return Ok(None),
        };
        let last = backdrop.and_then(|_| sheets.found().next_back());
        if !(0..nearer).all(|k| order.is_in_front_of_all_after(k, nearer - 1)) {
            return Ok(None);
        }
        for k in 0..nearer {
            let lines = order.at(k).lines();
            if !SQUARE.keep_inside(lines, &mut self.sides, &mut self.pieces[k], &mut self.room).ok_or(TooMany)? {
                self.pieces[k] = Polygon::EMPTY;
            }
            for other in 0..k {
                if !sheets.are_neighbours(k, other) && self.overlap(order, k, other)? {
                    return Ok(None);
                }
            }
        }
        let mut sum = Sum::default();
        let mut open = 1.0;
        for k in 0..nearer {
            let face = &faces[order.at(k).face];
            let area = self.pieces[k].area();
            sum.add(face.rgb, area * face.alpha);
            open -= area * face.alpha;
            let mut left = area;
            let Some(last) = last else { continue };
            for behind in sheets.found() {
                if left < NOTHING {
                    break;
                }
                // The sheet covers the pixel, so its last face is behind whatever is left.
                let hidden = if behind == last {
                    left
                } else {
                    let lines = order.at(behind).lines();
                    let piece = &self.pieces[k];
                    if !piece.keep_inside(lines, &mut self.sides, &mut self.both, &mut self.room).ok_or(TooMany)? {
                        continue;
                    }
                    self.both.area()
                };
                left -= hidden;
                sum.add(faces[order.at(behind).face].rgb, -hidden * face.alpha);
            }
        }
        if last.is_none() {
            sum.add(background, open);
            return Ok(Some(sum.0));
        }
        for behind in sheets.found() {
            sum.add(faces[order.at(behind).face].rgb, sheets.area(behind));
        }
        Ok(Some(sum.0))
    }

    /// Whether the pieces of two nearer faces overlap.
    #[inline]
    fn overlap(&mut self, order: &Faces, a: usize, b: usize) -> Result<bool, TooMany> {
        if order.at(a).around.are_apart(&order.at(b).around) {
            return Ok(false);
        }
        let [a, b] = [a, b].map(|k| (&self.pieces[k], order.at(k).lines()));
        if b.0.set_crossing(a.1, &mut self.sides).is_none() {
            return Ok(false);
        }
        let is_met = a.0.keep_inside(b.1, &mut self.sides, &mut self.both, &mut self.room).ok_or(TooMany)?;
        Ok(is_met && self.both.area() >= NOTHING)
    }
}
