//! `cyclorama bench pixels`: time to draw scenes, and the error of what is drawn.

use super::entrant::{Entrant, Field, How};
use super::truth::{Judged, truth};
use super::{PEER_BACKGROUND, instructions, look, peer, spread};
use crate::cli::PixelsArgs;
use crate::error::CommandError;
use crate::output::{note, say};
use crate::source::{self, Source};
use ::bench::Report;
use ::bench::chart::{Curve, error_against_time};
use ::bench::pixels::{Renderer, Row, SCENES, Setting, figures, table};
use channel::geometry::coarse::Coarse;
use channel::pipeline::Skips;
use channel::simd::SimdLevel;
use manager::host::camera::CameraPose;
use proto::view::Samples;
use std::num::NonZeroUsize;
use std::path::Path;

/// What llvmpipe offers: none and four.
const PEER_SAMPLES: [usize; 2] = [0, 4];

/// `cyclorama bench pixels`.
pub(crate) fn pixels(args: &PixelsArgs) -> Result<(), CommandError> {
    let mut args = args.clone();
    if args.peer {
        args.air.background.get_or_insert(PEER_BACKGROUND);
    }
    let default = SCENES.map(String::from);
    let scenes = if args.scenes.is_empty() { &default[..] } else { &args.scenes };
    for folder in [&args.plot, &args.diff, &args.out].into_iter().flatten() {
        std::fs::create_dir_all(folder).map_err(|error| CommandError::file(folder, error))?;
    }
    let mut rows = Vec::new();
    let mut setting = Setting {
        threads: args.threads.get(),
        no_peer: (!args.peer).then(|| "run with --peer".into()),
        no_reference: (!args.reference).then(|| "run with --reference".into()),
    };
    for name in scenes {
        note(&format!("{name} …"));
        let source = source::load(name, args.camera.as_deref())?;
        let own = scene_rows(name, &source, &args, &mut setting)?;
        if let Some(folder) = &args.plot {
            plot(folder, name, &own)?;
        }
        rows.extend(own);
    }
    let figures = figures(&rows, &setting);
    let shown = table(&rows, &figures);
    let report = Report::new("pixels", rows, figures);
    let text = serde_json::to_string(&report).map_err(|error| CommandError::said(error.to_string()))?;
    if let Some(folder) = &args.out {
        let day = report.date.get(..10).unwrap_or("undated");
        let path = folder.join(format!("pixels-{day}-{}.json", report.commit));
        std::fs::write(&path, format!("{text}\n")).map_err(|error| CommandError::file(&path, error))?;
    }
    say(if args.json { &text } else { shown.trim_end() });
    Ok(())
}

/// Measures one scene.
fn scene_rows(name: &str, source: &Source, args: &PixelsArgs, setting: &mut Setting) -> Result<Vec<Row>, CommandError> {
    let poses = spread(&source.camera, args.poses);
    // Outlives the field, which borrows it.
    let front = if name == "overdraw" && !args.alone { Some(source::load("overdraw-front", None)?) } else { None };
    let mut field = Field::new(args);
    let mut entrants = Vec::new();
    let ours = field.add(&source.scene, args.threads)?;
    for &samples in &args.samples {
        entrants.push(Entrant::new(name, How::Ours { drawer: ours, samples }, args.threads, true));
    }
    if args.ablate {
        ablate(name, source, args, &mut field, &mut entrants)?;
    }
    if name == "dense" {
        let drawer = field.add(&source.scene, NonZeroUsize::MIN)?;
        let how = How::Ours { drawer, samples: Samples::One };
        if args.threads != NonZeroUsize::MIN {
            entrants.push(Entrant::new(name, how, NonZeroUsize::MIN, false));
        }
    }
    if let Some(front) = &front {
        let drawer = field.add(&front.scene, args.threads)?;
        let how = How::Ours { drawer, samples: Samples::One };
        entrants.push(Entrant::new("overdraw-front", how, args.threads, false));
    }
    if args.peer {
        match enter_peer(name, &poses, args)? {
            Ok(child) => {
                field.peer = Some(child);
                for samples in PEER_SAMPLES {
                    entrants.push(Entrant::new(name, How::Peer { samples }, args.threads, true));
                }
            }
            Err(why) => {
                note(&format!("{name}: no llvmpipe beside it: {why}"));
                setting.no_peer.get_or_insert(why);
            }
        }
    }
    if !args.alone {
        entrants.push(Entrant::new(name, How::Memory, args.threads, false));
    }

    for (k, pose) in poses.iter().enumerate() {
        let before = poses[k.saturating_sub(1)];
        for entrant in &mut entrants {
            entrant.turn(&mut field, before, pose)?;
        }
    }
    let mut rows: Vec<Row> = entrants.iter().map(|entrant| entrant.row(args)).collect();
    if args.instructions {
        for (entrant, row) in entrants.iter().zip(&mut rows) {
            if let (How::Ours { samples, .. }, None) = (entrant.how, &row.variant) {
                note(&format!("{}: counting instructions, {samples} …", row.scene));
                row.instructions = Some(instructions::of_a_frame(&row.scene, samples, args)?);
            }
        }
    }
    if args.reference {
        judge_all(name, source, poses[poses.len() / 2], args, &mut field, &entrants, &mut rows)?;
    }
    Ok(rows)
}

/// Enters a renderer for each skip that is turned off, for each cheaper way to put vertices on the screen, and for each instruction set;
/// their rows are named by that.
fn ablate<'a>(
    name: &str,
    source: &'a Source,
    args: &PixelsArgs,
    field: &mut Field<'a>,
    entrants: &mut Vec<Entrant>,
) -> Result<(), CommandError> {
    let Some(&samples) = args.samples.first() else { return Ok(()) };
    let all = Skips::default();
    let without = [
        ("without boxes", Skips { hidden: false, ..all }),
        ("back faces late", Skips { back_faces: false, ..all }),
        ("without occlusion", Skips { occluded: false, ..all }),
        ("without whole pixels", Skips { single: false, ..all }),
        ("without opaque tiles", Skips { opaque_tiles: false, ..all }),
    ];
    for (variant, skips) in without {
        let drawer = field.add(&source.scene, args.threads)?;
        field.renderer(drawer).set_skips(skips);
        entrants.push(Entrant::new(name, How::Ours { drawer, samples }, args.threads, false).named(variant.into()));
    }
    let usual = Coarse::default();
    let cheaper = [
        ("vertices in f32", Coarse { narrow: true, ..usual }),
        ("1/64 pixel", Coarse { bits: 6, ..usual }),
        ("1/16 pixel", Coarse { bits: 4, ..usual }),
    ];
    for (variant, coarse) in cheaper {
        let drawer = field.add(&source.scene, args.threads)?;
        field.renderer(drawer).set_coarse(coarse);
        // These make other pictures.
        entrants.push(Entrant::new(name, How::Ours { drawer, samples }, args.threads, true).named(variant.into()));
    }
    for level in SimdLevel::all() {
        let drawer = field.add(&source.scene, args.threads)?;
        field.renderer(drawer).set_simd(level);
        entrants.push(Entrant::new(name, How::Ours { drawer, samples }, args.threads, false).named(level.to_string()));
    }
    Ok(())
}

/// A peer for this scene and these poses, or why there is none.
fn enter_peer(
    name: &str,
    poses: &[&CameraPose],
    args: &PixelsArgs,
) -> Result<Result<::peer::protocol::Child, String>, CommandError> {
    if poses.iter().any(|pose| !pose.entities.is_empty() || !pose.versions.is_empty()) {
        return Ok(Err("the camera moves things, which the peer does not draw".into()));
    }
    let (state, view) = look(poses[0], args.size, &args.air, Samples::One)?;
    if let Err(why) = peer::peer_look(&state, &view, 0) {
        return Ok(Err(why));
    }
    match peer::start(name, args.threads)? {
        Ok(child) if (child.samples_max as usize) < PEER_SAMPLES[1] => {
            Ok(Err(format!("{} has {} samples at most", child.renderer, child.samples_max)))
        }
        other => Ok(other),
    }
}

/// Compares everybody's picture of one pose with the reference's.
fn judge_all(
    name: &str,
    source: &Source,
    pose: &CameraPose,
    args: &PixelsArgs,
    field: &mut Field<'_>,
    entrants: &[Entrant],
    rows: &mut [Row],
) -> Result<(), CommandError> {
    let size = args.reference_size.unwrap_or(args.size);
    let (state, view) = look(pose, size, &args.air, Samples::One)?;
    note(&format!("{name}: the reference's picture, {}x{} …", size.0, size.1));
    let truth = truth(&source.scene, pose, &state, &view)?;
    for (entrant, row) in entrants.iter().zip(rows).filter(|(entrant, _)| entrant.is_judged) {
        let judged = match entrant.how {
            How::Ours { drawer, samples } => {
                let tiles = field.picture(drawer, pose, samples, size)?;
                Judged::of_tiles(&tiles, size.0, size.1)
            }
            How::Peer { samples } => {
                let look = peer::peer_look(&state, &view, samples).map_err(CommandError::said)?;
                let child = field.peer.as_mut().ok_or_else(|| CommandError::said("the peer has gone"))?;
                Judged { linear: child.picture(&look).map_err(peer::failed)?, rgb: None }
            }
            How::Memory => continue,
        };
        judged.judge(row, &truth);
        if let (Some(folder), None) = (&args.diff, &row.variant) {
            let who = match row.renderer {
                Renderer::Cyclorama => String::new(),
                other => format!("-{other}"),
            };
            let samples = row.samples.map_or(String::new(), |samples| samples.to_string());
            let path = folder.join(format!("{}{who}-{samples}.png", file_name(name)));
            judged.write_difference(&path, &truth)?;
        }
    }
    Ok(())
}

/// A scene's name as part of a file's: the last piece of its path, without the extension.
fn file_name(scene: &str) -> String {
    Path::new(scene).file_stem().map_or_else(|| scene.to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// One curve per renderer, one point per number of samples.
fn plot(folder: &Path, name: &str, rows: &[Row]) -> Result<(), CommandError> {
    let curve = |renderer: Renderer| {
        let own = rows.iter().filter(|row| row.renderer == renderer && row.variant.is_none());
        let points = own.filter_map(|row| Some((row.ms.median, row.rms_edges?, row.samples?.to_string())));
        Curve { name: renderer.to_string(), points: points.collect() }
    };
    let curves: Vec<Curve> = [Renderer::Cyclorama, Renderer::Llvmpipe].map(curve).into();
    let curves: Vec<Curve> = curves.into_iter().filter(|curve| !curve.points.is_empty()).collect();
    let path = folder.join(format!("{}.svg", file_name(name)));
    std::fs::write(&path, error_against_time(&file_name(name), &curves))
        .map_err(|error| CommandError::file(&path, error))
}
