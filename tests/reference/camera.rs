//! From the world to a view, and from a view to its pixels and back: the formulas of picture.md, "Frames of reference".
//!
//! Positions are made relative to the eye before anything is rotated, so that large coordinates cost no accuracy.
//!
//! Choices: a view that is displaced from the eyepoint sees from its own place, which is therefore "the eye" of
//! distances and rays.

use glam::{DAffine3, DMat3, DVec3};
use proto::frame::FrameState;
use proto::view::{Tangents, View};

/// One view of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    eye_world: DVec3,
    /// The view's place relative to the eyepoint, world axes.
    displacement: DVec3,
    world_to_view: DMat3,
    tangents: Tangents,
    width: f64,
    height: f64,
    /// Distance of the near plane along the line of sight, m.
    pub near: f64,
}

impl Camera {
    /// The camera of a view in a frame.
    pub fn new(state: &FrameState, view: &View) -> Self {
        let eye = state.eye.orientation.normalize();
        let offset = view.offset.orientation.normalize();
        Self {
            eye_world: state.eye.position,
            displacement: eye * view.offset.position,
            world_to_view: DMat3::from_quat((eye * offset).normalize().conjugate()),
            tangents: view.tangents,
            width: f64::from(view.width),
            height: f64::from(view.height),
            near: view.near,
        }
    }

    /// A point of a mesh in the view's frame: X right, Y up, looking along −Z.
    pub fn view_point(&self, transform: &DAffine3, point: DVec3) -> DVec3 {
        let origin = (transform.translation - self.eye_world) - self.displacement;
        self.world_to_view * (transform.matrix3 * point + origin)
    }

    /// A direction of a mesh in the view's axes, as long as the transformation makes it.
    pub fn view_direction(&self, transform: &DAffine3, direction: DVec3) -> DVec3 {
        self.world_to_view * (transform.matrix3 * direction)
    }

    /// Where a point of the view's frame with Z < 0 lands, pixels from the upper left.
    pub fn project(&self, point: DVec3) -> [f64; 2] {
        let t = &self.tangents;
        let x = (point.x / -point.z - t.left) / (t.right - t.left) * self.width;
        let y = (t.top - point.y / -point.z) / (t.top - t.bottom) * self.height;
        [x, y]
    }

    /// The inverse: (X, Y) of the point at Z = −1 that lands there.
    pub fn ray(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let t = &self.tangents;
        [t.left + x / self.width * (t.right - t.left), t.top - y / self.height * (t.top - t.bottom)]
    }

    /// The direction of a point of the screen, a unit vector in world axes.
    pub fn direction_world(&self, screen: [f64; 2]) -> DVec3 {
        let [x, y] = self.ray(screen);
        (self.world_to_view.transpose() * DVec3::new(x, y, -1.0)).normalize()
    }

    /// How much farther from the eye a point of the screen is than along the line of sight: Euclidean distance over −Z.
    pub fn slant(&self, screen: [f64; 2]) -> f64 {
        let [x, y] = self.ray(screen);
        (x * x + y * y + 1.0).sqrt()
    }

    /// Change of (X, Y) of [`Camera::ray`] per pixel.
    pub fn per_pixel(&self) -> [f64; 2] {
        let t = &self.tangents;
        [(t.right - t.left) / self.width, -(t.top - t.bottom) / self.height]
    }

    /// How far above the horizontal plane through the eye the ray of a screen point runs, as an affine function of the
    /// screen: (at the upper left, per pixel right, per pixel down). Its zero is the horizon, a straight line.
    pub fn horizon(&self) -> [f64; 3] {
        let up = self.world_to_view * DVec3::Y;
        let ([x, y], [dx, dy]) = (self.ray([0.0, 0.0]), self.per_pixel());
        [up.x * x + up.y * y - up.z, up.x * dx, up.y * dy]
    }

    /// Screen positions that guard pixels from the origin would have at Z = −1: left, right, lower and upper tangents.
    pub fn band(&self, guard_pixels: f64) -> Tangents {
        let [left, top] = self.ray([-guard_pixels, -guard_pixels]);
        let [right, bottom] = self.ray([guard_pixels, guard_pixels]);
        Tangents { left, right, bottom, top }
    }
}
