//! Faces taken from front to back: each takes its share of what the nearer ones left.
//!
//! What is left of the pixel is a few convex regions, each with what the faces so far let through there. A face cuts the
//! regions that its edges cross; the parts outside stay as they were, the parts inside count with its colour, and stay if it is
//! translucent. When nothing is left, what is farther is never looked at.
//!
//! That is right as long as the order at the pixel's centre is the order wherever two faces overlap, which is checked
//! for the parts where it matters, cheapest question first: is the face nearer than all that follow; is the difference of
//! two faces' inverse distances of one sign over the pixel; do they share an edge; does an edge of the
//! other keep it out of the part; is the difference of one sign over the part. Where all answers are no, and where a face
//! belongs to a model, the part is left to [`super::cells`].

use super::ExactFace;
use super::cells::{Cells, TooMany};
use super::polygon::{Bounds, Polygon, SQUARE, Sides};
use super::prepare::Faces;
use super::sheet::Sheets;
use crate::room::room;

/// Most regions of a pixel. A guess: a mesh with a hole and 140 faces in the pixel gets by with it, in 0.3 ms.
pub const REGIONS_MAX: usize = 512;

/// Areas below this are nothing, pixels².
pub(super) const NOTHING: f64 = 1e-12;

/// A part of the pixel.
#[derive(Clone, Copy, Debug)]
struct Region {
    polygon: Polygon,
    around: Bounds,
    /// What the faces so far let through of what is behind them.
    transmitted: f64,
}

impl Region {
    const EMPTY: Self = Self { polygon: Polygon::EMPTY, around: Bounds::SQUARE, transmitted: 0.0 };
}

/// What is left of the pixel.
#[derive(Debug, Default)]
pub(super) struct Regions {
    /// The first `count` are regions, the others are room.
    regions: Vec<Region>,
    count: usize,
    scratch: Scratch,
}

room!(Regions: regions; count, scratch);

/// Room for cutting.
#[derive(Debug)]
struct Scratch {
    /// A region's part inside of a face.
    inside: Polygon,
    /// Before the last cut.
    before: Polygon,
    /// Of a part, what another face covers too, and room for cutting it.
    both: [Polygon; 2],
    sides: [Sides; 3],
}

impl Default for Scratch {
    fn default() -> Self {
        Self { inside: Polygon::EMPTY, before: Polygon::EMPTY, both: [Polygon::EMPTY; 2], sides: [Sides::default(); 3] }
    }
}

/// Light gathered, linear RGB times pixels².
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sum(pub(super) [f64; 3]);

impl Sum {
    #[inline]
    pub(super) fn add(&mut self, rgb: [f64; 3], share: f64) {
        for (sum, c) in self.0.iter_mut().zip(rgb) {
            *sum += c * share;
        }
    }
}

impl Regions {
    /// The pixel's colour. The shared edges are known.
    pub(super) fn colour(
        &mut self,
        faces: &[ExactFace<'_>],
        order: &Faces,
        sheets: &Sheets,
        cells: &mut Cells,
        background: [f64; 3],
    ) -> Result<[f64; 3], TooMany> {
        let mut sum = Sum::default();
        self.count = 0;
        let all = self.room()?;
        all.polygon.set(&SQUARE);
        (all.around, all.transmitted) = (Bounds::SQUARE, 1.0);
        self.count = 1;
        // What no opaque face was found for yet, pixels².
        let mut open = 1.0;
        for k in 0..order.len() {
            if order.at(k).is_part {
                for region in &self.regions[..self.count] {
                    cells.add(faces, order, k, &region.polygon, region.transmitted, background, &mut sum)?;
                }
                return Ok(sum.0);
            }
            open -= self.take(faces, order, sheets, cells, k, background, &mut sum)?;
            if open < NOTHING || self.count == 0 {
                return Ok(sum.0);
            }
        }
        for region in &self.regions[..self.count] {
            sum.add(background, region.transmitted * region.polygon.area());
        }
        Ok(sum.0)
    }

    /// Gives face k its share, and returns the area that it closed.
    fn take(
        &mut self,
        faces: &[ExactFace<'_>],
        order: &Faces,
        sheets: &Sheets,
        cells: &mut Cells,
        k: usize,
        background: [f64; 3],
        sum: &mut Sum,
    ) -> Result<f64, TooMany> {
        let mut closed = 0.0;
        let prepared = order.at(k);
        let face = &faces[prepared.face];
        // Backwards, because what is done with is replaced by the last, and what is new is not for this face.
        for r in (0..self.count).rev() {
            if self.regions[r].around.are_apart(&prepared.around) || !self.cut_out(order, k, r)? {
                continue;
            }
            let area = self.scratch.inside.area();
            let transmitted = self.regions[r].transmitted;
            let is_in_order = order.is_in_front_of_all_after(k, k)
                || (k + 1..order.len()).all(|other| self.scratch.is_behind(order, sheets, k, other));
            if is_in_order {
                sum.add(face.rgb, area * (transmitted * face.alpha));
            } else {
                cells.add(faces, order, k, &self.scratch.inside, transmitted, background, sum)?;
            }
            if is_in_order && face.alpha < 1.0 {
                let region = &mut self.regions[r];
                region.polygon.set(&self.scratch.inside);
                region.around = Bounds::of(region.polygon.corners());
                region.transmitted = transmitted * (1.0 - face.alpha);
            } else {
                closed += area;
                self.count -= 1;
                let (kept, last) = self.regions.split_at_mut(self.count);
                if let (Some(kept), Some(last)) = (kept.get_mut(r), last.first()) {
                    kept.polygon.set(&last.polygon);
                    (kept.around, kept.transmitted) = (last.around, last.transmitted);
                }
            }
        }
        Ok(closed)
    }

    /// Cuts region r: what is inside of face k comes to the scratch, what is outside becomes new regions. If nothing is inside, it
    /// returns false.
    #[inline]
    fn cut_out(&mut self, order: &Faces, k: usize, r: usize) -> Result<bool, TooMany> {
        let Scratch { inside, before, sides, .. } = &mut self.scratch;
        let lines = order.at(k).lines();
        let region = &self.regions[r];
        let Some(mut crossing) = region.polygon.set_crossing(lines, sides) else { return Ok(false) };
        let transmitted = region.transmitted;
        if crossing == 0 {
            inside.set(&region.polygon);
        }
        let mut is_cut = false;
        while crossing != 0 {
            let i = crossing.trailing_zeros() as usize;
            crossing &= crossing - 1;
            let sides = &mut sides[i];
            if is_cut {
                inside.set_sides(&lines[i], sides);
                if sides.inside == 0 {
                    // Each edge crosses the region, but what the others left of it is outside of this one.
                    let region = &mut self.regions[r];
                    region.polygon.set(inside);
                    region.around = Bounds::of(inside.corners());
                    return Ok(false);
                }
                if sides.outside == 0 {
                    continue;
                }
            }
            before.set(if is_cut { inside } else { &self.regions[r].polygon });
            if before.is_full() {
                return Err(TooMany);
            }
            let outside = room(&mut self.regions, self.count)?;
            before.cut(sides, inside, &mut outside.polygon);
            outside.around = Bounds::of(outside.polygon.corners());
            outside.transmitted = transmitted;
            self.count += 1;
            is_cut = true;
        }
        Ok(true)
    }

    #[inline]
    fn room(&mut self) -> Result<&mut Region, TooMany> {
        room(&mut self.regions, self.count)
    }
}

#[inline]
fn room(regions: &mut Vec<Region>, count: usize) -> Result<&mut Region, TooMany> {
    if count == regions.len() {
        if count == REGIONS_MAX {
            return Err(TooMany);
        }
        regions.push(Region::EMPTY);
    }
    Ok(&mut regions[count])
}

impl Scratch {
    /// Whether face `other` is nowhere in front of face k within the part of it that is inside.
    fn is_behind(&mut self, order: &Faces, sheets: &Sheets, k: usize, other: usize) -> bool {
        let part = &self.inside;
        let (front, back) = (order.at(k), order.at(other));
        if front.around.are_apart(&back.around) {
            return true;
        }
        let difference = front.in_front_of(back);
        let is_in_front =
            |part: &Polygon| part.corners().iter().all(|corner| difference.at(*corner) >= -difference.slack);
        if difference.over_square()[0] >= -difference.slack || sheets.are_neighbours(k, other) {
            return true;
        }
        let [both, room] = &mut self.both;
        match part.keep_inside(back.lines(), &mut self.sides, both, room) {
            None => return false,
            Some(false) => return true,
            Some(true) => {}
        }
        is_in_front(both) || both.area() < NOTHING
    }
}
