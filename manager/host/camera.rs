//! Camera files: JSON lists of poses, as people write them and as the built-in scenes bring them.
//!
//! A file is a list of poses, or an object `{"origin": …, "poses": […]}`. Each pose has an eye and either `target` and
//! `up` or an `orientation` (eye → world), and a lens: a vertical field of view or four tangents.

use glam::{DQuat, DVec3};
use proto::view::{Pose, PoseError, Tangents};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Vertical field of view of a pose that names no lens, degrees.
pub const FOV_DEFAULT_DEG: f64 = 45.0;

/// Where a scene's origin lies on the earth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Geodetic {
    /// Latitude, degrees, north positive.
    pub lat: f64,
    /// Longitude, degrees, east positive.
    pub lon: f64,
    /// Height above the ellipsoid, m.
    pub height: f64,
}

/// A node that a pose puts somewhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraEntity {
    /// The node's name in the scene.
    pub node: String,
    /// World position, m.
    pub position: [f64; 3],
    /// Rotation to the world, x y z w.
    #[serde(default = "no_rotation")]
    pub orientation: [f64; 4],
}

fn no_rotation() -> [f64; 4] {
    [0.0, 0.0, 0.0, 1.0]
}

/// One pose of a camera file, as written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPose {
    /// Time, s; without it the file has one pose per frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub t: Option<f64>,
    /// The eye, world, m.
    pub eye: [f64; 3],
    /// A point that the eye looks at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<[f64; 3]>,
    /// Upwards in the picture; +Y when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// Eye → world, x y z w, instead of `target` and `up`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation: Option<[f64; 4]>,
    /// The lens.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vertical_fov_deg: Option<f64>,
    /// The lens, instead of the field of view.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tangents: Option<Tangents>,
    /// Nodes that this pose moves.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub entities: Vec<CameraEntity>,
    /// Weights of a node's versions, finest first.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub versions: BTreeMap<String, Vec<f64>>,
}

impl CameraPose {
    /// An eye that looks at a target, +Y up.
    pub fn looking_at(t: Option<f64>, eye: DVec3, target: DVec3, vertical_fov_deg: f64) -> Self {
        Self {
            t,
            eye: eye.to_array(),
            target: Some(target.to_array()),
            up: Some([0.0, 1.0, 0.0]),
            orientation: None,
            vertical_fov_deg: Some(vertical_fov_deg),
            tangents: None,
            entities: Vec::new(),
            versions: BTreeMap::new(),
        }
    }

    /// The eye's pose.
    ///
    /// # Errors
    /// When the numbers are no pose; see [`PoseError`].
    pub fn pose(&self) -> Result<Pose, PoseError> {
        let eye = DVec3::from_array(self.eye);
        match (self.orientation, self.target) {
            (Some(q), _) => Pose::checked(eye, DQuat::from_array(q)),
            (None, Some(target)) => {
                let up = self.up.map_or(DVec3::Y, DVec3::from_array);
                Pose::looking_at(eye, DVec3::from_array(target), up)
            }
            (None, None) => Pose::checked(eye, DQuat::IDENTITY),
        }
    }

    /// The lens for a picture of `width` × `height` square pixels.
    pub fn lens(&self, width: u32, height: u32) -> Tangents {
        self.tangents.unwrap_or_else(|| {
            Tangents::symmetric(self.vertical_fov_deg.unwrap_or(FOV_DEFAULT_DEG), width, height)
        })
    }
}

/// A camera file.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CameraFile {
    /// Where the scene's origin lies, if the file says so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub origin: Option<Geodetic>,
    /// The poses, in order; at least one in a file that was read.
    pub poses: Vec<CameraPose>,
}
