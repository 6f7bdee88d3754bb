//! When boards can't follow, the frame rate halves for all views alike (chain.md, Shares); it returns when there is time again.
//!
//! Deliberately slow to trust: three late frames (each late one counts, each timely one takes one back) halve the rate
//! at once, but only half a second of timely frames that would also have met the doubled rate with a fifth to spare doubles it.
//! A rise that doesn't last was wrong: the next one needs twice as much time, and so on, so that a load between two
//! rates doesn't make the rate go up and down.

use std::time::Duration;

/// Late frames, less timely ones, that halve the rate.
const LATE_LIMIT: u32 = 3;
/// Nominal periods of timely frames in a row before the rate doubles: half a second at 60 Hz.
const CALM_PERIODS: u32 = 30;
/// But at least this many frames, for at the lowest rates half a second is one.
const CALM_FRAMES_MIN: u32 = 4;
/// Nominal periods after a rise within which a fall shows that it was wrong.
const PROBATION_PERIODS: u32 = 120;
/// How many times as long as usual calm must last at most, after wrong rises: eight seconds.
const DOUBT_MAX: u32 = 16;
/// The rate is never less than this part of the nominal one.
pub(super) const DIVIDER_MAX: u32 = 32;

/// See the module's head.
#[derive(Clone, Debug)]
pub struct RateControl {
    period: Duration,
    divider: u32,
    late: u32,
    calm: u32,
    /// How many times as long as usual calm must last.
    doubt: u32,
    /// Nominal periods since the last rise.
    risen: u32,
}

impl RateControl {
    /// Nominal period of a frame.
    pub fn new(period: Duration) -> Self {
        Self { period, divider: 1, late: 0, calm: 0, doubt: 1, risen: PROBATION_PERIODS }
    }

    /// The period in force.
    pub fn period(&self) -> Duration {
        self.period * self.divider
    }

    /// How many nominal periods a frame takes: a power of two.
    pub fn divider(&self) -> u32 {
        self.divider
    }

    /// A frame was complete after `took`.
    pub fn on_timely(&mut self, took: Duration) {
        self.late = self.late.saturating_sub(1);
        self.step();
        if self.divider > 1 && took * 5 < self.period() * 2 {
            self.calm += 1;
            if self.calm >= (CALM_PERIODS / self.divider).max(CALM_FRAMES_MIN) * self.doubt {
                self.calm = 0;
                self.divider /= 2;
                self.risen = 0;
            }
        } else {
            self.calm = 0;
        }
    }

    /// A frame was not complete when it was due.
    pub fn on_late(&mut self) {
        self.calm = 0;
        self.step();
        // Bounded, or the lowest rate's late frames would weigh on the recovery.
        self.late = (self.late + 1).min(LATE_LIMIT);
        if self.late >= LATE_LIMIT && self.divider < DIVIDER_MAX {
            self.late = 0;
            self.divider *= 2;
            if self.risen < PROBATION_PERIODS {
                self.doubt = (self.doubt * 2).min(DOUBT_MAX);
            }
            // One wrong rise is counted once.
            self.risen = PROBATION_PERIODS;
        }
    }

    fn step(&mut self) {
        if self.risen < PROBATION_PERIODS {
            self.risen += self.divider;
            if self.risen >= PROBATION_PERIODS {
                self.doubt = 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settle(cost: Duration) -> RateControl {
        let mut rate = RateControl::new(Duration::from_millis(16));
        for _ in 0..1000 {
            if cost < rate.period() { rate.on_timely(cost) } else { rate.on_late() }
        }
        rate
    }

    #[test]
    fn a_constant_load_settles_at_the_rate_it_can_keep() {
        assert_eq!(settle(Duration::from_millis(10)).divider(), 1);
        assert_eq!(settle(Duration::from_millis(20)).divider(), 2);
        assert_eq!(settle(Duration::from_millis(100)).divider(), 8);
    }

    #[test]
    fn the_rate_returns_when_the_load_goes() {
        let mut rate = settle(Duration::from_millis(100));
        for _ in 0..5 * CALM_PERIODS {
            rate.on_timely(Duration::from_millis(5));
        }
        assert_eq!(rate.divider(), 1);
    }

    /// Heavy frames come in bursts that the full rate can't keep; in between it could.
    #[test]
    fn a_load_between_two_rates_does_not_make_the_rate_go_up_and_down() {
        let mut rate = RateControl::new(Duration::from_millis(16));
        let (mut at, mut changes) = (0, 0);
        // A minute.
        while at < 3600 {
            let cost = Duration::from_millis(if at / 10 % 10 == 0 { 18 } else { 10 });
            let before = rate.divider();
            at += before;
            if cost < rate.period() {
                rate.on_timely(cost);
            } else {
                rate.on_late();
            }
            changes += u32::from(rate.divider() != before);
        }
        assert!(changes <= 24, "{changes} changes in a minute");
    }

    #[test]
    fn one_late_frame_changes_nothing() {
        let mut rate = RateControl::new(Duration::from_millis(16));
        for _ in 0..100 {
            rate.on_late();
            rate.on_timely(Duration::from_millis(10));
        }
        assert_eq!(rate.divider(), 1);
    }
}
