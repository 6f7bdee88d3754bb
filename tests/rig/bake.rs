//! Baked files through the real program: the same pictures, and no half file whatever happens to a bake.

use crate::program::{cyclorama, files, fly, run, wait_for};
use std::path::Path;

#[track_caller]
fn succeeds(args: &[&str]) -> String {
    let output = run(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn named(folder: &Path, name: &str) -> String {
    folder.join(name).display().to_string()
}

#[test]
fn a_baked_scene_is_drawn_flown_and_inspected_as_what_it_was_made_from() {
    let folder = tempfile::tempdir().unwrap();
    // The ending says nothing: the file is known by its content.
    let baked = named(folder.path(), "airport.glb");
    let line = succeeds(&["bake", "airport", "-o", &baked]);
    assert!(line.contains("triangles") && line.contains("airport.path.json"), "{line}");
    let draw = |scene: &str, name: &str| {
        let picture = named(folder.path(), name);
        succeeds(&["render", scene, "--pose", "600", "--size", "320x180", "--samples", "4", "-o", &picture]);
        std::fs::read(picture).unwrap()
    };
    assert!(draw("airport", "a.png") == draw(&baked, "b.png"), "the picture is the same to the byte");

    let flown = |scene: &str| {
        let out = tempfile::tempdir().unwrap();
        let flight = ["--frames", "3", "--views", "2", "--size", "96x54", "--samples", "1", "--boards", "2"];
        fly(out.path(), &[&[scene][..], &flight].concat());
        files(out.path())
    };
    assert!(flown("airport") == flown(&baked), "and so is a rig's");

    let inspect = |args: &[&str]| -> serde_json::Value {
        serde_json::from_str(&succeeds(&[&["inspect", "--json"], args].concat())).unwrap()
    };
    let (plain, ours) = (inspect(&["airport"]), inspect(&[&baked, "--check"]));
    assert_eq!(plain["counts"], ours["counts"]);
    assert_eq!((&plain["baked"], &ours["baked"]["format"]), (&serde_json::Value::Null, &1.into()));
    assert!(succeeds(&["inspect", &baked]).contains("baked file, format version 1"));
}

#[test]
fn a_damaged_baked_file_is_named_with_its_section() {
    let folder = tempfile::tempdir().unwrap();
    let baked = named(folder.path(), "runway.baked");
    succeeds(&["bake", "runway", "-o", &baked]);
    let good = std::fs::read(&baked).unwrap();
    let fails = |bytes: &[u8], args: &[&str]| {
        std::fs::write(&baked, bytes).unwrap();
        let output = run(args);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!((output.status.code(), error.trim_end().lines().count()), (Some(1), 1), "{error}");
        assert!(error.starts_with("cyclorama: ") && error.contains("runway.baked: "), "{error}");
        error
    };
    let flipped = |at: usize| {
        let mut bytes = good.clone();
        bytes[at] ^= 4;
        bytes
    };
    assert!(fails(&good[..good.len() / 2], &["inspect", &baked]).contains("bytes long"));
    assert!(fails(&flipped(70), &["inspect", &baked]).contains("header and index"));
    assert!(fails(&flipped(64 + 17 * 64 + 5), &["inspect", &baked]).contains("section nodes: damaged"));
    let last_mesh = good.len() - 300;
    let picture = named(folder.path(), "x.png");
    let draw = ["render", &baked, "--size", "64x64", "-o", &picture];
    assert!(fails(&flipped(last_mesh), &draw).contains("section"), "no picture from a damaged mesh");
    assert!(!Path::new(&picture).exists());
    assert!(fails(&good, &["bake", &baked, "-o", &picture]).contains("is baked already"));
}

#[test]
fn a_bake_that_is_killed_leaves_the_old_file_whole() {
    let folder = tempfile::tempdir().unwrap();
    let baked = named(folder.path(), "scene.baked");
    succeeds(&["bake", "runway", "-o", &baked]);
    let before = std::fs::read(&baked).unwrap();
    let part = folder.path().join("scene.baked.part");
    let mut child = cyclorama().args(["bake", "airport", "-o", &baked]).spawn().unwrap();
    let ended = wait_for("the new file, or the end", || {
        if part.exists() { Some(false) } else { child.try_wait().unwrap().map(|_| true) }
    });
    child.kill().unwrap();
    child.wait().unwrap();
    // Writing takes milliseconds: the kill may have come too late, and then the new file is whole.
    if ended || !part.exists() {
        succeeds(&["inspect", &baked, "--check"]);
    } else {
        assert!(std::fs::read(&baked).unwrap() == before, "the old file is as it was");
    }
    succeeds(&["bake", "airport", "-o", &baked]);
    assert!(!part.exists() && std::fs::read(&baked).unwrap() != before);
    succeeds(&["inspect", &baked, "--check"]);
}
