//! Links to boards, compositors and the other backplane: they only move bytes between sockets and the engine.
//!
//! | task | waits for |
//! |---|---|
//! | listener | connections |
//! | dialler, of a stand-by | its link to who leads |
//! | one reader per link | messages; hands each to the engine |
//! | one writer per link | its two queues: messages, and names of scene pieces, which it takes from [`Content`] itself, so that megabytes don't sit in a queue |
//!
//! A piece goes out in slices, and between two slices everything that waits in the other queue goes first: a frame never
//! waits behind a large texture. A message that was queued before a piece is never behind it.
//!
//! The engine never waits for a link. A link whose queue is full gets no more frames ([`Outbox::try_frame`], counted); one
//! that can't even take a message of the chain is hung, and dropped.

use super::content::Content;
use super::engine::{Event, OPENED};
use bytes::Bytes;
use futures_util::SinkExt;
use futures_util::stream::{SplitSink, SplitStream, StreamExt};
use link::{Arrival, Expected, Identity, Incoming, Listener, NodeRole, Stream, Trust};
use proto::chain::BetweenBackplanes;
use proto::codec;
use proto::ids::{BoardKey, ContentId};
use proto::limits;
use proto::link::{Link, LinkError, expect, open, receive};
use proto::message::{FromBoard, FromCompositor, Hello, Role};
use proto::piece::{PIECE_OVERHEAD, PieceKind};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

/// Messages that may wait for one link.
const OUTBOX: usize = 64;
/// Of these, places that frames may not take, so that the chain's messages get through.
const OUTBOX_RESERVE: usize = 16;
/// Pieces that may wait for one link. Each counts for at least its overhead, and together for no more than may be in flight.
const PIECES: usize = (limits::PIECES_IN_FLIGHT_MAX / PIECE_OVERHEAD) as usize + 1;
/// Bytes before each message on the stream: its length.
const LENGTH_BYTES: u64 = 4;
/// A peer that has not said hello by then is dropped.
const GREETING_TIMEOUT: Duration = Duration::from_secs(5);

/// A link to the other backplane that was up for so long was one.
const LASTING: Duration = Duration::from_secs(1);

/// What a writer sends.
#[derive(Debug)]
enum Outgoing {
    Message(Bytes),
    /// Flush, then close.
    Close,
}

/// Bytes over all links to boards since the start, lengths included.
#[derive(Debug, Default)]
pub(crate) struct Traffic {
    pub to_boards: AtomicU64,
    pub from_boards: AtomicU64,
}

/// The engine's end of a link.
#[derive(Clone, Debug)]
pub(crate) struct Outbox {
    queue: mpsc::Sender<Outgoing>,
    pieces: mpsc::Sender<(ContentId, PieceKind)>,
    /// Ends both tasks of the link at once.
    cut: CancellationToken,
}

impl Outbox {
    /// Queues a message that must not be lost. False: the link is hung or gone and has been cut.
    pub(crate) fn send(&self, message: Bytes) -> bool {
        self.put(Outgoing::Message(message))
    }

    /// Queues a piece of the scene, behind all messages that are queued. False, as for [`Self::send`].
    pub(crate) fn send_piece(&self, id: ContentId, kind: PieceKind) -> bool {
        let is_queued = self.pieces.try_send((id, kind)).is_ok();
        if !is_queued {
            self.cut.cancel();
        }
        is_queued
    }

    /// Whether a frame would find room.
    pub(crate) fn has_room(&self) -> bool {
        self.queue.capacity() > OUTBOX_RESERVE
    }

    /// Queues a frame if there is room to spare.
    pub(crate) fn try_frame(&self, message: Bytes) -> bool {
        self.has_room() && self.queue.try_send(Outgoing::Message(message)).is_ok()
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

/// What the first guest is called. Boards send tiles by their keys, so two backplanes must not call two boards the same: those of a
/// stand-by begin anywhere.
pub(crate) fn first_key(stands_by: bool) -> u64 {
    let anywhere = RandomState::new().build_hasher().finish() % 0xffff + 1;
    if stands_by { (anywhere << 24) + 1 } else { 1 }
}

/// Accepts links for ever; guests get keys from the first one on.
pub(crate) async fn listen(
    mut listener: Listener,
    engine: SyncSender<Event>,
    content: Arc<Content>,
    traffic: Arc<Traffic>,
    first_key: u64,
) {
    let keys = Arc::new(AtomicU64::new(first_key));
    loop {
        match listener.next().await {
            Arrival::Peer(incoming) => {
                let (engine, content, keys, traffic) = (engine.clone(), content.clone(), keys.clone(), traffic.clone());
                tokio::spawn(async move {
                    let from = incoming.from();
                    if let Err(error) = serve(incoming, &engine, content, &keys, &traffic).await {
                        post(&engine, Event::Refused { from, error: error.to_string(), count: 1 }).await;
                    }
                });
            }
            Arrival::Refused { count, from, reason } => {
                post(&engine, Event::Refused { from, error: reason, count }).await;
            }
        }
    }
}

/// Hears who a peer is.
async fn greet(stream: Stream) -> Result<(Link<Stream>, Hello, Option<Identity>), LinkError> {
    let identity = stream.peer().cloned();
    // Before a peer has said who it is, it may claim little.
    let mut opened = open(stream, limits::CONTROL_MESSAGE_MAX).await?;
    let (mut hello, _) = expect::<Hello>(&mut opened).await?;
    if let Role::Board { link: address, .. } | Role::Compositor { listen: address, .. } = &hello.role {
        // Addresses go out again in messages of bounded length.
        codec::within("bytes of an address", address.len() as u64, limits::NAME_MAX)?;
    }
    if let Role::Compositor { views, .. } = &hello.role {
        codec::within("views of a display", views.len() as u64, limits::VIEWS_MAX)?;
        if !views.is_sorted_by(|a, b| a < b) {
            let what = "the views of a display are not in ascending order";
            return Err(LinkError::Io(std::io::Error::new(std::io::ErrorKind::InvalidData, what)));
        }
    }
    let role = match hello.role {
        Role::Board { .. } => NodeRole::Board,
        Role::Compositor { .. } => NodeRole::Compositor,
        Role::Backplane => NodeRole::Manager,
    };
    // Names are for people and logs: bounded, and no control characters.
    hello.name = hello.name.chars().filter(|c| !c.is_control()).take(limits::NAME_MAX / 4).collect();
    if let Some(identity) = &identity {
        if identity.role != role {
            let what = format!("it says that it is a {role}, with the certificate of {identity}");
            return Err(LinkError::Io(std::io::Error::new(std::io::ErrorKind::PermissionDenied, what)));
        }
        tracing::info!(%identity, fingerprint = %identity.fingerprint, "proven by its certificate");
        hello.name = known_as(&identity.name, &hello.name);
    }
    if role == NodeRole::Compositor {
        // It sends pictures. A board says nothing large.
        opened.codec_mut().set_incoming_max(limits::PREVIEW_MAX);
    }
    Ok((opened, hello, identity))
}

/// The name in the certificate, and then what a node calls itself: several boards may have the keys of their machine.
fn known_as(certified: &str, said: &str) -> String {
    if said == certified { certified.to_owned() } else { format!("{certified} ({said})") }
}

/// Greets a link and starts its writer and reader. An error is one of the greeting; afterwards the engine hears `Lost`.
async fn serve(
    incoming: Incoming,
    engine: &SyncSender<Event>,
    content: Arc<Content>,
    keys: &AtomicU64,
    traffic: &Arc<Traffic>,
) -> Result<(), LinkError> {
    let from = incoming.from();
    let ((link, hello, identity), _place) = incoming.greet(GREETING_TIMEOUT, greet).await?;
    let key = BoardKey(keys.fetch_add(1, Ordering::Relaxed));
    carry(link, key, hello, from, identity, engine, content, traffic).await;
    Ok(())
}

/// Keeps a link to the other backplane.
pub(crate) async fn dial(
    address: String,
    trust: Trust,
    engine: SyncSender<Event>,
    content: Arc<Content>,
    traffic: Arc<Traffic>,
) {
    let mut backoff = trust.backoff(0);
    loop {
        let connecting = async {
            let stream = trust.connect(&address, &Expected::any(NodeRole::Manager)).await?;
            let (from, identity) = (stream.peer_addr()?, stream.peer().cloned());
            let mut opened = open(stream, limits::CONTROL_MESSAGE_MAX).await?;
            let hello = Hello { name: "stand-by".into(), role: Role::Backplane };
            opened.send(codec::encode(&hello, &[])).await?;
            Ok::<_, LinkError>((opened, from, identity))
        };
        match tokio::time::timeout(GREETING_TIMEOUT, connecting).await {
            Ok(Ok((link, from, identity))) => {
                let started = Instant::now();
                let hello = Hello { name: address.clone(), role: Role::Backplane };
                carry(link, OPENED, hello, from, identity, &engine, content.clone(), &traffic).await;
                // Who closes at once doesn't want us.
                if started.elapsed() > LASTING {
                    backoff.reset();
                }
            }
            Ok(Err(error)) => {
                tracing::info!(%address, %error, "no link to the other backplane; trying again");
                post(&engine, Event::Lost { key: OPENED, reason: error.to_string() }).await;
            }
            Err(_) => drop(post(&engine, Event::Lost { key: OPENED, reason: "no answer".into() }).await),
        }
        tokio::time::sleep(backoff.next_wait()).await;
    }
}

/// Carries a link from its greeting to its end.
async fn carry(
    link: Link<Stream>,
    key: BoardKey,
    hello: Hello,
    from: SocketAddr,
    identity: Option<Identity>,
    engine: &SyncSender<Event>,
    content: Arc<Content>,
    traffic: &Arc<Traffic>,
) {
    let role = hello.role.clone();
    let is_board = matches!(role, Role::Board { .. });
    let (queue, waiting) = mpsc::channel(OUTBOX);
    let (pieces, wanted) = mpsc::channel(PIECES);
    let cut = CancellationToken::new();
    let outbox = Outbox { queue, pieces, cut: cut.clone() };
    if !post(engine, Event::Hello { key, hello, from, identity, outbox }).await {
        return;
    }
    let (sink, source) = link.split();
    let counted = is_board.then(|| traffic.clone());
    let writer = tokio::spawn(write(sink, waiting, wanted, content, counted, cut.clone()));
    let reading = async {
        match role {
            Role::Board { .. } => read_board(source, key, engine, traffic).await,
            Role::Compositor { .. } => read_compositor(source, key, engine).await,
            Role::Backplane => read_peer(source, key, engine).await,
        }
    };
    let ended = tokio::select! {
        ended = reading => ended,
        () = cut.cancelled() => Ok(()),
    };
    if let Some(error) = ended.as_ref().err().filter(|error| is_breach(error)) {
        // Said apart from the loss: what breaks the rules right behind its greeting is gone before the engine has known it.
        let error = format!("it broke the protocol: {error}");
        post(engine, Event::Refused { from, error, count: 1 }).await;
    }
    let reason = ended.err().map_or_else(|| "closed its link".to_owned(), |error| error.to_string());
    post(engine, Event::Lost { key, reason }).await;
    cut.cancel();
    // The writer only ever ends; that it was cancelled is no news.
    let _ = writer.await;
}

/// Whether a peer said what it may not, rather than went away.
fn is_breach(error: &LinkError) -> bool {
    match error {
        LinkError::Codec(_) => true,
        LinkError::Io(error) => error.kind() == std::io::ErrorKind::InvalidData,
        LinkError::Closed => false,
    }
}

async fn read_board(
    mut source: SplitStream<Link<Stream>>,
    key: BoardKey,
    engine: &SyncSender<Event>,
    traffic: &Traffic,
) -> Result<(), LinkError> {
    while let Some(frame) = source.next().await {
        let frame = frame?;
        traffic.from_boards.fetch_add(frame.len() as u64 + LENGTH_BYTES, Ordering::Relaxed);
        let (message, payload) = codec::decode::<FromBoard>(frame.freeze())?;
        if !post(engine, Event::Board { key, message, payload }).await {
            break;
        }
    }
    Ok(())
}

async fn read_peer(
    mut source: SplitStream<Link<Stream>>,
    key: BoardKey,
    engine: &SyncSender<Event>,
) -> Result<(), LinkError> {
    while let Some((message, _)) = receive::<BetweenBackplanes>(&mut source).await? {
        if !post(engine, Event::Peer { key, message }).await {
            break;
        }
    }
    Ok(())
}

async fn read_compositor(
    mut source: SplitStream<Link<Stream>>,
    key: BoardKey,
    engine: &SyncSender<Event>,
) -> Result<(), LinkError> {
    while let Some((message, payload)) = receive::<FromCompositor>(&mut source).await? {
        if !post(engine, Event::Compositor { key, message, payload }).await {
            break;
        }
    }
    Ok(())
}

/// What a writer does next.
enum Next {
    Outgoing(Option<Outgoing>),
    Piece(Option<(ContentId, PieceKind)>),
}

async fn write(
    mut sink: SplitSink<Link<Stream>, Bytes>,
    mut waiting: mpsc::Receiver<Outgoing>,
    mut wanted: mpsc::Receiver<(ContentId, PieceKind)>,
    content: Arc<Content>,
    traffic: Option<Arc<Traffic>>,
    cut: CancellationToken,
) {
    let count = |message: &Bytes| {
        if let Some(traffic) = &traffic {
            traffic.to_boards.fetch_add(message.len() as u64 + LENGTH_BYTES, Ordering::Relaxed);
        }
    };
    let writing = async {
        let mut slices = None;
        loop {
            // Everything that waits goes out in one flush.
            while let Ok(outgoing) = waiting.try_recv() {
                let Outgoing::Message(message) = outgoing else { return sink.close().await };
                count(&message);
                sink.feed(message).await?;
            }
            if let Some(slice) = slices.as_mut().and_then(Iterator::next) {
                count(&slice);
                sink.feed(slice).await?;
                sink.flush().await?;
                continue;
            }
            slices = None;
            sink.flush().await?;
            // Messages first, when both are there. A piece that is taken waits for another look at the messages.
            let next = tokio::select! {
                biased;
                outgoing = waiting.recv() => Next::Outgoing(outgoing),
                piece = wanted.recv() => Next::Piece(piece),
            };
            match next {
                Next::Outgoing(Some(Outgoing::Message(message))) => {
                    count(&message);
                    sink.feed(message).await?;
                }
                Next::Piece(Some((id, kind))) => slices = Some(content.piece(id, kind)),
                // The engine has dropped its end, or said so.
                Next::Outgoing(None | Some(Outgoing::Close)) | Next::Piece(None) => return sink.close().await,
            }
        }
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
