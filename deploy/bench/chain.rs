//! `cyclorama bench chain`: a flying rig whose boards are killed, stopped, asked to leave and replaced, at random.

use super::disturbed::disturbed;
use super::fleet::{self, Fleet, Look, Plan, said};
use super::pair::Pair;
use crate::cli::ChainArgs;
use crate::error::CommandError;
use crate::output::{note, say};
use ::bench::Report;
use ::bench::chain::{Quantiles, Row, What, figures, table};
use rustix::process::Signal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// After a change, until the rig is as if nothing had been.
const SETTLE: Duration = Duration::from_millis(300);
/// How long what should do nothing is watched for doing something.
const WATCH: Duration = Duration::from_millis(300);

/// Times of one kind of deed.
#[derive(Default)]
struct Times {
    detect: Vec<f64>,
    repair: Vec<f64>,
    late: Vec<f64>,
    expelled: u64,
    resent: u64,
    count: usize,
}

impl Times {
    fn row(&self, what: What) -> Row {
        let Self { detect, repair, late, expelled, resent, count } = self;
        let [detect_ms, repair_ms, late_frames] = [detect, repair, late].map(|values| Quantiles::of(values));
        Row { what, count: *count, detect_ms, repair_ms, late_frames, expelled: *expelled, resent: *resent }
    }
}

/// Runs the command.
pub(crate) fn chain(args: &ChainArgs) -> Result<(), CommandError> {
    if let Some(seconds) = args.flight {
        return disturbed(args, seconds);
    }
    let folder = tempfile::tempdir().map_err(said)?;
    let camera = fleet::camera(&args.fleet, folder.path())?;
    let plan = Plan::new(&args.fleet, &camera);
    note(&format!("seed {}", args.seed));
    let mut bench = Bench { fleet: Fleet::start(plan)?, random: Random(args.seed), joined: Times::default() };
    let period = Duration::from_secs_f64(1.0 / args.fleet.rate);
    let mut rows = Vec::new();
    for (what, count) in [(What::Killed, args.kills), (What::Silent, args.silent), (What::Left, args.leaves)] {
        note(&format!("{count} times a board is {what} …"));
        let mut times = Times::default();
        for _ in 0..count {
            bench.remove(what, &mut times)?;
        }
        rows.push(times.row(what));
    }
    rows.push(bench.joined.row(What::Joined));
    note(&format!("{} times a board is stalled …", args.stalls));
    rows.push(bench.stall(args.stalls, period * 2)?.row(What::Stalled));
    note(&format!("{} times the manager is restarted …", args.restarts));
    let mut restarted = Times::default();
    for _ in 0..args.restarts {
        bench.restart(&mut restarted)?;
    }
    rows.push(restarted.row(What::Restarted));
    let Bench { fleet, mut random, .. } = bench;
    drop(fleet);
    if args.standbys > 0 {
        note(&format!("{0} times a manager with a stand-by is killed, and {0} times stopped …", args.standbys));
        let mut pair = Pair::start(Plan::new(&args.fleet, &camera))?;
        for (what, signal) in [(What::TakenOver, Signal::KILL), (What::BySilence, Signal::STOP)] {
            let mut times = Times::default();
            for _ in 0..args.standbys {
                let change = pair.change(signal, &mut random)?;
                times.detect.push(change.led_ms);
                times.repair.push(change.whole_ms);
                times.resent += change.resent;
                times.count += 1;
            }
            rows.push(times.row(what));
        }
    }
    let shown = table(&rows);
    let figures = figures(&rows);
    if args.json {
        say(&serde_json::to_string(&Report::new("chain", rows, figures)).map_err(said)?);
    } else {
        say(shown.trim_end());
        figures.iter().for_each(|figure| say(&figure.to_string()));
    }
    Ok(())
}

/// Steele, Lea and Flood's `SplitMix64`: enough to pick boards and moments.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

struct Bench<'a> {
    fleet: Fleet<'a>,
    random: Random,
    joined: Times,
}

fn ms(from: Instant, to: Instant) -> f64 {
    to.saturating_duration_since(from).as_secs_f64() * 1e3
}

impl Bench<'_> {
    fn pick(&mut self) -> usize {
        (self.random.next() % self.fleet.boards.len() as u64) as usize
    }

    /// Waits for the next moment that has nothing to do with frames.
    fn settle(&mut self) {
        std::thread::sleep(SETTLE + Duration::from_micros(self.random.next() % 50_000));
    }

    /// Takes a random board away, and brings another when the rig is whole again.
    fn remove(&mut self, what: What, times: &mut Times) -> Result<(), CommandError> {
        self.settle();
        let board = self.pick();
        let name = self.fleet.boards[board].name.clone();
        let before = self.fleet.look()?;
        let signal = match what {
            What::Silent => Signal::STOP,
            What::Left => Signal::TERM,
            _ => Signal::KILL,
        };
        let at = self.fleet.signal(board, signal)?;
        let event = match what {
            What::Silent => "put out",
            What::Left => "left",
            _ => "lost",
        };
        let (noticed, _) = self.fleet.event(event, Some(&name), at)?;
        times.detect.push(ms(at, noticed.at));
        if what != What::Left {
            let (whole, _) = self.fleet.event("whole", None, at)?;
            times.repair.push(ms(at, whole.at));
        }
        self.settle();
        let after = self.fleet.look()?;
        times.late.push(late(&before, &after));
        times.expelled += others_lost(&after, at, &name);
        times.count += 1;
        self.fleet.forget(board);
        self.join()
    }

    /// A board comes.
    fn join(&mut self) -> Result<(), CommandError> {
        let at = Instant::now();
        let before = self.fleet.look()?;
        self.fleet.add()?;
        let name = self.fleet.boards.last().map(|board| board.name.clone()).unwrap_or_default();
        let (connected, _) = self.fleet.event("connected", Some(&name), at)?;
        let (draws, _) = self.fleet.event("draws", Some(&name), at)?;
        self.joined.detect.push(ms(at, connected.at));
        self.joined.repair.push(ms(connected.at, draws.at));
        self.settle();
        let after = self.fleet.look()?;
        self.joined.late.push(late(&before, &after));
        self.joined.count += 1;
        Ok(())
    }

    /// Stops random boards for a while each, with all cores busy. Nobody may be put out for it.
    fn stall(&mut self, count: usize, length: Duration) -> Result<Times, CommandError> {
        let is_over = AtomicBool::new(false);
        let mut times = Times::default();
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get);
        std::thread::scope(|scope| {
            for _ in 0..cores {
                scope.spawn(|| {
                    while !is_over.load(Ordering::Relaxed) {
                        std::hint::spin_loop();
                    }
                });
            }
            let result = (0..count).try_for_each(|_| -> Result<(), CommandError> {
                self.settle();
                let board = self.pick();
                let before = self.fleet.look()?;
                let at = self.fleet.signal(board, Signal::STOP)?;
                std::thread::sleep(length);
                self.fleet.signal(board, Signal::CONT)?;
                std::thread::sleep(WATCH);
                let after = self.fleet.look()?;
                times.late.push(late(&before, &after));
                times.expelled += others_lost(&after, at, "");
                times.count += 1;
                Ok(())
            });
            is_over.store(true, Ordering::Relaxed);
            result
        })?;
        Ok(times)
    }

    /// Kills the manager and starts another in its place.
    fn restart(&mut self, times: &mut Times) -> Result<(), CommandError> {
        self.settle();
        let at = self.fleet.kill_manager();
        self.fleet.restart_manager()?;
        let boards = self.fleet.boards.len();
        let drawing = |look: &Look| {
            let mut drawing: Vec<_> =
                look.events_since(at).into_iter().filter(|event| event.event == "draws").collect();
            drawing.sort_by_key(|event| event.at);
            drawing
        };
        let look = self.fleet.wait("all boards draw again", |look| drawing(look).len() >= boards)?;
        times.repair.push(drawing(&look).last().map_or(f64::NAN, |event| ms(at, event.at)));
        times.resent += look.count("/streaming/pieces");
        times.count += 1;
        Ok(())
    }
}

/// Frames with views that repeated between two readings.
fn late(before: &Look, after: &Look) -> f64 {
    after.count("/late_frames").saturating_sub(before.count("/late_frames")) as f64
}

/// Boards other than this one that were lost or put out.
fn others_lost(look: &Look, since: Instant, name: &str) -> u64 {
    let start = format!("board {name} ");
    let is_loss = |event: &str| event == "lost" || event == "put out";
    let lost =
        look.events_since(since).into_iter().filter(|event| is_loss(&event.event) && !event.detail.starts_with(&start));
    lost.count() as u64
}
