//! Displays with windows, on a desktop of their own: what is in the window is the picture.

use crate::program::{ANY_PORTS, Daemon, HANG, cyclorama, daemon, fly, manager, stats, wait_for};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// A desktop without a screen, whose pixels lie in a file.
struct Desktop {
    _server: Daemon,
    name: String,
    folder: tempfile::TempDir,
}

impl Desktop {
    fn start() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new("Xvfb");
        command
            .args(["-displayfd", "1", "-screen", "0", "640x480x24", "-nolisten", "tcp", "-fbdir"])
            .arg(folder.path());
        let Ok(mut child) = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn() else {
            println!("SKIPPED: no Xvfb here (Debian's package xvfb)");
            return None;
        };
        let mut number = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut number).unwrap();
        Some(Self { _server: Daemon::of(child), name: format!(":{}", number.trim()), folder })
    }

    /// The pixels of a part of the screen, RGB. The file is an X window dump: a header that says how long it is, colours, then rows.
    fn pixels(&self, [left, top]: [usize; 2], [width, height]: [usize; 2]) -> Vec<u8> {
        let dump = std::fs::read(self.folder.path().join("Xvfb_screen0")).unwrap();
        let word = |k: usize| u32::from_be_bytes(dump[4 * k..4 * k + 4].try_into().unwrap()) as usize;
        // header_size, …, bits_per_pixel (11), bytes_per_line (12), …, ncolors (19): X11/XWDFile.h.
        let (header, bits, line, colours) = (word(0), word(11), word(12), word(19));
        assert_eq!(bits, 32, "a pixel is a word");
        let start = header + 12 * colours;
        let row = |y: usize| {
            let at = start + (top + y) * line + left * 4;
            dump[at..at + width * 4].chunks_exact(4).flat_map(|bgrx| [bgrx[2], bgrx[1], bgrx[0]]).collect::<Vec<_>>()
        };
        (0..height).flat_map(row).collect()
    }
}

fn picture(folder: &Path) -> Vec<u8> {
    image::open(folder.join("frame-00000.png")).unwrap().into_rgb8().into_raw()
}

const SIZE: &str = "96x64";

#[test]
fn boards_are_displays_and_their_windows_show_the_views() {
    let Some(desktop) = Desktop::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    fly(folder.path(), &["city", "--views", "2", "--size", SIZE, "--samples", "1", "--frames", "1"]);
    let whole = picture(folder.path());
    let (_manager, [backplane, pose, console]) = manager(
        &[
            &ANY_PORTS[..],
            &[
                "--scene",
                "city",
                "--views",
                "2",
                "--size",
                SIZE,
                "--samples",
                "1",
                "--wait-for-compositor",
                "--wait-for-boards",
                "2",
                "--lock-step",
            ],
        ]
        .concat(),
    );
    let backplane = backplane.to_string();
    let boards = [("0", "10,20"), ("1", "206,120")].map(|(view, at)| {
        let mut board = cyclorama();
        board.env("DISPLAY", &desktop.name).args(["channel", "--backplane", &backplane, "--threads", "1"]);
        board.args(["--display", view, "--display-at", at]).stdout(Stdio::null()).stderr(Stdio::null());
        Daemon::of(board.spawn().unwrap())
    });
    // One pose, and no more.
    let camera = folder.path().join("camera.json");
    cyclorama().args(["scene", "city", "-o"]).arg(folder.path().join("city.glb")).output().unwrap();
    let poses: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("city.path.json")).unwrap()).unwrap();
    let first = poses.as_array().or_else(|| poses["poses"].as_array()).unwrap()[0].clone();
    std::fs::write(&camera, serde_json::to_vec(&vec![first]).unwrap()).unwrap();
    let _host =
        daemon(&["host", "play", camera.to_str().unwrap(), "--to", &pose.to_string(), "--lock-step", "--size", SIZE]);
    wait_for("the frame", || stats(console).filter(|stats| stats["frames"].as_u64() >= Some(1)));
    let part = |view: usize| {
        let row = |y: usize| whole[(y * 192 + view * 96) * 3..][..96 * 3].to_vec();
        (0..64).flat_map(row).collect::<Vec<_>>()
    };
    for (view, at) in [[10, 20], [206, 120]].into_iter().enumerate() {
        let wanted = part(view);
        wait_for("the picture in its window", || (desktop.pixels(at, [96, 64]) == wanted).then_some(()));
    }
    // Whoever is told to end takes its window along.
    for board in &boards {
        board.signal(rustix::process::Signal::TERM);
    }
    for mut board in boards {
        assert!(wait_for("its end", || board.ended()).success());
    }
    wait_for("no window", || desktop.pixels([0, 0], [640, 480]).iter().all(|byte| *byte == 0).then_some(()));
}

#[test]
fn without_a_desktop_it_is_said_that_there_is_none() {
    let started = std::time::Instant::now();
    let output = cyclorama().env_remove("DISPLAY").args(["compositor", "--window"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && said.contains("DISPLAY"), "{said}");
    let output = cyclorama().env("DISPLAY", ":4321").args(["compositor", "--window=x"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(started.elapsed() < HANG);
    let output = cyclorama().args(["compositor", "--window", "--format", "exr"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && said.contains("8-bit"), "{said}");
}
