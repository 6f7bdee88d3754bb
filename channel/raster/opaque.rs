//! The raster stage of a tile: its opaque and MASK triangles, in the order of the list, into [`Visible`].
//!
//! Lists run front to back, so most of what comes late is hidden. Per block of 8 × 8 pixels a *far bound* is kept: a q that
//! every sample of the block is known to reach, because some face that covers all of it does. A triangle whose q over
//! the block stays below is left out there without a look at a pixel. It is a bound and only ever spares work; what
//! is seen doesn't depend on it, nor on the order in which triangles come.

use super::coverage::{BLOCK, BLOCKS, BLOCKS_PER_ROW, CoverageSink, cover};
use super::depth::{bounds, in_front};
use super::visible::Visible;
use crate::geometry::setup::{Flags, Triangle};
use crate::samples::SUBPIXELS;
use crate::shade::{FaceCache, Shader};
use proto::frame::{PixelRect, TILE};

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

/// What is known of how far one can see in a tile.
#[derive(Clone, Debug)]
pub struct FarBounds {
    /// Per block: all samples see something with at least this q.
    blocks: [f64; BLOCKS],
    /// The least of them.
    tile: f64,
}

impl FarBounds {
    /// Nothing is hidden.
    pub const OPEN: Self = Self { blocks: [f64::NEG_INFINITY; BLOCKS], tile: f64::NEG_INFINITY };

    /// Whether a triangle is surely hidden in the whole tile.
    #[inline]
    pub fn hides_in_tile(&self, triangle: &Triangle, rect: PixelRect) -> bool {
        let [x, y] = [rect.x0, rect.y0].map(|c| c as i32 * SUBPIXELS);
        self.tile > 0.0 && bounds(triangle, x, y, TILE as i32 * SUBPIXELS)[1] < self.tile
    }

    /// Whether it is surely hidden in a block of the tile.
    #[inline]
    pub fn hides_in_block(&self, triangle: &Triangle, rect: PixelRect, block: usize) -> bool {
        if self.blocks[block] <= 0.0 {
            return false;
        }
        let [x, y] = block_corner(rect, block);
        bounds(triangle, x, y, BLOCK as i32 * SUBPIXELS)[1] < self.blocks[block]
    }

    /// An opaque triangle covers all of a block.
    fn cover(&mut self, triangle: &Triangle, rect: PixelRect, block: usize) {
        let [x, y] = block_corner(rect, block);
        let low = bounds(triangle, x, y, BLOCK as i32 * SUBPIXELS)[0];
        if low > self.blocks[block] {
            self.blocks[block] = low;
            self.tile = self.blocks.iter().fold(f64::INFINITY, |least, q| if *q < least { *q } else { least });
        }
    }
}

/// Upper left of a block, sub.
fn block_corner(rect: PixelRect, block: usize) -> [i32; 2] {
    let (bx, by) = (block as u32 % BLOCKS_PER_ROW, block as u32 / BLOCKS_PER_ROW);
    [rect.x0 + bx * BLOCK, rect.y0 + by * BLOCK].map(|c| c as i32 * SUBPIXELS)
}

/// Upper left of a tile's pixel, sub.
#[inline]
pub fn pixel_corner(rect: PixelRect, pixel: usize) -> [i32; 2] {
    let (x, y) = (pixel as u32 % TILE, pixel as u32 / TILE);
    [rect.x0 + x, rect.y0 + y].map(|c| c as i32 * SUBPIXELS)
}

/// Puts the triangles `numbers` into an empty tile.
pub fn draw_opaque(
    shader: &Shader<'_>,
    rect: PixelRect,
    numbers: &[u32],
    visible: &mut Visible,
    far: &mut FarBounds,
    faces: &mut FaceCache,
    counts: &mut RasterCounts,
) {
    let mut touched = 0;
    counts.pairs += numbers.len() as u64;
    for &number in numbers {
        let triangle = &shader.triangles[number as usize];
        if far.hides_in_tile(triangle, rect) {
            counts.occluded += 1;
            continue;
        }
        let cutoff = shader.items[triangle.item as usize].cutoff();
        let beyond = triangle.flags.has(Flags::BEYOND);
        let mut sink = OpaqueSink {
            shader,
            rect,
            number,
            triangle,
            cutoff,
            whole: cutoff.is_none() && !beyond,
            beyond,
            is_fresh: false,
            touched: &mut touched,
            visible,
            far,
            faces,
            counts,
        };
        cover(shader.pattern, triangle, rect, &mut sink);
    }
}

/// One triangle on its way into a tile.
struct OpaqueSink<'a, 'b> {
    shader: &'a Shader<'a>,
    rect: PixelRect,
    number: u32,
    triangle: &'a Triangle,
    cutoff: Option<f32>,
    beyond: bool,
    /// Whether what covers also hides: neither a cut-off nor the end of visibility makes holes.
    whole: bool,
    /// Whether the block that was asked for last was never touched by any triangle.
    is_fresh: bool,
    /// A bit per block: some triangle may have put something there.
    touched: &'b mut u16,
    visible: &'b mut Visible,
    far: &'b mut FarBounds,
    faces: &'b mut FaceCache,
    counts: &'b mut RasterCounts,
}

impl CoverageSink for OpaqueSink<'_, '_> {
    #[inline]
    fn skips(&mut self, block: usize) -> bool {
        if self.far.hides_in_block(self.triangle, self.rect, block) {
            self.counts.occluded += 1;
            return true;
        }
        self.is_fresh = *self.touched & 1 << block == 0;
        *self.touched |= 1 << block;
        false
    }

    fn block(&mut self, block: usize, pixel: usize, columns: usize, rows: usize) {
        let fills = self.whole && self.is_fresh;
        for row in 0..rows {
            let first = pixel + row * TILE as usize;
            for pixel in first..first + columns {
                if fills {
                    self.visible.put_single(pixel, self.number);
                } else {
                    self.pixel(pixel, self.shader.pattern.full);
                }
            }
        }
        if fills {
            self.counts.covered_pixels += (columns * rows) as u64;
        }
        if self.whole {
            self.far.cover(self.triangle, self.rect, block);
        }
    }

    #[inline]
    fn pixel(&mut self, pixel: usize, mut mask: u64) {
        let shader = self.shader;
        let [x, y] = pixel_corner(self.rect, pixel);
        let front = |other: u32, both: u64| {
            in_front(shader.pattern, self.triangle, &shader.triangles[other as usize], x, y, both)
        };
        if !self.whole {
            if self.beyond {
                mask = shader.within_visibility(self.triangle, x, y, mask);
            }
            if let Some(cutoff) = self.cutoff {
                // Only where it would be seen is alpha worth a look.
                mask = self.visible.unhidden(pixel, mask, front);
                mask = shader.reaches_cutoff(self.faces, self.number, cutoff, x, y, mask);
            }
            if mask == 0 {
                return;
            }
        }
        self.counts.covered_pixels += 1;
        self.visible.put(pixel, self.number, mask, front);
    }
}
