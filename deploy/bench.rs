//! `cyclorama bench`: figures, as ratios in one run where that is possible, each answer checked before its time counts.
//!
//! `pixels` draws scenes along their camera paths in this process and, with `--reference`, compares one picture of each with
//! the reference renderer of `tests/reference`: the integral where the scene has no textures, 1024 points otherwise.

use crate::cli::PixelsArgs;
use crate::error::CommandError;
use crate::in_process::{InProcess, placed};
use crate::output::{note, say};
use crate::source::{self, Source};
use crate::{rig_file, settings};
use ::bench::chart::{Curve, error_against_time};
use ::bench::{Report, Spread};
use channel::pipeline::{DrawStats, TilePictures};
use manager::host::camera::CameraPose;
use manager::scene::Scene;
use proto::frame::FrameState;
use proto::ids::{Epoch, FrameNumber};
use proto::share::Part;
use proto::view::{Pose, Samples, View};
use reference::compare::{Shown, compare, difference_picture};
use reference::picture::Picture as Truth;
use reference::sampling::{Options, sample};
use reference::screen::Vertices;
use reference::world::World;
use serde::Serialize;
use std::path::Path;

/// Points of the reference where there is no integral.
const REFERENCE_POINTS: usize = 1024;
/// Steps of grey for a difference of 1/255 in a difference picture.
const DIFFERENCE_GAIN: f64 = 16.0;

/// One scene at one number of samples.
#[derive(Debug, Serialize)]
struct Row {
    scene: String,
    size: [u32; 2],
    samples: usize,
    threads: usize,
    poses: usize,
    ms: Spread,
    stage_ms: StageMs,
    triangles: u64,
    triangles_drawn: u64,
    fragments: u64,
    skipped: Skips,
    /// Against the reference, linear full scale.
    rms_edges: Option<f64>,
    rms_all: Option<f64>,
    /// Against the reference, 1/255 of the encoded value.
    errors_255: Option<Errors255>,
}

/// Medians over the poses; raster to resolve summed over threads.
#[derive(Debug, Serialize)]
struct StageMs {
    select: f64,
    geometry: f64,
    raster: f64,
    translucency: f64,
    resolve: f64,
}

/// Means over the poses.
#[derive(Debug, Serialize)]
struct Skips {
    culled: u64,
    occluded: u64,
    backface: u64,
    tiles_opaque: u64,
    pixels_single: u64,
}

/// proof.md's measures of one picture.
#[derive(Clone, Copy, Debug, Serialize)]
struct Errors255 {
    edges_rms: f64,
    interior_max: f64,
    untextured_max: f64,
    magnified_p99: f64,
    minified_p99: f64,
    edge_pixels: usize,
    textured_pixels: usize,
}

/// `cyclorama bench pixels`.
pub(crate) fn pixels(args: &PixelsArgs) -> Result<(), CommandError> {
    let default = ["city", "dense", "smoke", "runway", "overdraw"].map(String::from);
    let scenes = if args.scenes.is_empty() { &default[..] } else { &args.scenes };
    for folder in [&args.plot, &args.diff].into_iter().flatten() {
        std::fs::create_dir_all(folder).map_err(|error| CommandError::file(folder, error))?;
    }
    let mut rows = Vec::new();
    for name in scenes {
        note(&format!("{name} …"));
        let source = source::load(name, args.camera.as_deref())?;
        let first = rows.len();
        run_scene(name, &source, args, &mut rows)?;
        if let Some(folder) = &args.plot {
            plot(folder, name, &rows[first..])?;
        }
    }
    if args.json {
        let text = serde_json::to_string(&Report::new("pixels", rows, Vec::new()));
        say(&text.map_err(|error| CommandError::said(error.to_string()))?);
    } else {
        say(table(&rows).trim_end());
    }
    Ok(())
}

fn run_scene(name: &str, source: &Source, args: &PixelsArgs, rows: &mut Vec<Row>) -> Result<(), CommandError> {
    let all = &source.camera.poses;
    let count = args.poses.get().min(all.len());
    let poses: Vec<&CameraPose> = (0..count).map(|k| &all[k * all.len() / count]).collect();
    let mut drawer = InProcess::new(&source.scene, args.threads)?;
    let mut truth = None;
    for samples in &args.samples {
        let mut out = TilePictures::with_linear();
        let mut plain = TilePictures::new();
        // Once unmeasured: buffers grow, pages come in.
        let (state, view) = look(poses[0], args, *samples)?;
        drawer.select(poses[0], &state, &view)?;
        drawer.draw(&state, &view, &Part::WHOLE, &mut plain)?;
        let mut times = Vec::new();
        let mut stats = Vec::new();
        let mut culled = 0;
        for pose in &poses {
            let (state, view) = look(pose, args, *samples)?;
            let started = std::time::Instant::now();
            drawer.select(pose, &state, &view)?;
            let drawn = drawer.draw(&state, &view, &Part::WHOLE, &mut plain)?;
            times.push(started.elapsed().as_secs_f64() * 1e3);
            stats.push((drawn, drawer.select_ms));
            culled += drawer.selection.counters.subobjects_culled;
        }
        let mut row = row(name, args, *samples, &times, &stats, culled);
        if args.reference {
            let pose = poses[poses.len() / 2];
            let (state, view) = look(pose, args, *samples)?;
            if truth.is_none() {
                truth = Some(reference_picture(&source.scene, pose, &state, &view)?);
            }
            drawer.select(pose, &state, &view)?;
            drawer.draw(&state, &view, &Part::WHOLE, &mut out)?;
            if let Some(truth) = &truth {
                judge(&mut row, &out, truth, args)?;
            }
        }
        rows.push(row);
    }
    Ok(())
}

fn look(pose: &CameraPose, args: &PixelsArgs, samples: Samples) -> Result<(FrameState, View), CommandError> {
    let (width, height) = args.size;
    let view = View {
        offset: Pose::IDENTITY,
        tangents: pose.lens(width, height),
        width,
        height,
        near: View::NEAR_DEFAULT,
        samples,
    };
    let state = FrameState {
        frame: FrameNumber(0),
        epoch: Epoch(1),
        eye: pose.pose().map_err(|error| CommandError::said(error.to_string()))?,
        environment: settings::environment(&args.air, &rig_file::Air::default())?,
    };
    Ok((state, view))
}

fn row(name: &str, args: &PixelsArgs, samples: Samples, times: &[f64], stats: &[(DrawStats, f64)], culled: u64) -> Row {
    let n = stats.len() as u64;
    let mean = |count: fn(&DrawStats) -> u64| stats.iter().map(|(s, _)| count(s)).sum::<u64>() / n;
    let median_ms = |count: fn(&DrawStats) -> u64| {
        let all: Vec<f64> = stats.iter().map(|(s, _)| count(s) as f64 / 1e6).collect();
        Spread::of(&all).median
    };
    let select: Vec<f64> = stats.iter().map(|(_, ms)| *ms).collect();
    Row {
        scene: name.to_owned(),
        size: [args.size.0, args.size.1],
        samples: samples.count(),
        threads: args.threads.get(),
        poses: times.len(),
        ms: Spread::of(times),
        stage_ms: StageMs {
            select: Spread::of(&select).median,
            geometry: median_ms(|s| s.geometry_ns),
            raster: median_ms(|s| s.raster_ns),
            translucency: median_ms(|s| s.translucency_ns),
            resolve: median_ms(|s| s.resolve_ns),
        },
        triangles: mean(|s| s.geometry.faces_in),
        triangles_drawn: mean(|s| s.triangles_drawn),
        fragments: mean(|s| s.fragments),
        skipped: Skips {
            culled: culled / n,
            occluded: mean(|s| s.opaque.occluded + s.translucent.occluded),
            backface: mean(|s| s.geometry.backface),
            tiles_opaque: mean(|s| s.tiles_opaque),
            pixels_single: mean(|s| s.pixels.pixels_single),
        },
        rms_edges: None,
        rms_all: None,
        errors_255: None,
    }
}

/// The truth: the integral where there is one.
fn reference_picture(scene: &Scene, pose: &CameraPose, state: &FrameState, view: &View) -> Result<Truth, CommandError> {
    let said = |error: String| CommandError::said(error);
    let mut moved = Vec::new();
    placed(scene, pose)?.moved(&mut moved);
    let weights = scene.version_weights(&pose.versions).map_err(|error| said(error.to_string()))?;
    let world = World::of_scene(&scene.table, &scene.meshes, &scene.textures, &moved, &weights);
    let world = world.map_err(|error| said(error.to_string()))?;
    // Edges are told apart as for 64 samples, the same for all rows.
    let integral = reference::integral::integrate(&world, state, view, Vertices::Exact, 1.0 / 8.0);
    Ok(integral.unwrap_or_else(|_| sample(&world, state, view, &Options::truth(REFERENCE_POINTS, 64))))
}

/// Enters the picture's errors into its row.
fn judge(row: &mut Row, out: &TilePictures, truth: &Truth, args: &PixelsArgs) -> Result<(), CommandError> {
    let (width, height) = args.size;
    let (linear, rgb) = assemble(out, width, height);
    let in_light = compare(Shown::Linear(&linear), truth);
    let on_screen = compare(Shown::Bytes(&rgb), truth);
    row.rms_edges = Some(in_light.edges.rms_linear);
    row.rms_all = Some(in_light.all.rms_linear);
    row.errors_255 = Some(Errors255 {
        edges_rms: on_screen.edges.rms_255,
        interior_max: on_screen.interior.max_255,
        untextured_max: on_screen.untextured.max_255,
        magnified_p99: on_screen.magnified.p99_255,
        minified_p99: on_screen.minified.p99_255,
        edge_pixels: on_screen.edges.pixels,
        textured_pixels: on_screen.magnified.pixels + on_screen.minified.pixels,
    });
    if let Some(folder) = &args.diff {
        let path = folder.join(format!("{}-{}.png", file_name(&row.scene), row.samples));
        let picture = difference_picture(Shown::Bytes(&rgb), truth, DIFFERENCE_GAIN);
        let picture = picture.map_err(|error| CommandError::file(&path, error))?;
        std::fs::write(&path, picture).map_err(|error| CommandError::file(&path, error))?;
    }
    Ok(())
}

/// The tiles as one row-major picture: linear, and 8 bits.
fn assemble(out: &TilePictures, width: u32, height: u32) -> (Vec<f32>, Vec<u8>) {
    let size = width as usize * height as usize * 3;
    let (mut linear, mut rgb) = (vec![0.0; size], vec![0; size]);
    for (k, tile) in out.tiles.iter().enumerate() {
        let rect = tile.rect(width, height);
        let row = rect.width() as usize * 3;
        for y in rect.y0..rect.y1 {
            let to = (y as usize * width as usize + rect.x0 as usize) * 3;
            let from = (y - rect.y0) as usize * row;
            rgb[to..to + row].copy_from_slice(&out.tile(k)[from..from + row]);
            if let Some(tile) = out.tile_linear(k) {
                linear[to..to + row].copy_from_slice(&tile[from..from + row]);
            }
        }
    }
    (linear, rgb)
}

/// A scene's name as part of a file's: the last piece of its path, without the extension.
fn file_name(scene: &str) -> String {
    Path::new(scene).file_stem().map_or_else(|| scene.to_owned(), |stem| stem.to_string_lossy().into_owned())
}

fn plot(folder: &Path, name: &str, rows: &[Row]) -> Result<(), CommandError> {
    let points = rows.iter().filter_map(|row| Some((row.ms.median, row.rms_edges?, row.samples.to_string())));
    let curve = Curve { name: "cyclorama".into(), points: points.collect() };
    let path = folder.join(format!("{}.svg", file_name(name)));
    std::fs::write(&path, error_against_time(&file_name(name), &[curve]))
        .map_err(|error| CommandError::file(&path, error))
}

fn table(rows: &[Row]) -> String {
    let mut out = format!(
        "{:<24} {:>4} {:>8} {:>8} {:>8} | {:>7} {:>7} {:>7} {:>7} | {:>9} {:>9} | {:>6} {:>6} {:>6} {:>6}\n{:<24} {:>4} {:>8} {:>8} {:>8} | {:>7} {:>7} {:>7} {:>7} | {:>9} {:>9} | {:>6} {:>6} {:>6} {:>6}\n",
        "scene",
        "n",
        "ms min",
        "median",
        "max",
        "geom",
        "raster",
        "transl",
        "resolve",
        "rms edge",
        "rms all",
        "edge",
        "plain",
        "magn",
        "minif",
        "",
        "",
        "",
        "",
        "",
        "ms",
        "ms",
        "ms",
        "ms",
        "linear",
        "linear",
        "rms",
        "max",
        "p99",
        "p99"
    );
    for row in rows {
        let number = |value: Option<f64>, digits: usize| value.map_or("-".into(), |v| format!("{v:.digits$}"));
        let linear = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:.2e}"));
        let e = row.errors_255;
        out.push_str(&format!(
            "{:<24} {:>4} {:>8.2} {:>8.2} {:>8.2} | {:>7.2} {:>7.2} {:>7.2} {:>7.2} | {:>9} {:>9} | {:>6} {:>6} {:>6} {:>6}\n",
            file_name(&row.scene),
            row.samples,
            row.ms.min,
            row.ms.median,
            row.ms.max,
            row.stage_ms.geometry,
            row.stage_ms.raster,
            row.stage_ms.translucency,
            row.stage_ms.resolve,
            linear(row.rms_edges),
            linear(row.rms_all),
            number(e.map(|e| e.edges_rms), 2),
            number(e.map(|e| e.untextured_max), 2),
            number(e.map(|e| e.magnified_p99), 2),
            number(e.map(|e| e.minified_p99), 2),
        ));
    }
    out
}
