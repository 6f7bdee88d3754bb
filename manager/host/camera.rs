//! Camera files: JSON lists of poses, as people write them and as the built-in scenes bring them.
//!
//! A file is a list of poses, or an object `{"origin": …, "poses": […]}`. Each pose has an eye and either `target` and
//! `up` or an `orientation` (eye → world), and a lens: a vertical field of view or four tangents.

use glam::{DQuat, DVec3};
use proto::limits;
use proto::pose::{EntityPose, EntityRef, ModelWeights, PosePacket, name_hash};
use proto::scene::Sphere;
use proto::view::{Pose, PoseError, Tangents};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use thiserror::Error;

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
        self.tangents
            .unwrap_or_else(|| Tangents::symmetric(self.vertical_fov_deg.unwrap_or(FOV_DEFAULT_DEG), width, height))
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

/// Why a camera file can't be used.
#[derive(Debug, Error)]
pub enum CameraError {
    /// It can't be read.
    #[error("{file}: {error}")]
    Read {
        /// The file.
        file: String,
        /// The reason.
        error: std::io::Error,
    },
    /// It isn't JSON of this form.
    #[error("{file}: {error}")]
    Form {
        /// The file.
        file: String,
        /// What and at which line.
        error: serde_json::Error,
    },
    /// It has no pose.
    #[error("{file}: no pose; a camera file is a list of at least one")]
    Empty {
        /// The file.
        file: String,
    },
    /// A pose's numbers are none.
    #[error("{file}: pose {index}: {what}")]
    Pose {
        /// The file.
        file: String,
        /// Which pose, from 0.
        index: usize,
        /// What is wrong.
        what: String,
    },
}

impl CameraFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`CameraError`] names the file, and the line or the pose.
    pub fn read(path: &Path) -> Result<Self, CameraError> {
        let file = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(text) => Self::parse(&text, &file),
            Err(error) => Err(CameraError::Read { file, error }),
        }
    }

    /// Takes a file's text; `file` is for messages.
    ///
    /// # Errors
    /// [`CameraError`].
    pub fn parse(text: &str, file: &str) -> Result<Self, CameraError> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Object {
            origin: Option<Geodetic>,
            poses: Vec<CameraPose>,
        }
        // Told apart by hand: serde's untagged enums forget the line of an error.
        let parsed = if text.trim_start().starts_with('[') {
            serde_json::from_str(text).map(|poses| Self { origin: None, poses })
        } else {
            serde_json::from_str(text).map(|Object { origin, poses }| Self { origin, poses })
        };
        let camera = parsed.map_err(|error| CameraError::Form { file: file.to_owned(), error })?;
        if camera.poses.is_empty() {
            return Err(CameraError::Empty { file: file.to_owned() });
        }
        for (index, pose) in camera.poses.iter().enumerate() {
            let fail = |what: String| CameraError::Pose { file: file.to_owned(), index, what };
            pose.pose().map_err(|error| fail(error.to_string()))?;
            if pose.vertical_fov_deg.is_some_and(|fov| !(fov > 0.0 && fov < 180.0)) {
                return Err(fail("vertical_fov_deg must lie between 0 and 180".into()));
            }
            if pose.tangents.is_some_and(|tangents| !tangents.is_valid()) {
                return Err(fail("tangents: left < right and bottom < top must hold".into()));
            }
            // Finite, and near enough that a clock can wait for it.
            if pose.t.is_some_and(|t| t.is_nan() || t.abs() > 1e9) {
                return Err(fail("t must be a number of seconds between -1e9 and 1e9".into()));
            }
            if !pose.lens(1, 1).is_valid() {
                return Err(fail("the field of view is too wide".into()));
            }
            if pose.entities.len() > limits::POSE_ENTITIES_MAX || pose.versions.len() > limits::POSE_MODELS_MAX {
                let (entities, models) = (limits::POSE_ENTITIES_MAX, limits::POSE_MODELS_MAX);
                return Err(fail(format!("at most {entities} entities and {models} models fit one pose")));
            }
            for (node, weights) in &pose.versions {
                let is_mixture =
                    weights.iter().all(|w| (0.0..=1.0).contains(w)) && weights.iter().sum::<f64>() < 1.0 + 1e-6;
                if !is_mixture || weights.len() > limits::VERSIONS_MAX {
                    return Err(fail(format!(
                        "versions of {node:?}: at most {} weights, each 0 to 1, together at most 1",
                        limits::VERSIONS_MAX
                    )));
                }
            }
            for entity in &pose.entities {
                let q = DQuat::from_array(entity.orientation);
                Pose::checked(DVec3::from_array(entity.position), q)
                    .map_err(|error| fail(format!("entity {:?}: {error}", entity.node)))?;
            }
        }
        Ok(camera)
    }

    /// A flight round a ball, looking at its centre: for scenes that come without a path. 20 s at 60 Hz.
    pub fn orbit(ball: Sphere) -> Self {
        const POSES: u32 = 1200;
        let radius = if ball.radius > 0.0 { ball.radius } else { 1.0 };
        let poses = (0..POSES).map(|k| {
            let turn = DQuat::from_rotation_y(f64::from(k) / f64::from(POSES) * std::f64::consts::TAU);
            let eye = ball.centre + turn * DVec3::new(0.0, 0.8 * radius, 2.6 * radius);
            CameraPose::looking_at(Some(f64::from(k) / 60.0), eye, ball.centre, FOV_DEFAULT_DEG)
        });
        Self { origin: None, poses: poses.collect() }
    }

    /// Pose `k` as a packet. With the size of the default views the lens goes along.
    ///
    /// # Panics
    /// If there is no pose `k` or the poses were not checked by [`Self::parse`].
    pub fn packet(&self, k: usize, sequence: u32, answer: bool, size: Option<(u32, u32)>) -> PosePacket {
        let pose = &self.poses[k];
        let entities = pose.entities.iter().take(limits::POSE_ENTITIES_MAX).map(|entity| EntityPose {
            entity: EntityRef::NameHash(name_hash(&entity.node)),
            pose: Pose {
                position: DVec3::from_array(entity.position),
                orientation: DQuat::from_array(entity.orientation).normalize(),
            },
        });
        let models = pose.versions.iter().take(limits::POSE_MODELS_MAX).map(|(node, weights)| ModelWeights {
            name: name_hash(node),
            weights: weights.iter().take(limits::VERSIONS_MAX).map(|weight| *weight as f32).collect(),
        });
        PosePacket {
            sequence,
            answer,
            eye: pose.pose().expect("poses are checked when a file is read"),
            lens: pose.tangents.or_else(|| size.map(|(width, height)| pose.lens(width, height))),
            entities: entities.collect(),
            models: models.collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_forms_are_read() {
        let list = r#"[{"eye": [1, 2, 3], "target": [0, 0, 0], "up": [0, 1, 0], "vertical_fov_deg": 40}]"#;
        let object = format!(r#"{{"origin": {{"lat": 1, "lon": 2, "height": 3}}, "poses": {list}}}"#);
        let (a, b) = (CameraFile::parse(list, "a").unwrap(), CameraFile::parse(&object, "b").unwrap());
        assert_eq!(a.poses, b.poses);
        assert_eq!(b.origin, Some(Geodetic { lat: 1.0, lon: 2.0, height: 3.0 }));
        assert_eq!(a.packet(0, 7, true, None).eye.position, DVec3::new(1.0, 2.0, 3.0));
    }

    #[test]
    fn errors_name_file_and_line_or_pose() {
        let error = |text: &str| CameraFile::parse(text, "path.json").unwrap_err().to_string();
        assert!(error("[{\n\"eye\": [1, 2]}]").contains("line 2"), "{}", error("[{\n\"eye\": [1, 2]}]"));
        assert!(error(r#"[{"eye": [0,0,0], "fov": 3}]"#).contains("unknown field `fov`"));
        assert!(error(r#"[{"eye": [0,0,0], "target": [0,0,0]}]"#).contains("path.json: pose 0: the line of sight"));
        assert!(error("[]").contains("no pose"));
    }

    #[test]
    fn an_orbit_sees_its_centre_from_outside() {
        let ball = Sphere { centre: DVec3::new(5.0, 6.0, 7.0), radius: 10.0 };
        for pose in CameraFile::orbit(ball).poses {
            assert!(DVec3::from_array(pose.eye).distance(ball.centre) > 2.0 * ball.radius);
        }
    }
}
