//! The daemons as commands: a runtime, the ways to end them, and what they say on stdout.
//!
//! A daemon ends by SIGINT, SIGTERM or, under `rig`, when its stdin does: so none outlives a rig that was killed.

use crate::cli::{ChannelArgs, CompositorArgs, HostPlayArgs, ManagerArgs, Supervision};
use crate::error::CommandError;
use crate::output::{note, say};
use crate::settings;
use link::NodeRole;
use manager::backplane::{Addresses, Report};
use manager::host::camera::CameraFile;
use proto::pose::Answer;
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;
use tokio::signal::unix::{SignalKind, signal};
use tokio_util::sync::CancellationToken;

/// How often a supervised manager says how far it is.
const PROGRESS_PERIOD: Duration = Duration::from_millis(250);
/// How long a lock-step host waits for an answer before it asks again.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(200);

/// What a supervised manager says, one JSON object a line.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ManagerLine {
    /// All sockets are open.
    Listening { backplane: SocketAddr, pose: SocketAddr, console: Option<SocketAddr> },
    /// Frames swapped.
    Progress(u64),
    /// The statistics, at the end.
    Report(serde_json::Value),
}

/// A runtime for a daemon, with `workers` threads.
pub(crate) fn runtime(workers: usize) -> Result<Runtime, CommandError> {
    let mut builder = if workers == 1 {
        tokio::runtime::Builder::new_current_thread()
    } else {
        let mut builder = tokio::runtime::Builder::new_multi_thread();
        builder.worker_threads(workers);
        builder
    };
    builder.enable_all().build().map_err(|error| CommandError::said(format!("cannot start: {error}")))
}

/// Cancelled when the daemon is to end.
pub(crate) fn shutdown_token(supervision: Supervision) -> Result<CancellationToken, CommandError> {
    let token = CancellationToken::new();
    let cannot = |error: std::io::Error| CommandError::said(format!("cannot listen for signals: {error}"));
    let mut interrupt = signal(SignalKind::interrupt()).map_err(cannot)?;
    let mut terminate = signal(SignalKind::terminate()).map_err(cannot)?;
    let ends = token.clone();
    tokio::spawn(async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        ends.cancel();
    });
    if supervision.supervised {
        let ends = token.clone();
        std::thread::spawn(move || {
            // Whether it ends or fails, nobody supervises us any more.
            let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
            ends.cancel();
        });
    }
    Ok(token)
}

fn say_json(line: &impl Serialize) {
    match serde_json::to_string(line) {
        Ok(text) => say(&text),
        Err(error) => tracing::error!(%error, "not printable"),
    }
}

/// `cyclorama manager`.
pub(crate) fn manager(args: &ManagerArgs) -> Result<(), CommandError> {
    let config = settings::manager(args)?;
    let supervised = args.supervision.supervised;
    let progress = Arc::clone(&config.progress);
    runtime(2)?.block_on(async {
        let shutdown = shutdown_token(args.supervision)?;
        if supervised {
            tokio::spawn(async move {
                let mut said = 0;
                loop {
                    tokio::time::sleep(PROGRESS_PERIOD).await;
                    let frames = progress.load(Ordering::Relaxed);
                    if frames != said {
                        said = frames;
                        say_json(&ManagerLine::Progress(frames));
                    }
                }
            });
        }
        let listening = |addresses: Addresses| {
            let Addresses { backplane, pose, console } = addresses;
            if supervised {
                say_json(&ManagerLine::Listening { backplane, pose, console });
            } else {
                note(&format!("boards and compositor: {backplane} (TCP)\npose packets: {pose} (UDP)"));
                if let Some(console) = console {
                    note(&format!("console: http://{console}/"));
                }
            }
        };
        let report = manager::backplane::run(config, shutdown, listening).await?;
        if supervised {
            let value = serde_json::to_value(&report).map_err(|error| CommandError::said(error.to_string()))?;
            say_json(&ManagerLine::Report(value));
        } else if args.json {
            say_json(&report);
        } else {
            summarise(&report);
        }
        Ok(())
    })
}

fn summarise(report: &Report) {
    note(&format!(
        "{} frames in {:.1} s; {} late; frame {:.1} ms (median), {:.1} ms (99 %)",
        report.frames, report.seconds, report.late_frames, report.frame_ms.p50, report.frame_ms.p99
    ));
}

/// `cyclorama channel`.
pub(crate) fn channel(args: &ChannelArgs) -> Result<(), CommandError> {
    let trust = settings::trust(&args.trust, NodeRole::Board)?;
    let listen = settings::guard_listen(args.listen, &trust)?;
    let threads = args.threads.unwrap_or_else(processors);
    let config = channel::worker::Config {
        backplanes: settings::backplanes(&args.backplane, &trust)?,
        trust,
        listen,
        advertise: args.advertise.clone(),
        threads,
        simd: args.simd.unwrap_or_default(),
        memory: args.memory_limit.unwrap_or_else(|| machine_memory() / 2),
        name: args.name.clone().unwrap_or_else(|| std::process::id().to_string()),
        once: args.supervision.supervised,
    };
    runtime(1)?.block_on(async {
        let shutdown = shutdown_token(args.supervision)?;
        channel::worker::run(
            config,
            shutdown,
            |address| tracing::info!(%address, threads, "listening for a neighbour"),
        )
        .await?;
        Ok(())
    })
}

/// Processors that this process may use.
pub(crate) fn processors() -> NonZeroUsize {
    std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN)
}

/// Memory that this process may use, bytes: the machine's, or less in a container that has less. A gibibyte where the system doesn't say.
pub(crate) fn machine_memory() -> u64 {
    let meminfo = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let total = meminfo.lines().find_map(|line| {
        line.strip_prefix("MemTotal:")?.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
    });
    let group = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok().and_then(|text| text.trim().parse().ok());
    total.into_iter().chain(group).min().unwrap_or(1 << 30)
}

/// `cyclorama compositor`.
pub(crate) fn compositor(args: &CompositorArgs) -> Result<(), CommandError> {
    let trust = settings::trust(&args.trust, NodeRole::Compositor)?;
    let config = compositor::shell::Config {
        backplanes: settings::backplanes(&args.backplane, &trust)?,
        listen: settings::guard_listen(args.listen, &trust)?,
        trust,
        out: args.out.clone().map(|folder| (folder, args.format)),
        manifest: args.manifest.clone(),
        once: args.supervision.supervised,
    };
    runtime(1)?.block_on(async {
        let shutdown = shutdown_token(args.supervision)?;
        let listening = |address| tracing::info!(%address, "listening for boards");
        let written = compositor::shell::run(config, shutdown, listening).await?;
        if let Some(folder) = &args.out {
            note(&format!("{written} pictures written to {}", folder.display()));
        }
        Ok(())
    })
}

/// `cyclorama host play`.
pub(crate) fn host_play(args: &HostPlayArgs) -> Result<(), CommandError> {
    let camera = CameraFile::read(&args.file)?;
    if args.lock_step && args.to.len() > 1 {
        return Err(CommandError::said("in lock-step there is one manager; give one --to"));
    }
    let sockets = args.to.iter().map(|to| pose_socket(to)).collect::<Result<Vec<_>, _>>()?;
    if args.supervision.supervised {
        std::thread::spawn(|| {
            // Whether it ends or fails, nobody supervises us any more.
            let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
            std::process::exit(0);
        });
    }
    let mut sequence = 0;
    let mut epoch = Instant::now();
    loop {
        for k in 0..camera.poses.len() {
            let due = camera.poses[k].t.unwrap_or(k as f64 / args.rate);
            if !args.lock_step {
                let due = epoch + Duration::from_secs_f64((due - camera.poses[0].t.unwrap_or(0.0)).max(0.0));
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
            let packet = camera.packet(k, sequence, args.lock_step, args.size).encode();
            for socket in &sockets {
                send_pose(socket, &packet, sequence, args.lock_step);
            }
            sequence = sequence.wrapping_add(1);
        }
        if !args.repeat {
            return Ok(());
        }
        // One period between the last pose and the first again.
        std::thread::sleep(if args.lock_step { Duration::ZERO } else { Duration::from_secs_f64(1.0 / args.rate) });
        epoch = Instant::now();
    }
}

/// A socket to a manager's pose port.
fn pose_socket(to: &str) -> Result<UdpSocket, CommandError> {
    let socket =
        UdpSocket::bind(("0.0.0.0", 0)).map_err(|error| CommandError::said(format!("no UDP socket: {error}")))?;
    socket
        .connect(to)
        .map_err(|error| CommandError::said(format!("{to}: {error}; expected HOST:PORT of a manager")))?;
    socket.set_read_timeout(Some(ANSWER_TIMEOUT)).map_err(|error| CommandError::said(error.to_string()))?;
    Ok(socket)
}

/// Sends a pose; in lock-step again and again until the manager has shown it.
fn send_pose(socket: &UdpSocket, packet: &[u8], sequence: u32, lock_step: bool) {
    let mut answer = [0; 64];
    loop {
        // "Refused" means that the manager isn't there at present: like JSBSim, go on.
        if let Err(error) = socket.send(packet) {
            tracing::debug!(%error, "pose not sent");
            if lock_step {
                std::thread::sleep(ANSWER_TIMEOUT);
            }
        }
        if !lock_step {
            return;
        }
        loop {
            match socket.recv(&mut answer) {
                Ok(len) if Answer::decode(&answer[..len]).is_ok_and(|answer| answer.sequence == sequence) => return,
                Ok(_) => {}
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => break,
                // "Refused": nobody listens at present, and the next attempt would fail as fast.
                Err(_) => {
                    std::thread::sleep(ANSWER_TIMEOUT);
                    break;
                }
            }
        }
    }
}
