//! Whatever is done to a file, the importer answers and does not panic, hang or ask for the moon.

use super::{File, load_glb};
use crate::scene::inspect::inspect;
use proptest::prelude::*;
use serde_json::json;

/// A small file in which most features occur.
fn seed() -> Vec<u8> {
    let mut file = File::triangle();
    super::features::texture(&mut file);
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let coordinates = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let colors = file.accessor(5121, "VEC4", 3, &[9; 12]);
    let translation = file.floats("VEC3", &[1.0, 0.0, 0.0, 2.0, 0.0, 0.0]);
    file.json["accessors"][colors]["normalized"] = json!(true);
    let indices = file.view(&[1]);
    let upright = file.json["accessors"][normals]["bufferView"].clone();
    file.json["accessors"][normals]["sparse"] = json!({"count": 1,
        "indices": {"bufferView": indices, "componentType": 5121}, "values": {"bufferView": upright}});
    file.primitive()["attributes"] =
        json!({"POSITION": 0, "NORMAL": normals, "TEXCOORD_0": coordinates, "COLOR_0": colors});
    file.json["nodes"] = json!([
        {"name": "tower", "mesh": 0, "children": [1], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},
        {"name": "trees", "mesh": 0, "rotation": [0, 0, 0, 1], "scale": [1, 1, 1], "extensions": {
            "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": translation}}}}
    ]);
    file.bytes()
}

fn survive(bytes: &[u8]) {
    match load_glb(bytes, "mutant.glb") {
        Ok(scene) => {
            let _ = inspect(&scene).to_string();
        }
        Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
    }
}

#[test]
fn the_seed_itself_loads() {
    let scene = load_glb(&seed(), "seed").unwrap();
    assert_eq!((scene.objects.len(), scene.warnings.len()), (3, 0), "{:?}", scene.warnings);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    #[test]
    fn changed_bytes_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8)) {
        let mut bytes = seed();
        for (place, value) in changes {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        survive(&bytes);
    }

    /// Bytes of the JSON swapped for ones that keep it JSON: the faults lie deeper.
    #[test]
    fn changed_numbers_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), 0usize..12), 1..5)) {
        let mut bytes = seed();
        let json = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let digits: Vec<usize> = (20..20 + json).filter(|&i| bytes[i].is_ascii_digit()).collect();
        for (place, value) in changes {
            bytes[digits[place.index(digits.len())]] = b"0123456789-e"[value];
        }
        survive(&bytes);
    }

    #[test]
    fn cut_and_doubled_stretches_never_panic(
        from in any::<prop::sample::Index>(), length in 0usize..200, doubled in any::<bool>(),
    ) {
        let mut bytes = seed();
        let from = from.index(bytes.len());
        let to = (from + length).min(bytes.len());
        let stretch = bytes[from..to].to_vec();
        bytes.splice(from..to, if doubled { [stretch.clone(), stretch].concat() } else { Vec::new() });
        survive(&bytes);
    }

    #[test]
    fn noise_never_panics(noise in prop::collection::vec(any::<u8>(), 0..300), header in any::<bool>()) {
        survive(&noise);
        if header {
            survive(&super::glb(&String::from_utf8_lossy(&noise), &noise));
        }
    }
}
