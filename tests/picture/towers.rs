//! A scene with levels of detail: rows of round towers of three levels each, and an eye before them that sees all three, models between two, and some that fade.

use serde_json::{Value, json};
use std::f32::consts::TAU;
use std::path::{Path, PathBuf};

/// Sides of a tower, the finest level first.
const SIDES: [u32; 3] = [24, 8, 4];
const ROWS: i32 = 14;
/// Of a tower, m: chosen so that the rows show all there is at 640 × 360.
const CRITICAL_RADIUS: f64 = 0.3;

/// A wall and a roof for each side.
fn tower(sides: u32) -> Vec<[f32; 3]> {
    let corner = |k: u32, y: f32| {
        let (s, c) = (TAU * k as f32 / sides as f32).sin_cos();
        [c, y, -s]
    };
    let side = |k| {
        let [a, b, c, d] = [corner(k, 0.0), corner(k + 1, 0.0), corner(k + 1, 3.0), corner(k, 3.0)];
        [a, b, c, a, c, d, d, c, [0.0, 4.0, 0.0]]
    };
    (0..sides).flat_map(side).collect()
}

fn scene() -> Value {
    let towers = SIDES.map(tower);
    let mut begin = 0;
    let accessors: Vec<Value> = towers
        .iter()
        .map(|corners| {
            let offset = begin;
            begin += corners.len() * 12;
            json!({"bufferView": 0, "byteOffset": offset, "componentType": 5126, "count": corners.len(), "type": "VEC3",
                   "min": [-1.0, 0.0, -1.0], "max": [1.0, 4.0, 1.0]})
        })
        .collect();
    let bytes = towers.iter().flatten().flatten().flat_map(|c| c.to_le_bytes());
    let data: String = bytes.map(|byte| format!("%{byte:02x}")).collect();
    let (mut nodes, mut roots) = (Vec::new(), Vec::new());
    for (row, column) in (0..ROWS).flat_map(|row| (-6..=6).map(move |column| (row, column))) {
        let (far, first) = (f64::from(row), nodes.len());
        let at = [f64::from(column) * 4.0 * (1.0 + far * 0.35), 0.0, -6.0 * far * (1.0 + far * 0.25)];
        roots.push(first);
        nodes.push(json!({
            "name": format!("tower {row} {column}"), "mesh": 0, "translation": at,
            "extensions": {"MSFT_lod": {"ids": [first + 1, first + 2]}},
            "extras": {"cyclorama": {"critical_radius": CRITICAL_RADIUS}},
        }));
        nodes.extend((1..3).map(
            |level| json!({"name": format!("tower {row} {column}, level {level}"), "mesh": level, "translation": at}),
        ));
    }
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": roots}], "extensionsUsed": ["MSFT_lod"], "nodes": nodes,
        "meshes": (0..3).map(|k| json!({"primitives": [{"attributes": {"POSITION": k}, "material": 0}]})).collect::<Vec<_>>(),
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.7, 0.6, 1.0]}}],
        "accessors": accessors,
        "bufferViews": [{"buffer": 0, "byteLength": begin}],
        "buffers": [{"byteLength": begin, "uri": format!("data:application/octet-stream,{data}")}],
    })
}

/// Writes scene and camera into a folder.
pub(crate) fn write(folder: &Path) -> [PathBuf; 2] {
    let files = [folder.join("towers.gltf"), folder.join("towers.json")];
    std::fs::write(&files[0], scene().to_string()).unwrap();
    let pose = json!([{"eye": [0, 7, 12], "target": [0, 0, -40], "vertical_fov_deg": 40}]);
    std::fs::write(&files[1], pose.to_string()).unwrap();
    files
}
