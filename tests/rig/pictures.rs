//! The stitched pictures don't depend on how many boards drew them, nor on who died meanwhile.

use crate::program::{files, fly, is_alive, wait_for};
use rustix::process::Signal;
use std::process::Stdio;

const FLIGHT: [&str; 8] = ["--frames", "12", "--views", "3", "--size", "160x90", "--samples", "4"];

fn flown(boards: &str, mode: &str) -> std::collections::BTreeMap<String, Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let args = [&FLIGHT[..], &["--boards", boards, "--mode", mode]].concat();
    let stats = fly(folder.path(), &args);
    assert_eq!(stats["frames"], 12, "every frame once");
    assert_eq!(stats["late_frames"], 0, "lock-step has no deadline");
    assert_eq!(stats["boards"].to_string(), boards, "all were there");
    files(folder.path())
}

#[test]
fn one_two_three_and_five_boards_write_the_same_bytes() {
    let one = flown("1", "interleave");
    assert_eq!(one.len(), 12);
    assert!(one.contains_key("frame-00000.png") && one.contains_key("frame-00011.png"));
    let picture = image::load_from_memory(&one["frame-00000.png"]).unwrap();
    assert_eq!((picture.width(), picture.height()), (3 * 160, 90));
    assert_ne!(one["frame-00000.png"], one["frame-00011.png"], "the picture moves");
    for (boards, mode) in
        [("2", "interleave"), ("3", "region"), ("3", "interleave"), ("5", "interleave"), ("5", "region")]
    {
        assert_eq!(flown(boards, mode), one, "{boards} boards, {mode}");
    }
}

#[test]
fn one_and_three_boards_write_the_same_manifest() {
    let folder = tempfile::tempdir().unwrap();
    let [one, three] = ["1", "3"].map(|boards| {
        let path = folder.path().join(boards);
        let args = [
            &["rig", "--console", "off", "--boards", boards, "--manifest"][..],
            &[path.to_str().unwrap()],
            &FLIGHT[..],
        ];
        let output = crate::program::run(&args.concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        std::fs::read_to_string(path).unwrap()
    });
    assert_eq!(one, three);
    let lines: Vec<serde_json::Value> = one.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(
        lines.iter().map(|line| line["frame"].as_u64()).collect::<Vec<_>>(),
        (0..12).map(Some).collect::<Vec<_>>()
    );
    assert_ne!(lines[0]["eye"], lines[11]["eye"], "the eye moves");
    assert_ne!(lines[0]["views"][0]["tiles"], lines[11]["views"][0]["tiles"], "and so does the picture");
}

/// Flies in lock-step while boards go, each `(after this picture, by this signal)`; the pictures must be those of an undisturbed flight.
fn disturbed(boards: &str, departures: &[(usize, Signal)]) {
    let args = ["--frames", "60", "--views", "2", "--size", "160x90", "--samples", "1", "--boards", boards];
    let undisturbed = tempfile::tempdir().unwrap();
    fly(undisturbed.path(), &args);

    let folder = tempfile::tempdir().unwrap();
    let mut rig = crate::program::cyclorama()
        .args(["rig", "--json", "--console", "off", "--out"])
        .arg(folder.path())
        .args(args)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let own = rig.id();
    for (picture, signal) in departures {
        let file = folder.path().join(format!("frame-{picture:05}.png"));
        wait_for("a picture", || file.exists().then_some(()));
        let board = wait_for("a board", || {
            let text = std::fs::read_to_string(format!("/proc/{own}/task/{own}/children")).ok()?;
            let is_board = |pid: &u32| {
                let command = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
                command.contains("\0channel\0") && is_alive(*pid)
            };
            text.split_whitespace().filter_map(|pid| pid.parse().ok()).find(is_board)
        });
        let pid = rustix::process::Pid::from_raw(board as i32).unwrap();
        rustix::process::kill_process(pid, *signal).unwrap();
        wait_for("its end", || (!is_alive(board)).then_some(()));
    }
    let mut output = String::new();
    std::io::Read::read_to_string(rig.stdout.as_mut().unwrap(), &mut output).unwrap();
    assert!(rig.wait().unwrap().success(), "{output}");
    let stats: serde_json::Value = serde_json::from_str(&output).unwrap();
    let left = boards.parse::<usize>().unwrap() - departures.len();
    assert_eq!(stats["boards"], left, "so many are left: {output}");
    assert_eq!(files(folder.path()), files(undisturbed.path()), "{departures:?}");
}

#[test]
fn a_board_killed_in_mid_flight_changes_no_written_picture() {
    disturbed("3", &[(5, Signal::KILL)]);
}

#[test]
fn boards_that_are_killed_and_asked_to_go_one_after_the_other_change_no_written_picture() {
    disturbed("5", &[(3, Signal::KILL), (12, Signal::TERM), (20, Signal::KILL), (30, Signal::TERM)]);
}

#[test]
fn linear_frames_and_bare_pixels_are_written_too() {
    let args = ["--frames", "2", "--views", "2", "--size", "96x64", "--samples", "4", "--boards", "2"];
    let folder = tempfile::tempdir().unwrap();
    let out = |kind: &str| {
        let out = folder.path().join(kind);
        fly(&out, &[&args[..], &["--format", kind]].concat());
        files(&out)
    };
    let (png, exr, raw) = (out("png"), out("exr"), out("rgb"));
    let decoded = image::load_from_memory(&png["frame-00001.png"]).unwrap().into_rgb8();
    assert_eq!(decoded.as_raw(), &raw["frame-00001.rgb"], "the same pixels");
    let format = image::ImageFormat::OpenExr;
    let linear = image::load_from_memory_with_format(&exr["frame-00001.exr"], format).unwrap().into_rgb32f();
    // A screen value of 128 is 0.216 of full light, and so on: the two must be one picture.
    for (shown, light) in decoded.as_raw().iter().zip(linear.as_raw()) {
        let c = f64::from(light.clamp(0.0, 1.0));
        let encoded = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
        assert!((encoded * 255.0 - f64::from(*shown)).abs() < 0.51, "{shown} of {light}");
    }
}
