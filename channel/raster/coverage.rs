//! Coverage: which samples a triangle covers, decided in integers and by its rounded vertices alone.
//!
//! An edge from a to b has the function E(p) = (b − a) × (p − a) = A·x + B·y + C, positive inside. A sample exactly on an
//! edge belongs to the triangle if the edge is a top or a left one; for the other edges C is lessened by 1, so that
//! "inside" is E ≥ 0 for all three, and a point on an edge shared by two triangles belongs to exactly one.
//!
//! Coarse to fine, all with the same functions: a block of 8 × 8 pixels is left out if all of its sample range lies
//! outside of one edge; a pixel whose sample range lies inside of all edges is covered by as many samples as there are;
//! only for edges that cross a pixel's sample range are samples asked one by one. With one sample that range is
//! a point, and the last case doesn't occur.

#![deny(clippy::float_arithmetic)]

use crate::geometry::setup::Triangle;
use crate::samples::{Pattern, SUBPIXELS};
use proto::frame::{PixelRect, TILE};

/// Side of a block, pixels.
pub const BLOCK: u32 = 8;
/// Blocks in a row of a tile.
pub const BLOCKS_PER_ROW: u32 = TILE / BLOCK;
/// Blocks of a tile.
pub const BLOCKS: usize = (BLOCKS_PER_ROW * BLOCKS_PER_ROW) as usize;
/// Pixels of a tile, and the stride of its rows.
pub const TILE_PIXELS: usize = (TILE * TILE) as usize;

/// Edges no longer than this along either axis, sub, have sample tables in i32: |A| + |B| < 2²¹ per sub-pixel times 2⁸
/// sub-pixels is below 2²⁹, for a table entry as well as for E at the pixel's corner when the edge crosses the pixel.
const SHORT_EDGE: i64 = 1 << 20;

/// The three edge functions of a triangle, ready for "≥ 0 is inside".
#[derive(Clone, Copy, Debug, Default)]
pub struct Edges {
    /// Change per sub-pixel to the right.
    pub a: [i64; 3],
    /// Change per sub-pixel downwards.
    pub b: [i64; 3],
    /// Value at the view's upper left.
    pub c: [i64; 3],
}

impl Edges {
    /// Edge k runs from corner k to corner k + 1.
    #[inline]
    pub fn of(triangle: &Triangle) -> Self {
        let (x, y) = (triangle.x.map(i64::from), triangle.y.map(i64::from));
        let mut edges = Self { a: [0; 3], b: [0; 3], c: [0; 3] };
        for k in 0..3 {
            let next = (k + 1) % 3;
            let (dx, dy) = (x[next] - x[k], y[next] - y[k]);
            let (a, b) = (-dy, dx);
            // Inside is to the right of a left edge (A > 0), below a top edge (A = 0, B > 0).
            let owns_border = a > 0 || (a == 0 && b > 0);
            edges.a[k] = a;
            edges.b[k] = b;
            edges.c[k] = -(a * x[k] + b * y[k]) - i64::from(!owns_border);
        }
        edges
    }

    /// Whether a sub-pixel position is covered.
    #[inline]
    pub fn covers(&self, x_sub: i32, y_sub: i32) -> bool {
        (0..3).all(|k| self.at(k, x_sub, y_sub) >= 0)
    }

    /// The covered samples of the pixel whose upper left is there.
    #[inline]
    pub fn mask(&self, pattern: &Pattern, x_sub: i32, y_sub: i32) -> u64 {
        let mut mask = 0;
        for (i, [x, y]) in pattern.points[..pattern.count].iter().enumerate() {
            mask |= u64::from(self.covers(x_sub + x, y_sub + y)) << i;
        }
        mask
    }

    /// Whether a square whose samples lie between `low` and `high` of its upper left, both axes, has none inside
    /// because one edge has them all outside.
    #[inline]
    pub fn misses(&self, x_sub: i32, y_sub: i32, low: i32, high: i32) -> bool {
        (0..3).any(|k| self.at(k, x_sub, y_sub) + self.largest(k, low, high) < 0)
    }

    #[inline]
    fn at(&self, k: usize, x_sub: i32, y_sub: i32) -> i64 {
        self.a[k] * i64::from(x_sub) + self.b[k] * i64::from(y_sub) + self.c[k]
    }

    /// Most that edge k gains from a square's upper left to a point of its range.
    #[inline]
    fn largest(&self, k: usize, low: i32, high: i32) -> i64 {
        let far = |slope: i64| slope * i64::from(if slope > 0 { high } else { low });
        far(self.a[k]) + far(self.b[k])
    }

    /// Least that edge k gains.
    #[inline]
    fn smallest(&self, k: usize, low: i32, high: i32) -> i64 {
        let far = |slope: i64| slope * i64::from(if slope > 0 { low } else { high });
        far(self.a[k]) + far(self.b[k])
    }
}

/// Who takes the covered pixels of a triangle in a tile.
pub trait CoverageSink {
    /// Whether block `block` (row by row) may be left out. Asked once per block that the triangle may touch.
    fn skips(&mut self, block: usize) -> bool;

    /// All samples of all pixels of a block are covered: `columns` × `rows` pixels from `pixel` on.
    fn block(&mut self, block: usize, pixel: usize, columns: usize, rows: usize);

    /// These samples of a pixel are covered; at least one. `pixel` counts the tile's pixels row by row, 32 in a row also
    /// where the view's border cuts the tile off.
    fn pixel(&mut self, pixel: usize, mask: u64);
}

/// Gives `sink` the pixels of `rect`, a tile's, that the triangle covers.
pub fn cover(pattern: &Pattern, triangle: &Triangle, rect: PixelRect, sink: &mut impl CoverageSink) {
    let [[x0, x1], [y0, y1]] = triangle.pixels(pattern.low, pattern.high());
    let x = [x0.max(rect.x0 as i32), x1.min(rect.x1 as i32 - 1)];
    let y = [y0.max(rect.y0 as i32), y1.min(rect.y1 as i32 - 1)];
    if x[0] > x[1] || y[0] > y[1] {
        return;
    }
    let edges = Edges::of(triangle);
    let mut walk = Walk::new(pattern, edges, rect);
    let block = BLOCK as i32;
    // Relative to the tile from here on.
    let (left, top) = (rect.x0 as i32, rect.y0 as i32);
    let (columns, rows) = (x.map(|x| x - left), y.map(|y| y - top));
    for by in rows[0] / block..=rows[1] / block {
        for bx in columns[0] / block..=columns[1] / block {
            let pixels_x = [columns[0].max(bx * block), columns[1].min(bx * block + block - 1)];
            let pixels_y = [rows[0].max(by * block), rows[1].min(by * block + block - 1)];
            walk.block(bx, by, pixels_x, pixels_y, sink);
        }
    }
}

/// One triangle's walk over one tile.
struct Walk<'a> {
    pattern: &'a Pattern,
    edges: Edges,
    rect: PixelRect,
    /// Least and most that each edge gains within a pixel's sample range.
    least: [i64; 3],
    most: [i64; 3],
    /// What each edge gains from the pixel's upper left to each sample, made when first needed.
    tables: [[i32; 64]; 3],
    has_table: [bool; 3],
}

impl<'a> Walk<'a> {
    #[inline]
    fn new(pattern: &'a Pattern, edges: Edges, rect: PixelRect) -> Self {
        let (low, high) = (pattern.low, pattern.high());
        Self {
            pattern,
            edges,
            rect,
            least: std::array::from_fn(|k| edges.smallest(k, low, high)),
            most: std::array::from_fn(|k| edges.largest(k, low, high)),
            tables: [[0; 64]; 3],
            has_table: [false; 3],
        }
    }

    #[inline]
    fn block(&mut self, bx: i32, by: i32, x: [i32; 2], y: [i32; 2], sink: &mut impl CoverageSink) {
        let number = (by * BLOCKS_PER_ROW as i32 + bx) as usize;
        let (left, top) = (self.rect.x0 as i32, self.rect.y0 as i32);
        let (columns, rows) = ((x[1] - x[0]) as i64, (y[1] - y[0]) as i64);
        // Each edge at the upper left of the first pixel, and its steps.
        let step_x = self.edges.a.map(|a| a * i64::from(SUBPIXELS));
        let step_y = self.edges.b.map(|b| b * i64::from(SUBPIXELS));
        let corner: [i64; 3] =
            std::array::from_fn(|k| self.edges.at(k, (left + x[0]) * SUBPIXELS, (top + y[0]) * SUBPIXELS));
        let mut all_inside = true;
        for k in 0..3 {
            let (gain_x, gain_y) = (step_x[k] * columns, step_y[k] * rows);
            if corner[k] + self.most[k] + gain_x.max(0) + gain_y.max(0) < 0 {
                return;
            }
            all_inside &= corner[k] + self.least[k] + gain_x.min(0) + gain_y.min(0) >= 0;
        }
        if sink.skips(number) {
            return;
        }
        let first = y[0] as usize * TILE as usize + x[0] as usize;
        if all_inside {
            if x[1] - x[0] == BLOCK as i32 - 1 && y[1] - y[0] == BLOCK as i32 - 1 {
                sink.block(number, first, BLOCK as usize, BLOCK as usize);
            } else {
                for row in 0..=rows as usize {
                    for column in 0..=columns as usize {
                        sink.pixel(first + row * TILE as usize + column, self.pattern.full);
                    }
                }
            }
            return;
        }
        let mut row_start = corner;
        for row in 0..=rows as usize {
            let mut e = row_start;
            for column in 0..=columns as usize {
                // A negative number's sign bit survives an OR.
                let outside = (e[0] + self.most[0]) | (e[1] + self.most[1]) | (e[2] + self.most[2]);
                if outside >= 0 {
                    let crossed = (e[0] + self.least[0]) | (e[1] + self.least[1]) | (e[2] + self.least[2]);
                    let mask = if crossed >= 0 { self.pattern.full } else { self.partial(e) };
                    if mask != 0 {
                        sink.pixel(first + row * TILE as usize + column, mask);
                    }
                }
                for (e, step) in e.iter_mut().zip(step_x) {
                    *e += step;
                }
            }
            for (e, step) in row_start.iter_mut().zip(step_y) {
                *e += step;
            }
        }
    }

    /// The covered samples of a pixel that edges cross, from the edges' values at its upper left.
    #[inline]
    fn partial(&mut self, e: [i64; 3]) -> u64 {
        let mut mask = self.pattern.full;
        for (k, e) in e.into_iter().enumerate() {
            if e + self.least[k] >= 0 {
                continue;
            }
            let (a, b) = (self.edges.a[k], self.edges.b[k]);
            if a.abs() < SHORT_EDGE && b.abs() < SHORT_EDGE {
                if !self.has_table[k] {
                    self.has_table[k] = true;
                    let (a, b) = (a as i32, b as i32);
                    for (entry, [x, y]) in self.tables[k].iter_mut().zip(&self.pattern.points[..self.pattern.count]) {
                        *entry = a * x + b * y;
                    }
                }
                mask &= not_negative(e as i32, &self.tables[k][..self.pattern.count.next_multiple_of(8)]);
            } else {
                for (i, [x, y]) in self.pattern.points[..self.pattern.count].iter().enumerate() {
                    let inside = e + a * i64::from(*x) + b * i64::from(*y) >= 0;
                    mask &= !(u64::from(!inside) << i);
                }
            }
        }
        mask
    }
}

/// Bit i: whether `base + table[i]` is not negative; a table of 8 to 64 entries, in eights. Entries beyond the pattern give
/// bits that the caller masks away.
#[inline]
fn not_negative(base: i32, table: &[i32]) -> u64 {
    let mut mask = 0;
    for (group, entries) in table.chunks_exact(8).enumerate() {
        // Eight bytes of 0 or 1, then gathered to eight bits by a multiplication: byte i lands in bit 56 + i.
        let mut bytes = [0u8; 8];
        for (byte, entry) in bytes.iter_mut().zip(entries) {
            *byte = u8::from(base + entry >= 0);
        }
        let gathered = u64::from_le_bytes(bytes).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        mask |= gathered << (8 * group);
    }
    mask
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::setup::{Flags, Plane, WHOLE_FACE, area_twice};
    use crate::oracle::{Random, point_in_triangle};
    use proto::frame::TileIndex;
    use proto::view::Samples;

    const ALL: [Samples; 5] = [Samples::One, Samples::Four, Samples::Eight, Samples::Sixteen, Samples::SixtyFour];

    /// Counts how often each sample of a tile is hit.
    struct Count {
        hits: Vec<[u32; 64]>,
        full: u64,
    }

    impl Count {
        fn new(pattern: &Pattern) -> Self {
            Self { hits: vec![[0; 64]; TILE_PIXELS], full: pattern.full }
        }
    }

    impl CoverageSink for Count {
        fn skips(&mut self, _block: usize) -> bool {
            false
        }

        fn block(&mut self, _block: usize, pixel: usize, columns: usize, rows: usize) {
            for row in 0..rows {
                for column in 0..columns {
                    self.pixel(pixel + row * TILE as usize + column, self.full);
                }
            }
        }

        fn pixel(&mut self, pixel: usize, mask: u64) {
            assert!(mask != 0 && mask & !self.full == 0, "pixel {pixel}: {mask:b}");
            for (i, hit) in self.hits[pixel].iter_mut().enumerate() {
                *hit += (mask >> i & 1) as u32;
            }
        }
    }

    /// Of those corners, turned the right way round; `None` without area.
    fn triangle(corners: [[i32; 2]; 3]) -> Option<Triangle> {
        let [a, b, c] = corners;
        let area = area_twice(a, b, c);
        let [a, b, c] = if area < 0 { [a, c, b] } else { [a, b, c] };
        (area != 0).then_some(Triangle {
            x: [a[0], b[0], c[0]],
            y: [a[1], b[1], c[1]],
            plane: Plane::default(),
            q: [1.0; 3],
            order: 0,
            item: 0,
            face: 0,
            clip: WHOLE_FACE,
            flags: Flags(0),
        })
    }

    fn tile(x: u16, y: u16) -> PixelRect {
        TileIndex { x, y }.rect(100, 100)
    }

    /// All samples of a tile with their positions.
    fn samples(pattern: &Pattern, rect: PixelRect) -> impl Iterator<Item = (usize, usize, [i32; 2])> {
        (0..rect.height()).flat_map(move |y| {
            (0..rect.width()).flat_map(move |x| {
                (0..pattern.count).map(move |i| {
                    let [dx, dy] = pattern.points[i];
                    let at = [(rect.x0 + x) as i32 * SUBPIXELS + dx, (rect.y0 + y) as i32 * SUBPIXELS + dy];
                    ((y * TILE + x) as usize, i, at)
                })
            })
        })
    }

    #[test]
    fn random_triangles_of_every_magnitude_cover_what_exact_arithmetic_says() {
        let mut random = Random(0xACE);
        for round in 0..4000 {
            let pattern = Pattern::of(ALL[round % 5]);
            let rect = tile(random.below(4) as u16, random.below(4) as u16);
            // From one sub-pixel to the whole guard band, about a point in the tile; often on multiples of 2 and 64.
            let size = 1i64 << random.below(25);
            let grid = [1, 2, 64, 128][random.below(4) as usize];
            let centre = [rect.x0, rect.y0].map(|c| i64::from(c) * 256 + random.below(32 * 256) as i64);
            let corners = std::array::from_fn(|_| {
                centre.map(|c| {
                    let at = c + (random.signed() * size as f64) as i64;
                    (at / grid * grid).clamp(-(1 << 24), 1 << 24) as i32
                })
            });
            let Some(triangle) = triangle(corners) else { continue };
            let mut count = Count::new(pattern);
            cover(pattern, &triangle, rect, &mut count);
            let edges = Edges::of(&triangle);
            for (pixel, i, at) in samples(pattern, rect) {
                let inside = point_in_triangle(corners.map(|c| c.map(i128::from)), at.map(i128::from));
                assert_eq!(count.hits[pixel][i], u32::from(inside), "round {round}: {corners:?} at {at:?}");
                assert_eq!(edges.covers(at[0], at[1]), inside, "round {round}: {corners:?} at {at:?}");
            }
        }
    }

    #[test]
    fn shared_edge_is_hit_once() {
        let mut random = Random(0xED6E);
        for round in 0..60 {
            let pattern = Pattern::of(ALL[round % 5]);
            // A grid of cells over the tile and beyond, its inner corners jittered as far as cells stay convex, each cell
            // cut along one diagonal; on even rounds the corners lie on sample positions.
            let cells = [1, 3, 9, 40][random.below(4) as usize];
            let span = 40 * 256;
            let snap = if round % 2 == 0 { pattern.low * 2 } else { 1 };
            let reach = (0.24 * f64::from(span / cells) - f64::from(snap)).max(0.0);
            let corner: Vec<[i32; 2]> = (0..=cells)
                .flat_map(|j| (0..=cells).map(move |i| [i, j]))
                .map(|at| {
                    at.map(|k| {
                        let place = k * span / cells - 1024;
                        let inner = k != 0 && k != cells;
                        let jitter = if inner { (random.signed() * reach) as i32 } else { 0 };
                        // Down to a multiple, then on to the row or column of samples.
                        ((place + jitter) & !(snap - 1)) + snap / 2
                    })
                })
                .collect();
            let at = |i: i32, j: i32| corner[(j * (cells + 1) + i) as usize];
            let mut count = Count::new(pattern);
            for j in 0..cells {
                for i in 0..cells {
                    let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                    let pair = if random.below(2) == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
                    for corners in pair {
                        if let Some(triangle) = triangle(corners) {
                            cover(pattern, &triangle, tile(0, 0), &mut count);
                        }
                    }
                }
            }
            for (pixel, i, at) in samples(pattern, tile(0, 0)) {
                assert_eq!(count.hits[pixel][i], 1, "round {round}, {cells} cells, sample {at:?}");
            }
        }
    }

    #[test]
    fn a_fan_about_a_sample_hits_it_once() {
        let mut random = Random(0xFA);
        for samples in ALL {
            let pattern = Pattern::of(samples);
            for [dx, dy] in &pattern.points[..pattern.count] {
                let hub = [5 * 256 + dx, 7 * 256 + dy];
                let blades = 3 + random.below(9) as usize;
                let tip = |k: usize| {
                    let (sin, cos) = (std::f64::consts::TAU * (k % blades) as f64 / blades as f64).sin_cos();
                    [hub[0] + (cos * 3000.0) as i32, hub[1] + (sin * 3000.0) as i32]
                };
                let hits = (0..blades).filter_map(|k| triangle([hub, tip(k), tip(k + 1)]));
                assert_eq!(hits.filter(|t| Edges::of(t).covers(hub[0], hub[1])).count(), 1, "{blades} blades");
            }
        }
    }
}
