//! Debug pictures: a tile's pixels replaced by what drawing them takes ([`proto::debug`]).
//!
//! The tile is drawn as always; then, from what the stages leave behind, its pixels are painted over. So the stages know nothing of it,
//! and where no debug picture is wanted it costs a comparison a tile. What is painted is a property of the picture: of which faces there are and of
//! what is seen, not of the order in which they came or of who has left out what. So it is the same for any share, list, thread and
//! instruction set, as the picture is. Faces that are left out before they reach a tile wouldn't be counted, so [`crate::pipeline`] leaves none out for
//! the two pictures that count.
//!
//! - `depth`: how many faces cover each pixel.
//! - `levels`: the picture in grey, tinted by levels of detail.
//! - `skips`: by which shortcut each block and pixel was drawn, and how many faces are hidden there.

mod depth;
mod levels;
mod skips;
#[cfg(test)]
mod tests;

pub use levels::NO_LEVEL;

use crate::raster::coverage::{BLOCK_PIXELS, BLOCKS, SampleTables, TILE_PIXELS};
use crate::raster::opaque::{pixel_corner, pixels_of_view};
use crate::resolve::colour::decode_srgb;
use crate::resolve::tile::{Resolved, TileOutput};
use crate::room::room;
use crate::samples::SUBPIXELS;
use crate::shade::tile::TileFaces;
use crate::translucency::models::Mix;
use fearless_simd::Simd;
use proto::debug::{DebugPicture, Rgb, depth_color};

/// Buffers of one thread, used again.
#[derive(Debug)]
pub struct DebugScratch {
    /// By pixel: faces that cover it.
    counts: Box<[u16; TILE_PIXELS]>,
    /// By place in the tile's list: the blocks in which the face is seen, a bit each.
    seen: Vec<u64>,
    /// By block: faces that cover some pixel of it and are seen in none.
    hidden: [u32; BLOCKS],
    tables: SampleTables,
    mix: Mix,
}

room!(DebugScratch: seen, mix; counts, hidden, tables);

impl Default for DebugScratch {
    fn default() -> Self {
        Self {
            counts: Box::new([0; TILE_PIXELS]),
            seen: Vec::new(),
            hidden: [0; BLOCKS],
            tables: SampleTables::default(),
            mix: Mix::default(),
        }
    }
}

/// Whether that picture counts faces, also those that nobody sees.
pub fn counts_hidden(picture: DebugPicture) -> bool {
    matches!(picture, DebugPicture::Depth | DebugPicture::Skips)
}

/// Paints a tile over, which has been drawn.
// Apart from the tile's kernel, and compiled for the same instructions.
#[inline(never)]
pub fn paint<S: Simd>(
    simd: S,
    picture: DebugPicture,
    tile: Resolved<'_>,
    faces: &mut TileFaces,
    scratch: &mut DebugScratch,
    out: &mut TileOutput<'_>,
) {
    match picture {
        DebugPicture::Off => {}
        DebugPicture::Depth => {
            simd.vectorize(
                #[inline(always)]
                || depth::count(simd, tile, scratch),
            );
            each_pixel(tile, |pixel, to| to.put(out, depth_color(u32::from(scratch.counts[pixel]))));
        }
        DebugPicture::Levels => {
            let grey = |to: &Place, out: &TileOutput<'_>| levels::luma(to.rgb(out));
            each_pixel(tile, |pixel, to| {
                let tint = levels::tint(tile, faces, &mut scratch.mix, pixel);
                let color = levels::tinted(tint, grey(&to, out), to.x + to.y);
                to.put(out, color);
            });
        }
        DebugPicture::Skips => {
            simd.vectorize(
                #[inline(always)]
                || depth::find_hidden(simd, tile, scratch),
            );
            skips::paint(tile, faces, &scratch.hidden, out);
        }
    }
}

/// A pixel of a tile.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// Its column and row in the view.
    x: u32,
    y: u32,
    /// Its first channel in the tile's output.
    at: usize,
}

impl Place {
    fn rgb(&self, out: &TileOutput<'_>) -> Rgb {
        [out.rgb[self.at], out.rgb[self.at + 1], out.rgb[self.at + 2]]
    }

    fn put(&self, out: &mut TileOutput<'_>, color: Rgb) {
        out.rgb[self.at..self.at + 3].copy_from_slice(&color);
        if let Some(linear) = &mut out.linear {
            linear[self.at..self.at + 3].copy_from_slice(&decode_srgb(color));
        }
    }
}

/// The pixels that the view has of a tile, by their numbers in arrays over the tile's pixels.
#[inline(always)]
fn each_pixel(tile: Resolved<'_>, mut f: impl FnMut(usize, Place)) {
    let rect = tile.rect;
    for (block, mask) in pixels_of_view(rect).into_iter().enumerate() {
        let mut rest = mask;
        while rest != 0 {
            let pixel = block * BLOCK_PIXELS + rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let [x, y] = pixel_corner(rect, pixel).map(|c| (c / SUBPIXELS) as u32);
            let at = ((y - rect.y0) as usize * rect.width() as usize + (x - rect.x0) as usize) * 3;
            f(pixel, Place { x, y, at });
        }
    }
}
