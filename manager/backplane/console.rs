//! The console: one self-contained page with the newest stitched picture and the statistics, and the same as JSON.
//!
//! It only ever asks the engine, and a picture is only made while somebody looks; a frame never waits for a viewer.

use super::engine::Event;
use super::links::post;
use super::statistics::Report;
use axum::Router;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{Html, IntoResponse, Json, Response};
use axum::routing::get;
use std::sync::mpsc::SyncSender;
use tokio::net::TcpListener;
use tokio::sync::oneshot;

const PAGE: &str = include_str!("console.html");

/// Serves until cancelled.
pub(crate) async fn serve(listener: TcpListener, engine: SyncSender<Event>) {
    let app = Router::new()
        .route("/", get(page))
        .route("/health", get(|| async { "ok\n" }))
        .route("/picture.jpg", get(picture))
        .route("/api/v1/stats", get(stats))
        .with_state(engine);
    if let Err(error) = axum::serve(listener, app).await {
        tracing::error!(%error, "the console has ended");
    }
}

async fn page() -> impl IntoResponse {
    let policy = "default-src 'none'; img-src 'self' blob:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; connect-src 'self'";
    ([(header::CONTENT_SECURITY_POLICY, policy), (header::X_CONTENT_TYPE_OPTIONS, "nosniff")], Html(PAGE))
}

async fn ask<T>(engine: &SyncSender<Event>, question: impl FnOnce(oneshot::Sender<T>) -> Event) -> Option<T> {
    let (answer, answered) = oneshot::channel();
    if !post(engine, question(answer)).await {
        return None;
    }
    answered.await.ok()
}

async fn picture(State(engine): State<SyncSender<Event>>) -> Response {
    match ask(&engine, Event::Picture).await {
        Some(Some((frame, jpeg))) => {
            let mut headers = HeaderMap::new();
            headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("image/jpeg"));
            headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
            headers.insert("x-frame", HeaderValue::from(frame.0));
            (headers, jpeg).into_response()
        }
        Some(None) => (StatusCode::NOT_FOUND, "no picture yet; ask again in a moment\n").into_response(),
        None => (StatusCode::SERVICE_UNAVAILABLE, "the rig has ended\n").into_response(),
    }
}

async fn stats(State(engine): State<SyncSender<Event>>) -> Result<Json<Report>, (StatusCode, &'static str)> {
    ask(&engine, Event::Report).await.map(Json).ok_or((StatusCode::SERVICE_UNAVAILABLE, "the rig has ended\n"))
}
