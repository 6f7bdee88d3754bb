//! When a frame's stages were done, as traces show them.
//!
//! All times are told from the moment at which the frame's message had come. A view's tiles are drawn by several threads, each of which takes a tile through
//! raster, translucency and resolve before the next: so these three share the time in which tiles were drawn, in the order and proportion in which threads
//! worked on them.

use crate::pipeline::DrawStats;
use proto::ids::ViewId;
use proto::message::{Stage, StageSpan, Timeline};
use std::time::{Duration, Instant};

/// See the module's head.
#[derive(Debug)]
pub(super) struct Watch {
    came: Instant,
    stages: Vec<StageSpan>,
}

fn ns(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

impl Watch {
    /// Of a frame that came then, and that the painter begins with now.
    pub(super) fn new(came: Instant) -> Self {
        let mut watch = Self { came, stages: Vec::new() };
        watch.put(Stage::Queue, None, 0, ns(came.elapsed()));
        watch
    }

    fn put(&mut self, stage: Stage, view: Option<ViewId>, begin_ns: u64, end_ns: u64) {
        self.stages.push(StageSpan { stage, view, begin_ns, end_ns });
    }

    /// A view was drawn, from that moment on.
    pub(super) fn on_drawn(&mut self, view: ViewId, begun: Instant, stats: &DrawStats) {
        let begin = ns(begun.saturating_duration_since(self.came));
        let end = begin + stats.total_ns;
        let mut at = begin + stats.geometry_ns.min(stats.total_ns);
        self.put(Stage::Geometry, Some(view), begin, at);
        let parts = [
            (Stage::Raster, stats.raster_ns),
            (Stage::Translucency, stats.translucency_ns),
            (Stage::Resolve, stats.resolve_ns),
        ];
        let worked: u64 = parts.iter().map(|(_, part)| part).sum();
        let drawing = (end - at) as f64 / worked.max(1) as f64;
        for (stage, part) in parts {
            let over = (at + (part as f64 * drawing) as u64).min(end);
            self.put(stage, Some(view), at, over);
            at = over;
        }
    }

    /// Tiles were compared or handed over from that moment until now.
    pub(super) fn on_transferred(&mut self, view: Option<ViewId>, begun: Instant) {
        let [begin, end] = [begun, Instant::now()].map(|at| ns(at.saturating_duration_since(self.came)));
        self.put(Stage::Transfer, view, begin, end);
    }

    /// The board is ready.
    pub(super) fn finish(self) -> Timeline {
        Timeline { ready_ns: ns(self.came.elapsed()), stages: self.stages }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_follow_one_another_and_share_the_time_in_which_tiles_were_drawn() {
        let came = Instant::now();
        let mut watch = Watch::new(came);
        let view = ViewId(3);
        // Two threads: sixteen milliseconds' work in ten.
        let stats = DrawStats {
            geometry_ns: 2_000_000,
            raster_ns: 12_000_000,
            translucency_ns: 0,
            resolve_ns: 4_000_000,
            total_ns: 12_000_000,
            ..DrawStats::default()
        };
        watch.on_drawn(view, came + Duration::from_millis(5), &stats);
        watch.on_transferred(Some(view), came + Duration::from_millis(17));
        let timeline = watch.finish();
        let drawn: Vec<_> = timeline.stages[1..5]
            .iter()
            .map(|span| (span.stage, span.begin_ns / 1_000_000, span.end_ns / 1_000_000))
            .collect();
        let expected =
            [(Stage::Geometry, 5, 7), (Stage::Raster, 7, 14), (Stage::Translucency, 14, 14), (Stage::Resolve, 14, 17)];
        assert_eq!(drawn, expected);
        assert!(timeline.stages[1..5].windows(2).all(|pair| pair[0].end_ns == pair[1].begin_ns), "{timeline:?}");
        let stages: Vec<_> = timeline.stages.iter().map(|span| (span.stage, span.view)).collect();
        assert_eq!((stages[0], stages[5]), ((Stage::Queue, None), (Stage::Transfer, Some(view))));
    }
}
