use super::*;
use crate::scene::import::load_glb;
use crate::scene::inspect::inspect;
use crate::scene::{Scene, builtin};
use std::collections::BTreeSet;
use std::time::Instant;

fn load(name: &str) -> (BuiltIn, Scene) {
    let built = builtin::build(name).unwrap();
    let start = Instant::now();
    let scene = load_glb(&built.glb, name).unwrap_or_else(|error| panic!("{error}"));
    println!(
        "{name}: imported in {} ms, {} planes over {} faces",
        start.elapsed().as_millis(),
        scene.table.planes.len(),
        faces_in_planes(&scene)
    );
    (built, scene)
}

fn faces_in_planes(scene: &Scene) -> usize {
    scene.table.face_planes.iter().filter(|&&plane| plane != proto::scene::NO_PLANE).count()
}

#[test]
fn counts_are_those_of_the_peers_benchmark() {
    // scene, nodes, meshes, triangles drawn (for the city about 50 000, it depends on chance)
    for (name, nodes, meshes, triangles) in [
        ("city", 64 + 32 + 2025, 28 + 64 + 32, 50_000..=60_000),
        ("dense", 144 + 10_000, 144 + 3, 1_202_528..=1_202_528),
        ("smoke", 1 + 7 + 40 + 20, 1 + 1 + 4 + 3, 23_310..=23_310),
        ("runway", 3 + 3 + 3, 9, 2_708..=2_708),
        ("overdraw", 90, 16, 4_560..=4_560),
    ] {
        let (built, scene) = load(name);
        let counts = inspect(&scene).counts;
        assert_eq!((counts.nodes, counts.meshes), (nodes, meshes), "{name}");
        assert!(triangles.contains(&counts.triangles_drawn), "{name}: {} triangles", counts.triangles_drawn);
        assert_eq!(scene.warnings, Vec::<String>::new(), "{name}");
        assert_eq!(built.camera.poses.len(), 60, "{name}");
        for pose in &built.camera.poses {
            let eye = pose.pose().unwrap().position;
            assert!(eye.distance(scene.sphere.centre) < 2.0 * scene.sphere.radius, "{name}: the eye is far off");
        }
    }
}

#[test]
fn the_front_of_overdraw_is_its_nearest_wall_and_all_boxes() {
    let ((built, front), (_, all)) = (load("overdraw-front"), load("overdraw"));
    assert_eq!((front.objects.len(), all.objects.len()), (1 + 60, 30 + 60));
    assert!(!builtin::names().contains(&built.name), "it is no scene for people");
    let places = |scene: &Scene| -> Vec<_> { scene.table.objects.iter().map(|row| row.transform).collect() };
    assert_eq!(places(&front), places(&all)[29..], "the same walls and boxes, to the bit");
    assert_eq!(built.camera, builtin::build("overdraw").unwrap().camera);
}

#[test]
fn they_are_the_same_to_the_byte_every_time() {
    for name in ["city", "smoke", "runway", "overdraw"] {
        assert_eq!(builtin::build(name), builtin::build(name), "{name}");
    }
}

#[test]
fn the_runway_lies_in_one_plane_in_three_layers() {
    let (_, scene) = load("runway");
    assert_eq!(scene.table.planes.len(), 1, "{:?}", scene.table.planes);
    let plane = scene.table.planes[0];
    assert!((plane.normal.y - 1.0).abs() < 1e-12 && plane.offset.abs() < 1e-9, "{plane:?}");
    let layers: BTreeSet<i32> =
        scene.table.subobjects.iter().filter(|row| row.planes.is_some()).map(|row| row.layer).collect();
    assert_eq!(layers, BTreeSet::from([0, 1, 2]));
    // All bars, the runway, the cells of the ground that lie under it (24 squares), and the triangles of the next two that
    // touch its end.
    assert_eq!(faces_in_planes(&scene), 84 + 2 + 48 + 6);
}

#[test]
fn hills_have_no_plane_and_streets_have() {
    let (_, dense) = load("dense");
    assert_eq!(dense.table.planes, []);
    let (_, city) = load("city");
    // No face of a street crosses x = 0 or z = 0, but pavements of one quarter touch streets of the next.
    let level = city.table.planes.iter().filter(|plane| plane.offset == 0.0 && plane.normal == DVec3::Y);
    assert_eq!((level.count(), city.table.planes.len()), (1, 1));
}
