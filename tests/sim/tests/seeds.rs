//! Seeds in the share of the ordinary test command. Longer: `cargo run --release -p cyclorama-sim -- --seeds 10000`.
#![expect(clippy::unwrap_used, reason = "a test that can't go on has failed")]

use cyclorama_sim::plan::{Faults, Plan};
use cyclorama_sim::{Outcome, run};
use std::sync::atomic::{AtomicU64, Ordering};

fn name(faults: Faults) -> &'static str {
    match faults {
        Faults::Any => "any",
        Faults::None => "none",
        Faults::Harmless => "harmless",
        Faults::ShortStalls => "short-stalls",
        Faults::OneCrash => "crash",
        Faults::OnePowerOff => "power-off",
        Faults::LeaderCrash => "leader-crash",
        Faults::LeaderPowerOff => "leader-power-off",
        Faults::LeaderCut => "leader-cut",
    }
}

/// Runs seeds on two threads; every one must be right.
fn run_seeds(faults: Faults, from: u64, count: u64) -> Vec<Outcome> {
    let next = AtomicU64::new(from);
    let work = || {
        let mut outcomes = Vec::new();
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= from + count {
                return outcomes;
            }
            let outcome = run(seed, faults, false);
            let replay = format!("cargo run --release -p cyclorama-sim -- --replay {seed} --faults {}", name(faults));
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
fn a_thousand_rigs_with_any_faults_are_right() {
    let outcomes = run_seeds(Faults::Any, 1_000_000, 1000);
    let sum = |of: fn(&Outcome) -> u64| outcomes.iter().map(of).sum::<u64>();
    // They do meet what they are meant to meet.
    assert!(sum(|o| o.counts.late) > 0 && sum(|o| o.counts.put_out) > 0);
    assert!(sum(|o| o.counts.takeovers) > 0 && sum(|o| o.counts.held) > 0);
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
    let outcomes = run_seeds(Faults::Harmless, 0, 200);
    assert!(outcomes.iter().all(|outcome| outcome.counts.put_out == 0));
}

#[test]
fn stalls_of_two_periods_put_nobody_out() {
    let outcomes = run_seeds(Faults::ShortStalls, 0, 200);
    let stalls: usize = (0..200).map(|seed| Plan::draw(seed, Faults::ShortStalls).faults.len()).sum();
    assert!(stalls > 2000 && outcomes.iter().all(|outcome| outcome.counts.put_out == 0));
}

#[test]
fn a_crash_is_repaired_within_a_tenth_of_a_second() {
    let outcomes = run_seeds(Faults::OneCrash, 0, 200);
    let (noticed, repaired) = (most(&outcomes, |o| o.counts.noticed), most(&outcomes, |o| o.counts.repaired));
    assert!(noticed <= 50.0 && repaired <= 100.0, "noticed after {noticed} ms, repaired after {repaired} ms");
}

#[test]
fn a_machine_without_power_is_noticed_within_four_periods() {
    let outcomes = run_seeds(Faults::OnePowerOff, 0, 200);
    let (noticed, repaired) = (most(&outcomes, |o| o.counts.noticed), most(&outcomes, |o| o.counts.repaired));
    assert!(noticed <= 67.0 && repaired <= 120.0, "noticed after {noticed} ms, repaired after {repaired} ms");
}

#[test]
fn a_stand_by_takes_over_and_repeats_no_frame() {
    for faults in [Faults::LeaderCrash, Faults::LeaderPowerOff] {
        let outcomes = run_seeds(faults, 0, 100);
        assert!(outcomes.iter().all(|outcome| outcome.counts.takeovers == 1), "{faults:?}");
        let led = most(&outcomes, |o| o.counts.noticed);
        assert!(led <= 250.0, "{faults:?}: the stand-by led after {led} ms");
    }
}

#[test]
fn a_leader_that_is_cut_off_and_comes_back_splits_nothing() {
    let outcomes = run_seeds(Faults::LeaderCut, 0, 200);
    assert!(outcomes.iter().any(|outcome| outcome.counts.takeovers > 0), "some were cut off from enough");
    assert!(outcomes.iter().any(|outcome| outcome.counts.held > 0), "some held what they could not show");
}
