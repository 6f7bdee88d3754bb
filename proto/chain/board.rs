//! A board's end of the chain: it takes an id from its left, hands the next to its right, and passes the total back.
//!
//! The right neighbour may connect before the backplane's word about the new wiring has arrived; such an early link is
//! kept (one, the newest) until it has. Everything about an older wiring than the newest known is ignored.

use super::planted::{Bug, is_planted};
use super::term::Seen;
use super::watch::BEAT;
use super::{FromBoardChain, Left, Side, ToBoardChain};
use crate::ids::{BoardId, BoardKey, Epoch, FrameNumber};
use crate::limits;
use crate::message::NeighbourMessage;
use crate::time::Time;
use std::collections::VecDeque;

/// The shell's name for one neighbour connection, never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LinkId(pub u64);

/// A board's place under one wiring that is or will be in effect.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Place {
    /// The wiring.
    pub epoch: Epoch,
    /// The board's id.
    pub id: BoardId,
    /// One weight per board.
    pub weights: Vec<u32>,
    /// The first frame under it.
    pub from: FrameNumber,
}

/// What a board's chain wants done.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum BoardOutput {
    /// Close any link to the left, and open one to this address; report with [`BoardChain::on_left_linked`] or
    /// [`BoardChain::on_link_lost`].
    ConnectLeft {
        /// For which wiring.
        epoch: Epoch,
        /// `host:port`.
        address: String,
    },
    /// Send to the backplane.
    ToBackplane(FromBoardChain),
    /// Send over a neighbour link.
    ToNeighbour(LinkId, NeighbourMessage),
    /// Close a neighbour link.
    Close(LinkId),
    /// Say to the backplane that the board is there ([`crate::message::FromBoard::Alive`]).
    Beat,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Seat {
    epoch: Epoch,
    /// `None`: the backplane is to the left.
    left_board: Option<BoardKey>,
    left_link: Option<LinkId>,
    right: Option<BoardKey>,
    right_link: Option<LinkId>,
    id: Option<u32>,
    /// The backplane has been told the id.
    is_reported: bool,
    total: Option<u32>,
}

/// See the module's head.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct BoardChain {
    key: BoardKey,
    seat: Option<Seat>,
    early: Option<(Epoch, BoardKey, LinkId)>,
    place: Option<Place>,
    /// When the backplane must hear from the board.
    beat: Time,
    outputs: VecDeque<BoardOutput>,
}

impl BoardChain {
    /// A board that the backplane calls `key`, not yet in any row.
    pub fn new(key: BoardKey) -> Self {
        Self { key, seat: None, early: None, place: None, beat: Time(0), outputs: VecDeque::new() }
    }

    /// The backplane said something.
    pub fn on_backplane(&mut self, message: ToBoardChain) {
        match message {
            ToBoardChain::Wire { epoch, left, right } => self.on_wire(epoch, left, right),
            ToBoardChain::Id { epoch, id } if (id as usize) < limits::BOARDS_MAX => {
                if let Some(seat) = self.seat.as_mut().filter(|s| s.epoch == epoch && s.left_board.is_none()) {
                    seat.id.get_or_insert(id);
                    self.advance();
                }
            }
            ToBoardChain::Id { .. } => {}
            ToBoardChain::Activate { epoch, frame, weights } => {
                let Some(seat) = self.seat.as_ref().filter(|seat| seat.epoch == epoch) else { return };
                let (Some(id), Some(total)) = (seat.id, seat.total) else { return };
                if weights.len() == total as usize && weights.iter().all(|w| *w > 0) {
                    self.place = Some(Place { epoch, id: BoardId(id), weights, from: frame });
                }
            }
        }
    }

    /// The link that [`BoardOutput::ConnectLeft`] asked for is up.
    pub fn on_left_linked(&mut self, epoch: Epoch, link: LinkId) {
        match self.seat.as_mut().filter(|seat| seat.epoch == epoch && seat.left_link.is_none()) {
            Some(seat) => {
                seat.left_link = Some(link);
                let hello = NeighbourMessage::Hello { key: self.key, epoch };
                self.outputs.push_back(BoardOutput::ToNeighbour(link, hello));
            }
            None => self.outputs.push_back(BoardOutput::Close(link)),
        }
    }

    /// A neighbour said something. A link that the board didn't open says hello first.
    pub fn on_neighbour(&mut self, link: LinkId, message: NeighbourMessage) {
        match message {
            // A link that is in use has said its hello: another one is slipped in.
            NeighbourMessage::Hello { .. } if self.is_known(link) => {}
            NeighbourMessage::Hello { key, epoch } => {
                let newest = self.seat.as_ref().map_or(Epoch(0), |seat| seat.epoch);
                if epoch > newest {
                    if let Some((_, _, old)) = self.early.replace((epoch, key, link)) {
                        self.outputs.push_back(BoardOutput::Close(old));
                    }
                } else {
                    self.take_right(epoch, key, link);
                }
            }
            NeighbourMessage::Id { epoch, id } if (id as usize) < limits::BOARDS_MAX => {
                let from_left = |seat: &&mut Seat| seat.epoch == epoch && seat.left_link == Some(link);
                if let Some(seat) = self.seat.as_mut().filter(from_left) {
                    seat.id.get_or_insert(id);
                    self.advance();
                }
            }
            // No row is that long.
            NeighbourMessage::Id { .. } => {}
            NeighbourMessage::Total { epoch, total } => {
                let from_right = |seat: &&mut Seat| seat.epoch == epoch && seat.right_link == Some(link);
                if let Some(seat) = self.seat.as_mut().filter(from_right) {
                    // A total that doesn't leave room for ourselves is nonsense.
                    if seat.id.is_some_and(|id| id < total) && seat.total.is_none() {
                        seat.total = Some(total);
                        self.announce_total();
                    }
                }
            }
        }
    }

    /// A neighbour link is down, or the connection that was asked for couldn't be made (then with `None`).
    pub fn on_link_lost(&mut self, epoch_asked: Option<Epoch>, link: Option<LinkId>) {
        if let (Some(link), Some((_, _, early))) = (link, self.early)
            && link == early
        {
            self.early = None;
            return;
        }
        let Some(seat) = &mut self.seat else { return };
        let side = if link.is_some() && seat.left_link == link {
            seat.left_link = None;
            Side::Left
        } else if link.is_some() && seat.right_link == link {
            seat.right_link = None;
            Side::Right
        } else if link.is_none() && epoch_asked == Some(seat.epoch) {
            Side::Left
        } else {
            return;
        };
        let epoch = seat.epoch;
        self.outputs.push_back(BoardOutput::ToBackplane(FromBoardChain::LinkLost { epoch, side }));
    }

    /// The place that holds for frames of this wiring, if it is in effect or announced.
    pub fn place(&self, epoch: Epoch) -> Option<&Place> {
        self.place.as_ref().filter(|place| place.epoch == epoch)
    }

    /// The board's place in the newest wiring that the backplane has said is in effect, if any.
    pub fn placed(&self) -> Option<Seen> {
        let place = self.place.as_ref()?;
        Some(Seen { epoch: place.epoch, id: place.id.0, total: place.weights.len() as u32 })
    }

    /// Something went to the backplane: no beat is needed for a while. Call it for whatever is sent but beats.
    pub fn on_sent(&mut self, now: Time) {
        self.beat = now + BEAT;
    }

    /// When [`Self::on_timeout`] is due.
    pub fn next_timeout(&self) -> Time {
        self.beat
    }

    /// Time has passed.
    pub fn on_timeout(&mut self, now: Time) {
        if now >= self.beat {
            self.beat = now + BEAT;
            self.outputs.push_back(BoardOutput::Beat);
        }
    }

    /// The next thing to do; `None`: wait.
    pub fn poll_output(&mut self) -> Option<BoardOutput> {
        self.outputs.pop_front()
    }

    fn on_wire(&mut self, epoch: Epoch, left: Left, right: Option<BoardKey>) {
        if self.seat.as_ref().is_some_and(|seat| seat.epoch >= epoch) {
            return;
        }
        let mut kept = None;
        if let Some(old) = self.seat.take() {
            kept = old.id.filter(|_| is_planted(Bug::OldPlaceKept));
            for link in [old.left_link, old.right_link].into_iter().flatten() {
                self.outputs.push_back(BoardOutput::Close(link));
            }
        }
        let left_board = match left {
            Left::Backplane => None,
            Left::Board { key, address } => {
                self.outputs.push_back(BoardOutput::ConnectLeft { epoch, address });
                Some(key)
            }
        };
        self.seat = Some(Seat {
            epoch,
            left_board,
            left_link: None,
            right,
            right_link: None,
            id: kept,
            is_reported: false,
            total: None,
        });
        match self.early {
            Some((e, key, link)) if e <= epoch => {
                self.early = None;
                self.take_right(e, key, link);
            }
            _ => {}
        }
    }

    fn is_known(&self, link: LinkId) -> bool {
        let seat = self.seat.as_ref().is_some_and(|s| s.left_link == Some(link) || s.right_link == Some(link));
        seat || self.early.is_some_and(|(_, _, early)| early == link)
    }

    fn take_right(&mut self, epoch: Epoch, key: BoardKey, link: LinkId) {
        let expected = |seat: &&mut Seat| seat.epoch == epoch && seat.right == Some(key) && seat.right_link.is_none();
        match self.seat.as_mut().filter(expected) {
            Some(seat) => {
                seat.right_link = Some(link);
                self.advance();
            }
            None => self.outputs.push_back(BoardOutput::Close(link)),
        }
    }

    /// Passes the id on as soon as both it and the right neighbour are there.
    fn advance(&mut self) {
        let Some(seat) = &mut self.seat else { return };
        let Some(id) = seat.id else { return };
        let epoch = seat.epoch;
        if !std::mem::replace(&mut seat.is_reported, true) {
            self.outputs.push_back(BoardOutput::ToBackplane(FromBoardChain::Placed { epoch, id }));
        }
        match (seat.right, seat.right_link) {
            (None, _) => {
                if seat.total.is_none() {
                    seat.total = Some(id + 1);
                    self.announce_total();
                }
            }
            (Some(_), Some(link)) => {
                self.outputs.push_back(BoardOutput::ToNeighbour(link, NeighbourMessage::Id { epoch, id: id + 1 }));
            }
            (Some(_), None) => {}
        }
    }

    fn announce_total(&mut self) {
        let Some(seat) = &self.seat else { return };
        let (Some(id), Some(total)) = (seat.id, seat.total) else { return };
        let epoch = seat.epoch;
        match (seat.left_board, seat.left_link) {
            (None, _) => self.outputs.push_back(BoardOutput::ToBackplane(FromBoardChain::Total { epoch, total })),
            (Some(_), Some(link)) => {
                self.outputs.push_back(BoardOutput::ToNeighbour(link, NeighbourMessage::Total { epoch, total }));
            }
            // The left link broke meanwhile; its loss has been reported and another wiring follows.
            (Some(_), None) => return,
        }
        self.outputs.push_back(BoardOutput::ToBackplane(FromBoardChain::Acknowledge { epoch, id, total }));
    }
}
