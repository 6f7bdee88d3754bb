//! `cyclorama bench console`: a rig that flies while nobody, one and twenty look at its console, by turns.
//!
//! Viewers show each picture at once, which no browser does, and are told all that a page is told. They run on this machine, yielding to the rig as
//! browsers elsewhere would. Each frame's time is read from the rig's own trace.

use super::fleet::{self, Fleet, Plan, said};
use crate::cli::ConsoleArgs;
use crate::error::CommandError;
use crate::output::{note, say};
use ::bench::Report;
use ::bench::console::{Turn, VIEWERS, figures, rows, table};
use serde_json::Value;
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tungstenite::Message;

/// After viewers have come or gone, before a turn is timed.
const SETTLE: Duration = Duration::from_millis(1500);
/// How often frames are read: the rig keeps those of some seconds.
const READ_PERIOD: Duration = Duration::from_secs(3);
/// A viewer looks this often whether the turn is over.
const LOOK_PERIOD: Duration = Duration::from_millis(500);

/// Runs the command.
pub(crate) fn console(args: &ConsoleArgs) -> Result<(), CommandError> {
    let folder = tempfile::tempdir().map_err(said)?;
    let camera = fleet::camera(&args.fleet, folder.path())?;
    let fleet = Fleet::start(Plan::new(&args.fleet, &camera))?;
    let mut rounds = Vec::new();
    for round in 0..args.rounds.get() {
        let mut order = VIEWERS;
        // Whatever grows or warms up meanwhile does so for all alike.
        order.rotate_left(round % VIEWERS.len());
        let turns = order.map(|viewers| turn(&fleet, viewers, Duration::from_secs_f64(args.seconds)));
        rounds.push(turns.into_iter().collect::<Result<Vec<_>, _>>()?);
        note(&format!("round {} of {}", round + 1, args.rounds));
    }
    drop(fleet);
    let rows = rows(&rounds);
    let (shown, figures) = (table(&rows), figures(&rows));
    if args.json {
        say(&serde_json::to_string(&Report::new("console", rows, figures)).map_err(said)?);
    } else {
        say(shown.trim_end());
        figures.iter().for_each(|figure| say(&figure.to_string()));
    }
    Ok(())
}

fn turn(fleet: &Fleet<'_>, viewers: usize, length: Duration) -> Result<Turn, CommandError> {
    let crowd = Crowd::come(fleet.console(), viewers);
    std::thread::sleep(SETTLE);
    let mut last = frames(fleet)?.last().map(|(frame, _)| *frame);
    let (started, shown) = (Instant::now(), crowd.shown.load(Ordering::Relaxed));
    let mut times = Vec::new();
    while let Some(left) = length.checked_sub(started.elapsed()).filter(|left| !left.is_zero()) {
        std::thread::sleep(left.min(READ_PERIOD));
        for (frame, ms) in frames(fleet)? {
            if last.is_none_or(|last| frame > last) {
                last = Some(frame);
                times.push(ms);
            }
        }
    }
    let seconds = started.elapsed().as_secs_f64();
    let pictures = (crowd.shown.load(Ordering::Relaxed) - shown) as f64;
    crowd.go()?;
    times.sort_by(f64::total_cmp);
    let frame_ms = *times.get(times.len() / 2).ok_or_else(|| said("no frame was shown in a whole turn"))?;
    Ok(Turn { viewers, frames: times.len(), frame_ms, pictures_hz: pictures / seconds / viewers.max(1) as f64 })
}

/// The frames that the rig remembers: number and time from open to swap, ms.
fn frames(fleet: &Fleet<'_>) -> Result<Vec<(u64, f64)>, CommandError> {
    let trace = fleet.get("/api/v1/trace")?;
    let events = trace["traceEvents"].as_array().ok_or_else(|| said("the trace has no events"))?;
    let frame = |event: &Value| Some((event["args"]["frame"].as_u64()?, event["dur"].as_f64()? / 1e3));
    Ok(events.iter().filter(|event| event["name"] == "frame").filter_map(frame).collect())
}

/// People who look.
struct Crowd {
    viewers: Vec<JoinHandle<Result<(), String>>>,
    is_over: Arc<AtomicBool>,
    shown: Arc<AtomicU64>,
}

impl Crowd {
    fn come(console: SocketAddr, count: usize) -> Self {
        let (is_over, shown) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
        let viewer = |_| {
            let (is_over, shown) = (Arc::clone(&is_over), Arc::clone(&shown));
            std::thread::spawn(move || look(console, &is_over, &shown))
        };
        Self { viewers: (0..count).map(viewer).collect(), is_over, shown }
    }

    fn go(self) -> Result<(), CommandError> {
        self.is_over.store(true, Ordering::Relaxed);
        for viewer in self.viewers {
            viewer.join().map_err(|_| said("a viewer panicked"))?.map_err(said)?;
        }
        Ok(())
    }
}

/// One viewer, until it is over.
fn look(console: SocketAddr, is_over: &AtomicBool, shown: &AtomicU64) -> Result<(), String> {
    pool::turns::go_last();
    let lost = |error: tungstenite::Error| format!("a viewer has lost the console: {error}");
    let stream = TcpStream::connect(console).map_err(|error| error.to_string())?;
    let handshake = tungstenite::client(format!("ws://{console}/api/v1/watch"), stream);
    let (mut socket, _) = handshake.map_err(|error| format!("a viewer was not let in: {error}"))?;
    socket.get_ref().set_read_timeout(Some(LOOK_PERIOD)).map_err(|error| error.to_string())?;
    while !is_over.load(Ordering::Relaxed) {
        match socket.read() {
            Ok(Message::Binary(_)) => {
                shown.fetch_add(1, Ordering::Relaxed);
                socket.send(Message::text("shown")).map_err(lost)?;
            }
            Ok(_) => {}
            Err(tungstenite::Error::Io(error))
                if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) => {}
            Err(error) => return Err(lost(error)),
        }
    }
    Ok(())
}
