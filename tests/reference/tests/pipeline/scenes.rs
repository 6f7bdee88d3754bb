//! Whole scenes: the pipeline's linear colours against the reference's, for the same rounded vertices and points.

use super::*;
use proto::frame::Background;

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
        // The pipeline takes a pixel's sky at its centre. That shows where the gradient has a kink, at 0° and 30° of elevation, and
        // grows with the pixel: 1.0/255 where pixels are 1.7° (64 × 36), the sixth part here.
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
    // Markings on runways among it: faces in one plane, ordered by layers. The reference finds the planes by itself.
    let (scene, camera) = airport();
    let count = camera.poses.len();
    for pose in [0, count / 3, count / 2, count - 1].map(|i| &camera.poses[i]) {
        let (mut content, mut state) = posed(&scene, pose);
        state.environment.background = Background::Constant([0.2, 0.3, 0.4]);
        for mesh in content.meshes.values_mut() {
            let mesh = Arc::make_mut(mesh);
            (mesh.material.base_texture, mesh.material.emissive_texture) = (None, None);
        }
        let view = view(192, 108, pose.lens(192, 108), Samples::Sixteen);
        let report = report(&content, &state, &view);
        println!("airport from {:?}, untextured\n{report}", pose.eye);
        assert!(report.all.max_255 <= 1.0, "{report}");
    }
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
#[test]
fn dbg_air() {
    let (scene, camera) = airport();
    let count = camera.poses.len();
    for (pi, pose) in [0, count / 3, count / 2, count - 1].map(|i| &camera.poses[i]).into_iter().enumerate() {
        let (mut content, mut state) = posed(&scene, pose);
        state.environment.background = Background::Constant([0.2, 0.3, 0.4]);
        for mesh in content.meshes.values_mut() {
            let mesh = Arc::make_mut(mesh);
            (mesh.material.base_texture, mesh.material.emissive_texture) = (None, None);
        }
        let view = view(192, 108, pose.lens(192, 108), Samples::Sixteen);
        let (linear, _) = content.draw(&state, &view);
        let world = content.world();
        let a = reference::sample(&world, &state, &view, &like_pipeline(view.samples));
        let b = reference::sample(&world, &state, &view, &Options { layers: false, ..like_pipeline(view.samples) });
        let (ra, rb) = (compare(Shown::Linear(&linear), &a), compare(Shown::Linear(&linear), &b));
        println!("pose {pi} with layers\n{}\nwithout\n{}", ra.all, rb.all);
        let mut n = 0;
        for i in 0..a.linear.len() {
            let bad = (0..3).any(|k| (f64::from(linear[i*3+k]) - a.linear[i][k]).abs() > 2e-5);
            if bad { n += 1; if n < 12 { println!(" ({}, {}) pipeline {:?} layers {:?} without {:?}", i % 192, i / 192, &linear[i*3..i*3+3], a.linear[i], b.linear[i]); } }
        }
        println!(" {n} bad");
        if pi == 3 {
            let [x, y] = ra.all.worst;
            let screen = reference::screen::Screen::new(&world, &state, &view, Vertices::Rounded(Grid::PIPELINE));
            let c: Vec<_> = screen.pieces.iter().filter(|piece| points(view.samples).iter().any(|p| reference::coverage::hits(&piece.corners, [x as f64 + p[0], y as f64 + p[1]]))).collect();
            for (i, a) in c.iter().enumerate() {
                let f = &screen.faces[a.face as usize];
                let sub = &content.table.subobjects[f.instance as usize];
                let moved = content.moved.iter().any(|m| m.object == sub.object);
                let name = &scene.node(scene.object(sub.object).node).name;
                println!("  {i}: face {} {name} moved {moved} rank {:?} planes {:?} depth {} col {:?} {:?}", a.face, f.rank, sub.planes, 1.0 / a.inverse_depth([x as f64 + 0.5, y as f64 + 0.5]), screen.materials[f.material as usize].base_color, f.plane);
                for (j, b) in c[..i].iter().enumerate() {
                    if f.plane.coincides(&screen.faces[b.face as usize].plane) { println!("      coincides with {j}"); }
                }
            }
        }
    }
}
