//! Selecting for the next frame while boards draw: what is shown is the same, whenever it was selected.

use crate::program::{cyclorama, daemon, fly, manager, stats, wait_for, whole_lines};
use bench::disturbed::Undisturbed;
use std::fs::File;
use std::io::{BufReader, Cursor};

const SIZE: &str = "96x64";

#[test]
fn frames_that_are_selected_ahead_show_what_their_poses_show() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    // Some poses of the scene's own path.
    assert!(cyclorama().args(["scene", "city", "-o", &at("city.glb")]).status().unwrap().success());
    let poses: Vec<serde_json::Value> = serde_json::from_slice(&std::fs::read(at("city.path.json")).unwrap()).unwrap();
    let some: Vec<_> = poses
        .into_iter()
        .take(60)
        .map(|mut pose| {
            pose.as_object_mut().unwrap().remove("t");
            pose
        })
        .collect();
    std::fs::write(at("camera.json"), serde_json::to_vec(&some).unwrap()).unwrap();
    let camera = at("camera.json");
    let of_path = ["--views", "2", "--size", SIZE, "--samples", "1", "--camera", &camera];
    fly(folder.path(), &[&["city", "--frames", "60", "--manifest", &at("undisturbed")][..], &of_path].concat());
    let undisturbed = Undisturbed::read(BufReader::new(File::open(at("undisturbed")).unwrap())).unwrap();

    let (_manager, [backplane, pose, console]) = manager(
        &[
            &[
                "--listen",
                "127.0.0.1:0",
                "--pose-listen",
                "127.0.0.1:0",
                "--console",
                "127.0.0.1:0",
                "--scene",
                "city",
                "--rate",
                "30",
            ][..],
            &["--select-ahead", "always", "--wait-for-compositor", "--wait-for-boards", "2"],
            &of_path,
        ]
        .concat(),
    );
    let backplane = backplane.to_string();
    let shown = at("shown");
    let _compositor = daemon(&["compositor", "--backplane", &backplane, "--manifest", &shown]);
    let _boards = [0, 1].map(|_| daemon(&["channel", "--backplane", &backplane, "--threads", "1"]));
    let _host =
        daemon(&["host", "play", &camera, "--to", &pose.to_string(), "--repeat", "--rate", "30", "--size", SIZE]);
    let count = |name: &str| stats(console).and_then(|stats| stats[name].as_u64()).unwrap_or(0);
    wait_for("frames selected ahead", || (count("frames_ahead") > 40).then_some(()));
    // Frames before the host's first pose are of the manager's own.
    let lines = &whole_lines(shown.as_ref())[10..];
    let compared = undisturbed.compare(Cursor::new(lines.concat())).unwrap();
    assert_eq!((compared.wrong, compared.unknown, compared.backwards), (0, 0, 0), "{compared:?}");
    assert!(compared.right > 30, "{compared:?}");
    let frames: Vec<_> =
        lines.iter().map(|line| line.split("\"eye\"").nth(1).map(|rest| rest[..80].to_owned())).collect();
    assert!(frames.windows(2).filter(|pair| pair[0] != pair[1]).count() > 10, "the eye moves");
}
