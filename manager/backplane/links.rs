//! Links to boards and compositors: they only move bytes between sockets and the engine.
//!
//! | task | waits for |
//! |---|---|
//! | listener | connections |
//! | one reader per link | messages; hands each to the engine |
//! | one writer per link | its queue; scene pieces it takes from [`Content`] itself, so that a joining board's megabytes don't sit in a queue |
//!
//! The engine never waits for a link. A link whose queue is full gets no more frames ([`Outbox::try_frame`], counted); one
//! that can't even take a message of the chain is hung, and dropped.

use super::content::Content;
use super::engine::Event;
use bytes::Bytes;
use futures_util::SinkExt;
use futures_util::stream::{SplitSink, SplitStream, StreamExt};
use proto::codec;
use proto::ids::{BoardKey, ContentId};
use proto::limits;
use proto::link::{self, Link, LinkError};
use proto::message::{FromBoard, FromCompositor, Hello, Role};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// Messages that may wait for one link.
const OUTBOX: usize = 64;
/// Of these, places that frames may not take, so that the chain's messages get through.
const OUTBOX_RESERVE: usize = 16;
/// A peer that has not said hello by then is dropped.
const GREETING_TIMEOUT: Duration = Duration::from_secs(5);
/// Peers connected at once, greeted or not.
const CONNECTIONS_MAX: usize = limits::BOARDS_MAX + 64;

/// What a writer sends.
#[derive(Debug)]
enum Outgoing {
    Message(Bytes),
    Pieces(Vec<ContentId>),
    /// Flush, then close.
    Close,
}

/// The engine's end of a link.
#[derive(Clone, Debug)]
pub(crate) struct Outbox {
    queue: mpsc::Sender<Outgoing>,
    /// Ends both tasks of the link at once.
    cut: CancellationToken,
}

impl Outbox {
    /// Queues a message that must not be lost. False: the link is hung or gone and has been cut.
    pub(crate) fn send(&self, message: Bytes) -> bool {
        self.put(Outgoing::Message(message))
    }

    /// Queues the scene's pieces.
    pub(crate) fn send_pieces(&self, ids: Vec<ContentId>) -> bool {
        self.put(Outgoing::Pieces(ids))
    }

    /// Queues a frame if there is room to spare.
    pub(crate) fn try_frame(&self, message: Bytes) -> bool {
        self.queue.capacity() > OUTBOX_RESERVE && self.queue.try_send(Outgoing::Message(message)).is_ok()
    }

    /// Closes the link after what is queued.
    pub(crate) fn close(&self) {
        self.put(Outgoing::Close);
    }

    /// Drops the link at once.
    pub(crate) fn cut(&self) {
        self.cut.cancel();
    }

    fn put(&self, outgoing: Outgoing) -> bool {
        let is_queued = self.queue.try_send(outgoing).is_ok();
        if !is_queued {
            self.cut.cancel();
        }
        is_queued
    }
}

/// Hands an event to the engine; waits, without blocking the runtime, while its queue is full. False: the engine has
/// ended.
pub(crate) async fn post(engine: &SyncSender<Event>, mut event: Event) -> bool {
    loop {
        match engine.try_send(event) {
            Ok(()) => return true,
            Err(TrySendError::Disconnected(_)) => return false,
            Err(TrySendError::Full(back)) => {
                event = back;
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
        }
    }
}

/// Accepts links for ever.
pub(crate) async fn listen(listener: TcpListener, engine: SyncSender<Event>, content: Arc<Content>) {
    let keys = Arc::new(AtomicU64::new(1));
    let places = Arc::new(tokio::sync::Semaphore::new(CONNECTIONS_MAX));
    loop {
        // The semaphore is never closed.
        let Ok(place) = places.clone().acquire_owned().await else { return };
        match listener.accept().await {
            Ok((stream, from)) => {
                let (engine, content, keys) = (engine.clone(), content.clone(), keys.clone());
                tokio::spawn(async move {
                    let _place = place;
                    if let Err(error) = serve(stream, from, &engine, content, &keys).await {
                        post(&engine, Event::Refused { from, error: error.to_string() }).await;
                    }
                });
            }
            Err(error) => {
                // Out of file descriptors, most likely: others may be given back.
                tracing::warn!(%error, "accept failed");
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
}

/// Greets a link and starts its writer and reader. An error is one of the greeting; afterwards the engine hears `Lost`.
async fn serve(
    stream: TcpStream,
    from: SocketAddr,
    engine: &SyncSender<Event>,
    content: Arc<Content>,
    keys: &AtomicU64,
) -> Result<(), LinkError> {
    stream.set_nodelay(true)?;
    let greeting = async {
        // Before a peer has said who it is, it may claim little.
        let mut opened = link::open(stream, limits::CONTROL_MESSAGE_MAX).await?;
        let (hello, _) = link::expect::<Hello>(&mut opened).await?;
        opened.codec_mut().set_max_frame_length(limits::BULK_MESSAGE_MAX);
        // Addresses go out again in messages of bounded length.
        let (Role::Board { link: address, .. } | Role::Compositor { listen: address, .. }) = &hello.role;
        codec::within("bytes of an address", address.len() as u64, limits::NAME_MAX)?;
        Ok::<_, LinkError>((opened, hello))
    };
    let Ok(greeted) = tokio::time::timeout(GREETING_TIMEOUT, greeting).await else {
        return Err(LinkError::Io(std::io::ErrorKind::TimedOut.into()));
    };
    let (link, mut hello) = greeted?;
    // Names are for people and logs: bounded, and no control characters.
    hello.name = hello.name.chars().filter(|c| !c.is_control()).take(limits::NAME_MAX / 4).collect();
    let key = BoardKey(keys.fetch_add(1, Ordering::Relaxed));
    let is_board = matches!(hello.role, Role::Board { .. });
    let (queue, waiting) = mpsc::channel(OUTBOX);
    let cut = CancellationToken::new();
    let outbox = Outbox { queue, cut: cut.clone() };
    if !post(engine, Event::Hello { key, hello, from, outbox }).await {
        return Ok(());
    }
    let (sink, source) = link.split();
    let writer = tokio::spawn(write(sink, waiting, content, cut.clone()));
    let reading = async {
        if is_board { read_board(source, key, engine).await } else { read_compositor(source, key, engine).await }
    };
    let ended = tokio::select! {
        ended = reading => ended,
        () = cut.cancelled() => Ok(()),
    };
    let reason = ended.err().map_or_else(|| "closed its link".to_owned(), |error| error.to_string());
    post(engine, Event::Lost { key, reason }).await;
    cut.cancel();
    // The writer only ever ends; that it was cancelled is no news.
    let _ = writer.await;
    Ok(())
}

async fn read_board(
    mut source: SplitStream<Link<TcpStream>>,
    key: BoardKey,
    engine: &SyncSender<Event>,
) -> Result<(), LinkError> {
    while let Some((message, payload)) = link::receive::<FromBoard>(&mut source).await? {
        if !post(engine, Event::Board { key, message, payload }).await {
            break;
        }
    }
    Ok(())
}

async fn read_compositor(
    mut source: SplitStream<Link<TcpStream>>,
    key: BoardKey,
    engine: &SyncSender<Event>,
) -> Result<(), LinkError> {
    while let Some((message, payload)) = link::receive::<FromCompositor>(&mut source).await? {
        if !post(engine, Event::Compositor { key, message, payload }).await {
            break;
        }
    }
    Ok(())
}

async fn write(
    mut sink: SplitSink<Link<TcpStream>, Bytes>,
    mut waiting: mpsc::Receiver<Outgoing>,
    content: Arc<Content>,
    cut: CancellationToken,
) {
    let writing = async {
        while let Some(mut outgoing) = waiting.recv().await {
            // Everything that waits goes out in one flush.
            loop {
                match outgoing {
                    Outgoing::Message(message) => sink.feed(message).await?,
                    Outgoing::Pieces(ids) => {
                        for piece in ids.iter().filter_map(|id| content.piece(id)) {
                            sink.feed(piece).await?;
                        }
                        sink.feed(content.table.clone()).await?;
                    }
                    Outgoing::Close => {
                        return sink.close().await;
                    }
                }
                match waiting.try_recv() {
                    Ok(next) => outgoing = next,
                    Err(_) => break,
                }
            }
            sink.flush().await?;
        }
        sink.close().await
    };
    tokio::select! {
        ended = writing => {
            if let Err(error) = ended {
                tracing::debug!(%error, "write failed");
                cut.cancel();
            }
        }
        () = cut.cancelled() => {}
    }
}

/// Splits a payload of content ids; `None` when its length is no multiple of theirs.
pub(crate) fn content_ids(payload: &[u8]) -> Option<Vec<ContentId>> {
    let mut reader = codec::Reader::new(payload, "content ids");
    let ids = reader.values::<[u8; 16]>(payload.len() / 16).ok()?;
    reader.finish().ok()?;
    Some(ids.into_iter().map(ContentId).collect())
}
