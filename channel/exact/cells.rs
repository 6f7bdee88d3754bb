//! The general way: a region is cut until the same faces cover it everywhere, in the same order.
//!
//! First by the edges of faces, each cell then knowing the set of those that cover it; a face that is behind an opaque one
//! all over a cell cuts it no more. Then, if two covering faces that follow each other in the order at the cell's middle
//! change places within it, by the line where their inverse distances are equal. What is left has one order, and is composed
//! once. Surfaces that interpenetrate, overlap in a circle or belong to models need no further care.

use super::ExactFace;
use super::polygon::{Polygon, Sides};
use super::prepare::{Faces, Prepared, members};
use super::regions::{NOTHING, Sum};
use crate::room::room;
use crate::translucency::models::Mix;

/// Most cells that a pixel is cut into. A guess: a millisecond or two, and 1.3 MB of buffers.
pub const CELLS_MAX: usize = 4096;

/// Words of a set of faces.
const WORDS: usize = 4;
/// Most faces that a cell can tell apart.
const FACES_MAX: usize = WORDS * 64;

/// A pixel needs more regions, corners or cells than there may be.
#[derive(Clone, Copy, Debug)]
pub(super) struct TooMany;

#[derive(Clone, Copy, Debug)]
struct Cell {
    polygon: Polygon,
    /// The faces that cover it, of those before `next`: bit i is the i-th after the first.
    covering: [u64; WORDS],
    /// The face to be looked at next.
    next: usize,
}

/// Buffers for cutting regions into cells.
#[derive(Debug, Default)]
pub(super) struct Cells {
    todo: Vec<Cell>,
    /// The faces that cover a cell, nearest first, and their inverse distance at its middle.
    stack: Vec<(f64, usize)>,
    mix: Mix,
    sides: Sides,
    /// Cells that there may still be in this pixel.
    budget: usize,
    /// Whether anything was added to this pixel.
    pub(super) is_used: bool,
}

room!(Cells: todo, stack, mix; sides, budget, is_used);

impl Cells {
    /// Begins a pixel.
    pub(super) fn clear(&mut self) {
        self.budget = CELLS_MAX;
        self.is_used = false;
    }

    /// Adds the light that comes through a region from face `first` of the order and all that follow, and from the background.
    pub(super) fn add(
        &mut self,
        faces: &[ExactFace<'_>],
        order: &Faces,
        first: usize,
        region: &Polygon,
        transmitted: f64,
        background: [f64; 3],
        sum: &mut Sum,
    ) -> Result<(), TooMany> {
        self.is_used = true;
        if order.len() - first > FACES_MAX {
            return Err(TooMany);
        }
        self.todo.clear();
        self.push(Cell { polygon: *region, covering: [0; WORDS], next: first })?;
        while let Some(mut cell) = self.todo.pop() {
            self.cut_by_edges(order, first, &mut cell)?;
            let area = cell.polygon.area();
            if area < NOTHING {
                continue;
            }
            if self.cut_by_order(order, first, &cell)? {
                continue;
            }
            self.compose(faces, order, background, area * transmitted, sum);
        }
        Ok(())
    }

    fn push(&mut self, cell: Cell) -> Result<(), TooMany> {
        self.budget = self.budget.checked_sub(1).ok_or(TooMany)?;
        self.todo.push(cell);
        Ok(())
    }

    /// Makes the cell the part of it that is covered as a whole by each face that reaches it; the other parts are to be looked at later.
    fn cut_by_edges(&mut self, order: &Faces, first: usize, cell: &mut Cell) -> Result<(), TooMany> {
        while cell.next < order.len() {
            let k = cell.next;
            cell.next += 1;
            let face = order.at(k);
            if face.lines().iter().any(|line| cell.polygon.is_outside(line)) || is_hidden(order, first, cell, k) {
                continue;
            }
            let mut is_missed = false;
            for line in face.lines() {
                let sides = &mut self.sides;
                cell.polygon.set_sides(line, sides);
                if sides.inside == 0 {
                    is_missed = true;
                    break;
                }
                if sides.outside == 0 {
                    continue;
                }
                if cell.polygon.is_full() {
                    return Err(TooMany);
                }
                let (mut inside, mut outside) = (Polygon::EMPTY, *cell);
                cell.polygon.cut(sides, &mut inside, &mut outside.polygon);
                cell.polygon = inside;
                self.push(outside)?;
            }
            if !is_missed {
                cell.covering[(k - first) / 64] |= 1 << ((k - first) % 64);
            }
        }
        Ok(())
    }

    /// Sorts what covers the cell. If the order isn't the same all over it, cuts it in two, both to be looked at later, and returns true.
    fn cut_by_order(&mut self, order: &Faces, first: usize, cell: &Cell) -> Result<bool, TooMany> {
        let middle = cell.polygon.middle();
        self.stack.clear();
        self.stack.extend(covering(cell).map(|k| (order.at(first + k).q_at(middle), first + k)));
        self.stack.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(order.by_rank(a.1, b.1)));
        for pair in self.stack.windows(2) {
            let (front, back) = (order.at(pair[0].1), order.at(pair[1].1));
            let difference = front.in_front_of(back);
            let sides = &mut self.sides;
            cell.polygon.set_sides(&difference, sides);
            if sides.outside != 0 && sides.inside != 0 {
                if cell.polygon.is_full() {
                    return Err(TooMany);
                }
                let (mut a, mut b) = (*cell, *cell);
                cell.polygon.cut(sides, &mut a.polygon, &mut b.polygon);
                // A corner cut off that is nothing would leave the other part as it was, to be cut again.
                if a.polygon.area() >= NOTHING && b.polygon.area() >= NOTHING {
                    self.push(b)?;
                    self.push(a)?;
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }

    /// The colour of the sorted stack, as far as light comes through.
    fn compose(&mut self, faces: &[ExactFace<'_>], order: &Faces, background: [f64; 3], share: f64, sum: &mut Sum) {
        let stack = self.stack.iter().map(|(_, k)| order.at(*k));
        let (rgb, transmitted) = compose(&mut self.mix, faces, stack);
        sum.add(rgb, share);
        sum.add(background, share * transmitted);
    }
}

/// What comes through faces, nearest first: linear RGB, and the part of what is behind.
pub(super) fn compose<'a>(
    mix: &mut Mix,
    faces: &[ExactFace<'_>],
    stack: impl Iterator<Item = &'a Prepared>,
) -> ([f64; 3], f64) {
    mix.clear();
    for prepared in stack {
        let face = &faces[prepared.face];
        let (member, is_translucent) = match face.part.as_ref().filter(|_| prepared.is_part) {
            Some(part) => (Some(&part.member), part.is_translucent),
            None => (None, face.alpha < 1.0),
        };
        if member.is_some_and(|member| mix.is_lost(member, is_translucent)) {
            continue;
        }
        let [r, g, b] = face.rgb;
        mix.add(member, is_translucent, [r, g, b, face.alpha]);
        if mix.transmitted() == 0.0 {
            break;
        }
    }
    let through = mix.through();
    (through.rgb, through.transmitted)
}

/// The faces that cover a cell, by their number after the first.
fn covering(cell: &Cell) -> impl Iterator<Item = usize> {
    cell.covering.into_iter().enumerate().flat_map(|(word, bits)| members(bits).map(move |bit| word * 64 + bit))
}

/// Whether face k is behind an opaque face that covers the cell, all over it.
fn is_hidden(order: &Faces, first: usize, cell: &Cell, k: usize) -> bool {
    let back = order.at(k);
    covering(cell).map(|hider| order.at(first + hider)).filter(|front| front.is_opaque).any(|front| {
        let difference = front.in_front_of(back);
        // Where they are equally near, the one earlier in the order is in front.
        cell.polygon.corners().iter().all(|corner| difference.at(*corner) >= 0.0)
    })
}
