//! The last frames as spans: what ran when, on whose account, one within the other. What traces are written from, whatever their format.
//!
//! A track holds spans that follow one another; those within one are its stages. Boards' spans end when the manager heard that they were ready, and
//! begin as much earlier as their stages took: the way of that word over the network is counted as if the board had begun later.

use super::trace::{Drawn, FrameTrace};
use proto::ids::FrameNumber;
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
        let mut put = |name, track: Track, begin: u64, end: u64, notes, stages: &[(&'static str, u64)]| {
            // Clocks and what boards say may not fit together: on its track nothing begins before the last is over.
            let free = ends.get(&track).copied().unwrap_or(0);
            let begin_ns = begin.max(free).min(end.max(free));
            let end_ns = end.max(begin_ns);
            ends.insert(track.clone(), end_ns);
            let stages = stages_within(begin_ns, end_ns, stages);
            spans.push(Span { name, track, frame, begin_ns, end_ns, notes, stages });
        };
        if let Some(received) = trace.received {
            put("wait", Track::Host, received.0, opened, Vec::new(), &[]);
        }
        for drawn in &trace.boards {
            let stages = stages_of(drawn);
            let took = stages.iter().fold(0u64, |sum, (_, ns)| sum.saturating_add(*ns));
            let begin = drawn.ready.0.saturating_sub(took).max(opened);
            let notes = vec![("triangles", drawn.report.triangles), ("tile_bytes", drawn.report.tile_bytes)];
            put("draw", Track::Board(Arc::clone(&drawn.board)), begin, drawn.ready.0, notes, &stages);
        }
        if let Some((presented, stitch)) = trace.presented {
            let stitch = stitch.as_nanos() as u64;
            put("stitch", Track::Compositor, presented.0.saturating_sub(stitch), presented.0, Vec::new(), &[]);
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

fn stages_of(drawn: &Drawn) -> [(&'static str, u64); 5] {
    let report = &drawn.report;
    [
        ("geometry", report.geometry_ns),
        ("raster", report.raster_ns),
        ("translucency", report.translucency_ns),
        ("resolve", report.resolve_ns),
        ("transfer", report.transfer_ns),
    ]
}

/// One after the other from the beginning, no longer than the whole; those that took nothing are left out.
fn stages_within(begin_ns: u64, end_ns: u64, stages: &[(&'static str, u64)]) -> Vec<Stage> {
    let mut at = begin_ns;
    let place = |(name, ns): &(&'static str, u64)| {
        let (begin_ns, end) = (at, at.saturating_add(*ns).min(end_ns));
        at = end;
        Stage { name, begin_ns, end_ns: end }
    };
    stages.iter().map(place).filter(|stage| stage.end_ns > stage.begin_ns).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backplane::trace::Traces;
    use proptest::prelude::*;
    use proto::ids::BoardKey;
    use proto::message::BoardReport;
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
                traces.on_sent(frame, Duration::from_nanos(5));
                let report = BoardReport { raster_ns: said[1], resolve_ns: said[2] % 50, ..BoardReport::default() };
                traces.on_ready(Time(opened + took / 2), frame, BoardKey(1), &"a".into(), &report);
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
}
