//! Scenes of a few faces, each with the planes that must be found.

use super::*;
use crate::scene::split::{Primitive, split};
use crate::scene::{Extras, NodeSource, Parts, PieceSource, Scene, ShapeIndex};
use glam::{DQuat, DVec3, dvec3};
use proto::scene::Material;

/// Squares facing up: centre x and z, side, height.
fn squares(all: &[[f64; 4]]) -> Primitive {
    let mut primitive = Primitive::default();
    for &[x, z, side, y] in all {
        let (half, first) = (side / 2.0, primitive.positions.len() as u32);
        for [i, j] in [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]] {
            primitive.positions.push(dvec3(x + i * half, y, z + j * half).as_vec3().to_array());
        }
        primitive.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    primitive
}

/// A net of `n` × `n` squares of one metre, at heights `y(x, z)`.
fn net(n: u32, y: impl Fn(f64, f64) -> f64) -> Primitive {
    let mut primitive = Primitive::default();
    for j in 0..=n {
        for i in 0..=n {
            let (x, z) = (f64::from(i), f64::from(j));
            primitive.positions.push(dvec3(x, y(x, z), z).as_vec3().to_array());
        }
    }
    for j in 0..n {
        for a in (0..n).map(|i| j * (n + 1) + i) {
            primitive.triangles.extend([[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]]);
        }
    }
    primitive
}

#[derive(Default)]
struct World {
    parts: Parts,
}

impl World {
    fn shape(&mut self, primitives: &[Primitive]) -> ShapeIndex {
        let pieces = primitives.iter().enumerate().flat_map(|(number, primitive)| {
            let plain = PieceSource::plain(split(primitive), 0);
            plain.into_iter().map(move |piece| PieceSource { primitive: number as u32, ..piece })
        });
        self.parts.add_shape("", Extras::default(), pieces.collect()).unwrap()
    }

    fn put(&mut self, shape: ShapeIndex, local: DAffine3) -> &mut NodeSource {
        self.parts.nodes.push(NodeSource { local, shape: Some(shape), ..NodeSource::default() });
        self.parts.nodes.last_mut().unwrap()
    }

    fn add(&mut self, primitive: &Primitive) -> &mut NodeSource {
        let shape = self.shape(std::slice::from_ref(primitive));
        self.put(shape, DAffine3::IDENTITY)
    }

    /// Assembles, and checks what holds of any table.
    fn scene(self) -> Scene {
        let scene = Scene::assemble(self.parts).unwrap();
        let table = &scene.table;
        let mut used = vec![0; table.planes.len()];
        let mut entries = 0;
        for row in &table.subobjects {
            let Some(start) = row.planes else { continue };
            let mesh = scene.meshes.get(&row.mesh).unwrap();
            entries += mesh.triangles.len();
            for (corners, &plane) in mesh.triangles.iter().zip(&table.face_planes[start as usize..]) {
                let Some(plane) = table.planes.get(plane as usize) else {
                    assert_eq!(plane, NO_PLANE, "a face has a plane that there is not");
                    continue;
                };
                used[table.planes.iter().position(|other| other == plane).unwrap()] += 1;
                // In the plane's space: within a few tolerances of it.
                let back = table.objects[plane.object.0 as usize].transform.inverse();
                let map = back * table.objects[row.object.0 as usize].transform;
                for &corner in corners {
                    let p = map.transform_point3(mesh.position(corner as usize));
                    let off = (plane.normal.dot(p) - plane.offset).abs();
                    assert!(off <= 1e-5 * p.abs().max_element().max(1.0), "a face is {off} m off its plane");
                }
            }
        }
        assert_eq!(entries, table.face_planes.len(), "one entry per triangle of each subobject with planes");
        assert!(used.iter().all(|&faces| faces != 1), "a plane must have at least two faces: {used:?}");
        scene
    }
}

/// Number of planes and of faces in them.
fn count(scene: &Scene) -> (usize, usize) {
    let table = &scene.table;
    (table.planes.len(), table.face_planes.iter().filter(|&&plane| plane != NO_PLANE).count())
}

#[test]
fn markings_share_the_plane_of_the_ground_below_and_only_that_ground() {
    let mut world = World::default();
    world.add(&net(10, |_, _| 0.0));
    world.add(&squares(&[[5.0, 5.0, 0.5, 0.0]]));
    // In the middle of four cells: eight triangles, of which it touches six.
    let scene = world.scene();
    assert_eq!(count(&scene), (1, 2 + 6));
    assert_eq!(scene.table.planes[0].normal, DVec3::Y);
}

#[test]
fn eight_sheets_in_one_place_share_planes_and_a_ninth_above_does_not() {
    let mut world = World::default();
    for _ in 0..8 {
        world.add(&squares(&[[0.0, 0.0, 10.0, 0.0]]));
    }
    world.add(&squares(&[[0.0, 0.0, 10.0, 0.001]]));
    // One for each half of the square: halves that don't overlap need not agree.
    assert_eq!(count(&world.scene()), (2, 16));
}

#[test]
fn faces_of_one_mesh_that_lie_over_each_other_share_a_plane_in_any_layer() {
    let mut world = World::default();
    let shape = world.shape(&[squares(&[[0.0, 0.0, 10.0, 0.0]]), squares(&[[1.0, 0.0, 3.0, 0.0]])]);
    world.put(shape, DAffine3::IDENTITY);
    assert_eq!(count(&world.scene()), (1, 4), "the small one lies on both halves of the large one");
}

#[test]
fn finely_curved_surfaces_have_no_planes() {
    let mut sphere = Primitive::default();
    let (n, m) = (200u32, 100u32);
    for j in 0..=m {
        for i in 0..=n {
            let (s, c) = libm::sincos(f64::from(j) / f64::from(m) * std::f64::consts::PI);
            let (sp, cp) = libm::sincos(f64::from(i) / f64::from(n) * std::f64::consts::TAU);
            sphere.positions.push((dvec3(s * cp, c, s * sp) * 1000.0).as_vec3().to_array());
        }
    }
    for j in 0..m {
        for a in (0..n).map(|i| j * (n + 1) + i) {
            sphere.triangles.extend([[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]]);
        }
    }
    let dish = net(100, |x, z| ((x - 50.0).powi(2) + (z - 50.0).powi(2)) * 1e-7);
    for surface in [sphere, dish, net(60, |_, _| 3.0)] {
        let mut world = World::default();
        world.add(&surface);
        assert_eq!(count(&world.scene()), (0, 0));
    }
}

#[test]
fn faces_that_touch_share_a_plane_unless_their_border_ends_in_the_same_corners() {
    for (name, other, expected) in [
        ("the whole side, corner to corner", [2.0, 0.0, 2.0, 0.0], (0, 0)),
        ("a part of the side", [2.0, 0.5, 2.0, 0.0], (1, 2)),
        // Whose other half touches with a corner.
        ("a smaller one", [1.5, 0.0, 1.0, 0.0], (1, 3)),
        ("a corner", [2.0, 2.0, 2.0, 0.0], (0, 0)),
        ("a hair of a gap", [2.000_001, 0.5, 2.0, 0.0], (1, 2)),
        ("a gap", [2.001, 0.5, 2.0, 0.0], (0, 0)),
        ("a step", [2.0, 0.5, 2.0, 0.001], (0, 0)),
    ] {
        let mut apart = World::default();
        apart.add(&squares(&[[0.0, 0.0, 2.0, 0.0]]));
        apart.add(&squares(&[other]));
        assert_eq!(count(&apart.scene()), expected, "{name}, two objects");
        let mut together = World::default();
        let shape = together.shape(&[squares(&[[0.0, 0.0, 2.0, 0.0]]), squares(&[other])]);
        together.put(shape, DAffine3::IDENTITY);
        assert_eq!(count(&together.scene()), expected, "{name}, one mesh");
        let mut alike = World::default();
        alike.add(&squares(&[[0.0, 0.0, 2.0, 0.0], other]));
        assert_eq!(count(&alike.scene()), (0, 0), "{name}, one primitive");
    }
}

#[test]
fn what_touches_what_lies_over_each_other_joins_its_plane() {
    let mut world = World::default();
    world.add(&squares(&[[0.0, 0.0, 10.0, 0.0], [0.5, -0.4, 2.0, 0.0]]));
    world.add(&squares(&[[8.0, 1.0, 6.0, 0.0], [8.4, 0.7, 1.0, 0.0]]));
    // Two halves and a marking each; of the halves all are linked, over markings and across the border.
    assert_eq!(count(&world.scene()), (1, 8));
}

#[test]
fn a_border_along_a_curve_shares_planes_only_as_far_as_they_are_true() {
    let dish = |z: f64| (z - 50.0).powi(2) * 1e-5;
    let left = net(100, |_, z| dish(z));
    let mut right = net(80, |_, z| dish(z * 1.25));
    right.positions.iter_mut().for_each(|p| *p = [100.0 + p[0], p[1], p[2] * 1.25]);
    // A marking within a triangle at the border, far from where the largest faces are.
    let mut marking = Primitive::default();
    for (x, z) in [(99.3, 0.8), (99.8, 0.9), (99.8, 0.5)] {
        marking.positions.push(dvec3(x, dish(0.0) + (dish(1.0) - dish(0.0)) * z, z).as_vec3().to_array());
    }
    marking.triangles.push([0, 1, 2]);
    let mut world = World::default();
    let whole = world.shape(&[left, right, marking]);
    world.put(whole, DAffine3::IDENTITY);
    let scene = world.scene();
    // That each face is in its plane is checked there.
    let (planes, faces) = count(&scene);
    assert!(planes > 3, "{planes} planes of a curve that is 25 mm deep");
    assert!((150..400).contains(&faces), "{faces} faces at a border of 180");
    assert_eq!(scene.warnings, Vec::<String>::new());
    let table = &scene.table;
    let marking = table.subobjects.iter().rfind(|row| row.primitive == 2).unwrap();
    let plane = table.face_planes[marking.planes.unwrap() as usize];
    assert!(plane != NO_PLANE, "the marking shares the ground's plane");
}

#[test]
fn instances_have_planes_of_their_own_wherever_they_stand() {
    let mut world = World::default();
    let shape = world.shape(&[squares(&[[0.0, 0.0, 10.0, 0.0], [2.0, -1.5, 3.0, 0.0]])]);
    let turn = DQuat::from_rotation_x(0.7) * DQuat::from_rotation_y(2.0);
    for (i, scale) in [DVec3::ONE, dvec3(-1.0, 1.0, 1.0), dvec3(2.0, -3.0, 0.5)].into_iter().enumerate() {
        let place = dvec3(6_378_137.0, 100.0 * i as f64, 0.0);
        world.put(shape, DAffine3::from_scale_rotation_translation(scale, turn, place));
    }
    let scene = world.scene();
    assert_eq!(count(&scene), (3, 12));
    let objects: Vec<u32> = scene.table.planes.iter().map(|plane| plane.object.0).collect();
    assert_eq!(objects, [0, 1, 2]);
}

#[test]
fn a_turned_poster_shares_the_plane_of_a_turned_wall_far_from_the_origin() {
    let turn = DAffine3::from_quat(DQuat::from_rotation_z(1.1) * DQuat::from_rotation_x(0.4));
    let far = DAffine3::from_translation(dvec3(6.0e6, -2.0e6, 1.5e6));
    let mirror = DAffine3::from_scale(dvec3(-1.0, 1.0, 1.0));
    for (name, poster_map, expected) in [
        ("moved within the plane", DAffine3::from_translation(dvec3(1.0, 0.0, -2.0)), (1, 4)),
        ("mirrored, as whose front stays in front", mirror, (1, 4)),
        ("above the plane", DAffine3::from_translation(dvec3(0.0, 0.01, 0.0)), (0, 0)),
    ] {
        let mut world = World::default();
        let wall = world.shape(&[squares(&[[0.0, 0.0, 10.0, 0.0]])]);
        let poster = world.shape(&[squares(&[[0.1, 0.2, 2.0, 0.0]])]);
        world.put(wall, far * turn);
        world.put(poster, far * turn * poster_map);
        assert_eq!(count(&world.scene()), expected, "{name}");
    }
}

#[test]
fn what_moves_shares_planes_within_itself_only() {
    let mut world = World::default();
    world.add(&squares(&[[0.0, 0.0, 10.0, 0.0]]));
    let lorry = world.add(&squares(&[[0.0, 0.0, 4.0, 0.0], [0.5, -0.3, 1.0, 0.0]]));
    lorry.extras.is_static = Some(false);
    let scene = world.scene();
    assert_eq!(count(&scene), (1, 4));
    assert_eq!(scene.table.subobjects[0].planes, None);
}

#[test]
fn versions_of_a_model_are_not_compared_and_its_surroundings_are() {
    let mut world = World::default();
    world.add(&squares(&[[100.0, 0.0, 10.0, 0.0]]));
    for version in 0..2 {
        let node = world.add(&squares(&[[0.0, 0.0, 10.0, 0.0]]));
        node.version = Some(version);
        if version == 0 {
            node.levels = 2;
        } else {
            node.parent = Some(1);
        }
    }
    assert_eq!(count(&world.scene()), (0, 0));
}

#[test]
fn back_to_back_needs_no_plane_unless_one_is_seen_from_behind() {
    for (double_sided, expected) in [(false, (0, 0)), (true, (2, 4))] {
        let mut world = World::default();
        world.add(&squares(&[[0.0, 0.0, 10.0, 0.0]]));
        let mut back = squares(&[[0.0, 0.0, 10.0, 0.0]]);
        back.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
        back.material = Material { double_sided, ..Material::default() };
        world.add(&back);
        assert_eq!(count(&world.scene()), expected, "double-sided: {double_sided}");
    }
}

#[test]
fn a_heap_of_coinciding_faces_ends_and_is_admitted() {
    let mut world = World::default();
    let sheet = squares(&[[0.0, 0.0, 1.0, 0.0]]);
    let triangles = sheet.triangles.iter().copied().cycle().take(20_000).collect();
    world.add(&Primitive { triangles, ..sheet });
    let scene = world.scene();
    assert!(scene.warnings.iter().any(|warning| warning.contains("may flicker")), "{:?}", scene.warnings);
    assert!(!scene.table.planes.is_empty());
}

#[test]
fn numbers_at_the_end_of_their_range_do_no_harm() {
    for size in [1e-38, 1e-20, 1e12, 1e37] {
        let mut world = World::default();
        let sheet = squares(&[[0.0, 0.0, size, 0.0], [0.0, 0.0, size / 2.0, 0.0]]);
        world.add(&sheet);
        world.add(&sheet);
        let flat = world.shape(&[sheet]);
        world.put(flat, DAffine3::from_scale(dvec3(1.0, 0.0, 1.0)));
        world.put(flat, DAffine3::from_scale(DVec3::ZERO));
        Scene::assemble(world.parts).unwrap();
    }
}
