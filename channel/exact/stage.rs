//! The exact stage of a tile: which pixels need areas, and which faces they are computed from.
//!
//! A tile is drawn with 64 points first. Where one face covers a pixel and nothing else comes near it, or several do one behind
//! the other, every point of the pixel sees the same, and that is the integral. The other pixels are found here and computed
//! anew from the areas of their faces by the [`Integrator`].
//!
//! "Near" and "covers" are meant with a margin ([`crate::samples::EXACT_MARGIN`]): coverage is asked of corners rounded to 1/256
//! pixel, areas of corners rounded to 1/65 536.
//!
//! 1. Every opaque face enters the lower bound of its inverse distance into the pixels that it covers with the margin; the
//!    largest is kept: the *cover*.
//! 2. Every face is a *candidate* of the pixels that it touches with the margin, unless the upper bound there is below the cover.
//! 3. Pixels with more than one candidate, or one that doesn't cover them, are integrated, unless all candidates cover them and none
//!    crosses another.
//!
//! So the candidates of a pixel are a function of all faces of the tile and nothing else; the steps that save work leave out
//! only what the bounds would have left out pixel by pixel, to the bit. The integral doesn't depend on their order. Hence the
//! same bytes for any list, share and thread.
//!
//! A face has one colour in a pixel ([`crate::shade`]). The sky is one colour as well: its mean over what is let through of the
//! 64 points. A pixel stays as the points have it if a candidate has holes by its texture or vertex colours (MASK), or if the
//! range of visibility ends in it.

use super::{ExactFace, Integrator, Part};
use crate::frame::Frame;
use crate::geometry::fine::FineFace;
use crate::geometry::setup::{Flags, Triangle};
use crate::geometry::transform::Item;
use crate::raster::coverage::{BLOCK, BLOCK_PIXELS, BLOCKS, Edges, TILE_PIXELS, TileCover, TileExtent};
use crate::raster::depth::{BlockDepth, order_over};
use crate::raster::opaque::{block_corner, nearest_in_block, pixel_corner, pixels_of_view};
use crate::resolve::background::Behind;
use crate::resolve::tile::{Resolved, TileOutput};
use crate::room::{emptied, room};
use crate::samples::SUBPIXELS;
use crate::shade::tile::TileFaces;
use crate::simd::each4;
use fearless_simd::{Simd, f32x16, mask32x16, prelude::*};
use proto::frame::PixelRect;

/// Up to so many faces that cover a pixel are compared in pairs where their bounds overlap. A guess.
const COMPARED_MAX: usize = 8;

/// A face that may be seen in a block.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// The triangle's place in the tile's list.
    place: u32,
    /// Pixels that it touches.
    touched: u64,
    /// Of these, those that it covers.
    full: u64,
    /// Bounds of its inverse distance at the block's first pixel.
    base: [f32; 2],
    depth: BlockDepth,
}

/// A face that was not asked for yet.
const UNKNOWN: u32 = u32::MAX;
/// A face without an area.
const NO_AREA: u32 = u32::MAX - 1;

/// Buffers of the stage, used again.
#[derive(Debug)]
pub struct ExactScratch {
    /// By pixel: something opaque covers it that isn't farther.
    covers: Box<[f32; TILE_PIXELS]>,
    /// By block: the least of its covers.
    far: [f32; BLOCKS],
    /// By block.
    blocks: [Vec<Candidate>; BLOCKS],
    pixels: PixelCandidates,
    /// By place in the tile's list: index into `fine`.
    known: Vec<u32>,
    fine: Vec<FineFace>,
    bounds: Vec<[f32; 2]>,
    integrator: Integrator,
    /// Always empty; only its room is used again.
    faces: Vec<ExactFace<'static>>,
}

room!(ExactScratch: blocks, pixels, known, fine, bounds, integrator, faces; covers, far);

impl Default for ExactScratch {
    fn default() -> Self {
        Self {
            covers: Box::new([f32::NEG_INFINITY; TILE_PIXELS]),
            far: [f32::NEG_INFINITY; BLOCKS],
            blocks: std::array::from_fn(|_| Vec::new()),
            pixels: PixelCandidates::default(),
            known: Vec::new(),
            fine: Vec::new(),
            bounds: Vec::new(),
            integrator: Integrator::default(),
            faces: Vec::new(),
        }
    }
}

/// Computes the pixels of a tile that points don't give exactly, and writes them over what is in `out`. The first `opaque` of the
/// tile's triangles are not fragments. Returns how many it
/// computed, and in how many of these the integrator had to fall back on points.
#[inline(always)]
pub fn integrate_tile<S: Simd>(
    simd: S,
    tile: Resolved<'_>,
    opaque: usize,
    faces: &mut TileFaces,
    scratch: &mut ExactScratch,
    out: &mut TileOutput<'_>,
) -> [u64; 2] {
    let before = scratch.integrator.counts().sampled;
    scratch.begin(tile.numbers.len());
    scratch.cover(simd, tile.frame, tile.rect, &tile.numbers[..opaque]);
    scratch.gather(simd, tile.frame, tile.rect, tile.numbers);
    let pixels = scratch.finish(tile, faces, out);
    [pixels, scratch.integrator.counts().sampled - before]
}

impl ExactScratch {
    fn begin(&mut self, faces: usize) {
        self.covers.fill(f32::NEG_INFINITY);
        self.far = [f32::NEG_INFINITY; BLOCKS];
        self.blocks.iter_mut().for_each(Vec::clear);
        self.known.clear();
        self.known.resize(faces, UNKNOWN);
        self.fine.clear();
    }

    /// Step 1.
    #[inline(always)]
    fn cover<S: Simd>(&mut self, simd: S, frame: &Frame<'_>, rect: PixelRect, numbers: &[u32]) {
        for &number in numbers {
            let triangle = frame.triangle(number);
            if has_holes(triangle) {
                continue;
            }
            let Some(extent) = TileExtent::new(frame.pattern, triangle, rect) else { continue };
            let cover = TileCover::new(frame.pattern, triangle, rect);
            let depth = BlockDepth::new(frame.pattern, &triangle.plane(), block_corner(rect, 0));
            for block in extent.blocks() {
                let base = depth.at(block);
                if nearest_in_block(&depth, base) < self.far[block] {
                    continue;
                }
                let full = cover.block(simd, block, extent.rows(block)).full;
                if full == 0 {
                    continue;
                }
                let gains = depth.lattice(simd);
                let covers = &mut self.covers[block * BLOCK_PIXELS..][..BLOCK_PIXELS];
                let mut least = f32x16::splat(simd, f32::INFINITY);
                for (group, gain) in gains.iter().enumerate() {
                    let covers = &mut covers[group * 16..][..16];
                    let before = f32x16::from_slice(simd, covers);
                    let low = *gain + base[0];
                    let inside = mask32x16::from_bitmask(simd, full >> (group * 16) & 0xffff);
                    // NaN compares as not nearer.
                    let after = (inside & low.simd_gt(before)).select(low, before);
                    after.store_slice(covers);
                    least = least.min(after);
                }
                self.far[block] = least.reduce_min();
            }
        }
    }

    /// Step 2.
    #[inline(always)]
    fn gather<S: Simd>(&mut self, simd: S, frame: &Frame<'_>, rect: PixelRect, numbers: &[u32]) {
        let valid = pixels_of_view(rect);
        for (place, &number) in numbers.iter().enumerate() {
            let triangle = frame.triangle(number);
            let Some(extent) = TileExtent::new(frame.pattern, triangle, rect) else { continue };
            let cover = TileCover::new(frame.pattern, triangle, rect);
            let depth = BlockDepth::new(frame.pattern, &triangle.plane(), block_corner(rect, 0));
            for block in extent.blocks() {
                let base = depth.at(block);
                if nearest_in_block(&depth, base) < self.far[block] {
                    continue;
                }
                let covered = cover.block(simd, block, extent.rows(block));
                let mut touched = covered.touched & valid[block] & within(frame, triangle, block_corner(rect, block));
                if touched == 0 {
                    continue;
                }
                let gains = depth.lattice(simd);
                let covers = &self.covers[block * BLOCK_PIXELS..][..BLOCK_PIXELS];
                for (group, gain) in gains.iter().enumerate() {
                    let high = *gain + base[1];
                    // NaN compares as not hidden.
                    let hidden = high.simd_lt(f32x16::from_slice(simd, &covers[group * 16..][..16]));
                    touched &= !(hidden.to_bitmask() << (group * 16));
                }
                if touched != 0 {
                    let full = if has_holes(triangle) { 0 } else { covered.full & touched };
                    self.blocks[block].push(Candidate { place: place as u32, touched, full, base, depth });
                }
            }
        }
    }

    /// Step 3.
    #[inline(never)]
    fn finish(&mut self, tile: Resolved<'_>, faces: &mut TileFaces, out: &mut TileOutput<'_>) -> u64 {
        let mut exact: Vec<ExactFace<'_>> = std::mem::take(&mut self.faces);
        let mut pixels = 0;
        for block in 0..BLOCKS {
            let (mut once, mut twice, mut partly) = (0, 0, 0);
            for candidate in &self.blocks[block] {
                twice |= once & candidate.touched;
                once |= candidate.touched;
                partly |= candidate.touched & !candidate.full;
            }
            let mut rest = twice | partly;
            if rest == 0 {
                continue;
            }
            self.pixels.set(&self.blocks[block], rest);
            while rest != 0 {
                let bit = rest.trailing_zeros();
                rest &= rest - 1;
                if partly >> bit & 1 == 0 && self.is_ordered(tile, block, bit) {
                    continue;
                }
                if let Some(colour) = self.integrate(tile, faces, &mut exact, block, bit) {
                    write(tile, block * BLOCK_PIXELS + bit as usize, colour, out);
                    pixels += 1;
                }
            }
        }
        self.faces = emptied(exact);
        pixels
    }

    /// Whether no two of the candidates of a pixel, all of which cover it, cross in it.
    fn is_ordered(&mut self, tile: Resolved<'_>, block: usize, bit: u32) -> bool {
        let candidates = &self.blocks[block];
        let here = self.pixels.of(bit);
        self.bounds.clear();
        self.bounds.extend(here.iter().map(|k| {
            let candidate = &candidates[*k as usize];
            candidate.depth.at_pixel(candidate.base, bit)
        }));
        self.bounds.sort_unstable_by(|a, b| b[0].total_cmp(&a[0]));
        if self.bounds.windows(2).all(|pair| pair[0][0] > pair[1][1]) {
            return true;
        }
        let [x, y] = pixel_corner(tile.rect, block * BLOCK_PIXELS + bit as usize);
        let plane = |k: &u32| tile.frame.triangle(tile.numbers[candidates[*k as usize].place as usize]).plane();
        here.len() <= COMPARED_MAX
            && here.iter().enumerate().all(|(k, a)| {
                let a = plane(a);
                let mut before = here[..k].iter().map(plane);
                before.all(|b| a == b || order_over(&a, &b, x, y, SUBPIXELS).is_some())
            })
    }

    /// The mean of a pixel, linear; `None` if it stays as its points have it.
    fn integrate<'a>(
        &mut self,
        tile: Resolved<'a>,
        faces: &mut TileFaces,
        exact: &mut Vec<ExactFace<'a>>,
        block: usize,
        bit: u32,
    ) -> Option<[f32; 3]> {
        let Resolved { frame, rect, numbers, .. } = tile;
        let pixel = block * BLOCK_PIXELS + bit as usize;
        let corner = pixel_corner(rect, pixel);
        let full = frame.pattern.full;
        let [left, top] = corner.map(|c| f64::from(c / SUBPIXELS));
        let behind = faces.behind(frame, corner);
        // Where something opaque covers the pixel there is no background.
        let mut sky = match behind {
            Behind::Straight(_) | Behind::Bent(_) if self.covers[pixel] == f32::NEG_INFINITY => Some(Passed([1.0; 64])),
            _ => None,
        };
        exact.clear();
        let candidates = &self.blocks[block];
        let here = self.pixels.of_mut(bit);
        if sky.is_some() {
            // Products depend on the order of their factors.
            here.sort_unstable_by_key(|k| frame.order(numbers[candidates[*k as usize].place as usize]));
        }
        for k in here {
            let candidate = &candidates[*k as usize];
            let number = numbers[candidate.place as usize];
            let triangle = frame.triangle(number);
            let item = &frame.items[triangle.item as usize];
            if triangle.flags.has(Flags::BEYOND) {
                match frame.within_visibility(triangle, corner[0], corner[1], full) {
                    0 => continue,
                    mask if mask == full => {}
                    _ => return None,
                }
            }
            let cutoff = item.cutoff();
            if cutoff.is_some() && !has_one_alpha(item) {
                return None;
            }
            let Some(fine) = fine_face(&mut self.known, &mut self.fine, frame, candidate.place, number) else {
                continue;
            };
            let [r, g, b, alpha] = faces.colour_of_area(frame, rect, candidate.place, number, corner, &fine);
            if cutoff.is_some_and(|cutoff| alpha < cutoff) {
                continue;
            }
            let alpha = if item.is_translucent() { f64::from(alpha).clamp(0.0, 1.0) } else { 1.0 };
            let [q0, qx, qy] = fine.plane(corner);
            // What covers the pixel takes of all points alike.
            if let Some(passed) = &mut sky
                && candidate.full >> bit & 1 == 0
            {
                passed.through(frame, triangle, item, alpha, corner);
            }
            exact.push(ExactFace {
                x: fine.x.map(|x| x - left),
                y: fine.y.map(|y| y - top),
                q0,
                qx,
                qy,
                order: frame.order(number),
                alpha,
                rgb: [f64::from(r), f64::from(g), f64::from(b)],
                part: item.part.map(|member| Part { member, is_translucent: item.is_translucent() }),
            });
        }
        let background = match &sky {
            Some(passed) => passed.mean(frame, &behind),
            None => behind.mean(frame.camera, frame.pattern, full).map(f64::from),
        };
        Some(self.integrator.integrate(exact, background).map(|c| c as f32))
    }
}

/// Of a block's pixels the candidates, as indices.
#[derive(Debug)]
struct PixelCandidates {
    /// Where a pixel's begin; the next one's is where they end.
    starts: [u32; BLOCK_PIXELS + 1],
    indices: Vec<u32>,
}

room!(PixelCandidates: indices; starts);

impl Default for PixelCandidates {
    fn default() -> Self {
        Self { starts: [0; BLOCK_PIXELS + 1], indices: Vec::new() }
    }
}

impl PixelCandidates {
    /// Of the pixels `wanted`; a counting sort of (candidate, pixel) pairs.
    fn set(&mut self, candidates: &[Candidate], wanted: u64) {
        self.starts = [0; BLOCK_PIXELS + 1];
        for candidate in candidates {
            each_bit(candidate.touched & wanted, |bit| self.starts[bit + 1] += 1);
        }
        for bit in 0..BLOCK_PIXELS {
            self.starts[bit + 1] += self.starts[bit];
        }
        let mut next = self.starts;
        self.indices.clear();
        self.indices.resize(self.starts[BLOCK_PIXELS] as usize, 0);
        for (k, candidate) in candidates.iter().enumerate() {
            each_bit(candidate.touched & wanted, |bit| {
                self.indices[next[bit] as usize] = k as u32;
                next[bit] += 1;
            });
        }
    }

    fn of(&self, bit: u32) -> &[u32] {
        &self.indices[self.starts[bit as usize] as usize..self.starts[bit as usize + 1] as usize]
    }

    fn of_mut(&mut self, bit: u32) -> &mut [u32] {
        &mut self.indices[self.starts[bit as usize] as usize..self.starts[bit as usize + 1] as usize]
    }
}

fn each_bit(mut set: u64, mut f: impl FnMut(usize)) {
    while set != 0 {
        f(set.trailing_zeros() as usize);
        set &= set - 1;
    }
}

/// What is let through at each of the 64 points.
struct Passed([f64; 64]);

impl Passed {
    /// A face of that saturation comes in between.
    fn through(&mut self, frame: &Frame<'_>, triangle: &Triangle, item: &Item<'_>, alpha: f64, [x, y]: [i32; 2]) {
        // Of a model that is mixed of versions, one version's part: close enough to tell where in the pixel the sky is seen.
        let share = item.part.map_or(1.0, |member| member.weights[member.version]);
        let edges = Edges::of(triangle);
        // Edge functions and their values near the tile are exact in f64.
        let [e0, e1, e2] = [0, 1, 2].map(|k| {
            let [a, b, c] =
                [edges.a[k], edges.b[k], edges.a[k] * i64::from(x) + edges.b[k] * i64::from(y) + edges.c[k]];
            [a as f64, b as f64, c as f64]
        });
        let [points_x, points_y] = &frame.pattern.points_f64;
        let left = 1.0 - alpha * share;
        for ((passed, x), y) in self.0.iter_mut().zip(points_x).zip(points_y) {
            let at = |e: [f64; 3]| e[0] * x + e[1] * y + e[2] >= 0.0;
            *passed *= if at(e0) & at(e1) & at(e2) { left } else { 1.0 };
        }
    }

    /// The mean of what is behind by what is let through; of all of it where the points let nothing through.
    fn mean(&self, frame: &Frame<'_>, behind: &Behind) -> [f64; 3] {
        let total: f64 = self.0.iter().sum();
        if total <= 0.0 {
            return behind.mean(frame.camera, frame.pattern, frame.pattern.full).map(f64::from);
        }
        let mut sum = [0.0; 3];
        for (passed, point) in self.0.iter().zip(frame.pattern.points) {
            if *passed > 0.0 {
                let colour = behind.at(frame.camera, point);
                sum = [0, 1, 2].map(|c| sum[c] + f64::from(colour[c]) * passed);
            }
        }
        sum.map(|c| c / total)
    }
}

/// Whether a face may be missing at some of the places that it covers.
#[inline(always)]
fn has_holes(triangle: &Triangle) -> bool {
    triangle.flags.0 & (Flags::BEYOND | Flags::CUT_OUT) != 0
}

/// Whether a face has the same alpha all over.
fn has_one_alpha(item: &Item<'_>) -> bool {
    item.base_texture.is_none() && item.stored.mesh.colors.is_empty()
}

/// The pixels of the block at (x, y) sub that a triangle's extent reaches, with the margin. Edges alone leave in what lies
/// beyond the tip of a splinter.
#[inline(always)]
fn within(frame: &Frame<'_>, triangle: &Triangle, [x, y]: [i32; 2]) -> u64 {
    let [[x0, x1], [y0, y1]] = triangle.pixels(frame.pattern.low, frame.pattern.high());
    let last = BLOCK as i32 - 1;
    let [first_column, last_column, first_row, last_row] =
        each4([x0 - x / SUBPIXELS, x1 - x / SUBPIXELS, y0 - y / SUBPIXELS, y1 - y / SUBPIXELS], |c| {
            c.clamp(-1, last + 1)
        });
    let (first_column, last_column) = (first_column.max(0), last_column.min(last));
    let (first_row, last_row) = (first_row.max(0), last_row.min(last));
    if first_column > last_column || first_row > last_row {
        return 0;
    }
    // Bits first to last of eight, in each byte; then of 64, eight by eight.
    let columns = (0xffu64 >> (last - last_column)) & (0xff << first_column);
    let rows = (u64::MAX >> (8 * (last - last_row))) & (u64::MAX << (8 * first_row));
    (columns * 0x0101_0101_0101_0101) & rows
}

/// The fine corners of the face at `place` of the tile's list; `None` if it has no area.
fn fine_face(
    known: &mut [u32],
    fine: &mut Vec<FineFace>,
    frame: &Frame<'_>,
    place: u32,
    number: u32,
) -> Option<FineFace> {
    let known = &mut known[place as usize];
    if *known == UNKNOWN {
        *known = NO_AREA;
        if let Some(face) = FineFace::new(frame, number) {
            *known = fine.len() as u32;
            fine.push(face);
        }
    }
    (*known != NO_AREA).then(|| fine[*known as usize])
}

/// Writes one pixel of a tile.
fn write(tile: Resolved<'_>, pixel: usize, colour: [f32; 3], out: &mut TileOutput<'_>) {
    let [x, y] = pixel_corner(tile.rect, pixel).map(|c| c / SUBPIXELS);
    let (column, row) = (x as usize - tile.rect.x0 as usize, y as usize - tile.rect.y0 as usize);
    let at = (row * tile.rect.width() as usize + column) * 3;
    let [r, g, b, _] = tile.frame.encoder.rgb(colour).to_le_bytes();
    out.rgb[at..at + 3].copy_from_slice(&[r, g, b]);
    if let Some(linear) = &mut out.linear {
        linear[at..at + 3].copy_from_slice(&colour);
    }
}
