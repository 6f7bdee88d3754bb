//! Two backplanes: which of them leads.
//!
//! A *term* numbers leaderships, above epochs: the upper bits of an epoch are its term, so whatever ignores older epochs
//! ignores lower terms. A stand-by takes over by a term that a majority of the boards grants. As in Raft, any two majorities
//! share a board; unlike Raft there is no log, for all that must not be repeated is frame numbers and epochs.
//!
//! 1. A board grants a term above all it has granted or served, if its backplane is lost or silent. From then on it serves
//!    that term only. It says which wiring it last drew under, its place there, how many boards that wiring has, and the
//!    newest frame number that it has seen.
//! 2. The stand-by counts grants under the newest wiring that any of them names, by place, so that a board that
//!    connects twice counts once. With more than half of that wiring's boards it leads, from a frame number above all it was told.
//! 3. A leader shows a frame only if more than half of its wiring's boards are ready with it ([`Quorum`]). So every frame shown
//!    was seen by a board of every majority that can elect another leader, whose first frame is above it; and once another is
//!    elected, nothing of the old one is shown. Cut off with a minority, it holds the last picture.
//! 4. A wiring is *settled* once more than half of the boards of the settled wiring before have been ready under it: then
//!    every majority of the old one knows of the new one. Until then both majorities are needed, and no further wiring
//!    takes effect. If too few are left (of two boards, one has died), the stand-by's *consent* settles it: it no longer
//!    counts grants under an older wiring.
//!
//! No clock decides anything here but when to try.

use super::backplane::{BACKPLANE_BEAT, Wiring};
use super::planted::{Bug, is_planted};
use super::watch::{SILENCE, Watch};
use crate::ids::{BoardKey, Epoch, FrameNumber, Term};
use crate::time::Time;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

/// How long a board's backplane must have been silent before another is granted a term. Three of its beats.
pub const LEADER_SILENCE: Duration = Duration::from_millis(150);
/// When a stand-by asks again, the first eight times: until boards have had time to notice that their backplane is silent.
const ASK_AGAIN: Duration = Duration::from_millis(20);
/// After that it waits twice as long each time, up to 32 times, for terms are used up by asking.
const QUICK_TRIES: u32 = 8;
const DOUBLINGS_MAX: u32 = 5;

/// Stand-by → board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Ask {
    /// The term it wants, or leads by.
    pub term: Term,
    /// It leads already, and asks a board that came later, or that it leads without.
    pub leads: bool,
}

/// Board → stand-by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Answer {
    /// The board serves this term from now on, and no lower one.
    Granted {
        /// The term.
        term: Term,
        /// The wiring that the board last drew under, if any.
        wiring: Option<Seen>,
        /// The newest frame number that it has seen.
        newest: FrameNumber,
    },
    /// The board's backplane is alive, or leads by a higher term.
    Refused {
        /// The term that the board serves.
        term: Term,
    },
}

/// A board's place in the wiring that it last drew under.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Seen {
    /// The wiring.
    pub epoch: Epoch,
    /// The board's id in it.
    pub id: u32,
    /// How many boards it has.
    pub total: u32,
}

/// Between backplanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum BetweenBackplanes {
    /// Leader → stand-by, as a beat.
    Leads {
        /// By which term.
        term: Term,
    },
    /// Leader → stand-by: count no grants under a wiring older than this.
    Consent {
        /// The wiring.
        epoch: Epoch,
    },
    /// Stand-by → leader: so be it.
    Consented {
        /// The wiring.
        epoch: Epoch,
    },
    /// Leader → stand-by: nobody can stand by here.
    Refused {
        /// Why.
        why: NoStandBy,
    },
    /// First, of who doesn't lead.
    Stands {
        /// The highest term that it has heard of.
        highest: Term,
    },
}

/// Why a backplane can't have a stand-by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum NoStandBy {
    /// It flies in lock-step, where every frame waits for everybody.
    LockStep,
    /// It has one already.
    Taken,
}

/// A board's part: which term it serves.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct BoardTerm {
    term: Term,
    wiring: Option<Seen>,
    newest: Option<FrameNumber>,
    /// When its backplane was last heard; `None`: it is lost.
    heard: Option<Time>,
}

impl BoardTerm {
    /// The term that is served.
    pub fn term(&self) -> Term {
        self.term
    }

    /// The wiring that the board last drew under, if any.
    pub fn wiring(&self) -> Option<Seen> {
        self.wiring
    }

    /// A backplane that leads by `term` speaks. Returns whether it is served; if not, what it says is not to be followed.
    pub fn on_leader(&mut self, now: Time, term: Term) -> bool {
        if term < self.term && !is_planted(Bug::TermNotCompared) {
            return false;
        }
        self.term = self.term.max(term);
        self.heard = Some(now);
        true
    }

    /// The link to the backplane that leads by `term` is lost.
    pub fn on_leader_lost(&mut self, term: Term) {
        if term == self.term {
            self.heard = None;
        }
    }

    /// A frame has been seen, drawn or not.
    pub fn on_frame(&mut self, frame: FrameNumber) {
        self.newest = self.newest.max(Some(frame));
    }

    /// A wiring is in effect.
    pub fn on_active(&mut self, wiring: Seen) {
        if self.wiring.is_none_or(|seen| seen.epoch < wiring.epoch) {
            self.wiring = Some(wiring);
        }
    }

    /// A stand-by asks.
    pub fn on_ask(&mut self, now: Time, ask: Ask) -> Answer {
        let is_led = self.heard.is_some_and(|heard| now.since(heard) < LEADER_SILENCE);
        // Only who leads by a term may have it twice: one that has lost it, and asks anew, would repeat its epochs.
        let again = ask.leads && ask.term == self.term;
        // Who leads already has its majority: the backplane that is heard has lost its own.
        if (ask.term > self.term && (!is_led || ask.leads)) || again {
            if !again {
                self.heard = None;
            }
            self.term = ask.term;
            Answer::Granted { term: ask.term, wiring: self.wiring, newest: self.newest.unwrap_or_default() }
        } else {
            Answer::Refused { term: self.term }
        }
    }
}

/// What a stand-by wants done.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum StandByOutput {
    /// Ask this board.
    Ask(BoardKey, Ask),
    /// This board is silent: close its link, and call [`StandBy::on_board_lost`].
    Drop(BoardKey),
    /// Say to every board that the stand-by is there.
    Beat,
    /// Say this to the leader.
    ToLeader(BetweenBackplanes),
    /// Lead: open a row with this quorum ([`super::BackplaneChain::in_term`]), and a clock whose first frame is this.
    Lead {
        /// The term.
        term: Term,
        /// The first frame.
        first: FrameNumber,
        /// The boards that granted it.
        quorum: Quorum,
    },
}

/// A stand-by's part: it watches the leader, and asks the boards when that is gone.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct StandBy {
    /// Which of two it is: their terms are odd and even, so that no two ask for the same one.
    rank: u64,
    /// The highest term it has heard of.
    highest: Term,
    /// It has consented to count no grants under an older wiring.
    floor: Epoch,
    leader: Watch<()>,
    watch: Watch,
    boards: BTreeSet<BoardKey>,
    grants: BTreeMap<BoardKey, (Option<Seen>, FrameNumber)>,
    /// The term that it asks for.
    asked: Option<Term>,
    again: Time,
    /// How often it has asked in vain.
    tries: u32,
    /// When its boards must hear from it.
    beat: Time,
    outputs: VecDeque<StandByOutput>,
}

impl StandBy {
    /// The stand-by of this rank, 0 or 1, which has heard of no term above `highest`. It waits for the leader's first word,
    /// or its loss.
    pub fn new(now: Time, rank: u64, highest: Term) -> Self {
        let mut leader = Watch::new(SILENCE);
        leader.on_heard(now, ());
        Self {
            rank: rank % 2,
            highest,
            // A leader without a term shows what it likes, whomever else the boards follow: from it nothing can be taken over.
            floor: Epoch::first_of(Term(1)),
            leader,
            watch: Watch::default(),
            boards: BTreeSet::new(),
            grants: BTreeMap::new(),
            asked: None,
            again: now,
            tries: 0,
            beat: now,
            outputs: VecDeque::new(),
        }
    }

    /// The leader says something.
    pub fn on_leader(&mut self, now: Time, message: BetweenBackplanes) {
        match message {
            BetweenBackplanes::Leads { term } => {
                // Boards that have granted a higher term refuse it, and it resigns: nothing is lost by waiting for that.
                self.highest = self.highest.max(term);
                self.leader.on_heard(now, ());
                // Whichever was the first, the two never ask for the same one.
                self.rank = (term.0 + 1) % 2;
                self.give_up();
            }
            // While it asks for a term, grants under an older wiring may have been counted.
            BetweenBackplanes::Consent { epoch } if self.asked.is_none() => {
                self.floor = self.floor.max(epoch);
                self.outputs.push_back(StandByOutput::ToLeader(BetweenBackplanes::Consented { epoch }));
            }
            _ => {}
        }
    }

    /// The link to the leader is lost, or couldn't be made.
    pub fn on_leader_lost(&mut self, now: Time) {
        self.leader.forget(());
        if self.asked.is_none() {
            self.ask(now);
        }
    }

    /// A board is connected.
    pub fn on_board(&mut self, now: Time, key: BoardKey) {
        self.boards.insert(key);
        self.watch.on_heard(now, key);
        if let Some(term) = self.asked {
            self.outputs.push_back(StandByOutput::Ask(key, Ask { term, leads: false }));
        }
    }

    /// A board is no longer connected. What it granted is void: it may have died, and forgotten it.
    pub fn on_board_lost(&mut self, key: BoardKey) {
        self.watch.forget(key);
        self.boards.remove(&key);
        self.grants.remove(&key);
    }

    /// A board has said something, no matter what.
    pub fn on_heard(&mut self, now: Time, key: BoardKey) {
        if self.watch.is_watched(key) {
            self.watch.on_heard(now, key);
        }
    }

    /// A board answers.
    pub fn on_answer(&mut self, key: BoardKey, answer: Answer) {
        match answer {
            Answer::Granted { term, wiring, newest } if Some(term) == self.asked && self.boards.contains(&key) => {
                self.grants.insert(key, (wiring, newest));
                self.lead_if_granted(term);
            }
            Answer::Refused { term } => self.highest = self.highest.max(term),
            Answer::Granted { .. } => {}
        }
    }

    /// When [`Self::on_timeout`] is due.
    pub fn next_timeout(&self) -> Option<Time> {
        let next = if self.asked.is_some() { Some(self.again) } else { self.leader.next_timeout() };
        let beat = (!self.boards.is_empty()).then_some(self.beat);
        [next, beat, self.watch.next_timeout()].into_iter().flatten().min()
    }

    /// Time has passed.
    pub fn on_timeout(&mut self, now: Time) {
        let is_silent = !self.leader.on_timeout(now).is_empty();
        if is_silent || (self.asked.is_some() && now >= self.again) {
            self.ask(now);
        }
        for key in self.watch.on_timeout(now) {
            self.outputs.push_back(StandByOutput::Drop(key));
        }
        if now >= self.beat && !self.boards.is_empty() {
            self.beat = now + BACKPLANE_BEAT;
            self.outputs.push_back(StandByOutput::Beat);
        }
    }

    /// The next thing to do; `None`: wait.
    pub fn poll_output(&mut self) -> Option<StandByOutput> {
        self.outputs.pop_front()
    }

    fn give_up(&mut self) {
        self.asked = None;
        self.tries = 0;
        self.grants.clear();
    }

    fn ask(&mut self, now: Time) {
        self.again = now + ASK_AGAIN * (1 << self.tries.saturating_sub(QUICK_TRIES).min(DOUBLINGS_MAX));
        self.tries += 1;
        if self.asked.is_none_or(|asked| asked <= self.highest) {
            self.grants.clear();
            self.highest = self.highest.next_of(self.rank);
            self.asked = Some(self.highest);
            // A board that already granted a higher one would say so; asking anew costs a message.
        }
        let Some(term) = self.asked else { return };
        for key in self.boards.iter().filter(|key| !self.grants.contains_key(key)) {
            self.outputs.push_back(StandByOutput::Ask(*key, Ask { term, leads: false }));
        }
    }

    fn lead_if_granted(&mut self, term: Term) {
        let newest_wiring = self.grants.values().filter_map(|(wiring, _)| *wiring).max_by_key(|wiring| wiring.epoch);
        let Some(wiring) = newest_wiring.filter(|wiring| wiring.epoch >= self.floor) else { return };
        let places: BTreeSet<u32> = self
            .grants
            .values()
            .filter_map(|(seen, _)| seen.filter(|s| s.epoch == wiring.epoch))
            .map(|s| s.id)
            .collect();
        if places.len() * 2 > wiring.total as usize {
            let newest = self.grants.values().map(|(_, newest)| *newest).max().unwrap_or_default();
            let granted = self.grants.iter().filter_map(|(key, (seen, _))| seen.map(|seen| (*key, seen)));
            let quorum = Quorum::granted(wiring, granted);
            self.outputs.push_back(StandByOutput::Lead { term, first: FrameNumber(newest.0 + 1), quorum });
            self.give_up();
            self.leader.forget(());
        }
    }
}

/// A leader's part: what a majority of its boards has seen.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Quorum {
    /// The last settled wiring, and how many boards it has.
    settled: BTreeSet<BoardKey>,
    settled_total: usize,
    /// In the first wiring of a term that was granted: the one that the grants name. More may come.
    founding: Option<Epoch>,
    /// The wiring in effect, until it is settled.
    unsettled: Option<Epoch>,
    members: BTreeSet<BoardKey>,
    /// Members that are gone since.
    gone: BTreeSet<BoardKey>,
    /// Members of the settled wiring that were ready under the one in effect.
    confirmed: BTreeSet<BoardKey>,
}

impl Quorum {
    /// The quorum of a term that these boards granted, with their places; `wiring` is the newest that they name.
    fn granted(wiring: Seen, grants: impl Iterator<Item = (BoardKey, Seen)>) -> Self {
        let mut quorum = Self { settled_total: wiring.total as usize, founding: Some(wiring.epoch), ..Self::default() };
        let mut places = BTreeSet::new();
        for (key, seen) in grants.filter(|(_, seen)| seen.epoch == wiring.epoch) {
            if places.insert(seen.id) {
                quorum.settled.insert(key);
            }
        }
        quorum
    }

    /// A board that came after the term was won has granted it too.
    pub fn on_granted(&mut self, key: BoardKey, seen: Seen) {
        if self.founding == Some(seen.epoch) && self.settled.len() < self.settled_total {
            self.settled.insert(key);
        }
    }

    /// A wiring takes effect.
    pub fn on_activated(&mut self, wiring: &Wiring) {
        self.members = wiring.members.iter().copied().collect();
        self.confirmed.clear();
        self.gone.clear();
        self.unsettled = Some(wiring.epoch);
        if self.settled_total == 0 {
            // The rig's first: there is nothing before it that another backplane could know of.
            self.settled.clone_from(&self.members);
            self.settled_total = self.members.len();
        }
    }

    /// A board was ready with a frame.
    pub fn on_ready(&mut self, key: BoardKey, epoch: Epoch) {
        if self.unsettled == Some(epoch) && self.settled.contains(&key) {
            self.confirmed.insert(key);
            if self.confirmed.len() * 2 > self.settled_total {
                self.settle();
            }
        }
    }

    /// Whether the wiring in effect is settled, so that another may take effect.
    pub fn is_settled(&self) -> bool {
        // A wiring that can't settle, for too few of those before are in it, may make room for a larger one.
        self.unsettled.is_none() || (self.founding.is_some() && self.wants_consent().is_some())
    }

    /// Whether a frame that these boards are ready with may be shown.
    pub fn may_show(&self, ready: &[BoardKey]) -> bool {
        let count = |of: &BTreeSet<BoardKey>| ready.iter().filter(|key| of.contains(key)).count();
        let carried = count(&self.members) * 2 > self.members.len();
        carried && (self.unsettled.is_none() || count(&self.settled) * 2 > self.settled_total)
    }

    /// A board is gone; should it come back, it is another one.
    pub fn on_lost(&mut self, key: BoardKey) {
        self.gone.insert(key);
    }

    /// The wiring that can't settle by itself: too few of the boards before are in it, or still there.
    pub fn wants_consent(&self) -> Option<Epoch> {
        let epoch = self.unsettled?;
        let can_confirm = |key: &&BoardKey| self.confirmed.contains(key) || !self.gone.contains(key);
        let possible = self.members.intersection(&self.settled).filter(can_confirm).count();
        (possible * 2 <= self.settled_total).then_some(epoch)
    }

    /// The stand-by has consented.
    pub fn on_consent(&mut self, epoch: Epoch) {
        if self.unsettled == Some(epoch) {
            self.settle();
        }
    }

    fn settle(&mut self) {
        self.unsettled = None;
        self.founding = None;
        self.settled.clone_from(&self.members);
        self.settled_total = self.settled.len();
    }
}
