//! Faces, sixteen at a time: which of a subobject's faces are drawn, and as what.
//!
//! Most faces have all of their vertices on the screen and are small, and of these half or more are dropped: seen from behind, without
//! an area, or without a sample. So the questions that drop them are asked of [`LANES`] faces at once, in 32-bit integers, and what is
//! left over gets its plane of inverse distance eight faces at a time. What has a vertex outside of something, or is too large for 32 bits,
//! is *single*: it goes the general way, which gives the same bits ([`super::transform`] has both, and a test compares them).

use super::setup::{Flags, area_twice, extent, pixels_within};
use super::vertices::Vertices;
use crate::simd::each3;
use fearless_simd::{Simd, f64x8, i32x16, prelude::*};

/// Faces that are sorted at once.
pub const LANES: usize = 16;

/// Faces whose planes are found at once.
pub const PLANES: usize = 8;

/// Largest extent along an axis, sub, of a face that is not single: twice its area is at most 2 · 32 767² < 2³¹.
const SMALL: i32 = i16::MAX as i32;

/// What decides whether a face is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Sieve {
    /// Width and height of the view, pixels.
    pub size: [i32; 2],
    /// Least and largest coordinate of a sample in its pixel, sub.
    pub samples: [i32; 2],
    /// Whether faces run the other way round.
    pub mirrored: bool,
    /// Whether faces seen from behind are kept.
    pub keeps_back: bool,
    /// Flags of all faces.
    pub flags: u8,
    /// Flags of faces seen from behind, beside [`Flags::BEHIND`].
    pub back: u8,
}

impl Sieve {
    /// The flags of a face whose corners run the other way round, or that is seen from behind.
    #[inline(always)]
    pub fn flags_of(&self, swapped: bool, behind: bool) -> u8 {
        self.flags | if swapped { Flags::SWAPPED } else { 0 } | if behind { Flags::BEHIND | self.back } else { 0 }
    }

    /// Whether the extent of a face with these corners, sub, has no sample of the view in it.
    #[inline(always)]
    pub fn misses(&self, x: [i32; 3], y: [i32; 3]) -> bool {
        let [low, high] = self.samples;
        let ([x0, x1], [y0, y1]) = (pixels_within(extent(x), low, high), pixels_within(extent(y), low, high));
        x0.max(0) > x1.min(self.size[0] - 1) || y0.max(0) > y1.min(self.size[1] - 1)
    }
}

/// What becomes of up to [`LANES`] faces: a bit each, in the first three sets at most one of them; the others are not drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sorted {
    /// To be drawn.
    pub drawn: u64,
    /// To be looked at one by one.
    pub single: u64,
    /// Seen from behind, and left out.
    pub backface: u64,
    /// Of those drawn: their corners run the other way round.
    pub swapped: u64,
    /// Of those drawn: seen from behind.
    pub behind: u64,
}

/// The corners of up to [`LANES`] faces, sub: by corner, then face.
#[derive(Clone, Copy, Debug)]
pub struct Corners {
    /// To the right.
    pub x: [[i32; LANES]; 3],
    /// Downwards.
    pub y: [[i32; LANES]; 3],
}

impl Default for Corners {
    fn default() -> Self {
        Self { x: [[0; LANES]; 3], y: [[0; LANES]; 3] }
    }
}

impl Corners {
    /// Fills in at most [`LANES`] faces, and tells those with a vertex that is outside of something.
    #[inline(always)]
    pub fn gather(&mut self, vertices: &Vertices, faces: &[[u32; 3]]) -> u64 {
        let count = vertices.x.len();
        // The same length for all: one check each.
        let (xs, ys, codes) = (&vertices.x[..count], &vertices.y[..count], &vertices.codes[..count]);
        let mut outside = 0;
        for (lane, face) in faces.iter().enumerate().take(LANES) {
            let mut code = 0;
            for (k, vertex) in face.iter().enumerate() {
                let vertex = *vertex as usize;
                self.x[k][lane] = xs[vertex];
                self.y[k][lane] = ys[vertex];
                code |= codes[vertex];
            }
            outside |= u64::from(code != 0) << lane;
        }
        outside
    }

    /// Sorts the first `count` faces, those in `outside` as single ones.
    #[inline(always)]
    pub fn sort<S: Simd>(&self, simd: S, sieve: &Sieve, count: usize, outside: u64) -> Sorted {
        let [x0, x1, x2] = each3(self.x, |c| i32x16::simd_from(simd, c));
        let [y0, y1, y2] = each3(self.y, |c| i32x16::simd_from(simd, c));
        let (left, right) = (x0.min(x1).min(x2), x0.max(x1).max(x2));
        let (top, bottom) = (y0.min(y1).min(y2), y0.max(y1).max(y2));
        let is_large = (right - left).simd_gt(SMALL) | (bottom - top).simd_gt(SMALL);
        let area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0);
        let [low, high] = sieve.samples;
        let [columns, rows] = sieve.size;
        let zero = i32x16::splat(simd, 0);
        let bits = crate::samples::SUBPIXEL_BITS;
        let up = crate::samples::SUBPIXELS - 1 - high;
        let first = [((left + up) >> bits).max(zero), ((top + up) >> bits).max(zero)];
        let last = [
            ((right - low) >> bits).min(i32x16::splat(simd, columns - 1)),
            ((bottom - low) >> bits).min(i32x16::splat(simd, rows - 1)),
        ];
        let is_missed = first[0].simd_gt(last[0]) | first[1].simd_gt(last[1]);
        let valid = (1u64 << count) - 1;
        let single = (is_large.to_bitmask() | outside) & valid;
        let negative = area.simd_lt(zero).to_bitmask();
        let flat = area.simd_eq(zero).to_bitmask();
        // On a screen whose y runs downwards a counter-clockwise face, seen from its front, has a negative area.
        let behind = if sieve.mirrored { negative } else { !negative };
        let whole = valid & !single & !flat;
        let backface = if sieve.keeps_back { 0 } else { whole & behind };
        let drawn = whole & !backface & !is_missed.to_bitmask();
        Sorted { drawn, single, backface, swapped: drawn & negative, behind: drawn & behind }
    }
}

/// The corners of [`PLANES`] faces. They run so that areas are positive; what isn't filled in gives numbers that mean nothing.
#[derive(Clone, Copy, Debug)]
pub struct Planes {
    /// Corners, sub: by corner, then face.
    pub x: [[i32; PLANES]; 3],
    /// Corners.
    pub y: [[i32; PLANES]; 3],
    /// Inverse distances at the corners, 1/m.
    pub q: [[f64; PLANES]; 3],
}

impl Default for Planes {
    fn default() -> Self {
        Self { x: [[0; PLANES]; 3], y: [[0; PLANES]; 3], q: [[0.0; PLANES]; 3] }
    }
}

impl Planes {
    /// What their inverse distances gain per sub-pixel to the right, and downwards: that of [`super::setup::Plane::through`], of small faces.
    #[inline(always)]
    pub fn slopes<S: Simd>(&self, simd: S) -> [[f64; PLANES]; 2] {
        // Whole numbers below 2³²: exact in whatever order.
        let side = |c: &[[i32; PLANES]; 3], k: usize| {
            let mut side = [0.0; PLANES];
            for (i, side) in side.iter_mut().enumerate() {
                *side = f64::from(c[k][i] - c[0][i]);
            }
            side
        };
        let (x1, x2) = (f64x8::simd_from(simd, side(&self.x, 1)), f64x8::simd_from(simd, side(&self.x, 2)));
        let (y1, y2) = (f64x8::simd_from(simd, side(&self.y, 1)), f64x8::simd_from(simd, side(&self.y, 2)));
        let area = x1 * y2 - x2 * y1;
        let q0 = f64x8::simd_from(simd, self.q[0]);
        let (q1, q2) = (f64x8::simd_from(simd, self.q[1]) - q0, f64x8::simd_from(simd, self.q[2]) - q0);
        [((q1 * y2 - q2 * y1) / area).into(), ((q2 * x1 - q1 * x2) / area).into()]
    }
}

/// Faces whose planes are to be found.
#[derive(Clone, Copy, Debug, Default)]
pub struct Waiting {
    /// Their corners.
    pub planes: Planes,
    /// Their numbers in the mesh.
    pub faces: [u32; PLANES],
    /// Their flags.
    pub flags: [u8; PLANES],
    /// How many there are.
    pub count: usize,
}

impl Waiting {
    /// Adds a face; whether there is no room for another.
    #[inline(always)]
    pub fn put(&mut self, x: [i32; 3], y: [i32; 3], q: [f64; 3], face: u32, flags: u8) -> bool {
        debug_assert!(area_twice([x[0], y[0]], [x[1], y[1]], [x[2], y[2]]) > 0, "corners run clockwise");
        let at = self.count;
        let planes = &mut self.planes;
        for k in 0..3 {
            (planes.x[k][at], planes.y[k][at], planes.q[k][at]) = (x[k], y[k], q[k]);
        }
        (self.faces[at], self.flags[at]) = (face, flags);
        self.count += 1;
        self.count == PLANES
    }
}
