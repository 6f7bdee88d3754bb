//! Thirty opaque walls one behind another, each larger than the screen, listed from far to near, and sixty boxes in front;
//! or the nearest wall and the boxes alone, which is the same picture.

use super::super::shapes::{Caps, Shape, Vertex};
use super::{ASPECT, FOV_DEG, Kit, Place, path};
use crate::host::camera::CameraPose;
use glam::{DVec3, dvec3};
use std::f64::consts::TAU;

const WALLS: u8 = 30;
const BOXES: u8 = 60;

pub(super) fn build(kit: &mut Kit) -> Vec<CameraPose> {
    layers(kit, 0)
}

/// Only what is seen.
pub(super) fn build_front(kit: &mut Kit) -> Vec<CameraPose> {
    layers(kit, WALLS - 1)
}

/// The walls from number `first` on, and the boxes.
fn layers(kit: &mut Kit, first: u8) -> Vec<CameraPose> {
    let wall =
        Shape::grid(8, 8, |i, j| Vertex::new(dvec3(f64::from(i) / 8.0 - 0.5, 0.5 - f64::from(j) / 8.0, 0.0), DVec3::Z));
    let unit = [-0.5, 0.5];
    let cube = Shape::cuboid(unit, unit, unit, Caps::Both);
    let mut colored = |name: &str, shape: &Shape| {
        let color = [(); 3].map(|()| kit.random.range(0.2, 0.9) as f32);
        let material = kit.color(name, color);
        kit.mesh(name, &[(shape, material)])
    };
    let walls: Vec<_> = (0..10).map(|_| colored("wall", &wall)).collect();
    let boxes: Vec<_> = (0..6).map(|_| colored("box", &cube)).collect();

    let half_height = libm::tan((FOV_DEG / 2.0).to_radians());
    for k in first..WALLS {
        let distance = 50.0 + 30.0 * f64::from(WALLS - 1 - k);
        // Enough for the path's sway.
        let height = 2.0 * distance * half_height * 1.15 + 8.0;
        let place =
            Place { at: dvec3(0.0, 0.0, -distance), scale: dvec3(height * ASPECT, height, 1.0), ..Place::ORIGIN };
        kit.put("wall", walls[usize::from(k) % walls.len()], place);
    }
    for k in 0..BOXES {
        let distance = 45.0 - 27.0 * (f64::from(k) / f64::from(BOXES - 1));
        let random = &mut kit.random;
        let side = random.range(2.0, 6.0);
        let reach = distance * 0.45;
        let at = dvec3(random.range(-reach, reach) * 1.6, random.range(-reach, reach), -distance);
        let place = Place { at, turn: random.range(0.0, 3.0), scale: DVec3::splat(side) };
        kit.put("box", boxes[usize::from(k) % boxes.len()], place);
    }
    path(FOV_DEG, |t| {
        let (s, c) = libm::sincos(TAU * t);
        (dvec3(2.0 * s, c, 4.0 * t), dvec3(2.0 * s, c, -100.0))
    })
}
