//! Cut links, in real processes: chain.md's rows *partition from the backplane* and *cut link between two boards*.

use crate::program::{Daemon, daemon, free_address, stats, wait_for};
use bench::relay::Relay;
use serde_json::Value;
use std::net::SocketAddr;

/// A manager that shows a still picture at its leisure, so that nothing but the chain decides who is put out.
struct Rig {
    backplane: SocketAddr,
    console: SocketAddr,
    _manager: Daemon,
}

impl Rig {
    fn new() -> Self {
        let (backplane, console) = (free_address(), free_address());
        let (listen, page) = (backplane.to_string(), console.to_string());
        let scene = ["manager", "--scene", "runway", "--views", "1", "--size", "96x64", "--samples", "1"];
        let ports = ["--listen", &listen, "--console", &page, "--pose-listen", "127.0.0.1:0"];
        Self { backplane, console, _manager: daemon(&[&scene[..], &ports[..]].concat()) }
    }

    fn wait(&self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        wait_for(what, || stats(self.console).filter(|stats| holds(stats)))
    }
}

fn board(name: &str, backplane: SocketAddr, more: &[&str]) -> Daemon {
    let backplane = backplane.to_string();
    let args = ["channel", "--backplane", &backplane, "--name", name, "--threads", "1", "--memory-limit", "256"];
    daemon(&[&args[..], more].concat())
}

/// Events of a kind about a board, or about any.
fn count(stats: &Value, event: &str, about: &str) -> usize {
    let events = stats["events"].as_array().map_or(&[][..], Vec::as_slice);
    let is_one = |line: &&Value| line["event"] == event && line["detail"].as_str().unwrap_or_default().contains(about);
    events.iter().filter(is_one).count()
}

#[test]
fn a_board_that_is_cut_off_from_the_backplane_is_missed_and_comes_back_by_itself() {
    let rig = Rig::new();
    let relay = Relay::to(rig.backplane).unwrap();
    let _near = board("near", rig.backplane, &[]);
    let _far = board("far", relay.address, &[]);
    let before = rig.wait("two boards", |stats| stats["boards"] == 2);
    relay.silence();
    let stats = rig.wait("the far board is missed", |stats| stats["boards"] == 1);
    assert_eq!(count(&stats, "put out", "board far"), 1, "{stats}");
    assert_eq!(count(&stats, "put out", "board near"), 0, "{stats}");
    relay.mend();
    let stats = rig.wait("the far board is back", |stats| stats["boards"] == 2);
    assert_eq!(count(&stats, "joined", "board far"), 2, "{stats}");
    assert_eq!(stats["streaming"]["pieces"], before["streaming"]["pieces"], "it has kept its meshes");
}

#[test]
fn boards_whose_link_is_cut_are_kept_apart_in_the_row() {
    let rig = Rig::new();
    // Nobody can reach the first board any more when its relay is cut, so there is one order left: with it at the right end.
    let boards: Vec<(Daemon, Relay)> = ["a", "b", "c"]
        .into_iter()
        .enumerate()
        .map(|(before, name)| {
            let listen = free_address();
            let relay = Relay::to(listen).unwrap();
            let (listen, advertise) = (listen.to_string(), relay.address.to_string());
            let process = board(name, rig.backplane, &["--listen", &listen, "--advertise", &advertise]);
            rig.wait("another board", |stats| stats["boards"] == before + 1 && stats["epochs"].as_u64() > Some(0));
            (process, relay)
        })
        .collect();
    let stats = rig.wait("a wiring of three", |stats| count(stats, "wired", "3 boards") > 0);
    let epochs = stats["epochs"].as_u64().unwrap();
    boards[0].1.break_links();
    let stats = rig.wait("another wiring of three", |stats| {
        stats["epochs"].as_u64().unwrap() > epochs && count(stats, "wired", "3 boards") > 1
    });
    assert_eq!(stats["boards"], 3, "{stats}");
    assert_eq!(count(&stats, "put out", "") + count(&stats, "lost", ""), 0, "{stats}");
}
