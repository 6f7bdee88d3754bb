//! How far a picture is from the reference: proof.md's measures.
//!
//! Errors in 1/255 are of the sRGB-encoded value, the reference's not rounded to 8 bits (so that a perfect 8-bit
//! picture has errors up to 0.5); errors in full scale are of linear light. Root mean squares are over the three
//! channels; a pixel's error, for percentiles and maxima, is its worst channel's.

use crate::picture::{Picture, decode, encode};
use image::{ImageEncoder, ImageError};
use std::fmt;

/// The picture that is compared.
#[derive(Clone, Copy, Debug)]
pub enum Shown<'a> {
    /// 8-bit sRGB, 3 bytes a pixel, row-major.
    Bytes(&'a [u8]),
    /// Linear RGB, 3 floats a pixel, row-major.
    Linear(&'a [f32]),
}

impl Shown<'_> {
    fn values(&self) -> usize {
        match self {
            Self::Bytes(bytes) => bytes.len(),
            Self::Linear(floats) => floats.len(),
        }
    }

    /// One channel: encoded 0..=255, and linear.
    fn channel(&self, index: usize) -> [f64; 2] {
        match self {
            Self::Bytes(bytes) => [f64::from(bytes[index]), decode(f64::from(bytes[index]))],
            Self::Linear(floats) => [encode(f64::from(floats[index])), f64::from(floats[index])],
        }
    }
}

/// Errors over some pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// How many pixels.
    pub pixels: usize,
    /// Root mean square, 1/255.
    pub rms_255: f64,
    /// 99th percentile of the pixels' errors, 1/255.
    pub p99_255: f64,
    /// Largest error, 1/255.
    pub max_255: f64,
    /// Root mean square, linear full scale.
    pub rms_linear: f64,
    /// Largest error, linear full scale.
    pub max_linear: f64,
    /// Where the largest encoded error is: x, y.
    pub worst: [u32; 2],
}

/// Errors by kind of pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Report {
    /// All pixels.
    pub all: Errors,
    /// Edge pixels.
    pub edges: Errors,
    /// Edge pixels that see no texture: what sampling alone is worth.
    pub untextured_edges: Errors,
    /// The rest.
    pub interior: Errors,
    /// Interior pixels that see no texture.
    pub untextured: Errors,
    /// Interior pixels that see textures, all magnified (at most one texel per pixel).
    pub magnified: Errors,
    /// Interior pixels that see a texture that is reduced.
    pub minified: Errors,
    /// Pixels of the reference that were sampled where they should have been integrated.
    pub sampled_instead: usize,
}

/// Compares.
///
/// # Panics
/// If the pictures' sizes differ.
pub fn compare(shown: Shown<'_>, reference: &Picture) -> Report {
    assert_eq!(shown.values(), reference.linear.len() * 3, "the pictures must have one size");
    let over = |wanted: &dyn Fn(usize) -> bool| errors(shown, reference, wanted);
    let is_edge = |i: usize| reference.kinds[i].is_edge;
    let is_textured = |i: usize| reference.kinds[i].is_textured;
    let is_reduced = |i: usize| reference.kinds[i].texels_per_pixel > 1.0;
    Report {
        all: over(&|_| true),
        edges: over(&is_edge),
        untextured_edges: over(&|i| is_edge(i) && !is_textured(i)),
        interior: over(&|i| !is_edge(i)),
        untextured: over(&|i| !is_edge(i) && !is_textured(i)),
        magnified: over(&|i| !is_edge(i) && is_textured(i) && !is_reduced(i)),
        minified: over(&|i| !is_edge(i) && is_reduced(i)),
        sampled_instead: reference.sampled_instead,
    }
}

fn errors(shown: Shown<'_>, reference: &Picture, wanted: &dyn Fn(usize) -> bool) -> Errors {
    let mut worst_of_pixels = Vec::new();
    let mut result = Errors::default();
    for (i, truth) in reference.linear.iter().enumerate().filter(|(i, _)| wanted(*i)) {
        let mut worst = 0.0f64;
        for (k, truth) in truth.iter().enumerate() {
            let [encoded, linear] = shown.channel(i * 3 + k);
            let (encoded, linear) = ((encoded - encode(*truth)).abs(), (linear - unclamped(shown, *truth)).abs());
            result.rms_255 += encoded * encoded;
            result.rms_linear += linear * linear;
            result.max_linear = result.max_linear.max(linear);
            worst = worst.max(encoded);
        }
        if worst > result.max_255 {
            result.max_255 = worst;
            result.worst = [i as u32 % reference.width, i as u32 / reference.width];
        }
        worst_of_pixels.push(worst);
    }
    let pixels = worst_of_pixels.len();
    if pixels > 0 {
        worst_of_pixels.sort_by(f64::total_cmp);
        result.pixels = pixels;
        result.p99_255 = worst_of_pixels[(pixels * 99).div_ceil(100) - 1];
        result.rms_255 = (result.rms_255 / (pixels * 3) as f64).sqrt();
        result.rms_linear = (result.rms_linear / (pixels * 3) as f64).sqrt();
    }
    result
}

/// What a linear value is compared with: bytes can't say more than 0 to 1.
fn unclamped(shown: Shown<'_>, truth: f64) -> f64 {
    match shown {
        Shown::Bytes(_) => truth.clamp(0.0, 1.0),
        Shown::Linear(_) => truth,
    }
}

impl fmt::Display for Errors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y] = self.worst;
        write!(
            f,
            "{:7} px  rms {:6.3}  p99 {:6.2}  max {:6.2} /255 at ({x}, {y})  linear rms {:.2e}  max {:.2e}",
            self.pixels, self.rms_255, self.p99_255, self.max_255, self.rms_linear, self.max_linear
        )
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = [
            ("all", self.all),
            ("edges", self.edges),
            ("untextured edges", self.untextured_edges),
            ("interior", self.interior),
            ("untextured", self.untextured),
            ("magnified", self.magnified),
            ("minified", self.minified),
        ];
        for (name, errors) in lines.iter().filter(|(_, errors)| errors.pixels > 0) {
            writeln!(f, "{name:>16}: {errors}")?;
        }
        if self.sampled_instead > 0 {
            writeln!(f, "{} pixels were sampled where they should have been integrated", self.sampled_instead)?;
        }
        Ok(())
    }
}

/// A PNG of the differences: grey is none, a channel's difference of 1/255 is `gain` steps up or down. Interior pixels
/// that are wrong by more than 1/255 are marked in full red, so that they can't be overlooked.
///
/// # Errors
/// When the encoder fails.
///
/// # Panics
/// If the pictures' sizes differ.
pub fn difference_picture(shown: Shown<'_>, reference: &Picture, gain: f64) -> Result<Vec<u8>, ImageError> {
    assert_eq!(shown.values(), reference.linear.len() * 3, "the pictures must have one size");
    let mut bytes = Vec::with_capacity(reference.linear.len() * 3);
    for (i, truth) in reference.linear.iter().enumerate() {
        let difference: [f64; 3] = std::array::from_fn(|k| shown.channel(i * 3 + k)[0] - encode(truth[k]));
        let is_wrong = !reference.kinds[i].is_edge && difference.iter().any(|d| d.abs() > 1.0);
        let grey = difference.map(|d| (128.0 + gain * d).clamp(0.0, 255.0) as u8);
        bytes.extend(if is_wrong { [255, 0, 0] } else { grey });
    }
    let mut png = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut png);
    encoder.write_image(&bytes, reference.width, reference.height, image::ExtendedColorType::Rgb8)?;
    Ok(png)
}
