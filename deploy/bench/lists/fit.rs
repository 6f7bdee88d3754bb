//! Finds the numbers of the cost model: draws the benchmark scenes from poses along their paths on one thread, and fits the times of whole frames to what the
//! model knows of them before they are drawn.

use crate::bench::{PEER_BACKGROUND, look, spread};
use crate::cli::{AirArgs, ListsArgs};
use crate::error::CommandError;
use crate::in_process::InProcess;
use crate::output::{note, say};
use crate::source::{self, Source};
use channel::pipeline::TilePictures;
use manager::scene::Scene;
use manager::select::cost::{self, CostModel, TERMS};
use manager::select::{DetailMode, detail};
use proto::frame::FrameState;
use proto::share::Part;
use proto::view::{Samples, View};
use std::num::NonZeroUsize;

/// What is drawn.
const SCENES: [&str; 6] = ["airport", "city", "dense", "smoke", "runway", "overdraw"];
/// Poses of each scene; those of the second kind only judge.
const POSES: NonZeroUsize = NonZeroUsize::new(24).expect("not 0");
/// Size of the picture.
const SIZE: (u32, u32) = (1280, 720);

/// A frame as the model knows it, and what drawing it took, ns.
type Row = ([f64; TERMS], f64);

/// `bench lists --fit`.
pub(super) fn fit(args: &ListsArgs) -> Result<(), CommandError> {
    let mut by_scene = Vec::new();
    for name in SCENES {
        note(&format!("{name} …"));
        let source = source::load(name, None)?;
        by_scene.push((name, measure(&source)?));
    }
    let all: Vec<Row> = by_scene.iter().flat_map(|(_, rows)| rows.iter().copied()).collect();
    // Every other frame decides, the rest judge.
    let half = |first: usize| all.iter().copied().skip(first).step_by(2).collect::<Vec<Row>>();
    let undetermined = || CommandError::said("the measurements don't determine the model");
    let (numbers, error) = cost::fit(&half(0)).ok_or_else(undetermined)?;
    let model = CostModel::of(numbers);
    let judged = error_of(numbers, &half(1));
    let scenes: Vec<_> = by_scene.iter().map(|(name, rows)| (*name, error_of(numbers, rows))).collect();
    let now = CostModel::MEASURED;
    let built_in = error_of([now.vertex, now.triangle, now.pixel, now.textured, now.layer], &all);
    if args.json {
        let report = serde_json::json!({
            "bench": "lists-fit", "frames": all.len(), "model_ns": model, "rms_relative_fitted": error,
            "rms_relative_judged": judged, "rms_relative_by_scene": scenes, "rms_relative_of_built_in": built_in,
            "rows": by_scene,
        });
        say(&report.to_string());
    } else {
        say(&format!(
            "{model:#?}\nroot mean square of the relative error: {error:.3} fitted, {judged:.3} on as many other frames"
        ));
        scenes.iter().for_each(|(name, error)| say(&format!("  {name}: {error:.3}")));
        say(&format!("of the model that is built in: {built_in:.3}"));
    }
    Ok(())
}

fn error_of(numbers: [f64; TERMS], rows: &[Row]) -> f64 {
    let relative = |(terms, value): &Row| terms.iter().zip(numbers).map(|(a, b)| a * b).sum::<f64>() / value - 1.0;
    (rows.iter().map(|row| relative(row).powi(2)).sum::<f64>() / rows.len().max(1) as f64).sqrt()
}

fn measure(source: &Source) -> Result<Vec<Row>, CommandError> {
    let mut drawer = InProcess::new(&source.scene, NonZeroUsize::MIN, DetailMode::Auto)?;
    let mut out = TilePictures::new();
    let mut rows = Vec::new();
    // A sky takes longer than what stands before it, and is no object's.
    let air = AirArgs { background: Some(PEER_BACKGROUND), ..AirArgs::default() };
    for pose in spread(&source.camera, POSES) {
        let (state, view) = look(pose, SIZE, &air, Samples::Sixteen)?;
        drawer.select(pose, &state, &view)?;
        let mut least = f64::INFINITY;
        // The fastest of three: what else the machine does is not the scene's.
        for _ in 0..3 {
            let stats = drawer.draw(&state, &view, &Part::WHOLE, &mut out)?;
            least = least.min((stats.geometry_ns + stats.raster_ns + stats.translucency_ns + stats.resolve_ns) as f64);
        }
        rows.push((terms(&source.scene, &drawer, &state, &view), least));
    }
    Ok(rows)
}

/// What the model knows of a frame: sums over what is selected of it.
fn terms(scene: &Scene, drawer: &InProcess<'_>, state: &FrameState, view: &View) -> [f64; TERMS] {
    let elements = detail::display_factor([view]);
    let mut sum = [0.0; TERMS];
    let mut objects: Vec<u32> =
        drawer.selection().subobjects.iter().map(|id| scene.table.subobjects[id.0 as usize].object.0).collect();
    objects.sort_unstable();
    objects.dedup();
    for object in objects {
        let slot = scene.blocks.slot(object);
        let (content, ball) = (scene.blocks.content(slot), scene.blocks.ball(slot));
        let covered = cost::covered(ball.radius, ball.centre.distance_squared(state.eye.position), elements);
        let terms = [
            f64::from(content.vertices),
            f64::from(content.triangles),
            covered * f64::from(content.area),
            covered * f64::from(content.textured),
            covered * f64::from(content.translucent),
        ];
        sum.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
    }
    sum
}
