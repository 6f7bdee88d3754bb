//! The last minute of frames as the chart shows it: four samples a second, each the mean of its frames.
//!
//! A frame's stages are those of the board that was ready last: its time is what the frame took.

use crate::backplane::live::Live;
use crate::backplane::trace::FrameTrace;
use proto::time::Time;
use serde::Serialize;
use std::collections::VecDeque;

/// A minute of looks.
const SAMPLES: usize = 240;

/// Frames between two looks, means in ms but where it says otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(super) struct Sample {
    /// When it was looked, s since the manager's start.
    pub time_s: f64,
    /// How many frames were swapped.
    pub frames: u32,
    /// Of these, with a view that repeats.
    pub late: u32,
    /// The longest from open to swap.
    pub frame_max_ms: f64,
    /// From open to swap.
    pub frame_ms: f64,
    /// From the host's packet to the swap; `None`: no packet came.
    pub latency_ms: Option<f64>,
    /// From the packet until its frame opens.
    pub wait: f64,
    /// The parts of a frame from open on, in their order.
    pub select: f64,
    pub stream: f64,
    pub geometry: f64,
    pub raster: f64,
    pub translucency: f64,
    pub resolve: f64,
    pub transfer: f64,
    /// What is left until the swap: links, and threads that waited for their turn.
    pub links: f64,
    /// After the swap.
    pub stitch: f64,
}

/// See the module's head.
#[derive(Debug, Default)]
pub(super) struct History {
    samples: VecDeque<Sample>,
    /// The last swap that is in a sample.
    seen: Time,
}

impl History {
    /// Takes the frames since the last look into a sample.
    pub(super) fn on_live(&mut self, live: &Live) -> Sample {
        let seen = self.seen;
        let fresh = live.recent.iter().filter(|trace| trace.swapped.is_some_and(|at| at > seen));
        let mut sample = sample(live.now.since(Time(0)).as_secs_f64(), fresh.clone().map(AsRef::as_ref));
        sample.time_s = (sample.time_s * 1e3).round() / 1e3;
        self.seen = fresh.filter_map(|trace| trace.swapped).max().unwrap_or(seen);
        if self.samples.len() >= SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
        sample
    }

    /// The oldest first.
    pub(super) fn samples(&self) -> Vec<Sample> {
        self.samples.iter().copied().collect()
    }
}

fn ms(ns: u64) -> f64 {
    ns as f64 / 1e6
}

fn sample<'a>(time_s: f64, frames: impl Iterator<Item = &'a FrameTrace>) -> Sample {
    let mut sum = Sample { time_s, ..Sample::default() };
    let mut packets = 0;
    for trace in frames {
        let Some(swapped) = trace.swapped else { continue };
        let frame = swapped.since(trace.opened).as_secs_f64() * 1e3;
        sum.frames += 1;
        sum.late += u32::from(trace.repeated > 0);
        sum.frame_ms += frame;
        sum.frame_max_ms = sum.frame_max_ms.max(frame);
        if let Some(received) = trace.received {
            packets += 1;
            sum.wait += trace.opened.since(received).as_secs_f64() * 1e3;
            *sum.latency_ms.get_or_insert(0.0) += swapped.since(received).as_secs_f64() * 1e3;
        }
        let mut named = trace.select.as_secs_f64() * 1e3 + trace.stream.as_secs_f64() * 1e3;
        sum.select += trace.select.as_secs_f64() * 1e3;
        sum.stream += trace.stream.as_secs_f64() * 1e3;
        if let Some(last) = trace.boards.last() {
            let report = &last.report;
            // A board may say any number: none is more than the frame.
            let mut part = |total: &mut f64, ns| {
                let time = ms(ns).min((frame - named).max(0.0));
                named += time;
                *total += time;
            };
            part(&mut sum.geometry, report.geometry_ns);
            part(&mut sum.raster, report.raster_ns);
            part(&mut sum.translucency, report.translucency_ns);
            part(&mut sum.resolve, report.resolve_ns);
            part(&mut sum.transfer, report.transfer_ns);
        }
        sum.links += (frame - named).max(0.0);
        sum.stitch += trace.presented.map_or(0.0, |(_, stitch)| stitch.as_secs_f64() * 1e3);
    }
    let rounded = |value: f64| (value * 1e3).round() / 1e3;
    let mean = |total: f64| rounded(total / f64::from(sum.frames.max(1)));
    let of_packets = |total: f64| rounded(total / f64::from(packets.max(1)));
    Sample {
        frame_max_ms: rounded(sum.frame_max_ms),
        frame_ms: mean(sum.frame_ms),
        latency_ms: sum.latency_ms.map(of_packets),
        wait: of_packets(sum.wait),
        select: mean(sum.select),
        stream: mean(sum.stream),
        geometry: mean(sum.geometry),
        raster: mean(sum.raster),
        translucency: mean(sum.translucency),
        resolve: mean(sum.resolve),
        transfer: mean(sum.transfer),
        links: mean(sum.links),
        stitch: mean(sum.stitch),
        ..sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backplane::trace::Traces;
    use proto::ids::{BoardKey, FrameNumber};
    use proto::message::{BoardReport, Timeline};
    use std::time::Duration;

    #[test]
    fn a_samples_stages_are_those_of_the_last_board_and_make_up_the_frame() {
        const MS: u64 = 1_000_000;
        let mut traces = Traces::default();
        for frame in 0..4 {
            let (number, at) = (FrameNumber(frame), Time((10 + 20 * frame) * MS));
            let received = (frame > 1).then_some(Time(at.0 - 6 * MS));
            traces.on_open(number, received, at, Duration::from_millis(1));
            traces.on_sent(at, number, Duration::from_millis(1));
            for (key, raster) in [(1, 2), (2, 5)] {
                let report = BoardReport { raster_ns: raster * MS, transfer_ns: MS, ..BoardReport::default() };
                let (ready, timeline) = (Time(at.0 + (3 + raster) * MS), Timeline::default());
                traces.on_ready(ready, number, BoardKey(key), &"b".into(), &report, timeline);
            }
            traces.on_swap(Time(at.0 + 9 * MS), number, u32::from(frame == 3));
        }
        let all = traces.all();
        let found = sample(1.0, all.iter().map(AsRef::as_ref));
        assert_eq!((found.frames, found.late), (4, 1));
        assert_eq!((found.frame_ms, found.frame_max_ms), (9.0, 9.0));
        assert_eq!((found.select, found.stream, found.raster, found.transfer, found.links), (1.0, 1.0, 5.0, 1.0, 1.0));
        assert_eq!((found.wait, found.latency_ms), (6.0, Some(15.0)), "of the frames that a packet came for");
    }
}
