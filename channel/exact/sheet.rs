//! Sheets: faces of a mesh that share their edges need no cutting.
//!
//! How many faces of a set cover a point is the winding number of their outlines round it, and it changes only across an
//! outline. Where every edge that goes through the pixel belongs to two of the faces, once in either direction, the outlines cancel there:
//! the number is the same all over the pixel, and equal to the sum of the faces' areas in it. If that is 1 they cover the pixel
//! and don't overlap, whatever their depths, and the pixel's colour is the sum of area times colour.
//!
//! The same holds for a translucent sheet, and for sheets one behind the other: if each has one saturation, every point of the pixel gets the
//! same part of its light from each, and the pixel's colour is the sum of these parts of the sheets' mean colours.
//!
//! The areas come from the edges alone: what lies in the pixel to the right of a face's left edges, less what lies to the right
//! of its right edges. An edge's share is computed once for both of its faces, and its rounding cancels.

use super::ExactFace;
use super::polygon::{larger, lesser};
use super::prepare::{Edge, Faces, is_downward};
use crate::room::room;

/// A sum of areas this near to 1 is 1. Others are whole numbers, but for rounding, which is below 1e-8 for corners at 1e7 pixels.
const WHOLE: f64 = 1e-6;

/// Segments that descend less than this in the pixel have nothing to their right, pixels. Their slope could overflow.
const LEVEL: f64 = 1e-15;

/// No index.
const NONE: u32 = u32::MAX;

/// Chains of edges; enough for one edge a chain in an ordinary pixel.
const CHAINS: usize = 32;

/// A face's edge that goes through the pixel, from its upper end to its lower one.
#[derive(Clone, Copy, Debug)]
struct Half {
    upper: [f64; 2],
    lower: [f64; 2],
    face: u32,
    /// Which of the face's edges.
    edge: u8,
    /// The face has it running downwards, on its right.
    is_downward: bool,
    /// No other face was found for it yet.
    is_single: bool,
    /// The next one of its chain.
    next: u32,
}

impl Half {
    /// The chain that it is in, and its twin.
    #[inline]
    fn chain(&self) -> usize {
        let [a, b, c] = [self.upper[0], self.upper[1], self.lower[0]].map(f64::to_bits);
        let mixed = (a ^ b.rotate_left(21) ^ c.rotate_left(42)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (mixed >> 59) as usize
    }
}

/// What edges say about a face.
#[derive(Clone, Copy, Debug)]
struct Member {
    /// By edge, the face that shares it.
    neighbours: [u32; 3],
    /// It has an edge through the pixel that no other face shares.
    is_open: bool,
    /// Its area in the pixel, pixels²; if it is open, not all of it.
    area: f64,
    /// The last sheet that it was found to be in, by number.
    sheet: u32,
}

/// Which faces share edges in the pixel.
#[derive(Debug)]
pub(super) struct Sheets {
    /// By the faces' order.
    members: Vec<Member>,
    halves: Vec<Half>,
    /// The first edge of each chain.
    heads: [u32; CHAINS],
    /// The faces of the sheet that was found last, in an order that the faces decide.
    found: Vec<u32>,
    /// Number of that sheet.
    sheet: u32,
}

room!(Sheets: members, halves, found; heads, sheet);

impl Default for Sheets {
    fn default() -> Self {
        Self { members: Vec::new(), halves: Vec::new(), heads: [NONE; CHAINS], found: Vec::new(), sheet: 0 }
    }
}

impl Sheets {
    /// Finds the shared edges.
    fn set(&mut self, faces: &[ExactFace<'_>], order: &Faces) {
        self.sheet = 0;
        self.halves.clear();
        self.heads = [NONE; CHAINS];
        self.members.clear();
        self.members.resize(order.len(), Member { neighbours: [NONE; 3], is_open: false, area: 0.0, sheet: NONE });
        for k in 0..order.len() {
            let prepared = order.at(k);
            let face = &faces[prepared.face];
            let mut area = 0.0;
            for (i, edge) in prepared.edges.iter().enumerate() {
                let next = if i == 2 { 0 } else { i + 1 };
                let (from, to) = ([face.x[i], face.y[i]], [face.x[next], face.y[next]]);
                match edge {
                    // Left of the pixel if the face has it running upwards, else right of it.
                    Edge::Aside => area += larger(clamp(from[1]) - clamp(to[1]), 0.0),
                    Edge::Beyond if is_downward(from, to) => area -= right_of(from, to),
                    Edge::Beyond => area += right_of(to, from),
                    Edge::Through => {
                        let is_downward = is_downward(from, to);
                        let (upper, lower) = if is_downward { (from, to) } else { (to, from) };
                        let (face, edge) = (k as u32, i as u8);
                        let half = Half { upper, lower, face, edge, is_downward, is_single: true, next: NONE };
                        area += self.pair(half);
                    }
                }
            }
            self.members[k].area += area;
        }
        for half in self.halves.iter().filter(|half| half.is_single) {
            self.members[half.face as usize].is_open = true;
        }
    }

    /// Pairs an edge with the same edge of an earlier face, running the other way, and returns what it adds to its face's area.
    #[inline]
    fn pair(&mut self, half: Half) -> f64 {
        let chain = half.chain();
        let mut at = self.heads[chain];
        while let Some(other) = self.halves.get_mut(at as usize) {
            let is_same = (other.upper[0] == half.upper[0])
                & (other.upper[1] == half.upper[1])
                & (other.lower[0] == half.lower[0])
                & (other.lower[1] == half.lower[1]);
            if is_same & other.is_single & (other.is_downward != half.is_downward) {
                other.is_single = false;
                let share = right_of(half.upper, half.lower);
                let share = if half.is_downward { -share } else { share };
                let twin = &mut self.members[other.face as usize];
                twin.neighbours[usize::from(other.edge)] = half.face;
                twin.area -= share;
                let face = other.face;
                self.members[half.face as usize].neighbours[usize::from(half.edge)] = face;
                return share;
            }
            at = other.next;
        }
        let next = std::mem::replace(&mut self.heads[chain], self.halves.len() as u32);
        self.halves.push(Half { next, ..half });
        0.0
    }

    /// Whether two faces, by their places in the order, share an edge: then they don't overlap.
    #[inline]
    pub(super) fn are_neighbours(&self, a: usize, b: usize) -> bool {
        self.members[a].neighbours.contains(&(b as u32))
    }

    /// The area in the pixel of a face of a sheet.
    #[inline]
    pub(super) fn area(&self, k: usize) -> f64 {
        self.members[k].area
    }

    /// The faces that [`Self::covers_from`] found.
    #[inline]
    pub(super) fn found(&self) -> impl DoubleEndedIterator<Item = usize> {
        self.found.iter().map(|k| *k as usize)
    }

    /// Finds the faces that are connected with face `first` through shared edges. Returns whether they cover the pixel without overlap,
    /// all have one saturation, and none is of a model that needs mixing.
    #[inline(always)]
    fn is_sheet(&mut self, faces: &[ExactFace<'_>], order: &Faces, first: usize) -> bool {
        self.sheet += 1;
        let sheet = self.sheet;
        self.found.clear();
        self.found.push(first as u32);
        self.members[first].sheet = sheet;
        let alpha = faces[order.at(first).face].alpha;
        let mut total = 0.0;
        let mut next = 0;
        while let Some(k) = self.found.get(next) {
            let k = *k as usize;
            let member = self.members[k];
            let prepared = order.at(k);
            if member.is_open || prepared.is_part || faces[prepared.face].alpha != alpha {
                return false;
            }
            total += member.area;
            for neighbour in member.neighbours {
                if let Some(member) = self.members.get_mut(neighbour as usize)
                    && member.sheet != sheet
                {
                    member.sheet = sheet;
                    self.found.push(neighbour);
                }
            }
            next += 1;
        }
        (total - 1.0).abs() <= WHOLE
    }

    /// Whether the sheet that was found last hides, or lies in front of, all faces from `first` on in the order but those in `others`.
    #[inline(always)]
    fn is_in_front(&self, order: &Faces, first: usize, others: impl Fn(u32) -> bool) -> bool {
        if self.found.len() == order.len() {
            return true;
        }
        let farthest = self.found().map(|k| order.range(k)[0]).fold(f64::INFINITY, lesser);
        let last = self.found().max().unwrap_or(first);
        // Where they are equally near, only what follows all of the sheet in the order is behind.
        let is_behind = |k: usize| order.range(k)[1] < farthest || (k > last && order.range(k)[1] == farthest);
        (first..order.len()).all(|k| {
            let own = self.members[k].sheet;
            own == self.sheet || others(own) || is_behind(k)
        })
    }

    /// Whether the faces that are connected with face `first` through shared edges are opaque, cover the pixel without overlap,
    /// and hide all other faces from `first` on in the order.
    #[inline]
    pub(super) fn covers_from(&mut self, faces: &[ExactFace<'_>], order: &Faces, first: usize) -> bool {
        order.at(first).is_opaque && self.is_sheet(faces, order, first) && self.is_in_front(order, first, |_| false)
    }

    /// The pixel's colour if it is made of sheets one behind the other, the last one opaque or the background. The shared edges are known
    /// afterwards, if not.
    #[inline]
    pub(super) fn colour(&mut self, faces: &[ExactFace<'_>], order: &Faces, background: [f64; 3]) -> Option<[f64; 3]> {
        let nearest = order.at(0);
        if nearest.is_opaque && nearest.lines().is_empty() {
            let [farthest, _] = order.range(0);
            if (1..order.len()).all(|k| order.range(k)[1] <= farthest) {
                return Some(faces[nearest.face].rgb);
            }
        }
        self.set(faces, order);
        let mut colour = [0.0; 3];
        let mut transmitted = 1.0;
        let mut first = 0;
        loop {
            // Sheets that were found before are in front.
            let found_before = |sheet: u32| sheet != NONE;
            if !self.is_sheet(faces, order, first) || !self.is_in_front(order, first, found_before) {
                return None;
            }
            let alpha = faces[order.at(first).face].alpha;
            for k in self.found() {
                let share = self.area(k) * (transmitted * alpha);
                for (sum, c) in colour.iter_mut().zip(faces[order.at(k).face].rgb) {
                    *sum += share * c;
                }
            }
            transmitted *= 1.0 - alpha;
            if transmitted == 0.0 {
                return Some(colour);
            }
            match (first + 1..order.len()).find(|k| self.members[*k].sheet == NONE) {
                Some(next) => first = next,
                None => break,
            }
        }
        for (sum, c) in colour.iter_mut().zip(background) {
            *sum += transmitted * c;
        }
        Some(colour)
    }
}

#[inline]
fn clamp(v: f64) -> f64 {
    lesser(larger(v, 0.0), 1.0)
}

/// The area of the pixel to the right of a segment that goes down, within the segment's height. Pixels².
#[inline]
fn right_of([x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) -> f64 {
    let (top, bottom) = (clamp(y0), clamp(y1));
    let height = bottom - top;
    if height <= LEVEL {
        return 0.0;
    }
    let slope = (x1 - x0) / (y1 - y0);
    // How much of a row is right of the segment, before it is clamped to the pixel.
    let (a, b) = (1.0 - (x0 + (top - y0) * slope), 1.0 - (x0 + (bottom - y0) * slope));
    let (low, high) = (lesser(a, b), larger(a, b));
    if low >= 0.0 && high <= 1.0 {
        return height * (low + high) * 0.5;
    }
    if high <= 0.0 {
        return 0.0;
    }
    if low >= 1.0 {
        return height;
    }
    // The mean over the height of a value that rises evenly from low to high, clamped: a ramp and a level part. The width isn't 0,
    // for one of the ends is outside of 0 to 1 and the other isn't on the same side.
    let (from, to) = (clamp(low), clamp(high));
    let ramp = (to - from) * (to + from) * 0.5;
    height * ((ramp + (high - to)) / (high - low))
}
