//! The country round the airport: a net of fields whose lines are the field borders and the roads themselves.
//!
//! The ground is a net of cells with uneven spacing, fine near the runway and coarse far away. Its lines are bent by a
//! smooth *warp*, so that nothing looks ruled. Blocks of cells are divided at random into fields, and each field has
//! its own colour and crop rows: borders are sharp because they are edges of the mesh. A road is a column of the net 8
//! m wide. Beyond the net rings of coarser cells reach to the horizon, where haze and hills hide the edge of the
//! world.

use super::super::random::{Random, hash, noise, smoothstep};
use super::super::shapes::{Shape, Vertex};
use glam::{DVec2, DVec3, dvec2, dvec3};
use std::ops::Range;

/// The mown ground of the airport, x and z, m; level.
pub(super) const AIRFIELD_X: [f64; 2] = [-560.0, 380.0];
/// See [`AIRFIELD_X`].
pub(super) const AIRFIELD_Z: [f64; 2] = [-2700.0, 200.0];
/// The roads: a column west, a column east and a row south of the airfield; x or z of the middle before warping, m.
pub(super) const ROAD_WEST: f64 = -1004.0;
/// See [`ROAD_WEST`].
pub(super) const ROAD_EAST: f64 = 720.0;
/// See [`ROAD_WEST`].
pub(super) const ROAD_SOUTH: f64 = 680.0;
const ROAD_HALF: f64 = 4.0;
/// The lake: middle and radius of its basin, m.
pub(super) const LAKE: DVec2 = dvec2(-740.0, 425.0);
/// See [`LAKE`].
pub(super) const LAKE_RADIUS: f64 = 178.0;
/// The lake's level, m.
pub(super) const LAKE_LEVEL: f64 = -11.0;
/// The village and the hamlet: middle and radius of the ground that is kept for them, m.
pub(super) const VILLAGES: [(DVec2, f64); 2] =
    [(dvec2(-270.0, ROAD_SOUTH), 250.0), (dvec2(ROAD_EAST, ROAD_SOUTH), 190.0)];

const SEED: u64 = 1983;
const HAZE: DVec3 = dvec3(0.66, 0.77, 0.88);

/// Lines of the net between given places: (from, to, number of cells).
const LINES_X: [(f64, f64, u32); 11] = [
    (-4600.0, -2600.0, 8),
    (-2600.0, -1300.0, 8),
    (-1300.0, ROAD_WEST - ROAD_HALF, 3),
    (ROAD_WEST - ROAD_HALF, ROAD_WEST + ROAD_HALF, 1),
    (ROAD_WEST + ROAD_HALF, -560.0, 5),
    (-560.0, 380.0, 10),
    (380.0, ROAD_EAST - ROAD_HALF, 4),
    (ROAD_EAST - ROAD_HALF, ROAD_EAST + ROAD_HALF, 1),
    (ROAD_EAST + ROAD_HALF, 1500.0, 9),
    (1500.0, 2600.0, 7),
    (2600.0, 4600.0, 8),
];
const LINES_Z: [(f64, f64, u32); 9] = [
    (-7000.0, -4500.0, 8),
    (-4500.0, -2700.0, 10),
    (-2700.0, 200.0, 26),
    (200.0, ROAD_SOUTH - ROAD_HALF, 5),
    (ROAD_SOUTH - ROAD_HALF, ROAD_SOUTH + ROAD_HALF, 1),
    (ROAD_SOUTH + ROAD_HALF, 1700.0, 12),
    (1700.0, 2600.0, 7),
    (2600.0, 3300.0, 4),
    (3300.0, 3900.0, 3),
];

/// Height of the ground, m. Meshes follow it to within about 0.6 m; what stands on it should reach that much deeper.
pub(super) fn height(x: f64, z: f64) -> f64 {
    let outside = outside_airfield(x, z);
    let octave = |seed, wave: f64| noise(SEED + seed, x / wave, z / wave, None);
    let mut rolling = 30.0 * octave(1, 1500.0) + 13.0 * octave(2, 640.0) + 4.0 * octave(3, 290.0);
    // Under the approach the country is low and calm: the pilot sees the runway over it, and never meets a hill.
    let corridor = smoothstep(1500.0, 500.0, x.abs()) * smoothstep(-300.0, 500.0, z);
    rolling += corridor * (-8.0 - 0.6 * rolling);
    let far = (outside - 1800.0).max(0.0);
    let ridges = 0.5 + 0.5 * noise(SEED + 4, x / 3400.0, z / 3400.0, None) + 0.25 * octave(5, 1600.0);
    let hills = ridges * 0.030 * far * smoothstep(0.0, 5000.0, far);
    let mut y = (rolling + hills) * smoothstep(40.0, 620.0, outside);

    let lake = dvec2(x, z).distance(LAKE) / LAKE_RADIUS;
    let shore = LAKE_LEVEL + 2.5;
    y += (shore - y) * smoothstep(2.0, 1.1, lake);
    y -= 8.0 * smoothstep(1.15, 0.6, lake);
    y
}

/// Distance from the airfield, m; 0 on it.
fn outside_airfield(x: f64, z: f64) -> f64 {
    let dx = (AIRFIELD_X[0] - x).max(x - AIRFIELD_X[1]).max(0.0);
    let dz = (AIRFIELD_Z[0] - z).max(z - AIRFIELD_Z[1]).max(0.0);
    dvec2(dx, dz).length()
}

/// Bends the net's lines; the airfield's stay straight.
fn warp(p: DVec2) -> DVec2 {
    let amount = 75.0 * smoothstep(60.0, 900.0, outside_airfield(p.x, p.y));
    let bend = |seed| noise(SEED + seed, p.x / 900.0, p.y / 900.0, None);
    p + amount * dvec2(bend(8), bend(9))
}

/// A point of the ground from net coordinates, which are metres before the warp.
pub(super) fn ground(net: DVec2) -> DVec3 {
    let p = warp(net);
    dvec3(p.x, height(p.x, p.y), p.y)
}

/// Whether a point lies in a village.
pub(super) fn in_village(p: DVec2) -> bool {
    VILLAGES.iter().any(|(middle, radius)| p.distance(*middle) < *radius)
}

/// Whether a point lies in the lake or on its bank.
pub(super) fn at_lake(p: DVec3) -> bool {
    dvec2(p.x, p.z).distance(LAKE) < LAKE_RADIUS * 1.25
}

/// Whether a point lies on a road or its verge.
pub(super) fn on_road(p: DVec3) -> bool {
    // The warp is gentle enough to be undone by a few rounds of taking it away.
    let place = dvec2(p.x, p.z);
    let net = (0..4).fold(place, |net, _| place - (warp(net) - net));
    let verge = ROAD_HALF + 4.0;
    (net.x - ROAD_WEST).abs() < verge || (net.x - ROAD_EAST).abs() < verge || (net.y - ROAD_SOUTH).abs() < verge
}

fn normal(x: f64, z: f64, step: f64) -> DVec3 {
    let dx = height(x + step, z) - height(x - step, z);
    let dz = height(x, z + step) - height(x, z - step);
    dvec3(-dx, 2.0 * step, -dz).normalize()
}

/// A colour as it looks through the air from near the runway's southern end. The renderer has no haze unless it is
/// told a visibility; without any, hills look like models.
pub(super) fn hazed(color: DVec3, p: DVec3) -> DVec3 {
    let distance = dvec2(p.x, p.z - 300.0).length();
    let haze = 1.0 - libm::exp(-(distance - 1200.0).max(0.0) / 11_000.0);
    color.lerp(HAZE, haze)
}

/// What grows on a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    Airfield,
    Road,
    Meadow,
    Crop,
    Wood,
}

/// A block of cells under one use.
#[derive(Clone, Debug)]
pub(super) struct Field {
    columns: Range<usize>,
    rows: Range<usize>,
    pub(super) usage: Use,
    color: DVec3,
    /// Direction of the crop rows, rad.
    direction: f64,
}

/// The net and what it is used for.
#[derive(Debug)]
pub(super) struct Land {
    lines_x: Vec<f64>,
    lines_z: Vec<f64>,
    pub(super) fields: Vec<Field>,
}

impl Land {
    pub(super) fn new(random: &mut Random) -> Self {
        let mut land = Self { lines_x: lines(&LINES_X), lines_z: lines(&LINES_Z), fields: Vec::new() };
        // Roads and the airfield cut the net into blocks.
        let cuts_x = land.cuts(&land.lines_x, &[ROAD_WEST, ROAD_EAST], &AIRFIELD_X);
        let cuts_z = land.cuts(&land.lines_z, &[ROAD_SOUTH], &AIRFIELD_Z);
        for x in cuts_x.windows(2) {
            for z in cuts_z.windows(2) {
                land.divide(x[0]..x[1], z[0]..z[1], random);
            }
        }
        land
    }

    fn cuts(&self, lines: &[f64], roads: &[f64], borders: &[f64]) -> Vec<usize> {
        let is_cut = |x: f64| borders.contains(&x) || roads.iter().any(|r| (x - r).abs() <= ROAD_HALF);
        (0..lines.len()).filter(|&i| i == 0 || i == lines.len() - 1 || is_cut(lines[i])).collect()
    }

    fn divide(&mut self, columns: Range<usize>, rows: Range<usize>, random: &mut Random) {
        let (width, depth) = (columns.len(), rows.len());
        let middle = self.middle(&columns, &rows);
        let road = self.lines_x[columns.end] - self.lines_x[columns.start] < 9.0
            || self.lines_z[rows.end] - self.lines_z[rows.start] < 9.0;
        let airfield =
            (AIRFIELD_X[0]..AIRFIELD_X[1]).contains(&middle.x) && (AIRFIELD_Z[0]..AIRFIELD_Z[1]).contains(&middle.y);
        let small = width * depth <= 4 || (width * depth <= 9 && random.chance(0.45));
        if road || airfield || (small && width <= 3 && depth <= 3) {
            let field = self.field(columns, rows, middle, (road, airfield), random);
            self.fields.push(field);
        } else if width > depth || (width == depth && random.chance(0.5)) {
            let cut = columns.start + (width as f64 * random.range(0.35, 0.65)).max(1.0) as usize;
            self.divide(columns.start..cut, rows.clone(), random);
            self.divide(cut..columns.end, rows, random);
        } else {
            let cut = rows.start + (depth as f64 * random.range(0.35, 0.65)).max(1.0) as usize;
            self.divide(columns.clone(), rows.start..cut, random);
            self.divide(columns, cut..rows.end, random);
        }
    }

    fn middle(&self, columns: &Range<usize>, rows: &Range<usize>) -> DVec2 {
        let centre = |lines: &[f64], r: &Range<usize>| (lines[r.start] + lines[r.end]) / 2.0;
        dvec2(centre(&self.lines_x, columns), centre(&self.lines_z, rows))
    }

    fn field(
        &self,
        columns: Range<usize>,
        rows: Range<usize>,
        middle: DVec2,
        (road, airfield): (bool, bool),
        random: &mut Random,
    ) -> Field {
        let place = warp(middle);
        // Woods keep away from the runway's ends, the village and the lake, and gather where noise says so.
        let wooded = noise(SEED + 12, place.x / 1300.0, place.y / 1300.0, None) > 0.08;
        let near = outside_airfield(place.x, place.y) < 130.0
            || (place.x.abs() < 330.0 && (200.0..1500.0).contains(&place.y))
            || in_village(place)
            || place.distance(LAKE) < LAKE_RADIUS + 90.0;
        let wood = !near && random.chance(if wooded { 0.38 } else { 0.04 });
        let (usage, color) = if road {
            (Use::Road, dvec3(0.17, 0.17, 0.175))
        } else if airfield {
            (Use::Airfield, dvec3(0.150, 0.235, 0.065))
        } else if wood {
            (Use::Wood, dvec3(0.055, 0.105, 0.032))
        } else {
            // Village gardens are green.
            let choice = if in_village(place) { 10 } else { random.index(16) };
            let (usage, color) = match choice {
                0..=2 => (Use::Crop, dvec3(0.47, 0.35, 0.125)),   // ripe wheat
                3..=4 => (Use::Crop, dvec3(0.36, 0.33, 0.11)),    // barley, still turning
                5..=6 => (Use::Crop, dvec3(0.125, 0.215, 0.05)),  // maize
                7 => (Use::Crop, dvec3(0.50, 0.43, 0.06)),        // rape in flower
                8..=9 => (Use::Crop, dvec3(0.225, 0.155, 0.095)), // ploughed
                10..=13 => (Use::Meadow, dvec3(0.155, 0.245, 0.06)),
                _ => (Use::Meadow, dvec3(0.215, 0.265, 0.085)), // mown
            };
            (usage, color * random.range(0.85, 1.12))
        };
        let direction = if random.chance(0.5) { 0.0 } else { std::f64::consts::FRAC_PI_2 } + random.range(-0.12, 0.12);
        Field { columns, rows, usage, color, direction }
    }

    /// A corner of the net.
    pub(super) fn corner(&self, i: usize, j: usize) -> DVec3 {
        ground(dvec2(self.lines_x[i], self.lines_z[j]))
    }

    /// The middle of a field on the ground.
    pub(super) fn centre(&self, field: &Field) -> DVec3 {
        ground(self.middle(&field.columns, &field.rows))
    }

    /// A point of a field at random, `inset` (0..0.5) away from its borders.
    pub(super) fn point_in(&self, field: &Field, inset: f64, random: &mut Random) -> DVec3 {
        let mut along = |lines: &[f64], r: &Range<usize>| {
            let t = random.range(inset, 1.0 - inset);
            lines[r.start] + (lines[r.end] - lines[r.start]) * t
        };
        let (x, z) = (along(&self.lines_x, &field.columns), along(&self.lines_z, &field.rows));
        ground(dvec2(x, z))
    }

    /// The corners along a field's northern and western border, where hedges may stand.
    pub(super) fn borders(&self, field: &Field) -> [Vec<DVec3>; 2] {
        [
            (field.columns.start..=field.columns.end).map(|i| self.corner(i, field.rows.start)).collect(),
            (field.rows.start..=field.rows.end).map(|j| self.corner(field.columns.start, j)).collect(),
        ]
    }

    /// All four borders, counter-clockwise seen from above.
    fn outline(&self, field: &Field) -> Vec<DVec3> {
        let (c, r) = (&field.columns, &field.rows);
        let south = (c.start..c.end).map(|i| (i, r.end));
        let east = (r.start + 1..=r.end).rev().map(|j| (c.end, j));
        let north = (c.start + 1..=c.end).rev().map(|i| (i, r.start));
        let west = (r.start..r.end).map(|j| (c.start, j));
        south.chain(east).chain(north).chain(west).map(|(i, j)| self.corner(i, j)).collect()
    }

    /// The ground of a field, mapped for its detail texture. A wood has none: [`Land::canopy`] covers it.
    pub(super) fn surface(&self, field: &Field) -> Shape {
        let texture_m = match field.usage {
            Use::Crop => 24.0,
            Use::Road => 12.0,
            _ => 40.0,
        };
        let (s, c) = libm::sincos(field.direction);
        Shape::grid(field.columns.len() as u32, field.rows.len() as u32, |i, j| {
            let p = self.corner(field.columns.start + i as usize, field.rows.start + j as usize);
            let patch = noise(SEED + 14, p.x / 190.0, p.z / 190.0, None);
            let color = match field.usage {
                Use::Road => field.color,
                // Dry and lush patches of an old lawn.
                Use::Airfield => field.color.lerp(dvec3(0.27, 0.27, 0.10), smoothstep(-0.6, 1.0, patch) * 0.75),
                // Reeds round the lake, whatever the field.
                _ => (field.color * (1.0 + 0.16 * patch))
                    .lerp(dvec3(0.14, 0.20, 0.06), smoothstep(1.5, 1.15, dvec2(p.x, p.z).distance(LAKE) / LAKE_RADIUS)),
            };
            let texcoord = dvec2(p.x * c + p.z * s, p.z * c - p.x * s) / texture_m;
            Vertex { color: hazed(color, p), texcoord, ..Vertex::new(p, normal(p.x, p.z, 30.0)) }
        })
    }

    /// The roof of tree tops over a wood, and its sides down to the ground. Near the airport it has four faces where
    /// the ground below would have one.
    pub(super) fn canopy(&self, field: &Field) -> Shape {
        let parts = if self.centre(field).length() < 1900.0 { 2 } else { 1 };
        let (nx, nz) = (field.columns.len() as u32 * parts, field.rows.len() as u32 * parts);
        let line = |lines: &[f64], start: usize, i: u32| {
            let (k, rest) = (start + (i / parts) as usize, i % parts);
            if rest == 0 { lines[k] } else { (lines[k] + lines[k + 1]) / 2.0 }
        };
        let foot = |i: u32, j: u32| {
            ground(dvec2(line(&self.lines_x, field.columns.start, i), line(&self.lines_z, field.rows.start, j)))
        };
        let rise = |p: DVec3| 8.0 + 8.0 * hash(SEED + 16, libm::round(p.x * 8.0) as i64, libm::round(p.z * 8.0) as i64);
        let mut canopy = Shape::grid(nx, nz, |i, j| {
            let p = foot(i, j);
            let up = rise(p);
            // Tree tops are rougher than the net: the light is tipped at random.
            let tip = |salt| hash(SEED + salt, i64::from(i), i64::from(j)) - 0.5;
            let slope = normal(p.x, p.z, 30.0) + dvec3(tip(17), 0.0, tip(18)) * 0.8;
            let top = p + DVec3::Y * up;
            let color = hazed(field.color * (0.95 + 0.5 * (up - 8.0) / 8.0), p);
            Vertex { color, texcoord: dvec2(p.x, p.z) / 64.0, ..Vertex::new(top, slope.normalize()) }
        });
        // The sides go once round, counter-clockwise seen from above.
        let south = (0..nx).map(|i| (i, nz));
        let east = (1..=nz).rev().map(|j| (nx, j));
        let north = (1..=nx).rev().map(|i| (i, 0));
        let west = (0..nz).map(|j| (0, j));
        let round: Vec<DVec3> = south.chain(east).chain(north).chain(west).map(|(i, j)| foot(i, j)).collect();
        for (k, &a) in round.iter().enumerate() {
            let b = round[(k + 1) % round.len()];
            let out = (dvec3(a.z - b.z, 0.0, b.x - a.x).normalize() + DVec3::Y * 0.5).normalize();
            let corners = [(a, -2.0), (b, -2.0), (b, rise(b)), (a, rise(a))].map(|(p, up)| {
                let light = if up < 0.0 { 0.5 } else { 1.05 };
                let texcoord = dvec2(p.x + p.z, up * 1.6) / 64.0;
                canopy.vertex(Vertex {
                    color: hazed(field.color * light, p),
                    texcoord,
                    ..Vertex::new(p + DVec3::Y * up, out)
                })
            });
            canopy.triangle(corners[0], corners[1], corners[2]);
            canopy.triangle(corners[0], corners[2], corners[3]);
        }
        canopy
    }

    /// The middle of the road in the south from west to east, for what drives on it.
    pub(super) fn road_south(&self) -> Vec<DVec3> {
        let row = self.lines_z.iter().position(|&z| z == ROAD_SOUTH - ROAD_HALF).expect("the road is a row of the net");
        (0..self.lines_x.len()).map(|i| (self.corner(i, row) + self.corner(i, row + 1)) / 2.0).collect()
    }

    /// The coarse rings from the net's border to the horizon.
    pub(super) fn horizon(&self) -> Shape {
        const RINGS: usize = 10;
        let (nx, nz) = (self.lines_x.len() - 1, self.lines_z.len() - 1);
        let whole = Field { columns: 0..nx, rows: 0..nz, usage: Use::Meadow, color: DVec3::ONE, direction: 0.0 };
        let border = self.outline(&whole);
        let centre = dvec2(0.0, -1550.0);
        let color = |p: DVec3, k: usize, j: usize| {
            let patch =
                noise(SEED + 20, p.x / 420.0, p.z / 420.0, None) + 0.7 * (hash(SEED + 21, k as i64, j as i64) - 0.5);
            let c = if patch < -0.12 {
                dvec3(0.055, 0.105, 0.032)
            } else if patch < 0.3 {
                dvec3(0.16, 0.225, 0.06)
            } else {
                dvec3(0.33, 0.28, 0.10)
            };
            hazed(c, p)
        };
        let vertex = |p: DVec3, k: usize, j: usize| {
            // Far slopes lose their shading in the haze too.
            let distance = dvec2(p.x, p.z).length();
            let n = normal(p.x, p.z, 80.0).lerp(DVec3::Y, smoothstep(3000.0, 24_000.0, distance)).normalize();
            Vertex { color: color(p, k, j), texcoord: dvec2(p.x, p.z) / 40.0, ..Vertex::new(p, n) }
        };
        let mut shape = Shape::new();
        let inner: Vec<u32> = border.iter().enumerate().map(|(k, &p)| shape.vertex(vertex(p, k, 0))).collect();
        let half = border.len() / 2;
        let mut rings = vec![inner];
        for j in 1..=RINGS {
            let t = j as f64 / RINGS as f64;
            let ring = (0..half)
                .map(|k| {
                    let from = dvec2(border[2 * k].x, border[2 * k].z) - centre;
                    // From the net's rectangle to a circle of 30 km; rings widen as they go out.
                    let to = from.normalize() * 30_000.0;
                    let p = centre + from.lerp(to, 0.02 * t + 0.98 * t * t * t.sqrt());
                    shape.vertex(vertex(dvec3(p.x, height(p.x, p.y), p.y), k, j))
                })
                .collect();
            rings.push(ring);
        }
        for k in 0..half {
            // The net's border has twice as many corners as the first ring.
            let next = (k + 1) % half;
            let (a, m, b) = (rings[0][2 * k], rings[0][2 * k + 1], rings[0][(2 * k + 2) % border.len()]);
            let (c, d) = (rings[1][k], rings[1][next]);
            shape.triangle(a, c, m);
            shape.triangle(m, c, d);
            shape.triangle(m, d, b);
            for pair in rings[1..].windows(2) {
                let (a, b, c, d) = (pair[0][k], pair[0][next], pair[1][k], pair[1][next]);
                shape.triangle(a, c, d);
                shape.triangle(a, d, b);
            }
        }
        shape
    }
}

fn lines(spans: &[(f64, f64, u32)]) -> Vec<f64> {
    let mut all = vec![spans[0].0];
    for &(from, to, cells) in spans {
        all.extend(
            (1..=cells).map(|k| if k == cells { to } else { from + (to - from) * f64::from(k) / f64::from(cells) }),
        );
    }
    all
}
