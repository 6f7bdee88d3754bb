//! Scene extras, models, levels of detail and lights.

use super::{File, push};
use crate::scene::{NodeIndex, Scene};
use proto::ids::ModelId;
use proto::scene::{LightKind, ModelPart, ModelRow};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// A file whose nodes all show the one triangle, unless they say otherwise.
fn nodes(nodes: Value) -> File {
    let mut file = File::triangle();
    let mut nodes = nodes;
    for node in nodes.as_array_mut().unwrap() {
        if node["mesh"].is_null() {
            node["mesh"] = json!(0);
        } else if node["mesh"] == json!(-1) {
            node.as_object_mut().unwrap().remove("mesh");
        }
    }
    let below: Vec<u64> = nodes
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|node| node["children"].as_array().cloned().unwrap_or_default())
        .filter_map(|child| child.as_u64())
        .collect();
    let roots: Vec<u64> = (0..nodes.as_array().unwrap().len() as u64).filter(|node| !below.contains(node)).collect();
    file.json["nodes"] = nodes;
    file.json["scenes"] = json!([{"nodes": roots}]);
    file
}

fn ours(extras: Value) -> Value {
    json!({"cyclorama": extras})
}

/// (node's name, model, version) of each object.
fn parts(scene: &Scene) -> Vec<(&str, Option<(u32, u32)>)> {
    let part = |row: &proto::scene::SubobjectRow| row.part_of.map(|ModelPart { model, version }| (model.0, version));
    let name = |object: proto::ids::ObjectId| scene.node(scene.object(object).node).name.as_str();
    scene.table.subobjects.iter().map(|row| (name(row.object), part(row))).collect()
}

#[test]
fn layers_come_from_the_narrowest_place() {
    let mut file = nodes(json!([
        {"name": "plain"},
        {"name": "ground", "extras": ours(json!({"layer": 1})), "children": [2, 3]},
        {"name": "below"},
        {"name": "own", "extras": {"layer": 7}},
        {"name": "mesh", "mesh": 1, "extras": {"layer": 9}},
    ]));
    let primitive = json!({"attributes": {"POSITION": 0}, "indices": 1});
    let mut painted = primitive.clone();
    painted["material"] = json!(0);
    let mut special = painted.clone();
    special["extras"] = ours(json!({"layer": -4}));
    file.json["materials"] = json!([{"extras": ours(json!({"layer": 3}))}]);
    let both = json!({"primitives": [primitive, painted, special], "extras": {"layer": 8, "cyclorama": {"layer": 2}}});
    push(&mut file.json["meshes"], both);
    let scene = file.load().unwrap();
    let rows: Vec<_> = scene.table.subobjects.iter().map(|row| (row.primitive, row.layer)).collect();
    // The mesh's own says 2; extras.layer alone is the weaker word of the two.
    assert_eq!(rows, [(0, 0), (1, 1), (2, 1), (3, 7), (4, 2), (5, 3), (6, -4)]);
    assert_eq!(scene.warnings, Vec::<String>::new());
}

#[test]
fn all_pieces_of_a_primitive_have_its_number() {
    let mut file = File::triangle();
    let corners: Vec<u8> = [0, 0, 1, 0, 2, 0].repeat(3000);
    let many = file.accessor(5123, "SCALAR", 9000, &corners);
    file.primitive()["indices"] = json!(many);
    let again = file.primitive().clone();
    push(&mut file.json["meshes"][0]["primitives"], again);
    push(&mut file.json["nodes"], json!({"mesh": 0}));
    file.json["scenes"][0]["nodes"] = json!([0, 1]);
    let scene = file.load().unwrap();
    let numbers: Vec<u32> = scene.table.subobjects.iter().map(|row| row.primitive).collect();
    assert_eq!(numbers, [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3]);
}

#[test]
fn traits_are_inherited_and_kept_with_the_object() {
    let said = json!({"surface": true, "critical_radius": 12.5, "cue": true, "static": false});
    let scene = nodes(json!([
        {"name": "lake", "mesh": -1, "extras": ours(said), "children": [1, 2]},
        {"name": "shore"},
        {"name": "pier", "extras": ours(json!({"surface": false, "static": true}))},
        {"name": "hill"},
    ]))
    .load()
    .unwrap();
    let found: Vec<_> = scene
        .objects
        .iter()
        .map(|object| object.traits)
        .map(|traits| (traits.surface, traits.critical_radius, traits.cue, traits.is_static))
        .collect();
    assert_eq!(found, [(true, Some(12.5), true, false), (false, Some(12.5), true, true), (false, None, false, true)]);
}

#[test]
fn what_is_not_understood_is_said_by_name() {
    let scene = nodes(json!([
        {"name": "a", "extras": ours(json!({"layr": 1, "layer": "top", "critical_radius": -2, "entity": 1.5, "levels": [3]}))},
        {"name": "b", "extras": {"cyclorama": 7, "other": {"layr": 1}}},
        {"name": "c", "extras": {"layer": "background"}},
    ]))
    .load()
    .unwrap();
    assert_eq!(scene.warnings.len(), 6, "{:#?}", scene.warnings);
    for key in ["layr is not known", "layer must", "critical_radius must", "entity must", "levels must"] {
        let there = scene.warnings.iter().any(|w| w.starts_with("node \"a\": ") && w.contains(key));
        assert!(there, "{key}: {:#?}", scene.warnings);
    }
    assert!(scene.warnings.iter().any(|w| w.starts_with("node \"b\": ")));

    let mut file = File::triangle();
    file.primitive()["extras"] = ours(json!({"entity": 4, "cue": true}));
    let warnings = file.load().unwrap().warnings;
    assert!(warnings.iter().all(|w| w.starts_with("mesh 0, primitive 0: ")) && warnings.len() == 2, "{warnings:#?}");
}

#[test]
fn entities_are_found_by_number_and_no_number_is_given_twice() {
    let mut list = json!([{"name": "a"}, {"name": "b", "extras": ours(json!({"entity": 17}))}]);
    let scene = nodes(list.clone()).load().unwrap();
    assert_eq!(scene.node_by_entity(17), Some(NodeIndex(1)));
    assert_eq!(scene.node_by_entity(1), None);
    list[0]["extras"] = ours(json!({"entity": 17.0}));
    let message = nodes(list).refusal();
    assert!(message.contains("node \"b\" has the entity number 17, which node \"a\" has already"), "{message}");
}

#[test]
fn a_merged_node_and_all_below_is_one_model() {
    let merged = ours(json!({"merged": true}));
    let list = json!([
        {"name": "smoke", "mesh": -1, "extras": merged, "children": [1, 2]},
        {"name": "puff"},
        {"name": "puff"},
        {"name": "hut"},
    ]);
    let scene = nodes(list.clone()).load().unwrap();
    assert_eq!(parts(&scene), [("puff", Some((0, 0))), ("puff", Some((0, 0))), ("hut", None)]);
    assert_eq!(scene.table.models, [ModelRow { merged: true, versions: 1 }]);
    assert_eq!(scene.model_of("smoke"), Some(ModelId(0)));
    assert_eq!(scene.model_of("puff"), None);

    let mut nested = list;
    nested[2]["extras"] = merged;
    let message = nodes(nested).refusal();
    assert!(message.contains("node \"puff\" is merged inside node \"smoke\""), "{message}");
}

#[test]
fn marked_parts_of_a_mesh_are_a_model_in_each_node_that_shows_it() {
    let mut file = nodes(json!([{"name": "a"}, {"name": "b"}]));
    let mut vapour = file.primitive().clone();
    vapour["material"] = json!(0);
    file.json["materials"] = json!([{"name": "vapour", "extras": ours(json!({"merged": true}))}]);
    push(&mut file.json["meshes"][0]["primitives"], vapour);
    let scene = file.load().unwrap();
    assert_eq!(parts(&scene), [("a", None), ("a", Some((0, 0))), ("b", None), ("b", Some((1, 0)))]);
    assert_eq!(scene.model_of("b"), Some(ModelId(1)));
}

/// All three notations, each with three levels, give the same model; moving its node moves all versions.
#[test]
fn levels_of_detail_in_all_notations() {
    let msft = nodes(json!([
        {"name": "hut", "translation": [5, 0, 0], "extensions": {"MSFT_lod": {"ids": [2, 3]}}, "children": [1]},
        {"name": "door"},
        {"name": "coarse", "translation": [5, 0, 0]},
        {"name": "coarsest", "translation": [5, 1, 0]},
        {"name": "tree"},
    ]));
    let siblings = nodes(json!([
        {"name": "coarsest_LOD2", "translation": [5, 1, 0]},
        {"name": "hut_LOD0", "translation": [5, 0, 0], "children": [2]},
        {"name": "door"},
        {"name": "hut_LOD1", "translation": [5, 0, 0]},
        {"name": "hut_LOD2", "translation": [5, 1, 0]},
        {"name": "tree"},
    ]));
    let named = nodes(json!([
        {"name": "hut", "mesh": -1, "extras": ours(json!({"levels": ["fine", "coarse", "coarsest"]})), "children": [1, 3]},
        {"name": "fine", "children": [2]},
        {"name": "door"},
        {"name": "coarse"},
        {"name": "coarsest", "translation": [0, 1, 0]},
        {"name": "tree"},
    ]));
    for (notation, mut file) in [("MSFT_lod", msft), ("siblings", siblings), ("names", named)] {
        file.json["extensionsRequired"] = json!(["MSFT_lod"]);
        let scene = file.load().unwrap_or_else(|error| panic!("{notation}: {error}"));
        assert_eq!(scene.table.models, [ModelRow { merged: false, versions: 3 }], "{notation}");
        let versions: Vec<_> = parts(&scene).into_iter().filter_map(|(_, part)| Some(part?.1)).collect();
        assert_eq!(versions, [0, 0, 1, 2], "{notation}");
        assert_eq!(parts(&scene).last().unwrap(), &("tree", None), "{notation}");
        assert_eq!(scene.model_of("hut"), Some(ModelId(0)), "{notation}");
        let node = scene.node(scene.models[0].node);
        assert_eq!(node.objects.len(), 4, "{notation}: all versions are below the model's node");
        let x = if notation == "names" { 0.0 } else { 5.0 };
        let last = scene.table.objects[node.objects.end as usize - 1].transform.translation;
        assert_eq!(last, glam::dvec3(x, 1.0, 0.0), "{notation}: it stands where the file puts it");
    }
}

#[test]
fn sets_of_siblings_with_one_name_are_told_apart_and_orphans_named() {
    let scene = nodes(json!([
        {"name": "t_LOD0"}, {"name": "t_LOD1"}, {"name": "t_LOD0"}, {"name": "t_LOD1"}, {"name": "u_LOD1"},
    ]))
    .load()
    .unwrap();
    let found: Vec<_> = parts(&scene).into_iter().map(|(_, part)| part).collect();
    assert_eq!(found, [Some((0, 0)), Some((0, 1)), Some((1, 0)), Some((1, 1)), None]);
    assert!(scene.warnings.iter().any(|w| w.contains("node \"u_LOD1\"")), "{:?}", scene.warnings);
}

#[test]
fn levels_that_make_no_sense_are_refused_by_name() {
    let lod = |ids: Value| json!({"MSFT_lod": {"ids": ids}});
    for (list, words) in [
        (json!([{"name": "a", "extensions": lod(json!([9]))}]), "there is no node 9"),
        (
            json!([{"name": "a", "extensions": lod(json!([1, 1]))}, {"name": "b"}]),
            "node \"b\": it is a level of detail twice",
        ),
        (
            json!([{"name": "a", "extensions": lod(json!([1]))}, {"name": "b", "extensions": lod(json!([0]))}]),
            "it is a level of detail twice",
        ),
        (
            json!([{"name": "a", "children": [1]}, {"name": "b", "extensions": lod(json!([0]))}]),
            "node \"a\": it is a level of detail of node \"b\", which is below it",
        ),
        (
            json!([
                {"name": "a", "extensions": lod(json!([1]))}, {"name": "b", "children": [2]},
                {"name": "c", "extensions": lod(json!([3]))}, {"name": "d"},
            ]),
            "node \"c\" has levels of detail inside node \"a\"",
        ),
        (json!([{"name": "a", "extras": ours(json!({"levels": ["x", "y"]}))}]), "there is no node \"x\""),
        (
            json!([
                {"name": "a", "extensions": lod(json!([1])), "children": [2]}, {"name": "b"},
                {"name": "c", "extras": ours(json!({"merged": true}))},
            ]),
            "node \"c\" is merged inside node \"a\"",
        ),
        (
            json!([{"name": "a", "scale": [0, 1, 1], "extensions": lod(json!([1]))}, {"name": "b"}]),
            "node \"a\" has levels of detail, but a scale of 0",
        ),
    ] {
        let message = nodes(list).refusal();
        assert!(message.contains(words), "{words}\n{message}");
    }
}

#[test]
fn weights_of_versions_are_checked() {
    let scene = nodes(json!([
        {"name": "hut", "extensions": {"MSFT_lod": {"ids": [1]}}}, {"name": "coarse"},
        {"name": "smoke", "extras": ours(json!({"merged": true}))},
    ]))
    .load()
    .unwrap();
    let ask = |name: &str, weights: &[f64]| scene.version_weights(&BTreeMap::from([(name.into(), weights.to_vec())]));
    let found = ask("hut", &[0.25, 0.75]).unwrap();
    assert_eq!((found[0].model, &found[0].weights[..]), (ModelId(0), &[0.25, 0.75][..]));
    assert!(ask("hut", &[0.1, 0.2]).is_ok(), "the rest shows nothing");
    assert!(ask("smoke", &[0.5]).is_ok());
    for (name, weights, words) in [
        ("hat", &[1.0][..], "no model begins at a node \"hat\""),
        ("hut", &[1.0], "has 2 versions, 1 weights"),
        ("hut", &[0.7, 0.4], "sum up to"),
        ("hut", &[-0.1, 1.0], "the weight -0.1"),
        ("hut", &[f64::NAN, 1.0], "the weight NaN"),
    ] {
        let message = ask(name, weights).unwrap_err().to_string();
        assert!(message.contains(words), "{words}\n{message}");
    }
}

#[test]
fn lights_stand_where_their_nodes_stand() {
    let mut file = nodes(json!([
        {"name": "mast", "translation": [0, 10, 0], "rotation": [-0.5f64.sqrt(), 0, 0, 0.5f64.sqrt()], "scale": [2, 2, 2],
         "mesh": -1, "children": [1, 2]},
        {"name": "lamp", "translation": [1, 0, 0], "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"name": "bulb", "mesh": -1, "extensions": {"KHR_lights_punctual": {"light": 1}}},
        {"name": "sun", "mesh": -1, "extensions": {"KHR_lights_punctual": {"light": 2}}},
    ]));
    file.json["extensionsRequired"] = json!(["KHR_lights_punctual"]);
    file.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    file.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "spot", "color": [1, 0.5, 0], "intensity": 40, "range": 30, "spot": {"innerConeAngle": 0.5}},
        {"type": "point", "range": -1},
        {"type": "directional", "intensity": 3, "extras": {"by": "hand"}},
    ]}});
    let scene = file.load().unwrap();
    let [spot, point, sun] = scene.table.lights[..] else { panic!("{:?}", scene.table.lights) };
    assert_eq!(spot.intensity, [40.0, 20.0, 0.0]);
    assert!(spot.position.distance(glam::dvec3(2.0, 10.0, 0.0)) < 1e-12, "{}", spot.position);
    assert!(spot.direction.distance(glam::DVec3::NEG_Y) < 1e-12, "turned to shine down: {}", spot.direction);
    let LightKind::Spot { range: Some(30.0), inner_cos, outer_cos } = spot.kind else { panic!("{:?}", spot.kind) };
    assert!((inner_cos - 0.877_582_6).abs() < 1e-6 && (outer_cos - std::f32::consts::FRAC_1_SQRT_2).abs() < 1e-6);
    assert_eq!(point.kind, LightKind::Point { range: None });
    assert_eq!((sun.kind, sun.intensity), (LightKind::Directional, [3.0; 3]));
    assert_eq!(scene.warnings.len(), 1, "only the range: {:?}", scene.warnings);
}
