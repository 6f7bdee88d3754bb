//! From linear light to the byte on the wire and back.
//!
//! The contract is: clamp to [0, 1], sRGB transfer function, 8 bits, rounded to nearest. Rather than evaluate a power per
//! channel, the 255 linear values at which the rounded code goes up by one are computed once, in f64 with `libm`; a value's code is the
//! number of thresholds that it reaches. A table over 16 384 equal steps of the value gives the code at the step's start,
//! and the threshold inside the step, where there is one (in 1 of 64), does the rest. So the rounding is exact, and equal everywhere.

use crate::simd::each3;
use fearless_simd::{Simd, f32x4, i32x4, prelude::*};
use std::sync::LazyLock;

/// Steps of the first guess; the exact thresholds correct it.
const GUESS_STEPS: usize = 16_384;

/// From linear light to bytes, and back.
pub struct Encoder {
    /// `thresholds[k]`: the smallest linear value with code k + 1; the last is out of reach and ends the search.
    thresholds: [f64; 256],
    /// The same for values that are f32.
    thresholds_f32: [f32; 256],
    /// The code at the lower end of each step; one more for the value 1.
    guess: [u8; GUESS_STEPS + 1],
    /// Linear value of each code.
    decoded: [f32; 256],
}

static ENCODER: LazyLock<Box<Encoder>> = LazyLock::new(|| {
    let mut tables = Box::new(Encoder {
        thresholds: [f64::INFINITY; 256],
        thresholds_f32: [f32::INFINITY; 256],
        guess: [0; GUESS_STEPS + 1],
        decoded: [0.0; 256],
    });
    for code in 0..255u8 {
        let threshold = linear_of((f64::from(code) + 0.5) / 255.0);
        tables.thresholds[usize::from(code)] = threshold;
        // The least f32 that isn't below it.
        let nearest = threshold as f32;
        tables.thresholds_f32[usize::from(code)] =
            if f64::from(nearest) < threshold { nearest.next_up() } else { nearest };
    }
    let mut code = 0;
    for step in 0..=GUESS_STEPS {
        while tables.thresholds[usize::from(code)] <= step as f64 / GUESS_STEPS as f64 {
            code += 1;
        }
        tables.guess[step] = code;
    }
    for code in 0..=255u8 {
        tables.decoded[usize::from(code)] = linear_of(f64::from(code) / 255.0) as f32;
    }
    tables
});

/// IEC 61966-2-1: the linear value of an encoded one, both in 0..=1.
fn linear_of(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { libm::pow((encoded + 0.055) / 1.055, 2.4) }
}

impl std::fmt::Debug for Encoder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Encoder").finish_non_exhaustive()
    }
}

impl Encoder {
    /// The one that there is.
    pub fn shared() -> &'static Self {
        &ENCODER
    }

    /// What [`encode_srgb`] says of a value that is an f32.
    #[inline(always)]
    pub fn code(&self, linear: f32) -> u8 {
        // NaN fails both comparisons.
        let value = if linear > 0.0 { linear } else { 0.0 };
        let value = if value < 1.0 { value } else { 1.0 };
        // A step holds one threshold at most: the least distance of two is 1/3294.
        let code = self.guess[(value * GUESS_STEPS as f32) as usize];
        code + u8::from(value >= self.thresholds_f32[usize::from(code)])
    }

    /// The same as [`Encoder::rgb`], three channels at once; the fourth number means nothing.
    #[inline(always)]
    pub fn rgb_of<S: Simd>(&self, simd: S, linear: [f32; 4]) -> u32 {
        let value = f32x4::simd_from(simd, linear);
        // NaN fails both comparisons.
        let value = value.simd_gt(0.0).select(value, f32x4::splat(simd, 0.0));
        let value = value.simd_lt(1.0).select(value, f32x4::splat(simd, 1.0));
        let steps: [i32; 4] = (value * GUESS_STEPS as f32).to_int::<i32x4<S>>().into();
        let value: [f32; 4] = value.into();
        let code = |c: usize| {
            let code = self.guess[steps[c] as usize];
            u32::from(code) + u32::from(value[c] >= self.thresholds_f32[usize::from(code)])
        };
        code(0) | code(1) << 8 | code(2) << 16
    }

    /// The codes of red, green and blue as `0x00BBGGRR`.
    #[inline(always)]
    pub fn rgb(&self, linear: [f32; 3]) -> u32 {
        let [r, g, b] = each3(linear, |c| u32::from(self.code(c)));
        r | g << 8 | b << 16
    }
}

/// The code of a linear value: clamped, encoded, rounded to nearest. NaN counts as 0.
#[inline]
pub fn encode_srgb(linear: f64) -> u8 {
    let tables = Encoder::shared();
    if linear >= 1.0 {
        return 255;
    }
    let positive = linear > 0.0;
    if !positive {
        return 0;
    }
    let mut code = tables.guess[(linear * GUESS_STEPS as f64) as usize];
    while linear >= tables.thresholds[usize::from(code)] {
        code += 1;
    }
    code
}

/// The linear values of three codes.
#[inline]
pub fn decode_srgb([r, g, b]: [u8; 3]) -> [f32; 3] {
    let decoded = &Encoder::shared().decoded;
    [decoded[usize::from(r)], decoded[usize::from(g)], decoded[usize::from(b)]]
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::simd::{at_level, every_level};

    /// The definition, evaluated directly.
    fn encoded_directly(linear: f64) -> u8 {
        let c = linear.clamp(0.0, 1.0);
        let e = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * libm::pow(c, 1.0 / 2.4) - 0.055 };
        (e * 255.0).round() as u8
    }

    #[test]
    fn every_code_survives_the_way_to_linear_and_back() {
        for code in 0..=255 {
            assert_eq!(decode_srgb([code; 3]).map(|c| encode_srgb(f64::from(c))), [code; 3]);
        }
    }

    #[test]
    fn rounding_is_to_the_nearest_code() {
        for step in 0..=1_000_000 {
            let linear = f64::from(step) / 1e6;
            assert_eq!(encode_srgb(linear), encoded_directly(linear), "{linear}");
        }
    }

    #[test]
    fn values_of_f32_have_the_codes_of_f64() {
        let encoder = Encoder::shared();
        let near = |value: f32| [value.next_down(), value, value.next_up()];
        let thresholds = encoder.thresholds_f32[..255].iter().flat_map(|t| near(*t));
        let steps = (0..=GUESS_STEPS).flat_map(|k| near(k as f32 / GUESS_STEPS as f32));
        let outside = [-1.0, -0.0, 2.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e-40];
        for value in thresholds.chain(steps).chain(outside) {
            let code = encode_srgb(f64::from(value));
            assert_eq!(encoder.code(value), code, "{value}");
            for level in every_level() {
                let three = [value, 1.0 - value, 0.25, f32::NAN];
                let found = at_level!(level, simd => encoder.rgb_of(simd, three));
                assert_eq!(found, encoder.rgb([three[0], three[1], three[2]]), "{level:?}: {value}");
            }
        }
    }

    #[test]
    fn what_is_outside_is_clamped_and_nan_is_black() {
        assert_eq!(encode_srgb(-1.0), 0);
        assert_eq!(encode_srgb(-0.0), 0);
        assert_eq!(encode_srgb(f64::NAN), 0);
        assert_eq!(encode_srgb(1.0), 255);
        assert_eq!(encode_srgb(f64::INFINITY), 255);
        assert_eq!(encode_srgb(f64::from_bits(1.0f64.to_bits() - 1)), 255);
    }
}
