//! The rig of `deploy/compose.yaml` on this machine's Docker engine: started, scaled, killed, paused, cut off and restarted, while what
//! is shown is compared with a rig of plain processes.
//!
//! The image holds the program under test and the libraries that it needs, so nothing is built a second time. How long things take is
//! printed and decides nothing.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test suite: a panic is a failure, and what is printed is its report"
)]

mod engine;
mod flight;
mod monitor;
mod project;

use engine::docker;
use flight::Flight;
use monitor::Monitor;
use project::{Project, number};
use std::time::{Duration, Instant};

/// So often is a board asked to leave; the machine may be busy with something else in some of them.
const LEAVES: usize = 6;

/// How long what took.
struct Log(Vec<(String, Duration)>);

impl Log {
    fn note(&mut self, what: impl Into<String>, since: Instant) {
        self.0.push((what.into(), since.elapsed()));
    }

    fn print(&self) {
        for (what, took) in &self.0 {
            println!("{:>8.2} s  {what}", took.as_secs_f64());
        }
    }
}

#[test]
fn a_composed_rig_shows_the_right_pictures_whatever_happens_to_its_containers() {
    if let Some(why) = engine::missing() {
        println!("SKIPPED: {why}");
        return;
    }
    let mut log = Log(Vec::new());
    let since = Instant::now();
    let image = engine::Image::build();
    log.note(format!("the image, {:.1} MB with this build's program", image.bytes() as f64 / 1e6), since);
    runs_alone(&image, &mut log);

    let since = Instant::now();
    let prometheus = monitor::image();
    if let Some(prometheus) = &prometheus {
        log.note(format!("Prometheus' image, {:.1} MB", prometheus.bytes() as f64 / 1e6), since);
    }

    let flight = Flight::write();
    let since = Instant::now();
    let rig = Project::up(&image, prometheus.as_ref(), &flight, 3);
    rig.picture();
    log.note("up, with new keys, to the first picture", since);
    rig.wait("three boards", |stats| number(stats, "boards") == 3);
    log.note("up, to three boards", since);
    // It reads, every five seconds, while all this happens.
    let monitor = prometheus.as_ref().map(|_| Monitor::up(&rig));
    refuses_who_has_no_keys(&rig, &image);
    is_scaled(&rig, &mut log);
    leaves_when_asked(&rig, &mut log);
    rig.compose(&["run", "--rm", "keys", "--renew"]);
    survives_what_befalls_a_board(&rig, &mut log);
    survives_the_managers_restart(&rig, &mut log);
    let since = Instant::now();
    rig.wait_healthy(&["manager", "channel"]);
    log.note("… until all are healthy", since);
    let shown = flight.shown();
    resumes_after_the_compositor(&rig, &mut log);

    let since = Instant::now();
    if let Some(monitor) = monitor {
        monitor.check();
        log.note("Prometheus asked for all of dashboard and rules", since);
    }

    let since = Instant::now();
    rig.compose(&["--profile", "metrics", "down", "--volumes"]);
    assert_eq!(rig.remains(), Vec::<String>::new(), "nothing is left");
    log.note("down", since);
    drop(rig);
    flight.compare(&shown);
    log.print();
}

/// Under the strictest settings that an engine has for a container.
fn runs_alone(image: &engine::Image, log: &mut Log) {
    let strict = ["run", "--rm", "--read-only", "--user", "65532", "--cap-drop", "ALL", "--network", "none"];
    let since = Instant::now();
    let said = docker(&[&strict[..], &[image.name(), "--version"]].concat());
    assert!(said.starts_with("cyclorama "), "{said}");
    log.note("docker run … --version", since);
    let user = docker(&["image", "inspect", "--format", "{{.Config.User}}", image.name()]);
    assert_eq!(user, "65532:65532", "not root, unless somebody asks for it");
}

/// A board without keys is in the same network, and is not let in.
fn refuses_who_has_no_keys(rig: &Project, image: &engine::Image) {
    let before = number(&rig.stats().unwrap(), "/dropped/connections");
    let network = rig.network();
    let stranger = ["channel", "--backplane", "manager:7400", "--listen", "0.0.0.0:7410", "--insecure"];
    let label = rig.label();
    let run = ["run", "--detach", "--read-only", "--network", &network, "--label", &label, image.name()];
    let id = docker(&[&run[..], &stranger].concat());
    rig.wait("a refused stranger", |stats| number(stats, "/dropped/connections") > before);
    assert_eq!(number(&rig.stats().unwrap(), "boards"), 3, "as many as before");
    docker(&["rm", "--force", &id]);
}

/// 3 → 5 → 2 while it flies.
fn is_scaled(rig: &Project, log: &mut Log) {
    for count in [5, 2] {
        let before = rig.stats().unwrap();
        let since = Instant::now();
        rig.scale(count);
        let after = rig.wait("the row's length", |stats| number(stats, "boards") == count);
        log.note(format!("{} to {count} boards", number(&before, "boards")), since);
        rig.wait_whole();
        let new = rig.events_since(&after, &before);
        assert!(!new.contains(&"lost") && !new.contains(&"put out"), "boards that are asked to go say so: {new:?}");
    }
}

/// `docker stop` is SIGTERM: the board's share moves on before it goes, and no frame is late for it.
fn leaves_when_asked(rig: &Project, log: &mut Log) {
    let board = &rig.containers("channel")[0];
    let mut undisturbed = 0;
    for _ in 0..LEAVES {
        rig.wait("two boards", |stats| number(stats, "boards") == 2);
        rig.wait_whole();
        let before = rig.stats().unwrap();
        let since = Instant::now();
        docker(&["stop", board]);
        let took = since.elapsed();
        let after = rig.wait("one board", |stats| number(stats, "boards") == 1);
        let new = rig.events_since(&after, &before);
        assert!(new.contains(&"left") && !new.contains(&"lost"), "it is asked, so it takes its leave: {new:?}");
        let late = number(&after, "late_frames") - number(&before, "late_frames");
        undisturbed += usize::from(late == 0);
        log.0.push((format!("docker stop of a board; late frames: {late}"), took));
        docker(&["start", board]);
    }
    assert!(undisturbed > 0, "of {LEAVES} leaves each made a frame late");
}

/// A kill, a pause, a cut cable; each time the row closes up, and the board comes back.
fn survives_what_befalls_a_board(rig: &Project, log: &mut Log) {
    let (board, network) = (&rig.containers("channel")[0], &rig.network());
    let blows: [(&str, &[&str], &[&str]); 3] = [
        ("kill", &["kill", board], &["start", board]),
        ("pause", &["pause", board], &["unpause", board]),
        ("network disconnect", &["network", "disconnect", network, board], &["network", "connect", network, board]),
    ];
    for (name, blow, remedy) in blows {
        rig.wait("two boards", |stats| number(stats, "boards") == 2);
        rig.wait_whole();
        let before = rig.stats().unwrap();
        let since = Instant::now();
        docker(blow);
        let after = rig.wait("the row closing up", |stats| number(stats, "boards") == 1);
        let repaired = rig.wait("all views again", |stats| rig.events_since(stats, &before).contains(&"whole"));
        let new = rig.events_since(&after, &before);
        assert!(new.contains(&"lost") || new.contains(&"put out"), "{name}: {new:?}");
        log.note(format!("docker {name}: {}", rig.last_event(&repaired, "whole")), since);
        rig.picture();
        let since = Instant::now();
        docker(remedy);
        rig.wait("two boards again", |stats| number(stats, "boards") == 2);
        log.note(format!("docker {}: back in the row", remedy[0]), since);
    }
}

/// All come back by themselves, and the host is heard.
fn survives_the_managers_restart(rig: &Project, log: &mut Log) {
    let since = Instant::now();
    docker(&["restart", &rig.containers("manager")[0]]);
    log.note("docker restart of the manager", since);
    rig.picture();
    log.note("… to its first picture", since);
    rig.wait("two boards and poses", |stats| {
        let hears = stats["latency_ms"]["p50"].as_f64() > Some(0.0);
        number(stats, "boards") == 2 && hears
    });
    log.note("… to two boards and the host's poses", since);
    rig.wait_whole();
}

/// Pictures are stitched again, whole.
fn resumes_after_the_compositor(rig: &Project, log: &mut Log) {
    let compositor = &rig.containers("compositor")[0];
    let since = Instant::now();
    docker(&["kill", compositor]);
    docker(&["start", compositor]);
    let frame = rig.frame_of_picture();
    rig.wait_for("a new picture", || (rig.frame_of_picture() > frame).then_some(()));
    log.note("docker kill and start of the compositor, to a new picture", since);
}
