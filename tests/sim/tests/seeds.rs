//! Seeds in the share of the ordinary test command. Longer: `cargo run --release -p cyclorama-sim -- --seeds 100000`.
#![expect(clippy::unwrap_used, reason = "a test that can't go on has failed")]

use cyclorama_sim::plan::{BOARDS_MAX, END, Faults, Plan};
use cyclorama_sim::{Outcome, run};
use std::sync::atomic::{AtomicU64, Ordering};

/// How many seeds of each kind, and from which one on.
const SHARE: [(Faults, u64, u64); 9] = [
    (Faults::Any, 1_000_000, 9500),
    (Faults::Harmless, 0, 400),
    (Faults::ShortStalls, 0, 600),
    (Faults::OneCrash, 0, 400),
    (Faults::OnePowerOff, 0, 400),
    (Faults::LeaderCrash, 0, 300),
    (Faults::LeaderPowerOff, 0, 300),
    (Faults::LeaderCut, 0, 400),
    (Faults::FirstTerm, 0, 300),
];

/// Runs the share of a kind on two threads; every seed must be right.
fn run_share(faults: Faults) -> Vec<Outcome> {
    let (_, from, count) = *SHARE.iter().find(|(of, ..)| *of == faults).unwrap();
    let next = AtomicU64::new(from);
    let work = || {
        let mut outcomes = Vec::new();
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= from + count {
                return outcomes;
            }
            let outcome = run(seed, faults, false);
            let replay = format!("cargo run --release -p cyclorama-sim -- --replay {seed} --faults {}", faults.name());
            assert!(outcome.violations.is_empty(), "seed {seed}: {:#?}\nreplay it with: {replay}", outcome.violations);
            outcomes.push(outcome);
        }
    };
    std::thread::scope(|scope| {
        let threads = [scope.spawn(work), scope.spawn(work)];
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    })
}

fn most(outcomes: &[Outcome], of: impl Fn(&Outcome) -> Option<u64>) -> f64 {
    outcomes.iter().filter_map(of).max().expect("it happened in some runs") as f64 / 1e6
}

#[test]
fn ten_thousand_rigs_of_eight_boards_are_looked_at() {
    let plans =
        SHARE.iter().flat_map(|(faults, from, count)| (*from..from + count).map(|seed| Plan::draw(seed, *faults)));
    assert!(plans.filter(|plan| plan.boards == BOARDS_MAX).count() >= 10_000);
    const { assert!(END >= 5_000_000_000, "each for five seconds or more") };
}

#[test]
fn rigs_with_any_faults_are_right() {
    let outcomes = run_share(Faults::Any);
    let sum = |of: fn(&Outcome) -> u64| outcomes.iter().map(of).sum::<u64>();
    // They do meet what they are meant to meet.
    assert!(sum(|o| o.counts.late) > 0 && sum(|o| o.counts.put_out) > 0);
    assert!(sum(|o| o.counts.takeovers) > 0 && sum(|o| o.counts.held) > 0 && sum(|o| o.counts.early) > 0);
}

#[test]
fn the_same_seed_gives_the_same_log_byte_for_byte() {
    for seed in 0..20 {
        let [a, b] = [(); 2].map(|()| run(seed, Faults::Any, true).log.unwrap());
        assert!(a == b && a.len() > 10_000, "seed {seed}");
        assert!(run(seed + 1, Faults::Any, true).log.unwrap() != a, "another seed is another run");
    }
}

#[test]
fn leaves_joins_and_old_messages_cost_no_late_frame() {
    // The checkers allow late frames in the first second only, for the rig fills then.
    let outcomes = run_share(Faults::Harmless);
    assert!(outcomes.iter().all(|outcome| outcome.counts.put_out == 0));
}

#[test]
fn stalls_of_two_periods_put_nobody_out() {
    let outcomes = run_share(Faults::ShortStalls);
    let stalls: usize = (0..600).map(|seed| Plan::draw(seed, Faults::ShortStalls).faults.len()).sum();
    assert!(stalls > 6000 && outcomes.iter().all(|outcome| outcome.counts.put_out == 0));
}

#[test]
fn a_crash_is_repaired_within_a_tenth_of_a_second() {
    let outcomes = run_share(Faults::OneCrash);
    let (noticed, repaired) = (most(&outcomes, |o| o.counts.noticed), most(&outcomes, |o| o.counts.repaired));
    assert!(noticed <= 50.0 && repaired <= 100.0, "noticed after {noticed} ms, repaired after {repaired} ms");
}

#[test]
fn a_machine_without_power_is_noticed_within_four_periods() {
    let outcomes = run_share(Faults::OnePowerOff);
    let (noticed, repaired) = (most(&outcomes, |o| o.counts.noticed), most(&outcomes, |o| o.counts.repaired));
    assert!(noticed <= 67.0 && repaired <= 105.0, "noticed after {noticed} ms, repaired after {repaired} ms");
}

#[test]
fn a_stand_by_takes_over_and_repeats_no_frame() {
    for faults in [Faults::LeaderCrash, Faults::LeaderPowerOff] {
        let outcomes = run_share(faults);
        assert!(outcomes.iter().all(|outcome| outcome.counts.takeovers == 1), "{faults:?}");
        let led = most(&outcomes, |o| o.counts.noticed);
        let whole = most(&outcomes, |o| o.counts.repaired);
        assert!(
            led <= 200.0 && whole <= 250.0,
            "{faults:?}: the stand-by led after {led} ms, all was whole after {whole} ms"
        );
    }
}

#[test]
fn a_leader_that_dies_in_its_first_term_is_replaced_though_it_has_shown_nothing_by_it() {
    let outcomes = run_share(Faults::FirstTerm);
    assert!(outcomes.iter().all(|outcome| outcome.counts.takeovers == 1));
    let early = outcomes.iter().filter(|outcome| outcome.counts.early == 1).count();
    assert!(early * 2 > outcomes.len(), "{early} of {} had shown nothing", outcomes.len());
}

#[test]
fn a_leader_that_is_cut_off_and_comes_back_splits_nothing() {
    let outcomes = run_share(Faults::LeaderCut);
    assert!(outcomes.iter().any(|outcome| outcome.counts.takeovers > 0), "some were cut off from enough");
    assert!(outcomes.iter().any(|outcome| outcome.counts.held > 0), "some held what they could not show");
}
