//! A town on level ground: 15 × 15 blocks of nine buildings, tall in the middle, made of 28 shared meshes.

use super::super::shapes::{Caps, Shape};
use super::{FOV_DEG, Kit, Place, ground, path};
use crate::host::camera::CameraPose;
use glam::dvec3;
use std::f64::consts::FRAC_PI_2;

/// Half the width of the town, m.
const HALF: f64 = 1125.0;
/// From street to street, m.
const BLOCK: f64 = 150.0;
const BLOCKS: u32 = 15;
/// Half the width of a street, m.
const STREET: f64 = 7.0;
/// Side of a plot; three by three fill a block between the streets. m.
const PLOT: f64 = 45.3;

/// A building one metre wide, deep and high.
struct Kind {
    walls: Shape,
    roof: Shape,
    glass: Option<Shape>,
}

fn kinds() -> [Kind; 7] {
    const S: [f64; 2] = [-0.5, 0.5];
    let walls = |top: f64| Shape::cuboid(S, [0.0, top], S, Caps::None);
    let flat_roof = || Shape::rect(S, S, 1.0);
    let plain = |walls: Shape, roof: Shape| Kind { walls, roof, glass: None };
    let (west, north, south) = ([-0.5, 0.0], [-0.5, 0.0], [0.0, 0.5]);
    let bands = [0.12, 0.30, 0.48, 0.66, 0.84]
        .map(|y| Shape::cuboid([-0.505, 0.505], [y, y + 0.08], [-0.505, 0.505], Caps::None));
    [
        plain(walls(1.0), flat_roof()),
        plain(walls(0.65), Shape::gable(S, [0.65, 1.0], S)),
        plain(walls(0.7), Shape::pyramid(S, [0.7, 1.0], S)),
        // Stepped: each storey smaller than the one below.
        plain(
            Shape::cuboid(S, [0.0, 0.6], S, Caps::Top),
            Shape::join([
                Shape::cuboid([-0.35, 0.35], [0.6, 0.85], [-0.35, 0.35], Caps::Top),
                Shape::cuboid([-0.2, 0.2], [0.85, 1.0], [-0.2, 0.2], Caps::Top),
            ]),
        ),
        // Two wings at a right angle.
        plain(
            Shape::join([
                Shape::cuboid(S, [0.0, 0.6], north, Caps::None),
                Shape::cuboid(west, [0.0, 0.6], south, Caps::None),
            ]),
            Shape::join([Shape::gable(S, [0.6, 1.0], north), Shape::gable(west, [0.6, 0.9], south)]),
        ),
        plain(Shape::cylinder(12, [0.5, 0.5], [0.0, 0.95], false), Shape::cylinder(12, [0.5, 0.0], [0.95, 1.0], false)),
        Kind { walls: walls(1.0), roof: flat_roof(), glass: Some(Shape::join(bands)) },
    ]
}

/// Which kinds are built high, and which low.
const TOWERS: [usize; 4] = [0, 3, 5, 6];
const HOUSES: [usize; 5] = [0, 1, 2, 4, 6];

pub(super) fn build(kit: &mut Kit) -> Vec<CameraPose> {
    let grass = kit.color("ground", [0.30, 0.38, 0.22]);
    let asphalt = kit.color("asphalt", [0.16, 0.16, 0.17]);
    let glass = kit.color("glass", [0.20, 0.28, 0.36]);
    let walls = [[0.72, 0.68, 0.60], [0.60, 0.42, 0.34], [0.55, 0.57, 0.60], [0.80, 0.78, 0.74]];
    let walls = walls.map(|color| kit.color("wall", color));
    let roofs = [[0.50, 0.20, 0.15], [0.28, 0.27, 0.28], [0.36, 0.30, 0.24], [0.42, 0.44, 0.46]];
    let roofs = roofs.map(|color| kit.color("roof", color));

    let mut meshes = Vec::new();
    for (k, kind) in kinds().iter().enumerate() {
        for (v, &wall) in walls.iter().enumerate() {
            let mut parts = vec![(&kind.walls, wall), (&kind.roof, roofs[(v + k) % roofs.len()])];
            parts.extend(kind.glass.as_ref().map(|bands| (bands, glass)));
            meshes.push(kit.mesh(&format!("building {k}.{v}"), &parts));
        }
    }

    // In 64 pieces, so that it can be culled.
    for i in 0..8 {
        for j in 0..8 {
            let [x, z] = [i, j].map(|n| -4000.0 + f64::from(n) * 1000.0);
            kit.paint("ground", 0, &ground([x, x + 1000.0], [z, z + 1000.0], [6, 6]), grass);
        }
    }
    for k in 0..=BLOCKS {
        let middle = -HALF + f64::from(k) * BLOCK;
        let across = [middle - STREET, middle + STREET];
        kit.paint("street to the east", 1, &ground([-HALF, HALF], across, [40, 1]), asphalt);
        kit.paint("street to the south", 2, &ground(across, [-HALF, HALF], [1, 40]), asphalt);
    }

    let plots = BLOCKS * 3;
    for i in 0..plots {
        for j in 0..plots {
            let [x, z] = [i, j].map(|n| {
                let (block, plot) = (f64::from(n / 3), f64::from(n % 3));
                -HALF + block * BLOCK + STREET + PLOT * (plot + 0.5)
            });
            let random = &mut kit.random;
            let centre = libm::exp(-(x * x + z * z) / (450.0 * 450.0));
            let height = 7.0 + random.range(0.0, 8.0) + 120.0 * centre * random.unit();
            let kind = if height > 25.0 { TOWERS[random.index(4)] } else { HOUSES[random.index(5)] };
            let (width, depth) = (random.range(22.0, 38.0), random.range(22.0, 38.0));
            let mesh = meshes[kind * walls.len() + random.index(walls.len())];
            let turn = random.index(4) as f64 * FRAC_PI_2;
            kit.put("building", mesh, Place { at: dvec3(x, 0.0, z), turn, scale: dvec3(width, height, depth) });
        }
    }
    path(FOV_DEG, |t| {
        let eye = dvec3(-2400.0 + 2000.0 * t, 380.0 - 270.0 * t, 75.0 + 250.0 * (1.0 - t));
        (eye, dvec3(-700.0 + 1300.0 * t, 0.0, 75.0 - 75.0 * (1.0 - t)))
    })
}
