//! Textures, painted by functions of the place in the picture.
//!
//! Detail textures (grass, asphalt, leaves …) are grey and a little below white: they multiply a vertex colour, which
//! says what colour the thing is, while the texture says that it is not all of one piece. They repeat without a seam
//! and have no feature larger than a quarter of their width, because anything larger shows the repetition from the
//! air.

use super::random::{hash, noise, smoothstep};
use crate::scene::glb::{Channels, Picture};

/// A picture from `paint(u, v)` at the texels' centres: linear RGB and alpha in 0..=1.
fn picture(width: u32, height: u32, channels: Channels, paint: impl Fn(f64, f64) -> [f64; 4]) -> Picture {
    let mut bytes = Vec::with_capacity(width as usize * height as usize * channels as usize);
    for j in 0..height {
        for i in 0..width {
            let c = paint((f64::from(i) + 0.5) / f64::from(width), (f64::from(j) + 0.5) / f64::from(height));
            let rgb = [c[0], c[1], c[2]].map(srgb);
            match channels {
                Channels::Grey => bytes.push(rgb[0]),
                Channels::Rgb => bytes.extend_from_slice(&rgb),
                Channels::Rgba => {
                    bytes.extend_from_slice(&rgb);
                    bytes.push(byte(c[3]));
                }
            }
        }
    }
    Picture { width, height, channels, bytes }
}

fn grey(size: u32, paint: impl Fn(f64, f64) -> f64) -> Picture {
    picture(size, size, Channels::Grey, |u, v| [paint(u, v), 0.0, 0.0, 1.0])
}

/// IEC 61966-2-1.
fn srgb(linear: f64) -> u8 {
    let x = linear.clamp(0.0, 1.0);
    byte(if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * libm::pow(x, 1.0 / 2.4) - 0.055 })
}

fn byte(x: f64) -> u8 {
    libm::round(x.clamp(0.0, 1.0) * 255.0) as u8
}

/// Noise of several octaves that repeats over the picture; the coarsest has `cells` features across.
fn fractal(seed: u64, u: f64, v: f64, cells: i64, octaves: u32) -> f64 {
    let mut sum = 0.0;
    for octave in 0..octaves {
        let n = cells << octave;
        sum += noise(seed + u64::from(octave), u * n as f64, v * n as f64, Some(n)) / f64::from(1 << octave);
    }
    sum
}

/// Distance to the nearest of scattered points, one in each of `cells` × `cells` squares, in squares (Worley 1996).
fn scattered(seed: u64, u: f64, v: f64, cells: i64) -> f64 {
    let (x, y) = (u * cells as f64, v * cells as f64);
    let (i, j) = (libm::floor(x) as i64, libm::floor(y) as i64);
    let mut nearest = f64::INFINITY;
    for (i, j) in (-1..=1).flat_map(|dj| (-1..=1).map(move |di| (i + di, j + dj))) {
        let at = |salt| hash(seed + salt, i.rem_euclid(cells), j.rem_euclid(cells));
        let (dx, dy) = (i as f64 + at(0) - x, j as f64 + at(1) - y);
        nearest = nearest.min(dx * dx + dy * dy);
    }
    nearest.sqrt()
}

/// Meadow: 40 m wide.
pub(crate) fn grass() -> Picture {
    grey(256, |u, v| 0.8 + 0.07 * fractal(11, u, v, 9, 3) + 0.11 * fractal(13, u, v, 48, 2))
}

/// Crops in rows along v: 24 m wide, 8 rows.
pub(crate) fn rows() -> Picture {
    grey(128, |u, v| {
        let row = libm::cos(u * 8.0 * std::f64::consts::TAU);
        0.8 + 0.06 * row + 0.1 * fractal(23, u, v, 12, 4)
    })
}

/// Leaves of trees and hedges: 12 m wide.
pub(crate) fn leaves() -> Picture {
    grey(128, |u, v| 0.68 + 0.3 * fractal(31, u, v, 8, 4))
}

/// Tree tops seen from above, lit in the middle and dark between: 10 × 10 of them, 64 m wide.
pub(crate) fn tree_tops() -> Picture {
    grey(256, |u, v| {
        let gap = smoothstep(0.1, 0.85, scattered(33, u, v, 10));
        0.98 - 0.62 * gap + 0.16 * fractal(37, u, v, 24, 3)
    })
}

/// Asphalt: 12 m wide.
pub(crate) fn asphalt() -> Picture {
    grey(128, |u, v| 0.84 + 0.07 * fractal(41, u, v, 9, 2) + 0.10 * fractal(43, u, v, 32, 2))
}

/// Concrete slabs: 4 × 4 of them, 30 m wide.
pub(crate) fn slabs() -> Picture {
    grey(256, |u, v| {
        let (x, y) = (u * 4.0, v * 4.0);
        let joint = [x, y].iter().any(|t| (t - libm::round(*t)).abs() < 0.01);
        let slab = hash(51, libm::floor(x) as i64, libm::floor(y) as i64);
        let stain = 0.05 * fractal(53, u, v, 5, 5);
        if joint { 0.64 } else { 0.82 + 0.1 * slab + stain }
    })
}

/// Ribbed sheet metal: one rib per unit of u.
pub(crate) fn ribs() -> Picture {
    picture(32, 4, Channels::Grey, |u, _| [0.86 + 0.13 * libm::cos(u * std::f64::consts::TAU), 0.0, 0.0, 1.0])
}

/// Roof tiles: a course per 1/8 of v, 4 m wide.
pub(crate) fn tiles() -> Picture {
    grey(64, |u, v| {
        let course = libm::floor(v * 8.0);
        let within = v * 8.0 - course;
        let tile = libm::floor(u * 8.0 + if course % 2.0 == 0.0 { 0.5 } else { 0.0 });
        0.95 - 0.3 * smoothstep(0.65, 1.0, within) - 0.22 * hash(61, tile.rem_euclid(8.0) as i64, course as i64)
    })
}

/// One bay of an office facade, 4 m wide and 4 m high: a band of glass between a parapet and a floor edge. RGB.
pub(crate) fn office() -> Picture {
    picture(64, 64, Channels::Rgb, |u, v| {
        let glass = (0.22..0.74).contains(&v);
        let mullion = !(0.035..0.965).contains(&u) || (u - 0.5).abs() < 0.02;
        if glass && !mullion {
            let shine = 0.5 + 0.5 * smoothstep(0.2, 0.75, 1.0 - v + 0.2 * (u - 0.5));
            [0.06 * shine, 0.11 * shine, 0.17 * shine, 1.0]
        } else if glass {
            [0.35, 0.36, 0.38, 1.0]
        } else {
            let dirt = 1.0 - 0.12 * smoothstep(0.74, 0.95, v) * (0.6 + 0.4 * noise(71, u * 8.0, v * 2.0, Some(8)));
            [0.72 * dirt, 0.72 * dirt, 0.70 * dirt, 1.0]
        }
    })
}

/// One bay of a house, 3 m wide and 2.8 m high: a plastered wall with a window. RGB, to be multiplied by the wall's
/// colour.
pub(crate) fn house() -> Picture {
    picture(64, 64, Channels::Rgb, |u, v| {
        let (x, y) = ((u - 0.5).abs(), (v - 0.47).abs());
        if x < 0.2 && y < 0.25 {
            let bar = x < 0.015 || y < 0.015 || x > 0.18 || y > 0.23;
            if bar { [0.8, 0.8, 0.78, 1.0] } else { [0.05, 0.06, 0.08, 1.0] }
        } else if x < 0.31 && y < 0.25 && x > 0.21 {
            [0.20, 0.26, 0.20, 1.0] // shutters
        } else {
            let plaster = 0.88 + 0.06 * noise(81, u * 12.0, v * 12.0, Some(12));
            [plaster; 4]
        }
    })
}

/// An airliner's skin: u from nose to tail, v around from the belly up the left side over the back and down. RGB.
///
/// White above, grey belly, a blue line and tail, a row of windows on both sides, doors, and the windscreen.
pub(crate) fn airliner_skin() -> Picture {
    picture(1024, 128, Channels::Rgb, |u, v| {
        // Height around the body: 0 at the belly, 1 at the back.
        let height = 0.5 - 0.5 * libm::cos(v * std::f64::consts::TAU);
        let window = (0.12..0.80).contains(&u) && (height - 0.635).abs() < 0.025 && libm::fmod(u * 110.0, 1.0) < 0.5;
        let door = [0.105, 0.815].iter().any(|d| (u - d).abs() < 0.011) && (0.42..0.76).contains(&height);
        let door_edge =
            door && ([0.105, 0.815].iter().all(|d| (u - d).abs() > 0.008) || !(0.45..0.73).contains(&height));
        let windscreen = (0.028..0.052).contains(&u) && (0.68..0.88).contains(&height);
        let tail = u > 0.80 + 0.12 * (1.0 - height);
        if window || windscreen {
            [0.03, 0.035, 0.045, 1.0]
        } else if door_edge {
            [0.40, 0.42, 0.45, 1.0]
        } else if tail || (0.40..0.45).contains(&height) {
            [0.02, 0.09, 0.30, 1.0]
        } else if height < 0.40 {
            [0.52, 0.54, 0.56, 1.0]
        } else {
            [0.88, 0.88, 0.87, 1.0]
        }
    })
}

/// A cumulus cloud seen from the side, flat below; RGBA with a soft border. `seed` makes another cloud.
pub(crate) fn cloud(seed: u64) -> Picture {
    // Balls on a line make the heap; noise frays it.
    let balls: Vec<[f64; 3]> = (0..14)
        .map(|k| {
            let at = |salt: i64| hash(seed, k, salt);
            let x = 0.14 + 0.72 * (k as f64 + at(0)) / 14.0;
            let middle = 1.0 - (x - 0.5).abs() * 1.7;
            let r = (0.06 + 0.12 * at(1)) * (0.5 + 0.6 * middle);
            [x, 0.70 - r * 0.9 - 0.28 * at(2) * middle, r]
        })
        .collect();
    picture(256, 128, Channels::Rgba, |u, v| {
        let fray = 0.035 * fractal(seed + 7, u, v, 6, 5);
        let mut density: f64 = 0.0;
        let mut light: f64 = 0.0;
        for [x, y, r] in &balls {
            let (dx, dy) = ((u - x) * 1.0, (v - y) * 0.62);
            let inside = 1.0 - (libm::sqrt(dx * dx + dy * dy) + fray) / r;
            if inside > 0.0 {
                density += inside;
                // Each ball is brightest towards the sun: above and a little to the right.
                light = light.max(0.55 + 0.5 * (-dy * 1.2 + dx * 0.5) / r);
            }
        }
        let base = 1.0 - smoothstep(0.64 + fray, 0.76 + fray, v);
        let edge = smoothstep(0.0, 0.06, u) * smoothstep(0.0, 0.06, 1.0 - u) * smoothstep(0.0, 0.05, v);
        let alpha = smoothstep(0.02, 0.55, density) * base * edge * 0.92;
        let white = 0.62 + 0.38 * light.clamp(0.0, 1.0) - 0.20 * smoothstep(0.35, 0.75, v);
        [white * 0.98, white * 0.99, white * 1.02, alpha]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detail_textures_repeat_without_a_seam() {
        for (name, picture) in
            [("grass", grass()), ("leaves", leaves()), ("tree tops", tree_tops()), ("asphalt", asphalt())]
        {
            let (w, h) = (picture.width as usize, picture.height as usize);
            let mean = |pairs: &mut dyn Iterator<Item = (usize, usize)>| {
                let steps: Vec<f64> =
                    pairs.map(|(a, b)| (f64::from(picture.bytes[a]) - f64::from(picture.bytes[b])).abs()).collect();
                steps.iter().sum::<f64>() / steps.len() as f64
            };
            let seam = mean(&mut (0..h).map(|j| (j * w, j * w + w - 1)));
            let inside = mean(&mut (0..h).map(|j| (j * w + w / 2, j * w + w / 2 + 1)));
            assert!(seam < 3.0 * inside + 2.0, "{name}: {seam} across the seam, {inside} inside");
        }
    }

    #[test]
    fn a_cloud_ends_before_its_border() {
        let cloud = cloud(1);
        let (w, h) = (cloud.width as usize, cloud.height as usize);
        let alpha = |i: usize, j: usize| cloud.bytes[4 * (j * w + i) + 3];
        let border = (0..w)
            .flat_map(|i| [alpha(i, 0), alpha(i, h - 1)])
            .chain((0..h).flat_map(|j| [alpha(0, j), alpha(w - 1, j)]));
        assert!(border.max() < Some(8), "the border must be clear");
        assert!(cloud.bytes.iter().skip(3).step_by(4).any(|&a| a > 200), "the middle must not");
    }
}
