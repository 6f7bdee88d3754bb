//! Triangles sorted into tiles: a counting sort of (tile, triangle) pairs that keeps the order of the list.
//!
//! Opaque (and MASK) triangles and translucent ones are kept apart, because the second kind is only looked at when a
//! tile's opaque faces are known. A large triangle is tested against each tile of its extent, so that a long diagonal one
//! doesn't enter tiles it never touches.

use super::coverage::Edges;
use crate::geometry::setup::Triangle;
use crate::samples::{Pattern, SUBPIXELS};
use proto::frame::{TILE, TileIndex, tile_grid};

/// No bin: the tile belongs to another board.
const NOT_OURS: u32 = u32::MAX;

/// The triangles of each owned tile.
#[derive(Debug, Default)]
pub struct Bins {
    /// Bin of each tile of the view's grid, row by row.
    slots: Vec<u32>,
    columns: u32,
    rows: u32,
    opaque: Side,
    translucent: Side,
}

/// One kind's pairs: the triangles of bin k are `triangles[starts[k]..starts[k + 1]]`.
#[derive(Debug, Default)]
struct Side {
    pairs: Vec<[u32; 2]>,
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl Bins {
    /// Sorts `triangles` into `tiles` of a view of `width` × `height` pixels; `is_translucent` tells the kinds apart.
    pub fn fill(
        &mut self,
        pattern: &Pattern,
        width: u32,
        height: u32,
        tiles: &[TileIndex],
        triangles: &[Triangle],
        is_translucent: impl Fn(&Triangle) -> bool,
    ) {
        (self.columns, self.rows) = tile_grid(width, height);
        self.slots.clear();
        self.slots.resize(self.columns as usize * self.rows as usize, NOT_OURS);
        for (slot, tile) in tiles.iter().enumerate() {
            self.slots[usize::from(tile.y) * self.columns as usize + usize::from(tile.x)] = slot as u32;
        }
        self.opaque.pairs.clear();
        self.translucent.pairs.clear();
        for (number, triangle) in triangles.iter().enumerate() {
            let side = if is_translucent(triangle) { &mut self.translucent } else { &mut self.opaque };
            let [[x0, x1], [y0, y1]] = triangle.pixels(pattern.low, pattern.high());
            let tile = TILE as i32;
            let (x0, x1) = (x0.max(0) / tile, x1.min(width as i32 - 1) / tile);
            let (y0, y1) = (y0.max(0) / tile, y1.min(height as i32 - 1) / tile);
            let edges = ((x1 - x0 + 1) * (y1 - y0 + 1) > 4).then(|| Edges::of(triangle));
            for y in y0..=y1 {
                for x in x0..=x1 {
                    let slot = self.slots[(y as u32 * self.columns + x as u32) as usize];
                    let side_sub = tile * SUBPIXELS;
                    let misses = |e: &Edges| e.misses(x * side_sub, y * side_sub, pattern.low, side_sub - pattern.low);
                    if slot != NOT_OURS && !edges.as_ref().is_some_and(misses) {
                        side.pairs.push([slot, number as u32]);
                    }
                }
            }
        }
        self.opaque.sort(tiles.len());
        self.translucent.sort(tiles.len());
    }

    /// The opaque and MASK triangles of a bin, in the order of the list.
    pub fn opaque(&self, slot: usize) -> &[u32] {
        self.opaque.bin(slot)
    }

    /// The translucent triangles of a bin.
    pub fn translucent(&self, slot: usize) -> &[u32] {
        self.translucent.bin(slot)
    }
}

impl Side {
    fn sort(&mut self, bins: usize) {
        self.starts.clear();
        self.starts.resize(bins + 2, 0);
        for [slot, _] in &self.pairs {
            self.starts[*slot as usize + 2] += 1;
        }
        for k in 2..self.starts.len() {
            self.starts[k] += self.starts[k - 1];
        }
        self.triangles.clear();
        self.triangles.resize(self.pairs.len(), 0);
        for [slot, number] in &self.pairs {
            let place = &mut self.starts[*slot as usize + 1];
            self.triangles[*place as usize] = *number;
            *place += 1;
        }
    }

    fn bin(&self, slot: usize) -> &[u32] {
        &self.triangles[self.starts[slot] as usize..self.starts[slot + 1] as usize]
    }
}
