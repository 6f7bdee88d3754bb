//! The resolve stage of a tile: shade each face that a pixel sees once, average, encode.

use super::background::background;
use super::colour::encode_srgb;
use crate::raster::opaque::pixel_corner;
use crate::raster::visible::{Seen, Visible};
use crate::shade::{FaceCache, Shader};
use crate::translucency::compose::{Composed, Layers, Through};
use crate::translucency::gather::Fragments;
use proto::frame::{PixelRect, TILE};

/// Stands for the background among the faces of a pixel.
const BACKGROUND: u32 = u32::MAX;

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
    layers: Layers,
    samples: Box<[Through; 64]>,
}

impl Default for ResolveScratch {
    fn default() -> Self {
        let samples = Box::new([Through { rgb: [0.0; 3], transmitted: 1.0 }; 64]);
        Self { seen: Vec::new(), layers: Layers::default(), samples }
    }
}

/// Computes and writes the pixels of a tile.
pub fn resolve(
    shader: &Shader<'_>,
    rect: PixelRect,
    visible: &Visible,
    fragments: &Fragments,
    faces: &mut FaceCache,
    scratch: &mut ResolveScratch,
    mut out: TileOutput<'_>,
    counts: &mut ResolveCounts,
) {
    let (width, height) = (rect.width() as usize, rect.height() as usize);
    for row in 0..height {
        for column in 0..width {
            let pixel = row * TILE as usize + column;
            let colour = pixel_colour(shader, rect, pixel, visible, fragments, faces, scratch, counts);
            let at = (row * width + column) * 3;
            for (byte, c) in out.rgb[at..at + 3].iter_mut().zip(colour) {
                *byte = encode_srgb(c);
            }
            if let Some(linear) = &mut out.linear {
                for (float, c) in linear[at..at + 3].iter_mut().zip(colour) {
                    *float = c as f32;
                }
            }
        }
    }
}

/// The mean of one pixel's samples, linear.
#[inline]
fn pixel_colour(
    shader: &Shader<'_>,
    rect: PixelRect,
    pixel: usize,
    visible: &Visible,
    fragments: &Fragments,
    faces: &mut FaceCache,
    scratch: &mut ResolveScratch,
    counts: &mut ResolveCounts,
) -> [f64; 3] {
    let [x, y] = pixel_corner(rect, pixel);
    let is_clear = fragments.is_empty(pixel);
    let mut shade = |triangle: u32| -> [f32; 3] {
        if triangle == BACKGROUND {
            background(shader.camera, shader.environment, x, y)
        } else {
            let [r, g, b, _] = shader.pixel_colour(faces, triangle, x, y);
            [r, g, b]
        }
    };
    let single = if visible.is_empty(pixel) { Some(BACKGROUND) } else { visible.single(pixel) };
    if let Some(triangle) = single.filter(|_| is_clear) {
        counts.pixels_single += 1;
        return shade(triangle).map(f64::from);
    }

    // What is behind, by samples; its parts in the order of their first samples.
    let pattern = shader.pattern;
    scratch.seen.clear();
    if let Some(triangle) = single {
        scratch.seen.push(Seen { triangle, mask: pattern.full });
    } else {
        scratch.seen.extend(visible.seen(pixel));
        let covered = scratch.seen.iter().fold(0, |mask, seen| mask | seen.mask);
        if covered != pattern.full {
            scratch.seen.push(Seen { triangle: BACKGROUND, mask: pattern.full & !covered });
        }
        scratch.seen.sort_unstable_by_key(|seen| seen.mask.trailing_zeros());
    }
    let share = 1.0 / pattern.count as f64;
    let mut sum = [0.0f64; 3];
    if is_clear {
        counts.pixels_multi += 1;
        for seen in &scratch.seen {
            let colour = shade(seen.triangle);
            let samples = f64::from(seen.mask.count_ones());
            for c in 0..3 {
                sum[c] += f64::from(colour[c]) * samples;
            }
        }
        return sum.map(|c| c * share);
    }

    let mut behind = [[0.0f32; 3]; 64];
    for seen in &scratch.seen {
        let colour = shade(seen.triangle);
        let mut rest = seen.mask;
        while rest != 0 {
            behind[rest.trailing_zeros() as usize] = colour;
            rest &= rest - 1;
        }
    }
    let composed = scratch.layers.compose(shader, faces, [x, y], fragments.of_pixel(pixel), &mut scratch.samples);
    if let (Composed::Uniform(through), Some(_)) = (composed, single) {
        counts.pixels_single += 1;
        return through.over(behind[0]);
    }
    counts.pixels_multi += 1;
    for (behind, sample) in behind[..pattern.count].iter().zip(scratch.samples.iter()) {
        let through = match &composed {
            Composed::Uniform(through) => through,
            Composed::PerSample => sample,
        };
        let colour = through.over(*behind);
        for c in 0..3 {
            sum[c] += colour[c];
        }
    }
    sum.map(|c| c * share)
}
