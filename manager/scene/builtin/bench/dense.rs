//! Rolling country of 1 002 528 triangles in 144 tiles, and 10 000 trees of 20 triangles.

use super::super::random::Random;
use super::super::shapes::{Shape, Vertex};
use super::{FOV_DEG, Kit, Place, path};
use crate::host::camera::CameraPose;
use glam::{DVec3, dvec3};
use std::f64::consts::{PI, TAU};

/// Half the side of the country, m.
const HALF: f64 = 2000.0;
/// Tiles along a side.
const TILES: u32 = 12;
/// Squares along a tile's side.
const CELLS: u32 = 59;
const TREES: u32 = 10_000;
/// Amplitude and length of the waves that the hills are a sum of, m.
const WAVES: [[f64; 2]; 6] = [[45.0, 2600.0], [30.0, 1500.0], [16.0, 700.0], [7.0, 310.0], [3.0, 130.0], [1.2, 47.0]];

/// y = Σ amplitude · sin(k · (x, z) + phase).
struct Hills {
    /// Amplitude, k along x and z, phase.
    waves: [[f64; 4]; 6],
}

impl Hills {
    fn new(random: &mut Random) -> Self {
        let waves = WAVES.map(|[amplitude, length]| {
            let (s, c) = libm::sincos(random.range(0.0, PI));
            [amplitude, TAU / length * c, TAU / length * s, random.range(0.0, TAU)]
        });
        Self { waves }
    }

    fn at(&self, x: f64, z: f64) -> Vertex {
        let (mut y, mut slope_x, mut slope_z) = (0.0, 0.0, 0.0);
        for [amplitude, kx, kz, phase] in self.waves {
            let (s, c) = libm::sincos(kx * x + kz * z + phase);
            y += amplitude * s;
            slope_x += amplitude * kx * c;
            slope_z += amplitude * kz * c;
        }
        Vertex::new(dvec3(x, y, z), dvec3(-slope_x, 1.0, -slope_z).normalize())
    }
}

pub(super) fn build(kit: &mut Kit) -> Vec<CameraPose> {
    let hills = Hills::new(&mut kit.random);
    let soils = [[0.33, 0.45, 0.20], [0.40, 0.48, 0.24], [0.28, 0.40, 0.18], [0.48, 0.44, 0.28]];
    let soils = soils.map(|color| kit.color("soil", color));
    let leaves = [[0.10, 0.28, 0.10], [0.14, 0.34, 0.12], [0.20, 0.36, 0.10]].map(|color| kit.color("leaves", color));
    let bark = kit.color("bark", [0.30, 0.22, 0.15]);
    // One metre high.
    let crown = Shape::cylinder(10, [0.35, 0.0], [0.2, 1.0], false);
    let trunk = Shape::cylinder(5, [0.05, 0.05], [-0.1, 0.22], false);
    let trees = leaves.map(|leaves| kit.mesh("tree", &[(&crown, leaves), (&trunk, bark)]));

    // Places on one net over all tiles: neighbours agree on their border to the bit.
    let place = |tile: u32, cell: u32| -HALF + 2.0 * HALF * (f64::from(tile * CELLS + cell) / f64::from(TILES * CELLS));
    for tile in 0..TILES * TILES {
        let (column, row) = (tile % TILES, tile / TILES);
        let land = Shape::grid(CELLS, CELLS, |i, j| hills.at(place(column, i), place(row, j)));
        let soil = soils[kit.random.index(soils.len())];
        let mesh = kit.mesh("terrain", &[(&land, soil)]);
        kit.put("terrain", mesh, Place::ORIGIN);

        let share = TREES / (TILES * TILES) + u32::from(tile < TREES % (TILES * TILES));
        for _ in 0..share {
            let random = &mut kit.random;
            let x = random.range(place(column, 0), place(column, CELLS));
            let z = random.range(place(row, 0), place(row, CELLS));
            let height = random.range(8.0, 18.0);
            let tree = trees[random.index(trees.len())];
            let turn = random.range(0.0, TAU);
            let scale = dvec3(0.8, 1.0, 0.8) * height;
            kit.put("tree", tree, Place { at: hills.at(x, z).position, turn, scale });
        }
    }
    path(FOV_DEG, |t| {
        let (x, z) = (-1950.0 + 1400.0 * t, 300.0 * libm::sin(2.0 * t));
        let ground: DVec3 = hills.at(x, z).position;
        (dvec3(x, ground.y.max(0.0) + 190.0 - 60.0 * t, z), dvec3(x + 1000.0, -160.0, z * 0.5))
    })
}
