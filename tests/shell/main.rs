//! The real shells under a simulated network. Each scenario runs in a process of its own, so that all chance in it follows from its seed:
//! `CYCLORAMA_SHELL=NAME:SEED cargo test -p cyclorama-shell` runs one, and prints what happened.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test suite: a panic is a failure, and what is printed is its report"
)]

mod chance;
mod scenarios;

use scenarios::SCENARIOS;
use std::process::{Command, ExitCode, Output};
use std::sync::Mutex;

/// Which scenario a process of this program is to run, and by which seed.
const CHOICE: &str = "CYCLORAMA_SHELL";

/// What is run: scenario and seed, and how often; the same twice must give the same log.
const RUNS: [(&str, u64, u32); 12] = [
    ("boards_come_back_to_a_manager_that_was_killed_with_jittered_waits", 1, 1),
    ("a_neighbour_link_that_is_cut_is_rewired_round", 2, 1),
    ("a_partitioned_board_comes_back_by_itself", 3, 1),
    ("a_board_that_is_heard_and_hears_nothing_comes_back_by_itself", 4, 1),
    ("a_board_that_hears_and_is_not_heard_comes_back_by_itself", 5, 1),
    ("held_up_words_of_a_board_come_late_and_harm_nobody", 6, 1),
    ("peers_that_hang_are_cut", 7, 1),
    ("the_compositor_is_followed_and_goes_on_with_a_whole_picture", 8, 1),
    ("connections_again_and_again_leave_nothing_behind", 9, 1),
    ("anything_may_happen", 10, 2),
    ("anything_may_happen", 11, 1),
    ("anything_may_happen", 12, 1),
];

fn main() -> ExitCode {
    if let Ok(choice) = std::env::var(CHOICE) {
        let (name, seed) = choice.split_once(':').unwrap();
        let (_, scenario) = SCENARIOS.iter().find(|(other, _)| *other == name).expect("a scenario of this name");
        let seed = seed.parse().unwrap();
        chance::begin(seed);
        // Hash keys are drawn once a thread; those of this one are drawn by now.
        let log = std::thread::spawn(move || scenario(seed)).join();
        println!("{}", log.unwrap_or_else(|_| std::process::exit(1)));
        return ExitCode::SUCCESS;
    }
    let wanted: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|part| name.contains(part.as_str()));
    let runs: Vec<_> = RUNS.iter().filter(|(name, ..)| is_wanted(name)).collect();
    println!("\nrunning {} tests", runs.len());
    // Two at a time; in which order they are printed doesn't matter.
    let (waiting, failed) = (Mutex::new(runs.iter()), Mutex::new(0));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                loop {
                    let Some((name, seed, times)) = waiting.lock().unwrap().next() else { return };
                    let error = try_run(name, *seed, *times).err();
                    println!("test {name}, seed {seed} ... {}", if error.is_some() { "FAILED" } else { "ok" });
                    if let Some(error) = error {
                        println!("{error}");
                        *failed.lock().unwrap() += 1;
                    }
                }
            });
        }
    });
    let failed = failed.into_inner().unwrap();
    let verdict = if failed == 0 { "ok" } else { "FAILED" };
    println!("\ntest result: {verdict}. {} passed; {failed} failed; 0 ignored\n", runs.len() - failed);
    if failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn try_run(name: &str, seed: u64, times: u32) -> Result<(), String> {
    let first = run(name, seed)?;
    for _ in 1..times {
        let again = run(name, seed)?;
        if again != first {
            let differ = first.lines().zip(again.lines()).find(|(a, b)| a != b);
            return Err(format!("the same seed gives another log: {differ:?}"));
        }
    }
    Ok(())
}

/// Its log, or what went wrong.
fn run(name: &str, seed: u64) -> Result<String, String> {
    let own = std::env::current_exe().map_err(|error| error.to_string())?;
    let output = Command::new(own).env(CHOICE, format!("{name}:{seed}")).output();
    let Output { status, stdout, stderr } = output.map_err(|error| error.to_string())?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    if status.success() { Ok(text(&stdout)) } else { Err(format!("{status}\n{}{}", text(&stdout), text(&stderr))) }
}
