//! A model in transition, by the command and through files: the weights of its versions stand in a camera file's pose, or follow
//! from how far away it is, and the linear picture is the weighted mean of the two that show one version each (picture.md,
//! "Translucency", a).

use crate::program::{fly, run};
use serde_json::{Value, json};
use std::path::Path;

/// Critical radius of the hut, m.
const RADIUS: f64 = 0.05;

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
            {"name": "hut", "mesh": 0, "extensions": {"MSFT_lod": {"ids": [1]}},
             "extras": {"cyclorama": {"critical_radius": RADIUS}}},
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

/// The linear picture of a pose.
fn rendered(folder: &Path, scene: &str, pose: &Value, options: &[&str]) -> Vec<f32> {
    let camera = folder.join("camera.json");
    std::fs::write(&camera, json!([pose]).to_string()).unwrap();
    let picture = folder.join("picture.exr");
    let [camera, picture] = [&camera, &picture].map(|path| path.to_str().unwrap());
    let all = ["render", scene, "--camera", camera, "--size", "96x64", "--samples", "16", "-o", picture];
    let output = run(&[&all[..], options].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    image::open(picture).unwrap().into_rgb32f().into_raw()
}

fn written(folder: &Path) -> String {
    let path = folder.join("hut.gltf");
    std::fs::write(&path, scene().to_string()).unwrap();
    path.to_str().unwrap().to_owned()
}

/// An eye so far from the hut's middle, m.
fn from(distance: f64) -> Value {
    json!({"eye": [0.0, 0.0, distance], "target": [0, 0, 0], "vertical_fov_deg": 45})
}

#[test]
fn a_model_in_transition_is_the_weighted_mean_of_two_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path());
    let draw = |weights: [f64; 2]| {
        let pose = json!({"eye": [0.3, 0.2, 4.0], "target": [0, 0, 0], "versions": {"hut": weights}});
        rendered(folder.path(), &path, &pose, &[])
    };
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

#[test]
fn levels_follow_the_distance_and_finest_is_said_by_a_flag() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path());
    let draw = |distance: f64, weights: Option<[f64; 2]>, options: &[&str]| {
        let mut pose = from(distance);
        if let Some(weights) = weights {
            pose["versions"] = json!({"hut": weights});
        }
        rendered(folder.path(), &path, &pose, options)
    };
    // K of 45 degrees over 64 square pixels, 96 of them across; the middle of all three triangles is not the origin, so
    // distances are a little uncertain.
    let across = 2.0 * (22.5f64.to_radians().tan() * 1.5).atan();
    let factor = 1.0 / (across / 96.0).tan();
    let at = |elements: f64| factor * RADIUS / elements;
    let (near, mixed, far, lost) = (at(4.0), at(2.25), at(1.25), at(0.4));
    let finest = |distance| draw(distance, None, &["--detail", "finest"]);
    assert_eq!(draw(near, None, &[]), finest(near), "level 2 alone from 3 elements on");
    assert_eq!(draw(far, None, &[]), draw(far, Some([0.0, 1.0]), &[]), "level 1 alone up to 1.5");
    assert_ne!(draw(far, None, &[]), finest(far));
    assert_eq!(draw(lost, None, &[]), draw(lost, Some([0.0, 0.0]), &[]), "below half an element it has faded");
    assert_eq!(draw(lost, Some([1.0, 0.0]), &[]), finest(lost), "a pose's weights hold");

    // Between, all of the picture is mixed by one weight, about a half.
    let (found, fine, coarse) = (draw(mixed, None, &[]), finest(mixed), draw(mixed, Some([0.0, 1.0]), &[]));
    let by = |i: usize| f64::from(fine[i]) - f64::from(coarse[i]);
    let clearest = (0..fine.len()).max_by(|&a, &b| by(a).abs().total_cmp(&by(b).abs())).unwrap();
    let weight = (f64::from(found[clearest]) - f64::from(coarse[clearest])) / by(clearest);
    assert!((0.2..0.8).contains(&weight), "{weight}");
    for (i, &value) in found.iter().enumerate() {
        let mean = f64::from(coarse[i]) + weight * by(i);
        assert!((f64::from(value) - mean).abs() < 1e-5, "value {i}: {value} is not {mean}");
    }
}

#[test]
fn a_rig_chooses_the_levels_that_a_single_picture_has() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path());
    let camera = folder.path().join("approach.json");
    let poses: Vec<Value> = (0..6).map(|k| from(8.0 - f64::from(k))).collect();
    std::fs::write(&camera, json!(poses).to_string()).unwrap();
    let camera = camera.to_str().unwrap();
    let view = ["--size", "96x64", "--samples", "4"];
    let mut unlike = 0;
    for detail in ["auto", "finest"] {
        let frames = folder.path().join(detail);
        let row = ["--views", "1", "--boards", "2", "--frames", "6", "--camera", camera, "--detail", detail];
        fly(&frames, &[&[path.as_str()], &row[..], &view[..]].concat());
        for k in 0..poses.len() {
            let single = folder.path().join("single.png");
            let (pose, output) = (k.to_string(), single.to_str().unwrap());
            let of = ["render", &path, "--camera", camera, "--pose", &pose, "--detail", detail, "-o", output];
            assert!(run(&[&of[..], &view[..]].concat()).status.success());
            let [single, frame] =
                [single, frames.join(format!("frame-{k:05}.png"))].map(|path| image::open(path).unwrap().into_rgb8());
            assert_eq!(single, frame, "{detail}, pose {k}");
            let other = folder.path().join(format!("auto/frame-{k:05}.png"));
            unlike += usize::from(image::open(other).unwrap().into_rgb8() != single);
        }
    }
    assert!(unlike > 0, "on the way some level was not the finest");
}
