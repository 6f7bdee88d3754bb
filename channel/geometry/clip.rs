//! What crosses the near plane, or reaches beyond the range of the integers, is cut; everything else is left alone.
//!
//! The sides of the view are *not* cut at: coverage is decided by integers, which simply don't look outside. Cutting makes
//! new vertices, and neighbours must agree on them: a new vertex is computed from the edge's inner end towards its outer
//! end, which both neighbours see alike whichever way round they run the edge, with operations in one order. Hence
//! the cut ends of a shared edge are the same numbers, and round to the same sub-pixel. The decision depends on
//! vertices and view only, never on a tile or a share.

use super::camera::{Camera, ViewPoint};

/// Most corners that a triangle has after five planes.
pub const CORNERS_MAX: usize = 8;

/// A corner of a clipped face.
#[derive(Clone, Copy, Debug)]
pub struct ClipCorner {
    /// Where it is.
    pub point: ViewPoint,
    /// Its weights with respect to the face's three vertices; their sum is 1. Attributes are linear in them.
    pub weights: [f64; 3],
}

/// A convex polygon on the stack.
#[derive(Clone, Debug)]
pub struct ClippedFace {
    corners: [ClipCorner; CORNERS_MAX],
    count: usize,
}

/// One plane as a distance that is positive inside.
#[derive(Clone, Copy, Debug)]
enum ClipPlane {
    Near,
    Left,
    Right,
    Bottom,
    Top,
}

impl ClipPlane {
    const ALL: [Self; 5] = [Self::Near, Self::Left, Self::Right, Self::Bottom, Self::Top];

    #[inline]
    fn distance(self, camera: &Camera, p: ViewPoint) -> f64 {
        match self {
            Self::Near => p.w - camera.near,
            Self::Left => p.x - camera.guard.left * p.w,
            Self::Right => camera.guard.right * p.w - p.x,
            Self::Bottom => p.y - camera.guard.bottom * p.w,
            Self::Top => camera.guard.top * p.w - p.y,
        }
    }
}

/// Whether a point is in front of the near plane and within the guard band: bit k is set if it is outside of plane k.
#[inline]
pub fn outside(camera: &Camera, p: ViewPoint) -> u8 {
    let mut code = 0;
    for (k, plane) in ClipPlane::ALL.into_iter().enumerate() {
        code |= u8::from(plane.distance(camera, p) < 0.0) << k;
    }
    code
}

impl ClippedFace {
    /// A face cut at the near plane and the guard band; `None` if nothing is left.
    pub fn new(camera: &Camera, points: [ViewPoint; 3]) -> Option<Self> {
        let corner = |k: usize| {
            let mut weights = [0.0; 3];
            weights[k] = 1.0;
            ClipCorner { point: points[k], weights }
        };
        let mut face = Self { corners: [corner(0); CORNERS_MAX], count: 3 };
        (face.corners[1], face.corners[2]) = (corner(1), corner(2));
        for plane in ClipPlane::ALL {
            face.cut(camera, plane);
            if face.count < 3 {
                return None;
            }
        }
        Some(face)
    }

    /// The corners, in the order of the face's vertices.
    pub fn corners(&self) -> &[ClipCorner] {
        &self.corners[..self.count]
    }

    fn cut(&mut self, camera: &Camera, plane: ClipPlane) {
        let distances: [f64; CORNERS_MAX] = self.corners.map(|c| plane.distance(camera, c.point));
        if distances[..self.count].iter().all(|d| *d >= 0.0) {
            return;
        }
        let before = self.corners;
        let count = std::mem::take(&mut self.count);
        for i in 0..count {
            let next = (i + 1) % count;
            let (here_in, next_in) = (distances[i] >= 0.0, distances[next] >= 0.0);
            if here_in {
                self.push(before[i]);
            }
            if here_in != next_in {
                let (inner, outer) = if here_in { (i, next) } else { (next, i) };
                let part = distances[inner] / (distances[inner] - distances[outer]);
                let mut cut = between(&before[inner], &before[outer], part);
                if matches!(plane, ClipPlane::Near) {
                    cut.point.w = camera.near;
                }
                self.push(cut);
            }
        }
    }

    /// A convex polygon gains at most one corner per plane. Rounding may make one not quite convex; a corner too many is then left
    /// out rather than written beyond the end.
    fn push(&mut self, corner: ClipCorner) {
        if self.count < CORNERS_MAX {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }
}

fn between(inner: &ClipCorner, outer: &ClipCorner, part: f64) -> ClipCorner {
    let mix = |a: f64, b: f64| a + (b - a) * part;
    ClipCorner {
        point: ViewPoint {
            x: mix(inner.point.x, outer.point.x),
            y: mix(inner.point.y, outer.point.y),
            w: mix(inner.point.w, outer.point.w),
        },
        weights: std::array::from_fn(|k| mix(inner.weights[k], outer.weights[k])),
    }
}
