//! Displays: compositors that show some of the views, beside the one that shows all or without it.

use crate::program::{ANY_PORTS, Rig, cyclorama, daemon, fly, kill, manager, stats, wait_for, whole_lines};
use proto::pose::PosePacket;
use proto::view::Pose;
use serde_json::Value;
use std::path::Path;

/// The lines of a manifest.
fn lines(path: &Path) -> Vec<Value> {
    whole_lines(path).iter().map(|line| serde_json::from_str(line).expect("a line of JSON")).collect()
}

/// Frames of a manifest of one view, as (frame, hashes of its tiles).
fn tiles(lines: &[Value], view: usize) -> Vec<(u64, Value)> {
    lines.iter().map(|line| (line["frame"].as_u64().unwrap(), line["views"][view]["tiles"].clone())).collect()
}

const FRAMES: usize = 12;

/// A rig of three views in lock-step whose parts are started one by one.
fn rig(folder: &Path, compositors: &[(&str, Option<&str>)], boards: usize) -> Vec<(String, Vec<Value>)> {
    let frames = FRAMES.to_string();
    let (_manager, [backplane, pose, console]) = manager(
        &[
            &ANY_PORTS[..],
            &[
                "--scene",
                "city",
                "--views",
                "3",
                "--size",
                "80x48",
                "--wait-for-boards",
                &boards.to_string(),
                "--wait-for-compositor",
                "--lock-step",
                "--frames",
                &frames,
            ],
        ]
        .concat(),
    );
    let backplane = backplane.to_string();
    let mut showing = Vec::new();
    for (name, views) in compositors {
        let path = folder.join(name);
        let mut args =
            vec!["compositor", "--supervised", "--backplane", &backplane, "--manifest", path.to_str().unwrap()];
        args.extend(views.iter().flat_map(|views| ["--views", views]));
        showing.push(cyclorama().args(args).stdin(std::process::Stdio::piped()).spawn().unwrap());
    }
    // Whoever comes after the first frame misses it.
    let connected = |stats: Value| stats["events"].to_string().matches("\"connected\"").count();
    wait_for("all compositors", || (stats(console).map(connected)? == compositors.len()).then_some(()));
    let _boards: Vec<_> =
        (0..boards).map(|_| daemon(&["channel", "--backplane", &backplane, "--threads", "1"])).collect();
    let _host = daemon(&["host", "play", "city", "--to", &pose.to_string(), "--lock-step", "--size", "80x48"]);
    for compositor in &mut showing {
        let status = wait_for("the end", || compositor.try_wait().unwrap());
        assert!(status.success(), "{status}");
    }
    compositors.iter().map(|(name, _)| ((*name).to_owned(), lines(&folder.join(name)))).collect()
}

#[test]
fn each_display_shows_its_views_as_the_whole_picture_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let compositors = [("whole", None), ("left", Some("0")), ("others", Some("2,1"))];
    let shown = rig(folder.path(), &compositors, 2);
    let [whole, left, others] = [0, 1, 2].map(|k| &shown[k].1);
    assert_eq!(whole.len(), FRAMES);
    assert_eq!((left[0]["views"].as_array().unwrap().len(), others[0]["views"].as_array().unwrap().len()), (1, 2));
    for (own, at, view) in [(left, 0, 0), (others, 0, 1), (others, 1, 2)] {
        assert_eq!(tiles(own, at), tiles(whole, view), "view {view}");
    }
    assert_ne!(tiles(whole, 0), tiles(whole, 1));

    let alone = rig(folder.path(), &[("a", Some("0,1")), ("b", Some("2"))], 3);
    for (own, at, view) in [(0, 0, 0), (0, 1, 1), (1, 0, 2)] {
        assert_eq!(tiles(&alone[own].1, at), tiles(whole, view), "view {view}, without a compositor for all");
    }
}

/// What displays of two views write of a rig's first frame, each with its further arguments.
fn pictures(folder: &Path, more: [&[&str]; 2]) -> [image::RgbImage; 2] {
    let rig = ["--scene", "city", "--views", "2", "--size", "80x48", "--samples", "1", "--frames", "1"];
    let (_manager, [backplane, pose, _]) =
        manager(&[&ANY_PORTS[..], &rig, &["--wait-for-compositor", "--lock-step"]].concat());
    let backplane = backplane.to_string();
    let displays = [0, 1].map(|view| {
        let mut display = cyclorama();
        display.args(["compositor", "--supervised", "--backplane", &backplane, "--views", &view.to_string()]);
        display.args(more[view]).arg("--out").arg(folder.join(view.to_string()));
        display.stdin(std::process::Stdio::piped()).spawn().unwrap()
    });
    let _board = daemon(&["channel", "--backplane", &backplane, "--threads", "1"]);
    let _host = daemon(&["host", "play", "city", "--to", &pose.to_string(), "--lock-step", "--size", "80x48"]);
    for mut display in displays {
        let status = wait_for("the end", || display.try_wait().unwrap());
        assert!(status.success(), "{status}");
    }
    [0, 1].map(|view| first_picture(&folder.join(view.to_string())))
}

fn first_picture(folder: &Path) -> image::RgbImage {
    image::open(folder.join("frame-00000.png")).unwrap().into_rgb8()
}

#[test]
fn a_display_writes_its_part_of_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    fly(&whole, &["city", "--views", "2", "--size", "80x48", "--frames", "1", "--samples", "1"]);
    let whole = first_picture(&whole);
    let part = |view: usize| image::imageops::crop_imm(&whole, 80 * view as u32, 0, 80, 48).to_image();
    let own = pictures(&folder.path().join("own"), [&[], &[]]);
    for (view, picture) in own.iter().enumerate() {
        assert_eq!(picture.dimensions(), (80, 48));
        assert!(part(view) == *picture, "view {view}");
    }
    let [picture, pattern] = pictures(&folder.path().join("pattern"), [&[], &["--pattern"]]);
    assert!(part(0) == picture, "the other display's pattern is its own");
    let (is_white, (width, height)) = (|x, y| pattern.get_pixel(x, y).0 == [255; 3], pattern.dimensions());
    assert_eq!((width, height), (80, 48));
    assert!((0..width).all(|x| is_white(x, 0) && is_white(x, height - 1)), "its border");
    assert!((0..height).all(|y| is_white(0, y) && is_white(width - 1, y)), "its border");
    assert!((1..width - 1).any(|x| !is_white(x, height / 2)), "and not white alone");
    let output = cyclorama().args(["compositor", "--pattern", "--format", "exr"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && said.contains("8-bit"), "{said}");
}

/// chain.md, "compositor crash, hang, restart": the others go on.
#[test]
fn a_display_that_is_killed_holds_up_neither_the_others_nor_the_boards() {
    let folder = tempfile::tempdir().unwrap();
    let (_manager, [backplane, pose, console]) = manager(
        &[&ANY_PORTS[..], &["--scene", "city", "--views", "2", "--size", "80x48", "--samples", "1", "--rate", "20"]]
            .concat(),
    );
    let backplane = backplane.to_string();
    let [left, right] = ["0", "1"].map(|view| {
        let path = folder.path().join(view);
        daemon(&["compositor", "--backplane", &backplane, "--views", view, "--manifest", path.to_str().unwrap()])
    });
    let _board = daemon(&["channel", "--backplane", &backplane, "--threads", "1"]);
    let _host =
        daemon(&["host", "play", "city", "--to", &pose.to_string(), "--repeat", "--rate", "20", "--size", "80x48"]);
    let count = |path: &str| stats(console).and_then(|stats| stats[path].as_u64()).unwrap_or(0);
    wait_for("both displays show the same frames", || (count("same_frame_swaps") > 5).then_some(()));
    kill(left.id());
    let shown = || lines(&folder.path().join("1")).len();
    let (before, frames) = (shown(), count("frames"));
    wait_for("the other one goes on", || (shown() > before + 20 && count("frames") > frames + 20).then_some(()));
    let again = daemon(&["compositor", "--backplane", &backplane, "--views", "0"]);
    let same = count("same_frame_swaps");
    wait_for("it is back", || (count("same_frame_swaps") > same + 5).then_some(()));
    drop((again, right));
}

#[test]
fn a_display_of_a_view_that_there_is_not_and_a_second_compositor_are_told_why() {
    let rig = Rig::start(&["city", "--size", "80x48", "--boards", "1", "--views", "2"]);
    rig.wait("frames", |stats| stats["frames"].as_u64() > Some(3));
    let args = std::fs::read(format!("/proc/{}/cmdline", rig.children(&["compositor"])[0])).unwrap();
    let args = String::from_utf8(args).unwrap();
    let backplane = args.split('\0').skip_while(|arg| *arg != "--backplane").nth(1).unwrap();
    for (more, why) in [(&["--views", "2"][..], "there is no view 2"), (&[], "has a compositor already")] {
        let output = cyclorama().args(["compositor", "--backplane", backplane]).args(more).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && said.contains(why), "{said}");
    }
    let display = daemon(&["compositor", "--backplane", backplane, "--views", "1"]);
    rig.wait("both show the same frames", |stats| stats["same_frame_swaps"].as_u64() > Some(5));
    drop(display);
}

/// A host that doesn't wait for answers: each pose has its frame all the same, also when a display comes while one is drawn.
#[test]
fn in_lock_step_every_pose_of_a_burst_has_a_frame_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let (_manager, [backplane, pose, console]) = manager(
        &[
            &ANY_PORTS[..],
            &[
                "--scene",
                "city",
                "--views",
                "1",
                "--size",
                "80x48",
                "--wait-for-compositor",
                "--lock-step",
                "--frames",
                "9",
            ],
        ]
        .concat(),
    );
    let backplane = backplane.to_string();
    let path = folder.path().join("whole");
    let mut compositor = cyclorama();
    compositor.args(["compositor", "--supervised", "--backplane", &backplane, "--manifest", path.to_str().unwrap()]);
    let mut compositor = compositor.stdin(std::process::Stdio::piped()).spawn().unwrap();
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    for sequence in 1..=9u32 {
        let position = glam::DVec3::new(0.0, 50.0 + f64::from(sequence), 0.0);
        let eye = Pose { position, orientation: glam::DQuat::IDENTITY };
        let (entities, models) = (Vec::new(), Vec::new());
        let packet = PosePacket { sequence, answer: false, eye, lens: None, entities, models };
        socket.send_to(&packet.encode(), pose).unwrap();
    }
    let joined = |stats: Value| stats["events"].to_string().contains("display of view 0").then_some(());
    let display = daemon(&["compositor", "--backplane", &backplane, "--views", "0"]);
    wait_for("the display", || stats(console).and_then(joined));
    let _board = daemon(&["channel", "--backplane", &backplane, "--threads", "1"]);
    assert!(wait_for("the end", || compositor.try_wait().unwrap()).success());
    let heights: Vec<_> = lines(&path).iter().map(|line| line["eye"]["position"][1].as_f64().unwrap()).collect();
    assert_eq!(heights, (51..=59).map(f64::from).collect::<Vec<_>>());
    drop(display);
}
