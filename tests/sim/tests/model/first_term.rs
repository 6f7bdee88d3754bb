//! A rig that flies without a term when a stand-by comes: how its leader takes the first one, and what becomes of that if it dies before a
//! frame is drawn by it. The newest frame shown without a term has come to some boards, whichever; the chain's own messages come to all.

use super::terms::{First, Rig, State};
use super::{alone, depth, look};
use proto::chain::planted::plant;
use proto::ids::Term;
use stateright::{Model, Property};

/// The same rig, and what it must have come to.
#[derive(Clone, Debug)]
struct FirstTerm(Rig);

/// Something was shown by this term, or one like it.
fn has_shown(state: &State, is_it: impl Fn(Term) -> bool) -> bool {
    state.shown.values().any(|term| is_it(*term))
}

impl Model for FirstTerm {
    type State = State;
    type Action = <Rig as Model>::Action;

    fn init_states(&self) -> Vec<State> {
        self.0.init_states()
    }

    fn actions(&self, state: &State, actions: &mut Vec<Self::Action>) {
        self.0.actions(state, actions);
    }

    fn next_state(&self, last: &State, action: Self::Action) -> Option<State> {
        self.0.next_state(last, action)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always("no frame number is repeated", |_, state: &State| !state.is_repeated()),
            Property::always("no split", |_, state: &State| !state.is_split()),
            Property::sometimes("the stand-by shows a frame, and the first term had shown none", |_, state| {
                has_shown(state, |term| term.0 % 2 == 1) && !has_shown(state, |term| term.0 == 2)
            }),
            Property::sometimes("a frame is shown by the first term", |_, state| has_shown(state, |term| term.0 == 2)),
        ]
    }
}

fn rig(first: First) -> Rig {
    Rig { first, asks: 1, faults: 0, frames: 1 }
}

#[test]
fn a_first_term_that_has_shown_nothing_is_taken_over_and_nothing_repeated_or_split() {
    let _guard = alone();
    plant(None);
    let found = look("first term", FirstTerm(rig(First::Taken)), depth(40));
    assert_eq!(found, Vec::<&str>::new());
}

#[test]
fn a_first_term_with_a_fault_repeats_and_splits_nothing() {
    let _guard = alone();
    plant(None);
    let found = look("first term, 1 fault", FirstTerm(Rig { faults: 1, ..rig(First::Taken) }), depth(13));
    // A takeover takes more steps; the test above has them.
    assert!(found.iter().all(|property| property.contains("show")), "{found:?}");
}

#[test]
fn a_first_term_that_is_taken_at_any_time_repeats_a_frame() {
    let _guard = alone();
    plant(None);
    // The newest frame was shown, and came to one board only; the two others elect the stand-by.
    let found = look("first term at any time", FirstTerm(rig(First::TakenAnyTime)), 40);
    assert!(found.contains(&"no frame number is repeated"), "{found:?}");
}

#[test]
fn a_first_term_before_any_frame_would_split_the_rig_if_those_who_were_told_could_vote() {
    let _guard = alone();
    plant(None);
    // The leader's first wiring is of one board, and the two that hadn't joined elect the stand-by.
    let found = look("first term before any frame", FirstTerm(Rig { frames: 2, ..rig(First::TakenBeforeAll) }), 40);
    assert!(found.contains(&"no split") || found.contains(&"no frame number is repeated"), "{found:?}");
}
