//! Pixels with too much in them for the other ways are cut into quarters, and these again: each has fewer faces.
//!
//! A quarter is a pixel of its own: positions are doubled, which is exact, so that faces which share a corner still do. A face's
//! colour stays that of the whole pixel.

use super::ExactFace;
use super::prepare::Faces;
use crate::room::{Room, emptied};

/// How often a pixel is quartered at most: 1024 parts. A guess: a mesh of some 10 000 faces in one pixel gets by with it.
pub(super) const DEPTH_MAX: usize = 5;

/// Buffers: by depth, the faces of the square that is cut and of its quarter that is worked on. Empty between pixels.
#[derive(Debug, Default)]
pub(super) struct Quarters {
    squares: [[Vec<ExactFace<'static>>; 2]; DEPTH_MAX],
}

impl Room for Quarters {
    fn make_room(&mut self, other: &Self) {
        self.squares.make_room(&other.squares);
    }
}

impl Quarters {
    /// Takes the two buffers of a depth, empty.
    pub(super) fn take<'a>(&mut self, depth: usize) -> [Vec<ExactFace<'a>>; 2] {
        std::mem::take(&mut self.squares[depth]).map(emptied)
    }

    /// Gives them back.
    pub(super) fn give(&mut self, depth: usize, buffers: [Vec<ExactFace<'_>>; 2]) {
        self.squares[depth] = buffers.map(emptied);
    }
}

/// The prepared faces as they were handed over, those that are taken as ordinary ones without their models.
pub(super) fn present<'a>(faces: &[ExactFace<'a>], prepared: &Faces, out: &mut Vec<ExactFace<'a>>) {
    out.clear();
    out.extend((0..prepared.len()).map(|k| {
        let prepared = prepared.at(k);
        let face = faces[prepared.face];
        ExactFace { part: face.part.filter(|_| prepared.is_part), ..face }
    }));
}

/// The faces that may reach quarter `number` (0 to 3: row by row) of the square that `faces` are in, in that quarter's units.
pub(super) fn quarter<'a>(faces: &[ExactFace<'a>], number: usize, out: &mut Vec<ExactFace<'a>>) {
    let [left, top] = [(number % 2) as f64, (number / 2) as f64];
    out.clear();
    out.extend(faces.iter().filter_map(|face| {
        let (x, y) = (face.x.map(|x| x * 2.0 - left), face.y.map(|y| y * 2.0 - top));
        let is_beside = |c: [f64; 3]| c.iter().all(|c| *c <= 0.0) || c.iter().all(|c| *c >= 1.0);
        (!is_beside(x) && !is_beside(y)).then_some(ExactFace {
            x,
            y,
            q0: face.q0 + 0.5 * (left * face.qx + top * face.qy),
            qx: 0.5 * face.qx,
            qy: 0.5 * face.qy,
            ..*face
        })
    }));
}
