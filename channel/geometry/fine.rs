//! Corners for areas: where a face has them on a grid of 1/65 536 pixel, as picture.md asks for `exact`.
//!
//! Which faces are where is decided as for points, with corners on 1/256 pixel. Only what that grid can't say is found out here: which
//! way a face is turned that is thinner than rounding, and so may have come out without an area or turned over; and where the
//! corners are when an area counts. A corner that two faces share is the same point of the scene, or the same cut of the same
//! edge, so it lands on the same place for both.

use super::camera::{Camera, ViewPoint};
use super::clip::{CORNERS_MAX, ClippedFace};
use super::setup::{Plane, Triangle, area_twice, extent};
use super::transform::{Item, view_point};
use crate::frame::Frame;
use crate::geometry::setup::Flags;
use crate::samples::SUBPIXELS;

/// Positions per pixel.
const FINE: f64 = 65_536.0;

/// The screen position of a point with w > 0 on the fine grid, pixels.
fn place(camera: &Camera, point: ViewPoint) -> [f64; 2] {
    camera.project(point).map(|c| (c * FINE + 0.5).floor() * (1.0 / FINE))
}

/// Twice the signed area of the triangle of these corners, pixels²; positive when they run clockwise as seen.
fn fine_area_twice([a, b, c]: [[f64; 2]; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether a face with these rounded corners, sub, and twice that area may be turned otherwise than they are: each of the four
/// differences in the area is wrong by a sub-pixel at most.
#[inline(always)]
pub fn is_doubtful(x: [i32; 3], y: [i32; 3], area: i64) -> bool {
    let ([x0, x1], [y0, y1]) = (extent(x), extent(y));
    area.abs() <= 2 * (i64::from(x1 - x0) + i64::from(y1 - y0)) + 2
}

/// The sign of a whole face's area, its corners in the order of the mesh.
pub fn turn(camera: &Camera, item: &Item<'_>, vertices: [usize; 3]) -> i64 {
    let area = fine_area_twice(vertices.map(|v| place(camera, view_point(camera, item, v))));
    i64::from(area > 0.0) - i64::from(area < 0.0)
}

/// The sign of the area of a cut face.
pub fn turn_of_cut(camera: &Camera, face: &ClippedFace) -> i64 {
    let places: [[f64; 2]; CORNERS_MAX] =
        std::array::from_fn(|k| face.corners().get(k).map_or([0.0; 2], |corner| place(camera, corner.point)));
    let area: f64 = (2..face.corners().len()).map(|k| fine_area_twice([places[0], places[k - 1], places[k]])).sum();
    i64::from(area > 0.0) - i64::from(area < 0.0)
}

/// The corners, or if they have no area others with one, a sub-pixel aside. See [`crate::samples::EXACT_MARGIN`].
pub fn with_area(x: [i32; 3], y: [i32; 3]) -> ([i32; 3], [i32; 3]) {
    let area = |x: [i32; 3], y: [i32; 3]| area_twice([x[0], y[0]], [x[1], y[1]], [x[2], y[2]]);
    if area(x, y) != 0 {
        return (x, y);
    }
    for k in 0..3 {
        // One of the two directions is off the line, unless the other two corners are one point.
        let (mut right, mut down) = (x, y);
        right[k] += 1;
        down[k] += 1;
        if area(right, y) != 0 {
            return (right, y);
        }
        if area(x, down) != 0 {
            return (x, down);
        }
    }
    ([x[0], x[1] + 1, x[2]], [y[0], y[1], y[2] + 1])
}

/// A face, or a piece of one, as its area is computed.
#[derive(Clone, Copy, Debug)]
pub struct FineFace {
    /// Corners, pixels from the view's upper left, so that the area is positive.
    pub x: [f64; 3],
    /// Corners.
    pub y: [f64; 3],
    /// Which of the triangle's vertices each corner is, if the triangle is a whole face.
    pub vertices: [usize; 3],
    /// Inverse distances of the corners, 1/m.
    q: [f64; 3],
    /// Inverse distance.
    depth: Depth,
}

/// Where a face's inverse distance comes from.
#[derive(Clone, Copy, Debug)]
enum Depth {
    /// A plane of the scene that it shares with others.
    Shared(Plane),
    /// Its own corners; see [`plane_through`].
    Own([f64; 5]),
}

impl FineFace {
    /// Of a triangle; `None` if it has no area.
    pub fn new(frame: &Frame<'_>, number: u32) -> Option<Self> {
        let triangle = frame.triangle(number);
        let points = corners(frame, number, triangle)?;
        let places = points.map(|point| place(frame.camera, point));
        let area = fine_area_twice(places);
        let order = if area < 0.0 { [0, 2, 1] } else { [0, 1, 2] };
        let (x, y) = (order.map(|k| places[k][0]), order.map(|k| places[k][1]));
        let q = order.map(|k| 1.0 / points[k].w);
        let area = area.abs();
        if !(area > 0.0 && area.is_finite()) {
            return None;
        }
        let depth = if triangle.flags.has(Flags::SHARED_PLANE) {
            Depth::Shared(triangle.plane())
        } else {
            // From the true corners, unless the face has no area there: where surfaces meet or coincide, a plane through rounded
            // ones would cross the other surface elsewhere.
            let truly = order.map(|k| frame.camera.project(points[k]));
            let rounded = order.map(|k| places[k]);
            Depth::Own(plane_through(truly, q).or_else(|| plane_through(rounded, q))?)
        };
        Some(Self { x, y, vertices: order, q, depth })
    }

    /// Where the face is shaded in the pixel whose upper left is there, pixels: at the centre if it covers that, else at the point of its part
    /// of the pixel nearest to it.
    pub fn shading_point(&self, [left, top]: [f64; 2]) -> [f64; 2] {
        let centre = [left + 0.5, top + 0.5];
        if self.areas(centre).iter().all(|area| *area >= 0.0) {
            return centre;
        }
        let mut polygon = [[0.0; 2]; 8];
        for (k, corner) in polygon.iter_mut().enumerate().take(3) {
            *corner = [self.x[k], self.y[k]];
        }
        let mut count = 3;
        for (axis, line) in [(0, left), (1, top)] {
            cut(&mut polygon, &mut count, axis, line, false);
            cut(&mut polygon, &mut count, axis, line + 1.0, true);
        }
        let mut best = (f64::INFINITY, centre);
        for i in 0..count {
            let (a, b) = (polygon[i], polygon[(i + 1) % count]);
            let along = [b[0] - a[0], b[1] - a[1]];
            let squared = along[0] * along[0] + along[1] * along[1];
            let part = ((centre[0] - a[0]) * along[0] + (centre[1] - a[1]) * along[1]) / squared;
            // A side without a length is its corner.
            let part = if squared > 0.0 { part.clamp(0.0, 1.0) } else { 0.0 };
            let point = [a[0] + along[0] * part, a[1] + along[1] * part];
            let away = [point[0] - centre[0], point[1] - centre[1]];
            let distance = away[0] * away[0] + away[1] * away[1];
            if distance < best.0 {
                best = (distance, point);
            }
        }
        best.1
    }

    /// What each corner's attribute, linear in space, counts for at a point; up to one factor for all.
    pub fn weights(&self, point: [f64; 2]) -> [f64; 3] {
        let areas = self.areas(point);
        // A point that rounding has put beside the face is on its border.
        [0, 1, 2].map(|k| if areas[k] > 0.0 { areas[k] * self.q[k] } else { 0.0 })
    }

    /// Twice the areas of the triangles that a point makes with the sides opposite of the corners, pixels²; negative outside.
    fn areas(&self, point: [f64; 2]) -> [f64; 3] {
        let corner = |k: usize| [self.x[k % 3], self.y[k % 3]];
        [0, 1, 2].map(|k| fine_area_twice([corner(k + 1), corner(k + 2), point]))
    }

    /// Inverse distance at the upper left of the pixel that is there, sub, and its change per pixel to the right and downwards.
    pub fn plane(&self, [x_sub, y_sub]: [i32; 2]) -> [f64; 3] {
        let per_pixel = f64::from(SUBPIXELS);
        match self.depth {
            Depth::Shared(plane) => [plane.at(x_sub, y_sub), plane.dx * per_pixel, plane.dy * per_pixel],
            Depth::Own([q, dx, dy, x0, y0]) => {
                let (x, y) = (f64::from(x_sub) / per_pixel - x0, f64::from(y_sub) / per_pixel - y0);
                [q + (x * dx + y * dy), dx, dy]
            }
        }
    }
}

/// The part of a convex polygon on one side of a line along an axis, its corners counted by `count`.
fn cut(polygon: &mut [[f64; 2]; 8], count: &mut usize, axis: usize, line: f64, keeps_less: bool) {
    let sign = if keeps_less { 1.0 } else { -1.0 };
    let inside = |p: [f64; 2]| sign * (line - p[axis]);
    let (from, corners) = (*polygon, *count);
    *count = 0;
    for i in 0..corners {
        let (a, b) = (from[i], from[(i + 1) % corners]);
        let (at_a, at_b) = (inside(a), inside(b));
        let mut put = |p: [f64; 2]| {
            // A triangle has seven corners at most after four cuts; rounding can't give it more than there is room for.
            if *count < polygon.len() {
                polygon[*count] = p;
                *count += 1;
            }
        };
        if at_a >= 0.0 {
            put(a);
        }
        if (at_a < 0.0) != (at_b < 0.0) {
            let part = at_a / (at_a - at_b);
            put([a[0] + (b[0] - a[0]) * part, a[1] + (b[1] - a[1]) * part]);
        }
    }
}

/// The plane of inverse distance through three corners: its value at the first, its change per pixel to the right and downwards, and where
/// the first corner is, pixels. `None` without an area.
fn plane_through([a, b, c]: [[f64; 2]; 3], q: [f64; 3]) -> Option<[f64; 5]> {
    let area = fine_area_twice([a, b, c]);
    let (q1, q2) = (q[1] - q[0], q[2] - q[0]);
    let dx = (q1 * (c[1] - a[1]) - q2 * (b[1] - a[1])) / area;
    let dy = (q2 * (b[0] - a[0]) - q1 * (c[0] - a[0])) / area;
    (area > 0.0 && dx.is_finite() && dy.is_finite()).then_some([q[0], dx, dy, a[0], a[1]])
}

/// The corners of a triangle in space.
fn corners(frame: &Frame<'_>, number: u32, triangle: &Triangle) -> Option<[ViewPoint; 3]> {
    let item = &frame.items[triangle.item as usize];
    let vertices = item.stored.mesh.triangles[triangle.face as usize];
    let points = vertices.map(|v| view_point(frame.camera, item, v as usize));
    let Some(record) = frame.clip(number) else { return Some(points) };
    // The face is cut once more; a corner's weights are what it is known by.
    let clipped = ClippedFace::new(frame.camera, points)?;
    let find = |weights: &[f64; 3]| clipped.corners().iter().find(|corner| corner.weights == *weights);
    let [a, b, c] = &record.weights;
    Some([find(a)?.point, find(b)?.point, find(c)?.point])
}
