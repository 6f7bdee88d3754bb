//! Who is in front: coinciding, crossing, encircling and countless faces.

use super::{
    Comparison, against_the_sampler, as_f64, random_color, random_vector, report, seen_faces, snapped, store_of_faces,
};
use crate::oracle::*;
use crate::picture_tests::ALL_SAMPLES;
use crate::picture_tests::planes::{eye_at, painted, runway, store_of_ground, telescope};
use crate::pipeline::Renderer;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use proto::frame::FrameState;
use proto::ids::ObjectId;
use proto::scene::PlaneRow;
use proto::share::Part;
use proto::view::{Pose, Samples, View};
use std::num::NonZeroUsize;

#[test]
fn eight_coplanar_layers_at_grazing_angles_from_ten_metres_to_fifty_kilometres() {
    for (distance, height) in [
        (10.0, 0.1),
        (10.0, 1.0),
        (100.0, 1.0),
        (1000.0, 1.5),
        (2000.0, 0.5),
        (10_000.0, 87.3),
        (10_000.0, 1.5),
        (50_000.0, 436.0),
        (50_000.0, 20.0),
        (50_000.0, 1.5),
    ] {
        let mut total = Comparison::default();
        let mut own = Comparison::default();
        // All of it must lie ahead of the near plane: the sampler knows whole faces only.
        let scale = f64::min(1.0, distance / 2000.0);
        let parts = runway(scale);
        let with = store_of_ground(&parts);
        let without = store_of(parts.iter().map(|(m, _)| (m.clone(), DAffine3::IDENTITY)).collect());
        for samples in ALL_SAMPLES {
            let state = eye_at(distance, height, scale);
            let view = telescope(distance / scale, samples);
            let expected = painted(&state, &view, &parts);
            total.add(&draw(&with, &state, &view), &expected);
            own.add(&draw(&without, &state, &view), &expected);
        }
        let case = format!("eight coplanar layers from {distance} m, {height} m above");
        report(&case, "by layer, exactly", &format!("{total} (by their own depths: {} pixels)", own.unlike));
        assert_eq!(total.unlike, 0, "{case}: {total}");
    }
}

#[test]
fn coplanar_layers_in_any_plane_of_any_object() {
    // Rotated, scaled, mirrored, sheared, far away: the plane is the object's, wherever that is.
    let mut random = Random(0xC0);
    let mut total = Comparison::default();
    let mut seen = 0;
    for round in 0..120 {
        let normal = random_vector(&mut random).normalize();
        let (u, v) = normal.any_orthonormal_pair();
        let offset = random.signed() * 3.0;
        let scale = [1e-3, 1.0, 1e4][round % 3];
        let matrix = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, random_vector(&mut random).normalize()))
            * DMat3::from_diagonal(DVec3::new(1.0, [1.0, -2.0][round % 2], 0.7))
            * scale;
        let eye = random_vector(&mut random) * 1e3;
        // Ahead of the eye by a few times its size.
        let centre = normal * offset;
        let transform =
            DAffine3 { matrix3: matrix, translation: eye + DVec3::new(0.1, -0.2, -9.0) * scale - matrix * centre };
        let meshes: Vec<_> = (0..8)
            .map(|k| {
                let [a, b] = [random.signed() * 0.5, random.signed() * 0.5];
                let size = 2.5 - 0.2 * f64::from(k);
                let corner = centre + u * (a - size) + v * (b - size);
                let mut mesh =
                    mesh_of(&rectangle(corner, u * 2.0 * size, v * 2.0 * size), random_color(&mut random, 1.0));
                mesh.material.double_sided = true;
                mesh
            })
            .collect();
        let mut state = state();
        state.eye.position = eye;
        let view = View { near: 0.01 * scale, ..view(32, 24, ALL_SAMPLES[round % 5]) };
        let faces: Vec<_> = meshes.iter().flat_map(|mesh| seen_faces(&state, &view, mesh, &transform)).collect();
        let expected = paint_by_force(&view, &faces);
        let store = store_with(meshes.into_iter().map(|m| (m, transform)).collect(), |table| {
            table.planes = vec![PlaneRow { object: ObjectId(3), normal, offset }];
            table.face_planes = vec![0; 16];
            table.subobjects.iter_mut().enumerate().for_each(|(k, row)| row.planes = Some(2 * k as u32));
        });
        total.add(&draw(&store, &state, &view), &expected);
        seen += usize::from(expected.iter().flatten().any(|c| *c > 0.0));
    }
    report(
        "eight coplanar layers, objects turned, mirrored, scaled by 1e-3 to 1e4",
        "by layer, exactly",
        &total.to_string(),
    );
    assert_eq!(total.unlike, 0, "{total}");
    assert!(seen > 60, "{seen} rounds show something");
}

#[test]
fn interpenetrating_faces() {
    let mut random = Random(0x1E);
    let mut total = Comparison::default();
    for round in 0..50 {
        let view = view(40, 30, ALL_SAMPLES[round % 5]);
        let faces: Vec<_> = (0..8)
            .map(|k| {
                let centre = random_vector(&mut random) * 0.2 - DVec3::Z * 3.0;
                let corners = std::array::from_fn(|_| snapped(centre + random_vector(&mut random) * 2.0));
                OracleFace { corners, color: random_color(&mut random, [1.0, 0.5, 1.0][(k + round) % 3]) }
            })
            .collect();
        let comparison = against_the_sampler(&view, &faces);
        total.pixels += comparison.pixels;
        total.unlike += comparison.unlike;
        total.largest = total.largest.max(comparison.largest);
    }
    report("interpenetrating faces, opaque and translucent", "the sampler's picture", &total.to_string());
    assert_eq!(total.unlike, 0, "{total}");
}

#[test]
fn three_faces_each_over_the_next() {
    let blade = |k: usize, alpha: f32| {
        let turn = |p: DVec3| DQuat::from_rotation_z(std::f64::consts::TAU / 3.0 * k as f64) * p;
        let corners = [DVec3::new(-1.6, 0.2, -2.6), DVec3::new(1.6, 0.2, -3.4), DVec3::new(1.6, 0.8, -3.4)];
        let mut color = [0.0, 0.0, 0.0, alpha];
        color[k] = 1.0;
        OracleFace { corners: corners.map(|p| snapped(turn(p))), color }
    };
    for alpha in [1.0, 0.5] {
        let faces = [0, 1, 2].map(|k| blade(k, alpha));
        let mut total = Comparison::default();
        for samples in ALL_SAMPLES {
            let comparison = against_the_sampler(&view(64, 64, samples), &faces);
            total.pixels += comparison.pixels;
            total.unlike += comparison.unlike;
            total.largest = total.largest.max(comparison.largest);
        }
        report(&format!("cyclic overlap of three, saturation {alpha}"), "the sampler's picture", &total.to_string());
        assert_eq!(total.unlike, 0, "{alpha}: {total}");
    }
}

/// A pane right across the view at about `distance`, tilted.
fn pane(random: &mut Random, distance: f64, tilt: f64, color: [f32; 4]) -> OracleFace {
    let [a, b] = [random.signed() * tilt, random.signed() * tilt];
    let at = |x: f64, y: f64| snapped(DVec3::new(x, y, -distance - a * x - b * y));
    let d = distance * 1.5;
    OracleFace { corners: [at(-d, -d), at(3.0 * d, -d), at(-d, 3.0 * d)], color }
}

#[test]
fn a_thousand_translucent_layers_in_random_order() {
    for (name, tilt) in [("parallel", 0.0), ("crossing", 0.01)] {
        let mut random = Random(1000);
        let mut faces: Vec<_> = (0..1000)
            .map(|k| {
                let alpha = 0.004 + 0.004 * random.unit() as f32;
                let color = random_color(&mut random, alpha);
                pane(&mut random, 2.0 + 0.003 * f64::from(k), tilt, color)
            })
            .collect();
        for i in (1..faces.len()).rev() {
            faces.swap(i, random.below(i as u64 + 1) as usize);
        }
        let comparison = against_the_sampler(&view(8, 6, Samples::SixtyFour), &faces);
        report(
            &format!("1000 translucent layers in random order, {name}"),
            "the sampler's picture",
            &comparison.to_string(),
        );
        assert_eq!(comparison.unlike, 0, "{name}: {comparison}");
    }
}

/// A ball about the eye's axis, its faces towards the eye; the sampler's faces and a mesh.
fn ball(radius: f64, color: [f32; 4]) -> Vec<OracleFace> {
    let at = |i: u32, j: u32| {
        let (e, a) = (std::f64::consts::PI * f64::from(i) / 10.0, std::f64::consts::TAU * f64::from(j % 20) / 20.0);
        let ring = libm::sin(e) * radius;
        snapped(DVec3::new(ring * libm::cos(a), radius * libm::cos(e), ring * libm::sin(a) - 5.0))
    };
    let cell = |i, j| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]];
    (0..10).flat_map(|i| (0..20).flat_map(move |j| cell(i, j))).map(|corners| OracleFace { corners, color }).collect()
}

#[test]
fn nested_spheres_in_any_order() {
    let mut random = Random(0x5EE);
    let faces: Vec<_> = (0..12)
        .flat_map(|k| ball(2.6 - 0.2 * f64::from(k), random_color(&mut random, if k == 11 { 1.0 } else { 0.2 })))
        .collect();
    let store = store_of_faces(&faces);
    let view = view(24, 24, Samples::Four);
    let standard = draw(&store, &state(), &view);
    let comparison = Comparison::of(&standard, &sample_by_force(&view, &faces));
    report("12 nested spheres", "the sampler's picture", &comparison.to_string());
    assert_eq!(comparison.unlike, 0, "{comparison}");
    // Alternately from the inside and from the outside, and back to front.
    let list = everything(&store);
    let mut renderer = Renderer::new(NonZeroUsize::MIN).unwrap();
    let mut alternate = Vec::new();
    for k in 0..6 {
        alternate.extend(&list[k * 400..(k + 1) * 400]);
        alternate.extend(&list[(11 - k) * 400..(12 - k) * 400]);
    }
    let reversed: Vec<_> = list.iter().rev().copied().collect();
    for list in [alternate, reversed] {
        let picture = draw_with(&mut renderer, &store, &state(), &view, &list, &[Part::WHOLE]);
        assert_eq!(Comparison::of(&picture, &as_f64(&standard)).largest, 0.0);
    }
}

#[test]
fn parallel_faces_keep_their_order() {
    // A millimetre apart at 10 m, ten metres apart at 10 km: never the farther one, whatever the slope.
    let mut random = Random(0x9A);
    let mut wrong = 0;
    for round in 0..60 {
        let (distance, gap) = [(10.0, 0.001), (10_000.0, 10.0)][round % 2];
        let slope = random.signed() * 0.3;
        let across = DVec3::new(1.0, 0.0, random.signed() * 0.3) * distance * 4.0;
        let up = DVec3::new(0.0, 1.0, slope) * distance * 0.2;
        let start = DVec3::new(0.0, 0.0, -distance) - (across + up) * 0.5;
        let front = mesh_of(&rectangle(start, across, up), [0.0, 1.0, 0.0, 1.0]);
        let normal = across.cross(up).normalize();
        let shift = normal * gap * -normal.dot(DVec3::new(0.0, 0.0, distance)).signum();
        let back =
            mesh_of(&rectangle(start + (up + across) * 0.05 + shift, across * 0.9, up * 0.9), [1.0, 0.0, 0.0, 1.0]);
        let meshes = [front, back].map(|mut mesh| {
            mesh.material.double_sided = true;
            (mesh, DAffine3::IDENTITY)
        });
        let mut meshes = meshes.to_vec();
        if round % 4 < 2 {
            meshes.reverse();
        }
        let state = FrameState { eye: Pose::IDENTITY, ..state() };
        let picture = draw(&store_of(meshes), &state, &view(48, 48, ALL_SAMPLES[round % 5]));
        wrong += picture.linear.iter().filter(|c| c[0] > 0.0).count();
    }
    report(
        "parallel faces 1 mm apart at 10 m, 10 m apart at 10 km",
        "never swapped",
        &format!("{wrong} pixels show the rear one"),
    );
    assert_eq!(wrong, 0);
}
