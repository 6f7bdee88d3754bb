//! Depth: of two faces, which is in front, and at which samples of a pixel.
//!
//! A face's inverse distance is an affine function of the screen position, evaluated by [`Plane::at`] in one order of
//! operations, so the answer at a sample is a pure function of two triangles and a position: nearer, or equally near and of the
//! larger order, is in front. Mostly it is the same for the whole pixel, or for a whole block, and that is found out first.
//!
//! - [`BlockDepth`]: bounds of a face's q over each pixel of a block, in f32 and rounded outward. What lies wholly before or wholly
//!   behind the bounds of what a pixel has seen so far needs no other look, and that is decided for 16 pixels at once.
//! - [`in_front`]: the exact answer for one pixel. The *difference* of two affine functions is affine too, and takes its
//!   extremes over the pixel at corners. If even its smallest magnitude there exceeds what rounding could have done to any of the
//!   evaluations, every sample would answer alike, and none needs to be asked.
//!
//! So no shortcut ever changes an answer, and pictures don't depend on when one is taken.

use super::coverage::{BLOCK, BLOCKS_PER_ROW};
use crate::geometry::setup::{Plane, Triangle};
use crate::samples::{Pattern, SUBPIXELS};
use fearless_simd::{Simd, f32x16, f64x8, prelude::*};
use proto::frame::TILE;

/// Bound on the rounding of all evaluations that a comparison replaces, relative to the sum of the magnitudes of their
/// terms. Each takes three operations, each wrong by 2⁻⁵³ at most; this is several times as much as can add up.
const ROUNDING: f64 = 1.0 / (1u64 << 48) as f64;

/// Likewise where the evaluations are in f32: a sum of three terms that were each rounded (4 · 2⁻²⁴), doubled twice.
const ROUNDING_F32: f64 = 1.0 / (1u64 << 20) as f64;

/// What f32 may lose of tiny numbers.
const TINIEST: f64 = 1e-37;

/// Sum of the magnitudes of the terms of a plane's q within a square of `side` sub at (x, y).
#[inline(always)]
fn terms(p: &Plane, x: i32, y: i32, side: f64) -> f64 {
    let (fx, fy) = (f64::from((x - p.x).abs()) + side, f64::from((y - p.y).abs()) + side);
    p.q.abs() + fx * p.dx.abs() + fy * p.dy.abs()
}

/// The samples of `mask`, in the pixel whose upper left is (x, y) sub, at which `a` is in front of `b`: nearer, or equally
/// near if `a_wins_ties`.
#[inline(always)]
pub fn in_front(
    pattern: &Pattern,
    a: &Triangle,
    b: &Triangle,
    x: i32,
    y: i32,
    mask: u64,
    a_wins_ties: impl Fn() -> bool,
) -> u64 {
    let (pa, pb) = (a.plane(), b.plane());
    if mask & mask.wrapping_sub(1) != 0 {
        // Several samples: try the whole pixel.
        match order_over(&pa, &pb, x, y, SUBPIXELS) {
            Some(true) => return mask,
            Some(false) => return 0,
            // Faces of one plane of the scene share its function, bit by bit.
            None if pa == pb => return if a_wins_ties() { mask } else { 0 },
            None => {}
        }
    }
    let mut front = 0;
    let mut rest = mask;
    while rest != 0 {
        let i = rest.trailing_zeros() as usize;
        rest &= rest - 1;
        let [dx, dy] = pattern.points[i];
        let (qa, qb) = (pa.at(x + dx, y + dy), pb.at(x + dx, y + dy));
        let is_front = qa > qb || (qa == qb && a_wins_ties());
        front |= u64::from(is_front) << i;
    }
    front
}

/// What rounding may do to the difference of two planes' q anywhere in the block at (x, y) sub.
#[inline(always)]
pub fn rounding_in_block(a: &Plane, b: &Plane, x: i32, y: i32) -> f64 {
    let side = f64::from(BLOCK as i32 * SUBPIXELS);
    ROUNDING * (terms(a, x, y, side) + terms(b, x, y, side))
}

/// What [`in_front`] says, for eight samples at once where the pixel as a whole doesn't decide.
#[inline(always)]
pub fn fronts<S: Simd>(
    simd: S,
    pattern: &Pattern,
    a: &Triangle,
    b: &Triangle,
    x: i32,
    y: i32,
    mask: u64,
    a_wins_ties: impl FnOnce() -> bool,
) -> u64 {
    let (pa, pb) = (a.plane(), b.plane());
    match order_over(&pa, &pb, x, y, SUBPIXELS) {
        Some(true) => return mask,
        Some(false) => return 0,
        None => {}
    }
    let a_wins_ties = a_wins_ties();
    if pa == pb {
        return if a_wins_ties { mask } else { 0 };
    }
    let splat = |c: f64| f64x8::splat(simd, c);
    let mut front = 0;
    for from in (0..pattern.count).step_by(8) {
        let px = f64x8::from_slice(simd, &pattern.points_f64[0][from..from + 8]);
        let py = f64x8::from_slice(simd, &pattern.points_f64[1][from..from + 8]);
        // Differences of positions are whole numbers: exact in whatever order they are added.
        let qa = ((px + f64::from(x - pa.x)) * pa.dx + (py + f64::from(y - pa.y)) * pa.dy) + splat(pa.q);
        let qb = ((px + f64::from(x - pb.x)) * pb.dx + (py + f64::from(y - pb.y)) * pb.dy) + splat(pb.q);
        let wins = if a_wins_ties { qa.simd_ge(qb) } else { qa.simd_gt(qb) };
        front |= wins.to_bitmask() << from;
    }
    front & mask
}

/// Whether plane `a` is in front of `b` everywhere in a square of `side` sub at (x, y), or behind; `None` if that isn't sure.
#[inline(always)]
pub fn order_over(a: &Plane, b: &Plane, x: i32, y: i32, side: i32) -> Option<bool> {
    let side = f64::from(side);
    let margin = ROUNDING * (terms(a, x, y, side) + terms(b, x, y, side));
    let here = a.at(x, y) - b.at(x, y);
    let (gain_x, gain_y) = ((a.dx - b.dx) * side, (a.dy - b.dy) * side);
    let (left, right) = if gain_x < 0.0 { (gain_x, 0.0) } else { (0.0, gain_x) };
    let (up, down) = if gain_y < 0.0 { (gain_y, 0.0) } else { (0.0, gain_y) };
    if here + (left + up) > margin {
        return Some(true);
    }
    if here + (right + down) < -margin {
        return Some(false);
    }
    None
}

/// Lower and upper bound of a plane's q over a square of `side` sub from (x, y), rounding included.
#[inline(always)]
pub fn bounds(p: &Plane, x: i32, y: i32, side: i32) -> [f64; 2] {
    let side = f64::from(side);
    let margin = ROUNDING * terms(p, x, y, side);
    let here = p.at(x, y);
    let (gain_x, gain_y) = (p.dx * side, p.dy * side);
    let low = here + (if gain_x < 0.0 { gain_x } else { 0.0 } + if gain_y < 0.0 { gain_y } else { 0.0 });
    let high = here + (if gain_x > 0.0 { gain_x } else { 0.0 } + if gain_y > 0.0 { gain_y } else { 0.0 });
    [low - margin, high + margin]
}

/// Bounds of a face's q over the pixels of the blocks of a tile.
#[derive(Clone, Copy, Debug)]
pub struct BlockDepth {
    /// Lower and upper bound at the centre of the tile's first pixel.
    first: [f64; 2],
    /// Change of q per block, to the right and downwards.
    block_steps: [f64; 2],
    /// Change of q per pixel.
    steps: [f32; 2],
}

impl BlockDepth {
    /// Of a face with that plane in the tile whose upper left is (x, y) sub; the bounds hold for the pattern's samples.
    #[inline(always)]
    pub fn new(pattern: &Pattern, plane: &Plane, [x, y]: [i32; 2]) -> Self {
        let centre = SUBPIXELS / 2;
        let slope = plane.dx.abs() + plane.dy.abs();
        let half = f64::from(SUBPIXELS / 2 - pattern.low) * slope;
        let first = plane.at(x + centre, y + centre);
        let side = f64::from(TILE as i32 * SUBPIXELS);
        let reach = half + ROUNDING_F32 * (first.abs() + side * slope) + ROUNDING * terms(plane, x, y, side) + TINIEST;
        let block = f64::from(BLOCK as i32 * SUBPIXELS);
        let pixel = f64::from(SUBPIXELS);
        Self {
            first: [first - reach, first + reach],
            block_steps: [plane.dx * block, plane.dy * block],
            steps: [(plane.dx * pixel) as f32, (plane.dy * pixel) as f32],
        }
    }

    /// Lower and upper bound at the first pixel of a block; [`BlockDepth::lattice`] leads to the others.
    #[inline(always)]
    pub fn at(&self, block: usize) -> [f32; 2] {
        let (column, row) = (block as u32 % BLOCKS_PER_ROW, block as u32 / BLOCKS_PER_ROW);
        let gain = f64::from(column as i32) * self.block_steps[0] + f64::from(row as i32) * self.block_steps[1];
        [(self.first[0] + gain) as f32, (self.first[1] + gain) as f32]
    }

    /// Most that q gains from a block's first pixel to any other.
    #[inline(always)]
    pub fn most_gained(&self) -> f32 {
        let last = (BLOCK - 1) as f32;
        let gain = |step: f32| if step > 0.0 { step * last } else { 0.0 };
        // A step that is not a number gives an unknown bound: one that hides nothing.
        if self.steps[0].is_finite() && self.steps[1].is_finite() {
            gain(self.steps[0]) + gain(self.steps[1])
        } else {
            f32::INFINITY
        }
    }

    /// Least that q gains from a block's first pixel to any other.
    #[inline(always)]
    pub fn least_gained(&self) -> f32 {
        let last = (BLOCK - 1) as f32;
        let gain = |step: f32| if step < 0.0 { step * last } else { 0.0 };
        if self.steps[0].is_finite() && self.steps[1].is_finite() {
            gain(self.steps[0]) + gain(self.steps[1])
        } else {
            f32::NEG_INFINITY
        }
    }

    /// The bounds at pixel `bit` (8·row + column) of a block that has `base` at its first one; infinite where they are no numbers.
    #[inline(always)]
    pub fn at_pixel(&self, base: [f32; 2], bit: u32) -> [f32; 2] {
        let (column, row) = ((bit % BLOCK) as f32, (bit / BLOCK) as f32);
        let gain = column * self.steps[0] + row * self.steps[1];
        let [low, high] = [base[0] + gain, base[1] + gain];
        [if low.is_nan() { f32::NEG_INFINITY } else { low }, if high.is_nan() { f32::INFINITY } else { high }]
    }

    /// What q gains from a block's first pixel to each of its 64.
    #[inline(always)]
    pub fn lattice<S: Simd>(&self, simd: S) -> [f32x16<S>; 4] {
        const COLUMNS: [f32; 16] = [0., 1., 2., 3., 4., 5., 6., 7., 0., 1., 2., 3., 4., 5., 6., 7.];
        const ROWS: [f32; 16] = [0., 0., 0., 0., 0., 0., 0., 0., 1., 1., 1., 1., 1., 1., 1., 1.];
        let along = f32x16::simd_from(simd, COLUMNS) * self.steps[0];
        let rows = f32x16::simd_from(simd, ROWS);
        // Not with a closure: at some levels it would be a function without the level's instructions.
        let down = self.steps[1];
        [along + rows * down, along + (rows + 2.0) * down, along + (rows + 4.0) * down, along + (rows + 6.0) * down]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::setup::{Flags, WHOLE_FACE};
    use crate::oracle::Random;
    use crate::simd::{at_level, every_level};
    use proto::view::Samples;

    #[test]
    fn eight_samples_at_once_are_ordered_as_one_by_one() {
        let mut random = Random(0xF407);
        let mut crossing = 0;
        for round in 0..4000 {
            let pattern = Pattern::of([Samples::One, Samples::Four, Samples::Eight, Samples::SixtyFour][round % 4]);
            let [x, y] = [0; 2].map(|_| random.below(1 << 20) as i32);
            let slope = libm::exp10((random.below(12) as i32 - 12).into());
            let level = [1.0, 1e-6][round % 2] * random.signed();
            let faces: Vec<Triangle> = (0..2)
                .map(|_| {
                    // Corners near the pixel, so that planes cross in it; coarse numbers, so that some are equal.
                    let corner = [x, y].map(|c| c + random.below(256) as i32);
                    let coarse = |n: f64| (n * 8.0).round() / 8.0;
                    let plane = Plane {
                        q: 1.0 + level + coarse(random.signed()) * slope * 100.0,
                        dx: slope * coarse(random.signed()),
                        dy: slope * coarse(random.signed()),
                        x: corner[0],
                        y: corner[1],
                    };
                    let (xs, ys) = ([corner[0], corner[0] + 999, corner[0]], [corner[1], corner[1], corner[1] + 999]);
                    Triangle::new(xs, ys, &plane, 0, 0, WHOLE_FACE, Flags(0))
                })
                .collect();
            let mask = random.next() & pattern.full;
            for wins in [false, true] {
                let one = in_front(pattern, &faces[0], &faces[1], x, y, mask, || wins);
                crossing += usize::from(one != 0 && one != mask);
                for level in every_level() {
                    let eight =
                        at_level!(level, simd => fronts(simd, pattern, &faces[0], &faces[1], x, y, mask, || wins));
                    assert_eq!(eight, one, "{level:?}: {faces:?}");
                }
            }
        }
        assert!(crossing > 100, "{crossing} pixels in which planes cross");
    }

    #[test]
    fn bounds_of_blocks_hold_at_every_sample_and_level() {
        let mut random = Random(0xB10C);
        for round in 0..3000 {
            let samples = [Samples::One, Samples::Four, Samples::Sixteen, Samples::SixtyFour][round % 4];
            let pattern = Pattern::of(samples);
            let magnitude = libm::exp10((random.below(60) as i32 - 40).into());
            let slope = magnitude * libm::exp10((random.below(16) as i32 - 12).into());
            let plane = Plane {
                q: magnitude * random.signed(),
                dx: slope * random.signed(),
                dy: slope * random.signed(),
                x: (random.signed() * f64::from(1 << random.below(24))) as i32,
                y: (random.signed() * f64::from(1 << random.below(24))) as i32,
            };
            let tile = [0; 2].map(|_| (random.below(64) * 8192) as i32);
            let depth = BlockDepth::new(pattern, &plane, tile);
            let block = random.below(16) as usize;
            let [low, high] = depth.at(block);
            let [x, y] = [tile[0] + (block as i32 % 4) * 2048, tile[1] + (block as i32 / 4) * 2048];
            for level in every_level() {
                let gains: [[f32; 16]; 4] = at_level!(level, simd => depth.lattice(simd).map(<[f32; 16]>::from));
                for pixel in 0..64 {
                    let gain = gains[pixel / 16][pixel % 16];
                    let (low, high) = (f64::from(low + gain), f64::from(high + gain));
                    let (px, py) = (x + (pixel % 8) as i32 * 256, y + (pixel / 8) as i32 * 256);
                    for [dx, dy] in &pattern.points[..pattern.count] {
                        let q = plane.at(px + dx, py + dy);
                        assert!(low <= q && q <= high, "{level:?}: {plane:?}: {q} is not in {low}..{high}");
                    }
                }
            }
        }
    }
}
