//! The bytes suite: the same picture for any number of boards, any way to share it, any number of threads, any
//! instruction set of this machine.
//!
//! The ordinary run takes pairs: every number of boards meets either mode and either number of threads somewhere, and every
//! instruction set some of them. With `CYCLORAMA_BYTES=full` it takes the whole product, on all built-in scenes. What this
//! machine lacks (NEON, or AVX-512) is untested.

use crate::{render, towers};
use channel::simd::SimdLevel;
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

/// Boards, mode, threads and instruction set.
fn combinations() -> Vec<(&'static str, &'static str, &'static str, &'static str)> {
    let levels: Vec<&str> = SimdLevel::all().into_iter().map(SimdLevel::name).collect();
    if !is_full() {
        let with_level = |(k, (boards, mode, threads))| (boards, mode, threads, levels[k % levels.len()]);
        return PAIRS.into_iter().enumerate().map(with_level).collect();
    }
    let modes = |boards| ["interleave", "region"].map(|mode| ["1", "2"].map(|threads| (boards, mode, threads)));
    let shares = BOARDS.into_iter().flat_map(modes).flatten();
    shares.flat_map(|(boards, mode, threads)| levels.iter().map(move |level| (boards, mode, threads, *level))).collect()
}

fn same(scene: &str, pose: &str, samples: &str, size: &str) {
    let draw = |boards: &str, mode: &str, threads: &str, level: &str| {
        let args = ["--pose", pose, "--samples", samples, "--size", size, "--mode", mode, "--simd", level];
        render(Path::new(scene), &[&args[..], &["--boards", boards, "--threads", threads]].concat())
    };
    let one = draw("1", "interleave", "1", SimdLevel::best().name());
    for (boards, mode, threads, level) in combinations() {
        let is_same = draw(boards, mode, threads, level) == one;
        assert!(is_same, "{scene}, pose {pose}: {boards} boards, {mode}, {threads} threads, {level}");
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

#[test]
fn debug_pictures_are_the_same_for_any_boards_modes_and_threads() {
    let folder = tempfile::tempdir().unwrap();
    let [towers, camera] = towers::write(folder.path());
    let camera = ["--camera", camera.to_str().unwrap()];
    let towers = towers.to_str().unwrap();
    let airport = ["--pose", "500"];
    for (scene, look, samples, debug) in [
        ("overdraw", &[][..], "1", "depth"),
        (towers, &camera[..], "4", "levels"),
        ("airport", &airport[..], "4", "skips"),
    ] {
        let draw = |more: &[&str]| {
            let args = ["--samples", samples, "--size", "240x135"];
            render(Path::new(scene), &[look, &args, more].concat())
        };
        let of = ["--debug", debug];
        let one = draw(&[&of[..], &["--threads", "1"]].concat());
        for (boards, mode, threads) in [("3", "interleave", "2"), ("5", "region", "1")] {
            let other = ["--boards", boards, "--mode", mode, "--threads", threads];
            let other = draw(&[&of[..], &other].concat());
            assert!(other == one, "{scene}, {debug}: {boards} boards, {mode}, {threads} threads");
        }
        assert!(one != draw(&[]), "{debug}: not the picture itself");
        if debug == "depth" {
            // Behind each other are thirty walls, before them boxes: the step of 17 to 32, or the next where there are more.
            let count = |faces| one.pixels().filter(|pixel| pixel.0 == proto::debug::depth_color(faces)).count();
            let (walls, more) = (count(30), count(33));
            assert!(walls + more == 240 * 135 && walls > 240 * 135 / 2, "{walls} and {more} pixels");
        }
        if debug == "levels" {
            // The sky is grey, a tower is blue or yellow.
            let is_tinted = |pixel: &&image::Rgb<u8>| pixel.0[0].abs_diff(pixel.0[2]) > 60;
            let tinted = one.pixels().filter(is_tinted).count();
            assert!(tinted > 1000, "{tinted} pixels are tinted");
        }
    }
}
