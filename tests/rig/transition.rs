//! A model in transition, by the command and through files: the weights of its versions stand in a camera file's pose, and the
//! linear picture is the weighted mean of the two that show one version each (picture.md, "Translucency", a).

use crate::program::run;
use serde_json::{Value, json};
use std::path::Path;

/// Three triangles about the middle of the view: the fine version's, the coarse one's, and a pane through both.
fn scene() -> Value {
    let corners: [[[f32; 3]; 3]; 3] = [
        [[-2.0, -1.0, -0.5], [1.0, -1.0, 0.0], [0.0, 1.5, 0.5]],
        [[-1.0, -1.5, 0.5], [2.0, -0.5, 0.0], [-0.5, 1.0, -0.5]],
        [[-1.5, 0.5, 0.5], [0.5, -1.5, -0.5], [1.5, 1.0, 0.2]],
    ];
    let bytes = corners.iter().flatten().flatten().flat_map(|c| c.to_le_bytes());
    let data: String = bytes.map(|byte| format!("%{byte:02x}")).collect();
    let accessor = |k: usize| {
        json!({"bufferView": 0, "byteOffset": 36 * k, "componentType": 5126, "count": 3, "type": "VEC3",
               "min": [-2.0, -1.5, -0.5], "max": [2.0, 1.5, 0.5]})
    };
    let material = |color: [f64; 4], mode: &str| json!({"pbrMetallicRoughness": {"baseColorFactor": color}, "alphaMode": mode, "doubleSided": true});
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 2]}],
        "extensionsUsed": ["MSFT_lod"],
        "nodes": [
            {"name": "hut", "mesh": 0, "extensions": {"MSFT_lod": {"ids": [1]}}},
            {"name": "hut from afar", "mesh": 1},
            {"name": "pane", "mesh": 2},
        ],
        "meshes": (0..3).map(|k| json!({"primitives": [{"attributes": {"POSITION": k}, "material": k}]})).collect::<Vec<_>>(),
        "materials": [
            material([0.9, 0.2, 0.1, 1.0], "OPAQUE"),
            material([0.1, 0.8, 0.3, 0.6], "BLEND"),
            material([0.2, 0.3, 0.9, 0.4], "BLEND"),
        ],
        "accessors": (0..3).map(accessor).collect::<Vec<_>>(),
        "bufferViews": [{"buffer": 0, "byteLength": 108}],
        "buffers": [{"byteLength": 108, "uri": format!("data:application/octet-stream,{data}")}],
    })
}

/// The linear picture with these weights.
fn rendered(folder: &Path, scene: &str, weights: [f64; 2]) -> Vec<f32> {
    let camera = folder.join("camera.json");
    let pose = json!([{"eye": [0.3, 0.2, 4.0], "target": [0, 0, 0], "versions": {"hut": weights}}]);
    std::fs::write(&camera, pose.to_string()).unwrap();
    let picture = folder.join("picture.exr");
    let [camera, picture] = [&camera, &picture].map(|path| path.to_str().unwrap());
    let output = run(&["render", scene, "--camera", camera, "--size", "96x64", "--samples", "16", "-o", picture]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    image::open(picture).unwrap().into_rgb32f().into_raw()
}

#[test]
fn a_model_in_transition_is_the_weighted_mean_of_two_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hut.gltf");
    std::fs::write(&path, scene().to_string()).unwrap();
    let draw = |weights| rendered(folder.path(), path.to_str().unwrap(), weights);
    let (fine, coarse) = (draw([1.0, 0.0]), draw([0.0, 1.0]));
    let unlike = fine.iter().zip(&coarse).filter(|(a, b)| (**a - **b).abs() > 0.05).count();
    assert!(unlike > 1000, "the two versions are two pictures: {unlike} values differ");
    for weight in [0.25, 0.7] {
        let mixed = draw([weight, 1.0 - weight]);
        for (i, ((mixed, fine), coarse)) in mixed.iter().zip(&fine).zip(&coarse).enumerate() {
            let mean = weight * f64::from(*fine) + (1.0 - weight) * f64::from(*coarse);
            assert!((f64::from(*mixed) - mean).abs() < 1e-6, "weight {weight}, value {i}: {mixed} is not {mean}");
        }
    }
}
