//! Whether the displays show the same frame, and how far apart they change to it.
//!
//! Told from what they say themselves, so it is only as good as their machines' clocks agree; on one machine they share one.

use super::statistics::Times;
use proto::ids::{BoardKey, FrameNumber};
use std::collections::VecDeque;
use std::time::Duration;

/// Swaps that may wait for displays to say that they have made them; beyond, one hangs.
const SWAPS: usize = 64;

/// A swap that displays are making.
#[derive(Clone, Debug)]
struct Open {
    frame: FrameNumber,
    /// Who hasn't said anything of it yet.
    waiting: Vec<BoardKey>,
    /// When the first and the last one changed to it, ns.
    span: Option<(u64, u64)>,
    /// Whether every view was new, and every display showed it so far.
    is_same: bool,
}

/// See the module's head.
#[derive(Clone, Debug, Default)]
pub(crate) struct Genlock {
    open: VecDeque<Open>,
    /// Swaps that several displays made.
    pub swaps: u64,
    /// Of these, those after which all views showed that frame.
    pub same: u64,
    /// From the first display's change to the last one's.
    pub skew: Times,
}

impl Genlock {
    /// These displays were told to show a frame, of which every view is new or not.
    pub(crate) fn on_swap(&mut self, frame: FrameNumber, displays: Vec<BoardKey>, is_whole: bool) {
        if displays.len() < 2 {
            return;
        }
        if self.open.len() >= SWAPS {
            self.open.pop_front();
            self.swaps += 1;
        }
        self.open.push_back(Open { frame, waiting: displays, span: None, is_same: is_whole });
    }

    /// A display shows a frame since then, ns.
    pub(crate) fn on_presented(&mut self, display: BoardKey, frame: FrameNumber, at_ns: u64) {
        for open in self.open.iter_mut().filter(|open| open.frame <= frame) {
            let Some(place) = open.waiting.iter().position(|key| *key == display) else { continue };
            open.waiting.swap_remove(place);
            if open.frame == frame {
                let (first, last) = open.span.unwrap_or((at_ns, at_ns));
                open.span = Some((first.min(at_ns), last.max(at_ns)));
            } else {
                // It was passed over.
                open.is_same = false;
            }
        }
        self.settle();
    }

    /// A display is gone: what it would have said of the swaps that it hasn't made yet nobody knows, so they don't count.
    pub(crate) fn on_lost(&mut self, display: BoardKey) {
        self.open.retain(|open| !open.waiting.contains(&display));
    }

    fn settle(&mut self) {
        let Self { open, swaps, same, skew } = self;
        open.retain(|open| {
            if !open.waiting.is_empty() {
                return true;
            }
            *swaps += 1;
            if open.is_same
                && let Some((first, last)) = open.span
            {
                *same += 1;
                skew.add(Duration::from_nanos(last - first));
            }
            false
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEFT: BoardKey = BoardKey(7);
    const RIGHT: BoardKey = BoardKey(9);

    fn swap(genlock: &mut Genlock, frame: u64, is_whole: bool) {
        genlock.on_swap(FrameNumber(frame), vec![LEFT, RIGHT], is_whole);
    }

    #[test]
    fn displays_that_show_a_frame_are_as_far_apart_as_they_say() {
        let mut genlock = Genlock::default();
        swap(&mut genlock, 1, true);
        genlock.on_presented(RIGHT, FrameNumber(1), 5_000_000);
        assert_eq!(genlock.swaps, 0, "the other one hasn't shown it");
        genlock.on_presented(LEFT, FrameNumber(1), 4_000_000);
        assert_eq!((genlock.swaps, genlock.same), (1, 1));
        assert!((genlock.skew.summary().max - 1.0).abs() < 0.01, "{:?}", genlock.skew.summary());
    }

    #[test]
    fn a_frame_that_one_passes_over_or_shows_in_part_is_not_the_same() {
        let mut genlock = Genlock::default();
        swap(&mut genlock, 1, true);
        swap(&mut genlock, 2, true);
        swap(&mut genlock, 3, false);
        for (display, frame) in [(LEFT, 1), (LEFT, 2), (RIGHT, 2), (LEFT, 3), (RIGHT, 3)] {
            genlock.on_presented(display, FrameNumber(frame), 0);
        }
        assert_eq!((genlock.swaps, genlock.same), (3, 1), "only the second");
    }

    #[test]
    fn what_who_is_gone_has_not_shown_does_not_count_and_who_hangs_does() {
        let mut genlock = Genlock::default();
        swap(&mut genlock, 1, true);
        genlock.on_presented(LEFT, FrameNumber(1), 0);
        genlock.on_lost(RIGHT);
        assert_eq!((genlock.swaps, genlock.same), (0, 0));
        (0..200).for_each(|frame| swap(&mut genlock, frame, true));
        assert_eq!((genlock.swaps, genlock.same), (200 - SWAPS as u64, 0));
        genlock.on_swap(FrameNumber(300), vec![LEFT], true);
        assert_eq!(genlock.open.len(), SWAPS, "one display is always the same as itself");
    }
}
