//! The resolve stage of a tile: shade each face that a pixel sees once, average, encode.
//!
//! It goes block by block. A block that one face of one colour fills is written as such; pixels that one face fills take its
//! colour, those shaded by their normals 16 at a time; only pixels with several faces or with fragments average over samples.

use crate::frame::Frame;
use crate::raster::coverage::{BLOCK, BLOCK_PIXELS, BLOCKS, BLOCKS_PER_ROW};
use crate::raster::opaque::{block_corner, pixel_corner};
use crate::raster::visible::{CENTRE, NOTHING, Seen, Visible};
use crate::room::room;
use crate::samples::SUBPIXELS;
use crate::shade::tile::{Batch, Look, NO_CODE, TileFaces};
use crate::simd::{each3, each4};
use crate::translucency::blend::{Blender, BlockLight};
use crate::translucency::gather::TileLayers;
use fearless_simd::{Simd, f32x4, prelude::*, u32x16};
use proto::frame::{Background, PixelRect};

/// Where a tile's pixels go: tightly packed rows of the tile's rectangle, three channels each.
#[derive(Debug)]
pub struct TileOutput<'a> {
    /// sRGB-encoded.
    pub rgb: &'a mut [u8],
    /// Linear and unclamped.
    pub linear: Option<&'a mut [f32]>,
}

/// How a tile's pixels were found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ResolveCounts {
    /// One colour for all samples.
    pub pixels_single: u64,
    /// Several colours to average.
    pub pixels_multi: u64,
}

/// Buffers of the stage, used again.
#[derive(Debug)]
pub struct ResolveScratch {
    seen: Vec<Seen>,
    blender: Blender,
    light: BlockLight,
    batch: Batch,
    block: BlockColours,
}

room!(ResolveScratch: seen, blender; light, batch, block);

/// A block's finished pixels.
#[derive(Debug)]
struct BlockColours {
    /// `0x00BBGGRR`.
    codes: [u32; BLOCK_PIXELS],
    /// Linear RGB; only kept up where it is asked for.
    linear: [[f32; 3]; BLOCK_PIXELS],
    /// Sums over the parts of pixels that see several faces, linear RGB and nothing.
    sums: [[f32; 4]; BLOCK_PIXELS],
}

impl Default for ResolveScratch {
    fn default() -> Self {
        let block =
            BlockColours { codes: [0; BLOCK_PIXELS], linear: [[0.0; 3]; BLOCK_PIXELS], sums: [[0.0; 4]; BLOCK_PIXELS] };
        Self {
            seen: Vec::new(),
            blender: Blender::default(),
            light: BlockLight::default(),
            batch: Batch::default(),
            block,
        }
    }
}

/// What the stage reads.
#[derive(Clone, Copy, Debug)]
pub struct Resolved<'a> {
    /// The frame's numbers.
    pub frame: &'a Frame<'a>,
    /// The tile's pixels in the view.
    pub rect: PixelRect,
    /// The tile's triangles.
    pub numbers: &'a [u32],
    /// What is seen of the opaque ones.
    pub visible: &'a Visible,
    /// What lies in front of that.
    pub layers: &'a TileLayers,
}

/// Computes and writes the pixels of a tile.
#[inline(always)]
pub fn resolve<S: Simd>(
    simd: S,
    tile: Resolved<'_>,
    faces: &mut TileFaces,
    scratch: &mut ResolveScratch,
    mut out: TileOutput<'_>,
    counts: &mut ResolveCounts,
) {
    let constant_background = match tile.frame.environment.background {
        Background::Constant(colour) => Some((colour, tile.frame.encoder.rgb(colour))),
        Background::Sky => None,
    };
    let (width, height) = (tile.rect.width(), tile.rect.height());
    for block in 0..BLOCKS {
        let (left, top) = (block as u32 % BLOCKS_PER_ROW * BLOCK, block as u32 / BLOCKS_PER_ROW * BLOCK);
        if left >= width || top >= height {
            continue;
        }
        let pixels = u64::from((width - left).min(BLOCK) * (height - top).min(BLOCK));
        let cells = tile.visible.block(block);
        let is_clear = tile.layers.block(block).is_empty();
        let first = u32x16::splat(simd, cells[0]);
        let equal = each4([0, 16, 32, 48], |at| u32x16::from_slice(simd, &cells[at..at + 16]).simd_eq(first));
        let is_uniform = (equal[0] & equal[1] & equal[2] & equal[3]).all_true();
        if is_clear && is_uniform {
            let constant = if cells[0] == NOTHING {
                constant_background
            } else if let Some(place) = Visible::single(cells[0]) {
                match faces.look(tile.frame, tile.rect, place, tile.numbers[place as usize]) {
                    Look::Constant([r, g, b, _], code) => Some(([r, g, b], code)),
                    Look::ByNormal(index) => {
                        by_normal(simd, tile.frame, faces, index, block, out.linear.is_some(), &mut scratch.block);
                        counts.pixels_single += pixels;
                        scratch.block.write(tile.rect, [left, top], &mut out);
                        continue;
                    }
                    Look::General => None,
                }
            } else {
                None
            };
            if let Some((colour, code)) = constant {
                counts.pixels_single += pixels;
                write_constant(colour, code, tile.rect, [left, top], &mut out);
                continue;
            }
        }
        if is_clear {
            resolve_block(simd, tile, block, constant_background, 0, faces, scratch, out.linear.is_some(), counts);
        } else {
            scratch.blender.blend(simd, tile, block, faces, &mut scratch.light);
            let done = scratch.light.finished;
            resolve_block(simd, tile, block, constant_background, done, faces, scratch, true, counts);
            counts.pixels_multi += u64::from(done.count_ones());
            scratch.block.put_before(tile.frame, &scratch.light);
        }
        scratch.block.write(tile.rect, [left, top], &mut out);
    }
}

/// A block that one face fills which is shaded by its normals.
#[inline(always)]
fn by_normal<S: Simd>(
    simd: S,
    frame: &Frame<'_>,
    faces: &TileFaces,
    index: u32,
    block: usize,
    with_linear: bool,
    out: &mut BlockColours,
) {
    let colours = faces.by_normal(index).block(simd, frame, block, u64::MAX);
    for group in 0..4 {
        let [r, g, b]: [[f32; 16]; 3] = each3([0, 1, 2], |c| colours[c][group].into());
        for i in 0..16 {
            out.codes[group * 16 + i] = frame.encoder.rgb([r[i], g[i], b[i]]);
            if with_linear {
                out.linear[group * 16 + i] = [r[i], g[i], b[i]];
            }
        }
    }
}

/// The pixels of a block of which the view has so many columns and rows.
#[inline(always)]
fn in_view(columns: u32, rows: u32) -> u64 {
    let row = 0xffu64 >> BLOCK.saturating_sub(columns);
    let rows_after = BLOCK.saturating_sub(rows) * BLOCK;
    (row * 0x0101_0101_0101_0101) & (u64::MAX >> rows_after)
}

/// A block pixel by pixel, but for the pixels `done`.
#[inline(always)]
fn resolve_block<S: Simd>(
    simd: S,
    tile: Resolved<'_>,
    block: usize,
    constant_background: Option<([f32; 3], u32)>,
    done: u64,
    faces: &mut TileFaces,
    scratch: &mut ResolveScratch,
    with_linear: bool,
    counts: &mut ResolveCounts,
) {
    let Resolved { frame, rect, numbers, visible, .. } = tile;
    let cells = visible.block(block);
    let (left, top) = (block as u32 % BLOCKS_PER_ROW * BLOCK, block as u32 / BLOCKS_PER_ROW * BLOCK);
    let (columns, rows) = (rect.width() - left, rect.height() - top);
    let [x0, y0] = block_corner(rect, block);
    scratch.batch.count = 0;
    let mut rest = in_view(columns, rows) & !done;
    let mut multi: u64 = 0;
    counts.pixels_single += u64::from(rest.count_ones());
    // Faces of one colour that were met before, and the background, are a look into a table.
    if !with_linear {
        let background = constant_background.map_or(NO_CODE, |(_, code)| code);
        let known = faces.codes();
        for (bit, (cell, code)) in cells.iter().zip(&mut scratch.block.codes).enumerate() {
            let found =
                if *cell == NOTHING { background } else { known.get(*cell as usize).copied().unwrap_or(NO_CODE) };
            let is_found = found != NO_CODE;
            *code = if is_found { found } else { *code };
            rest &= !(u64::from(is_found) << bit);
        }
    }
    while rest != 0 {
        let bit = rest.trailing_zeros() as usize;
        rest &= rest - 1;
        let (column, row) = (bit as u32 % BLOCK, bit as u32 / BLOCK);
        let cell = cells[bit];
        let corner = [x0 + column as i32 * SUBPIXELS, y0 + row as i32 * SUBPIXELS];
        let colour = if cell == NOTHING {
            if let Some((colour, code)) = constant_background {
                scratch.block.codes[bit] = code;
                scratch.block.linear[bit] = colour;
                continue;
            }
            faces.behind(frame, corner).mean(frame.camera, frame.pattern, frame.pattern.full)
        } else if let Some(place) = Visible::single(cell) {
            match faces.look(frame, rect, place, numbers[place as usize]) {
                Look::Constant([r, g, b, _], code) => {
                    scratch.block.codes[bit] = code;
                    scratch.block.linear[bit] = [r, g, b];
                    continue;
                }
                Look::ByNormal(index) => {
                    // A face that all samples see covers the centre.
                    let at = [(left + column) as f32 + 0.5, (top + row) as f32 + 0.5];
                    if scratch.batch.push(index, at, bit as u8, 1.0) {
                        flush(simd, frame, faces, scratch, with_linear);
                    }
                    continue;
                }
                Look::General => {
                    let [r, g, b, _] =
                        frame.pixel_colour(faces.general(), numbers[place as usize], corner[0], corner[1]);
                    [r, g, b]
                }
            }
        } else {
            multi |= 1 << bit;
            let at = [(left + column) as f32, (top + row) as f32];
            several(simd, tile, block, bit, at, faces, scratch, with_linear);
            continue;
        };
        scratch.block.codes[bit] = frame.encoder.rgb(colour);
        scratch.block.linear[bit] = colour;
    }
    flush(simd, frame, faces, scratch, with_linear);
    let several = u64::from(multi.count_ones());
    counts.pixels_single -= several;
    counts.pixels_multi += several;
    while multi != 0 {
        let bit = multi.trailing_zeros() as usize;
        multi &= multi - 1;
        let sum = scratch.block.sums[bit];
        scratch.block.codes[bit] = frame.encoder.rgb_of(simd, sum);
        if with_linear {
            let [r, g, b, _] = sum;
            // A sum of shares of numbers at the end of the range may round beyond it.
            scratch.block.linear[bit] = each3([r, g, b], |c| c.clamp(f32::MIN, f32::MAX));
        }
    }
}

/// Finishes the pixels of the batch.
#[inline(always)]
fn flush<S: Simd>(simd: S, frame: &Frame<'_>, faces: &TileFaces, scratch: &mut ResolveScratch, with_linear: bool) {
    let count = scratch.batch.count;
    if count == 0 {
        return;
    }
    let colours = scratch.batch.colours(simd, frame, faces);
    let ResolveScratch { batch, block, .. } = scratch;
    for i in 0..count {
        let (bit, share) = (usize::from(batch.pixels[i]), batch.shares[i]);
        if share < 1.0 {
            add_share(simd, &mut block.sums[bit], colours[i], share);
            continue;
        }
        block.codes[bit] = frame.encoder.rgb_of(simd, colours[i]);
        if with_linear {
            let [r, g, b, _] = colours[i];
            block.linear[bit] = [r, g, b];
        }
    }
    batch.count = 0;
}

#[inline(always)]
fn add_share<S: Simd>(simd: S, sum: &mut [f32; 4], colour: [f32; 4], share: f32) {
    let more = f32x4::simd_from(simd, colour) * share;
    (f32x4::simd_from(simd, *sum) + more).store_slice(sum);
}

/// Sums up a pixel that sees several faces, `at` pixels from the tile's upper left; what the batch holds of it comes later. The
/// order of the sum is that of the faces' first samples, in which they are batched as well, so that the order in which
/// faces were found has no say.
#[inline(always)]
fn several<S: Simd>(
    simd: S,
    tile: Resolved<'_>,
    block: usize,
    bit: usize,
    at: [f32; 2],
    faces: &mut TileFaces,
    scratch: &mut ResolveScratch,
    with_linear: bool,
) {
    let Resolved { frame, rect, numbers, visible, .. } = tile;
    let pattern = frame.pattern;
    let pixel = block * BLOCK_PIXELS + bit;
    scratch.seen.clear();
    scratch.seen.extend(visible.seen(pixel));
    scratch.seen.sort_unstable_by_key(|seen| seen.mask.trailing_zeros());
    scratch.block.sums[bit] = [0.0; 4];
    let one = 1.0 / pattern.count as f32;
    let mut open = pattern.full;
    for k in 0..scratch.seen.len() {
        let seen = scratch.seen[k];
        open &= !seen.mask;
        let share = seen.mask.count_ones() as f32 * one;
        let number = numbers[seen.triangle as usize];
        let colour = match faces.look(frame, rect, seen.triangle, number) {
            Look::Constant(colour, _) => colour,
            Look::ByNormal(index) => {
                let [x, y] = match seen.point {
                    CENTRE => [0.5, 0.5],
                    sample => {
                        let [x, y] = pattern.points[usize::from(sample)];
                        [x as f32 * (1.0 / SUBPIXELS as f32), y as f32 * (1.0 / SUBPIXELS as f32)]
                    }
                };
                if scratch.batch.push(index, [at[0] + x, at[1] + y], bit as u8, share) {
                    flush(simd, frame, faces, scratch, with_linear);
                }
                continue;
            }
            Look::General => {
                let [x, y] = pixel_corner(rect, pixel);
                frame.pixel_colour(faces.general(), number, x, y)
            }
        };
        add_share(simd, &mut scratch.block.sums[bit], colour, share);
    }
    if open != 0 {
        let behind = faces.behind(frame, pixel_corner(rect, pixel));
        let [r, g, b] = behind.mean(frame.camera, pattern, open);
        add_share(simd, &mut scratch.block.sums[bit], [r, g, b, 0.0], open.count_ones() as f32 * one);
    }
}

/// A row of eight pixels as bytes.
#[inline(always)]
fn row_bytes(codes: &[u32; 8]) -> [u8; 24] {
    let c = |i: usize| u64::from(codes[i]);
    let words = [
        c(0) | c(1) << 24 | c(2) << 48,
        c(2) >> 16 | c(3) << 8 | c(4) << 32 | c(5) << 56,
        c(5) >> 8 | c(6) << 16 | c(7) << 40,
    ];
    let mut bytes = [0; 24];
    for (to, word) in bytes.chunks_exact_mut(8).zip(words) {
        to.copy_from_slice(&word.to_le_bytes());
    }
    bytes
}

impl BlockColours {
    /// Puts the light of layers before what is here.
    #[inline(always)]
    fn put_before(&mut self, frame: &Frame<'_>, light: &BlockLight) {
        for bit in 0..BLOCK_PIXELS {
            let mut colour = each3([0, 1, 2], |c| light.rgb[c][bit]);
            if light.finished >> bit & 1 == 0 {
                for c in 0..3 {
                    colour[c] += self.linear[bit][c] * light.transmitted[bit];
                }
            }
            self.codes[bit] = frame.encoder.rgb(colour);
            // Numbers at the end of the range may add up to more.
            self.linear[bit] = each3(colour, |c| c.clamp(f32::MIN, f32::MAX));
        }
    }

    /// Writes the block whose upper left is (left, top) of the tile.
    #[inline(always)]
    fn write(&self, rect: PixelRect, [left, top]: [u32; 2], out: &mut TileOutput<'_>) {
        let (columns, rows) = ((rect.width() - left).min(BLOCK) as usize, (rect.height() - top).min(BLOCK) as usize);
        for row in 0..rows {
            let codes: &[u32; 8] = self.codes[row * 8..][..8].try_into().expect("eight pixels");
            let at = (((top as usize + row) * rect.width() as usize) + left as usize) * 3;
            out.rgb[at..at + columns * 3].copy_from_slice(&row_bytes(codes)[..columns * 3]);
            if let Some(linear) = &mut out.linear {
                linear[at..at + columns * 3].copy_from_slice(self.linear[row * 8..][..columns].as_flattened());
            }
        }
    }
}

/// Writes a block of one colour.
#[inline(always)]
fn write_constant(colour: [f32; 3], code: u32, rect: PixelRect, [left, top]: [u32; 2], out: &mut TileOutput<'_>) {
    let (columns, rows) = ((rect.width() - left).min(BLOCK) as usize, (rect.height() - top).min(BLOCK) as usize);
    let bytes = row_bytes(&[code; 8]);
    for row in 0..rows {
        let at = (((top as usize + row) * rect.width() as usize) + left as usize) * 3;
        if columns == 8 {
            out.rgb[at..at + 24].copy_from_slice(&bytes);
        } else {
            out.rgb[at..at + columns * 3].copy_from_slice(&bytes[..columns * 3]);
        }
        if let Some(linear) = &mut out.linear {
            linear[at..at + columns * 3].copy_from_slice([colour; 8][..columns].as_flattened());
        }
    }
}
