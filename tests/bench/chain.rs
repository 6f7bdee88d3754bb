//! How long a rig takes to notice that a board has gone, to be whole again, and to take one in.

use crate::{Figure, at_most};
use serde::Serialize;
use std::fmt;

/// What was done to the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// A board was killed by SIGKILL: its links close.
    Killed,
    /// A board was stopped by SIGSTOP: its links stay open, and nothing comes.
    Silent,
    /// A board was asked to leave by SIGTERM.
    Left,
    /// A board came.
    Joined,
    /// A board was stopped for two frame periods, while all cores were busy.
    Stalled,
    /// The manager was killed, and another started in its place at once.
    Restarted,
    /// The manager was killed, and had a stand-by.
    TakenOver,
    /// The manager was stopped by SIGSTOP, and had a stand-by.
    BySilence,
}

impl fmt::Display for What {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Killed => "killed",
            Self::Silent => "silent",
            Self::Left => "left",
            Self::Joined => "joined",
            Self::Stalled => "stalled",
            Self::Restarted => "restarted",
            Self::TakenOver => "taken over",
            Self::BySilence => "by silence",
        })
    }
}

/// A distribution.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quantiles {
    /// Median.
    pub p50: f64,
    /// 99 % are no larger.
    pub p99: f64,
    /// The largest.
    pub max: f64,
}

impl Quantiles {
    /// Of these values; `None` of none.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        // The smallest value that so large a part is not above.
        let at = |part: f64| sorted.get(((part * sorted.len() as f64).ceil() as usize).saturating_sub(1)).copied();
        Some(Self { p50: at(0.5)?, p99: at(0.99)?, max: at(1.0)? })
    }
}

/// All times that one thing was done.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// What was done.
    pub what: What,
    /// How often.
    pub count: usize,
    /// From the deed until the manager's log had it, ms; of a manager, until the other led.
    pub detect_ms: Option<Quantiles>,
    /// Until a frame was shown of which all views were whole; of who joined, until its first part of a frame was shown, from its connection on; ms.
    pub repair_ms: Option<Quantiles>,
    /// Frames with views that repeated, each time.
    pub late_frames: Option<Quantiles>,
    /// Boards that were put out or lost without having been touched, or that were only stalled.
    pub expelled: u64,
    /// Meshes and textures that were sent again.
    pub resent: u64,
}

/// The rows as a table.
pub fn table(rows: &[Row]) -> String {
    let mut text = format!(
        "{:<10} {:>5} | {:>8} {:>8} {:>8} | {:>8} {:>8} {:>8} | {:>6} {:>6} | {:>8} {:>6}\n{:16} | {:^26} | {:^26} | {:^13} |\n",
        "",
        "times",
        "p50",
        "p99",
        "max",
        "p50",
        "p99",
        "max",
        "p50",
        "max",
        "expelled",
        "resent",
        "",
        "noticed, ms",
        "whole again, ms",
        "late frames"
    );
    let three = |values: &Option<Quantiles>| {
        values.map_or(format!("{:>8} {:>8} {:>8}", "-", "-", "-"), |q| {
            format!("{:8.1} {:8.1} {:8.1}", q.p50, q.p99, q.max)
        })
    };
    for row in rows {
        let late = row.late_frames.map_or(format!("{:>6} {:>6}", "-", "-"), |q| format!("{:6.0} {:6.0}", q.p50, q.max));
        text += &format!(
            "{:<10} {:>5} | {} | {} | {late} | {:>8} {:>6}\n",
            row.what,
            row.count,
            three(&row.detect_ms),
            three(&row.repair_ms),
            row.expelled,
            row.resent
        );
    }
    text
}

/// proof.md's figures of the chain.
pub fn figures(rows: &[Row]) -> Vec<Figure> {
    let row = |what: What| rows.iter().find(|row| row.what == what).ok_or_else(|| format!("nothing was {what}"));
    let times = |what: What, of: fn(&Row) -> Option<Quantiles>| {
        of(row(what)?).ok_or_else(|| format!("nothing was measured of what was {what}"))
    };
    let repaired = || {
        let killed = times(What::Killed, |row| row.repair_ms)?.p99;
        Ok(times(What::Silent, |row| row.repair_ms).map_or(killed, |silent| killed.max(silent.p99)))
    };
    vec![
        at_most("chain.detect_p99_ms", "ms", "<= 50", 50.0, times(What::Killed, |row| row.detect_ms).map(|q| q.p99)),
        at_most(
            "chain.detect_silent_p99_ms",
            "ms",
            "<= 67",
            67.0,
            times(What::Silent, |row| row.detect_ms).map(|q| q.p99),
        ),
        at_most("chain.repair_p99_ms", "ms", "<= 100", 100.0, repaired()),
        at_most("chain.leave_late_frames", "", "0", 0.0, times(What::Left, |row| row.late_frames).map(|q| q.max)),
        at_most("chain.join_draw_ms", "ms", "<= 1000", 1000.0, times(What::Joined, |row| row.repair_ms).map(|q| q.max)),
        at_most(
            "chain.restart_ms",
            "ms",
            "<= 2000",
            2000.0,
            times(What::Restarted, |row| row.repair_ms).map(|q| q.max),
        ),
        at_most("chain.standby_ms", "ms", "<= 250", 250.0, times(What::TakenOver, |row| row.repair_ms).map(|q| q.max)),
        at_most(
            "chain.false_expulsions",
            "",
            "0",
            0.0,
            row(What::Stalled).map(|_| rows.iter().map(|row| row.expelled).sum::<u64>() as f64),
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_occurred() {
        let values: Vec<f64> = (1..=200).rev().map(f64::from).collect();
        assert_eq!(Quantiles::of(&values), Some(Quantiles { p50: 100.0, p99: 198.0, max: 200.0 }));
        assert_eq!(Quantiles::of(&[7.0]), Some(Quantiles { p50: 7.0, p99: 7.0, max: 7.0 }));
        assert_eq!(Quantiles::of(&[]), None);
    }

    #[test]
    fn the_worse_way_to_go_decides_and_what_was_not_done_has_no_figure() {
        let row = |what, repair: f64, expelled| Row {
            what,
            count: 1,
            detect_ms: Quantiles::of(&[3.0]),
            repair_ms: Quantiles::of(&[repair]),
            late_frames: Quantiles::of(&[1.0]),
            expelled,
            resent: 0,
        };
        let found = figures(&[
            row(What::Killed, 40.0, 0),
            row(What::Silent, 120.0, 1),
            row(What::Stalled, 0.0, 0),
            row(What::TakenOver, 90.0, 0),
            row(What::BySilence, 300.0, 0),
        ]);
        let of =
            |name: &str| found.iter().find(|figure| figure.figure == name).map(|figure| (figure.value, figure.met));
        assert_eq!(of("chain.repair_p99_ms"), Some((Some(120.0), Some(false))));
        assert_eq!(of("chain.detect_p99_ms"), Some((Some(3.0), Some(true))));
        assert_eq!(of("chain.false_expulsions"), Some((Some(1.0), Some(false))));
        assert_eq!(of("chain.standby_ms"), Some((Some(90.0), Some(true))));
        assert_eq!(of("chain.leave_late_frames"), Some((None, None)));
    }
}
