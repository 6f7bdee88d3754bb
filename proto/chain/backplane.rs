//! The backplane's end of the chain: who is in the row, and which wiring is in effect.
//!
//! Any change of the row opens a new epoch at once; a change during the opening of one opens the next. Two boards that
//! can't reach each other are kept apart: the row is tried in another order (`order`), and only when there is none is a board put
//! out. An epoch that doesn't close within `WIRING_TIMEOUT`, though nobody has said why, names a culprit, the first board that the
//! id (or the total) didn't reach; it is moved, and the second time put out. So the row always converges on boards that can
//! reach each other.
//!
//! Boards are put out as well when they are silent (`watch`), and when they miss frame after frame that most others don't
//! (`weights`). With a stand-by, what is shown needs a majority of the boards ([`Quorum`]).

use super::order::Apart;
use super::planted::{Bug, is_planted};
use super::term::{LEADER_SILENCE, Quorum, Seen};
use super::watch::{PERIOD, Watch};
use super::weights::{Verdict, Weights};
use super::{FromBoardChain, Left, Side, ToBoardChain};
use crate::ids::{BoardKey, Epoch, FrameNumber, Term};
use crate::limits;
use crate::message::Swap;
use crate::time::Time;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

/// How long a wiring may take to close. Loopback closes 16 boards in a few ms, a cabin network in tens; long enough that
/// a stalled machine is not put out, and that a board whose link can't be made says so first (300 ms); short enough that a
/// broken link doesn't hold the picture for a second.
const WIRING_TIMEOUT: Duration = Duration::from_millis(500);
/// Wirings in a row that a board may hold up, without a word why, before it is put out.
const STRIKES_MAX: u32 = 2;

/// A closed wiring: everything that shares depend on.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Wiring {
    /// Its number.
    pub epoch: Epoch,
    /// The boards in the order of their ids.
    pub members: Vec<BoardKey>,
    /// Their weights, likewise.
    pub weights: Vec<u32>,
}

/// What the backplane's chain wants done.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum BackplaneOutput {
    /// Send this to that board.
    Send(BoardKey, ToBoardChain),
    /// The board has drained: its share is drawn by others. Say goodbye to it.
    Released(BoardKey),
    /// Drop the board, and say why. The shell closes its link and calls [`BackplaneChain::on_lost`].
    PutOut(BoardKey, &'static str),
    /// A wiring has closed and waits for the next frame.
    Closed(Epoch),
    /// Say to every board in the row that the backplane is there ([`crate::message::ToBoard::Alive`]).
    Beat,
}

/// How often a backplane says that it is there. A board that has heard nothing for four beats takes its link for dead.
pub const BACKPLANE_BEAT: Duration = Duration::from_millis(250);
/// The same where a stand-by may take its place: boards grant no term to another while they hear it.
const BACKPLANE_BEAT_IN_TERM: Duration = Duration::from_millis(50);
const _: () = assert!(
    BACKPLANE_BEAT_IN_TERM.as_millis() * 3 <= LEADER_SILENCE.as_millis(),
    "a beat or two may be late before another is granted a term"
);

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Slot {
    key: BoardKey,
    address: String,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Opening {
    placed: BTreeSet<BoardKey>,
    acknowledged: BTreeSet<BoardKey>,
    total: bool,
    deadline: Time,
}

/// See the module's head.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct BackplaneChain {
    /// The boards that are to be in the row, from the left.
    row: Vec<Slot>,
    /// Boards that asked to leave and still draw under the wiring in effect.
    leaving: BTreeSet<BoardKey>,
    /// The newest epoch.
    epoch: Epoch,
    /// The newest epoch's boards in the order of their places.
    members: Vec<BoardKey>,
    opening: Option<Opening>,
    closed: Option<Wiring>,
    active: Option<Wiring>,
    apart: Apart,
    /// Wirings that each board has held up since it was last in one that closed.
    strikes: BTreeMap<BoardKey, u32>,
    watch: Watch,
    weights: Weights,
    period: Duration,
    quorum: Option<Quorum>,
    /// When the next beat is due.
    beat: Time,
    outputs: VecDeque<BackplaneOutput>,
}

impl Default for BackplaneChain {
    fn default() -> Self {
        Self::new()
    }
}

impl BackplaneChain {
    /// An empty row, of a backplane that no other may replace.
    pub fn new() -> Self {
        Self {
            row: Vec::new(),
            leaving: BTreeSet::new(),
            epoch: Epoch(0),
            members: Vec::new(),
            opening: None,
            closed: None,
            active: None,
            apart: Apart::default(),
            strikes: BTreeMap::new(),
            watch: Watch::default(),
            weights: Weights::default(),
            period: PERIOD,
            quorum: None,
            beat: Time(0),
            outputs: VecDeque::new(),
        }
    }

    /// An empty row, of a backplane that leads by `term` and that another may replace: its epochs are above those of all
    /// lower terms, and it shows nothing that a majority of its boards hasn't drawn or seen.
    pub fn in_term(term: Term, quorum: Quorum) -> Self {
        Self { epoch: Epoch::first_of(term), quorum: Some(quorum), ..Self::new() }
    }

    /// Whether a first term may be taken now that this has been shown, and before another frame is opened: most boards of the wiring in effect
    /// have seen it, so whoever is elected by most of them begins above it.
    pub fn may_take_term(&self, swap: &Swap) -> bool {
        let is_ready = |key: &&BoardKey| swap.boards.contains(key);
        self.quorum.is_none()
            && self.active.as_ref().is_some_and(|active| {
                active.epoch == swap.epoch && active.members.iter().filter(is_ready).count() * 2 > active.members.len()
            })
    }

    /// From now on another backplane may replace this one, which has led without a term and leads by `term`, its first
    /// ([`Self::may_take_term`]): boards are wired anew, and nothing is shown until that wiring is in effect.
    pub fn on_term(&mut self, now: Time, term: Term) {
        self.epoch = Epoch::first_of(term);
        // Boards that are told of the term refuse what is of none.
        self.quorum = Some(self.active.take().as_ref().map_or_else(Quorum::default, Quorum::taken));
        self.beat = now;
        self.rewire(now);
    }

    /// A board that came after the term was won has granted it too.
    pub fn on_granted(&mut self, key: BoardKey, seen: Seen) {
        if let Some(quorum) = &mut self.quorum {
            quorum.on_granted(key, seen);
        }
    }

    /// The time from frame to frame that is in force; a sixtieth of a second unless set. A silence of nearly four of them is death, but
    /// never less than [`super::SILENCE`]: a rig that is so busy that its rate has fallen has boards that are late to speak, too.
    pub fn set_period(&mut self, period: Duration) {
        self.period = period;
        self.watch.set_limit((period * 15 / 4).max(super::SILENCE));
    }

    /// The silence that is taken for death, whatever the period. Shorter, busy boards are put out; longer, what is dead
    /// holds up its views. Boards say something every [`super::BEAT`].
    pub fn set_silence(&mut self, silence: Duration) {
        self.watch.set_limit(silence);
    }

    /// A board that holds the scene enters the row at its right end. `address` is where its right neighbour can reach it.
    /// Returns whether there was room.
    pub fn on_join(&mut self, now: Time, key: BoardKey, address: String) -> bool {
        self.on_join_at(now, key, address, usize::MAX)
    }

    /// A board that holds the scene enters the row with `position` boards to its left, or all if there are fewer. Returns
    /// whether there was room.
    pub fn on_join_at(&mut self, now: Time, key: BoardKey, address: String, position: usize) -> bool {
        if self.row.len() >= limits::BOARDS_MAX || self.row.iter().any(|slot| slot.key == key) {
            return false;
        }
        self.row.insert(position.min(self.row.len()), Slot { key, address });
        self.watch.on_heard(now, key);
        self.rewire(now);
        true
    }

    /// A board asks to leave: it goes on drawing until a wiring without it is in effect.
    pub fn on_leave(&mut self, now: Time, key: BoardKey) {
        if !self.remove(key) {
            return;
        }
        if self.active.as_ref().is_some_and(|active| active.members.contains(&key)) {
            self.leaving.insert(key);
        } else {
            self.forget(key);
            self.outputs.push_back(BackplaneOutput::Released(key));
        }
        self.rewire(now);
    }

    /// A board is gone: its link closed, or it was put out.
    pub fn on_lost(&mut self, now: Time, key: BoardKey) {
        self.leaving.remove(&key);
        self.forget(key);
        if let Some(quorum) = &mut self.quorum {
            quorum.on_lost(key);
        }
        let was_in_row = self.remove(key);
        let in_closed = self.closed.as_ref().is_some_and(|closed| closed.members.contains(&key));
        if was_in_row || in_closed {
            self.rewire(now);
        } else if self.row.is_empty() && self.leaving.is_empty() {
            self.active = None;
        }
    }

    /// A board in the row has said something, no matter what.
    pub fn on_heard(&mut self, now: Time, key: BoardKey) {
        if self.watch.is_watched(key) {
            self.watch.on_heard(now, key);
        }
    }

    /// A board was ready with a frame of the wiring in effect, after drawing for `cost`.
    pub fn on_ready(&mut self, now: Time, key: BoardKey, epoch: Epoch, cost: Duration) {
        self.on_heard(now, key);
        let Some(active) = self.active.as_ref().filter(|active| active.epoch == epoch) else { return };
        let Some(place) = active.members.iter().position(|member| *member == key) else { return };
        self.weights.on_ready(key, active.weights[place], cost);
        if let Some(quorum) = &mut self.quorum {
            quorum.on_ready(key, epoch);
        }
    }

    /// A frame of the wiring in effect is over: these boards missed it, though they are connected. Their weight shrinks, and then
    /// they are put out; but only if most of the wiring's boards were ready, or half of them with much time to spare, for else the load is to blame.
    pub fn on_frame_over(&mut self, now: Time, missing: &[BoardKey]) {
        let Some(active) = &self.active else { return };
        let late = missing.len() * 2;
        let are_others_at_ease = || {
            let mut others = active.members.iter().zip(&active.weights).filter(|(key, _)| !missing.contains(key));
            others.all(|(key, weight)| self.weights.is_at_ease(*key, *weight, self.period))
        };
        if late < active.members.len() || (late == active.members.len() && are_others_at_ease()) {
            for key in missing {
                match self.weights.on_missed(*key) {
                    Verdict::Wait => {}
                    Verdict::Shrink => self.rewire_unless_opening(now),
                    Verdict::PutOut => self.put_out(now, *key, "it missed too many frames in a row"),
                }
            }
        }
        let Some(active) = &self.active else { return };
        let is_whole = missing.is_empty() && active.epoch == self.epoch;
        if is_whole && self.weights.wants_change(now, &active.members, &active.weights, self.period) {
            self.rewire_unless_opening(now);
        }
    }

    /// A board said something about a wiring. What is about an older one is ignored.
    pub fn on_message(&mut self, now: Time, key: BoardKey, message: FromBoardChain) {
        self.on_heard(now, key);
        let Some(place) = self.members.iter().position(|member| *member == key) else { return };
        match message {
            FromBoardChain::LinkLost { epoch, side } if epoch == self.epoch => self.on_link_lost(now, place, side),
            FromBoardChain::Placed { epoch, id } if epoch == self.epoch => {
                if id as usize != place {
                    self.put_out(now, key, "it reported an id that is not its place");
                } else if let Some(opening) = &mut self.opening {
                    opening.placed.insert(key);
                    self.close_if_complete();
                }
            }
            FromBoardChain::Acknowledge { epoch, id, total } if epoch == self.epoch => {
                if id as usize != place || total as usize != self.members.len() {
                    self.put_out(now, key, "it acknowledged a place that is not its own");
                } else if let Some(opening) = &mut self.opening {
                    opening.acknowledged.insert(key);
                    self.close_if_complete();
                }
            }
            FromBoardChain::Total { epoch, total } if epoch == self.epoch => {
                if place != 0 || total as usize != self.members.len() {
                    self.put_out(now, key, "it returned a wrong total");
                } else if let Some(opening) = &mut self.opening {
                    opening.total = true;
                    self.close_if_complete();
                }
            }
            _ => {}
        }
    }

    /// When [`Self::on_timeout`] is due.
    pub fn next_timeout(&self) -> Option<Time> {
        let opening = self.opening.as_ref().map(|opening| opening.deadline);
        let beat = (!self.row.is_empty()).then_some(self.beat);
        [opening, self.watch.next_timeout(), beat].into_iter().flatten().min()
    }

    /// Time has passed.
    pub fn on_timeout(&mut self, now: Time) {
        let slept = self.watch.slept(now);
        if let Some(opening) = &mut self.opening {
            // Its boards may have said all they had to.
            opening.deadline = opening.deadline + slept;
        }
        for key in self.watch.on_timeout(now) {
            self.put_out(now, key, "it has been silent for too long");
        }
        if self.opening.as_ref().is_some_and(|opening| now >= opening.deadline) {
            self.on_wiring_timeout(now);
        }
        if now >= self.beat && !self.row.is_empty() {
            self.beat = now + if self.quorum.is_some() { BACKPLANE_BEAT_IN_TERM } else { BACKPLANE_BEAT };
            self.outputs.push_back(BackplaneOutput::Beat);
        }
    }

    /// The frame that opens next: a closed wiring takes effect with it. Call before opening any frame.
    pub fn on_frame(&mut self, now: Time, frame: FrameNumber) -> Option<&Wiring> {
        if self.quorum.as_ref().is_none_or(Quorum::is_settled)
            && let Some(wiring) = self.closed.take()
        {
            self.activate(now, frame, wiring);
        }
        if self.row.is_empty() {
            // Nobody draws any more. Those who wait to leave may go.
            self.active = None;
            for key in std::mem::take(&mut self.leaving) {
                self.forget(key);
                self.outputs.push_back(BackplaneOutput::Released(key));
            }
        }
        self.active.as_ref()
    }

    /// Whether what these boards have drawn, under the wiring in effect, may be shown.
    pub fn may_show(&self, boards: &[BoardKey]) -> bool {
        self.quorum.as_ref().is_none_or(|quorum| quorum.may_show(boards))
    }

    /// The wiring for which the stand-by's consent is needed, because too few of the boards before are left to carry it.
    pub fn wants_consent(&self) -> Option<Epoch> {
        self.quorum.as_ref().and_then(Quorum::wants_consent)
    }

    /// The stand-by has consented: it counts grants under this wiring or later ones only.
    pub fn on_consent(&mut self, epoch: Epoch) {
        if let Some(quorum) = &mut self.quorum {
            quorum.on_consent(epoch);
        }
    }

    /// The wiring in effect.
    pub fn active(&self) -> Option<&Wiring> {
        self.active.as_ref()
    }

    /// Whether a closed wiring waits for the next frame.
    pub fn has_closed(&self) -> bool {
        self.closed.is_some()
    }

    /// Boards that are to be in the row.
    pub fn len(&self) -> usize {
        self.row.len()
    }

    /// Whether the row is empty.
    pub fn is_empty(&self) -> bool {
        self.row.is_empty()
    }

    /// The newest epoch, open or closed.
    pub fn epoch(&self) -> Epoch {
        self.epoch
    }

    /// The next thing to do; `None`: wait.
    pub fn poll_output(&mut self) -> Option<BackplaneOutput> {
        self.outputs.pop_front()
    }

    fn remove(&mut self, key: BoardKey) -> bool {
        let before = self.row.len();
        self.row.retain(|slot| slot.key != key);
        self.row.len() != before
    }

    fn forget(&mut self, key: BoardKey) {
        self.watch.forget(key);
        self.weights.forget(key);
        self.apart.forget(key);
        self.strikes.remove(&key);
    }

    fn put_out(&mut self, now: Time, key: BoardKey, why: &'static str) {
        self.outputs.push_back(BackplaneOutput::PutOut(key, why));
        self.on_lost(now, key);
    }

    /// A link couldn't be made, or broke. Its neighbour may be dead; if so, its own closed link or its silence will say so,
    /// and wiring anew is right either way.
    fn on_link_lost(&mut self, now: Time, place: usize, side: Side) {
        let left = match side {
            Side::Left => place.checked_sub(1),
            Side::Right => Some(place),
        };
        let pair = left.and_then(|left| Some((*self.members.get(left)?, *self.members.get(left + 1)?)));
        // A link that was there once can perhaps be made again.
        if let Some((left, right)) = pair.filter(|_| self.opening.is_some()) {
            self.apart.insert(now, left, right);
        }
        self.reorder(now);
    }

    fn on_wiring_timeout(&mut self, now: Time) {
        let Some(opening) = &self.opening else { return };
        // The id goes right and the total comes back left: the first board that the id didn't reach is the one that
        // can't reach its left neighbour; if all have one, the last that hasn't passed the total on is stuck.
        let is_unplaced = |key: &&BoardKey| !opening.placed.contains(key);
        let is_stuck = |key: &&BoardKey| !opening.acknowledged.contains(key);
        let culprit = self.members.iter().find(is_unplaced).or_else(|| self.members.iter().rev().find(is_stuck));
        let Some(key) = culprit.or(self.members.first()).copied() else { return };
        let strikes = self.strikes.entry(key).or_insert(0);
        *strikes += 1;
        let left = self.members.iter().position(|member| *member == key).and_then(|place| place.checked_sub(1));
        match left {
            Some(left) if *strikes < STRIKES_MAX => {
                self.apart.insert(now, self.members[left], key);
                self.reorder(now);
            }
            // There is nobody to its left but ourselves, or it was the same beside another.
            _ => self.put_out(now, key, "it did not take its place in the row in time"),
        }
    }

    /// Wires anew in an order that keeps boards apart that can't reach each other.
    fn reorder(&mut self, now: Time) {
        let row: Vec<_> = self.row.iter().map(|slot| slot.key).collect();
        match self.apart.order(now, &row) {
            Some(order) => {
                let place = |key| order.iter().position(|other| *other == key);
                self.row.sort_by_key(|slot| place(slot.key));
                self.rewire(now);
            }
            None => {
                if let Some(key) = self.apart.worst(&row) {
                    self.put_out(now, key, "no order of the row has neighbours that it can reach");
                }
            }
        }
    }

    fn close_if_complete(&mut self) {
        let Some(opening) = &self.opening else { return };
        let is_complete = opening.total && opening.acknowledged.len() == self.members.len();
        let is_planted = is_planted(Bug::AcknowledgementsNotAwaited) && opening.placed.len() == self.members.len();
        if !is_complete && !is_planted {
            return;
        }
        let (epoch, members) = (self.epoch, self.members.clone());
        for key in &members {
            self.strikes.remove(key);
        }
        let weights = self.weights.plan(&members);
        self.closed = Some(Wiring { epoch, members, weights });
        self.opening = None;
        self.outputs.push_back(BackplaneOutput::Closed(epoch));
    }

    fn activate(&mut self, now: Time, frame: FrameNumber, wiring: Wiring) {
        for key in &wiring.members {
            let message = ToBoardChain::Activate { epoch: wiring.epoch, frame, weights: wiring.weights.clone() };
            self.outputs.push_back(BackplaneOutput::Send(*key, message));
        }
        for key in std::mem::take(&mut self.leaving) {
            if wiring.members.contains(&key) {
                self.leaving.insert(key);
            } else {
                self.forget(key);
                self.outputs.push_back(BackplaneOutput::Released(key));
            }
        }
        let before = self.active.take().map(|active| active.weights).unwrap_or_default();
        self.weights.on_active(now, &wiring.weights, &before);
        if let Some(quorum) = &mut self.quorum {
            quorum.on_activated(&wiring);
        }
        self.active = Some(wiring);
    }

    fn rewire_unless_opening(&mut self, now: Time) {
        if self.opening.is_none() {
            self.rewire(now);
        }
    }

    fn rewire(&mut self, now: Time) {
        self.epoch.0 += 1;
        self.closed = None;
        self.opening = None;
        self.members = self.row.iter().map(|slot| slot.key).collect();
        if self.row.is_empty() {
            // A wiring without members would never close: it is in effect from the next frame on.
            if self.leaving.is_empty() {
                self.active = None;
            }
            return;
        }
        let epoch = self.epoch;
        for (i, slot) in self.row.iter().enumerate() {
            let left = match i.checked_sub(1).map(|l| &self.row[l]) {
                None => Left::Backplane,
                Some(left) => Left::Board { key: left.key, address: left.address.clone() },
            };
            let right = self.row.get(i + 1).map(|slot| slot.key);
            self.outputs.push_back(BackplaneOutput::Send(slot.key, ToBoardChain::Wire { epoch, left, right }));
        }
        self.outputs.push_back(BackplaneOutput::Send(self.row[0].key, ToBoardChain::Id { epoch, id: 0 }));
        self.opening = Some(Opening {
            placed: BTreeSet::new(),
            acknowledged: BTreeSet::new(),
            total: false,
            deadline: now + WIRING_TIMEOUT,
        });
    }
}
