//! The painter: the one thread that owns what the board holds, and draws.
//!
//! What it holds is the backplane's to decide: pieces come, prepared by the loader, and are given up when told. More than its memory
//! limit is refused.
//!
//! Work comes in order and lists are followed frame by frame, but when several frames wait only the newest is drawn:
//! the others' deadlines have passed. What is the same as in the frame before isn't drawn again, and a tile that came out the
//! same isn't sent again. All tiles are sent after a new wiring, a new link to the compositor, or a frame whose
//! tiles found no room in the link's queue; only then may the compositor count on what it has.

use super::follow::Followed;
use super::loader::{self, Raw};
use crate::pipeline::{DrawStats, Renderer, TilePictures};
use crate::store::{Prepared, SceneStore};
use bytes::Bytes;
use proto::codec::{decode_table, encode};
use proto::frame::{Environment, FrameState, PixelFormat, TileIndex};
use proto::ids::{ContentId, Epoch, FrameNumber, ViewId};
use proto::message::{BoardReport, FrameHeader, TileMessage};
use proto::piece::PieceKind;
use proto::share::Share;
use proto::view::{Pose, ViewSetup};
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, Sender};
use std::time::{Duration, Instant};
use tokio::sync::mpsc;

/// Answers that may wait for the session.
pub(super) const ANSWERS: usize = 64;
/// Most pixels in one tile message, bytes: large shares go in several, so that sending overlaps stitching.
const TILE_MESSAGE_BYTES: usize = 8 << 20;

/// What the painter is asked to do.
#[derive(Debug)]
pub(super) enum Work {
    /// Say what is held.
    Inventory,
    /// Keep a piece that came in that session.
    Piece(u64, Prepared),
    /// Give these up.
    Evict(Vec<ContentId>),
    /// Keep the tables.
    Table(ContentId, Bytes),
    /// Draw these shares of a frame.
    /// Its shares; `None`: the board has no place under its wiring, so it must not be thought ready with it.
    Frame { header: Box<FrameHeader>, payload: Bytes, shares: Option<Vec<Share>> },
    /// The queue to the compositor, or that there is none.
    Outlet(Option<mpsc::Sender<Vec<Bytes>>>),
    /// A session is over and that one begins: lists and views are another's from now on. The scene is kept.
    ForgetSession(u64),
}

/// What the painter answers.
#[derive(Debug)]
pub(super) enum Painted {
    /// What is held: the scene whose tables are here, and pieces.
    Holding { scene: Option<ContentId>, ids: Vec<ContentId> },
    /// A piece of so many bytes is ready to be drawn.
    Stored { id: ContentId, len: u64 },
    /// The tables are here.
    Loaded(ContentId),
    /// A frame is drawn and its tiles are queued.
    Ready { frame: FrameNumber, epoch: Epoch, report: BoardReport },
    /// What came can't be kept or drawn: the backplane's fault.
    Refused(String),
}

/// The session's end of the painter and its loader.
#[derive(Debug)]
pub(super) struct Painter {
    pub(super) work: Sender<Work>,
    pub(super) pieces: Sender<Raw>,
    /// With the session that each belongs to.
    pub(super) answers: mpsc::Receiver<(u64, Painted)>,
    pub(super) session: u64,
}

impl Painter {
    /// Starts the threads. `memory` is what meshes and textures may count for, bytes.
    pub(super) fn start(renderer: Renderer, memory: u64) -> std::io::Result<Self> {
        let (work, inbox) = std::sync::mpsc::channel();
        let (pieces, raw) = std::sync::mpsc::channel();
        let (outbox, answers) = mpsc::channel(ANSWERS);
        let hand = Hand {
            renderer,
            store: SceneStore::new(),
            memory,
            scene: None,
            session: 0,
            outbox: outbox.clone(),
            outlet: None,
            is_behind: true,
            sent_epoch: None,
            followed: Followed::default(),
            drawn: None,
            pictures: BTreeMap::new(),
            spare: TilePictures::new(),
        };
        std::thread::Builder::new().name("painter".into()).spawn(move || hand.run(&inbox))?;
        let painter = work.clone();
        std::thread::Builder::new().name("loader".into()).spawn(move || loader::run(&raw, &painter, &outbox))?;
        Ok(Self { work, pieces, answers, session: 0 })
    }

    /// Hands work over. The queue has no bound of its own: the backplane sends frames at the rig's rate, of which all but the
    /// newest are only followed.
    pub(super) fn send(&self, work: Work) {
        // If the thread has ended, `painted` says so.
        let _ = self.work.send(work);
    }

    /// Hands a piece to the loader. The session bounds how many are under way.
    pub(super) fn load(&self, id: ContentId, kind: PieceKind, bytes: Bytes) {
        // If the thread has ended, so has the painter.
        let _ = self.pieces.send(Raw { session: self.session, id, kind, bytes });
    }

    /// For the outlet's task.
    pub(super) fn work(&self) -> Sender<Work> {
        self.work.clone()
    }

    /// The next answer of this session; `None`: the painter has ended. Cancel-safe.
    pub(super) async fn painted(&mut self) -> Option<Painted> {
        loop {
            let (session, painted) = self.answers.recv().await?;
            if session == self.session {
                return Some(painted);
            }
        }
    }

    /// Forgets everything that belongs to a session; what is under way of it is ignored when it comes.
    pub(super) fn forget_session(&mut self) {
        self.session += 1;
        self.send(Work::ForgetSession(self.session));
    }
}

/// What decides a picture.
#[derive(Clone, Debug, PartialEq)]
struct Inputs {
    eye: Pose,
    environment: Environment,
    /// Of lists, moved objects and weights.
    revision: u64,
    views: Vec<ViewSetup>,
    shares: Vec<Share>,
    format: PixelFormat,
}

#[derive(Debug)]
struct Drawn {
    frame: FrameNumber,
    epoch: Epoch,
    inputs: Inputs,
}

struct Hand {
    renderer: Renderer,
    store: SceneStore,
    /// What the store may count for, bytes.
    memory: u64,
    /// Whose tables the store has.
    scene: Option<ContentId>,
    session: u64,
    outbox: mpsc::Sender<(u64, Painted)>,
    outlet: Option<mpsc::Sender<Vec<Bytes>>>,
    /// The compositor lacks tiles that were drawn: all must be sent.
    is_behind: bool,
    /// The wiring under which tiles were sent last.
    sent_epoch: Option<Epoch>,
    followed: Followed,
    /// The frame that `pictures` show.
    drawn: Option<Drawn>,
    /// What was drawn, by view.
    pictures: BTreeMap<ViewId, TilePictures>,
    spare: TilePictures,
}

/// The newest frame that waits.
struct Job {
    state: FrameState,
    inputs: Inputs,
}

impl Hand {
    fn run(mut self, inbox: &Receiver<Work>) {
        while let Ok(work) = inbox.recv() {
            let mut job = None;
            let mut next = Some(work);
            while let Some(work) = next {
                if let Err(error) = self.take(work, &mut job) {
                    job = None;
                    self.answer(Painted::Refused(error));
                }
                next = inbox.try_recv().ok();
            }
            if let Some(job) = job {
                self.paint(job);
            }
        }
    }

    fn answer(&self, painted: Painted) {
        // Nobody listens when the daemon ends; the work queue closes next.
        let _ = self.outbox.blocking_send((self.session, painted));
    }

    fn take(&mut self, work: Work, job: &mut Option<Job>) -> Result<(), String> {
        match work {
            Work::Inventory => {
                let ids = self.store.contents().collect();
                self.answer(Painted::Holding { scene: self.scene, ids });
            }
            // The backplane of this session hasn't sent it, and doesn't know of it.
            Work::Piece(session, _) if session != self.session => {}
            Work::Piece(_, piece) => {
                let needed = self.store.memory().saturating_add(piece.memory());
                if needed > self.memory {
                    let limit = self.memory;
                    return Err(format!("piece {} needs {needed} bytes of memory, the limit is {limit}", piece.id()));
                }
                self.store.insert(piece);
            }
            Work::Evict(ids) => {
                if let Some(id) = ids.iter().find(|id| !self.store.remove(id)) {
                    return Err(format!("piece {id} can't be given up: it isn't here"));
                }
            }
            Work::Table(scene, bytes) => {
                named(scene, &bytes)?;
                let table = decode_table(bytes).map_err(|error| error.to_string())?;
                self.store.set_table(table).map_err(|error| error.to_string())?;
                self.scene = Some(scene);
                self.drawn = None;
                self.answer(Painted::Loaded(scene));
            }
            Work::Frame { header, payload, shares } => *job = self.follow(*header, &payload, shares)?,
            Work::Outlet(outlet) => {
                self.outlet = outlet;
                self.is_behind = true;
                // A frame that is not under way again is the compositor's only chance to get this board's tiles.
                if job.is_none()
                    && let Some(drawn) = &self.drawn
                {
                    let (frame, epoch) = (drawn.frame, drawn.epoch);
                    self.deliver(frame, epoch, None);
                }
            }
            Work::ForgetSession(session) => {
                self.session = session;
                self.followed.clear();
                self.drawn = None;
                self.outlet = None;
                self.is_behind = true;
                self.sent_epoch = None;
                *job = None;
            }
        }
        Ok(())
    }

    /// Follows the views and lists of a frame; it becomes the newest job.
    fn follow(
        &mut self,
        header: FrameHeader,
        payload: &[u8],
        shares: Option<Vec<Share>>,
    ) -> Result<Option<Job>, String> {
        if let Some(views) = &header.views {
            // The compositor clears its canvas when sizes or places change.
            self.is_behind |= views.iter().map(shape).ne(self.followed.views.iter().map(shape));
        }
        let store = &self.store;
        self.followed.take(&header, payload, store.subobjects(), |object| store.home(object))?;
        let Some(shares) = shares else { return Ok(None) };
        let FrameState { eye, environment, .. } = header.state;
        let inputs = Inputs {
            eye,
            environment,
            revision: self.followed.revision(),
            views: self.followed.views.clone(),
            shares,
            format: header.format,
        };
        Ok(Some(Job { state: header.state, inputs }))
    }

    fn paint(&mut self, job: Job) {
        let (frame, epoch) = (job.state.frame, job.state.epoch);
        let mut report = BoardReport::default();
        let is_same = self.drawn.as_ref().is_some_and(|drawn| drawn.inputs == job.inputs);
        // A view that this board no longer draws must not come back from here later.
        self.pictures.retain(|view, _| job.inputs.shares.iter().any(|share| share.view == *view));
        if is_same {
            report.frames_unchanged = 1;
        } else {
            self.drawn = None;
            let moved = self.store.set_moved(&self.followed.moved());
            if let Err(error) = moved.and_then(|()| self.store.set_weights(&self.followed.weights())) {
                self.answer(Painted::Refused(error.to_string()));
                return;
            }
        }
        // The link's epoch is new to the compositor: it has dropped what it had of this board.
        self.is_behind |= self.sent_epoch != Some(epoch);
        let mut changed = BTreeMap::new();
        let mut comparing = Duration::ZERO;
        for share in job.inputs.shares.iter().filter(|_| !is_same) {
            // A picture without the linear pixels that are now wanted, or with ones that aren't, starts anew.
            if (job.inputs.format == PixelFormat::LinearF32) != self.spare.linear.is_some() {
                self.spare = blank(job.inputs.format);
            }
            let Some(setup) = job.inputs.views.get(share.view.0 as usize) else { continue };
            let list = self.followed.list(share.view);
            match self.renderer.draw(&self.store, &job.state, &setup.view, list, &share.part, &mut self.spare) {
                Ok(stats) => count(&mut report, &stats),
                Err(error) => {
                    self.answer(Painted::Refused(error.to_string()));
                    return;
                }
            }
            let started = Instant::now();
            let before = self.pictures.entry(share.view).or_insert_with(|| blank(job.inputs.format));
            std::mem::swap(before, &mut self.spare);
            let tiles = differing(before, &self.spare, job.inputs.format);
            report.tiles_unchanged += if self.is_behind { 0 } else { (before.tiles.len() - tiles.len()) as u64 };
            comparing += started.elapsed();
            changed.insert(share.view, tiles);
        }
        let started = Instant::now();
        self.drawn = Some(Drawn { frame, epoch, inputs: job.inputs });
        report.tile_bytes = self.deliver(frame, epoch, Some(&changed));
        report.transfer_ns = (comparing + started.elapsed()).as_nanos() as u64;
        self.answer(Painted::Ready { frame, epoch, report });
    }

    /// Queues the tiles of the drawn frame for the compositor: the changed ones, or all when it is behind. Returns the
    /// bytes.
    fn deliver(&mut self, frame: FrameNumber, epoch: Epoch, changed: Option<&BTreeMap<ViewId, Vec<usize>>>) -> u64 {
        let Some(outlet) = &self.outlet else {
            self.is_behind = true;
            return 0;
        };
        let Some(Inputs { views, format, .. }) = self.drawn.as_ref().map(|drawn| &drawn.inputs) else { return 0 };
        let mut messages = Vec::new();
        for (view, picture) in &self.pictures {
            let Some(size) = views.get(view.0 as usize).map(|setup| (setup.view.width, setup.view.height)) else {
                continue;
            };
            let all: Vec<usize>;
            let tiles = match changed {
                Some(changed) if !self.is_behind => changed.get(view).map_or(&[][..], Vec::as_slice),
                _ => {
                    all = (0..picture.tiles.len()).collect();
                    &all
                }
            };
            let head = TileMessage::Tiles { frame, epoch, view: *view, count: 0, size, format: *format };
            tile_messages(picture, tiles, *format, &head, &mut messages);
        }
        messages.push(encode(&TileMessage::Done { frame, epoch }, &[]));
        let bytes = messages.iter().map(|message| message.len() as u64).sum();
        // All or nothing. Without room the compositor hangs or is gone, and the board goes on without it.
        self.is_behind = outlet.try_send(messages).is_err();
        if self.is_behind {
            return 0;
        }
        self.sent_epoch = Some(epoch);
        bytes
    }
}

/// What of a view decides where its pixels lie.
fn shape(setup: &ViewSetup) -> (u32, u32, Option<[u32; 2]>) {
    (setup.view.width, setup.view.height, setup.at)
}

/// Refuses a payload that is not what its name says.
fn named(id: ContentId, bytes: &[u8]) -> Result<(), String> {
    if ContentId::of(bytes) == id { Ok(()) } else { Err(format!("payload {id} has other content than its name says")) }
}

/// An empty picture of the format.
fn blank(format: PixelFormat) -> TilePictures {
    match format {
        PixelFormat::Srgb8 => TilePictures::new(),
        PixelFormat::LinearF32 => TilePictures::with_linear(),
    }
}

/// A tile's pixels as they are sent.
fn pixels(picture: &TilePictures, k: usize, format: PixelFormat) -> &[u8] {
    match (format, picture.tile_linear(k)) {
        // f32 are sent as they lie in memory: `proto::codec` refuses to be built for a big-endian machine.
        (PixelFormat::LinearF32, Some(linear)) => bytemuck::cast_slice(linear),
        _ => picture.tile(k),
    }
}

/// Indices of the tiles of `new` that `old` doesn't have alike.
fn differing(new: &TilePictures, old: &TilePictures, format: PixelFormat) -> Vec<usize> {
    let is_comparable = new.tiles == old.tiles && new.linear.is_some() == old.linear.is_some();
    let is_alike = |k: &usize| is_comparable && pixels(new, *k, format) == pixels(old, *k, format);
    (0..new.tiles.len()).filter(|k| !is_alike(k)).collect()
}

/// The messages that carry the tiles numbered in `tiles`; `head` says which picture they are of.
fn tile_messages(
    picture: &TilePictures,
    tiles: &[usize],
    format: PixelFormat,
    head: &TileMessage,
    messages: &mut Vec<Bytes>,
) {
    let mut rest = tiles;
    while !rest.is_empty() {
        let mut bytes = 0;
        let fits = rest.iter().take_while(|k| {
            bytes += pixels(picture, **k, format).len();
            bytes <= TILE_MESSAGE_BYTES
        });
        let (run, after) = rest.split_at(fits.count().max(1));
        rest = after;
        let mut payload = Vec::with_capacity(bytes + run.len() * size_of::<TileIndex>());
        for k in run {
            let tile = picture.tiles[*k];
            payload.extend_from_slice(&tile.x.to_le_bytes());
            payload.extend_from_slice(&tile.y.to_le_bytes());
        }
        for k in run {
            payload.extend_from_slice(pixels(picture, *k, format));
        }
        let mut head = head.clone();
        if let TileMessage::Tiles { count, .. } = &mut head {
            *count = run.len() as u32;
        }
        messages.push(encode(&head, &payload));
    }
}

fn count(report: &mut BoardReport, stats: &DrawStats) {
    report.geometry_ns += stats.geometry_ns;
    report.raster_ns += stats.raster_ns;
    report.translucency_ns += stats.translucency_ns;
    report.resolve_ns += stats.resolve_ns;
    report.fragments += stats.fragments;
    report.tiles_opaque += stats.tiles_opaque;
    report.triangles += stats.geometry.faces_in;
    report.backface += stats.geometry.backface;
    report.occluded += stats.opaque.occluded + stats.translucent.occluded;
    report.pixels_single += stats.pixels.pixels_single;
    report.pixels_multi += stats.pixels.pixels_multi;
}
