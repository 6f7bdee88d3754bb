//! The opaque stage of a tile: which face each sample sees, triangle by triangle.
//!
//! Triangles come roughly from front to back, so most of what is hidden is found hidden block by block: every block knows how far one
//! can see in it at least ([`Visible::far`]), and a triangle that lies wholly farther is left out there, or in all of the
//! tile. Then coverage makes masks of the block's 64 pixels, and bounds of depth decide for 16 of them at a time whether the
//! face is in front of what is there or behind. What is left over is looked at one by one: pixels on the triangle's rim, and those
//! where bounds overlap. All of that saves work; what is seen doesn't depend on it, nor on the order in which triangles come.

use super::coverage::{BLOCK, BLOCK_PIXELS, BLOCKS, BLOCKS_PER_ROW, SampleTables, TileCover, TileExtent};
use super::depth::{BlockDepth, bounds, fronts, in_front};
use super::visible::{Arriving, CENTRE, Visible};
use crate::frame::Frame;
use crate::geometry::setup::{Flags, Triangle};
use crate::pipeline::Skips;
use crate::prefetch::prefetch;
use crate::samples::{Pattern, SUBPIXELS};
use crate::shade::FaceCache;
use fearless_simd::Simd;
use proto::frame::{PixelRect, TILE};

/// How many triangles ahead memory is asked for. A guess: a few times what a small one takes.
const AHEAD: usize = 6;

/// What became of a tile's triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RasterCounts {
    /// (Triangle, tile) pairs that came.
    pub pairs: u64,
    /// (Triangle, block or tile) pairs left out because they were known to be hidden.
    pub occluded: u64,
    /// Faces put into pixels.
    pub covered_pixels: u64,
}

impl RasterCounts {
    /// Adds another tile's counts.
    pub fn add(&mut self, other: &Self) {
        self.pairs += other.pairs;
        self.occluded += other.occluded;
        self.covered_pixels += other.covered_pixels;
    }
}

/// Upper left of a block of a tile, sub.
#[inline(always)]
pub fn block_corner(rect: PixelRect, block: usize) -> [i32; 2] {
    let (bx, by) = (block as u32 % BLOCKS_PER_ROW, block as u32 / BLOCKS_PER_ROW);
    [(rect.x0 + bx * BLOCK) as i32 * SUBPIXELS, (rect.y0 + by * BLOCK) as i32 * SUBPIXELS]
}

/// Upper left of a tile's pixel, sub.
#[inline(always)]
pub fn pixel_corner(rect: PixelRect, pixel: usize) -> [i32; 2] {
    let [x, y] = block_corner(rect, pixel / BLOCK_PIXELS);
    let (column, row) = (pixel as u32 % BLOCK, pixel as u32 / BLOCK % BLOCK);
    [x + column as i32 * SUBPIXELS, y + row as i32 * SUBPIXELS]
}

/// Of each block the pixels that the view has: bit 8·row + column.
#[inline(always)]
pub fn pixels_of_view(rect: PixelRect) -> [u64; BLOCKS] {
    if rect.width() == BLOCKS_PER_ROW * BLOCK && rect.height() == BLOCKS_PER_ROW * BLOCK {
        return [u64::MAX; BLOCKS];
    }
    std::array::from_fn(|block| {
        let (bx, by) = (block as u32 % BLOCKS_PER_ROW * BLOCK, block as u32 / BLOCKS_PER_ROW * BLOCK);
        let columns = rect.width().saturating_sub(bx).min(BLOCK);
        let rows = rect.height().saturating_sub(by).min(BLOCK);
        let row = 0xffu64 >> (BLOCK - columns);
        (0..rows).fold(0, |mask, y| mask | row << (y * BLOCK))
    })
}

/// Where in a tile a triangle is, and the bounds of its depth by blocks; `None` if nothing of it can be seen there. What is behind all that the tile shows is
/// told from one bound over the whole tile, before anything else is computed.
#[inline(always)]
pub fn unless_hidden<S: Simd>(
    simd: S,
    skips: Skips,
    pattern: &Pattern,
    rect: PixelRect,
    triangle: &Triangle,
    visible: &mut Visible,
    counts: &mut RasterCounts,
) -> Option<(TileExtent, BlockDepth)> {
    let plane = triangle.plane();
    let far = if skips.occluded { visible.tile_far(simd) } else { f32::NEG_INFINITY };
    let is_behind = |[x, y]: [i32; 2], side: i32| bounds(&plane, x, y, side * SUBPIXELS)[1] < f64::from(far);
    let corner = block_corner(rect, 0);
    if far != f32::NEG_INFINITY && is_behind(corner, TILE as i32) {
        counts.occluded += 1;
        return None;
    }
    let extent = TileExtent::new(pattern, triangle, rect)?;
    let depth = BlockDepth::new(pattern, &plane, corner);
    let is_hidden = match extent.one_block() {
        Some(block) => skips.occluded && nearest_in_block(&depth, depth.at(block)) < visible.far(simd, block),
        None => {
            let [[x0, x1], [y0, y1]] = extent.pixels;
            far != f32::NEG_INFINITY && is_behind([x0 * SUBPIXELS, y0 * SUBPIXELS], (x1 - x0).max(y1 - y0) + 1)
        }
    };
    if is_hidden {
        counts.occluded += 1;
        return None;
    }
    Some((extent, depth))
}

/// The largest upper bound of a face in a block.
#[inline(always)]
pub fn nearest_in_block(depth: &BlockDepth, [_, high]: [f32; 2]) -> f32 {
    high + depth.most_gained()
}

/// Puts the triangles of a tile's list that are not fragments into an empty tile.
#[inline(always)]
pub fn draw_opaque<S: Simd>(
    simd: S,
    frame: &Frame<'_>,
    rect: PixelRect,
    numbers: &[u32],
    visible: &mut Visible,
    tables: &mut SampleTables,
    faces: &mut FaceCache,
    skips: Skips,
    counts: &mut RasterCounts,
) {
    counts.pairs += numbers.len() as u64;
    let valid = pixels_of_view(rect);
    let pattern = frame.pattern;
    for (place, &number) in numbers.iter().enumerate() {
        let triangle = frame.triangle(number);
        if let Some(next) = numbers.get(place + AHEAD) {
            prefetch(frame.triangle(*next));
        }
        let found = unless_hidden(simd, skips, pattern, rect, triangle, visible, counts);
        let Some((extent, depth)) = found else { continue };
        let cover = TileCover::new(pattern, triangle, rect);
        let is_small = extent.one_block().is_some();
        tables.clear();
        let gains = depth.lattice(simd);
        let is_whole = triangle.flags.0 & (Flags::BEYOND | Flags::CUT_OUT) == 0;
        for block in extent.blocks() {
            let base = depth.at(block);
            if !is_small && skips.occluded && nearest_in_block(&depth, base) < visible.far(simd, block) {
                counts.occluded += 1;
                continue;
            }
            let rows = extent.rows(block);
            let covered = cover.block(simd, block, rows);
            let touched = covered.touched & valid[block];
            if touched == 0 || triangle.flags.has(Flags::BACK) {
                continue;
            }
            let depths = visible.compare(simd, block, rows, base, &gains);
            let reached = touched & !depths.behind;
            let filled = if is_whole && skips.single { reached & covered.full & depths.front } else { 0 };
            if filled != 0 {
                visible.fill(simd, block, filled, place as u32, base, &gains, depth.least_gained());
                counts.covered_pixels += u64::from(filled.count_ones());
            }
            let mut rest = reached & !filled;
            while rest != 0 {
                let bit = rest.trailing_zeros();
                rest &= rest - 1;
                let is_full = covered.full >> bit & 1 != 0;
                let mask = if is_full { pattern.full } else { cover.samples(simd, tables, block, bit) };
                if mask == 0 {
                    continue;
                }
                let [low, high] = depth.at_pixel(base, bit);
                // Samples are numbered by their distance from the centre.
                let is_central = is_full || cover.covers_centre(block, bit);
                let point = if is_central { CENTRE } else { mask.trailing_zeros() as u8 };
                let face = Arriving { triangle: place as u32, low, high, point };
                let pixel = block * BLOCK_PIXELS + bit as usize;
                let [px, py] = pixel_corner(rect, pixel);
                let is_front = depths.front >> bit & 1 != 0;
                let front = |other: u32, both: u64| {
                    if is_front {
                        return both;
                    }
                    let other = numbers[other as usize];
                    let wins_ties = || frame.order(number) > frame.order(other);
                    if pattern.count == 1 {
                        return in_front(pattern, triangle, frame.triangle(other), px, py, both, wins_ties);
                    }
                    simd.vectorize(
                        #[inline(always)]
                        || fronts(simd, pattern, triangle, frame.triangle(other), px, py, both, wins_ties),
                    )
                };
                let mask = if is_whole {
                    mask
                } else {
                    remaining(frame, number, [px, py], pixel, mask, visible, faces, front)
                };
                if mask != 0 {
                    counts.covered_pixels += 1;
                    visible.put(pixel, face, mask, front);
                }
            }
        }
    }
}

/// Of the covered samples those at which a face exists that visibility or its alpha makes holes in. Alpha is only looked at
/// where the face would be seen.
#[inline(never)]
fn remaining(
    frame: &Frame<'_>,
    number: u32,
    [x, y]: [i32; 2],
    pixel: usize,
    mut mask: u64,
    visible: &Visible,
    faces: &mut FaceCache,
    front: impl FnMut(u32, u64) -> u64,
) -> u64 {
    let triangle = frame.triangle(number);
    if triangle.flags.has(Flags::BEYOND) {
        mask = frame.within_visibility(triangle, x, y, mask);
    }
    if let Some(cutoff) = frame.items[triangle.item as usize].cutoff() {
        mask = visible.unhidden(pixel, mask, front);
        mask = frame.reaches_cutoff(faces, number, cutoff, x, y, mask);
    }
    mask
}
