//! A runway in grass with 42 white bars (168 edges) in one plane with it, on a 3° approach; beside it three buses and three
//! tanks, each kind in three degrees of detail.

use super::super::shapes::{Caps, Shape};
use super::{Kit, Place, ground, path};
use crate::host::camera::CameraPose;
use glam::{DVec3, dvec3};

/// A pilot's window is narrower than a street's view.
const APPROACH_FOV_DEG: f64 = 40.0;

/// Bars as ranges of x and z, m.
fn bars() -> Vec<[[f64; 2]; 2]> {
    let mut bars = Vec::new();
    for z in [-36.0, -2994.0] {
        for pair in 0..6u8 {
            for side in [-1.0, 1.0] {
                let x = side * (3.2 + 3.2 * f64::from(pair));
                bars.push([[x - 0.9, x + 0.9], [z, z + 30.0]]);
            }
        }
    }
    bars.extend((0..14u8).map(|i| {
        let z = -130.0 - 200.0 * f64::from(i);
        [[-0.45, 0.45], [z, z + 30.0]]
    }));
    for side in [-1.0, 1.0] {
        let x = side * 12.0;
        bars.extend([-345.0, -2700.0].map(|z| [[x - 3.0, x + 3.0], [z, z + 45.0]]));
    }
    bars
}

pub(super) fn build(kit: &mut Kit) -> Vec<CameraPose> {
    let grass = kit.color("grass", [0.30, 0.42, 0.20]);
    let asphalt = kit.color("asphalt", [0.20, 0.20, 0.21]);
    let white = kit.color("white", [0.92, 0.92, 0.90]);
    kit.paint("ground", 0, &ground([-4000.0, 4000.0], [-6000.0, 2000.0], [32, 32]), grass);
    kit.paint("runway", 1, &Shape::rect([-22.5, 22.5], [-3000.0, 0.0], 0.0), asphalt);
    let markings = Shape::join(bars().into_iter().map(|[x, z]| Shape::rect(x, z, 0.0)));
    kit.paint("markings", 2, &markings, white);
    buses(kit);

    let steel = kit.color("steel", [0.75, 0.76, 0.78]);
    for (i, sides) in [8, 24, 96].into_iter().enumerate() {
        let tank = Shape::cylinder(sides, [9.0, 9.0], [0.0, 12.0], true);
        let tank = kit.mesh("tank", &[(&tank, steel)]);
        let i = i as f64;
        kit.put("tank", tank, Place { at: dvec3(-52.0 - 24.0 * i, 0.0, -60.0 - 10.0 * i), ..Place::ORIGIN });
    }
    let slope = libm::tan(3f64.to_radians());
    path(APPROACH_FOV_DEG, |t| {
        let distance = 900.0 + (20.0 - 900.0) * t;
        (DVec3::new(0.0, (distance + 300.0) * slope, distance), dvec3(0.0, 0.0, -300.0))
    })
}

/// A plain box, one with windows, one with windows and wheels.
fn buses(kit: &mut Kit) {
    let dark = kit.color("window", [0.12, 0.14, 0.18]);
    let rubber = kit.color("tyre", [0.08, 0.08, 0.08]);
    let body = Shape::cuboid([-1.25, 1.25], [0.4, 3.2], [-6.0, 6.0], Caps::Both);
    let windows = Shape::join((0..7u8).map(|i| {
        let z = -5.2 + 1.5 * f64::from(i);
        Shape::cuboid([-1.27, 1.27], [1.9, 2.7], [z, z + 1.1], Caps::None)
    }));
    let wheels = Shape::join([-1.1, 1.1].into_iter().flat_map(|x| {
        [-4.0, 3.5].map(|z| Shape::cuboid([x - 0.25, x + 0.25], [0.0, 1.0], [z - 0.5, z + 0.5], Caps::Both))
    }));
    for (i, color) in [[0.85, 0.65, 0.10], [0.75, 0.15, 0.12], [0.15, 0.35, 0.70]].into_iter().enumerate() {
        let paint = kit.color("bus", color);
        let parts = [(&body, paint), (&windows, dark), (&wheels, rubber)];
        let bus = kit.mesh("bus", &parts[..=i]);
        let i = i as f64;
        kit.put("bus", bus, Place { at: dvec3(34.0 + 6.0 * i, 0.0, -40.0 - 25.0 * i), turn: 0.5 * i, ..Place::ORIGIN });
    }
}
