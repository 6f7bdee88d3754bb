//! What the samples of one pixel see through its fragments.
//!
//! A fragment's colour and saturation are computed once per pixel, when first needed, and only if something in front of
//! it still lets light through. The order of the layers is mostly the same at all samples of a pixel; that is checked, not
//! assumed, by comparing neighbours in the order exactly, and where it isn't (panes that cross, or bound on each other)
//! each sample sorts its own.

use super::gather::Fragment;
use crate::geometry::setup::Triangle;
use crate::raster::depth::in_front;
use crate::shade::{FaceCache, Shader};

/// Up to this many fragments are compared pair by pair when comparing neighbours wasn't enough. A guess: the pairs then
/// cost about as much as sorting each sample.
const PAIRWISE_MAX: usize = 16;

/// A fragment with what sorting and mixing need.
#[derive(Clone, Copy, Debug)]
struct Layer {
    triangle: u32,
    mask: u64,
    q_centre: f64,
    order: u64,
    /// Linear RGB and saturation, once computed.
    shaded: Option<[f64; 4]>,
}

/// Buffers for one pixel, used again.
#[derive(Debug, Default)]
pub struct Layers {
    layers: Vec<Layer>,
    of_sample: Vec<(f64, u64, usize)>,
}

/// Light gathered so far on the way outward, and what still comes through.
#[derive(Clone, Copy, Debug)]
pub struct Through {
    /// Linear RGB.
    pub rgb: [f64; 3],
    /// What the layers so far let through of what is behind them, 0 to 1.
    pub transmitted: f64,
}

impl Through {
    const CLEAR: Self = Self { rgb: [0.0; 3], transmitted: 1.0 };

    #[inline]
    fn add(&mut self, [r, g, b, alpha]: [f64; 4]) {
        let part = alpha * self.transmitted;
        self.rgb[0] += r * part;
        self.rgb[1] += g * part;
        self.rgb[2] += b * part;
        self.transmitted *= 1.0 - alpha;
    }

    /// The colour with `behind` behind all layers.
    #[inline]
    pub fn over(&self, behind: [f32; 3]) -> [f64; 3] {
        std::array::from_fn(|c| self.rgb[c] + f64::from(behind[c]) * self.transmitted)
    }
}

/// What comes through a pixel's fragments.
#[derive(Clone, Copy, Debug)]
pub enum Composed {
    /// The same at every sample.
    Uniform(Through),
    /// Each sample its own; see the array given to [`Layers::compose`].
    PerSample,
}

impl Layers {
    /// Mixes the fragments of the pixel whose upper left is (x, y) sub; `samples` is filled if the answer says so.
    pub fn compose(
        &mut self,
        shader: &Shader<'_>,
        faces: &mut FaceCache,
        [x, y]: [i32; 2],
        fragments: impl Iterator<Item = Fragment>,
        samples: &mut [Through; 64],
    ) -> Composed {
        let pattern = shader.pattern;
        let triangle = |number: u32| -> &Triangle { &shader.triangles[number as usize] };
        self.layers.clear();
        self.layers.extend(fragments.map(|f| {
            let t = triangle(f.triangle);
            let q_centre = t.plane.at(x + 128, y + 128);
            Layer { triangle: f.triangle, mask: f.mask, q_centre, order: t.order, shaded: None }
        }));
        // Nearest first; equally near: the later in the file first. The order of the list has no say.
        self.layers.sort_unstable_by(|a, b| b.q_centre.total_cmp(&a.q_centre).then(b.order.cmp(&a.order)));
        let is_front = |a: &Layer, b: &Layer, mask: u64| {
            mask == 0 || in_front(pattern, triangle(a.triangle), triangle(b.triangle), x, y, mask) == mask
        };
        let one_order = self.layers.windows(2).all(|pair| is_front(&pair[0], &pair[1], pattern.full))
            || (self.layers.len() <= PAIRWISE_MAX
                && (1..self.layers.len()).all(|k| {
                    self.layers[..k].iter().all(|a| is_front(a, &self.layers[k], a.mask & self.layers[k].mask))
                }));
        let mut shade = |layer: &mut Layer| {
            *layer.shaded.get_or_insert_with(|| {
                let [r, g, b, alpha] = shader.pixel_colour(faces, layer.triangle, x, y);
                [r, g, b, alpha.clamp(0.0, 1.0)].map(f64::from)
            })
        };
        if one_order && self.layers.iter().all(|l| l.mask == pattern.full) {
            let mut through = Through::CLEAR;
            for layer in &mut self.layers {
                through.add(shade(layer));
                if through.transmitted == 0.0 {
                    break;
                }
            }
            return Composed::Uniform(through);
        }
        samples[..pattern.count].fill(Through::CLEAR);
        if one_order {
            let mut open = pattern.full;
            for layer in &mut self.layers {
                let mut rest = layer.mask & open;
                if rest == 0 {
                    continue;
                }
                let colour = shade(layer);
                while rest != 0 {
                    let i = rest.trailing_zeros() as usize;
                    samples[i].add(colour);
                    open &= !(u64::from(samples[i].transmitted == 0.0) << i);
                    rest &= rest - 1;
                }
            }
        } else {
            for (i, sample) in samples[..pattern.count].iter_mut().enumerate() {
                let [dx, dy] = pattern.points[i];
                self.of_sample.clear();
                self.of_sample.extend(
                    self.layers
                        .iter()
                        .enumerate()
                        .filter(|(_, l)| l.mask >> i & 1 != 0)
                        .map(|(k, l)| (triangle(l.triangle).plane.at(x + dx, y + dy), l.order, k)),
                );
                self.of_sample.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
                for (_, _, k) in &self.of_sample {
                    sample.add(shade(&mut self.layers[*k]));
                    if sample.transmitted == 0.0 {
                        break;
                    }
                }
            }
        }
        Composed::PerSample
    }
}
