//! The tint of levels of detail: what a pixel shows, each face in the colour of its level, mixed as light is.

use crate::geometry::transform::Item;
use crate::raster::coverage::BLOCK_PIXELS;
use crate::raster::opaque::pixel_corner;
use crate::resolve::tile::Resolved;
use crate::shade::tile::TileFaces;
use crate::translucency::models::Mix;
use proto::debug::{NO_LEVELS, Rgb, level_color};

/// The level of what has none.
pub const NO_LEVEL: u8 = u8::MAX;

/// How much of the tint's brightness is the picture's; the rest is always there, so that shadows have a colour too.
const FROM_PICTURE: f64 = 0.75;
/// Stripes of what is between levels: so wide, pixels along a row, one in so many.
const STRIPE: [u32; 2] = [2, 8];
/// How bright a stripe is to what lies between stripes.
const STRIPE_BRIGHTNESS: f64 = 0.3;

/// What a pixel is tinted with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tint {
    /// 0 to 255.
    color: [f64; 3],
    /// Whether something in it is between levels, or fades.
    is_between: bool,
}

fn of(item: &Item<'_>) -> [f64; 3] {
    match item.part.as_ref().filter(|_| item.in_transition) {
        // All versions of a model have one colour: that of its mixture.
        Some(part) if part.weights.len() > 1 => {
            let total: f64 = part.weights.iter().sum();
            let mut color = [0.0; 3];
            for (level, weight) in part.weights.iter().enumerate() {
                for (sum, c) in color.iter_mut().zip(level_color(level)) {
                    *sum += f64::from(c) * weight / total;
                }
            }
            color
        }
        _ if item.level == NO_LEVEL => NO_LEVELS.map(f64::from),
        _ => level_color(item.level.into()).map(f64::from),
    }
}

/// The tint of a pixel.
pub(super) fn tint(tile: Resolved<'_>, faces: &mut TileFaces, mix: &mut Mix, pixel: usize) -> Tint {
    let Resolved { frame, rect, numbers, visible, layers } = tile;
    let (block, bit) = (pixel / BLOCK_PIXELS, (pixel % BLOCK_PIXELS) as u32);
    let pattern = frame.pattern;
    let one = 1.0 / pattern.count as f64;
    mix.clear();
    let mut is_between = false;
    for layer in layers.block(block).iter().filter(|layer| layer.touched >> bit & 1 != 0) {
        let item = &frame.items[frame.triangle(layer.number).item as usize];
        let mask = layers.mask(layer, bit, pattern.full);
        let alpha = if item.is_translucent() {
            faces.colour(frame, rect, layer.place, layer.number, pixel_corner(rect, pixel))[3].clamp(0.0, 1.0)
        } else {
            1.0
        };
        let [r, g, b] = of(item);
        mix.add(
            item.part.as_ref(),
            item.is_translucent(),
            [r, g, b, f64::from(alpha) * f64::from(mask.count_ones()) * one],
        );
        is_between |= item.in_transition;
        if mix.transmitted() == 0.0 {
            break;
        }
    }
    let through = mix.through();
    // Whole numbers, so that the order in which faces were found has no say.
    let (mut sum, mut open) = ([0u32; 3], pattern.full);
    let mut add = |color: Rgb, mask: u64| {
        for (sum, c) in sum.iter_mut().zip(color) {
            *sum += u32::from(c) * mask.count_ones();
        }
    };
    for seen in visible.seen(pixel) {
        let item = &frame.items[frame.triangle(numbers[seen.triangle as usize]).item as usize];
        add(if item.level == NO_LEVEL { NO_LEVELS } else { level_color(item.level.into()) }, seen.mask);
        open &= !seen.mask;
    }
    add(NO_LEVELS, open);
    let color = std::array::from_fn(|c| through.rgb[c] + f64::from(sum[c]) * one * through.transmitted);
    Tint { color, is_between }
}

/// How bright a pixel is, 0 to 255.
pub(super) fn luma([r, g, b]: Rgb) -> u32 {
    (54 * u32::from(r) + 183 * u32::from(g) + 19 * u32::from(b)) >> 8
}

/// What a pixel of that brightness becomes; `diagonal` is the sum of its column and row.
pub(super) fn tinted(tint: Tint, luma: u32, diagonal: u32) -> Rgb {
    let [wide, every] = STRIPE;
    let is_stripe = tint.is_between && diagonal % every < wide;
    let stripe = if is_stripe { STRIPE_BRIGHTNESS } else { 1.0 };
    let brightness = (1.0 - FROM_PICTURE + FROM_PICTURE * f64::from(luma) / 255.0) * stripe;
    tint.color.map(|c| (c * brightness + 0.5) as u8)
}
