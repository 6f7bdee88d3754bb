//! Where a face is shaded that has an area in a pixel but doesn't cover its centre: at its point nearest to the centre.
//!
//! That is the limit of "its covered sample nearest to the centre" for infinitely many samples, and what pixels computed by areas
//! take instead ([`crate::exact::stage`]).

use crate::geometry::setup::Triangle;
use crate::raster::coverage::Edges;
use crate::samples::SUBPIXELS;

/// The place, sub from the pixel's upper left, and the square of its distance from the centre, sub². (x, y) is the pixel's upper left, sub;
/// the triangle doesn't cover its centre.
pub(super) fn nearest(triangle: &Triangle, edges: &Edges, [x, y]: [i32; 2]) -> ([i32; 2], f64) {
    let half = f64::from(SUBPIXELS / 2);
    // Corners from the centre.
    let corner = |k: usize| [f64::from(triangle.x[k % 3] - x) - half, f64::from(triangle.y[k % 3] - y) - half];
    let mut best = ([0.0; 2], f64::INFINITY);
    for k in 0..3 {
        let (a, b) = (corner(k), corner(k + 1));
        let along = [b[0] - a[0], b[1] - a[1]];
        let squared = along[0] * along[0] + along[1] * along[1];
        let part = if squared > 0.0 { -(a[0] * along[0] + a[1] * along[1]) / squared } else { 0.0 };
        let part = part.clamp(0.0, 1.0);
        let place = [a[0] + along[0] * part, a[1] + along[1] * part];
        let distance = place[0] * place[0] + place[1] * place[1];
        if distance < best.1 {
            best = (place, distance);
        }
    }
    // Of the whole sub-pixels about it one that the face covers; a face too thin for that is shaded at a corner, where
    // its attributes are known best.
    let [px, py] = best.0.map(|c| c + half);
    for [dx, dy] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]] {
        let [sx, sy] = [px.floor() + dx, py.floor() + dy].map(|c| c as i32);
        if edges.covers(x + sx, y + sy) {
            return ([sx, sy], best.1);
        }
    }
    let far = |k: usize| corner(k).map(f64::abs).into_iter().sum::<f64>();
    let first = (1..3).fold(0, |best, k| if far(k) < far(best) { k } else { best });
    ([triangle.x[first] - x, triangle.y[first] - y], best.1)
}
