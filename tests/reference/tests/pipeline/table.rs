//! The table of issue "the right picture": every model at 640 × 360 with 64 samples against the truth at 1024 points.
//!
//! Minutes of work, so it is asked for: `cargo test --release -p cyclorama-reference --test pipeline -- --ignored
//! --nocapture table`. The result is kept in `docs/accuracy.md`. With `CYCLORAMA_DIFF=folder` it writes a difference picture for each model.

use super::*;
use std::time::Instant;

fn models(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        match path.extension().and_then(|e| e.to_str()) {
            _ if path.is_dir() => models(&path, found),
            Some("glb" | "gltf") => found.push(path),
            _ => {}
        }
    }
}

#[test]
#[ignore = "takes minutes"]
fn table_of_all_models() {
    let Some(data) = data() else { return };
    let mut found = Vec::new();
    models(&data.join("models"), &mut found);
    let mut wrong = Vec::new();
    for path in found {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let scene = import::load(&path).unwrap();
        let pose = orbit(&scene);
        let view = view(640, 360, pose.lens(640, 360), Samples::SixtyFour);
        let (content, state) = posed(&scene, &pose);
        let (_, bytes) = content.draw(&state, &view);
        let started = Instant::now();
        let truth = reference::sample(&content.world(), &state, &view, &Options::truth(1024, 64));
        let seconds = started.elapsed().as_secs_f64();
        let report = compare(Shown::Bytes(&bytes), &truth);
        println!("{name} ({seconds:.1} s)\n{report}");
        if let Some(folder) = std::env::var_os("CYCLORAMA_DIFF") {
            let png = reference::difference_picture(Shown::Bytes(&bytes), &truth, 8.0).unwrap();
            std::fs::write(Path::new(&folder).join(name.clone() + ".png"), png).unwrap();
        }
        let is_right =
            report.untextured.max_255 <= 1.0 && report.magnified.p99_255 <= 6.0 && report.edges.rms_255 <= 1.9;
        if !is_right {
            wrong.push(name);
        }
    }
    assert!(wrong.is_empty(), "beyond the limits: {wrong:?}");
}

#[test]
#[ignore = "takes minutes"]
fn table_of_the_integral() {
    let Some(data) = data() else { return };
    for name in ["SimpleInstancing.glb", "a4-skyhawk/a4-skyhawk.glb", "house.glb"] {
        let scene = import::load(&data.join("models").join(name)).unwrap();
        let pose = orbit(&scene);
        let (mut content, mut state) = posed(&scene, &pose);
        state.environment.background = proto::frame::Background::Constant([0.2, 0.3, 0.4]);
        for mesh in content.meshes.values_mut() {
            let mesh = Arc::make_mut(mesh);
            (mesh.material.base_texture, mesh.material.emissive_texture) = (None, None);
        }
        let view = view(640, 360, pose.lens(640, 360), Samples::SixtyFour);
        let started = Instant::now();
        let world = content.world();
        let truth = reference::integrate(&world, &state, &view, Vertices::Exact, 0.125).unwrap();
        println!(
            "{name}: integral in {:.1} s, {} sampled instead",
            started.elapsed().as_secs_f64(),
            truth.sampled_instead
        );
        for samples in ALL_SAMPLES {
            let (linear, _) = content.draw(&state, &View { samples, ..view });
            println!("  pipeline, {samples:?}: edges {}", compare(Shown::Linear(&linear), &truth).edges);
        }
        let sampled = reference::sample(&world, &state, &view, &Options::truth(1024, 64));
        let floats: Vec<f32> = sampled.linear.iter().flatten().map(|c| *c as f32).collect();
        println!("  1024 points: all {}", compare(Shown::Linear(&floats), &truth).all);
    }
}
