//! Whether a frame would show anything new: if not, for some while, none is opened, and boards and compositor have nothing to do.
//!
//! A frame in a while is opened all the same. It heals whatever went wrong unnoticed, such as tiles that were lost with a
//! compositor's link, within that while.

use proto::debug::DebugPicture;
use proto::frame::{Environment, PixelFormat};
use proto::ids::{BoardKey, Epoch};
use proto::time::Time;
use proto::view::Pose;
use std::time::Duration;

/// Equal frames in a row, all complete, before none is opened: links that have just come up get their tiles by these.
const FRAMES: u32 = 30;
/// One frame is opened after this long.
const WHILE: Duration = Duration::from_secs(1);

/// Everything that decides what a frame shows, and to whom.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Shown {
    pub eye: Pose,
    pub environment: Environment,
    pub debug: DebugPicture,
    pub format: PixelFormat,
    pub epoch: Epoch,
    pub compositors: Vec<BoardKey>,
    /// Revisions of the views, of what is moved and mixed, and of each view's list.
    pub revisions: Vec<u64>,
}

/// See the module's head.
#[derive(Clone, Debug, Default)]
pub(crate) struct Calm {
    /// The frame that was opened last, when, and how many in a row that were like it were complete.
    last: Option<(Shown, Time)>,
    frames: u32,
}

impl Calm {
    /// A frame is opened.
    pub(crate) fn on_open(&mut self, now: Time, shown: Shown) {
        if self.last.as_ref().is_none_or(|(last, _)| *last != shown) {
            self.frames = 0;
        }
        self.last = Some((shown, now));
    }

    /// The frame is swapped, as a whole or not.
    pub(crate) fn on_swap(&mut self, is_complete: bool) {
        self.frames = if is_complete { self.frames.saturating_add(1) } else { 0 };
    }

    /// Something was lost that the next frames must bring again.
    pub(crate) fn disturb(&mut self) {
        self.frames = 0;
    }

    /// Whether a frame that shows this needs not be opened.
    pub(crate) fn is_idle(&self, now: Time, shown: &Shown) -> bool {
        let is_same = |(last, at): &(Shown, Time)| last == shown && now.since(*at) < WHILE;
        self.frames >= FRAMES && self.last.as_ref().is_some_and(is_same)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(revision: u64) -> Shown {
        let environment = Environment::default();
        let (format, debug) = (PixelFormat::Srgb8, DebugPicture::Off);
        let (eye, epoch) = (Pose::IDENTITY, Epoch(1));
        Shown { eye, environment, debug, format, epoch, compositors: Vec::new(), revisions: vec![revision] }
    }

    #[test]
    fn frames_stop_when_nothing_changes_but_for_one_a_second() {
        let mut calm = Calm::default();
        let mut opened = Vec::new();
        // Ten seconds at 60 Hz; something changes at the 300th tick, and the frame of tick 500 is not complete.
        for tick in 0u64..600 {
            let (now, shown) = (Time(tick * 16_666_667), shown(u64::from(tick >= 300)));
            if !calm.is_idle(now, &shown) {
                opened.push(tick);
                calm.on_open(now, shown);
                calm.on_swap(true);
            }
            if tick == 500 {
                calm.disturb();
            }
        }
        let quiet = |range: std::ops::Range<u64>| opened.iter().filter(|tick| range.contains(tick)).count();
        assert_eq!(quiet(0..30), 30);
        assert_eq!(quiet(30..300), 4, "one a second");
        assert_eq!(
            opened.iter().filter(|tick| (300..330).contains(*tick)).count(),
            30,
            "at once when something changes"
        );
        assert_eq!(quiet(330..501), 2);
        assert_eq!(quiet(501..531), 30, "and after a disturbance");
    }
}
