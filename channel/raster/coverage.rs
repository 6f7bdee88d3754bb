//! Coverage: which samples a triangle covers, decided in integers and by its rounded vertices alone.
//!
//! An edge from a to b has the function E(p) = (b − a) × (p − a) = A·x + B·y + C, positive inside. A sample exactly on an
//! edge belongs to the triangle if the edge is a top or a left one; for the other edges C is lessened by 1, so that
//! "inside" is E ≥ 0 for all three, and a point on an edge shared by two triangles belongs to exactly one.
//!
//! Coarse to fine, all with the same functions. A block of 8 × 8 pixels is left out if all of its sample range lies outside of one
//! edge, and is taken whole if it lies inside of all. Where an edge crosses the block, two masks of 64 pixels come from one
//! pass over its lattice: the pixels that have the sample range partly inside of all edges (*touched*), and those that have it
//! wholly inside (*full*). Only in pixels that are touched and not full are samples asked one by one. With one sample that
//! range is a point, and the last case doesn't occur.
//!
//! The bit budget of the lattice: a pixel's E differs from the block's by 256 · (A·i + B·j) with i, j < 8, so
//! E ≥ 0 is the same as A·i + B·j + ⌊E₀/256⌋ ≥ 0. With |A|, |B| ≤ 2²⁵ the sum A·i + B·j is below 2²⁹, and so is the
//! other term where the edge crosses the block: 32 bits suffice for triangles of any size.

#![deny(clippy::float_arithmetic)]

use crate::geometry::camera::GUARD_BITS;
use crate::geometry::setup::Triangle;
use crate::samples::{Pattern, SUBPIXEL_BITS, SUBPIXELS};
use crate::simd::each3;
use fearless_simd::{Simd, i32x16, prelude::*};
use proto::frame::{PixelRect, TILE};

/// Side of a block, pixels.
pub const BLOCK: u32 = 8;
/// Blocks in a row of a tile.
pub const BLOCKS_PER_ROW: u32 = TILE / BLOCK;
/// Blocks of a tile.
pub const BLOCKS: usize = (BLOCKS_PER_ROW * BLOCKS_PER_ROW) as usize;
/// Pixels of a block: one bit each in a mask, row by row.
pub const BLOCK_PIXELS: usize = (BLOCK * BLOCK) as usize;
/// Pixels of a tile. Arrays over them go block by block, and within a block row by row.
pub const TILE_PIXELS: usize = (TILE * TILE) as usize;

/// Place of a tile's pixel in arrays over its pixels.
#[inline(always)]
pub fn pixel_number(x: u32, y: u32) -> usize {
    let block = (y / BLOCK) * BLOCKS_PER_ROW + x / BLOCK;
    (block * BLOCK * BLOCK + y % BLOCK * BLOCK + x % BLOCK) as usize
}

const _: () = assert!(BLOCK_PIXELS == 64, "a block's pixels are the bits of a u64");
const _: () = assert!(GUARD_BITS + 1 + 1 + 3 < 31, "A·i + B·j of a block must fit in an i32");

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
    #[inline(always)]
    pub fn of(triangle: &Triangle) -> Self {
        let (x, y) = (each3(triangle.x, i64::from), each3(triangle.y, i64::from));
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
    #[inline(always)]
    pub fn covers(&self, x_sub: i32, y_sub: i32) -> bool {
        // A negative number's sign bit survives an OR.
        (self.at(0, x_sub, y_sub) | self.at(1, x_sub, y_sub) | self.at(2, x_sub, y_sub)) >= 0
    }

    /// The covered samples of the pixel whose upper left is there.
    #[inline(always)]
    pub fn mask(&self, pattern: &Pattern, x_sub: i32, y_sub: i32) -> u64 {
        let mut mask = 0;
        for (i, [x, y]) in pattern.points[..pattern.count].iter().enumerate() {
            mask |= u64::from(self.covers(x_sub + x, y_sub + y)) << i;
        }
        mask
    }

    /// Whether all of a square is covered, its sides included.
    #[inline(always)]
    pub fn covers_square(&self, x_sub: i32, y_sub: i32, side: i32) -> bool {
        let least =
            each3([0, 1, 2], |k| self.at(k, x_sub, y_sub) + (self.a[k].min(0) + self.b[k].min(0)) * i64::from(side));
        (least[0] | least[1] | least[2]) >= 0
    }

    /// Which cells of a grid over the pixel whose upper left is there have their middles covered, the middles rounded down to
    /// sub-pixels: bit row · columns + column. At most 256 cells.
    #[inline(always)]
    pub fn cells(&self, x_sub: i32, y_sub: i32, [columns, rows]: [u32; 2]) -> [u64; 4] {
        // Half a cell in 2⁻¹⁶ of a sub-pixel.
        const ONE: u32 = (SUBPIXELS as u32 / 2) << 16;
        let (half_column, half_row) = (ONE / columns, ONE / rows);
        let mut cells = [0; 4];
        let mut bit = 0usize;
        for row in 0..rows {
            let y = y_sub + (((2 * row + 1) * half_row) >> 16) as i32;
            let at = each3([0, 1, 2], |k| self.at(k, x_sub, y));
            for column in 0..columns {
                let x = i64::from(((2 * column + 1) * half_column) >> 16);
                let e = each3([0, 1, 2], |k| at[k] + self.a[k] * x);
                cells[bit / 64] |= u64::from((e[0] | e[1] | e[2]) >= 0) << (bit % 64);
                bit += 1;
            }
        }
        cells
    }

    /// Whether a square whose samples lie between `low` and `high` of its upper left, both axes, has none inside
    /// because one edge has them all outside.
    #[inline(always)]
    pub fn misses(&self, x_sub: i32, y_sub: i32, low: i32, high: i32) -> bool {
        let most = each3([0, 1, 2], |k| self.at(k, x_sub, y_sub) + self.largest(k, low, high));
        (most[0] | most[1] | most[2]) < 0
    }

    #[inline(always)]
    fn at(&self, k: usize, x_sub: i32, y_sub: i32) -> i64 {
        self.a[k] * i64::from(x_sub) + self.b[k] * i64::from(y_sub) + self.c[k]
    }

    /// Most that edge k gains from a square's upper left to a point of its range.
    #[inline(always)]
    fn largest(&self, k: usize, low: i32, high: i32) -> i64 {
        let far = |slope: i64| slope * i64::from(if slope > 0 { high } else { low });
        far(self.a[k]) + far(self.b[k])
    }
}

/// Which pixels of a block a triangle covers: bit 8·row + column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockCover {
    /// Pixels with a sample that may be covered; all that have one.
    pub touched: u64,
    /// Pixels whose samples are all covered.
    pub full: u64,
}

/// Numbers of the blocks of a rectangle, row by row.
#[derive(Clone, Debug)]
pub struct Blocks {
    at: usize,
    column: i32,
    columns: [i32; 2],
    last: usize,
}

impl Iterator for Blocks {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let at = self.at;
        if at > self.last {
            return None;
        }
        if self.column == self.columns[1] {
            self.column = self.columns[0];
            self.at += (BLOCKS_PER_ROW as i32 - (self.columns[1] - self.columns[0])) as usize;
        } else {
            self.column += 1;
            self.at += 1;
        }
        Some(at)
    }
}

/// What an edge function gains from the upper left of a pixel or a block to the samples in it.
#[derive(Clone, Copy, Debug, Default)]
struct EdgeRange {
    /// Sum of its negative slopes per sub-pixel.
    falls: i64,
    /// Least and most within a pixel.
    least: i64,
    most: i64,
    /// Least and most within a block.
    block_least: i64,
    block_most: i64,
}

impl EdgeRange {
    #[inline(always)]
    fn new(a: i64, b: i64, low: i32, high: i32) -> Self {
        let (rises, falls) = (a.max(0) + b.max(0), a.min(0) + b.min(0));
        let (low, high) = (i64::from(low), i64::from(high));
        let (least, most) = (falls * high + rises * low, rises * high + falls * low);
        // From a block's first pixel to its last.
        let rest = i64::from((BLOCK as i32 - 1) * SUBPIXELS);
        Self { falls, least, most, block_least: least + falls * rest, block_most: most + rises * rest }
    }
}

/// Two rows of pixels each: what is worked on at once. First and last of a block's four, ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowPairs {
    /// 0 to 3.
    pub first: usize,
    /// Likewise, not less.
    pub last: usize,
}

impl RowPairs {
    /// All of a block.
    pub const ALL: Self = Self { first: 0, last: BLOCK as usize / 2 - 1 };
}

/// The part of a tile that a triangle's extent meets.
#[derive(Clone, Copy, Debug)]
pub struct TileExtent {
    /// First and last pixel of the view, columns and rows.
    pub pixels: [[i32; 2]; 2],
    /// First and last block of the tile, columns and rows.
    blocks: [[i32; 2]; 2],
    /// First and last row of the tile.
    rows: [i32; 2],
}

impl TileExtent {
    /// Of a triangle in `rect`, a tile's; `None` if its extent has no sample there.
    #[inline(always)]
    pub fn new(pattern: &Pattern, triangle: &Triangle, rect: PixelRect) -> Option<Self> {
        let [[x0, x1], [y0, y1]] = triangle.pixels(pattern.low, pattern.high());
        let (left, top) = (rect.x0 as i32, rect.y0 as i32);
        let x = [x0.max(left), x1.min(rect.x1 as i32 - 1)];
        let y = [y0.max(top), y1.min(rect.y1 as i32 - 1)];
        if x[0] > x[1] || y[0] > y[1] {
            return None;
        }
        let block = BLOCK.trailing_zeros();
        let blocks = [[(x[0] - left) >> block, (x[1] - left) >> block], [(y[0] - top) >> block, (y[1] - top) >> block]];
        Some(Self { pixels: [x, y], blocks, rows: [y[0] - top, y[1] - top] })
    }

    /// The rows of one of its blocks in which it has pixels.
    #[inline(always)]
    pub fn rows(&self, block: usize) -> RowPairs {
        let top = (block as u32 / BLOCKS_PER_ROW * BLOCK) as i32;
        let pair = |row: i32| (row - top).clamp(0, BLOCK as i32 - 1) as usize / 2;
        RowPairs { first: pair(self.rows[0]), last: pair(self.rows[1]) }
    }

    /// The block that holds all of it, if one does.
    #[inline(always)]
    pub fn one_block(&self) -> Option<usize> {
        let [[x0, x1], [y0, y1]] = self.blocks;
        (x0 == x1 && y0 == y1).then_some((y0 * BLOCKS_PER_ROW as i32 + x0) as usize)
    }

    /// The numbers of its blocks, row by row.
    #[inline(always)]
    pub fn blocks(&self) -> Blocks {
        let [[x0, x1], [y0, y1]] = self.blocks;
        let row = BLOCKS_PER_ROW as i32;
        Blocks { at: (y0 * row + x0) as usize, column: x0, columns: [x0, x1], last: (y1 * row + x1) as usize }
    }
}

/// One triangle's coverage of one tile.
#[derive(Debug)]
pub struct TileCover<'a> {
    pattern: &'a Pattern,
    edges: Edges,
    /// The tile's upper left, sub.
    corner: [i32; 2],
    ranges: [EdgeRange; 3],
    /// All samples of the tile are covered.
    covers_tile: bool,
}

/// What each edge of a triangle gains from a pixel's upper left to each sample, made when first needed.
#[derive(Debug)]
pub struct SampleTables {
    gains: [[i32; 64]; 3],
    are_made: [bool; 3],
}

impl Default for SampleTables {
    fn default() -> Self {
        Self { gains: [[0; 64]; 3], are_made: [false; 3] }
    }
}

impl SampleTables {
    /// Forgets the triangle before.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.are_made = [false; 3];
    }
}

impl<'a> TileCover<'a> {
    /// Of a triangle in the tile whose upper left is pixel (`rect.x0`, `rect.y0`).
    #[inline(always)]
    pub fn new(pattern: &'a Pattern, triangle: &Triangle, rect: PixelRect) -> Self {
        let (low, high) = (pattern.low, pattern.high());
        let (left, top) = (rect.x0 as i32, rect.y0 as i32);
        let edges = Edges::of(triangle);
        let mut ranges = [EdgeRange::default(); 3];
        let mut least_in_tile = 0;
        for k in 0..3 {
            let range = EdgeRange::new(edges.a[k], edges.b[k], low, high);
            // A negative number's sign bit survives an OR.
            least_in_tile |= edges.at(k, left * SUBPIXELS, top * SUBPIXELS)
                + range.least
                + range.falls * i64::from((TILE as i32 - 1) * SUBPIXELS);
            ranges[k] = range;
        }
        Self { pattern, edges, corner: [left * SUBPIXELS, top * SUBPIXELS], ranges, covers_tile: least_in_tile >= 0 }
    }

    /// The pixels of a block that the triangle covers, beyond the view's border as well; of each row that isn't in `rows` maybe none, see
    /// [`TileExtent::rows`].
    #[inline(always)]
    pub fn block<S: Simd>(&self, simd: S, block: usize, rows: RowPairs) -> BlockCover {
        if self.covers_tile {
            return BlockCover { touched: u64::MAX, full: u64::MAX };
        }
        let [x, y] = self.block_corner(block);
        let mut is_crossed = false;
        // Of an edge that doesn't cross the block: inside, everywhere.
        let (mut a, mut b, mut most, mut least) = ([0; 3], [0; 3], [0; 3], [0; 3]);
        for k in 0..3 {
            let range = &self.ranges[k];
            let at = self.edges.at(k, x, y);
            if at + range.block_most < 0 {
                return BlockCover::default();
            }
            if at + range.block_least < 0 {
                is_crossed = true;
                (a[k], b[k]) = (self.edges.a[k] as i32, self.edges.b[k] as i32);
                most[k] = ((at + range.most) >> SUBPIXEL_BITS) as i32;
                least[k] = ((at + range.least) >> SUBPIXEL_BITS) as i32;
            }
        }
        if !is_crossed {
            return BlockCover { touched: u64::MAX, full: u64::MAX };
        }
        let columns = i32x16::simd_from(simd, LATTICE[0]);
        let two_rows = i32x16::simd_from(simd, LATTICE[1]);
        // Not with a closure: it would be a function without the level's instructions.
        let steps =
            [columns * a[0] + two_rows * b[0], columns * a[1] + two_rows * b[1], columns * a[2] + two_rows * b[2]];
        // With one sample, least and most are the same.
        let has_range = self.pattern.count != 1;
        let mut cover = BlockCover::default();
        for pair in rows.first..=rows.last {
            let down = 2 * pair as i32;
            // A negative number's sign bit survives an OR.
            let outside = (steps[0] + (most[0] + down * b[0]))
                | (steps[1] + (most[1] + down * b[1]))
                | (steps[2] + (most[2] + down * b[2]));
            let touched = outside.simd_ge(0).to_bitmask();
            cover.touched |= touched << (16 * pair);
            if has_range {
                let partial = (steps[0] + (least[0] + down * b[0]))
                    | (steps[1] + (least[1] + down * b[1]))
                    | (steps[2] + (least[2] + down * b[2]));
                cover.full |= partial.simd_ge(0).to_bitmask() << (16 * pair);
            }
        }
        if !has_range {
            cover.full = cover.touched;
        }
        cover
    }

    /// The covered samples of a touched pixel; may be none. `tables` are this triangle's.
    #[inline(always)]
    pub fn samples<S: Simd>(&self, simd: S, tables: &mut SampleTables, block: usize, pixel: u32) -> u64 {
        let [x, y] = self.block_corner(block);
        let (x, y) = (x + (pixel % BLOCK) as i32 * SUBPIXELS, y + (pixel / BLOCK) as i32 * SUBPIXELS);
        let mut mask = self.pattern.full;
        for k in 0..3 {
            let e = self.edges.at(k, x, y);
            if e + self.ranges[k].least >= 0 {
                continue;
            }
            let (a, b) = (self.edges.a[k], self.edges.b[k]);
            if a.abs() < SHORT_EDGE && b.abs() < SHORT_EDGE {
                if !tables.are_made[k] {
                    tables.are_made[k] = true;
                    self.make_table(simd, k, &mut tables.gains[k]);
                }
                // An edge that has the whole pixel outside gives no samples; else |E| is as small as the table's entries.
                if e + self.ranges[k].most < 0 {
                    return 0;
                }
                mask &= not_negative(simd, e as i32, &tables.gains[k], self.pattern.count);
            } else {
                for (i, [x, y]) in self.pattern.points[..self.pattern.count].iter().enumerate() {
                    let inside = e + a * i64::from(*x) + b * i64::from(*y) >= 0;
                    mask &= !(u64::from(!inside) << i);
                }
            }
        }
        mask
    }

    /// Whether the triangle covers a pixel's centre.
    #[inline(always)]
    pub fn covers_centre(&self, block: usize, pixel: u32) -> bool {
        let [x, y] = self.block_corner(block);
        let half = SUBPIXELS / 2;
        let (x, y) = (x + (pixel % BLOCK) as i32 * SUBPIXELS, y + (pixel / BLOCK) as i32 * SUBPIXELS);
        self.edges.covers(x + half, y + half)
    }

    #[inline(always)]
    fn make_table<S: Simd>(&self, simd: S, k: usize, gains: &mut [i32; 64]) {
        let (a, b) = (self.edges.a[k] as i32, self.edges.b[k] as i32);
        for from in (0..self.pattern.count).step_by(16) {
            let x = i32x16::from_slice(simd, &self.pattern.points_x[from..from + 16]);
            let y = i32x16::from_slice(simd, &self.pattern.points_y[from..from + 16]);
            (x * a + y * b).store_slice(&mut gains[from..from + 16]);
        }
    }

    /// Upper left of a block, sub.
    #[inline(always)]
    fn block_corner(&self, block: usize) -> [i32; 2] {
        let [x, y] = self.corner;
        let (column, row) = (block as i32 % BLOCKS_PER_ROW as i32, block as i32 / BLOCKS_PER_ROW as i32);
        let side = BLOCK as i32 * SUBPIXELS;
        [x + column * side, y + row * side]
    }
}

/// Column and row of the first 16 pixels of a block.
const LATTICE: [[i32; 16]; 2] =
    [[0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7], [0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1]];

/// Bit i: whether `base + table[i]` is not negative, for the first `count` entries.
#[inline(always)]
fn not_negative<S: Simd>(simd: S, base: i32, table: &[i32; 64], count: usize) -> u64 {
    let mut mask = 0;
    for from in (0..count).step_by(16) {
        let sum = i32x16::from_slice(simd, &table[from..from + 16]) + base;
        mask |= sum.simd_ge(0).to_bitmask() << from;
    }
    mask
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::setup::{Flags, Plane, WHOLE_FACE, area_twice};
    use crate::oracle::{Random, point_in_triangle};
    use crate::simd::{at_level, every_level};
    use proto::frame::TileIndex;
    use proto::view::Samples;

    const ALL: [Samples; 5] = [Samples::One, Samples::Four, Samples::Eight, Samples::Sixteen, Samples::SixtyFour];

    /// Counts how often each sample of a tile is hit.
    struct Count {
        hits: Vec<[u32; 64]>,
    }

    impl Count {
        fn new() -> Self {
            Self { hits: vec![[0; 64]; TILE_PIXELS] }
        }

        /// Adds what a triangle covers, at every level, all of which must agree.
        fn cover(&mut self, pattern: &Pattern, triangle: &Triangle, rect: PixelRect) {
            let Some(extent) = TileExtent::new(pattern, triangle, rect) else { return };
            let cover = TileCover::new(pattern, triangle, rect);
            for block in extent.blocks() {
                let rows = extent.rows(block);
                let found: Vec<BlockCover> = every_level()
                    .into_iter()
                    .map(|level| at_level!(level, simd => cover.block(simd, block, rows)))
                    .collect();
                assert!(found.iter().all(|f| *f == found[0]), "{found:?}");
                let BlockCover { touched, full } = found[0];
                assert_eq!(full & !touched, 0, "what is full is touched");
                for pixel in (0..64).filter(|p| touched >> p & 1 != 0) {
                    let masks: Vec<u64> = every_level()
                        .into_iter()
                        .map(|level| {
                            let mut tables = SampleTables::default();
                            at_level!(level, simd => cover.samples(simd, &mut tables, block, pixel))
                        })
                        .collect();
                    assert!(masks.iter().all(|m| *m == masks[0]), "{masks:?}");
                    let is_full = full >> pixel & 1 != 0;
                    assert!(!is_full || masks[0] == pattern.full, "block {block}, pixel {pixel}");
                    assert!(pattern.count > 1 || is_full, "one sample: touched is full");
                    for (i, hit) in self.hits[block * BLOCK_PIXELS + pixel as usize].iter_mut().enumerate() {
                        *hit += (masks[0] >> i & 1) as u32;
                    }
                }
            }
        }
    }

    /// Of those corners, turned the right way round; `None` without area.
    fn triangle(corners: [[i32; 2]; 3]) -> Option<Triangle> {
        let [a, b, c] = corners;
        let area = area_twice(a, b, c);
        let [a, b, c] = if area < 0 { [a, c, b] } else { [a, b, c] };
        let (x, y) = ([a[0], b[0], c[0]], [a[1], b[1], c[1]]);
        let plane = Plane { x: x[0], y: y[0], ..Plane::default() };
        (area != 0).then(|| Triangle::new(x, y, &plane, 0, 0, WHOLE_FACE, Flags(0)))
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
                    (pixel_number(x, y), i, at)
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
            let mut count = Count::new();
            count.cover(pattern, &triangle, rect);
            let edges = Edges::of(&triangle);
            for (pixel, i, at) in samples(pattern, rect) {
                let inside = point_in_triangle(corners.map(|c| c.map(i128::from)), at.map(i128::from));
                assert_eq!(count.hits[pixel][i], u32::from(inside), "round {round}: {corners:?} at {at:?}");
                assert_eq!(edges.covers(at[0], at[1]), inside, "round {round}: {corners:?} at {at:?}");
            }
        }
    }

    #[test]
    fn cells_and_squares_are_those_that_each_point_says() {
        let mut random = Random(0xCE11);
        let (mut covered, mut squares) = (0, 0);
        for round in 0..3000 {
            let size = [300.0, 3000.0, 100_000.0][round % 3];
            let corners = [0; 3].map(|_| [0; 2].map(|_| 5000 + (random.signed() * size) as i32));
            let Some(triangle) = triangle(corners) else { continue };
            let edges = Edges::of(&triangle);
            let [x, y] = [0; 2].map(|_| random.below(40) as i32 * SUBPIXELS);
            let counts = [1 + random.below(16) as u32, 1 + random.below(16) as u32];
            let cells = edges.cells(x, y, counts);
            for bit in 0..(counts[0] * counts[1]) as usize {
                let (column, row) = (bit as u32 % counts[0], bit as u32 / counts[0]);
                // Half cells in 2⁻¹⁶ of a sub-pixel, as they are rounded there.
                let middle = |k: u32, count: u32| (((2 * k + 1) * ((128 << 16) / count)) >> 16) as i32;
                let at = [x + middle(column, counts[0]), y + middle(row, counts[1])];
                let inside = point_in_triangle(corners.map(|c| c.map(i128::from)), at.map(i128::from));
                assert_eq!(cells[bit / 64] >> (bit % 64) & 1 != 0, inside, "round {round}, cell {bit} of {counts:?}");
                covered += usize::from(inside);
            }
            let all = [[0, 0], [SUBPIXELS, 0], [0, SUBPIXELS], [SUBPIXELS, SUBPIXELS]];
            let is_full = all.iter().all(|[dx, dy]| edges.covers(x + dx, y + dy));
            assert_eq!(edges.covers_square(x, y, SUBPIXELS), is_full, "round {round}");
            squares += usize::from(is_full);
        }
        assert!(covered > 1000 && squares > 50, "{covered} cells and {squares} squares");
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
            let mut count = Count::new();
            for j in 0..cells {
                for i in 0..cells {
                    let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                    let pair = if random.below(2) == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
                    for corners in pair {
                        if let Some(triangle) = triangle(corners) {
                            count.cover(pattern, &triangle, tile(0, 0));
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
