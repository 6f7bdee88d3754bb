//! Poses, views and frusta: who looks where, and through which window.
//!
//! The world is right-handed, in metres, f64; glTF axes (+X east, +Y up, −Z north). The eye looks along −Z with +X
//! right and +Y up. A *view* is what one projector shows: a rotation and a displacement relative to the eyepoint, four
//! half-angle tangents and a size in pixels.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::fmt;
use thiserror::Error;

/// Position and orientation in f64.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Position in the parent frame, m.
    pub position: DVec3,
    /// Rotation from this frame to the parent frame; a unit quaternion.
    pub orientation: DQuat,
}

impl Pose {
    /// At the origin, looking along −Z.
    pub const IDENTITY: Self = Self { position: DVec3::ZERO, orientation: DQuat::IDENTITY };

    /// A pose from numbers of outside: refused unless every number is finite and the quaternion can be made a unit one.
    ///
    /// # Errors
    /// [`PoseError`] names what was wrong.
    pub fn checked(position: DVec3, orientation: DQuat) -> Result<Self, PoseError> {
        if !position.is_finite() {
            return Err(PoseError::Position);
        }
        let length = orientation.length();
        if !length.is_finite() || length < 1e-6 {
            return Err(PoseError::Orientation);
        }
        Ok(Self { position, orientation: orientation.normalize() })
    }

    /// The pose at `eye` that looks towards `target` with `up` as nearly upwards as that allows.
    ///
    /// # Errors
    /// When a number is not finite, eye and target coincide, or `up` is parallel to the line of sight.
    pub fn looking_at(eye: DVec3, target: DVec3, up: DVec3) -> Result<Self, PoseError> {
        let back = (eye - target).try_normalize().ok_or(PoseError::LineOfSight)?;
        let right = up.cross(back).try_normalize().ok_or(PoseError::LineOfSight)?;
        Self::checked(eye, DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back)))
    }

    /// This pose as a map from its own frame to its parent's.
    pub fn to_affine(self) -> DAffine3 {
        DAffine3::from_rotation_translation(self.orientation, self.position)
    }

    /// `child`, given in this pose's frame, in this pose's parent frame.
    pub fn then(self, child: Self) -> Self {
        Self {
            position: self.position + self.orientation * child.position,
            orientation: (self.orientation * child.orientation).normalize(),
        }
    }
}

/// Why numbers are no pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum PoseError {
    /// A coordinate is NaN or infinite.
    #[error("the position is not finite")]
    Position,
    /// The quaternion is not finite or has no length.
    #[error("the orientation is not a quaternion that can be normalised")]
    Orientation,
    /// Eye and target coincide, or the up vector is along the line of sight.
    #[error("the line of sight has no length or is parallel to the up vector")]
    LineOfSight,
}

/// The window's four half-angle tangents: at distance 1 it spans `left..right` and `bottom..top`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tangents {
    /// Left border, x/−z.
    pub left: f64,
    /// Right border, x/−z; greater than `left`.
    pub right: f64,
    /// Lower border, y/−z.
    pub bottom: f64,
    /// Upper border, y/−z; greater than `bottom`.
    pub top: f64,
}

impl Tangents {
    /// The symmetrical window of a vertical field of view, with square pixels.
    pub fn symmetric(vertical_fov_deg: f64, width: u32, height: u32) -> Self {
        let top = libm_tan(vertical_fov_deg.to_radians() / 2.0);
        let right = top * f64::from(width) / f64::from(height);
        Self { left: -right, right, bottom: -top, top }
    }

    /// Whether the numbers are finite and in order.
    pub fn is_valid(&self) -> bool {
        [self.left, self.right, self.bottom, self.top].iter().all(|t| t.is_finite() && t.abs() < 1e6)
            && self.left < self.right
            && self.bottom < self.top
    }

    /// Horizontal field of view, rad.
    pub fn horizontal_fov_rad(&self) -> f64 {
        glam_atan(self.right) - glam_atan(self.left)
    }
}

// std's tan and atan differ between platforms; views must not, because shares of one view may be computed on several.
// glam is built with libm, and its quaternion helpers give us the same functions without another dependency.
fn libm_tan(angle_rad: f64) -> f64 {
    let q = DQuat::from_rotation_z(angle_rad);
    // q = (0, 0, sin(a/2), cos(a/2)); tan a = 2 s c / (c² − s²)
    2.0 * q.z * q.w / (q.w * q.w - q.z * q.z)
}

fn glam_atan(t: f64) -> f64 {
    // The z rotation that takes +X to (1, t): asin/acos of libm inside.
    let q = DQuat::from_rotation_arc(DVec3::X, DVec3::new(1.0, t, 0.0).normalize());
    let (axis, angle) = q.to_axis_angle();
    if axis.z < 0.0 { -angle } else { angle }
}

/// How many points of a pixel are looked at; the mean of their colours is the pixel's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
pub enum Samples {
    /// The centre.
    #[default]
    One,
    /// 4 points.
    Four,
    /// 8 points.
    Eight,
    /// 16 points.
    Sixteen,
    /// 64 points.
    SixtyFour,
    /// Not points but areas: the box filter's integral itself.
    Exact,
}

impl Samples {
    /// Number of points. For [`Samples::Exact`] 64: the pixels that are not computed by areas are those of 64 points.
    pub const fn count(self) -> usize {
        match self {
            Self::One => 1,
            Self::Four => 4,
            Self::Eight => 8,
            Self::Sixteen => 16,
            Self::SixtyFour | Self::Exact => 64,
        }
    }

    /// The variant with `count` points, if there is one.
    pub const fn from_count(count: u32) -> Option<Self> {
        match count {
            1 => Some(Self::One),
            4 => Some(Self::Four),
            8 => Some(Self::Eight),
            16 => Some(Self::Sixteen),
            64 => Some(Self::SixtyFour),
            _ => None,
        }
    }

    /// What the names of all variants are, for people.
    pub const NAMES: &str = "1, 4, 8, 16, 64 or exact";

    /// The variant of that name: a number of points, or `exact`.
    pub fn from_name(name: &str) -> Option<Self> {
        if name == "exact" { Some(Self::Exact) } else { Self::from_count(name.parse().ok()?) }
    }
}

impl fmt::Display for Samples {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exact => f.write_str("exact"),
            points => write!(f, "{}", points.count()),
        }
    }
}

/// What one projector shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// The view's frame in the eye's frame: displacement in m and rotation (view → eye).
    pub offset: Pose,
    /// The window.
    pub tangents: Tangents,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Distance of the near plane, m: what has −Z < near is not drawn.
    pub near: f64,
    /// Points per pixel.
    pub samples: Samples,
}

impl View {
    /// Default distance of the near plane, m.
    pub const NEAR_DEFAULT: f64 = 0.1;

    /// The default row of `count` views: each `width` × `height` behind `tangents`, view k (from the left) turned by
    /// (k − (count − 1)/2) times the horizontal field, so that neighbours share an edge plane.
    pub fn row(count: u32, width: u32, height: u32, tangents: Tangents, samples: Samples) -> Vec<Self> {
        let field = tangents.horizontal_fov_rad();
        (0..count)
            .map(|k| {
                let turn = (f64::from(k) - f64::from(count - 1) / 2.0) * field;
                Self {
                    offset: Pose { position: DVec3::ZERO, orientation: DQuat::from_rotation_y(-turn) },
                    tangents,
                    width,
                    height,
                    near: Self::NEAR_DEFAULT,
                    samples,
                }
            })
            .collect()
    }

    /// The same window with a pixel for every `scale` × `scale` of its pixels; what remains at the right and lower border counts as whole.
    pub fn at_scale(self, scale: u32) -> Self {
        Self { width: self.width.div_ceil(scale), height: self.height.div_ceil(scale), ..self }
    }

    /// The view's pose in the world for an eye there.
    pub fn world_pose(&self, eye: Pose) -> Pose {
        eye.then(self.offset)
    }

    /// Whether every number is usable: finite, in order, within [`crate::limits`].
    pub fn is_valid(&self) -> bool {
        let sizes = 1..=crate::limits::VIEW_SIZE_MAX;
        self.tangents.is_valid()
            && sizes.contains(&self.width)
            && sizes.contains(&self.height)
            && self.near.is_finite()
            && self.near > 0.0
            && Pose::checked(self.offset.position, self.offset.orientation).is_ok()
    }
}

/// How a view is shared between boards.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Mode {
    /// Every k-th tile of a skewed lattice (seed 001).
    #[default]
    Interleave,
    /// A rectangle each (seed 002's sub-areas; sort-first).
    Region,
}

/// A view and its place in the rig.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewSetup {
    /// What is shown.
    pub view: View,
    /// How it is shared between boards.
    pub mode: Mode,
    /// Where its upper left pixel lies in the stitched picture; `None`: to the right of the view before.
    pub at: Option<[u32; 2]>,
}

impl ViewSetup {
    /// Interleaved, to the right of the view before.
    pub fn new(view: View) -> Self {
        Self { view, mode: Mode::default(), at: None }
    }

    /// Where each view lies in the stitched picture, and that picture's size; `None` when it would be larger than
    /// [`crate::limits::STITCHED_SIZE_MAX`] allows.
    pub fn layout(views: &[Self]) -> Option<(Vec<[u32; 2]>, [u32; 2])> {
        let mut x = 0u32;
        let mut size = [0u32; 2];
        let mut places = Vec::with_capacity(views.len());
        for setup in views {
            let at = setup.at.unwrap_or([x, 0]);
            x = at[0].checked_add(setup.view.width)?;
            size = [size[0].max(x), size[1].max(at[1].checked_add(setup.view.height)?)];
            places.push(at);
        }
        (size.iter().all(|side| *side <= crate::limits::STITCHED_SIZE_MAX)).then_some((places, size))
    }

    /// Whether every number is usable.
    pub fn is_valid(&self) -> bool {
        self.view.is_valid()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_views_share_an_edge_plane() {
        let tangents = Tangents::symmetric(45.0, 640, 360);
        let views = View::row(3, 640, 360, tangents, Samples::One);
        for pair in views.windows(2) {
            let right = pair[0].offset.orientation * DVec3::new(tangents.right, 0.0, -1.0);
            let left = pair[1].offset.orientation * DVec3::new(tangents.left, 0.0, -1.0);
            assert!((right - left).length() < 1e-12, "{right} {left}");
        }
        assert!((views[0].offset.orientation * DVec3::NEG_Z).x < 0.0, "view 0 must look to the left of the middle");
    }

    #[test]
    fn tangent_and_arc_tangent_agree_with_the_standard_library() {
        for degrees in [0.01f64, 1.0, 22.5, 45.0, 60.0, 85.0] {
            let angle = degrees.to_radians();
            assert!((libm_tan(angle) / angle.tan() - 1.0).abs() < 1e-12, "tan {degrees}");
            assert!((glam_atan(angle.tan()) - angle).abs() < 1e-12, "atan {degrees}");
            assert!((glam_atan(-angle.tan()) + angle).abs() < 1e-12, "atan −{degrees}");
        }
    }

    #[test]
    fn samples_are_read_as_they_are_written() {
        for samples in
            [Samples::One, Samples::Four, Samples::Eight, Samples::Sixteen, Samples::SixtyFour, Samples::Exact]
        {
            assert_eq!(Samples::from_name(&samples.to_string()), Some(samples));
        }
        for name in ["", "2", "-1", "Exact", "64 "] {
            assert_eq!(Samples::from_name(name), None, "{name:?}");
        }
    }

    #[test]
    fn a_pose_off_unit_is_renormalised_and_nonsense_is_refused() {
        let off = DQuat::from_xyzw(0.0, 0.0, 0.0, 1.001);
        assert_eq!(Pose::checked(DVec3::ZERO, off).unwrap().orientation, DQuat::IDENTITY);
        assert_eq!(Pose::checked(DVec3::NAN, off), Err(PoseError::Position));
        assert_eq!(Pose::checked(DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0)), Err(PoseError::Orientation));
        assert_eq!(Pose::looking_at(DVec3::ZERO, DVec3::Y, DVec3::Y).map(|p| p.position), Err(PoseError::LineOfSight));
    }
}
