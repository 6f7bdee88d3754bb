//! Subobjects that need no vertex: those whose box lies behind faces that cover all of its tiles, or meets none of the tiles
//! that this board draws; and triangles that needn't enter a tile's bin, for they lie behind a face that covers all of it.
//!
//! While triangles are sorted into tiles, each that covers a whole tile says how near it is there at least (*front*). Later
//! subobjects of the list, which runs from front to back, are asked by their boxes. Whether a front is there already when one
//! asks depends on the threads; the picture does not, since only what no sample can see is left out.
//!
//! What is asked is conservative: boxes are taken larger by what their projection may be off and by what rounding to
//! sub-pixels moves, fronts are taken farther by what their plane's evaluation may be off, and a box that reaches behind the near plane
//! isn't judged at all.

use super::bins::TileMap;
use crate::geometry::camera::{Camera, GUARD_BITS};
use crate::geometry::setup::{Flags, Plane, Triangle};
use crate::geometry::transform::Item;
use crate::raster::coverage::Edges;
use crate::raster::depth::bounds;
use crate::samples::SUBPIXELS;
use crate::simd::each4;
use glam::DVec3;
use proto::frame::TILE;
use std::sync::atomic::{AtomicU32, Ordering};

/// Side of a tile, sub.
const SIDE: i32 = TILE as i32 * SUBPIXELS;

/// By how much of itself an inverse distance is moved to the safe side, besides what is computed: far more than the rounding of a
/// few operations and of the number to f32.
const SAFETY: f64 = 1e-6;

/// Error of a coordinate relative to the numbers it is the sum of: three products and three sums twice over.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// By bin: the inverse distance, 1/m, that the nearest face known to cover the whole tile has in it at least; 0 if there is
/// none. f32 bits, which order as the numbers do.
#[derive(Debug, Default)]
pub struct TileFronts {
    fronts: Vec<AtomicU32>,
}

/// Where a subobject's box is on the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxExtent {
    /// First and last tile, columns and rows; none if first > last.
    tiles: [[i32; 2]; 2],
    /// No sample of the subobject is nearer, 1/m.
    nearest: f32,
}

/// How near a triangle is, 1/m, at most.
#[derive(Clone, Copy, Debug)]
pub struct Nearest {
    plane: Plane,
    /// In all tiles that it may be in.
    anywhere: f64,
}

impl Nearest {
    /// In so many tiles each way from the one whose upper left is given, sub.
    #[inline(always)]
    pub fn of(triangle: &Triangle, [x, y]: [i32; 2], tiles: i32) -> Self {
        let plane = triangle.plane();
        Self { plane, anywhere: bounds(&plane, x, y, tiles * SIDE)[1] }
    }
}

impl TileFronts {
    /// Forgets all; so many bins.
    pub fn clear(&mut self, bins: usize) {
        self.fronts.clear();
        self.fronts.resize_with(bins, AtomicU32::default);
    }

    /// Notes that a triangle covers a tile, if it does: its bin, and the tile's upper left, sub.
    #[inline(always)]
    pub fn note(&self, slot: u32, triangle: &Triangle, edges: &Edges, [x, y]: [i32; 2]) {
        if triangle.flags.0 & (Flags::CUT_OUT | Flags::BEYOND) == 0 && edges.covers_square(x, y, SIDE) {
            self.fronts[slot as usize].fetch_max(least_in_tile(triangle, [x, y]).to_bits(), Ordering::Relaxed);
        }
    }

    /// Whether nothing of a triangle is seen in a tile of those it was looked at in: its bin, and the tile's upper left, sub.
    #[inline(always)]
    pub fn hide_triangle(&self, slot: u32, nearest: &Nearest, [x, y]: [i32; 2]) -> bool {
        let front = f64::from(f32::from_bits(self.fronts[slot as usize].load(Ordering::Relaxed)));
        front > 0.0 && (nearest.anywhere < front || bounds(&nearest.plane, x, y, SIDE)[1] < front)
    }

    /// Whether nothing of the subobject with that box is seen in the tiles that are drawn.
    pub fn hide(&self, map: &TileMap, extent: &BoxExtent) -> bool {
        let [[x0, x1], [y0, y1]] = extent.tiles;
        let is_behind = |slot: u32| f32::from_bits(self.fronts[slot as usize].load(Ordering::Relaxed)) > extent.nearest;
        (y0..=y1).all(|y| (x0..=x1).all(|x| map.slot(x, y).is_none_or(is_behind)))
    }
}

/// The least inverse distance of a triangle's plane in a tile, no larger than any sample's; 0 where the plane ends in it.
fn least_in_tile(triangle: &Triangle, [x, y]: [i32; 2]) -> f32 {
    let plane = triangle.plane();
    let corners = each4([[x, y], [x + SIDE, y], [x, y + SIDE], [x + SIDE, y + SIDE]], |[x, y]| {
        // Of three terms that may nearly cancel.
        let (dx, dy) = (f64::from(x - plane.x) * plane.dx, f64::from(y - plane.y) * plane.dy);
        plane.at(x, y) - ROUNDING * (plane.q.abs() + dx.abs() + dy.abs())
    });
    let least = corners.into_iter().fold(f64::INFINITY, |least, q| if q < least { q } else { least });
    let safe = (least * (1.0 - SAFETY)) as f32;
    if safe > 0.0 { safe } else { 0.0 }
}

impl BoxExtent {
    /// Of a subobject's box; `None` if it can't be told where its samples are.
    pub fn of(camera: &Camera, item: &Item<'_>) -> Option<Self> {
        // A shared plane may be nearer than the corners of the faces that lie in it, seen edge on by any factor.
        if item.planes.is_some() {
            return None;
        }
        let [low, high] = item.stored.bounds()?;
        let reach = low.abs().max(high.abs());
        let m = &item.linear;
        let magnitude = item.relative.abs().element_sum()
            + m.x_axis.abs().element_sum() * reach.x
            + m.y_axis.abs().element_sum() * reach.y
            + m.z_axis.abs().element_sum() * reach.z;
        let (mut nearest, mut farthest) = (f64::INFINITY, 0.0f64);
        let mut window = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for k in 0..8 {
            let pick = |axis: usize| if k >> axis & 1 == 0 { low[axis] } else { high[axis] };
            let turned = item.linear * DVec3::new(pick(0), pick(1), pick(2));
            let point = camera.view_point(turned + item.relative);
            // A NaN isn't, and isn't judged.
            let is_ahead = point.w > camera.near;
            if !is_ahead {
                return None;
            }
            (nearest, farthest) = (nearest.min(point.w), farthest.max(point.w));
            for (range, c) in window.iter_mut().zip([point.x / point.w, point.y / point.w]) {
                *range = [range[0].min(c), range[1].max(c)];
            }
        }
        let off = ROUNDING * magnitude;
        let nearest = nearest - off;
        let is_ahead = nearest > camera.near && farthest.is_finite();
        if !is_ahead {
            return None;
        }
        let [span_x, span_y] = camera.spans();
        let t = camera.tangents;
        let [x0, x1] = window[0];
        let [y0, y1] = window[1];
        let x =
            pixels([x0 - t.left, x1 - t.left], span_x, camera.width, off / nearest * (1.0 + x0.abs().max(x1.abs())))?;
        let y =
            pixels([t.top - y1, t.top - y0], span_y, camera.height, off / nearest * (1.0 + y0.abs().max(y1.abs())))?;
        // A plane through rounded corners may leave their range of depths by 2⁻⁵² · extent² / area, and the least area is one (see
        // `Plane`).
        let [wide, high] =
            [x, y].map(|[from, to]| ((to - from) * f64::from(SUBPIXELS)).min(f64::from(2 << GUARD_BITS)));
        let beyond = (wide * wide + high * high) * f64::EPSILON;
        let tile = |pixel: f64, size: u32| (pixel.clamp(-1.0, f64::from(size)) / f64::from(TILE)).floor() as i32;
        let tiles = |[from, to]: [f64; 2], size: u32| {
            [tile(from, size).max(0), tile(to, size).min((size as i32 - 1) / TILE as i32)]
        };
        Some(Self {
            tiles: [tiles(x, camera.width), tiles(y, camera.height)],
            nearest: ((1.0 + beyond + SAFETY) / nearest) as f32,
        })
    }
}

/// From a range on the window at distance 1 to pixels, larger by what it may be `off` and by a pixel's quarter for rounding;
/// `None` if it is off by more than a pixel.
fn pixels([from, to]: [f64; 2], span: f64, size: u32, off: f64) -> Option<[f64; 2]> {
    let per = f64::from(size) / span;
    let margin = off * per;
    (margin < 1.0).then_some([from * per - margin - 0.25, to * per + margin + 0.25])
}
