//! Whom a board serves: one backplane at a time, of those that it knows.
//!
//! [`BoardTerm`] says which term may speak; this says over which link. A board that has a place under no term has nothing to remember: it
//! elects nobody, and follows whoever leads.
//!
//! A board that knows one backplane only forgets the term with the link, for nobody else will ever ask it: a backplane that is
//! started anew begins anew.

use proto::chain::{Answer, Ask, BoardTerm, Seen};
use proto::ids::{FrameNumber, Term};
use proto::time::Time;

/// What a backplane's word is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Heed {
    /// To be followed.
    Follow,
    /// The first word of another leader than before: to be followed from now on, and the other no more.
    Begin,
    /// Of who doesn't lead.
    Ignore,
}

/// See the module's head.
#[derive(Debug)]
pub(super) struct Terms {
    term: BoardTerm,
    /// Over which link the leader speaks, or who was granted a term.
    served: Option<usize>,
    /// Whether it leads: who was only granted a term must not keep others from asking.
    is_led: bool,
    /// Whether another backplane may ask for a term.
    keeps: bool,
}

impl Terms {
    /// Of a board that knows so many backplanes.
    pub(super) fn new(backplanes: usize) -> Self {
        Self { term: BoardTerm::default(), served: None, is_led: false, keeps: backplanes > 1 }
    }

    /// The link of who is served.
    pub(super) fn served(&self) -> Option<usize> {
        self.served
    }

    /// The term that is served.
    pub(super) fn term(&self) -> Term {
        self.term.term()
    }

    /// The term that a backplane must know of, if any: under it, or a lower one, the board has a place in a wiring.
    pub(super) fn remembered(&self) -> Option<Term> {
        self.term.remembered()
    }

    /// Who leads by `term` speaks over a link.
    pub(super) fn on_leader(&mut self, now: Time, link: usize, term: Term) -> Heed {
        let is_served = self.served == Some(link);
        // Two that lead by the same term are two that were both started as the first: the one that came first is served.
        let may_speak = is_served || self.served.is_none() || term > self.term.term();
        if !may_speak || !self.term.on_leader(now, term) {
            return Heed::Ignore;
        }
        (self.served, self.is_led) = (Some(link), true);
        if is_served { Heed::Follow } else { Heed::Begin }
    }

    /// Who leads by `term` wires the board over a link, over which `placed` is the newest place that has taken effect. [`Self::on_leader`] comes
    /// after it.
    pub(super) fn on_wired(&mut self, link: usize, term: Term, placed: Option<Seen>) {
        if self.served == Some(link) && self.is_led {
            self.term.on_wired(term, placed);
        }
    }

    /// A word that says no term, and that only who leads says. Only without terms it may be the first.
    pub(super) fn on_word(&mut self, now: Time, link: usize) -> Heed {
        if self.served != Some(link) && self.term.term() > Term(0) {
            return Heed::Ignore;
        }
        self.on_leader(now, link, self.term.term())
    }

    /// A backplane is there, and may or may not lead.
    pub(super) fn on_alive(&mut self, now: Time, link: usize) {
        if self.served == Some(link) && self.is_led {
            self.term.on_leader(now, self.term.term());
        }
    }

    /// A backplane asks for a term, or says by which it leads. Returns the answer, and whether it is served from now on and wasn't, or not
    /// by that term.
    pub(super) fn on_ask(&mut self, now: Time, link: usize, ask: Ask) -> (Answer, bool) {
        let before = (self.served, self.term.term());
        let answer = self.term.on_ask(now, ask);
        let is_granted = matches!(answer, Answer::Granted { .. });
        if is_granted && ask.leads {
            self.term.on_leader(now, ask.term);
        }
        if is_granted {
            (self.served, self.is_led) = (Some(link), ask.leads);
        }
        (answer, is_granted && before != (Some(link), ask.term))
    }

    /// A frame has come.
    pub(super) fn on_frame(&mut self, frame: FrameNumber) {
        self.term.on_frame(frame);
    }

    /// A frame has come under this wiring.
    pub(super) fn on_active(&mut self, wiring: Seen) {
        self.term.on_active(wiring);
    }

    /// A link is lost. Returns whether it was that of who is served.
    pub(super) fn on_lost(&mut self, link: usize) -> bool {
        if self.served != Some(link) {
            return false;
        }
        self.served = None;
        self.term.on_leader_lost(self.term.term());
        if !self.keeps || self.remembered().is_none() {
            self.term = BoardTerm::default();
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::ids::Epoch;

    const NOW: Time = Time(1_000_000_000);
    const LATER: Time = Time(2_000_000_000);

    /// A board that has drawn for the backplane behind link 0, which led by term 2.
    fn drawn(backplanes: usize) -> Terms {
        let mut terms = Terms::new(backplanes);
        let (answer, begins) = terms.on_ask(NOW, 0, Ask { term: Term(2), leads: true });
        assert!(matches!(answer, Answer::Granted { wiring: None, .. }) && begins, "{answer:?}");
        assert_eq!(terms.on_leader(NOW, 0, Term(2)), Heed::Follow);
        terms.on_frame(FrameNumber(7));
        terms.on_active(Seen { epoch: Epoch(Epoch::first_of(Term(2)).0 + 1), id: 0, total: 3 });
        terms
    }

    #[test]
    fn without_terms_the_first_that_leads_is_served_until_it_is_lost() {
        let mut terms = Terms::new(2);
        assert_eq!(terms.on_word(NOW, 0), Heed::Begin);
        assert_eq!(terms.on_word(NOW, 1), Heed::Ignore);
        assert_eq!(terms.on_leader(NOW, 1, Term(0)), Heed::Ignore);
        assert!(!terms.on_lost(1));
        assert!(terms.on_lost(0));
        assert_eq!(terms.on_word(NOW, 1), Heed::Begin);
    }

    #[test]
    fn a_stand_by_is_served_from_its_grant_on_and_the_old_leader_no_more() {
        let mut terms = drawn(2);
        let ask = Ask { term: Term(3), leads: false };
        assert_eq!(terms.on_ask(NOW, 1, ask), (Answer::Refused { term: Term(2) }, false), "its leader is heard");
        let (answer, begins) = terms.on_ask(LATER, 1, ask);
        assert!(
            matches!(answer, Answer::Granted { term: Term(3), newest: FrameNumber(7), .. }) && begins,
            "{answer:?}"
        );
        assert_eq!(terms.on_leader(LATER, 0, Term(2)), Heed::Ignore);
        assert_eq!(terms.on_word(LATER, 0), Heed::Ignore);
        assert_eq!((terms.on_leader(LATER, 1, Term(3)), terms.served()), (Heed::Follow, Some(1)));
    }

    #[test]
    fn who_was_granted_a_term_and_does_not_lead_keeps_nobody_from_asking() {
        let mut terms = drawn(2);
        assert!(terms.on_ask(LATER, 1, Ask { term: Term(3), leads: false }).1);
        terms.on_alive(LATER, 1);
        let (answer, begins) = terms.on_ask(LATER, 0, Ask { term: Term(4), leads: false });
        assert!(matches!(answer, Answer::Granted { term: Term(4), .. }) && begins, "{answer:?}");
    }

    #[test]
    fn who_leads_by_a_higher_term_is_served_though_the_old_leader_is_heard() {
        let mut terms = drawn(2);
        let (answer, begins) = terms.on_ask(NOW, 1, Ask { term: Term(3), leads: true });
        assert!(matches!(answer, Answer::Granted { term: Term(3), .. }) && begins, "{answer:?}");
    }

    #[test]
    fn a_board_that_was_wired_by_a_first_term_elects_the_stand_by_before_it_has_drawn() {
        let placed = Seen { epoch: Epoch(5), id: 1, total: 3 };
        for (wires, remembered) in [(0, Some(Term(2))), (1, None)] {
            let mut terms = Terms::new(2);
            assert_eq!(terms.on_leader(NOW, 0, Term(0)), Heed::Begin);
            terms.on_frame(FrameNumber(7));
            terms.on_active(placed);
            terms.on_wired(wires, Term(2), Some(placed));
            let heed = terms.on_leader(NOW, wires, Term(2));
            assert_eq!(heed, if wires == 0 { Heed::Follow } else { Heed::Begin });
            assert_eq!(terms.remembered(), remembered, "only who led without a term can have taken the first");
            terms.on_lost(wires);
            let (answer, _) = terms.on_ask(LATER, 1 - wires, Ask { term: Term(3), leads: false });
            let wiring = Some(Seen { epoch: Epoch::first_of(Term(2)), ..placed });
            let granted = Answer::Granted { term: Term(3), wiring, newest: FrameNumber(7) };
            assert_eq!(answer, if wires == 0 { granted } else { Answer::Refused { term: Term(0) } });
        }
    }

    #[test]
    fn a_board_that_has_drawn_under_no_term_elects_nobody_and_follows_anybody() {
        let mut terms = Terms::new(2);
        assert_eq!(terms.on_word(NOW, 0), Heed::Begin);
        assert!(terms.on_lost(0));
        let ask = Ask { term: Term(3), leads: false };
        assert_eq!(terms.on_ask(LATER, 1, ask), (Answer::Refused { term: Term(0) }, false));
        assert_eq!((terms.on_word(LATER, 0), terms.remembered()), (Heed::Begin, None));
    }

    #[test]
    fn what_was_drawn_under_is_remembered_only_where_another_may_ask() {
        for (backplanes, remembered) in [(1, None), (2, Some(Term(2)))] {
            let mut terms = drawn(backplanes);
            assert!(terms.on_lost(0));
            assert_eq!(terms.remembered(), remembered, "{backplanes} backplanes");
        }
    }
}
