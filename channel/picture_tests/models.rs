//! Versions that are mixed and layers that are merged, against the weighted mean and the sum over all combinations.

use super::distribution::motley;
use super::{ALL_SAMPLES, assert_near, at_origin, near, wall};
use crate::oracle::*;
use crate::store::{SceneStore, StoreError};
use glam::{DAffine3, DVec3};
use proto::frame::VersionWeights;
use proto::ids::ModelId;
use proto::scene::{Alpha, Mesh, ModelPart, ModelRow, SceneTable};
use proto::view::Samples;

fn part(model: u32, version: u32) -> Option<ModelPart> {
    Some(ModelPart { model: ModelId(model), version })
}

/// Largest difference of two pictures' linear values.
fn difference(a: &[[f32; 3]], b: &[[f64; 3]]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
}

/// The mixture of pictures, linear.
fn mean(pictures: &[(f64, &Picture)]) -> Vec<[f64; 3]> {
    (0..pictures[0].1.linear.len())
        .map(|i| std::array::from_fn(|c| pictures.iter().map(|(w, p)| w * f64::from(p.linear[i][c])).sum()))
        .collect()
}

/// A few faces, some of them far larger than the view, none behind the eye.
fn random_face(random: &mut Random) -> OracleFace {
    let size = [0.1, 1.0, 4.0][random.below(3) as usize];
    let centre = DVec3::new(random.signed() * 2.0, random.signed() * 2.0, -0.8 - random.unit() * 3.0);
    let corners = std::array::from_fn(|_| {
        let p = centre + DVec3::new(random.signed(), random.signed(), random.signed()) * size;
        DVec3::new(p.x, p.y, -p.z.abs().max(0.2)).as_vec3().as_dvec3()
    });
    let alpha = if random.below(2) == 0 { 1.0 } else { 0.25 + 0.5 * random.unit() as f32 };
    OracleFace { corners, color: [random.unit() as f32, random.unit() as f32, random.unit() as f32, alpha] }
}

fn mesh_of_face(face: &OracleFace) -> Mesh {
    let mut mesh = mesh_of(&[face.corners], face.color);
    mesh.material.double_sided = true;
    mesh
}

#[test]
fn one_model_in_transition_is_the_weighted_mean_of_two_pictures() {
    // Textures, cut-outs, glass, smooth normals, fog: two thirds of it in two versions of one model.
    for merged in [false, true] {
        let (mut store, state) = motley(|table| {
            table.models = vec![ModelRow { merged, versions: 2 }];
            for (k, row) in table.subobjects.iter_mut().enumerate() {
                row.part_of = if k % 3 == 2 { None } else { part(0, k as u32 / 3 % 2) };
            }
        });
        for samples in ALL_SAMPLES {
            let view = view(90, 70, samples);
            let mut of = |w: &[f32]| {
                store.set_weights(&weights(&[(0, w)])).unwrap();
                draw(&store, &state, &view)
            };
            let (fine, coarse) = (of(&[1.0, 0.0]), of(&[0.0, 1.0]));
            assert_ne!(fine, coarse);
            assert_eq!(of(&[1.0]), fine, "weights that are left out are 0");
            for w in [0.25f32, 0.7, 1.0 / 3.0] {
                let mixed = of(&[w, 1.0 - w]);
                let expected = mean(&[(f64::from(w), &fine), (1.0 - f64::from(w), &coarse)]);
                let error = difference(&mixed.linear, &expected);
                assert!(error < 1e-6, "{samples:?}, weight {w}, merged {merged}: {error:e}");
            }
            // Fading out: what is missing to 1 is a version that shows nothing.
            let nothing = of(&[0.0, 0.0]);
            let error = difference(&of(&[0.0, 0.375]).linear, &mean(&[(0.375, &coarse), (0.625, &nothing)]));
            assert!(error < 1e-6, "{samples:?}, fading out, merged {merged}: {error:e}");
        }
        store.set_weights(&[]).unwrap();
        let unnamed = draw(&store, &state, &view(90, 70, Samples::Four));
        store.set_weights(&weights(&[(0, &[1.0, 0.0])])).unwrap();
        assert_eq!(draw(&store, &state, &view(90, 70, Samples::Four)), unnamed, "version 0 where nothing is said");
    }
}

#[test]
fn many_models_in_transition_equal_the_mean_over_all_combinations() {
    let mut random = Random(0x30DE1);
    let mut largest = 0.0f64;
    for round in 0..40 {
        let view = view(20, 18, ALL_SAMPLES[round % 5]);
        let merged: [bool; 4] = std::array::from_fn(|_| random.below(3) == 0);
        // Two versions in transition, three, one that fades out, and one that is not in transition.
        let w = random.unit() as f32;
        let mixtures: [&[f32]; 4] = [&[w, 1.0 - w], &[w * 0.5, 0.5, 0.5 - w * 0.5], &[w], &[0.0, 1.0]];
        let faces: Vec<_> = (0..24)
            .map(|_| {
                let model = random.below(5) as usize;
                let versions = mixtures.get(model).map_or(1, |m| m.len() as u64);
                let part = OraclePart { model, version: random.below(versions) as usize };
                (random_face(&mut random), (model < 4).then_some(part))
            })
            .collect();
        let meshes = faces.iter().map(|(face, _)| (mesh_of_face(face), DAffine3::IDENTITY)).collect();
        let mut store = store_with(meshes, |table| {
            let versions = [2, 3, 1, 2];
            table.models = (0..4).map(|m| ModelRow { merged: merged[m], versions: versions[m] }).collect();
            for (row, (_, of)) in table.subobjects.iter_mut().zip(&faces) {
                row.part_of = of.and_then(|of| part(of.model as u32, of.version as u32));
            }
        });
        let named: Vec<_> = mixtures.iter().enumerate().map(|(m, w)| (m as u32, *w)).collect();
        store.set_weights(&weights(&named)).unwrap();
        let models: Vec<_> = mixtures.into_iter().zip(merged).collect();
        let expected = sample_versions_by_force(&view, &faces, &models);
        let error = difference(&draw(&store, &state(), &view).linear, &expected);
        largest = largest.max(error);
        assert!(error < 1e-6, "round {round}: {error:e}");
    }
    println!("four models, two of them in transition and one fading: {largest:.1e} of full scale");
}

/// A ball of 8 × 16 faces, seen from outside.
fn ball(centre: DVec3, radius: f64) -> Vec<[DVec3; 3]> {
    let at = |i: i32, j: i32| {
        let (elevation, around) =
            (std::f64::consts::PI * f64::from(i) / 8.0, std::f64::consts::TAU * f64::from(j % 16) / 16.0);
        let ring = libm::sin(elevation) * radius;
        let p = DVec3::new(ring * libm::cos(around), radius * libm::cos(elevation), -ring * libm::sin(around));
        (centre + p).as_vec3().as_dvec3()
    };
    let faces = |i, j| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]];
    (0..8).flat_map(|i| (0..16).flat_map(move |j| [(i, j)])).flat_map(|(i, j)| faces(i, j)).collect()
}

#[test]
fn smoke_of_forty_merged_spheres_is_the_nearest_layer_alone() {
    let mut random = Random(40);
    let puffs: Vec<_> = (0..40)
        .map(|_| {
            let centre = DVec3::new(random.signed() * 1.5, random.signed() * 1.5, -4.0 + random.signed());
            let grey = 0.2 + 0.6 * random.unit() as f32;
            (ball(centre, 0.4 + 0.4 * random.unit()), [grey, grey, grey, 0.1 + 0.3 * random.unit() as f32])
        })
        .collect();
    let behind = wall(8.0, [0.1, 0.3, 0.2, 1.0]);
    let table = |table: &mut SceneTable, merged| {
        table.models = vec![ModelRow { merged, versions: 1 }];
        table.subobjects.iter_mut().take(40).for_each(|row| row.part_of = part(0, 0));
    };
    let meshes = || {
        let mut meshes: Vec<_> = puffs.iter().map(|(faces, c)| (mesh_of(faces, *c), DAffine3::IDENTITY)).collect();
        meshes.push((behind.clone(), DAffine3::IDENTITY));
        meshes
    };
    let view = view(24, 24, Samples::Four);
    let flat = |faces: &[[DVec3; 3]], color| -> Vec<_> {
        let face = |corners: &[DVec3; 3]| OracleFace { corners: *corners, color };
        faces.iter().map(|corners| (face(corners), Some(OraclePart { model: 0, version: 0 }))).collect()
    };
    // Only what faces the eye: the puffs are single-sided.
    let seen = |[a, b, c]: &[DVec3; 3]| (*b - *a).cross(*c - *a).dot(*a) < 0.0;
    let mut faces: Vec<_> = Vec::new();
    for (triangles, c) in &puffs {
        faces.extend(flat(&triangles.iter().copied().filter(seen).collect::<Vec<_>>(), *c));
    }
    let corners = |m: &Mesh| m.triangles.iter().map(|t| t.map(|v| m.position(v as usize))).collect::<Vec<_>>();
    let wall_faces =
        corners(&behind).into_iter().map(|corners| (OracleFace { corners, color: [0.1, 0.3, 0.2, 1.0] }, None));
    faces.extend(wall_faces);
    let mut store = store_with(meshes(), |t| table(t, true));
    for w in [1.0f32, 0.375] {
        store.set_weights(&weights(&[(0, &[w])])).unwrap();
        let picture = draw(&store, &state(), &view);
        let error = difference(&picture.linear, &sample_versions_by_force(&view, &faces, &[(&[w], true)]));
        assert!(error < 1e-6, "weight {w}: {error:e}");
        println!("40 merged spheres at weight {w}: {error:.1e} of full scale");
    }
    let unmerged = draw(&store_with(meshes(), |t| table(t, false)), &state(), &view);
    store.set_weights(&[]).unwrap();
    assert_ne!(draw(&store, &state(), &view), unmerged, "the mark makes a difference");
    let plain = store_of(meshes());
    assert_eq!(draw(&plain, &state(), &view), unmerged, "a model that neither merges nor changes is ordinary");
}

#[test]
fn a_merged_models_opaque_faces_are_ordinary_and_clear_ones_do_not_count() {
    let puff = |d: f64, c: f32, alpha: f32| {
        let mut mesh = wall(d, [c, c, c, alpha]);
        mesh.material.alpha = Alpha::Blend;
        mesh
    };
    let core = wall(4.0, [0.0, 1.0, 0.0, 1.0]);
    // At 1 m a puff without any saturation, at 2 m the one that counts, at 3 m one too many, at 4 m the core.
    let meshes = vec![puff(1.0, 1.0, 0.0), puff(2.0, 0.5, 0.25), puff(3.0, 1.0, 0.5), core];
    let store = store_with(meshes.into_iter().map(|m| (m, DAffine3::IDENTITY)).collect(), |table| {
        table.models = vec![ModelRow { merged: true, versions: 1 }];
        table.subobjects.iter_mut().for_each(|row| row.part_of = part(0, 0));
    });
    assert_near(draw(&store, &state(), &view(8, 8, Samples::Four)).at(3, 3), [0.125, 0.875, 0.125], 1e-6);
}

#[test]
fn cut_outs_in_transition_are_cut_out_per_sample() {
    let (mut store, state) = motley(|table| {
        table.models = vec![ModelRow { merged: false, versions: 1 }];
        table.subobjects.iter_mut().filter(|row| row.primitive % 4 == 3).for_each(|row| row.part_of = part(0, 0));
    });
    let view = view(80, 60, Samples::Eight);
    let whole = draw(&store, &state, &view);
    let mut of = |w: f32| {
        store.set_weights(&weights(&[(0, &[w])])).unwrap();
        draw(&store, &state, &view)
    };
    let (none, half) = (of(0.0), of(0.5));
    assert_eq!(of(1.0), whole);
    let between = mean(&[(0.5, &whole), (0.5, &none)]);
    assert!(
        half.linear.iter().zip(&between).all(|(a, b)| near(*a, *b, 1e-6)),
        "{:e}",
        difference(&half.linear, &between)
    );
}

#[test]
fn weights_that_are_no_mixture_are_refused_and_change_nothing() {
    let mut store = store_with(vec![(wall(1.0, [1.0; 4]), DAffine3::IDENTITY)], |table| {
        table.models = vec![ModelRow { merged: false, versions: 2 }];
        table.subobjects[0].part_of = part(0, 0);
    });
    store.set_weights(&weights(&[(0, &[0.25, 0.0])])).unwrap();
    let half = |store: &SceneStore| draw(store, &state(), &view(4, 4, Samples::One)).at(1, 1)[0];
    assert_eq!(half(&store), 0.25);
    let bad = StoreError::Weights { model: ModelId(0) };
    let refused: [&[f32]; 6] = [&[0.5, 0.25, 0.25], &[f32::NAN], &[f32::INFINITY], &[-0.1], &[1.1], &[0.7, 0.7]];
    for w in refused {
        assert_eq!(store.set_weights(&weights(&[(0, w)])), Err(bad.clone()), "{w:?}");
    }
    let beyond = [VersionWeights { model: ModelId(1), weights: vec![1.0] }];
    assert_eq!(store.set_weights(&beyond), Err(StoreError::WeightsOutOfRange { model: ModelId(1), models: 1 }));
    assert_eq!(half(&store), 0.25);
    let plain = at_origin(vec![wall(1.0, [1.0; 4])]);
    assert_eq!(half(&plain), 1.0);
    // A sum that is 1 but for rounding is 1: nothing shines through.
    store.set_weights(&weights(&[(0, &[1.0 - 1e-7, 1e-7])])).unwrap();
    assert!(half(&store) <= 1.0);
}
