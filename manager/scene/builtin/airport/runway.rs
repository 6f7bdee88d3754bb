//! Runway 36/18, taxiways and apron, their markings and lamps, and what stands beside them.
//!
//! The runway lies along −Z from its southern threshold at the origin. Dimensions follow ICAO Annex 14 as closely as a
//! picture needs: threshold bars of 30 m, designators of 9 m, centre line of 30 m strokes and 20 m gaps, aiming points
//! 300 m in.

use super::super::shapes::{Caps, Shape, Vertex};
use super::kit::{Kit, level};
use super::terrain;
use crate::scene::glb::{Node, NodeId};
use glam::{DAffine3, DVec3, dvec2, dvec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Length of the runway, m.
pub(super) const LENGTH: f64 = 2400.0;
const HALF_WIDTH: f64 = 22.5;
/// Middle of the parallel taxiway, x, m.
pub(super) const TAXIWAY_X: f64 = -105.0;
const TAXI_HALF: f64 = 11.5;
/// Where taxiways join the runway, z of their middles, m.
const CONNECTORS: [f64; 5] = [-40.0, -620.0, -1200.0, -1780.0, -2360.0];
/// The apron: x and z.
pub(super) const APRON_X: [f64; 2] = [-262.0, TAXIWAY_X - TAXI_HALF];
/// See [`APRON_X`].
pub(super) const APRON_Z: [f64; 2] = [-1010.0, -34.0];
/// The apron for light aircraft in the east.
pub(super) const CLUB_X: [f64; 2] = [80.0, 160.0];
/// See [`CLUB_X`].
pub(super) const CLUB_Z: [f64; 2] = [-520.0, -260.0];

const WHITE: DVec3 = dvec3(0.82, 0.82, 0.80);
const YELLOW: DVec3 = dvec3(0.80, 0.52, 0.04);

pub(super) fn build(kit: &mut Kit) {
    let group = kit.group("runway and taxiways");
    pavement(kit, group);
    markings(kit, group);
    taxi_lines(kit, group);
    lamps(kit, group);
    approach_lights(kit, group);
    windsock(kit, group);
    radio_aids(kit, group);
    fence(kit, group);
}

/// A level rectangle in cells of at most `cell` m, coloured by `color(x, z)` and mapped by `texture_m`.
fn paving(x: [f64; 2], z: [f64; 2], y: f64, cell: f64, texture_m: f64, color: impl Fn(f64, f64) -> DVec3) -> Shape {
    let cells = |range: [f64; 2]| libm::ceil((range[1] - range[0]) / cell) as u32;
    let (nx, nz) = (cells(x), cells(z));
    let at = |range: [f64; 2], i: u32, n: u32| range[0] + (range[1] - range[0]) * f64::from(i) / f64::from(n);
    Shape::grid(nx, nz, |i, j| {
        let p = dvec3(at(x, i, nx), y, at(z, j, nz));
        Vertex { color: color(p.x, p.z), texcoord: dvec2(p.x, p.z) / texture_m, ..Vertex::new(p, DVec3::Y) }
    })
}

fn pavement(kit: &mut Kit, group: NodeId) {
    // Tyres leave their rubber either side of the centre line, most of it in the touchdown zones.
    let columns = [-22.5, -19.0, -9.5, -7.0, -4.5, -2.0, 0.0, 2.0, 4.5, 7.0, 9.5, 19.0, 22.5];
    let rows = 26;
    let rubber = |x: f64, z: f64| {
        let zone = |d: f64| libm::exp(-((d - 420.0) / 230.0) * ((d - 420.0) / 230.0));
        let wear = 0.25 + 0.75 * zone(-z).max(zone(z + LENGTH));
        let track = libm::exp(-((x.abs() - 4.5) / 3.2) * ((x.abs() - 4.5) / 3.2));
        let edge = if x.abs() > 19.0 { 1.12 } else { 1.0 };
        dvec3(0.205, 0.205, 0.21) * (1.0 - 0.55 * wear * track) * edge
    };
    let runway = Shape::grid(columns.len() as u32 - 1, rows, |i, j| {
        let p = dvec3(columns[i as usize], level::RUNWAY, -LENGTH + LENGTH * f64::from(j) / f64::from(rows));
        Vertex { color: rubber(p.x, p.z), texcoord: dvec2(p.x, p.z) / 12.0, ..Vertex::new(p, DVec3::Y) }
    });
    // Stopways: where the runway ends, a paler strip goes on.
    let stopway = |z| paving([-22.5, 22.5], z, level::TAXIWAY, 45.0, 12.0, |_, _| dvec3(0.25, 0.245, 0.235));
    let asphalt = kit.palette.asphalt;
    kit.object(
        group,
        "runway",
        &[(Shape::join([runway, stopway([0.0, 60.0]), stopway([-LENGTH - 60.0, -LENGTH])]), asphalt)],
    );

    let dark = |_: f64, _: f64| dvec3(0.185, 0.185, 0.19);
    let strip = |x, z| paving(x, z, level::TAXIWAY, 80.0, 12.0, dark);
    let edge = TAXIWAY_X + TAXI_HALF;
    let mut taxiways = vec![strip([TAXIWAY_X - TAXI_HALF, edge], [-LENGTH + 28.5, -28.5])];
    for z in CONNECTORS {
        taxiways.push(strip([edge, -HALF_WIDTH], [z - TAXI_HALF, z + TAXI_HALF]));
        for north in [-1.0, 1.0] {
            // The outermost corners are the taxiway's ends and have nothing to round off.
            let corner = z + north * TAXI_HALF;
            if (-LENGTH + 60.0..-60.0).contains(&corner) {
                taxiways.push(fillet(edge, corner, 1.0, north));
            }
            taxiways.push(fillet(-HALF_WIDTH, corner, -1.0, north));
        }
    }
    let club_z = (CLUB_Z[0] + CLUB_Z[1]) / 2.0;
    taxiways.push(strip([HALF_WIDTH, CLUB_X[0]], [club_z - 7.5, club_z + 7.5]));
    for side in [-1.0, 1.0] {
        taxiways.push(fillet(HALF_WIDTH, club_z + side * 7.5, 1.0, side));
    }
    kit.object(group, "taxiways", &[(Shape::join(taxiways), asphalt)]);

    let concrete = |_: f64, _: f64| dvec3(0.40, 0.395, 0.375);
    let slabs = kit.palette.slabs;
    let aprons = [
        paving(APRON_X, APRON_Z, level::TAXIWAY, 100.0, 30.0, concrete),
        paving(CLUB_X, CLUB_Z, level::TAXIWAY, 100.0, 30.0, concrete),
    ];
    kit.object(group, "aprons", &[(Shape::join(aprons), slabs)]);
}

/// The rounded corner between two strips that meet at (x, z); it lies on the side where x and z go by the signs.
fn fillet(x: f64, z: f64, sign_x: f64, sign_z: f64) -> Shape {
    const RADIUS: f64 = 22.0;
    const STEPS: u32 = 6;
    let mut shape = Shape::new();
    let mut add = |px: f64, pz: f64| {
        let p = dvec3(px, level::TAXIWAY, pz);
        let color = dvec3(0.185, 0.185, 0.19);
        shape.vertex(Vertex { color, texcoord: dvec2(p.x, p.z) / 12.0, ..Vertex::new(p, DVec3::Y) })
    };
    let corner = add(x, z);
    let arc: Vec<u32> = (0..=STEPS)
        .map(|k| {
            let (s, c) = libm::sincos(f64::from(k) / f64::from(STEPS) * FRAC_PI_2);
            add(x + sign_x * RADIUS * (1.0 - s), z + sign_z * RADIUS * (1.0 - c))
        })
        .collect();
    for pair in arc.windows(2) {
        if sign_x * sign_z < 0.0 {
            shape.triangle(corner, pair[0], pair[1]);
        } else {
            shape.triangle(corner, pair[1], pair[0]);
        }
    }
    shape
}

fn markings(kit: &mut Kit, group: NodeId) {
    let bar = |x: [f64; 2], z: [f64; 2]| Shape::rect(x, z, level::MARKING);
    // One end's markings, for the southern threshold; the other end's are the same turned round.
    let mut end = Vec::new();
    for k in 0..6 {
        let x = 3.0 + 3.05 * f64::from(k);
        end.push(bar([x, x + 1.8], [-36.0, -6.0]));
        end.push(bar([-x - 1.8, -x], [-36.0, -6.0]));
    }
    for (distance, bars) in [(150.0, 3), (450.0, 2), (600.0, 1)] {
        for k in 0..bars {
            let x = 9.0 + 3.3 * f64::from(k);
            end.push(bar([x, x + 1.9], [-distance - 22.5, -distance]));
            end.push(bar([-x - 1.9, -x], [-distance - 22.5, -distance]));
        }
    }
    end.push(bar([9.0, 17.0], [-345.0, -300.0]));
    end.push(bar([-17.0, -9.0], [-345.0, -300.0]));
    let end = Shape::join(end);
    let turned =
        end.clone().transformed(DAffine3::from_translation(dvec3(0.0, 0.0, -LENGTH)) * DAffine3::from_rotation_y(PI));

    let mut all = vec![end, turned];
    all.push(digits("36"));
    all.push(
        digits("18").transformed(DAffine3::from_translation(dvec3(0.0, 0.0, -LENGTH)) * DAffine3::from_rotation_y(PI)),
    );
    for k in 0..46 {
        let z = -78.0 - 50.0 * f64::from(k);
        if z - 30.0 > -LENGTH + 60.0 {
            all.push(bar([-0.45, 0.45], [z - 30.0, z]));
        }
    }
    for k in 0..24 {
        let z = [-100.0 * f64::from(k + 1), -100.0 * f64::from(k)];
        all.push(bar([-21.6, -20.7], z));
        all.push(bar([20.7, 21.6], z));
    }
    let plain = kit.palette.plain;
    kit.object(group, "runway markings", &[(Shape::join(all).colored(WHITE), plain)]);
}

/// A two-digit designator south of which the threshold bars lie, read by whoever lands northwards.
fn digits(text: &str) -> Shape {
    // Strokes of each digit in a cell 3 wide and 9 high: [x0, x1, y0, y1].
    const STROKES: [(char, &[[f64; 4]]); 4] = [
        ('1', &[[1.1, 1.9, 0.0, 9.0]]),
        ('3', &[[2.2, 3.0, 0.0, 9.0], [0.0, 2.2, 8.2, 9.0], [0.6, 2.2, 4.1, 4.9], [0.0, 2.2, 0.0, 0.8]]),
        (
            '6',
            &[
                [0.0, 0.8, 0.0, 9.0],
                [0.8, 3.0, 8.2, 9.0],
                [0.8, 3.0, 4.1, 4.9],
                [0.8, 3.0, 0.0, 0.8],
                [2.2, 3.0, 0.8, 4.1],
            ],
        ),
        (
            '8',
            &[
                [0.0, 0.8, 0.0, 9.0],
                [2.2, 3.0, 0.0, 9.0],
                [0.8, 2.2, 8.2, 9.0],
                [0.8, 2.2, 4.1, 4.9],
                [0.8, 2.2, 0.0, 0.8],
            ],
        ),
    ];
    let mut shape = Shape::new();
    for (k, digit) in text.chars().enumerate() {
        let strokes = STROKES.iter().find(|(d, _)| *d == digit).map_or(&[][..], |(_, strokes)| strokes);
        for [x0, x1, y0, y1] in strokes {
            // Drawn half as large again, as large runways do.
            let (left, scale) = (-6.6 + 8.4 * k as f64, 1.6);
            shape.add(Shape::rect(
                [left + x0 * scale, left + x1 * scale],
                [-48.0 - y1 * scale, -48.0 - y0 * scale],
                level::MARKING,
            ));
        }
    }
    shape
}

fn taxi_lines(kit: &mut Kit, group: NodeId) {
    let line = |x: [f64; 2], z: [f64; 2]| Shape::rect(x, z, level::TAXI_LINE);
    let mut all = Vec::new();
    for k in 0..24 {
        let span = (LENGTH - 80.0) / 24.0;
        let z = -40.0 - span * f64::from(k);
        all.push(line([TAXIWAY_X - 0.2, TAXIWAY_X + 0.2], [z - span, z]));
    }
    for z in CONNECTORS {
        all.push(line([TAXIWAY_X + 0.2, -HALF_WIDTH - 1.0], [z - 0.2, z + 0.2]));
        // The holding position: two lines across, 75 m from the centre line.
        for x in [-75.0, -73.8] {
            all.push(line([x, x + 0.4], [z - 10.5, z - 0.5]));
            all.push(line([x, x + 0.4], [z + 0.5, z + 10.5]));
        }
    }
    // Lead-in lines to the stands.
    for z in super::STANDS_Z {
        all.push(line([-194.0, TAXIWAY_X - 0.2], [z - 0.2, z + 0.2]));
    }
    let club_z = (CLUB_Z[0] + CLUB_Z[1]) / 2.0;
    all.push(line([HALF_WIDTH + 1.0, 106.0], [club_z - 0.1, club_z + 0.1]));
    let plain = kit.palette.plain;
    kit.object(group, "taxiway lines", &[(Shape::join(all).colored(YELLOW), plain)]);
}

/// A lamp on the ground: a small pyramid, four triangles.
fn lamp(x: f64, z: f64, size: f64) -> Shape {
    Shape::pyramid([x - size, x + size], [level::RUNWAY, level::RUNWAY + 1.6 * size], [z - size, z + size])
}

fn lamps(kit: &mut Kit, group: NodeId) {
    let mut white = Vec::new();
    for k in 0..=40 {
        let z = -60.0 * f64::from(k);
        white.push(lamp(-HALF_WIDTH - 1.5, z, 0.2));
        white.push(lamp(HALF_WIDTH + 1.5, z, 0.2));
    }
    let across = |z: f64| Shape::join((0..10).map(|k| lamp(-20.25 + 4.5 * f64::from(k), z, 0.25)));
    let palette = kit.palette;
    kit.object(
        group,
        "runway lamps",
        &[
            (Shape::join(white), palette.white_lamp),
            (across(2.0), palette.green_lamp),
            (across(-LENGTH - 2.0), palette.red_lamp),
        ],
    );

    // The PAPI: four boxes left of the aiming point; two white and two red are the right glide path.
    let unit = |x: f64| Shape::cuboid([x - 0.9, x + 0.9], [0.5, 1.1], [-300.6, -299.2], Caps::Both);
    let eye = |x: f64| Shape::cuboid([x - 0.75, x + 0.75], [0.58, 1.02], [-299.25, -299.05], Caps::Top);
    let xs = [-64.5, -55.5, -46.5, -37.5];
    let legs = |x: f64| Shape::cuboid([x - 0.5, x + 0.5], [0.0, 0.5], [-300.2, -299.6], Caps::None);
    let housings = Shape::join(xs.iter().flat_map(|&x| [unit(x), legs(x)])).colored(dvec3(0.75, 0.30, 0.05));
    let white = Shape::join(xs[..2].iter().map(|&x| eye(x)));
    let red = Shape::join(xs[2..].iter().map(|&x| eye(x)));
    kit.object(group, "PAPI", &[(housings, palette.plain), (white, palette.white_lamp), (red, palette.red_lamp)]);
}

fn approach_lights(kit: &mut Kit, group: NodeId) {
    let mut posts = Vec::new();
    let mut white = Vec::new();
    for k in 1..=14 {
        let z = 60.0 + 30.0 * f64::from(k - 1);
        let ground = terrain::height(0.0, z);
        // Masts rise to a plane that goes out at 1 in 60 from the threshold.
        let top = (0.8 + z / 60.0).max(ground + 0.8);
        let half = if k == 9 { 11.0 } else { 2.2 };
        posts.push(Shape::cuboid([-half, half], [top - 0.2, top], [z - 0.1, z + 0.1], Caps::Both));
        for x in [-half + 0.4, half - 0.4] {
            posts.push(Shape::cuboid([x - 0.12, x + 0.12], [ground - 1.5, top - 0.2], [z - 0.1, z + 0.1], Caps::None));
        }
        let count = if k == 9 { 11 } else { 5 };
        for n in 0..count {
            let x = -half + 2.0 * half * f64::from(n) / f64::from(count - 1);
            white.push(Shape::cuboid([x - 0.22, x + 0.22], [top, top + 0.4], [z - 0.2, z + 0.2], Caps::Top));
        }
    }
    let palette = kit.palette;
    let posts = Shape::join(posts).colored(dvec3(0.62, 0.25, 0.06));
    kit.object(group, "approach lights", &[(posts, palette.plain), (Shape::join(white), palette.white_lamp)]);
}

fn windsock(kit: &mut Kit, group: NodeId) {
    let pole = Shape::cylinder(6, [0.12, 0.08], [0.0, 7.0], false).colored(dvec3(0.8, 0.8, 0.8));
    // A tapering sleeve in the northerly wind, in five bands.
    let mut sleeve = Shape::new();
    for band in 0..5 {
        let (a, b) = (f64::from(band) / 5.0, f64::from(band + 1) / 5.0);
        let radius = |t: f64| 0.6 - 0.3 * t;
        let color = if band % 2 == 0 { dvec3(0.85, 0.22, 0.03) } else { dvec3(0.85, 0.85, 0.82) };
        sleeve.add(Shape::cylinder(8, [radius(a), radius(b)], [4.0 * a, 4.0 * b], false).colored(color));
    }
    let sleeve = sleeve
        .transformed(DAffine3::from_translation(dvec3(0.0, 6.6, 0.1)) * DAffine3::from_rotation_x(FRAC_PI_2 + 0.12));
    let palette = kit.palette;
    let mesh = kit.mesh("windsock", &[(pole, palette.plain), (sleeve, palette.cloth)]);
    for at in [dvec3(58.0, 0.0, -330.0), dvec3(-60.0, 0.0, -2050.0)] {
        kit.glb.node(Some(group), Node::new("windsock").mesh(mesh).at(at));
    }
}

/// The instrument landing system: the glide path's mast with its hut beside the aiming point, and the localizer's row
/// of antennas beyond the northern end.
fn radio_aids(kit: &mut Kit, group: NodeId) {
    let orange = dvec3(0.80, 0.24, 0.04);
    let white = dvec3(0.80, 0.80, 0.78);
    let mut mast = Shape::new();
    for band in 0..6 {
        let y = [2.5 * f64::from(band), 2.5 * f64::from(band + 1)];
        let color = if band % 2 == 0 { orange } else { white };
        mast.add(Shape::cylinder(4, [0.35, 0.35], y, band == 5).colored(color));
    }
    for y in [5.0, 9.5, 14.0] {
        mast.add(Shape::cuboid([-1.0, 1.0], [y, y + 0.7], [0.3, 0.8], Caps::Both).colored(white));
    }
    let hut = Shape::cuboid([-1.8, 1.8], [0.0, 2.8], [-8.0, -4.0], Caps::Top).colored(orange);
    let glide_path = Shape::join([mast, hut]).moved(dvec3(56.0, 0.0, -290.0));
    kit.box_shadow([54.2, 57.8], [-298.0, -294.0], 2.8);
    kit.box_shadow([55.7, 56.3], [-290.3, -289.7], 15.0);

    let row = (0..15).map(|k| {
        let x = -14.0 + 2.0 * f64::from(k);
        Shape::cuboid([x - 0.2, x + 0.2], [0.0, 2.6], [-LENGTH - 240.6, -LENGTH - 239.4], Caps::Top).colored(orange)
    });
    let plain = kit.palette.plain;
    kit.object(group, "radio aids", &[(Shape::join(row.chain([glide_path])), plain)]);
}

/// The fence round the airfield, a little inside its border.
fn fence(kit: &mut Kit, group: NodeId) {
    let (x, z) = (terrain::AIRFIELD_X, terrain::AIRFIELD_Z);
    let (x, z) = ([x[0] + 6.0, x[1] - 6.0], [z[0] + 6.0, z[1] - 6.0]);
    let corners = [dvec3(x[0], 0.0, z[0]), dvec3(x[0], 0.0, z[1]), dvec3(x[1], 0.0, z[1]), dvec3(x[1], 0.0, z[0])];
    let mut panels = Shape::new();
    let mut posts = Vec::new();
    for (k, &a) in corners.iter().enumerate() {
        let b = corners[(k + 1) % 4];
        let count = libm::ceil(a.distance(b) / 60.0) as u32;
        for n in 0..count {
            let at = |n: u32| a.lerp(b, f64::from(n) / f64::from(count));
            let (p, q, up) = (at(n), at(n + 1), DVec3::Y * 2.4);
            panels.polygon(&[p, q, q + up, p + up]);
            posts.push(Shape::pyramid([p.x - 0.15, p.x + 0.15], [0.0, 2.9], [p.z - 0.15, p.z + 0.15]));
        }
    }
    let palette = kit.palette;
    let posts = Shape::join(posts).colored(dvec3(0.4, 0.42, 0.4));
    kit.object(group, "fence", &[(panels, palette.fence), (posts, palette.plain)]);
}
