//! A rig in real time whose processes a benchmark starts, kills, stops and adds one by one.
//!
//! Its children end with their stdin, as those of `rig` do, so none outlives the benchmark. What happens is read from the manager's own log of
//! events; its clock is brought to ours with every reading, to within half of what the reading took.

use crate::cli::FleetArgs;
use crate::error::CommandError;
use crate::serve::ManagerLine;
use crate::source;
use ::bench::relay::Relay;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A rig that doesn't do what it should after this long doesn't work.
pub(super) const HANG: Duration = Duration::from_secs(60);
/// How often the statistics are read while something is awaited: seldom enough to be no load.
const LOOK_PERIOD: Duration = Duration::from_millis(25);

/// What is flown.
#[derive(Clone, Debug)]
pub(super) struct Plan<'a> {
    pub(super) scene: &'a str,
    pub(super) camera: &'a Path,
    pub(super) views: u32,
    pub(super) boards: usize,
    pub(super) size: (u32, u32),
    pub(super) rate: f64,
    /// Where the compositor writes what it shows.
    pub(super) manifest: Option<&'a Path>,
    /// Whether each board reaches the backplane through a relay that can be cut and slowed.
    pub(super) relays: bool,
    /// Whether each view has a display of its own, instead of one compositor for all.
    pub(super) displays: bool,
}

impl<'a> Plan<'a> {
    /// As the command line has it, along that camera path.
    pub(super) fn new(args: &'a FleetArgs, camera: &'a Path) -> Self {
        let FleetArgs { scene, views, boards, size, rate } = args;
        Self {
            scene,
            camera,
            views: views.get(),
            boards: boards.get(),
            size: *size,
            rate: *rate,
            manifest: None,
            relays: false,
            displays: false,
        }
    }
}

/// Writes the path that the scene is flown along into a folder; returns its file.
pub(super) fn camera(args: &FleetArgs, folder: &Path) -> Result<PathBuf, CommandError> {
    source::load(&args.scene, None)?.camera_file(folder)
}

/// A board's process.
#[derive(Debug)]
pub(super) struct Board {
    pub(super) name: String,
    child: Child,
    relay: Option<Relay>,
}

/// The processes of a rig.
#[derive(Debug)]
pub(super) struct Fleet<'a> {
    plan: Plan<'a>,
    manager: Child,
    others: Vec<Child>,
    pub(super) boards: Vec<Board>,
    backplane: SocketAddr,
    pose: SocketAddr,
    console: SocketAddr,
    named: usize,
}

/// The manager's statistics, and our time when they were made.
#[derive(Clone, Debug)]
pub(super) struct Look {
    value: Value,
    /// When the manager's clock was zero, by ours.
    zero: Instant,
}

/// A line of the manager's log.
#[derive(Clone, Debug)]
pub(super) struct Event {
    pub(super) at: Instant,
    pub(super) event: String,
    pub(super) detail: String,
}

impl Look {
    /// A number of the statistics.
    pub(super) fn count(&self, path: &str) -> u64 {
        self.value.pointer(path).and_then(Value::as_u64).unwrap_or(0)
    }

    /// Likewise.
    pub(super) fn number(&self, path: &str) -> Option<f64> {
        self.value.pointer(path)?.as_f64()
    }

    /// Something of the statistics.
    pub(super) fn value(&self, path: &str) -> Option<&Value> {
        self.value.pointer(path)
    }

    /// What was logged after a moment, less the millisecond to which the log is rounded.
    pub(super) fn events_since(&self, since: Instant) -> Vec<Event> {
        let events = self.value["events"].as_array().map_or(&[][..], Vec::as_slice);
        let read = |event: &Value| {
            let text = |name: &str| event[name].as_str().unwrap_or_default().to_owned();
            let at = self.zero + Duration::from_secs_f64(event["time_s"].as_f64()?.max(0.0));
            Some(Event { at, event: text("event"), detail: text("detail") })
        };
        let after = |event: &Event| event.at + Duration::from_millis(1) >= since;
        events.iter().filter_map(read).filter(after).collect()
    }
}

impl<'a> Fleet<'a> {
    /// Starts manager, compositor, host and boards, and waits until all boards draw.
    pub(super) fn start(plan: Plan<'a>) -> Result<Self, CommandError> {
        let (manager, [backplane, pose, console]) = manager(&plan, [any(), any(), any()], true, None)?;
        let mut fleet =
            Self { plan, manager, others: Vec::new(), boards: Vec::new(), backplane, pose, console, named: 0 };
        let address = fleet.backplane.to_string();
        if fleet.plan.displays {
            for view in 0..fleet.plan.views {
                fleet.others.push(display(&address, view)?);
            }
        } else {
            fleet.others.push(compositor(&address, fleet.plan.manifest)?);
        }
        fleet.others.push(host(&fleet.plan, &fleet.pose.to_string())?);
        for _ in 0..fleet.plan.boards {
            fleet.add()?;
        }
        fleet.wait("all boards draw", |look| {
            let drawing = look.events_since(look.zero).iter().filter(|event| event.event == "draws").count();
            drawing >= fleet.plan.boards
        })?;
        Ok(fleet)
    }

    /// Starts another board.
    pub(super) fn add(&mut self) -> Result<(), CommandError> {
        let name = format!("b{}", self.named);
        self.named += 1;
        let relay = self.plan.relays.then(|| Relay::to(self.backplane)).transpose().map_err(said)?;
        let backplane = relay.as_ref().map_or(self.backplane, |relay| relay.address).to_string();
        let child = board(&backplane, &name)?;
        self.boards.push(Board { name, child, relay });
        Ok(())
    }

    /// Sends a board's process a signal; returns when.
    pub(super) fn signal(&self, board: usize, signal: Signal) -> Result<Instant, CommandError> {
        send(&self.boards[board].child, signal)
    }

    /// What stands between a board and the backplane, if it has a relay.
    pub(super) fn relay(&self, board: usize) -> Option<&Relay> {
        self.boards[board].relay.as_ref()
    }

    /// The manager's open files, and its resident memory, MiB.
    pub(super) fn manager_size(&self) -> Result<(usize, f64), CommandError> {
        let folder = PathBuf::from(format!("/proc/{}", self.manager.id()));
        let files = std::fs::read_dir(folder.join("fd")).map_err(said)?.count();
        let status = std::fs::read_to_string(folder.join("status")).map_err(said)?;
        let resident = status
            .lines()
            .find_map(|line| line.strip_prefix("VmRSS:")?.trim().strip_suffix("kB")?.trim().parse::<f64>().ok());
        Ok((files, resident.ok_or_else(|| said("the manager's memory is not known"))? / 1024.0))
    }

    /// How many processes are children of this one, and how many of them the rig has started and not ended.
    pub(super) fn processes(&self) -> Result<[usize; 2], CommandError> {
        let own = std::process::id().to_string();
        let is_child = |entry: std::fs::DirEntry| {
            let status = std::fs::read_to_string(entry.path().join("status")).ok()?;
            status.lines().find_map(|line| line.strip_prefix("PPid:").map(|parent| parent.trim() == own))
        };
        let entries = std::fs::read_dir("/proc").map_err(said)?;
        let children = entries.filter_map(Result::ok).filter_map(is_child).filter(|is_child| *is_child).count();
        Ok([children, 1 + self.others.len() + self.boards.len()])
    }

    /// Takes a board out of the list; its process is killed if it still runs.
    pub(super) fn forget(&mut self, board: usize) {
        end(&mut self.boards.remove(board).child);
    }

    /// Kills the manager; returns when.
    pub(super) fn kill_manager(&mut self) -> Instant {
        let now = Instant::now();
        end(&mut self.manager);
        now
    }

    /// Starts a manager where the last one was.
    pub(super) fn restart_manager(&mut self) -> Result<(), CommandError> {
        let addresses = [self.backplane, self.pose, self.console];
        (self.manager, _) = manager(&self.plan, addresses, false, None)?;
        Ok(())
    }

    /// Where its console is.
    pub(super) fn console(&self) -> SocketAddr {
        self.console
    }

    /// Asks the console for JSON.
    pub(super) fn get(&self, path: &str) -> Result<Value, CommandError> {
        get(self.console, path)
    }

    /// Reads the statistics.
    pub(super) fn look(&self) -> Result<Look, CommandError> {
        look(self.console)
    }

    /// Looks until something holds.
    pub(super) fn wait(&self, what: &str, holds: impl Fn(&Look) -> bool) -> Result<Look, CommandError> {
        let started = Instant::now();
        loop {
            // While a manager is away its console is.
            if let Ok(look) = self.look()
                && holds(&look)
            {
                return Ok(look);
            }
            if started.elapsed() > HANG {
                return Err(said(format!("waited in vain until {what}")));
            }
            std::thread::sleep(LOOK_PERIOD);
        }
    }

    /// Waits for an event after a moment, of this board if it is named; returns it and the statistics that had it.
    pub(super) fn event(&self, name: &str, board: Option<&str>, since: Instant) -> Result<(Event, Look), CommandError> {
        let of_board = board.map(|board| format!("board {board} "));
        let find = |look: &Look| {
            look.events_since(since).into_iter().find(|event| {
                event.event == name && of_board.as_ref().is_none_or(|start| event.detail.starts_with(start.as_str()))
            })
        };
        let look = self.wait(&format!("{name:?} was logged"), |look| find(look).is_some())?;
        let event = find(&look).ok_or_else(|| said("an event is gone"))?;
        Ok((event, look))
    }
}

impl Drop for Fleet<'_> {
    fn drop(&mut self) {
        for board in &mut self.boards {
            end(&mut board.child);
        }
        self.others.iter_mut().for_each(end);
        end(&mut self.manager);
    }
}

/// Asks a console for JSON.
fn get(console: SocketAddr, path: &str) -> Result<Value, CommandError> {
    let mut stream = TcpStream::connect(console).map_err(said)?;
    stream.set_read_timeout(Some(HANG)).map_err(said)?;
    write!(stream, "GET {path} HTTP/1.1\r\nHost: rig\r\nConnection: close\r\n\r\n").map_err(said)?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).map_err(said)?;
    let (_, body) = answer.split_once("\r\n\r\n").ok_or_else(|| said("the console's answer has no body"))?;
    serde_json::from_str(body).map_err(said)
}

/// Reads a manager's statistics.
pub(super) fn look(console: SocketAddr) -> Result<Look, CommandError> {
    let before = Instant::now();
    let value = get(console, "/api/v1/stats")?;
    let middle = before + before.elapsed() / 2;
    let time = value["time_s"].as_f64().ok_or_else(|| said("the statistics have no time"))?;
    let zero = middle.checked_sub(Duration::from_secs_f64(time));
    Ok(Look { value, zero: zero.ok_or_else(|| said("the statistics' time is not of today"))? })
}

/// Sends a process a signal; returns when.
pub(super) fn send(child: &Child, signal: Signal) -> Result<Instant, CommandError> {
    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    let now = Instant::now();
    kill_process(pid.ok_or_else(|| said("a process has no number"))?, signal).map_err(said)?;
    Ok(now)
}

/// Starts a board. It stays when the manager goes, and ends with its stdin all the same.
pub(super) fn board(backplanes: &str, name: &str) -> Result<Child, CommandError> {
    let mut board = own(&["channel", "--backplane", backplanes, "--name", name, "--threads", "1"])?;
    board.args(["--memory-limit", "2048"]).spawn().map_err(said)
}

/// Starts a compositor.
pub(super) fn compositor(backplanes: &str, manifest: Option<&Path>) -> Result<Child, CommandError> {
    let mut compositor = own(&["compositor", "--backplane", backplanes])?;
    if let Some(manifest) = manifest {
        compositor.arg("--manifest").arg(manifest);
    }
    compositor.spawn().map_err(said)
}

/// Starts the display of a view.
fn display(backplane: &str, view: u32) -> Result<Child, CommandError> {
    own(&["compositor", "--backplane", backplane, "--views", &view.to_string()])?.spawn().map_err(said)
}

/// Starts a host that flies.
pub(super) fn host(plan: &Plan<'_>, to: &str) -> Result<Child, CommandError> {
    let (size, rate) = (format!("{}x{}", plan.size.0, plan.size.1), plan.rate.to_string());
    let mut host = own(&["host", "play"])?;
    host.arg(plan.camera).args(["--to", to, "--size", &size, "--rate", &rate, "--repeat"]);
    host.spawn().map_err(said)
}

/// Kills a process, and waits for it.
pub(super) fn end(child: &mut Child) {
    // It may have ended by itself.
    let _ = child.kill();
    let _ = child.wait();
}

pub(super) fn any() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 0))
}

/// Starts a manager that listens there, for boards, poses and browsers, and perhaps stands by for another; returns where it listens.
pub(super) fn manager(
    plan: &Plan<'_>,
    at: [SocketAddr; 3],
    waits: bool,
    stands_by_for: Option<SocketAddr>,
) -> Result<(Child, [SocketAddr; 3]), CommandError> {
    let [backplane, pose, console] = at.map(|address| address.to_string());
    let mut command = own(&["manager", "--listen", &backplane, "--pose-listen", &pose, "--console", &console])?;
    command.args(["--scene", plan.scene, "--camera"]).arg(plan.camera).args(["--views", &plan.views.to_string()]);
    command.args(["--size", &format!("{}x{}", plan.size.0, plan.size.1), "--samples", "1"]);
    // What is measured is the rig as it was asked for.
    command.args(["--rate", &plan.rate.to_string(), "--lowest-resolution", "1"]);
    if waits {
        command.args(["--wait-for-boards", &plan.boards.to_string(), "--wait-for-compositor"]);
    }
    if let Some(leader) = stands_by_for {
        command.args(["--standby", &leader.to_string()]);
    }
    let mut child = command.stdout(Stdio::piped()).spawn().map_err(said)?;
    let stdout = child.stdout.take().ok_or_else(|| said("the manager has no stdout"))?;
    let mut lines = BufReader::new(stdout).lines().map_while(Result::ok);
    let first = lines.next().and_then(|line| serde_json::from_str(&line).ok());
    // Keeps the pipe open and empty.
    std::thread::spawn(move || lines.for_each(drop));
    match first {
        Some(ManagerLine::Listening { backplane, pose, console: Some(console) }) => {
            Ok((child, [backplane, pose, console]))
        }
        _ => {
            end(&mut child);
            Err(said("the manager did not start; its message is above"))
        }
    }
}

/// This program.
pub(super) fn program() -> Result<Command, CommandError> {
    std::env::current_exe().map(Command::new).map_err(said)
}

fn own(args: &[&str]) -> Result<Command, CommandError> {
    let mut command = program()?;
    command.args(args).arg("--supervised").stdin(Stdio::piped()).stdout(Stdio::null());
    if std::env::var_os("CYCLORAMA_LOG").is_none() {
        command.env("CYCLORAMA_LOG", "error");
    }
    Ok(command)
}

pub(super) fn said(error: impl std::fmt::Display) -> CommandError {
    CommandError::said(error.to_string())
}
