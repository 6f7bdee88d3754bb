//! Boards with too little memory for the scene: no frame waits for what isn't there, what stands in is the same at all boards of a view, and
//! nobody ever holds more than its limit.

use crate::grid;
use crate::program::{Rig, daemon, files, fly, stats, wait_for};
use manager::scene::{Scene, builtin, import};
use proto::piece::{mesh_memory, texture_memory};
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::path::Path;

/// What all of a scene counts for, bytes.
fn memory(scene: &Scene) -> u64 {
    let meshes = scene.meshes.all().unwrap().values().map(|mesh| mesh_memory(mesh)).sum::<u64>();
    meshes + scene.textures.sizes().map(|(_, [width, height])| texture_memory(width, height)).sum::<u64>()
}

/// A third of it as a limit, MiB.
fn third(scene: &Scene) -> String {
    format!("{}", memory(scene) as f64 / 3.0 / f64::from(1 << 20))
}

/// A low flight across the grid and back, one pose a frame.
fn flight(folder: &Path, frames: usize) -> String {
    let reach = 4.0 * grid::STEP;
    let pose = |k: usize| {
        let turn = k as f64 / frames as f64 * std::f64::consts::TAU;
        let (sin, cos) = turn.sin_cos();
        json!({"eye": [reach * cos, 4.0, reach * sin], "target": [reach * cos - 20.0 * sin, 2.0, reach * sin + 20.0 * cos], "vertical_fov_deg": 50})
    };
    let path = folder.join("flight.json");
    std::fs::write(&path, Value::Array((0..frames).map(pose).collect()).to_string()).unwrap();
    path.to_str().unwrap().to_owned()
}

/// What holds of every rig in real time.
fn check(stats: &Value, boards: usize) {
    assert_eq!(stats["boards"], boards, "{stats}");
    assert_eq!(stats["streaming"]["frames_waited"], 0, "{stats}");
    let events = stats["events"].to_string();
    // A board that is named something that it doesn't hold closes its link, and so does one that is sent more than it has room for.
    assert!(!events.contains("\"lost\""), "{events}");
    assert!(!events.contains("\"put out\""), "{events}");
    let memory = stats["memory"].as_array().unwrap();
    assert_eq!(memory.len(), boards, "the memory of every board is told");
    for board in memory {
        assert!(board["peak_bytes"].as_u64() <= board["limit_bytes"].as_u64(), "{board}");
        assert!(board["limit_bytes"].as_u64().unwrap() * 29 / 10 < stats["scene_bytes"].as_u64().unwrap(), "{board}");
    }
}

#[test]
fn a_grid_of_models_is_flown_through_with_a_third_of_its_memory() {
    let Some(models) = grid::models() else { return println!("SKIPPED: no models; see CYCLORAMA_DATA") };
    let folder = tempfile::tempdir().unwrap();
    let scene = grid::write(&models, folder.path(), 12);
    let limit = third(&import::load(&scene).unwrap());
    let (scene, camera) = (scene.to_str().unwrap(), flight(folder.path(), 240));
    let small = ["--size", "128x72", "--samples", "1", "--memory-limit", &limit];

    // In real time: pieces come and go while the views turn.
    let rig = Rig::start(&[&[scene, "--views", "2", "--boards", "3", "--camera", &camera], &small[..]].concat());
    let count = |stats: &Value, name: &str| stats["streaming"][name].as_u64().unwrap();
    let stats = rig.wait("a flight with too little memory", |stats| {
        stats["frames"].as_u64() > Some(100) && count(stats, "evicted") > 0 && count(stats, "substitutions") > 0
    });
    check(&stats, 3);
    drop(rig);

    // In lock-step: the pictures depend on the memory, not on how many boards share a view.
    let short = flight(folder.path(), 8);
    let flown = |boards: &str, more: &[&str]| {
        let out = folder.path().join(format!("{boards}{}", more.join("")));
        let of = [
            "--views",
            "1",
            "--boards",
            boards,
            "--camera",
            &short,
            "--frames",
            "8",
            "--size",
            "128x72",
            "--samples",
            "1",
        ];
        let stats = fly(&out, &[&[scene], &of[..], more].concat());
        (
            files(&out),
            stats["streaming"]["substitutions"].as_u64().unwrap(),
            stats["streaming"]["omitted"].as_u64().unwrap(),
        )
    };
    let alone = flown("1", &["--memory-limit", &limit]);
    assert!(alone.1 + alone.2 > 0, "not all has room");
    assert_eq!(flown("2", &["--memory-limit", &limit]), alone);
    assert_eq!(flown("3", &["--memory-limit", &limit, "--mode", "region"]), alone);
    let whole = flown("2", &[]);
    assert_eq!((whole.1, whole.2), (0, 0), "with all the memory there is");
    assert_ne!(whole.0, alone.0, "and then one sees more");
}

#[test]
fn dense_is_flown_through_with_a_third_of_its_memory() {
    let built = builtin::build("dense").unwrap();
    let limit = third(&import::load_glb(&built.glb, built.name).unwrap());
    let small = ["--views", "1", "--boards", "2", "--size", "96x64", "--samples", "1", "--memory-limit", &limit];
    let rig = Rig::start(&[&["dense"], &small[..]].concat());
    let stats = rig.wait("a flight with too little memory", |stats| {
        let streaming = &stats["streaming"];
        stats["frames"].as_u64() > Some(60)
            && streaming["omitted"].as_u64() > Some(0)
            && streaming["evicted"].as_u64() > Some(0)
    });
    check(&stats, 2);
}

#[test]
fn a_board_that_comes_back_to_another_manager_is_sent_no_mesh_again() {
    let free = || std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let (backplane, console) = (free(), free());
    let at: SocketAddr = console.parse().unwrap();
    let manage = || {
        let ports = ["--listen", &backplane, "--console", &console, "--pose-listen", "127.0.0.1:0"];
        daemon(
            &[&["manager", "--scene", "airport", "--views", "1", "--size", "96x64", "--samples", "1"], &ports[..]]
                .concat(),
        )
    };
    let is_whole = |stats: &Value| stats["boards"] == 1 && stats["memory"][0]["held_bytes"] == stats["scene_bytes"];
    let first = manage();
    let _board = daemon(&["channel", "--backplane", &backplane, "--threads", "1"]);
    let stats_first = wait_for("a board with all of the scene", || stats(at).filter(is_whole));
    assert!(stats_first["streaming"]["pieces"].as_u64() > Some(0));
    assert_eq!(stats_first["skipped"]["meshes_cached"], 0);
    drop(first);
    let _second = manage();
    let stats_second = wait_for("the board again", || stats(at).filter(is_whole));
    assert_eq!(stats_second["streaming"]["pieces"], 0, "{stats_second}");
    assert_eq!(stats_second["skipped"]["meshes_cached"], stats_first["streaming"]["pieces"]);
}
