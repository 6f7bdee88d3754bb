//! The frame clock: open, ready, swap.
//!
//! In *real time* a frame opens at every tick of the (possibly halved) rate. It is swapped as soon as every view is
//! complete; a frame that isn't when the next tick comes is swapped all the same, and its incomplete views repeat their
//! last image as a whole. In *lock-step* there is no tick: a frame opens when the shell says that its pose is there, waits
//! for every board, and the next opens only after the compositor has shown it; a frame whose boards changed is drawn again
//! under the new wiring.

use super::Wiring;
use super::rate::{DIVIDER_MAX, RateControl};
use crate::ids::{BoardId, BoardKey, Epoch, FrameNumber};
use crate::message::Swap;
use crate::share::views_of;
use crate::time::Time;
use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

/// At the lowest rate a frame is waited for this long before its views repeat; without it boards that need longer than the
/// longest period would never show anything.
const PATIENCE: Duration = Duration::from_secs(5);

/// How frames follow one another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockMode {
    /// At a rate.
    RealTime {
        /// Nominal time from frame to frame.
        period: Duration,
    },
    /// One after the other.
    LockStep,
}

/// What the clock wants done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ClockOutput {
    /// All displays change.
    Swap {
        /// The message, less the preview wish.
        swap: Swap,
        /// When the frame was opened.
        opened: Time,
        /// Whether it was late: some view repeats.
        late: bool,
        /// The boards that are connected and were not ready ([`super::BackplaneChain::on_frame_over`]).
        missing: Vec<BoardKey>,
    },
}

#[derive(Clone, Debug)]
struct Open {
    frame: FrameNumber,
    wiring: Wiring,
    waiting: BTreeSet<BoardKey>,
    lost: BTreeSet<BoardKey>,
    opened: Time,
}

/// Late frames in a row that counted against the rate, and may have been late for want of boards that are dead: which isn't known before these have been silent for long
/// enough, by when their frames have halved the rate of a rig of two boards, and the frame that is whole again waits for its tick.
#[derive(Clone, Debug)]
struct Suspicion {
    /// What the rate was before the first of them.
    before: RateControl,
    /// The boards that all of these frames lacked.
    lacked: BTreeSet<BoardKey>,
}

/// See the module's head.
#[derive(Clone, Debug)]
pub struct FrameClock {
    mode: ClockMode,
    rate: RateControl,
    suspicion: Option<Suspicion>,
    next_frame: FrameNumber,
    next_tick: Time,
    open: Option<Open>,
    /// Lock-step: the frame that the compositor is to show before the next opens, and whose tiles make it up.
    presenting: Option<(FrameNumber, Vec<BoardKey>)>,
    /// Lock-step: the next frame has been open before.
    is_redraw: bool,
    views: u32,
    outputs: VecDeque<ClockOutput>,
}

impl FrameClock {
    /// A clock whose first tick is due at once. `first` is the first frame's number.
    pub fn new(mode: ClockMode, first: FrameNumber, views: u32) -> Self {
        let period = match mode {
            ClockMode::RealTime { period } => period,
            ClockMode::LockStep => Duration::from_millis(1),
        };
        Self {
            mode,
            rate: RateControl::new(period),
            suspicion: None,
            next_frame: first,
            next_tick: Time(0),
            open: None,
            presenting: None,
            is_redraw: false,
            views,
            outputs: VecDeque::new(),
        }
    }

    /// The number of the frame that would open next.
    pub fn next_frame(&self) -> FrameNumber {
        self.next_frame
    }

    /// Whether the next frame is one that has to be drawn again, so that its pose is known already.
    pub fn is_redraw(&self) -> bool {
        self.is_redraw
    }

    /// The frame being drawn.
    pub fn open_frame(&self) -> Option<FrameNumber> {
        self.open.as_ref().map(|open| open.frame)
    }

    /// How many nominal periods a frame takes at present.
    pub fn divider(&self) -> u32 {
        self.rate.divider()
    }

    /// How many of the picture's pixels, each way, one pixel drawn stands for at present.
    pub fn scale(&self) -> u32 {
        self.rate.scale()
    }

    /// Lets resolution fall to this part of the full one each way when boards can't follow at an eighth of the rate; a power of two.
    pub fn allow_scale(&mut self, scale_max: u32) {
        self.rate.allow_scale(scale_max);
    }

    /// Whether a frame should open now. In lock-step only the shell knows whether a pose is there; it asks this as well.
    pub fn wants_open(&self, now: Time) -> bool {
        let free = self.open.is_none() && self.presenting.is_none();
        match self.mode {
            ClockMode::RealTime { .. } => free && now >= self.next_tick,
            ClockMode::LockStep => free,
        }
    }

    /// When to call [`Self::on_timeout`] or look at [`Self::wants_open`] again.
    pub fn next_timeout(&self) -> Option<Time> {
        match (self.mode, &self.open) {
            (ClockMode::LockStep, _) => None,
            (ClockMode::RealTime { .. }, None) => Some(self.next_tick),
            (ClockMode::RealTime { .. }, Some(open)) => Some(self.deadline(open)),
        }
    }

    fn deadline(&self, open: &Open) -> Time {
        if self.rate.divider() >= DIVIDER_MAX { open.opened + PATIENCE } else { self.next_tick }
    }

    /// Real time: when the next frame should open, and the period in force.
    pub fn next_tick(&self) -> (Time, Duration) {
        (self.next_tick, self.rate.period())
    }

    /// The shell opens the next frame under `wiring`; returns its number. In lock-step the same number opens again
    /// after [`Self::on_rewired`].
    ///
    /// # Panics
    /// If a frame is open already.
    pub fn on_open(&mut self, now: Time, wiring: &Wiring) -> FrameNumber {
        assert!(self.open.is_none(), "frame {} is still open", self.next_frame);
        let frame = self.next_frame;
        self.next_frame.0 += 1;
        self.is_redraw = false;
        self.step_tick(now);
        let waiting = wiring.members.iter().copied().collect();
        self.open = Some(Open { frame, wiring: wiring.clone(), waiting, lost: BTreeSet::new(), opened: now });
        frame
    }

    /// Real time: the tick passes without a frame, because what is shown is what the frame would show. Returns the number that it
    /// would have had; it is used up.
    ///
    /// # Panics
    /// If a frame is open, or in lock-step, where every frame is wanted.
    pub fn on_idle(&mut self, now: Time) -> FrameNumber {
        assert!(self.open.is_none() && self.mode != ClockMode::LockStep, "frame {} is not idle", self.next_frame);
        let frame = self.next_frame;
        self.next_frame.0 += 1;
        self.suspicion = None;
        self.rate.on_idle();
        self.step_tick(now);
        frame
    }

    fn step_tick(&mut self, now: Time) {
        if let ClockMode::RealTime { .. } = self.mode {
            // Ticks keep their grid; one that was slept through is skipped, not made up for. So is one that would leave the frame less than half
            // a period, because it has waited for boards to draw it.
            let period = self.rate.period();
            self.next_tick = self.next_tick + period;
            if self.next_tick < now + period / 2 {
                self.next_tick = now + period;
            }
        }
    }

    /// A board has drawn its shares.
    pub fn on_ready(&mut self, now: Time, key: BoardKey, frame: FrameNumber, epoch: Epoch) {
        if let Some(open) = self.open.as_mut().filter(|o| o.frame == frame && o.wiring.epoch == epoch) {
            open.waiting.remove(&key);
            self.settle(now);
        }
    }

    /// A board is gone. In real time the frame no longer waits for it; its views repeat.
    pub fn on_lost(&mut self, now: Time, key: BoardKey) {
        if let Some(open) = &mut self.open
            && open.wiring.members.contains(&key)
        {
            // Even if it was ready: tiles that were under way went with its link.
            open.waiting.remove(&key);
            if open.lost.insert(key) {
                self.settle(now);
            }
        }
        self.acquit(now, key);
        if let Some((frame, boards)) = &self.presenting
            && boards.contains(&key)
        {
            self.on_missing(*frame);
        }
    }

    /// Lock-step: a new wiring has closed while a frame waits for a board that is gone. Returns whether that frame is to be opened
    /// again.
    pub fn on_rewired(&mut self) -> bool {
        match (&self.open, self.mode) {
            (Some(open), ClockMode::LockStep) if !open.lost.is_empty() => {
                self.next_frame = open.frame;
                self.is_redraw = true;
                self.open = None;
                true
            }
            _ => false,
        }
    }

    /// The compositor has shown a frame, or there is none to wait for.
    pub fn on_presented(&mut self, frame: FrameNumber) {
        if self.presenting.as_ref().is_some_and(|(presenting, _)| *presenting <= frame) {
            self.presenting = None;
        }
    }

    /// The compositor can't show a frame, for tiles were lost with a link: in lock-step it is drawn again.
    pub fn on_missing(&mut self, frame: FrameNumber) {
        if self.presenting_frame() == Some(frame) {
            self.presenting = None;
            self.next_frame = frame;
            self.is_redraw = true;
        }
    }

    /// Lock-step: the frame that the compositor is to show.
    pub fn presenting_frame(&self) -> Option<FrameNumber> {
        self.presenting.as_ref().map(|(frame, _)| *frame)
    }

    /// The compositor is gone: nothing waits for it.
    pub fn on_compositor_lost(&mut self) {
        self.presenting = None;
    }

    /// Time has passed.
    pub fn on_timeout(&mut self, now: Time) {
        let due = match (&self.open, self.mode) {
            (Some(open), ClockMode::RealTime { .. }) => now >= self.deadline(open),
            _ => false,
        };
        if due {
            // One board of many is hung or slow: a matter of its weight, not of everybody's rate.
            if let Some(open) = self.open.as_ref().filter(|open| open.waiting.len() * 2 >= open.wiring.members.len()) {
                let suspicion = match self.suspicion.take() {
                    Some(Suspicion { before, lacked }) if !lacked.is_disjoint(&open.waiting) => {
                        Suspicion { before, lacked: &lacked & &open.waiting }
                    }
                    _ => Suspicion { before: self.rate.clone(), lacked: open.waiting.clone() },
                };
                self.suspicion = Some(suspicion);
                self.rate.on_late();
            }
            self.swap();
        }
    }

    /// A board is gone. If none that is still there was late in all the frames that it was late in, the load wasn't to blame: the rate is what it was before them, and the next
    /// tick when it would have been.
    fn acquit(&mut self, now: Time, gone: BoardKey) {
        let Some(suspicion) = &mut self.suspicion else { return };
        if suspicion.lacked.remove(&gone) && suspicion.lacked.is_empty() {
            let slow = self.rate.period();
            self.rate = suspicion.before.clone();
            let sooner = slow.saturating_sub(self.rate.period());
            self.suspicion = None;
            if let ClockMode::RealTime { .. } = self.mode {
                self.next_tick = (self.next_tick - sooner).max(now);
            }
        }
    }

    /// Whether no frame is being drawn or waits to be shown.
    pub fn is_idle(&self) -> bool {
        self.open.is_none() && self.presenting.is_none()
    }

    /// The next thing to do; `None`: wait.
    pub fn poll_output(&mut self) -> Option<ClockOutput> {
        self.outputs.pop_front()
    }

    fn settle(&mut self, now: Time) {
        let Some(open) = &self.open else { return };
        if !open.waiting.is_empty() {
            return;
        }
        if open.lost.is_empty() {
            self.suspicion = None;
            self.rate.on_timely(now.since(open.opened));
            self.swap();
        } else if let ClockMode::RealTime { .. } = self.mode {
            // Not the survivors' fault: no reason to halve the rate.
            self.swap();
        }
    }

    fn swap(&mut self) {
        let Some(open) = self.open.take() else { return };
        let mut complete = vec![true; self.views as usize];
        for (i, key) in open.wiring.members.iter().enumerate() {
            if open.waiting.contains(key) || open.lost.contains(key) {
                for view in views_of(BoardId(i as u32), &open.wiring.weights, self.views) {
                    complete[view as usize] = false;
                }
            }
        }
        let late = complete.iter().any(|c| !c);
        let boards: Vec<_> = open
            .wiring
            .members
            .iter()
            .copied()
            .filter(|key| !open.waiting.contains(key) && !open.lost.contains(key))
            .collect();
        if self.mode == ClockMode::LockStep {
            self.presenting = Some((open.frame, boards.clone()));
        }
        self.outputs.push_back(ClockOutput::Swap {
            swap: Swap { frame: open.frame, epoch: open.wiring.epoch, complete, boards, preview: false, moment: None },
            opened: open.opened,
            late,
            missing: open.waiting.into_iter().collect(),
        });
    }
}
