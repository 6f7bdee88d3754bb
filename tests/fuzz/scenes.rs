//! The files that a manager reads.

use manager::scene::{Scene, baked, import};
use std::ops::ControlFlow;

/// A triangle with a colour, complete in itself.
const TRIANGLE: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
"nodes":[{"mesh":0,"name":"part","translation":[1,2,3],"extras":{"cyclorama":{"entity":4}}}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0}]}],
"materials":[{"pbrMetallicRoughness":{"baseColorFactor":[1,0.5,0,1]},"alphaMode":"MASK","doubleSided":true}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6}],
"buffers":[{"byteLength":42,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAABAAIA"}]}"#;

/// A baked file: it opens or is refused, and so does everything in it.
pub(crate) fn baked(bytes: &[u8]) {
    if let Ok(scene) = baked::open_bytes(bytes.to_vec(), "input") {
        // It may be damaged inside; nothing more is asked than that it says so.
        let _ = baked::check_all(&scene);
    }
}

/// A glTF file, as JSON or packed, that names no others.
pub(crate) fn gltf(bytes: &[u8]) {
    let _ = import::load_glb(bytes, "input");
}

/// Inputs to begin with.
pub(crate) fn made(mut add: impl FnMut(&'static str, &str, Vec<u8>)) {
    add("gltf", "triangle", TRIANGLE.into());
    let parts = || import::parts_glb(TRIANGLE.as_bytes(), "triangle", &mut |_| ()).expect("it is a scene");
    let scene = Scene::assemble(parts()).expect("likewise");
    let path = std::env::temp_dir().join(format!("cyclorama-fuzz-{}.baked", std::process::id()));
    baked::write(&parts(), &scene, &path, &mut |_| ControlFlow::Continue(())).expect("it can be written");
    add("baked", "triangle", std::fs::read(&path).expect("it was written"));
    // A file of ours in a folder for such.
    let _ = std::fs::remove_file(&path);
}
