//! Bad input on the command line: one clear line on stderr, exit code 1 (2 where the command itself was wrong), never a
//! panic.

use crate::program::run;
use std::path::Path;

/// Runs and expects failure; returns the message.
fn fails(code: i32, args: &[&str]) -> String {
    let output = run(args);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{args:?}: {error}");
    assert!(!error.contains("panicked"), "{args:?}: {error}");
    if code == 1 {
        assert_eq!(error.trim_end().lines().count(), 1, "{args:?}: {error}");
        assert!(error.starts_with("cyclorama: "), "{error}");
    }
    error
}

fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) -> String {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path.display().to_string()
}

/// A .gltf of one triangle whose pieces can be replaced.
fn gltf(nodes: &str, position_accessor: &str, index: u16, positions: [f32; 9]) -> String {
    let mut bytes: Vec<u8> = positions.iter().flat_map(|p| p.to_le_bytes()).collect();
    for i in [0, 1, index] {
        bytes.extend_from_slice(&i.to_le_bytes());
    }
    let data: String = bytes.iter().map(|b| format!("%{b:02x}")).collect();
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}], "nodes": {nodes},
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
        "accessors": [{position_accessor}, {{"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 36}}, {{"buffer": 0, "byteOffset": 36, "byteLength": 6}}],
        "buffers": [{{"byteLength": 42, "uri": "data:application/octet-stream,{data}"}}]}}"#
    )
}

const NODE: &str = r#"[{"name": "tower", "mesh": 0}]"#;
const POSITIONS: &str =
    r#"{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0,0,0], "max": [1,1,0]}"#;
const TRIANGLE: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

#[test]
fn the_triangle_that_the_other_tests_break_is_good() {
    let folder = tempfile::tempdir().unwrap();
    let good = write(folder.path(), "good.gltf", gltf(NODE, POSITIONS, 2, TRIANGLE));
    let output = run(&["inspect", &good]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_missing_file_is_named() {
    let error = fails(1, &["inspect", "nowhere.glb"]);
    assert!(error.contains("nowhere.glb: no such file") && error.contains("airport"), "{error}");
}

#[test]
fn a_truncated_glb_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("airport.glb");
    assert!(run(&["scene", "airport", "-o", whole.to_str().unwrap()]).status.success());
    let bytes = std::fs::read(&whole).unwrap();
    for len in [0, 3, 11, 19, 100, bytes.len() / 2, bytes.len() - 1] {
        let cut = write(folder.path(), "cut.glb", &bytes[..len]);
        let error = fails(1, &["inspect", &cut]);
        assert!(error.contains("cut.glb: "), "{len} bytes: {error}");
    }
}

#[test]
fn a_nan_position_is_refused_by_node_accessor_and_element() {
    let folder = tempfile::tempdir().unwrap();
    let mut positions = TRIANGLE;
    positions[4] = f32::NAN;
    let file = write(folder.path(), "nan.gltf", gltf(NODE, POSITIONS, 2, positions));
    let error = fails(1, &["render", &file, "-o", "/dev/null.png"]);
    assert!(error.contains("nan.gltf: node \"tower\": accessor 0") && error.contains("element 1"), "{error}");
}

#[test]
fn an_index_out_of_range_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(folder.path(), "index.gltf", gltf(NODE, POSITIONS, 3, TRIANGLE));
    let error = fails(1, &["inspect", &file]);
    assert!(error.contains("tower") && error.contains('3'), "{error}");
}

#[test]
fn a_cycle_of_nodes_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let nodes = r#"[{"name": "tower", "children": [1]}, {"name": "room", "children": [0]}]"#;
    let file = write(folder.path(), "cycle.gltf", gltf(nodes, POSITIONS, 2, TRIANGLE));
    let error = fails(1, &["inspect", &file]);
    assert!(error.contains("tower") || error.contains("room"), "{error}");
}

#[test]
fn a_four_billion_element_accessor_in_a_small_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let huge = POSITIONS.replace("\"count\": 3", "\"count\": 4294967295");
    let file = write(folder.path(), "huge.gltf", gltf(NODE, &huge, 2, TRIANGLE));
    let error = fails(1, &["inspect", &file]);
    assert!(error.contains("accessor 0"), "{error}");
}

#[test]
fn a_file_that_is_something_else_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in
        [("text.glb", &b"hello, world, this is no model"[..]), ("list.gltf", b"[1, 2"), ("empty.glb", b"")]
    {
        let error = fails(1, &["inspect", &write(folder.path(), name, bytes)]);
        assert!(error.contains(name), "{error}");
    }
}

#[test]
fn a_compressed_mesh_is_refused_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let text = gltf(NODE, POSITIONS, 2, TRIANGLE).replacen(
        '{',
        r#"{"extensionsRequired": ["KHR_draco_mesh_compression"], "extensionsUsed": ["KHR_draco_mesh_compression"],"#,
        1,
    );
    let error = fails(1, &["inspect", &write(folder.path(), "draco.gltf", text)]);
    assert!(error.contains("KHR_draco_mesh_compression") && error.contains("gltf-transform"), "{error}");
}

#[test]
fn wrong_flags_are_usage_errors() {
    assert!(fails(2, &["rig", "--bords", "3"]).contains("--boards"), "the nearest flag is suggested");
    assert!(fails(2, &["render", "airport", "--samples", "5", "-o", "x.png"]).contains("1, 4, 8, 16, 64 or exact"));
    assert!(fails(2, &["fly"]).contains("fly"));
}

#[test]
fn what_no_rig_with_a_stand_by_can_be_is_refused() {
    assert!(fails(2, &["manager", "--standby", "127.0.0.1:7400", "--lock-step"]).contains("--lock-step"));
    let error = fails(1, &["manager", "--standby", "127.0.0.1:7400", "--listen", "127.0.0.1:7400"]);
    assert!(error.contains("listens at 127.0.0.1:7400 itself"), "{error}");
    let three = "127.0.0.1:1,127.0.0.1:2,127.0.0.1:3";
    assert!(fails(1, &["channel", "--backplane", three]).contains("there can be two: one leads, and one stands by"));
    let twice = ["compositor", "--backplane", "127.0.0.1:1", "--backplane", "127.0.0.1:1"];
    assert!(fails(1, &twice).contains("given twice"));
    let folder = tempfile::tempdir().unwrap();
    let flight = write(folder.path(), "path.json", r#"[{"eye": [1, 2, 3], "target": [0, 0, 0]}]"#);
    let both = ["host", "play", &flight, "--lock-step", "--to", "127.0.0.1:1", "--to", "127.0.0.1:2"];
    assert!(fails(1, &both).contains("in lock-step there is one manager"));
    let anywhere = write(folder.path(), "rig.toml", "[ports]\nbackplane = \"0.0.0.0:7400\"\n");
    assert!(fails(1, &["manager", "--rig", &anywhere, "--standby"]).contains("--standby HOST:PORT"));
}

#[test]
fn an_unknown_rig_key_is_refused_with_line_and_suggestion() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(folder.path(), "rig.toml", "scene = \"airport\"\n\n[ports]\nbackplan = \"127.0.0.1:0\"\n");
    let error = fails(1, &["manager", "--rig", &file]);
    assert!(error.contains("rig.toml: line 4: unknown key \"backplan\"; did you mean \"backplane\"?"), "{error}");
}

#[test]
fn a_busy_port_is_named_with_the_flag_that_changes_it() {
    let holder = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = holder.local_addr().unwrap().to_string();
    let error = fails(1, &["manager", "--listen", &address, "--pose-listen", "127.0.0.1:0", "--console", "off"]);
    assert!(error.contains(&address) && error.contains("--listen"), "{error}");
    let free = ["manager", "--listen", "127.0.0.1:0", "--pose-listen", "127.0.0.1:0", "--console", &address];
    let error = fails(1, &free);
    assert!(error.contains(&address) && error.contains("--console"), "{error}");
}

#[test]
fn an_address_beyond_this_machine_needs_a_word() {
    let error = fails(1, &["manager", "--listen", "0.0.0.0:0"]);
    assert!(error.contains("--insecure"), "{error}");
    assert!(fails(1, &["channel", "--listen", "0.0.0.0:0"]).contains("--insecure"));
}

#[test]
fn a_bad_camera_is_named_with_line_or_pose() {
    let folder = tempfile::tempdir().unwrap();
    let render = |text: &str| {
        let file = write(folder.path(), "path.json", text);
        fails(1, &["render", "airport", "--camera", &file, "-o", "x.png"])
    };
    assert!(render("[{\"eye\": [1, 2, 3],\n \"targt\": [0, 0, 0]}]").contains("line 2"));
    assert!(render(r#"[{"eye": [1, 2, 3], "target": [1, 2, 3]}]"#).contains("pose 0"));
    assert!(render("[]").contains("no pose"));
    let error = fails(1, &["render", "airport", "--pose", "99999", "-o", "x.png"]);
    assert!(error.contains("--pose 99999") && error.contains("poses 0 to"), "{error}");
}

#[test]
fn a_picture_that_cannot_be_written_is_named() {
    let error = fails(1, &["render", "airport", "--size", "32x32", "-o", "/no/such/folder/x.png"]);
    assert!(error.contains("/no/such/folder/x.png: "), "{error}");
    assert!(fails(1, &["render", "airport", "-o", "x.gif"]).contains(".exr"));
}
