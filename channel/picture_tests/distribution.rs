//! The same bytes however the work is shared out, and no bytes that are wrong whatever comes in.

use super::{ALL_SAMPLES, at_origin, checker, wall};
use crate::oracle::*;
use crate::pipeline::{DrawError, Renderer, TilePictures};
use crate::store::SceneStore;
use glam::{DAffine3, DQuat, DVec3};
use proto::frame::{Background, FrameState};
use proto::ids::{BoardId, ModelId, ObjectId, SubobjectId};
use proto::scene::{Alpha, LightKind, LightRow, ModelPart, ModelRow, NO_PLANE, PlaneRow, SceneTable};
use proto::share::{Part, shares};
use proto::view::{Mode, Pose, Samples, View, ViewSetup};
use std::num::NonZeroUsize;

/// Models in transition, merged ones, layers of one plane and lights, all in the table of [`motley`].
fn everything_at_once(table: &mut SceneTable) {
    let versions = [(false, 2), (true, 1), (true, 3), (false, 1)];
    table.models = versions.map(|(merged, versions)| ModelRow { merged, versions }).to_vec();
    for (k, row) in table.subobjects.iter_mut().enumerate() {
        let model = k as u32 / 3 % 6;
        let version = versions.get(model as usize).map(|(_, versions)| k as u32 % versions);
        row.part_of = version.map(|version| ModelPart { model: ModelId(model), version });
        row.layer = [0, 2, -1][k % 3];
        // Faces of all directions forced into two planes: nonsense, but the same nonsense everywhere.
        row.planes = (k % 5 == 0).then_some(0);
    }
    table.planes = vec![
        PlaneRow { object: ObjectId(0), normal: DVec3::new(0.6, 0.0, 0.8), offset: -4.0 },
        PlaneRow { object: ObjectId(7), normal: DVec3::new(0.0, 1.0, 0.0), offset: -2.0 },
    ];
    table.face_planes = (0..24).map(|f| [NO_PLANE, 0, 1, NO_PLANE][f % 4]).collect();
    let light = LightRow {
        kind: LightKind::Point { range: Some(9.0) },
        intensity: [2.0, 1.0, 0.5],
        position: DVec3::new(0.5, 1.0, -3.0),
        direction: DVec3::NEG_Z,
    };
    let spot = LightKind::Spot { range: None, inner_cos: 0.9, outer_cos: 0.7 };
    table.lights = vec![light, LightRow { kind: spot, ..light }, LightRow { kind: LightKind::Directional, ..light }];
}

/// The scene of [`everything_at_once`] with two models in transition and one that fades out.
pub(crate) fn everything_shown(change: impl FnOnce(&mut SceneTable)) -> (SceneStore, FrameState) {
    let (mut store, mut state) = motley(|table| {
        everything_at_once(table);
        change(table);
    });
    store.set_weights(&weights(&[(0, &[0.3, 0.7]), (2, &[0.5, 0.25, 0.25]), (3, &[0.6])])).unwrap();
    state.environment.scene_lights = true;
    (store, state)
}

/// Something of everything: crossing faces, textures, masks, smooth normals, glass, fog, a mirrored and a moved object.
pub(super) fn motley(change: impl FnOnce(&mut SceneTable)) -> (SceneStore, FrameState) {
    let mut random = Random(0xBEEF);
    let mut meshes = Vec::new();
    for k in 0..60 {
        let triangles: Vec<[DVec3; 3]> = (0..1 + random.below(20))
            .map(|_| {
                let centre = DVec3::new(random.signed() * 6.0, random.signed() * 4.0, -1.0 - random.unit() * 9.0);
                let size = [0.05, 0.5, 4.0][random.below(3) as usize];
                std::array::from_fn(|_| {
                    (centre + DVec3::new(random.signed(), random.signed(), random.signed()) * size).as_vec3().as_dvec3()
                })
            })
            .collect();
        let mut mesh = mesh_of(&triangles, [random.unit() as f32, random.unit() as f32, random.unit() as f32, 1.0]);
        let mut vector = |_: &[f32; 3]| [random.signed() as f32, random.signed() as f32, random.signed() as f32];
        if k % 3 == 0 {
            mesh.normals = mesh.positions.iter().map(&mut vector).collect();
        }
        if k % 2 == 0 {
            mesh.texcoords = vec![mesh.positions.iter().map(&mut vector).map(|[u, v, _]| [u, v]).collect()];
            mesh.material.base_texture = Some(texture_use(content(1000)));
            mesh.material.emissive_texture = Some(texture_use(content(1000)));
            mesh.material.emissive = [0.1; 3];
        }
        if k % 5 == 1 {
            mesh.colors =
                mesh.positions.iter().map(&mut vector).map(|[r, g, b]| [r.abs(), g.abs(), b.abs(), r.abs()]).collect();
        }
        mesh.material.unlit = k % 7 == 0;
        mesh.material.double_sided = k % 4 != 0;
        mesh.material.alpha = [Alpha::Opaque, Alpha::Blend, Alpha::Opaque, Alpha::Mask { cutoff: 0.5 }][k % 4];
        if k % 8 == 1 {
            mesh.material.base_color[3] = 0.4;
        }
        let mut transform = DAffine3::from_translation(DVec3::new(0.0, 0.0, -(k as f64) * 0.05));
        if k % 6 == 0 {
            transform.matrix3.x_axis = -transform.matrix3.x_axis;
        }
        meshes.push((mesh, transform));
    }
    let mut store = store_with(meshes, change);
    checker(&mut store, 1000, 8, [250, 200, 150, 220], [30, 60, 90, 60]);
    let mut state = state();
    state.environment.background = Background::Sky;
    state.environment.visibility_m = Some(11.0);
    (store, state)
}

#[test]
fn bytes_are_the_same_for_any_threads_shares_and_lists() {
    let (store, state) = everything_shown(|_| ());
    let list = everything(&store);
    let mut reversed = list.clone();
    reversed.reverse();
    let mut shuffled = list.clone();
    let mut random = Random(3);
    for i in (1..shuffled.len()).rev() {
        shuffled.swap(i, random.below(i as u64 + 1) as usize);
    }
    let mut one = Renderer::new(NonZeroUsize::MIN).unwrap();
    let mut two = Renderer::new(NonZeroUsize::new(2).unwrap()).unwrap();
    for samples in ALL_SAMPLES {
        let view = view(150, 100, samples);
        let standard = draw_with(&mut one, &store, &state, &view, &list, &[Part::WHOLE]);
        let differ = standard.rgb.iter().collect::<std::collections::BTreeSet<_>>().len();
        assert!(differ > 1000, "a picture worth comparing: {differ} colours");
        assert_eq!(draw_with(&mut two, &store, &state, &view, &list, &[Part::WHOLE]), standard, "two threads");
        assert_eq!(draw_with(&mut two, &store, &state, &view, &reversed, &[Part::WHOLE]), standard, "list reversed");
        assert_eq!(draw_with(&mut one, &store, &state, &view, &shuffled, &[Part::WHOLE]), standard, "list shuffled");
        for (boards, mode) in [(2, Mode::Interleave), (3, Mode::Region), (5, Mode::Interleave), (5, Mode::Region)] {
            let weights = vec![1; boards];
            let setup = [ViewSetup { mode, ..ViewSetup::new(view) }];
            let parts: Vec<Part> =
                (0..boards as u32).flat_map(|b| shares(BoardId(b), &weights, &setup)).map(|s| s.part).collect();
            let picture = draw_with(&mut two, &store, &state, &view, &shuffled, &parts);
            assert_eq!(picture, standard, "{boards} boards, {mode:?}");
        }
    }
}

/// See [`everything_moved`].
pub(crate) const GRID: f64 = 1.0 / 1_048_576.0;

/// [`everything_shown`] with its table moved: objects, lights and eye. On a grid of 2⁻²⁰ m adding 2²³ loses nothing; on
/// none (`grid` is 0) objects are at places with all the digits they can have.
pub(crate) fn everything_moved(by: DVec3, grid: f64) -> (SceneStore, FrameState) {
    let exact = |v: DVec3| if grid > 0.0 { (v / grid).round() * grid } else { v * std::f64::consts::FRAC_1_PI * 3.0 };
    let (store, mut state) = everything_shown(|table| {
        for row in &mut table.objects {
            row.transform.translation = exact(row.transform.translation + DVec3::X * 0.1) + by;
        }
        table.lights.iter_mut().for_each(|light| light.position += by);
    });
    state.eye.position += by;
    (store, state)
}

/// [`everything_shown`] made larger by 2^`exponent` about the world's origin, eye and visibility with it; without the lights that
/// fall off with distance.
pub(crate) fn everything_scaled(exponent: f64) -> (SceneStore, FrameState) {
    let by = libm::exp2(exponent);
    let (store, mut state) = everything_shown(|table| {
        for row in &mut table.objects {
            row.transform.matrix3 *= by;
            row.transform.translation *= by;
        }
        table.lights.retain(|light| light.kind == LightKind::Directional);
    });
    state.eye.position *= by;
    state.environment.visibility_m = state.environment.visibility_m.map(|v| v * by);
    (store, state)
}

/// A view with a displacement and a rotation of its own.
pub(crate) fn offset_view() -> View {
    View {
        offset: Pose { position: DVec3::new(0.3, 0.1, 0.2), orientation: DQuat::from_rotation_y(0.2) },
        ..view(100, 80, Samples::Sixteen)
    }
}

#[test]
fn scene_and_eye_moved_together_give_the_same_bytes() {
    let [here, there] = [DVec3::ZERO, DVec3::new(8_388_608.0, -8_388_608.0, 8_388_608.0)].map(|by| {
        let (store, state) = everything_moved(by, GRID);
        draw(&store, &state, &offset_view())
    });
    assert_eq!(there, here);
}

#[test]
fn no_mesh_makes_a_pixel_that_is_not_a_number() {
    let mut random = Random(0xDEAD);
    let magnitudes = [0.0, 5e-324, 1e-40, 1e-7, 0.1, 1.0, 1e3, 1e7, 1e12, 3e38];
    for round in 0..40 {
        let number = |random: &mut Random| {
            let m = magnitudes[random.below(magnitudes.len() as u64) as usize];
            (m * random.signed()) as f32
        };
        let mut mesh = mesh_of(&[[DVec3::ZERO; 3]; 60], [1.0; 4]);
        mesh.positions.iter_mut().for_each(|p| *p = std::array::from_fn(|_| number(&mut random)));
        mesh.normals = mesh.positions.iter().map(|_| std::array::from_fn(|_| number(&mut random))).collect();
        mesh.texcoords = vec![mesh.positions.iter().map(|_| std::array::from_fn(|_| number(&mut random))).collect()];
        mesh.colors = mesh.positions.iter().map(|_| std::array::from_fn(|_| number(&mut random))).collect();
        mesh.material.double_sided = true;
        mesh.material.unlit = false;
        mesh.material.emissive = [f32::MAX; 3];
        mesh.material.alpha = [Alpha::Opaque, Alpha::Blend, Alpha::Mask { cutoff: 0.5 }][round % 3];
        mesh.material.base_texture = Some(texture_use(content(100)));
        let scale = [1.0, 1e-12, 1e12, 1e150, 0.0][round % 5];
        let transform = DAffine3::from_scale_rotation_translation(
            DVec3::new(scale, 1.0, -scale),
            DQuat::from_rotation_y(random.signed()),
            DVec3::new(0.0, 0.0, -0.1),
        );
        let mut store = store_of(vec![(mesh, transform)]);
        checker(&mut store, 100, 5, [255; 4], [0; 4]);
        let mut state = state();
        if round % 4 == 0 {
            state.environment.visibility_m = Some(1e6);
        }
        // draw() checks that every pixel is finite.
        draw(&store, &state, &view(40, 33, ALL_SAMPLES[round % 5]));
    }
}

#[test]
fn crowds_of_crumbs_in_a_pixel_are_one_pixel() {
    // 200 000 faces, each sample of the pixel hit by thousands, all within about one pixel of 64 samples.
    let mut random = Random(1);
    let crumbs: Vec<[DVec3; 3]> = (0..2000)
        .map(|_| {
            let centre =
                DVec3::new(random.unit() * 0.16 - 0.02, random.unit() * 0.16 - 0.02, -1.0 - random.unit() * 0.01);
            std::array::from_fn(|_| {
                (centre + DVec3::new(random.signed(), random.signed(), 0.0) * 0.03).as_vec3().as_dvec3()
            })
        })
        .collect();
    let mut mesh = mesh_of(&crumbs, [1.0, 0.5, 0.25, 1.0]);
    mesh.material.double_sided = true;
    let store = store_of(vec![(mesh, DAffine3::IDENTITY); 100]);
    let picture = draw(&store, &state(), &view(16, 16, Samples::SixtyFour));
    assert_eq!(picture.at(8, 7), [1.0, 0.5, 0.25]);
    assert!(picture.linear.iter().all(|c| c[0] <= 1.0), "no sample counts twice");
}

#[test]
fn what_cannot_be_drawn_is_an_error_and_leaves_nothing() {
    let store = at_origin(vec![wall(1.0, [1.0; 4])]);
    let mut renderer = Renderer::new(NonZeroUsize::MIN).unwrap();
    let mut out = TilePictures::new();
    let small = view(8, 8, Samples::One);
    let mut attempt = |store: &SceneStore, state: &FrameState, view: &View, id| {
        let error = renderer.draw(store, state, view, &[SubobjectId(id)], &Part::WHOLE, &mut out).unwrap_err();
        assert!(out.tiles.is_empty() && out.rgb.is_empty(), "{error}");
        error
    };
    assert_eq!(attempt(&store, &state(), &View { width: 0, ..small }, 0), DrawError::View);
    assert_eq!(
        attempt(&store, &state(), &small, 1),
        DrawError::UnknownSubobject { subobject: SubobjectId(1), subobjects: 1 }
    );
    let mut blind = state();
    blind.eye.position.x = f64::NAN;
    assert_eq!(attempt(&store, &blind, &small, 0), DrawError::State);
    blind = state();
    blind.environment.visibility_m = Some(0.0);
    assert_eq!(attempt(&store, &blind, &small, 0), DrawError::State);
    let mut awaiting = SceneStore::new();
    awaiting.set_table(place(&[(content(0), DAffine3::IDENTITY)])).unwrap();
    assert_eq!(attempt(&awaiting, &state(), &small, 0), DrawError::Missing { subobject: SubobjectId(0) });
}
