//! When boards can't follow, the frame rate halves for all views alike, and later their resolution (chain.md, Shares); both return when there is
//! time again.
//!
//! What is given up, step by step: the rate down to an eighth, then resolution as far as the rig allows, then the rest of the rate.
//! A picture of half the width and height costs a quarter, so it buys more than another halving of the rate, but it is the worse to
//! look at as long as the rate isn't very low.
//!
//! Deliberately slow to trust: three late frames (each late one counts, each timely one takes one back) take a step
//! at once, but only half a second of timely frames that would also have met what the step before asks for, with a fifth to spare, takes it back.
//! A step back that doesn't last was wrong: the next one needs twice as much time, and so on, so that a load between two
//! steps doesn't make the rate go up and down.

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
/// Resolution is touched only when the rate is this part of the nominal one.
const DIVIDER_BEFORE_SCALE: u32 = 8;

/// What is given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Step {
    /// Nominal periods that a frame takes.
    divider: u32,
    /// Pixels of the picture, each way, that one pixel drawn stands for.
    scale: u32,
}

impl Step {
    /// The step after, as long as there is one.
    fn further(self, scale_max: u32) -> Option<Self> {
        let Self { divider, scale } = self;
        if divider < DIVIDER_BEFORE_SCALE {
            Some(Self { divider: divider * 2, scale })
        } else if scale < scale_max {
            Some(Self { divider, scale: scale * 2 })
        } else {
            (divider < DIVIDER_MAX).then_some(Self { divider: divider * 2, scale })
        }
    }

    /// The step before, and how many times a frame's part of its period grows by it.
    fn back(self) -> Option<(Self, u32)> {
        let Self { divider, scale } = self;
        if divider > DIVIDER_BEFORE_SCALE {
            Some((Self { divider: divider / 2, scale }, 2))
        } else if scale > 1 {
            Some((Self { divider, scale: scale / 2 }, 4))
        } else {
            (divider > 1).then_some((Self { divider: divider / 2, scale }, 2))
        }
    }
}

/// See the module's head.
#[derive(Clone, Debug)]
pub struct RateControl {
    period: Duration,
    step: Step,
    /// Resolution is never given up further.
    scale_max: u32,
    late: u32,
    calm: u32,
    /// How many times as long as usual calm must last.
    doubt: u32,
    /// Nominal periods since the last rise.
    risen: u32,
    /// What the last timely frame took.
    took: Duration,
}

impl RateControl {
    /// Nominal period of a frame; full resolution always.
    pub fn new(period: Duration) -> Self {
        let step = Step { divider: 1, scale: 1 };
        Self { period, step, scale_max: 1, late: 0, calm: 0, doubt: 1, risen: PROBATION_PERIODS, took: Duration::ZERO }
    }

    /// Lets resolution fall to this part of the full one each way, a power of two.
    pub fn allow_scale(&mut self, scale_max: u32) {
        self.scale_max = scale_max;
    }

    /// The period in force.
    pub fn period(&self) -> Duration {
        self.period * self.step.divider
    }

    /// How many nominal periods a frame takes: a power of two.
    pub fn divider(&self) -> u32 {
        self.step.divider
    }

    /// How many of the picture's pixels, each way, one pixel drawn stands for: a power of two.
    pub fn scale(&self) -> u32 {
        self.step.scale
    }

    /// A frame was complete after `took`.
    pub fn on_timely(&mut self, took: Duration) {
        self.took = took;
        self.follow(took);
    }

    /// A tick passed without a frame, for nothing had changed. Boards that have nothing to do could follow any rate; but at another resolution all
    /// would have to be drawn, for which the last frame tells the cost: else a still picture would grow sharp, and blurred again, for ever.
    pub fn on_idle(&mut self) {
        let is_resolution_next = self.step.back().is_some_and(|(back, _)| back.scale != self.step.scale);
        self.follow(if is_resolution_next { self.took } else { Duration::ZERO });
    }

    fn follow(&mut self, took: Duration) {
        self.late = self.late.saturating_sub(1);
        self.pass();
        match self.step.back() {
            // A fifth to spare.
            Some((back, growth)) if took * growth * 5 < self.period() * 4 => {
                self.calm += 1;
                if self.calm >= (CALM_PERIODS / self.step.divider).max(CALM_FRAMES_MIN) * self.doubt {
                    self.calm = 0;
                    self.step = back;
                    self.risen = 0;
                }
            }
            _ => self.calm = 0,
        }
    }

    /// A frame was not complete when it was due.
    pub fn on_late(&mut self) {
        self.calm = 0;
        self.pass();
        // Bounded, or the lowest rate's late frames would weigh on the recovery.
        self.late = (self.late + 1).min(LATE_LIMIT);
        if self.late >= LATE_LIMIT
            && let Some(further) = self.step.further(self.scale_max)
        {
            self.late = 0;
            self.step = further;
            if self.risen < PROBATION_PERIODS {
                self.doubt = (self.doubt * 2).min(DOUBT_MAX);
            }
            // One wrong rise is counted once.
            self.risen = PROBATION_PERIODS;
        }
    }

    fn pass(&mut self) {
        if self.risen < PROBATION_PERIODS {
            self.risen += self.step.divider;
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

    /// A load by pixels: what it costs falls with the square of the resolution.
    #[test]
    fn resolution_is_given_up_after_the_rate_and_returns_before_it() {
        let mut rate = RateControl::new(Duration::from_millis(16));
        rate.allow_scale(4);
        let mut steps = vec![(1, 1)];
        // Heavier and heavier, then lighter and lighter.
        for full_ms in (1..=60).map(|k| k * 50).chain((1..=60).rev().map(|k| k * 50)).chain([4]) {
            for _ in 0..400 {
                let took = Duration::from_millis(full_ms) / (rate.scale() * rate.scale());
                if took < rate.period() {
                    rate.on_timely(took);
                } else {
                    rate.on_late();
                }
                if steps.last() != Some(&(rate.divider(), rate.scale())) {
                    steps.push((rate.divider(), rate.scale()));
                }
            }
        }
        let down = [(1, 1), (2, 1), (4, 1), (8, 1), (8, 2), (8, 4), (16, 4)];
        let up = down.iter().rev().skip(1);
        let expected: Vec<_> = down.iter().chain(up).copied().collect();
        steps.dedup();
        assert_eq!(steps, expected);
    }

    #[test]
    fn a_still_picture_gets_its_resolution_back_only_if_it_can_be_drawn_in_time() {
        for (full_ms, scale) in [(600, 2), (60, 1)] {
            let mut rate = RateControl::new(Duration::from_millis(16));
            rate.allow_scale(2);
            while rate.scale() == 1 {
                rate.on_late();
            }
            (0..10).for_each(|_| rate.on_timely(Duration::from_millis(full_ms) / 4));
            (0..1000).for_each(|_| rate.on_idle());
            assert_eq!(rate.scale(), scale, "{full_ms} ms");
        }
    }

    #[test]
    fn without_leave_resolution_stays() {
        let mut rate = RateControl::new(Duration::from_millis(16));
        for _ in 0..1000 {
            rate.on_late();
        }
        assert_eq!((rate.divider(), rate.scale()), (DIVIDER_MAX, 1));
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
