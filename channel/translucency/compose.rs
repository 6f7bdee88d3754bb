//! What the samples of one pixel see through its fragments.
//!
//! A fragment's colour and saturation are computed once per pixel, when first needed, and only if something in front of
//! it still lets light through. The order of the layers is mostly the same at all samples of a pixel; that is checked, not
//! assumed, by comparing neighbours in the order exactly, and where it isn't (panes that cross, or bound on each other)
//! each sample sorts its own.

use super::gather::Fragment;
use super::models::Mix;
use crate::frame::Frame;
use crate::geometry::setup::{Flags, Triangle};
use crate::raster::depth::in_front;
use crate::resolve::tile::Resolved;
use crate::room::room;
use crate::shade::tile::TileFaces;

/// Up to this many fragments are compared pair by pair when comparing neighbours wasn't enough. A guess: the pairs then
/// cost about as much as sorting each sample.
const PAIRWISE_MAX: usize = 16;

/// A fragment with what sorting and mixing need.
#[derive(Clone, Copy, Debug)]
struct Layer {
    /// The triangle's place in the tile's list, and its number.
    place: u32,
    number: u32,
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
    mix: Mix,
    /// Masks of samples that see the same layers.
    kinds: Vec<u64>,
}

room!(Layers: layers, of_sample, mix, kinds;);

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
        tile: Resolved<'_>,
        faces: &mut TileFaces,
        [x, y]: [i32; 2],
        fragments: impl Iterator<Item = Fragment>,
        samples: &mut [Through; 64],
    ) -> Composed {
        let Resolved { frame, rect, numbers, .. } = tile;
        let pattern = frame.pattern;
        let triangle = |number: u32| -> &Triangle { frame.triangle(number) };
        let mut flags = 0;
        self.layers.clear();
        self.layers.extend(fragments.map(|f| {
            let number = numbers[f.triangle as usize];
            let t = triangle(number);
            flags |= t.flags.0;
            let q_centre = t.plane().at(x + 128, y + 128);
            Layer { place: f.triangle, number, mask: f.mask, q_centre, order: frame.order(number), shaded: None }
        }));
        // Nearest first; equally near: the larger order first. The order of the list has no say.
        self.layers.sort_unstable_by(|a, b| b.q_centre.total_cmp(&a.q_centre).then(b.order.cmp(&a.order)));
        let is_front = |a: &Layer, b: &Layer, mask: u64| {
            mask == 0
                || in_front(pattern, triangle(a.number), triangle(b.number), x, y, mask, || a.order > b.order) == mask
        };
        let one_order = self.layers.windows(2).all(|pair| is_front(&pair[0], &pair[1], pattern.full))
            || (self.layers.len() <= PAIRWISE_MAX
                && (1..self.layers.len()).all(|k| {
                    self.layers[..k].iter().all(|a| is_front(a, &self.layers[k], a.mask & self.layers[k].mask))
                }));
        if Flags(flags).has(Flags::PART) {
            return self.compose_models(tile, faces, [x, y], one_order, samples);
        }
        let mut shade = |layer: &mut Layer| {
            *layer.shaded.get_or_insert_with(|| {
                let [r, g, b, alpha] = faces.colour(frame, rect, layer.place, layer.number, [x, y]);
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
                sort_sample(&mut self.of_sample, &self.layers, frame, [x, y], i);
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

    /// The same where fragments belong to models; the layers are there, in the order of the pixel's centre, which is that of all
    /// samples if there is `one_order`.
    fn compose_models(
        &mut self,
        tile: Resolved<'_>,
        faces: &mut TileFaces,
        [x, y]: [i32; 2],
        one_order: bool,
        samples: &mut [Through; 64],
    ) -> Composed {
        let Resolved { frame, rect, .. } = tile;
        let pattern = frame.pattern;
        let mut step = |mix: &mut Mix, layer: &mut Layer| {
            let item = &frame.items[frame.triangle(layer.number).item as usize];
            let part = item.part.as_ref();
            let is_translucent = item.is_translucent();
            if part.is_some_and(|part| mix.is_lost(part, is_translucent)) {
                return;
            }
            let colour = *layer.shaded.get_or_insert_with(|| {
                let [r, g, b, alpha] = faces.colour(frame, rect, layer.place, layer.number, [x, y]);
                // Opaque surfaces ignore alpha; of cut-out ones only what reaches the cut-off is here.
                let alpha = if is_translucent { alpha.clamp(0.0, 1.0) } else { 1.0 };
                [r, g, b, alpha].map(f64::from)
            });
            mix.add(part, is_translucent, colour);
        };
        if !one_order {
            for (i, sample) in samples[..pattern.count].iter_mut().enumerate() {
                sort_sample(&mut self.of_sample, &self.layers, frame, [x, y], i);
                self.mix.clear();
                for (_, _, k) in &self.of_sample {
                    step(&mut self.mix, &mut self.layers[*k]);
                    if self.mix.transmitted() == 0.0 {
                        break;
                    }
                }
                *sample = self.mix.through();
            }
            return Composed::PerSample;
        }
        // Samples that see the same layers see the same light: one computation for each kind of sample.
        self.kinds.clear();
        self.kinds.push(pattern.full);
        for layer in &self.layers {
            for k in 0..self.kinds.len() {
                let (with, without) = (self.kinds[k] & layer.mask, self.kinds[k] & !layer.mask);
                if with != 0 && without != 0 {
                    self.kinds[k] = with;
                    self.kinds.push(without);
                }
            }
        }
        for kind in &self.kinds {
            self.mix.clear();
            for layer in self.layers.iter_mut().filter(|layer| layer.mask & kind != 0) {
                step(&mut self.mix, layer);
                if self.mix.transmitted() == 0.0 {
                    break;
                }
            }
            let through = self.mix.through();
            if *kind == pattern.full {
                return Composed::Uniform(through);
            }
            let mut rest = *kind;
            while rest != 0 {
                samples[rest.trailing_zeros() as usize] = through;
                rest &= rest - 1;
            }
        }
        Composed::PerSample
    }
}

/// The layers at sample i of the pixel whose upper left is (x, y) sub, nearest first.
fn sort_sample(
    of_sample: &mut Vec<(f64, u64, usize)>,
    layers: &[Layer],
    frame: &Frame<'_>,
    [x, y]: [i32; 2],
    i: usize,
) {
    let [dx, dy] = frame.pattern.points[i];
    let q = |layer: &Layer| frame.triangle(layer.number).plane().at(x + dx, y + dy);
    of_sample.clear();
    of_sample.extend(layers.iter().enumerate().filter(|(_, l)| l.mask >> i & 1 != 0).map(|(k, l)| (q(l), l.order, k)));
    of_sample.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
}
