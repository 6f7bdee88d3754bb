//! How much of the picture each board draws: one small integer each, from measured cost.
//!
//! Equal by default, and equal whenever unequal weights wouldn't help: while the slowest board has time to spare nothing is
//! changed, for every change is a new wiring. Weights follow *speed*, what a board draws of its weight per time, smoothed
//! over many frames, and change only for a clear gain, and seldom. So a load that goes up and down leaves them alone.

use crate::ids::BoardKey;
use crate::time::Time;
use std::collections::BTreeMap;
use std::time::Duration;

/// The largest weight. Small, because the sum of weights is the modulus of the lattice.
pub(super) const WEIGHT_MAX: u32 = 8;
/// Frames over which a cost is smoothed.
const SMOOTHING: u32 = 16;
/// Parts of a nanosecond in which costs are kept: whole numbers, so that states can be compared.
const FRACTION: u64 = 64;
/// Frames measured before a board's speed counts.
const FRAMES_MIN: u32 = 16;
/// The slowest board's part of a period from which on weights matter.
const BUSY: f64 = 0.7;
/// What the slowest board must gain for a change.
const GAIN: f64 = 0.8;
/// Shortest time between changes.
const PAUSE: Duration = Duration::from_secs(2);
/// What a miss adds to a board's account, and a timely frame takes away.
const MISS: u32 = 2;
/// Account from which a board's weight shrinks: four misses in a row.
const SHRINK: u32 = 4 * MISS;
/// Account at which a board is put out: eight in a row. A stall of two periods misses three frames at most.
const PUT_OUT: u32 = 8 * MISS;

const _: () = assert!(SHRINK > 3 * MISS, "a stall of two periods changes nothing");

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
struct Measured {
    /// Time per unit of weight, ns / [`FRACTION`].
    cost: u64,
    frames: u32,
    misses: u32,
    /// Its part of its fair weight, in eighths, that misses have left it.
    left: u32,
}

/// What follows from a miss.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Nothing yet.
    Wait,
    /// Its weight shrinks.
    Shrink,
    /// It is put out.
    PutOut,
}

/// See the module's head.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Weights {
    boards: BTreeMap<BoardKey, Measured>,
    changed: Option<Time>,
}

impl Weights {
    /// A board was ready in time, after drawing for `cost` under `weight`.
    pub(super) fn on_ready(&mut self, key: BoardKey, weight: u32, cost: Duration) {
        let measured = self.boards.entry(key).or_insert(Measured { left: WEIGHT_MAX, ..Measured::default() });
        measured.misses = measured.misses.saturating_sub(1);
        if measured.misses == 0 {
            measured.left = WEIGHT_MAX;
        }
        // A day at most, so that nothing overflows.
        let cost = cost.min(Duration::from_secs(86_400)).as_nanos() as u64;
        let unit = cost * FRACTION / u64::from(weight.max(1));
        let frames = u64::from(SMOOTHING.min(measured.frames.saturating_add(1)));
        measured.cost = (measured.cost * (frames - 1) + unit) / frames;
        measured.frames = measured.frames.saturating_add(1);
    }

    /// A board missed a frame that most others didn't.
    pub(super) fn on_missed(&mut self, key: BoardKey) -> Verdict {
        let measured = self.boards.entry(key).or_insert(Measured { left: WEIGHT_MAX, ..Measured::default() });
        measured.misses += MISS;
        if measured.misses >= PUT_OUT {
            Verdict::PutOut
        } else if measured.misses >= SHRINK && measured.left == WEIGHT_MAX {
            measured.left = WEIGHT_MAX / 2;
            Verdict::Shrink
        } else {
            Verdict::Wait
        }
    }

    /// Whether it is known that a board draws a part of that weight in a quarter of a period.
    pub(super) fn is_at_ease(&self, key: BoardKey, weight: u32, period: Duration) -> bool {
        let known = self.boards.get(&key).filter(|measured| measured.frames >= FRAMES_MIN);
        known.is_some_and(|measured| {
            let cost = u128::from(measured.cost) * u128::from(weight) / u128::from(FRACTION);
            cost * 4 <= period.as_nanos()
        })
    }

    /// A board is gone.
    pub(super) fn forget(&mut self, key: BoardKey) {
        self.boards.remove(&key);
    }

    /// Whether other weights than the present ones would be so much better that a new wiring is worth it.
    pub(super) fn wants_change(&self, now: Time, members: &[BoardKey], present: &[u32], period: Duration) -> bool {
        if self.changed.is_some_and(|changed| now.since(changed) < PAUSE) {
            return false;
        }
        let Some(units) = self.units(members) else { return false };
        let slowest = |weights: &[u32]| {
            let total: u32 = weights.iter().sum();
            let costs = units.iter().zip(weights).map(|(unit, weight)| unit * f64::from(*weight) / f64::from(total));
            costs.fold(0.0, f64::max)
        };
        let total: u32 = present.iter().sum();
        let is_busy = slowest(present) * f64::from(total) > BUSY * period.as_secs_f64();
        is_busy && slowest(&self.plan(members)) < GAIN * slowest(present)
    }

    /// A wiring with such weights takes effect.
    pub(super) fn on_active(&mut self, now: Time, present: &[u32], before: &[u32]) {
        // What has been measured per unit of weight is of the same part of the picture only while the sum is the same.
        let sum_of = |weights: &[u32]| weights.iter().map(|weight| u64::from(*weight)).sum::<u64>();
        let (sum, old) = (sum_of(present), sum_of(before));
        if present != before {
            self.changed = Some(now);
        }
        for measured in self.boards.values_mut().filter(|_| sum > 0 && old > 0) {
            measured.cost = measured.cost / sum * old;
        }
    }

    /// The weights for these boards: as their speeds are, at most [`WEIGHT_MAX`], without a common divisor. Equal unless every speed is
    /// known and they differ clearly.
    pub(super) fn plan(&self, members: &[BoardKey]) -> Vec<u32> {
        let left = |key| self.boards.get(key).map_or(WEIGHT_MAX, |measured| measured.left);
        let mut weights: Vec<u32> = match self.units(members) {
            Some(units) => {
                let fastest = units.iter().copied().fold(f64::INFINITY, f64::min);
                let weight = |unit: &f64| {
                    // As fast as the fastest, but for noise.
                    let speed = if fastest < GAIN * unit { fastest / unit } else { 1.0 };
                    (f64::from(WEIGHT_MAX) * speed).round().clamp(1.0, f64::from(WEIGHT_MAX)) as u32
                };
                units.iter().map(weight).collect()
            }
            None => vec![WEIGHT_MAX; members.len()],
        };
        for (weight, key) in weights.iter_mut().zip(members) {
            *weight = (*weight * left(key) / WEIGHT_MAX).max(1);
        }
        let divisor = weights.iter().copied().fold(0, gcd).max(1);
        weights.iter().map(|weight| weight / divisor).collect()
    }

    /// Time per unit of weight for each, s; `None` while one of them isn't known well.
    fn units(&self, members: &[BoardKey]) -> Option<Vec<f64>> {
        let unit = |key| {
            let measured = self.boards.get(key).filter(|measured| measured.frames >= FRAMES_MIN)?;
            (measured.cost > 0).then_some(measured.cost as f64 / FRACTION as f64 / 1e9)
        };
        members.iter().map(unit).collect()
    }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::watch::PERIOD;

    fn measured(costs_ms: &[f64]) -> (Weights, Vec<BoardKey>) {
        let keys: Vec<_> = (0..costs_ms.len() as u64).map(BoardKey).collect();
        let mut weights = Weights::default();
        for _ in 0..100 {
            for (key, cost) in keys.iter().zip(costs_ms) {
                weights.on_ready(*key, 1, Duration::from_secs_f64(cost / 1000.0));
            }
        }
        (weights, keys)
    }

    #[test]
    fn equal_boards_have_equal_weights_of_one() {
        let (weights, keys) = measured(&[10.0, 10.5, 9.8]);
        assert_eq!(weights.plan(&keys), [1, 1, 1]);
        assert_eq!(Weights::default().plan(&keys), [1, 1, 1]);
    }

    #[test]
    fn a_board_that_is_half_as_fast_gets_half() {
        let (weights, keys) = measured(&[6.0, 12.0, 6.0]);
        assert_eq!(weights.plan(&keys), [2, 1, 2]);
        assert!(weights.wants_change(Time(0), &keys, &[1, 1, 1], PERIOD));
        assert!(!weights.wants_change(Time(0), &keys, &[2, 1, 2], PERIOD), "it is settled");
    }

    #[test]
    fn boards_that_have_time_to_spare_are_left_alone() {
        let (weights, keys) = measured(&[1.0, 2.0, 1.0]);
        assert!(!weights.wants_change(Time(0), &keys, &[1, 1, 1], PERIOD));
    }

    #[test]
    fn a_load_that_wavers_does_not_change_weights_again_and_again() {
        let (mut weights, keys) = measured(&[8.0, 13.0]);
        let (mut present, mut changes) = (vec![1, 1], 0);
        for frame in 0..3600_u32 {
            let now = Time(0) + PERIOD * frame;
            let heavy = if frame / 60 % 2 == 0 { 13.0 } else { 10.0 };
            let total = f64::from(present.iter().sum::<u32>());
            for (key, (speed, weight)) in keys.iter().zip([8.0, heavy].into_iter().zip(&present)) {
                let cost = speed * 2.0 * f64::from(*weight) / total / 1000.0;
                weights.on_ready(*key, *weight, Duration::from_secs_f64(cost));
            }
            if weights.wants_change(now, &keys, &present, PERIOD) {
                let planned = weights.plan(&keys);
                weights.on_active(now, &planned, &present);
                present = planned;
                changes += 1;
            }
        }
        assert!(changes <= 2, "{changes} changes in a minute");
    }

    #[test]
    fn three_misses_change_nothing_four_shrink_and_eight_put_out() {
        let (mut weights, keys) = measured(&[5.0, 5.0]);
        let verdicts: Vec<_> = (0..8).map(|_| weights.on_missed(keys[0])).collect();
        assert!(verdicts[..3].iter().all(|verdict| *verdict == Verdict::Wait), "{verdicts:?}");
        assert_eq!((verdicts[3], verdicts[7]), (Verdict::Shrink, Verdict::PutOut));
        assert_eq!(weights.plan(&keys), [1, 2]);
    }
}
