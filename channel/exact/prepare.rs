//! A pixel's faces made ready: which of them reach it, by which of their edges it is cut, and in which order they stand.

use super::ExactFace;
use super::polygon::{Bounds, Line, larger, lesser};
use super::versions::Versions;
use crate::room::room;
use std::cmp::Ordering;

/// Bound on the rounding of a comparison of two inverse distances, relative to the sum of the magnitudes of their terms: a few
/// operations, each wrong by 2⁻⁵³ at most.
const ROUNDING: f64 = 1.0 / (1u64 << 48) as f64;

/// Up to this many faces are sorted as they come, which for few is faster. A guess.
const INSERTED_MAX: usize = 20;

/// How one edge of a face lies with respect to the pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Edge {
    /// The whole pixel is on its inner side.
    #[default]
    Aside,
    /// Its line goes through the pixel, but it ends before.
    Beyond,
    /// It goes through the pixel.
    Through,
}

/// A face that reaches the pixel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Prepared {
    /// Index into what was handed over.
    pub(super) face: usize,
    pub(super) edges: [Edge; 3],
    lines: [Line; 3],
    line_count: usize,
    /// Of its corners.
    pub(super) around: Bounds,
    /// Inverse distance at the pixel's upper left, and its change per pixel.
    pub(super) q: [f64; 3],
    /// Sum of the magnitudes of its terms.
    terms: f64,
    /// Hides everything behind it.
    pub(super) is_opaque: bool,
    /// Has to be mixed by the rules of its model.
    pub(super) is_part: bool,
}

impl Prepared {
    /// Becomes a face, in its place, because moving it there takes as long as making it. Returns false, and is nothing in particular,
    /// if the face covers nothing of the pixel, or isn't a face at all: without area, or not of finite numbers.
    #[inline]
    fn set(&mut self, number: usize, face: &ExactFace<'_>, is_part: bool) -> bool {
        let ([x0, x1, x2], [y0, y1, y2]) = (face.x, face.y);
        let area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0);
        let around = Bounds::of_triangle(face.x, face.y);
        if !(area > 0.0 && area.is_finite() && face.alpha > 0.0) || around.are_apart(&Bounds::SQUARE) {
            return false;
        }
        self.edges = [Edge::Aside; 3];
        self.line_count = 0;
        for k in 0..3 {
            let next = if k == 2 { 0 } else { k + 1 };
            let (from, to) = ([face.x[k], face.y[k]], [face.x[next], face.y[next]]);
            let (a, b) = (from[1] - to[1], to[0] - from[0]);
            // The upper end anchors the line, so that of two faces that share an edge, one has the other's function with the sign
            // turned, to the bit: no gap, however far the ends are.
            let [x, y] = if is_downward(from, to) { from } else { to };
            let line = Line::new(a, b, -(a * x + b * y));
            let [low, high] = line.over_square();
            if high <= line.slack {
                return false;
            }
            if low < -line.slack {
                self.lines[self.line_count] = line;
                self.line_count += 1;
                let is_beyond = |a: f64, b: f64| larger(a, b) <= 0.0 || lesser(a, b) >= 1.0;
                let is_beyond = is_beyond(from[0], to[0]) || is_beyond(from[1], to[1]);
                self.edges[k] = if is_beyond { Edge::Beyond } else { Edge::Through };
            }
        }
        self.face = number;
        self.around = around;
        self.q = [face.q0, face.qx, face.qy];
        self.terms = face.q0.abs() + face.qx.abs() + face.qy.abs();
        self.is_opaque = face.alpha == 1.0 && !is_part;
        self.is_part = is_part;
        true
    }

    /// The edges' lines that go through the pixel: within it, the face is what is inside of all of them.
    #[inline]
    pub(super) fn lines(&self) -> &[Line] {
        &self.lines[..self.line_count]
    }

    /// Inverse distance at a place in the pixel.
    #[inline]
    pub(super) fn q_at(&self, [x, y]: [f64; 2]) -> f64 {
        self.q[0] + (self.q[1] * x + self.q[2] * y)
    }

    /// The function that is positive where this face is in front of another: the difference of two affine functions is affine.
    #[inline]
    pub(super) fn in_front_of(&self, other: &Self) -> Line {
        let [c, a, b] = [0, 1, 2].map(|i| self.q[i] - other.q[i]);
        Line { a, b, c, slack: ROUNDING * (self.terms + other.terms) }
    }

    /// Least and largest inverse distance over the pixel, or over the face if that says more.
    #[inline]
    pub(super) fn bounds(&self, face: &ExactFace<'_>) -> [f64; 2] {
        let [q, dx, dy] = self.q;
        let [a, b, c] = [0, 1, 2].map(|k| self.q_at([face.x[k], face.y[k]]));
        let farthest = larger(q + (lesser(dx, 0.0) + lesser(dy, 0.0)), lesser(lesser(a, b), c));
        let nearest = lesser(q + (larger(dx, 0.0) + larger(dy, 0.0)), larger(larger(a, b), c));
        [farthest, nearest]
    }
}

/// Whether an edge goes down, or right if it is level.
#[inline]
pub(super) fn is_downward(from: [f64; 2], to: [f64; 2]) -> bool {
    from[1] < to[1] || (from[1] == to[1] && from[0] < to[0])
}

/// Where a face stands in the order.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// Inverse distance at the pixel's centre.
    q: f64,
    order: u64,
    index: usize,
}

/// The faces that reach the pixel, nearest at its centre first.
#[derive(Debug, Default)]
pub(super) struct Faces {
    /// The first `count` are faces, the others are room.
    prepared: Vec<Prepared>,
    count: usize,
    places: Vec<Place>,
    pub(super) has_parts: bool,
    /// By the order: least and largest inverse distance of a face.
    ranges: Vec<[f64; 2]>,
    /// By the order: the largest inverse distance of the faces that follow.
    after: Vec<f64>,
}

room!(Faces: prepared, places, ranges, after; count, has_parts);

impl Faces {
    /// Of all faces.
    pub(super) fn set(&mut self, faces: &[ExactFace<'_>]) {
        self.clear();
        for (number, face) in faces.iter().enumerate() {
            self.add(faces, number, face.part.is_some());
        }
        self.sort(faces);
        self.set_ranges(faces);
    }

    /// Of those faces that a choice of versions shows, as if they belonged to no model.
    pub(super) fn set_versions(&mut self, faces: &[ExactFace<'_>], versions: &Versions) {
        self.clear();
        for (number, face) in faces.iter().enumerate() {
            if versions.shows(face) {
                self.add(faces, number, false);
            }
        }
        self.sort(faces);
        self.set_ranges(faces);
    }

    fn clear(&mut self) {
        self.count = 0;
        self.places.clear();
        self.has_parts = false;
    }

    #[inline]
    fn add(&mut self, faces: &[ExactFace<'_>], number: usize, is_part: bool) {
        let face = &faces[number];
        if self.count == self.prepared.len() {
            self.prepared.push(Prepared::default());
        }
        let prepared = &mut self.prepared[self.count];
        if !prepared.set(number, face, is_part) {
            return;
        }
        self.has_parts |= is_part;
        let place = Place { q: prepared.q_at([0.5; 2]), order: face.order, index: self.count };
        self.count += 1;
        let mut k = self.places.len();
        self.places.push(place);
        if k >= INSERTED_MAX {
            return;
        }
        while k > 0 && self.is_before(faces, &place, &self.places[k - 1]) {
            self.places[k] = self.places[k - 1];
            k -= 1;
        }
        self.places[k] = place;
    }

    /// Sorts what was too much for inserting.
    fn sort(&mut self, faces: &[ExactFace<'_>]) {
        if self.places.len() > INSERTED_MAX {
            let mut places = std::mem::take(&mut self.places);
            places.sort_unstable_by(|a, b| {
                let corners = |place: &Place| {
                    let face = &faces[self.prepared[place.index].face];
                    [face.x, face.y]
                };
                let by_corners = || corners(a).partial_cmp(&corners(b)).unwrap_or(Ordering::Equal);
                b.q.total_cmp(&a.q).then(b.order.cmp(&a.order)).then_with(by_corners)
            });
            self.places = places;
        }
    }

    /// A total order of what the faces are. Only pieces of one face have all but their corners in common.
    #[inline]
    fn is_before(&self, faces: &[ExactFace<'_>], a: &Place, b: &Place) -> bool {
        if a.q != b.q {
            return a.q > b.q;
        }
        if a.order != b.order {
            return a.order > b.order;
        }
        let [a, b] = [a, b].map(|place| &faces[self.prepared[place.index].face]);
        let corners = |face: &ExactFace<'_>| [face.x, face.y];
        corners(a) < corners(b)
    }

    #[inline]
    pub(super) fn len(&self) -> usize {
        self.places.len()
    }

    /// Face k in the order.
    #[inline]
    pub(super) fn at(&self, k: usize) -> &Prepared {
        &self.prepared[self.places[k].index]
    }

    /// Which of two faces is in front where both are equally near.
    #[inline]
    pub(super) fn by_rank(&self, a: usize, b: usize) -> Ordering {
        self.places[b].order.cmp(&self.places[a].order).then(a.cmp(&b))
    }

    /// Computes how near the faces come, for what is asked below.
    fn set_ranges(&mut self, faces: &[ExactFace<'_>]) {
        self.ranges.clear();
        for place in &self.places {
            let prepared = &self.prepared[place.index];
            self.ranges.push(prepared.bounds(&faces[prepared.face]));
        }
        self.after.clear();
        self.after.resize(self.ranges.len(), f64::NEG_INFINITY);
        for k in (1..self.ranges.len()).rev() {
            self.after[k - 1] = larger(self.after[k], self.ranges[k][1]);
        }
    }

    /// Least and largest inverse distance of face k in the order, within the pixel.
    #[inline]
    pub(super) fn range(&self, k: usize) -> [f64; 2] {
        self.ranges[k]
    }

    /// Whether face k is in front of all that follow `last` in the order, wherever in the pixel they meet; `last` is k or follows it.
    #[inline]
    pub(super) fn is_in_front_of_all_after(&self, k: usize, last: usize) -> bool {
        self.ranges[k][0] >= self.after[last]
    }
}

/// The members of a set of faces, in order.
#[inline]
pub(super) fn members(mut set: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let k = set.trailing_zeros() as usize;
        (set != 0).then(|| {
            set &= set - 1;
            k
        })
    })
}
