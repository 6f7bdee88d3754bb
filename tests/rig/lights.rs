//! Lights of the scene's file: they shine only when asked for, in a single picture as in a rig.

use crate::program::{fly, run};
use serde_json::json;

#[test]
fn lights_of_the_file_shine_when_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let data: String = [[-9.0f32, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]]
        .iter()
        .flatten()
        .flat_map(|c| c.to_le_bytes())
        .map(|byte| format!("%{byte:02x}"))
        .collect();
    let wall = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "color": [1.0, 0.0, 0.0], "intensity": 4.0}]}},
        "nodes": [
            {"name": "wall", "mesh": 0},
            {"name": "lamp", "translation": [0.0, 0.0, 2.0], "extensions": {"KHR_lights_punctual": {"light": 0}}},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                       "min": [-9.0, -9.0, 0.0], "max": [9.0, 9.0, 0.0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": format!("data:application/octet-stream,{data}")}],
    });
    let (scene, camera) = (folder.path().join("wall.gltf"), folder.path().join("camera.json"));
    std::fs::write(&scene, wall.to_string()).unwrap();
    std::fs::write(&camera, json!([{"eye": [0.0, 0.0, 5.0], "target": [0, 0, 0]}]).to_string()).unwrap();
    let picture = folder.path().join("picture.png");
    let [scene, camera, output] = [&scene, &camera, &picture].map(|path| path.to_str().unwrap());
    let draw = |options: &[&str]| {
        let all = ["render", scene, "--camera", camera, "--size", "64x48", "--samples", "4", "-o", output];
        let result = run(&[&all[..], options].concat());
        assert!(result.status.success(), "{}", String::from_utf8_lossy(&result.stderr));
        image::open(&picture).unwrap().into_rgb8()
    };
    let (dark, lit) = (draw(&[]), draw(&["--scene-lights"]));
    let (before, after) = (dark.get_pixel(32, 24).0, lit.get_pixel(32, 24).0);
    assert!(after[0] > before[0] + 20, "{before:?} became {after:?}");
    assert_eq!((before[1], before[2]), (after[1], after[2]), "the lamp is red");

    let frames = folder.path().join("frames");
    let row = ["--camera", camera, "--frames", "1", "--views", "1", "--size", "64x48", "--samples", "4"];
    fly(&frames, &[&[scene, "--scene-lights"], &row[..]].concat());
    assert_eq!(image::open(frames.join("frame-00000.png")).unwrap().into_rgb8(), lit);
}
