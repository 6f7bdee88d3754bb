//! The backplane's end of the chain: who is in the row, and which wiring is in effect.
//!
//! Any change of the row opens a new epoch at once; a change during the opening of one opens the next. An epoch that
//! doesn't close within `WIRING_TIMEOUT` names a culprit, the first board that the id (or the total) didn't reach; it
//! is put out, and what remains is wired anew. So the row always converges on boards that can reach each other.

use super::{FromBoardChain, Left, ToBoardChain};
use crate::ids::{BoardKey, Epoch, FrameNumber};
use crate::limits;
use crate::time::Time;
use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

/// How long a wiring may take to close. Loopback closes 16 boards in a few ms, a cabin network in tens; long enough that
/// a stalled machine is not put out, short enough that a broken link doesn't hold the picture for a second.
const WIRING_TIMEOUT: Duration = Duration::from_millis(500);

/// A closed wiring: everything that shares depend on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// Its number.
    pub epoch: Epoch,
    /// The boards in the order of their ids.
    pub members: Vec<BoardKey>,
    /// Their weights, likewise.
    pub weights: Vec<u32>,
}

/// What the backplane's chain wants done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BackplaneOutput {
    /// Send this to that board.
    Send(BoardKey, ToBoardChain),
    /// The board has drained: its share is drawn by others. Say goodbye to it.
    Released(BoardKey),
    /// Drop the board, and say why. The shell closes its link and calls [`BackplaneChain::on_lost`].
    PutOut(BoardKey, &'static str),
    /// A wiring has closed and waits for the next frame.
    Closed(Epoch),
}

#[derive(Clone, Debug)]
struct Slot {
    key: BoardKey,
    address: String,
}

#[derive(Clone, Debug)]
struct Opening {
    members: Vec<BoardKey>,
    placed: BTreeSet<BoardKey>,
    acknowledged: BTreeSet<BoardKey>,
    total: bool,
    deadline: Time,
}

/// See the module's head.
#[derive(Clone, Debug, Default)]
pub struct BackplaneChain {
    /// The boards that are to be in the row, from the left.
    row: Vec<Slot>,
    /// Boards that asked to leave and still draw under the wiring in effect.
    leaving: BTreeSet<BoardKey>,
    /// The newest epoch.
    epoch: Epoch,
    opening: Option<Opening>,
    closed: Option<Wiring>,
    active: Option<Wiring>,
    outputs: VecDeque<BackplaneOutput>,
}

impl BackplaneChain {
    /// An empty row.
    pub fn new() -> Self {
        Self::default()
    }

    /// A board that holds the scene enters the row at its right end. `address` is where its right neighbour can reach it.
    /// Returns whether there was room.
    pub fn on_join(&mut self, now: Time, key: BoardKey, address: String) -> bool {
        if self.row.len() >= limits::BOARDS_MAX || self.row.iter().any(|slot| slot.key == key) {
            return false;
        }
        self.row.push(Slot { key, address });
        self.rewire(now);
        true
    }

    /// A board asks to leave: it goes on drawing until a wiring without it is in effect.
    pub fn on_leave(&mut self, now: Time, key: BoardKey) {
        let before = self.row.len();
        self.row.retain(|slot| slot.key != key);
        if self.row.len() == before {
            return;
        }
        if self.active.as_ref().is_some_and(|active| active.members.contains(&key)) {
            self.leaving.insert(key);
        } else {
            self.outputs.push_back(BackplaneOutput::Released(key));
        }
        self.rewire(now);
    }

    /// A board is gone: its link closed, or it was put out.
    pub fn on_lost(&mut self, now: Time, key: BoardKey) {
        self.leaving.remove(&key);
        let before = self.row.len();
        self.row.retain(|slot| slot.key != key);
        let in_closed = self.closed.as_ref().is_some_and(|closed| closed.members.contains(&key));
        if self.row.len() != before || in_closed {
            self.rewire(now);
        }
    }

    /// A board said something about a wiring. What is about an older one is ignored.
    pub fn on_message(&mut self, now: Time, key: BoardKey, message: FromBoardChain) {
        if let FromBoardChain::LinkLost { epoch, .. } = message {
            // Its neighbour is dead or cut off. If dead, its own closed link says so too; wiring anew is right either way.
            if epoch == self.epoch && self.row.iter().any(|slot| slot.key == key) && self.opening.is_none() {
                self.rewire(now);
            }
            return;
        }
        let Some(opening) = &mut self.opening else { return };
        let Some(place) = opening.members.iter().position(|member| *member == key) else { return };
        let misplaced = |id: u32| id as usize != place;
        match message {
            FromBoardChain::Placed { epoch, id } if epoch == self.epoch => {
                if misplaced(id) {
                    self.outputs.push_back(BackplaneOutput::PutOut(key, "it reported an id that is not its place"));
                    return;
                }
                opening.placed.insert(key);
            }
            FromBoardChain::Acknowledge { epoch, id, total } if epoch == self.epoch => {
                if misplaced(id) || total as usize != opening.members.len() {
                    self.outputs.push_back(BackplaneOutput::PutOut(key, "it acknowledged a place that is not its own"));
                    return;
                }
                opening.acknowledged.insert(key);
            }
            FromBoardChain::Total { epoch, total } if epoch == self.epoch => {
                if place != 0 || total as usize != opening.members.len() {
                    self.outputs.push_back(BackplaneOutput::PutOut(key, "it returned a wrong total"));
                    return;
                }
                opening.total = true;
            }
            _ => return,
        }
        if opening.total && opening.acknowledged.len() == opening.members.len() {
            let weights = vec![1; opening.members.len()];
            self.closed = Some(Wiring { epoch: self.epoch, members: std::mem::take(&mut opening.members), weights });
            self.opening = None;
            self.outputs.push_back(BackplaneOutput::Closed(self.epoch));
        }
    }

    /// When [`Self::on_timeout`] is due.
    pub fn next_timeout(&self) -> Option<Time> {
        self.opening.as_ref().map(|opening| opening.deadline)
    }

    /// Time has passed.
    pub fn on_timeout(&mut self, now: Time) {
        let Some(opening) = &self.opening else { return };
        if now < opening.deadline {
            return;
        }
        // The id goes right and the total comes back left: the first board that the id didn't reach is the one that
        // can't reach its left neighbour; if all have one, the last that hasn't passed the total on is stuck.
        let culprit = opening
            .members
            .iter()
            .find(|key| !opening.placed.contains(key))
            .or_else(|| opening.members.iter().rev().find(|key| !opening.acknowledged.contains(key)))
            .or(opening.members.first())
            .copied();
        if let Some(key) = culprit {
            self.outputs.push_back(BackplaneOutput::PutOut(key, "it did not take its place in the row in time"));
            self.on_lost(now, key);
        }
    }

    /// The frame that opens next: a closed wiring takes effect with it. Call before opening any frame.
    pub fn on_frame(&mut self, frame: FrameNumber) -> Option<&Wiring> {
        if let Some(wiring) = self.closed.take() {
            for key in &wiring.members {
                let message = ToBoardChain::Activate { epoch: wiring.epoch, frame, weights: wiring.weights.clone() };
                self.outputs.push_back(BackplaneOutput::Send(*key, message));
            }
            for key in std::mem::take(&mut self.leaving) {
                if wiring.members.contains(&key) {
                    self.leaving.insert(key);
                } else {
                    self.outputs.push_back(BackplaneOutput::Released(key));
                }
            }
            self.active = Some(wiring);
        }
        self.active.as_ref()
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

    fn rewire(&mut self, now: Time) {
        self.epoch.0 += 1;
        self.closed = None;
        self.opening = None;
        if self.row.is_empty() {
            // Nobody draws: a wiring without members would never close. Those who wait to leave may go.
            self.active = None;
            self.outputs.extend(std::mem::take(&mut self.leaving).into_iter().map(BackplaneOutput::Released));
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
            members: self.row.iter().map(|slot| slot.key).collect(),
            placed: BTreeSet::new(),
            acknowledged: BTreeSet::new(),
            total: false,
            deadline: now + WIRING_TIMEOUT,
        });
    }
}
