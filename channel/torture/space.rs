//! Far from the origin, tiny and huge, near and far at once, very narrow and very wide.

use super::{Comparison, against_the_sampler, as_f64, random_color, random_vector, report, snapped};
use crate::geometry::camera::Camera;
use crate::oracle::*;
use crate::picture_tests::distribution::{GRID, everything_moved, everything_scaled, offset_view};
use crate::picture_tests::{ALL_SAMPLES, at_origin, wall};
use glam::{DAffine3, DVec3};
use proto::view::{Pose, Samples, Tangents, View};

/// Draws the scene of everything here and moved by `by`; the largest displacement of a projected point, pixels, and the pictures.
fn moved(by: DVec3, grid: f64) -> (f64, Comparison) {
    let view = offset_view();
    let (here, state_here) = everything_moved(DVec3::ZERO, grid);
    let (there, state_there) = everything_moved(by, grid);
    let [a, b] = [&state_here, &state_there].map(|state| Camera::new(state, &view));
    let mut random = Random(0x6378);
    let mut displaced = 0.0f64;
    for id in everything(&here) {
        let [p, q] = [(&here, &a), (&there, &b)].map(|(store, camera)| {
            let found = store.find(id).unwrap();
            (found.transform.matrix3, camera.relative(found.transform))
        });
        for _ in 0..50 {
            let v = random_vector(&mut random) * 5.0 - DVec3::Z * 5.0;
            let [p, q] =
                [(p, &a), (q, &b)].map(|((linear, relative), camera)| camera.view_point(linear * v + relative));
            if p.w > 0.1 {
                let [p, q] = [a.project(p), b.project(q)];
                displaced = displaced.max((p[0] - q[0]).abs()).max((p[1] - q[1]).abs());
            }
        }
    }
    let comparison = Comparison::of(&draw(&there, &state_there, &view), &as_f64(&draw(&here, &state_here, &view)));
    (displaced, comparison)
}

#[test]
fn scene_and_eye_moved_together_by_2_to_the_23_are_the_same_bytes() {
    let (displaced, comparison) = moved(DVec3::new(8_388_608.0, 8_388_608.0, -8_388_608.0), GRID);
    assert_eq!((displaced, comparison.largest), (0.0, 0.0));
    report("scene and eye moved by 2^23 m", "the same bytes", "the same bytes");
}

#[test]
fn scene_and_eye_moved_together_stay_within_a_sub_pixel() {
    let slanted = DVec3::new(0.48, 0.6, -0.64);
    for (name, distance) in [("6.4e6 m", 6_378_137.0), ("1e9 m", 1e9)] {
        let (displaced, comparison) = moved(slanted * distance, 0.0);
        let measured = format!("{displaced:.1e} pixel; {comparison}");
        report(&format!("scene and eye moved by {name}, slanted"), "within 1/256 pixel", &measured);
        assert!(displaced < 1.0 / 256.0, "{name}: {measured}");
        // Where a vertex rounds to the other side, one sample of 16 may flip.
        assert!(comparison.unlike * 20 < comparison.pixels, "{name}: {measured}");
    }
}

#[test]
fn scenes_of_a_millimetre_and_of_ten_thousand_kilometres_are_the_same_picture() {
    // By powers of two every operation scales exactly: the same bytes.
    let view = offset_view();
    let [(a, state_a), (b, state_b), (c, state_c)] = [0.0f64, -10.0, 23.0].map(everything_scaled);
    let scaled = |by: f64| {
        let mut view = view;
        (view.near, view.offset.position) = (view.near * by, view.offset.position * by);
        view
    };
    let standard = draw(&a, &state_a, &view);
    assert_eq!(draw(&b, &state_b, &scaled(1.0 / 1024.0)), standard);
    assert_eq!(draw(&c, &state_c, &scaled(8_388_608.0)), standard);
    report("scenes of 2^-10 m and 2^23 m", "the same bytes", "the same bytes");
    for size in [1e-3, 1e7] {
        let mut random = Random(77);
        let mut total = Comparison::default();
        for round in 0..20 {
            let view = View { near: size * 0.01, ..view_of(round) };
            let faces: Vec<_> = (0..20)
                .map(|k| {
                    let centre = random_vector(&mut random) - DVec3::Z * 2.0;
                    let corners = std::array::from_fn(|_| {
                        let p = centre + random_vector(&mut random) * 0.8;
                        snapped(DVec3::new(p.x, p.y, -p.z.abs().max(0.1)) * size)
                    });
                    OracleFace { corners, color: random_color(&mut random, [1.0, 0.4][k % 2]) }
                })
                .collect();
            let comparison =
                Comparison::of(&draw(&super::store_of_faces(&faces), &state(), &view), &sample_by_force(&view, &faces));
            total.pixels += comparison.pixels;
            total.unlike += comparison.unlike;
            total.largest = total.largest.max(comparison.largest);
        }
        report(&format!("scene of {size:e} m"), "the sampler's picture", &total.to_string());
        assert_eq!(total.unlike, 0, "{size:e} m: {total}");
    }
}

fn view_of(round: usize) -> View {
    view(32, 24, ALL_SAMPLES[round % 5])
}

#[test]
fn a_near_plane_at_a_millimetre_and_a_face_at_ten_thousand_kilometres() {
    let mut pane = wall(0.0011, [0.5, 0.25, 0.0, 0.5]);
    pane.material.double_sided = true;
    let meshes = vec![wall(1.0000001e7, [1.0, 0.0, 0.0, 1.0]), pane, wall(1e7, [0.0, 0.0, 1.0, 1.0])];
    let view = View { near: 1e-3, ..view(40, 30, Samples::Eight) };
    let picture = draw(&at_origin(meshes), &state(), &view);
    let comparison = Comparison::of(&picture, &vec![[0.25, 0.125, 0.5]; 1200]);
    report("near plane 1e-3 m, faces at 1.1e-3 m, 1e7 m and 1 m behind that", "the formula", &comparison.to_string());
    assert_eq!(comparison.unlike, 0, "{comparison}");
}

#[test]
fn fields_of_view_of_a_hundredth_and_of_170_degrees() {
    for (degrees, distance) in [(0.01, 5000.0), (170.0, 1.0)] {
        let mut random = Random(170);
        let mut total = Comparison::default();
        for round in 0..20 {
            let tangents = Tangents::symmetric(degrees, 32, 24);
            let view = View { tangents, ..view_of(round) };
            let half = tangents.top * distance;
            let faces: Vec<_> = (0..20)
                .map(|k| {
                    let place = random_vector(&mut random);
                    let centre = DVec3::new(place.x * half, place.y * half, -distance * (1.0 + random.unit()));
                    let size = half * [0.05, 0.5, 2.0][k % 3];
                    let corners = std::array::from_fn(|_| {
                        let p = centre + random_vector(&mut random) * size;
                        snapped(DVec3::new(p.x, p.y, -p.z.abs().max(distance * 0.2)))
                    });
                    OracleFace { corners, color: random_color(&mut random, [1.0, 0.5][k % 2]) }
                })
                .collect();
            let comparison = against_the_sampler(&view, &faces);
            total.pixels += comparison.pixels;
            total.unlike += comparison.unlike;
            total.largest = total.largest.max(comparison.largest);
        }
        report(&format!("field of view {degrees} degrees"), "the sampler's picture", &total.to_string());
        assert_eq!(total.unlike, 0, "{degrees} degrees: {total}");
    }
}

#[test]
fn a_pose_that_jumps_leaves_nothing_behind() {
    let (store, mut state) = everything_moved(DVec3::ZERO, GRID);
    let mut renderer = crate::pipeline::Renderer::new(std::num::NonZeroUsize::MIN).unwrap();
    let list = everything(&store);
    let whole = [proto::share::Part::WHOLE];
    let home = state.eye;
    let mut at = |position| {
        state.eye = Pose { position, ..home };
        draw_with(&mut renderer, &store, &state, &offset_view(), &list, &whole)
    };
    let standard = at(home.position);
    for frame in 1..20 {
        let jump = DVec3::new(1e6, -1e6, 1e6) * f64::from(frame % 2) + home.position;
        let picture = at(jump);
        assert_eq!(picture == standard, frame % 2 == 0, "frame {frame}");
    }
    report("poses that jump 1e6 m per frame", "each frame as if it were the first", "the same bytes");
}

#[test]
fn an_object_far_from_its_meshs_origin_is_where_it_should_be() {
    // Mesh coordinates of 2²³ m that the object's place takes back.
    let by = DVec3::splat(8_388_608.0);
    let mesh = wall(2.0, [1.0, 0.5, 0.25, 1.0]);
    let mut far = mesh.clone();
    far.origin += by;
    let [here, there] = [(mesh, DVec3::ZERO), (far, -by)]
        .map(|(mesh, t)| draw(&store_of(vec![(mesh, DAffine3::from_translation(t))]), &state(), &view_of(2)));
    assert_eq!(here, there);
    report("mesh 2^23 m from its origin", "the same bytes", "the same bytes");
}
