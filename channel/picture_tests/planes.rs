//! Layers of one plane: who wins where faces coincide, when the plane holds, and when it can't be used.

use super::{ALL_SAMPLES, assert_near, wall};
use crate::geometry::camera::Camera;
use crate::oracle::*;
use crate::pipeline::Renderer;
use crate::store::SceneStore;
use glam::{DAffine3, DQuat, DVec3};
use proto::frame::{FrameState, Moved};
use proto::ids::{ObjectId, SubobjectId};
use proto::scene::{Mesh, NO_PLANE, PlaneRow, SceneTable};
use proto::share::Part;
use proto::view::{Samples, View};
use std::num::NonZeroUsize;

/// Colour number k of eight, all different.
pub(crate) fn colour(k: usize) -> [f32; 4] {
    [(k % 2) as f32, (k / 2 % 2) as f32, 0.125 + 0.125 * k as f32, 1.0]
}

/// A rectangle in the ground plane y = 0 of its mesh, front upwards: x0..x1 × z0..z1, in strips across so that its
/// vertices are others than its neighbours'.
pub(crate) fn patch([x0, x1]: [f64; 2], [z0, z1]: [f64; 2], strips: u32, color: [f32; 4]) -> Mesh {
    let z = |k: u32| z0 + (z1 - z0) * f64::from(k) / f64::from(strips);
    let strip = |k: u32| rectangle(DVec3::new(x0, 0.0, z(k)), DVec3::Z * (z(k + 1) - z(k)), DVec3::X * (x1 - x0));
    mesh_of(&(0..strips).flat_map(strip).collect::<Vec<_>>(), color)
}

/// All faces of all meshes lie in the ground plane of object 0; layers as given.
pub(crate) fn ground(table: &mut SceneTable, faces: &[usize], layers: &[i32]) {
    table.planes = vec![PlaneRow { object: ObjectId(0), normal: DVec3::Y, offset: 0.0 }];
    for ((row, faces), layer) in table.subobjects.iter_mut().zip(faces).zip(layers) {
        row.planes = Some(table.face_planes.len() as u32);
        row.layer = *layer;
        table.face_planes.extend(vec![0; *faces]);
    }
}

/// A runway of 3 km times `scale` with seven layers of markings, each in a tessellation of its own. In the file in this order, whatever their layers.
pub(crate) fn runway(scale: f64) -> Vec<(Mesh, i32)> {
    let mut random = Random(8);
    let patch = |[x0, x1]: [f64; 2], [z0, z1]: [f64; 2], strips, color| {
        patch([x0 * scale, x1 * scale], [z0 * scale, z1 * scale], strips, color)
    };
    let mut parts = vec![(patch([-30.0, 30.0], [-3000.0, 0.0], 7, colour(0)), 0)];
    for layer in [3, 1, 7, 2, 6, 4, 5] {
        let [x, z] = [random.signed() * 15.0, -1500.0 + random.signed() * 300.0];
        let [half_x, half_z] = [14.0 - f64::from(layer), 1100.0 - 100.0 * f64::from(layer)];
        let strips = 1 + random.below(9) as u32;
        let mesh = patch([x - half_x, x + half_x], [z - half_z, z + half_z], strips, colour(layer as usize));
        parts.push((mesh, layer));
    }
    parts
}

/// A store of parts that lie in one plane.
pub(crate) fn store_of_ground(parts: &[(Mesh, i32)]) -> SceneStore {
    let meshes = parts.iter().map(|(mesh, _)| (mesh.clone(), DAffine3::IDENTITY)).collect();
    let faces: Vec<_> = parts.iter().map(|(mesh, _)| mesh.triangles.len()).collect();
    let layers: Vec<_> = parts.iter().map(|(_, layer)| *layer).collect();
    store_with(meshes, |table| ground(table, &faces, &layers))
}

/// What parts of one plane look like when they are painted by layers.
pub(crate) fn painted(state: &FrameState, view: &View, parts: &[(Mesh, i32)]) -> Vec<[f64; 3]> {
    let mut sorted: Vec<_> = parts.iter().collect();
    sorted.sort_by_key(|(_, layer)| *layer);
    let faces = sorted.iter().flat_map(|(mesh, _)| {
        let color = mesh.material.base_color;
        let corners = corners_at_eye(state, view, mesh, &DAffine3::IDENTITY);
        corners.into_iter().map(move |corners| OracleFace { corners, color })
    });
    paint_by_force(view, &faces.collect::<Vec<_>>())
}

/// An eye that looks at the middle of the runway of that scale from `distance` metres along it and `height` above, slightly aside and banked.
pub(crate) fn eye_at(distance: f64, height: f64, scale: f64) -> FrameState {
    let mut state = state();
    let target = DVec3::new(1.0, 0.0, -1500.0) * scale;
    let position = DVec3::new(0.013 * distance, height, target.z + distance);
    let up = DVec3::new(0.1, 1.0, 0.02);
    state.eye = proto::view::Pose::looking_at(position, target, up).unwrap();
    state
}

/// A view that is about as wide as the runway's middle seen from that distance.
pub(crate) fn telescope(distance: f64, samples: Samples) -> View {
    let half = 60.0 / distance.max(100.0);
    View {
        tangents: proto::view::Tangents { left: -half, right: half, bottom: -half / 2.0, top: half / 2.0 },
        ..view(96, 48, samples)
    }
}

#[test]
fn markings_seen_at_half_a_degree_from_ten_kilometres_are_painted_by_layer() {
    let parts = runway(1.0);
    let store = store_of_ground(&parts);
    for samples in ALL_SAMPLES {
        let state = eye_at(10_000.0, 10_000.0 * libm::tan(0.5f64.to_radians()), 1.0);
        let view = telescope(10_000.0, samples);
        let expected = painted(&state, &view, &parts);
        let picture = draw(&store, &state, &view);
        let colours = picture.linear.iter().map(|c| c[2].to_bits()).collect::<std::collections::BTreeSet<_>>().len();
        assert!(colours >= 8, "all layers are seen: {colours}");
        for (drawn, expected) in picture.linear.iter().zip(expected) {
            assert_near(*drawn, expected, 1e-6);
        }
    }
}

#[test]
fn in_one_layer_the_later_primitive_wins_and_in_one_primitive_the_later_face() {
    let patch_of = |k| patch([-5.0, 5.0], [-9.0, -1.0], 1 + k as u32 % 3, colour(k));
    let mut state = state();
    state.eye.position = DVec3::new(0.3, 2.0, 0.7);
    state.eye.orientation = DQuat::from_rotation_x(-0.5);
    let picture = |first: (i32, u32), second: (i32, u32), swap_faces: bool| {
        let meshes: Vec<_> = (0..2)
            .map(|k| {
                let mut mesh = patch_of(k);
                if swap_faces {
                    // Pieces of one primitive: the first has the later faces.
                    mesh.face_numbers = (0..mesh.triangles.len() as u32).map(|f| f + 100 * (1 - k as u32)).collect();
                }
                (mesh, DAffine3::IDENTITY)
            })
            .collect();
        let faces: Vec<_> = meshes.iter().map(|(m, _)| m.triangles.len()).collect();
        let store = store_with(meshes, |table| {
            ground(table, &faces, &[first.0, second.0]);
            (table.subobjects[0].primitive, table.subobjects[1].primitive) = (first.1, second.1);
        });
        let mut renderer = Renderer::new(NonZeroUsize::MIN).unwrap();
        let view = view(32, 32, Samples::Sixteen);
        let [forth, back] = [[0, 1], [1, 0]]
            .map(|list| draw_with(&mut renderer, &store, &state, &view, &list.map(SubobjectId), &[Part::WHOLE]));
        assert_eq!(forth, back, "the list has no say");
        forth.at(16, 20)
    };
    let [a, b] = [0, 1].map(|k| [colour(k)[0], colour(k)[1], colour(k)[2]]);
    assert_eq!(picture((0, 0), (0, 1), false), b);
    assert_eq!(picture((0, 1), (0, 0), false), a);
    assert_eq!(picture((1, 0), (0, 1), false), a);
    assert_eq!(picture((-1, 5), (i32::MIN, 9), false), a);
    assert_eq!(picture((0, 3), (0, 3), true), a, "one primitive in two pieces");
}

#[test]
fn a_plane_holds_while_nothing_moves_or_all_of_it_is_one_object() {
    // Two objects; the marking is in the runway's plane, but a little too low by its own vertices.
    let low = DAffine3::from_translation(DVec3::new(0.0, -0.01, 0.0));
    let parts = [patch([-5.0, 5.0], [-9.0, -1.0], 1, colour(0)), patch([-4.0, 4.0], [-8.0, -2.0], 3, colour(1))];
    let faces = [2, 6];
    let meshes = vec![(parts[0].clone(), DAffine3::IDENTITY), (parts[1].clone(), low)];
    let mut store = store_with(meshes, |table| ground(table, &faces, &[0, 1]));
    let mut state = state();
    state.eye.position = DVec3::new(0.0, 2.0, 0.0);
    state.eye.orientation = DQuat::from_rotation_x(-0.4);
    let red = |store: &SceneStore| draw(store, &state, &view(32, 32, Samples::Four)).at(16, 18)[0];
    assert_eq!(red(&store), 1.0, "the marking has the runway's depth");
    let moved = |object, by: f64| Moved {
        object: ObjectId(object),
        transform: DAffine3::from_translation(DVec3::new(0.0, by, 0.0)),
    };
    store.set_moved(&[moved(1, -0.02)]).unwrap();
    assert_eq!(red(&store), 0.0, "a marking that was moved has its own depth");
    store.set_moved(&[moved(0, 0.5)]).unwrap();
    assert_eq!(red(&store), 0.0, "a runway that was moved leaves its marking behind");
    store.set_moved(&[moved(0, 0.0)]).unwrap();
    assert_eq!(red(&store), 1.0, "moved to where it is");
    // One object for both: wherever it is.
    let meshes = parts.iter().map(|m| (m.clone(), DAffine3::IDENTITY)).collect();
    let mut store = store_with(meshes, |table| {
        ground(table, &faces, &[1, 0]);
        table.subobjects[1].object = ObjectId(0);
    });
    assert_eq!(red(&store), 0.0);
    store.set_moved(&[moved(0, 0.5)]).unwrap();
    assert_eq!(red(&store), 0.0, "the higher layer, though earlier in the file");
}

#[test]
fn what_stands_on_a_plane_hides_it_and_is_hidden_by_it() {
    let parts = runway(1.0);
    let mut meshes: Vec<_> = parts.iter().map(|(mesh, _)| (mesh.clone(), DAffine3::IDENTITY)).collect();
    // A wall across the runway, half of it below the ground.
    let across = rectangle(DVec3::new(-40.0, -4.0, -1500.0), DVec3::X * 80.0, DVec3::Y * 8.0);
    meshes.push((mesh_of(&across, [1.0, 1.0, 1.0, 1.0]), DAffine3::IDENTITY));
    let faces: Vec<_> = parts.iter().map(|(mesh, _)| mesh.triangles.len()).collect();
    let layers: Vec<_> = parts.iter().map(|(_, layer)| *layer).collect();
    let store = store_with(meshes, |table| ground(table, &faces, &layers));
    let bare = store_of_ground(&parts);
    for distance in [100.0, 1000.0, 20_000.0] {
        let state = eye_at(distance, distance * 0.02, 1.0);
        let view = telescope(distance, Samples::One);
        let [with, without] = [&store, &bare].map(|store| draw(store, &state, &view));
        let camera = Camera::new(&state, &view);
        let mut seen = [0; 2];
        for (i, (with, without)) in with.linear.iter().zip(&without.linear).enumerate() {
            let [x, y] = [i % 96, i / 96].map(|c| c as i32 * 256 + 128);
            let ray = camera.ray_world(camera.ray(x, y));
            let hit = state.eye.position + ray * ((-1500.0 - state.eye.position.z) / ray.z);
            // Half a sub-pixel of the view at that distance is 2.5 mm.
            let margin = 0.01;
            let on_ground = state.eye.position + ray * (-state.eye.position.y / ray.y);
            let is_below = hit.y < -margin && on_ground.x.abs() < 30.0 - margin;
            if hit.x.abs() > 40.0 + margin || hit.y > 4.0 + margin || is_below {
                assert_eq!(with, without, "{distance} m, pixel {i}: {hit}");
                seen[0] += 1;
            } else if hit.x.abs() < 40.0 - margin && hit.y > margin && hit.y < 4.0 - margin {
                assert_eq!(*with, [1.0; 3], "{distance} m, pixel {i}: {hit}");
                seen[1] += 1;
            }
        }
        assert!(seen[0] > 500 && seen[1] > 100, "{distance} m: {seen:?}");
    }
}

#[test]
fn layers_that_pass_under_the_eye_are_cut_at_the_near_plane_and_keep_their_order() {
    // Half-widths of nested rectangles from 50 m behind to 400 m ahead, the upper ones narrower; their strips are all others.
    let half = |k: usize| 8.0 - k as f64;
    let ends = |k: usize| [400.0 - 30.0 * k as f64, -50.0 + 3.0 * k as f64];
    let parts: Vec<_> = [5, 0, 3, 6, 1, 4, 2]
        .map(|k| (patch([-half(k), half(k)], [-ends(k)[0], -ends(k)[1]], 1 + 2 * k as u32, colour(k)), k as i32))
        .into();
    let store = store_of_ground(&parts);
    let mut random = Random(0x0CA2);
    let mut compared = 0;
    for round in 0..20 {
        let mut state = state();
        state.eye.position = DVec3::new(random.signed() * 3.0, 0.2 + random.unit() * 3.0, 0.0);
        state.eye.orientation = DQuat::from_rotation_x(-0.5 * random.unit()) * DQuat::from_rotation_z(random.signed());
        let view = view(64, 48, Samples::One);
        let picture = draw(&store, &state, &view);
        let camera = Camera::new(&state, &view);
        for (i, drawn) in picture.linear.iter().enumerate() {
            let [x, y] = [i % 64, i / 64].map(|c| c as i32 * 256 + 128);
            let ray = camera.ray_world(camera.ray(x, y));
            let hit = state.eye.position + ray * (-state.eye.position.y / ray.y);
            // Half a sub-pixel on the ground grows with the square of the distance.
            let margin = 1e-3 + hit.distance_squared(state.eye.position) * 1e-4 / state.eye.position.y;
            let inside = |k: &usize, by: f64| {
                hit.x.abs() < half(*k) + by && -hit.z < ends(*k)[0] + by && -hit.z > ends(*k)[1] - by
            };
            let [least, most] = [-margin, margin].map(|by| (0..7).rev().find(|k| inside(k, by)));
            if ray.y < -1e-3 && least == most {
                let expected = least.map_or([0.0; 3], |k| [0, 1, 2].map(|c| colour(k)[c]));
                assert_eq!(*drawn, expected, "round {round}, pixel {i}: {hit}");
                compared += usize::from(least.is_some());
            }
        }
    }
    assert!(compared > 5000, "{compared} pixels were compared");
}

#[test]
fn planes_and_parts_that_the_table_lacks_are_refused_and_faces_without_one_are_ordinary() {
    use crate::store::StoreError;
    let mesh = wall(2.0, [1.0; 4]);
    let table = |change: fn(&mut SceneTable)| {
        let mut store = SceneStore::new();
        store.insert_mesh(content(0), mesh.clone()).unwrap();
        let mut table = place(&[(content(0), DAffine3::IDENTITY)]);
        table.planes = vec![PlaneRow { object: ObjectId(0), normal: DVec3::Z, offset: -2.0 }];
        table.subobjects[0].planes = Some(0);
        table.face_planes = vec![0, 0];
        change(&mut table);
        store.set_table(table).map(|()| store)
    };
    let refused = |change| table(change).map(|_| ()).unwrap_err();
    assert_eq!(refused(|t| t.planes[0].object = ObjectId(1)), StoreError::Plane { plane: 0 });
    assert_eq!(refused(|t| t.planes[0].offset = f64::NAN), StoreError::Plane { plane: 0 });
    assert_eq!(refused(|t| t.face_planes[1] = 1), StoreError::FacePlane { plane: 1, planes: 1 });
    assert_eq!(
        refused(|t| t.subobjects[0].planes = Some(3)),
        StoreError::FacePlanes { subobject: 0, begin: 3, found: 2 }
    );
    // No plane, one that is nonsense (through the eye), too few: the faces' own depths.
    let changes: [fn(&mut SceneTable); 4] = [
        |t| t.face_planes.fill(NO_PLANE),
        |t| t.planes[0].offset = 0.0,
        |t| t.planes[0].normal = DVec3::ZERO,
        |t| t.face_planes.truncate(1),
    ];
    for change in changes {
        let store = table(change).unwrap();
        assert_eq!(draw(&store, &state(), &view(8, 8, Samples::Four)).at(3, 3), [1.0; 3]);
    }
}
