//! Textures: what is read at one place, and what a pixel sees of them.
//!
//! picture.md: "colour decoded from sRGB, then filtered linearly (a NEAREST magnification filter is honoured), wrap
//! modes as glTF; the truth is the base level averaged over the pixel". So there are no halved copies here: the pixel
//! is looked at in many places, and each reads the base level.
//!
//! Choices: in a pixel that its face covers only in part, the average is over that part. NEAREST is magnification
//! only: where a pixel is larger than a texel, reading is linear.

use glam::DVec2;
use proto::scene::{Filter, Mesh, Texture, TextureUse, Wrap};
use std::sync::LazyLock;

/// Linear values of the 256 encoded ones.
static DECODED: LazyLock<[f64; 256]> = LazyLock::new(|| std::array::from_fn(|c| crate::picture::decode(c as f64)));

/// How much of a texture a pixel sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filtering {
    /// The base level averaged over the pixel, as the page has it; at most that many places per side. (Four places
    /// per texel are looked at, at least 4 and at most this number per side.)
    Averaged(usize),
    /// The same where texels are smaller than pixels; where they are larger, the one place where the face is shaded, as
    /// renderers do. Beside a sharp edge in the texture that differs from the average, most where texels and pixels are
    /// of one size.
    AveragedIfReduced(usize),
    /// The one place where the face is shaded, always.
    Point,
}

impl Filtering {
    /// The truth for all practical purposes.
    pub const TRUTH: Self = Self::Averaged(64);

    /// Places per side of a pixel.
    pub fn side(self, texels_per_pixel: f64) -> usize {
        match self {
            Self::Point => 1,
            Self::AveragedIfReduced(_) if texels_per_pixel <= 1.0 => 1,
            Self::AveragedIfReduced(most) | Self::Averaged(most) => {
                ((texels_per_pixel * 4.0).ceil() as usize).clamp(4, most.max(4))
            }
        }
    }
}

/// A texture coordinate of a face: the two numbers at its three vertices, transformed.
#[derive(Clone, Copy, Debug)]
pub struct Coordinates([DVec2; 3]);

impl Coordinates {
    /// The coordinates that `used` reads `mesh` with, of the triangle with these vertices.
    pub fn new(mesh: &Mesh, used: &TextureUse, corners: [u32; 3]) -> Self {
        let set = mesh.texcoords.get(used.set as usize);
        Self(corners.map(|corner| {
            let [u, v] = set.map_or([0.0; 2], |set| set[corner as usize]).map(f64::from);
            let [row0, row1] = used.transform.map(|row| row.map(f64::from));
            DVec2::new(row0[0] * u + row0[1] * v + row0[2], row1[0] * u + row1[1] * v + row1[2])
        }))
    }

    /// The coordinate at these weights of the vertices.
    pub fn at(&self, weights: [f64; 3]) -> DVec2 {
        self.0[0] * weights[0] + self.0[1] * weights[1] + self.0[2] * weights[2]
    }
}

/// Reads the base level at a place: linear RGBA.
pub fn read(texture: &Texture, used: &TextureUse, place: DVec2, filter: Filter) -> [f64; 4] {
    let (width, height) = (i64::from(texture.width), i64::from(texture.height));
    let texel = |x: i64, y: i64| {
        let (x, y) = (wrap(used.wrap_u, x, width), wrap(used.wrap_v, y, height));
        let [r, g, b, a] = texture.texels[(y * width + x) as usize];
        let color = |c: u8| DECODED[usize::from(c)];
        [color(r), color(g), color(b), f64::from(a) / 255.0]
    };
    let (x, y) = (place.x * width as f64, place.y * height as f64);
    if filter == Filter::Nearest {
        return texel(x.floor() as i64, y.floor() as i64);
    }
    // Texels lie at the centres of their squares.
    let (x, y) = (x - 0.5, y - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let (right_part, lower_part) = (x - left, y - top);
    let (left, top) = (left as i64, top as i64);
    let mut sum = [0.0; 4];
    for (column, row, share) in [
        (left, top, (1.0 - right_part) * (1.0 - lower_part)),
        (left + 1, top, right_part * (1.0 - lower_part)),
        (left, top + 1, (1.0 - right_part) * lower_part),
        (left + 1, top + 1, right_part * lower_part),
    ] {
        for (sum, c) in sum.iter_mut().zip(texel(column, row)) {
            *sum += c * share;
        }
    }
    sum
}

fn wrap(wrap: Wrap, at: i64, size: i64) -> i64 {
    match wrap {
        Wrap::Repeat => at.rem_euclid(size),
        Wrap::Clamp => at.clamp(0, size - 1),
        Wrap::Mirror => {
            let at = at.rem_euclid(2 * size);
            if at < size { at } else { 2 * size - 1 - at }
        }
    }
}
