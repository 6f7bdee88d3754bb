//! Real models made by others: `../shared/data/models`, or where `CYCLORAMA_DATA` says.

use crate::scene::Scene;
use crate::scene::import::load;
use crate::scene::inspect::{Materials, inspect};
use std::path::PathBuf;

/// The folder of models; `None`, said loudly, if this machine hasn't got it.
fn models() -> Option<PathBuf> {
    let data = std::env::var_os("CYCLORAMA_DATA").map(PathBuf::from);
    let data = data.unwrap_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")));
    let folder = data.join("models");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no models at {}; set CYCLORAMA_DATA", folder.display());
    None
}

fn get(file: &str) -> Option<Scene> {
    Some(load(&models()?.join(file)).unwrap_or_else(|error| panic!("{error}")))
}

#[test]
fn counts_equal_those_of_the_models_own_table() {
    // file, triangles stored, drawn, (opaque, mask, blend)
    let table = [
        ("CesiumMilkTruck.glb", 2_856, 3_624, (4, 0, 0)),
        ("a4-skyhawk/a4-skyhawk.glb", 26_157, 26_157, (40, 0, 2)),
        ("TextureSettingsTest.glb", 72, 72, (10, 0, 0)),
        ("VertexColorTest.glb", 36, 36, (2, 0, 0)),
        ("SimpleInstancing.glb", 12, 1_500, (1, 0, 0)),
        ("LightsPunctualLamp/LightsPunctualLamp.gltf", 6_000, 6_000, (2, 0, 1)),
        ("house.glb", 10_497, 10_497, (1, 1, 0)),
        ("odyssey-controller-left.glb", 6_336, 6_336, (1, 0, 0)),
    ];
    for (file, stored, drawn, (opaque, mask, blend)) in table {
        let Some(scene) = get(file) else { return };
        let found = inspect(&scene);
        assert_eq!(found.counts.triangles_stored, stored, "{file}\n{found}");
        assert_eq!(found.counts.triangles_drawn, drawn, "{file}\n{found}");
        assert_eq!(found.materials, Materials { opaque, mask, blend }, "{file}\n{found}");
        assert!(scene.bounds.is_some() && scene.sphere.radius > 0.0, "{file}");
    }
}

#[test]
fn the_citys_tiles_have_4208_triangles_and_one_texture() {
    let Some(folder) = models() else { return };
    let mut triangles = 0;
    let mut textures = std::collections::BTreeSet::new();
    for entry in std::fs::read_dir(folder.join("kenney-city")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "glb") {
            let scene = load(&path).unwrap_or_else(|error| panic!("{error}"));
            triangles += inspect(&scene).counts.triangles_drawn;
            textures.extend(scene.textures.keys().copied());
        }
    }
    assert_eq!((triangles, textures.len()), (4_208, 1));
}

#[test]
fn the_trucks_wheels_share_one_mesh() {
    let Some(scene) = get("CesiumMilkTruck.glb") else { return };
    let found = inspect(&scene).counts;
    assert_eq!((found.nodes, found.depth, found.objects, found.meshes), (6, 4, 3, 2));
    assert_eq!(scene.textures.len(), 1, "two are in the file, one of which is shown");
    assert!(scene.warnings.iter().any(|warning| warning.contains("animations")));
}

#[test]
fn the_skyhawk_is_whole_and_its_three_faults_are_named() {
    let Some(scene) = get("a4-skyhawk/a4-skyhawk.glb") else { return };
    assert_eq!(scene.warnings.len(), 3, "{:?}", scene.warnings);
    for (warning, part) in scene.warnings.iter().zip(["SpecularGlossiness", "\"Hose\": 3 of 29", "LeftGearDoorFront_1"])
    {
        assert!(warning.contains(part), "{warning}");
    }
    let bounds = scene.bounds.unwrap();
    let size = bounds.max - bounds.min;
    assert!((18.0..20.0).contains(&size.max_element()), "12 m of aeroplane and a trailing hose, in metres: {size}");
}

#[test]
fn every_texture_that_is_used_is_there_and_none_is_there_for_nothing() {
    for file in ["TextureSettingsTest.glb", "house.glb", "LightsPunctualLamp/LightsPunctualLamp.gltf"] {
        let Some(scene) = get(file) else { return };
        let meshes = scene.meshes.all().unwrap();
        let used: std::collections::BTreeSet<_> = meshes
            .values()
            .flat_map(|mesh| [mesh.material.base_texture, mesh.material.emissive_texture])
            .flatten()
            .map(|usage| usage.texture)
            .collect();
        assert_eq!(used, scene.textures.keys().copied().collect(), "{file}");
    }
}

#[test]
fn the_same_file_gives_the_same_scene() {
    let Some(one) = get("house.glb") else { return };
    let Some(other) = get("house.glb") else { return };
    assert_eq!(one.table, other.table);
    assert!(one.meshes.keys().eq(other.meshes.keys()));
}
