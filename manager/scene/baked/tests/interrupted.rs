//! A bake that is killed, stopped or fails: what was there before is there still, and nothing half-written has its name.

use super::*;
use crate::scene::baked::{open, part_of, write};
use std::ops::ControlFlow;
use std::path::Path;
use std::process::{Command, Stdio};

/// Set for the child of [`kill_9_leaves_the_old_file_whole`]: the file to bake to.
const TARGET: &str = "CYCLORAMA_TEST_BAKE_TARGET";

fn written(parts: &Parts, path: &Path) {
    let scene = Scene::assemble(parts.clone()).unwrap();
    write(parts, &scene, path, &mut |_| ControlFlow::Continue(())).unwrap();
}

/// Bakes until it is killed: not a test by itself.
#[test]
fn bakes_for_its_parent() {
    let Some(target) = std::env::var_os(TARGET) else { return };
    let parts = small();
    let scene = Scene::assemble(parts.clone()).unwrap();
    let mut is_first = true;
    let mut watch = |_| {
        if std::mem::take(&mut is_first) {
            // In the middle of writing: what is in memory reaches the file, then the parent hears of it and kills us.
            println!("writing");
            std::thread::sleep(std::time::Duration::from_secs(600));
        }
        ControlFlow::Continue(())
    };
    write(&parts, &scene, target.as_ref(), &mut watch).unwrap();
}

#[test]
fn kill_9_leaves_the_old_file_whole() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("city.baked");
    let old = Parts { name: "old".into(), ..small() };
    written(&old, &target);
    let before = std::fs::read(&target).unwrap();

    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "scene::baked::tests::interrupted::bakes_for_its_parent", "--nocapture"])
        .env(TARGET, &target)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = std::io::BufRead::lines(std::io::BufReader::new(child.stdout.take().unwrap()));
    let found = lines.map_while(Result::ok).find(|line| line.ends_with("writing"));
    assert!(found.is_some(), "the child writes");
    let part = part_of(&target);
    assert!(part.exists(), "the new file is under way beside the old one");
    assert!(matches!(begun_by_another(&target), BakedFault::Busy), "and locked");
    child.kill().unwrap();
    child.wait().unwrap();

    assert!(std::fs::read(&target).unwrap() == before, "the old file is as it was");
    assert_eq!(open(&target).unwrap().name, "old");
    assert!(part.exists(), "what was killed left its part, by its name");
    written(&small(), &target);
    assert_eq!(open(&target).unwrap().name, "small");
    assert!(!part.exists(), "the next bake took it over");
}

fn begun_by_another(target: &Path) -> BakedFault {
    let parts = small();
    let scene = Scene::assemble(parts.clone()).unwrap();
    *write(&parts, &scene, target, &mut |_| ControlFlow::Continue(())).unwrap_err().fault
}

#[test]
fn a_bake_that_is_stopped_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("city.baked");
    let parts = small();
    let scene = Scene::assemble(parts.clone()).unwrap();
    let error = write(&parts, &scene, &target, &mut |_| ControlFlow::Break(())).unwrap_err();
    assert!(error.to_string().contains("interrupted"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_place_that_cannot_be_written_is_named() {
    let parts = Parts::default();
    let scene = Scene::assemble(parts.clone()).unwrap();
    let error = write(&parts, &scene, "/no/such/folder/x.baked".as_ref(), &mut |_| ControlFlow::Continue(()));
    let error = error.unwrap_err();
    assert!(error.to_string().starts_with("/no/such/folder/x.baked: cannot be written"), "{error}");
    assert!(std::error::Error::source(&error).is_some(), "and why");
}
