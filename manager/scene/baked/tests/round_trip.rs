//! A baked scene is the scene that was baked, value for value.

use super::*;
use crate::scene::baked;
use crate::scene::{Content, Contents};
use std::ops::ControlFlow;
use std::path::PathBuf;

/// Everything of a scene but its meshes and textures, as text: floats are printed so that each has a text of its own.
fn described(scene: &Scene) -> String {
    let Scene { name, nodes, roots, objects, shapes, materials, models, table, .. } = scene;
    let found = (name, nodes, roots, objects, shapes, materials, models, table);
    let more = (&scene.blocks.tree, &scene.sphere, &scene.bounds, &scene.warnings);
    let names: Vec<_> = scene.node_names().map(|name| (name, scene.node_by_name(name))).collect();
    let entities: Vec<_> = scene.entities().collect();
    let model_names: Vec<_> = scene.model_names().collect();
    format!("{found:?} {more:?} {names:?} {entities:?} {model_names:?}")
}

fn same_contents<T: Content + PartialEq>(a: &Contents<T>, b: &Contents<T>) {
    assert!(a.keys().eq(b.keys()), "the same names");
    assert!(a.sizes().eq(b.sizes()), "the same sizes");
    for id in a.keys() {
        assert!(a.get(id).unwrap() == b.get(id).unwrap(), "{} {id} is another", T::WHAT);
        assert!(a.payload(id).unwrap() == b.payload(id).unwrap(), "what travels");
        assert!(b.contains(id), "it can be found");
    }
}

#[track_caller]
fn same(a: &Scene, b: &Scene) {
    let (a_text, b_text) = (described(a), described(b));
    if a_text != b_text {
        let at = a_text.bytes().zip(b_text.bytes()).take_while(|(a, b)| a == b).count();
        let near = |text: &str| String::from_utf8_lossy(&text.as_bytes()[at.saturating_sub(80)..][..160]).into_owned();
        panic!("{}: from byte {at}:\n{}\n{}", a.name, near(&a_text), near(&b_text));
    }
    same_contents(&a.meshes, &b.meshes);
    same_contents(&a.textures, &b.textures);
}

#[test]
fn the_small_scene_has_everything() {
    let scene = Scene::assemble(small()).unwrap();
    assert!(!scene.table.planes.is_empty() && scene.table.subobjects.iter().any(|row| row.planes.is_none()));
    assert_eq!((scene.table.lights.len(), scene.models.len(), scene.textures.len()), (3, 2, 1));
    assert!(scene.shapes.iter().any(|shape| shape.pieces.len() > 2) && scene.warnings.len() > 1);
}

#[test]
fn a_scene_comes_back_from_memory() {
    let parts = small();
    let mut scene = Scene::assemble(parts.clone()).unwrap();
    let opened = open(&bake(&parts)).unwrap();
    // Names of levels are the importer's, which has followed them; nobody reads them afterwards.
    scene.shapes.iter_mut().for_each(|shape| shape.extras.levels = None);
    same(&scene, &opened);
    assert!(opened.is_baked() && !scene.is_baked());
    baked::check_all(&opened).unwrap();
    assert!(bake(&small()) == bake(&small()), "the same scene, the same bytes");
}

#[test]
fn an_empty_scene_comes_back() {
    let empty = Scene::assemble(Parts::default()).unwrap();
    same(&empty, &open(&bake(&Parts::default())).unwrap());
}

/// By way of a file, mapped and read.
#[cfg(feature = "import")]
fn through_a_file(parts: Parts) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.baked");
    let scene = Scene::assemble(parts.clone()).unwrap();
    let mut heard = vec![0.0];
    let mut watch = |part| {
        heard.push(part);
        ControlFlow::Continue(())
    };
    baked::write(&parts, &scene, &path, &mut watch).unwrap();
    assert!(heard.is_sorted() && heard.iter().all(|part| *part <= 1.0 + 1e-9), "progress goes one way");
    assert!(baked::is_baked(&path));
    same(&scene, &baked::open(&path).unwrap());
    same(&scene, &baked::open_by_reading(&path).unwrap());
    let facts = baked::facts(&path).unwrap();
    assert_eq!((facts.format, facts.bytes), (baked::FORMAT, std::fs::metadata(&path).unwrap().len()));
    assert!(facts.sections.iter().map(|section| section.bytes).sum::<u64>() <= facts.bytes);
}

#[cfg(feature = "import")]
#[test]
fn built_in_scenes_come_back() {
    use crate::scene::{builtin, import};
    for name in builtin::names() {
        let built = builtin::build(name).unwrap();
        through_a_file(import::parts_glb(&built.glb, name, &mut |_| ()).unwrap());
    }
}

#[cfg(feature = "import")]
#[test]
fn real_models_come_back() {
    let data = std::env::var_os("CYCLORAMA_DATA").map(PathBuf::from);
    let data = data.unwrap_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")));
    let folder = data.join("models");
    if !folder.is_dir() {
        eprintln!("SKIPPED: no models at {}; set CYCLORAMA_DATA", folder.display());
        return;
    }
    for file in [
        "CesiumMilkTruck.glb",
        "a4-skyhawk/a4-skyhawk.glb",
        "TextureSettingsTest.glb",
        "VertexColorTest.glb",
        "SimpleInstancing.glb",
        "LightsPunctualLamp/LightsPunctualLamp.gltf",
        "house.glb",
        "odyssey-controller-left.glb",
    ] {
        let mut heard = vec![0.0];
        let parts = crate::scene::import::parts(&folder.join(file), &mut |part| heard.push(part)).unwrap();
        assert!(heard.is_sorted() && heard.iter().all(|part| *part <= 1.0), "{file}: {heard:?}");
        through_a_file(parts);
    }
}

fn timed<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let begun = std::time::Instant::now();
    let result = work();
    println!("{what}: {:.1} ms", begun.elapsed().as_secs_f64() * 1e3);
    result
}

/// Not the target, which is about triangles: what a million objects cost.
#[test]
#[ignore = "a measurement: cargo test --release -p cyclorama-manager a_million_objects -- --ignored --nocapture"]
fn a_million_objects() {
    let mut parts = small();
    let shape = parts.nodes[1].shape;
    let at = |i: u32| DVec3::new(f64::from(i % 1000), 0.0, f64::from(i / 1000)) * 40.0;
    let node = |i: u32| NodeSource {
        name: format!("object {i}"),
        shape,
        local: DAffine3::from_translation(at(i)),
        extras: Extras { is_static: Some(false), ..Extras::default() },
        ..NodeSource::default()
    };
    parts.nodes = (0..1_000_000).map(node).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.baked");
    let again = parts.clone();
    let scene = timed("assembled", || Scene::assemble(again).unwrap());
    timed("written", || baked::write(&parts, &scene, &path, &mut |_| ControlFlow::Continue(())).unwrap());
    for _ in 0..3 {
        let opened = timed("opened", || baked::open(&path).unwrap());
        assert_eq!(opened.table, scene.table);
    }
}
