//! `cyclorama bench latency`: a rig in real time, and how long it takes from the host's packet to the swap, and how
//! far apart displays change.

use super::fleet::{self, Fleet, Look, Plan, said};
use crate::cli::LatencyArgs;
use crate::error::CommandError;
use crate::output::{note, say};
use ::bench::Report;
use ::bench::latency::{Displays, Row, Times, figures, table};
use std::time::{Duration, Instant};

/// How often it is said how far it is.
const PROGRESS_PERIOD: Duration = Duration::from_secs(30);
/// Stages by their names in the statistics.
const STAGES: [&str; 8] = ["select", "stream", "geometry", "raster", "translucency", "resolve", "transfer", "stitch"];

/// Runs the command.
pub(crate) fn latency(args: &LatencyArgs) -> Result<(), CommandError> {
    let folder = tempfile::tempdir().map_err(said)?;
    let camera = fleet::camera(&args.fleet, folder.path())?;
    let plan = Plan { displays: !args.stitched, ..Plan::new(&args.fleet, &camera) };
    let fleet = Fleet::start(plan)?;
    let length = Duration::from_secs_f64(args.seconds);
    let started = Instant::now();
    while let Some(left) = length.checked_sub(started.elapsed()).filter(|left| !left.is_zero()) {
        std::thread::sleep(left.min(PROGRESS_PERIOD));
        note(&format!("{:.0} of {:.0} s", started.elapsed().as_secs_f64(), args.seconds));
    }
    let row = row(args, &fleet.look()?);
    drop(fleet);
    let (shown, figures) = (table(&row), figures(&row));
    if args.json {
        say(&serde_json::to_string(&Report::new("latency", vec![row], figures)).map_err(said)?);
    } else {
        say(shown.trim_end());
        figures.iter().for_each(|figure| say(&figure.to_string()));
    }
    Ok(())
}

fn row(args: &LatencyArgs, look: &Look) -> Row {
    let times = |path: &str| {
        let [p50, p99, p999, max] =
            ["p50", "p99", "p999", "max"].map(|at| look.number(&format!("{path}/{at}")).unwrap_or(f64::NAN));
        Times { p50, p99, p999, max }
    };
    Row {
        scene: args.fleet.scene.clone(),
        views: args.fleet.views.get(),
        boards: args.fleet.boards.get(),
        size: [args.fleet.size.0, args.fleet.size.1],
        rate_hz: args.fleet.rate,
        seconds: look.number("/seconds").unwrap_or(0.0),
        frames: look.count("/frames"),
        late_frames: look.count("/late_frames"),
        rate_divider: look.count("/rate_divider"),
        latency: times("/latency_ms"),
        frame: times("/frame_ms"),
        displays: (!args.stitched).then(|| Displays {
            swaps: look.count("/display_swaps"),
            same: look.count("/same_frame_swaps"),
            skew: times("/swap_skew_ms"),
        }),
        stages: STAGES.map(|stage| (stage.to_owned(), times(&format!("/stage_ms/{stage}")))).to_vec(),
    }
}
