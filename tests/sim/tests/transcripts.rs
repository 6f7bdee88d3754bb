//! Transcripts: one readable file per row of chain.md's event table, with what each end of the chain says. A changed behaviour is
//! a changed file: `CYCLORAMA_RENEW=1 cargo test -p cyclorama-sim --test transcripts` writes them anew.
#![expect(clippy::unwrap_used, reason = "a test that can't go on has failed")]

use proto::chain::planted::{Bug, plant};
use proto::chain::{
    Ask, BEAT, BackplaneChain, BackplaneOutput, BoardChain, BoardOutput, BoardTerm, ClockMode, ClockOutput, FrameClock,
    FromBoardChain, LinkId, PERIOD, Quorum, SILENCE, Seen, StandBy, StandByOutput, ToBoardChain,
};
use proto::ids::{BoardKey, Epoch, FrameNumber, Term};
use proto::message::{NeighbourMessage, Swap};
use proto::time::Time;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Mutex;

static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// A rig whose messages arrive at once, in order, and are written down.
struct Stage {
    now: Time,
    backplane: BackplaneChain,
    clock: FrameClock,
    boards: BTreeMap<BoardKey, BoardChain>,
    links: BTreeMap<LinkId, (BoardKey, BoardKey)>,
    cut: Vec<(u64, u64)>,
    next_link: u64,
    text: String,
}

impl Stage {
    fn new(about: &str) -> Self {
        let mut text = String::new();
        about.lines().for_each(|line| writeln!(text, "# {}", line.trim()).unwrap());
        Self {
            now: Time(0),
            backplane: BackplaneChain::new(),
            clock: FrameClock::new(ClockMode::RealTime { period: PERIOD }, FrameNumber(0), 2),
            boards: BTreeMap::new(),
            links: BTreeMap::new(),
            cut: Vec::new(),
            next_link: 1,
            text,
        }
    }

    fn note(&mut self, what: &str) {
        writeln!(self.text, "\n{what}").unwrap();
    }

    fn line(&mut self, line: String) {
        writeln!(self.text, "    {line}").unwrap();
    }

    /// Boards of these keys fly, and a frame has been drawn. That isn't written down.
    fn flying(about: &str, boards: u64) -> Self {
        let mut stage = Self::new(about);
        (1..=boards).for_each(|key| stage.join(key));
        let length = about.lines().map(|line| line.trim().len() + 3).sum();
        stage.frame(&[]);
        stage.text.truncate(length);
        stage.note(&format!("[{boards} boards fly under {:?}]", stage.backplane.epoch()));
        stage
    }

    fn join(&mut self, key: u64) {
        self.note(&format!("board {key} holds the scene and joins"));
        self.boards.insert(BoardKey(key), BoardChain::new(BoardKey(key)));
        assert!(self.backplane.on_join(self.now, BoardKey(key), key.to_string()), "there is room");
        self.settle();
    }

    fn lost(&mut self, key: u64, what: &str) {
        self.note(what);
        self.backplane.on_lost(self.now, BoardKey(key));
        self.clock.on_lost(self.now, BoardKey(key));
        self.remove(BoardKey(key));
        self.settle();
    }

    fn remove(&mut self, key: BoardKey) {
        self.boards.remove(&key);
        self.links.retain(|_, (right, left)| *right != key && *left != key);
    }

    fn settle(&mut self) {
        loop {
            let before = self.text.len();
            while let Some(output) = self.backplane.poll_output() {
                self.on_backplane_output(output);
            }
            for key in self.boards.keys().copied().collect::<Vec<_>>() {
                while let Some(output) = self.boards.get_mut(&key).and_then(BoardChain::poll_output) {
                    self.on_board_output(key, output);
                }
            }
            if self.text.len() == before {
                return;
            }
        }
    }

    fn on_backplane_output(&mut self, output: BackplaneOutput) {
        match output {
            BackplaneOutput::Send(key, message) => {
                self.line(format!("→ board {key}: {message:?}"));
                if let Some(board) = self.boards.get_mut(&key) {
                    board.on_backplane(message);
                }
            }
            BackplaneOutput::PutOut(key, why) => {
                self.line(format!("put out board {key}: {why}"));
                self.clock.on_lost(self.now, key);
                self.remove(key);
            }
            BackplaneOutput::Released(key) => {
                self.line(format!("→ board {key}: goodbye"));
                self.remove(key);
            }
            BackplaneOutput::Closed(epoch) => self.line(format!("{epoch:?} is closed")),
            BackplaneOutput::Beat => {}
        }
    }

    fn on_board_output(&mut self, key: BoardKey, output: BoardOutput) {
        match output {
            BoardOutput::ToBackplane(message) => {
                self.line(format!("board {key} → backplane: {message:?}"));
                self.backplane.on_message(self.now, key, message);
            }
            BoardOutput::ConnectLeft { epoch, address } => {
                let left = BoardKey(address.parse().unwrap());
                if self.cut.contains(&(left.0, key.0)) || !self.boards.contains_key(&left) {
                    self.line(format!("board {key} can't connect to board {left}"));
                    self.boards.get_mut(&key).unwrap().on_link_lost(Some(epoch), None);
                } else {
                    let link = LinkId(self.next_link);
                    self.next_link += 1;
                    self.links.insert(link, (key, left));
                    self.boards.get_mut(&key).unwrap().on_left_linked(epoch, link);
                }
            }
            BoardOutput::ToNeighbour(link, message) => {
                let Some((right, left)) = self.links.get(&link).copied() else { return };
                let to = if right == key { left } else { right };
                if !matches!(message, NeighbourMessage::Hello { .. }) {
                    self.line(format!("board {key} → board {to}: {message:?}"));
                }
                if let Some(board) = self.boards.get_mut(&to) {
                    board.on_neighbour(link, message);
                }
            }
            BoardOutput::Close(link) => drop(self.links.remove(&link)),
            BoardOutput::Beat => {}
        }
    }

    /// Opens a frame; all but `missing` are ready, and its time passes.
    fn frame(&mut self, missing: &[u64]) {
        self.now = self.clock.next_timeout().unwrap().max(self.now);
        self.clock.on_timeout(self.now);
        self.swaps();
        let next = self.clock.next_frame();
        let Some(wiring) = self.backplane.on_frame(self.now, next).cloned() else {
            self.line("no board is left to draw".into());
            return self.settle();
        };
        self.settle();
        let frame = self.clock.on_open(self.now, &wiring);
        for key in wiring.members.iter().filter(|key| !missing.contains(&key.0)) {
            match self.boards.get(key).map(|board| board.place(wiring.epoch).is_some()) {
                Some(true) => self.clock.on_ready(self.now, *key, frame, wiring.epoch),
                Some(false) => self.line(format!("board {key} has no place in {:?}", wiring.epoch)),
                None => self.clock.on_lost(self.now, *key),
            }
        }
        if self.clock.open_frame().is_some() {
            self.now = self.clock.next_timeout().unwrap();
            self.clock.on_timeout(self.now);
        }
        self.swaps();
    }

    fn swaps(&mut self) {
        while let Some(ClockOutput::Swap { swap, missing, .. }) = self.clock.poll_output() {
            let missed = if missing.is_empty() { String::new() } else { format!(", missed by {missing:?}") };
            self.line(format!("swap {:?} of {:?}, views complete {:?}{missed}", swap.frame, swap.epoch, swap.complete));
            self.backplane.on_frame_over(self.now, &missing);
            self.settle();
        }
    }

    /// Time passes; only these boards beat.
    fn pass(&mut self, until: Time, beating: &[u64]) {
        while self.now < until {
            self.now = (self.now + BEAT).min(until);
            beating.iter().for_each(|key| self.backplane.on_heard(self.now, BoardKey(*key)));
            self.backplane.on_timeout(self.now);
            self.settle();
        }
    }
}

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("transcripts").join(format!("{name}.txt"))
}

fn check(name: &str, play: impl Fn() -> String) {
    let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    plant(None);
    let text = play();
    if std::env::var_os("CYCLORAMA_RENEW").is_some() {
        std::fs::write(path(name), &text).unwrap();
    }
    let kept = std::fs::read_to_string(path(name)).unwrap();
    for (i, (is, was)) in text.lines().zip(kept.lines()).enumerate() {
        assert_eq!(is, was, "{name}.txt, line {}", i + 1);
    }
    assert_eq!(text.lines().count(), kept.lines().count(), "{name}.txt");
}

fn crash() -> String {
    let mut stage = Stage::flying("Crash: the closed link says so at once; its views repeat until the next epoch.", 3);
    stage.lost(2, "board 2 is killed; its link closes");
    stage.frame(&[]);
    stage.text
}

fn leave() -> String {
    let mut stage = Stage::flying("Leave: it draws until a wiring without it is in effect; no frame is late.", 3);
    stage.note("board 1 asks to leave");
    stage.backplane.on_leave(stage.now, BoardKey(1));
    stage.settle();
    stage.note("the next frame");
    stage.frame(&[]);
    stage.text
}

fn cut_link() -> String {
    let mut stage =
        Stage::flying("Cut link between two boards: the row takes an order in which they aren't neighbours.", 3);
    stage.note("the way from board 3 to board 2 is cut; both say that their link is gone");
    stage.cut.push((2, 3));
    let epoch = stage.backplane.epoch();
    let side = proto::chain::Side::Left;
    stage.backplane.on_message(stage.now, BoardKey(3), FromBoardChain::LinkLost { epoch, side });
    stage.settle();
    stage.note("the next frame");
    stage.frame(&[]);
    stage.text
}

fn two_backplanes() -> String {
    let mut text =
        "# Two backplanes: a term is won by a majority of the boards; the lower one is refused.\n".to_string();
    let first = Term(0).next_of(0);
    let epoch = Epoch(Epoch::first_of(first).0 + 1);
    let mut boards: Vec<BoardTerm> = vec![BoardTerm::default(); 3];
    for (id, board) in boards.iter_mut().enumerate() {
        board.on_leader(Time(0), first);
        board.on_frame(FrameNumber(41));
        board.on_active(Seen { epoch, id: id as u32, total: 3 });
    }
    let mut stand_by = StandBy::new(Time(0), 1, first);
    (0..3).for_each(|key| stand_by.on_board(Time(0), BoardKey(key)));
    writeln!(text, "\nthe leader is silent for the stand-by; board 0 still hears it").unwrap();
    let asked = Time(0) + SILENCE * 4;
    boards[0].on_leader(asked, first);
    stand_by.on_leader_lost(asked);
    while let Some(output) = stand_by.poll_output() {
        match output {
            StandByOutput::Ask(key, ask) => {
                let answer = boards[key.0 as usize].on_ask(asked, ask);
                writeln!(text, "    → board {key}: {ask:?}\n    board {key} → stand-by: {answer:?}").unwrap();
                stand_by.on_answer(key, answer);
            }
            StandByOutput::Lead { term, first, .. } => {
                writeln!(text, "    it leads by {term:?}, from {first:?} on").unwrap();
            }
            _ => {}
        }
    }
    writeln!(text, "\nthe first leader says something to each").unwrap();
    for (id, board) in boards.iter_mut().enumerate() {
        let is_served = board.on_leader(asked, first);
        writeln!(text, "    board {id} serves {:?}: {is_served}", first).unwrap();
    }
    let again = boards[1].on_ask(asked, Ask { term: first, leads: false });
    writeln!(text, "\nand asks board 1 for its old term\n    board 1: {again:?}").unwrap();
    text
}

fn first_term() -> String {
    let about =
        "First term: a stand-by comes to who flies without one; the leader dies before a frame is drawn by the term.";
    let mut stage = Stage::flying(about, 3);
    let before = stage.backplane.active().unwrap().clone();
    let swap = |boards: &[BoardKey]| Swap {
        frame: FrameNumber(0),
        epoch: before.epoch,
        complete: vec![true; 2],
        boards: boards.to_vec(),
        preview: false,
        moment: None,
    };
    stage.note("a frame is shown; may the leader take a term?");
    for count in [1, 2, 3] {
        let may = stage.backplane.may_take_term(&swap(&before.members[..count]));
        stage.line(format!("with {count} of 3 boards ready: {may}"));
    }
    let mut boards: BTreeMap<BoardKey, BoardTerm> = BTreeMap::new();
    for (id, key) in before.members.iter().enumerate() {
        let board = boards.entry(*key).or_default();
        board.on_leader(stage.now, Term(0));
        board.on_frame(FrameNumber(0));
        board.on_active(Seen { epoch: before.epoch, id: id as u32, total: 3 });
    }
    let first = Term(0).next_of(0);
    stage.note(&format!("it takes {first:?}, and wires boards 1 and 2; then it is dead"));
    stage.backplane.on_term(stage.now, first);
    while let Some(output) = stage.backplane.poll_output() {
        let BackplaneOutput::Send(key @ BoardKey(1..=2), message @ ToBoardChain::Wire { epoch, .. }) = output else {
            continue;
        };
        stage.line(format!("→ board {key}: {message:?}"));
        let placed = stage.boards[&key].placed();
        let board = boards.get_mut(&key).unwrap();
        board.on_wired(epoch.term(), placed);
        board.on_leader(stage.now, epoch.term());
    }
    boards.values_mut().for_each(|board| board.on_leader_lost(board.term()));
    stage.note("the stand-by asks");
    let mut stand_by = StandBy::new(stage.now, 1, first);
    boards.keys().for_each(|key| stand_by.on_board(stage.now, *key));
    stand_by.on_leader_lost(stage.now);
    while let Some(output) = stand_by.poll_output() {
        match output {
            StandByOutput::Ask(key, ask) => {
                let answer = boards.get_mut(&key).unwrap().on_ask(stage.now, ask);
                stage.line(format!("→ board {key}: {ask:?}"));
                stage.line(format!("board {key} → stand-by: {answer:?}"));
                stand_by.on_answer(key, answer);
            }
            StandByOutput::Lead { term, first, .. } => stage.line(format!("it leads by {term:?}, from {first:?} on")),
            _ => {}
        }
    }
    stage.text
}

#[test]
fn a_first_term_without_a_frame_is_taken_over() {
    check("first-term", first_term);
}

#[test]
fn join_is_in_the_next_epoch() {
    check("join", || {
        let mut stage = Stage::flying("Join: the next epoch includes it; running frames go on.", 2);
        stage.join(3);
        stage.note("the next frame");
        stage.frame(&[]);
        stage.text
    });
}

#[test]
fn leave_drains() {
    check("leave", leave);
}

#[test]
fn crash_is_noticed_at_once() {
    check("crash", crash);
}

#[test]
fn silence_is_noticed_within_four_periods() {
    check("silence", || {
        let mut stage = Stage::flying("Loss of power: noticed by silence, within four frame periods.", 3);
        stage.note("board 2 says nothing any more");
        let until = stage.now + SILENCE;
        stage.pass(until, &[1, 3]);
        stage.note("the next frame");
        stage.frame(&[]);
        stage.text
    });
}

#[test]
fn hang_gets_less_and_is_put_out() {
    check("hang", || {
        let mut stage =
            Stage::flying("Hang: misses deadlines; its weight shrinks, then it is put out; it may rejoin.", 3);
        stage.note("board 2 beats, but is never ready");
        (0..9).for_each(|_| stage.frame(&[2]));
        stage.join(4);
        stage.frame(&[]);
        stage.text
    });
}

#[test]
fn compositor_crash_holds_up_nobody() {
    check("compositor", || {
        let about = "Compositor crash, hang, restart: in real time frames open and swap whether it shows them or not.";
        let mut stage = Stage::flying(about, 2);
        stage.note("the compositor is gone");
        stage.clock.on_compositor_lost();
        (0..2).for_each(|_| stage.frame(&[]));
        stage.text
    });
}

#[test]
fn cut_link_is_rewired_around() {
    check("cut-link", cut_link);
}

#[test]
fn partition_from_the_backplane_is_silence_and_then_a_join() {
    check("partition", || {
        let mut stage = Stage::flying("Partition from the backplane: silence, and a new key when it is back.", 2);
        stage.note("nothing comes from board 2, nor arrives there");
        let until = stage.now + SILENCE;
        stage.pass(until, &[1]);
        stage.frame(&[]);
        stage.join(3);
        stage.frame(&[]);
        stage.text
    });
}

#[test]
fn backplane_restart_begins_with_an_empty_row() {
    check("backplane-restart", || {
        let mut stage = Stage::new("Backplane restart: boards come back one by one, with what they hold.");
        stage.join(1);
        stage.join(2);
        stage.frame(&[]);
        stage.text
    });
}

#[test]
fn two_backplanes_one_leads() {
    check("two-backplanes", two_backplanes);
}

#[test]
fn stale_and_forged_messages_are_ignored() {
    check("stale-and-forged", || {
        let mut stage =
            Stage::flying("Stale, repeated, reordered or forged messages: ignored by epoch and frame number.", 2);
        let (now, old) = (stage.now, Epoch(1));
        stage.note("board 2 speaks of an epoch that is over; the backplane's old messages come again");
        for message in [
            FromBoardChain::Placed { epoch: old, id: 7 },
            FromBoardChain::Total { epoch: old, total: 9 },
            FromBoardChain::Acknowledge { epoch: old, id: 7, total: 9 },
        ] {
            stage.backplane.on_message(now, BoardKey(2), message);
        }
        for message in [
            ToBoardChain::Id { epoch: old, id: 5 },
            ToBoardChain::Activate { epoch: old, frame: FrameNumber(0), weights: vec![1; 9] },
        ] {
            stage.boards.get_mut(&BoardKey(1)).unwrap().on_backplane(message);
        }
        stage.clock.on_ready(now, BoardKey(1), FrameNumber(99), Epoch(2));
        stage.settle();
        stage.note("a board claims a place that is not its own");
        let epoch = stage.backplane.epoch();
        stage.backplane.on_message(now, BoardKey(2), FromBoardChain::Placed { epoch, id: 0 });
        stage.settle();
        stage.text
    });
}

#[test]
fn a_quorum_holds_what_a_minority_has_drawn() {
    let mut quorum = Quorum::default();
    let members: Vec<_> = (1..=3).map(BoardKey).collect();
    quorum.on_activated(&proto::chain::Wiring { epoch: Epoch(1), members: members.clone(), weights: vec![1; 3] });
    assert!(quorum.may_show(&members[..2]) && !quorum.may_show(&members[..1]));
}

#[test]
fn planted_bugs_change_transcripts() {
    let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let differs = |bug, name: &str, play: fn() -> String| {
        plant(Some(bug));
        let text = play();
        plant(None);
        text != std::fs::read_to_string(path(name)).unwrap()
    };
    assert!(differs(Bug::OldPlaceKept, "leave", leave));
    assert!(differs(Bug::AcknowledgementsNotAwaited, "crash", crash));
    assert!(differs(Bug::TermNotCompared, "two-backplanes", two_backplanes));
}
