//! From a tile's translucent triangles to *layers*: per block of 8 × 8 pixels, the faces that are seen through, each with the pixels
//! it fills and the samples it covers in the others.
//!
//! A model in transition gives all of its faces here, opaque and cut-out ones as well: its weights make them translucent.
//! The tile's opaque faces are final when this runs: what is behind them is dropped sample by sample, so that what is kept
//! is what contributes. There is no limit on the number of layers; a tile's layers share arrays that grow as
//! needed and are used again.
//!
//! What is kept, pixel by pixel and sample by sample, doesn't depend on the order of the list, nor on the shortcuts taken.

use crate::frame::Frame;
use crate::geometry::setup::{Flags, Plane, Triangle};
use crate::pipeline::Skips;
use crate::raster::coverage::{BLOCK_PIXELS, BLOCKS, SampleTables, TileCover};
use crate::raster::depth::{BlockDepth, in_front};
use crate::raster::opaque::{
    RasterCounts, block_corner, nearest_in_block, pixel_corner, pixels_of_view, unless_hidden,
};
use crate::raster::visible::Visible;
use crate::room::room;
use crate::shade::FaceCache;
use fearless_simd::Simd;
use proto::frame::PixelRect;

/// A translucent face in a block.
#[derive(Clone, Copy, Debug)]
pub struct Layer {
    /// The triangle's place in the tile's list.
    pub place: u32,
    /// Its number in the frame.
    pub number: u32,
    /// Pixels with a sample that it is seen at.
    pub touched: u64,
    /// Of these, those where it is seen at all samples.
    pub full: u64,
    /// Of these, those whose centre it covers.
    pub centre: u64,
    /// Where the samples of the others begin, in the order of their bits.
    first_mask: u32,
    /// Inverse distance at the block's middle, 1/m.
    pub q: f64,
    /// Where layers are equally near, the larger is in front.
    pub order: u64,
    /// Bounds of the inverse distance over the block.
    pub low: f32,
    /// See `low`.
    pub high: f32,
    /// Of the triangle.
    pub flags: Flags,
}

/// A translucent face in a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Fragment {
    /// The triangle's place in the tile's list.
    pub triangle: u32,
    /// The samples it is seen at: covered, and no opaque face in front.
    pub mask: u64,
}

/// The layers of a tile.
#[derive(Debug)]
pub struct TileLayers {
    blocks: [Vec<Layer>; BLOCKS],
    masks: Vec<u64>,
    count: usize,
}

impl Default for TileLayers {
    // Not derived, since arrays have a default up to a length of 32 only, and tiles of 64 pixels have 64 blocks.
    fn default() -> Self {
        Self { blocks: std::array::from_fn(|_| Vec::new()), masks: Vec::new(), count: 0 }
    }
}

room!(TileLayers: blocks, masks; count);

impl TileLayers {
    /// Forgets all.
    pub fn clear(&mut self) {
        if self.count > 0 {
            for block in &mut self.blocks {
                block.clear();
            }
            self.masks.clear();
            self.count = 0;
        }
    }

    /// Number of (face, pixel) pairs.
    pub fn fragments(&self) -> usize {
        self.count
    }

    /// The layers of a block, in the order of the list until [`TileLayers::sort`].
    #[inline(always)]
    pub fn block(&self, block: usize) -> &[Layer] {
        &self.blocks[block]
    }

    /// Orders a block's layers by their distance in the block's middle, nearest first; equally near: the larger order first.
    pub fn sort(&mut self, block: usize) {
        let layers = &mut self.blocks[block];
        layers.sort_unstable_by(|a, b| b.q.total_cmp(&a.q).then(b.order.cmp(&a.order)));
    }

    /// The samples at which a layer is seen in a pixel that it touches.
    #[inline(always)]
    pub fn mask(&self, layer: &Layer, bit: u32, full: u64) -> u64 {
        if layer.full >> bit & 1 != 0 {
            return full;
        }
        let before = layer.touched & !layer.full & ((1 << bit) - 1);
        self.masks[layer.first_mask as usize + before.count_ones() as usize]
    }

    /// A pixel's fragments in the order of the block's layers.
    pub fn of_pixel(&self, block: usize, bit: u32, full: u64) -> impl Iterator<Item = Fragment> + '_ {
        let touching = self.blocks[block].iter().filter(move |layer| layer.touched >> bit & 1 != 0);
        touching.map(move |layer| Fragment { triangle: layer.place, mask: self.mask(layer, bit, full) })
    }
}

/// Collects the layers of a tile's translucent triangles: those of `numbers` from `first` on. The opaque ones, before that,
/// are in `visible`.
#[inline(always)]
pub fn gather<S: Simd>(
    simd: S,
    frame: &Frame<'_>,
    rect: PixelRect,
    numbers: &[u32],
    first: usize,
    visible: &mut Visible,
    layers: &mut TileLayers,
    tables: &mut SampleTables,
    faces: &mut FaceCache,
    skips: Skips,
    counts: &mut RasterCounts,
) {
    counts.pairs += (numbers.len() - first) as u64;
    let valid = pixels_of_view(rect);
    let pattern = frame.pattern;
    for place in first..numbers.len() {
        let number = numbers[place];
        let triangle = frame.triangle(number);
        let found = unless_hidden(simd, skips, pattern, rect, triangle, visible, counts);
        let Some((extent, depth)) = found else { continue };
        let plane = triangle.plane();
        let cover = TileCover::new(pattern, triangle, rect);
        tables.clear();
        // Only a model in transition has cut-outs here.
        let has_holes = triangle.flags.0 & (Flags::BEYOND | Flags::CUT_OUT) != 0;
        let gains = depth.lattice(simd);
        for block in extent.blocks() {
            let [x, y] = block_corner(rect, block);
            let base = depth.at(block);
            if skips.occluded && nearest_in_block(&depth, base) < visible.far(simd, block) {
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
            let touched = touched & !depths.behind;
            if touched == 0 {
                continue;
            }
            let first_mask = layers.masks.len() as u32;
            let mut seen = if has_holes { 0 } else { touched & covered.full & depths.front };
            let mut full = seen;
            let mut centre = seen;
            let mut rest = touched & !seen;
            while rest != 0 {
                let bit = rest.trailing_zeros();
                rest &= rest - 1;
                let is_full = covered.full >> bit & 1 != 0;
                let mut mask = if is_full { pattern.full } else { cover.samples(simd, tables, block, bit) };
                let pixel = block * BLOCK_PIXELS + bit as usize;
                if depths.front >> bit & 1 == 0 || has_holes {
                    let looked_at = Looked { frame, numbers, number, triangle, visible };
                    mask = looked_at.seen(faces, pixel_corner(rect, pixel), pixel, mask);
                }
                if mask == 0 {
                    continue;
                }
                seen |= 1 << bit;
                centre |= u64::from(is_full || cover.covers_centre(block, bit)) << bit;
                if mask == pattern.full {
                    full |= 1 << bit;
                } else {
                    layers.masks.push(mask);
                }
            }
            if seen == 0 {
                continue;
            }
            layers.count += seen.count_ones() as usize;
            let [low, high] = extremes(&depth, base);
            layers.blocks[block].push(Layer {
                place: place as u32,
                number,
                touched: seen,
                full,
                centre,
                first_mask,
                q: middle(&plane, x, y),
                order: frame.order(number),
                low,
                high,
                flags: triangle.flags,
            });
        }
    }
}

/// q at the middle of the block whose upper left is (x, y) sub.
#[inline(always)]
fn middle(plane: &Plane, x: i32, y: i32) -> f64 {
    plane.at(x + 1024, y + 1024)
}

/// Bounds of a face's q over a block with these at its first pixel.
#[inline(always)]
fn extremes(depth: &BlockDepth, base: [f32; 2]) -> [f32; 2] {
    [base[0] + depth.least_gained(), base[1] + depth.most_gained()]
}

/// A triangle as it is looked at in a pixel that isn't plainly in front.
struct Looked<'a> {
    frame: &'a Frame<'a>,
    numbers: &'a [u32],
    number: u32,
    triangle: &'a Triangle,
    visible: &'a Visible,
}

impl Looked<'_> {
    /// Of the covered samples those at which it exists and isn't hidden.
    #[inline(never)]
    fn seen(&self, faces: &mut FaceCache, [x, y]: [i32; 2], pixel: usize, mut mask: u64) -> u64 {
        let Self { frame, numbers, number, triangle, visible } = *self;
        if triangle.flags.has(Flags::BEYOND) {
            mask = frame.within_visibility(triangle, x, y, mask);
        }
        mask = visible.unhidden(pixel, mask, |other, both| {
            let other = numbers[other as usize];
            let wins_ties = || frame.order(number) > frame.order(other);
            in_front(frame.pattern, triangle, frame.triangle(other), x, y, both, wins_ties)
        });
        match frame.items[triangle.item as usize].cutoff() {
            Some(cutoff) => frame.reaches_cutoff(faces, number, cutoff, x, y, mask),
            None => mask,
        }
    }
}
