//! Other people's models: each is drawn, shows something, and is the same for any boards, threads and instruction set.

use crate::{data, render};
use channel::simd::SimdLevel;
use std::path::{Path, PathBuf};

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
fn every_model_is_drawn_and_is_the_same_for_any_boards_threads_and_instruction_set() {
    let Some(data) = data() else { return };
    let mut found = Vec::new();
    models(&data.join("models"), &mut found);
    assert!(found.len() >= 20, "{} models", found.len());
    for model in found {
        let args = ["--size", "192x108", "--samples", "4"];
        let one = render(&model, &[&args[..], &["--threads", "1"]].concat());
        let empty = render(&model, &["--size", "192x108", "--samples", "1", "--visibility", "0.000001"]);
        let different = one.pixels().zip(empty.pixels()).filter(|(a, b)| a != b).count();
        assert!(different > 100, "{}: {different} pixels differ from the sky", model.display());
        for level in SimdLevel::all() {
            let other = ["--threads", "2", "--boards", "3", "--simd", level.name()];
            assert!(render(&model, &[&args[..], &other].concat()) == one, "{}, {level}", model.display());
        }
    }
}
