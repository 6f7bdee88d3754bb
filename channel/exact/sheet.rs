//! Sheets: faces of a mesh that share their edges need no cutting.
//!
//! How many faces of a set cover a point is the winding number of their outlines round it, and it changes only across an
//! outline. Where every edge that goes through the pixel belongs to two of the faces, once in either direction, the outlines cancel there:
//! the number is the same all over the pixel, and equal to the sum of the faces' areas in it. If that is 1 they cover the pixel
//! and don't overlap, whatever their depths, and the pixel's colour is the sum of area times colour.
//!
//! The areas come from the edges alone: what lies in the pixel to the right of a face's left edges, less what lies to the right
//! of its right edges. An edge's share is computed once for both of its faces, and its rounding cancels.

use super::ExactFace;
use super::polygon::{larger, lesser};
use super::prepare::{Edge, Faces, is_downward, members};

/// More faces than this aren't tried: they are a bit each in a word.
pub(super) const SHEET_MAX: usize = 64;

/// A sum of areas this near to 1 is 1. Others are whole numbers, but for rounding, which is below 1e-8 for corners at 1e7 pixels.
const WHOLE: f64 = 1e-6;

/// Segments that descend less than this in the pixel have nothing to their right, pixels. Their slope could overflow.
const LEVEL: f64 = 1e-15;

/// A face's edge that goes through the pixel, from its upper end to its lower one.
#[derive(Clone, Copy, Debug)]
struct Half {
    upper: [f64; 2],
    lower: [f64; 2],
    face: usize,
    /// The face has it running downwards, on its right.
    is_downward: bool,
}

/// Which faces share edges in the pixel.
#[derive(Debug)]
pub(super) struct Sheets {
    /// Edges that no other face was found for yet.
    single: Vec<Half>,
    /// Bit j of entry i: faces i and j, in the order, share an edge, so they don't overlap.
    pub(super) neighbours: [u64; SHEET_MAX],
    /// The faces that have edges through the pixel that aren't shared.
    open: u64,
    /// Areas in the pixel, pixels²; of faces with edges that aren't shared, not all of it.
    pub(super) areas: [f64; SHEET_MAX],
}

impl Default for Sheets {
    fn default() -> Self {
        Self { single: Vec::new(), neighbours: [0; SHEET_MAX], open: 0, areas: [0.0; SHEET_MAX] }
    }
}

impl Sheets {
    /// Finds the shared edges of up to [`SHEET_MAX`] faces.
    fn set(&mut self, faces: &[ExactFace<'_>], order: &Faces) {
        self.single.clear();
        for k in 0..order.len() {
            self.neighbours[k] = 0;
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
                        self.pair(Half { upper, lower, face: k, is_downward }, &mut area);
                    }
                }
            }
            self.areas[k] = area;
        }
        self.open = self.single.iter().fold(0, |set, half| set | 1 << half.face);
    }

    /// Pairs an edge with the same edge of an earlier face, running the other way.
    #[inline]
    fn pair(&mut self, half: Half, area: &mut f64) {
        let is_twin = |other: &Half| {
            (other.upper[0] == half.upper[0])
                & (other.upper[1] == half.upper[1])
                & (other.lower[0] == half.lower[0])
                & (other.lower[1] == half.lower[1])
                & (other.is_downward != half.is_downward)
        };
        let Some(at) = self.single.iter().position(is_twin) else {
            self.single.push(half);
            return;
        };
        let twin = self.single.swap_remove(at);
        self.neighbours[half.face] |= 1 << twin.face;
        self.neighbours[twin.face] |= 1 << half.face;
        let share = right_of(half.upper, half.lower);
        let share = if half.is_downward { -share } else { share };
        *area += share;
        self.areas[twin.face] -= share;
    }

    /// The faces that are connected with face `first` through shared edges, if they are opaque, cover the pixel without
    /// overlap, and hide all other faces from `first` on in the order. There are up to [`SHEET_MAX`] faces.
    #[inline]
    pub(super) fn covering_from(&self, faces: &[ExactFace<'_>], order: &Faces, first: usize) -> Option<u64> {
        let mut sheet = 1 << first;
        let mut fresh: u64 = sheet;
        while fresh != 0 {
            let k = fresh.trailing_zeros() as usize;
            if self.open >> k & 1 != 0 || !order.at(k).is_opaque {
                return None;
            }
            let found = self.neighbours[k] & !sheet;
            sheet |= found;
            fresh = fresh & (fresh - 1) | found;
        }
        let total: f64 = members(sheet).map(|k| self.areas[k]).sum();
        if (total - 1.0).abs() > WHOLE {
            return None;
        }
        let others = u64::MAX >> (SHEET_MAX - order.len()) & u64::MAX << first & !sheet;
        if others != 0 {
            let bounds = |k: usize| order.at(k).bounds(&faces[order.at(k).face]);
            let farthest = members(sheet).map(|k| bounds(k)[0]).fold(f64::INFINITY, lesser);
            // Where they are equally near, only what follows all of the sheet in the order is behind.
            let last = sheet.ilog2() as usize;
            let is_behind = |k: usize| bounds(k)[1] < farthest || (k > last && bounds(k)[1] == farthest);
            if !members(others).all(is_behind) {
                return None;
            }
        }
        Some(sheet)
    }

    /// The pixel's colour if the nearest of up to [`SHEET_MAX`] faces belongs to a sheet that hides all others.
    ///
    /// The neighbours are known afterwards, whether it does or not.
    #[inline]
    pub(super) fn colour(&mut self, faces: &[ExactFace<'_>], order: &Faces) -> Option<[f64; 3]> {
        debug_assert!((1..=SHEET_MAX).contains(&order.len()), "{} faces", order.len());
        self.set(faces, order);
        let sheet = self.covering_from(faces, order, 0)?;
        let mut colour = [0.0; 3];
        for k in members(sheet) {
            for (sum, c) in colour.iter_mut().zip(faces[order.at(k).face].rgb) {
                *sum += self.areas[k] * c;
            }
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
