//! The background: one colour, or the sky of picture.md by the elevation of the rays through a pixel's samples.

use crate::geometry::camera::Camera;
use crate::raster::coverage::BLOCK;
use crate::samples::{Pattern, SUBPIXELS};
use crate::simd::each3;
use proto::frame::{Background, Environment};

/// The sky's colour at the horizon and below, linear.
pub const HORIZON: [f32; 3] = [0.60, 0.70, 0.80];
/// The sky's colour from 30° of elevation upwards, linear.
pub const ZENITH: [f32; 3] = [0.15, 0.30, 0.60];
/// Sine of the elevation at which the sky is all zenith, 30°.
const SIN_ZENITH: f64 = 0.5;
/// That elevation, rad.
const ZENITH_RAD: f64 = std::f64::consts::PI / 6.0;

/// What is behind the samples of one pixel.
#[derive(Clone, Copy, Debug)]
pub enum Behind {
    /// One colour.
    Constant([f32; 3]),
    /// The sky, straight: its colour at the pixel's upper left and what it gains per sub-pixel to the right and downwards.
    Straight([[f64; 3]; 3]),
    /// The sky near a kink, or in a pixel that is wide: each sample's own, for the pixel whose upper left is there, sub.
    Bent([i32; 2]),
}

/// The background of the block that was asked for last: nine rays and five arcsines for each pixel of a sky would cost more than most
/// surfaces do.
#[derive(Clone, Copy, Debug, Default)]
pub struct BlockSky {
    /// The block's upper left, sub, and what is behind it.
    last: Option<([i32; 2], Behind)>,
}

impl BlockSky {
    /// Forgets the last block: the next may be another frame's.
    pub fn clear(&mut self) {
        self.last = None;
    }

    /// What is behind the pixel whose upper left is (x, y) sub. That of the block of 8 × 8 pixels which holds it, counted from the view's
    /// upper left, where it is one colour or straight; else the pixel's own.
    #[inline]
    pub fn of(&mut self, camera: &Camera, environment: &Environment, [x, y]: [i32; 2]) -> Behind {
        if let Background::Constant(colour) = environment.background {
            return Behind::Constant(colour);
        }
        let block = [x & !(BLOCK_SUB - 1), y & !(BLOCK_SUB - 1)];
        let known = self.last.filter(|(last, _)| *last == block);
        let (_, sky) = known.unwrap_or_else(|| (block, Behind::square(camera, block, BLOCK_SUB, WIDE_BLOCK)));
        self.last = Some((block, sky));
        match sky {
            Behind::Constant(_) => sky,
            Behind::Straight([corner, along, across]) => {
                let (dx, dy) = (f64::from(x - block[0]), f64::from(y - block[1]));
                Behind::Straight([each3([0, 1, 2], |c| corner[c] + (along[c] * dx + across[c] * dy)), along, across])
            }
            Behind::Bent(_) => Behind::square(camera, [x, y], SUBPIXELS, WIDE),
        }
    }
}

impl Behind {
    /// Of the square with that side whose upper left is (x, y) sub.
    ///
    /// Along the elevation the sky has two kinks and is nearly straight elsewhere: where a square doesn't come near a kink, and is
    /// no wider than `wide`, it is taken as affine, which differs by less than an eighth of the square of that angle.
    fn square(camera: &Camera, [x, y]: [i32; 2], side: i32, wide: f64) -> Self {
        let sine = |dx: i32, dy: i32| elevation(camera, [x + dx, y + dy]);
        let corners = [sine(0, 0), sine(side, 0), sine(0, side), sine(side, side)];
        let low = corners.into_iter().fold(f64::INFINITY, |m, s| if s < m { s } else { m });
        let high = corners.into_iter().fold(f64::NEG_INFINITY, |m, s| if s > m { s } else { m });
        // The sky may sag between corners: by the second order as well.
        let slack = (high - low) * (high - low) + 1e-9;
        let near = |kink: f64| low - slack < kink && high + slack > kink;
        if near(0.0) || near(SIN_ZENITH) || high - low > wide {
            return Self::Bent([x, y]);
        }
        if low >= SIN_ZENITH || high <= 0.0 {
            return Self::Constant(sky(low));
        }
        let half = side / 2;
        let [centre, left, right, up, down] =
            [sine(half, half), sine(0, half), sine(side, half), sine(half, 0), sine(half, side)]
                .map(|s| sky(s).map(f64::from));
        let per_sub = 1.0 / f64::from(side);
        let gain = |from: [f64; 3], to: [f64; 3]| std::array::from_fn(|c| (to[c] - from[c]) * per_sub);
        let (along, across): ([f64; 3], [f64; 3]) = (gain(left, right), gain(up, down));
        let corner = std::array::from_fn(|c| centre[c] - (along[c] + across[c]) * f64::from(half));
        Self::Straight([corner, along, across])
    }

    /// At a sample, sub from the pixel's upper left.
    #[inline]
    pub fn at(&self, camera: &Camera, [dx, dy]: [i32; 2]) -> [f32; 3] {
        match self {
            Self::Constant(colour) => *colour,
            Self::Straight([corner, along, across]) => {
                each3([0, 1, 2], |c| (corner[c] + (along[c] * f64::from(dx) + across[c] * f64::from(dy))) as f32)
            }
            Self::Bent([x, y]) => sky(elevation(camera, [x + dx, y + dy])),
        }
    }

    /// The mean over samples; there is at least one.
    pub fn mean(&self, camera: &Camera, pattern: &Pattern, mask: u64) -> [f32; 3] {
        match self {
            Self::Constant(colour) => *colour,
            // The mean of all points is the centre.
            Self::Straight(_) if mask == pattern.full => self.at(camera, [SUBPIXELS / 2; 2]),
            Self::Straight(_) | Self::Bent(_) => {
                let mut sum = [0.0f64; 3];
                let mut rest = mask;
                while rest != 0 {
                    let colour = self.at(camera, pattern.points[rest.trailing_zeros() as usize]);
                    rest &= rest - 1;
                    sum = each3([0, 1, 2], |c| sum[c] + f64::from(colour[c]));
                }
                let share = 1.0 / f64::from(mask.count_ones());
                each3(sum, |c| (c * share) as f32)
            }
        }
    }
}

/// Sine of the elevation of the ray through a sub-pixel position.
fn elevation(camera: &Camera, [x, y]: [i32; 2]) -> f64 {
    camera.ray_world(camera.ray(x, y)).y
}

/// Pixels in which the sine of the elevation changes by more than this, as in views of nearly 180°, are looked at sample by sample.
const WIDE: f64 = 1.0 / 512.0;

/// Blocks in which it changes by more are looked at pixel by pixel. Straight in so many, the sky is 4e-5 of full scale off at most, linear.
const WIDE_BLOCK: f64 = 1.0 / 48.0;

/// Side of a block, sub.
const BLOCK_SUB: i32 = BLOCK as i32 * SUBPIXELS;

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
