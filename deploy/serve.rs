//! The daemons as commands: a runtime, the ways to end them, and what they say on stdout.
//!
//! A daemon ends by SIGINT, SIGTERM or, under `rig`, when its stdin does: so none outlives a rig that was killed.

use crate::cli::{ChannelArgs, CompositorArgs, ManagerArgs, Supervision};
use crate::error::CommandError;
use crate::output::{note, say};
use crate::settings;
use link::NodeRole;
use manager::backplane::{Addresses, Report};
use pool::turns;
use proto::frame::PixelFormat;
use proto::ids::ViewId;
use serde::{Deserialize, Serialize};
use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tokio::runtime::Runtime;
use tokio::signal::unix::{SignalKind, signal};
use tokio_util::sync::CancellationToken;

/// How often a supervised manager says how far it is.
const PROGRESS_PERIOD: Duration = Duration::from_millis(250);

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
    turns::go_first();
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
        backplanes: settings::backplanes(&args.leader.backplane, &trust)?,
        trust,
        listen,
        advertise: args.advertise.clone(),
        threads,
        simd: args.simd.unwrap_or_default(),
        memory: args.memory_limit.unwrap_or_else(|| machine_memory() / 2),
        name: args.name.clone().unwrap_or_else(own_name),
        once: args.supervision.supervised,
    };
    let display = args.display.map(|view| display(args, ViewId(view))).transpose()?;
    turns::go_first();
    runtime(1)?.block_on(async {
        let shutdown = shutdown_token(args.supervision)?;
        let listening = |address| tracing::info!(%address, threads, "listening for a neighbour");
        let Some(display) = display else {
            return Ok(channel::worker::run(config, shutdown, listening).await?);
        };
        // Whichever ends first, the other one does too; a board that leaves draws until others do, and its display shows that.
        let ends = CancellationToken::new();
        let (board_ends, board) = (ends.clone(), shutdown.clone());
        // Laying tiles must not hold up the board's words.
        let showing = tokio::task::spawn_blocking(move || {
            let told = |address| tracing::info!(%address, "listening for tiles of the display");
            let shown = runtime(1).map(|runtime| runtime.block_on(compositor::shell::run(display, ends, told)));
            board.cancel();
            shown
        });
        let drawn = channel::worker::run(config, shutdown, listening).await;
        board_ends.cancel();
        let shown = showing.await.map_err(|error| CommandError::said(error.to_string()))?;
        drawn?;
        shown??;
        Ok(())
    })
}

/// What a board that is a display shows.
fn display(args: &ChannelArgs, view: ViewId) -> Result<compositor::shell::Config, CommandError> {
    let mut trust = args.trust.clone();
    if trust.keys.is_some() && args.display_keys.is_none() {
        return Err(CommandError::said("a board's keys don't show pictures; give a compositor's with --display-keys"));
    }
    trust.keys.clone_from(&args.display_keys);
    let trust = settings::trust(&trust, NodeRole::Compositor)?;
    Ok(compositor::shell::Config {
        backplanes: settings::backplanes(&args.leader.backplane, &trust)?,
        listen: settings::guard_listen(SocketAddr::new(args.listen.ip(), 0), &trust)?,
        trust,
        views: vec![view],
        window: Some(args.display_at.unwrap_or_default()),
        out: None,
        pattern: args.pattern,
        manifest: None,
        once: args.supervision.supervised,
    })
}

/// What a board is called that wasn't given a name. In a container it is the first process, and the container's name says which.
fn own_name() -> String {
    match std::process::id() {
        1 => host_name(),
        number => format!("{}-{number}", host_name()),
    }
}

/// This machine's name, or the container's.
pub(crate) fn host_name() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    if name.trim().is_empty() { "board".into() } else { name.trim().to_owned() }
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
    if args.window.is_some() && args.format.format() != PixelFormat::Srgb8 {
        return Err(CommandError::said(
            "a window shows 8-bit pixels; give --format exr to another compositor, with --views if there is one for all",
        ));
    }
    if args.pattern && args.format.format() != PixelFormat::Srgb8 {
        return Err(CommandError::said("the pattern has 8-bit pixels; write it as --format png or rgb"));
    }
    let mut views: Vec<_> = args.views.iter().copied().map(ViewId).collect();
    views.sort_unstable();
    views.dedup();
    let config = compositor::shell::Config {
        views,
        backplanes: settings::backplanes(&args.leader.backplane, &trust)?,
        listen: settings::guard_listen(args.listen, &trust)?,
        trust,
        window: args.window,
        out: args.out.clone().map(|folder| (folder, args.format)),
        pattern: args.pattern,
        manifest: args.manifest.clone(),
        once: args.supervision.supervised,
    };
    turns::go_first();
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
