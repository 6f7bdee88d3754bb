//! Fields, woods, hedges and trees: what covers the [land](super::terrain), gathered into pieces that can be culled.

use super::super::random::Random;
use super::super::shapes::{Shape, Vertex};
use super::kit::Kit;
use super::terrain::{self, Field, Land, Use, hazed};
use crate::scene::glb::{MeshId, Node, NodeId};
use glam::{DQuat, DVec2, DVec3, dvec2, dvec3};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Trees that stand alone or in rows; those of a wood's inside are its canopy.
const TREES: usize = 850;
/// The nearest of them are modelled with care, the rest with a third of the triangles.
const NEAR_TREES: usize = 300;
/// Edge of the squares that ground and trees are gathered in, m.
const TILE: f64 = 1200.0;

/// The land and what covers it; [`trees`] come later, when it is known where the houses are.
pub(super) fn build(kit: &mut Kit, land: &Land) {
    ground(kit, land);
    let horizon = land.horizon();
    let grass = kit.palette.grass;
    let group = kit.group("horizon");
    kit.object(group, "horizon", &[(horizon, grass)]);
    lake(kit, group);
}

type Tile = (i64, i64);

fn tile(p: DVec3) -> Tile {
    (libm::floor(p.x / TILE) as i64, libm::floor(p.z / TILE) as i64)
}

fn ground(kit: &mut Kit, land: &Land) {
    #[derive(Default)]
    struct Cover {
        grass: Shape,
        crops: Shape,
        roads: Shape,
        leaves: Shape,
        tree_tops: Shape,
    }
    let mut tiles: BTreeMap<Tile, Cover> = BTreeMap::new();
    let mut random = Random::new(kit.random.next());
    for field in &land.fields {
        let cover = tiles.entry(tile(land.centre(field))).or_default();
        match field.usage {
            Use::Wood => cover.tree_tops.add(land.canopy(field)),
            Use::Crop => cover.crops.add(land.surface(field)),
            Use::Road => cover.roads.add(land.surface(field)),
            Use::Meadow | Use::Airfield => cover.grass.add(land.surface(field)),
        }
        if matches!(field.usage, Use::Crop | Use::Meadow) {
            for border in land.borders(field) {
                if border.iter().all(|p| may_have_hedge(*p)) && random.chance(0.5) {
                    cover.leaves.add(hedge(&border, random.range(2.0, 4.0)));
                }
            }
        }
    }
    let palette = kit.palette;
    let group = kit.group("ground");
    for ((i, j), cover) in tiles {
        let parts = [
            (cover.grass, palette.grass),
            (cover.crops, palette.crops),
            (cover.roads, palette.asphalt),
            (cover.leaves, palette.leaves),
            (cover.tree_tops, palette.tree_tops),
        ];
        kit.object(group, &format!("ground {i} {j}"), &parts);
    }
}

/// Whether a hedge may stand there: near enough to be seen, and not in the lake, the village or the approach lights.
fn may_have_hedge(p: DVec3) -> bool {
    let approach = p.x.abs() < 150.0 && (0.0..650.0).contains(&p.z);
    p.length() < 2200.0 && !terrain::at_lake(p) && !terrain::in_village(dvec2(p.x, p.z)) && !approach
}

/// A hedge along a border: a ridge of leaves without ends.
fn hedge(border: &[DVec3], height: f64) -> Shape {
    let half = 0.45 * height;
    let across = |k: usize| {
        let along = border[(k + 1).min(border.len() - 1)] - border[k.saturating_sub(1)];
        dvec3(along.z, 0.0, -along.x).normalize()
    };
    let mut shape = Shape::new();
    for side in [-1.0, 1.0] {
        for k in 0..border.len() - 1 {
            let corners = [(k, true), (k + 1, true), (k + 1, false), (k, false)].map(|(k, foot)| {
                let out = across(k) * side;
                let p = border[k] + if foot { out * half - DVec3::Y * 0.8 } else { DVec3::Y * height };
                let light = if foot { 0.55 } else { 1.0 };
                let along = border[k].x + border[k].z;
                shape.vertex(Vertex {
                    color: hazed(dvec3(0.065, 0.125, 0.035) * light, p),
                    texcoord: dvec2(along, if foot { 0.0 } else { height * 1.2 }) / 12.0,
                    ..Vertex::new(p, (out + DVec3::Y * 0.7).normalize())
                })
            });
            let [a, b, c, d] = corners;
            // `across` points left of the border's direction; seen from there the border runs backwards.
            if side < 0.0 {
                shape.triangle(a, b, c);
                shape.triangle(a, c, d);
            } else {
                shape.triangle(b, a, d);
                shape.triangle(b, d, c);
            }
        }
    }
    shape
}

fn lake(kit: &mut Kit, group: NodeId) {
    let (centre, r) = (terrain::LAKE, terrain::LAKE_RADIUS * 1.35);
    let rim: Vec<DVec3> = super::super::shapes::circle(24, r, 0.0);
    let mut water = Shape::new();
    let p = |v: DVec3| dvec3(centre.x + v.x, terrain::LAKE_LEVEL, centre.y + v.z);
    let middle = water.vertex(Vertex::new(p(DVec3::ZERO), DVec3::Y));
    let ring: Vec<u32> = rim.iter().map(|&v| water.vertex(Vertex::new(p(v), DVec3::Y))).collect();
    for k in 0..24 {
        water.triangle(middle, ring[k], ring[(k + 1) % 24]);
    }
    let material = kit.palette.water;
    kit.object(group, "lake", &[(water, material)]);
}

/// Tree meshes.
struct Forest {
    conifers: [MeshId; 2],
    broad: [MeshId; 4],
    far_conifer: MeshId,
    far_broad: [MeshId; 2],
}

fn trunk(height: f64, radius: f64) -> Shape {
    Shape::cylinder(3, [radius, radius], [-1.2, height], false).colored(dvec3(0.14, 0.10, 0.07))
}

fn conifer(kit: &mut Kit, color: DVec3) -> MeshId {
    let shade = |p: DVec3, _: DVec3| color * (0.6 + 0.6 * p.y / 14.0);
    let tiers = [(3.2, [1.6, 8.0]), (2.3, [5.0, 11.5]), (1.4, [8.6, 14.5])];
    let cones = tiers.map(|(r, y)| Shape::cylinder(6, [r, 0.0], y, false).mapped(|p, _| dvec2(p.x + p.z, p.y) / 8.0));
    let palette = kit.palette;
    kit.mesh("conifer", &[(Shape::join(cones).painted(shade), palette.leaves), (trunk(2.0, 0.35), palette.plain)])
}

/// A crown of leaves: a ball of 20 or more faces, dented at random, dark below.
fn crown(random: &mut Random, (n, m): (u32, u32), size: DVec3, centre: DVec3, color: DVec3) -> Shape {
    // Corners of one place must move together, or the ball would tear.
    let salt = random.next();
    Shape::sphere(n, m)
        .jittered(|p| {
            let key = |x: f64| libm::round(x * 1000.0) as i64;
            p * 0.42 * (super::super::random::hash(salt, key(p.x) * 7919 + key(p.y), key(p.z)) - 0.5)
        })
        .painted(|p, _| color * (0.78 + 0.36 * p.y))
        .scaled(size)
        .moved(centre)
        .mapped(|p, _| dvec2(p.x + 0.4 * p.z, p.y + 0.6 * p.z) / 8.0)
}

impl Forest {
    fn new(kit: &mut Kit) -> Self {
        let conifers = [dvec3(0.055, 0.115, 0.045), dvec3(0.07, 0.13, 0.045)].map(|c| conifer(kit, c));
        let mut random = Random::new(kit.random.next());
        let palette = kit.palette;
        let colors =
            [dvec3(0.13, 0.225, 0.055), dvec3(0.10, 0.19, 0.05), dvec3(0.175, 0.25, 0.065), dvec3(0.12, 0.21, 0.06)];
        let broad = [0, 1, 2, 3].map(|k: usize| {
            let color = colors[k];
            let mut leaves = crown(
                &mut random,
                if k.is_multiple_of(2) { (6, 4) } else { (6, 3) },
                dvec3(4.6, 4.2, 4.6),
                dvec3(0.0, 6.6, 0.0),
                color,
            );
            if k == 3 {
                // The larger oak has a second heap.
                leaves.add(crown(&mut random, (5, 3), dvec3(3.2, 2.8, 3.2), dvec3(3.0, 5.4, 1.0), color * 0.92));
            }
            kit.mesh("broadleaf", &[(leaves, palette.leaves), (trunk(4.0, 0.4), palette.plain)])
        });
        let far_broad = [colors[0], colors[1]].map(|color| {
            let leaves = crown(&mut random, (4, 3), dvec3(4.6, 5.2, 4.6), dvec3(0.0, 5.4, 0.0), color);
            kit.mesh("far broadleaf", &[(leaves, palette.leaves)])
        });
        let cone = Shape::cylinder(6, [2.9, 0.0], [0.0, 14.0], false)
            .mapped(|p, _| dvec2(p.x + p.z, p.y) / 8.0)
            .painted(|p, _| dvec3(0.05, 0.10, 0.04) * (0.6 + 0.6 * p.y / 14.0));
        let far_conifer = kit.mesh("far conifer", &[(cone, palette.leaves)]);
        Self { conifers, broad, far_conifer, far_broad }
    }
}

/// Trees; not where the `village` has its houses.
pub(super) fn trees(kit: &mut Kit, land: &Land, village: &[DVec2]) {
    let forest = Forest::new(kit);
    let mut random = Random::new(kit.random.next());
    let mut places: Vec<(DVec3, bool)> = Vec::new();
    // Rows along field borders and the edges of woods, then single ones in the meadows, near country first.
    let mut fields: Vec<(&Field, DVec3)> = land.fields.iter().map(|f| (f, land.centre(f))).collect();
    let interest = dvec3(0.0, 0.0, 200.0);
    fields.sort_by(|a, b| a.1.distance(interest).total_cmp(&b.1.distance(interest)));
    for (field, centre) in &fields {
        let nearness = (1.0 - centre.distance(interest) / 4200.0).max(0.0);
        match field.usage {
            Use::Wood => {
                let conifers = random.chance(0.35);
                for border in land.borders(field) {
                    for pair in border.windows(2) {
                        let count = (nearness * 7.0) as u32;
                        for _ in 0..count {
                            let p = pair[0].lerp(pair[1], random.unit());
                            let push = dvec3(random.range(-9.0, 5.0), 0.0, random.range(-9.0, 5.0));
                            places.push((p + push, conifers));
                        }
                    }
                }
            }
            Use::Meadow | Use::Crop => {
                for border in land.borders(field) {
                    if random.chance(0.4 * nearness + 0.1) {
                        for pair in border.windows(2) {
                            for _ in 0..1 + random.index(4) {
                                places.push((pair[0].lerp(pair[1], random.unit()), false));
                            }
                        }
                    }
                }
                if field.usage == Use::Meadow && random.chance(nearness) {
                    for _ in 0..random.index(6) {
                        places.push((land.point_in(field, 0.12, &mut random), random.chance(0.15)));
                    }
                }
            }
            Use::Airfield | Use::Road => {}
        }
    }
    // Gardens and orchards.
    for (middle, radius) in terrain::VILLAGES {
        for _ in 0..55 {
            let (s, c) = libm::sincos(random.range(0.0, TAU));
            let p = middle + dvec2(c, s) * radius * random.range(0.1, 0.95);
            let apart = village.iter().all(|house| house.distance(p) > 11.0);
            if apart {
                places.push((dvec3(p.x, 0.0, p.y), random.chance(0.12)));
            }
        }
    }
    // A windbreak behind the buildings.
    for k in 0..46 {
        places.push((
            dvec3(-530.0 + random.range(-6.0, 6.0), 0.0, -90.0 - 22.0 * f64::from(k) + random.range(-8.0, 8.0)),
            k % 9 < 3,
        ));
    }
    places.retain(|(p, _)| free(*p));
    // Those that are nearest to where the flight goes; the far ones would be specks.
    places.sort_by(|a, b| a.0.distance(interest).total_cmp(&b.0.distance(interest)));
    places.truncate(TREES);

    let mut groups: BTreeMap<Tile, NodeId> = BTreeMap::new();
    let all = kit.group("trees");
    for (k, (p, is_conifer)) in places.into_iter().enumerate() {
        let (i, j) = tile(p);
        let group =
            *groups.entry((i, j)).or_insert_with(|| kit.glb.node(Some(all), Node::new(format!("trees {i} {j}"))));
        let at = dvec3(p.x, terrain::height(p.x, p.z) - 0.4, p.z);
        let mesh = match (is_conifer, k < NEAR_TREES) {
            (true, true) => forest.conifers[random.index(2)],
            (false, true) => forest.broad[random.index(4)],
            (true, false) => forest.far_conifer,
            (false, false) => forest.far_broad[random.index(2)],
        };
        let (h, w) = (random.range(0.75, 1.35), random.range(0.85, 1.2));
        let node = Node::new("tree").mesh(mesh).at(at).turned(DQuat::from_rotation_y(random.range(0.0, TAU)));
        kit.glb.node(Some(group), node.scaled(dvec3(h * w, h, h * w)));
    }
}

/// Whether a tree may stand there: not on the airfield's open ground, in the water, on a road, or under the approach.
fn free(p: DVec3) -> bool {
    let (x, z) = (terrain::AIRFIELD_X, terrain::AIRFIELD_Z);
    let inside = p.x > x[0] - 20.0 && p.x < x[1] + 20.0 && p.z > z[0] - 20.0 && p.z < z[1] + 20.0;
    let windbreak = p.x < -515.0 && p.x > x[0];
    let approach = p.x.abs() < 60.0 && p.z > 0.0 && p.z < 700.0;
    let wet = dvec2(p.x, p.z).distance(terrain::LAKE) < terrain::LAKE_RADIUS * 1.05;
    (!inside || windbreak) && !approach && !wet && !terrain::on_road(p)
}
