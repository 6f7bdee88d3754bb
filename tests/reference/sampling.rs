//! The sampler: every given point of every pixel is asked of every face that reaches the pixel; all fragments are kept,
//! sorted and composed; the pixel is the mean. picture.md, "One sample" and "One pixel".
//!
//! A face's colour is computed once per pixel, at the centre if the face covers it, else at its covered point nearest
//! the centre (of equally near ones, the first given). Coverage here means the face's own, whatever hides it, cuts it
//! out (MASK) or fades it away. The background is computed at each point.
//!
//! Beside the points that make the colour, a ring of points round the pixel is asked what it sees, so that edge
//! pixels can be told from interior ones as proof.md defines them ("more than one plane, material or stack of
//! faces"): by the stack of (plane, material) from the eye down to the first opaque face. Faces with a texture or
//! with colours at their vertices count each for itself even in one plane, because where two of them meet colours may
//! jump.

use crate::coverage::{Overlap, extent_in_band, hits, overlap};
use crate::picture::{Kind, Picture};
use crate::plane;
use crate::points;
use crate::screen::{Screen, Vertices};
use crate::shade::{Place, Shaded};
use crate::texture::Filtering;
use crate::translucency::{Fragment, composite_sorted};
use crate::world::World;
use proto::frame::FrameState;
use proto::view::View;
use rayon::prelude::*;
use std::ops::Range;

/// How the sampler looks.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Where vertices are.
    pub vertices: Vertices,
    /// The points of a pixel, from its upper left corner, each coordinate in 0..1.
    pub points: Vec<[f64; 2]>,
    /// What pixels see of textures.
    pub filtering: Filtering,
    /// Whether faces in one plane share its depth and are ordered by layer and place in the file, as the page demands,
    /// or like any others by a depth of their own, and only at exactly equal depth by their place.
    pub layers: bool,
    /// "One sample spacing" for telling edge pixels, pixels; `None`: only what the points themselves see counts.
    pub spacing: Option<f64>,
}

impl Options {
    /// The truth as near as `count` points come: true vertices, averaged textures; edge pixels as a renderer with `n`
    /// samples has them.
    pub fn truth(count: usize, n: usize) -> Self {
        Self {
            vertices: Vertices::Exact,
            points: points::spread(count),
            filtering: Filtering::TRUTH,
            layers: true,
            spacing: Some(1.0 / (n as f64).sqrt()),
        }
    }

    /// A renderer's own points and grid.
    pub fn like(vertices: Vertices, points: &[[f64; 2]]) -> Self {
        let spacing = Some(1.0 / (points.len() as f64).sqrt());
        Self { vertices, points: points.to_vec(), filtering: Filtering::TRUTH, layers: true, spacing }
    }
}

/// Draws a view of a world.
///
/// # Panics
/// If `options` has no points, or a material names a texture that the world doesn't have.
pub fn sample(world: &World<'_>, state: &FrameState, view: &View, options: &Options) -> Picture {
    assert!(!options.points.is_empty(), "a pixel is looked at somewhere");
    let bare;
    let world = if options.layers {
        world
    } else {
        bare = world.without_planes();
        &bare
    };
    let screen = Screen::new(world, state, view, options.vertices);
    let margin = options.spacing.unwrap_or(0.0);
    let rows = screen.pieces_by_row(margin);
    let sampler = Sampler::new(&screen, options);
    let pixels: Vec<Vec<([f64; 3], Kind)>> =
        rows.par_iter().enumerate().map(|(y, pieces)| sampler.row(y, pieces)).collect();
    let (linear, kinds) = pixels.into_iter().flatten().unzip();
    Picture { width: view.width, height: view.height, linear, kinds, sampled_instead: 0 }
}

/// For each pixel of a row the pieces that may reach it, in order.
pub(crate) fn pieces_by_pixel(screen: &Screen<'_>, y: usize, pieces: &[u32], margin: f64) -> Vec<Vec<u32>> {
    let mut cells = vec![Vec::new(); screen.width as usize];
    let (top, bottom) = (y as f64 - margin, y as f64 + 1.0 + margin);
    for index in pieces {
        let corners = &screen.pieces[*index as usize].corners;
        let Some([left, right]) = extent_in_band(corners, top, bottom) else { continue };
        let width = f64::from(screen.width);
        // A hundredth of a pixel more on both sides, so that no rounding can lose a face.
        let first = (left - margin - 0.01).floor().clamp(0.0, width) as usize;
        let end = ((right + margin + 0.01).floor() + 1.0).clamp(0.0, width) as usize;
        for cell in cells.get_mut(first..end).unwrap_or_default() {
            cell.push(*index);
        }
    }
    cells
}

/// What is the same for all pixels.
pub(crate) struct Sampler<'s> {
    screen: &'s Screen<'s>,
    options: &'s Options,
    /// The given points, then the ring.
    points: Vec<[f64; 2]>,
    /// Indices of the given points, nearest to the centre first.
    by_distance: Vec<usize>,
    /// Smallest and largest coordinate of any point.
    bounds: [f64; 2],
}

/// A face in a pixel.
struct Seen<'s> {
    face: u32,
    /// The pieces of it that reach the pixel, among the candidates.
    pieces: Range<usize>,
    /// Where it is shaded; `None` if no point of the pixel is covered.
    at: Option<Place<'s>>,
    shaded: Option<Shaded>,
}

/// A face at a point.
#[derive(Clone, Copy)]
struct Hit {
    /// Index among the pixel's faces.
    seen: usize,
    /// 1/−Z: larger is nearer.
    inverse: f64,
}

impl<'s> Sampler<'s> {
    pub(crate) fn new(screen: &'s Screen<'s>, options: &'s Options) -> Self {
        let mut points = options.points.clone();
        points.extend(options.spacing.map(points::ring).unwrap_or_default());
        let mut by_distance: Vec<usize> = (0..options.points.len()).collect();
        let distance = |i: &usize| {
            let [x, y] = options.points[*i];
            (x - 0.5) * (x - 0.5) + (y - 0.5) * (y - 0.5)
        };
        by_distance.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        let margin = options.spacing.unwrap_or(0.0);
        Self { screen, options, points, by_distance, bounds: [-margin, 1.0 + margin] }
    }

    fn row(&self, y: usize, pieces: &[u32]) -> Vec<([f64; 3], Kind)> {
        let cells = pieces_by_pixel(self.screen, y, pieces, -self.bounds[0]);
        cells.iter().enumerate().map(|(x, candidates)| self.pixel(x, y, candidates)).collect()
    }

    /// The colour of a pixel that these pieces may reach.
    pub(crate) fn pixel(&self, x: usize, y: usize, candidates: &[u32]) -> ([f64; 3], Kind) {
        let corner = [x as f64, y as f64];
        let points: Vec<[f64; 2]> = self.points.iter().map(|p| [corner[0] + p[0], corner[1] + p[1]]).collect();
        let mut at_point: Vec<Vec<Hit>> = vec![Vec::new(); points.len()];
        let mut seen: Vec<Seen<'s>> = Vec::new();
        let mut start = 0;
        while start < candidates.len() {
            let face = self.screen.pieces[candidates[start] as usize].face;
            let more = candidates[start..].iter().take_while(|i| self.screen.pieces[**i as usize].face == face).count();
            self.cover(corner, &points, face, start..start + more, candidates, &mut seen, &mut at_point);
            start += more;
        }
        let planes: Vec<_> = seen.iter().map(|s| &self.screen.faces[s.face as usize].plane).collect();
        let groups = plane::groups(&planes);
        let is_shared = groups.iter().enumerate().any(|(i, group)| *group != i);

        let count = self.options.points.len();
        let mut sum = [0.0; 3];
        let mut kind = Kind::default();
        let mut stack: Option<u64> = None;
        let mut fragments = Vec::new();
        for (i, hits) in at_point.iter_mut().enumerate() {
            if self.options.layers && is_shared {
                self.settle_planes(&seen, &groups, hits);
            }
            hits.sort_by(|a, b| {
                b.inverse.total_cmp(&a.inverse).then(self.rank(&seen[b.seen]).cmp(&self.rank(&seen[a.seen])))
            });
            hits.truncate(hits.iter().position(|hit| self.hides(&seen[hit.seen])).map_or(hits.len(), |last| last + 1));
            let signature = hits.iter().fold(0xcbf2_9ce4_8422_2325, |hash, hit| {
                let face = self.face(&seen[hit.seen]);
                let surface = if self.is_varied(face) { hit.seen } else { groups[hit.seen] };
                let entry = (surface as u64) << 32 | u64::from(face.material);
                mix(hash, entry + 1)
            });
            kind.is_edge |= *stack.get_or_insert(signature) != signature;
            if i >= count {
                continue;
            }
            fragments.clear();
            for hit in hits.iter() {
                let shaded = self.shaded(corner, candidates, &mut seen[hit.seen]);
                kind.is_textured |= self.is_textured(self.face(&seen[hit.seen]));
                kind.texels_per_pixel = kind.texels_per_pixel.max(shaded.texels_per_pixel);
                fragments.push(self.fragment(&seen[hit.seen], hit, shaded));
            }
            let color = composite_sorted(&fragments, &self.screen.world.models, self.screen.background(points[i]));
            sum.iter_mut().zip(color).for_each(|(sum, c)| *sum += c);
        }
        (sum.map(|c| c / count as f64), kind)
    }

    /// Finds the points that a face covers.
    fn cover(
        &self,
        corner: [f64; 2],
        points: &[[f64; 2]],
        face: u32,
        range: Range<usize>,
        candidates: &[u32],
        seen: &mut Vec<Seen<'s>>,
        at_point: &mut [Vec<Hit>],
    ) {
        let screen: &'s Screen<'s> = self.screen;
        let [low, high] = self.bounds;
        let (min, max) = ([corner[0] + low, corner[1] + low], [corner[0] + high, corner[1] + high]);
        let pieces: Vec<_> = candidates[range.clone()]
            .iter()
            .map(|i| &screen.pieces[*i as usize])
            .map(|piece| (piece, overlap(&piece.corners, min, max)))
            .filter(|(_, overlap)| *overlap != Overlap::Nothing)
            .collect();
        if pieces.is_empty() {
            return;
        }
        let hit_by = |point: [f64; 2]| {
            let hit =
                |piece: &&(&crate::screen::Piece, Overlap)| piece.1 == Overlap::Whole || hits(&piece.0.corners, point);
            pieces.iter().find(hit).map(|(piece, _)| Place { piece, point })
        };
        let cutoff = screen.cutoff(face);
        let range_m = screen.state.environment.visibility_m.unwrap_or(f64::INFINITY);
        let mut covered = vec![false; points.len()];
        let mut any = false;
        for (i, point) in points.iter().enumerate() {
            let Some(place) = hit_by(*point) else { continue };
            covered[i] = true;
            any = true;
            let is_cut_out = cutoff.is_some_and(|cutoff| screen.alpha_at(place) < cutoff);
            if !is_cut_out && screen.distance(place) <= range_m {
                at_point[i].push(Hit { seen: seen.len(), inverse: place.piece.inverse_depth(*point) });
            }
        }
        if any {
            let centre = hit_by([corner[0] + 0.5, corner[1] + 0.5]);
            let nearest = || self.by_distance.iter().find(|i| covered[**i]).and_then(|i| hit_by(points[*i]));
            seen.push(Seen { face, pieces: range, at: centre.or_else(nearest), shaded: None });
        }
    }

    /// Gives faces that lie in one plane the depth of the lowest among them, so that their rank decides. Where the
    /// scene says which plane that is, they have it already.
    fn settle_planes(&self, seen: &[Seen<'s>], groups: &[usize], hits: &mut [Hit]) {
        let old: Vec<Hit> = hits.to_vec();
        for hit in hits {
            let same = old.iter().filter(|other| groups[other.seen] == groups[hit.seen]);
            if let Some(lowest) = same.min_by_key(|other| self.rank(&seen[other.seen])) {
                hit.inverse = lowest.inverse;
            }
        }
    }

    fn shaded(&self, corner: [f64; 2], candidates: &[u32], seen: &mut Seen<'s>) -> Shaded {
        let (screen, pieces) = (self.screen, &candidates[seen.pieces.clone()]);
        let at = seen.at;
        *seen.shaded.get_or_insert_with(|| {
            let at = at.expect("a face with a hit among the points has a covered point");
            let covered = |side: usize| {
                let place = |[x, y]: [f64; 2]| {
                    let point = [corner[0] + x, corner[1] + y];
                    let mut pieces = pieces.iter().map(|i| &screen.pieces[*i as usize]);
                    pieces.find(|piece| hits(&piece.corners, point)).map(|piece| Place { piece, point })
                };
                points::grid(side).filter_map(place).collect()
            };
            screen.shade(at, self.options.filtering, &covered)
        })
    }

    fn fragment(&self, seen: &Seen<'s>, hit: &Hit, shaded: Shaded) -> Fragment {
        let face = self.face(seen);
        Fragment {
            depth: -hit.inverse,
            rank: face.rank,
            color: shaded.color,
            alpha: shaded.alpha,
            is_opaque: !self.screen.is_translucent(seen.face),
            member: self.screen.world.instances[face.instance as usize].member,
        }
    }

    fn face(&self, seen: &Seen<'s>) -> &'s crate::screen::Face {
        &self.screen.faces[seen.face as usize]
    }

    fn is_textured(&self, face: &crate::screen::Face) -> bool {
        let material = &self.screen.materials[face.material as usize];
        material.base_texture.is_some() || material.emissive_texture.is_some()
    }

    /// Whether its colour isn't the same all over its plane.
    fn is_varied(&self, face: &crate::screen::Face) -> bool {
        self.is_textured(face) || !self.screen.world.instances[face.instance as usize].mesh.colors.is_empty()
    }

    fn rank(&self, seen: &Seen<'s>) -> (i32, u32, u32) {
        self.face(seen).rank
    }

    /// Whether nothing behind the face can be seen: it is opaque and not a version of something.
    fn hides(&self, seen: &Seen<'s>) -> bool {
        let instance = self.face(seen).instance as usize;
        !self.screen.is_translucent(seen.face) && self.screen.world.instances[instance].member.is_none()
    }
}

/// FNV-1a over an entry's bytes.
fn mix(hash: u64, entry: u64) -> u64 {
    entry.to_le_bytes().iter().fold(hash, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}
