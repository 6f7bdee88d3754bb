//! `cyclorama render`: one picture without a network, through the same selection, shares, drawing and stitching as a
//! rig's.

use crate::cli::RenderArgs;
use crate::error::CommandError;
use crate::in_process::{InProcess, look};
use crate::output::say;
use crate::serve::processors;
use crate::source;
use bytes::Bytes;
use channel::pipeline::{DrawStats, TilePictures};
use compositor::sinks::{FileKind, Picture};
use compositor::stitch::Stitcher;
use manager::host::camera::CameraPose;
use manager::select::Counters;
use proto::frame::{FrameState, PixelFormat};
use proto::ids::{BoardId, BoardKey, FrameNumber};
use proto::message::Swap;
use proto::share::shares;
use proto::view::{Samples, ViewSetup};
use std::num::NonZeroUsize;
use std::time::Instant;

/// Runs the command.
pub(crate) fn run(args: &RenderArgs) -> Result<(), CommandError> {
    let extension = args.output.extension().unwrap_or_default().to_string_lossy();
    let Some(kind) = FileKind::of_extension(&extension) else {
        let shown = args.output.display();
        return Err(CommandError::said(format!("{shown}: possible are .png, .exr and .rgb; name the picture so")));
    };
    let source = source::load(&args.scene, args.camera.as_deref())?;
    let count = source.camera.poses.len();
    let Some(pose) = source.camera.poses.get(args.pose) else {
        return Err(CommandError::said(format!("--pose {}: the camera has poses 0 to {}", args.pose, count - 1)));
    };
    let (width, height) = args.size;
    let (mut state, view) = look(pose, args.size, &args.air, args.samples)?;
    (state.frame, state.debug) = (FrameNumber(args.pose as u64), args.debug.into());
    let threads = args.threads.unwrap_or_else(processors);
    let mut drawer = InProcess::new(&source.scene, threads, args.detail.into())?;
    drawer.renderer().set_simd(args.simd.unwrap_or_default());
    let setup = ViewSetup { mode: args.mode.into(), ..ViewSetup::new(view) };
    let drawn = draw(&mut drawer, pose, &state, &setup, args.boards, kind.format())?;
    let pixels = drawn.stitcher.canvas().to_vec();
    let picture = Picture { frame: state.frame, width, height, format: kind.format(), pixels };
    kind.write(&args.output, &picture)?;
    if args.stats {
        say(&drawn.to_json(args, threads));
    }
    Ok(())
}

struct Drawn {
    stitcher: Stitcher,
    stats: Vec<DrawStats>,
    selected: Counters,
    select_ms: f64,
    total_ms: f64,
}

/// One renderer plays all boards, one after the other; the compositor's stitcher puts their shares together.
fn draw(
    drawer: &mut InProcess<'_>,
    pose: &CameraPose,
    state: &FrameState,
    setup: &ViewSetup,
    boards: NonZeroUsize,
    format: PixelFormat,
) -> Result<Drawn, CommandError> {
    let started = Instant::now();
    let (view, views) = (&setup.view, std::slice::from_ref(setup));
    drawer.select(pose, state, view)?;
    let weights = vec![1; boards.get()];
    let mut stitcher = Stitcher::new(format, Vec::new());
    if !stitcher.set_views(views) {
        return Err(CommandError::said("the picture is too large"));
    }
    let mut pictures = match format {
        PixelFormat::Srgb8 => TilePictures::new(),
        PixelFormat::LinearF32 => TilePictures::with_linear(),
    };
    let (frame, epoch, size) = (state.frame, state.epoch, (view.width, view.height));
    let mut stats = Vec::new();
    let mut keys = Vec::new();
    for board in 0..boards.get() {
        let key = BoardKey(board as u64);
        stitcher.on_board(key);
        keys.push(key);
        for share in shares(BoardId(board as u32), &weights, views) {
            stats.push(drawer.draw(state, view, &share.part, &mut pictures)?);
            let (count, payload) = (pictures.tiles.len() as u32, tile_payload(&pictures, format));
            stitcher
                .on_tiles(key, frame, epoch, share.view, count, size, format, payload)
                .map_err(|error| CommandError::said(error.to_string()))?;
        }
        stitcher.on_done(key, frame, epoch);
    }
    stitcher.on_swap(Swap { frame, epoch, complete: vec![true], boards: keys, preview: false, moment: None });
    if stitcher.poll().is_none() {
        return Err(CommandError::said("the shares don't make a whole picture; please report this"));
    }
    let total_ms = started.elapsed().as_secs_f64() * 1e3;
    Ok(Drawn { stitcher, stats, selected: drawer.selection().counters, select_ms: drawer.select_ms, total_ms })
}

fn tile_payload(pictures: &TilePictures, format: PixelFormat) -> Bytes {
    let mut payload = Vec::with_capacity(pictures.tiles.len() * 4 + pictures.rgb.len());
    for tile in &pictures.tiles {
        payload.extend_from_slice(&tile.x.to_le_bytes());
        payload.extend_from_slice(&tile.y.to_le_bytes());
    }
    match (format, &pictures.linear) {
        (PixelFormat::LinearF32, Some(linear)) => payload.extend(linear.iter().flat_map(|v| v.to_le_bytes())),
        _ => payload.extend_from_slice(&pictures.rgb),
    }
    payload.into()
}

impl Drawn {
    fn to_json(&self, args: &RenderArgs, threads: NonZeroUsize) -> String {
        let sum = |count: fn(&DrawStats) -> u64| self.stats.iter().map(count).sum::<u64>();
        let ms = |count: fn(&DrawStats) -> u64| sum(count) as f64 / 1e6;
        serde_json::json!({
            "scene": args.scene,
            "size": [args.size.0, args.size.1],
            "samples": if args.samples == Samples::Exact { "exact".into() } else { serde_json::json!(args.samples.count()) },
            "threads": threads,
            "boards": args.boards,
            "ms": self.total_ms,
            "stage_ms": {
                "select": self.select_ms,
                "geometry": ms(|s| s.geometry_ns),
                "raster": ms(|s| s.raster_ns),
                "translucency": ms(|s| s.translucency_ns),
                "resolve": ms(|s| s.resolve_ns),
            },
            "subobjects": self.selected.subobjects_visible,
            "triangles": sum(|s| s.geometry.faces_in),
            "triangles_drawn": sum(|s| s.triangles_drawn),
            "fragments": sum(|s| s.fragments),
            "skipped": {
                "culled": self.selected.subobjects_culled,
                "occluded_subobjects": sum(|s| s.geometry.hidden_subobjects),
                "occluded": sum(|s| s.opaque.occluded + s.translucent.occluded),
                "backface": sum(|s| s.geometry.backface),
                "tiles_opaque": sum(|s| s.tiles_opaque),
                "pixels_single": sum(|s| s.pixels.pixels_single),
            },
        })
        .to_string()
    }
}
