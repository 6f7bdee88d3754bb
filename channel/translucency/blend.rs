//! The light that comes through the layers of a block.
//!
//! Layers are ordered once per block, by their distance in its middle, and that order is then proven rather than trusted: two
//! layers that share a sample must lie in it all over the block (the difference of their planes, at the block's corners).
//! Where two don't, they and all between them form a *run*, and pixels where layers of a run meet are sorted on their own. So a
//! pixel meets its layers in exact order, and most pixels of a block meet them together: colours are computed and added for 16
//! pixels at a time.
//!
//! That needs a layer to be seen at all samples of the pixel. The others, on the rims of layers, keep *classes* of samples that let
//! the same light through: a layer splits the classes that it covers in part. Where the next face of the same mesh covers the
//! rest with the same saturation, the classes become one again, so that the inner edges of a mesh cost next to nothing.
//! Pixels whose layers cross within the pixel, or belong to models, are left to [`super::compose`], sample by sample.
//!
//! Which way a pixel goes depends on what is seen in its block and on nothing else.

use super::compose::{Composed, Layers, Through};
use super::gather::Layer;
use crate::frame::Frame;
use crate::geometry::setup::Flags;
use crate::raster::coverage::{BLOCK, BLOCK_PIXELS};
use crate::raster::depth::{fronts, order_over, rounding_in_block};
use crate::raster::opaque::block_corner;
use crate::raster::visible::Seen;
use crate::resolve::background::Behind;
use crate::resolve::tile::Resolved;
use crate::room::room;
use crate::samples::SUBPIXELS;
use crate::shade::tile::{Look, TileFaces};
use crate::simd::{each3, each4};
use fearless_simd::{Simd, f32x16, f64x8, mask32x16, prelude::*};
use std::ops::Range;

/// A block's light so far, and what still comes through, for pixels whose samples are alike.
#[derive(Debug)]
pub struct BlockLight {
    /// Linear RGB.
    pub rgb: [[f32; BLOCK_PIXELS]; 3],
    /// What the layers let through of what is behind them, 0 to 1.
    pub transmitted: [f32; BLOCK_PIXELS],
    /// Pixels that are finished already, in `rgb`, with what is behind them: their samples differ.
    pub finished: u64,
}

impl Default for BlockLight {
    fn default() -> Self {
        Self { rgb: [[0.0; BLOCK_PIXELS]; 3], transmitted: [1.0; BLOCK_PIXELS], finished: 0 }
    }
}

/// Samples of a pixel that let the same light through.
#[derive(Clone, Copy, Debug)]
struct Class {
    mask: u64,
    /// In f64, as are sums over a pixel's layers here: there may be a thousand.
    transmitted: f64,
}

/// A layer in some pixels of a block.
#[derive(Clone, Copy, Debug)]
struct Part {
    layer: usize,
    pixels: u64,
}

/// A layer met in a pixel.
#[derive(Clone, Copy, Debug)]
struct Met {
    layer: usize,
    mask: u64,
    q: f64,
    order: u64,
}

/// Buffers of the stage, used again.
#[derive(Debug, Default)]
pub struct Blender {
    /// For each layer the first of its run.
    run_starts: Vec<usize>,
    /// Colours of the block's layers in its pixels, of those that are asked for one by one.
    colours: Vec<[[f32; BLOCK_PIXELS]; 3]>,
    /// Their saturations.
    alphas: Vec<[f32; BLOCK_PIXELS]>,
    parts: Vec<Part>,
    met: Vec<Met>,
    ordered: Vec<Met>,
    classes: Vec<Class>,
    /// What is behind a pixel's layers.
    behind: Vec<Seen>,
    compose: Layers,
    samples: Option<Box<[Through; 64]>>,
}

room!(Blender: run_starts, colours, alphas, parts, met, ordered, classes, behind, compose, samples;);

impl Blender {
    /// Computes the light of a block; its layers have been sorted.
    #[inline(always)]
    pub fn blend<S: Simd>(
        &mut self,
        simd: S,
        tile: Resolved<'_>,
        block: usize,
        faces: &mut TileFaces,
        out: &mut BlockLight,
    ) {
        let layers = tile.layers.block(block);
        let mut mixed = 0;
        let mut flags = 0;
        let mut all = 0;
        for layer in layers {
            mixed |= layer.touched & !layer.full;
            all |= layer.touched;
            flags |= layer.flags.0;
        }
        out.rgb = [[0.0; BLOCK_PIXELS]; 3];
        out.transmitted = [1.0; BLOCK_PIXELS];
        let is_modelled = Flags(flags).has(Flags::PART);
        if is_modelled {
            mixed = all;
        } else {
            self.find_runs(tile, block);
            mixed = self.order_block(simd, tile, block, mixed);
            self.blend_uniform(simd, tile, block, faces, mixed, out);
        }
        out.finished = mixed;
        let mut rest = mixed;
        while rest != 0 {
            let bit = rest.trailing_zeros();
            rest &= rest - 1;
            let rgb = if is_modelled {
                self.by_samples(tile, block, bit, faces)
            } else {
                self.by_classes(simd, tile, block, bit, faces)
            };
            for c in 0..3 {
                out.rgb[c][bit as usize] = rgb[c];
            }
        }
    }

    /// Finds which neighbours in the order aren't proven to be in it.
    #[inline(always)]
    fn find_runs(&mut self, tile: Resolved<'_>, block: usize) {
        let layers = tile.layers.block(block);
        self.run_starts.clear();
        let mut least = f32::INFINITY;
        for (j, layer) in layers.iter().enumerate() {
            self.run_starts.push(j);
            // NaN is less than nothing: then all are compared.
            let is_clear = layer.high < least;
            if !is_clear {
                for (i, before) in layers[..j].iter().enumerate() {
                    let is_behind = layer.high < before.low;
                    if !is_behind && before.touched & layer.touched != 0 && !in_order(tile, block, before, layer) {
                        // All between belong to the run as well.
                        let start = self.run_starts[i];
                        self.run_starts[start..=j].fill(start);
                        break;
                    }
                }
            }
            least = if layer.low < least { layer.low } else { least };
        }
    }

    /// Puts the layers of the block's runs in an order that holds in every pixel beside those of `mixed`, in parts where they
    /// change places from pixel to pixel; returns `mixed` with the pixels in which they do so from sample to sample.
    #[inline(always)]
    fn order_block<S: Simd>(&mut self, simd: S, tile: Resolved<'_>, block: usize, mut mixed: u64) -> u64 {
        let layers = tile.layers.block(block);
        let corner = block_corner(tile.rect, block);
        self.parts.clear();
        let mut run_begin = 0;
        for (k, layer) in layers.iter().enumerate() {
            if self.run_starts[k] == k {
                run_begin = self.parts.len();
            }
            let mut left = layer.touched;
            // One after the other goes to its place: in each pixel before the first that it is in front of. What is in place is
            // in order in each pixel, so that it is in front of the rest as well.
            let mut at = run_begin;
            while at < self.parts.len() && left != 0 {
                let other = self.parts[at];
                let both = other.pixels & left & !mixed;
                if both != 0 {
                    let before = &layers[other.layer];
                    let (front, unsure) = fronts_of_pixels(simd, tile.frame, layer, before, corner, both);
                    mixed |= unsure;
                    if front != 0 {
                        self.parts.insert(at, Part { layer: k, pixels: front });
                        left &= !front;
                        at += 1;
                    }
                }
                at += 1;
            }
            if left != 0 {
                self.parts.push(Part { layer: k, pixels: left });
            }
        }
        mixed
    }

    /// The pixels that aren't `mixed`, part by part.
    #[inline(always)]
    fn blend_uniform<S: Simd>(
        &mut self,
        simd: S,
        tile: Resolved<'_>,
        block: usize,
        faces: &mut TileFaces,
        mixed: u64,
        out: &mut BlockLight,
    ) {
        let layers = tile.layers.block(block);
        if self.colours.len() < layers.len() {
            self.colours.resize(layers.len(), [[0.0; BLOCK_PIXELS]; 3]);
            self.alphas.resize(layers.len(), [0.0; BLOCK_PIXELS]);
        }
        let mut computed = 0;
        for part in &self.parts {
            let k = part.layer;
            let layer = &layers[k];
            let is_alone = self.run_starts[k] == k && self.run_starts.get(k + 1).is_none_or(|next| *next != k);
            if is_alone {
                let (colours, alpha) = colours(simd, tile, block, layer, faces);
                add(simd, out, layer.touched & !mixed, &colours, &alpha);
                if layer.touched & mixed != 0 {
                    store(simd, &colours, &alpha, &mut self.colours[k], &mut self.alphas[k]);
                }
                continue;
            }
            // Parts of a layer come after those of all runs before its own.
            while computed <= k || self.run_starts.get(computed).is_some_and(|start| *start == self.run_starts[k]) {
                if self.run_starts[computed] == self.run_starts[k] {
                    let (colours, alpha) = colours(simd, tile, block, &layers[computed], faces);
                    store(simd, &colours, &alpha, &mut self.colours[computed], &mut self.alphas[computed]);
                }
                computed += 1;
            }
            let (colours, alpha) = load(simd, &self.colours[k], &self.alphas[k]);
            add(simd, out, part.pixels & !mixed, &colours, &alpha);
        }
    }

    /// A pixel whose layers aren't seen at all samples alike, in the order of the block where that is proven.
    #[inline(always)]
    fn by_classes<S: Simd>(
        &mut self,
        simd: S,
        tile: Resolved<'_>,
        block: usize,
        bit: u32,
        faces: &mut TileFaces,
    ) -> [f32; 3] {
        let layers = tile.layers.block(block);
        let frame = tile.frame;
        let full = frame.pattern.full;
        let [x, y] = corner_of(tile, block, bit);
        self.met.clear();
        for (k, layer) in layers.iter().enumerate() {
            if layer.touched >> bit & 1 != 0 {
                let mask = tile.layers.mask(layer, bit, full);
                self.met.push(Met { layer: k, mask, q: layer.q, order: layer.order });
            }
        }
        self.order_pixel(simd, tile, block, [x, y]);
        let mut rgb = [0.0f64; 3];
        self.classes.clear();
        self.classes.push(Class { mask: full, transmitted: 1.0 });
        for met in &self.met {
            let (layer, mask) = (&layers[met.layer], met.mask);
            // What covers the centre is shaded there, and that has been done.
            let [r, g, b, alpha] = if layer.centre >> bit & 1 != 0 {
                let (colours, i) = (&self.colours[met.layer], bit as usize);
                [colours[0][i], colours[1][i], colours[2][i], self.alphas[met.layer][i]]
            } else {
                let [r, g, b, alpha] = faces.colour(frame, tile.rect, layer.place, layer.number, [x, y]);
                [r, g, b, saturation(alpha)]
            };
            let alpha = f64::from(alpha);
            let mut weight = 0.0;
            for k in 0..self.classes.len() {
                let class = self.classes[k];
                let both = class.mask & mask;
                if both == 0 {
                    continue;
                }
                weight += class.transmitted * alpha * f64::from(both.count_ones());
                let transmitted = class.transmitted * (1.0 - alpha);
                if both == class.mask {
                    self.classes[k].transmitted = transmitted;
                } else {
                    self.classes[k].mask &= !mask;
                    self.classes.push(Class { mask: both, transmitted });
                }
            }
            for (sum, c) in rgb.iter_mut().zip([r, g, b]) {
                *sum += f64::from(c) * weight;
            }
            join_classes(&mut self.classes);
            if self.classes.len() == 1 && self.classes[0].transmitted == 0.0 {
                break;
            }
        }
        let pixel = block * BLOCK_PIXELS + bit as usize;
        let mut open = full;
        let mut add = |mask: u64, colour: [f32; 3]| {
            for class in &self.classes {
                let weight = class.transmitted * f64::from((class.mask & mask).count_ones());
                for c in 0..3 {
                    rgb[c] += f64::from(colour[c]) * weight;
                }
            }
        };
        self.behind.clear();
        self.behind.extend(tile.visible.seen(pixel));
        // In the order of their first samples: the order in which they were found has no say.
        self.behind.sort_unstable_by_key(|seen| seen.mask.trailing_zeros());
        for seen in &self.behind {
            let number = tile.numbers[seen.triangle as usize];
            let [r, g, b, _] = faces.colour(frame, tile.rect, seen.triangle, number, [x, y]);
            add(seen.mask, [r, g, b]);
            open &= !seen.mask;
        }
        if open != 0 {
            match faces.behind(frame, [x, y]) {
                Behind::Constant(colour) => add(open, colour),
                sky => {
                    let mut rest = open;
                    while rest != 0 {
                        let i = rest.trailing_zeros() as usize;
                        add(rest & rest.wrapping_neg(), sky.at(frame.camera, frame.pattern.points[i]));
                        rest &= rest - 1;
                    }
                }
            }
        }
        let share = 1.0 / frame.pattern.count as f64;
        each3(rgb, |c| (c * share) as f32)
    }

    /// Puts the layers met in the pixel whose upper left is (x, y) sub in an order that holds at every sample that two of
    /// them share; layers that cross within the pixel are met in parts.
    #[inline(always)]
    fn order_pixel<S: Simd>(&mut self, simd: S, tile: Resolved<'_>, block: usize, corner: [i32; 2]) {
        // Between runs the block's order holds. Within one it must be looked at if layers share a sample.
        let mut start = 0;
        while start < self.met.len() {
            let run = self.run_starts[self.met[start].layer];
            let mut end = start;
            let (mut once, mut twice) = (0, 0);
            while end < self.met.len() && self.run_starts[self.met[end].layer] == run {
                twice |= once & self.met[end].mask;
                once |= self.met[end].mask;
                end += 1;
            }
            if twice != 0 {
                end = self.order_run(simd, tile, block, start..end, corner);
            }
            start = end;
        }
    }

    /// The same for some of the layers met, which are of one run; returns where they end now.
    #[inline(always)]
    fn order_run<S: Simd>(
        &mut self,
        simd: S,
        tile: Resolved<'_>,
        block: usize,
        range: Range<usize>,
        [x, y]: [i32; 2],
    ) -> usize {
        let frame = tile.frame;
        let layers = tile.layers.block(block);
        let centre = SUBPIXELS / 2;
        let met = &mut self.met[range.clone()];
        for met in met.iter_mut() {
            met.q = frame.triangle(layers[met.layer].number).plane().at(x + centre, y + centre);
        }
        met.sort_unstable_by(|a, b| b.q.total_cmp(&a.q).then(b.order.cmp(&a.order)));
        // One after the other goes to its place: at each sample before the first that it is in front of. What is in place is
        // in order at each sample, so that it is in front of the rest as well.
        self.ordered.clear();
        for own in met.iter() {
            let triangle = frame.triangle(layers[own.layer].number);
            let mut left = own.mask;
            let mut at = 0;
            while at < self.ordered.len() && left != 0 {
                let other = self.ordered[at];
                let both = other.mask & left;
                let front = if both == 0 {
                    0
                } else {
                    let wins_ties = || own.order > other.order;
                    let other = frame.triangle(layers[other.layer].number);
                    fronts(simd, frame.pattern, triangle, other, x, y, both, wins_ties)
                };
                if front != 0 {
                    self.ordered.insert(at, Met { mask: front, ..*own });
                    left &= !front;
                    at += 1;
                }
                at += 1;
            }
            if left != 0 {
                self.ordered.push(Met { mask: left, ..*own });
            }
        }
        let end = range.start + self.ordered.len();
        self.met.splice(range, self.ordered.drain(..));
        end
    }

    /// A pixel sample by sample.
    #[inline(never)]
    fn by_samples(&mut self, tile: Resolved<'_>, block: usize, bit: u32, faces: &mut TileFaces) -> [f32; 3] {
        let frame = tile.frame;
        let pattern = frame.pattern;
        let corner = corner_of(tile, block, bit);
        let pixel = block * BLOCK_PIXELS + bit as usize;
        let mut behind = [[0.0f32; 3]; 64];
        let mut open = pattern.full;
        let mut fill = |mut rest: u64, colour: &dyn Fn(usize) -> [f32; 3]| {
            while rest != 0 {
                let i = rest.trailing_zeros() as usize;
                behind[i] = colour(i);
                rest &= rest - 1;
            }
        };
        for seen in tile.visible.seen(pixel) {
            let number = tile.numbers[seen.triangle as usize];
            let [r, g, b, _] = faces.colour(frame, tile.rect, seen.triangle, number, corner);
            open &= !seen.mask;
            fill(seen.mask, &|_| [r, g, b]);
        }
        if open != 0 {
            let sky = faces.behind(frame, corner);
            fill(open, &|i| sky.at(frame.camera, pattern.points[i]));
        }
        let fragments = tile.layers.of_pixel(block, bit, pattern.full);
        let samples = self.samples.get_or_insert_with(|| Box::new([Through { rgb: [0.0; 3], transmitted: 1.0 }; 64]));
        let composed = self.compose.compose(tile, faces, corner, fragments, samples);
        let mut sum = [0.0f64; 3];
        for (behind, sample) in behind[..pattern.count].iter().zip(samples.iter()) {
            let through = match &composed {
                Composed::Uniform(through) => through,
                Composed::PerSample => sample,
            };
            let colour = through.over(*behind);
            for c in 0..3 {
                sum[c] += colour[c];
            }
        }
        let share = 1.0 / pattern.count as f64;
        each3(sum, |c| (c * share) as f32)
    }
}

/// Classes that let the same light through become one.
#[inline(always)]
fn join_classes(classes: &mut Vec<Class>) {
    let mut k = 1;
    while k < classes.len() {
        let class = classes[k];
        match classes[..k].iter().position(|other| other.transmitted.to_bits() == class.transmitted.to_bits()) {
            Some(other) => {
                classes[other].mask |= class.mask;
                classes.swap_remove(k);
            }
            None => k += 1,
        }
    }
}

/// The pixels of `both` in which `a` is in front of `b` at all samples, and those in which that isn't sure.
#[inline(always)]
fn fronts_of_pixels<S: Simd>(
    simd: S,
    frame: &Frame<'_>,
    a: &Layer,
    b: &Layer,
    [x, y]: [i32; 2],
    both: u64,
) -> (u64, u64) {
    const COLUMNS: [f64; 8] = [128.0, 384.0, 640.0, 896.0, 1152.0, 1408.0, 1664.0, 1920.0];
    let (pa, pb) = (frame.triangle(a.number).plane(), frame.triangle(b.number).plane());
    let wins_ties = a.order > b.order;
    if pa == pb {
        return (if wins_ties { both } else { 0 }, 0);
    }
    let splat = |c: f64| f64x8::splat(simd, c);
    // How far their difference may go from a pixel's centre to its samples.
    let reach = if frame.pattern.count == 1 {
        None
    } else {
        let half = f64::from(SUBPIXELS / 2 - frame.pattern.low);
        Some(splat(half * ((pa.dx - pb.dx).abs() + (pa.dy - pb.dy).abs()) + rounding_in_block(&pa, &pb, x, y)))
    };
    let columns = f64x8::simd_from(simd, COLUMNS);
    let (fxa, fxb) = (columns + f64::from(x - pa.x), columns + f64::from(x - pb.x));
    let (gxa, gxb) = (fxa * pa.dx, fxb * pb.dx);
    let (mut front, mut unsure) = (0, 0);
    for row in 0..8 {
        if both >> (row * 8) & 0xff == 0 {
            continue;
        }
        let py = y + row * SUBPIXELS + SUBPIXELS / 2;
        let qa = (gxa + f64::from(py - pa.y) * pa.dy) + splat(pa.q);
        let qb = (gxb + f64::from(py - pb.y) * pb.dy) + splat(pb.q);
        let wins = match reach {
            None => {
                if wins_ties {
                    qa.simd_ge(qb)
                } else {
                    qa.simd_gt(qb)
                }
            }
            Some(reach) => {
                let ahead = qa - qb;
                let behind = ahead.simd_lt(splat(0.0) - reach);
                let wins = ahead.simd_gt(reach);
                unsure |= (!(behind | wins)).to_bitmask() << (row * 8);
                wins
            }
        };
        front |= wins.to_bitmask() << (row * 8);
    }
    (front & both, unsure & both)
}

/// Whether `front` is in front of `back` wherever they share a sample in the block.
#[inline(always)]
fn in_order(tile: Resolved<'_>, block: usize, front: &Layer, back: &Layer) -> bool {
    let (a, b) = (tile.frame.triangle(front.number).plane(), tile.frame.triangle(back.number).plane());
    let [x, y] = block_corner(tile.rect, block);
    match order_over(&a, &b, x, y, BLOCK as i32 * SUBPIXELS) {
        Some(true) => true,
        // One plane of the scene: equally near everywhere, and sorted by their order.
        None if a == b => true,
        Some(false) | None => !share_samples(tile, front, back),
    }
}

/// Whether two layers are seen at one sample.
#[inline(always)]
fn share_samples(tile: Resolved<'_>, a: &Layer, b: &Layer) -> bool {
    let common = a.touched & b.touched;
    if common & (a.full | b.full) != 0 {
        return true;
    }
    let mut rest = common;
    while rest != 0 {
        let bit = rest.trailing_zeros();
        rest &= rest - 1;
        if tile.layers.mask(a, bit, u64::MAX) & tile.layers.mask(b, bit, u64::MAX) != 0 {
            return true;
        }
    }
    false
}

/// Upper left of a block's pixel, sub.
#[inline(always)]
fn corner_of(tile: Resolved<'_>, block: usize, bit: u32) -> [i32; 2] {
    let [x, y] = block_corner(tile.rect, block);
    [x + (bit % BLOCK) as i32 * SUBPIXELS, y + (bit / BLOCK) as i32 * SUBPIXELS]
}

/// Saturations are in 0..=1; NaN counts as 0.
#[inline(always)]
fn saturation(alpha: f32) -> f32 {
    let alpha = if alpha > 0.0 { alpha } else { 0.0 };
    if alpha < 1.0 { alpha } else { 1.0 }
}

/// Puts a layer's colours and saturations aside.
#[inline(always)]
fn store<S: Simd>(
    simd: S,
    colours: &[[f32x16<S>; 4]; 3],
    alpha: &Alpha,
    to: &mut [[f32; BLOCK_PIXELS]; 3],
    alphas: &mut [f32; BLOCK_PIXELS],
) {
    for c in 0..3 {
        for group in 0..4 {
            colours[c][group].store_slice(&mut to[c][group * 16..group * 16 + 16]);
        }
    }
    match alpha {
        Alpha::One(alpha) => {
            for group in 0..4 {
                f32x16::splat(simd, *alpha).store_slice(&mut alphas[group * 16..group * 16 + 16]);
            }
        }
        Alpha::Each(each) => *alphas = *each,
    }
}

/// And takes them up again.
#[inline(always)]
fn load<S: Simd>(
    simd: S,
    from: &[[f32; BLOCK_PIXELS]; 3],
    alphas: &[f32; BLOCK_PIXELS],
) -> ([[f32x16<S>; 4]; 3], Alpha) {
    let colours = each3(from.each_ref(), |c| each4([0, 16, 32, 48], |at| f32x16::from_slice(simd, &c[at..at + 16])));
    (colours, Alpha::Each(*alphas))
}

/// A face's colour in a pixel in general.
fn general(tile: Resolved<'_>, block: usize, layer: &Layer, faces: &mut TileFaces, bit: u32) -> [f32; 4] {
    faces.colour(tile.frame, tile.rect, layer.place, layer.number, corner_of(tile, block, bit))
}

/// Saturation of a layer in 16 pixels of each of the block's four groups.
#[derive(Clone, Copy)]
#[expect(clippy::large_enum_variant, reason = "one at a time, on the stack")]
enum Alpha {
    One(f32),
    Each([f32; BLOCK_PIXELS]),
}

/// Linear RGB and saturation of a layer in the pixels of a block whose centres it covers.
#[inline(always)]
fn colours<S: Simd>(
    simd: S,
    tile: Resolved<'_>,
    block: usize,
    layer: &Layer,
    faces: &mut TileFaces,
) -> ([[f32x16<S>; 4]; 3], Alpha) {
    match faces.look(tile.frame, tile.rect, layer.place, layer.number) {
        Look::Constant([r, g, b, alpha], _) => {
            (each3([r, g, b], |c| [f32x16::splat(simd, c); 4]), Alpha::One(saturation(alpha)))
        }
        Look::ByNormal(index) => {
            let face = faces.by_normal(index);
            (face.block(simd, tile.frame, block, layer.touched), Alpha::One(saturation(face.alpha())))
        }
        Look::General => {
            let mut each = [[0.0f32; BLOCK_PIXELS]; 4];
            let mut rest = layer.centre;
            while rest != 0 {
                let bit = rest.trailing_zeros();
                rest &= rest - 1;
                let colour = general(tile, block, layer, faces, bit);
                for c in 0..4 {
                    each[c][bit as usize] = colour[c];
                }
                each[3][bit as usize] = saturation(colour[3]);
            }
            let [r, g, b, alphas] = each;
            load(simd, &[r, g, b], &alphas)
        }
    }
}

/// Adds a layer behind those before it.
#[inline(always)]
fn add<S: Simd>(simd: S, out: &mut BlockLight, pixels: u64, colours: &[[f32x16<S>; 4]; 3], alpha: &Alpha) {
    for group in 0..4 {
        let bits = pixels >> (group * 16) & 0xffff;
        if bits == 0 {
            continue;
        }
        let range = group * 16..group * 16 + 16;
        let alpha = match alpha {
            Alpha::One(alpha) => f32x16::splat(simd, *alpha),
            Alpha::Each(each) => f32x16::from_slice(simd, &each[range.clone()]),
        };
        let transmitted = f32x16::from_slice(simd, &out.transmitted[range.clone()]);
        // What isn't touched lets everything through.
        let alpha = mask32x16::from_bitmask(simd, bits).select(alpha, f32x16::splat(simd, 0.0));
        let part = alpha * transmitted;
        (transmitted * (f32x16::splat(simd, 1.0) - alpha)).store_slice(&mut out.transmitted[range.clone()]);
        for c in 0..3 {
            let to = &mut out.rgb[c][range.clone()];
            // Colours of pixels that aren't touched are finite: they count zero times.
            (f32x16::from_slice(simd, to) + colours[c][group] * part).store_slice(to);
        }
    }
}
