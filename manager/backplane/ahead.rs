//! Selecting for the next frame while boards draw the present one: only when one period doesn't suffice for both, for what is selected before
//! its tick can't show a pose that comes in between (chain.md, Frames and swaps).
//!
//! Selection then begins so long before the tick that it is done by it, and poses that come after that wait for the frame after. The manager
//! has one thread for frames, so a frame whose boards are ready meanwhile is swapped when selection is over.

use proto::time::Time;
use std::collections::VecDeque;
use std::time::Duration;

/// Frames in a row for which a period wasn't enough before selection goes ahead: one fewer than halve the rate.
const TIGHT_FRAMES: u32 = 2;
/// Frames in a row for which it would have been enough before it no longer does: two seconds at 60 Hz.
const EASY_FRAMES: u32 = 120;
/// How many poses may wait for a frame that doesn't open; then the oldest is taken, and selection has been made in vain.
const HELD_MAX: usize = 64;

/// Whether selection goes ahead of the tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SelectAhead {
    /// When one period isn't enough for selecting and drawing one after the other.
    #[default]
    Auto,
    /// Always, so that latency is the same whatever a frame takes.
    Always,
    /// Never: what is shown is never older than need be, and the rate falls instead.
    Never,
}

/// See the module's head. `P` is a pose with where it came from.
#[derive(Debug)]
pub(crate) struct Ahead<P> {
    wish: SelectAhead,
    is_on: bool,
    tight: u32,
    easy: u32,
    /// What the manager took for the last frame, until boards had it.
    selecting: Duration,
    /// What the slowest board has taken to draw since that frame was opened.
    drawing: Duration,
    /// The next frame's selection has been made.
    is_made: bool,
    held: VecDeque<P>,
}

impl<P> Ahead<P> {
    /// Before the first frame.
    pub(crate) fn new(wish: SelectAhead) -> Self {
        let (selecting, drawing) = (Duration::ZERO, Duration::ZERO);
        Self {
            wish,
            is_on: wish == SelectAhead::Always,
            tight: 0,
            easy: 0,
            selecting,
            drawing,
            is_made: false,
            held: VecDeque::new(),
        }
    }

    /// Whether it goes ahead even if no frame is drawn meanwhile.
    pub(crate) fn is_always(&self) -> bool {
        self.wish == SelectAhead::Always
    }

    /// A board has drawn a frame.
    pub(crate) fn on_drawn(&mut self, took: Duration) {
        self.drawing = self.drawing.max(took);
    }

    /// A frame has been sent, after the manager had `selected` for so long in all, ahead of the tick or after; `period` is the one in force. Returns the
    /// poses that have waited for it, which are the next frame's.
    pub(crate) fn on_sent(&mut self, selected: Duration, period: Duration) -> VecDeque<P> {
        // What boards took belongs to the frame before, and that is near enough.
        let fits = |time: Duration, tenths: u32| time * 10 <= period * tenths;
        let both = selected + self.drawing;
        let is_tight = !fits(both, 9) && fits(self.drawing, 9) && fits(selected, 9);
        self.tight = if is_tight { self.tight + 1 } else { 0 };
        self.easy = if fits(both, 7) { self.easy + 1 } else { 0 };
        match self.wish {
            SelectAhead::Auto if self.tight >= TIGHT_FRAMES => self.is_on = true,
            SelectAhead::Auto if self.easy >= EASY_FRAMES => self.is_on = false,
            SelectAhead::Auto => {}
            SelectAhead::Always => self.is_on = true,
            SelectAhead::Never => self.is_on = false,
        }
        (self.selecting, self.drawing) = (selected, Duration::ZERO);
        self.is_made = false;
        std::mem::take(&mut self.held)
    }

    /// When selection for the frame of that tick should begin; `None`: with the frame.
    pub(crate) fn due(&self, tick: Time) -> Option<Time> {
        // Half as much again, for selection varies.
        let lead = self.selecting + self.selecting / 2 + Duration::from_millis(1);
        (self.is_on && !self.is_made).then(|| tick - lead)
    }

    /// The next frame's selection has been made ahead.
    pub(crate) fn on_made(&mut self) {
        self.is_made = true;
    }

    /// Whether it has.
    pub(crate) fn is_made(&self) -> bool {
        self.is_made
    }

    /// A pose that came after the selection. Returns one to be taken at once, if too many wait.
    pub(crate) fn hold(&mut self, pose: P) -> Option<P> {
        self.held.push_back(pose);
        if self.held.len() > HELD_MAX { self.held.pop_front() } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);
    const PERIOD: Duration = Duration::from_millis(16);

    /// Whether selection goes ahead after so many frames that take so long, ms.
    fn after(ahead: &mut Ahead<u32>, frames: u32, selecting: u32, drawing: u32) -> bool {
        for _ in 0..frames {
            ahead.on_drawn(MS * drawing);
            ahead.on_sent(MS * selecting, PERIOD);
        }
        ahead.due(Time(0) + PERIOD).is_some()
    }

    #[test]
    fn selection_goes_ahead_only_where_that_helps_and_while_it_does() {
        let mut ahead = Ahead::new(SelectAhead::Auto);
        assert!(!after(&mut ahead, 100, 4, 8), "both fit into a period");
        assert!(!after(&mut ahead, 100, 1, 20), "drawing alone does not");
        assert!(!after(&mut ahead, 1, 6, 12), "one frame decides nothing");
        assert!(!after(&mut Ahead::new(SelectAhead::Never), 100, 6, 12), "it isn't wanted");
        assert!(after(&mut Ahead::new(SelectAhead::Always), 500, 1, 1), "it always is");
        assert!(after(&mut ahead, 2, 6, 12));
        assert!(after(&mut ahead, 50, 4, 9), "where it is near, it stays");
        assert!(!after(&mut ahead, 200, 3, 5));
    }

    #[test]
    fn selection_is_done_by_the_tick_and_later_poses_wait() {
        let mut ahead = Ahead::new(SelectAhead::Auto);
        assert!(after(&mut ahead, 2, 6, 12));
        let tick = Time(0) + PERIOD * 4;
        let due = ahead.due(tick).unwrap();
        assert!(due + MS * 6 < tick && due + PERIOD > tick);
        ahead.on_made();
        assert_eq!(ahead.due(tick), None, "once");
        assert!((0..3).all(|pose| ahead.hold(pose).is_none()));
        assert_eq!(ahead.on_sent(MS * 6, PERIOD), [0, 1, 2]);
        assert!(!ahead.is_made() && ahead.on_sent(MS * 6, PERIOD).is_empty());
        ahead.on_made();
        let taken: Vec<_> = (0..100).filter_map(|pose| ahead.hold(pose)).collect();
        assert_eq!(taken, (0..36).collect::<Vec<_>>());
    }
}
