//! `cyclorama bench chain --flight`: a long flight in which every few seconds a random board is killed, stopped, cut off, asked to leave or added, or its link to the
//! backplane is silent one way, slowed, limited, loses a segment or is reset; every view is compared with an undisturbed flight's.

use super::chain::Random;
use super::fleet::{self, Fleet, Look, Plan, said};
use crate::cli::ChainArgs;
use crate::error::CommandError;
use crate::output::{note, say};
use ::bench::Report;
use ::bench::disturbed::{Row, Undisturbed, figures, table};
use ::bench::relay::{Relay, Slowness, Way};
use manager::host::camera::CameraFile;
use rustix::process::Signal;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::time::{Duration, Instant};

/// How long a board is silent, cut off or slowed: long enough to be put out.
const ABSENCE: Duration = Duration::from_secs(1);
/// What is lost so long after it was touched, is lost for another reason.
const CONSEQUENCES: Duration = Duration::from_secs(4);
/// Boards that fly besides those that were asked for, at most.
const EXTRA: usize = 2;

/// How long a slowed link takes each way, and how much longer at most: another site's.
const DELAY: [Duration; 2] = [Duration::from_millis(20), Duration::from_millis(10)];
/// What passes over a limited link each way, bytes a second: a moving eye's lists, just about.
const RATE: u32 = 64 << 10;

/// What is done to a board, or to its link to the backplane.
const DEEDS: [Deed; 11] = [
    Deed::Kill,
    Deed::Stop,
    Deed::Cut,
    Deed::Add,
    Deed::Leave,
    Deed::Deafen,
    Deed::Mute,
    Deed::Slow,
    Deed::Limit,
    Deed::Lose,
    Deed::Reset,
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Deed {
    Kill,
    Stop,
    Cut,
    Add,
    Leave,
    Deafen,
    Mute,
    Slow,
    Limit,
    Lose,
    Reset,
}

impl Deed {
    fn done(self) -> &'static str {
        match self {
            Self::Kill => "killed",
            Self::Stop => "stopped",
            Self::Cut => "cut off",
            Self::Add => "added",
            Self::Leave => "asked to leave",
            Self::Deafen => "deafened",
            Self::Mute => "not heard",
            Self::Slow => "slowed",
            Self::Limit => "limited",
            Self::Lose => "missing a segment",
            Self::Reset => "reset",
        }
    }

    /// Begins what is done to a link. A deed that isn't one does nothing to it.
    fn begin(self, relay: &Relay, seed: u64) {
        let slow = |slowness| [Way::There, Way::Back].map(|way| relay.slow(way, slowness));
        match self {
            Self::Cut => relay.silence(),
            Self::Deafen => relay.silence_one(Way::Back),
            Self::Mute => relay.silence_one(Way::There),
            Self::Slow => {
                let [delay, jitter] = DELAY;
                slow(Slowness { delay, jitter, rate: None, seed });
            }
            Self::Limit => {
                slow(Slowness { rate: Some(RATE), ..Slowness::default() });
            }
            Self::Lose => relay.lose(if seed.is_multiple_of(2) { Way::There } else { Way::Back }),
            Self::Reset => relay.reset(),
            Self::Kill | Self::Stop | Self::Add | Self::Leave => {}
        }
    }
}

/// Runs the command; `seconds` long.
pub(super) fn disturbed(args: &ChainArgs, seconds: f64) -> Result<(), CommandError> {
    let folder = tempfile::tempdir().map_err(said)?;
    let camera = fleet::camera(&args.fleet, folder.path())?;
    let (reference, flown) = (folder.path().join("undisturbed.jsonl"), folder.path().join("disturbed.jsonl"));
    note("the undisturbed flight …");
    let undisturbed = undisturbed(args, &camera, &reference)?;
    note(&format!(
        "seed {}; {} poses; {seconds:.0} s, something is done every {:.0} s …",
        args.seed,
        undisturbed.len(),
        args.every
    ));
    let plan = Plan { manifest: Some(&flown), relays: true, ..Plan::new(&args.fleet, &camera) };
    let mut flight = Flight {
        fleet: Fleet::start(plan)?,
        random: Random(args.seed),
        touched: BTreeMap::new(),
        counts: [0; DEEDS.len()],
    };
    let mut row = flight.fly(args, seconds)?;
    drop(flight);
    let manifest = File::open(&flown).map_err(|error| CommandError::file(&flown, error))?;
    row.compared = undisturbed.compare(BufReader::new(manifest)).map_err(said)?;
    let (shown, figures) = (table(&row), figures(&row));
    if args.json {
        say(&serde_json::to_string(&Report::new("chain", vec![row], figures)).map_err(said)?);
    } else {
        say(shown.trim_end());
        figures.iter().for_each(|figure| say(&figure.to_string()));
    }
    Ok(())
}

/// Every pose of the path in lock-step, by a rig of the same views.
fn undisturbed(args: &ChainArgs, camera: &Path, manifest: &Path) -> Result<Undisturbed, CommandError> {
    let poses = CameraFile::read(camera)?.poses.len();
    let mut rig = fleet::program()?;
    rig.args(["rig", &args.fleet.scene, "--camera"]).arg(camera).arg("--manifest").arg(manifest);
    let size = format!("{}x{}", args.fleet.size.0, args.fleet.size.1);
    rig.args(["--size", &size, "--samples", "1", "--views", &args.fleet.views.to_string()]);
    rig.args(["--boards", "1", "--frames", &poses.to_string()]);
    let output = rig.output().map_err(said)?;
    if !output.status.success() {
        return Err(said(format!(
            "the undisturbed flight failed: {}",
            String::from_utf8_lossy(&output.stderr).trim_end()
        )));
    }
    let file = File::open(manifest).map_err(|error| CommandError::file(manifest, error))?;
    Undisturbed::read(BufReader::new(file)).map_err(said)
}

struct Flight<'a> {
    fleet: Fleet<'a>,
    random: Random,
    /// When something was last done to the board of that name.
    touched: BTreeMap<String, Instant>,
    counts: [usize; DEEDS.len()],
}

impl Flight<'_> {
    fn fly(&mut self, args: &ChainArgs, seconds: f64) -> Result<Row, CommandError> {
        let before = self.fleet.manager_size()?;
        let (started, length) = (Instant::now(), Duration::from_secs_f64(seconds));
        let every = Duration::from_secs_f64(args.every);
        let (mut looked, mut expelled, mut next) = (started, 0, started + every);
        while started.elapsed() < length {
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
            next += every;
            self.disturb(args.fleet.boards.get())?;
            let now = Instant::now();
            let look = self.fleet.look()?;
            expelled += self.expelled(&look, looked);
            looked = now;
            if self.counts.iter().sum::<usize>() % 12 == 0 {
                note(&format!("{:.0} of {seconds:.0} s", started.elapsed().as_secs_f64()));
            }
        }
        // What comes back by itself has time to.
        std::thread::sleep(CONSEQUENCES);
        let look = self.fleet.look()?;
        expelled += self.expelled(&look, looked);
        let after = self.fleet.manager_size()?;
        Ok(Row {
            seconds: started.elapsed().as_secs_f64(),
            swapped: look.count("/frames"),
            deeds: DEEDS.iter().zip(self.counts).map(|(deed, count)| (deed.done().to_owned(), count)).collect(),
            compared: ::bench::disturbed::Compared::default(),
            substituted: look.count("/streaming/frames_substituted"),
            expelled,
            processes: self.fleet.processes()?,
            files: [before.0, after.0],
            memory_mib: [before.1, after.1],
        })
    }

    /// Does something to a random board.
    fn disturb(&mut self, boards: usize) -> Result<(), CommandError> {
        let count = self.fleet.boards.len();
        let deed = match DEEDS[(self.random.next() % DEEDS.len() as u64) as usize] {
            Deed::Add if count >= boards + EXTRA => Deed::Leave,
            Deed::Leave if count <= boards => Deed::Add,
            other => other,
        };
        self.counts[DEEDS.iter().position(|other| *other == deed).unwrap_or(0)] += 1;
        let board = (self.random.next() % count as u64) as usize;
        let name = self.fleet.boards[board].name.clone();
        if deed != Deed::Add {
            self.touched.insert(name, Instant::now());
        }
        match deed {
            Deed::Kill => {
                self.fleet.signal(board, Signal::KILL)?;
                std::thread::sleep(ABSENCE);
                self.fleet.forget(board);
                self.fleet.add()?;
            }
            Deed::Stop => {
                self.fleet.signal(board, Signal::STOP)?;
                std::thread::sleep(ABSENCE);
                self.fleet.signal(board, Signal::CONT)?;
            }
            Deed::Add => self.fleet.add()?,
            Deed::Leave => {
                self.fleet.signal(board, Signal::TERM)?;
                std::thread::sleep(ABSENCE);
                self.fleet.forget(board);
            }
            Deed::Cut | Deed::Deafen | Deed::Mute | Deed::Slow | Deed::Limit | Deed::Lose | Deed::Reset => {
                let seed = self.random.next();
                if let Some(relay) = self.fleet.relay(board) {
                    deed.begin(relay, seed);
                    std::thread::sleep(ABSENCE);
                    relay.mend();
                }
            }
        }
        Ok(())
    }

    /// Boards that were lost or put out since then without having been touched.
    fn expelled(&self, look: &Look, since: Instant) -> u64 {
        let is_ours = |detail: &str, at: Instant| {
            let name = detail.strip_prefix("board ").and_then(|rest| rest.split(' ').next()).unwrap_or_default();
            self.touched.get(name).is_some_and(|touched| at < *touched + CONSEQUENCES)
        };
        let lost = look
            .events_since(since)
            .into_iter()
            .filter(|event| (event.event == "lost" || event.event == "put out") && !is_ours(&event.detail, event.at));
        lost.inspect(|event| note(&format!("untouched: {} {}", event.event, event.detail))).count() as u64
    }
}
