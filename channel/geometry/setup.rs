//! The triangle on the screen: rounded vertices, the plane of inverse distance, and where its attributes are.
//!
//! Its vertices always run so that the area is positive in screen axes (x right, y down); whether it faces the eye was decided
//! before, by the sign that the *rounded* area had. Coverage, visibility and attributes all use the rounded vertices.
//!
//! A triangle is one cache line. What is only asked for in ties or when a face is shaded (its rank in the file, its
//! attributes) is looked up by `item` and `face` instead of being carried along.

use crate::samples::SUBPIXELS;
use crate::simd::each3;

/// No clip record: the triangle is a whole face.
pub const WHOLE_FACE: u32 = u32::MAX;

/// Inverse distance q = 1/w as an affine function of the screen position: larger is nearer.
///
/// The gradient is a quotient of products of exact differences by an exact integer area, so its error times the triangle's
/// extent L is below 2⁻⁵² · L²/area · (the face's range of q): nothing for ordinary faces, and a small part of the range
/// even for a face of one sub-pixel's area right across the largest screen. Hence q isn't clamped to the range of the
/// vertices: it stays one affine function, which whole-pixel decisions rely on (see `raster::depth`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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
    #[inline(always)]
    pub fn at(&self, x_sub: i32, y_sub: i32) -> f64 {
        self.q + (f64::from(x_sub - self.x) * self.dx + f64::from(y_sub - self.y) * self.dy)
    }

    /// The plane through three corners with a positive area.
    #[inline(always)]
    pub fn through(x: [i32; 3], y: [i32; 3], q: [f64; 3]) -> Self {
        let area = area_twice([x[0], y[0]], [x[1], y[1]], [x[2], y[2]]) as f64;
        let (x1, y1) = (f64::from(x[1] - x[0]), f64::from(y[1] - y[0]));
        let (x2, y2) = (f64::from(x[2] - x[0]), f64::from(y[2] - y[0]));
        let (q1, q2) = (q[1] - q[0], q[2] - q[0]);
        Self { q: q[0], dx: (q1 * y2 - q2 * y1) / area, dy: (q2 * x1 - q1 * x2) / area, x: x[0], y: y[0] }
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
    /// Its plane is one of the scene's, with the view's upper left for reference instead of the first corner.
    pub const SHARED_PLANE: u8 = 16;
    /// It is a MASK surface: it may have holes.
    pub const CUT_OUT: u8 = 32;
    /// It is single-sided and seen from behind: it is here only because back faces are not left out early, to see what that costs.
    pub const BACK: u8 = 64;

    /// Whether a bit is set.
    #[inline(always)]
    pub fn has(self, bit: u8) -> bool {
        self.0 & bit != 0
    }
}

/// Inverse distance beyond all use, 1/m; it can still be multiplied by areas and divided by.
pub const FARTHEST: f64 = 1e-280;

/// A triangle ready for the raster.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Triangle {
    /// Corners, sub.
    pub x: [i32; 3],
    /// Corners, sub.
    pub y: [i32; 3],
    /// [`Plane::q`] of its plane.
    q: f64,
    /// [`Plane::dx`].
    q_dx: f64,
    /// [`Plane::dy`].
    q_dy: f64,
    /// Index into the frame's list.
    pub item: u32,
    /// Index of the face in its mesh.
    pub face: u32,
    /// Index of the [`ClipRecord`] in its run, or [`WHOLE_FACE`].
    pub clip: u32,
    /// Order of corners, side, range, model, plane.
    pub flags: Flags,
}

const _: () = assert!(size_of::<Triangle>() == 64, "a triangle is one cache line");

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
#[inline(always)]
pub fn area_twice(a: [i32; 2], b: [i32; 2], c: [i32; 2]) -> i64 {
    let (abx, aby) = (i64::from(b[0] - a[0]), i64::from(b[1] - a[1]));
    let (acx, acy) = (i64::from(c[0] - a[0]), i64::from(c[1] - a[1]));
    abx * acy - acx * aby
}

/// The pixels whose samples, lying between `low` and `high` of a pixel, may be within an extent of `[min, max]` sub: first
/// and last, ends included; none if first > last.
#[inline(always)]
pub fn pixels_within([min, max]: [i32; 2], low: i32, high: i32) -> [i32; 2] {
    [(min - high + SUBPIXELS - 1) >> crate::samples::SUBPIXEL_BITS, (max - low) >> crate::samples::SUBPIXEL_BITS]
}

/// Smallest and largest of three.
#[inline(always)]
pub fn extent(c: [i32; 3]) -> [i32; 2] {
    [c[0].min(c[1]).min(c[2]), c[0].max(c[1]).max(c[2])]
}

impl Triangle {
    /// A triangle of these corners with a positive area, whose depth is that of `plane`; `flags` says whether the plane is shared.
    #[inline(always)]
    pub fn new(x: [i32; 3], y: [i32; 3], plane: &Plane, item: u32, face: u32, clip: u32, flags: Flags) -> Self {
        debug_assert!(flags.has(Flags::SHARED_PLANE) || (plane.x, plane.y) == (x[0], y[0]), "the reference vertex");
        Self { x, y, q: plane.q, q_dx: plane.dx, q_dy: plane.dy, item, face, clip, flags }
    }

    /// Its plane.
    #[inline(always)]
    pub fn plane(&self) -> Plane {
        let [x, y] = if self.flags.has(Flags::SHARED_PLANE) { [0, 0] } else { [self.x[0], self.y[0]] };
        Plane { q: self.q, dx: self.q_dx, dy: self.q_dy, x, y }
    }

    /// Twice its area, sub².
    #[inline(always)]
    pub fn area_twice(&self) -> i64 {
        area_twice([self.x[0], self.y[0]], [self.x[1], self.y[1]], [self.x[2], self.y[2]])
    }

    /// Inverse distance at its corners, 1/m, as its plane has it. Positive: where the plane of the scene that it shares, or that of a
    /// splinter, has a corner beyond its horizon by rounding, the corner counts as farther than everything.
    #[inline(always)]
    pub fn corner_q(&self) -> [f64; 3] {
        let plane = self.plane();
        each3([0, 1, 2], |k| {
            let q = plane.at(self.x[k], self.y[k]);
            if q > FARTHEST { q } else { FARTHEST }
        })
    }

    /// The pixels that may have a sample inside: `[first, last]` per axis, ends included, samples lying between `low`
    /// and `high` of a pixel; empty if first > last.
    #[inline(always)]
    pub fn pixels(&self, low: i32, high: i32) -> [[i32; 2]; 2] {
        [pixels_within(extent(self.x), low, high), pixels_within(extent(self.y), low, high)]
    }
}
