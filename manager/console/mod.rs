//! The console: an instrument panel for who runs a rig, in a browser; and the same for programs.
//!
//! It knows nothing itself. The engine is asked, four times a second however many look ([`Desk`]), and never waits; pictures are made
//! by the compositor only as fast as somebody shows them. All of it runs on a thread of its own that yields to whatever makes frames: on a
//! machine that is too busy, the console is what gets slow.
//!
//! | module | what |
//! |---|---|
//! | `access` | who may look, who may change something |
//! | `page` (files) | the page: HTML, style, scripts, all in the program |
//! | `watch` | the socket of one viewer |
//! | `observer` | looks at the rig four times a second, for all of them |
//! | `state` | what a viewer is told |
//! | `history` | the last minute, for the chart |
//! | `pictures` | pictures on their way to viewers |
//! | `owners` | which tile is whose |
//! | `control` | what can be changed |
//! | `health` | for whoever starts and restarts processes |
//! | `metrics` | for Prometheus |
//! | `trace` | the last frames, for Perfetto |

mod access;
mod control;
mod health;
mod history;
mod metrics;
mod observer;
mod owners;
mod pictures;
mod state;
mod trace;
mod watch;

use crate::backplane::Token;
use crate::backplane::desk::{Desk, Silence};
use access::Access;
use axum::Router;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Json, Response};
use axum::routing::{get, post};
use observer::Observer;
use pictures::Pictures;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::net::TcpListener;
use tokio_util::sync::{CancellationToken, DropGuard};

/// How long who asks for a picture waits for a newer one than there is, for the first, and how often it is looked for.
const PATIENCE_WITH_OLD: Duration = Duration::from_millis(500);
const PATIENCE_WITHOUT: Duration = Duration::from_secs(2);
const PICTURE_PERIOD: Duration = Duration::from_millis(45);

/// Nothing from elsewhere, no scripts but the files, and nobody frames the page.
const POLICY: &str = "default-src 'none'; img-src 'self'; style-src 'self'; script-src 'self'; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The page's files: address, kind, text.
const FILES: [(&str, &str, &str); 7] = [
    ("/", "text/html; charset=utf-8", include_str!("page/console.html")),
    ("/console.css", "text/css; charset=utf-8", include_str!("page/console.css")),
    ("/console.js", "text/javascript; charset=utf-8", include_str!("page/console.js")),
    ("/panels.js", "text/javascript; charset=utf-8", include_str!("page/panels.js")),
    ("/chart.js", "text/javascript; charset=utf-8", include_str!("page/chart.js")),
    ("/picture.js", "text/javascript; charset=utf-8", include_str!("page/picture.js")),
    ("/icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
];

/// What all that is served shares.
#[derive(Debug)]
struct Room {
    desk: Desk,
    access: Access,
    observer: Observer,
    pictures: Pictures,
}

/// A console that is being served; it ends when this goes.
#[derive(Debug)]
pub(crate) struct Console {
    _end: DropGuard,
}

impl Console {
    /// Serves on a thread of its own.
    ///
    /// # Errors
    /// When the thread or its runtime can't be started.
    pub(crate) fn start(listener: TcpListener, token: Option<Token>, desk: Desk) -> io::Result<Self> {
        let access = Access::new(listener.local_addr()?, token);
        // Sockets belong to the runtime that they were opened in.
        let listener = listener.into_std()?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let end = CancellationToken::new();
        let ended = end.clone();
        std::thread::Builder::new().name("console".into()).spawn(move || {
            pool::turns::go_behind();
            let room = Room { desk, access, observer: Observer::default(), pictures: Pictures::default() };
            if let Err(error) = runtime.block_on(serve(listener, Arc::new(room), ended)) {
                tracing::error!(%error, "the console has ended");
            }
        })?;
        Ok(Self { _end: end.drop_guard() })
    }
}

async fn serve(listener: std::net::TcpListener, room: Arc<Room>, end: CancellationToken) -> io::Result<()> {
    let listener = TcpListener::from_std(listener)?;
    let served = axum::serve(listener, router(Arc::clone(&room)).into_make_service_with_connect_info::<SocketAddr>());
    tokio::select! {
        served = async { served.await } => served,
        () = room.observer.run(&room.desk) => Ok(()),
        () = room.pictures.run(&room.desk) => Ok(()),
        () = end.cancelled() => Ok(()),
    }
}

fn router(room: Arc<Room>) -> Router {
    let file = |(_, kind, text): (&str, &'static str, &'static str)| get(move || async move { page_file(kind, text) });
    let files = FILES.into_iter().fold(Router::new(), |router, entry| router.route(entry.0, file(entry)));
    files
        .route("/health", get(health::health))
        .route("/ready", get(health::ready))
        .route("/metrics", get(metrics::metrics))
        .route("/picture.jpg", get(picture))
        .route("/api/v1/stats", get(stats))
        .route("/api/v1/live", get(live))
        .route("/api/v1/owners", get(owners::owners))
        .route("/api/v1/trace", get(trace::trace))
        .route("/api/v1/watch", get(watch::watch))
        .route("/api/v1/control", post(control::control))
        .with_state(room)
}

fn page_file(kind: &'static str, text: &'static str) -> Response {
    let head = [
        (header::CONTENT_TYPE, kind),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        // A new program has new files under the same names.
        (header::CACHE_CONTROL, "no-cache"),
    ];
    (head, text).into_response()
}

/// An error's body.
fn problem(error: &str) -> Json<serde_json::Value> {
    Json(serde_json::json!({ "error": error }))
}

impl IntoResponse for Silence {
    fn into_response(self) -> Response {
        (StatusCode::SERVICE_UNAVAILABLE, problem(&self.to_string())).into_response()
    }
}

/// `GET /picture.jpg`. What the engine has may be from long ago, or not be there yet; asking has one made, which is waited for shortly.
async fn picture(State(room): State<Arc<Room>>) -> Result<Response, Silence> {
    let first = room.desk.picture().await?;
    let old = first.as_ref().map(|(frame, _)| *frame);
    let patience = if first.is_some() { PATIENCE_WITH_OLD } else { PATIENCE_WITHOUT };
    let (started, mut newest) = (Instant::now(), first);
    while newest.as_ref().map(|(frame, _)| *frame) == old && started.elapsed() < patience {
        tokio::time::sleep(PICTURE_PERIOD).await;
        newest = room.desk.picture().await?;
    }
    let Some((frame, jpeg)) = newest else {
        let problem =
            problem("there is no picture yet: no frame has been shown as a whole; /ready says what is missing");
        return Ok((StatusCode::SERVICE_UNAVAILABLE, [(header::RETRY_AFTER, "1")], problem).into_response());
    };
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("image/jpeg"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(HeaderName::from_static("x-frame"), HeaderValue::from(frame.0));
    Ok((headers, jpeg).into_response())
}

async fn stats(State(room): State<Arc<Room>>) -> Result<Response, Silence> {
    Ok(Json(room.desk.report().await?).into_response())
}

async fn live(State(room): State<Arc<Room>>) -> Result<Response, Silence> {
    Ok(Json(state::State::of(&*room.desk.live().await?)).into_response())
}
