//! The bytes suite: the same picture for any number of boards, any way to share it, any number of threads.
//!
//! The ordinary run takes pairs: every number of boards meets either mode and either number of threads somewhere. With
//! `CYCLORAMA_BYTES=full` it takes the whole product, on all built-in scenes.

use crate::render;
use std::path::Path;

const BOARDS: [&str; 6] = ["1", "2", "3", "5", "8", "16"];

/// (boards, mode, threads): each pair of values occurs.
const PAIRS: [(&str, &str, &str); 8] = [
    ("1", "region", "2"),
    ("2", "interleave", "2"),
    ("3", "region", "1"),
    ("5", "interleave", "1"),
    ("5", "region", "2"),
    ("8", "region", "1"),
    ("8", "interleave", "2"),
    ("16", "interleave", "1"),
];

fn is_full() -> bool {
    std::env::var("CYCLORAMA_BYTES").is_ok_and(|value| value == "full")
}

fn combinations() -> Vec<(&'static str, &'static str, &'static str)> {
    if !is_full() {
        return PAIRS.to_vec();
    }
    let modes = |boards| ["interleave", "region"].map(|mode| ["1", "2"].map(|threads| (boards, mode, threads)));
    BOARDS.into_iter().flat_map(modes).flatten().collect()
}

fn same(scene: &str, pose: &str, samples: &str, size: &str) {
    let draw = |boards: &str, mode: &str, threads: &str| {
        let args = ["--pose", pose, "--samples", samples, "--size", size, "--mode", mode];
        render(Path::new(scene), &[&args[..], &["--boards", boards, "--threads", threads]].concat())
    };
    let one = draw("1", "interleave", "1");
    for (boards, mode, threads) in combinations() {
        assert!(draw(boards, mode, threads) == one, "{scene}, pose {pose}: {boards} boards, {mode}, {threads} threads");
    }
}

#[test]
fn the_airport_is_the_same_for_any_boards_modes_and_threads() {
    for (pose, samples) in [("0", "1"), ("500", "16"), ("1150", "64")] {
        same("airport", pose, samples, "300x170");
    }
}

#[test]
fn the_benchmark_scenes_are_the_same_for_any_boards_modes_and_threads() {
    for (scene, samples) in [("city", "8"), ("smoke", "4"), ("runway", "64"), ("overdraw", "16")] {
        same(scene, "30", samples, "240x135");
    }
    // A million triangles take a while to make; the ordinary run leaves them to the others' likeness.
    if is_full() {
        same("dense", "30", "4", "240x135");
    }
}
