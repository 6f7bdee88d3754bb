//! Depth: of two faces, which is in front, and at which samples of a pixel.
//!
//! A face's inverse distance is an affine function of the screen position, evaluated by `Plane::at` in one order of
//! operations, so the answer at a sample is a pure function of two triangles and a position. Mostly it is the same for the
//! whole pixel, and that is found out first: the *difference* of two affine functions is affine too, and takes its
//! extremes over the pixel at corners. If even its smallest magnitude there exceeds what rounding could have done to any of the
//! evaluations, every sample would answer alike, and none needs to be asked. So the shortcut never changes an answer, and
//! pictures don't depend on when it is taken.

use crate::geometry::setup::Triangle;
use crate::samples::{Pattern, SUBPIXELS};

/// Bound on the rounding of all evaluations that a comparison replaces, relative to the sum of the magnitudes of their
/// terms. Each takes three operations, each wrong by 2⁻⁵³ at most; this is several times as much as can add up.
const ROUNDING: f64 = 1.0 / (1u64 << 48) as f64;

/// The samples of `mask`, in the pixel whose upper left is (x, y) sub, at which `a` is in front of `b`: nearer, or equally near and of the larger order.
#[inline]
pub fn in_front(pattern: &Pattern, a: &Triangle, b: &Triangle, x: i32, y: i32, mask: u64) -> u64 {
    if mask & (mask - 1) != 0 {
        // Several samples: try the whole pixel.
        let (pa, pb) = (&a.plane, &b.plane);
        let side = f64::from(SUBPIXELS);
        let terms = |p: &crate::geometry::setup::Plane| {
            let (fx, fy) = (f64::from((x - p.x).abs()) + side, f64::from((y - p.y).abs()) + side);
            p.q.abs() + fx * p.dx.abs() + fy * p.dy.abs()
        };
        let margin = ROUNDING * (terms(pa) + terms(pb));
        let here = pa.at(x, y) - pb.at(x, y);
        let (gain_x, gain_y) = ((pa.dx - pb.dx) * side, (pa.dy - pb.dy) * side);
        let (left, right) = if gain_x < 0.0 { (gain_x, 0.0) } else { (0.0, gain_x) };
        let (up, down) = if gain_y < 0.0 { (gain_y, 0.0) } else { (0.0, gain_y) };
        if here + (left + up) > margin {
            return mask;
        }
        if here + (right + down) < -margin {
            return 0;
        }
        // Faces of one plane of the scene share its function, bit by bit.
        if (pa.q, pa.dx, pa.dy, pa.x, pa.y) == (pb.q, pb.dx, pb.dy, pb.x, pb.y) {
            return if a.order > b.order { mask } else { 0 };
        }
    }
    let mut front = 0;
    let mut rest = mask;
    while rest != 0 {
        let i = rest.trailing_zeros() as usize;
        rest &= rest - 1;
        let [dx, dy] = pattern.points[i];
        let (qa, qb) = (a.plane.at(x + dx, y + dy), b.plane.at(x + dx, y + dy));
        let is_front = qa > qb || (qa == qb && a.order > b.order);
        front |= u64::from(is_front) << i;
    }
    front
}

/// Lower and upper bound of a triangle's q over a square of `side` sub from (x, y), rounding included.
#[inline]
pub fn bounds(triangle: &Triangle, x: i32, y: i32, side: i32) -> [f64; 2] {
    let p = &triangle.plane;
    let side = f64::from(side);
    let (fx, fy) = (f64::from((x - p.x).abs()) + side, f64::from((y - p.y).abs()) + side);
    let margin = ROUNDING * (p.q.abs() + fx * p.dx.abs() + fy * p.dy.abs());
    let here = p.at(x, y);
    let (gain_x, gain_y) = (p.dx * side, p.dy * side);
    let low = here + (if gain_x < 0.0 { gain_x } else { 0.0 } + if gain_y < 0.0 { gain_y } else { 0.0 });
    let high = here + (if gain_x > 0.0 { gain_x } else { 0.0 } + if gain_y > 0.0 { gain_y } else { 0.0 });
    [low - margin, high + margin]
}
