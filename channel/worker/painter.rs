//! The painter: the one thread that owns what the board holds, and draws.
//!
//! What it holds is the backplane's to decide: pieces come, prepared by the loader, and are given up when told. More than its memory
//! limit is refused.
//!
//! Work comes in order and lists are followed frame by frame, but when several frames wait only the newest is drawn:
//! the others' deadlines have passed. What is the same as in the frame before isn't drawn again, and a tile that came out the
//! same isn't sent again (`delivery`).

use super::delivery::{Delivery, Outlets, pixels};
use super::follow::Followed;
use super::loader::{self, Raw};
use super::timeline::Watch;
use crate::pipeline::{DrawStats, Renderer, TilePictures};
use crate::store::{Prepared, SceneStore};
use bytes::Bytes;
use pool::turns;
use proto::codec::decode_table;
use proto::debug::DebugPicture;
use proto::frame::{Environment, FrameState, PixelFormat};
use proto::ids::{BoardKey, ContentId, Epoch, FrameNumber, ViewId};
use proto::message::{BoardReport, FrameHeader, TileSink, Timeline};
use proto::piece::PieceKind;
use proto::share::Share;
use proto::view::{Pose, ViewSetup};
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, Sender};
use std::time::{Duration, Instant};
use tokio::sync::mpsc;

/// Answers that may wait for the session.
pub(super) const ANSWERS: usize = 64;

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
    /// Its shares; `None`: the board has no place under its wiring, so it must not be thought ready with it. And when it came.
    Frame { header: Box<FrameHeader>, payload: Bytes, shares: Option<Vec<Share>>, came: Instant },
    /// The queue to a compositor of that session.
    OutletUp(u64, TileSink, mpsc::Sender<Vec<Bytes>>),
    /// The queue to that compositor is no more.
    OutletDown(BoardKey),
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
    Ready { frame: FrameNumber, epoch: Epoch, report: BoardReport, timeline: Timeline },
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
            outlets: Outlets::default(),
            followed: Followed::default(),
            drawn: None,
            pictures: BTreeMap::new(),
            spare: TilePictures::new(),
        };
        std::thread::Builder::new().name("painter".into()).spawn(move || {
            turns::go_along();
            hand.run(&inbox);
        })?;
        let painter = work.clone();
        std::thread::Builder::new().name("loader".into()).spawn(move || {
            turns::go_along();
            loader::run(&raw, &painter, &outbox);
        })?;
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

    /// For an outlet's task: the queue, and the session.
    pub(super) fn work(&self) -> (Sender<Work>, u64) {
        (self.work.clone(), self.session)
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
    debug: DebugPicture,
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
    outlets: Outlets,
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
    came: Instant,
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
            Work::Frame { header, payload, shares, came } => *job = self.follow(*header, &payload, shares, came)?,
            Work::OutletUp(session, ..) if session != self.session => {}
            Work::OutletUp(_, sink, queue) => {
                let key = sink.key;
                self.outlets.open(sink, queue);
                // A frame that is not under way again is the compositor's only chance to get this board's tiles.
                if job.is_none() {
                    self.deliver(Some(key), &BTreeMap::new());
                }
            }
            Work::OutletDown(key) => self.outlets.close(key),
            Work::ForgetSession(session) => {
                self.session = session;
                self.followed.clear();
                self.drawn = None;
                self.outlets = Outlets::default();
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
        came: Instant,
    ) -> Result<Option<Job>, String> {
        if let Some(views) = &header.views {
            // Compositors clear their canvas when sizes or places change.
            if views.iter().map(shape).ne(self.followed.views.iter().map(shape)) {
                self.outlets.fall_behind();
            }
        }
        let store = &self.store;
        self.followed.take(&header, payload, store.subobjects(), |object| store.home(object))?;
        let Some(shares) = shares else { return Ok(None) };
        let FrameState { eye, environment, debug, .. } = header.state;
        let inputs = Inputs {
            eye,
            environment,
            debug,
            revision: self.followed.revision(),
            views: self.followed.views.clone(),
            shares,
            format: header.format,
        };
        Ok(Some(Job { state: header.state, inputs, came }))
    }

    fn paint(&mut self, job: Job) {
        let (frame, epoch) = (job.state.frame, job.state.epoch);
        let _span = tracing::debug_span!("draw", frame = frame.0, epoch = epoch.0).entered();
        let mut watch = Watch::new(job.came);
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
        self.outlets.on_epoch(epoch);
        let is_behind = self.outlets.is_behind();
        let mut changed = BTreeMap::new();
        let mut comparing = Duration::ZERO;
        for share in job.inputs.shares.iter().filter(|_| !is_same) {
            // A picture without the linear pixels that are now wanted, or with ones that aren't, starts anew.
            if (job.inputs.format == PixelFormat::LinearF32) != self.spare.linear.is_some() {
                self.spare = blank(job.inputs.format);
            }
            let Some(setup) = job.inputs.views.get(share.view.0 as usize) else { continue };
            let list = self.followed.list(share.view);
            let begun = Instant::now();
            match self.renderer.draw(&self.store, &job.state, &setup.view, list, &share.part, &mut self.spare) {
                Ok(stats) => {
                    count(&mut report, &stats);
                    watch.on_drawn(share.view, begun, &stats);
                }
                Err(error) => {
                    self.answer(Painted::Refused(error.to_string()));
                    return;
                }
            }
            let started = Instant::now();
            let before = self.pictures.entry(share.view).or_insert_with(|| blank(job.inputs.format));
            // Only where that is a debug picture.
            self.spare.darken_unchanged(before);
            std::mem::swap(before, &mut self.spare);
            let tiles = differing(before, &self.spare, job.inputs.format);
            report.tiles_unchanged += if is_behind { 0 } else { (before.tiles.len() - tiles.len()) as u64 };
            comparing += started.elapsed();
            watch.on_transferred(Some(share.view), started);
            changed.insert(share.view, tiles);
        }
        let started = Instant::now();
        self.drawn = Some(Drawn { frame, epoch, inputs: job.inputs });
        report.tile_bytes = self.deliver(None, &changed);
        report.transfer_ns = (comparing + started.elapsed()).as_nanos() as u64;
        watch.on_transferred(None, started);
        let timeline = watch.finish();
        tracing::trace!(?report, ?timeline, "drawn");
        self.answer(Painted::Ready { frame, epoch, report, timeline });
    }

    /// Queues the tiles of the drawn frame for the compositors. Returns the bytes.
    fn deliver(&mut self, to: Option<BoardKey>, changed: &BTreeMap<ViewId, Vec<usize>>) -> u64 {
        let Some(Drawn { frame, epoch, inputs }) = &self.drawn else { return 0 };
        let drawn = Delivery {
            frame: *frame,
            epoch: *epoch,
            views: &inputs.views,
            format: inputs.format,
            pictures: &self.pictures,
            changed,
        };
        self.outlets.deliver(to, &drawn)
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

/// Indices of the tiles of `new` that `old` doesn't have alike.
fn differing(new: &TilePictures, old: &TilePictures, format: PixelFormat) -> Vec<usize> {
    let is_comparable = new.tiles == old.tiles && new.linear.is_some() == old.linear.is_some();
    let is_alike = |k: &usize| is_comparable && pixels(new, *k, format) == pixels(old, *k, format);
    (0..new.tiles.len()).filter(|k| !is_alike(k)).collect()
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
