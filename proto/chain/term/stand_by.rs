//! A stand-by's part: it watches the leader, and asks the boards when that is gone.

use super::{Answer, Ask, BetweenBackplanes, Quorum, Seen};
use crate::chain::backplane::BACKPLANE_BEAT;
use crate::chain::watch::{SILENCE, Watch};
use crate::ids::{BoardKey, Epoch, FrameNumber, Term};
use crate::time::Time;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

/// When a stand-by asks again, the first eight times: until boards have had time to notice that their backplane is silent.
const ASK_AGAIN: Duration = Duration::from_millis(20);
/// After that it waits twice as long each time, up to 32 times, for terms are used up by asking.
const QUICK_TRIES: u32 = 8;
const DOUBLINGS_MAX: u32 = 5;

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
    /// Lead: open a row with this quorum ([`crate::chain::BackplaneChain::in_term`]), and a clock whose first frame is this.
    Lead {
        /// The term.
        term: Term,
        /// The first frame.
        first: FrameNumber,
        /// The boards that granted it.
        quorum: Quorum,
    },
}

/// See the module's head.
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
