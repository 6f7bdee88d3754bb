//! The background: one colour, or the sky of picture.md by the elevation of the ray through a pixel's centre.

use crate::geometry::camera::Camera;
use crate::samples::SUBPIXELS;
use proto::frame::{Background, Environment};

/// The sky's colour at the horizon and below, linear.
pub const HORIZON: [f32; 3] = [0.60, 0.70, 0.80];
/// The sky's colour from 30° of elevation upwards, linear.
pub const ZENITH: [f32; 3] = [0.15, 0.30, 0.60];
/// Sine of the elevation at which the sky is all zenith, 30°.
const SIN_ZENITH: f64 = 0.5;
/// That elevation, rad.
const ZENITH_RAD: f64 = std::f64::consts::PI / 6.0;

/// The colour behind the pixel whose upper left is (x, y) sub.
pub fn background(camera: &Camera, environment: &Environment, x: i32, y: i32) -> [f32; 3] {
    match environment.background {
        Background::Constant(colour) => colour,
        Background::Sky => {
            let ray = camera.ray_world(camera.ray(x + SUBPIXELS / 2, y + SUBPIXELS / 2));
            sky(ray.y)
        }
    }
}

/// The sky in a direction whose unit vector has that component along the local vertical.
fn sky(sine: f64) -> [f32; 3] {
    if sine >= SIN_ZENITH {
        return ZENITH;
    }
    if sine <= 0.0 {
        return HORIZON;
    }
    let part = (libm::asin(sine) / ZENITH_RAD) as f32;
    std::array::from_fn(|c| HORIZON[c] + (ZENITH[c] - HORIZON[c]) * part)
}

/// What things fade to: the given colour, else the horizon's or the constant background.
pub fn fog(environment: &Environment) -> [f32; 3] {
    environment.fog.unwrap_or(match environment.background {
        Background::Constant(colour) => colour,
        Background::Sky => HORIZON,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sky_goes_from_horizon_to_zenith_by_angle() {
        assert_eq!(sky(-1.0), HORIZON);
        assert_eq!(sky(0.0), HORIZON);
        assert_eq!(sky(1.0), ZENITH);
        assert_eq!(sky(0.5), ZENITH);
        let middle = sky(libm::sin(15f64.to_radians()));
        for c in 0..3 {
            assert!((middle[c] - (HORIZON[c] + ZENITH[c]) / 2.0).abs() < 1e-6, "{middle:?}");
        }
    }

    #[test]
    fn fog_is_the_backgrounds_colour_unless_given() {
        let sky = Environment::default();
        assert_eq!(fog(&sky), HORIZON);
        assert_eq!(fog(&Environment { background: Background::Constant([0.1, 0.2, 0.3]), ..sky }), [0.1, 0.2, 0.3]);
        assert_eq!(fog(&Environment { fog: Some([1.0, 0.0, 0.0]), ..sky }), [1.0, 0.0, 0.0]);
    }
}
