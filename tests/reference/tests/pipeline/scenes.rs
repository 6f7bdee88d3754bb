//! Whole scenes: the pipeline's linear colours against the reference's, for the same rounded vertices and points.

use super::*;
use manager::scene::split::{Primitive, split};
use manager::scene::{Extras, NodeSource, Parts, PieceSource};
use proto::frame::Background;
use proto::ids::ModelId;
use proto::scene::{Filter, LightKind, LightRow, ModelPart, ModelRow, PlaneRow, TextureUse, Wrap};

#[test]
fn random_faces_have_the_references_colours() {
    let mut random = Random(21);
    let (mut worst, mut worst_linear) = (0.0f64, 0.0f64);
    for round in 0..80 {
        let samples = ALL_SAMPLES[round % 5];
        let count = 1 + random.below(40);
        let content = random_content(&mut random, count);
        let mut state = state(Pose::checked(random.vector(0.1), DQuat::from_rotation_y(0.05)).unwrap());
        state.environment.visibility_m = (round % 3 == 0).then_some(8.0);
        // A sky is no face: what it is worth within a pixel has a test of its own.
        state.environment.background = Background::Constant([0.2, 0.3, 0.4]);
        let tangents = Tangents { left: -0.9, right: 1.1, bottom: -0.7, top: 1.0 };
        let view = view(40, 34, tangents, samples);
        let report = report(&content, &state, &view);
        assert!(report.all.max_255 <= 1.0, "round {round}, {samples:?}: {report}");
        worst = worst.max(report.all.max_255);
        worst_linear = worst_linear.max(report.all.max_linear);
    }
    println!("80 random scenes: worst {worst:.4}/255, {worst_linear:.1e} linear");
}

#[test]
fn models_in_transition_and_merged_ones_have_the_references_colours() {
    let mut random = Random(23);
    let mut worst = 0.0f64;
    for round in 0..40 {
        let mut content = random_content(&mut random, 50);
        for model in 0..4 {
            let versions = 1 + random.below(3);
            content.table.models.push(ModelRow { merged: random.below(2) == 0, versions });
            let weights: Vec<f64> = (0..versions).map(|_| random.unit()).collect();
            // Some have a version that shows nothing.
            let sum: f64 = weights.iter().sum::<f64>() + f64::from(random.below(2));
            let weights = weights.iter().map(|w| (w / sum) as f32).collect();
            content.weights.push(VersionWeights { model: ModelId(model), weights });
        }
        for row in &mut content.table.subobjects {
            let model = random.below(8);
            if let Some(of) = content.table.models.get(model as usize) {
                row.part_of = Some(ModelPart { model: ModelId(model), version: random.below(of.versions) });
            }
        }
        let mut state = state(Pose::IDENTITY);
        state.environment.background = Background::Constant([0.2, 0.3, 0.4]);
        let tangents = Tangents { left: -0.9, right: 1.1, bottom: -0.7, top: 1.0 };
        let view = view(40, 34, tangents, ALL_SAMPLES[round % 5]);
        let report = report(&content, &state, &view);
        assert!(report.all.max_255 <= 1.0, "round {round}: {report}");
        worst = worst.max(report.all.max_linear);
    }
    println!("40 scenes with models: {worst:.1e} linear");
}

#[test]
fn the_lights_of_a_scene_are_the_references() {
    let mut random = Random(24);
    for round in 0..20 {
        let mut content = random_content(&mut random, 30);
        for _ in 0..3 {
            let range = (random.below(2) == 0).then_some(8.0);
            let kind = match random.below(3) {
                0 => LightKind::Directional,
                1 => LightKind::Point { range },
                _ => LightKind::Spot { range, inner_cos: 0.95, outer_cos: 0.4 },
            };
            let strength = if kind == LightKind::Directional { 0.5 } else { 4.0 };
            content.table.lights.push(LightRow {
                kind,
                intensity: [0; 3].map(|_| (strength * random.unit()) as f32),
                position: random.vector(3.0) + DVec3::new(0.0, 0.0, -4.0),
                direction: random.vector(1.0).normalize(),
            });
        }
        let mut state = state(Pose::IDENTITY);
        state.environment.scene_lights = true;
        state.environment.background = Background::Constant([0.2, 0.3, 0.4]);
        let view = view(40, 34, Tangents::symmetric(60.0, 40, 34), ALL_SAMPLES[round % 5]);
        let report = report(&content, &state, &view);
        assert!(report.all.max_255 <= 1.0, "round {round}: {report}");
    }
}

#[test]
fn two_sets_of_texture_coordinates_with_transformations_are_the_references() {
    let mut random = Random(25);
    let mut content = Content::default();
    let texture = Texture {
        width: 8,
        height: 8,
        texels: (0..64).map(|_| [0; 4].map(|_| 64 + random.below(192) as u8)).collect(),
    };
    let id = ContentId([7; 16]);
    content.textures.insert(id, Arc::new(texture));
    let of_set = |set: u32, random: &mut Random| TextureUse {
        texture: id,
        set,
        transform: [0; 2].map(|_| [0; 3].map(|_| random.between(-1.0, 1.0) as f32)),
        wrap_u: Wrap::Repeat,
        wrap_v: Wrap::Mirror,
        magnify: Filter::Linear,
    };
    for k in 0..6 {
        let z = -2.0 - 0.5 * f64::from(k);
        let points = [[-3.0, -2.0], [3.0, -2.5], [0.5, 2.5]].map(|[x, y]| DVec3::new(x, y, z) + random.vector(0.7));
        let material = Material {
            base_color: [0.8, 0.8, 0.8, 0.5],
            alpha: Alpha::Blend,
            double_sided: true,
            emissive: [0.3; 3],
            base_texture: Some(of_set(1 - k % 2, &mut random)),
            emissive_texture: Some(of_set(k % 2, &mut random)),
            ..Material::default()
        };
        let mut mesh = mesh(&points, material);
        mesh.texcoords = (0..2).map(|_| (0..3).map(|_| [0; 2].map(|_| random.unit() as f32)).collect()).collect();
        content.add(mesh, DAffine3::IDENTITY);
    }
    let view = view(96, 64, Tangents::symmetric(60.0, 96, 64), Samples::Sixteen);
    let state = state(Pose::IDENTITY);
    let truth = content.reference(&state, &view);
    let (linear, _) = content.draw(&state, &view);
    let report = compare(Shown::Linear(&linear), &truth);
    println!("two sets of coordinates\n{report}");
    assert!(report.magnified.pixels > 1000 && report.magnified.p99_255 <= 1.0, "{report}");
    // It would be seen if the sets were mistaken for each other.
    for mesh in content.meshes.values_mut() {
        Arc::make_mut(mesh).texcoords.swap(0, 1);
    }
    let mistaken = compare(Shown::Linear(&linear), &content.reference(&state, &view));
    assert!(mistaken.magnified.rms_255 > 3.0, "{mistaken}");
}

#[test]
fn markings_on_a_runway_seen_at_half_a_degree_from_10_km_lie_on_it() {
    let rectangle = |x0: f64, x1: f64, z0: f64, z1: f64| {
        let [a, b, c, d] = [(x0, z1), (x1, z1), (x1, z0), (x0, z0)].map(|(x, z)| DVec3::new(x, 0.0, z));
        [a, b, c, a, c, d]
    };
    let mut content = Content::default();
    for k in 0..8u32 {
        // Each a little smaller than the one before, in corners that no other has, and in an order unlike the layers'.
        let inset = f64::from(k * 5 % 8);
        let points =
            rectangle(-30.0 + 2.31 * inset, 30.0 - 1.93 * inset, -1500.0 + 97.3 * inset, 1500.0 - 83.1 * inset);
        let shade = (inset as f32 + 1.0) / 8.0;
        content.add(
            mesh(&points, Material { base_color: [shade, 1.0 - shade, 0.5, 1.0], unlit: true, ..Material::default() }),
            DAffine3::IDENTITY,
        );
        let row = &mut content.table.subobjects[k as usize];
        (row.layer, row.planes) = (inset as i32, Some(k * 2));
        content.table.face_planes.extend([0, 0]);
    }
    content.table.planes = vec![PlaneRow { object: ObjectId(0), normal: DVec3::Y, offset: 0.0 }];
    let mut differences = 0;
    for (distance, degrees) in [(10_000.0, 0.5f64), (2_000.0, 0.5), (50_000.0, 5.0)] {
        let eye = DVec3::new(3.7, distance * degrees.to_radians().tan(), distance);
        let mut state = state(Pose::looking_at(eye, DVec3::ZERO, DVec3::Y).unwrap());
        state.environment.background = Background::Constant([0.2, 0.3, 0.4]);
        let view = view(96, 54, Tangents::symmetric(4e4 / distance.max(1e4) / 10.0, 96, 54), Samples::Sixteen);
        let report = report(&content, &state, &view);
        println!("runway from {distance} m at {degrees}°: {}", report.all);
        assert!(report.all.max_255 <= 1.0, "{report}");
        let (by_layer, by_depth) = by_layer_and_by_depth(&content, &state, &view);
        differences += by_layer.linear.iter().zip(&by_depth.linear).filter(|(a, b)| a != b).count();
    }
    assert!(differences > 100, "by depth alone it would be another picture");
}

#[test]
fn a_displaced_and_turned_view_is_the_references() {
    let mut random = Random(22);
    let content = random_content(&mut random, 60);
    let offset = Pose::checked(DVec3::new(0.3, -0.2, 0.4), DQuat::from_rotation_y(0.4)).unwrap();
    let mut state = state(Pose::checked(random.vector(0.5), DQuat::from_rotation_z(0.3)).unwrap());
    state.environment.visibility_m = Some(20.0);
    state.environment.background = Background::Constant([0.5; 3]);
    let tangents = Tangents { left: -0.2, right: 1.3, bottom: -1.0, top: 0.4 };
    let view = View { offset, ..view(64, 48, tangents, Samples::Sixteen) };
    let report = report(&content, &state, &view);
    println!("a displaced view:\n{report}");
    assert!(report.all.max_255 <= 1.0);
}

#[test]
fn the_sky_is_the_references() {
    for samples in ALL_SAMPLES {
        let eye = Pose::checked(DVec3::ZERO, DQuat::from_rotation_x(0.2) * DQuat::from_rotation_z(0.3)).unwrap();
        // The pipeline takes a pixel's sky at its centre. That shows where the gradient has a kink, at 0° and 30° of
        // elevation, and grows with the pixel: 1.0/255 where pixels are 1.7° (64 × 36), the sixth part here.
        let view = view(384, 216, Tangents::symmetric(60.0, 384, 216), samples);
        let report = report(&Content::default(), &state(eye), &view);
        println!("sky, {samples:?}: {}", report.all);
        assert!(report.all.max_255 <= 0.25, "{report}");
    }
}

/// What is required of every scene: same coverage, same untextured colour.
fn assert_agrees(name: &str, report: &Report) {
    println!("{name}\n{report}");
    assert!(report.untextured.max_255 <= 1.0, "{name}: untextured interior\n{report}");
    assert!(report.magnified.p99_255 <= 6.0, "{name}: magnified\n{report}");
}

#[test]
fn imported_models_have_the_references_colours() {
    let Some(data) = data() else { return };
    for name in [
        "SimpleInstancing.glb",
        "a4-skyhawk/a4-skyhawk.glb",
        "CesiumMilkTruck.glb",
        "VertexColorTest.glb",
        "TextureSettingsTest.glb",
        "house.glb",
        "odyssey-controller-left.glb",
    ] {
        let scene = import::load(&data.join("models").join(name)).unwrap();
        let pose = orbit(&scene);
        for samples in [Samples::One, Samples::Sixteen] {
            let view = view(96, 64, pose.lens(96, 64), samples);
            let (content, state) = posed(&scene, &pose);
            assert_agrees(&format!("{name}, {samples:?}"), &report(&content, &state, &view));
        }
    }
}

#[test]
fn untextured_models_agree_in_every_pixel() {
    let Some(data) = data() else { return };
    // The city's buildings without their texture: double-sided, with normals.
    for name in ["SimpleInstancing.glb", "a4-skyhawk/a4-skyhawk.glb", "kenney-city/building-small-a.glb"] {
        let path = data.join("models").join(name);
        if !path.exists() {
            println!("SKIPPED: no {name}");
            continue;
        }
        let scene = import::load(&path).unwrap();
        let pose = orbit(&scene);
        let (mut content, state) = posed(&scene, &pose);
        for mesh in content.meshes.values_mut() {
            let mesh = Arc::make_mut(mesh);
            (mesh.material.base_texture, mesh.material.emissive_texture) = (None, None);
        }
        let view = view(160, 90, pose.lens(160, 90), Samples::SixtyFour);
        let report = report(&content, &state, &view);
        println!("{name}, untextured\n{report}");
        assert!(report.all.max_255 <= 1.0, "{name}");
    }
}

#[test]
fn the_airport_without_textures_agrees_in_every_pixel() {
    // Markings on runways among it, faces in one plane, ordered by layers; the reference finds that order by itself.
    // And what stands on them: wheels, masts, walls.
    let (scene, camera) = airport();
    let count = camera.poses.len();
    for pose in [0, count / 3, count / 2, count - 1].map(|i| &camera.poses[i]) {
        let (content, state, view) = airport_without_textures(&scene, pose);
        let (linear, _) = content.draw(&state, &view);
        let truth = content.reference(&state, &view);
        let wrong = unlike(&linear, &truth);
        let all = compare(Shown::Linear(&linear), &truth).all;
        println!("airport from {:?}, untextured: {} pixels are unlike; {all}", pose.eye, wrong.len());
        assert!(wrong.is_empty(), "pixels {wrong:?}");
    }
}

/// 192 × 108 pixels of 16 points.
fn airport_without_textures(scene: &Scene, pose: &CameraPose) -> (Content, FrameState, View) {
    let (mut content, mut state) = posed(scene, pose);
    state.environment.background = Background::Constant([0.2, 0.3, 0.4]);
    for mesh in content.meshes.values_mut() {
        let mesh = Arc::make_mut(mesh);
        (mesh.material.base_texture, mesh.material.emissive_texture) = (None, None);
    }
    (content, state, view(192, 108, pose.lens(192, 108), Samples::Sixteen))
}

/// The pixels whose colour isn't that of the reference.
fn unlike(linear: &[f32], truth: &Picture) -> Vec<usize> {
    let is_unlike = |(drawn, truth): (&[f32], &[f64; 3])| {
        drawn.iter().zip(truth).any(|(drawn, truth)| (f64::from(*drawn) - truth).abs() > 1e-6)
    };
    linear
        .chunks(3)
        .zip(&truth.linear)
        .map(is_unlike)
        .enumerate()
        .filter(|(_, unlike)| *unlike)
        .map(|(i, _)| i)
        .collect()
}

/// The reference's picture by the page's rule for coplanar faces, and by depth alone.
fn by_layer_and_by_depth(content: &Content, state: &FrameState, view: &View) -> (Picture, Picture) {
    let (world, options) = (content.world(), like_pipeline(view.samples));
    let by_depth = Options { layers: false, ..options.clone() };
    (reference::sample(&world, state, view, &options), reference::sample(&world, state, view, &by_depth))
}

/// picture.md: "where planes coincide the higher layer wins …; in one layer, the later in the file". At the airport
/// the sides of `taxiways` and `aprons`, in one plane, touch along a line whose vertices differ; rounded, they
/// overlap by part of 1/256 pixel, and at pixel (54, 60) a point hits both. Depth, of which each has a rounding of its own, showed
/// the taxiway; the apron, later in the file, must win.
#[test]
fn faces_in_one_plane_that_touch_are_ordered_by_layer() {
    let (scene, camera) = airport();
    let (content, state, view) = airport_without_textures(&scene, camera.poses.last().unwrap());
    let (linear, _) = content.draw(&state, &view);
    let (by_layer, by_depth) = by_layer_and_by_depth(&content, &state, &view);
    let by_depth: Vec<f32> = by_depth.linear.iter().flatten().map(|c| *c as f32).collect();
    let touching = unlike(&by_depth, &by_layer);
    println!("pixels in which layer and depth differ: {touching:?}");
    assert!(touching.contains(&(60 * 192 + 54)), "the taxiway and the apron meet where they met");
    let wrong = unlike(&linear, &by_layer);
    assert!(wrong.is_empty(), "depth decided in pixels {wrong:?}");
}

/// Adds a square as a node of its own.
fn add_square(parts: &mut Parts, positions: [[f32; 3]; 4], base_color: [f32; 4], double_sided: bool, turn: DQuat) {
    let primitive = Primitive {
        positions: positions.to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material: Material { base_color, unlit: true, double_sided, ..Material::default() },
        ..Primitive::default()
    };
    let pieces = PieceSource::plain(split(&primitive), 0);
    let shape = parts.add_shape("square", Extras::default(), pieces).unwrap();
    let local = DAffine3::from_quat(turn);
    parts.nodes.push(NodeSource { local, shape: Some(shape), ..NodeSource::default() });
}

/// The same of two squares of different colours, from far and near: one side of theirs, with other vertices.
#[test]
fn squares_that_touch_are_ordered_by_their_place_in_the_file_from_anywhere() {
    let mut random = Random(31);
    let mut differences = 0;
    for round in 0..60 {
        let mut parts = Parts::default();
        let turn = DQuat::from_axis_angle(random.vector(1.0).normalize(), random.between(-0.3, 0.3));
        for (k, [x0, x1, z0, z1]) in
            [[-30.0, 1.3, -20.0, 20.0], [1.3, 40.0, -33.0, 27.1], [1.3, 9.0, 27.1, 41.7]].into_iter().enumerate()
        {
            let shade = k as f32 / 2.0;
            let positions = [[x0, 0.0, z1], [x1, 0.0, z1], [x1, 0.0, z0], [x0, 0.0, z0]];
            add_square(&mut parts, positions, [shade, 1.0 - shade, 0.5, 1.0], false, turn);
        }
        let scene = Scene::assemble(parts).unwrap();
        assert!(!scene.table.planes.is_empty());
        let distance = [30.0, 300.0, 3000.0][round % 3];
        let direction = turn * DVec3::new(random.between(-1.0, 1.0), random.between(0.02, 0.3), 1.0).normalize();
        let mut state = state(Pose::looking_at(direction * distance, DVec3::ZERO, DVec3::Y).unwrap());
        state.environment.background = Background::Constant([0.2, 0.3, 0.4]);
        let view = view(96, 54, Tangents::symmetric(4000.0 / distance.max(60.0), 96, 54), Samples::SixtyFour);
        let content = Content::of(&scene);
        let (linear, _) = content.draw(&state, &view);
        let (by_layer, by_depth) = by_layer_and_by_depth(&content, &state, &view);
        let wrong = unlike(&linear, &by_layer);
        assert!(wrong.is_empty(), "round {round}: pixels {wrong:?}");
        differences += unlike(&linear, &by_depth).len();
    }
    println!("squares that touch: {differences} pixels would be others by depth");
    assert!(differences > 5, "{differences}");
}

/// Walls that stand on, or go through, a ground whose faces share a plane with markings: along the line of contact a
/// fraction of 1/256 pixel decides which of the two is in front, and the lower the eye, the farther along the ground.
#[test]
fn what_stands_on_a_shared_plane_agrees_in_every_pixel() {
    let mut random = Random(37);
    let (mut by_corners, mut worst) = (0, 0.0f64);
    for round in 0..120 {
        let mut parts = Parts::default();
        let turn = DQuat::from_axis_angle(random.vector(1.0).normalize(), random.between(-0.3, 0.3));
        for [half, shade] in [[43.7f32, 0.2], [11.3, 0.7]] {
            let positions = [[-half, 0.0, half], [half, 0.0, half], [half, 0.0, -half], [-half, 0.0, -half]];
            add_square(&mut parts, positions, [shade, 1.0 - shade, 0.5, 1.0], false, turn);
        }
        for k in 0..12 {
            let [[x, z], [dx, dz]] = [20.0, 6.0].map(|size| [0; 2].map(|_| random.between(-size, size) as f32));
            let bottom = if k % 3 == 0 { -random.unit() as f32 } else { 0.0 };
            let top = random.between(0.5, 4.0) as f32;
            let positions = [[x, bottom, z], [x + dx, bottom, z + dz], [x + dx, top, z + dz], [x, top, z]];
            add_square(&mut parts, positions, [0.9, k as f32 / 12.0, 0.1, 1.0], true, turn);
        }
        let scene = Scene::assemble(parts).unwrap();
        assert!(!scene.table.planes.is_empty());
        // From well above to nearly in the plane, where faces are slivers a hundredth of a pixel wide. There none is
        // cut, for a cut sliver's outline may cross itself, and nothing is faded: where a rounded corner lies beyond
        // the plane's horizon, a pixel in some of these rounds is still faded differently.
        let height = [0.3, 0.03, 1e-3, 1e-6][round % 4] * random.between(0.1, 1.0);
        let is_edge_on = round % 4 == 3;
        let distance = [if is_edge_on { 100.0 } else { 30.0 }, 300.0, 3000.0][round % 3];
        let direction = turn * DVec3::new(random.between(-1.0, 1.0), height, 1.0).normalize();
        let mut state = state(Pose::looking_at(direction * distance, DVec3::ZERO, DVec3::Y).unwrap());
        state.environment.background = Background::Constant([0.2, 0.3, 0.4]);
        state.environment.visibility_m = (round % 7 == 0 && !is_edge_on).then_some(distance * 1.01);
        let samples = ALL_SAMPLES[round % 5];
        let view = view(96, 54, Tangents::symmetric(4000.0 / distance.max(60.0), 96, 54), samples);
        let mut content = Content::of(&scene);
        let is_coloured = round / 4 % 2 == 1;
        if is_coloured {
            // Colours at the vertices show how far along a face a place is.
            for mesh in content.meshes.values_mut() {
                let mesh = Arc::make_mut(mesh);
                mesh.colors = mesh.positions.iter().map(|_| [0; 4].map(|_| random.unit() as f32)).collect();
            }
        }
        let (linear, _) = content.draw(&state, &view);
        let truth = content.reference(&state, &view);
        let wrong = unlike(&linear, &truth);
        worst = worst.max(compare(Shown::Linear(&linear), &truth).all.max_255);
        assert!(wrong.is_empty(), "round {round}: pixels {wrong:?}");
        let own = reference::sample(&content.world().without_planes(), &state, &view, &like_pipeline(samples));
        by_corners += if is_edge_on || is_coloured { 0 } else { unlike(&linear, &own).len() };
    }
    println!("what stands on a plane: worst {worst:.4}/255; {by_corners} pixels would be others by rounded corners");
    assert!(by_corners > 100, "{by_corners}");
}

#[test]
fn the_airport_has_the_references_colours() {
    let (scene, camera) = airport();
    let count = camera.poses.len();
    for pose in [0, count / 3, count / 2, count - 1].map(|i| &camera.poses[i]) {
        let view = view(96, 64, pose.lens(96, 64), Samples::Four);
        let (content, mut state) = posed(&scene, pose);
        for visibility in [None, Some(3000.0)] {
            state.environment.visibility_m = visibility;
            let name = format!("airport from {:?}, visibility {visibility:?}", pose.eye);
            assert_agrees(&name, &report(&content, &state, &view));
        }
    }
}
