//! The lights of a scene's file (`KHR_lights_punctual`), placed for a frame.
//!
//! A directional light gives its lux everywhere. A point light or a spot gives candela / d², faded out towards its range by the
//! extension's window, and a spot is faded between its cones as the extension recommends. All as factors of
//! max(0, n · d), beside the ambient light and the sun.

use crate::geometry::camera::Camera;
use glam::DVec3;
use proto::scene::{LightKind, LightRow};

/// Least difference of a spot's two cosines: the extension's own guard of the division.
const CONE_MIN: f64 = 0.001;

/// A light as one view's shading needs it.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    kind: LightKind,
    intensity: [f64; 3],
    /// Relative to the view's eye, world axes, m.
    position: DVec3,
    /// Unit vector along which it shines, world axes; zero if it has none.
    direction: DVec3,
}

impl Light {
    /// A light of the table, which has been checked.
    pub fn new(row: &LightRow, camera: &Camera) -> Self {
        Self {
            kind: row.kind,
            intensity: row.intensity.map(f64::from),
            position: camera.relative_point(row.position),
            direction: row.direction.normalize_or_zero(),
        }
    }

    /// Whether it shines alike everywhere.
    pub fn is_uniform(&self) -> bool {
        matches!(self.kind, LightKind::Directional)
    }

    /// What it adds to the factor of a surface with that unit normal at `point` (relative to the view's eye, world axes).
    pub fn on(&self, point: DVec3, normal: DVec3) -> [f64; 3] {
        let (range, cone) = match self.kind {
            LightKind::Directional => return self.scaled((-self.direction).dot(normal)),
            LightKind::Point { range } => (range, None),
            LightKind::Spot { range, inner_cos, outer_cos } => (range, Some([inner_cos, outer_cos].map(f64::from))),
        };
        let towards = self.position - point;
        let squared = towards.length_squared();
        if squared == 0.0 {
            return [0.0; 3];
        }
        let towards = towards / squared.sqrt();
        let window = range.map_or(1.0, |range| {
            let part = squared / (range * range);
            (1.0 - part * part).clamp(0.0, 1.0)
        });
        let spot = cone.map_or(1.0, |[inner, outer]| {
            let within = ((-towards).dot(self.direction) - outer) / (inner - outer).max(CONE_MIN);
            within.clamp(0.0, 1.0)
        });
        self.scaled(towards.dot(normal) * window * (spot * spot) / squared)
    }

    fn scaled(&self, factor: f64) -> [f64; 3] {
        self.intensity.map(|c| if factor > 0.0 { c * factor } else { 0.0 })
    }
}
