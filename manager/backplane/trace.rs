//! What the last frames did, and when: for the console's chart and for traces.
//!
//! A ring of frames, each written while it is made: opened, ready board by board, swapped, shown. Whoever wants to know gets the frames
//! themselves, shared, not copied, so that being watched costs the engine next to nothing. Boards say when they did what by their own clocks
//! ([`Timeline`]); what is known by the manager's is when it had sent them the frame and when it heard that they were ready.

#![cfg_attr(not(feature = "console"), allow(dead_code, reason = "only the console reads it"))]

use proto::ids::{BoardKey, FrameNumber};
use proto::limits;
use proto::message::{BoardReport, Timeline};
use proto::time::Time;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// Frames that are kept: eight seconds at 60 Hz.
const FRAMES: usize = 512;

/// A board's part of a frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Drawn {
    pub key: BoardKey,
    /// Its name, for people.
    pub board: Arc<str>,
    /// When the manager heard that it was ready.
    pub ready: Time,
    pub report: BoardReport,
    pub timeline: Timeline,
}

/// A frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FrameTrace {
    pub frame: FrameNumber,
    /// When the host's packet that it shows had come; `None`: it shows what the frame before did.
    pub received: Option<Time>,
    pub opened: Time,
    pub select: Duration,
    pub stream: Duration,
    /// When its messages were queued.
    pub sent: Time,
    /// In the order in which they were ready.
    pub boards: Vec<Drawn>,
    pub swapped: Option<Time>,
    /// Views that repeat their last image.
    pub repeated: u32,
    /// When the compositor had said that it is on the displays, and how long that took from the last tile.
    pub presented: Option<(Time, Duration)>,
}

/// See the module's head.
#[derive(Debug, Default)]
pub(crate) struct Traces {
    frames: VecDeque<Arc<FrameTrace>>,
}

impl Traces {
    /// A frame is opened, after selecting for so long.
    pub(crate) fn on_open(&mut self, frame: FrameNumber, received: Option<Time>, opened: Time, select: Duration) {
        if self.frames.len() >= FRAMES {
            self.frames.pop_front();
        }
        let (stream, boards) = (Duration::ZERO, Vec::new());
        let (swapped, presented) = (None, None);
        let (sent, repeated) = (opened, 0);
        let trace = FrameTrace { frame, received, opened, select, stream, sent, boards, swapped, repeated, presented };
        self.frames.push_back(Arc::new(trace));
    }

    /// Its messages are queued, which took so long.
    pub(crate) fn on_sent(&mut self, now: Time, frame: FrameNumber, stream: Duration) {
        self.change(frame, |trace| (trace.stream, trace.sent) = (stream, now));
    }

    /// A board is ready with it.
    pub(crate) fn on_ready(
        &mut self,
        now: Time,
        frame: FrameNumber,
        key: BoardKey,
        board: &Arc<str>,
        report: &BoardReport,
        mut timeline: Timeline,
    ) {
        timeline.stages.truncate(limits::STAGE_SPANS_MAX);
        let drawn = Drawn { key, board: Arc::clone(board), ready: now, report: *report, timeline };
        // Once each, whatever a board says.
        self.change(frame, |trace| {
            if trace.boards.iter().all(|other| other.key != key) {
                trace.boards.push(drawn);
            }
        });
    }

    /// It is swapped.
    pub(crate) fn on_swap(&mut self, now: Time, frame: FrameNumber, repeated: u32) {
        self.change(frame, |trace| (trace.swapped, trace.repeated) = (Some(now), repeated));
    }

    /// The compositor has shown it.
    pub(crate) fn on_presented(&mut self, now: Time, frame: FrameNumber, stitch: Duration) {
        self.change(frame, |trace| trace.presented = Some((now, stitch)));
    }

    /// The frames that were swapped after a moment, the oldest first.
    pub(crate) fn since(&self, moment: Time) -> Vec<Arc<FrameTrace>> {
        let is_newer = |trace: &&Arc<FrameTrace>| trace.swapped.is_some_and(|at| at > moment);
        // Frames are swapped in the order in which they were opened, but for one that is drawn again.
        let mut found: Vec<_> = self
            .frames
            .iter()
            .rev()
            .take_while(|trace| trace.opened > moment || is_newer(trace))
            .filter(is_newer)
            .cloned()
            .collect();
        found.reverse();
        found
    }

    /// All that are kept, the oldest first.
    pub(crate) fn all(&self) -> Vec<Arc<FrameTrace>> {
        self.frames.iter().cloned().collect()
    }

    fn change(&mut self, frame: FrameNumber, change: impl FnOnce(&mut FrameTrace)) {
        // A frame that is drawn again stands there twice, the later one counts.
        if let Some(trace) = self.frames.iter_mut().rev().find(|trace| trace.frame == frame) {
            // Copied only if somebody is reading it at this moment.
            change(Arc::make_mut(trace));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn fly(traces: &mut Traces, frame: u64) {
        let (number, at) = (FrameNumber(frame), Time(frame * 16 * MS));
        traces.on_open(number, Some(at), at, Duration::from_micros(100));
        traces.on_sent(Time(at.0 + MS), number, Duration::from_micros(20));
        let report = BoardReport { raster_ns: 3 * MS, ..BoardReport::default() };
        traces.on_ready(Time(at.0 + 4 * MS), number, BoardKey(1), &"a".into(), &report, Timeline::default());
        traces.on_swap(Time(at.0 + 5 * MS), number, 0);
        traces.on_presented(Time(at.0 + 6 * MS), number, Duration::from_micros(300));
    }

    #[test]
    fn a_frame_is_kept_as_it_went_and_old_ones_go() {
        let mut traces = Traces::default();
        (0..600).for_each(|frame| fly(&mut traces, frame));
        let all = traces.all();
        assert_eq!((all.len(), all[0].frame, all[FRAMES - 1].frame), (FRAMES, FrameNumber(88), FrameNumber(599)));
        let last = &all[FRAMES - 1];
        assert_eq!(last.stream, Duration::from_micros(20));
        assert_eq!(last.boards.len(), 1);
        assert!(last.opened < last.boards[0].ready && Some(last.boards[0].ready) < last.swapped);
    }

    #[test]
    fn since_finds_what_was_swapped_later_and_nothing_that_is_still_drawn() {
        let mut traces = Traces::default();
        (0..10).for_each(|frame| fly(&mut traces, frame));
        traces.on_open(FrameNumber(10), None, Time(160 * MS), Duration::ZERO);
        let frames = |moment| traces.since(Time(moment)).iter().map(|trace| trace.frame.0).collect::<Vec<_>>();
        assert_eq!(frames((8 * 16 + 5) * MS), [9], "not the one that was swapped at that very moment");
        assert_eq!(frames((8 * 16 + 5) * MS - 1), [8, 9]);
    }

    #[test]
    fn a_board_counts_once_and_a_frame_that_is_drawn_again_is_another() {
        let mut traces = Traces::default();
        let (frame, name) = (FrameNumber(3), "a".into());
        traces.on_open(frame, None, Time(0), Duration::ZERO);
        let ready = |traces: &mut Traces, at| {
            traces.on_ready(Time(at), frame, BoardKey(1), &name, &BoardReport::default(), Timeline::default());
        };
        (0..2).for_each(|k| ready(&mut traces, k));
        let held = traces.all();
        traces.on_open(frame, None, Time(9), Duration::ZERO);
        ready(&mut traces, 10);
        let ready: Vec<_> = traces.all().iter().map(|trace| trace.boards.len()).collect();
        assert_eq!(ready, [1, 1]);
        assert_eq!(held.len(), 1, "what somebody reads doesn't change under him");
    }
}
