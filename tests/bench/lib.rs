//! What benchmarks print: spreads of times, rows, figures with their targets, and charts of error against time.
//!
//! A report names the machine and the commit, so that a kept result can be traced. Times never decide anything here: a
//! figure that misses its target is printed as missed.

pub mod chain;
pub mod chart;
pub mod console;
mod date;
pub mod disturbed;
pub mod latency;
pub mod lists;
pub mod memory;
pub mod pixels;
pub mod relay;
pub mod wire;

use serde::Serialize;
use std::fmt;
use std::process::Command;

/// Smallest, middle and largest of some values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Smallest.
    pub min: f64,
    /// Median; of an even number of values the lower of the middle two.
    pub median: f64,
    /// Largest.
    pub max: f64,
}

impl Spread {
    /// Of these values.
    ///
    /// # Panics
    /// If there are none.
    pub fn of(values: &[f64]) -> Self {
        assert!(!values.is_empty(), "a spread of nothing");
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        Self { min: sorted[0], median: sorted[(sorted.len() - 1) / 2], max: sorted[sorted.len() - 1] }
    }
}

/// One of proof.md's figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// Its name there.
    pub figure: &'static str,
    /// What was measured; `None` when it couldn't be.
    pub value: Option<f64>,
    /// Of the value.
    pub unit: &'static str,
    /// What is aimed at, in words.
    pub target: &'static str,
    /// Whether the target is met; `None` without a value.
    pub met: Option<bool>,
    /// Why there is no value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
}

/// One line of a table: name, value, unit, target, and whether it is met or why it isn't known.
impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = match (self.met, &self.why) {
            (Some(true), _) => "met",
            (Some(false), _) => "missed",
            (None, Some(why)) => why,
            (None, None) => "",
        };
        let value = self.value.map_or("-".into(), |value| match value {
            value if value != 0.0 && value.abs() < 1e-3 => format!("{value:.2e}"),
            value => format!("{value:.3}"),
        });
        write!(f, "{:<28} {value:>10} {:<10} {:<8} {verdict}", self.figure, self.unit, self.target)
    }
}

/// A figure that is to be no more than a limit.
fn at_most(
    figure: &'static str,
    unit: &'static str,
    target: &'static str,
    limit: f64,
    value: Result<f64, String>,
) -> Figure {
    judged(figure, unit, target, value, |value| value <= limit)
}

/// A figure that is to be no less than a limit.
fn at_least(
    figure: &'static str,
    unit: &'static str,
    target: &'static str,
    limit: f64,
    value: Result<f64, String>,
) -> Figure {
    judged(figure, unit, target, value, |value| value >= limit)
}

fn judged(
    figure: &'static str,
    unit: &'static str,
    target: &'static str,
    value: Result<f64, String>,
    is_met: impl Fn(f64) -> bool,
) -> Figure {
    let (value, why) = match value {
        Ok(value) => (Some(value), None),
        Err(why) => (None, Some(why)),
    };
    Figure { figure, value, unit, target, met: value.map(is_met), why }
}

/// What `bench … --json` prints.
#[derive(Clone, Debug, Serialize)]
pub struct Report<R> {
    /// Which benchmark.
    pub bench: &'static str,
    /// Of the working tree, or `unknown`.
    pub commit: String,
    /// When, UTC.
    pub date: String,
    /// Processor and number of cores.
    pub machine: String,
    /// The measurements.
    pub rows: Vec<R>,
    /// The figures that follow from them.
    pub figures: Vec<Figure>,
}

impl<R> Report<R> {
    /// A report of this machine and commit.
    pub fn new(bench: &'static str, rows: Vec<R>, figures: Vec<Figure>) -> Self {
        Self { bench, commit: commit(), date: date::now(), machine: machine(), rows, figures }
    }
}

/// The commit of the working tree, if git knows; with `-dirty` if there is more in the tree.
fn commit() -> String {
    let output = Command::new("git").args(["describe", "--always", "--dirty", "--exclude=*"]).output();
    let text = output.ok().filter(|output| output.status.success()).map(|output| output.stdout);
    text.map_or_else(|| "unknown".into(), |text| String::from_utf8_lossy(&text).trim().to_owned())
}

/// What this machine is.
fn machine() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")).and_then(|line| line.split(':').nth(1));
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get);
    format!("{}, {cores} cores, {}", model.unwrap_or(" unknown processor").trim(), std::env::consts::OS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_sorted() {
        assert_eq!(Spread::of(&[3.0, 1.0, 2.0]), Spread { min: 1.0, median: 2.0, max: 3.0 });
        assert_eq!(Spread::of(&[4.0, 1.0]).median, 1.0);
    }
}
