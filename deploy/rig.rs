//! `cyclorama rig`: manager, compositor, boards and host as processes on this machine.
//!
//! Children report on stdout and end when their stdin does, so none is left behind, however the rig itself ends. A board
//! that dies is reported and the rig goes on; the manager's end is the rig's end.

use crate::cli::{Console, ModeArg, RigArgs, Supervision};
use crate::error::CommandError;
use crate::keys::Authority;
use crate::output::{note, say};
use crate::serve::{ManagerLine, machine_memory, processors, runtime, shutdown_token};
use crate::{rig_file, settings, source};
use indicatif::{ProgressBar, ProgressStyle};
use link::NodeRole;
use std::io::IsTerminal;
use std::net::SocketAddr;
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::time::{Duration, Instant};
use tokio::io::{AsyncBufReadExt, BufReader, Lines};
use tokio::process::{ChildStdin, ChildStdout, Command};
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

/// After its stdin has ended, a child that isn't gone by then is killed.
const END_TIMEOUT: Duration = Duration::from_millis(900);
/// The compositor gets longer when it still has pictures to write.
const WRITE_TIMEOUT: Duration = Duration::from_secs(60);
/// How often progress is said where there is no terminal.
const PROGRESS_PERIOD: Duration = Duration::from_secs(5);

/// Runs the command.
pub(crate) fn run(args: &RigArgs) -> Result<(), CommandError> {
    let source = source::load(&args.scene, args.camera.as_deref())?;
    let poses = source.camera.poses.len() as u64;
    let folder = tempfile::tempdir().map_err(|error| CommandError::said(format!("no temporary folder: {error}")))?;
    let camera = source.camera_file(folder.path())?;
    drop(source);
    // With pictures to write, the flight is flown once unless a number says otherwise.
    let frames = args.frames.or(is_writing(args).then_some(poses));
    runtime(1)?.block_on(async {
        let mut rig = Rig::start(args, folder.path(), &camera, frames).await?;
        let outcome = rig.watch(frames).await;
        rig.end().await;
        if let Some(report) = outcome? {
            if let Some(warning) = substituted(&report) {
                note(&warning);
            }
            if args.json {
                say(&report.to_string());
            } else {
                note(&summary(&report));
            }
        }
        Ok(())
    })
}

/// Whether every frame is to be kept, so that none may be skipped.
fn is_writing(args: &RigArgs) -> bool {
    args.out.is_some() || args.manifest.is_some()
}

/// What to say if frames didn't show all that they should.
fn substituted(report: &serde_json::Value) -> Option<String> {
    let count = |name: &str| report.pointer(&format!("/streaming/{name}")).and_then(serde_json::Value::as_u64);
    let frames = count("frames_substituted").filter(|frames| *frames > 0)?;
    let (omitted, models) = (count("omitted")?, count("substitutions")?);
    Some(format!(
        "warning: {frames} frames don't show all that they should: boards lacked {omitted} subobjects, and {models} models showed other \
         versions; give boards more memory (--memory-limit) if this is not what you want"
    ))
}

fn summary(report: &serde_json::Value) -> String {
    let number = |path: &str| report.pointer(path).and_then(serde_json::Value::as_f64).unwrap_or(0.0);
    format!(
        "{} frames in {:.1} s, {} late; frame {:.1} ms, latency {:.1} ms (medians); {:.1} kB to and {:.2} MB from boards a frame",
        number("/frames"),
        number("/seconds"),
        number("/late_frames"),
        number("/frame_ms/p50"),
        number("/latency_ms/p50"),
        number("/bytes_to_boards_per_frame") / 1e3,
        number("/bytes_from_boards_per_frame") / 1e6,
    )
}

/// One process of the rig.
struct Spawned {
    name: String,
    stdin: Option<ChildStdin>,
    kill: CancellationToken,
}

struct Rig {
    manager: Lines<BufReader<ChildStdout>>,
    children: Vec<Spawned>,
    /// Index of the child and how it ended.
    exits: JoinSet<(usize, Option<ExitStatus>)>,
    shutdown: CancellationToken,
    is_writing: bool,
}

/// Indices into `children`.
const MANAGER: usize = 0;
const COMPOSITOR: usize = 1;

impl Rig {
    async fn start(args: &RigArgs, folder: &Path, camera: &Path, frames: Option<u64>) -> Result<Self, CommandError> {
        let keys = args.keys.as_deref().map(Authority::open).transpose()?.map(|authority| Keys { authority, folder });
        let shutdown = shutdown_token(Supervision { supervised: false })?;
        let row = settings::row(&args.row, Some(args.mode), &rig_file::RigFile::default())?;
        let boards = args.boards.map_or(row.count as usize, std::num::NonZeroUsize::get);
        let threads = (processors().get() / boards).max(1);
        let memory = args.memory_limit.unwrap_or_else(|| machine_memory() / 2 / boards as u64);
        let size = format!("{}x{}", row.width, row.height);

        let mut manager = own_command(&["manager", "--listen", "127.0.0.1:0", "--pose-listen", "127.0.0.1:0"])?;
        manager.args(["--scene", &args.scene, "--camera"]).arg(camera);
        manager.args(["--views", &row.count.to_string(), "--size", &size]);
        manager.args(["--samples", &row.samples.to_string(), "--rate", &args.rate.to_string()]);
        manager.args(["--wait-for-boards", &boards.to_string(), "--wait-for-compositor"]);
        if args.mode == ModeArg::Region {
            manager.args(["--mode", "region"]);
        }
        manager.args(["--detail", args.detail.name()]);
        manager.args(["--console", &console(args.console)]);
        if let Some(token) = &args.observed.console_token {
            // Not by its command line, which everybody can read.
            manager.env("CYCLORAMA_CONSOLE_TOKEN", token);
        }
        if let Some(url) = &args.observed.otlp {
            manager.args(["--otlp", url]);
        }
        manager.args(air_flags(args));
        if let Some(frames) = frames {
            manager.args(["--frames", &frames.to_string()]);
        }
        if is_writing(args) {
            manager.arg("--lock-step");
        }
        give_keys(&mut manager, keys.as_ref(), NodeRole::Manager, "manager")?;
        let mut exits = JoinSet::new();
        let mut children = Vec::new();
        let stdout = spawn(manager.stdout(Stdio::piped()), "the manager".into(), &mut children, &mut exits)?;
        let Some(stdout) = stdout else { return Err(CommandError::said("the manager has no stdout")) };
        let mut lines = BufReader::new(stdout).lines();
        let (backplane, pose, address) = listening(&mut lines).await?;

        let mut compositor = own_command(&["compositor", "--backplane", &backplane.to_string()])?;
        if let Some(out) = &args.out {
            compositor.arg("--out").arg(out).args(["--format", args.format.extension()]);
        }
        if let Some(manifest) = &args.manifest {
            compositor.arg("--manifest").arg(manifest);
        }
        give_keys(&mut compositor, keys.as_ref(), NodeRole::Compositor, "compositor")?;
        spawn(compositor.stdout(Stdio::null()), "the compositor".into(), &mut children, &mut exits)?;
        let mut host = own_command(&["host", "play"])?;
        host.arg(camera).args(["--to", &pose.to_string(), "--size", &size, "--repeat"]);
        host.args(["--rate", &args.rate.to_string()]);
        if is_writing(args) {
            host.arg("--lock-step");
        }
        spawn(host.stdout(Stdio::null()), "the host".into(), &mut children, &mut exits)?;
        for k in 0..boards {
            let name = format!("{k}");
            let mut board = own_command(&["channel", "--backplane", &backplane.to_string(), "--name", &name])?;
            board.args(["--threads", &threads.to_string()]);
            board.args(["--memory-limit", &(memory as f64 / f64::from(1 << 20)).to_string()]);
            give_keys(&mut board, keys.as_ref(), NodeRole::Board, &name)?;
            spawn(board.stdout(Stdio::null()), format!("board {k}"), &mut children, &mut exits)?;
        }
        if let Some(address) = address {
            note(&format!("console: http://{address}/"));
        }
        note(&format!("{} views of {size}, {boards} boards; Ctrl-C ends the rig", row.count));
        Ok(Self { manager: lines, children, exits, shutdown, is_writing: is_writing(args) })
    }

    /// Follows the rig to its end; returns the manager's report.
    async fn watch(&mut self, frames: Option<u64>) -> Result<Option<serde_json::Value>, CommandError> {
        let bar = frames.filter(|_| std::io::stderr().is_terminal()).map(bar);
        let mut said = Instant::now();
        let mut report = None;
        let mut is_ending = false;
        loop {
            tokio::select! {
                line = self.manager.next_line() => match line.ok().flatten().map(|text| serde_json::from_str(&text)) {
                    Some(Ok(ManagerLine::Progress(done))) => {
                        if let Some(bar) = &bar {
                            bar.set_position(done);
                        } else if let Some(all) = frames && said.elapsed() > PROGRESS_PERIOD {
                            said = Instant::now();
                            note(&format!("frame {done} of {all}"));
                        }
                    }
                    Some(Ok(ManagerLine::Report(value))) => report = Some(value),
                    Some(_) => {}
                    // End of the manager's output: it is over, and its exit status says how.
                    None => return self.judge_manager(report).await,
                },
                Some(Ok((child, status))) = self.exits.join_next() => {
                    if child == MANAGER {
                        // Its last lines may still be on their way.
                        while let Ok(Some(text)) = self.manager.next_line().await {
                            if let Ok(ManagerLine::Report(value)) = serde_json::from_str(&text) {
                                report = Some(value);
                            }
                        }
                        return match status {
                            Some(status) if status.success() => Ok(report),
                            _ => Err(CommandError::said("the manager has failed; its message is above")),
                        };
                    }
                    if !is_ending {
                        self.on_exit(child, status)?;
                    }
                }
                () = self.shutdown.cancelled(), if !is_ending => {
                    is_ending = true;
                    self.children[MANAGER].stdin = None;
                }
            }
        }
    }

    async fn judge_manager(
        &mut self,
        report: Option<serde_json::Value>,
    ) -> Result<Option<serde_json::Value>, CommandError> {
        while let Some(ended) = self.exits.join_next().await {
            match ended {
                Ok((MANAGER, Some(status))) if status.success() => return Ok(report),
                Ok((MANAGER, _)) => return Err(CommandError::said("the manager has failed; its message is above")),
                _ => {}
            }
        }
        Ok(report)
    }

    fn on_exit(&self, child: usize, status: Option<ExitStatus>) -> Result<(), CommandError> {
        let name = &self.children[child].name;
        let how = status.map_or_else(|| "is gone".to_owned(), |status| format!("ended ({status})"));
        let has_failed = status.is_none_or(|status| !status.success());
        if child == COMPOSITOR && has_failed && self.is_writing {
            return Err(CommandError::said(format!("{name} {how}, and pictures can't be written without it")));
        }
        // Whoever ends without an error was told to, by the manager or by a person.
        if has_failed {
            note(&format!("{name} {how}; the rig goes on"));
        }
        Ok(())
    }

    /// Ends what still runs and waits for it.
    async fn end(&mut self) {
        // The compositor ends by itself when its pictures are written; the others hold nothing.
        let is_writing = self.is_writing && !self.shutdown.is_cancelled();
        for (i, child) in self.children.iter_mut().enumerate() {
            if !(is_writing && i == COMPOSITOR) {
                child.stdin = None;
            }
        }
        let patience = if is_writing { WRITE_TIMEOUT } else { END_TIMEOUT };
        let waiting = async { while self.exits.join_next().await.is_some() {} };
        if tokio::time::timeout(patience, waiting).await.is_err() {
            for child in &self.children {
                child.kill.cancel();
            }
            while self.exits.join_next().await.is_some() {}
        }
    }
}

/// Where the processes' keys come from, and where they are put.
struct Keys<'a> {
    authority: Authority,
    folder: &'a Path,
}

/// Longer than a rig on one machine runs; its keys go with it.
const KEY_DAYS: u32 = 365;

fn give_keys(command: &mut Command, keys: Option<&Keys<'_>>, role: NodeRole, name: &str) -> Result<(), CommandError> {
    if let Some(Keys { authority, folder }) = keys {
        let folder = folder.join(format!("{role}-{name}"));
        authority.issue(role, name, KEY_DAYS, &folder)?;
        command.arg("--keys").arg(folder);
    }
    Ok(())
}

fn bar(frames: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} frame {pos} of {len}, {eta} left");
    ProgressBar::new(frames).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

fn own_command(args: &[&str]) -> Result<Command, CommandError> {
    let program =
        std::env::current_exe().map_err(|error| CommandError::said(format!("own program not found: {error}")))?;
    let mut command = Command::new(program);
    command.args(args).arg("--supervised").stdin(Stdio::piped()).kill_on_drop(true);
    // A node's keys are not all nodes'.
    command.env_remove("CYCLORAMA_KEYS").env_remove("CYCLORAMA_CONSOLE_TOKEN");
    if std::env::var_os("CYCLORAMA_LOG").is_none() {
        command.env("CYCLORAMA_LOG", "warn");
    }
    Ok(command)
}

fn spawn(
    command: &mut Command,
    name: String,
    children: &mut Vec<Spawned>,
    exits: &mut JoinSet<(usize, Option<ExitStatus>)>,
) -> Result<Option<ChildStdout>, CommandError> {
    let mut child = command.spawn().map_err(|error| CommandError::said(format!("cannot start {name}: {error}")))?;
    let (stdin, stdout, index) = (child.stdin.take(), child.stdout.take(), children.len());
    let kill = CancellationToken::new();
    let killed = kill.clone();
    exits.spawn(async move {
        tokio::select! {
            status = child.wait() => (index, status.ok()),
            () = killed.cancelled() => {
                // It may have ended at this very moment.
                let _ = child.kill().await;
                (index, None)
            }
        }
    });
    children.push(Spawned { name, stdin, kill });
    Ok(stdout)
}

async fn listening(
    lines: &mut Lines<BufReader<ChildStdout>>,
) -> Result<(SocketAddr, SocketAddr, Option<SocketAddr>), CommandError> {
    match lines.next_line().await.ok().flatten().map(|text| serde_json::from_str(&text)) {
        Some(Ok(ManagerLine::Listening { backplane, pose, console })) => Ok((backplane, pose, console)),
        _ => Err(CommandError::said("the manager did not start; its message is above")),
    }
}

/// The console's address: as asked, or 7480, or any free port when that is in use.
fn console(asked: Option<Console>) -> String {
    match asked {
        Some(Console::Off) => "off".into(),
        Some(Console::At(address)) => address.to_string(),
        None => {
            let usual = settings::loopback(settings::PORT_CONSOLE);
            let is_free = std::net::TcpListener::bind(usual).is_ok();
            if is_free { usual } else { settings::loopback(0) }.to_string()
        }
    }
}

fn air_flags(args: &RigArgs) -> Vec<String> {
    let triple =
        |name: &str, value: Option<[f64; 3]>| value.map(|[x, y, z]| [format!("--{name}"), format!("{x},{y},{z}")]);
    let air = &args.air;
    let mut flags: Vec<String> = [triple("background", air.background), triple("sun", air.sun), triple("fog", air.fog)]
        .into_iter()
        .flatten()
        .flatten()
        .collect();
    if let Some(visibility) = air.visibility {
        flags.extend(["--visibility".into(), visibility.to_string()]);
    }
    if air.scene_lights {
        flags.push("--scene-lights".into());
    }
    flags
}
