//! How far off what is seen at a point of the screen is: 1/−Z, larger being nearer.
//!
//! On a plane it is affine over the screen. With the normal n, a point w·(X, Y, −1) of the view's frame lies in the
//! plane through P if w · n·(X, Y, −1) = n·P. So 1/w = n·(X, Y, −1) / n·P, and X and Y are affine in the pixel's
//! coordinates.
//!
//! A face has it from its own corners or, if it lies in a plane of the scene, from that: picture.md, "A marking takes
//! its depth from the plane of the face it lies on". A plane of the scene isn't rounded, and all its faces have the
//! same function, to the bit. Beyond its horizon, which the rounded outline of a face may reach, it is zero or less:
//! farther than everything.
//!
//! Choices: a shared plane is of no use when it is seen so nearly edge on that all of it that the near plane leaves
//! lies within one step of the grid from its horizon, a line of which only rounding is seen. Its faces then have their
//! depth from their corners.

use crate::camera::Camera;
use crate::plane::ScenePlane;
use crate::screen::{Grid, Vertices};
use glam::DVec3;

/// 1/−Z as an affine function of the screen, 1/m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseDepth {
    /// A point of the screen, pixels.
    at: [f64; 2],
    /// The value there.
    value: f64,
    /// Its change per pixel to the right and down.
    slope: [f64; 2],
}

impl InverseDepth {
    /// The value at a point of the screen.
    pub fn at(&self, [x, y]: [f64; 2]) -> f64 {
        self.value + (self.slope[0] * (x - self.at[0]) + self.slope[1] * (y - self.at[1]))
    }

    /// Of the plane with a normal of any length through a point of the view's frame.
    pub fn of_plane(camera: &Camera, normal: DVec3, point: DVec3) -> Self {
        let distance = normal.dot(point);
        let ([x, y], [dx, dy]) = (camera.ray([0.0; 2]), camera.per_pixel());
        Self {
            at: [0.0; 2],
            value: normal.dot(DVec3::new(x, y, -1.0)) / distance,
            slope: [normal.x * dx / distance, normal.y * dy / distance],
        }
    }

    /// Of a plane of the scene; `None` where it is of no use.
    pub fn of_scene_plane(camera: &Camera, plane: &ScenePlane, vertices: Vertices) -> Option<Self> {
        let (u, v) = plane.normal.any_orthonormal_pair();
        let [u, v] = [u, v].map(|way| camera.view_direction(&plane.transform, way));
        let point = camera.view_point(&plane.transform, plane.normal * plane.offset);
        let depth = Self::of_plane(camera, u.cross(v), point);
        let is_line = match vertices {
            Vertices::Exact => false,
            // Beside the horizon it rises from 0; at the near plane it is 1/near.
            Vertices::Rounded(Grid { bits, .. }) => {
                let per_step = depth.slope.map(|s| s.abs() / f64::from(bits).exp2());
                per_step.into_iter().any(|rise| rise * camera.near >= 1.0)
            }
        };
        (depth.is_finite() && !is_line).then_some(depth)
    }

    /// The same change, with this value at that point.
    pub fn through(self, at: [f64; 2], value: f64) -> Self {
        Self { at, value, ..self }
    }

    /// Of these values at three points of the screen.
    pub fn through_corners([a, b, c]: [[f64; 2]; 3], value: [f64; 3]) -> Self {
        let area = crate::coverage::side(a, b, c);
        let ([x1, y1], [x2, y2]) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        let (v1, v2) = (value[1] - value[0], value[2] - value[0]);
        let slope = [(v1 * y2 - v2 * y1) / area, (v2 * x1 - v1 * x2) / area];
        Self { at: a, value: value[0], slope }
    }

    /// Whether it has a value everywhere.
    pub fn is_finite(&self) -> bool {
        self.value.is_finite() && self.slope.iter().all(|s| s.is_finite())
    }
}
