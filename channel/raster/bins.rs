//! Triangles sorted into tiles: per run of geometry a counting sort of (tile, triangle) pairs that keeps the order of the list.
//!
//! Each run sorts its own triangles, in the thread that made them; a tile then goes through the runs in order. So nothing is
//! joined, copied or locked between geometry and tiles, and the order is that of the list whatever the number of threads.
//!
//! Opaque (and MASK) triangles and translucent ones are kept apart, because the second kind is only looked at when a
//! tile's opaque faces are known. A large triangle is tested against each tile of its extent, so that a long diagonal one
//! doesn't enter tiles it never touches. What is known to be hidden in a tile, since a face before it covers all of that, doesn't enter it either.

use super::coverage::Edges;
use super::fronts::{Nearest, TileFronts};
use crate::geometry::setup::{Flags, Triangle};
use crate::samples::{Pattern, SUBPIXELS};
use proto::frame::{TILE, TileIndex, tile_grid};

/// No bin: the tile belongs to another board.
const NOT_OURS: u32 = u32::MAX;

/// Which tiles of a view are drawn, and as which bins.
#[derive(Debug, Default)]
pub struct TileMap {
    /// Bin of each tile of the view's grid, row by row.
    slots: Vec<u32>,
    columns: u32,
    width: u32,
    height: u32,
    bins: usize,
}

impl TileMap {
    /// How many bins there are.
    pub fn bins(&self) -> usize {
        self.bins
    }

    /// The bin of the tile in that column and row of the view's grid, if it is drawn.
    #[inline(always)]
    pub fn slot(&self, column: i32, row: i32) -> Option<u32> {
        let slot = self.slots[(row as u32 * self.columns + column as u32) as usize];
        (slot != NOT_OURS).then_some(slot)
    }

    /// Makes `tiles` of a view of `width` × `height` pixels the bins, in their order.
    pub fn set(&mut self, width: u32, height: u32, tiles: &[TileIndex]) {
        let (columns, rows) = tile_grid(width, height);
        (self.columns, self.width, self.height, self.bins) = (columns, width, height, tiles.len());
        self.slots.clear();
        self.slots.resize(columns as usize * rows as usize, NOT_OURS);
        for (slot, tile) in tiles.iter().enumerate() {
            self.slots[usize::from(tile.y) * columns as usize + usize::from(tile.x)] = slot as u32;
        }
    }
}

/// The triangles of one run in each drawn tile.
#[derive(Debug, Default)]
pub struct RunBins {
    opaque: Side,
    translucent: Side,
    /// (Triangle, tile) pairs left out because they were known to be hidden.
    pub hidden: u64,
}

/// One kind's pairs: the triangles of bin k are `triangles[starts[k]..starts[k + 1]]`.
#[derive(Debug, Default)]
struct Side {
    pairs: Vec<[u32; 2]>,
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl RunBins {
    /// Sorts a run's triangles; `is_fragments` tells the kinds apart by the triangle's item. Opaque triangles that cover whole tiles are
    /// noted in `fronts`; with `looks`, what lies behind such triangles is left out.
    #[inline(always)]
    pub fn fill(
        &mut self,
        pattern: &Pattern,
        map: &TileMap,
        fronts: &TileFronts,
        triangles: &[Triangle],
        looks: bool,
        is_fragments: impl Fn(&Triangle) -> bool,
    ) {
        self.opaque.pairs.clear();
        self.translucent.pairs.clear();
        self.hidden = 0;
        let tile = TILE.trailing_zeros();
        let side_sub = TILE as i32 * SUBPIXELS;
        let last = [map.width as i32 - 1, map.height as i32 - 1];
        for (number, triangle) in triangles.iter().enumerate() {
            let is_fragment = is_fragments(triangle);
            let side = if is_fragment { &mut self.translucent } else { &mut self.opaque };
            let [[x0, x1], [y0, y1]] = triangle.pixels(pattern.low, pattern.high());
            let (x0, x1) = (x0.max(0) >> tile, x1.min(last[0]) >> tile);
            let (y0, y1) = (y0.max(0) >> tile, y1.min(last[1]) >> tile);
            let edges = ((x1 - x0 + 1) * (y1 - y0 + 1) > 2).then(|| Edges::of(triangle));
            let nearest = Nearest::of(triangle, [x0 * side_sub, y0 * side_sub], (x1 - x0).max(y1 - y0) + 1);
            for y in y0..=y1 {
                for x in x0..=x1 {
                    let Some(slot) = map.slot(x, y) else { continue };
                    let corner = [x * side_sub, y * side_sub];
                    if looks && fronts.hide_triangle(slot, &nearest, corner) {
                        self.hidden += 1;
                        continue;
                    }
                    if let Some(edges) = &edges {
                        if edges.misses(corner[0], corner[1], pattern.low, side_sub - pattern.low) {
                            continue;
                        }
                        if !is_fragment && !triangle.flags.has(Flags::BACK) {
                            fronts.note(slot, triangle, edges, corner);
                        }
                    }
                    side.pairs.push([slot, number as u32]);
                }
            }
        }
        self.opaque.sort(map.bins);
        self.translucent.sort(map.bins);
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
        self.triangles.clear();
        if self.pairs.is_empty() {
            return;
        }
        self.starts.resize(bins + 2, 0);
        for [slot, _] in &self.pairs {
            self.starts[*slot as usize + 2] += 1;
        }
        for k in 2..self.starts.len() {
            self.starts[k] += self.starts[k - 1];
        }
        self.triangles.resize(self.pairs.len(), 0);
        for [slot, number] in &self.pairs {
            let place = &mut self.starts[*slot as usize + 1];
            self.triangles[*place as usize] = *number;
            *place += 1;
        }
    }

    fn bin(&self, slot: usize) -> &[u32] {
        if self.starts.is_empty() {
            return &[];
        }
        &self.triangles[self.starts[slot] as usize..self.starts[slot + 1] as usize]
    }
}
