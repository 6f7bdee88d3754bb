//! `exact` against the integral: area times colour, with the true vertices.

use super::*;
use proto::frame::Background;

/// What may be wrong, of full scale, by the design book's page *The right picture*.
const ALLOWED: f64 = 1e-4;

/// What `exact` and 64 points give of a built-in scene, so far along its path (0 to 1), against the integral.
fn compared(name: &str, along: f64, size: [u32; 2], background: Background) -> [Report; 2] {
    let built = builtin::build(name).unwrap();
    let scene = import::load_glb(&built.glb, built.name).unwrap();
    let poses = &built.camera.poses;
    let pose = &poses[(along * poses.len() as f64) as usize];
    let (content, mut state) = posed(&scene, pose);
    state.environment.background = background;
    let [width, height] = size;
    let view = view(width, height, pose.lens(width, height), Samples::Exact);
    let truth = reference::integrate(&content.world(), &state, &view, Vertices::Exact, 0.125).unwrap();
    let reports = [Samples::Exact, Samples::SixtyFour].map(|samples| {
        let (linear, _) = content.draw(&state, &View { samples, ..view });
        compare(Shown::Linear(&linear), &truth)
    });
    for (samples, report) in ["exact", "64"].iter().zip(&reports) {
        println!("{name}, {samples}: {report}");
    }
    reports
}

const CONSTANT: Background = Background::Constant([0.2, 0.3, 0.4]);

#[test]
fn edges_of_flat_scenes_are_as_the_integral_has_them() {
    for (name, size) in [("city", [160, 90]), ("runway", [320, 180]), ("overdraw", [80, 45])] {
        let [exact, points] = compared(name, 0.0, size, CONSTANT);
        assert!(exact.all.max_linear <= ALLOWED, "{name}: {exact}");
        assert!(exact.edges.rms_linear * 20.0 < points.edges.rms_linear, "{name}: {exact}\n{points}");
    }
}

/// Thin faces of a round tower far away: where their light is told counts by 14 of full scale a pixel.
#[test]
fn what_is_thin_and_curved_is_lit_where_its_true_corners_have_it() {
    let [exact, _] = compared("city", 0.4, [480, 270], CONSTANT);
    assert!(exact.all.max_linear <= ALLOWED, "{exact}");
}

#[test]
fn smooth_and_layered_scenes_are_near_the_integral() {
    for (name, size) in [("dense", [32, 18]), ("smoke", [32, 18])] {
        let [exact, points] = compared(name, 0.0, size, CONSTANT);
        assert!(exact.edges.rms_linear * 10.0 < points.edges.rms_linear, "{name}: {exact}\n{points}");
    }
}

#[test]
fn random_flat_scenes_are_within_a_ten_thousandth_of_the_integral() {
    let mut random = Random(0xE8AC);
    let tangents = Tangents { left: -1.0, right: 1.0, bottom: -0.75, top: 0.75 };
    let mut worst = 0.0f64;
    for round in 0..60 {
        let mut content = random_content(&mut random, 25);
        for mesh in content.meshes.values_mut() {
            let mesh = Arc::make_mut(mesh);
            (mesh.normals, mesh.colors) = (Vec::new(), Vec::new());
            mesh.material.base_color[3] = mesh.material.base_color[3].max(0.01);
        }
        let mut state = state(Pose::IDENTITY);
        state.environment.background = CONSTANT;
        let view = view(32, 24, tangents, Samples::Exact);
        let truth = reference::integrate(&content.world(), &state, &view, Vertices::Exact, 0.125).unwrap();
        let (linear, _) = content.draw(&state, &view);
        let report = compare(Shown::Linear(&linear), &truth);
        worst = worst.max(report.all.max_linear);
        assert!(report.all.max_linear <= ALLOWED, "round {round}: {report}");
    }
    println!("largest error {worst:e}");
}
