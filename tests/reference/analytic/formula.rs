//! The translucency formula and its two consequences, layers in one plane, and models with versions.

use super::*;
use crate::{Fragment, Member, Options, composite, sample};

fn random_fragments(random: &mut Random, count: usize, member: Option<Member>) -> Vec<Fragment> {
    (0..count)
        .map(|_| Fragment {
            depth: random.between(1.0, 100.0),
            rank: (0, 0, 0),
            color: std::array::from_fn(|_| random.between(0.0, 2.0)),
            alpha: if random.next() < 0.2 { 1.0 } else { random.next() },
            is_opaque: false,
            member,
        })
        .collect()
}

#[test]
fn a_model_in_transition_is_the_weighted_mean_of_its_versions() {
    let mut random = Random(3);
    for _ in 0..200 {
        let w = random.next();
        let around = random_fragments(&mut random, 3, None);
        let a = random_fragments(&mut random, 4, Some(Member { model: 0, version: 0 }));
        let b = random_fragments(&mut random, 2, Some(Member { model: 0, version: 1 }));
        let show = |weights: &[f64], parts: &[&[Fragment]]| {
            let models = [Model { weights: weights.to_vec(), merged: false }];
            composite(&parts.concat(), &models, [0.2, 0.4, 0.6])
        };
        let both = show(&[w, 1.0 - w], &[&around, &a, &b]);
        let (first, second) = (show(&[1.0, 0.0], &[&around, &a]), show(&[0.0, 1.0], &[&around, &b]));
        let mean = std::array::from_fn(|k| w * first[k] + (1.0 - w) * second[k]);
        assert_close(both, mean, 1e-13);
        // A version without weight might as well not be there; a lone version is an ordinary stack.
        assert_close(show(&[1.0, 0.0], &[&around, &a, &b]), first, 1e-13);
        let ordinary: Vec<Fragment> = a.iter().map(|f| Fragment { member: None, ..*f }).collect();
        assert_close(show(&[], &[&around, &ordinary]), first, 1e-13);
    }
}

#[test]
fn an_ordinary_scene_is_the_ordinary_over() {
    let mut random = Random(4);
    for count in [0, 1, 2, 10, 1000] {
        let fragments = random_fragments(&mut random, count, None);
        let background = [0.3, 0.6, 0.9];
        // From the back to the front.
        let mut sorted = fragments.clone();
        sorted.sort_by(|a, b| b.depth.total_cmp(&a.depth));
        let want = sorted
            .iter()
            .fold(background, |behind, f| std::array::from_fn(|k| f.color[k] * f.alpha + behind[k] * (1.0 - f.alpha)));
        assert_close(composite(&fragments, &[], background), want, 1e-12);
    }
}

#[test]
fn a_thousand_layers_in_any_order_lose_none() {
    let mut random = Random(9);
    // So thin that all of them are seen.
    let mut layers: Vec<Mesh> = (0..1000)
        .map(|k| mesh(&wall(2.0 + f64::from(k)), glass(std::array::from_fn(|_| random.next() as f32), 0.002)))
        .collect();
    let options = Options { spacing: None, ..Options::truth(1, 1) };
    let picture = |layers: &[Mesh]| sample(&world(layers), &state([1.0; 3]), &view(), &options).at(4, 4);
    let in_order = picture(&layers);
    let want = layers.iter().rev().fold([1.0; 3], |behind: [f64; 3], mesh| {
        let [r, g, b, alpha] = mesh.material.base_color.map(f64::from);
        std::array::from_fn(|k| [r, g, b][k] * alpha + behind[k] * (1.0 - alpha))
    });
    assert_close(in_order, want, 1e-12);
    for i in (1..layers.len()).rev() {
        layers.swap(i, (random.next() * (i + 1) as f64) as usize);
    }
    assert_close(picture(&layers), in_order, 1e-15);
}

#[test]
fn three_models_in_transition_multiply_what_shines_through() {
    // Opaque versions at depths 1 to 6: model g has version 0 nearer, version 1 farther.
    let weights = [[0.25, 0.75], [0.5, 0.5], [0.9, 0.1]];
    let models: Vec<Model> = weights.iter().map(|w| Model { weights: w.to_vec(), merged: false }).collect();
    let mut fragments = Vec::new();
    for model in 0..3 {
        for version in 0..2 {
            fragments.push(Fragment {
                depth: (model * 2 + version) as f64,
                rank: (0, 0, 0),
                color: std::array::from_fn(|k| if k == model { 1.0 } else { 0.0 }),
                alpha: 1.0,
                is_opaque: true,
                member: Some(Member { model, version }),
            });
        }
    }
    // Each model covers the point in both versions, so together they let nothing through: only the first is seen.
    assert_close(composite(&fragments, &models, [5.0; 3]), [1.0, 0.0, 0.0], 1e-15);
    // Without its farther version a model lets that version's weight through.
    fragments.retain(|f| f.member.is_some_and(|m| m.version == 0));
    let want = [0.25, 0.75 * 0.5, 0.75 * 0.5 * 0.9].map(|c| c + 5.0 * 0.75 * 0.5 * 0.1);
    assert_close(composite(&fragments, &models, [5.0; 3]), want, 1e-15);
}

#[test]
fn of_a_merged_model_only_the_nearest_puff_counts() {
    let mut meshes: Vec<Mesh> = (0..40).map(|k| mesh(&wall(50.0 - f64::from(k)), glass([0.5; 3], 0.25))).collect();
    meshes.push(mesh(&wall(60.0), glass([1.0, 0.0, 0.0], 0.5)));
    meshes.push(mesh(&wall(30.5), paint([0.0, 1.0, 0.0])));
    let mut world = world(&meshes);
    world.models = vec![Model { weights: vec![1.0], merged: true }];
    for (i, instance) in world.instances.iter_mut().enumerate() {
        // The red pane belongs to no one, the opaque wall is part of the cloud.
        instance.member = (i != 40).then_some(Member { model: 0, version: 0 });
    }
    let options = Options::truth(1, 1);
    assert_close(sample(&world, &state([1.0; 3]), &view(), &options).at(2, 2), [0.125, 0.875, 0.125], 1e-12);
    world.instances.remove(41);
    // Without the wall: the puff, then the pane, then the background.
    let want = [0.125 + 0.75, 0.125 + 0.75 * 0.5, 0.125 + 0.75 * 0.5];
    assert_close(sample(&world, &state([1.0; 3]), &view(), &options).at(2, 2), want, 1e-12);
}

#[test]
fn versions_of_a_drawn_model_mix_as_their_pictures() {
    let meshes = [
        mesh(&rectangle(1.0, 1.0, 5.3, 7.0, 4.0), paint([1.0, 0.5, 0.0])),
        mesh(&rectangle(2.0, 2.0, 7.0, 5.5, 3.0), glass([0.0, 0.5, 1.0], 0.5)),
    ];
    let options = Options::truth(16, 16);
    let picture = |weights: &[f64]| sample(&versions(&meshes, weights), &state([0.1; 3]), &view(), &options);
    let (both, first, second) = (picture(&[0.375, 0.625]), picture(&[1.0, 0.0]), picture(&[0.0, 1.0]));
    for i in 0..both.linear.len() {
        let mean = std::array::from_fn(|k| 0.375 * first.linear[i][k] + 0.625 * second.linear[i][k]);
        assert_close(both.linear[i], mean, 1e-14);
    }
}

#[test]
fn in_one_plane_the_higher_layer_wins_then_the_later_in_the_file() {
    // A slanted floor and two markings on it, cut from other corners, so that their depths differ in the last digits.
    let floor = |left: f64, right: f64| {
        // Depth depends on y alone: 1/w = y/24.
        let w = |y: f64| 24.0 / y;
        quad([(left, 7.7), (right, 7.7), (right, 1.3), (left, 1.3)].map(|(x, y)| on_screen(x, y, w(y))))
    };
    let [red, green, blue] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let meshes = [
        mesh(&floor(0.37, 7.9), paint(red)),
        mesh(&floor(1.91, 6.1), paint(green)),
        mesh(&floor(2.3, 5.3), paint(blue)),
    ];
    let options = Options::truth(16, 16);
    for (layers, want) in
        [([0, 0, 0], blue), ([0, 1, 0], green), ([1, 0, 0], red), ([0, 1, 1], blue), ([-1, -1, -2], green)]
    {
        let mut world = world(&meshes);
        for (instance, layer) in world.instances.iter_mut().zip(layers) {
            instance.layer = layer;
        }
        let picture = sample(&world, &state([0.0; 3]), &view(), &options);
        let integral = crate::integrate(&world, &state([0.0; 3]), &view(), crate::Vertices::Exact, 0.25).unwrap();
        for y in 2..7 {
            for x in 3..5 {
                assert_close(picture.at(x, y), want.map(f64::from), 1e-12);
                assert_close(integral.at(x, y), want.map(f64::from), 1e-12);
            }
        }
    }
}
