//! Whose swaps are shown: those of the backplane that leads by the highest term.
//!
//! Within a term the numbers of frames only grow, and a leader that was elected begins above all that was shown before, so no number is shown
//! twice and none out of order. Only a rig that has been started anew, all of it but the compositor, may begin below.
//!
//! A compositor that knows one backplane follows that, whatever it says: started anew, it begins anew.

use proto::ids::{FrameNumber, Term};
use proto::message::Swap;

/// What becomes of a swap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Heed {
    /// It is carried out.
    Follow,
    /// It is the first of another leader than before, whose swaps are void.
    Begin,
    /// It is of who doesn't lead, or has been shown.
    Ignore,
}

/// See the module's head.
#[derive(Debug)]
pub(crate) struct Terms {
    term: Term,
    /// Over which link the leader speaks.
    followed: Option<usize>,
    /// The frame that was swapped last.
    newest: Option<FrameNumber>,
    /// Whether there is more than one backplane.
    keeps: bool,
}

impl Terms {
    /// Of a compositor that knows so many backplanes.
    pub(crate) fn new(backplanes: usize) -> Self {
        Self { term: Term(0), followed: None, newest: None, keeps: backplanes > 1 }
    }

    /// The link of who leads.
    pub(crate) fn followed(&self) -> Option<usize> {
        self.followed
    }

    /// A backplane swaps a frame.
    pub(crate) fn on_swap(&mut self, link: usize, swap: &Swap) -> Heed {
        let (term, is_followed) = (swap.epoch.term(), self.followed == Some(link));
        if self.keeps {
            let may_speak = term > self.term || (term == self.term && (is_followed || self.followed.is_none()));
            let is_old = term == self.term && self.newest.is_some_and(|newest| swap.frame <= newest);
            if !may_speak || is_old {
                return Heed::Ignore;
            }
        }
        let begins = !is_followed || term != self.term;
        (self.term, self.followed, self.newest) = (term, Some(link), Some(swap.frame));
        if begins { Heed::Begin } else { Heed::Follow }
    }

    /// A link is lost.
    pub(crate) fn on_lost(&mut self, link: usize) {
        if self.followed == Some(link) {
            self.followed = None;
            if self.term == Term(0) {
                // Who leads without a term may begin anew.
                self.newest = None;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::ids::Epoch;

    fn swap(term: u64, frame: u64) -> Swap {
        let epoch = Epoch(Epoch::first_of(Term(term)).0 + 1);
        Swap {
            frame: FrameNumber(frame),
            epoch,
            complete: vec![true],
            boards: Vec::new(),
            preview: false,
            moment: None,
        }
    }

    #[test]
    fn the_higher_term_is_followed_and_the_lower_one_never_again() {
        let mut terms = Terms::new(2);
        assert_eq!(terms.on_swap(0, &swap(2, 7)), Heed::Begin);
        assert_eq!(terms.on_swap(0, &swap(2, 8)), Heed::Follow);
        assert_eq!(terms.on_swap(1, &swap(3, 9)), Heed::Begin);
        assert_eq!(terms.on_swap(0, &swap(2, 10)), Heed::Ignore);
        terms.on_lost(1);
        assert_eq!(terms.on_swap(0, &swap(2, 11)), Heed::Ignore);
        assert_eq!(terms.on_swap(0, &swap(4, 12)), Heed::Begin);
    }

    #[test]
    fn no_frame_is_swapped_twice_over_a_link_that_was_cut() {
        let mut terms = Terms::new(2);
        assert_eq!(terms.on_swap(0, &swap(2, 7)), Heed::Begin);
        terms.on_lost(0);
        assert_eq!(terms.on_swap(0, &swap(2, 7)), Heed::Ignore);
        assert_eq!(terms.on_swap(0, &swap(2, 8)), Heed::Begin);
    }

    #[test]
    fn a_backplane_without_terms_begins_anew() {
        for backplanes in [1, 2] {
            let mut terms = Terms::new(backplanes);
            assert_eq!(terms.on_swap(0, &swap(0, 7)), Heed::Begin);
            terms.on_lost(0);
            assert_eq!(terms.on_swap(0, &swap(0, 0)), Heed::Begin, "{backplanes} backplanes");
        }
        let mut terms = Terms::new(1);
        assert_eq!(terms.on_swap(0, &swap(5, 7)), Heed::Begin);
        terms.on_lost(0);
        assert_eq!(terms.on_swap(0, &swap(0, 0)), Heed::Begin, "the rig has no stand-by any more");
    }
}
