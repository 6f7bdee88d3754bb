//! A scene in which nothing happens costs nothing: no frames are opened, until something does happen.

use crate::program::{Rig, wait_for};
use serde_json::json;

#[test]
fn a_still_scene_opens_no_frames_and_its_picture_is_there_for_who_looks() {
    let folder = tempfile::tempdir().unwrap();
    let camera = folder.path().join("still.json");
    let pose = json!([{"eye": [0.0, 30.0, 200.0], "target": [0, 5, 0], "vertical_fov_deg": 45}]);
    std::fs::write(&camera, pose.to_string()).unwrap();
    let small = ["--views", "2", "--boards", "2", "--size", "96x64", "--samples", "1"];
    let rig = Rig::start(&[&small[..], &["--camera", camera.to_str().unwrap()]].concat());
    let idle = |stats: &serde_json::Value| stats["skipped"]["frames_idle"].as_u64().unwrap();
    let stats = rig.wait("frames that aren't opened", |stats| idle(stats) > 50);
    assert!(stats["latency_ms"]["p50"].as_f64() > Some(0.0), "poses arrive: {stats}");
    // Whoever looks gets the picture, although frames have stopped.
    let picture = wait_for("a picture", || {
        rig.get("/picture.jpg").filter(|(head, _)| head.starts_with("HTTP/1.1 200")).map(|(_, jpeg)| jpeg)
    });
    assert_eq!(image::load_from_memory(&picture).unwrap().width(), 2 * 96);
    // A board that goes: the others take over at once, and it is calm again.
    let board = rig.children(&["channel", "--name", "1"])[0];
    crate::program::kill(board);
    let before = rig.wait("the row closing up", |stats| stats["boards"] == 1);
    rig.wait("frames under the new wiring, and then none", |stats| {
        stats["epochs"].as_u64() > Some(1) && idle(stats) > idle(&before) + 50
    });
}
