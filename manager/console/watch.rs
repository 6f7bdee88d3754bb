//! The socket of one viewer (`/api/v1/watch`).
//!
//! We say, as text: first `{"hello": …, "history": […]}`, then `{"state": …, "sample": …}` four times a second; as bytes, pictures: a frame's number
//! (8 bytes, little-endian) and a JPEG. The viewer says `shown` for each picture that he has shown, so that he never has more than two on
//! their way; `hide` when nobody sees the page, and `look` again. A viewer who doesn't read is told the newest when he does.

use super::Room;
use super::access::Denied;
use super::pictures::Waiting;
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use std::sync::Arc;
use std::time::Duration;

/// Viewers at once; one more is refused.
const VIEWERS_MAX: usize = 64;
/// Longest message of a viewer, bytes: they are words.
const MESSAGE_MAX: usize = 1024;
/// Pictures on their way to one viewer: two, so that the next travels while he shows the last.
const PICTURES_MAX: u32 = 2;
/// A viewer who takes nothing for so long is gone.
const SEND_TIMEOUT: Duration = Duration::from_secs(20);

/// `GET /api/v1/watch`.
pub(super) async fn watch(
    State(room): State<Arc<Room>>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Result<Response, Denied> {
    room.access.check_site(&headers)?;
    if room.observer.viewers() >= VIEWERS_MAX {
        let full = format!("{VIEWERS_MAX} viewers are looking already, the most there can be");
        return Ok((StatusCode::SERVICE_UNAVAILABLE, super::problem(&full)).into_response());
    }
    let upgrade = upgrade.max_message_size(MESSAGE_MAX).max_frame_size(MESSAGE_MAX);
    Ok(upgrade.on_upgrade(move |socket| async move {
        // `None`: he has gone, which is no error.
        let _ = serve(socket, &room).await;
    }))
}

async fn send(socket: &mut WebSocket, message: Message) -> Option<()> {
    tokio::time::timeout(SEND_TIMEOUT, socket.send(message)).await.ok()?.ok()
}

async fn serve(mut socket: WebSocket, room: &Room) -> Option<()> {
    let mut told = room.observer.subscribe();
    let mut pictures = room.pictures.subscribe();
    // The last one may be from long ago.
    pictures.mark_unchanged();
    let hello = serde_json::json!({
        "hello": { "controls": room.access.controls(), "version": env!("CARGO_PKG_VERSION") },
        "history": room.observer.history(),
    });
    send(&mut socket, Message::Text(hello.to_string().into())).await?;
    let mut under_way = 0;
    let mut is_looking = true;
    let mut waiting: Option<Waiting<'_>> = None;
    loop {
        if is_looking && under_way < PICTURES_MAX {
            waiting.get_or_insert_with(|| room.pictures.wait());
        } else {
            waiting = None;
        }
        tokio::select! {
            message = socket.recv() => match message?.ok()? {
                Message::Text(text) => match text.as_str() {
                    "shown" => under_way = under_way.saturating_sub(1),
                    "hide" => is_looking = false,
                    // Whatever was under way when the page was hidden may never be shown.
                    "look" => (is_looking, under_way) = (true, 0),
                    _ => return None,
                },
                Message::Close(_) | Message::Binary(_) => return None,
                Message::Ping(_) | Message::Pong(_) => {}
            },
            changed = told.changed() => {
                changed.ok()?;
                let text = told.borrow_and_update().clone();
                if let Some(text) = text {
                    send(&mut socket, Message::Text(text)).await?;
                }
            }
            changed = pictures.changed(), if waiting.is_some() => {
                changed.ok()?;
                let picture = pictures.borrow_and_update().clone();
                if let Some((_, bytes)) = picture {
                    under_way += 1;
                    send(&mut socket, Message::Binary(bytes)).await?;
                }
            }
        }
    }
}
