//! Forty translucent balls of 500 triangles in front of huts, and twenty panes of coloured glass in front of those.

use super::super::shapes::{Caps, Shape};
use super::{FOV_DEG, Kit, Place, ground, path};
use crate::host::camera::CameraPose;
use glam::{DVec3, dvec3};

pub(super) fn build(kit: &mut Kit) -> Vec<CameraPose> {
    let grass = kit.color("ground", [0.36, 0.40, 0.28]);
    let land = ground([-1000.0, 1000.0], [-1000.0, 1000.0], [40, 40]);
    let land = kit.mesh("ground", &[(&land, grass)]);
    kit.put("ground", land, Place::ORIGIN);

    let clay = kit.color("hut", [0.55, 0.35, 0.25]);
    let hut = Shape::cuboid([-5.0, 5.0], [0.0, 8.0], [-5.0, 5.0], Caps::Top);
    let hut = kit.mesh("hut", &[(&hut, clay)]);
    for x in (-60..=60).step_by(20) {
        kit.put("hut", hut, Place { at: dvec3(f64::from(x), 0.0, -50.0), ..Place::ORIGIN });
    }

    let ball = Shape::sphere(25, 11);
    let puffs = [(0.75, 0.10), (0.55, 0.15), (0.35, 0.20), (0.85, 0.12)].map(|(grey, alpha)| {
        let vapour = kit.glass("puff", [grey, grey, grey * 1.04], alpha, false);
        kit.mesh("puff", &[(&ball, vapour)])
    });
    for _ in 0..40 {
        let random = &mut kit.random;
        let radius = random.range(26.0, 38.0);
        let mesh = puffs[random.index(puffs.len())];
        let at = dvec3(random.range(-48.0, 48.0), random.range(8.0, 40.0), random.range(-40.0, 20.0));
        kit.put("puff", mesh, Place { at, scale: DVec3::splat(radius), ..Place::ORIGIN });
    }

    let pane =
        Shape::flat(&[[dvec3(-0.5, 0.0, 0.0), dvec3(0.5, 0.0, 0.0), dvec3(0.5, 1.0, 0.0), dvec3(-0.5, 1.0, 0.0)]]);
    let panes = [[0.2, 0.5, 0.7], [0.6, 0.7, 0.3], [0.7, 0.3, 0.3]].map(|color| {
        let glass = kit.glass("window", color, 0.12, true);
        kit.mesh("window", &[(&pane, glass)])
    });
    for i in 0..20u8 {
        let random = &mut kit.random;
        let at = dvec3(random.range(-18.0, 18.0), random.range(0.0, 12.0), 42.0 + 2.0 * f64::from(i));
        let place = Place { at, turn: random.range(-0.3, 0.3), scale: dvec3(60.0, 32.0, 1.0) };
        kit.put("window", panes[usize::from(i) % panes.len()], place);
    }
    path(FOV_DEG, |t| {
        (dvec3(30.0 * libm::sin(2.0 * t) - 15.0, 16.0 + 14.0 * t, 150.0 - 45.0 * t), dvec3(0.0, 22.0, 0.0))
    })
}
