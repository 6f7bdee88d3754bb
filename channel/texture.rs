//! Textures: what a pixel sees of a picture on a surface.
//!
//! The truth is the base level averaged over the pixel. Where a texel is larger than a pixel that is the base level
//! itself, interpolated (or the nearest texel where the file asks for it); where it is smaller, a chain of halved copies
//! (mip-maps) stands for the average, read trilinearly: bilinearly in the two copies whose texels are next in size, mixed
//! by the logarithm of the footprint.
//!
//! Everything is filtered in linear light: the base level is kept as the file's bytes and decoded texel by texel through a
//! table; the copies are kept as linear 16-bit numbers, 1/20 of an 8-bit sRGB step at worst. A copy's texel is the exact
//! area mean of what it covers, also where a side is odd: then up to three texels count per axis, with the weights of
//! their overlap. Alpha is averaged as a channel of its own, as glTF's straight alpha has it.

use crate::resolve::colour::decode_srgb;
use proto::limits::TEXTURE_SIZE_MAX;
use proto::scene::{Filter, Texture, TextureUse, Wrap};
use thiserror::Error;

/// Why a texture from outside is refused. Nothing was stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum TextureError {
    /// A side is zero or larger than [`TEXTURE_SIZE_MAX`].
    #[error("texture is {width} × {height} texels, allowed are 1 to {TEXTURE_SIZE_MAX} a side")]
    Size {
        /// Width, texels.
        width: u32,
        /// Height, texels.
        height: u32,
    },
    /// The number of texels isn't width × height.
    #[error("texture of {width} × {height} has {texels} texels")]
    Length {
        /// Width, texels.
        width: u32,
        /// Height, texels.
        height: u32,
        /// Texels that came.
        texels: usize,
    },
}

/// A texture with its halved copies.
#[derive(Clone, Debug)]
pub struct MipTexture {
    base: Level<u8>,
    /// Level 1 and on, each half as wide and high as the one before, down to 1 × 1.
    halved: Vec<Level<u16>>,
}

/// One level: row-major, tightly packed RGBA. `u8`: sRGB colour, linear alpha; `u16`: all linear, 65 535 is 1.
#[derive(Clone, Debug)]
struct Level<T> {
    width: u32,
    height: u32,
    texels: Vec<[T; 4]>,
}

/// Linear RGBA of one texel.
trait Texels {
    fn size(&self) -> (u32, u32);
    fn texel(&self, x: u32, y: u32) -> [f32; 4];
}

impl Texels for Level<u8> {
    fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    #[inline]
    fn texel(&self, x: u32, y: u32) -> [f32; 4] {
        let t = self.texels[y as usize * self.width as usize + x as usize];
        let [r, g, b] = decode_srgb([t[0], t[1], t[2]]);
        [r, g, b, f32::from(t[3]) * (1.0 / 255.0)]
    }
}

impl Texels for Level<u16> {
    fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    #[inline]
    fn texel(&self, x: u32, y: u32) -> [f32; 4] {
        let [r, g, b, a] = self.texels[y as usize * self.width as usize + x as usize];
        let scale = 1.0 / 65_535.0;
        [f32::from(r) * scale, f32::from(g) * scale, f32::from(b) * scale, f32::from(a) * scale]
    }
}

impl MipTexture {
    /// Checks a texture that came from outside and makes its halved copies.
    ///
    /// # Errors
    /// [`TextureError`] when size and number of texels don't agree with each other or the limits.
    pub fn new(texture: Texture) -> Result<Self, TextureError> {
        let Texture { width, height, texels } = texture;
        let sides = 1..=TEXTURE_SIZE_MAX;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(TextureError::Size { width, height });
        }
        if texels.len() != width as usize * height as usize {
            return Err(TextureError::Length { width, height, texels: texels.len() });
        }
        let base = Level { width, height, texels };
        let mut halved = Vec::new();
        // Each copy is made from the floats of the one before, so that rounding doesn't add up from level to level.
        let mut size = (width, height);
        let mut source: Vec<[f32; 4]> = Vec::new();
        while size != (1, 1) {
            let next = ((size.0 / 2).max(1), (size.1 / 2).max(1));
            let floats = if halved.is_empty() {
                halve(size, next, |x, y| base.texel(x, y))
            } else {
                halve(size, next, |x, y| source[y as usize * size.0 as usize + x as usize])
            };
            let quantise = |c: f32| (c.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16;
            halved.push(Level {
                width: next.0,
                height: next.1,
                texels: floats.iter().map(|t| t.map(quantise)).collect(),
            });
            (source, size) = (floats, next);
        }
        Ok(Self { base, halved })
    }

    /// Width and height of the base level, texels.
    pub fn size(&self) -> (u32, u32) {
        self.base.size()
    }

    /// Linear RGBA at (u, v). `detail` is the level whose texels are as large as the pixel's footprint, log2 of the
    /// footprint in base texels; at 0 and below the texture is magnified.
    #[inline]
    pub fn sample(&self, usage: &TextureUse, u: f64, v: f64, detail: f32) -> [f32; 4] {
        // NaN compares false: it lands in the base level, and no coordinate is used unchecked below.
        let magnified = detail.is_nan() || detail <= 0.0;
        if magnified {
            return match usage.magnify {
                Filter::Linear => bilinear(&self.base, usage, u, v),
                Filter::Nearest => nearest(&self.base, usage, u, v),
            };
        }
        let last = self.halved.len();
        let detail = detail.min(last as f32);
        let lower = detail as usize;
        let part = detail - lower as f32;
        let fine = self.level(lower, usage, u, v);
        if part == 0.0 {
            return fine;
        }
        let coarse = self.level(lower + 1, usage, u, v);
        std::array::from_fn(|c| fine[c] + (coarse[c] - fine[c]) * part)
    }

    fn level(&self, level: usize, usage: &TextureUse, u: f64, v: f64) -> [f32; 4] {
        match level.checked_sub(1) {
            None => bilinear(&self.base, usage, u, v),
            Some(k) => bilinear(&self.halved[k], usage, u, v),
        }
    }
}

/// Log2 of the pixel's footprint in texels, from the derivatives of (u, v) along one pixel in x and in y: the longer of
/// the two, so that nothing flickers; the blur across a slanted footprint is the price until filtering is anisotropic.
#[inline]
pub fn detail(size: (u32, u32), du: [f64; 2], dv: [f64; 2]) -> f32 {
    let (w, h) = (f64::from(size.0), f64::from(size.1));
    let along = |k: usize| {
        let (x, y) = (du[k] * w, dv[k] * h);
        x * x + y * y
    };
    // Not f64::max: a NaN must not win or lose by the platform's rule.
    let (a, b) = (along(0), along(1));
    let longer = if a > b { a } else { b };
    if longer > 1.0 { 0.5 * libm::log2f(longer as f32) } else { 0.0 }
}

/// A coordinate in texels, brought to the texture or its mirror image first: a u of 1e12 has a place in a repeated
/// texture; one that has none (infinite, NaN, beyond f64's integers) counts as 0.
#[inline]
fn texels_along(coordinate: f64, side: u32, wrap: Wrap) -> f64 {
    let near = match wrap {
        Wrap::Repeat => coordinate - floor(coordinate) as f64,
        Wrap::Mirror => coordinate - 2.0 * floor(coordinate * 0.5) as f64,
        Wrap::Clamp => coordinate.clamp(0.0, 1.0),
    };
    if (0.0..=2.0).contains(&near) { near * f64::from(side) } else { 0.0 }
}

/// The largest integer that isn't above; what has none in i64 gets the nearest that i64 has, NaN gets 0. The
/// base instruction set has no rounding instruction, and `f64::floor` would be a call per coordinate.
#[inline]
fn floor(x: f64) -> i64 {
    let towards_zero = x as i64;
    if towards_zero as f64 > x { towards_zero.saturating_sub(1) } else { towards_zero }
}

/// The texel at a coordinate from [`texels_along`], or one beside it: at −1 up to the number of texels, of both images if
/// mirrored. Comparisons, because a division per texel costs more than the rest of the filter.
#[inline]
fn wrapped(i: i64, side: u32, wrap: Wrap) -> u32 {
    let n = i64::from(side);
    let inside = match wrap {
        Wrap::Repeat if i < 0 => i + n,
        Wrap::Repeat if i >= n => i - n,
        Wrap::Repeat => i,
        Wrap::Mirror if i < 0 => -1 - i,
        Wrap::Mirror if i >= 2 * n => i - 2 * n,
        Wrap::Mirror if i >= n => 2 * n - 1 - i,
        Wrap::Mirror => i,
        Wrap::Clamp => i.clamp(0, n - 1),
    };
    inside as u32
}

#[inline]
fn nearest(level: &impl Texels, usage: &TextureUse, u: f64, v: f64) -> [f32; 4] {
    let (w, h) = level.size();
    let x = floor(texels_along(u, w, usage.wrap_u));
    let y = floor(texels_along(v, h, usage.wrap_v));
    level.texel(wrapped(x, w, usage.wrap_u), wrapped(y, h, usage.wrap_v))
}

#[inline]
fn bilinear(level: &impl Texels, usage: &TextureUse, u: f64, v: f64) -> [f32; 4] {
    let (w, h) = level.size();
    let (x, y) = (texels_along(u, w, usage.wrap_u) - 0.5, texels_along(v, h, usage.wrap_v) - 0.5);
    let (x0, y0) = (floor(x), floor(y));
    let (fx, fy) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    let (left, right) = (wrapped(x0, w, usage.wrap_u), wrapped(x0 + 1, w, usage.wrap_u));
    let (above, below) = (wrapped(y0, h, usage.wrap_v), wrapped(y0 + 1, h, usage.wrap_v));
    let (a, b) = (level.texel(left, above), level.texel(right, above));
    let (c, d) = (level.texel(left, below), level.texel(right, below));
    std::array::from_fn(|k| {
        let upper = a[k] + (b[k] - a[k]) * fx;
        let lower = c[k] + (d[k] - c[k]) * fx;
        upper + (lower - upper) * fy
    })
}

/// The area means of a level: texel (x, y) of the next level covers `from/to` texels of this one along each axis.
fn halve(from: (u32, u32), to: (u32, u32), source: impl Fn(u32, u32) -> [f32; 4]) -> Vec<[f32; 4]> {
    let columns = overlaps(from.0, to.0);
    let rows = overlaps(from.1, to.1);
    let mut texels = Vec::with_capacity(columns.len() * rows.len());
    for row in &rows {
        for column in &columns {
            let mut sum = [0.0f32; 4];
            for (y, wy) in row {
                for (x, wx) in column {
                    let texel = source(*x, *y);
                    for c in 0..4 {
                        sum[c] += texel[c] * (wx * wy);
                    }
                }
            }
            texels.push(sum);
        }
    }
    texels
}

/// For each of `to` equal parts of a row of `from` texels: the texels it overlaps and the share that each has of it.
fn overlaps(from: u32, to: u32) -> Vec<Vec<(u32, f32)>> {
    // In units of 1/to texel everything is an integer: part k reaches from k·from to (k + 1)·from, texel i from i·to on.
    let (from, to) = (u64::from(from), u64::from(to));
    (0..to)
        .map(|k| {
            let (start, end) = (k * from, (k + 1) * from);
            (start / to..end.div_ceil(to))
                .map(|i| {
                    let overlap = end.min((i + 1) * to) - start.max(i * to);
                    (i as u32, overlap as f32 / from as f32)
                })
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::ids::ContentId;
    use proto::scene::TRANSFORM_IDENTITY;

    fn usage(wrap: Wrap, magnify: Filter) -> TextureUse {
        TextureUse {
            texture: ContentId([0; 16]),
            set: 0,
            transform: TRANSFORM_IDENTITY,
            wrap_u: wrap,
            wrap_v: wrap,
            magnify,
        }
    }

    /// A row of texels whose alpha is their number.
    fn row(alphas: &[u8]) -> MipTexture {
        let texels = alphas.iter().map(|a| [255, 0, 0, *a]).collect();
        MipTexture::new(Texture { width: alphas.len() as u32, height: 1, texels }).unwrap()
    }

    fn alpha_at(texture: &MipTexture, usage: &TextureUse, u: f64, detail: f32) -> f32 {
        texture.sample(usage, u, 0.5, detail)[3] * 255.0
    }

    #[test]
    fn wrap_modes_continue_the_row_as_gltf_says() {
        let texture = row(&[10, 20, 30, 40]);
        // Centres of the texels −5 … 8.
        let at = |wrap| -> Vec<f32> {
            let usage = usage(wrap, Filter::Nearest);
            (-5..9).map(|i| alpha_at(&texture, &usage, (f64::from(i) + 0.5) / 4.0, 0.0).round()).collect()
        };
        assert_eq!(at(Wrap::Repeat), [40., 10., 20., 30., 40., 10., 20., 30., 40., 10., 20., 30., 40., 10.]);
        assert_eq!(at(Wrap::Mirror), [40., 40., 30., 20., 10., 10., 20., 30., 40., 40., 30., 20., 10., 10.]);
        assert_eq!(at(Wrap::Clamp), [10., 10., 10., 10., 10., 10., 20., 30., 40., 40., 40., 40., 40., 40.]);
    }

    #[test]
    fn bilinear_mixes_across_the_border_by_the_wrap_mode() {
        let texture = row(&[0, 100]);
        for (wrap, expected) in [(Wrap::Repeat, 50.0), (Wrap::Mirror, 0.0), (Wrap::Clamp, 0.0)] {
            let alpha = alpha_at(&texture, &usage(wrap, Filter::Linear), 0.0, 0.0);
            assert!((alpha - expected).abs() < 1e-3, "{wrap:?}: {alpha}");
        }
        let middle = alpha_at(&texture, &usage(Wrap::Clamp, Filter::Linear), 0.5, 0.0);
        assert!((middle - 50.0).abs() < 1e-3, "{middle}");
    }

    #[test]
    fn far_and_senseless_coordinates_are_read_without_harm() {
        let texture = row(&[10, 20, 30, 40]);
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for u in [1e300, -1e300, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e12 + 0.125, 5e-324] {
                for detail in [f32::NAN, f32::INFINITY, -1.0, 0.5, 100.0] {
                    let alpha = alpha_at(&texture, &usage(wrap, Filter::Linear), u, detail);
                    assert!((10.0..=40.01).contains(&alpha), "{wrap:?} {u} {detail}: {alpha}");
                }
            }
        }
    }

    #[test]
    fn copies_are_area_means_in_linear_light_also_for_odd_sides() {
        let texture = row(&[0, 60, 240]);
        // 3 → 1: the mean of all three.
        assert!((alpha_at(&texture, &usage(Wrap::Clamp, Filter::Linear), 0.5, 1.0) - 100.0).abs() < 0.01);
        // 5 → 2: (t0 + t1 + t2/2) / 2.5.
        let five = row(&[10, 20, 30, 40, 50]);
        let left = alpha_at(&five, &usage(Wrap::Clamp, Filter::Linear), 0.25, 1.0);
        assert!((left - (10.0 + 20.0 + 15.0) / 2.5).abs() < 0.01, "{left}");
        // Black and white mix to half the light, not to half the code.
        let texels = vec![[0, 0, 0, 255], [255; 4]];
        let texture = MipTexture::new(Texture { width: 2, height: 1, texels }).unwrap();
        let grey = texture.sample(&usage(Wrap::Clamp, Filter::Linear), 0.5, 0.5, 1.0);
        assert!((grey[0] - 0.5).abs() < 1e-4, "{grey:?}");
    }

    #[test]
    fn the_level_follows_the_footprint() {
        let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-6, "{a} {b}");
        // 256 texels, one pixel spans 1/64 of the texture: 4 texels, level 2, by whichever axis is longer.
        near(detail((256, 256), [1.0 / 64.0, 0.0], [0.0, 1.0 / 64.0]), 2.0);
        near(detail((256, 256), [1.0 / 64.0, 0.0], [0.0, 1.0 / 8192.0]), 2.0);
        near(detail((256, 16), [1.0 / 1024.0, 0.0], [0.0, 1.0 / 4.0]), 2.0);
        near(detail((256, 256), [1.0 / 1024.0, 0.0], [0.0, 1.0 / 1024.0]), 0.0);
        near(detail((256, 256), [f64::NAN, 0.0], [0.0, 0.0]), 0.0);
        // Half-way between two levels both count half.
        let texture = row(&[0, 200, 0, 200]);
        let value = alpha_at(&texture, &usage(Wrap::Clamp, Filter::Linear), 0.375, 0.5);
        assert!((value - 150.0).abs() < 0.01, "{value}");
    }

    #[test]
    fn a_texture_that_contradicts_itself_is_refused() {
        let refused = |width, height, n| MipTexture::new(Texture { width, height, texels: vec![[0; 4]; n] }).err();
        assert_eq!(refused(0, 1, 0), Some(TextureError::Size { width: 0, height: 1 }));
        assert_eq!(refused(2, 2, 3), Some(TextureError::Length { width: 2, height: 2, texels: 3 }));
        assert_eq!(refused(u32::MAX, u32::MAX, 1), Some(TextureError::Size { width: u32::MAX, height: u32::MAX }));
    }
}
