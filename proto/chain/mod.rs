//! The chain: how boards learn their places, and when displays change (seed 001; chain.md of the design).
//!
//! Boards stand in a row. The backplane tells each board who its left neighbour is; the first board gets id 0 from the
//! backplane itself. A board that gets `id` from its left keeps it and sends `id + 1` to its right; the last board
//! sends the total back left, and it passes every board on its way to the backplane. When the backplane has the total and
//! every board's acknowledgement, the wiring, called an *epoch*, is *closed*; it takes effect at a frame number that the
//! backplane names.
//!
//! These are state machines without sockets or clocks. The calling contract of each: hand in one fact
//! (`on_…(now, …)`), drain `poll_output()` until it is empty, wait until the next fact or `next_timeout()`.
//!
//! [`BackplaneChain`] and [`BoardChain`] keep the row; [`FrameClock`] opens and swaps frames; [`RateControl`] halves the
//! frame rate when boards can't follow; [`Watch`] notices who is silent; [`StandBy`], [`BoardTerm`] and [`Quorum`] decide which of
//! two backplanes leads.

mod backplane;
mod board;
mod frame_clock;
mod order;
pub mod planted;
mod rate;
mod term;
mod watch;
mod weights;

pub use backplane::{BACKPLANE_BEAT, BackplaneChain, BackplaneOutput, Wiring};
pub use board::{BoardChain, BoardOutput, LinkId, Place};
pub use frame_clock::{ClockMode, ClockOutput, FrameClock};
pub use rate::RateControl;
pub use term::{
    Answer, Ask, BetweenBackplanes, BoardTerm, LEADER_SILENCE, NoStandBy, Quorum, Seen, StandBy, StandByOutput,
};
pub use watch::{BEAT, PERIOD, SILENCE, Watch};

use crate::ids::{BoardKey, Epoch, FrameNumber};
use serde::{Deserialize, Serialize};

/// Who is to a board's left.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Hash)]
pub enum Left {
    /// Nobody: the board is the first, and the id comes over its link to the backplane.
    Backplane,
    /// A board.
    Board {
        /// Its key.
        key: BoardKey,
        /// Where it listens for neighbours, `host:port`.
        address: String,
    },
}

/// An end of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Hash)]
pub enum Side {
    /// Towards id 0.
    Left,
    /// Towards the total.
    Right,
}

/// Backplane → board.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Hash)]
pub enum ToBoardChain {
    /// A new wiring begins: connect to the left, expect the right.
    Wire {
        /// The wiring.
        epoch: Epoch,
        /// To connect to.
        left: Left,
        /// Who will connect; `None` at the right end of the row.
        right: Option<BoardKey>,
    },
    /// To the first board only: its id.
    Id {
        /// The wiring.
        epoch: Epoch,
        /// 0.
        id: u32,
    },
    /// The wiring takes effect.
    Activate {
        /// The wiring.
        epoch: Epoch,
        /// The first frame drawn under it.
        frame: FrameNumber,
        /// One weight per board, in the order of ids.
        weights: Vec<u32>,
    },
}

impl ToBoardChain {
    /// The wiring that it is about.
    pub fn epoch(&self) -> Epoch {
        match self {
            Self::Wire { epoch, .. } | Self::Id { epoch, .. } | Self::Activate { epoch, .. } => *epoch,
        }
    }
}

/// Board → backplane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Hash)]
pub enum FromBoardChain {
    /// An id has come from the left.
    Placed {
        /// The wiring.
        epoch: Epoch,
        /// The board's id.
        id: u32,
    },
    /// From the first board only: the total has come back.
    Total {
        /// The wiring.
        epoch: Epoch,
        /// Number of boards.
        total: u32,
    },
    /// The board knows its place: id and total.
    Acknowledge {
        /// The wiring.
        epoch: Epoch,
        /// The board's id.
        id: u32,
        /// Number of boards.
        total: u32,
    },
    /// A neighbour link broke or couldn't be made.
    LinkLost {
        /// The wiring.
        epoch: Epoch,
        /// Which end.
        side: Side,
    },
}

#[cfg(test)]
mod tests;
