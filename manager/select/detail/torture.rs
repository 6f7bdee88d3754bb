//! The detail control parameter where it could break: at no distance, over a surface feature, at the edges of its bands, and for
//! every kind of number. Lines of docs/torture.md, printed by
//! `cargo test -p cyclorama-manager torture -- --nocapture | grep '^torture'`.

use super::*;
use crate::scene::split::{Primitive, split};
use crate::scene::{Extras, NodeSource, Parts, PieceSource};
use glam::{DAffine3, DQuat};
use proptest::prelude::*;
use proto::view::{Pose, Samples, Tangents};

fn report(case: &str, expected: &str, measured: &str) {
    println!("torture | {case} | {expected} | {measured} |");
}

fn solid(radius: f64) -> Feature {
    Feature { centre: DVec3::new(3e6, 100.0, -5e6), radius, lying: None }
}

/// A runway of 3000 m by 45 m, in a direction that is no axis.
fn runway() -> Feature {
    let lying = Lying { long: 1500.0, short: 22.5, axis: DVec2::new(0.6, 0.8) };
    Feature { centre: DVec3::new(3e6, 100.0, -5e6), radius: 0.0, lying: Some(lying) }
}

const FACTOR: f64 = 1467.0;

#[test]
fn the_factor_of_a_view_is_the_reports() {
    let across = |degrees: f64, width| {
        let half = (degrees / 2.0).to_radians().tan();
        View {
            tangents: Tangents { left: -half, right: half, bottom: -half, top: half },
            width,
            ..View::row(1, 1, 1, Tangents::symmetric(40.0, 1, 1), Samples::One)[0]
        }
    };
    // Seed 004, 4.7: 40 degrees over 1024 elements.
    assert!((display_factor([&across(40.0, 1024)]) - 1467.0).abs() < 0.5);
    let both = [across(40.0, 512), across(40.0, 1024)];
    assert_eq!(display_factor(&both), display_factor(&both[1..]), "the smallest elements count");
    assert!((display_factor([&across(179.0, 1)]) - 1.0).abs() < 1e-12, "an element wider than a right angle");
    assert_eq!(display_factor([]), 1.0);
}

#[test]
fn at_no_distance_detail_is_full() {
    let mut asked = 0;
    for radius in [0.0, f64::MIN_POSITIVE, 1e-3, 1.0, 1e7] {
        for feature in [solid(radius), Feature { radius, ..runway() }] {
            for visibility in [None, Some(1e-300), Some(1000.0)] {
                for place in [DVec3::ZERO, DVec3::X * radius, DVec3::Y * (radius * 0.5), DVec3::NEG_Z * radius] {
                    // Where the coordinates are too coarse for the step, the eye is on the centre.
                    let eye = feature.centre + place;
                    if eye.distance(feature.centre) > radius {
                        continue;
                    }
                    let elements = elements(&feature, eye, FACTOR, visibility);
                    assert_eq!(elements, f64::INFINITY, "{radius} {place} {visibility:?}");
                    assert_eq!(LevelTable::default().weights(elements, 4), [1.0, 0.0, 0.0, 0.0]);
                    asked += 1;
                }
            }
        }
    }
    report(
        "detail parameter at no slant range, and within r_c",
        "infinite: full detail",
        &format!("{asked} of {asked}"),
    );
}

/// `N_e` over a runway by its definition (seed 004, 3.4), from the angle itself: how much the near half subtends that reaches
/// `r_e` towards the eye along the ground, seen from a height H at a ground range `R_g`.
fn by_angles(feature: &Feature, eye: DVec3) -> f64 {
    let lying = feature.lying.unwrap();
    let sight = feature.centre - eye;
    let theta = sight.xz().angle_to(lying.axis);
    let inverse = (theta.cos() / lying.long).powi(2) + (theta.sin() / lying.short).powi(2);
    let (ground, height) = (sight.xz().length(), sight.y.abs());
    let near = ground - inverse.sqrt().recip();
    let subtended = (height.atan2(near) - height.atan2(ground)).tan();
    if subtended >= 0.0 { FACTOR * subtended } else { f64::INFINITY }
}

#[test]
fn over_a_surface_feature_the_parameter_is_the_subtended_angles() {
    let feature = runway();
    let mut largest = 0.0f64;
    let (mut finite, mut full) = (0, 0);
    for height in [1e-6, 0.1, 3.0, 100.0, 1e4] {
        for bearing in 0..48 {
            for ground in [0.0, 1e-9, 20.0, 22.5, 23.0, 1000.0, 1500.0, 1500.0 + 1e-6, 5000.0, 2e5] {
                let towards = DVec2::from_angle(f64::from(bearing) * std::f64::consts::TAU / 48.0) * ground;
                for height in [height, -height] {
                    let eye = feature.centre + DVec3::new(towards.x, height, towards.y);
                    let found = elements(&feature, eye, FACTOR, None);
                    assert!(!found.is_nan() && found >= 0.0);
                    if ground < 1e-3 {
                        // Without a ground track there is no direction: only that it is a number counts.
                        continue;
                    }
                    let expected = by_angles(&feature, eye);
                    if found.is_finite() && expected.is_finite() {
                        // Where the angle is near a right one its tangent is no number to compare.
                        largest = largest.max((found - expected).abs() / (1.0 + expected) / (1.0 + expected / FACTOR));
                        finite += 1;
                    } else {
                        let either = if found.is_finite() { found } else { expected };
                        assert!(either > 1e6, "one says full detail, the other {either}, {height} m over {towards}");
                        full += 1;
                    }
                }
            }
        }
    }
    assert!(finite > 1000 && full > 100, "{finite} and {full}");
    assert!(largest < 1e-5, "{largest}");
    report(
        "detail parameter over a surface feature",
        "the angle's, or full detail; never NaN",
        &format!("{finite} angles, at most {largest:.1e} off; {full} full"),
    );
}

#[test]
fn a_long_feature_comes_late_when_it_is_looked_along() {
    let feature = runway();
    let lying = feature.lying.unwrap();
    let from = |direction: DVec2| {
        let place = direction * 40_000.0;
        elements(&feature, feature.centre + DVec3::new(place.x, 300.0, place.y), FACTOR, None)
    };
    let (along, across) = (from(lying.axis), from(lying.axis.perp()));
    assert!(along / across > 50.0, "the long radius is towards the eye: {along} and {across}");
    assert_eq!(elements(&feature, feature.centre + DVec3::X * 40_000.0, FACTOR, None), 0.0, "edge on");
}

#[test]
fn at_band_edges_weights_go_over_without_a_step() {
    let table = LevelTable::default();
    // The report's own example.
    assert_eq!(table.weights(6.75, 4), [0.0, 0.25, 0.75, 0.0]);
    let mut edges = vec![table.fade.0, table.fade.1];
    edges.extend(table.steps.iter().flat_map(|(from, to)| [*from, *to]));
    let mut largest = 0.0f64;
    for versions in 1..=limits::VERSIONS_MAX {
        for &edge in &edges {
            let around = [edge.next_down(), edge, edge.next_up()].map(|elements| table.weights(elements, versions));
            for weights in &around {
                for (a, b) in weights.iter().zip(&around[1]) {
                    largest = largest.max(f64::from((a - b).abs()));
                }
            }
            let at = &around[1];
            assert!(at.iter().filter(|weight| **weight > 0.0).count() <= 1, "{edge}: one level alone, {at:?}");
        }
        assert_eq!(table.weights(table.fade.0, versions).iter().sum::<f32>(), 0.0);
        assert_eq!(table.weights(f64::INFINITY, versions)[0], 1.0);
    }
    assert!(largest <= 1.0 / GRAIN, "{largest}");
    report(
        "detail at band edges, and one bit beside them",
        "one level alone; no step above 1/65536",
        &format!("{} edges, largest step {largest:.1e}", edges.len()),
    );
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        any::<u64>().prop_map(f64::from_bits),
        -1e7..1e7f64,
        Just(0.0),
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(f64::MIN_POSITIVE / 2.0),
    ]
}

fn any_point() -> impl Strategy<Value = DVec3> {
    (any_number(), any_number(), any_number()).prop_map(|(x, y, z)| DVec3::new(x, y, z))
}

proptest! {
    #[test]
    fn no_number_makes_a_parameter_that_is_none(
        centre in any_point(), eye in any_point(), radius in any_number(), factor in 1.0..1e9f64,
        lying in prop::option::of((any_number(), any_number(), 0.0..7.0f64)),
        visibility in prop::option::of(f64::MIN_POSITIVE..1e9), versions in 1..=limits::VERSIONS_MAX,
    ) {
        let lying = lying.map(|(a, b, angle)| {
            let (a, b) = (a.abs(), b.abs());
            Lying { long: a.max(b), short: a.min(b), axis: DVec2::from_angle(angle) }
        });
        let elements = elements(&Feature { centre, radius: radius.abs(), lying }, eye, factor, visibility);
        prop_assert!(elements >= 0.0, "{}", elements);
        let table = LevelTable::default();
        let weights = table.weights(elements, versions);
        prop_assert!(weights.iter().all(|weight| (0.0..=1.0).contains(weight)));
        prop_assert!(weights.iter().sum::<f32>() <= 1.0);
        prop_assert_eq!(table.is_finest(elements, versions), weights[0] == 1.0);
    }

    #[test]
    fn weights_sum_to_one_and_mix_neighbours(elements in 0.0..600.0f64, versions in 1..=limits::VERSIONS_MAX) {
        let table = LevelTable::default();
        let weights = table.weights(elements, versions);
        let shown: Vec<usize> = (0..versions).filter(|&v| weights[v] > 0.0).collect();
        prop_assert!(shown.len() <= 2 && shown.windows(2).all(|pair| pair[0] + 1 == pair[1]), "{:?}", weights);
        let sum: f32 = weights.iter().sum();
        if elements >= 1.0 {
            prop_assert_eq!(sum, 1.0);
        } else {
            prop_assert!((f64::from(sum) - (2.0 * elements - 1.0).max(0.0)).abs() <= 1.0 / GRAIN);
        }
        // lod.md's default table, as it stands there.
        let alone = (1..versions).find(|&level| elements < 1.5 * (level * level) as f64);
        if let Some(level) = alone.filter(|&level| level == 1 || elements >= 1.5 * (level * (level - 1)) as f64) {
            prop_assert!(shown.iter().all(|&version| version == versions - level), "{:?}", weights);
        }
    }

    #[test]
    fn who_comes_nearer_sees_no_less(
        radius in 0.01..1000.0f64, from in 1.0..100.0f64, nearer in 0.0..1.0f64,
        visibility in prop::option::of(100.0..1e6f64),
    ) {
        let feature = solid(radius);
        let at = |times: f64| elements(&feature, feature.centre + DVec3::X * (radius * times), FACTOR, visibility);
        prop_assert!(at(1.0 + (from - 1.0) * nearer) >= at(from) * (1.0 - 1e-9));
    }
}

/// A thing of one triangle a version, `levels` of them, that says of itself what `extras` says; and a bystander.
fn scene(extras: Extras, levels: u32) -> Scene {
    let primitive = Primitive {
        positions: vec![[-3.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        triangles: vec![[0, 1, 2]],
        ..Primitive::default()
    };
    let mut parts = Parts::default();
    let shape = parts.add_shape("t", Extras::default(), PieceSource::plain(split(&primitive), 0));
    for version in 0..levels {
        parts.nodes.push(NodeSource {
            name: format!("v{version}"),
            parent: (version > 0).then_some(0),
            shape,
            levels: if version == 0 { levels } else { 0 },
            version: Some(version),
            extras: if version == 0 { extras.clone() } else { Extras::default() },
            ..NodeSource::default()
        });
    }
    parts.nodes.push(NodeSource {
        local: DAffine3::from_translation(DVec3::X * 100.0),
        shape,
        ..NodeSource::default()
    });
    Scene::assemble(parts).unwrap()
}

fn shown(scene: &Scene, entities: &Entities, given: &[VersionWeights], eye: DVec3) -> Option<Vec<f32>> {
    let mut out = vec![VersionWeights { model: ModelId(7), weights: Vec::new() }];
    Detail::new(scene, DetailMode::Auto, LevelTable::default())
        .select(scene, entities, given, eye, FACTOR, None, &mut out);
    assert!(out.len() <= 1);
    out.pop().map(|found| found.weights)
}

#[test]
fn a_model_is_shown_by_what_its_radius_spans_wherever_it_was_moved() {
    let said = Extras { critical_radius: Some(2.0), ..Extras::default() };
    let scene = scene(said, 3);
    let still = Entities::new(&scene);
    let middle = Detail::new(&scene, DetailMode::Auto, LevelTable::default()).at_rest[0].unwrap().centre;
    // So far away that K r_c / R_s is 6.75: three quarters of level 2, a quarter of level 3.
    let distance = FACTOR * 2.0 / 6.75;
    assert_eq!(shown(&scene, &still, &[], middle + DVec3::Y * distance), Some(vec![0.25, 0.75, 0.0]));
    assert_eq!(shown(&scene, &still, &[], middle), None, "the finest alone needn't be named");
    assert_eq!(shown(&scene, &still, &[], middle + DVec3::Y * 1e5), Some(vec![0.0; 3]), "faded to nothing");

    let mut moved = still.clone();
    let to = Pose { position: DVec3::new(5000.0, 0.0, 0.0), orientation: DQuat::from_rotation_y(1.0) };
    moved.set(&scene, NodeIndex(0), to);
    let there = to.orientation * middle + to.position;
    assert_eq!(shown(&scene, &moved, &[], there + DVec3::Z * distance), Some(vec![0.25, 0.75, 0.0]));

    let given = [VersionWeights { model: ModelId(0), weights: vec![0.0, 0.0, 1.0] }];
    assert_eq!(shown(&scene, &moved, &given, there), Some(vec![0.0, 0.0, 1.0]), "the host's word holds");
}

#[test]
fn a_surface_feature_lies_as_its_geometry_does() {
    let surface = Extras { surface: Some(true), ..Extras::default() };
    let scene = scene(surface, 2);
    let lies = |entities: &Entities| feature(&scene, entities, &scene.models[0]).lying.unwrap();
    let mut entities = Entities::new(&scene);
    let still = lies(&entities);
    assert!((still.long - 3.0).abs() < 1e-9 && (still.short - 0.5).abs() < 1e-9, "{still:?}");
    assert!(still.axis.perp_dot(DVec2::X).abs() < 1e-9, "{still:?}");
    entities.set(&scene, NodeIndex(0), Pose { position: DVec3::ZERO, orientation: DQuat::from_rotation_y(0.7) });
    let turned = lies(&entities);
    let axis = (DQuat::from_rotation_y(0.7) * DVec3::X).xz();
    assert!((turned.long - 3.0).abs() < 1e-9 && turned.axis.perp_dot(axis).abs() < 1e-9, "{turned:?}");

    let line = lying(&[DVec2::ZERO, DVec2::new(3.0, 4.0)]);
    assert_eq!((line.long, line.short), (2.5, 0.0));
    let point = lying(&[DVec2::ONE]);
    assert_eq!((point.long, point.short), (0.0, 0.0));
    for found in [line, point, lying(&[])] {
        for angle in 0..8 {
            assert!(found.effective_radius(DVec2::from_angle(f64::from(angle))) >= 0.0);
        }
    }
}
