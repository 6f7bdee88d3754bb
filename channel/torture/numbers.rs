//! Numbers at the edge of what numbers are.

use super::{Comparison, as_f64, random_color, random_vector, report, snapped, store_of_faces};
use crate::oracle::*;
use crate::picture_tests::distribution::{GRID, everything_moved, offset_view};
use crate::picture_tests::{ALL_SAMPLES, at_origin, wall};
use crate::pipeline::{DrawError, Renderer, TilePictures};
use crate::store::SceneStore;
use glam::{DAffine3, DQuat, DVec3};
use proto::frame::{FrameState, Moved};
use proto::ids::{ModelId, ObjectId};
use proto::scene::{Mesh, ModelRow, PlaneRow, SceneTable, Texture};
use proto::share::Part;
use proto::view::{Pose, Samples, View};
use std::num::NonZeroUsize;

fn attempt(store: &SceneStore, state: &FrameState, view: &View) -> Result<(), DrawError> {
    let mut renderer = Renderer::new(NonZeroUsize::MIN).unwrap();
    let mut out = TilePictures::new();
    renderer.draw(store, state, view, &everything(store), &Part::WHOLE, &mut out).map(|_| ())
}

#[test]
fn quaternions_off_unit_are_made_unit_ones() {
    let (store, state) = everything_moved(DVec3::ZERO, GRID);
    let standard = as_f64(&draw(&store, &state, &offset_view()));
    let mut total = Comparison::default();
    for length in [1.0 - 1e-3, 1.0 + 1e-3, 0.5, 1e3] {
        let mut state = state;
        state.eye.orientation = DQuat::from_rotation_y(0.0) * length;
        let mut view = offset_view();
        view.offset.orientation *= length;
        total.add(&draw(&store, &state, &view), &standard);
    }
    report("quaternions off unit by 1e-3 and more", "as the unit ones", &total.to_string());
    assert_eq!(total.unlike, 0, "{total}");
    for nonsense in [DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0)] {
        let mut bad = state;
        bad.eye.orientation = nonsense;
        assert_eq!(attempt(&store, &bad, &offset_view()), Err(DrawError::State));
        let mut view = offset_view();
        view.offset.orientation = nonsense;
        assert_eq!(attempt(&store, &state, &view), Err(DrawError::View));
    }
}

#[test]
fn a_negative_zero_is_a_zero() {
    let mut random = Random(0);
    let mut faces: Vec<_> = (0..40)
        .map(|k| {
            // On a grid through the view's middle, so that many coordinates are 0 and many edges hit samples.
            let corner = |random: &mut Random| {
                let p = (random_vector(random) * 2.0).round() * 0.5;
                DVec3::new(p.x, p.y, -1.0 - p.z.abs())
            };
            let corners = [corner(&mut random), corner(&mut random), corner(&mut random)];
            OracleFace { corners, color: random_color(&mut random, [1.0, 0.5][k % 2]) }
        })
        .collect();
    for samples in ALL_SAMPLES {
        let view = view(32, 32, samples);
        let positive = draw(&store_of_faces(&faces), &state(), &view);
        let negate = |c: f64| if c == 0.0 { -0.0 } else { c };
        for face in &mut faces {
            face.corners = face.corners.map(|p| DVec3::new(negate(p.x), negate(p.y), p.z));
        }
        assert_eq!(draw(&store_of_faces(&faces), &state(), &view), positive, "{samples:?}");
        assert_eq!(Comparison::of(&positive, &sample_by_force(&view, &faces)).unlike, 0, "{samples:?}");
    }
    report("-0 for 0 in every coordinate", "the same bytes", "the same bytes");
}

#[test]
fn denormals_are_as_good_as_nothing() {
    let tiny = f32::from_bits(1);
    let standard_mesh = wall(2.0, [0.5, 0.25, 0.125, 1.0]);
    let mut mesh = standard_mesh.clone();
    mesh.material.emissive = [tiny; 3];
    mesh.positions.iter_mut().flatten().filter(|c| **c == 0.0).for_each(|c| *c = tiny);
    mesh.origin = DVec3::splat(5e-324);
    // Faces of denormal size, at the eye and ahead; denormal normals; a denormal weight; denormal saturation.
    let crumb = mesh_of(&[[DVec3::ZERO, DVec3::X * 1e-40, DVec3::Y * 1e-44]], [1.0; 4]);
    let mut glass = wall(1.0, [1.0, 1.0, 1.0, tiny]);
    glass.material.unlit = false;
    glass.normals = vec![[tiny, 0.0, -tiny]; glass.positions.len()];
    let mut version = wall(1.5, [1.0; 4]);
    version.material.unlit = false;
    let at = DAffine3::from_translation(DVec3::new(0.0, 5e-324, -1.0));
    let meshes = vec![
        (mesh, DAffine3::IDENTITY),
        (crumb.clone(), DAffine3::IDENTITY),
        (crumb, at),
        (glass, DAffine3::IDENTITY),
        (version, DAffine3::IDENTITY),
    ];
    let mut store = store_with(meshes, |table| {
        table.models = vec![ModelRow { merged: true, versions: 1 }];
        table.subobjects[4].part_of = Some(proto::scene::ModelPart { model: ModelId(0), version: 0 });
        table.planes = vec![PlaneRow { object: ObjectId(0), normal: DVec3::Z * 5e-324, offset: 5e-324 }];
        table.subobjects[0].planes = Some(0);
        table.face_planes = vec![0; 2];
    });
    store.set_weights(&weights(&[(0, &[tiny])])).unwrap();
    let mut state = state();
    state.environment.ambient = tiny;
    for samples in ALL_SAMPLES {
        let view = view(32, 32, samples);
        let expected = as_f64(&draw(&at_origin(vec![standard_mesh.clone()]), &state, &view));
        let comparison = Comparison::of(&draw(&store, &state, &view), &expected);
        assert_eq!(comparison.unlike, 0, "{samples:?}: {comparison}");
    }
    report("denormals in positions, normals, colours, weights, planes", "as good as 0", "0 pixels differ");
}

#[test]
fn huge_numbers_make_no_nan() {
    let mut random = Random(u64::MAX);
    for round in 0..60 {
        let size = [1e12, 1e30, 3e38][round % 3];
        let corners = std::array::from_fn(|_| snapped(random_vector(&mut random) * size));
        let mut mesh = mesh_of(&[corners], random_color(&mut random, [1.0, 0.5][round % 2]));
        mesh.material.double_sided = true;
        mesh.material.unlit = false;
        mesh.material.emissive = [f32::MAX; 3];
        let normal = random_vector(&mut random) * 1e200;
        let scale = [1.0, 1e100, 1e300, f64::MAX][round / 3 % 4];
        let store = store_with(vec![(mesh, DAffine3::from_scale(DVec3::splat(scale)))], |table| {
            table.planes = vec![PlaneRow { object: ObjectId(0), normal, offset: 1e300 * random.signed() }];
            table.subobjects[0].planes = Some(0);
            table.face_planes = vec![0];
        });
        let mut state = state();
        state.eye.position = random_vector(&mut random) * [0.0, 1e12, 1e300][round % 3];
        // draw() asserts that every pixel is finite.
        draw(&store, &state, &view(24, 18, ALL_SAMPLES[round % 5]));
    }
    report("coordinates to 3e38, transformations and planes to 1.8e308", "no NaN, no panic", "none");
}

#[test]
fn nan_and_infinity_are_refused_wherever_they_come_in() {
    let mut refused = 0;
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let changes: [fn(&mut Mesh, f32); 9] = [
            |m, bad| m.positions[1][2] = bad,
            |m, bad| m.origin.y = f64::from(bad),
            |m, bad| m.normals = vec![[0.0, bad, 0.0]; m.positions.len()],
            |m, bad| m.colors = vec![[1.0, 1.0, bad, 1.0]; m.positions.len()],
            |m, bad| m.texcoords = vec![vec![[bad, 0.0]; m.positions.len()]],
            |m, bad| m.material.base_color[3] = bad,
            |m, bad| m.material.emissive[0] = bad,
            |m, bad| m.material.alpha = proto::scene::Alpha::Mask { cutoff: bad },
            |m, bad| {
                let mut usage = texture_use(content(9));
                usage.transform[0][0] = bad;
                m.material.base_texture = Some(usage);
            },
        ];
        for change in changes {
            let mut mesh = wall(1.0, [1.0; 4]);
            change(&mut mesh, bad);
            assert!(SceneStore::new().insert_mesh(content(0), mesh).is_err(), "a mesh with {bad}");
            refused += 1;
        }
        let wide = f64::from(bad);
        let tables: [fn(&mut SceneTable, f64); 3] = [
            |t, bad| t.objects[0].transform.translation.z = bad,
            |t, bad| t.objects[0].transform.matrix3.x_axis.y = bad,
            |t, bad| t.planes = vec![PlaneRow { object: ObjectId(0), normal: DVec3::X * bad, offset: 0.0 }],
        ];
        for change in tables {
            let mut table = place(&[(content(0), DAffine3::IDENTITY)]);
            change(&mut table, wide);
            assert!(SceneStore::new().set_table(table).is_err(), "a table with {bad}");
            refused += 1;
        }
        let mut store = at_origin(vec![wall(1.0, [1.0; 4])]);
        let moved = Moved { object: ObjectId(0), transform: DAffine3::from_scale(DVec3::splat(wide)) };
        assert!(store.set_moved(&[moved]).is_err(), "a move with {bad}");
        let states: [fn(&mut FrameState, f64); 6] = [
            |s, bad| s.eye.position.x = bad,
            |s, bad| s.eye.orientation.w = bad,
            |s, bad| s.environment.ambient = bad as f32,
            |s, bad| s.environment.sun_direction.y = bad,
            |s, bad| s.environment.visibility_m = Some(bad),
            |s, bad| s.environment.fog = Some([0.0, bad as f32, 0.0]),
        ];
        for change in states {
            let mut state = state();
            change(&mut state, wide);
            assert_eq!(attempt(&store, &state, &view(8, 8, Samples::One)), Err(DrawError::State), "{bad}");
            refused += 1;
        }
        let views: [fn(&mut View, f64); 4] = [
            |v, bad| v.near = bad,
            |v, bad| v.tangents.left = bad,
            |v, bad| v.offset.position.z = bad,
            |v, bad| v.offset.orientation.x = bad,
        ];
        for change in views {
            let mut view = view(8, 8, Samples::One);
            change(&mut view, wide);
            assert_eq!(attempt(&store, &state(), &view), Err(DrawError::View), "{bad}");
            refused += 1;
        }
        assert!(Pose::checked(DVec3::splat(wide), DQuat::IDENTITY).is_err());
        refused += 2;
    }
    let texture = Texture { width: 2, height: 2, texels: vec![[0; 4]; 3] };
    assert!(SceneStore::new().insert_texture(content(1), texture).is_err());
    report("NaN and infinity at every input", "refused", &format!("{refused} of {refused} refused"));
}
