//! A board's part: which term it serves.

use super::{Answer, Ask, LEADER_SILENCE, Seen};
use crate::chain::planted::{Bug, is_planted};
use crate::ids::{Epoch, FrameNumber, Term};
use crate::time::Time;

/// See the module's head.
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

    /// The term that a backplane must know of, if any: under it, or a lower one, the board has a place in a wiring. Who remembers none elects
    /// nobody: what it would grant says nothing of what others have shown.
    pub fn remembered(&self) -> Option<Term> {
        self.wiring.filter(|seen| seen.epoch.term() > Term(0)).map(|_| self.term)
    }

    /// The backplane that is served wires its boards, by `term`. Call it before [`Self::on_leader`], and only if this backplane was served
    /// before. If it had no term this is its first one, because those that are won are announced by an [`Ask`] before any wiring.
    /// `placed` is the board's place in the newest wiring that has taken effect over this link ([`crate::chain::BoardChain::placed`]);
    /// nothing that the chain says is dropped, so it is the one in effect, as number 0 of the term.
    pub fn on_wired(&mut self, term: Term, placed: Option<Seen>) {
        if self.term == Term(0)
            && term > Term(0)
            && let Some(seen) = placed.filter(|seen| seen.epoch.term() == Term(0))
        {
            self.wiring = Some(Seen { epoch: Epoch::first_of(term), ..seen });
        }
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
        if !ask.leads && self.remembered().is_none() {
            return Answer::Refused { term: self.term };
        }
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
