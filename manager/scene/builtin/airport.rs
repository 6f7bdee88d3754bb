//! The scene `airport`: an airport in rolling country, and an approach to it.
//!
//! Frame: metres, +X east, +Y up, −Z north; the origin is the middle of the runway's southern threshold, and the
//! airfield is level at y = 0. About 50 000 triangles are shown, most of them by shared meshes. The order of the parts
//! is that of the file.
//!
//! * [`terrain`] is the shape of the land and its division into fields; [`vegetation`] covers it
//! * [`runway`], [`buildings`], [`village`] are what people built, [`aircraft`] what they fly
//! * [`flight`] is the camera path and the traffic
//! * [`kit`] holds materials, levels and painted shadows

mod aircraft;
mod buildings;
mod flight;
mod kit;
mod runway;
mod terrain;
mod vegetation;
mod village;

use super::BuiltIn;
use aircraft::Fleet;
use flight::node;
use kit::Kit;
use terrain::Land;

/// Where airliners stand along the terminal, z, m.
const STANDS_Z: [f64; 5] = [-585.0, -640.0, -725.0, -800.0, -860.0];
const SEED: u64 = 1978;

/// Makes the scene and the flight.
pub(super) fn build() -> BuiltIn {
    let (kit, land) = scene();
    BuiltIn { name: "airport", glb: kit.glb.write(), camera: flight::camera(&land) }
}

fn scene() -> (Kit, Land) {
    let mut kit = Kit::new(SEED);
    let land = Land::new(&mut kit.random);
    vegetation::build(&mut kit, &land);
    runway::build(&mut kit);
    let fleet = Fleet::new(&mut kit);
    let cars = village::cars(&mut kit);
    let lorry = village::lorry(&mut kit);
    buildings::build(&mut kit, &fleet, cars, lorry);
    let houses = village::build(&mut kit);
    vegetation::trees(&mut kit, &land, &houses);
    village::clouds(&mut kit);

    let radar = buildings::radar(&mut kit);
    for placed in flight::traffic(0.0, &land.road_south()) {
        let mesh = match placed.node {
            node::DEPARTING | node::TAXIING => fleet.airliner,
            node::DEPARTING_SHADOW | node::TAXIING_SHADOW => fleet.airliner_shadow,
            node::CIRCUIT => fleet.light[0],
            node::CAR => cars[0],
            node::LORRY => lorry,
            _ => radar,
        };
        kit.entity(placed.node, mesh, placed.at, placed.turned);
    }
    (kit, land)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use serde_json::Value;
    use std::collections::BTreeSet;

    /// The JSON chunk and the binary chunk.
    fn chunks(glb: &[u8]) -> (Value, &[u8]) {
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        (serde_json::from_slice(&glb[20..20 + length]).unwrap(), &glb[28 + length..])
    }

    #[test]
    fn it_is_the_same_to_the_byte_every_time() {
        let (first, second) = (build(), build());
        assert!(first.glb == second.glb, "the scene differs");
        assert_eq!(first.camera, second.camera);
    }

    #[test]
    fn it_has_about_fifty_thousand_triangles() {
        let (kit, _) = scene();
        let count = kit.glb.triangles_drawn();
        assert!((40_000..=60_000).contains(&count), "{count} triangles");
    }

    #[test]
    fn every_moved_node_exists_once() {
        let scene = build();
        let (document, _) = chunks(&scene.glb);
        let names: Vec<&str> =
            document["nodes"].as_array().unwrap().iter().filter_map(|n| n["name"].as_str()).collect();
        let moved: BTreeSet<&str> =
            scene.camera.poses.iter().flat_map(|pose| &pose.entities).map(|entity| entity.node.as_str()).collect();
        assert_eq!(moved.len(), 8);
        for node in moved {
            assert_eq!(names.iter().filter(|name| **name == node).count(), 1, "{node}");
        }
    }

    #[test]
    fn accessors_lie_in_their_views_and_within_their_bounds() {
        let scene = build();
        let (document, binary) = chunks(&scene.glb);
        let number = |v: &Value| v.as_u64().unwrap() as usize;
        for accessor in document["accessors"].as_array().unwrap() {
            let view = &document["bufferViews"][number(&accessor["bufferView"])];
            let (start, length) = (number(&view["byteOffset"]), number(&view["byteLength"]));
            let width = match accessor["type"].as_str().unwrap() {
                "SCALAR" => 1,
                "VEC2" => 2,
                _ => 3,
            };
            assert_eq!(length, number(&accessor["count"]) * width * 4);
            let bytes = &binary[start..start + length];
            if accessor["componentType"] == 5126 {
                let values: Vec<f32> = bytes.chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
                assert!(values.iter().all(|x| x.is_finite()), "a number is not finite");
                for (bound, pick) in [("min", f32::min as fn(f32, f32) -> f32), ("max", f32::max)] {
                    let Some(stated) = accessor[bound].as_array() else { continue };
                    for axis in 0..3 {
                        let found = values[axis..].iter().step_by(3).copied().reduce(pick).unwrap();
                        assert_eq!(stated[axis].as_f64().unwrap() as f32, found, "{bound} of axis {axis}");
                    }
                }
            }
        }
    }

    /// A face whose normals point to its back is lit as if it were inside out, and usually is.
    #[test]
    fn no_face_turns_away_from_its_normals() {
        let scene = build();
        let (document, binary) = chunks(&scene.glb);
        let number = |v: &Value| v.as_u64().unwrap() as usize;
        let words = |accessor: &Value| {
            let accessor = &document["accessors"][number(accessor)];
            let view = &document["bufferViews"][number(&accessor["bufferView"])];
            let start = number(&view["byteOffset"]);
            let words = binary[start..start + number(&view["byteLength"])].chunks(4);
            words.map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect::<Vec<_>>()
        };
        let vectors = |accessor: &Value| {
            let words: Vec<f64> = words(accessor).iter().map(|w| f64::from(f32::from_bits(*w))).collect();
            words.chunks(3).map(DVec3::from_slice).collect::<Vec<_>>()
        };
        for mesh in document["meshes"].as_array().unwrap() {
            for primitive in mesh["primitives"].as_array().unwrap() {
                let positions = vectors(&primitive["attributes"]["POSITION"]);
                let normals = vectors(&primitive["attributes"]["NORMAL"]);
                for t in words(&primitive["indices"]).chunks(3) {
                    let [a, b, c] = [0, 1, 2].map(|k| positions[t[k] as usize]);
                    let face = (b - a).cross(c - a).normalize_or_zero();
                    let mean: DVec3 = t.iter().map(|&i| normals[i as usize]).sum();
                    assert!(face != DVec3::ZERO, "{}: a face without area at {a}", mesh["name"]);
                    assert!(face.dot(mean) > 0.0, "{}: a face at {a} turns away from its normals", mesh["name"]);
                }
            }
        }
    }

    #[test]
    fn the_camera_file_reads_back() {
        let camera = build().camera;
        let text = serde_json::to_string(&camera.poses).unwrap();
        assert!(text.len() < 2_000_000, "{} bytes", text.len());
        let poses: Vec<crate::host::camera::CameraPose> = serde_json::from_str(&text).unwrap();
        assert_eq!(poses, camera.poses);
        let first = poses[0].pose().unwrap();
        assert!((first.orientation * DVec3::NEG_Z).z < 0.0, "the flight heads north");
    }
}
