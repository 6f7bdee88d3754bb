//! For Prometheus (`GET /metrics`): the statistics under their own names, times in seconds, in histograms whose buckets are fine
//! round the periods of frame rates. Everything is counted where it happens; here it is only written down.
//!
//! Who accepts `OpenMetrics` text gets it, as every Prometheus does. Others, such as curl and `promtool check metrics`, get the older text, in which a
//! counter is called what its sample is: with `_total`.

use super::Room;
use super::health::missing;
use super::state::{Board, State as Seen};
use crate::backplane::desk::Silence;
use crate::backplane::live::Live;
use crate::backplane::statistics::{BUCKETS_S, STAGES, TimeCounts};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric, MetricEncoder, NoLabelSet, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::ConstCounter;
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::registry::{Registry, Unit};
use proto::debug::DebugPicture;
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";
const PLAIN: &str = "text/plain; version=0.0.4; charset=utf-8";

/// A rig at one moment, to be written.
#[derive(Debug)]
struct Rig {
    live: Arc<Live>,
    viewers: usize,
}

/// `GET /metrics`.
pub(super) async fn metrics(State(room): State<Arc<Room>>, asked: HeaderMap) -> Result<Response, Silence> {
    let rig = Rig { live: room.desk.live().await?, viewers: room.observer.viewers() };
    let mut registry = Registry::with_prefix("cyclorama");
    registry.register_collector(Box::new(rig));
    let mut page = String::new();
    let accepted = asked.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let is_open = accepted.flat_map(|value| value.split(',')).any(|kind| kind.contains("application/openmetrics-text"));
    Ok(match text::encode(&mut page, &registry) {
        Ok(()) if is_open => ([(header::CONTENT_TYPE, OPEN_METRICS)], page).into_response(),
        Ok(()) => ([(header::CONTENT_TYPE, PLAIN)], plain(&page)).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, super::problem(&error.to_string())).into_response(),
    })
}

/// `OpenMetrics` text as the older text: families of counters have their samples' names, and there are neither units nor an end mark.
fn plain(page: &str) -> String {
    let types = page.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.strip_suffix(" counter"));
    let counters: BTreeSet<&str> = types.collect();
    let mut older = String::with_capacity(page.len() + counters.len() * 2 * "_total".len());
    for line in page.lines() {
        let mut words = line.splitn(4, ' ');
        match (words.next(), words.next(), words.next(), words.next()) {
            (Some("#"), Some("UNIT"), ..) | (Some("#"), Some("EOF"), None, None) => continue,
            (Some("#"), Some(what), Some(name), Some(rest)) if counters.contains(name) => {
                older.extend(["# ", what, " ", name, "_total ", rest]);
            }
            _ => older.push_str(line),
        }
        older.push('\n');
    }
    older
}

/// The fields of a struct of counts, by their names.
fn fields(counts: impl Serialize) -> Vec<(String, u64)> {
    let value = serde_json::to_value(counts).unwrap_or_default();
    let all = value.as_object().into_iter().flatten();
    all.filter_map(|(name, count)| Some((name.clone(), count.as_u64()?))).collect()
}

/// Writes metrics, each with what it says.
struct Writer<'a>(DescriptorEncoder<'a>);

impl Writer<'_> {
    fn counter(&mut self, name: &str, unit: Option<&Unit>, help: &str, value: u64) -> fmt::Result {
        ConstCounter::new(value).encode(self.0.encode_descriptor(name, help, unit, MetricType::Counter)?)
    }

    fn gauge(&mut self, name: &str, unit: Option<&Unit>, help: &str, value: f64) -> fmt::Result {
        ConstGauge::new(value).encode(self.0.encode_descriptor(name, help, unit, MetricType::Gauge)?)
    }

    /// A counter for each of what `label` tells apart.
    fn counters(
        &mut self,
        name: &str,
        unit: Option<&Unit>,
        help: &str,
        label: &str,
        all: &[(String, u64)],
    ) -> fmt::Result {
        let mut family = self.0.encode_descriptor(name, help, unit, MetricType::Counter)?;
        for (value, count) in all {
            ConstCounter::new(*count).encode(family.encode_family(&[(label, value.as_str())])?)?;
        }
        Ok(())
    }

    /// A gauge for each board that has a value.
    fn boards(
        &mut self,
        name: &str,
        unit: Option<&Unit>,
        help: &str,
        boards: &[Board],
        value: impl Fn(&Board) -> Option<f64>,
    ) -> fmt::Result {
        let mut family = self.0.encode_descriptor(name, help, unit, MetricType::Gauge)?;
        let mut names = BTreeSet::new();
        for board in boards {
            // Two boards may have one name, two series not.
            let is_first = names.insert(board.name.clone());
            let name = if is_first { board.name.clone() } else { format!("{} #{}", board.name, board.key) };
            if let Some(value) = value(board) {
                ConstGauge::new(value).encode(family.encode_family(&[("board", name.as_str())])?)?;
            }
        }
        Ok(())
    }

    fn times(&mut self, name: &str, help: &str, counts: &TimeCounts) -> fmt::Result {
        histogram(&mut self.0.encode_descriptor(name, help, Some(&Unit::Seconds), MetricType::Histogram)?, counts)
    }
}

fn histogram(encoder: &mut MetricEncoder<'_>, counts: &TimeCounts) -> fmt::Result {
    let ends = BUCKETS_S.into_iter().chain([f64::INFINITY]);
    let buckets: Vec<(f64, u64)> = ends.zip(counts.buckets).collect();
    let all = counts.buckets.iter().sum();
    encoder.encode_histogram::<NoLabelSet>(counts.sum.as_secs_f64(), all, &buckets, None)
}

impl Collector for Rig {
    fn encode(&self, encoder: DescriptorEncoder<'_>) -> fmt::Result {
        let Self { live, viewers } = self;
        let (totals, seen) = (&live.totals, Seen::of(live));
        let flag = |is: bool| f64::from(u8::from(is));
        let (ratio, bytes, seconds) = (&Unit::Other("ratio".into()), Some(&Unit::Bytes), Some(&Unit::Seconds));
        let ratio = Some(ratio);
        let mut to = Writer(encoder);

        to.counter("frames", None, "Frames swapped", totals.frames)?;
        to.counter("late_frames", None, "Frames in which some view repeated", totals.late_frames)?;
        to.counter("repeated_views", None, "Views that repeated", totals.repeated_views)?;
        to.counter("epochs", None, "Wirings so far", live.epoch)?;
        to.counter("triangles", None, "Triangles that came into geometry, all boards", totals.triangles)?;
        to.counter("fragments", None, "Translucent fragments, all boards", totals.fragments)?;
        to.counter("to_boards", bytes, "Bytes of frame messages", totals.bytes_to_boards)?;
        to.counter("from_boards", bytes, "Bytes of tiles", totals.bytes_from_boards)?;
        to.counters("link", bytes, "All bytes over links, by direction", "link", &fields(live.link_bytes))?;
        to.counters("skipped", None, "Work that was not needed, by what it was", "what", &fields(totals.skipped))?;
        to.counters("dropped", None, "Things from outside that were dropped", "what", &fields(totals.dropped))?;
        let mut streaming = fields(totals.streaming);
        streaming.retain(|(name, _)| name != "piece_bytes");
        to.counters("streaming", None, "Pieces of the scene, and what stood in for them", "what", &streaming)?;
        to.counter("piece", bytes, "Bytes of meshes and textures sent", totals.streaming.piece_bytes)?;

        to.times("frame", "From opening a frame to its swap", &live.frame_times)?;
        to.times("latency", "From the host's packet to the swap", &live.latency_times)?;
        let help = "Time by stage; a board's stages of all boards";
        let mut stages = to.0.encode_descriptor("stage", help, seconds, MetricType::Histogram)?;
        for (stage, counts) in STAGES.iter().zip(&live.stage_times) {
            histogram(&mut stages.encode_family(&[("stage", *stage)])?, counts)?;
        }

        to.gauge("boards", None, "Boards in the row", live.row as f64)?;
        to.gauge("views", None, "Views of the rig", live.views.len() as f64)?;
        let resolution = "Pixels of the picture, each way, that one pixel drawn stands for";
        to.gauge("resolution_divider", None, resolution, live.scale.into())?;
        to.gauge("rate_divider", None, "Nominal periods that a frame takes at present", live.divider.into())?;
        to.gauge(
            "deadline",
            seconds,
            "How long a frame may take; 0: as long as it likes",
            seen.deadline_ms.unwrap_or(0.0) / 1e3,
        )?;
        to.gauge("ready", None, "1: pictures are shown, as /ready says", flag(missing(live).is_none()))?;
        to.gauge("paused", None, "1: held at a console", flag(live.is_paused))?;
        to.gauge("compositor", None, "1: a compositor is connected", flag(live.has_compositor))?;
        to.gauge("leads", None, "1: this manager leads; 0: it stands by", flag(live.lead.leads))?;
        to.gauge("term", None, "Term by which it leads, or that it has heard of; 0: none", live.lead.term as f64)?;
        let standby = live.lead.leads && live.lead.other.is_some();
        to.gauge("standby", None, "1: this manager leads, and another stands by for it", flag(standby))?;
        let debug = live.debug != DebugPicture::Off;
        to.gauge("debug_picture", None, "1: boards draw a debug picture, which displays show", flag(debug))?;
        to.gauge("console_viewers", None, "Viewers at consoles", *viewers as f64)?;
        to.gauge("display_factor", None, "The factor K of detail", live.display_factor)?;
        to.gauge("models_in_transition", None, "Models between two levels, or fading", live.in_transition as f64)?;
        to.gauge(
            "scene",
            bytes,
            "What all meshes and textures count for in a board's memory",
            live.scene_bytes as f64,
        )?;

        let boards = &seen.boards;
        to.boards(
            "board_drawing",
            None,
            "1: the board's share was in the last swap; 0: it is there or missed",
            boards,
            |board| Some(flag(board.is_drawing())),
        )?;
        to.boards("board_share", ratio, "Part of all views that the board draws", boards, |board| {
            board.id.map(|_| board.share_percent / 100.0)
        })?;
        to.boards("board_load", ratio, "Part of a frame's time that drawing takes, last second", boards, |board| {
            board.load_percent.map(|percent| percent / 100.0)
        })?;
        to.boards("board_frame", seconds, "Mean time of the board's part of a frame, last second", boards, |board| {
            board.frame_ms.map(|ms| ms / 1e3)
        })?;
        to.boards("board_memory_held", bytes, "Meshes and textures that the board holds", boards, |board| {
            board.memory_held_bytes.map(|bytes| bytes as f64)
        })?;
        to.boards("board_memory_limit", bytes, "What the board has room for", boards, |board| {
            board.memory_limit_bytes.map(|bytes| bytes as f64)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::plain;

    #[test]
    fn the_older_text_names_counters_as_their_samples() {
        let open = "# HELP rig_link_bytes All bytes.\n# TYPE rig_link_bytes counter\n# UNIT rig_link_bytes bytes\nrig_link_bytes_total{link=\"tiles\"} 7\n\
                    # HELP rig_boards In the row.\n# TYPE rig_boards gauge\nrig_boards 3\n# EOF\n";
        let older = "# HELP rig_link_bytes_total All bytes.\n# TYPE rig_link_bytes_total counter\nrig_link_bytes_total{link=\"tiles\"} 7\n\
                     # HELP rig_boards In the row.\n# TYPE rig_boards gauge\nrig_boards 3\n";
        assert_eq!(plain(open), older);
    }
}
