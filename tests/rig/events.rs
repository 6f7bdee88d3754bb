//! chain.md's table of events, row by row, in real processes. What docs/chain.md names beside these are tests of written pictures (`pictures.rs`), of
//! two backplanes, and of what peers may say (`place.rs`, `hostile.rs`, `impostor.rs`).

use crate::program::{Daemon, HANG, daemon, free_address, stats, told_lines, wait_for, whole_lines};
use bench::disturbed::Undisturbed;
use bench::relay::Relay;
use proto::chain::{FromBoardChain, ToBoardChain};
use proto::frame::REFERENCE_TILE;
use proto::ids::Term;
use proto::limits;
use proto::link::{self, Link};
use proto::message::{FromBoard, Hello, NeighbourMessage, Role, ToBoard};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};

/// A manager that shows a still picture at its leisure, so that nothing but the chain decides who is put out.
pub(crate) struct Rig {
    pub(crate) backplane: SocketAddr,
    console: SocketAddr,
    manager: Option<Daemon>,
}

impl Rig {
    pub(crate) fn new() -> Self {
        let mut rig = Self { backplane: free_address(), console: free_address(), manager: None };
        rig.start_manager();
        rig
    }

    fn start_manager(&mut self) {
        let (listen, page) = (self.backplane.to_string(), self.console.to_string());
        let scene = ["manager", "--scene", "runway", "--views", "1", "--size", "96x64", "--samples", "1"];
        // On a busy machine the picture would else become another one.
        let still = ["--lowest-resolution", "1"];
        let ports = ["--listen", &listen, "--console", &page, "--pose-listen", "127.0.0.1:0"];
        self.manager = Some(daemon(&[&scene[..], &still[..], &ports[..]].concat()));
    }

    pub(crate) fn wait(&self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        wait_for(what, || stats(self.console).filter(|stats| holds(stats)))
    }

    pub(crate) fn compositor(&self, manifest: &Path) -> Daemon {
        let backplane = self.backplane.to_string();
        daemon(&["compositor", "--backplane", &backplane, "--manifest", manifest.to_str().unwrap()])
    }
}

pub(crate) fn board(name: &str, backplane: SocketAddr, more: &[&str]) -> Daemon {
    let backplane = backplane.to_string();
    let args = ["channel", "--backplane", &backplane, "--name", name, "--threads", "1", "--memory-limit", "256"];
    daemon(&[&args[..], more].concat())
}

fn signal(daemon: &Daemon, signal: Signal) {
    let pid = Pid::from_raw(daemon.id() as i32).unwrap();
    kill_process(pid, signal).unwrap();
}

/// Events of a kind about a board, or about any.
pub(crate) fn count(stats: &Value, event: &str, about: &str) -> usize {
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

#[test]
fn a_board_that_joins_is_in_the_next_wiring_and_draws() {
    let rig = Rig::new();
    let _first = board("first", rig.backplane, &[]);
    rig.wait("a board that draws", |stats| count(stats, "draws", "board first") == 1);
    let _second = board("second", rig.backplane, &[]);
    let stats = rig.wait("another that draws", |stats| count(stats, "draws", "board second") == 1);
    assert_eq!(stats["boards"], 2, "{stats}");
    assert_eq!(count(&stats, "lost", "") + count(&stats, "put out", ""), 0, "{stats}");
}

#[test]
fn a_board_that_is_asked_to_leave_is_released() {
    let rig = Rig::new();
    let (_stays, leaves) = (board("stays", rig.backplane, &[]), board("leaves", rig.backplane, &[]));
    rig.wait("two boards that draw", |stats| count(stats, "draws", "") == 2);
    signal(&leaves, Signal::TERM);
    let stats = rig.wait("its leaving", |stats| count(stats, "left", "board leaves") == 1);
    assert_eq!(stats["boards"], 1, "{stats}");
    assert_eq!(count(&stats, "lost", "") + count(&stats, "put out", ""), 0, "{stats}");
}

#[test]
fn a_board_that_crashes_is_missed_and_the_view_is_whole_again() {
    let rig = Rig::new();
    let (_stays, crashes) = (board("stays", rig.backplane, &[]), board("crashes", rig.backplane, &[]));
    rig.wait("two boards that draw", |stats| count(stats, "draws", "") == 2);
    signal(&crashes, Signal::KILL);
    let stats = rig.wait("the whole view", |stats| count(stats, "whole", "") == 1);
    assert_eq!(count(&stats, "lost", "board crashes"), 1, "{stats}");
    assert_eq!(stats["boards"], 1, "{stats}");
}

#[test]
fn a_board_that_is_stopped_is_put_out_and_comes_back_when_it_goes_on() {
    let rig = Rig::new();
    let (_stays, stops) = (board("stays", rig.backplane, &[]), board("stops", rig.backplane, &[]));
    rig.wait("two boards that draw", |stats| count(stats, "draws", "") == 2);
    signal(&stops, Signal::STOP);
    rig.wait("its being missed", |stats| count(stats, "put out", "board stops") == 1 && stats["boards"] == 1);
    signal(&stops, Signal::CONT);
    let stats = rig.wait("its coming back", |stats| count(stats, "draws", "board stops") == 2);
    assert_eq!(stats["boards"], 2, "{stats}");
    assert_eq!(count(&stats, "put out", "board stays"), 0, "{stats}");
}

/// A board that takes its place, beats, and never draws.
struct Hung {
    backplane: Link<TcpStream>,
    right: Option<Link<TcpStream>>,
    listener: TcpListener,
}

impl Hung {
    async fn join(backplane: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let stream = TcpStream::connect(backplane).await.unwrap();
        let mut opened = link::open(stream, limits::BULK_MESSAGE_MAX).await.unwrap();
        let role = Role::Board { threads: 1, link: address, memory: 1 << 28, drawn: REFERENCE_TILE };
        link::send(&mut opened, &Hello { name: "hung".into(), role }, &[]).await.unwrap();
        let mut hung = Self { backplane: opened, right: None, listener };
        hung.say(&FromBoard::Holding { scene: None, term: Term(0), more: false }).await;
        hung
    }

    async fn say(&mut self, message: &FromBoard) {
        // It may have been put out.
        let _ = link::send(&mut self.backplane, message, &[]).await;
    }

    /// Until it is put out.
    async fn hang(mut self) {
        let mut beat = tokio::time::interval(Duration::from_millis(20));
        loop {
            tokio::select! {
                _ = beat.tick() => self.say(&FromBoard::Alive).await,
                message = link::receive::<ToBoard>(&mut self.backplane) => match message {
                    Ok(Some((ToBoard::Table { scene }, _))) => self.say(&FromBoard::Loaded { scene }).await,
                    Ok(Some((ToBoard::Chain(ToBoardChain::Id { epoch, id }), _))) => {
                        self.say(&FromBoard::Chain(FromBoardChain::Placed { epoch, id })).await;
                        if let Some(total) = self.pass_on(epoch, id).await {
                            self.say(&FromBoard::Chain(FromBoardChain::Acknowledge { epoch, id, total })).await;
                            self.say(&FromBoard::Chain(FromBoardChain::Total { epoch, total })).await;
                        }
                    }
                    Ok(Some(_)) => {}
                    _ => return,
                },
            }
        }
    }

    /// Gives the right neighbour its id, and hears the total; alone it knows that.
    async fn pass_on(&mut self, epoch: proto::ids::Epoch, id: u32) -> Option<u32> {
        if self.right.is_none() {
            let coming = tokio::time::timeout(Duration::from_millis(300), self.listener.accept()).await;
            let Ok(Ok((stream, _))) = coming else { return Some(1) };
            self.right = link::open(stream, limits::CONTROL_MESSAGE_MAX).await.ok();
        }
        let right = self.right.as_mut()?;
        loop {
            match link::expect::<NeighbourMessage>(right).await.ok()?.0 {
                NeighbourMessage::Hello { epoch: of, .. } if of == epoch => {
                    link::send(right, &NeighbourMessage::Id { epoch, id: id + 1 }, &[]).await.ok()?;
                }
                NeighbourMessage::Total { epoch: of, total } if of == epoch => return Some(total),
                _ => {}
            }
        }
    }
}

#[tokio::test]
async fn a_board_that_hangs_and_beats_is_put_out_after_a_number_of_misses() {
    let rig = Rig::new();
    rig.wait("the manager", |_| true);
    // First in the row: the others are on its right.
    let hung = tokio::spawn(Hung::join(rig.backplane).await.hang());
    let rig = tokio::task::spawn_blocking(move || {
        rig.wait("the hung board's place", |stats| count(stats, "joined", "board hung") == 1);
        let _others = [board("a", rig.backplane, &[]), board("b", rig.backplane, &[])];
        let stats = rig.wait("its being put out", |stats| count(stats, "put out", "board hung") == 1);
        let others = count(&stats, "put out", "board a") + count(&stats, "put out", "board b");
        assert_eq!(others, 0, "{stats}");
        rig.wait("frames without it", |stats| stats["boards"] == 2 && count(stats, "draws", "") == 2);
        rig
    });
    tokio::time::timeout(HANG, rig).await.unwrap().unwrap();
    tokio::time::timeout(HANG, hung).await.expect("its link is cut").unwrap();
}

/// How many frames a manifest has.
fn lines(path: &Path) -> usize {
    whole_lines(path).len()
}

#[test]
fn a_compositor_that_crashes_hangs_or_is_restarted_loses_no_board_and_begins_with_a_whole_picture() {
    let rig = Rig::new();
    let folder = tempfile::tempdir().unwrap();
    let manifests = ["first", "second"].map(|name| folder.path().join(name));
    let _boards = [board("a", rig.backplane, &[]), board("b", rig.backplane, &[])];
    let first = rig.compositor(&manifests[0]);
    rig.wait("two boards that draw", |stats| count(stats, "draws", "") == 2);
    wait_for("pictures", || (lines(&manifests[0]) > 2).then_some(()));
    // It hangs.
    signal(&first, Signal::STOP);
    let frames = |stats: &Value| stats["frames"].as_u64().unwrap_or(0);
    let before = frames(&rig.wait("statistics", |_| true));
    rig.wait("frames without it", |stats| frames(stats) > before + 60);
    signal(&first, Signal::CONT);
    let shown = lines(&manifests[0]);
    wait_for("pictures again", || (lines(&manifests[0]) > shown).then_some(()));
    // It crashes, and another comes.
    signal(&first, Signal::KILL);
    let before = frames(&rig.wait("its being missed", |stats| count(stats, "lost", "compositor") == 1));
    rig.wait("frames without it", |stats| frames(stats) > before + 60);
    let _second = rig.compositor(&manifests[1]);
    wait_for("pictures of the other", || (lines(&manifests[1]) > 2).then_some(()));
    let stats = rig.wait("statistics", |_| true);
    assert_eq!(count(&stats, "lost", "board") + count(&stats, "put out", ""), 0, "{stats}");
    // The scene is still, so every picture is that of the first line; of what was shown before a compositor came it isn't told what that depends on.
    let [flown, after] = manifests.each_ref().map(|path| told_lines(path));
    let undisturbed = Undisturbed::read(flown[0].as_bytes()).unwrap();
    let compared = [flown, after].map(|lines| undisturbed.compare(lines.concat().as_bytes()).unwrap());
    assert!(compared.iter().all(|of| of.right > 0 && of.wrong + of.unknown + of.backwards == 0), "{compared:?}");
}

#[test]
fn boards_come_back_to_a_manager_that_is_restarted_and_are_sent_nothing_again() {
    let mut rig = Rig::new();
    let _boards = [board("a", rig.backplane, &[]), board("b", rig.backplane, &[])];
    rig.wait("two boards that draw", |stats| count(stats, "draws", "") == 2);
    // SIGKILL.
    rig.manager = None;
    rig.start_manager();
    let stats = rig.wait("two boards that draw again", |stats| count(stats, "draws", "") == 2);
    assert_eq!(stats["streaming"]["pieces"], 0, "{stats}");
    assert!(stats["skipped"]["meshes_cached"].as_u64() > Some(0), "{stats}");
}
