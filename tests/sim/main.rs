//! `cyclorama-sim`: many seeds, or one with its log.
#![forbid(unsafe_code)]
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "a command's output")]

use cyclorama_sim::check::Counts;
use cyclorama_sim::plan::{END, Faults};
use cyclorama_sim::run;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

const USAGE: &str = "usage: cyclorama-sim [--seeds N] [--from SEED] [--faults any|none|harmless|short-stalls|crash|power-off|leader-crash|leader-power-off|leader-cut|first-term] [--threads N]
       cyclorama-sim --replay SEED [--faults …]   one seed, with its log";

struct Options {
    seeds: u64,
    from: u64,
    faults: Faults,
    replay: bool,
    threads: u64,
}

fn parse(mut words: impl Iterator<Item = String>) -> Option<Options> {
    let mut options = Options { seeds: 1000, from: 0, faults: Faults::Any, replay: false, threads: 2 };
    while let Some(word) = words.next() {
        let value = words.next()?;
        match word.as_str() {
            "--seeds" => options.seeds = value.parse().ok()?,
            "--from" => options.from = value.parse().ok()?,
            "--threads" => options.threads = value.parse().ok()?,
            "--replay" => (options.from, options.replay) = (value.parse().ok()?, true),
            "--faults" => options.faults = Faults::named(&value)?,
            _ => return None,
        }
    }
    Some(options)
}

fn main() -> ExitCode {
    let Some(options) = parse(std::env::args().skip(1)) else {
        eprintln!("{USAGE}");
        return ExitCode::FAILURE;
    };
    if options.replay { replay(&options) } else { many(&options) }
}

fn replay(options: &Options) -> ExitCode {
    let outcome = run(options.from, options.faults, true);
    print!("{}", outcome.log.unwrap_or_default());
    println!("{:?}", outcome.counts);
    for violation in &outcome.violations {
        println!("WRONG {violation}");
    }
    if outcome.violations.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn many(options: &Options) -> ExitCode {
    let (next, wrong) = (AtomicU64::new(0), AtomicU64::new(0));
    let began = Instant::now();
    let work = || {
        let mut all = Vec::new();
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            if i >= options.seeds {
                return all;
            }
            let seed = options.from + i;
            let outcome = run(seed, options.faults, false);
            if !outcome.violations.is_empty() && wrong.fetch_add(1, Ordering::Relaxed) < 10 {
                println!("seed {seed}: {}", outcome.violations[0]);
            }
            all.push((seed, outcome.counts));
        }
    };
    let counts: Vec<(u64, Counts)> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..options.threads.max(1)).map(|_| scope.spawn(work)).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap_or_default()).collect()
    });
    report(options, &counts, began.elapsed().as_secs_f64());
    match wrong.into_inner() {
        0 => ExitCode::SUCCESS,
        wrong => {
            println!(
                "{wrong} seeds were wrong; replay one with: cargo run --release -p cyclorama-sim -- --replay SEED"
            );
            ExitCode::FAILURE
        }
    }
}

fn report(options: &Options, counts: &[(u64, Counts)], seconds: f64) {
    let simulated = END as f64 / 1e9 * counts.len() as f64;
    let sum = |of: fn(&Counts) -> u64| counts.iter().map(|(_, counts)| of(counts)).sum::<u64>();
    println!(
        "{} seeds from {} in {seconds:.1} s: {:.0} seeds/s, {:.0} times real time",
        counts.len(),
        options.from,
        counts.len() as f64 / seconds,
        simulated / seconds
    );
    println!(
        "{} frames, {} late, {} held, {} boards put out, {} takeovers, {} of them from a first term that had shown nothing",
        sum(|c| c.frames),
        sum(|c| c.late),
        sum(|c| c.held),
        sum(|c| c.put_out),
        sum(|c| c.takeovers),
        sum(|c| c.early)
    );
    spread("noticed", counts.iter().filter_map(|(seed, c)| Some((c.noticed?, *seed))));
    spread("repaired", counts.iter().filter_map(|(seed, c)| Some((c.repaired?, *seed))));
}

/// Times with their seeds, so that the longest can be replayed.
fn spread(what: &str, times: impl Iterator<Item = (u64, u64)>) {
    let mut times: Vec<_> = times.collect();
    times.sort_unstable();
    let at = |place: usize| times[place].0 as f64 / 1e6;
    if let Some(last) = times.len().checked_sub(1) {
        let (p50, p99, max, seed) = (at(last / 2), at(last * 99 / 100), at(last), times[last].1);
        println!("{what} after the first fault: p50 {p50:.1} ms, p99 {p99:.1} ms, max {max:.1} ms (seed {seed})");
    }
}
