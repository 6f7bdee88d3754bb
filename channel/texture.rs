//! Textures: what a pixel sees of a picture on a surface.
//!
//! The truth is the base level averaged over the pixel. A pixel sees a parallelogram of the texture, and it is looked at
//! in a grid of places on it, so close together that none is left out, in the copy (mip-map) whose texels are a
//! fraction of the parallelogram's width: so nothing from outside bleeds in, however slanted it is. Where the texture is
//! magnified, the places are in the base level, interpolated (or the nearest texel where the file asks for it); one is
//! enough where the pixel lies between the same four texels all over. In a pixel that the face covers in part only
//! places on the face count: what lies beside it in the texture is something else.
//!
//! Everything is filtered in linear light: levels are kept as linear 16-bit numbers, 1/20 of an 8-bit sRGB step at
//! worst. A copy's texel is the exact area mean of what it covers, also where a side is odd: then up to three texels count
//! per axis, with the weights of their overlap. Alpha is averaged as a channel of its own, as glTF's straight alpha has it.
//! Places are counted in integers and added in a fixed order; levels are chosen by a number's exponent: the same bytes
//! everywhere.

use crate::resolve::colour::decode_srgb;
use crate::simd::{each2, each4};
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

/// Texels of the level in use across the narrower side of a pixel's parallelogram, at least (up to twice as many).
const ACROSS: f64 = 2.0;

/// Texels of the level in use along the longer side of it, at most (and at least half as many where that is the limit).
const ALONG_MAX: f64 = 16.0;

/// Places that a pixel is looked at, at most.
const PLACES_MAX: u32 = 256;

/// Fewest places per side of a pixel that a face covers in part.
const PLACES_PARTIAL: u32 = 4;

/// Places per side of a pixel that sees a border of texels that aren't interpolated.
const PLACES_NEAREST: u32 = 8;

/// Of a texel: what pixels see that are smaller is the same all over.
const TINY: f64 = 1.0 / 16.0;

/// Fractional bits of a coordinate in texels.
const FRACTION_BITS: u32 = 16;

/// A texture with its halved copies.
#[derive(Clone, Debug)]
pub struct MipTexture {
    /// The base level, then each half as wide and high as the one before, down to 1 × 1.
    levels: Vec<Level>,
}

/// One level: row-major, tightly packed RGBA, all linear, 65 535 is 1.
#[derive(Clone, Debug)]
struct Level {
    width: u32,
    height: u32,
    texels: Vec<[u16; 4]>,
}

/// What a pixel sees of a texture: (u, v) at a place in it and the change of either per pixel, to the right and downwards.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    /// Coordinates at [`Footprint::place`].
    pub at: [f64; 2],
    /// Where in the pixel that is, from its upper left, pixels.
    pub place: [f64; 2],
    /// Change of u.
    pub du: [f64; 2],
    /// Change of v.
    pub dv: [f64; 2],
}

/// How a row or column of texels goes on beyond its ends.
#[derive(Clone, Copy, Debug)]
struct Axis {
    side: i32,
    wrap: Wrap,
    is_power_of_two: bool,
}

impl Axis {
    fn new(side: u32, wrap: Wrap) -> Self {
        Self { side: side as i32, wrap, is_power_of_two: side.is_power_of_two() }
    }

    /// The texel at this place of the endless row.
    #[inline]
    fn texel(self, i: i32) -> usize {
        let within = |period: i32| match () {
            () if self.is_power_of_two => i & (period - 1),
            () if (0..period).contains(&i) => i,
            () => i.rem_euclid(period),
        };
        let inside = match self.wrap {
            Wrap::Repeat => within(self.side),
            Wrap::Mirror => {
                let i = within(2 * self.side);
                if i < self.side { i } else { 2 * self.side - 1 - i }
            }
            Wrap::Clamp => i.clamp(0, self.side - 1),
        };
        inside as usize
    }

    /// A coordinate in texels, of the texture or its mirror image if it goes on: a u of 1e12 has a place in a repeated
    /// texture; one that has none (infinite, NaN, beyond f64's integers) counts as 0.
    #[inline]
    fn along(self, coordinate: f64) -> f64 {
        let near = match self.wrap {
            Wrap::Repeat => coordinate - floor(coordinate) as f64,
            Wrap::Mirror => coordinate - 2.0 * floor(coordinate * 0.5) as f64,
            // Far enough beyond the border that no pixel reaches back that isn't larger than the texture.
            Wrap::Clamp => {
                return if coordinate.is_nan() { 0.0 } else { coordinate.clamp(-1e3, 1e3) * f64::from(self.side) };
            }
        };
        if (0.0..=2.0).contains(&near) { near * f64::from(self.side) } else { 0.0 }
    }
}

/// A coordinate in texels as an integer.
#[inline]
fn fixed(texels: f64) -> i64 {
    (texels * f64::from(1u32 << FRACTION_BITS)) as i64
}

impl Level {
    #[inline]
    fn axes(&self, usage: &TextureUse) -> [Axis; 2] {
        [Axis::new(self.width, usage.wrap_u), Axis::new(self.height, usage.wrap_v)]
    }

    #[inline]
    fn texel(&self, x: usize, y: usize) -> [f32; 4] {
        each4(self.texels[y * self.width as usize + x], f32::from)
    }

    /// Four texels mixed, in 1/65 535, at a place counted from the centre of the first texel. `u` and `v` say which
    /// texel a place of the endless row is.
    #[inline(always)]
    fn bilinear(&self, u: &impl Fn(i32) -> usize, v: &impl Fn(i32) -> usize, x: i64, y: i64) -> [f32; 4] {
        let part = |c: i64| (c & ((1 << FRACTION_BITS) - 1)) as i32 as f32 * (1.0 / (1u32 << FRACTION_BITS) as f32);
        let (fx, fy) = (part(x), part(y));
        let (x0, y0) = ((x >> FRACTION_BITS) as i32, (y >> FRACTION_BITS) as i32);
        let (left, right) = (u(x0), u(x0 + 1));
        let (above, below) = (v(y0), v(y0 + 1));
        let (a, b) = (self.texel(left, above), self.texel(right, above));
        let (c, d) = (self.texel(left, below), self.texel(right, below));
        each4([0, 1, 2, 3], |k| {
            let upper = a[k] + (b[k] - a[k]) * fx;
            let lower = c[k] + (d[k] - c[k]) * fx;
            upper + (lower - upper) * fy
        })
    }

    #[inline(always)]
    fn nearest(&self, u: &impl Fn(i32) -> usize, v: &impl Fn(i32) -> usize, x: i64, y: i64) -> [f32; 4] {
        self.texel(u((x >> FRACTION_BITS) as i32), v((y >> FRACTION_BITS) as i32))
    }

    /// The sum over a grid, and of how many places; with `MASKED` those of `cells` alone.
    #[inline(always)]
    fn sum<const MASKED: bool>(grid: &Grid, cells: &[u64; 4], texel: impl Fn(i64, i64) -> [f32; 4]) -> ([f32; 4], u32) {
        let mut sum = [0.0f32; 4];
        let mut count = 0;
        let mut bit = 0usize;
        let [mut row_x, mut row_y] = grid.first;
        for _ in 0..grid.counts[1] {
            let (mut x, mut y) = (row_x, row_y);
            for _ in 0..grid.counts[0] {
                if !MASKED || cells[bit / 64] >> (bit % 64) & 1 != 0 {
                    let texel = texel(x, y);
                    sum = each4([0, 1, 2, 3], |k| sum[k] + texel[k]);
                    count += 1;
                }
                bit += 1;
                (x, y) = (x + grid.column_step[0], y + grid.column_step[1]);
            }
            (row_x, row_y) = (row_x + grid.row_step[0], row_y + grid.row_step[1]);
        }
        (sum, count)
    }

    /// The same of texels mixed by fours, by the quickest way to find them that will do.
    #[inline(always)]
    fn sum_linear<const MASKED: bool>(&self, axes: &[Axis; 2], grid: &Grid, cells: &[u64; 4]) -> ([f32; 4], u32) {
        let is_masked = |a: &Axis| a.is_power_of_two && a.wrap == Wrap::Repeat;
        if grid.is_within([self.width, self.height]) {
            Self::sum::<MASKED>(grid, cells, |x, y| self.bilinear(&|i| i as usize, &|i| i as usize, x, y))
        } else if is_masked(&axes[0]) && is_masked(&axes[1]) {
            let (mask_u, mask_v) = (axes[0].side - 1, axes[1].side - 1);
            let (u, v) = (|i| (i & mask_u) as usize, |i| (i & mask_v) as usize);
            Self::sum::<MASKED>(grid, cells, |x, y| self.bilinear(&u, &v, x, y))
        } else {
            Self::sum::<MASKED>(grid, cells, |x, y| self.bilinear(&|i| axes[0].texel(i), &|i| axes[1].texel(i), x, y))
        }
    }

    /// The same of the nearest texels.
    fn sum_nearest(&self, axes: &[Axis; 2], grid: &Grid, cells: &[u64; 4]) -> ([f32; 4], u32) {
        Self::sum::<true>(grid, cells, |x, y| self.nearest(&|i| axes[0].texel(i), &|i| axes[1].texel(i), x, y))
    }

    /// One place, as this filter reads it.
    fn at(&self, usage: &TextureUse, filter: Filter, at: [f64; 2]) -> [f32; 4] {
        let axes = self.axes(usage);
        let [x, y] = [axes[0].along(at[0]), axes[1].along(at[1])];
        let sum = match filter {
            Filter::Linear => {
                self.bilinear(&|i| axes[0].texel(i), &|i| axes[1].texel(i), fixed(x - 0.5), fixed(y - 0.5))
            }
            Filter::Nearest => self.nearest(&|i| axes[0].texel(i), &|i| axes[1].texel(i), fixed(x), fixed(y)),
        };
        each4(sum, |c| c * UNIT)
    }
}

/// Places on a level, coordinates in texels as integers.
#[derive(Clone, Copy, Debug)]
struct Grid {
    first: [i64; 2],
    column_step: [i64; 2],
    row_step: [i64; 2],
    /// Columns, rows.
    counts: [u32; 2],
}

impl Grid {
    /// Whether all places lie between texels that the level has, so that nothing wraps.
    fn is_within(&self, side: [u32; 2]) -> bool {
        let is_within = each2([0, 1], |k| {
            let ways =
                [self.column_step[k] * i64::from(self.counts[0] - 1), self.row_step[k] * i64::from(self.counts[1] - 1)];
            let low = self.first[k] + ways[0].min(0) + ways[1].min(0);
            let high = self.first[k] + ways[0].max(0) + ways[1].max(0);
            low >= 0 && (high >> FRACTION_BITS) + 1 < i64::from(side[k])
        });
        is_within[0] && is_within[1]
    }
}

/// What a texel's number is multiplied by.
const UNIT: f32 = 1.0 / 65_535.0;

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
        let scale = 1.0 / 255.0;
        let decoded = |t: [u8; 4]| {
            let [r, g, b] = decode_srgb([t[0], t[1], t[2]]);
            [r, g, b, f32::from(t[3]) * scale]
        };
        let quantise = |c: f32| (c.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16;
        let level = |size: (u32, u32), texels: Vec<[u16; 4]>| Level { width: size.0, height: size.1, texels };
        let mut size = (width, height);
        let codes: [[u16; 2]; 256] = std::array::from_fn(|c| {
            let [r, _, _, a] = decoded([c as u8; 4]).map(quantise);
            [r, a]
        });
        let stored = |t: &[u8; 4]| {
            let [r, g, b, a] = t.map(|c| codes[usize::from(c)]);
            [r[0], g[0], b[0], a[1]]
        };
        let mut levels = vec![level(size, texels.iter().map(stored).collect())];
        // Each copy is made from the floats of the one before, so that rounding doesn't add up from level to level.
        let mut source: Vec<[f32; 4]> = Vec::new();
        while size != (1, 1) {
            let next = ((size.0 / 2).max(1), (size.1 / 2).max(1));
            let at = |x: u32, y: u32| y as usize * size.0 as usize + x as usize;
            let floats = if levels.len() == 1 {
                halve(size, next, |x, y| decoded(texels[at(x, y)]))
            } else {
                halve(size, next, |x, y| source[at(x, y)])
            };
            levels.push(level(next, floats.iter().map(|t| t.map(quantise)).collect()));
            (source, size) = (floats, next);
        }
        Ok(Self { levels })
    }

    /// Width and height of the base level, texels.
    pub fn size(&self) -> (u32, u32) {
        (self.levels[0].width, self.levels[0].height)
    }

    /// Linear RGBA at (u, v). `detail` is the level whose texels are as large as the footprint, log2 of the
    /// footprint in base texels; at 0 and below the texture is magnified.
    #[inline]
    pub fn sample(&self, usage: &TextureUse, u: f64, v: f64, detail: f32) -> [f32; 4] {
        // NaN compares false: it lands in the base level, and no coordinate is used unchecked below.
        let magnified = detail.is_nan() || detail <= 0.0;
        if magnified {
            return self.levels[0].at(usage, usage.magnify, [u, v]);
        }
        let last = self.levels.len() - 1;
        let detail = detail.min(last as f32);
        let lower = detail as usize;
        let part = detail - lower as f32;
        let fine = self.levels[lower].at(usage, Filter::Linear, [u, v]);
        if part == 0.0 {
            return fine;
        }
        let coarse = self.levels[lower + 1].at(usage, Filter::Linear, [u, v]);
        std::array::from_fn(|c| fine[c] + (coarse[c] - fine[c]) * part)
    }

    /// Linear RGBA, averaged over a pixel. `covered` says which places of a grid of so many columns and rows over the pixel the face
    /// covers (bit row · columns + column); `None`: it covers all of it.
    #[inline]
    pub fn average(
        &self,
        usage: &TextureUse,
        footprint: &Footprint,
        covered: Option<impl Fn([u32; 2]) -> [u64; 4]>,
    ) -> [f32; 4] {
        let (w, h) = (f64::from(self.levels[0].width), f64::from(self.levels[0].height));
        let right = [footprint.du[0] * w, footprint.dv[0] * h];
        let down = [footprint.du[1] * w, footprint.dv[1] * h];
        let [wide, high] = each2([right, down], |d| (d[0] * d[0] + d[1] * d[1]).sqrt());
        // Not f64::max: a NaN must not win or lose by the platform's rule.
        let longer = if wide > high { wide } else { high };
        if longer.is_nan() || longer < TINY * TINY {
            return self.levels[0].at(usage, usage.magnify, footprint.at);
        }
        if longer <= 1.0 {
            let axes = self.levels[0].axes(usage);
            let shift = if usage.magnify == Filter::Linear { 0.5 } else { 0.0 };
            let inside = |axis: usize| {
                let x = axes[axis].along(footprint.at[axis]) - shift;
                let part = x - floor(x) as f64;
                let reach = 0.5 * (right[axis].abs() + down[axis].abs());
                part - reach >= 0.0 && part + reach <= 1.0
            };
            if (covered.is_none() || longer < TINY) && inside(0) && inside(1) {
                return self.levels[0].at(usage, usage.magnify, footprint.at);
            }
            let filter = usage.magnify;
            let fewest = match (filter, covered.is_some()) {
                (Filter::Nearest, _) => PLACES_NEAREST,
                (Filter::Linear, true) => PLACES_PARTIAL,
                (Filter::Linear, false) => 2,
            };
            let places = |side: f64| ((side * 3.0) as u32 + 1).max(fewest);
            return self.places(usage, filter, footprint, 0, [1.0; 2], [places(wide), places(high)], covered);
        }
        let area = (right[0] * down[1] - right[1] * down[0]).abs();
        // Texels as large as possible of which so many fit across, and as small as needed to get along with so many.
        let across = area / (longer * ACROSS);
        let along = longer / ALONG_MAX;
        let mut level = exponent(if across > along { across } else { along });
        let fewest = if covered.is_some() { PLACES_PARTIAL } else { 1 };
        loop {
            let last = self.levels.len() - 1;
            if level >= last {
                return self.levels[last].at(usage, Filter::Linear, footprint.at);
            }
            // Powers of two are exact.
            let texel = (1u64 << level) as f64;
            let per_texel = if level == 0 && longer <= SMALL { PER_TEXEL_SMALL } else { 1.0 };
            let per_base = per_texel / texel;
            let places = |side: f64| ((side * per_base) as u32 + 1).max(fewest);
            let counts = [places(wide), places(high)];
            if counts[0] * counts[1] > PLACES_MAX {
                level += 1;
                continue;
            }
            // A copy is blurred by its texels and by mixing them, more than the base level by mixing its own: the
            // parallelogram shrinks so far that the average's variance stays that of the truth.
            if level == 0 {
                return self.places(usage, Filter::Linear, footprint, 0, [1.0; 2], counts, covered);
            }
            let blur = 3.0 * texel * texel - 2.0;
            let shrink = |side: f64| {
                let rest = 1.0 - blur / (side * side);
                if rest > 0.0 { rest.sqrt() } else { 0.0 }
            };
            return self.places(usage, Filter::Linear, footprint, level, [shrink(wide), shrink(high)], counts, covered);
        }
    }

    /// The mean of a grid of places over the pixel (shrunk about its centre) in one level.
    fn places(
        &self,
        usage: &TextureUse,
        filter: Filter,
        footprint: &Footprint,
        level: usize,
        shrink: [f64; 2],
        [columns, rows]: [u32; 2],
        covered: Option<impl Fn([u32; 2]) -> [u64; 4]>,
    ) -> [f32; 4] {
        let level = &self.levels[level];
        let axes = level.axes(usage);
        let shift = if filter == Filter::Linear { 0.5 } else { 0.0 };
        let (per_column, per_row) = (shrink[0] / f64::from(columns), shrink[1] / f64::from(rows));
        // From where (u, v) are known to the first place.
        let to_first = [
            0.5 - footprint.place[0] - 0.5 * shrink[0] + 0.5 * per_column,
            0.5 - footprint.place[1] - 0.5 * shrink[1] + 0.5 * per_row,
        ];
        let slopes = [footprint.du, footprint.dv];
        let side = [f64::from(level.width), f64::from(level.height)];
        let first = each2([0, 1], |k| {
            let way = (slopes[k][0] * to_first[0] + slopes[k][1] * to_first[1]) * side[k];
            fixed(axes[k].along(footprint.at[k]) - shift + way)
        });
        let column_step = each2([0, 1], |k| fixed(slopes[k][0] * per_column * side[k]));
        let row_step = each2([0, 1], |k| fixed(slopes[k][1] * per_row * side[k]));
        let grid = Grid { first, column_step, row_step, counts: [columns, rows] };
        let (sum, count) = match (filter, covered) {
            (Filter::Linear, None) => level.sum_linear::<false>(&axes, &grid, &[0; 4]),
            (Filter::Linear, Some(covered)) => level.sum_linear::<true>(&axes, &grid, &covered([columns, rows])),
            (Filter::Nearest, None) => level.sum_nearest(&axes, &grid, &[u64::MAX; 4]),
            (Filter::Nearest, Some(covered)) => level.sum_nearest(&axes, &grid, &covered([columns, rows])),
        };
        if count == 0 {
            return level.at(usage, filter, footprint.at);
        }
        let scale = UNIT / count as f32;
        each4(sum, |c| c * scale)
    }
}

/// Up to so many base texels long a pixel is looked at in more places than one per texel: each counts for much.
const SMALL: f64 = 4.0;

/// Places per texel in such a pixel.
const PER_TEXEL_SMALL: f64 = 2.0;

/// The power of two at or below a positive number, 0 below 1.
#[inline]
fn exponent(x: f64) -> usize {
    ((x.to_bits() >> 52) as usize & 0x7ff).saturating_sub(1023)
}

/// Log2 of the pixel's footprint in texels, from the derivatives of (u, v) along one pixel in x and in y: the longer of
/// the two. What one sample of a pixel is read with; pixels are averaged.
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

/// The largest integer that isn't above; what has none in i64 gets the nearest that i64 has, NaN gets 0. The
/// base instruction set has no rounding instruction, and `f64::floor` would be a call per coordinate.
#[inline]
fn floor(x: f64) -> i64 {
    let towards_zero = x as i64;
    if towards_zero as f64 > x { towards_zero.saturating_sub(1) } else { towards_zero }
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
