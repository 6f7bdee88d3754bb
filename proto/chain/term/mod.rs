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
//! 5. Who leads without a term shows what it likes. When a stand-by comes it takes the *first* term, right after it has shown a frame that
//!    more than half of its wiring's boards were ready with ([`super::BackplaneChain::may_take_term`]); that wiring is the settled one,
//!    and counts as number 0 of the term. A board that is wired by a first term knows its place in it ([`BoardTerm::on_wired`]). So all
//!    above holds from the first term on, though nothing has been drawn under it: every majority of that wiring has a board that has seen the newest
//!    frame shown without a term. A rig that has shown nothing has no such wiring, and takes no term.
//!
//! No clock decides anything here but when to try.

mod board;
mod quorum;
mod stand_by;

pub use board::BoardTerm;
pub use quorum::Quorum;
pub use stand_by::{StandBy, StandByOutput};

use crate::ids::{Epoch, FrameNumber, Term};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// How long a board's backplane must have been silent before another is granted a term. Three of its beats.
pub const LEADER_SILENCE: Duration = Duration::from_millis(150);

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
