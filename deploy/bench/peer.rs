//! llvmpipe in a process of its own, and alone.

use super::{PEER_BACKGROUND, look, spread};
use crate::cli::PeerArgs;
use crate::error::CommandError;
use crate::output::{note, say};
use crate::source;
use ::bench::Report;
use ::bench::pixels::{Renderer, Row, Sampling, table};
use ::peer::protocol::{Child, ChildError, Reply, serve};
use ::peer::{Look, Peer};
use proto::frame::{Background, FrameState};
use proto::view::{Samples, View};
use std::io::{stdin, stdout};
use std::num::NonZeroUsize;
use std::process::Command;

/// Frames before the first that counts.
const WARM_UP: usize = 3;

/// `cyclorama bench peer`: alone, or the child of a benchmark.
pub(crate) fn peer(args: &PeerArgs) -> Result<(), CommandError> {
    if args.serve { answer(args) } else { alone(args) }
}

/// Takes the scene in and answers on stdout.
fn answer(args: &PeerArgs) -> Result<(), CommandError> {
    let said = |error: &dyn std::fmt::Display| CommandError::said(format!("the benchmark's pipe: {error}"));
    let scene = source::load(&args.scene, None)?.scene;
    let result = Peer::new(&scene.table, &scene.meshes.all()?);
    match result {
        Ok(peer) => serve(peer, stdin().lock(), stdout().lock()).map_err(|error| said(&error)),
        Err(error) => {
            let why = error.to_string();
            ::peer::protocol::say(&mut stdout().lock(), &Reply::Unavailable { why }).map_err(|error| said(&error))
        }
    }
}

/// Starts a child for this scene. The inner error says why there can be none, which fails nothing: its rows are left out.
pub(super) fn start(scene: &str, threads: NonZeroUsize) -> Result<Result<Child, String>, CommandError> {
    let program = std::env::current_exe().map_err(|error| CommandError::said(format!("this program: {error}")))?;
    let mut command = Command::new(program);
    command.args(["bench", "peer", "--serve", scene]);
    match Child::start(command, threads) {
        Ok(child) => Ok(Ok(child)),
        Err(ChildError::Unavailable(why)) => Ok(Err(why)),
        Err(error) => Err(failed(error)),
    }
}

/// What went wrong with a child that was there.
pub(super) fn failed(error: ChildError) -> CommandError {
    CommandError::said(format!("{}: {error}", Renderer::Llvmpipe))
}

/// What the peer draws of this; `Err` says why it can't.
pub(super) fn peer_look(state: &FrameState, view: &View, samples: usize) -> Result<Look, String> {
    let air = &state.environment;
    let Background::Constant(background) = air.background else {
        return Err("the peer draws no sky: give it a --background".into());
    };
    if air.visibility_m.is_some() {
        return Err("the peer draws no fog: leave out --visibility".into());
    }
    Ok(Look {
        size: [view.width, view.height],
        samples: samples as u32,
        pose: view.world_pose(state.eye),
        tangents: view.tangents,
        near: view.near,
        sun: air.sun_direction,
        background,
    })
}

/// Times the peer on a scene's path, with nothing beside it.
fn alone(args: &PeerArgs) -> Result<(), CommandError> {
    let camera = source::load(&args.scene, None)?.camera;
    let mut child = start(&args.scene, args.threads)?.map_err(CommandError::said)?;
    note(&child.renderer);
    let air = crate::cli::AirArgs { background: Some(PEER_BACKGROUND), ..Default::default() };
    let poses = spread(&camera, args.poses);
    let mut rows = Vec::new();
    for &samples in &args.samples {
        let mut times = Vec::new();
        for (k, pose) in poses.iter().enumerate() {
            let (state, view) = look(pose, args.size, &air, Samples::One)?;
            let look = peer_look(&state, &view, samples).map_err(CommandError::said)?;
            // The first frames compile shaders and touch memory.
            for _ in 0..if k == 0 { WARM_UP } else { 0 } {
                child.draw(&look).map_err(failed)?;
            }
            times.push(child.draw(&look).map_err(failed)?.ms);
        }
        let sampling = Some(Sampling::Points(samples));
        rows.push(Row {
            size: [args.size.0, args.size.1],
            threads: args.threads.get(),
            ..Row::timed(&args.scene, Renderer::Llvmpipe, sampling, &times)
        });
    }
    if args.json {
        let text = serde_json::to_string(&Report::new("peer", rows, Vec::new()));
        say(&text.map_err(|error| CommandError::said(error.to_string()))?);
    } else {
        say(table(&rows, &[]).trim_end());
    }
    Ok(())
}
