//! The exact pixel: the box filter's integral over flat-coloured faces, by area instead of by samples.
//!
//! The design book's page *The right picture*, "One pixel", says what a pixel is: the mean, in linear light, of what is
//! seen over its square; area times colour, as seed 002 (EP 0 621 548) computes it for its faces' edges. Sampling approximates it, with n
//! points to about 1/n of the edges' contrast; here it is computed, from the faces' corners, to rounding. A face's
//! colour is one per pixel, so the integral is a sum of visible areas times colours, and what remains is to find the areas. Four ways,
//! each taken where the one before doesn't answer:
//!
//! 1. `sheet`: faces that share all their edges within the pixel, as a mesh's do away from its outline, or several such sheets one behind the
//!    other. Their areas come from the edges, without any cutting.
//! 2. `mosaic`: faces side by side before a sheet or the background, as at a mesh's outline. Areas less the areas of overlaps.
//! 3. `regions`: faces from front to back, each taking its part of what is left, translucent ones leaving a part. For
//!    layers, and whatever else has one order.
//! 4. `cells`: cut until everything has one order and one set of faces. For surfaces that interpenetrate or overlap in a circle, and for
//!    merged models.
//!
//! A pixel with versions of models in transition is the weighted mean of pixels without (`versions`).
//!
//! A pixel that needs more than a named number of regions or cells is cut into quarters (`quarters`), and these again; what is still
//! too much after that is sampled instead (`points`), and counted.
//!
//! The colour is a function of the set of faces and the background, to the bit: faces are sorted by what they are before
//! anything is added, so the order in which they are handed over has no say.
//!
//! Errors: positions within the pixel are right to about 1e-15 pixel for corners near it and 1e-9 for corners 1e7 pixels away;
//! pieces thinner than 1e-13 pixel or smaller than 1e-12 pixels² may be given to a neighbour. All in all below 1e-6 of full scale.

mod cells;
mod mosaic;
mod points;
mod polygon;
mod prepare;
mod quarters;
mod regions;
mod sheet;
pub mod stage;
#[cfg(test)]
mod tests;
mod versions;

use crate::room::room;
use crate::translucency::models::Member;

pub use cells::CELLS_MAX;
pub use points::SAMPLES_INSTEAD;
pub use regions::REGIONS_MAX;

/// What a face of a model is to it.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a> {
    /// Its model and version.
    pub member: Member<'a>,
    /// Whether the face is translucent by its material, whatever its saturation here: of a merged model only the nearest such counts.
    pub is_translucent: bool,
}

/// A triangle with one colour, in pixels relative to the upper left of the pixel, x to the right, y down.
#[derive(Clone, Copy, Debug)]
pub struct ExactFace<'a> {
    /// Corners, so that the area is positive: clockwise as seen. Up to 1e7 pixels away.
    pub x: [f64; 3],
    /// Corners.
    pub y: [f64; 3],
    /// Inverse distance at the pixel's upper left; larger is nearer.
    pub q0: f64,
    /// Its change per pixel to the right.
    pub qx: f64,
    /// Its change per pixel downwards.
    pub qy: f64,
    /// Where faces are equally near, the larger is in front.
    pub order: u64,
    /// Saturation, 0 to 1; 1 is opaque, 0 is not there.
    pub alpha: f64,
    /// Linear RGB.
    pub rgb: [f64; 3],
    /// What it belongs to, if its model is merged or has versions.
    pub part: Option<Part<'a>>,
}

/// How pixels were computed. Each is counted once, but for `versions`, which are counted besides; for these the longest of the ways
/// that were taken counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Met by no face.
    pub empty: u64,
    /// By sheets of faces, one behind the other.
    pub sheets: u64,
    /// By faces side by side before a sheet or the background.
    pub mosaics: u64,
    /// From front to back.
    pub regions: u64,
    /// From front to back, with parts that were cut until they had one order.
    pub cells: u64,
    /// In quarters, or quarters of these, because as a whole they would have needed more than [`REGIONS_MAX`] or [`CELLS_MAX`].
    pub quarters: u64,
    /// In part by [`SAMPLES_INSTEAD`] points, because some small square of them would still have needed more.
    pub sampled: u64,
    /// As means over versions of models.
    pub versions: u64,
}

/// How a pixel was computed, the shortest way first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Way {
    Empty,
    Sheet,
    Mosaic,
    Regions,
    Cells,
    Quarters,
    Sampled,
}

/// Integrates pixels; its buffers are used again.
#[derive(Debug, Default)]
pub struct Integrator {
    faces: prepare::Faces,
    versions: versions::Versions,
    sheets: sheet::Sheets,
    mosaic: mosaic::Mosaic,
    regions: regions::Regions,
    cells: cells::Cells,
    quarters: quarters::Quarters,
    points: points::Points,
    counts: Counts,
}

room!(Integrator: faces, versions, sheets, regions, cells, quarters, points; mosaic, counts);

impl Integrator {
    /// How the pixels since the beginning were computed.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// The mean over the pixel of what is seen of the faces before a background, linear RGB, unclamped.
    pub fn integrate(&mut self, faces: &[ExactFace<'_>], background: [f64; 3]) -> [f64; 3] {
        self.faces.set(faces);
        let (colour, way) = if self.faces.has_parts && self.versions.set(faces, &self.faces) {
            self.counts.versions += 1;
            self.mean_of_versions(faces, background)
        } else {
            self.one(faces, background, 0)
        };
        *match way {
            Way::Empty => &mut self.counts.empty,
            Way::Sheet => &mut self.counts.sheets,
            Way::Mosaic => &mut self.counts.mosaics,
            Way::Regions => &mut self.counts.regions,
            Way::Cells => &mut self.counts.cells,
            Way::Quarters => &mut self.counts.quarters,
            Way::Sampled => &mut self.counts.sampled,
        } += 1;
        colour
    }

    fn mean_of_versions(&mut self, faces: &[ExactFace<'_>], background: [f64; 3]) -> ([f64; 3], Way) {
        let mut mean = [0.0; 3];
        let mut longest = Way::Empty;
        loop {
            let weight = self.versions.weight();
            if weight > 0.0 {
                self.faces.set_versions(faces, &self.versions);
                let (colour, way) = self.one(faces, background, 0);
                for (mean, c) in mean.iter_mut().zip(colour) {
                    *mean += c * weight;
                }
                longest = longest.max(way);
            }
            if !self.versions.advance() {
                return (mean, longest);
            }
        }
    }

    /// The pixel of the prepared faces, or a square that it was quartered into `depth` times.
    #[inline]
    fn one(&mut self, faces: &[ExactFace<'_>], background: [f64; 3], depth: usize) -> ([f64; 3], Way) {
        if self.faces.len() == 0 {
            return (background, Way::Empty);
        }
        if let Some(colour) = self.sheets.colour(faces, &self.faces, background) {
            return (colour, Way::Sheet);
        }
        if !self.faces.has_parts
            && let Ok(Some(colour)) = self.mosaic.colour(faces, &self.faces, &mut self.sheets, background)
        {
            return (colour, Way::Mosaic);
        }
        self.cells.clear();
        match self.regions.colour(faces, &self.faces, &self.sheets, &mut self.cells, background) {
            Ok(colour) if self.cells.is_used => (colour, Way::Cells),
            Ok(colour) => (colour, Way::Regions),
            Err(cells::TooMany) if depth < quarters::DEPTH_MAX => self.quartered(faces, background, depth),
            Err(cells::TooMany) => (self.points.colour(faces, &self.faces, background), Way::Sampled),
        }
    }

    /// The mean of the four quarters.
    #[inline(never)]
    fn quartered(&mut self, faces: &[ExactFace<'_>], background: [f64; 3], depth: usize) -> ([f64; 3], Way) {
        let [mut all, mut part] = self.quarters.take(depth);
        quarters::present(faces, &self.faces, &mut all);
        let mut mean = [0.0; 3];
        let mut longest = Way::Quarters;
        for number in 0..4 {
            quarters::quarter(&all, number, &mut part);
            self.faces.set(&part);
            let (colour, way) = self.one(&part, background, depth + 1);
            for (mean, c) in mean.iter_mut().zip(colour) {
                *mean += 0.25 * c;
            }
            longest = longest.max(way);
        }
        self.quarters.give(depth, [all, part]);
        (mean, longest)
    }
}
