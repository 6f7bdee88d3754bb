//! The compositor's daemon: links, and one task that owns the [`Stitcher`].
//!
//! | task | owns | waits for |
//! |---|---|---|
//! | main | stitcher, sinks, the link to the backplane | messages, tiles, shutdown |
//! | listener | the listening socket | boards |
//! | one per board | that board's link | tiles; its queue to main is short, so a board that is too fast is held back by TCP |
//! | png, preview threads | their encoder | pictures; of previews the newest |
//!
//! An error of one link ends that link. When the backplane is gone the compositor keeps its picture and tries again.

use crate::manifest::Manifest;
use crate::preview::Previews;
use crate::sinks::{FileKind, Files, Picture, SinkError};
use crate::stitch::Stitcher;
use ::link::{Arrival, Expected, Incoming, Listener, NodeRole, Roster, Stream, Trust, check_board, denied};
use bytes::Bytes;
use futures_util::StreamExt;
use proto::backoff::Backoff;
use proto::codec;
use proto::frame::PixelFormat;
use proto::ids::BoardKey;
use proto::limits;
use proto::link::{self, Link, LinkError};
use proto::message::{FromCompositor, Hello, Role, TileMessage, ToCompositor};
use std::collections::BTreeMap;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use thiserror::Error;
use tokio::net::TcpListener;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Messages from boards that may wait; with a message per board and view and frame, a few frames.
const TILE_QUEUE: usize = 64;
/// A peer that has not finished its greeting by then is dropped.
const GREETING_TIMEOUT: Duration = Duration::from_secs(5);

/// Bytes of a preview's message that are not its picture, and some to spare.
const PREVIEW_HEAD_MAX: usize = 64;

/// How a compositor is set up.
#[derive(Clone, Debug)]
pub struct Config {
    /// Where the backplane listens, `host:port`.
    pub backplane: String,
    /// How links are protected.
    pub trust: Trust,
    /// Where to listen for boards; port 0: any free port.
    pub listen: SocketAddr,
    /// Folder for files of every frame, and their kind.
    pub out: Option<(PathBuf, FileKind)>,
    /// File that is to say of each frame what it was, a line each.
    pub manifest: Option<PathBuf>,
    /// End when the rig ends, instead of waiting for the next one.
    pub once: bool,
}

/// Why a compositor ends.
#[derive(Debug, Error)]
pub enum CompositorError {
    /// The listening socket.
    #[error("cannot listen on {0}: {1}; choose another with --listen")]
    Listen(SocketAddr, io::Error),
    /// A file.
    #[error(transparent)]
    Sink(#[from] SinkError),
    /// The backplane doesn't want us.
    #[error("the backplane at {0} refused this compositor: {1}")]
    Refused(String, String),
}

/// The link of each board, and what ends it.
type Links = BTreeMap<BoardKey, (u64, CancellationToken)>;

enum Event {
    Board(BoardKey, u64, CancellationToken),
    Message(BoardKey, u64, TileMessage, Bytes),
    Lost(BoardKey, u64),
}

/// Why one session with a backplane is over.
enum End {
    Goodbye,
    /// The file writer has failed; its error comes out when it is joined.
    Sink,
    Lost(LinkError),
    Shutdown,
    Failed(CompositorError),
}

/// Runs until `shutdown`, or until the rig ends when `config.once`. Returns the number of files written.
///
/// # Errors
/// [`CompositorError`].
pub async fn run(
    config: Config,
    shutdown: CancellationToken,
    listening: impl FnOnce(SocketAddr),
) -> Result<u64, CompositorError> {
    let cannot_listen = |error| CompositorError::Listen(config.listen, error);
    let listener = TcpListener::bind(config.listen).await.map_err(cannot_listen)?;
    let address = listener.local_addr().map_err(cannot_listen)?;
    listening(address);
    let (events, mut inbox) = mpsc::channel(TILE_QUEUE);
    let roster = watch::Sender::new(Roster::new());
    let listener = Listener::new(listener, config.trust.clone());
    let accepting = tokio::spawn(accept(listener, events, roster.subscribe()));

    let mut files = match &config.out {
        Some((folder, kind)) => Some(Files::new(folder.clone(), *kind)?),
        None => None,
    };
    let mut manifest = match &config.manifest {
        Some(path) => Some(Manifest::create(path)?),
        None => None,
    };
    let format = config.out.as_ref().map_or(PixelFormat::Srgb8, |(_, kind)| kind.format());
    let mut stitcher = Stitcher::new(format);
    let mut links = Links::new();
    let mut backoff = Backoff::new(u64::from(std::process::id()));
    let result = loop {
        let sinks = (files.as_ref(), manifest.as_mut());
        let session = session(&config, address, &mut stitcher, &mut links, &mut inbox, &roster, sinks, &mut backoff);
        let end = tokio::select! {
            end = session => end,
            () = shutdown.cancelled() => End::Shutdown,
        };
        // The next backplane calls boards by other keys.
        roster.send_replace(Roster::new());
        match end {
            End::Shutdown | End::Sink => break Ok(()),
            End::Failed(error) => break Err(error),
            End::Goodbye if config.once => break Ok(()),
            End::Goodbye => tracing::info!("the rig has ended; waiting for the next"),
            End::Lost(error) => tracing::debug!(%error, "no backplane"),
        }
        tokio::select! {
            () = tokio::time::sleep(backoff.next_wait()) => {}
            () = shutdown.cancelled() => break Ok(()),
        }
    };
    accepting.abort();
    let written = match files.take() {
        // The disk may be slow; the runtime must not wait for it on its own thread.
        Some(files) => tokio::task::spawn_blocking(|| files.finish()).await.unwrap_or(Ok(0))?,
        None => 0,
    };
    result.map(|()| written)
}

async fn session(
    config: &Config,
    address: SocketAddr,
    stitcher: &mut Stitcher,
    links: &mut Links,
    inbox: &mut mpsc::Receiver<Event>,
    roster: &watch::Sender<Roster>,
    (files, mut manifest): (Option<&Files>, Option<&mut Manifest>),
    backoff: &mut Backoff,
) -> End {
    let mut backplane = match tokio::time::timeout(GREETING_TIMEOUT, greet(config, address, stitcher.format())).await {
        Err(_) => return End::Lost(LinkError::Closed),
        Ok(Err(error)) => return End::Lost(error),
        Ok(Ok(Err(reason))) => return End::Failed(CompositorError::Refused(config.backplane.clone(), reason)),
        Ok(Ok(Ok(link))) => link,
    };
    backoff.reset();
    tracing::info!(backplane = %config.backplane, "connected");
    let (made, mut previews_made) = mpsc::channel(1);
    let previews = match Previews::start(made) {
        Ok(previews) => previews,
        Err(error) => return End::Lost(LinkError::Io(error)),
    };
    loop {
        tokio::select! {
            message = link::receive::<ToCompositor>(&mut backplane) => match message {
                Err(error) => return End::Lost(error),
                Ok(None) => return End::Lost(LinkError::Closed),
                Ok(Some((ToCompositor::Welcome, _))) => {}
                Ok(Some((ToCompositor::Refused { reason }, _))) => {
                    return End::Failed(CompositorError::Refused(config.backplane.clone(), reason));
                }
                Ok(Some((ToCompositor::Views(views), _))) => {
                    if !stitcher.set_views(&views) {
                        tracing::error!("the views make a picture too large to stitch");
                    }
                }
                Ok(Some((ToCompositor::Record { frame, record }, _))) => {
                    if let Some(manifest) = &mut manifest {
                        manifest.on_record(frame, record);
                    }
                }
                Ok(Some((ToCompositor::Boards(names), _))) => {
                    roster.send_replace(names.into_iter().collect());
                }
                Ok(Some((ToCompositor::Swap(swap), _))) => stitcher.on_swap(swap),
                Ok(Some((ToCompositor::Goodbye, _))) => return End::Goodbye,
            },
            Some(event) = inbox.recv() => {
                if let Err(error) = on_event(stitcher, links, &mut backplane, event).await {
                    return End::Lost(error);
                }
            }
            // Of a picture far higher than wide it may be larger than the backplane takes; then the console does without.
            Some((frame, jpeg)) = previews_made.recv() => {
                let preview = FromCompositor::Preview { frame };
                if jpeg.len() + PREVIEW_HEAD_MAX <= limits::PREVIEW_MAX
                    && let Err(error) = link::send(&mut backplane, &preview, &jpeg).await
                {
                    return End::Lost(error);
                }
            }
        }
        let started = Instant::now();
        while let Some(shown) = stitcher.poll() {
            let stitch_ns = started.elapsed().as_nanos() as u64;
            if let Some(manifest) = &mut manifest
                && let Err(error) = manifest.write(&shown, stitcher)
            {
                return End::Failed(error.into());
            }
            let picture = || {
                let ((width, height), format) = (stitcher.size(), stitcher.format());
                Picture { frame: shown.frame, width, height, format, pixels: stitcher.canvas().to_vec() }
            };
            if let Some(files) = files
                && !files.write(Arc::new(picture())).await
            {
                return End::Sink;
            }
            let presented = FromCompositor::Presented { frame: shown.frame, stitch_ns };
            if let Err(error) = link::send(&mut backplane, &presented, &[]).await {
                return End::Lost(error);
            }
            // Behind that word: no frame waits for a look.
            if shown.preview {
                previews.offer(picture());
            }
        }
    }
}

async fn greet(
    config: &Config,
    address: SocketAddr,
    format: PixelFormat,
) -> Result<Result<Link<Stream>, String>, LinkError> {
    let stream = config.trust.connect(&config.backplane, &Expected::any(NodeRole::Manager)).await?;
    // Listening on any address, we are reached at the one that reaches the backplane.
    let ip = if address.ip().is_unspecified() { stream.local_addr()?.ip() } else { address.ip() };
    let listen = SocketAddr::new(ip, address.port()).to_string();
    let mut backplane = link::open(stream, limits::CONTROL_MESSAGE_MAX).await?;
    let hello = Hello {
        name: "compositor".into(),
        role: Role::Compositor { listen, format, records: config.manifest.is_some() },
    };
    link::send(&mut backplane, &hello, &[]).await?;
    match link::expect(&mut backplane).await?.0 {
        ToCompositor::Refused { reason } => Ok(Err(reason)),
        _ => Ok(Ok(backplane)),
    }
}

async fn on_event(
    stitcher: &mut Stitcher,
    links: &mut Links,
    backplane: &mut Link<Stream>,
    event: Event,
) -> Result<(), LinkError> {
    match event {
        Event::Board(key, link, cut) => {
            if let Some((_, old)) = links.insert(key, (link, cut)) {
                old.cancel();
            }
            stitcher.on_board(key);
        }
        Event::Message(key, link, message, payload) if is_current(links, key, link) => match message {
            TileMessage::Tiles { frame, epoch, view, count, size, format } => {
                if let Err(error) = stitcher.on_tiles(key, frame, epoch, view, count, size, format, payload) {
                    tracing::warn!(%key, %error, "tiles refused: the board's link is dropped");
                    drop_board(stitcher, links, backplane, key).await?;
                }
            }
            TileMessage::Done { frame, epoch } => stitcher.on_done(key, frame, epoch),
            TileMessage::Hello { .. } => {}
        },
        Event::Lost(key, link) if is_current(links, key, link) => drop_board(stitcher, links, backplane, key).await?,
        // Of a link that has been replaced meanwhile.
        Event::Message(..) | Event::Lost(..) => {}
    }
    Ok(())
}

fn is_current(links: &Links, key: BoardKey, link: u64) -> bool {
    links.get(&key).is_some_and(|(current, _)| *current == link)
}

/// Ends a board's link and says which frames can't be shown for it. The board connects again and sends all its tiles.
async fn drop_board(
    stitcher: &mut Stitcher,
    links: &mut Links,
    backplane: &mut Link<Stream>,
    key: BoardKey,
) -> Result<(), LinkError> {
    if let Some((_, cut)) = links.remove(&key) {
        cut.cancel();
    }
    for frame in stitcher.on_lost(key) {
        link::send(backplane, &FromCompositor::Missing { frame }, &[]).await?;
    }
    Ok(())
}

async fn accept(mut listener: Listener, events: mpsc::Sender<Event>, roster: watch::Receiver<Roster>) {
    let mut next_link = 0;
    loop {
        match listener.next().await {
            Arrival::Peer(incoming) => {
                next_link += 1;
                let (from, link, events, roster) = (incoming.from(), next_link, events.clone(), roster.clone());
                tokio::spawn(async move {
                    if let Err(error) = serve(incoming, link, events, roster).await {
                        tracing::info!(%from, %error, "tile link ended");
                    }
                });
            }
            Arrival::Refused { count, from, reason } => tracing::warn!(count, %from, %reason, "tile links refused"),
        }
    }
}

/// Hears which board it is, and makes sure of it.
async fn greet_board(
    stream: Stream,
    mut roster: watch::Receiver<Roster>,
) -> Result<(Link<Stream>, BoardKey), LinkError> {
    let identity = stream.peer().cloned();
    // Before a peer has said who it is, it may claim little.
    let mut tiles = link::open(stream, limits::CONTROL_MESSAGE_MAX).await?;
    let (TileMessage::Hello { key }, _) = link::expect::<TileMessage>(&mut tiles).await? else {
        return Err(denied("it doesn't say hello first".into()));
    };
    if let Some(identity) = identity {
        check_board(key, &identity, &mut roster).await?;
    }
    tiles.codec_mut().set_incoming_max(limits::BULK_MESSAGE_MAX);
    Ok((tiles, key))
}

async fn serve(
    incoming: Incoming,
    link: u64,
    events: mpsc::Sender<Event>,
    roster: watch::Receiver<Roster>,
) -> Result<(), LinkError> {
    let greeting = |stream| greet_board(stream, roster);
    let ((mut tiles, key), _place) = incoming.greet(GREETING_TIMEOUT, greeting).await?;
    // A closed queue means that the daemon ends: then so does this task.
    let cut = CancellationToken::new();
    if events.send(Event::Board(key, link, cut.clone())).await.is_err() {
        return Ok(());
    }
    let result = loop {
        let next = tokio::select! {
            next = tiles.next() => next,
            () = cut.cancelled() => return Ok(()),
        };
        match next {
            None => break Ok(()),
            Some(Err(error)) => break Err(error.into()),
            Some(Ok(frame)) => match codec::decode(frame.freeze()) {
                Err(error) => break Err(error.into()),
                Ok((message, payload)) => {
                    if events.send(Event::Message(key, link, message, payload)).await.is_err() {
                        return Ok(());
                    }
                }
            },
        }
    };
    // As above.
    let _ = events.send(Event::Lost(key, link)).await;
    result
}
