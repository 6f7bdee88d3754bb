//! Shading: the colour of a face in a pixel (picture.md, "One sample").
//!
//! Evaluated once per pixel and face, at the pixel's centre if the face covers it, else at its covered sample nearest the
//! centre. "Covers" is the face's own coverage, whatever hides it, and of a face that was cut at the near plane all
//! pieces together; so neighbouring boards and passes agree on the point.
//!
//! - [`face`]: a face prepared for everything that a material can be.
//! - `nearest`: where a face is shaded if pixels are computed by areas.
//! - [`tile`]: the faces of a tile, and the quick ways for those whose colour is one, or depends on the normal alone.

pub mod face;
mod nearest;
pub mod tile;

use crate::frame::Frame;
use crate::geometry::setup::Triangle;
use crate::raster::coverage::Edges;
use crate::samples::SUBPIXELS;
pub use face::FaceCache;
use nearest::nearest;

impl Frame<'_> {
    /// Linear RGB, faded, and alpha of a face in the pixel whose upper left is (x, y) sub. Always finite.
    #[inline]
    pub fn pixel_colour(&self, faces: &mut FaceCache, number: u32, x: i32, y: i32) -> [f32; 4] {
        let face = faces.of(self, number);
        if let (Some(colour), None) = (face.constant, self.fade) {
            return colour;
        }
        let point = self.shading_point(&face.edges, number, x, y);
        let face = faces.of(self, point.triangle);
        face.colour(self, point.x, point.y, [x, y])
    }

    /// Of the samples `mask` of a pixel, those at which the surface is within the range of visibility.
    pub fn within_visibility(&self, triangle: &Triangle, x: i32, y: i32, mask: u64) -> u64 {
        let Some((_, range_squared)) = self.fade else { return mask };
        let plane = triangle.plane();
        let mut within = 0;
        let mut rest = mask;
        while rest != 0 {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let [dx, dy] = self.pattern.points[i];
            let q = plane.at(x + dx, y + dy);
            let [rx, ry] = self.camera.ray(x + dx, y + dy);
            // d² = (rx² + ry² + 1) / q² ≤ V²; q is not positive at a horizon that a rounded outline reaches beyond.
            within |= u64::from(q > 0.0 && rx * rx + ry * ry + 1.0 <= range_squared * (q * q)) << i;
        }
        within
    }

    /// Of the samples `mask` of a pixel, those at which the alpha of a MASK surface is at least the cut-off.
    pub fn reaches_cutoff(&self, faces: &mut FaceCache, number: u32, cutoff: f32, x: i32, y: i32, mask: u64) -> u64 {
        if mask == 0 {
            return 0;
        }
        let face = faces.of(self, number);
        if let Some(colour) = face.constant {
            return if colour[3] >= cutoff { mask } else { 0 };
        }
        // One mip level for the whole pixel, that of the point where its colour is taken; a sample is worth its share of
        // the pixel, a power of two: 1/√n as wide.
        let point = self.shading_point(&face.edges, number, x, y);
        let level = faces.of(self, point.triangle).base_level(self, point.x, point.y);
        let level = level - 0.5 * self.pattern.count.trailing_zeros() as f32;
        let face = faces.of(self, number);
        let mut reached = 0;
        let mut rest = mask;
        while rest != 0 {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let [dx, dy] = self.pattern.points[i];
            reached |= u64::from(face.alpha(self, x + dx, y + dy, level) >= cutoff) << i;
        }
        reached
    }

    /// Where the face that a triangle with these edges is, or is a piece of, is shaded in the pixel whose upper left is (x, y) sub.
    #[inline]
    fn shading_point(&self, edges: &Edges, number: u32, x: i32, y: i32) -> ShadingPoint {
        let centre = SUBPIXELS / 2;
        if edges.covers(x + centre, y + centre) {
            return ShadingPoint { triangle: number, x: x + centre, y: y + centre };
        }
        self.shading_point_off_centre(number, x, y)
    }

    /// The same where a triangle doesn't cover the pixel's centre: another piece may, or it is at a sample.
    fn shading_point_off_centre(&self, number: u32, x: i32, y: i32) -> ShadingPoint {
        let centre = SUBPIXELS / 2;
        let pieces = self.clip(number).map_or(number..number + 1, |record| {
            let first = number - u32::from(record.before);
            first..first + u32::from(record.pieces)
        });
        let edges_of = |piece: u32| Edges::of(self.triangle(piece));
        for piece in pieces.clone() {
            if edges_of(piece).covers(x + centre, y + centre) {
                return ShadingPoint { triangle: piece, x: x + centre, y: y + centre };
            }
        }
        if self.pattern.is_exact() {
            let places = pieces.map(|piece| (piece, nearest(self.triangle(piece), &edges_of(piece), [x, y])));
            let nearer = |a: (u32, ([i32; 2], f64)), b: (u32, ([i32; 2], f64))| if b.1.1 < a.1.1 { b } else { a };
            let (triangle, ([dx, dy], _)) = places.reduce(nearer).expect("a face has a piece");
            return ShadingPoint { triangle, x: x + dx, y: y + dy };
        }
        // Points are in the order of their distance from the centre.
        for [dx, dy] in &self.pattern.points[..self.pattern.count] {
            for piece in pieces.clone() {
                if edges_of(piece).covers(x + dx, y + dy) {
                    return ShadingPoint { triangle: piece, x: x + dx, y: y + dy };
                }
            }
        }
        unreachable!("a face is shaded only in pixels where it covers a sample")
    }
}

/// Where, and as which triangle, a face is shaded in a pixel.
#[derive(Clone, Copy, Debug)]
struct ShadingPoint {
    triangle: u32,
    x: i32,
    y: i32,
}
