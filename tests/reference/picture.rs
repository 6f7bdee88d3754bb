//! A picture: linear colours, and what kind of pixel each is.

/// What is seen in a pixel, for statistics.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Kind {
    /// More than one plane, material or stack of faces is seen in the pixel or within one sample spacing of it
    /// (proof.md).
    pub is_edge: bool,
    /// A texture is seen.
    pub is_textured: bool,
    /// Texels per pixel of the texture seen that is reduced the most. Up to 1 a texture is magnified.
    pub texels_per_pixel: f64,
}

/// A picture in linear light, unclamped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Linear RGB, row-major.
    pub linear: Vec<[f64; 3]>,
    /// One per pixel.
    pub kinds: Vec<Kind>,
    /// Pixels that were too intricate to be integrated and were sampled instead.
    pub sampled_instead: usize,
}

impl Picture {
    /// The colour of a pixel.
    ///
    /// # Panics
    /// If it is outside of the picture.
    pub fn at(&self, x: u32, y: u32) -> [f64; 3] {
        self.linear[y as usize * self.width as usize + x as usize]
    }

    /// 8-bit sRGB: clamped, encoded, rounded to nearest; 3 bytes a pixel, row-major.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.linear.iter().flatten().map(|c| encode(*c).round() as u8).collect()
    }
}

/// The sRGB transfer function times 255, of a linear value clamped to 0..=1. Not rounded.
pub fn encode(linear: f64) -> f64 {
    let c = linear.clamp(0.0, 1.0);
    255.0 * if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`encode`].
pub fn decode(encoded: f64) -> f64 {
    let c = encoded / 255.0;
    if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}
