//! Aircraft: an airliner of the A320's size, a light high-wing aeroplane of the Cessna 172's, and their shadows.
//!
//! Both have their nose towards −Z and stand on the ground at y = 0 at their origin, so that a heading is a turn about
//! Y.

use super::super::shapes::{Caps, Shape};
use super::kit::Kit;
use crate::scene::glb::MeshId;
use glam::{DAffine3, DVec2, DVec3, dvec2, dvec3};
use std::f64::consts::{FRAC_PI_2, TAU};

const GREY: DVec3 = dvec3(0.55, 0.57, 0.60);
const WHITE: DVec3 = dvec3(0.84, 0.84, 0.83);
const BLUE: DVec3 = dvec3(0.02, 0.09, 0.30);
const DARK: DVec3 = dvec3(0.03, 0.03, 0.035);

/// The meshes that all parked and moving aircraft share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fleet {
    pub(super) airliner: MeshId,
    pub(super) airliner_shadow: MeshId,
    /// In three liveries.
    pub(super) light: [MeshId; 3],
    pub(super) light_shadow: MeshId,
}

impl Fleet {
    pub(super) fn new(kit: &mut Kit) -> Self {
        let palette = kit.palette;
        let (skin, rest) = airliner();
        let airliner = kit.mesh("airliner", &[(skin, palette.skin), (rest, palette.plain)]);
        let shadow = Shape::join([
            plan(&[(0.0, -17.0), (1.9, -14.0), (1.9, 12.0), (0.6, 19.5), (-0.6, 19.5), (-1.9, 12.0), (-1.9, -14.0)]),
            plan(&[(1.9, -3.6), (17.0, 6.2), (17.0, 7.8), (1.9, 3.6)]).mirrored(),
            plan(&[(1.3, 15.0), (6.2, 18.6), (6.2, 20.0), (0.6, 19.0)]).mirrored(),
        ]);
        let airliner_shadow = kit.mesh("airliner shadow", &[(shadow, palette.shadow)]);
        let liveries = [dvec3(0.62, 0.05, 0.04), dvec3(0.03, 0.13, 0.42), dvec3(0.75, 0.42, 0.02)];
        let light = liveries.map(|stripe| {
            kit.mesh("light aircraft", &[(light(stripe), palette.plain), (propeller(), palette.propeller)])
        });
        let shadow = Shape::join([
            plan(&[(0.0, -2.6), (0.55, -2.0), (0.55, 1.5), (0.15, 5.3), (-0.15, 5.3), (-0.55, 1.5), (-0.55, -2.0)]),
            plan(&[(0.55, -0.95), (5.5, -0.8), (5.5, 0.45), (0.55, 0.7)]).mirrored(),
            plan(&[(0.2, 4.3), (1.7, 4.5), (1.7, 5.3), (0.2, 5.3)]).mirrored(),
        ]);
        let light_shadow = kit.mesh("light aircraft shadow", &[(shadow, palette.shadow)]);
        Self { airliner, airliner_shadow, light, light_shadow }
    }
}

/// A level polygon from (x, z) points listed clockwise on paper with z downwards.
fn plan(points: &[(f64, f64)]) -> Shape {
    let mut shape = Shape::new();
    let mut corners: Vec<DVec3> = points.iter().map(|&(x, z)| dvec3(x, 0.0, z)).collect();
    corners.reverse();
    shape.polygon(&corners);
    shape
}

/// An upright ring of `n` points about (0, y) at z, from the belly by way of +x; clockwise for who looks towards +z.
fn ring(n: u32, z: f64, y: f64, rx: f64, ry: f64) -> Vec<DVec3> {
    (0..n)
        .map(|k| {
            let (s, c) = libm::sincos(f64::from(k) / f64::from(n) * TAU);
            dvec3(rx * s, y - ry * c, z)
        })
        .collect()
}

/// A section of a wing that stretches towards +x.
#[derive(Clone, Copy, Debug)]
struct Section {
    x: f64,
    y: f64,
    leading_z: f64,
    chord: f64,
    thickness: f64,
}

/// A wing through its sections, root first, with its tip closed.
fn wing(sections: &[Section]) -> Shape {
    let rings: Vec<Vec<DVec3>> = sections
        .iter()
        .map(|s| {
            let at = |along: f64, up: f64| dvec3(s.x, s.y + up * s.thickness, s.leading_z + along * s.chord);
            vec![at(0.3, 0.5), at(0.7, 0.32), at(1.0, 0.0), at(0.7, -0.22), at(0.3, -0.5), at(0.0, -0.05)]
        })
        .collect();
    let mut shape = Shape::loft(&rings);
    if let Some(tip) = rings.last() {
        shape.polygon(tip);
    }
    shape
}

fn section(x: f64, y: f64, leading_z: f64, chord: f64, thickness: f64) -> Section {
    Section { x, y, leading_z, chord, thickness }
}

/// A wheel about the x axis.
fn wheel(at: DVec3, radius: f64, width: f64) -> Shape {
    let outline: Vec<DVec2> = (0..7)
        .map(|k| {
            let (s, c) = libm::sincos(f64::from(k) / 7.0 * TAU);
            dvec2(c, -s) * radius
        })
        .collect();
    Shape::prism(&outline, [-width / 2.0, width / 2.0], Caps::Both)
        .transformed(DAffine3::from_translation(at) * DAffine3::from_rotation_z(FRAC_PI_2))
        .colored(DARK)
}

/// The airliner: what the skin texture covers, and the rest in vertex colours.
fn airliner() -> (Shape, Shape) {
    const N: u32 = 12;
    // Stations from nose to tail: z, height of the middle, half width, half height.
    let body = [
        (-17.2, 3.15, 0.02, 0.02),
        (-16.9, 3.2, 0.55, 0.5),
        (-16.1, 3.35, 1.12, 1.08),
        (-14.8, 3.55, 1.65, 1.68),
        (-12.6, 3.7, 1.96, 2.02),
        (-4.0, 3.7, 1.98, 2.05),
        (7.0, 3.7, 1.98, 2.05),
        (11.5, 3.95, 1.8, 1.82),
        (15.5, 4.45, 1.22, 1.28),
        (18.8, 5.0, 0.55, 0.62),
        (20.2, 5.25, 0.16, 0.2),
    ];
    let rings: Vec<_> = body.iter().map(|&(z, y, rx, ry)| ring(N, z, y, rx, ry)).collect();
    // The loft maps u by station; the skin wants it by length.
    let skin = Shape::loft(&rings).remapped(|p, t| dvec2((p.z + 17.2) / 37.4, t.y));

    let wings = wing(&[
        section(1.2, 2.75, -4.8, 7.6, 0.95),
        section(6.2, 3.15, -0.6, 4.3, 0.55),
        section(16.6, 3.95, 5.6, 1.7, 0.2),
    ])
    .colored(GREY);
    let winglet = wing(&[section(3.85, 0.0, 5.8, 1.5, 0.14), section(5.5, 0.0, 7.1, 0.7, 0.08)])
        .transformed(DAffine3::from_translation(dvec3(16.65, 0.0, 0.0)) * DAffine3::from_rotation_z(FRAC_PI_2))
        .colored(BLUE);
    let tailplane = wing(&[section(0.5, 5.2, 14.6, 3.8, 0.4), section(6.2, 5.75, 18.4, 1.5, 0.16)]).colored(GREY);
    let fin = wing(&[
        section(5.4, 0.0, 12.4, 6.6, 0.55),
        section(6.4, 0.0, 13.8, 5.2, 0.5),
        section(11.9, 0.0, 18.1, 2.3, 0.25),
    ])
    .transformed(DAffine3::from_rotation_z(FRAC_PI_2))
    .colored(BLUE);
    let nacelle = |z, r| ring(8, z, 1.75, r, r).into_iter().map(|p| p + dvec3(5.7, 0.0, 0.0)).collect::<Vec<_>>();
    let mut intake = Shape::new();
    intake.polygon(&nacelle(-4.0, 0.95).into_iter().rev().collect::<Vec<_>>());
    let mut nozzle = Shape::new();
    nozzle.polygon(&nacelle(0.9, 0.55));
    let lip =
        Shape::loft(&[nacelle(-4.0, 0.95), nacelle(-4.25, 1.08), nacelle(-3.9, 1.2)]).colored(dvec3(0.7, 0.7, 0.72));
    let cowl =
        Shape::loft(&[nacelle(-3.9, 1.2), nacelle(-2.4, 1.26), nacelle(-0.6, 1.05), nacelle(0.9, 0.55)]).colored(WHITE);
    let pylon = Shape::cuboid([5.55, 5.85], [2.6, 3.1], [-2.8, 1.6], Caps::None).colored(GREY);
    let leg = |x: f64, z: f64, y: f64| {
        Shape::cuboid([x - 0.13, x + 0.13], [0.4, y], [z - 0.13, z + 0.13], Caps::None).colored(GREY)
    };
    let main_gear = Shape::join([
        leg(3.8, 1.4, 2.7),
        wheel(dvec3(3.45, 0.58, 1.4), 0.58, 0.4),
        wheel(dvec3(4.15, 0.58, 1.4), 0.58, 0.4),
    ]);
    let nose_gear = Shape::join([leg(0.0, -12.2, 1.8), wheel(dvec3(0.0, 0.38, -12.2), 0.38, 0.5)]);
    let half = Shape::join([
        wings,
        winglet,
        tailplane,
        intake.colored(DARK),
        nozzle.colored(DARK),
        lip,
        cowl,
        pylon,
        main_gear,
    ]);
    (skin, Shape::join([half.mirrored(), fin, nose_gear]))
}

fn light(stripe: DVec3) -> Shape {
    const N: u32 = 8;
    let body = [
        (-2.55, 1.25, 0.12, 0.12),
        (-2.45, 1.22, 0.42, 0.36),
        (-1.2, 1.25, 0.56, 0.52),
        (-0.75, 1.45, 0.58, 0.78),
        (0.9, 1.48, 0.56, 0.78),
        (1.9, 1.42, 0.40, 0.5),
        (5.2, 1.45, 0.10, 0.16),
    ];
    let rings: Vec<_> = body.iter().map(|&(z, y, rx, ry)| ring(N, z, y, rx, ry)).collect();
    let fuselage = Shape::loft(&rings).painted(|p, _| if p.y < 1.3 { stripe } else { WHITE });
    // Glass: a pane on each side, hardly proud of the skin, and the windscreen.
    let side = [dvec3(0.6, 1.55, 0.8), dvec3(0.6, 1.55, -0.7), dvec3(0.5, 2.08, -0.6), dvec3(0.5, 2.08, 0.7)];
    let screen = [dvec3(0.44, 1.72, -1.25), dvec3(-0.44, 1.72, -1.25), dvec3(-0.42, 2.2, -0.8), dvec3(0.42, 2.2, -0.8)];
    let glass = Shape::join([Shape::flat(&[side]).mirrored(), Shape::flat(&[screen])]).colored(dvec3(0.04, 0.05, 0.07));
    let wings = wing(&[
        section(0.0, 2.3, -0.95, 1.65, 0.24),
        section(2.6, 2.36, -0.95, 1.6, 0.22),
        section(5.5, 2.45, -0.8, 1.15, 0.14),
    ])
    .painted(|p, _| if p.x > 5.0 { stripe } else { WHITE });
    let tailplane = wing(&[section(0.05, 1.45, 4.2, 1.1, 0.12), section(1.7, 1.45, 4.45, 0.8, 0.08)]).colored(WHITE);
    let fin = wing(&[section(1.4, 0.0, 3.7, 1.6, 0.14), section(2.75, 0.0, 4.7, 0.75, 0.08)])
        .transformed(DAffine3::from_rotation_z(FRAC_PI_2))
        .colored(stripe);
    let strut = Shape::cuboid([-0.04, 0.04], [0.0, 2.75], [-0.08, 0.08], Caps::None)
        .transformed(DAffine3::from_translation(dvec3(0.5, 0.95, -0.3)) * DAffine3::from_rotation_z(-1.05))
        .colored(WHITE);
    let leg = Shape::cuboid([-0.06, 0.06], [-0.05, 0.95], [-0.1, 0.1], Caps::None)
        .transformed(DAffine3::from_translation(dvec3(1.15, 0.25, 0.3)) * DAffine3::from_rotation_z(0.7))
        .colored(WHITE);
    let half = Shape::join([wings, tailplane, strut, leg, wheel(dvec3(1.2, 0.23, 0.3), 0.23, 0.18)]).mirrored();
    let nose_leg = Shape::cuboid([-0.05, 0.05], [0.2, 1.0], [-1.85, -1.75], Caps::None).colored(GREY);
    Shape::join([fuselage, glass, half, fin, nose_leg, wheel(dvec3(0.0, 0.2, -1.8), 0.2, 0.15)])
}

/// The disc that a turning propeller looks like.
fn propeller() -> Shape {
    let mut disc = Shape::new();
    disc.polygon(&ring(12, -2.6, 1.25, 0.95, 0.95));
    disc
}
