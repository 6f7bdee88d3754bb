//! The village at the crossroads, farms, cars, and the works whose chimney smokes.

use super::super::random::Random;
use super::super::shapes::{Caps, Shape};
use super::kit::{Kit, heading};
use super::terrain::{self, ROAD_EAST, ROAD_SOUTH, ROAD_WEST};
use crate::scene::glb::{AlphaMode, MeshId, Node, NodeId, Surface};
use glam::{DVec2, DVec3, dvec2, dvec3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Where the chimney stands, in net coordinates, m.
const WORKS: DVec2 = dvec2(ROAD_EAST + 130.0, -430.0);
const CHIMNEY_TOP: f64 = 46.0;
const PUFFS: u32 = 36;

/// Builds it all and tells where the houses stand.
pub(super) fn build(kit: &mut Kit) -> Vec<DVec2> {
    let group = kit.group("village");
    let mut random = Random::new(kit.random.next());
    let houses = houses(kit, &mut random);
    // Along the two roads from the crossing, both sides, thinning out; then a second row behind.
    let mut places = Vec::new();
    for (arm, first, count) in [(0, 0, 4), (1, 0, 3), (2, 0, 3), (3, 0, 2), (3, 29, 16)] {
        for k in first..first + count {
            for side in [-1.0, 1.0] {
                for row in 0..2 {
                    if random.chance(if row == 0 { 0.12 } else { 0.55 }) {
                        continue;
                    }
                    let along = 24.0 + 27.0 * f64::from(k) + random.range(-4.0, 4.0);
                    let off = side * (17.0 + 30.0 * f64::from(row) + random.range(-2.0, 4.0));
                    let net = match arm {
                        0 => dvec2(ROAD_EAST + off, ROAD_SOUTH - along),
                        1 => dvec2(ROAD_EAST + off, ROAD_SOUTH + along),
                        2 => dvec2(ROAD_EAST + along, ROAD_SOUTH + off),
                        _ => dvec2(ROAD_EAST - along, ROAD_SOUTH + off),
                    };
                    if row == 1 && (ROAD_SOUTH - net.y).abs() > 20.0 && net.x < -280.0 && net.x > -350.0 && off < 0.0 {
                        continue; // The church stands there.
                    }
                    // Where the second rows of two roads meet there would be houses in houses.
                    let (dx, dz) = ((net.x - ROAD_EAST).abs(), (net.y - ROAD_SOUTH).abs());
                    if row == 1 && dx.min(dz) > 30.0 && dx.max(dz) < 62.0 && arm >= 2 {
                        continue;
                    }
                    let facing = if arm < 2 { FRAC_PI_2 } else { 0.0 } + random.range(-0.08, 0.08);
                    let p = place(kit, group, houses[random.index(houses.len())], net, facing);
                    places.push(dvec2(p.x, p.z));
                }
            }
        }
    }
    church(kit, group);
    // Farms in the fields on both sides of the approach.
    for (x, z, turn) in [
        (-440.0, 1190.0, 0.4),
        (300.0, 1010.0, 1.2),
        (ROAD_WEST - 60.0, 250.0, 0.0),
        (-300.0, 1900.0, 0.7),
        (1350.0, -900.0, 0.2),
        (-1500.0, -700.0, 0.9),
    ] {
        farm(kit, group, houses[0], dvec2(x, z), turn);
    }
    works(kit, group);
    smoke(kit);
    places
}

fn place(kit: &mut Kit, group: NodeId, mesh: MeshId, net: DVec2, turn: f64) -> DVec3 {
    let p = terrain::ground(net);
    kit.glb.node(Some(group), Node::new("house").mesh(mesh).at(p).turned(heading(turn)));
    p
}

/// A house: ridge along x, walls into the ground.
fn house_shape(width: f64, depth: f64, storeys: u32, wall: DVec3, roof: DVec3) -> [Shape; 3] {
    let height = 2.8 * f64::from(storeys);
    let (x, z) = ([-width / 2.0, width / 2.0], [-depth / 2.0, depth / 2.0]);
    // A whole number of window bays on every wall.
    let bays = |length: f64| libm::round(length / 3.0).max(1.0) / length;
    let mut walls = Shape::new();
    for (a, b) in [
        (dvec2(x[0], z[1]), dvec2(x[1], z[1])),
        (dvec2(x[1], z[1]), dvec2(x[1], z[0])),
        (dvec2(x[1], z[0]), dvec2(x[0], z[0])),
        (dvec2(x[0], z[0]), dvec2(x[0], z[1])),
    ] {
        let u = bays(a.distance(b)) * a.distance(b);
        let up = |p: DVec2, y: f64| dvec3(p.x, y, p.y);
        walls.mapped_polygon(&[
            (up(a, 0.0), dvec2(0.0, f64::from(storeys))),
            (up(b, 0.0), dvec2(u, f64::from(storeys))),
            (up(b, height), dvec2(u, 0.0)),
            (up(a, height), dvec2(0.0, 0.0)),
        ]);
    }
    let base = Shape::cuboid([x[0] - 0.05, x[1] + 0.05], [-2.5, 0.35], [z[0] - 0.05, z[1] + 0.05], Caps::None)
        .colored(wall * 0.55);
    let rise = depth * 0.42;
    let gable = Shape::gable([x[0] - 0.3, x[1] + 0.3], [height - 0.25, height + rise], [z[0] - 0.6, z[1] + 0.6])
        .tiled(dvec2(0.25, 0.25))
        .colored(roof);
    let chimney = Shape::cuboid(
        [width * 0.22, width * 0.22 + 0.8],
        [height + rise * 0.4, height + rise + 0.9],
        [-1.2, -0.4],
        Caps::Top,
    )
    .colored(dvec3(0.40, 0.20, 0.14));
    [walls.colored(wall), gable, Shape::join([base, chimney])]
}

fn houses(kit: &mut Kit, random: &mut Random) -> Vec<MeshId> {
    let palette = kit.palette;
    let walls = [
        dvec3(0.86, 0.82, 0.72),
        dvec3(0.80, 0.78, 0.74),
        dvec3(0.72, 0.58, 0.42),
        dvec3(0.88, 0.86, 0.82),
        dvec3(0.66, 0.44, 0.34),
    ];
    let roofs = [dvec3(0.42, 0.13, 0.07), dvec3(0.34, 0.12, 0.08), dvec3(0.20, 0.18, 0.18), dvec3(0.48, 0.19, 0.09)];
    (0..7)
        .map(|k| {
            let (w, d) = (random.range(10.0, 16.0), random.range(8.0, 10.5));
            let storeys = if k % 3 == 0 { 1 } else { 2 };
            let [a, b, c] = house_shape(w, d, storeys, walls[k % 5], roofs[k % 4]);
            kit.mesh("house", &[(a, palette.house), (b, palette.tiles), (c, palette.plain)])
        })
        .collect()
}

fn church(kit: &mut Kit, group: NodeId) {
    let stone = dvec3(0.62, 0.57, 0.48);
    let slate = dvec3(0.16, 0.17, 0.19);
    let tower = Shape::cuboid([-14.0, -8.0], [-2.5, 22.0], [-3.0, 3.0], Caps::None).colored(stone);
    let spire = Shape::pyramid([-14.4, -7.6], [22.0, 40.0], [-3.4, 3.4]).colored(slate);
    let nave = Shape::cuboid([-8.0, 16.0], [-2.5, 9.0], [-5.5, 5.5], Caps::None).colored(stone);
    let roof = Shape::gable([-8.0, 16.3], [8.8, 15.5], [-6.0, 6.0]).tiled(dvec2(0.25, 0.25)).colored(slate * 1.3);
    let mut windows = Shape::new();
    for k in 0..5 {
        let x = -5.5 + 4.3 * f64::from(k);
        for (z, left, right) in [(5.54, x, x + 1.4), (-5.54, x + 1.4, x)] {
            windows.polygon(&[
                dvec3(left, 2.5, z),
                dvec3(right, 2.5, z),
                dvec3(right, 6.2, z),
                dvec3((left + right) / 2.0, 7.4, z),
                dvec3(left, 6.2, z),
            ]);
        }
    }
    for (z, left, right) in [(3.04, -12.0, -10.0), (-3.04, -10.0, -12.0)] {
        windows.polygon(&[dvec3(left, 16.0, z), dvec3(right, 16.0, z), dvec3(right, 19.5, z), dvec3(left, 19.5, z)]);
    }
    let palette = kit.palette;
    let solid = Shape::join([tower, spire, nave, windows.colored(dvec3(0.05, 0.05, 0.06))]);
    let mesh = kit.mesh("church", &[(solid, palette.plain), (roof, palette.tiles)]);
    place(kit, group, mesh, dvec2(-322.0, ROAD_SOUTH - 52.0), 0.1);
}

fn farm(kit: &mut Kit, group: NodeId, house: MeshId, net: DVec2, turn: f64) {
    let palette = kit.palette;
    let barn = Shape::cuboid([-14.0, 14.0], [-2.5, 6.0], [-7.5, 7.5], Caps::None)
        .tiled(dvec2(1.2, 1.0))
        .colored(dvec3(0.36, 0.14, 0.10));
    let roof =
        Shape::gable([-14.6, 14.6], [5.8, 10.5], [-8.3, 8.3]).tiled(dvec2(1.2, 1.0)).colored(dvec3(0.40, 0.41, 0.42));
    let silo = Shape::join([
        Shape::cylinder(12, [2.8, 2.8], [-2.5, 13.0], false).colored(dvec3(0.66, 0.67, 0.66)),
        Shape::cylinder(12, [2.9, 0.0], [13.0, 15.0], false).colored(dvec3(0.5, 0.52, 0.54)),
    ])
    .moved(dvec3(19.0, 0.0, -3.0));
    let mesh = kit.mesh("barn", &[(Shape::join([barn, roof]), palette.ribs), (silo, palette.plain)]);
    place(kit, group, mesh, net, turn);
    place(kit, group, house, net + dvec2(8.0, 34.0), turn + 0.1);
}

fn works(kit: &mut Kit, group: NodeId) {
    let palette = kit.palette;
    let brick = dvec3(0.42, 0.20, 0.13);
    let hall = Shape::cuboid([-30.0, 22.0], [-3.0, 9.0], [-16.0, 16.0], Caps::None).tiled(dvec2(0.25, 0.25));
    let mut roof = Vec::new();
    // Four saw-tooth bays, glass to the north.
    for k in 0..4 {
        let x = [-30.0 + 13.0 * f64::from(k), -17.0 + 13.0 * f64::from(k)];
        roof.push(
            Shape::gable([-16.0, 16.0], [9.0, 12.5], [-6.5, 6.5])
                .turned(FRAC_PI_2)
                .moved(dvec3((x[0] + x[1]) / 2.0, 0.0, 0.0))
                .colored(dvec3(0.34, 0.33, 0.32)),
        );
    }
    let chimney = Shape::join([
        Shape::cylinder(14, [2.6, 1.7], [-3.0, CHIMNEY_TOP], false).colored(brick * 1.25),
        Shape::cylinder(14, [1.95, 1.95], [CHIMNEY_TOP - 3.0, CHIMNEY_TOP], true).colored(dvec3(0.75, 0.73, 0.70)),
        Shape::cylinder(14, [1.4, 1.4], [CHIMNEY_TOP, CHIMNEY_TOP + 0.1], true).colored(dvec3(0.03, 0.03, 0.03)),
    ])
    .moved(dvec3(34.0, 0.0, 6.0));
    let mesh = kit.mesh(
        "works",
        &[(hall.colored(brick * 1.6), palette.office), (Shape::join(roof), palette.plain), (chimney, palette.plain)],
    );
    place(kit, group, mesh, WORKS, 0.0);
}

/// The plume: balls of rising size and falling opacity that drift south-eastwards, away from the wind and the approach.
fn smoke(kit: &mut Kit) {
    let mut random = Random::new(kit.random.next());
    let group = kit.group("smoke");
    let mouth = terrain::ground(WORKS) + dvec3(34.0, CHIMNEY_TOP, 6.0);
    let grades: Vec<MeshId> = (0..6)
        .map(|grade| {
            let t = f64::from(grade) / 5.0;
            let white = (0.52 + 0.22 * t) as f32;
            let surface = Surface {
                base_color: [white, white, white * 1.02, (0.34 - 0.25 * t) as f32],
                alpha: AlphaMode::Blend,
                emissive: [0.06, 0.07, 0.08],
                ..Surface::default()
            };
            let material = kit.glb.material("smoke", &surface);
            kit.mesh("puff", &[(Shape::sphere(8, 4), material)])
        })
        .collect();
    for k in 0..PUFFS {
        let t = f64::from(k) / f64::from(PUFFS);
        let drift = 260.0 * t * (0.3 + 0.7 * t);
        let wobble = (5.0 + 26.0 * t) * t;
        let at = mouth
            + dvec3(0.55 * drift, 70.0 * t.sqrt() * (1.0 - 0.25 * t) * t.sqrt() + 2.0, drift)
            + dvec3(random.range(-wobble, wobble), random.range(-wobble, wobble) * 0.6, random.range(-wobble, wobble));
        let r = (2.2 + 24.0 * t) * random.range(0.85, 1.15);
        let mesh = grades[((t * 6.0) as usize).min(5)];
        kit.glb.node(Some(group), Node::new("puff").mesh(mesh).at(at).scaled(dvec3(r, r * 0.85, r)));
    }
}

/// Four cars of different colours, nose towards −Z.
pub(super) fn cars(kit: &mut Kit) -> [MeshId; 4] {
    let colors = [dvec3(0.55, 0.04, 0.03), dvec3(0.70, 0.70, 0.70), dvec3(0.04, 0.10, 0.28), dvec3(0.06, 0.06, 0.065)];
    colors.map(|color| {
        let body = Shape::cuboid([-0.88, 0.88], [0.35, 0.92], [-2.15, 2.15], Caps::Top).colored(color);
        let tyre = Shape::cuboid([-0.84, 0.84], [0.0, 0.5], [-0.33, 0.33], Caps::None).colored(dvec3(0.02, 0.02, 0.02));
        // The cabin tapers: glass all round, roof in the car's colour.
        let (low, high) = ([[-0.8, 0.8], [-1.0, 1.7]], [[-0.62, 0.62], [-0.35, 1.35]]);
        let ring = |[x, z]: [[f64; 2]; 2], y: f64| {
            [dvec3(x[0], y, z[1]), dvec3(x[1], y, z[1]), dvec3(x[1], y, z[0]), dvec3(x[0], y, z[0])]
        };
        let (a, b) = (ring(low, 0.92), ring(high, 1.45));
        let glass: Vec<_> = (0..4).map(|k| [a[k], a[(k + 1) % 4], b[(k + 1) % 4], b[k]]).collect();
        let cabin = Shape::flat(&glass).colored(dvec3(0.05, 0.06, 0.07));
        let roof = Shape::flat(&[b]).colored(color);
        let wheels = Shape::join([tyre.clone().moved(dvec3(0.0, 0.0, -1.35)), tyre.moved(dvec3(0.0, 0.0, 1.35))]);
        let plain = kit.palette.plain;
        kit.mesh("car", &[(Shape::join([body, cabin, roof, wheels]), plain)])
    })
}

/// A lorry, nose towards −Z.
pub(super) fn lorry(kit: &mut Kit) -> MeshId {
    let plain = kit.palette.plain;
    let parts = [
        Shape::cuboid([-1.2, 1.2], [0.5, 2.9], [-4.2, -2.3], Caps::Top).colored(dvec3(0.10, 0.25, 0.12)),
        Shape::cuboid([-1.25, 1.25], [0.9, 3.7], [-2.1, 4.6], Caps::Both).colored(dvec3(0.78, 0.77, 0.72)),
        Shape::cuboid([-1.1, 1.1], [0.0, 0.9], [-3.6, -2.7], Caps::None).colored(dvec3(0.02, 0.02, 0.02)),
        Shape::cuboid([-1.1, 1.1], [0.0, 0.9], [2.2, 4.2], Caps::None).colored(dvec3(0.02, 0.02, 0.02)),
    ];
    kit.mesh("lorry", &[(Shape::join(parts), plain)])
}

/// Fair-weather clouds: pictures on upright sheets far away, turned towards the airport. From the few hundred metres
/// that the flight sees of the world they look as if they had depth.
pub(super) fn clouds(kit: &mut Kit) {
    let group = kit.group("clouds");
    let mut random = Random::new(kit.random.next());
    let sheets: Vec<MeshId> = (0..4u64)
        .map(|k| {
            let picture = kit.glb.picture("cloud", &super::super::paint::cloud(100 + 37 * k));
            let surface = Surface { alpha: AlphaMode::Blend, unlit: true, clamp: true, ..Surface::textured(picture) };
            let material = kit.glb.material("cloud", &surface);
            let corner = |x: f64, y: f64| (dvec3(x, y, 0.0), dvec2(x + 0.5, 1.0 - y));
            let mut sheet = Shape::new();
            sheet.mapped_polygon(&[corner(-0.5, 0.0), corner(0.5, 0.0), corner(0.5, 1.0), corner(-0.5, 1.0)]);
            kit.mesh("cloud", &[(sheet, material)])
        })
        .collect();
    for k in 0..22 {
        let bearing = TAU * (f64::from(k) + random.range(-0.3, 0.3)) / 22.0;
        let distance = random.range(17_000.0, 34_000.0);
        let (s, c) = libm::sincos(bearing);
        let at = dvec3(distance * s, random.range(1500.0, 2100.0) + 0.03 * distance, -distance * c);
        let width = random.range(4500.0, 9000.0);
        let node = Node::new("cloud").mesh(sheets[random.index(4)]).at(at).turned(heading(bearing));
        let node = node.extras(serde_json::json!({"cyclorama": {"static": false}}));
        kit.glb.node(Some(group), node.scaled(dvec3(width, width * random.range(0.26, 0.36), 1.0)));
    }
}
