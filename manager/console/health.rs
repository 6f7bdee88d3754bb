//! For whoever starts and restarts processes. `/health`: the process answers and its engine turns; if not, start it anew. `/ready`: pictures are
//! shown; if not, it says what is missing, and waiting helps more than a new start.

use super::Room;
use crate::backplane::desk::Silence;
use crate::backplane::live::Live;
use axum::extract::State;
use axum::http::StatusCode;
use std::sync::Arc;
use std::time::Duration;

/// Frames are shown if one was within this time, or within four periods if that is longer.
const SHOWN_WITHIN: Duration = Duration::from_secs(3);
/// In lock-step frames come as poses do, and each takes as long as it takes.
const LOCK_STEP_WITHIN: Duration = Duration::from_secs(60);

/// How long ago the last frame may have been shown.
pub(super) fn shown_within(live: &Live) -> Duration {
    live.period.map_or(LOCK_STEP_WITHIN, |period| (period * live.divider * 4).max(SHOWN_WITHIN))
}

type Answer = (StatusCode, String);

/// `GET /health`.
pub(super) async fn health(State(room): State<Arc<Room>>) -> Answer {
    match room.desk.live().await {
        Ok(_) => (StatusCode::OK, "ok\n".into()),
        Err(silence) => unavailable(silence),
    }
}

/// `GET /ready`.
pub(super) async fn ready(State(room): State<Arc<Room>>) -> Answer {
    match room.desk.live().await.map(|live| missing(&live)) {
        Ok(None) => (StatusCode::OK, "ready\n".into()),
        Ok(Some(missing)) => (StatusCode::SERVICE_UNAVAILABLE, format!("{missing}\n")),
        Err(silence) => unavailable(silence),
    }
}

fn unavailable(silence: Silence) -> Answer {
    (StatusCode::SERVICE_UNAVAILABLE, format!("{silence}\n"))
}

/// What keeps pictures from being shown. A rig that somebody has paused is ready: who takes it away from him can't go on.
pub(super) fn missing(live: &Live) -> Option<String> {
    if let Some(of) = &live.lead.of {
        return Some(format!("this manager stands by for {of}, which leads"));
    }
    if live.row == 0 {
        return Some("no board is in the row".into());
    }
    if live.wiring.is_none() {
        return Some(format!("the wiring of {} boards has not closed", live.row));
    }
    if !live.has_compositor {
        return Some("no compositor is connected".into());
    }
    if live.is_paused {
        return None;
    }
    match live.shown {
        None => Some("no frame has been shown yet".into()),
        Some(at) if live.now.since(at) >= shown_within(live) => {
            Some(format!("no frame has been shown for {:.1} s", live.now.since(at).as_secs_f64()))
        }
        Some(_) => None,
    }
}
