//! Chance that is the same on every machine: a seeded generator for things in a row, and noise for things in a plane.

/// The generator `SplitMix64` (Steele, Lea, Flood 2014): ten lines, good enough for scenery.
#[derive(Clone, Debug)]
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        mix(self.0)
    }

    /// In 0..1.
    pub(crate) fn unit(&mut self) -> f64 {
        unit(self.next())
    }

    /// In `low..high`.
    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// In `0..count`.
    pub(crate) fn index(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }

    /// True with this probability.
    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }
}

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

/// A number in 0..1 that belongs to a lattice point.
pub(crate) fn hash(seed: u64, x: i64, y: i64) -> f64 {
    let a = mix(seed.wrapping_add((x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)));
    unit(mix(a ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F)))
}

/// Smooth noise in −1..1 whose features are about 1 wide. With `period` it repeats after that many lattice points, as
/// textures must.
pub(crate) fn noise(seed: u64, x: f64, y: f64, period: Option<i64>) -> f64 {
    let (x0, y0) = (libm::floor(x), libm::floor(y));
    let (fx, fy) = (fade(x - x0), fade(y - y0));
    let wrap = |i: i64| period.map_or(i, |period| i.rem_euclid(period));
    let at = |i: i64, j: i64| hash(seed, wrap(x0 as i64 + i), wrap(y0 as i64 + j)) * 2.0 - 1.0;
    let low = at(0, 0) + (at(1, 0) - at(0, 0)) * fx;
    let high = at(0, 1) + (at(1, 1) - at(0, 1)) * fx;
    low + (high - low) * fy
}

fn fade(t: f64) -> f64 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// 0 below `low`, 1 above `high`, and between them a curve without a kink.
pub(crate) fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    fade(((x - low) / (high - low)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generator_is_splitmix64() {
        // The first outputs for seed 1234567, as published with the reference implementation.
        let mut random = Random::new(1_234_567);
        assert_eq!(random.next(), 6_457_827_717_110_365_317);
        assert_eq!(random.next(), 3_203_168_211_198_807_973);
    }

    #[test]
    fn noise_is_continuous_and_repeats_when_asked() {
        for i in 0..200 {
            let (x, y) = (f64::from(i) * 0.173 - 9.0, f64::from(i) * 0.291 - 20.0);
            let here = noise(5, x, y, Some(8));
            assert!((-1.0..=1.0).contains(&here), "{here}");
            assert!((here - noise(5, x + 1e-6, y, Some(8))).abs() < 1e-4, "jump at {x}, {y}");
            assert!((here - noise(5, x + 8.0, y - 16.0, Some(8))).abs() < 1e-9, "no period at {x}, {y}");
        }
    }
}
