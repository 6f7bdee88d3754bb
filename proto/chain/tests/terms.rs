//! Terms, as far as daemons need what the simulation of two backplanes doesn't meet: a leader that had no term.

use super::*;
use crate::ids::Term;

const BOARDS: [BoardKey; 3] = [BoardKey(1), BoardKey(2), BoardKey(3)];

/// What a stand-by wants when its leader is lost and all boards grant what it asks for, the wiring of that number behind them.
fn elect(mut stand_by: StandBy, wiring: Epoch) -> Option<StandByOutput> {
    for key in BOARDS {
        stand_by.on_board(Time(0), key);
    }
    stand_by.on_leader_lost(Time(1));
    let mut outputs = Vec::new();
    while let Some(output) = stand_by.poll_output() {
        let StandByOutput::Ask(key, Ask { term, .. }) = output else { continue };
        let seen = Seen { epoch: wiring, id: key.0 as u32 - 1, total: 3 };
        stand_by.on_answer(key, Answer::Granted { term, wiring: Some(seen), newest: FrameNumber(9) });
        outputs.extend(stand_by.poll_output().filter(|output| matches!(output, StandByOutput::Lead { .. })));
    }
    outputs.pop()
}

#[test]
fn nothing_is_taken_over_from_a_leader_without_a_term() {
    let stand_by = StandBy::new(Time(0), 1, Term(2));
    assert_eq!(elect(stand_by.clone(), Epoch(5)), None);
    let in_term = Epoch(Epoch::first_of(Term(2)).0 + 5);
    let Some(StandByOutput::Lead { first, .. }) = elect(stand_by, in_term) else { panic!("it is granted") };
    assert_eq!(first, FrameNumber(10));
}

#[test]
fn the_terms_of_a_stand_by_are_never_those_of_who_leads() {
    for (leads, wins) in [(2, 3), (3, 4)] {
        let mut stand_by = StandBy::new(Time(0), 1, Term(0));
        stand_by.on_leader(Time(0), BetweenBackplanes::Leads { term: Term(leads) });
        let Some(StandByOutput::Lead { term, .. }) = elect(stand_by, Epoch(Epoch::first_of(Term(leads)).0 + 1)) else {
            panic!("it is granted");
        };
        assert_eq!(term, Term(wins));
    }
}

#[test]
fn who_leads_is_followed_by_a_board_that_still_hears_the_old_leader() {
    let mut board = BoardTerm::default();
    assert!(board.on_leader(Time(0), Term(2)));
    let refused = board.on_ask(Time(1), Ask { term: Term(3), leads: false });
    assert_eq!(refused, Answer::Refused { term: Term(2) });
    let granted = board.on_ask(Time(1), Ask { term: Term(3), leads: true });
    assert!(matches!(granted, Answer::Granted { term: Term(3), .. }), "{granted:?}");
    assert!(!board.on_leader(Time(1), Term(2)));
}

#[test]
fn a_leader_that_takes_a_term_wires_its_boards_anew_and_shows_what_a_majority_has_drawn() {
    let mut world = World::new(11);
    for key in 1..=3 {
        world.join(key);
    }
    world.settle();
    world.places(0);
    world.backplane.on_term(world.now, Term(2));
    assert!(!world.backplane.may_show(&BOARDS), "of the wiring before");
    world.drain();
    world.settle();
    assert_eq!(world.places(1), [1, 2, 3]);
    let epoch = world.backplane.active().unwrap().epoch;
    assert_eq!(epoch.term(), Term(2));
    assert!(world.backplane.may_show(&BOARDS[..2]) && !world.backplane.may_show(&BOARDS[..1]));
}
