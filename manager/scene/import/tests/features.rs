//! What must be read, and how it must come out.

use super::{File, only_mesh, push};
use crate::scene::inspect::inspect;
use crate::scene::{NodeIndex, Scene, import};
use glam::DVec3;
use proto::scene::{Alpha, Filter, Mesh, TRANSFORM_IDENTITY, Wrap};
use serde_json::json;

/// Gives the primitive a material with a picture of 2 × 1 texels, red and half-transparent green.
pub(super) fn texture(file: &mut File) {
    let mut png = Vec::new();
    let pixels = image::RgbaImage::from_raw(2, 1, vec![255, 0, 0, 255, 0, 255, 0, 128]).unwrap();
    pixels.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let view = file.view(&png);
    file.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
    file.json["textures"] = json!([{"source": 0}]);
    file.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    file.primitive()["material"] = json!(0);
}

fn corners(mesh: &Mesh) -> Vec<[DVec3; 3]> {
    mesh.triangles.iter().map(|corners| corners.map(|corner| mesh.position(corner as usize))).collect()
}

#[test]
fn all_index_types_and_none_give_the_same_triangle() {
    let expected = corners(&only_mesh(&File::triangle().load().unwrap()));
    for (component, bytes) in [(5121, vec![0, 1, 2]), (5125, vec![0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0])] {
        let mut file = File::triangle();
        let accessor = file.accessor(component, "SCALAR", 3, &bytes);
        file.primitive()["indices"] = json!(accessor);
        assert_eq!(corners(&only_mesh(&file.load().unwrap())), expected);
    }
    let mut file = File::triangle();
    file.primitive().as_object_mut().unwrap().remove("indices");
    assert_eq!(corners(&only_mesh(&file.load().unwrap())), expected);
}

#[test]
fn strips_fans_and_their_winding() {
    for (mode, expected) in [(5, 2), (6, 2)] {
        let mut file = File::triangle();
        let positions = file.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0]);
        let order = if mode == 5 { vec![0, 1, 2, 3] } else { vec![0, 1, 3, 2] };
        let indices = file.accessor(5121, "SCALAR", 4, &order);
        *file.primitive() = json!({"attributes": {"POSITION": positions}, "indices": indices, "mode": mode});
        let scene = file.load().unwrap();
        let triangles = corners(&only_mesh(&scene));
        assert_eq!(triangles.len(), expected);
        for [a, b, c] in triangles {
            assert!((b - a).cross(c - a).z > 0.0, "mode {mode}: {a} {b} {c} must be counter-clockwise");
        }
    }
}

#[test]
fn interleaved_vertices_are_read_with_their_stride() {
    let mut file = File::triangle();
    let mut bytes = Vec::new();
    for (position, normal) in [([0.0f32, 0.0, 0.0], 1.0f32), ([1.0, 0.0, 0.0], 2.0), ([0.0, 1.0, 0.0], -3.0)] {
        bytes.extend(position.iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend([0.0, 0.0, normal].iter().flat_map(|x| x.to_le_bytes()));
    }
    let view = file.view(&bytes);
    file.json["bufferViews"][view]["byteStride"] = json!(24);
    for (attribute, offset) in [("POSITION", 0), ("NORMAL", 12)] {
        let accessor =
            json!({"bufferView": view, "byteOffset": offset, "componentType": 5126, "count": 3, "type": "VEC3"});
        let accessor = push(&mut file.json["accessors"], accessor);
        file.primitive()["attributes"][attribute] = json!(accessor);
    }
    let scene = file.load().unwrap();
    let mesh = only_mesh(&scene);
    assert_eq!(mesh.position(1), DVec3::X);
    assert_eq!(mesh.normals, [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], "made unit vectors");
}

#[test]
fn sparse_accessors_replace_single_elements() {
    let mut file = File::triangle();
    let indices = file.view(&[1, 2]);
    let values: Vec<u8> = [5.0f32, 0.0, 0.0, 0.0, 7.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let values = file.view(&values);
    file.json["accessors"][0]["sparse"] = json!({"count": 2,
        "indices": {"bufferView": indices, "componentType": 5121}, "values": {"bufferView": values}});
    let with_base = file.load().unwrap();
    assert_eq!(corners(&only_mesh(&with_base)), [[DVec3::ZERO, DVec3::X * 5.0, DVec3::Y * 7.0]]);
    file.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    let without = file.load().unwrap();
    assert_eq!(corners(&only_mesh(&without)), corners(&only_mesh(&with_base)), "elements not named are zero");
    file.json["accessors"][0]["count"] = json!(2);
    assert!(file.refusal().contains("replaces element 2 of 2"), "{}", file.refusal());
}

#[test]
fn normalised_integers_are_numbers_from_nought_or_minus_one_to_one() {
    let mut file = File::triangle();
    let colors = file.accessor(5121, "VEC4", 3, &[255, 0, 0, 51, 0, 255, 0, 255, 0, 0, 255, 255]);
    file.json["accessors"][colors]["normalized"] = json!(true);
    let normals = file.accessor(5120, "VEC3", 3, &[0, 0, 127, 0, 0, 0, 0x80, 0, 0, 0, 0, 127]);
    file.json["accessors"][normals]["normalized"] = json!(true);
    let view = file.json["accessors"][normals]["bufferView"].as_u64().unwrap() as usize;
    file.json["bufferViews"][view]["byteStride"] = json!(4);
    file.primitive()["attributes"]["COLOR_0"] = json!(colors);
    file.primitive()["attributes"]["NORMAL"] = json!(normals);
    let scene = file.load().unwrap();
    let mesh = only_mesh(&scene);
    assert_eq!(mesh.colors, [[1.0, 0.0, 0.0, 0.2], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]]);
    assert_eq!(mesh.normals[0], [0.0, 0.0, 1.0]);
}

#[test]
fn quantised_positions_are_read() {
    let mut file = File::triangle();
    let bytes: Vec<u8> = [0i16, 0, 0, 0, 1000, 0, 0, 0, 0, -1000, 0, 0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let positions = file.accessor(5122, "VEC3", 3, &bytes);
    let view = file.json["accessors"][positions]["bufferView"].as_u64().unwrap() as usize;
    file.json["bufferViews"][view]["byteStride"] = json!(8);
    file.primitive()["attributes"]["POSITION"] = json!(positions);
    file.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let scene = file.load().unwrap();
    assert_eq!(corners(&only_mesh(&scene)), [[DVec3::ZERO, DVec3::X * 1000.0, DVec3::Y * -1000.0]]);
}

#[test]
fn unusable_normals_become_zero_with_a_warning() {
    let mut file = File::triangle();
    let normals = file.floats("VEC3", &[0.0, 0.0, 0.0, f32::NAN, 0.0, 1.0, 0.0, 0.0, 9.0]);
    file.primitive()["attributes"]["NORMAL"] = json!(normals);
    let scene = file.load().unwrap();
    assert_eq!(only_mesh(&scene).normals, [[0.0; 3], [0.0; 3], [0.0, 0.0, 1.0]]);
    assert!(scene.warnings[0].contains("2 of 3 normals"), "{:?}", scene.warnings);
}

#[test]
fn a_material_with_everything() {
    let mut file = File::triangle();
    texture(&mut file);
    for set in [2, 5] {
        let accessor = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, set as f32]);
        file.primitive()["attributes"][format!("TEXCOORD_{set}")] = json!(accessor);
    }
    file.json["samplers"] = json!([{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}]);
    file.json["textures"] = json!([{"source": 0, "sampler": 0}, {"source": 0}]);
    file.json["materials"] = json!([{
        "name": "everything",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.25, 0.5, 0.75, 0.5],
            "baseColorTexture": {"index": 0, "texCoord": 0, "extensions": {
                "KHR_texture_transform": {"offset": [0.5, 0.25], "scale": [2.0, 4.0], "texCoord": 5}}}
        },
        "emissiveFactor": [0.5, 0.0, 0.25],
        "emissiveTexture": {"index": 1, "texCoord": 2},
        "alphaMode": "MASK", "alphaCutoff": 0.75, "doubleSided": true,
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}}
    }]);
    let scene = file.load().unwrap();
    assert_eq!((scene.textures.len(), scene.warnings.len()), (1, 0), "{:?}", scene.warnings);
    let mesh = only_mesh(&scene);
    let material = mesh.material;
    assert_eq!(material.base_color, [0.25, 0.5, 0.75, 0.5]);
    assert_eq!(material.emissive, [2.0, 0.0, 1.0]);
    assert_eq!(material.alpha, Alpha::Mask { cutoff: 0.75 });
    assert!(material.double_sided && !material.unlit);
    let (base, glow) = (material.base_texture.unwrap(), material.emissive_texture.unwrap());
    assert_eq!((base.wrap_u, base.wrap_v, base.magnify), (Wrap::Clamp, Wrap::Mirror, Filter::Nearest));
    assert_eq!((glow.wrap_u, glow.wrap_v, glow.magnify), (Wrap::Repeat, Wrap::Repeat, Filter::Linear));
    assert_eq!(base.transform, [[2.0, 0.0, 0.5], [0.0, 4.0, 0.25]]);
    assert_eq!(glow.transform, TRANSFORM_IDENTITY);
    assert_eq!(mesh.texcoords[base.set as usize][2], [0.0, 5.0]);
    assert_eq!(mesh.texcoords[glow.set as usize][2], [0.0, 2.0]);
    let picture = scene.textures.get(&base.texture).unwrap();
    assert_eq!((picture.width, picture.height), (2, 1));
    assert_eq!(picture.texels, [[255, 0, 0, 255], [0, 255, 0, 128]]);
}

#[test]
fn an_unlit_material_does_not_glow() {
    let mut file = File::triangle();
    file.json["materials"] = json!([{"emissiveFactor": [1, 1, 1], "alphaMode": "BLEND",
        "extensions": {"KHR_materials_unlit": {}}}]);
    file.json["extensionsRequired"] = json!(["KHR_materials_unlit"]);
    file.primitive()["material"] = json!(0);
    let scene = file.load().unwrap();
    let material = only_mesh(&scene).material;
    assert!(material.unlit && material.alpha == Alpha::Blend && material.emissive == [0.0; 3]);
}

#[test]
fn a_texture_without_coordinates_warns_and_uses_none() {
    let mut file = File::triangle();
    texture(&mut file);
    let scene = file.load().unwrap();
    let mesh = only_mesh(&scene);
    let set = mesh.material.base_texture.unwrap().set as usize;
    assert!(mesh.texcoords.get(set).is_none(), "no set means (0, 0) everywhere");
    assert!(scene.warnings[0].contains("TEXCOORD_0, which it lacks"), "{:?}", scene.warnings);
}

#[test]
fn transformations_are_carried_down_the_tree_in_double_precision() {
    let mut file = File::triangle();
    file.json["nodes"] = json!([
        {"name": "tower", "mesh": 0, "translation": [0.0625, 0.0, 0.0]},
        {"name": "earth", "children": [2], "translation": [6378137.0, 0.0, 0.0]},
        {"name": "turn", "children": [0], "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0.25, 1]}
    ]);
    file.json["scenes"] = json!([{"nodes": [1]}]);
    let scene = file.load().unwrap();
    assert_eq!(scene.nodes.iter().map(|node| node.name.as_str()).collect::<Vec<_>>(), ["earth", "turn", "tower"]);
    let transform = scene.table.objects[0].transform;
    assert_eq!(transform.translation, DVec3::new(6_378_137.0, 0.0625, 0.25));
    assert_eq!(transform.transform_vector3(DVec3::X), DVec3::Y);
}

#[test]
fn only_the_scenes_nodes_are_there_and_shared_meshes_are_kept_once() {
    let mut file = File::triangle();
    file.json["nodes"] = json!([
        {"name": "a", "mesh": 0}, {"name": "b", "mesh": 0, "scale": [-1, 1, 1]}, {"name": "not in the scene", "mesh": 0}
    ]);
    file.json["scenes"] = json!([{"nodes": [2]}, {"nodes": [1, 0]}]);
    file.json["scene"] = json!(1);
    let scene = file.load().unwrap();
    assert_eq!(scene.nodes.iter().map(|node| node.name.as_str()).collect::<Vec<_>>(), ["b", "a"]);
    assert_eq!((scene.objects.len(), scene.shapes.len(), scene.meshes.len()), (2, 1, 1));
    assert!(scene.table.objects[0].transform.matrix3.determinant() < 0.0, "mirrored nodes stay mirrored");
    file.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(file.load().unwrap().nodes[0].name, "not in the scene", "without a default the first scene counts");
    file.json.as_object_mut().unwrap().remove("scenes");
    assert_eq!(file.load().unwrap().nodes.len(), 3, "without scenes all roots count");
}

#[test]
fn what_is_not_drawn_is_warned_of_once() {
    let mut file = File::triangle();
    let points = json!({"attributes": {"POSITION": 0}, "mode": 0});
    let lines = json!({"attributes": {"POSITION": 0}, "mode": 3});
    let morphing = json!({"attributes": {"POSITION": 0}, "targets": [{"POSITION": 0}, {"POSITION": 0}]});
    file.json["meshes"][0]["primitives"] = json!([points.clone(), points, lines, morphing]);
    file.json["skins"] = json!([{"joints": [0]}]);
    file.json["nodes"][0]["skin"] = json!(0);
    file.json["animations"] = json!([{"channels": [], "samplers": []}]);
    let scene = file.load().unwrap();
    assert_eq!(scene.warnings.len(), 4, "{:?}", scene.warnings);
    for word in ["points and lines", "morph targets", "skins", "animations"] {
        assert_eq!(scene.warnings.iter().filter(|warning| warning.contains(word)).count(), 1, "{word}");
    }
    assert_eq!(inspect(&scene).counts.triangles_drawn, 1);
}

#[test]
fn instances_are_nodes_below_their_node() {
    let mut file = File::triangle();
    let translation = file.floats("VEC3", &[1.0, 0.0, 0.0, 2.0, 0.0, 0.0]);
    let rotation = file.accessor(5122, "VEC4", 2, &[0, 0, 255, 127, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 255, 127]);
    file.json["accessors"][rotation]["normalized"] = json!(true);
    file.json["nodes"] = json!([{"name": "trees", "mesh": 0, "translation": [0, 10, 0], "children": [1], "extensions": {
        "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": translation, "ROTATION": rotation}}}}, {"name": "sign"}]);
    file.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let scene = file.load().unwrap();
    let names: Vec<_> = scene.nodes.iter().map(|node| node.name.as_str()).collect();
    assert_eq!(names, ["trees", "trees[0]", "trees[1]", "sign"]);
    let placed: Vec<_> = scene.table.objects.iter().map(|row| row.transform).collect();
    assert_eq!(placed[0].transform_point3(DVec3::Z), DVec3::new(1.0, 10.0, -1.0), "turned half round +Y");
    assert_eq!(placed[1].transform_point3(DVec3::Z), DVec3::new(2.0, 10.0, 1.0));
    assert_eq!(scene.node(NodeIndex(0)).objects, 0..2);
}

#[test]
fn a_gltf_with_its_parts_beside_it_or_inside_equals_the_glb() {
    let mut file = File::triangle();
    texture(&mut file);
    let whole = file.load().unwrap();
    let same = |scene: &Scene| {
        assert!(scene.meshes.keys().eq(whole.meshes.keys()) && scene.textures.keys().eq(whole.textures.keys()));
    };
    let folder = tempfile::tempdir().unwrap();
    let length = file.binary.len();
    std::fs::create_dir(folder.path().join("data")).unwrap();
    std::fs::write(folder.path().join("data/all of it.bin"), &file.binary).unwrap();
    file.json["buffers"] = json!([{"byteLength": length, "uri": "data/all%20of%20it.bin"}]);
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, format!("\u{feff}{}", file.json)).unwrap();
    let beside = import::load(&path).unwrap();
    assert_eq!(beside.name, "scene");
    same(&beside);

    let hex: String = file.binary.iter().map(|byte| format!("%{byte:02X}")).collect();
    file.json["buffers"] = json!([{"byteLength": length, "uri": format!("data:application/octet-stream,{hex}")}]);
    same(&import::load_glb(file.json.to_string().as_bytes(), "inside").unwrap());
}

#[test]
fn an_empty_scene_loads_with_a_warning() {
    let scene = import::load_glb(br#"{"asset": {"version": "2.0"}}"#, "empty").unwrap();
    assert!(scene.objects.is_empty() && scene.warnings[0].contains("nothing is drawn"), "{:?}", scene.warnings);
}
