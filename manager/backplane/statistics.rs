//! What a rig has done, under the names of operations.md: counters, distributions of times, and a log of events.

use super::genlock::Genlock;
use hdrhistogram::Histogram;
use proto::message::BoardReport;
use serde::Serialize;
use std::collections::VecDeque;
use std::time::Duration;

/// Events kept for the console and the final report; older ones are counted only.
const EVENTS_MAX: usize = 1000;
/// Longest time that a distribution tells apart from longer ones, ns: a minute.
const LONGEST_NS: u64 = 60_000_000_000;

/// Upper ends of the buckets in which times are counted for metrics, s: fine round the periods of 120, 60 and 30 Hz.
pub(crate) const BUCKETS_S: [f64; 15] = [
    0.0001, 0.00025, 0.0005, 0.001, 0.002, 0.004, 0.008_334, 0.0125, 0.016_667, 0.025, 0.033_334, 0.05, 0.1, 0.25, 1.0,
];

/// How many times fell into each of [`BUCKETS_S`], and last those above all, and their sum.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct TimeCounts {
    pub buckets: [u64; BUCKETS_S.len() + 1],
    pub sum: Duration,
}

/// A distribution of times; resolution about a thousandth.
#[derive(Clone, Debug)]
pub(crate) struct Times {
    histogram: Histogram<u64>,
    counts: TimeCounts,
}

impl Default for Times {
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(1000, LONGEST_NS, 3).expect("the bounds are constants in order");
        Self { histogram, counts: TimeCounts::default() }
    }
}

impl Times {
    pub(crate) fn add(&mut self, time: Duration) {
        self.histogram.saturating_record(u64::try_from(time.as_nanos()).unwrap_or(LONGEST_NS));
        let seconds = time.as_secs_f64();
        self.counts.buckets[BUCKETS_S.partition_point(|end| *end < seconds)] += 1;
        // A board may say any number.
        self.counts.sum = self.counts.sum.saturating_add(time);
    }

    pub(crate) fn summary(&self) -> TimeSummary {
        let ms = |ns: u64| (ns as f64 / 1e3).round() / 1e3;
        let at = |q| if self.histogram.is_empty() { 0.0 } else { ms(self.histogram.value_at_quantile(q)) };
        TimeSummary { p50: at(0.5), p99: at(0.99), p999: at(0.999), max: ms(self.histogram.max()) }
    }
}

/// Milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct TimeSummary {
    /// Median.
    pub p50: f64,
    /// 99 % are below.
    pub p99: f64,
    /// 99.9 % are below.
    pub p999: f64,
    /// The largest.
    pub max: f64,
}

/// One line of the event log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EventEntry {
    /// Seconds since the manager's start.
    pub time_s: f64,
    /// The frame that was to open next.
    pub frame: u64,
    /// `joined`, `draws`, `left`, `lost`, `whole`, `refused`, `put out`, `leads`, `resigned`, …
    pub event: &'static str,
    /// Who and why.
    pub detail: String,
}

/// Times by stage, ms.
#[derive(Clone, Debug, Default, Serialize)]
pub struct StageTimes {
    /// Culling and sorting, all views.
    pub select: TimeSummary,
    /// Encoding and queueing for all boards.
    pub stream: TimeSummary,
    /// A board's geometry.
    pub geometry: TimeSummary,
    /// A board's raster.
    pub raster: TimeSummary,
    /// A board's translucency.
    pub translucency: TimeSummary,
    /// A board's resolve.
    pub resolve: TimeSummary,
    /// A board's comparing and sending of tiles.
    pub transfer: TimeSummary,
    /// The compositor's stitching.
    pub stitch: TimeSummary,
}

/// What was not done because the scene didn't need it; sums over all frames.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Skipped {
    /// Subobjects outside the view.
    pub culled: u64,
    /// Objects under the size that is drawn.
    pub small: u64,
    /// Subobjects beyond the visibility range.
    pub faded: u64,
    /// Triangles, blocks and pixels behind what was drawn already.
    pub occluded: u64,
    /// Triangles that show their back.
    pub backface: u64,
    /// Tiles without a translucent fragment.
    pub tiles_opaque: u64,
    /// Pixels shaded once.
    pub pixels_single: u64,
    /// Tiles drawn and not sent.
    pub tiles_unchanged: u64,
    /// Frames not drawn again, counted per board.
    pub frames_unchanged: u64,
    /// Frames that were not even opened, for nothing had changed.
    pub frames_idle: u64,
    /// Meshes and textures that a joining board had kept.
    pub meshes_cached: u64,
}

/// What was sent ahead of need, and what frames showed instead of what hadn't come; sums over all frames.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Streaming {
    /// Meshes and textures sent.
    pub pieces: u64,
    /// What they count for in boards' memory.
    pub piece_bytes: u64,
    /// Meshes and textures that boards were told to give up.
    pub evicted: u64,
    /// Models that showed other versions than they should have, one for each frame.
    pub substitutions: u64,
    /// Subobjects that were left out, one for each frame and view.
    pub omitted: u64,
    /// Frames with either.
    pub frames_substituted: u64,
    /// Frames that waited for pieces: in lock-step only.
    pub frames_waited: u64,
}

/// The memory for meshes and textures of one board.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BoardMemory {
    /// The board's name.
    pub board: String,
    /// What it has room for.
    pub limit_bytes: u64,
    /// What it holds, and what is on its way.
    pub held_bytes: u64,
    /// The most that it ever held in this session.
    pub peak_bytes: u64,
}

/// All bytes over the links between manager and boards, whatever they were for.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct LinkBytes {
    /// From the manager.
    pub to_boards: u64,
    /// To the manager.
    pub from_boards: u64,
    /// From boards to the compositor.
    pub tiles: u64,
}

/// What a report says of the present.
#[derive(Clone, Debug, Default)]
pub(crate) struct Present {
    pub time: Duration,
    pub views: u32,
    pub boards: usize,
    pub epochs: u64,
    pub leads: bool,
    pub term: u64,
    pub divider: u32,
    pub scale: u32,
    pub seconds: f64,
    pub link_bytes: LinkBytes,
    pub scene_bytes: u64,
    pub memory: Vec<BoardMemory>,
}

/// Things from outside that were dropped.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Dropped {
    /// Pose packets that were none.
    pub pose_packets: u64,
    /// Pose packets that were not newer than the last.
    pub stale_poses: u64,
    /// Entities that the scene doesn't have.
    pub unknown_entities: u64,
    /// Connections that didn't speak our protocol.
    pub connections: u64,
    /// Frames for a board whose queue was full.
    pub board_frames: u64,
    /// Boards that broke the protocol, or did not take their place.
    pub boards: u64,
}

/// A rig's statistics, ready to print.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Frames swapped.
    pub frames: u64,
    /// Number of views.
    pub views: u32,
    /// Boards in the row now.
    pub boards: usize,
    /// Wirings so far, in this term.
    pub epochs: u64,
    /// Whether this manager leads, or stands by.
    pub leads: bool,
    /// By which term it leads; 0: nobody can take its place.
    pub term: u64,
    /// Frames that were not shown because too few boards were ready with them for sure that nobody else leads.
    pub held_frames: u64,
    /// Frames in which some view repeated.
    pub late_frames: u64,
    /// Views that repeated.
    pub repeated_views: u64,
    /// When this was said, in seconds since the manager's start: the clock of events.
    pub time_s: f64,
    /// Seconds since the first frame opened.
    pub seconds: f64,
    /// How many nominal periods a frame takes at present.
    pub rate_divider: u32,
    /// How many of the picture's pixels, each way, one pixel drawn stands for at present.
    pub resolution_divider: u32,
    /// Frames that were selected for while the one before was drawn.
    pub frames_ahead: u64,
    /// Swaps that several displays made.
    pub display_swaps: u64,
    /// Of these, those after which all views showed that frame.
    pub same_frame_swaps: u64,
    /// From the first display's change of picture to the last one's, ms.
    pub swap_skew_ms: TimeSummary,
    /// From open to swap, ms.
    pub frame_ms: TimeSummary,
    /// From the host's packet to the swap, ms.
    pub latency_ms: TimeSummary,
    /// By stage, ms.
    pub stage_ms: StageTimes,
    /// Mean bytes of frame messages per frame, all boards.
    pub bytes_to_boards_per_frame: f64,
    /// Mean bytes of tiles per frame, all boards.
    pub bytes_from_boards_per_frame: f64,
    /// Triangles that came into geometry, all boards and frames.
    pub triangles: u64,
    /// Translucent fragments, likewise.
    pub fragments: u64,
    /// What was not done.
    pub skipped: Skipped,
    /// What was not taken.
    pub dropped: Dropped,
    /// What was sent of the scene, and what stood in for what hadn't come.
    pub streaming: Streaming,
    /// What all meshes and textures of the scene count for in a board's memory.
    pub scene_bytes: u64,
    /// What boards hold of it.
    pub memory: Vec<BoardMemory>,
    /// Traffic since the manager's start.
    pub link_bytes: LinkBytes,
    /// The newest events.
    pub events: Vec<EventEntry>,
}

/// The running counts behind a [`Report`].
#[derive(Clone, Debug, Default)]
pub(crate) struct Statistics {
    pub frames: u64,
    pub held_frames: u64,
    pub late_frames: u64,
    pub frames_ahead: u64,
    pub repeated_views: u64,
    pub frame: Times,
    pub latency: Times,
    pub select: Times,
    pub stream: Times,
    pub geometry: Times,
    pub raster: Times,
    pub translucency: Times,
    pub resolve: Times,
    pub transfer: Times,
    pub stitch: Times,
    pub bytes_to_boards: u64,
    pub bytes_from_boards: u64,
    pub triangles: u64,
    pub fragments: u64,
    pub skipped: Skipped,
    pub dropped: Dropped,
    pub streaming: Streaming,
    pub genlock: Genlock,
    events: VecDeque<EventEntry>,
}

/// The sums of a [`Statistics`], which cost nothing to tell: unlike a [`Report`], no distribution is looked through.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(crate) struct Totals {
    pub frames: u64,
    pub late_frames: u64,
    pub repeated_views: u64,
    pub bytes_to_boards: u64,
    pub bytes_from_boards: u64,
    pub triangles: u64,
    pub fragments: u64,
    pub skipped: Skipped,
    pub dropped: Dropped,
    pub streaming: Streaming,
}

/// Stages in the order of a frame, by the names of [`StageTimes`].
pub(crate) const STAGES: [&str; 8] =
    ["select", "stream", "geometry", "raster", "translucency", "resolve", "transfer", "stitch"];

#[cfg_attr(not(feature = "console"), allow(dead_code, reason = "only the console asks"))]
impl Statistics {
    pub(crate) fn totals(&self) -> Totals {
        Totals {
            frames: self.frames,
            late_frames: self.late_frames,
            repeated_views: self.repeated_views,
            bytes_to_boards: self.bytes_to_boards,
            bytes_from_boards: self.bytes_from_boards,
            triangles: self.triangles,
            fragments: self.fragments,
            skipped: self.skipped,
            dropped: self.dropped,
            streaming: self.streaming,
        }
    }

    /// Of a whole frame, of its latency, and of each of [`STAGES`].
    pub(crate) fn counts(&self) -> (TimeCounts, TimeCounts, [TimeCounts; STAGES.len()]) {
        let stages = [
            &self.select,
            &self.stream,
            &self.geometry,
            &self.raster,
            &self.translucency,
            &self.resolve,
            &self.transfer,
            &self.stitch,
        ];
        (self.frame.counts, self.latency.counts, stages.map(|times| times.counts))
    }

    /// The newest events, at most so many, the oldest first.
    pub(crate) fn newest_events(&self, count: usize) -> Vec<EventEntry> {
        self.events.range(self.events.len().saturating_sub(count)..).cloned().collect()
    }
}

impl Statistics {
    pub(crate) fn on_board_report(&mut self, report: &BoardReport) {
        // A board may say any number; a sum that can't be told any more is no reason to end the rig.
        let add = |sum: &mut u64, count: u64| *sum = sum.saturating_add(count);
        add(&mut self.triangles, report.triangles);
        add(&mut self.fragments, report.fragments);
        add(&mut self.bytes_from_boards, report.tile_bytes);
        add(&mut self.skipped.backface, report.backface);
        add(&mut self.skipped.occluded, report.occluded);
        add(&mut self.skipped.tiles_opaque, report.tiles_opaque);
        add(&mut self.skipped.pixels_single, report.pixels_single);
        add(&mut self.skipped.tiles_unchanged, report.tiles_unchanged);
        add(&mut self.skipped.frames_unchanged, report.frames_unchanged);
        if report.frames_unchanged == 0 {
            self.geometry.add(Duration::from_nanos(report.geometry_ns));
            self.raster.add(Duration::from_nanos(report.raster_ns));
            self.translucency.add(Duration::from_nanos(report.translucency_ns));
            self.resolve.add(Duration::from_nanos(report.resolve_ns));
        }
        self.transfer.add(Duration::from_nanos(report.transfer_ns));
    }

    pub(crate) fn on_event(&mut self, time: Duration, frame: u64, event: &'static str, detail: String) {
        tracing::info!(frame, "{event}: {detail}");
        if self.events.len() >= EVENTS_MAX {
            self.events.pop_front();
        }
        self.events.push_back(EventEntry { time_s: (time.as_secs_f64() * 1e3).round() / 1e3, frame, event, detail });
    }

    pub(crate) fn report(&self, present: Present) -> Report {
        let Present {
            time,
            views,
            boards,
            epochs,
            leads,
            term,
            divider,
            scale,
            seconds,
            link_bytes,
            scene_bytes,
            memory,
        } = present;
        let per_frame = |sum: u64| (sum as f64 / self.frames.max(1) as f64 * 10.0).round() / 10.0;
        Report {
            frames: self.frames,
            views,
            boards,
            epochs,
            leads,
            term,
            held_frames: self.held_frames,
            late_frames: self.late_frames,
            repeated_views: self.repeated_views,
            time_s: time.as_secs_f64(),
            seconds: (seconds * 1e3).round() / 1e3,
            rate_divider: divider,
            resolution_divider: scale,
            frames_ahead: self.frames_ahead,
            display_swaps: self.genlock.swaps,
            same_frame_swaps: self.genlock.same,
            swap_skew_ms: self.genlock.skew.summary(),
            frame_ms: self.frame.summary(),
            latency_ms: self.latency.summary(),
            stage_ms: StageTimes {
                select: self.select.summary(),
                stream: self.stream.summary(),
                geometry: self.geometry.summary(),
                raster: self.raster.summary(),
                translucency: self.translucency.summary(),
                resolve: self.resolve.summary(),
                transfer: self.transfer.summary(),
                stitch: self.stitch.summary(),
            },
            bytes_to_boards_per_frame: per_frame(self.bytes_to_boards),
            bytes_from_boards_per_frame: per_frame(self.bytes_from_boards),
            triangles: self.triangles,
            fragments: self.fragments,
            skipped: self.skipped,
            dropped: self.dropped,
            streaming: self.streaming,
            scene_bytes,
            memory,
            link_bytes: LinkBytes { tiles: self.bytes_from_boards, ..link_bytes },
            events: self.events.iter().cloned().collect(),
        }
    }
}
