//! The link to a compositor: a task that connects, gives the painter a queue, and empties it into the socket.

use super::painter::Work;
use ::link::{Expected, NodeRole, Trust};
use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use proto::backoff::Backoff;
use proto::codec::encode;
use proto::ids::BoardKey;
use proto::limits;
use proto::link::{self, LinkError};
use proto::message::{TileMessage, TileSink};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio_util::sync::{CancellationToken, DropGuard};

/// Frames that may wait for the compositor. When there is no room, a frame's tiles are not sent and the next frame's are
/// all sent: a compositor that hangs never holds a board back.
const QUEUE: usize = 4;
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);

/// Keeps a link to a compositor until dropped. Who drops it tells the painter.
pub(super) fn keep(
    sink: TileSink,
    key: BoardKey,
    painter: (std::sync::mpsc::Sender<Work>, u64),
    trust: Trust,
) -> DropGuard {
    let cut = CancellationToken::new();
    let ended = cut.clone();
    tokio::spawn(async move {
        let mut backoff = trust.backoff(key.0);
        let address = &sink.address;
        let keeping = async {
            loop {
                match carry(&sink, key, &painter, &trust, &mut backoff).await {
                    Ok(()) => tracing::info!(%address, "the compositor closed its link"),
                    Err(error) => tracing::info!(%address, %error, "no link to the compositor"),
                }
                if painter.0.send(Work::OutletDown(sink.key)).is_err() {
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
    sink: &TileSink,
    key: BoardKey,
    (painter, session): &(std::sync::mpsc::Sender<Work>, u64),
    trust: &Trust,
    backoff: &mut Backoff,
) -> Result<(), LinkError> {
    let connecting = async {
        let stream = trust.connect(&sink.address, &Expected::any(NodeRole::Compositor)).await?;
        link::open(stream, limits::CONTROL_MESSAGE_MAX).await
    };
    let Ok(connected) = tokio::time::timeout(CONNECT_TIMEOUT, connecting).await else {
        return Err(LinkError::Io(std::io::ErrorKind::TimedOut.into()));
    };
    let mut compositor = connected?;
    compositor.send(encode(&TileMessage::Hello { key }, &[])).await?;
    backoff.reset();
    let (queue, mut waiting) = mpsc::channel::<Vec<Bytes>>(QUEUE);
    if painter.send(Work::OutletUp(*session, sink.clone(), queue)).is_err() {
        return Ok(());
    }
    let (mut writer, mut source) = compositor.split();
    let writing = async {
        while let Some(messages) = waiting.recv().await {
            for message in messages {
                writer.feed(message).await?;
            }
            writer.flush().await?;
        }
        Ok::<_, LinkError>(())
    };
    tokio::select! {
        ended = writing => ended,
        // The compositor never speaks: anything here is its end.
        _ = source.next() => Ok(()),
    }
}
