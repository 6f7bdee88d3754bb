//! The airport's buildings: tower, terminal, hangars, fuel farm, fire station, car park and what belongs to them.
//!
//! They stand west of the runway with their fronts to the east, where the sun of the default picture comes from.

use super::super::shapes::{Caps, Shape, circle};
use super::STANDS_Z;
use super::aircraft::Fleet;
use super::kit::{Kit, heading, level, shadow_shift};
use super::runway::{APRON_X, CLUB_X, CLUB_Z};
use crate::scene::glb::{MeshId, Node, NodeId};
use glam::{DAffine3, DVec3, dvec2, dvec3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_8, PI};

const TOWER: DVec3 = dvec3(-304.0, 0.0, -292.0);
/// Where the radar antenna on the tower turns; the flight moves it.
pub(super) const RADAR: DVec3 = dvec3(TOWER.x, 45.2, TOWER.z);
const CONCRETE: DVec3 = dvec3(0.58, 0.57, 0.54);
const DARK: DVec3 = dvec3(0.05, 0.055, 0.06);

pub(super) fn build(kit: &mut Kit, fleet: &Fleet, cars: [MeshId; 4], lorry: MeshId) {
    let group = kit.group("buildings");
    tower(kit, group);
    terminal(kit, group);
    hangars(kit, group);
    fuel_farm(kit, group);
    fire_station(kit, group);
    club(kit, group);
    car_park(kit, group, cars);
    parked(kit, fleet);
    vehicles(kit, group, lorry);
}

/// Lorries that serve the airliners, and two that wait.
fn vehicles(kit: &mut Kit, group: NodeId, lorry: MeshId) {
    let stands = STANDS_Z.map(|z| (-217.0, z - 5.8, 1.5));
    let waiting = [(-240.0, -500.0, 0.3), (-246.0, -512.0, 0.3), (-180.0, -690.0, 2.8)];
    for (x, z, turn) in stands.into_iter().chain(waiting) {
        let node = Node::new("service lorry").mesh(lorry).at(dvec3(x, level::TAXIWAY, z));
        kit.glb.node(Some(group), node.turned(heading(turn)));
    }
}

fn ground_boxes(kit: &mut Kit, boxes: &[([f64; 2], [f64; 2], f64)]) {
    for &(x, z, height) in boxes {
        kit.box_shadow(x, z, height);
    }
}

/// Walls with a window per 4 × 4 m bay, and a flat roof with a parapet.
fn office(x: [f64; 2], z: [f64; 2], storeys: u32) -> (Shape, Shape) {
    let height = 4.0 * f64::from(storeys);
    let walls = Shape::cuboid(x, [0.0, height], z, Caps::None).tiled(dvec2(0.25, 0.25));
    let edge = Shape::cuboid([x[0] - 0.3, x[1] + 0.3], [height, height + 0.8], [z[0] - 0.3, z[1] + 0.3], Caps::Both);
    let plant = Shape::cuboid(
        [x[0] * 0.7 + x[1] * 0.3, x[0] * 0.4 + x[1] * 0.6],
        [height + 0.8, height + 2.6],
        [z[0] * 0.6 + z[1] * 0.4, z[0] * 0.3 + z[1] * 0.7],
        Caps::Top,
    );
    (walls, Shape::join([edge.colored(dvec3(0.50, 0.50, 0.48)), plant.colored(dvec3(0.42, 0.44, 0.45))]))
}

fn tower(kit: &mut Kit, group: NodeId) {
    const EIGHT: u32 = 8;
    let turn = |shape: Shape| shape.turned(FRAC_PI_8);
    let shaft = turn(Shape::cylinder(EIGHT, [4.2, 3.4], [0.0, 34.0], false)).colored(dvec3(0.70, 0.69, 0.66));
    let stripe =
        |y: f64| turn(Shape::cylinder(EIGHT, [3.75, 3.72], [y, y + 0.9], false)).colored(dvec3(0.05, 0.16, 0.35));
    let collar = turn(Shape::cylinder(EIGHT, [3.4, 6.0], [33.0, 36.0], false)).colored(CONCRETE);
    let gallery = turn(Shape::cylinder(EIGHT, [6.6, 6.6], [36.0, 36.5], true)).colored(dvec3(0.45, 0.45, 0.44));
    let under = turn(Shape::cylinder(EIGHT, [6.6, 6.6], [-36.0, -35.9], true))
        .transformed(DAffine3::from_rotation_x(PI))
        .colored(dvec3(0.35, 0.35, 0.34));
    let sill = turn(Shape::cylinder(EIGHT, [5.0, 5.2], [36.5, 37.5], false)).colored(dvec3(0.70, 0.69, 0.66));
    let desk = turn(Shape::cylinder(EIGHT, [3.9, 3.9], [36.5, 37.6], true)).colored(DARK);
    let core = turn(Shape::cylinder(EIGHT, [1.0, 1.0], [36.5, 41.0], false)).colored(dvec3(0.5, 0.48, 0.45));
    let roof = Shape::join([
        turn(Shape::cylinder(EIGHT, [6.6, 6.5], [41.0, 41.9], false)).colored(dvec3(0.70, 0.69, 0.66)),
        turn(Shape::cylinder(EIGHT, [6.5, 1.2], [41.9, 43.2], true)).colored(dvec3(0.40, 0.42, 0.43)),
        turn(Shape::cylinder(EIGHT, [6.6, 6.6], [-41.0, -40.95], true))
            .transformed(DAffine3::from_rotation_x(PI))
            .colored(dvec3(0.5, 0.5, 0.5)),
        Shape::cylinder(6, [0.5, 0.35], [43.2, RADAR.y - 0.4], true).colored(dvec3(0.6, 0.6, 0.6)),
        Shape::cylinder(5, [0.12, 0.04], [42.5, 51.0], false)
            .moved(dvec3(-3.4, 0.0, 1.0))
            .colored(dvec3(0.75, 0.2, 0.1)),
    ]);
    // The cab leans outwards, so that nobody sees a reflection of the desk at night.
    let foot = circle(EIGHT, 5.2, 37.5);
    let head = circle(EIGHT, 6.1, 41.0);
    let mut mullions = Shape::new();
    for k in 0..EIGHT as usize {
        let side = (foot[(k + 1) % 8] - foot[(k + 7) % 8]).normalize() * 0.11;
        let out = foot[k].with_y(0.0).normalize() * 0.16;
        let (a, b) = (foot[k], head[k]);
        mullions.polygon(&[a + out, a + side, b + side, b + out]);
        mullions.polygon(&[a - side, a + out, b + out, b - side]);
        mullions.polygon(&[a + side, a - side, b - side, b + side]);
    }
    let mullions = turn(mullions).colored(dvec3(0.75, 0.75, 0.73));
    let glass = turn(Shape::cylinder(EIGHT, [5.2, 6.1], [37.5, 41.0], false));
    let solid = Shape::join([shaft, stripe(20.0), collar, gallery, under, sill, desk, core, roof, mullions]);
    let lamp = Shape::sphere(6, 4).scaled(DVec3::splat(0.3)).moved(dvec3(-3.4, 51.2, 1.0));

    // The block at its foot.
    let (walls, top) = office([-16.0, 12.0], [-10.0, 11.0], 2);
    let palette = kit.palette;
    let mesh = kit.mesh(
        "tower",
        &[
            (Shape::join([solid, top]), palette.plain),
            (walls, palette.office),
            (lamp, palette.red_lamp),
            (glass, palette.glass),
        ],
    );
    kit.glb.node(Some(group), Node::new("tower").mesh(mesh).at(TOWER));
    ground_boxes(kit, &[([TOWER.x - 16.0, TOWER.x + 12.0], [TOWER.z - 10.0, TOWER.z + 11.0], 8.8)]);
    // The tower's own shadow begins where it leaves the block's.
    let cab: Vec<_> = circle(EIGHT, 6.0, 0.0).iter().map(|p| dvec2(p.x + TOWER.x, p.z + TOWER.z)).collect();
    let base = shadow_shift(19.0);
    let narrow: Vec<_> = circle(EIGHT, 3.6, 0.0).iter().map(|p| dvec2(p.x + TOWER.x, p.z + TOWER.z) + base).collect();
    kit.outline_shadow(&narrow, 14.0);
    let lifted: Vec<_> = cab.iter().map(|&p| p + shadow_shift(36.5)).collect();
    kit.outline_shadow(&lifted, 5.5);
}

/// The radar antenna: a slim dish on a pivot, about its own origin.
pub(super) fn radar(kit: &mut Kit) -> MeshId {
    let beam = Shape::cuboid([-2.6, 2.6], [0.0, 0.9], [-0.25, 0.25], Caps::Both).colored(dvec3(0.80, 0.22, 0.05));
    let pivot = Shape::cylinder(6, [0.3, 0.3], [-0.4, 0.0], false).colored(dvec3(0.6, 0.6, 0.6));
    let plain = kit.palette.plain;
    kit.mesh("radar", &[(Shape::join([beam, pivot]), plain)])
}

fn terminal(kit: &mut Kit, group: NodeId) {
    // The hall: glass front to the apron under a roof that swings up towards it.
    let (x, z) = ([-304.0, -270.0], [-890.0, -560.0]);
    let walls = Shape::cuboid([x[0], x[1] - 2.0], [0.0, 12.0], z, Caps::None).tiled(dvec2(0.25, 0.25));
    let profile = [(-4.0, 12.6), (6.0, 14.6), (16.0, 15.0), (26.0, 14.2), (38.0, 12.0)];
    let mut roof = Shape::new();
    let (z0, z1) = (z[0] - 4.0, z[1] + 4.0);
    let (start, thick) = (x[0], 0.9);
    for pair in profile.windows(2) {
        let [(ax, ay), (bx, by)] = [pair[0], pair[1]];
        let (a, b) = ((start + ax, ay), (start + bx, by));
        for k in 0..6 {
            let at = |k: i32| z0 + (z1 - z0) * f64::from(k) / 6.0;
            let (n, s) = (at(k), at(k + 1));
            roof.polygon(&[
                dvec3(a.0, a.1 + thick, s),
                dvec3(b.0, b.1 + thick, s),
                dvec3(b.0, b.1 + thick, n),
                dvec3(a.0, a.1 + thick, n),
            ]);
        }
        roof.polygon(&[dvec3(a.0, a.1, z0), dvec3(b.0, b.1, z0), dvec3(b.0, b.1, z1), dvec3(a.0, a.1, z1)]);
        roof.polygon(&[
            dvec3(a.0, a.1, z1),
            dvec3(b.0, b.1, z1),
            dvec3(b.0, b.1 + thick, z1),
            dvec3(a.0, a.1 + thick, z1),
        ]);
        roof.polygon(&[
            dvec3(b.0, b.1, z0),
            dvec3(a.0, a.1, z0),
            dvec3(a.0, a.1 + thick, z0),
            dvec3(b.0, b.1 + thick, z0),
        ]);
    }
    let (front, back) = (start + 38.0, start - 4.0);
    roof.polygon(&[
        dvec3(front, 12.0, z1),
        dvec3(front, 12.0, z0),
        dvec3(front, 12.0 + thick, z0),
        dvec3(front, 12.0 + thick, z1),
    ]);
    roof.polygon(&[
        dvec3(back, 12.6, z0),
        dvec3(back, 12.6, z1),
        dvec3(back, 12.6 + thick, z1),
        dvec3(back, 12.6 + thick, z0),
    ]);
    // Gables between walls and roof.
    let mut gables = Shape::new();
    let under = [(0.0, 13.4), (6.0, 14.6), (16.0, 15.0), (26.0, 14.2), (32.0, 13.1)];
    for pair in under.windows(2) {
        let [(ax, ay), (bx, by)] = [pair[0], pair[1]].map(|(px, py)| (start + px, py));
        gables.polygon(&[dvec3(ax, 12.0, z[1]), dvec3(bx, 12.0, z[1]), dvec3(bx, by, z[1]), dvec3(ax, ay, z[1])]);
        gables.polygon(&[dvec3(bx, 12.0, z[0]), dvec3(ax, 12.0, z[0]), dvec3(ax, ay, z[0]), dvec3(bx, by, z[0])]);
    }
    gables.polygon(&[
        dvec3(x[0], 12.0, z[0]),
        dvec3(x[0], 12.0, z[1]),
        dvec3(x[0], 13.4, z[1]),
        dvec3(x[0], 13.4, z[0]),
    ]);
    gables.polygon(&[
        dvec3(x[1] - 2.0, 12.0, z[1]),
        dvec3(x[1] - 2.0, 12.0, z[0]),
        dvec3(x[1] - 2.0, 13.1, z[0]),
        dvec3(x[1] - 2.0, 13.1, z[1]),
    ]);
    let roof = Shape::join([roof.colored(dvec3(0.62, 0.64, 0.66)), gables.colored(dvec3(0.70, 0.70, 0.68))]);

    let (pier_walls, pier_top) = office([-270.0, -248.0], [-760.0, -690.0], 2);
    let mut bridges = Vec::new();
    for stand in STANDS_Z {
        bridges.push(jet_bridge(stand));
    }
    let (wing_walls, wing_top) = office([-300.0, -276.0], [-540.0, -478.0], 3);
    let palette = kit.palette;
    kit.object(
        group,
        "terminal",
        &[
            (Shape::join([roof, pier_top, wing_top]), palette.plain),
            (Shape::join([walls, pier_walls, wing_walls]), palette.office),
            (Shape::join(bridges), palette.ribs),
        ],
    );
    ground_boxes(
        kit,
        &[
            ([x[0], x[1]], z, 13.0),
            ([-300.0, -276.0], [-540.0, -478.0], 12.8),
            ([-269.0, -248.0], [-760.0, -690.0], 8.8),
        ],
    );
}

/// The covered way from the terminal to the left front door of the airliner on a stand.
fn jet_bridge(stand_z: f64) -> Shape {
    let color = dvec3(0.62, 0.66, 0.70);
    let z = stand_z + 7.0;
    let tube = Shape::cuboid([-273.0, -218.0], [3.4, 6.2], [z - 1.6, z + 1.6], Caps::Both).tiled(dvec2(2.0, 1.0));
    let head = Shape::cuboid([-221.0, -216.5], [3.2, 6.4], [z - 4.6, z + 1.8], Caps::Both).tiled(dvec2(2.0, 1.0));
    let leg = |x: f64| Shape::cuboid([x - 0.6, x + 0.6], [0.0, 3.4], [z - 0.6, z + 0.6], Caps::None);
    Shape::join([tube, head, leg(-224.0), leg(-250.0)]).colored(color)
}

/// A hangar with an arched roof, door towards +z: sheet metal, and the plain parts.
fn hangar(width: f64, depth: f64, wall: f64, rise: f64, color: DVec3, door: DVec3) -> (Shape, Shape) {
    const STEPS: u32 = 12;
    let half = width / 2.0;
    let arch: Vec<(f64, f64)> = (0..=STEPS)
        .map(|k| {
            let (s, c) = libm::sincos(PI * f64::from(k) / f64::from(STEPS));
            (half * c, wall + rise * s)
        })
        .collect();
    let (front, back) = (depth / 2.0, -depth / 2.0);
    let mut metal = Shape::new();
    for pair in arch.windows(2) {
        let [(ax, ay), (bx, by)] = [pair[0], pair[1]];
        let span = |along: f64| dvec2(along, 0.0);
        metal.mapped_polygon(&[
            (dvec3(ax, ay, front), span(depth)),
            (dvec3(ax, ay, back), span(0.0)),
            (dvec3(bx, by, back), span(0.0)),
            (dvec3(bx, by, front), span(depth)),
        ]);
    }
    let metal = metal.colored(dvec3(0.52, 0.55, 0.57));
    let mut sheet = Shape::cuboid([-half, half], [0.0, wall], [back, front], Caps::None);
    for (z, turned) in [(front, false), (back, true)] {
        let mut end: Vec<_> = arch.iter().map(|&(x, y)| (dvec3(x, y, z), dvec2(x, 0.0))).collect();
        if turned {
            end.reverse();
        }
        sheet.mapped_polygon(&end);
    }
    let sheet = sheet.colored(color);

    // Six door leaves, alternately a little further out, under a lintel.
    let mut plain = Vec::new();
    let leaf = width * 0.84 / 6.0;
    for k in 0..6 {
        let x = -3.0 * leaf + leaf * f64::from(k);
        let out = front + if k % 2 == 0 { 0.35 } else { 0.6 };
        plain.push(Shape::cuboid([x, x + leaf], [0.0, wall + 0.5], [front - 0.1, out], Caps::Top).colored(door));
        let (low, high) = (wall * 0.62, wall * 0.84);
        let window = [
            dvec3(x + 0.8, low, out + 0.04),
            dvec3(x + leaf - 0.8, low, out + 0.04),
            dvec3(x + leaf - 0.8, high, out + 0.04),
            dvec3(x + 0.8, high, out + 0.04),
        ];
        plain.push(Shape::flat(&[window]).colored(dvec3(0.07, 0.09, 0.11)));
    }
    plain.push(
        Shape::cuboid([-3.2 * leaf, 3.2 * leaf], [wall + 0.5, wall + 1.5], [front - 0.1, front + 0.9], Caps::Both)
            .colored(dvec3(0.30, 0.32, 0.34)),
    );
    (Shape::join([metal, sheet]), Shape::join(plain))
}

fn hangars(kit: &mut Kit, group: NodeId) {
    let colors = [
        (dvec3(0.62, 0.63, 0.60), dvec3(0.10, 0.22, 0.38)),
        (dvec3(0.55, 0.57, 0.55), dvec3(0.60, 0.60, 0.58)),
        (dvec3(0.58, 0.50, 0.40), dvec3(0.34, 0.12, 0.08)),
    ];
    let palette = kit.palette;
    for (k, (color, door)) in colors.into_iter().enumerate() {
        let (metal, plain) = hangar(52.0, 58.0, 9.0, 8.5, color, door);
        let z = -68.0 - 66.0 * k as f64;
        let x = APRON_X[0] - 33.0;
        let mesh = kit.mesh("hangar", &[(metal, palette.ribs), (plain, palette.plain)]);
        kit.glb.node(Some(group), Node::new("hangar").mesh(mesh).at(dvec3(x, 0.0, z)).turned(heading(-FRAC_PI_2)));
        kit.box_shadow([x - 29.0, x + 29.0], [z - 26.0, z + 26.0], 13.0);
    }
    // Small ones for the flying club, on the other side, doors to the west.
    let (metal, plain) = hangar(19.0, 17.0, 4.4, 2.6, dvec3(0.50, 0.56, 0.50), dvec3(0.66, 0.66, 0.62));
    let mesh = kit.mesh("club hangar", &[(metal, palette.ribs), (plain, palette.plain)]);
    for k in 0..4 {
        let at = dvec3(CLUB_X[1] + 16.0, 0.0, CLUB_Z[0] + 20.0 + 24.0 * f64::from(k));
        kit.glb.node(Some(group), Node::new("club hangar").mesh(mesh).at(at).turned(heading(FRAC_PI_2)));
        kit.box_shadow([at.x - 8.5, at.x + 8.5], [at.z - 9.5, at.z + 9.5], 6.0);
    }
}

fn fuel_farm(kit: &mut Kit, group: NodeId) {
    let centre = dvec3(-384.0, 0.0, -190.0);
    let mut parts = Vec::new();
    for (dx, dz, r, h) in
        [(-20.0, -18.0, 9.0, 11.0), (4.0, -18.0, 9.0, 11.0), (-20.0, 8.0, 9.0, 11.0), (4.0, 8.0, 7.0, 9.0)]
    {
        let tank = Shape::join([
            Shape::cylinder(20, [r, r], [0.0, h], false).colored(dvec3(0.80, 0.80, 0.78)),
            Shape::cylinder(20, [r, 0.0], [h, h + 1.3], false).colored(dvec3(0.66, 0.67, 0.67)),
            Shape::cylinder(20, [r + 0.06, r + 0.06], [h * 0.72, h * 0.86], false).colored(dvec3(0.66, 0.10, 0.06)),
        ]);
        parts.push(tank.moved(dvec3(dx, 0.0, dz)));
        let rim: Vec<_> = circle(10, r, 0.0).iter().map(|p| dvec2(p.x + dx + centre.x, p.z + dz + centre.z)).collect();
        kit.outline_shadow(&rim, h);
    }
    // The wall that would hold what leaks.
    for (x, z) in [
        ([-34.0, 18.0], [-31.0, -30.5]),
        ([-34.0, 18.0], [20.5, 21.0]),
        ([-34.0, -33.5], [-30.5, 20.5]),
        ([17.5, 18.0], [-30.5, 20.5]),
    ] {
        parts.push(Shape::cuboid(x, [0.0, 1.4], z, Caps::Top).colored(CONCRETE));
    }
    let plain = kit.palette.plain;
    let mesh = kit.mesh("fuel farm", &[(Shape::join(parts), plain)]);
    kit.glb.node(Some(group), Node::new("fuel farm").mesh(mesh).at(centre));
}

fn fire_station(kit: &mut Kit, group: NodeId) {
    let (x, z) = ([-304.0, -272.0], [-446.0, -400.0]);
    let hall = Shape::cuboid(x, [0.0, 7.0], z, Caps::Top).colored(dvec3(0.60, 0.36, 0.26));
    let mut parts = vec![hall];
    for k in 0..5 {
        let left = z[1] - 4.0 - 8.4 * f64::from(k);
        let door = Shape::cuboid([x[1] - 0.1, x[1] + 0.2], [0.0, 5.0], [left - 6.4, left], Caps::Top);
        parts.push(door.colored(dvec3(0.60, 0.05, 0.03)));
    }
    let mast = Shape::cuboid([x[0] + 3.0, x[0] + 8.0], [7.0, 15.0], [z[0] + 3.0, z[0] + 8.0], Caps::Top);
    parts.push(mast.colored(dvec3(0.66, 0.62, 0.56)));
    let plain = kit.palette.plain;
    kit.object(group, "fire station", &[(Shape::join(parts), plain)]);
    kit.box_shadow(x, z, 7.0);
}

fn club(kit: &mut Kit, group: NodeId) {
    let (x, z) = ([CLUB_X[1] + 8.0, CLUB_X[1] + 20.0], [-330.0, -300.0]);
    let palette = kit.palette;
    let walls =
        Shape::cuboid(x, [0.0, 3.2], z, Caps::None).tiled(dvec2(1.0 / 3.0, 1.0 / 3.2)).colored(dvec3(0.80, 0.76, 0.66));
    // The gable's ridge runs along x; this house's along z.
    let roof = Shape::gable([-16.0, 16.0], [3.2, 6.8], [-7.0, 7.0])
        .tiled(dvec2(0.25, 0.25))
        .colored(dvec3(0.48, 0.15, 0.09))
        .turned(FRAC_PI_2)
        .moved(dvec3((x[0] + x[1]) / 2.0, 0.0, (z[0] + z[1]) / 2.0));
    kit.object(group, "clubhouse", &[(walls, palette.house), (roof, palette.tiles)]);
    kit.box_shadow(x, z, 4.8);
}

fn car_park(kit: &mut Kit, group: NodeId, cars: [MeshId; 4]) {
    let (x, z) = ([-402.0, -330.0], [-850.0, -600.0]);
    let lot = Shape::rect(x, z, level::TAXIWAY).mapped(|p, _| dvec2(p.x, p.z) / 12.0).colored(dvec3(0.21, 0.21, 0.21));
    let way = Shape::rect([terrain_edge(), x[0]], [-728.0, -720.0], level::TAXIWAY)
        .mapped(|p, _| dvec2(p.x, p.z) / 12.0)
        .colored(dvec3(0.19, 0.19, 0.19));
    let asphalt = kit.palette.asphalt;
    kit.object(group, "car park", &[(Shape::join([lot, way]), asphalt)]);
    for row in 0..4 {
        for place in 0..40 {
            if kit.random.chance(0.3) {
                let at = dvec3(x[0] + 9.0 + 18.0 * f64::from(row), level::TAXIWAY, z[0] + 8.0 + 6.0 * f64::from(place));
                let side = if kit.random.chance(0.5) { FRAC_PI_2 } else { -FRAC_PI_2 };
                let mesh = cars[kit.random.index(4)];
                kit.glb.node(Some(group), Node::new("parked car").mesh(mesh).at(at).turned(heading(side)));
            }
        }
    }
}

fn terrain_edge() -> f64 {
    super::terrain::AIRFIELD_X[0]
}

fn parked(kit: &mut Kit, fleet: &Fleet) {
    let group = kit.group("parked aircraft");
    for (k, z) in STANDS_Z.into_iter().enumerate() {
        if k == 2 || k == 4 {
            continue; // Two stands are free: their airliners are on the taxiway.
        }
        let at = dvec3(-204.0, level::TAXIWAY, z);
        kit.glb.node(Some(group), Node::new("parked airliner").mesh(fleet.airliner).at(at).turned(heading(-FRAC_PI_2)));
        let shift = shadow_shift(3.2);
        kit.placed_shadow(
            fleet.airliner_shadow,
            dvec3(at.x + shift.x, level::SHADOW, at.z + shift.y),
            heading(-FRAC_PI_2),
        );
    }
    // One waits at the holding position for the flight to pass.
    let at = dvec3(-92.0, level::TAXIWAY, -40.0);
    kit.glb.node(Some(group), Node::new("waiting airliner").mesh(fleet.airliner).at(at).turned(heading(FRAC_PI_2)));
    let shift = shadow_shift(3.2);
    kit.placed_shadow(fleet.airliner_shadow, dvec3(at.x + shift.x, level::SHADOW, at.z + shift.y), heading(FRAC_PI_2));
    for k in 0..6 {
        let turn = kit.random.range(-0.12, 0.12) + if k < 4 { FRAC_PI_2 } else { -FRAC_PI_2 };
        let at = if k < 4 {
            dvec3(CLUB_X[1] - 14.0, level::TAXIWAY, CLUB_Z[0] + 26.0 + 24.0 * f64::from(k))
        } else {
            dvec3(CLUB_X[0] + 36.0, level::TAXIWAY, CLUB_Z[1] - 20.0 - 18.0 * f64::from(k - 4))
        };
        let mesh = fleet.light[k as usize % 3];
        kit.glb.node(Some(group), Node::new("parked light aircraft").mesh(mesh).at(at).turned(heading(turn)));
        let shift = shadow_shift(1.6);
        kit.placed_shadow(fleet.light_shadow, dvec3(at.x + shift.x, level::SHADOW, at.z + shift.y), heading(turn));
    }
}
