//! A manager and its stand-by, in real processes: chain.md's row *two backplanes, stand-by takes over*.
//!
//! On a busy machine the leader may be silent for so long that the stand-by takes over unasked; so each test looks who leads before it does
//! anything to who leads.

use crate::keys::Authority;
use crate::program::{Daemon, daemon, manager, stats, wait_for, whole_lines};
use bench::relay::Relay;
use rustix::process::Signal;
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const BOARDS: usize = 3;
/// Whole pictures in a row that make a rig whole.
const WHOLE: usize = 20;

/// Where a board reaches the two backplanes.
type Ways = [SocketAddr; 2];

/// Two managers, three boards, a compositor that writes a manifest, and a host that flies.
struct Rig {
    /// Backplane, poses and console of each manager.
    ports: [[SocketAddr; 3]; 2],
    /// Where the stand-by reaches the first.
    between: SocketAddr,
    keys: Option<[PathBuf; 2]>,
    managers: [Option<Daemon>; 2],
    /// The compositor, the boards, and the host.
    others: Vec<Daemon>,
    folder: tempfile::TempDir,
}

fn and_keys<'a>(args: &[&'a str], keys: Option<&'a Path>) -> Vec<&'a str> {
    let keys = keys.map(|folder| ["--keys", folder.to_str().unwrap()]);
    [args, keys.as_ref().map_or(&[], |keys| &keys[..])].concat()
}

/// Starts a manager at these ports, which perhaps stands by.
fn start(ports: [SocketAddr; 3], stands_by_for: Option<SocketAddr>, keys: Option<&Path>) -> (Daemon, [SocketAddr; 3]) {
    let [listen, pose, console] = ports.map(|address| address.to_string());
    let leader = stands_by_for.map(|leader| leader.to_string());
    let scene = ["--scene", "runway", "--views", "2", "--size", "96x64", "--samples", "1"];
    let ports = ["--listen", &listen, "--pose-listen", &pose, "--console", &console];
    let standby = leader.as_ref().map(|leader| ["--standby", leader.as_str()]);
    let args = [&scene[..], &ports, standby.as_ref().map_or(&[], |standby| &standby[..])].concat();
    manager(&and_keys(&args, keys))
}

fn any() -> [SocketAddr; 3] {
    [SocketAddr::from(([127, 0, 0, 1], 0)); 3]
}

impl Rig {
    /// `between` is where the stand-by reaches the manager that is at that address, `ways` where each board reaches the two.
    fn new(
        authority: Option<&Authority>,
        between: impl FnOnce(SocketAddr) -> SocketAddr,
        ways: impl FnOnce([SocketAddr; 2]) -> [Ways; BOARDS],
    ) -> Self {
        let issue = |role: &str, name: &str| authority.map(|authority| authority.issue(role, name));
        let [wall, pc1] = [issue("compositor", "wall"), issue("board", "pc1")];
        let keys = authority.map(|authority| ["desk", "spare"].map(|name| authority.issue("manager", name)));
        let key = |which: usize| keys.as_ref().map(|keys| keys[which].as_path());
        let (first, at) = start(any(), None, key(0));
        let between = between(at[0]);
        let (second, second_at) = start(any(), Some(between), key(1));
        let ports = [at, second_at];

        let folder = tempfile::tempdir().unwrap();
        let flight = folder.path().join("flight.json");
        let pose = |k: u32| {
            let x = f64::from(k) / 10.0;
            json!({"t": f64::from(k) / 60.0, "eye": [x, 20, 200], "target": [x, 5, 0], "up": [0, 1, 0], "vertical_fov_deg": 45})
        };
        std::fs::write(&flight, Value::from((0..600).map(pose).collect::<Vec<_>>()).to_string()).unwrap();
        let [a, b] = ports.map(|ports| ports[0].to_string());
        let manifest = folder.path().join("manifest.jsonl");
        let manifest = manifest.to_str().unwrap();
        let compositor = ["compositor", "--backplane", &a, "--backplane", &b, "--manifest", manifest];
        let mut others = vec![daemon(&and_keys(&compositor, wall.as_deref()))];
        for (k, [a, b]) in ways(ports.map(|ports| ports[0])).into_iter().enumerate() {
            // The other way to say both.
            let (name, both) = (format!("b{k}"), format!("{a},{b}"));
            let board = ["channel", "--backplane", &both, "--name", &name, "--threads", "1", "--memory-limit", "256"];
            others.push(daemon(&and_keys(&board, pc1.as_deref())));
        }
        let [a, b] = ports.map(|ports| ports[1].to_string());
        others.push(daemon(&["host", "play", flight.to_str().unwrap(), "--to", &a, "--to", &b, "--repeat"]));
        Self { ports, between, keys, managers: [Some(first), Some(second)], others, folder }
    }

    /// Starts the first manager or the stand-by again, as it was started before.
    fn restart(&mut self, which: usize) {
        let keys = self.keys.as_ref().map(|keys| keys[which].as_path());
        let (manager, _) = start(self.ports[which], (which == 1).then_some(self.between), keys);
        self.managers[which] = Some(manager);
    }

    fn stats(&self, which: usize) -> Option<Value> {
        stats(self.ports[which][2])
    }

    /// Waits until the statistics of a manager satisfy `is_so`.
    fn wait(&self, which: usize, what: &str, is_so: impl Fn(&Value) -> bool) -> Value {
        wait_for(what, || self.stats(which).filter(|stats| is_so(stats)))
    }

    /// Waits until one leads all boards by a term, and the other one could take over; returns who leads.
    fn leader(&self) -> usize {
        // Boards must have drawn under a term to elect anybody.
        let mut first = None;
        wait_for("a leader of three boards that have the scene, and a stand-by", || {
            let both = [self.stats(0)?, self.stats(1)?];
            let leader = both.iter().position(|stats| stats["leads"] == true)?;
            let (leads, stands) = (&both[leader], &both[1 - leader]);
            let memory = leads["memory"].as_array()?;
            let is_whole = memory.len() == BOARDS && memory.iter().all(|m| m["held_bytes"] == leads["scene_bytes"]);
            let is_led = leads["term"] != 0 && leads["boards"] == BOARDS && is_whole;
            let has_boards = stands["memory"].as_array()?.len() == BOARDS;
            let has_compositor = count(stands, "connected", "compositor") > count(stands, "lost", "compositor");
            if !is_led || stands["leads"] == true || !has_boards || !has_compositor {
                first = None;
                return None;
            }
            let frames = leads["frames"].as_u64()?;
            let (since, from) = *first.get_or_insert((leader, frames));
            if since != leader {
                first = None;
            }
            (since == leader && frames > from + WHOLE as u64).then_some(leader)
        })
    }

    fn signal(&self, which: usize, signal: Signal) {
        self.managers[which].as_ref().unwrap().signal(signal);
    }

    fn kill(&mut self, which: usize) {
        self.managers[which] = None;
    }

    /// The frames that were shown, and whether all their views were whole.
    fn shown(&self) -> Vec<(u64, bool)> {
        let read = |line: &String| {
            let line: Value = serde_json::from_str(line).unwrap();
            let is_whole = line["views"].as_array().unwrap().iter().all(|view| view["complete"] == true);
            (line["frame"].as_u64().unwrap(), is_whole)
        };
        whole_lines(&self.folder.path().join("manifest.jsonl")).iter().map(read).collect()
    }

    /// Waits until so many pictures are shown as a whole, one after the other, after the first `from`.
    fn whole_after(&self, from: usize) {
        wait_for("whole pictures", || {
            let shown = self.shown();
            let whole = shown.iter().skip(from).rev().take_while(|(_, is_whole)| *is_whole).count();
            (whole >= WHOLE).then_some(())
        });
    }

    fn assert_in_order(&self) {
        let shown = self.shown();
        let wrong = shown.windows(2).find(|pair| pair[0].0 >= pair[1].0);
        assert_eq!(wrong, None, "of {} frames", shown.len());
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        if std::thread::panicking() {
            for which in [0, 1] {
                println!("manager {which}: {}", self.stats(which).unwrap_or_default());
            }
        }
    }
}

/// Events of a kind about something.
fn count(stats: &Value, event: &str, about: &str) -> usize {
    let events = stats["events"].as_array().map_or(&[][..], Vec::as_slice);
    let is_one = |line: &&Value| line["event"] == event && line["detail"].as_str().unwrap_or_default().contains(about);
    events.iter().filter(is_one).count()
}

fn straight(authority: Option<&Authority>) -> Rig {
    Rig::new(authority, |first| first, |backplanes| [backplanes; BOARDS])
}

/// Kills the leader, and sees the other lead.
fn take_over(mut rig: Rig) {
    let leader = rig.leader();
    rig.whole_after(0);
    let before = rig.shown().len();
    rig.kill(leader);
    let stats =
        rig.wait(1 - leader, "the stand-by's lead", |stats| stats["leads"] == true && stats["boards"] == BOARDS);
    rig.whole_after(before);
    rig.assert_in_order();
    let stats_now = rig.stats(1 - leader).unwrap();
    assert_eq!(stats_now["streaming"]["pieces"], 0, "nothing is sent again: {stats_now}");
    assert_eq!(count(&stats_now, "leads", "granted by a majority"), 1, "{stats}");
}

#[test]
fn a_killed_leader_is_replaced_and_nothing_is_sent_again() {
    take_over(straight(None));
}

#[test]
fn with_keys_the_stand_by_is_a_manager_of_its_own_name_and_takes_over_too() {
    let authority = Authority::new();
    take_over(straight(Some(&authority)));
}

#[test]
fn a_leader_that_was_stopped_finds_another_in_its_place() {
    let rig = straight(None);
    let old = rig.leader();
    rig.whole_after(0);
    let before = rig.shown().len();
    rig.signal(old, Signal::STOP);
    rig.wait(1 - old, "the stand-by's lead", |stats| stats["leads"] == true);
    rig.whole_after(before);
    rig.signal(old, Signal::CONT);
    let stats = rig.wait(old, "its resignation", |stats| stats["leads"] == false);
    assert!(count(&stats, "resigned", "") > 0, "{stats}");
    // From now on it shows nothing, as long as the other leads.
    let frames = stats["frames"].clone();
    let term = rig.stats(1 - old).unwrap()["term"].clone();
    let resumed = rig.shown().len();
    rig.whole_after(resumed + WHOLE);
    let (old_stats, new_stats) = (rig.stats(old).unwrap(), rig.stats(1 - old).unwrap());
    if new_stats["leads"] == true && new_stats["term"] == term {
        assert_eq!((&old_stats["leads"], &old_stats["frames"]), (&json!(false), &frames), "{old_stats}");
    }
    rig.assert_in_order();
}

#[test]
fn a_first_manager_that_is_started_again_stands_by_and_may_lead_again() {
    let mut rig = straight(None);
    let mut last = rig.leader();
    for _ in 0..2 {
        rig.kill(last);
        rig.wait(1 - last, "the other's lead", |stats| stats["leads"] == true && stats["boards"] == BOARDS);
        rig.restart(last);
        last = rig.leader();
    }
    let before = rig.shown().len();
    rig.whole_after(before);
    rig.assert_in_order();
}

#[test]
fn a_stand_by_that_only_a_minority_can_reach_does_not_lead() {
    let (mut between, mut far) = (None, None);
    let mut rig = Rig::new(
        None,
        |first| between.insert(Relay::to(first).unwrap()).address,
        |[first, second]| {
            let far = far.insert([0, 1].map(|_| Relay::to(second).unwrap()));
            [[first, far[0].address], [first, far[1].address], [first, second]]
        },
    );
    let (between, far) = (between.unwrap(), far.unwrap());
    if rig.leader() != 0 {
        println!("skipped: this machine is so busy that the stand-by leads already");
        return;
    }
    rig.whole_after(0);
    far.iter().for_each(Relay::break_links);
    between.break_links();
    rig.wait(1, "the loss of two boards and the leader", |stats| {
        stats["memory"].as_array().is_some_and(|boards| boards.len() == 1)
            && count(stats, "lost", "other backplane") > 0
    });
    let before = rig.shown().len();
    rig.whole_after(before);
    rig.kill(0);
    // It would lead within a fifth of a second. A machine so slow that it doesn't would miss the mistake, not invent one.
    let until = Instant::now() + Duration::from_secs(2);
    while Instant::now() < until {
        assert_eq!(rig.stats(1).unwrap()["leads"], false, "with one of three boards");
        std::thread::sleep(Duration::from_millis(50));
    }
    let before = rig.shown().len();
    far.iter().for_each(Relay::mend);
    rig.wait(1, "its lead with a majority", |stats| stats["leads"] == true && stats["boards"] == BOARDS);
    rig.whole_after(before);
    rig.assert_in_order();
}

#[test]
fn a_leader_that_only_a_minority_can_reach_shows_nothing_more() {
    let (mut between, mut far) = (None, None);
    let rig = Rig::new(
        None,
        |first| between.insert(Relay::to(first).unwrap()).address,
        |[first, second]| {
            let far = far.insert([0, 1].map(|_| Relay::to(first).unwrap()));
            [[far[0].address, second], [far[1].address, second], [first, second]]
        },
    );
    let (between, far) = (between.unwrap(), far.unwrap());
    if rig.leader() != 0 {
        println!("skipped: this machine is so busy that the stand-by leads already");
        return;
    }
    rig.whole_after(0);
    // Silent, not closed: nobody tells it, and it hears its compositor all the time.
    far.iter().for_each(Relay::silence);
    between.silence();
    rig.wait(1, "the stand-by's lead", |stats| stats["leads"] == true && stats["boards"] == BOARDS);
    let stats = rig.wait(0, "the old one's resignation", |stats| stats["leads"] == false);
    assert!(count(&stats, "resigned", "") > 0, "{stats}");
    let before = rig.shown().len();
    rig.whole_after(before);
    rig.assert_in_order();
}

#[test]
fn when_most_boards_are_lost_the_stand_by_consents_and_can_still_take_over() {
    let mut rig = straight(None);
    let leader = rig.leader();
    rig.whole_after(0);
    for board in [1, 2] {
        rig.others[board].signal(Signal::KILL);
    }
    rig.wait(leader, "a row of one board", |stats| stats["boards"] == 1);
    let before = rig.shown().len();
    rig.whole_after(before);
    rig.kill(leader);
    rig.wait(1 - leader, "the stand-by's lead", |stats| stats["leads"] == true && stats["boards"] == 1);
    let before = rig.shown().len();
    rig.whole_after(before);
    rig.assert_in_order();
}

#[test]
fn in_lock_step_nobody_stands_by_and_the_stand_by_is_told() {
    let scene = ["--scene", "runway", "--views", "1", "--size", "96x64", "--samples", "1", "--listen", "127.0.0.1:0"];
    let ports = ["--pose-listen", "127.0.0.1:0", "--console", "127.0.0.1:0", "--lock-step"];
    let (_leader, at) = manager(&[&scene[..], &ports].concat());
    let (_stand_by, stand_by_at) = start(any(), Some(at[0]), None);
    for (console, what) in [(at[2], "in lock-step there can be none"), (stand_by_at[2], "it flies in lock-step")] {
        let stats =
            wait_for("the refusal", || stats(console).filter(|stats| stats["events"].to_string().contains(what)));
        assert_eq!(stats["term"], 0, "{stats}");
    }
}
