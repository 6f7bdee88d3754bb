//! The last frames as spans: what ran when, on whose account, one within the other. What traces are written from, whatever their format.
//!
//! A track holds spans that follow one another; those within one are its stages. A board says by its own clock when it did what, from the moment at
//! which the frame had come until it was ready ([`proto::message::Timeline`]). What is left of the time from the frame's sending to the news of that
//! is the way there and back; it is taken as the same both ways, as clocks are compared over networks (RFC 5905, 8), so a board's span is wrong by half of it
//! at most, and its stages are right to each other.

use super::trace::{Drawn, FrameTrace};
use proto::ids::FrameNumber;
use proto::message::StageSpan;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Who did it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Track {
    /// A packet of the host waits for its frame.
    Host,
    /// Frames; the second and further are of frames that overlap.
    Frames(usize),
    /// The boards of one name.
    Board(Arc<str>),
    /// The compositor.
    Compositor,
}

/// Something that took time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Span {
    pub name: &'static str,
    pub track: Track,
    pub frame: FrameNumber,
    /// Nanoseconds since the manager's start; the end is not before the beginning.
    pub begin_ns: u64,
    pub end_ns: u64,
    /// Numbers that go with it.
    pub notes: Vec<(&'static str, u64)>,
    /// What it is made of, in order, one after the other, within it.
    pub stages: Vec<Stage>,
}

/// A part of a span.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Stage {
    pub name: &'static str,
    /// Of which view, if it is of one.
    pub view: Option<u32>,
    pub begin_ns: u64,
    pub end_ns: u64,
}

/// The spans of frames, which come the oldest first. Frames that aren't swapped yet have none.
pub(crate) fn spans<'a>(frames: impl IntoIterator<Item = &'a FrameTrace>) -> Vec<Span> {
    let mut ends: BTreeMap<Track, u64> = BTreeMap::new();
    let mut spans = Vec::new();
    for trace in frames {
        let Some(swapped) = trace.swapped else { continue };
        let (frame, opened, swapped) = (trace.frame, trace.opened.0, swapped.0.max(trace.opened.0));
        let mut put = |name, track: Track, begin: u64, end: u64, notes, stages: &dyn Fn(u64, u64) -> Vec<Stage>| {
            // Clocks and what boards say may not fit together: on its track nothing begins before the last is over.
            let free = ends.get(&track).copied().unwrap_or(0);
            let begin_ns = begin.max(free).min(end.max(free));
            let end_ns = end.max(begin_ns);
            ends.insert(track.clone(), end_ns);
            let stages = stages(begin_ns, end_ns);
            spans.push(Span { name, track, frame, begin_ns, end_ns, notes, stages });
        };
        let none = |_, _| Vec::new();
        if let Some(received) = trace.received {
            put("wait", Track::Host, received.0, opened, Vec::new(), &none);
        }
        for drawn in &trace.boards {
            let (begin, end) = place(trace, drawn);
            let notes = vec![("triangles", drawn.report.triangles), ("tile_bytes", drawn.report.tile_bytes)];
            let stages = |begin_ns, end_ns| stages_of(drawn, begin, begin_ns, end_ns);
            put("draw", Track::Board(Arc::clone(&drawn.board)), begin, end, notes, &stages);
        }
        if let Some((presented, stitch)) = trace.presented {
            let stitch = stitch.as_nanos() as u64;
            put("stitch", Track::Compositor, presented.0.saturating_sub(stitch), presented.0, Vec::new(), &none);
        }
        let stages = [("select", trace.select.as_nanos() as u64), ("stream", trace.stream.as_nanos() as u64)];
        let lane = (0..).find(|lane| ends.get(&Track::Frames(*lane)).is_none_or(|end| *end <= opened)).unwrap_or(0);
        let mut put = |track: Track, notes| {
            ends.insert(track.clone(), swapped);
            let stages = stages_within(opened, swapped, &stages);
            spans.push(Span { name: "frame", track, frame, begin_ns: opened, end_ns: swapped, notes, stages });
        };
        put(Track::Frames(lane), vec![("repeated_views", trace.repeated.into())]);
    }
    spans
}

/// When a board had the frame, and when it was ready, by the manager's clock.
fn place(trace: &FrameTrace, drawn: &Drawn) -> (u64, u64) {
    let (sent, heard) = (trace.sent.0, drawn.ready.0.max(trace.sent.0));
    // A board may say any number.
    let took = drawn.timeline.ready_ns.min(heard - sent);
    let way = (heard - sent - took) / 2;
    (sent + way, sent + way + took)
}

/// What a board did from `zero` on, as far as it lies between these ends, one after the other.
fn stages_of(drawn: &Drawn, zero: u64, begin_ns: u64, end_ns: u64) -> Vec<Stage> {
    let mut at = begin_ns;
    let place = |span: &StageSpan| {
        let [begin_ns, end] = [span.begin_ns, span.end_ns].map(|ns| zero.saturating_add(ns));
        let begin_ns = begin_ns.clamp(at, end_ns);
        at = end.clamp(begin_ns, end_ns);
        Stage { name: span.stage.name(), view: span.view.map(|view| view.0), begin_ns, end_ns: at }
    };
    drawn.timeline.stages.iter().map(place).filter(|stage| stage.end_ns > stage.begin_ns).collect()
}

/// One after the other from the beginning, no longer than the whole; those that took nothing are left out.
fn stages_within(begin_ns: u64, end_ns: u64, stages: &[(&'static str, u64)]) -> Vec<Stage> {
    let mut at = begin_ns;
    let place = |(name, ns): &(&'static str, u64)| {
        let (begin_ns, end) = (at, at.saturating_add(*ns).min(end_ns));
        at = end;
        Stage { name, view: None, begin_ns, end_ns: end }
    };
    stages.iter().map(place).filter(|stage| stage.end_ns > stage.begin_ns).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backplane::trace::Traces;
    use proptest::prelude::*;
    use proto::ids::{BoardKey, ViewId};
    use proto::message::{self, BoardReport, Timeline};
    use proto::time::Time;
    use std::time::Duration;

    proptest! {
        #[test]
        fn whatever_boards_say_spans_of_a_track_follow_one_another_and_hold_their_stages(
            frames in proptest::collection::vec((0u64..50, 0u64..30, 0u64..40, any::<[u64; 3]>()), 1..30),
        ) {
            let mut traces = Traces::default();
            let mut opened = 100;
            for (number, (gap, took, wait, said)) in frames.iter().enumerate() {
                // Frames may overlap: the next opens after a gap, not after the swap.
                opened += gap;
                let frame = FrameNumber(number as u64);
                traces.on_open(frame, Some(Time(opened.saturating_sub(*wait))), Time(opened), Duration::from_nanos(said[0] % 100));
                traces.on_sent(Time(opened + took / 4), frame, Duration::from_nanos(5));
                let span = |begin_ns, end_ns| {
                    StageSpan { stage: message::Stage::Raster, view: Some(ViewId(0)), begin_ns, end_ns }
                };
                let stages = vec![span(said[1], said[2]), span(said[0] % 20, said[2] % 50), span(3, 9)];
                let timeline = Timeline { ready_ns: said[frame.0 as usize % 3], stages };
                traces.on_ready(
                    Time(opened + took / 2), frame, BoardKey(1), &"a".into(), &BoardReport::default(), timeline,
                );
                traces.on_swap(Time(opened + took), frame, 0);
                traces.on_presented(Time(opened + took + 1), frame, Duration::from_nanos(said[0]));
            }
            let all = traces.all();
            let spans = spans(all.iter().map(AsRef::as_ref));
            prop_assert_eq!(spans.len(), 4 * frames.len());
            let mut ends: BTreeMap<Track, u64> = BTreeMap::new();
            for span in &spans {
                prop_assert!(span.begin_ns <= span.end_ns);
                prop_assert!(ends.insert(span.track.clone(), span.end_ns).unwrap_or(0) <= span.begin_ns);
                let mut at = span.begin_ns;
                for stage in &span.stages {
                    prop_assert!(stage.begin_ns >= at && stage.end_ns > stage.begin_ns);
                    at = stage.end_ns;
                }
                prop_assert!(at <= span.end_ns);
            }
        }
    }

    #[test]
    fn a_board_lies_in_the_middle_between_sending_and_news_and_its_stages_where_it_says() {
        let mut traces = Traces::default();
        let frame = FrameNumber(7);
        traces.on_open(frame, None, Time(1000), Duration::from_nanos(100));
        traces.on_sent(Time(1200), frame, Duration::from_nanos(100));
        let span = |stage, view, begin_ns, end_ns| StageSpan { stage, view: Some(ViewId(view)), begin_ns, end_ns };
        let stages = vec![span(message::Stage::Geometry, 0, 50, 150), span(message::Stage::Resolve, 1, 160, 400)];
        // Of the 600 that it took to hear of it the board had 500.
        let timeline = Timeline { ready_ns: 500, stages };
        traces.on_ready(Time(1800), frame, BoardKey(1), &"a".into(), &BoardReport::default(), timeline);
        traces.on_swap(Time(1900), frame, 0);
        let all = traces.all();
        let spans = spans(all.iter().map(AsRef::as_ref));
        let draw = spans.iter().find(|span| span.name == "draw").unwrap();
        assert_eq!((draw.begin_ns, draw.end_ns), (1250, 1750));
        let stage = |name, view, begin_ns, end_ns| Stage { name, view: Some(view), begin_ns, end_ns };
        assert_eq!(draw.stages, [stage("geometry", 0, 1300, 1400), stage("resolve", 1, 1410, 1650)]);
    }
}
