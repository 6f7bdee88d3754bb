//! From a tile's translucent triangles to a list of fragments per pixel.
//!
//! A model in transition gives all of its faces here, opaque and cut-out ones as well: its weights make them translucent.
//! The tile's opaque faces are final when this runs: fragments behind them are dropped sample by sample, so that what is kept
//! is what contributes. There is no limit on the number of layers; a tile's fragments share one array that grows as
//! needed and is used again.

use crate::geometry::setup::{Flags, Triangle};
use crate::raster::coverage::{CoverageSink, TILE_PIXELS, cover};
use crate::raster::depth::in_front;
use crate::raster::opaque::{FarBounds, RasterCounts, pixel_corner};
use crate::raster::visible::Visible;
use crate::shade::{FaceCache, Shader};
use proto::frame::{PixelRect, TILE};

/// Ends a list.
const END: u32 = u32::MAX;

/// A translucent face in a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Fragment {
    /// Number of the triangle.
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
}

impl Fragments {
    /// None.
    pub fn new() -> Self {
        Self { heads: vec![END; TILE_PIXELS], fragments: Vec::new() }
    }

    /// Forgets all fragments.
    pub fn clear(&mut self) {
        if !self.fragments.is_empty() {
            self.heads.fill(END);
            self.fragments.clear();
        }
    }

    /// Number of fragments in the tile.
    pub fn count(&self) -> usize {
        self.fragments.len()
    }

    /// Whether a pixel has any.
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
        let next = std::mem::replace(&mut self.heads[pixel], self.fragments.len() as u32);
        self.fragments.push(Fragment { triangle, next, mask });
    }
}

impl Default for Fragments {
    fn default() -> Self {
        Self::new()
    }
}

/// Collects the fragments of the triangles `numbers` of a tile whose opaque faces are `visible`.
pub fn gather(
    shader: &Shader<'_>,
    rect: PixelRect,
    numbers: &[u32],
    visible: &Visible,
    far: &FarBounds,
    fragments: &mut Fragments,
    faces: &mut FaceCache,
    counts: &mut RasterCounts,
) {
    counts.pairs += numbers.len() as u64;
    for &number in numbers {
        let triangle = &shader.triangles[number as usize];
        if far.hides_in_tile(triangle, rect) {
            counts.occluded += 1;
            continue;
        }
        // Only a model in transition has cut-outs here.
        let cutoff = shader.items[triangle.item as usize].cutoff();
        let mut sink = GatherSink { shader, rect, number, triangle, cutoff, visible, far, fragments, faces, counts };
        cover(shader.pattern, triangle, rect, &mut sink);
    }
}

struct GatherSink<'a, 'b> {
    shader: &'a Shader<'a>,
    rect: PixelRect,
    number: u32,
    triangle: &'a Triangle,
    cutoff: Option<f32>,
    visible: &'b Visible,
    far: &'b FarBounds,
    fragments: &'b mut Fragments,
    faces: &'b mut FaceCache,
    counts: &'b mut RasterCounts,
}

impl CoverageSink for GatherSink<'_, '_> {
    fn skips(&mut self, block: usize) -> bool {
        let hidden = self.far.hides_in_block(self.triangle, self.rect, block);
        self.counts.occluded += u64::from(hidden);
        hidden
    }

    fn block(&mut self, _block: usize, pixel: usize, columns: usize, rows: usize) {
        for row in 0..rows {
            let first = pixel + row * TILE as usize;
            for pixel in first..first + columns {
                self.pixel(pixel, self.shader.pattern.full);
            }
        }
    }

    fn pixel(&mut self, pixel: usize, mut mask: u64) {
        let shader = self.shader;
        let [x, y] = pixel_corner(self.rect, pixel);
        if self.triangle.flags.has(Flags::BEYOND) {
            mask = shader.within_visibility(self.triangle, x, y, mask);
        }
        mask = self.visible.unhidden(pixel, mask, |other, both| {
            in_front(shader.pattern, self.triangle, &shader.triangles[other as usize], x, y, both)
        });
        if let Some(cutoff) = self.cutoff {
            mask = shader.reaches_cutoff(self.faces, self.number, cutoff, x, y, mask);
        }
        if mask != 0 {
            self.fragments.push(pixel, self.number, mask);
        }
    }
}
