//! Which board draws which part of which view: a pure function of the board's place, the number of boards, the number
//! of views and the epoch's weights. Every board computes its own share; no assignment table is ever sent.
//!
//! The views, laid side by side, are one line of length V; board i owns the stretch that its weight is of all weights.
//! With as many equal boards as views each owns one whole view; extra boards split views, and too few serve several,
//! always evenly. Within a view the stretches become tiles of a skewed lattice: tile (x, y) has the *residue*
//! (x + k·y) mod W, and a board owns a run of residues. Seed 001 (p. "Future Developments") left the mapping for N ≠ 2^k
//! open; [`skew`] is the k that keeps any rectangle of tiles evenly spread.

use crate::frame::{TileIndex, tile_grid};
use crate::ids::{BoardId, ViewId};
use crate::view::{Mode, ViewSetup};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// The tiles of one view that one board draws: those whose residue (x + skew·y) mod modulus lies in `first..end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lattice {
    /// Number of residues; the sum of all weights.
    pub modulus: u32,
    /// By how much the residues of a row of tiles are shifted against the row above.
    pub skew: u32,
    /// First residue owned.
    pub first: u32,
    /// One past the last residue owned.
    pub end: u32,
}

impl Lattice {
    /// Every tile.
    pub const WHOLE: Self = Self { modulus: 1, skew: 0, first: 0, end: 1 };

    /// Whether the tile belongs to this share.
    pub fn owns(&self, tile: TileIndex) -> bool {
        let residue = (u64::from(tile.x) + u64::from(self.skew) * u64::from(tile.y)) % u64::from(self.modulus);
        (u64::from(self.first)..u64::from(self.end)).contains(&residue)
    }
}

/// A rectangle of tiles: `x0..x1` × `y0..y1`, upper ends excluded; may be empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileRect {
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// One past the last column.
    pub x1: u32,
    /// One past the last row.
    pub y1: u32,
}

impl TileRect {
    fn owns(&self, tile: TileIndex) -> bool {
        (self.x0..self.x1).contains(&u32::from(tile.x)) && (self.y0..self.y1).contains(&u32::from(tile.y))
    }

    /// Cuts across the longer side so that the first part has about `first` of `first + second`.
    fn cut(self, first: u64, second: u64) -> (Self, Self) {
        let part = |from: u32, to: u32| {
            // Rounded to the nearest border between tiles.
            let length = u64::from(to - from);
            from + ((2 * length * first + first + second) / (2 * (first + second))) as u32
        };
        if self.x1 - self.x0 >= self.y1 - self.y0 {
            let x = part(self.x0, self.x1);
            (Self { x1: x, ..self }, Self { x0: x, ..self })
        } else {
            let y = part(self.y0, self.y1);
            (Self { y1: y, ..self }, Self { y0: y, ..self })
        }
    }
}

/// Some tiles of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Part {
    /// Of a skewed lattice.
    Lattice(Lattice),
    /// A rectangle.
    Region(TileRect),
}

impl Part {
    /// Every tile.
    pub const WHOLE: Self = Self::Lattice(Lattice::WHOLE);

    /// Whether the tile belongs to this part.
    pub fn owns(&self, tile: TileIndex) -> bool {
        match self {
            Self::Lattice(lattice) => lattice.owns(tile),
            Self::Region(rect) => rect.owns(tile),
        }
    }

    /// The tiles of this part in a view of `width` × `height` pixels, row by row.
    pub fn tiles(&self, width: u32, height: u32) -> impl Iterator<Item = TileIndex> + '_ {
        let (columns, rows) = tile_grid(width, height);
        (0..rows)
            .flat_map(move |y| (0..columns).map(move |x| TileIndex { x: x as u16, y: y as u16 }))
            .filter(|tile| self.owns(*tile))
    }
}

/// The part of a view that a board draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Share {
    /// Which view.
    pub view: ViewId,
    /// Which of its tiles.
    pub part: Part,
}

/// Each board's stretch of a line of `views` views, in units of 1/W of a view, W the sum of weights: a view has W units,
/// board i has `V·w_i` of them, one board after the other.
fn stretches(weights: &[u32], views: u32) -> impl Iterator<Item = Range<u64>> + '_ {
    assert!(weights.iter().all(|w| *w > 0), "a board without weight is not in the row");
    weights.iter().scan(0, move |start, weight| {
        let from = *start;
        *start += u64::from(views) * u64::from(*weight);
        Some(from..*start)
    })
}

fn overlap(a: &Range<u64>, b: &Range<u64>) -> Range<u64> {
    a.start.max(b.start)..a.end.min(b.end)
}

/// The views of which board `id` draws a part.
///
/// # Panics
/// If `id` is not below `weights.len()` or a weight is zero.
pub fn views_of(id: BoardId, weights: &[u32], views: u32) -> Range<u32> {
    let total: u64 = weights.iter().map(|w| u64::from(*w)).sum();
    let own = stretches(weights, views).nth(id.0 as usize).expect("the board is in the row");
    (own.start / total) as u32..own.end.div_ceil(total) as u32
}

/// What board `id` of `weights.len()` boards draws of `views`, ascending by view.
///
/// `weights` holds one small positive integer per board, in the order of ids. The shares of all boards cover every tile
/// of every view exactly once.
///
/// # Panics
/// If `id` is not below `weights.len()` or a weight is zero.
pub fn shares(id: BoardId, weights: &[u32], views: &[ViewSetup]) -> Vec<Share> {
    let count = views.len() as u32;
    let total: u64 = weights.iter().map(|w| u64::from(*w)).sum();
    let all: Vec<_> = stretches(weights, count).collect();
    let own = &all[id.0 as usize];
    let share = |view: u32| {
        let line = u64::from(view) * total..(u64::from(view) + 1) * total;
        let units = overlap(own, &line);
        let setup = &views[view as usize];
        let part = match setup.mode {
            _ if units == line => Part::WHOLE,
            Mode::Interleave => Part::Lattice(Lattice {
                modulus: total as u32,
                skew: skew(total as u32),
                first: (units.start - line.start) as u32,
                end: (units.end - line.start) as u32,
            }),
            Mode::Region => {
                let sharers = all.iter().map(|stretch| overlap(stretch, &line)).filter(|part| !part.is_empty());
                let parts: Vec<(u64, bool)> = sharers.map(|part| (part.end - part.start, part == units)).collect();
                let (x1, y1) = tile_grid(setup.view.width, setup.view.height);
                Part::Region(region(TileRect { x0: 0, y0: 0, x1, y1 }, &parts))
            }
        };
        Share { view: ViewId(view), part }
    };
    views_of(id, weights, count).map(share).collect()
}

/// The rectangle of the sharer that is marked: the sharers are halved by weight again and again, and the rectangle with
/// them, across its longer side.
fn region(rect: TileRect, sharers: &[(u64, bool)]) -> TileRect {
    if sharers.len() == 1 {
        return rect;
    }
    let total: u64 = sharers.iter().map(|(weight, _)| weight).sum();
    let mut first = 0;
    let mut at = 0;
    // At least one on either side; otherwise as near to half as possible.
    while at == 0 || (at + 1 < sharers.len() && 2 * first + sharers[at].0 <= total) {
        first += sharers[at].0;
        at += 1;
    }
    let (left, right) = rect.cut(first, total - first);
    let (before, after) = sharers.split_at(at);
    if before.iter().any(|(_, own)| *own) { region(left, before) } else { region(right, after) }
}

/// The skew k with the least worst imbalance over all rectangles of at least 16·W tiles, for W = 2, 3, …: found by trying
/// all k coprime to W (the test `any_large_rectangle_is_spread_within_thirteen_percent` measures each again).
const SKEW: [u32; 63] = [
    1, 1, 1, 2, 1, 2, 3, 2, 3, 3, 5, 5, 3, 4, 7, 5, 5, 7, 9, 8, 5, 5, 7, 9, 7, 8, 5, 8, 11, 12, 7, 10, 13, 8, 11, 10,
    7, 14, 11, 11, 13, 10, 13, 19, 17, 13, 17, 18, 19, 20, 11, 23, 17, 21, 15, 16, 17, 25, 13, 17, 23, 17, 23,
];

/// The skew k for `modulus` residues.
///
/// The tiles of one residue form the lattice {(x, y) : x + k·y ≡ 0 (mod W)}. Up to 64 the best k is tabled; beyond, it is
/// the one whose shortest lattice vector is longest (ties: the smaller k), for a lattice without short vectors spreads
/// rectangles evenly in whichever direction. k is always coprime to W, or a single column of tiles would miss residues.
pub fn skew(modulus: u32) -> u32 {
    if let Some(k) = (modulus as usize).checked_sub(2).and_then(|i| SKEW.get(i)) {
        return *k;
    }
    (1..modulus.max(2))
        .filter(|k| gcd(modulus, *k) == 1)
        .max_by_key(|k| (shortest_squared(modulus, *k), std::cmp::Reverse(*k)))
        .unwrap_or(0)
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Square of the length of the shortest vector of {(x, y) : x + k·y ≡ 0 (mod W)}.
fn shortest_squared(modulus: u32, k: u32) -> u64 {
    let (w, k) = (i64::from(modulus), i64::from(k));
    // (W, 0) is always in the lattice; every other candidate has 0 < y ≤ √W-ish, and x is the residue of −k·y nearest 0.
    let mut best = w * w;
    let mut y = 1;
    while y * y < best {
        let r = (k * y).rem_euclid(w);
        let x = r.min(w - r);
        best = best.min(x * x + y * y);
        y += 1;
    }
    best as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::{Samples, Tangents, View};
    use proptest::prelude::*;

    fn setups(count: u32, width: u32, height: u32, mode: Mode) -> Vec<ViewSetup> {
        let views = View::row(count, width, height, Tangents::symmetric(45.0, width, height), Samples::One);
        views.into_iter().map(|view| ViewSetup { mode, ..ViewSetup::new(view) }).collect()
    }

    fn count(share: &Share, width: u32, height: u32) -> usize {
        share.part.tiles(width, height).count()
    }

    proptest! {
        #[test]
        fn every_tile_of_every_view_has_one_owner(
            weights in prop::collection::vec(1u32..5, 1..17), views in 1u32..9,
            width in 1u32..900, height in 1u32..600, region in any::<bool>(),
        ) {
            let mode = if region { Mode::Region } else { Mode::Interleave };
            let setups = setups(views, width, height, mode);
            let (columns, rows) = tile_grid(width, height);
            let mut owners = vec![0; (views * columns * rows) as usize];
            for id in (0..weights.len()).map(|id| BoardId(id as u32)) {
                let shares = shares(id, &weights, &setups);
                let drawn = shares.iter().map(|s| s.view.0).collect::<Vec<_>>();
                prop_assert_eq!(drawn, views_of(id, &weights, views).collect::<Vec<_>>());
                for share in shares {
                    for tile in share.part.tiles(width, height) {
                        owners[((share.view.0 * rows + u32::from(tile.y)) * columns + u32::from(tile.x)) as usize] += 1;
                    }
                }
            }
            prop_assert!(owners.iter().all(|n| *n == 1));
        }
    }

    #[test]
    fn as_many_boards_as_views_get_one_whole_view_each() {
        for mode in [Mode::Interleave, Mode::Region] {
            for id in 0..5 {
                let got = shares(BoardId(id), &[1; 5], &setups(5, 640, 360, mode));
                assert_eq!(got, [Share { view: ViewId(id), part: Part::WHOLE }]);
            }
        }
    }

    #[test]
    fn two_boards_serve_three_views_half_and_half() {
        for mode in [Mode::Interleave, Mode::Region] {
            let tiles = |id| -> usize {
                let shares = shares(BoardId(id), &[1, 1], &setups(3, 1280, 704, mode));
                shares.iter().map(|s| count(s, 1280, 704)).sum()
            };
            assert_eq!((tiles(0), tiles(1)), (40 * 22 * 3 / 2, 40 * 22 * 3 / 2));
        }
    }

    #[test]
    fn a_heavier_board_gets_more() {
        for mode in [Mode::Interleave, Mode::Region] {
            let share = |id| count(&shares(BoardId(id), &[3, 1], &setups(1, 1280, 1280, mode))[0], 1280, 1280);
            assert_eq!((share(0), share(1)), (1200, 400));
        }
    }

    #[test]
    fn seven_regions_of_a_screen_are_rectangles_of_about_the_same_area() {
        let setups = setups(1, 1920, 1080, Mode::Region);
        for id in 0..7 {
            let share = shares(BoardId(id), &[1; 7], &setups)[0];
            let tiles = count(&share, 1920, 1080);
            assert!((0.8..=1.2).contains(&(tiles as f64 * 7.0 / (60.0 * 34.0))), "board {id}: {tiles} tiles");
        }
    }

    /// Largest share over mean share, for every rectangle of at least 16·n tiles. Where the rectangle lies doesn't matter:
    /// moving it turns the residues round.
    fn worst_imbalance(n: u32) -> f64 {
        let k = skew(n);
        let mut worst: f64 = 1.0;
        for width in 1..=16 * n {
            let tallest = (16 * n).div_ceil(width) + n;
            let mut counts = vec![0u32; n as usize];
            for y in 0..tallest {
                for x in 0..width % n {
                    counts[((x + k * y) % n) as usize] += 1;
                }
                let area = width * (y + 1);
                if area >= 16 * n {
                    let most = counts.iter().max().copied().unwrap_or(0) + width / n * (y + 1);
                    worst = worst.max(f64::from(most) * f64::from(n) / f64::from(area));
                }
            }
        }
        worst
    }

    #[test]
    fn any_large_rectangle_is_spread_within_thirteen_percent() {
        for n in 2..=64 {
            let worst = worst_imbalance(n);
            // No coprime skew does better for these two: 1.131 and 1.152.
            let target = if [38, 54].contains(&n) { 1.152 } else { 1.13 };
            assert!(worst <= target, "{n} boards, skew {}: {worst}", skew(n));
        }
    }
}
