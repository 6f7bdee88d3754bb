//! The integral: a pixel's true colour, area times colour, for scenes without textures.
//!
//! The pixel's square is cut into convex regions until in each of them the same faces, in the same order, are seen
//! everywhere: by the edges of faces that cross a region, nearest face first; then, where two faces that cover a
//! region change places within it, by the line where their depths are equal (1/−Z is affine over the screen, so it is
//! a straight one). What lies wholly behind an opaque face that covers the region is dropped before it can cut. Then
//! the region's stack is composed, and its colour counts with its area. Cyclic overlap needs no care, for nothing is
//! sorted but what covers a region.
//!
//! A face's colour is one per pixel as in `sampling`, the limit of infinitely many points: at the centre if the face
//! covers it, else at the point of its part of the pixel nearest to the centre. The sky is taken at each region's
//! centroid, the pixel being cut along the horizon, where its gradient has a kink.
//!
//! Exact to rounding (about 1e-12 of a pixel's area per cut), except: the range of visibility and a cut-off of alpha
//! (vertex colours) are asked once per region; the sky's colour isn't quite linear within a pixel (below 1e-6 for
//! ordinary fields of view). Textured faces are refused. A pixel that would need more than [`REGIONS_MAX`] regions is
//! sampled at [`SAMPLES_INSTEAD`] points, and counted.

use crate::coverage::side;
use crate::picture::{Kind, Picture};
use crate::plane;
use crate::points;
use crate::sampling::{Options, Sampler, pieces_by_pixel};
use crate::screen::{Piece, Screen, Vertices};
use crate::shade::{Place, Shaded};
use crate::texture::Filtering;
use crate::translucency::{Fragment, composite};
use crate::world::World;
use proto::frame::{Background, FrameState};
use proto::view::View;
use rayon::prelude::*;
use thiserror::Error;

/// Most regions of a pixel. A guess: far beyond what the benchmark scenes need, and still milliseconds.
pub const REGIONS_MAX: usize = 20_000;
/// Points of a pixel that has more.
pub const SAMPLES_INSTEAD: usize = 4096;

/// Nearer to a line than this, pixels, is on it.
const ON_LINE: f64 = 1e-11;
/// Regions below this area, pixels², are nothing.
const AREA_MIN: f64 = 1e-14;
/// Depths that differ by less, relative to the larger, are equal.
const EQUAL_DEPTH: f64 = 1e-13;

/// Why there is no integral.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("instance {instance} has a texture; only scenes without textures are integrated")]
pub struct Textured {
    /// Which one.
    pub instance: usize,
}

type Polygon = Vec<[f64; 2]>;

/// Integrates a view of a world. Edge pixels are told for a renderer with sample spacing `spacing`, pixels.
///
/// # Errors
/// [`Textured`] if a material has a texture.
pub fn integrate(
    world: &World<'_>,
    state: &FrameState,
    view: &View,
    vertices: Vertices,
    spacing: f64,
) -> Result<Picture, Textured> {
    let is_textured = |m: &proto::scene::Material| m.base_texture.is_some() || m.emissive_texture.is_some();
    if let Some(instance) = world.instances.iter().position(|i| is_textured(&i.mesh.material)) {
        return Err(Textured { instance });
    }
    let screen = Screen::new(world, state, view, vertices);
    let options = |count, spacing| Options {
        vertices,
        points: points::spread(count),
        filtering: Filtering::Point,
        layers: true,
        spacing,
    };
    let (for_kind, instead) = (options(64, Some(spacing)), options(SAMPLES_INSTEAD, None));
    let (for_kind, instead) = (Sampler::new(&screen, &for_kind), Sampler::new(&screen, &instead));
    let rows = screen.pieces_by_row(spacing);
    let pixels: Vec<([f64; 3], Kind, bool)> = rows
        .par_iter()
        .enumerate()
        .flat_map_iter(|(y, pieces)| {
            let cells = pieces_by_pixel(&screen, y, pieces, spacing);
            let pixel = |(x, candidates): (usize, &Vec<u32>)| {
                let (_, kind) = for_kind.pixel(x, y, candidates);
                match Pixel::new(&screen, x, y, candidates).color() {
                    Some(color) => (color, kind, false),
                    None => (instead.pixel(x, y, candidates).0, kind, true),
                }
            };
            cells.iter().enumerate().map(pixel).collect::<Vec<_>>()
        })
        .collect();
    Ok(Picture {
        width: view.width,
        height: view.height,
        linear: pixels.iter().map(|p| p.0).collect(),
        kinds: pixels.iter().map(|p| p.1).collect(),
        sampled_instead: pixels.iter().filter(|p| p.2).count(),
    })
}

/// A piece of a face in the pixel.
struct Part<'s> {
    piece: &'s Piece,
    /// Index into [`Pixel::faces`].
    face: usize,
}

/// A face in the pixel.
struct PixelFace<'s> {
    rank: (i32, u32, u32),
    group: usize,
    /// Nothing behind it is seen.
    hides: bool,
    fragment: Fragment,
    cutoff: Option<f64>,
    /// Nearest point to the centre so far, and its distance.
    at: Place<'s>,
    distance: f64,
}

struct Pixel<'s> {
    screen: &'s Screen<'s>,
    square: Polygon,
    parts: Vec<Part<'s>>,
    faces: Vec<PixelFace<'s>>,
}

/// A region to be looked at: what covers all of it, and what may cross it.
struct Region {
    polygon: Polygon,
    covering: Vec<usize>,
    crossing: Vec<usize>,
}

impl<'s> Pixel<'s> {
    fn new(screen: &'s Screen<'s>, x: usize, y: usize, candidates: &[u32]) -> Self {
        let (x, y) = (x as f64, y as f64);
        let square = vec![[x, y], [x + 1.0, y], [x + 1.0, y + 1.0], [x, y + 1.0]];
        let centre = [x + 0.5, y + 0.5];
        let mut pixel = Self { screen, square, parts: Vec::new(), faces: Vec::new() };
        let mut last = None;
        let mut planes = Vec::new();
        for index in candidates {
            let piece = &screen.pieces[*index as usize];
            let polygon = inside(&pixel.square, piece);
            if area(&polygon) < AREA_MIN {
                continue;
            }
            let point = nearest(&polygon, centre);
            let distance = (point[0] - centre[0]).hypot(point[1] - centre[1]);
            let at = Place { piece, point };
            if last == Some(piece.face) {
                if let Some(face) = pixel.faces.last_mut().filter(|face| distance < face.distance) {
                    (face.at, face.distance) = (at, distance);
                }
            } else {
                let face = &screen.faces[piece.face as usize];
                let member = screen.world.instances[face.instance as usize].member;
                let is_opaque = !screen.is_translucent(piece.face);
                pixel.faces.push(PixelFace {
                    rank: face.rank,
                    group: 0,
                    hides: is_opaque && member.is_none(),
                    fragment: Fragment { depth: 0.0, rank: face.rank, color: [0.0; 3], alpha: 0.0, is_opaque, member },
                    cutoff: screen.cutoff(piece.face),
                    at,
                    distance,
                });
                planes.push(&face.plane);
                last = Some(piece.face);
            }
            pixel.parts.push(Part { piece, face: pixel.faces.len() - 1 });
        }
        for (face, group) in pixel.faces.iter_mut().zip(plane::groups(&planes)) {
            face.group = group;
            let Shaded { color, alpha, .. } = screen.shade(face.at, Filtering::Point, &|_| Vec::new());
            (face.fragment.color, face.fragment.alpha) = (color, alpha);
        }
        pixel
    }

    /// The integral; `None` if it takes too many regions.
    fn color(&self) -> Option<[f64; 3]> {
        let all = || (0..self.parts.len()).collect::<Vec<_>>();
        let mut todo = Vec::new();
        let horizon = self.screen.camera.horizon();
        let above = |p: [f64; 2]| horizon[0] + horizon[1] * p[0] + horizon[2] * p[1];
        if self.screen.state.environment.background == Background::Sky {
            for half in halves(&self.square, above) {
                todo.push(Region { polygon: half, covering: Vec::new(), crossing: all() });
            }
        } else {
            todo.push(Region { polygon: self.square.clone(), covering: Vec::new(), crossing: all() });
        }
        let mut sum = [0.0; 3];
        let mut total = 0.0;
        let mut regions = 0;
        while let Some(region) = todo.pop() {
            regions += 1;
            if regions > REGIONS_MAX {
                return None;
            }
            let size = area(&region.polygon);
            if size < AREA_MIN {
                continue;
            }
            if let Some((color, size)) = self.look(region, size, &mut todo) {
                sum.iter_mut().zip(color).for_each(|(sum, c)| *sum += c * size);
                total += size;
            }
        }
        // What was left out because it was nothing.
        Some(sum.map(|c| c / total))
    }

    /// Colour and area of a region that needs no more cuts, or else its parts into `todo`.
    fn look(&self, mut region: Region, size: f64, todo: &mut Vec<Region>) -> Option<([f64; 3], f64)> {
        let mut edge: Option<(usize, usize)> = None;
        let mut nearest = f64::NEG_INFINITY;
        let middle = centroid(&region.polygon);
        let mut crossing = Vec::new();
        for index in std::mem::take(&mut region.crossing) {
            match place(self.parts[index].piece, &region.polygon) {
                Lies::Outside => {}
                Lies::Covering => region.covering.push(index),
                Lies::Crossing(side) => crossing.push((index, side)),
            }
        }
        self.drop_hidden(&mut region, &mut crossing);
        for (index, side) in &crossing {
            let inverse = self.parts[*index].piece.inverse_depth(middle);
            if inverse > nearest || edge.is_none() {
                (nearest, edge) = (inverse, Some((*index, *side)));
            }
        }
        region.crossing = crossing.into_iter().map(|(index, _)| index).collect();
        if let Some((index, k)) = edge {
            let line = distance_from_edge(self.parts[index].piece, k);
            push_halves(&region, line, todo);
            return None;
        }
        if let Some((a, b)) = self.change_places(&region) {
            let (a, b) = (self.parts[a].piece, self.parts[b].piece);
            push_halves(&region, |p| a.inverse_depth(p) - b.inverse_depth(p), todo);
            return None;
        }
        Some((self.compose(&region, middle), size))
    }

    /// Leaves out what is wholly behind an opaque face that covers the region.
    fn drop_hidden(&self, region: &mut Region, crossing: &mut Vec<(usize, usize)>) {
        let polygon = &region.polygon;
        let hides = |a: usize, b: usize| {
            let (front, back) = (&self.parts[a], &self.parts[b]);
            let face = &self.faces[front.face];
            face.hides
                && face.cutoff.is_none()
                && face.group != self.faces[back.face].group
                && polygon.iter().all(|p| {
                    let (near, far) = (front.piece.inverse_depth(*p), back.piece.inverse_depth(*p));
                    near - far > EQUAL_DEPTH * near.abs()
                        && self.screen.distance(Place { piece: front.piece, point: *p })
                            <= self.screen.state.environment.visibility_m.unwrap_or(f64::INFINITY)
                })
        };
        let covering = region.covering.clone();
        let is_hidden = |b: usize| covering.iter().any(|a| *a != b && hides(*a, b));
        region.covering.retain(|b| !is_hidden(*b));
        crossing.retain(|(b, _)| !is_hidden(*b));
    }

    /// Two covering parts of which neither is in front of the other all over the region.
    fn change_places(&self, region: &Region) -> Option<(usize, usize)> {
        for (i, a) in region.covering.iter().enumerate() {
            for b in &region.covering[..i] {
                let (pa, pb) = (&self.parts[*a], &self.parts[*b]);
                if self.faces[pa.face].group == self.faces[pb.face].group {
                    continue;
                }
                let mut signs = [false; 2];
                for p in &region.polygon {
                    let (qa, qb) = (pa.piece.inverse_depth(*p), pb.piece.inverse_depth(*p));
                    let slack = EQUAL_DEPTH * qa.abs().max(qb.abs());
                    signs[0] |= qa - qb > slack;
                    signs[1] |= qb - qa > slack;
                }
                // A crossing so near to a corner that cutting it off changes nothing is none.
                if signs == [true, true] {
                    let difference = |p| pa.piece.inverse_depth(p) - pb.piece.inverse_depth(p);
                    if halves(&region.polygon, difference).iter().all(|half| area(half) >= AREA_MIN) {
                        return Some((*a, *b));
                    }
                }
            }
        }
        None
    }

    fn compose(&self, region: &Region, middle: [f64; 2]) -> [f64; 3] {
        let environment = &self.screen.state.environment;
        let range = environment.visibility_m.unwrap_or(f64::INFINITY);
        let mut there: Vec<&Part<'_>> = Vec::new();
        for index in &region.covering {
            let part = &self.parts[*index];
            let at = Place { piece: part.piece, point: middle };
            let is_cut_out = self.faces[part.face].cutoff.is_some_and(|cutoff| self.screen.alpha_at(at) < cutoff);
            if !is_cut_out && self.screen.distance(at) <= range && there.iter().all(|other| other.face != part.face) {
                there.push(part);
            }
        }
        let fragment = |part: &&Part<'_>| {
            let face = &self.faces[part.face];
            let same = there.iter().filter(|other| self.faces[other.face].group == face.group);
            let lowest = same.min_by_key(|other| self.faces[other.face].rank).unwrap_or(part);
            Fragment { depth: -lowest.piece.inverse_depth(middle), ..face.fragment }
        };
        let fragments: Vec<Fragment> = there.iter().map(fragment).collect();
        composite(&fragments, &self.screen.world.models, self.screen.background(middle))
    }
}

/// How a piece lies with respect to a region.
enum Lies {
    Outside,
    Covering,
    /// This edge goes through it.
    Crossing(usize),
}

fn place(piece: &Piece, polygon: &[[f64; 2]]) -> Lies {
    let mut crossing = None;
    for k in 0..3 {
        let distance = distance_from_edge(piece, k);
        let (mut inside, mut outside) = (false, false);
        for p in polygon {
            let d = distance(*p);
            inside |= d > ON_LINE;
            outside |= d < -ON_LINE;
        }
        match (inside, outside) {
            (false, _) => return Lies::Outside,
            (true, true) if crossing.is_none() => crossing = Some(k),
            (true, _) => {}
        }
    }
    crossing.map_or(Lies::Covering, Lies::Crossing)
}

/// Signed distance from a piece's edge, pixels, positive inside.
fn distance_from_edge(piece: &Piece, k: usize) -> impl Fn([f64; 2]) -> f64 {
    let (a, b) = (piece.corners[k], piece.corners[(k + 1) % 3]);
    let length = (b[0] - a[0]).hypot(b[1] - a[1]);
    move |p| side(a, b, p) / length
}

/// The parts of a convex polygon where an affine function is positive and negative; without area, empty.
fn halves(polygon: &[[f64; 2]], function: impl Fn([f64; 2]) -> f64) -> [Polygon; 2] {
    let values: Vec<f64> = polygon.iter().map(|p| function(*p)).collect();
    let (mut positive, mut negative) = (Vec::new(), Vec::new());
    for (i, here) in polygon.iter().enumerate() {
        let j = (i + 1) % polygon.len();
        if values[i] >= 0.0 {
            positive.push(*here);
        }
        if values[i] <= 0.0 {
            negative.push(*here);
        }
        if values[i] * values[j] < 0.0 {
            let part = values[i] / (values[i] - values[j]);
            let cut = std::array::from_fn(|axis| here[axis] + (polygon[j][axis] - here[axis]) * part);
            positive.push(cut);
            negative.push(cut);
        }
    }
    [positive, negative]
}

fn push_halves(region: &Region, line: impl Fn([f64; 2]) -> f64, todo: &mut Vec<Region>) {
    for polygon in halves(&region.polygon, line) {
        todo.push(Region { polygon, covering: region.covering.clone(), crossing: region.crossing.clone() });
    }
}

/// The part of a polygon inside of a piece.
fn inside(polygon: &[[f64; 2]], piece: &Piece) -> Polygon {
    (0..3).fold(polygon.to_vec(), |polygon, k| {
        let [kept, _] = halves(&polygon, distance_from_edge(piece, k));
        kept
    })
}

fn area(polygon: &[[f64; 2]]) -> f64 {
    (1..polygon.len().saturating_sub(1)).map(|k| side(polygon[0], polygon[k], polygon[k + 1])).sum::<f64>().abs() / 2.0
}

fn centroid(polygon: &[[f64; 2]]) -> [f64; 2] {
    let mut sum = [0.0; 2];
    let mut total = 0.0;
    for k in 1..polygon.len() - 1 {
        let corners = [polygon[0], polygon[k], polygon[k + 1]];
        let weight = side(corners[0], corners[1], corners[2]);
        total += weight;
        for (axis, sum) in sum.iter_mut().enumerate() {
            *sum += weight * corners.iter().map(|c| c[axis]).sum::<f64>() / 3.0;
        }
    }
    sum.map(|s| s / total)
}

/// The point of a convex polygon nearest to another point.
fn nearest(polygon: &[[f64; 2]], to: [f64; 2]) -> [f64; 2] {
    let mut best = (f64::INFINITY, to);
    let mut is_inside = true;
    for (i, a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        is_inside &= side(*a, b, to) >= 0.0;
        let along = [b[0] - a[0], b[1] - a[1]];
        let length = along[0] * along[0] + along[1] * along[1];
        let part = ((to[0] - a[0]) * along[0] + (to[1] - a[1]) * along[1]) / length;
        let part = if part.is_finite() { part.clamp(0.0, 1.0) } else { 0.0 };
        let point = [a[0] + along[0] * part, a[1] + along[1] * part];
        let distance = (point[0] - to[0]).hypot(point[1] - to[1]);
        if distance < best.0 {
            best = (distance, point);
        }
    }
    if is_inside { to } else { best.1 }
}
