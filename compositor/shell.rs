//! The compositor's daemon: links, and one task that owns the [`Stitcher`].
//!
//! | task | owns | waits for |
//! |---|---|---|
//! | main | stitcher, sinks, whom it follows (`terms`) | messages, tiles, shutdown |
//! | backplane tasks (`backplanes`) | the link to a backplane each | its words |
//! | listener | the listening socket | boards |
//! | one per board | that board's link | tiles; its queue to main is short, so a board that is too fast is held back by TCP |
//! | png, preview threads | their encoder | pictures; of previews the newest |
//! | window thread | the window | pictures; main waits until each is shown |
//!
//! An error of one link ends that link. When the backplane is gone the compositor keeps its picture and tries again; when a stand-by leads, it
//! goes on from that picture.

use crate::backplanes::{self, BackplaneEvent};
use crate::manifest::Manifest;
use crate::pattern::{Pattern, PatternView};
use crate::preview::Previews;
use crate::sinks::{FileKind, Files, Picture, SinkError};
use crate::stitch::{Shown, Stitcher};
use crate::terms::{Heed, Terms};
use crate::together::{self, wall_clock_ns};
use crate::window::{Place, Window};
use ::link::{Arrival, Incoming, Listener, Outbox, Roster, Stream, Trust, check_board, denied};
use bytes::Bytes;
use futures_util::StreamExt;
use pool::turns;
use proto::codec;
use proto::frame::{FrameRecord, PixelFormat};
use proto::ids::{BoardKey, FrameNumber, ViewId};
use proto::limits;
use proto::link::{self, Link, LinkError};
use proto::message::{FromCompositor, TileMessage, ToCompositor};
use proto::view::ViewSetup;
use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use thiserror::Error;
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
    /// Where the backplanes listen, `host:port` each: one leads, another may stand by.
    pub backplanes: Vec<String>,
    /// How links are protected.
    pub trust: Trust,
    /// Where to listen for boards; port 0: any free port.
    pub listen: SocketAddr,
    /// The views to show; none: all, as one picture.
    pub views: Vec<ViewId>,
    /// Folder for files of every frame, and their kind.
    pub out: Option<(PathBuf, FileKind)>,
    /// The window to show the picture in.
    pub window: Option<Place>,
    /// Show a pattern to set up projectors by, of 8-bit pixels, instead of the picture.
    pub pattern: bool,
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
    /// The thread that makes the console's pictures.
    #[error("cannot start a thread: {0}")]
    Thread(io::Error),
    /// The window.
    #[error("cannot show a window: {0}")]
    Window(String),
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

/// Why the main task ends.
enum End {
    Goodbye,
    /// The file writer has failed; its error comes out when it is joined.
    Sink,
    Failed(CompositorError),
}

/// Records of frames that may wait until who opened them leads.
const RECORDS_MAX: usize = 256;

/// What a backplane has said; it counts when that leads.
#[derive(Default)]
struct Backplane {
    outbox: Option<Outbox>,
    views: Vec<ViewSetup>,
    /// The names in boards' certificates, where there are keys.
    boards: Vec<(BoardKey, String)>,
    records: VecDeque<(FrameNumber, FrameRecord)>,
}

/// The main task.
struct Shell {
    config: Config,
    backplanes: Vec<Backplane>,
    terms: Terms,
    stitcher: Stitcher,
    /// The views that are shown.
    placed: Vec<PatternView>,
    /// What was shown instead of the picture.
    pattern: Option<Pattern>,
    /// The frame that was handed out last, of who is followed.
    shown: Option<FrameNumber>,
    links: Links,
    roster: watch::Sender<Roster>,
    files: Option<Files>,
    manifest: Option<Manifest>,
    window: Option<Window>,
    previews: Previews,
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
    let listener = Listener::bind(config.listen, config.trust.clone()).await.map_err(cannot_listen)?;
    let address = listener.local_addr().map_err(cannot_listen)?;
    listening(address);
    let (events, inbox) = mpsc::channel(TILE_QUEUE);
    let roster = watch::Sender::new(Roster::new());
    let accepting = tokio::spawn(accept(listener, events, roster.subscribe()));

    let files = match &config.out {
        Some((folder, kind)) => Some(Files::new(folder.clone(), *kind)?),
        None => None,
    };
    let manifest = match &config.manifest {
        Some(path) => Some(Manifest::create(path)?),
        None => None,
    };
    let format = config.out.as_ref().map_or(PixelFormat::Srgb8, |(_, kind)| kind.format());
    let said = backplanes::keep(&config, address, format);
    let (made, previews_made) = mpsc::channel(1);
    let previews = Previews::start(made).map_err(CompositorError::Thread)?;
    let closed = CancellationToken::new();
    let window = match config.window {
        Some(place) => {
            let window = Window::start(title(&config.views), place, closed.clone());
            Some(window.map_err(|error| CompositorError::Window(error.to_string()))?)
        }
        None => None,
    };
    let mut shell = Shell {
        backplanes: config.backplanes.iter().map(|_| Backplane::default()).collect(),
        terms: Terms::new(config.backplanes.len()),
        stitcher: Stitcher::new(format, config.views.clone()),
        config,
        placed: Vec::new(),
        pattern: None,
        shown: None,
        links: Links::new(),
        roster,
        files,
        manifest,
        window,
        previews,
    };
    let end = tokio::select! {
        end = shell.serve(said, inbox, previews_made) => Some(end),
        () = shutdown.cancelled() => None,
        () = closed.cancelled() => None,
    };
    accepting.abort();
    let written = match shell.files.take() {
        // The disk may be slow; the runtime must not wait for it on its own thread.
        Some(files) => tokio::task::spawn_blocking(|| files.finish()).await.unwrap_or(Ok(0))?,
        None => 0,
    };
    match end {
        Some(End::Failed(error)) => Err(error),
        Some(End::Goodbye | End::Sink) | None => Ok(written),
    }
}

impl Shell {
    async fn serve(
        &mut self,
        mut said: mpsc::Receiver<BackplaneEvent>,
        mut inbox: mpsc::Receiver<Event>,
        mut previews_made: mpsc::Receiver<(FrameNumber, Vec<u8>)>,
    ) -> End {
        loop {
            tokio::select! {
                Some(event) = said.recv() => {
                    if let Err(end) = self.on_backplane(event) {
                        return end;
                    }
                }
                Some(event) = inbox.recv() => self.on_event(event),
                // Of a picture far higher than wide it may be larger than the backplane takes; then the console does without.
                Some((frame, jpeg)) = previews_made.recv() => {
                    if jpeg.len() + PREVIEW_HEAD_MAX <= limits::PREVIEW_MAX {
                        self.report(&FromCompositor::Preview { frame }, &jpeg);
                    }
                }
            }
            let started = Instant::now();
            while let Some(shown) = self.stitcher.poll() {
                let stitch_ns = started.elapsed().as_nanos() as u64;
                let mut at_ns = wall_clock_ns();
                // In lock-step a frame comes again when another compositor lacked it: it is shown, and nothing new.
                if self.shown.replace(shown.frame) != Some(shown.frame) {
                    match self.hand_out(&shown).await {
                        Ok(at) => at_ns = at,
                        Err(end) => return end,
                    }
                }
                self.report(&FromCompositor::Presented { frame: shown.frame, stitch_ns, at_ns }, &[]);
                // Behind that word: no frame waits for a look. And nobody looks at a canvas on which nothing was shown yet.
                if shown.preview && self.stitcher.is_whole() {
                    let picture = self.picture(shown.frame);
                    self.previews.offer(picture);
                }
            }
        }
    }

    /// Says something to the backplane that leads.
    fn report(&self, message: &FromCompositor, payload: &[u8]) {
        let leader = self.terms.followed().and_then(|index| self.backplanes[index].outbox.as_ref());
        if let Some(outbox) = leader {
            outbox.send(codec::encode(message, payload));
        }
    }

    /// Gives what is on the canvas to all sinks, when it is to be shown. Returns since when it is, ns since 1970.
    async fn hand_out(&mut self, shown: &Shown) -> Result<u64, End> {
        let is_wanted = self.files.is_some() || self.window.is_some();
        let picture = is_wanted.then(|| Arc::new(self.picture(shown.frame)));
        // First: what is seen is what waits for the swap.
        let at_ns = match (&self.window, &picture) {
            (Some(window), Some(picture)) => match window.show(Arc::clone(picture), shown.moment).await {
                Ok(at_ns) => at_ns,
                Err(Some(why)) => return Err(End::Failed(CompositorError::Window(why))),
                Err(None) => return Err(End::Goodbye),
            },
            _ => together::change(shown.moment, wall_clock_ns).await,
        };
        if let Some(manifest) = &mut self.manifest {
            manifest.write(shown, &self.stitcher).map_err(|error| End::Failed(error.into()))?;
        }
        if let (Some(files), Some(picture)) = (&self.files, picture)
            && !files.write(picture).await
        {
            return Err(End::Sink);
        }
        Ok(at_ns)
    }

    fn picture(&mut self, frame: FrameNumber) -> Picture {
        let ((width, height), format) = (self.stitcher.size(), self.stitcher.format());
        let pixels = if self.config.pattern { self.pattern().of(frame) } else { self.stitcher.canvas().to_vec() };
        Picture { frame, width, height, format, pixels }
    }

    /// The pattern of the present views. Making it takes some tenths of a second for a large picture: once, as long as the views are the same.
    fn pattern(&mut self) -> &Pattern {
        let size = self.stitcher.size();
        let kept = self.pattern.take().filter(|pattern| pattern.is_of(&self.placed, size));
        self.pattern.insert(kept.unwrap_or_else(|| {
            turns::go_along();
            let made = Pattern::new(self.placed.clone(), size);
            turns::go_first();
            made
        }))
    }

    fn on_backplane(&mut self, event: BackplaneEvent) -> Result<(), End> {
        let is_only = self.backplanes.len() == 1;
        match event {
            BackplaneEvent::Up(index, outbox) => {
                tracing::info!(backplane = %self.config.backplanes[index], "connected");
                self.backplanes[index].outbox = Some(outbox);
            }
            BackplaneEvent::Down(index, error) => {
                tracing::debug!(backplane = %self.config.backplanes[index], %error, "no backplane");
                // The next one calls boards by other keys.
                self.backplanes[index] = Backplane::default();
                self.terms.on_lost(index);
                self.tell_roster();
            }
            BackplaneEvent::Said(index, message, _) => return self.on_message(index, *message, is_only),
        }
        Ok(())
    }

    fn on_message(&mut self, index: usize, message: ToCompositor, is_only: bool) -> Result<(), End> {
        let is_leader = self.terms.followed() == Some(index);
        match message {
            ToCompositor::Welcome => {}
            ToCompositor::Refused { reason } => {
                let backplane = self.config.backplanes[index].clone();
                if is_only {
                    return Err(End::Failed(CompositorError::Refused(backplane, reason)));
                }
                tracing::warn!(%backplane, %reason, "refused by one of the backplanes");
            }
            ToCompositor::Views(views) => {
                self.backplanes[index].views = views;
                // The first tiles come before the first swap.
                if is_leader || is_only || self.terms.followed().is_none() {
                    self.take_views(index);
                }
            }
            ToCompositor::Record { frame, record } if is_leader => {
                if let Some(manifest) = &mut self.manifest {
                    manifest.on_record(frame, record);
                }
            }
            ToCompositor::Record { frame, record } => {
                let records = &mut self.backplanes[index].records;
                if records.len() >= RECORDS_MAX {
                    records.pop_front();
                }
                records.push_back((frame, record));
            }
            ToCompositor::Boards(names) => {
                self.backplanes[index].boards = names;
                self.tell_roster();
            }
            ToCompositor::Swap(swap) => match self.terms.on_swap(index, &swap) {
                Heed::Ignore => {}
                Heed::Follow => self.stitcher.on_swap(swap),
                Heed::Begin => {
                    tracing::info!(backplane = %self.config.backplanes[index], frame = %swap.frame, "following");
                    self.begin(index);
                    self.stitcher.on_swap(swap);
                }
            },
            ToCompositor::Goodbye if is_only && self.config.once => return Err(End::Goodbye),
            ToCompositor::Goodbye => {
                tracing::info!(backplane = %self.config.backplanes[index], "the rig has ended; waiting for the next");
                self.backplanes[index].outbox = None;
            }
        }
        Ok(())
    }

    /// Another backplane leads than before: what it has said counts.
    fn begin(&mut self, index: usize) {
        self.shown = None;
        self.stitcher.forget_swaps();
        self.take_views(index);
        for (frame, record) in std::mem::take(&mut self.backplanes[index].records) {
            if let Some(manifest) = &mut self.manifest {
                manifest.on_record(frame, record);
            }
        }
    }

    fn take_views(&mut self, index: usize) {
        let views = &self.backplanes[index].views;
        if views.is_empty() {
            return;
        }
        if !views.iter().all(ViewSetup::is_valid) || !self.stitcher.set_views(views) {
            tracing::error!("the views make no picture, or one too large to stitch");
            return;
        }
        let view = |(id, at): (ViewId, [u32; 2])| {
            let view = views.get(id.0 as usize)?.view;
            Some(PatternView { id, view, at })
        };
        self.placed = self.stitcher.places().filter_map(view).collect();
    }

    fn tell_roster(&self) {
        let names = self.backplanes.iter().flat_map(|backplane| backplane.boards.iter().cloned());
        self.roster.send_replace(names.collect());
    }

    fn on_event(&mut self, event: Event) {
        match event {
            Event::Board(key, link, cut) => {
                if let Some((_, old)) = self.links.insert(key, (link, cut)) {
                    old.cancel();
                }
                self.stitcher.on_board(key);
            }
            Event::Message(key, link, message, payload) if self.is_current(key, link) => match message {
                TileMessage::Tiles { frame, epoch, view, count, size, format } => {
                    let taken = self.stitcher.on_tiles(key, frame, epoch, view, count, size, format, payload);
                    if let Err(error) = taken {
                        tracing::warn!(%key, %error, "tiles refused: the board's link is dropped");
                        self.drop_board(key);
                    }
                }
                TileMessage::Done { frame, epoch } => self.stitcher.on_done(key, frame, epoch),
                TileMessage::Hello { .. } => {}
            },
            Event::Lost(key, link) if self.is_current(key, link) => self.drop_board(key),
            // Of a link that has been replaced meanwhile.
            Event::Message(..) | Event::Lost(..) => {}
        }
    }

    fn is_current(&self, key: BoardKey, link: u64) -> bool {
        self.links.get(&key).is_some_and(|(current, _)| *current == link)
    }

    /// Ends a board's link and says which frames can't be shown for it. The board connects again and sends all its tiles.
    fn drop_board(&mut self, key: BoardKey) {
        if let Some((_, cut)) = self.links.remove(&key) {
            cut.cancel();
        }
        for frame in self.stitcher.on_lost(key) {
            self.report(&FromCompositor::Missing { frame }, &[]);
        }
    }
}

/// What a window is called.
fn title(views: &[ViewId]) -> String {
    let numbers: Vec<_> = views.iter().map(|view| view.0.to_string()).collect();
    match &numbers[..] {
        [] => "Cyclorama".into(),
        [view] => format!("Cyclorama, view {view}"),
        views => format!("Cyclorama, views {}", views.join(", ")),
    }
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
