//! Planted bugs, and whether the simulation catches them. Builds without debug assertions can't have them.
#![cfg(debug_assertions)]

use cyclorama_sim::plan::Faults;
use cyclorama_sim::run;
use proto::chain::planted::{Bug, plant};
use std::sync::Mutex;

static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// The first seed that goes wrong with a bug, and how.
fn catch(bug: Option<Bug>, faults: Faults, seeds: u64) -> Option<(u64, String)> {
    let _guard = ONE_AT_A_TIME.lock();
    plant(bug);
    let caught = (0..seeds).find_map(|seed| run(seed, faults, false).violations.first().map(|v| (seed, v.clone())));
    plant(None);
    caught
}

#[test]
fn nothing_is_wrong_without_them() {
    assert_eq!(catch(None, Faults::Any, 30), None);
    assert_eq!(catch(None, Faults::LeaderPowerOff, 30), None);
}

#[test]
fn a_place_kept_from_the_wiring_before_is_caught() {
    let (seed, what) = catch(Some(Bug::OldPlaceKept), Faults::OneCrash, 30).expect("caught");
    assert!(what.contains("without a cause"), "seed {seed}: {what}");
}

#[test]
fn a_wiring_that_does_not_await_acknowledgements_is_caught() {
    let (seed, what) = catch(Some(Bug::AcknowledgementsNotAwaited), Faults::Any, 300).expect("caught");
    assert!(what.contains("without a cause") || what.contains("row"), "seed {seed}: {what}");
}

#[test]
fn a_term_that_is_not_compared_is_caught() {
    let (seed, what) = catch(Some(Bug::TermNotCompared), Faults::LeaderCut, 400).expect("caught");
    assert!(
        what.contains("by a lower term") || what.contains("a second time") || what.contains("row"),
        "seed {seed}: {what}"
    );
}
