//! What it costs a rig to be looked at: its frame time with viewers at the console, as a ratio to that without, in turns.

use crate::{Figure, Spread, at_most};
use serde::Serialize;

/// How many look, by turns.
pub const VIEWERS: [usize; 3] = [0, 1, 20];

/// A turn.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Turn {
    /// Viewers at the console.
    pub viewers: usize,
    /// Frames that were timed.
    pub frames: usize,
    /// Median from open to swap, ms.
    pub frame_ms: f64,
    /// Pictures a second that each viewer was sent, in the mean.
    pub pictures_hz: f64,
}

/// All turns with so many viewers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Viewers at the console.
    pub viewers: usize,
    /// Turns.
    pub turns: usize,
    /// Frames that were timed.
    pub frames: usize,
    /// The turns' medians, ms.
    pub frame_ms: Spread,
    /// To that without viewers, round by round.
    pub ratio: Spread,
    /// Where the ratio's true median is, 19 times of 20 ([`bounds`]).
    pub ratio_between: [f64; 2],
    /// Pictures a second that each viewer was sent, in the mean.
    pub pictures_hz: f64,
}

/// Fewest values whose first and last bound the median with that probability: 1 − 2 · 2⁻⁶ = 0.97.
const SURE_MIN: usize = 6;

/// Bounds of the median of what these values were drawn from, right 19 times of 20: those of them that stand 0.98 √n places before and behind the middle (the
/// binomial distribution's places, by its normal approximation). Of few values: the first and the last, which are as sure from six on only.
///
/// # Panics
/// If there are none.
pub fn bounds(values: &[f64]) -> [f64; 2] {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (count, spread) = (sorted.len() as f64, 0.98 * (sorted.len() as f64).sqrt());
    let before = (count / 2.0 - spread - 1.0).round().max(0.0) as usize;
    [sorted[before], sorted[sorted.len() - 1 - before]]
}

/// Rounds of turns, each with one of every number of [`VIEWERS`] in any order, as rows.
///
/// # Panics
/// If there are none, or one lacks a turn.
pub fn rows(rounds: &[Vec<Turn>]) -> Vec<Row> {
    let turn = |round: &'_ Vec<Turn>, viewers| {
        round.iter().find(|turn| turn.viewers == viewers).expect("every round has every turn").clone()
    };
    let row = |viewers| {
        let turns: Vec<_> = rounds.iter().map(|round| turn(round, viewers)).collect();
        let ratios: Vec<_> =
            rounds.iter().zip(&turns).map(|(round, of)| of.frame_ms / turn(round, 0).frame_ms).collect();
        Row {
            viewers,
            turns: turns.len(),
            frames: turns.iter().map(|turn| turn.frames).sum(),
            frame_ms: Spread::of(&turns.iter().map(|turn| turn.frame_ms).collect::<Vec<_>>()),
            ratio: Spread::of(&ratios),
            ratio_between: bounds(&ratios),
            pictures_hz: turns.iter().map(|turn| turn.pictures_hz).sum::<f64>() / turns.len() as f64,
        }
    };
    VIEWERS.map(row).to_vec()
}

/// The rows as a table.
pub fn table(rows: &[Row]) -> String {
    let is_sure = rows.iter().all(|row| row.turns >= SURE_MIN);
    let ratio = if is_sure { "ratio (19 of 20)" } else { "ratio (min to max)" };
    let mut text = format!("{:<8} {:>8} {:>12} {:>22} {:>14}\n", "viewers", "frames", "frame, ms", ratio, "pictures/s");
    for row in rows {
        let ratio = format!("{:.3} ({:.3} to {:.3})", row.ratio.median, row.ratio_between[0], row.ratio_between[1]);
        text += &format!(
            "{:<8} {:>8} {:>12.3} {ratio:>22} {:>14.1}\n",
            row.viewers, row.frames, row.frame_ms.median, row.pictures_hz
        );
    }
    text
}

/// Frame times with viewers and without are to be within 3 % of each other.
pub fn figures(rows: &[Row]) -> Vec<Figure> {
    let ratio = |viewers| {
        let row = rows.iter().find(|row| row.viewers == viewers);
        row.map(|row| row.ratio.median).ok_or_else(|| format!("{viewers} viewers were not tried"))
    };
    vec![
        at_most("console.one_viewer", "", "<= 1.03", 1.03, ratio(1)),
        at_most("console.twenty_viewers", "", "<= 1.03", 1.03, ratio(20)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_is_of_turns_of_one_round() {
        // The machine gets slower by half from round to round; what viewers cost is told all the same.
        let round = |k: i32, ms: f64| {
            let turn = |viewers, of| Turn { viewers, frames: 100, frame_ms: of, pictures_hz: 10.0 };
            let mut turns = vec![turn(0, ms), turn(1, ms * 1.01), turn(20, ms * 1.05)];
            turns.rotate_left(k as usize);
            turns
        };
        let rows = rows(&[round(0, 10.0), round(1, 15.0), round(2, 22.5)]);
        assert_eq!((rows[0].ratio.median, rows[0].frames), (1.0, 300));
        assert!((rows[1].ratio.max - 1.01).abs() < 1e-9 && (rows[2].ratio.min - 1.05).abs() < 1e-9);
        let met: Vec<_> = figures(&rows).iter().map(|figure| figure.met).collect();
        assert_eq!(met, [Some(true), Some(false)]);
        assert!(table(&rows).lines().count() == 4);
    }

    #[test]
    fn bounds_of_a_median_get_nearer_with_the_number_of_values() {
        // Values 1 to n, whatever their order.
        let between = |n: u32| bounds(&(1..=n).rev().map(f64::from).collect::<Vec<_>>());
        assert_eq!(between(1), [1.0, 1.0]);
        assert_eq!(between(3), [1.0, 3.0]);
        // Tables of the binomial distribution have places 10 and 21 of 30, and 40 and 61 of 100.
        assert_eq!(between(30), [10.0, 21.0]);
        assert_eq!(between(100), [40.0, 61.0]);
    }
}
