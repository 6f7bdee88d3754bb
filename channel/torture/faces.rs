//! Faces that are hardly any: slivers, points, edge-on planes, vertices on and behind the eye; and too many at once.

use super::{Comparison, against_the_sampler, as_f64, random_color, random_vector, report, snapped, store_of_faces};
use crate::oracle::*;
use crate::picture_tests::{ALL_SAMPLES, at_origin, wall};
use glam::{DAffine3, DQuat, DVec3};
use proto::ids::ObjectId;
use proto::scene::PlaneRow;
use proto::view::{Samples, View};

#[test]
fn slivers_ten_million_times_as_long_as_wide() {
    let mut random = Random(1e7 as u64);
    let mut total = Comparison::default();
    for round in 0..60 {
        let view = view(40, 30, ALL_SAMPLES[round % 5]);
        let faces: Vec<_> = (0..60)
            .map(|k| {
                let from = DVec3::new(random.signed() * 3.0, random.signed() * 3.0, -1.0 - random.unit() * 3.0);
                let to = DVec3::new(random.signed() * 3.0, random.signed() * 3.0, -1.0 - random.unit() * 3.0);
                let beside = from + (to - from) * random.unit() + random_vector(&mut random) * 1e-7 * from.distance(to);
                OracleFace {
                    corners: [from, to, beside].map(snapped),
                    color: random_color(&mut random, [1.0, 0.5][k % 2]),
                }
            })
            .collect();
        let comparison = against_the_sampler(&view, &faces);
        total.pixels += comparison.pixels;
        total.unlike += comparison.unlike;
        total.largest = total.largest.max(comparison.largest);
    }
    report("slivers, aspect 1e7", "the sampler's picture", &total.to_string());
    assert_eq!(total.unlike, 0, "{total}");
}

#[test]
fn faces_without_area_and_repeated_vertices_are_nothing() {
    let mut random = Random(3);
    let mut faces: Vec<_> = (0..12)
        .map(|k| {
            let centre = random_vector(&mut random) * 2.0 - DVec3::Z * 4.0;
            let corners = std::array::from_fn(|_| snapped(centre + random_vector(&mut random)));
            OracleFace { corners, color: random_color(&mut random, [1.0, 0.5][k % 2]) }
        })
        .collect();
    for samples in ALL_SAMPLES {
        let view = view(40, 30, samples);
        let without = draw(&store_of_faces(&faces), &state(), &view);
        let count = faces.len();
        for k in 0..30 {
            let [a, b] =
                [random_vector(&mut random), random_vector(&mut random)].map(|v| snapped(v * 2.0 - DVec3::Z * 4.0));
            let middle = a + (b - a) * 0.5;
            let corners = [[a, a, b], [a, b, a], [b, a, a], [a, a, a], [a, middle, b]][k % 5];
            faces.push(OracleFace { corners, color: [1.0; 4] });
        }
        // The collinear ones may become a sub-pixel wide when they are rounded, hence the sampler; the others are nothing.
        let comparison = against_the_sampler(&view, &faces);
        assert_eq!(comparison.unlike, 0, "{samples:?}: {comparison}");
        let repeated: Vec<_> =
            faces.iter().enumerate().filter(|(k, _)| *k < count || (*k - count) % 5 < 4).map(|(_, f)| *f).collect();
        assert_eq!(draw(&store_of_faces(&repeated), &state(), &view), without, "{samples:?}");
        faces.truncate(count);
    }
    report("zero-area faces, repeated vertices", "as if they weren't there", "the same bytes");
}

#[test]
fn a_million_faces_in_one_pixel() {
    // 500 crowds of 2000 crumbs each, crowd k a millimetre before crowd k + 1, around pixel (8, 7).
    let mut random = Random(1_000_000);
    let crumbs: Vec<[DVec3; 3]> = (0..2000)
        .map(|_| {
            let centre = DVec3::new(0.0625 + random.signed() * 0.06, 0.0625 + random.signed() * 0.06, -1.0);
            std::array::from_fn(|_| snapped(centre + DVec3::new(random.signed(), random.signed(), 0.0) * 0.03))
        })
        .collect();
    let crowd = |k: u32| {
        let mut mesh = mesh_of(&crumbs, [1.0 - k as f32 / 500.0, k as f32 / 500.0, 1.0, 1.0]);
        mesh.material.double_sided = true;
        (mesh, DAffine3::from_translation(DVec3::Z * f64::from(k) * -1e-3))
    };
    let store = store_of((0..500).rev().map(crowd).collect());
    let picture = draw(&store, &state(), &view(16, 16, Samples::SixtyFour));
    assert_eq!(picture.at(8, 7), [1.0, 0.0, 1.0], "the nearest crowd covers the pixel");
    assert!(picture.linear.iter().all(|c| c[2] <= 1.0), "no sample counts twice");
    report("a million faces in one pixel", "the nearest", "the nearest");
}

#[test]
fn vertices_on_the_near_plane_on_the_eye_and_behind() {
    let mut random = Random(0x0E1E);
    // Corners exactly on the near plane are not cut.
    let mut total = Comparison::default();
    for round in 0..30 {
        let view = View { near: 0.25, ..view(40, 30, ALL_SAMPLES[round % 5]) };
        let faces: Vec<_> = (0..12)
            .map(|k| {
                let corners = std::array::from_fn(|c| {
                    let p = snapped(random_vector(&mut random) * 0.5);
                    DVec3::new(p.x, p.y, if c <= k % 3 { -0.25 } else { -0.25 - p.z.abs() })
                });
                OracleFace { corners, color: random_color(&mut random, [1.0, 0.5][k % 2]) }
            })
            .collect();
        let comparison = against_the_sampler(&view, &faces);
        total.pixels += comparison.pixels;
        total.unlike += comparison.unlike;
        total.largest = total.largest.max(comparison.largest);
    }
    assert_eq!(total.unlike, 0, "{total}");
    report("vertices on the near plane", "the sampler's picture", &total.to_string());

    // A vertex on the eye: the face is seen edge on, and nothing of it.
    let on_eye: Vec<_> = (0..50)
        .map(|_| {
            let [a, b] = [random_vector(&mut random), random_vector(&mut random)].map(|v| snapped(v * 5.0));
            OracleFace { corners: [DVec3::ZERO, a, b], color: [1.0; 4] }
        })
        .collect();
    for samples in ALL_SAMPLES {
        let picture = draw(&store_of_faces(&on_eye), &state(), &view(64, 64, samples));
        let seen = picture.linear.iter().map(|c| f64::from(c[0])).sum::<f64>() * samples.count() as f64;
        // A line thinner than a sub-pixel may still be rounded onto a sample.
        assert!(seen <= 50.0, "{samples:?}: {seen} samples");
        report(
            &format!("vertices on the eye, {} samples", samples.count()),
            "nothing",
            &format!("{seen} samples of 50 faces"),
        );
    }

    // A floor from far behind the eye to far ahead: all below the horizon, nothing above.
    let floor = mesh_of(&rectangle(DVec3::new(-1e6, -1.0, -1e6), DVec3::Z * 2e6, DVec3::X * 2e6), [1.0; 4]);
    let store = at_origin(vec![floor]);
    for samples in ALL_SAMPLES {
        let picture = draw(&store, &state(), &view(64, 64, samples));
        for (i, pixel) in picture.linear.iter().enumerate() {
            assert_eq!(pixel[0], if i / 64 >= 32 { 1.0 } else { 0.0 }, "{samples:?}, pixel {i}");
        }
    }
    let behind = draw(&at_origin(vec![wall(-3.0, [1.0; 4])]), &state(), &view(32, 32, Samples::Four));
    assert!(behind.linear.iter().all(|c| *c == [0.0; 3]), "nothing behind the eye is seen");
    report("a floor from 1000 km behind to 1000 km ahead", "exactly the lower half", "exact");
}

#[test]
fn a_plane_seen_edge_on_is_a_line_at_most() {
    // The ground with eight layers, the eye in it or a hair above or below, level and banked; a wall behind all of it.
    let mut most = 0.0f64;
    for (height, bank) in [(0.0, 0.0), (0.0, 0.3), (1e-12, 0.2), (-1e-9, 0.7), (1e-6, 0.0), (1e-6, 0.4), (1e-4, 0.1)] {
        for shared in [false, true] {
            let mut meshes: Vec<_> = (0..8)
                .map(|k| {
                    let size = 100.0 - 10.0 * f64::from(k);
                    let mut mesh = mesh_of(
                        &rectangle(DVec3::new(-size, 0.0, -size), DVec3::Z * 2.0 * size, DVec3::X * 2.0 * size),
                        [1.0, 0.0, 0.0, 1.0],
                    );
                    mesh.material.double_sided = true;
                    (mesh, DAffine3::IDENTITY)
                })
                .collect();
            meshes.push((wall(200.0, [0.0, 1.0, 0.0, 1.0]), DAffine3::IDENTITY));
            let store = store_with(meshes, |table| {
                if shared {
                    table.planes = vec![PlaneRow { object: ObjectId(0), normal: DVec3::Y, offset: 0.0 }];
                    table.face_planes = vec![0; 16];
                    for (k, row) in table.subobjects.iter_mut().take(8).enumerate() {
                        (row.planes, row.layer) = (Some(2 * k as u32), k as i32);
                    }
                }
            });
            let mut state = state();
            state.eye.position.y = height;
            state.eye.orientation = DQuat::from_rotation_z(bank);
            let picture = draw(&store, &state, &view(64, 64, Samples::SixtyFour));
            assert!(picture.linear.iter().all(|c| c[0] + c[1] == 1.0), "{height} m, bank {bank}: no hole");
            // Half of what is 1e-4 m below the eye is seen under more than a sub-pixel from 8 m on.
            let area: f64 = picture.linear.iter().map(|c| f64::from(c[0])).sum();
            most = most.max(area / 64.0);
            assert!(area / 64.0 <= 1.0, "{height} m, bank {bank}: {area} pixels");
        }
    }
    report(
        "a plane with eight layers seen edge on",
        "no hole, a line of a pixel at most",
        &format!("{most:.4} pixels wide"),
    );
}

#[test]
fn the_same_faces_in_any_order_are_the_same_picture() {
    let mut random = Random(11);
    let faces: Vec<_> = (0..40)
        .map(|k| {
            let size = [1e-3, 0.3, 30.0][k % 3];
            let centre = random_vector(&mut random) - DVec3::Z * 1.2;
            let corners = std::array::from_fn(|_| snapped(centre + random_vector(&mut random) * size));
            OracleFace { corners, color: random_color(&mut random, [1.0, 0.5][k % 2]) }
        })
        .collect();
    let store = store_of_faces(&faces);
    let mut list = everything(&store);
    let mut renderer = crate::pipeline::Renderer::new(std::num::NonZeroUsize::MIN).unwrap();
    let view = view(48, 40, Samples::Sixteen);
    let standard = draw(&store, &state(), &view);
    for _ in 0..5 {
        for i in (1..list.len()).rev() {
            list.swap(i, random.below(i as u64 + 1) as usize);
        }
        let picture = draw_with(&mut renderer, &store, &state(), &view, &list, &[proto::share::Part::WHOLE]);
        assert_eq!(Comparison::of(&picture, &as_f64(&standard)).largest, 0.0);
    }
    report("faces cut by the near plane in any order", "the same bytes", "the same bytes");
}
