//! The faces of a tile as they are shaded, and two quick ways that most faces take.
//!
//! - *One colour*: flat, untextured, uncoloured, unfaded. It is computed once per tile and kept as bytes, too.
//! - *By normal*: as before, but with a normal per vertex and the sun as the only light. The interpolated normal needs no division:
//!   q · n is affine over the screen, and only its direction counts. So a pixel costs three affine functions, a root and a quotient,
//!   for 16 pixels at a time where one face covers a block.
//!
//! Everything else, and faces so thin that their affine functions would cancel in f32, is *general* ([`super::face`]). Which way a
//! face takes depends on the face and the tile alone, never on a share or a list.
//!
//! Coordinates here are in pixels from the tile's upper left, where f32 is exact to 2⁻¹⁸ pixel.

use super::FaceCache;
use super::nearest::nearest;
use crate::frame::Frame;
use crate::geometry::fine::FineFace;
use crate::geometry::setup::{Flags, WHOLE_FACE, extent};
use crate::raster::coverage::{BLOCK, BLOCKS_PER_ROW, Edges};
use crate::resolve::background::{Behind, BlockSky};
use crate::room::room;
use crate::samples::SUBPIXELS;
use crate::simd::{each3, each4};
use fearless_simd::{Simd, f32x4, f32x16, prelude::*};
use proto::frame::{Environment, PixelRect};

/// How much larger than the sum of an affine function its terms may be, anywhere on the face: that costs f32 six of its 24 bits.
/// Splinters, and faces that reach from right before the eye far away, are more.
const WEIGHT_MAX: f64 = 64.0;

/// Factors up to this can be multiplied and added without a thought of f32's range. NaN isn't.
const MODEST: f32 = 1e15;

/// Not looked at yet.
const UNKNOWN: u32 = u32::MAX;

/// The sun as the quick way needs it.
#[derive(Clone, Copy, Debug)]
pub struct Sun {
    direction: [f32; 3],
    light: f32,
    ambient: f32,
}

impl Sun {
    /// Of a frame's environment.
    pub fn of(environment: &Environment) -> Self {
        let direction = environment.sun_direction.as_vec3().to_array();
        Self { direction, light: environment.sun, ambient: environment.ambient }
    }

    fn is_modest(&self) -> bool {
        self.direction.iter().chain([&self.light, &self.ambient]).all(|c| c.abs() <= MODEST)
    }
}

/// A face that depends on its normal alone. Vectors are x, y, z and, but for the last two, what is said.
///
/// The affine function is told from the face's own first corner, on whose side of the picture it may lie far away: on the face no
/// term is then much larger than the sum, however far the tile's corner is from a small face.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct ByNormal {
    /// A multiple of the normal at the first corner.
    normal: [f32; 4],
    /// Its change per pixel to the right; the first corner's place, pixels from the tile's left.
    right: [f32; 4],
    /// Its change per pixel downwards; the first corner's place, pixels from the tile's top.
    down: [f32; 4],
    /// Linear RGB that light is multiplied by, and alpha.
    base: [f32; 4],
    /// Linear RGB that is added.
    emissive: [f32; 4],
}

/// How a face of the tile is shaded.
#[derive(Clone, Copy, Debug)]
pub enum Look {
    /// One linear RGB and alpha all over, and the same as bytes, `0x00BBGGRR`.
    Constant([f32; 4], u32),
    /// By the normal; an index for [`TileFaces::by_normal`].
    ByNormal(u32),
    /// In general.
    General,
}

/// The faces of a tile, by their place in its list. One per thread, used again.
#[derive(Debug, Default)]
pub struct TileFaces {
    /// How each is shaded: [`UNKNOWN`], or one of the kinds below above [`INDEX_BITS`] and an index in them.
    known: Vec<u32>,
    /// The bytes of faces of one colour by *place*, `0x00BBGGRR`; [`NO_CODE`] of all others.
    codes: Vec<u32>,
    constants: Vec<([f32; 4], u32)>,
    normals: Vec<ByNormal>,
    general: FaceCache,
    sky: BlockSky,
}

room!(TileFaces: known, codes, constants, normals; general, sky);

/// Below the kind in [`TileFaces::known`].
const INDEX_BITS: u32 = 30;
const CONSTANT: u32 = 0;
const BY_NORMAL: u32 = 1;
const GENERAL: u32 = 2;

/// Not the bytes of any colour.
pub const NO_CODE: u32 = u32::MAX;

impl TileFaces {
    /// Forgets all faces and makes room for the `count` of the next tile.
    pub fn begin(&mut self, count: usize) {
        assert!(count < 1 << INDEX_BITS, "an index and its kind share a number");
        self.known.clear();
        self.known.resize(count, UNKNOWN);
        self.codes.clear();
        self.codes.resize(count, NO_CODE);
        self.constants.clear();
        self.normals.clear();
        self.general.clear();
        self.sky.clear();
    }

    /// What is behind all faces in the pixel whose upper left is there, sub.
    #[inline(always)]
    pub fn behind(&mut self, frame: &Frame<'_>, corner: [i32; 2]) -> Behind {
        self.sky.of(frame.camera, frame.environment, corner)
    }

    /// The faces of the general way.
    pub fn general(&mut self) -> &mut FaceCache {
        &mut self.general
    }

    /// A face of the quick way by normals.
    #[inline(always)]
    pub fn by_normal(&self, index: u32) -> &ByNormal {
        &self.normals[index as usize]
    }

    /// By place, the bytes of the faces of one colour that were looked at; [`NO_CODE`] for all others.
    #[inline(always)]
    pub fn codes(&self) -> &[u32] {
        &self.codes
    }

    /// How the face at `place` of the tile's list, triangle `number`, is shaded.
    #[inline(always)]
    pub fn look(&mut self, frame: &Frame<'_>, rect: PixelRect, place: u32, number: u32) -> Look {
        let mut known = self.known[place as usize];
        if known == UNKNOWN {
            known = self.find(frame, rect, place, number);
        }
        let index = known & ((1 << INDEX_BITS) - 1);
        match known >> INDEX_BITS {
            BY_NORMAL => Look::ByNormal(index),
            CONSTANT => {
                let (colour, code) = self.constants[index as usize];
                Look::Constant(colour, code)
            }
            _ => Look::General,
        }
    }

    #[inline(never)]
    fn find(&mut self, frame: &Frame<'_>, rect: PixelRect, place: u32, number: u32) -> u32 {
        let constant = match quick(frame, rect, number) {
            Some(Quick::ByNormal(face)) => {
                self.normals.push(face);
                let known = BY_NORMAL << INDEX_BITS | (self.normals.len() as u32 - 1);
                self.known[place as usize] = known;
                return known;
            }
            Some(Quick::Constant(colour)) => Some(colour),
            None => self.general.of(frame, number).constant.filter(|_| frame.fade.is_none()),
        };
        let known = match constant {
            None => GENERAL << INDEX_BITS,
            Some(colour) => {
                let code = frame.encoder.rgb([colour[0], colour[1], colour[2]]);
                self.codes[place as usize] = code;
                self.constants.push((colour, code));
                CONSTANT << INDEX_BITS | (self.constants.len() as u32 - 1)
            }
        };
        self.known[place as usize] = known;
        known
    }

    /// [`TileFaces::colour`] for a pixel that is computed by areas, of a face with these true corners: where its light changes over it, from those.
    pub fn colour_of_area(
        &mut self,
        frame: &Frame<'_>,
        rect: PixelRect,
        place: u32,
        number: u32,
        corner: [i32; 2],
        fine: &FineFace,
    ) -> [f32; 4] {
        let face = match self.look(frame, rect, place, number) {
            Look::Constant(colour, _) => return colour,
            Look::ByNormal(index) => Some(self.normals[index as usize]),
            // Also what is too thin for the quick way.
            Look::General => plain(frame, number),
        };
        if let Some(face) = face
            && let Some(normals) = vertex_normals(frame, number)
        {
            let weights = fine.weights(fine.shading_point(corner.map(|c| f64::from(c / SUBPIXELS))));
            let total: f64 = weights.iter().sum();
            let normal = each3([0, 1, 2], |c| {
                let sum: f64 = (0..3).map(|k| weights[k] * f64::from(normals[fine.vertices[k]][c])).sum();
                (sum / total) as f32
            });
            if total > 0.0 {
                return face.lit(frame, normal);
            }
        }
        self.colour(frame, rect, place, number, corner)
    }

    /// Linear RGB and alpha of the face at `place` in the pixel whose upper left is (x, y) sub.
    #[inline(always)]
    pub fn colour(
        &mut self,
        frame: &Frame<'_>,
        rect: PixelRect,
        place: u32,
        number: u32,
        [x, y]: [i32; 2],
    ) -> [f32; 4] {
        match self.look(frame, rect, place, number) {
            Look::Constant(colour, _) => colour,
            Look::ByNormal(index) => {
                let [dx, dy] = shading_point(frame, number, [x, y]);
                let place = [x + dx - (rect.x0 as i32) * SUBPIXELS, y + dy - (rect.y0 as i32) * SUBPIXELS];
                let scale = 1.0 / SUBPIXELS as f32;
                self.normals[index as usize].at(frame, [place[0] as f32 * scale, place[1] as f32 * scale])
            }
            Look::General => frame.pixel_colour(&mut self.general, number, x, y),
        }
    }
}

/// Where in a pixel a whole face is shaded: at the centre, or at its covered sample nearest to that; sub.
#[inline(always)]
fn shading_point(frame: &Frame<'_>, number: u32, [x, y]: [i32; 2]) -> [i32; 2] {
    let edges = Edges::of(frame.triangle(number));
    let centre = SUBPIXELS / 2;
    if edges.covers(x + centre, y + centre) {
        return [centre, centre];
    }
    if frame.pattern.is_exact() {
        return nearest(frame.triangle(number), &edges, [x, y]).0;
    }
    let points = &frame.pattern.points[..frame.pattern.count];
    for [dx, dy] in points {
        if edges.covers(x + dx, y + dy) {
            return [*dx, *dy];
        }
    }
    unreachable!("a face is shaded only in pixels where it covers a sample")
}

enum Quick {
    Constant([f32; 4]),
    ByNormal(ByNormal),
}

/// The unit normals of a face's vertices on the side that is seen, in the order of the mesh; `None` if a vertex has none.
#[inline(always)]
fn vertex_normals(frame: &Frame<'_>, number: u32) -> Option<[[f32; 4]; 3]> {
    let triangle = frame.triangle(number);
    let all = frame.run(number).normals_of(triangle.item as usize)?;
    let vertices = frame.items[triangle.item as usize].stored.mesh.triangles[triangle.face as usize];
    let mut normals = each3(vertices, |vertex| all[vertex as usize]);
    if normals.contains(&[0.0; 4]) {
        return None;
    }
    if triangle.flags.has(Flags::BEHIND) {
        normals = each3(normals, |n| [-n[0], -n[1], -n[2], 0.0]);
    }
    Some(normals)
}

/// What light makes of a face, without its normals; `None` unless these and its material are all that its colour depends on.
#[inline(always)]
fn plain(frame: &Frame<'_>, number: u32) -> Option<ByNormal> {
    let triangle = frame.triangle(number);
    let item = &frame.items[triangle.item as usize];
    let mesh = &item.stored.mesh;
    let material = &mesh.material;
    let is_plain = material.base_texture.is_none() && material.emissive_texture.is_none() && mesh.colors.is_empty();
    if !is_plain || material.unlit || frame.fade.is_some() || !frame.lights.is_empty() || triangle.clip != WHOLE_FACE {
        return None;
    }
    // Whatever light makes of numbers like these is a number.
    let is_modest = |c: &f32| c.abs() <= MODEST;
    if !material.base_color.iter().chain(&material.emissive).all(is_modest) || !frame.sun.is_modest() {
        return None;
    }
    let [er, eg, eb] = material.emissive;
    let none = [0.0; 4];
    Some(ByNormal { normal: none, right: none, down: none, base: material.base_color, emissive: [er, eg, eb, 0.0] })
}

/// What the quick ways need of a face, if one of them will do.
#[inline(always)]
fn quick(frame: &Frame<'_>, rect: PixelRect, number: u32) -> Option<Quick> {
    let triangle = frame.triangle(number);
    let mut face = plain(frame, number)?;
    let [a, b, c] = vertex_normals(frame, number)?;
    face.normal = a;
    if a == b && a == c {
        return Some(Quick::Constant(face.at(frame, [0.0; 2])));
    }
    let normals = if triangle.flags.has(Flags::SWAPPED) { [a, c, b] } else { [a, b, c] };
    let (x, y, q) = (triangle.x, triangle.y, triangle.corner_q());
    let largest = q[0].max(q[1]).max(q[2]);
    let least = q[0].min(q[1]).min(q[2]);
    let scale = f64::from(SUBPIXELS) / (triangle.area_twice() as f64 * largest);
    let [[left, wide], [top, high]] = [extent(x), extent(y)];
    let (wide, high) = (f64::from(wide - left), f64::from(high - top));
    let at_corner = (q[0] / largest) as f32;
    let normal = each4(normals[0], |n| n * at_corner);
    let (mut to_right, mut downwards) = ([0.0f32; 4], [0.0f32; 4]);
    let mut reach = 0.0;
    for k in 0..3 {
        // The edge opposite of corner k.
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let part = q[k] * scale;
        let (right, down) = (f64::from(y[i] - y[j]) * part, f64::from(x[j] - x[i]) * part);
        reach += wide * right.abs() + high * down.abs();
        for c in 0..4 {
            to_right[c] += normals[k][c] * right as f32;
            downwards[c] += normals[k][c] * down as f32;
        }
    }
    // Terms on the face, against the smallest sum; a NaN doesn't fit.
    let fits = reach * (1.0 / f64::from(SUBPIXELS)) * largest <= least * WEIGHT_MAX;
    if !fits {
        return None;
    }
    let place = |corner: i32, tile: u32| (corner - tile as i32 * SUBPIXELS) as f32 * (1.0 / SUBPIXELS as f32);
    (to_right[3], downwards[3]) = (place(x[0], rect.x0), place(y[0], rect.y0));
    (face.normal, face.right, face.down) = (normal, to_right, downwards);
    Some(Quick::ByNormal(face))
}

impl ByNormal {
    /// Linear RGB and alpha at a place in pixels from the tile's upper left: the scalar twin of [`ByNormal::block`].
    #[inline(always)]
    pub fn at(&self, frame: &Frame<'_>, [x, y]: [f32; 2]) -> [f32; 4] {
        let (x, y) = (x - self.right[3], y - self.down[3]);
        self.lit(frame, each3([0, 1, 2], |k| self.normal[k] + (self.right[k] * x + self.down[k] * y)))
    }

    /// Linear RGB and alpha where the normal has that direction.
    #[inline(always)]
    fn lit(&self, frame: &Frame<'_>, n: [f32; 3]) -> [f32; 4] {
        let sun = &frame.sun;
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        let slope = (n[0] * sun.direction[0] + n[1] * sun.direction[1] + n[2] * sun.direction[2]) / length;
        // What has no direction has no sun.
        let light = sun.ambient + sun.light * if slope > 0.0 { slope } else { 0.0 };
        let [r, g, b] = each3([0, 1, 2], |c| self.base[c] * light + self.emissive[c]);
        [r, g, b, self.base[3]]
    }

    /// A multiple of the normal at a place.
    #[inline(always)]
    fn direction<S: Simd>(&self, simd: S, x: f32, y: f32) -> [f32; 4] {
        let (x, y) = (x - self.right[3], y - self.down[3]);
        let [normal, right, down] = each3([self.normal, self.right, self.down], |v| f32x4::simd_from(simd, v));
        (normal + (right * x + down * y)).into()
    }

    /// Linear RGB at the centres of a block's 64 pixels; anything finite in rows of 16 without a pixel of `pixels`.
    #[inline(always)]
    pub fn block<S: Simd>(&self, simd: S, frame: &Frame<'_>, block: usize, pixels: u64) -> [[f32x16<S>; 4]; 3] {
        const COLUMNS: [f32; 16] = [0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5];
        const ROWS: [f32; 16] = [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5];
        let (left, top) = (block as u32 % BLOCKS_PER_ROW * BLOCK, block as u32 / BLOCKS_PER_ROW * BLOCK);
        let x = f32x16::simd_from(simd, COLUMNS) + left as f32 - self.right[3];
        let rows = f32x16::simd_from(simd, ROWS) + top as f32;
        let mut out = [[f32x16::splat(simd, 0.0); 4]; 3];
        for group in 0..4 {
            if pixels >> (16 * group) & 0xffff == 0 {
                continue;
            }
            let y = rows + (2 * group) as f32 - self.down[3];
            let n = [
                (x * self.right[0] + y * self.down[0]) + self.normal[0],
                (x * self.right[1] + y * self.down[1]) + self.normal[1],
                (x * self.right[2] + y * self.down[2]) + self.normal[2],
            ];
            let light = Self::light(simd, frame, n);
            for c in 0..3 {
                out[c][group] = light * self.base[c] + self.emissive[c];
            }
        }
        out
    }

    /// The factor of light for 16 directions.
    #[inline(always)]
    fn light<S: Simd>(simd: S, frame: &Frame<'_>, n: [f32x16<S>; 3]) -> f32x16<S> {
        let sun = &frame.sun;
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        let slope = (n[0] * sun.direction[0] + n[1] * sun.direction[1] + n[2] * sun.direction[2]) / length;
        let zero = f32x16::splat(simd, 0.0);
        slope.simd_gt(zero).select(slope, zero) * sun.light + sun.ambient
    }

    /// Alpha, everywhere.
    #[inline(always)]
    pub fn alpha(&self) -> f32 {
        self.base[3]
    }
}

/// Up to 16 places on faces that are shaded by normals, to be done together.
#[derive(Debug)]
pub struct Batch {
    /// Index of the face, for [`TileFaces::by_normal`].
    pub faces: [u32; 16],
    /// Pixels from the tile's upper left.
    pub x: [f32; 16],
    /// Likewise.
    pub y: [f32; 16],
    /// Number of the pixel in its block that it is for.
    pub pixels: [u8; 16],
    /// Share of the pixel that it is; 1 where it is all of it.
    pub shares: [f32; 16],
    /// How many there are.
    pub count: usize,
}

impl Default for Batch {
    fn default() -> Self {
        Self { faces: [0; 16], x: [0.0; 16], y: [0.0; 16], pixels: [0; 16], shares: [0.0; 16], count: 0 }
    }
}

impl Batch {
    /// Adds a place; whether the batch is full now.
    #[inline(always)]
    pub fn push(&mut self, face: u32, [x, y]: [f32; 2], pixel: u8, share: f32) -> bool {
        let at = self.count;
        (self.faces[at], self.x[at], self.y[at]) = (face, x, y);
        (self.pixels[at], self.shares[at]) = (pixel, share);
        self.count += 1;
        self.count == 16
    }

    /// Linear RGB of each place, as [`ByNormal::at`] gives it.
    #[inline(always)]
    pub fn colours<S: Simd>(&self, simd: S, frame: &Frame<'_>, faces: &TileFaces) -> [[f32; 4]; 16] {
        let mut n = [[0.0f32; 16]; 3];
        for i in 0..self.count {
            let face = faces.by_normal(self.faces[i]);
            let at = face.direction(simd, self.x[i], self.y[i]);
            for k in 0..3 {
                n[k][i] = at[k];
            }
        }
        let light: [f32; 16] = ByNormal::light(simd, frame, each3(n, |c| f32x16::simd_from(simd, c))).into();
        let mut out = [[0.0; 4]; 16];
        for i in 0..self.count {
            let face = faces.by_normal(self.faces[i]);
            let base = f32x4::simd_from(simd, face.base);
            (base * light[i] + f32x4::simd_from(simd, face.emissive)).store_slice(&mut out[i]);
        }
        out
    }
}
