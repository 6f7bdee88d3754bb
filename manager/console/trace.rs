//! The last frames as a trace that Perfetto and Chrome open (`GET /api/v1/trace`): the JSON of Chrome's Trace Event Format, complete events only.
//! Each board has a track, the compositor one, frames one, and one shows how long the host's packets waited.

use super::Room;
use crate::backplane::desk::Silence;
use crate::backplane::spans::{Span, Track, spans};
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Json, Response};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The only process that is told of: what others did is told by the manager's clock.
const PROCESS: u32 = 1;

fn title(track: &Track) -> String {
    match track {
        Track::Host => "host: packets that wait".into(),
        Track::Frames(0) => "frames".into(),
        Track::Frames(lane) => format!("frames, overlapping {lane}"),
        Track::Board(name) => format!("board {name}"),
        Track::Compositor => "compositor".into(),
    }
}

fn micros(ns: u64) -> f64 {
    ns as f64 / 1e3
}

fn write(spans: &[Span]) -> Value {
    let mut tracks: BTreeMap<&Track, u32> = spans.iter().map(|span| (&span.track, 0)).collect();
    let mut events = vec![json!({"ph": "M", "name": "process_name", "pid": PROCESS, "args": {"name": "cyclorama"}})];
    for (number, (track, id)) in tracks.iter_mut().enumerate() {
        *id = number as u32 + 1;
        events
            .push(json!({"ph": "M", "name": "thread_name", "pid": PROCESS, "tid": id, "args": {"name": title(track)}}));
        events.push(
            json!({"ph": "M", "name": "thread_sort_index", "pid": PROCESS, "tid": id, "args": {"sort_index": id}}),
        );
    }
    for span in spans {
        let tid = tracks[&span.track];
        let mut event = |name: &str, begin: u64, end: u64, notes: &[(&str, u64)]| {
            let mut about: serde_json::Map<String, Value> =
                notes.iter().map(|(k, v)| ((*k).into(), json!(v))).collect();
            about.insert("frame".into(), json!(span.frame.0));
            events.push(json!({
                "ph": "X", "cat": "frame", "name": name, "pid": PROCESS, "tid": tid,
                "ts": micros(begin), "dur": micros(end - begin), "args": about,
            }));
        };
        event(span.name, span.begin_ns, span.end_ns, &span.notes);
        for stage in &span.stages {
            let view = stage.view.map(|view| ("view", u64::from(view)));
            event(stage.name, stage.begin_ns, stage.end_ns, view.as_slice());
        }
    }
    json!({"displayTimeUnit": "ms", "traceEvents": events})
}

/// `GET /api/v1/trace`.
pub(super) async fn trace(State(room): State<Arc<Room>>) -> Result<Response, Silence> {
    let frames = room.desk.traces().await?;
    let name = [(header::CONTENT_DISPOSITION, "inline; filename=\"cyclorama-trace.json\"")];
    Ok((name, Json(write(&spans(frames.iter().map(AsRef::as_ref))))).into_response())
}
