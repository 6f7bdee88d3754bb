//! From a tile's translucent triangles to a list of fragments per pixel.
//!
//! A model in transition gives all of its faces here, opaque and cut-out ones as well: its weights make them translucent.
//! The tile's opaque faces are final when this runs: fragments behind them are dropped sample by sample, so that what is kept
//! is what contributes. There is no limit on the number of layers; a tile's fragments share one array that grows as
//! needed and is used again.

use crate::frame::Frame;
use crate::geometry::setup::Flags;
use crate::pipeline::Skips;
use crate::raster::coverage::{BLOCK_PIXELS, BLOCKS, SampleTables, TILE_PIXELS, TileCover};
use crate::raster::depth::{BlockDepth, in_front};
use crate::raster::opaque::{RasterCounts, block_corner, hidden_in_tile, nearest_in_block, pixel_corner, pixels_of_view};
use crate::raster::visible::Visible;
use crate::shade::FaceCache;
use fearless_simd::Simd;
use proto::frame::PixelRect;

/// Ends a list.
const END: u32 = u32::MAX;

const _: () = assert!(BLOCKS <= 16, "a bit per block in a u16");

/// A translucent face in a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Fragment {
    /// The triangle's place in the tile's list.
    pub triangle: u32,
    next: u32,
    /// The samples it is seen at: covered, and no opaque face in front.
    pub mask: u64,
}

/// The fragments of a tile.
#[derive(Debug)]
pub struct Fragments {
    heads: Vec<u32>,
    fragments: Vec<Fragment>,
    /// A bit per block that has any.
    blocks: u16,
}

impl Fragments {
    /// None.
    pub fn new() -> Self {
        Self { heads: vec![END; TILE_PIXELS], fragments: Vec::new(), blocks: 0 }
    }

    /// Forgets all fragments.
    pub fn clear(&mut self) {
        if !self.fragments.is_empty() {
            self.heads.fill(END);
            self.fragments.clear();
            self.blocks = 0;
        }
    }

    /// Number of fragments in the tile.
    pub fn count(&self) -> usize {
        self.fragments.len()
    }

    /// Whether no pixel of a block has any.
    #[inline(always)]
    pub fn is_block_empty(&self, block: usize) -> bool {
        self.blocks >> block & 1 == 0
    }

    /// Whether a pixel has none.
    #[inline]
    pub fn is_empty(&self, pixel: usize) -> bool {
        self.heads[pixel] == END
    }

    /// A pixel's fragments in no meaningful order.
    pub fn of_pixel(&self, pixel: usize) -> impl Iterator<Item = Fragment> + '_ {
        let mut at = self.heads[pixel];
        std::iter::from_fn(move || {
            let fragment = *self.fragments.get(at as usize)?;
            at = fragment.next;
            Some(fragment)
        })
    }

    fn push(&mut self, pixel: usize, triangle: u32, mask: u64) {
        assert!(self.fragments.len() < END as usize, "a tile's fragments are numbered in 32 bits");
        self.blocks |= 1 << (pixel / BLOCK_PIXELS);
        let next = std::mem::replace(&mut self.heads[pixel], self.fragments.len() as u32);
        self.fragments.push(Fragment { triangle, next, mask });
    }
}

impl Default for Fragments {
    fn default() -> Self {
        Self::new()
    }
}

/// Collects the fragments of a tile's translucent triangles: those of `numbers` from `first` on. The opaque ones, before that,
/// are in `visible`.
#[inline(always)]
pub fn gather<S: Simd>(
    simd: S,
    frame: &Frame<'_>,
    rect: PixelRect,
    numbers: &[u32],
    first: usize,
    visible: &mut Visible,
    fragments: &mut Fragments,
    tables: &mut SampleTables,
    faces: &mut FaceCache,
    skips: Skips,
    counts: &mut RasterCounts,
) {
    counts.pairs += (numbers.len() - first) as u64;
    let valid = pixels_of_view(rect);
    let pattern = frame.pattern;
    for (place, &number) in numbers.iter().enumerate().skip(first) {
        let triangle = frame.triangle(number);
        if skips.occluded && hidden_in_tile(simd, frame, triangle, rect, visible) {
            counts.occluded += 1;
            continue;
        }
        let Some(cover) = TileCover::new(pattern, triangle, rect) else { continue };
        tables.clear();
        // Only a model in transition has cut-outs here.
        let cutoff = frame.items[triangle.item as usize].cutoff();
        let depth = BlockDepth::new(pattern, triangle.plane());
        let gains = depth.lattice(simd);
        for block in cover.blocks() {
            let [x, y] = block_corner(rect, block);
            let base = depth.at(x, y);
            if skips.occluded && nearest_in_block(&depth, base) < visible.far(simd, block) {
                counts.occluded += 1;
                continue;
            }
            let covered = cover.block(simd, block);
            let touched = covered.touched & valid[block];
            if touched == 0 {
                continue;
            }
            let depths = visible.compare(simd, block, base, &gains);
            let mut rest = touched & !depths.behind;
            while rest != 0 {
                let bit = rest.trailing_zeros();
                rest &= rest - 1;
                let is_full = covered.full >> bit & 1 != 0;
                let mut mask = if is_full { pattern.full } else { cover.samples(simd, tables, block, bit) };
                let pixel = block * BLOCK_PIXELS + bit as usize;
                let [px, py] = pixel_corner(rect, pixel);
                if triangle.flags.has(Flags::BEYOND) {
                    mask = frame.within_visibility(triangle, px, py, mask);
                }
                if depths.front >> bit & 1 == 0 {
                    mask = visible.unhidden(pixel, mask, |other, both| {
                        let other = numbers[other as usize];
                        let wins_ties = || frame.order(number) > frame.order(other);
                        in_front(pattern, triangle, frame.triangle(other), px, py, both, wins_ties)
                    });
                }
                if let Some(cutoff) = cutoff {
                    mask = frame.reaches_cutoff(faces, number, cutoff, px, py, mask);
                }
                if mask != 0 {
                    fragments.push(pixel, place as u32, mask);
                }
            }
        }
    }
}
