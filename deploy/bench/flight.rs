//! `cyclorama bench flight`: one path flown again and again, as fast as it can be drawn. What counts here isn't the typical frame but
//! the worst, and whether memory grows.

use super::look;
use crate::cli::FlightArgs;
use crate::error::CommandError;
use crate::in_process::InProcess;
use crate::output::{note, say};
use crate::source;
use ::bench::Report;
use channel::pipeline::TilePictures;
use manager::select::DetailMode;
use proto::share::Part;
use serde::Serialize;
use std::time::{Duration, Instant};

/// Frames that are drawn before time counts: buffers grow and caches fill.
const WARM_UP: Duration = Duration::from_secs(1);

/// Between two lines that say how far it is.
const PROGRESS: Duration = Duration::from_secs(30);

/// One flight.
#[derive(Clone, Debug, Serialize)]
struct Row {
    scene: String,
    size: [u32; 2],
    samples: String,
    threads: usize,
    /// How long it was flown, s, without the warm-up.
    seconds: f64,
    frames: usize,
    /// Selection and drawing.
    frame_ms: Quantiles,
    /// Resident, MiB: after the warm-up, at the end, and the most that it ever was. `None` where the system doesn't say.
    resident_mib: Option<[f64; 3]>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Quantiles {
    p50: f64,
    p99: f64,
    p999: f64,
    max: f64,
}

impl Quantiles {
    /// Of at least one value; each is a value that so great a part doesn't exceed.
    fn of(values: &mut [f32]) -> Self {
        values.sort_by(f32::total_cmp);
        let at = |part: f64| {
            let place = (part * values.len() as f64).ceil() as usize;
            f64::from(values[place.clamp(1, values.len()) - 1])
        };
        Self { p50: at(0.5), p99: at(0.99), p999: at(0.999), max: at(1.0) }
    }
}

/// Runs the command.
pub(crate) fn flight(args: &FlightArgs) -> Result<(), CommandError> {
    let source = source::load(&args.scene, args.camera.as_deref())?;
    let mut drawer = InProcess::new(&source.scene, args.threads, DetailMode::Auto)?;
    let mut out = TilePictures::new();
    let mut poses = source.camera.poses.iter().cycle();
    let mut frame = || -> Result<f32, CommandError> {
        let pose = poses.next().ok_or_else(|| CommandError::said("the camera has no pose"))?;
        let (state, view) = look(pose, args.size, &args.air, args.samples)?;
        let begun = Instant::now();
        drawer.select(pose, &state, &view)?;
        drawer.draw(&state, &view, &Part::WHOLE, &mut out)?;
        Ok((begun.elapsed().as_secs_f64() * 1e3) as f32)
    };
    let begun = Instant::now();
    while begun.elapsed() < WARM_UP {
        frame()?;
    }
    let length = Duration::from_secs_f64(args.seconds);
    // So much that the list of times is not what grows: a frame takes more than a tenth of a millisecond.
    let mut times: Vec<f32> = Vec::with_capacity((args.seconds * 10_000.0).min(1e8) as usize);
    times.extend(std::iter::repeat_n(0.0, times.capacity()));
    times.clear();
    let before = resident_mib("VmRSS");
    let (begun, mut said) = (Instant::now(), Instant::now());
    while begun.elapsed() < length {
        times.push(frame()?);
        if said.elapsed() >= PROGRESS {
            said = Instant::now();
            note(&format!("{:.0} of {:.0} s, {} frames", begun.elapsed().as_secs_f64(), args.seconds, times.len()));
        }
    }
    let row = Row {
        scene: args.scene.clone(),
        size: [args.size.0, args.size.1],
        samples: args.samples.to_string(),
        threads: args.threads.get(),
        seconds: begun.elapsed().as_secs_f64(),
        frames: times.len(),
        frame_ms: Quantiles::of(&mut times),
        resident_mib: before.zip(resident_mib("VmRSS")).zip(resident_mib("VmHWM")).map(|((a, b), c)| [a, b, c]),
    };
    if args.json {
        let report = Report::new("flight", vec![row], Vec::new());
        say(&serde_json::to_string_pretty(&report).map_err(|error| CommandError::said(error.to_string()))?);
        return Ok(());
    }
    let Quantiles { p50, p99, p999, max } = row.frame_ms;
    say(&format!(
        "{} frames in {:.0} s; a frame takes {p50:.2} ms (p50), {p99:.2} (p99), {p999:.2} (p99.9), {max:.2} at most",
        row.frames, row.seconds
    ));
    if let Some([before, after, most]) = row.resident_mib {
        say(&format!("memory: {before:.1} MiB after a second, {after:.1} at the end, {most:.1} at most"));
    }
    Ok(())
}

/// A line of what Linux says of this process, MiB.
fn resident_mib(name: &str) -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_so_many_do_not_exceed() {
        let mut values: Vec<f32> = (1..=1000).rev().map(|k| k as f32).collect();
        assert_eq!(Quantiles::of(&mut values), Quantiles { p50: 500.0, p99: 990.0, p999: 999.0, max: 1000.0 });
        assert_eq!(Quantiles::of(&mut [7.0]), Quantiles { p50: 7.0, p99: 7.0, p999: 7.0, max: 7.0 });
    }
}
