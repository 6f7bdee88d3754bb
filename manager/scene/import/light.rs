//! Lights of the file: `KHR_lights_punctual`.

use super::Importer;
use super::accessor::at;
use super::error::Fault;
use crate::scene::LightSource;
use gltf::json::extensions::scene::khr_lights_punctual::{Light, Type};
use gltf::json::validation::Checked;
use proto::scene::LightKind;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

impl Importer<'_> {
    /// The light `index`; `None` if it can't shine, which is warned of. `place` is the node that it stands in.
    pub(super) fn light(&mut self, index: usize, place: &str) -> Result<Option<LightSource>, Fault> {
        let lights = self.data.root.extensions.as_ref().and_then(|all| all.khr_lights_punctual.as_ref());
        let light = at(lights.map_or(&[][..], |all| &all.lights), index, "light", place)?;
        let Checked::Valid(kind) = light.type_ else {
            self.warnings.add(format!("{place}: a light of unknown type is left out"));
            return Ok(None);
        };
        let intensity = light.color.map(|channel| channel * light.intensity);
        if intensity.iter().any(|channel| !(*channel >= 0.0 && channel.is_finite())) {
            self.warnings.add(format!("{place}: a light whose intensity is negative or not finite is left out"));
            return Ok(None);
        }
        let range = self.range(light, place);
        let kind = match kind {
            Type::Directional => LightKind::Directional,
            Type::Point => LightKind::Point { range },
            Type::Spot => {
                let (inner, outer) = self.cone(light, place);
                // Cosines by way of libm: the same bits on every machine.
                LightKind::Spot { range, inner_cos: libm::cosf(inner), outer_cos: libm::cosf(outer) }
            }
        };
        Ok(Some(LightSource { kind, intensity }))
    }

    fn range(&mut self, light: &Light, place: &str) -> Option<f64> {
        let range = light.range?;
        if range > 0.0 && range.is_finite() {
            return Some(f64::from(range));
        }
        self.warnings.add(format!("{place}: its light's range must be above 0 and is ignored"));
        None
    }

    /// The angles of a spot light, rad: 0 ≤ inner < outer ≤ π/2.
    fn cone(&mut self, light: &Light, place: &str) -> (f32, f32) {
        let (inner, outer) =
            light.spot.as_ref().map_or((0.0, FRAC_PI_4), |spot| (spot.inner_cone_angle, spot.outer_cone_angle));
        if 0.0 <= inner && inner < outer && outer <= FRAC_PI_2 {
            return (inner, outer);
        }
        self.warnings.add(format!("{place}: its light's cone must have 0 ≤ inner < outer ≤ 90° and is mended"));
        let outer = if outer > 0.0 { outer.min(FRAC_PI_2) } else { FRAC_PI_4 };
        let inner = if inner >= 0.0 { inner.min(outer * 0.999) } else { 0.0 };
        (inner, outer)
    }
}
