//! `cyclorama bench wire`: what travels between the processes of a rig on loopback, and what a still scene costs.
//!
//! Two rigs, one after the other. In *flight* every pose is a frame and nothing is skipped, so that the bytes don't depend on the
//! machine; in a *still* one the host sends one pose at 60 Hz, and boards' bytes and processor time are read at the beginning and the end of
//! some seconds, from the rig's own statistics and from the system.

use crate::cli::WireArgs;
use crate::error::CommandError;
use crate::output::{note, say};
use crate::source;
use ::bench::wire::{Flight, Process, Row, Still, figures};
use ::bench::{Report, Spread};
use manager::host::camera::CameraFile;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A rig that shows nothing after this long doesn't work.
const START_TIMEOUT: Duration = Duration::from_secs(120);
/// After the first frames, until boards hold everything and frames have stopped.
const SETTLE: Duration = Duration::from_secs(3);

/// Runs the command.
pub(crate) fn wire(args: &WireArgs) -> Result<(), CommandError> {
    let camera = source::load(&args.scene, None)?.camera;
    note("flight …");
    let flight = flight(args)?;
    note(&format!("still, {} s …", args.seconds));
    let still = still(args, &camera)?;
    let row = Row {
        scene: args.scene.clone(),
        views: args.views.get(),
        boards: args.boards.get(),
        size: [args.size.0, args.size.1],
        flight,
        still,
    };
    let figures = figures(&row);
    let shown = row.to_string();
    if args.json {
        say(&serde_json::to_string(&Report::new("wire", vec![row], figures)).map_err(said)?);
    } else {
        say(shown.trim_end());
        figures.iter().for_each(|figure| say(&figure.to_string()));
    }
    Ok(())
}

fn said(error: impl std::fmt::Display) -> CommandError {
    CommandError::said(error.to_string())
}

fn rig(args: &WireArgs) -> Result<Command, CommandError> {
    let mut rig = Command::new(std::env::current_exe().map_err(said)?);
    rig.args(["rig", &args.scene, "--samples", "1", "--json"]);
    rig.args(["--views", &args.views.to_string(), "--boards", &args.boards.to_string()]);
    rig.args(["--size", &format!("{}x{}", args.size.0, args.size.1)]);
    rig.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    Ok(rig)
}

/// Flies the path, one frame for each pose.
fn flight(args: &WireArgs) -> Result<Flight, CommandError> {
    let folder = tempfile::tempdir().map_err(said)?;
    let mut rig = rig(args)?;
    rig.args(["--console", "off", "--format", "rgb", "--frames", &args.frames.to_string(), "--out"]).arg(folder.path());
    let output = rig.output().map_err(said)?;
    if !output.status.success() {
        return Err(CommandError::said(String::from_utf8_lossy(&output.stderr).trim().to_owned()));
    }
    let report: Value = serde_json::from_slice(&output.stdout).map_err(said)?;
    let number = |path: &str| report.pointer(path).and_then(Value::as_f64);
    let lacks = || CommandError::said("the rig's statistics lack what is measured");
    let frames = number("/frames").ok_or_else(lacks)?;
    let all = number("/bytes_to_boards_per_frame").ok_or_else(lacks)?;
    Ok(Flight { frames: frames as u64, bytes_per_frame: all / args.boards.get() as f64 })
}

/// A rig that is ended when dropped, with where its console is.
struct Running {
    child: Child,
    console: SocketAddr,
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself; its children end with it.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Running {
    fn start(mut rig: Command) -> Result<Self, CommandError> {
        let mut child = rig.spawn().map_err(said)?;
        let stderr = child.stderr.take().ok_or_else(|| CommandError::said("the rig has no stderr"))?;
        let mut lines = BufReader::new(stderr).lines().map_while(Result::ok);
        let console = lines.find_map(|line| line.strip_prefix("console: http://")?.strip_suffix('/')?.parse().ok());
        // Keeps the pipe open and empty.
        std::thread::spawn(move || lines.for_each(drop));
        let Some(console) = console else {
            // Not yet wrapped, so ended here.
            let _ = child.kill();
            let _ = child.wait();
            return Err(CommandError::said("the rig has no console, which this benchmark asks"));
        };
        Ok(Self { child, console })
    }

    fn stats(&self) -> Option<Value> {
        let mut stream = TcpStream::connect(self.console).ok()?;
        stream.set_read_timeout(Some(START_TIMEOUT)).ok()?;
        write!(stream, "GET /api/v1/stats HTTP/1.1\r\nHost: rig\r\nConnection: close\r\n\r\n").ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        serde_json::from_str(answer.split_once("\r\n\r\n")?.1).ok()
    }

    /// Its processes, by the command that each was started with.
    fn processes(&self) -> Vec<(String, u32)> {
        let own = self.child.id();
        let children = std::fs::read_to_string(format!("/proc/{own}/task/{own}/children")).unwrap_or_default();
        let command = |pid: u32| {
            let line = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            Some((line.split('\0').nth(1)?.to_owned(), pid))
        };
        children.split_whitespace().filter_map(|pid| command(pid.parse().ok()?)).collect()
    }
}

/// Processor time that a process has used, ns: what the scheduler has counted of all of its threads.
fn processor_ns(pid: u32) -> Option<u64> {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).ok()?;
    let of = |path: std::path::PathBuf| {
        std::fs::read_to_string(path.join("schedstat")).ok()?.split_whitespace().next()?.parse::<u64>().ok()
    };
    threads.map(|thread| thread.ok().and_then(|thread| of(thread.path()))).sum()
}

/// The resident set of a process, MiB.
fn memory_mib(pid: u32) -> Option<f64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let kib = status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.trim().strip_suffix(" kB"))?;
    Some(kib.parse::<f64>().ok()? / 1024.0)
}

/// Watches a rig to which nothing happens.
fn still(args: &WireArgs, camera: &CameraFile) -> Result<Still, CommandError> {
    let folder = tempfile::tempdir().map_err(said)?;
    let path = folder.path().join("still.json");
    let pose = camera.poses.first().ok_or_else(|| CommandError::said("the camera has no pose"))?;
    let text = serde_json::to_string(&[pose]).map_err(said)?;
    std::fs::write(&path, text).map_err(|error| CommandError::file(&path, error))?;
    let mut rig = rig(args)?;
    rig.args(["--console", "127.0.0.1:0", "--camera"]).arg(&path);
    let rig = Running::start(rig)?;
    let begun = Instant::now();
    let count = |stats: &Value, path: &str| stats.pointer(path).and_then(Value::as_u64);
    let is_running = |stats: &Value| {
        count(stats, "/boards") == Some(args.boards.get() as u64)
            && count(stats, "/frames").is_some_and(|frames| frames > 60)
    };
    while !rig.stats().is_some_and(|stats| is_running(&stats)) {
        if begun.elapsed() > START_TIMEOUT {
            return Err(CommandError::said("the rig shows nothing"));
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    std::thread::sleep(SETTLE);
    let gone = || CommandError::said("the rig ended while it was watched");
    let processes = rig.processes();
    let used = || processes.iter().map(|(_, pid)| processor_ns(*pid)).collect::<Option<Vec<u64>>>();
    let (before, used_before, from) = (rig.stats().ok_or_else(gone)?, used().ok_or_else(gone)?, Instant::now());
    std::thread::sleep(Duration::from_secs_f64(args.seconds));
    let (after, used_after, seconds) = (rig.stats().ok_or_else(gone)?, used().ok_or_else(gone)?, from.elapsed());
    let seconds = seconds.as_secs_f64();
    let per_second = |path: &str| {
        let bytes = count(&after, path)?.checked_sub(count(&before, path)?)?;
        Some(bytes as f64 / seconds / args.boards.get() as f64)
    };
    let percent = used_before.iter().zip(&used_after).map(|(a, b)| b.saturating_sub(*a) as f64 / 1e7 / seconds);
    let of = |((what, pid), cpu_percent): (&(String, u32), f64)| {
        Some(Process { what: what.clone(), cpu_percent, memory_mib: memory_mib(*pid)? })
    };
    let processes = processes.iter().zip(percent).map(of).collect::<Option<Vec<_>>>().ok_or_else(gone)?;
    let boards = processes.iter().filter(|process| process.what == "channel");
    let percent: Vec<f64> = boards.map(|board| board.cpu_percent).collect();
    if percent.is_empty() {
        return Err(CommandError::said("the rig's boards are not found; this benchmark needs /proc"));
    }
    Ok(Still {
        seconds,
        cpu_percent: Spread::of(&percent),
        processes,
        bytes_to_board_per_s: per_second("/link_bytes/to_boards").ok_or_else(gone)?,
        bytes_from_board_per_s: per_second("/link_bytes/from_boards").ok_or_else(gone)?,
        tile_bytes_per_s: per_second("/link_bytes/tiles").ok_or_else(gone)?,
    })
}
