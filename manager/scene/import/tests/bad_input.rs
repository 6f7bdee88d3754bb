//! What must be refused: each fault by itself, with the words that help.

use super::super::{Fault, load};
use super::{File, glb, load_glb};
use serde_json::json;

/// Checks that a message has all these parts.
#[track_caller]
fn says(message: &str, parts: &[&str]) {
    assert!(message.starts_with("scene.glb: "), "the file's name comes first: {message}");
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
}

/// The refusal of raw bytes.
fn refusal(bytes: &[u8]) -> String {
    load_glb(bytes, "scene.glb").expect_err("must be refused").to_string()
}

#[test]
fn the_plain_triangle_is_fine() {
    let scene = File::triangle().load().unwrap();
    assert_eq!((scene.table.subobjects.len(), scene.warnings.len()), (1, 0), "{:?}", scene.warnings);
}

#[test]
fn a_missing_scene_file() {
    let error = load("no/such/scene.glb".as_ref()).unwrap_err().to_string();
    assert_eq!(error, "no/such/scene.glb: no such file; check the path");
}

#[test]
fn a_folder_instead_of_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let error = load(folder.path()).unwrap_err();
    assert!(matches!(*error.fault, Fault::NotAFile { .. }), "{error}");
}

#[test]
fn a_missing_buffer_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = File::triangle();
    file.json["buffers"] = json!([{"byteLength": 4, "uri": "walls.bin"}]);
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, file.json.to_string()).unwrap();
    let message = load(&path).unwrap_err().to_string();
    assert!(message.contains("buffer 0 is in ") && message.contains("walls.bin\", which does not exist"), "{message}");
}

#[test]
fn a_missing_image_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = File::triangle();
    file.json["images"] = json!([{"uri": "textures/wall%201.png"}]);
    file.json["textures"] = json!([{"source": 0}]);
    file.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    file.primitive()["material"] = json!(0);
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, file.bytes()).unwrap();
    let message = load(&path).unwrap_err().to_string();
    assert!(message.contains("image 0") && message.contains("wall 1.png\", which does not exist"), "{message}");
}

#[test]
fn addresses_outside_the_scenes_folder() {
    for address in ["/etc/passwd", "../secret.bin", "http://example.org/walls.bin", "file:///etc/passwd"] {
        let mut file = File::triangle();
        file.json["buffers"] = json!([{"byteLength": 4, "uri": address}]);
        says(&file.refusal(), &["buffer 0 has the address", address, "put the file in the scene's folder"]);
    }
}

#[test]
fn a_broken_data_uri() {
    let mut file = File::triangle();
    file.json["buffers"] = json!([{"byteLength": 4, "uri": "data:application/octet-stream;base64,A!=="}]);
    says(&file.refusal(), &["buffer 0", "malformed data URI", "not base64"]);
}

#[test]
fn an_empty_file_and_one_of_another_kind() {
    for bytes in [b"".as_slice(), b"\x89PNG\r\n\x1a\n", b"o cube\nv 0 0 0", b"[1]"] {
        says(&refusal(bytes), &["neither binary glTF nor glTF JSON", "export the scene as .glb or .gltf"]);
    }
}

#[test]
fn every_way_to_cut_a_glb_short() {
    let bytes = File::triangle().bytes();
    for length in 4..bytes.len() {
        says(&refusal(&bytes[..length]), &["damaged .glb"]);
    }
}

#[test]
fn a_chunk_that_is_longer_than_the_file() {
    let mut bytes = File::triangle().bytes();
    bytes[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    says(&refusal(&bytes), &["damaged .glb", "a chunk of 4294967295 bytes"]);
}

#[test]
fn versions_one_and_three() {
    let mut bytes = File::triangle().bytes();
    bytes[4] = 1;
    says(&refusal(&bytes), &["glTF version 1 is not supported"]);
    let mut file = File::triangle();
    file.json["asset"]["version"] = json!("3.0");
    says(&file.refusal(), &["glTF version 3.0 is not supported"]);
}

#[test]
fn json_that_is_none_or_is_no_gltf() {
    says(&refusal(&glb("{\"asset\": ", &[])), &["malformed glTF", "line 1 column"]);
    says(&refusal(&glb("{\"asset\": {\"version\": \"2.0\"}, \"nodes\": 7}", &[])), &["malformed glTF"]);
    let deep = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"extensions\":{{\"X\":{}1{}}}}}",
        "[".repeat(5000),
        "]".repeat(5000)
    );
    says(&refusal(&glb(&deep, &[])), &["malformed glTF", "recursion limit"]);
}

#[test]
fn a_nan_position() {
    let mut file = File::triangle();
    let mut positions = vec![0.5f32; 150];
    positions[40 * 3 + 1] = f32::NAN;
    let accessor = file.floats("VEC3", &positions);
    file.primitive()["attributes"]["POSITION"] = json!(accessor);
    assert_eq!(file.refusal(), "scene.glb: node \"tower\": accessor 2 has a NaN at element 40; re-export the mesh");
}

#[test]
fn an_infinite_position_of_a_nameless_node() {
    let mut file = File::triangle();
    file.json["nodes"] = json!([{"mesh": 0}]);
    let accessor = file.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, f32::NEG_INFINITY, 0.0, 0.0, 1.0, 0.0]);
    file.primitive()["attributes"]["POSITION"] = json!(accessor);
    assert_eq!(file.refusal(), "scene.glb: node 0: accessor 2 has an infinity at element 1; re-export the mesh");
}

#[test]
fn a_nan_texture_coordinate_and_a_nan_colour() {
    for (attribute, kind, values) in [
        ("TEXCOORD_0", "VEC2", vec![0.0, 0.0, f32::NAN, 0.0, 1.0, 1.0]),
        ("COLOR_0", "VEC3", vec![0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0]),
    ] {
        let mut file = File::triangle();
        let accessor = file.floats(kind, &values);
        file.primitive()["attributes"][attribute] = json!(accessor);
        super::features::texture(&mut file);
        says(&file.refusal(), &["node \"tower\"", "has a NaN at element"]);
    }
}

#[test]
fn an_index_out_of_range() {
    for (component, bytes) in
        [(5121, vec![0, 1, 3]), (5123, vec![0, 0, 1, 0, 3, 0]), (5125, vec![0, 0, 0, 0, 1, 0, 0, 0, 3, 0, 0, 0])]
    {
        let mut file = File::triangle();
        let accessor = file.accessor(component, "SCALAR", 3, &bytes);
        file.primitive()["indices"] = json!(accessor);
        says(&file.refusal(), &["node \"tower\": accessor 2 has index 3 at element 2, but there are 3 vertices"]);
    }
}

#[test]
fn a_node_that_is_below_itself() {
    let mut file = File::triangle();
    file.json["nodes"] = json!([{"mesh": 0}, {"name": "a", "children": [2]}, {"name": "b", "children": [3]},
        {"name": "c", "children": [2]}]);
    assert!(file.refusal().contains("has two parents"), "{}", file.refusal());
    file.json["nodes"] = json!([{"mesh": 0}, {"name": "a", "children": [2]}, {"name": "b", "children": [1]}]);
    let message = file.refusal();
    assert!(
        message.contains("node \"a\" is below itself") || message.contains("node \"b\" is below itself"),
        "{message}"
    );
    file.json["nodes"] = json!([{"name": "tower", "mesh": 0, "children": [0]}]);
    says(&file.refusal(), &["node \"tower\" is below itself; nodes must form a tree"]);
}

#[test]
fn a_node_with_two_parents() {
    let mut file = File::triangle();
    file.json["nodes"] = json!([{"name": "a", "children": [2]}, {"name": "b", "children": [2]}, {"name": "wheel"}]);
    says(&file.refusal(), &["node \"wheel\" has two parents, node \"a\" and node \"b\""]);
    file.json["nodes"] = json!([{"name": "a", "children": [1, 1]}, {"name": "wheel"}]);
    says(&file.refusal(), &["node \"wheel\" has two parents"]);
}

#[test]
fn a_scene_that_begins_below_its_own_roots_or_twice() {
    let mut file = File::triangle();
    file.json["nodes"] = json!([{"name": "tower", "mesh": 0}, {"name": "a", "children": [0]}]);
    says(&file.refusal(), &["node \"tower\" begins the scene, yet is below node \"a\""]);
    file.json["nodes"] = json!([{"name": "tower", "mesh": 0}]);
    file.json["scenes"] = json!([{"nodes": [0, 0]}]);
    says(&file.refusal(), &["node \"tower\" begins the scene twice"]);
}

#[test]
fn four_billion_elements_in_a_kilobyte() {
    let mut file = File::triangle();
    file.json["accessors"][0]["count"] = json!(4_000_000_000u64);
    says(&file.refusal(), &["node \"tower\"", "accessor 0 (4000000000 elements) needs 48000000000 bytes"]);

    file.json["accessors"][0]["count"] = json!(u64::MAX);
    says(&file.refusal(), &["node \"tower\"", "accessor 0"]);

    // Without data of its own every element is zero, and no byte of the file backs the claim.
    let mut file = File::triangle();
    file.json["accessors"][0] = json!({"componentType": 5126, "type": "VEC3", "count": 4_000_000_000u64});
    says(&file.refusal(), &["has 4000000000 elements and no data"]);

    let mut file = File::triangle();
    file.json["accessors"][1]["count"] = json!(4_000_000_000u64);
    says(&file.refusal(), &["accessor 1 (4000000000 elements)"]);
}

#[test]
fn a_long_name_for_each_of_a_hundred_thousand_instances() {
    let instanced = |name: String| {
        let mut file = File::triangle();
        let instances = json!({"componentType": 5126, "type": "VEC3", "count": 100_000});
        let accessor = super::push(&mut file.json["accessors"], instances);
        file.json["nodes"] = json!([{"name": name, "mesh": 0, "extensions": {
            "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": accessor}}}}]);
        file.load()
    };
    let error = instanced("tree ".repeat(100_000)).unwrap_err().to_string();
    assert!(error.ends_with("50000000000 bytes of instances' names, at most 1073741824 are possible; split the scene"));
    assert_eq!(instanced("tree".into()).unwrap().objects.len(), 100_000);
}

/// Each child once copied the list of its parent's levels, which took for ever.
#[test]
fn a_long_list_of_levels_above_many_nodes_is_quick() {
    let mut file = File::triangle();
    let n = 30_000;
    let names: Vec<_> = (0..n).map(|i| format!("level {i}")).collect();
    let mut nodes = vec![json!({"children": (1..=n).collect::<Vec<_>>(), "extras": {"cyclorama": {"levels": names}}})];
    nodes.extend((0..n).map(|_| json!({"mesh": 0})));
    file.json["nodes"] = json!(nodes);
    match file.load() {
        Ok(scene) => assert_eq!(scene.objects.len(), n),
        Err(error) => assert!(error.to_string().contains("levels"), "{error}"),
    }
}

#[test]
fn strides_offsets_and_views_that_lead_outside() {
    let broken = |change: &dyn Fn(&mut File)| {
        let mut file = File::triangle();
        change(&mut file);
        let message = file.refusal();
        assert!(message.contains("node \"tower\""), "{message}");
    };
    broken(&|file| file.json["bufferViews"][0]["byteStride"] = json!(16));
    broken(&|file| file.json["bufferViews"][0]["byteStride"] = json!(4));
    broken(&|file| file.json["bufferViews"][0]["byteStride"] = json!(u64::MAX));
    broken(&|file| file.json["bufferViews"][0]["byteOffset"] = json!(u64::MAX));
    broken(&|file| file.json["bufferViews"][0]["byteLength"] = json!(u64::MAX));
    broken(&|file| file.json["bufferViews"][0]["buffer"] = json!(1));
    broken(&|file| file.json["accessors"][0]["byteOffset"] = json!(4));
    broken(&|file| file.json["accessors"][0]["byteOffset"] = json!(u64::MAX - 3));
    broken(&|file| file.json["accessors"][0]["bufferView"] = json!(99));
}

#[test]
fn indices_of_things_that_are_not_there() {
    let broken = |change: &dyn Fn(&mut File)| {
        let mut file = File::triangle();
        change(&mut file);
        says(&file.refusal(), &["there is no ", " 9, the file has "]);
    };
    broken(&|file| file.primitive()["attributes"]["POSITION"] = json!(9));
    broken(&|file| file.primitive()["indices"] = json!(9));
    broken(&|file| file.primitive()["material"] = json!(9));
    broken(&|file| file.json["nodes"][0]["mesh"] = json!(9));
    broken(&|file| file.json["nodes"][0]["children"] = json!([9]));
    broken(&|file| file.json["scenes"][0]["nodes"] = json!([9]));
    broken(&|file| file.json["scene"] = json!(9));
    let textured = |change: &dyn Fn(&mut File)| {
        broken(&|file| {
            super::features::texture(file);
            change(file);
        });
    };
    textured(&|file| file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = json!(9));
    textured(&|file| file.json["textures"][0]["source"] = json!(9));
    textured(&|file| file.json["textures"][0]["sampler"] = json!(9));
    textured(&|file| file.json["images"][0]["bufferView"] = json!(9));
}

#[test]
fn accessors_of_the_wrong_type() {
    let broken = |change: &dyn Fn(&mut File)| {
        let mut file = File::triangle();
        change(&mut file);
        says(&file.refusal(), &["node \"tower\": accessor", "re-export the mesh"]);
    };
    broken(&|file| file.json["accessors"][0]["type"] = json!("SCALAR"));
    broken(&|file| file.json["accessors"][0]["type"] = json!("VEC9"));
    broken(&|file| file.json["accessors"][0]["componentType"] = json!(5125));
    broken(&|file| file.json["accessors"][0]["componentType"] = json!(5130));
    broken(&|file| file.json["accessors"][1]["componentType"] = json!(5126));
    broken(&|file| file.json["accessors"][1]["type"] = json!("VEC3"));
}

#[test]
fn attributes_of_unlike_length() {
    let mut file = File::triangle();
    let accessor = file.floats("VEC3", &[0.0, 0.0, 1.0]);
    file.primitive()["attributes"]["NORMAL"] = json!(accessor);
    says(&file.refusal(), &["node \"tower\": NORMAL has 1 elements for 3 vertices"]);
}

#[test]
fn a_buffer_that_is_shorter_than_it_says_and_one_that_is_not_there() {
    let mut file = File::triangle();
    file.json["buffers"] = json!([{"byteLength": 1_000_000}]);
    says(&file.refusal(), &["buffer 0 has ", "1000000 are declared"]);
    file.json["buffers"] = json!([{"byteLength": 4}, {"byteLength": 4}]);
    says(&file.refusal(), &["buffer 1 has no data"]);
}

#[test]
fn transformations_that_are_none() {
    let broken = |node: serde_json::Value, part: &str| {
        let mut file = File::triangle();
        file.json["nodes"] = json!([node]);
        says(&file.refusal(), &["node \"tower\"", part]);
    };
    broken(json!({"name": "tower", "mesh": 0, "rotation": [0.0, 0.0, 0.0, 0.0]}), "not a unit quaternion");
    broken(
        json!({"name": "tower", "mesh": 0, "matrix": [1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}),
        "not affine",
    );
    broken(json!({"name": "tower", "mesh": 0, "translation": [1e300, 0.0, 0.0]}), "beyond the range of numbers");
    broken(json!({"name": "tower", "mesh": 0, "scale": [1e300, 1.0, 1.0]}), "beyond the range of numbers");
    let mut file = File::triangle();
    file.json["nodes"] = json!([{"mesh": 0, "translation": ["NaN", 0.0, 0.0]}]);
    says(&file.refusal(), &["malformed glTF"]);
}

#[test]
fn a_chain_of_a_hundred_thousand_nodes_does_no_harm() {
    let mut file = File::triangle();
    let n = 100_000;
    let nodes: Vec<_> =
        (0..n).map(|i| if i + 1 < n { json!({"children": [i + 1]}) } else { json!({"mesh": 0}) }).collect();
    file.json["nodes"] = json!(nodes);
    let scene = file.load().unwrap();
    assert_eq!((scene.nodes.len(), scene.objects.len()), (n, 1));
    assert!(crate::scene::inspect::inspect(&scene).to_string().len() < 100_000);
}

#[test]
fn required_extensions_are_refused_with_a_remedy() {
    for (extension, remedy) in [
        ("KHR_draco_mesh_compression", "npx @gltf-transform/cli copy in.glb out.glb"),
        ("EXT_meshopt_compression", "npx @gltf-transform/cli copy in.glb out.glb"),
        ("KHR_texture_basisu", "npx @gltf-transform/cli ktxdecompress in.glb out.glb"),
        ("ACME_teapots", "export the scene without it"),
    ] {
        let mut file = File::triangle();
        file.json["extensionsUsed"] = json!([extension]);
        file.json["extensionsRequired"] = json!([extension]);
        says(&file.refusal(), &["requires the extension", extension, remedy]);
        file.json["extensionsRequired"] = json!([]);
        let warnings = file.load().unwrap().warnings;
        assert!(warnings.len() == 1 && warnings[0].contains(extension), "{warnings:?}");
    }
}

#[test]
fn pictures_that_are_none() {
    let mut file = File::triangle();
    super::features::texture(&mut file);
    let good = file.json["images"][0]["bufferView"].as_u64().unwrap() as usize;
    for (bytes, part) in [
        (b"GIF89a\x01\x00\x01\x00".as_slice(), "is Gif, not PNG or JPEG"),
        (b"what is this".as_slice(), "neither PNG nor JPEG"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".as_slice(), "cannot be decoded"),
    ] {
        let view = file.view(bytes);
        file.json["images"][0]["bufferView"] = json!(view);
        says(&file.refusal(), &["image 0", part]);
    }
    file.json["images"][0]["bufferView"] = json!(good);
    file.load().unwrap();
    file.json["images"][0] = json!({});
    says(&file.refusal(), &["image 0 has no data"]);
}

#[test]
fn a_picture_of_gigapixels_in_a_few_bytes() {
    // A PNG header that claims 60 000 × 60 000; its checksum is right.
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    png.extend(60_000u32.to_be_bytes());
    png.extend(60_000u32.to_be_bytes());
    png.extend([8, 6, 0, 0, 0]);
    png.extend(crc(&png[12..]).to_be_bytes());
    png.extend(b"\0\0\0\0IDAT");
    png.extend(crc(b"IDAT").to_be_bytes());
    let mut file = File::triangle();
    super::features::texture(&mut file);
    let view = file.view(&png);
    file.json["images"][0]["bufferView"] = json!(view);
    says(&file.refusal(), &["image 0", "make it smaller"]);
}

fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
    })
}
