//! One view's numbers: from the world to the eye, and from the eye to the screen.
//!
//! Positions stay f64 until they are relative to the eye, and the subtraction that makes them so is of two large numbers
//! *only*: (translation − eyepoint), once per subobject. A scene and an eye that are moved together by an amount that f64
//! holds exactly therefore give the same picture to the byte. A view's own displacement is subtracted after that, for the same reason.
//!
//! Space names: *world* axes; *view* axes: x right, y up, and w = −Z, the distance along the line of sight, in place of Z;
//! *pixels* from the view's upper left; *sub*: 1/256 pixel, integers.

use crate::samples::{SUBPIXEL_BITS, SUBPIXELS};
use glam::{DAffine3, DMat3, DVec3};
use proto::frame::FrameState;
use proto::limits::VIEW_SIZE_MAX;
use proto::view::{Tangents, View};

/// Screen coordinates lie within ±2²⁴ sub-pixels; what reaches beyond is cut there.
///
/// The bit budget: differences of two coordinates need 25 bits, their product twice that, an edge function is
/// a sum of two such: 2·25 + 1 = 51 bits. So edge functions are exact in i64, and areas and barycentric numerators also
/// in f64's 53 bits.
pub const GUARD_BITS: u32 = 24;

const _: () = assert!(
    (VIEW_SIZE_MAX as u64) << SUBPIXEL_BITS <= 1 << (GUARD_BITS - 1),
    "the guard band must lie well outside of the largest view"
);
const _: () = assert!(2 * (GUARD_BITS + 1) + 2 <= 53, "edge functions must be exact in f64");

/// Everything that a view and an eyepoint decide, ready for use.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    /// The eyepoint, world, m.
    eye_world: DVec3,
    /// The view's own eye relative to the eyepoint, world axes, m.
    offset_world: DVec3,
    /// World axes → view's axes (Z still backwards).
    to_view: DMat3,
    /// The window.
    pub tangents: Tangents,
    /// Width of the window at distance 1.
    span_x: f64,
    /// Height of the window at distance 1.
    span_y: f64,
    /// Width of a sub-pixel at distance 1.
    step_x: f64,
    /// Height of a sub-pixel at distance 1.
    step_y: f64,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Distance of the near plane, m.
    pub near: f64,
    /// The window that the guard band spans.
    pub guard: Tangents,
}

/// A position in view axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewPoint {
    /// To the right, m.
    pub x: f64,
    /// Upwards, m.
    pub y: f64,
    /// Along the line of sight, m.
    pub w: f64,
}

impl Camera {
    /// The camera of a view in a frame. The caller has checked both.
    pub fn new(state: &FrameState, view: &View) -> Self {
        let orientation = view.world_pose(state.eye).orientation;
        let tangents = view.tangents;
        let (span_x, span_y) = (tangents.right - tangents.left, tangents.top - tangents.bottom);
        // The guard band in pixels, a sub-pixel short of the limit so that rounding stays inside.
        let limit = f64::from((1i32 << GUARD_BITS) - 1) / f64::from(SUBPIXELS);
        let (per_x, per_y) = (span_x / f64::from(view.width), span_y / f64::from(view.height));
        let guard = Tangents {
            left: tangents.left - limit * per_x,
            right: tangents.left + limit * per_x,
            bottom: tangents.top - limit * per_y,
            top: tangents.top + limit * per_y,
        };
        Self {
            eye_world: state.eye.position,
            offset_world: state.eye.orientation * view.offset.position,
            to_view: DMat3::from_quat(orientation.conjugate()),
            tangents,
            span_x,
            span_y,
            step_x: per_x / f64::from(SUBPIXELS),
            step_y: per_y / f64::from(SUBPIXELS),
            width: view.width,
            height: view.height,
            near: view.near,
            guard,
        }
    }

    /// The translation of an object relative to the view's eye, world axes.
    pub fn relative(&self, transform: &DAffine3) -> DVec3 {
        self.relative_point(transform.translation)
    }

    /// A direction or a relative position from world axes to the view's axes, Z backwards.
    pub fn view_axes(&self, relative: DVec3) -> DVec3 {
        self.to_view * relative
    }

    /// World axes to the view's axes, Z backwards.
    pub fn to_view(&self) -> &DMat3 {
        &self.to_view
    }

    /// Width and height of the window at distance 1.
    pub fn spans(&self) -> [f64; 2] {
        [self.span_x, self.span_y]
    }

    /// The way back.
    pub fn world_axes(&self, relative: DVec3) -> DVec3 {
        self.to_view.transpose() * relative
    }

    /// Width and height of a sub-pixel at distance 1.
    pub fn steps(&self) -> [f64; 2] {
        [self.step_x, self.step_y]
    }

    /// A position in the world relative to the view's eye, world axes.
    pub fn relative_point(&self, position: DVec3) -> DVec3 {
        (position - self.eye_world) - self.offset_world
    }

    /// A position relative to the view's eye, from world axes to view axes.
    #[inline]
    pub fn view_point(&self, relative: DVec3) -> ViewPoint {
        let v = self.to_view * relative;
        ViewPoint { x: v.x, y: v.y, w: -v.z }
    }

    /// The screen position of a point with w > 0, pixels.
    #[inline]
    pub fn project(&self, point: ViewPoint) -> [f64; 2] {
        let x = (point.x / point.w - self.tangents.left) / self.span_x * f64::from(self.width);
        let y = (self.tangents.top - point.y / point.w) / self.span_y * f64::from(self.height);
        [x, y]
    }

    /// The same, rounded to 1/256 pixel and within the guard band.
    #[inline]
    pub fn project_sub(&self, point: ViewPoint) -> [i32; 2] {
        let limit = f64::from(1i32 << GUARD_BITS);
        self.project(point).map(|c| (c * f64::from(SUBPIXELS) + 0.5).floor().clamp(-limit, limit) as i32)
    }

    /// The ray through a sub-pixel position: (X, Y) at distance 1 along the line of sight.
    #[inline]
    pub fn ray(&self, x_sub: i32, y_sub: i32) -> [f64; 2] {
        let x = self.tangents.left + f64::from(x_sub) * self.step_x;
        let y = self.tangents.top - f64::from(y_sub) * self.step_y;
        [x, y]
    }

    /// A ray of [`Camera::ray`] as a unit vector in world axes.
    pub fn ray_world(&self, ray: [f64; 2]) -> DVec3 {
        let [x, y] = ray;
        self.world_axes(DVec3::new(x, y, -1.0)) / (x * x + y * y + 1.0).sqrt()
    }
}
