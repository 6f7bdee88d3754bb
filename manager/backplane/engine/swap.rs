//! A frame is over: the compositors, the statistics and the log hear of it.

use super::{Engine, PREVIEW_INTEREST, PREVIEW_PERIOD};
use proto::message::{Moment, Swap};
use proto::time::Time;
use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime};

impl Engine {
    /// Whether somebody has asked for a picture lately, and got none since.
    pub(super) fn is_picture_wanted(&self, now: Time) -> bool {
        self.picture_wanted.is_some_and(|at| now.since(at) < PREVIEW_INTEREST)
    }

    /// How long before its moment a swap is said: displays that are several are to change together.
    fn swap_lead(&self) -> Duration {
        let are_several = self.compositors.keys().len() > 1;
        if are_several && !self.is_lock_step() { self.config.swap_lead } else { Duration::ZERO }
    }

    pub(super) fn swap(&mut self, mut swap: Swap, opened: Time, late: bool) {
        let now = self.now();
        let is_due = self.picture_made.is_none_or(|at| now.since(at) >= PREVIEW_PERIOD);
        swap.preview = self.control.is_paused() || (is_due && self.is_picture_wanted(now));
        if swap.preview {
            // One for each time that somebody asks: a viewer that is slow to show them costs no more than he sees.
            (self.picture_made, self.picture_wanted) = (Some(now), None);
        }
        self.calm.on_swap(!late && swap.complete.iter().all(|complete| *complete));
        self.statistics.frames += 1;
        self.config.progress.store(self.statistics.frames, Ordering::Relaxed);
        self.statistics.late_frames += u64::from(late);
        let repeated = swap.complete.iter().filter(|complete| !**complete).count() as u32;
        self.statistics.repeated_views += u64::from(repeated);
        self.traces.on_swap(now, swap.frame, repeated);
        self.statistics.frame.add(now.since(opened));
        let lead = self.swap_lead();
        if !lead.is_zero() {
            let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
            let at_ns = u64::try_from((since + lead).as_nanos()).unwrap_or(0);
            swap.moment = Some(Moment { at_ns, lead_ns: u32::try_from(lead.as_nanos()).unwrap_or(0) });
        }
        if let Some(source) = &self.shown {
            self.statistics.latency.add(now.since(source.received) + lead);
        }
        self.tell_swap(&swap);
        if !late {
            self.on_whole(now, &swap);
        }
        self.last_swap = Some(swap);
        if !self.is_lock_step() || self.compositors.is_empty() {
            self.answer();
        }
    }

    /// A swap of which all views are whole: takes note of who drew in it for the first time, and of the end of what a lost board has caused.
    fn on_whole(&mut self, now: Time, swap: &Swap) {
        if let Some((since, late)) = self.broken.take() {
            let (ms, frames) = (now.since(since).as_secs_f64() * 1e3, self.statistics.late_frames - late);
            self.log(
                "whole",
                format!("{:?}: all views again, after {ms:.1} ms and {frames} frames with repeated views", swap.frame),
            );
        }
        for key in &swap.boards {
            let Some(board) = self.boards.get_mut(key).filter(|board| !board.draws) else { continue };
            board.draws = true;
            let (name, ms) = (board.name.clone(), now.since(board.since).as_secs_f64() * 1e3);
            self.log("draws", format!("board {name} ({key:?}), {ms:.0} ms after it connected"));
        }
    }
}
