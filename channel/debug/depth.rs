//! Which faces cover what, seen or not: once more over all of a tile's triangles, by the raster's own coverage.
//!
//! A face counts in a pixel if it covers one of its samples. Cut-outs count as if they had no holes. Faces that show a single-sided surface from behind don't
//! count: they aren't in the picture at all.

use super::DebugScratch;
use crate::geometry::setup::Flags;
use crate::raster::coverage::{BLOCK_PIXELS, BLOCKS, SampleTables, TileCover, TileExtent};
use crate::raster::opaque::pixels_of_view;
use crate::resolve::tile::Resolved;
use fearless_simd::Simd;

/// Calls `f` with the place of each triangle in the tile's list, each block that it may be in, and the pixels there of which it covers a sample.
#[inline(always)]
fn each_cover<S: Simd>(simd: S, tile: Resolved<'_>, tables: &mut SampleTables, mut f: impl FnMut(usize, usize, u64)) {
    let valid = pixels_of_view(tile.rect);
    let pattern = tile.frame.pattern;
    for (place, number) in tile.numbers.iter().enumerate() {
        let triangle = tile.frame.triangle(*number);
        if triangle.flags.has(Flags::BACK) {
            continue;
        }
        let Some(extent) = TileExtent::new(pattern, triangle, tile.rect) else { continue };
        let cover = TileCover::new(pattern, triangle, tile.rect);
        tables.clear();
        for block in extent.blocks() {
            let found = cover.block(simd, block, extent.rows(block));
            let mut covered = found.full & valid[block];
            let mut rest = found.touched & !found.full & valid[block];
            while rest != 0 {
                let bit = rest.trailing_zeros();
                rest &= rest - 1;
                covered |= u64::from(cover.samples(simd, tables, block, bit) != 0) << bit;
            }
            f(place, block, covered);
        }
    }
}

/// Counts the faces that cover each pixel.
#[inline(always)]
pub(super) fn count<S: Simd>(simd: S, tile: Resolved<'_>, scratch: &mut DebugScratch) {
    let DebugScratch { counts, tables, .. } = scratch;
    counts.fill(0);
    each_cover(
        simd,
        tile,
        tables,
        #[inline(always)]
        |_, block, covered| {
            let mut rest = covered;
            while rest != 0 {
                let count = &mut counts[block * BLOCK_PIXELS + rest.trailing_zeros() as usize];
                *count = count.saturating_add(1);
                rest &= rest - 1;
            }
        },
    );
}

/// Counts the faces of each block of which no pixel of it shows anything.
#[inline(always)]
pub(super) fn find_hidden<S: Simd>(simd: S, tile: Resolved<'_>, scratch: &mut DebugScratch) {
    let DebugScratch { seen, hidden, tables, .. } = scratch;
    seen.clear();
    seen.resize(tile.numbers.len(), 0);
    for block in 0..BLOCKS {
        let pixels = block * BLOCK_PIXELS..(block + 1) * BLOCK_PIXELS;
        for face in pixels.flat_map(|pixel| tile.visible.seen(pixel)) {
            // A pixel that sees nothing has no face.
            seen[face.triangle as usize] |= 1 << block;
        }
        for layer in tile.layers.block(block) {
            seen[layer.place as usize] |= 1 << block;
        }
    }
    *hidden = [0; BLOCKS];
    each_cover(
        simd,
        tile,
        tables,
        #[inline(always)]
        |place, block, covered| hidden[block] += u32::from(covered != 0 && seen[place] >> block & 1 == 0),
    );
}
