//! The link to the compositor: a task that connects, gives the painter a queue, and empties it into the socket.

use super::painter::Work;
use ::link::{Expected, NodeRole, Trust};
use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use proto::backoff::Backoff;
use proto::codec::encode;
use proto::ids::BoardKey;
use proto::limits;
use proto::link::{self, LinkError};
use proto::message::TileMessage;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio_util::sync::{CancellationToken, DropGuard};

/// Frames that may wait for the compositor. When there is no room, a frame's tiles are not sent and the next frame's are
/// all sent: a compositor that hangs never holds a board back.
const QUEUE: usize = 4;
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);

/// Keeps a link to the compositor at `address` until dropped. Who drops it tells the painter.
pub(super) fn keep(address: String, key: BoardKey, painter: std::sync::mpsc::Sender<Work>, trust: Trust) -> DropGuard {
    let cut = CancellationToken::new();
    let ended = cut.clone();
    tokio::spawn(async move {
        let mut backoff = trust.backoff(key.0);
        let keeping = async {
            loop {
                match carry(&address, key, &painter, &trust, &mut backoff).await {
                    Ok(()) => tracing::info!(%address, "the compositor closed its link"),
                    Err(error) => tracing::info!(%address, %error, "no link to the compositor"),
                }
                if painter.send(Work::Outlet(None)).is_err() {
                    return;
                }
                tokio::time::sleep(backoff.next_wait()).await;
            }
        };
        tokio::select! {
            // First: nothing of this link may reach the painter after the next one's.
            biased;
            () = ended.cancelled() => {}
            () = keeping => {}
        }
    });
    cut.drop_guard()
}

async fn carry(
    address: &str,
    key: BoardKey,
    painter: &std::sync::mpsc::Sender<Work>,
    trust: &Trust,
    backoff: &mut Backoff,
) -> Result<(), LinkError> {
    let connecting = async {
        let stream = trust.connect(address, &Expected::any(NodeRole::Compositor)).await?;
        link::open(stream, limits::CONTROL_MESSAGE_MAX).await
    };
    let Ok(connected) = tokio::time::timeout(CONNECT_TIMEOUT, connecting).await else {
        return Err(LinkError::Io(std::io::ErrorKind::TimedOut.into()));
    };
    let mut compositor = connected?;
    compositor.send(encode(&TileMessage::Hello { key }, &[])).await?;
    backoff.reset();
    let (queue, mut waiting) = mpsc::channel::<Vec<Bytes>>(QUEUE);
    if painter.send(Work::Outlet(Some(queue))).is_err() {
        return Ok(());
    }
    let (mut sink, mut source) = compositor.split();
    let writing = async {
        while let Some(messages) = waiting.recv().await {
            for message in messages {
                sink.feed(message).await?;
            }
            sink.flush().await?;
        }
        Ok::<_, LinkError>(())
    };
    tokio::select! {
        ended = writing => ended,
        // The compositor never speaks: anything here is its end.
        _ = source.next() => Ok(()),
    }
}
