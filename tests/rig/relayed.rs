//! What a slow link does, and one that is silent one way: rigs that show a still picture, one of whose boards reaches the backplane through a relay.

use crate::events::{Rig, board, count};
use crate::program::{told_lines, wait_for};
use bench::disturbed::Undisturbed;
use bench::relay::{Relay, Slowness, Way};
use serde_json::Value;
use std::time::Duration;

/// As two sites have it that are far apart.
const DELAY: Duration = Duration::from_millis(30);

/// A manager, two boards beside it, another behind a relay, and what the compositor has shown. When half of the boards are late the load is to blame: so
/// there are three.
struct Relayed {
    rig: Rig,
    relay: Relay,
    _daemons: [crate::program::Daemon; 4],
    folder: tempfile::TempDir,
    /// How many pictures there were before all boards had all of the scene: until then something is left out.
    first: usize,
}

impl Relayed {
    /// In flight, with nothing done yet.
    fn new() -> Self {
        let rig = Rig::new();
        let relay = Relay::to(rig.backplane).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let daemons = [
            board("near", rig.backplane, &[]),
            board("beside", rig.backplane, &[]),
            board("far", relay.address, &[]),
            rig.compositor(&folder.path().join("shown")),
        ];
        rig.wait("three boards that draw", |stats| count(stats, "draws", "") == 3);
        let mut relayed = Self { rig, relay, _daemons: daemons, folder, first: 0 };
        relayed.wait("boards with all of the scene", |stats| {
            let memory = stats["memory"].as_array().map_or(&[][..], Vec::as_slice);
            memory.len() == 3 && memory.iter().all(|board| board["held_bytes"] == stats["scene_bytes"])
        });
        relayed.wait_for_pictures();
        relayed.first = relayed.shown().len();
        relayed.wait_for_pictures();
        relayed
    }

    fn shown(&self) -> Vec<String> {
        told_lines(&self.folder.path().join("shown"))
    }

    fn wait_for_pictures(&self) {
        let before = self.shown().len();
        wait_for("pictures", || (self.shown().len() > before + 1).then_some(()));
    }

    /// The scene is still: every picture is that of the first whole one.
    fn all_pictures_are_right(&self) {
        let shown = &self.shown()[self.first..];
        let first = shown.iter().find(|line| !line.contains("\"complete\":false")).unwrap();
        let compared = Undisturbed::read(first.as_bytes()).unwrap().compare(shown.concat().as_bytes()).unwrap();
        assert!(compared.right > 3 && compared.wrong + compared.unknown + compared.backwards == 0, "{compared:?}");
    }

    fn wait(&self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        self.rig.wait(what, holds)
    }
}

#[test]
fn a_board_behind_a_slow_link_misses_its_frames_alone_and_is_back_when_the_link_is_fast() {
    let relayed = Relayed::new();
    for way in [Way::There, Way::Back] {
        relayed.relay.slow(way, Slowness { delay: DELAY, jitter: DELAY / 6, rate: None, seed: 1 });
    }
    // There and back takes almost four periods: no frame is ready in time, though its beats come.
    relayed.wait("its being put out", |stats| count(stats, "put out", "board far") >= 1);
    let stats = relayed.wait("the whole view", |stats| count(stats, "whole", "") >= 1);
    let others = ["near", "beside"].map(|name| {
        count(&stats, "put out", &format!("board {name}")) + count(&stats, "lost", &format!("board {name}"))
    });
    assert_eq!(others, [0; 2], "{stats}");
    relayed.wait_for_pictures();
    relayed.relay.mend();
    let drawn = count(&relayed.wait("statistics", |_| true), "draws", "board far");
    let stats = relayed.wait("its drawing again", |stats| count(stats, "draws", "board far") > drawn);
    assert_eq!(stats["boards"], 3, "{stats}");
    relayed.wait_for_pictures();
    relayed.all_pictures_are_right();
}

#[test]
fn a_board_that_is_not_heard_or_does_not_hear_is_missed_and_comes_back_by_itself() {
    for way in [Way::There, Way::Back] {
        let relayed = Relayed::new();
        let before = relayed.wait("statistics", |_| true);
        relayed.relay.silence_one(way);
        let stats = relayed.wait("its being missed", |stats| count(stats, "put out", "board far") == 1);
        assert_eq!(count(&stats, "put out", "board near"), 0, "{way:?}: {stats}");
        relayed.wait("a row without it", |stats| stats["boards"] == 2);
        relayed.wait_for_pictures();
        relayed.relay.mend();
        let stats = relayed.wait("its coming back", |stats| count(stats, "draws", "board far") == 2);
        assert_eq!(stats["boards"], 3, "{way:?}: {stats}");
        assert_eq!(stats["streaming"]["pieces"], before["streaming"]["pieces"], "{way:?}: it has kept its meshes");
        relayed.all_pictures_are_right();
    }
}
