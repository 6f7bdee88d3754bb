//! The triangle on the screen: rounded vertices, the plane of inverse distance, and where its attributes are.
//!
//! Its vertices always run so that the area is positive in screen axes (x right, y down); whether it faces the eye was decided
//! before, by the sign that the *rounded* area had. Coverage, visibility and attributes all use the rounded vertices.

use crate::samples::SUBPIXELS;

/// No clip record: the triangle is a whole face.
pub const WHOLE_FACE: u32 = u32::MAX;

/// Inverse distance q = 1/w as an affine function of the screen position: larger is nearer.
///
/// The gradient is a quotient of products of exact differences by an exact integer area, so its error times the triangle's
/// extent L is below 2⁻⁵² · L²/area · (the face's range of q): nothing for ordinary faces, and a small part of the range
/// even for a face of one sub-pixel's area right across the largest screen. Hence q isn't clamped to the range of the
/// vertices: it stays one affine function, which whole-pixel decisions rely on (see `raster::depth`).
#[derive(Clone, Copy, Debug, Default)]
pub struct Plane {
    /// q at the reference vertex, 1/m.
    pub q: f64,
    /// Change of q per sub-pixel to the right.
    pub dx: f64,
    /// Change of q per sub-pixel downwards.
    pub dy: f64,
    /// Reference vertex, sub.
    pub x: i32,
    /// Reference vertex, sub.
    pub y: i32,
}

impl Plane {
    /// q at a sub-pixel position: a pure function with one order of operations, whoever asks.
    #[inline]
    pub fn at(&self, x_sub: i32, y_sub: i32) -> f64 {
        self.q + (f64::from(x_sub - self.x) * self.dx + f64::from(y_sub - self.y) * self.dy)
    }
}

/// How a triangle's corners and sides relate to its face's. A set of bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags(pub u8);

impl Flags {
    /// Corners are in the order 0, 2, 1 of the face.
    pub const SWAPPED: u8 = 1;
    /// Seen from behind.
    pub const BEHIND: u8 = 2;
    /// Some vertex is farther than the range of visibility: samples must be asked.
    pub const BEYOND: u8 = 4;

    /// Its fragments belong to a model.
    pub const PART: u8 = 8;

    /// Whether a bit is set.
    #[inline]
    pub fn has(self, bit: u8) -> bool {
        self.0 & bit != 0
    }
}

/// A triangle ready for the raster.
#[derive(Clone, Copy, Debug)]
pub struct Triangle {
    /// Corners, sub.
    pub x: [i32; 3],
    /// Corners, sub.
    pub y: [i32; 3],
    /// Inverse distance over the screen.
    pub plane: Plane,
    /// Inverse distance at the corners, 1/m.
    pub q: [f64; 3],
    /// Layer, primitive, face, in this order: where two are equally near, the larger wins.
    pub order: u64,
    /// Index into the frame's list.
    pub item: u32,
    /// Index of the face in its mesh.
    pub face: u32,
    /// Index of the [`ClipRecord`], or [`WHOLE_FACE`].
    pub clip: u32,
    /// Order of corners, side, range, model.
    pub flags: Flags,
}

/// What a piece of a clipped face must remember.
#[derive(Clone, Copy, Debug)]
pub struct ClipRecord {
    /// Weights of the piece's corners with respect to the face's vertices, in the triangle's order of corners.
    pub weights: [[f64; 3]; 3],
    /// How many pieces of this face stand directly before this one.
    pub before: u8,
    /// Number of pieces of this face.
    pub pieces: u8,
}

/// Twice the signed area, sub², of the triangle of these corners; positive when they run clockwise as seen (y is down).
#[inline]
pub fn area_twice(a: [i32; 2], b: [i32; 2], c: [i32; 2]) -> i64 {
    let (abx, aby) = (i64::from(b[0] - a[0]), i64::from(b[1] - a[1]));
    let (acx, acy) = (i64::from(c[0] - a[0]), i64::from(c[1] - a[1]));
    abx * acy - acx * aby
}

impl Triangle {
    /// The plane through three corners with a positive area.
    pub fn plane_through(x: [i32; 3], y: [i32; 3], q: [f64; 3]) -> Plane {
        let area = area_twice([x[0], y[0]], [x[1], y[1]], [x[2], y[2]]) as f64;
        let (x1, y1) = (f64::from(x[1] - x[0]), f64::from(y[1] - y[0]));
        let (x2, y2) = (f64::from(x[2] - x[0]), f64::from(y[2] - y[0]));
        let (q1, q2) = (q[1] - q[0], q[2] - q[0]);
        Plane { q: q[0], dx: (q1 * y2 - q2 * y1) / area, dy: (q2 * x1 - q1 * x2) / area, x: x[0], y: y[0] }
    }

    /// The same triangle when its run's clip records follow `base` others.
    #[inline]
    pub fn with_clip_base(mut self, base: u32) -> Self {
        if self.clip != WHOLE_FACE {
            self.clip += base;
        }
        self
    }

    /// The pixels that may have a sample inside: `[first, last]` per axis, ends included, samples lying between `low`
    /// and `high` of a pixel; empty if first > last.
    #[inline]
    pub fn pixels(&self, low: i32, high: i32) -> [[i32; 2]; 2] {
        let range = |c: [i32; 3]| {
            let (min, max) = (c[0].min(c[1]).min(c[2]), c[0].max(c[1]).max(c[2]));
            [(min - high + SUBPIXELS - 1).div_euclid(SUBPIXELS), (max - low).div_euclid(SUBPIXELS)]
        };
        [range(self.x), range(self.y)]
    }
}
