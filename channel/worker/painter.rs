//! The painter: the one thread that owns what the board holds, and draws.
//!
//! Work comes in order and lists are followed frame by frame, but when several frames wait only the newest is drawn:
//! the others' deadlines have passed. What is the same as in the frame before isn't drawn again, and a tile that came out the
//! same isn't sent again. All tiles are sent after a new wiring, a new link to the compositor, or a frame whose
//! tiles found no room in the link's queue; only then may the compositor count on what it has.

use crate::pipeline::{DrawStats, Renderer, TilePictures};
use crate::store::SceneStore;
use bytes::Bytes;
use proto::codec::{decode_mesh, decode_table, decode_texture, encode};
use proto::frame::{Environment, FrameState, Moved, PixelFormat, TileIndex, VersionWeights};
use proto::ids::{ContentId, Epoch, FrameNumber, SubobjectId, ViewId};
use proto::list::apply;
use proto::message::{BoardReport, FrameHeader, FramePayload, ListBase, TileMessage};
use proto::share::Share;
use proto::view::{Pose, ViewSetup};
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, Sender};
use std::time::{Duration, Instant};
use tokio::sync::mpsc;

/// Answers that may wait for the session.
const ANSWERS: usize = 64;
/// Most pixels in one tile message, bytes: large shares go in several, so that sending overlaps stitching.
const TILE_MESSAGE_BYTES: usize = 8 << 20;

/// What the painter is asked to do.
#[derive(Debug)]
pub(super) enum Work {
    /// Say which of these are lacking.
    Offer(Vec<ContentId>),
    /// Keep a mesh.
    Mesh(ContentId, Bytes),
    /// Keep a texture.
    Texture(ContentId, Bytes),
    /// Keep the tables; the scene is then complete.
    Table(ContentId, Bytes),
    /// Draw these shares of a frame.
    Frame { header: Box<FrameHeader>, payload: Bytes, shares: Vec<Share> },
    /// The queue to the compositor, or that there is none.
    Outlet(Option<mpsc::Sender<Vec<Bytes>>>),
    /// The session is over: lists and views are another's from now on. The scene is kept.
    ForgetSession,
}

/// What the painter answers.
#[derive(Debug)]
pub(super) enum Painted {
    /// Of an offer.
    Lacking(Vec<ContentId>),
    /// The scene is complete.
    Loaded(ContentId),
    /// A frame is drawn and its tiles are queued.
    Ready { frame: FrameNumber, epoch: Epoch, report: BoardReport },
    /// What came can't be kept or drawn: the backplane's fault.
    Refused(String),
}

/// The session's end of the painter.
#[derive(Debug)]
pub(super) struct Painter {
    work: Sender<Work>,
    answers: mpsc::Receiver<Painted>,
}

impl Painter {
    /// Starts the thread.
    pub(super) fn start(renderer: Renderer) -> std::io::Result<Self> {
        let (work, inbox) = std::sync::mpsc::channel();
        let (outbox, answers) = mpsc::channel(ANSWERS);
        let hand = Hand {
            renderer,
            store: SceneStore::new(),
            outbox,
            outlet: None,
            is_behind: true,
            sent_epoch: None,
            views: Vec::new(),
            lists: BTreeMap::new(),
            drawn: None,
            pictures: BTreeMap::new(),
            spare: TilePictures::new(),
        };
        std::thread::Builder::new().name("painter".into()).spawn(move || hand.run(&inbox))?;
        Ok(Self { work, answers })
    }

    /// Hands work over. The queue has no bound of its own: the backplane sends a scene once, and frames at the rig's rate, of
    /// which all but the newest are only followed.
    pub(super) fn send(&self, work: Work) {
        // If the thread has ended, `painted` says so.
        let _ = self.work.send(work);
    }

    /// For the outlet's task.
    pub(super) fn work(&self) -> Sender<Work> {
        self.work.clone()
    }

    /// The next answer; `None`: the painter has ended. Cancel-safe.
    pub(super) async fn painted(&mut self) -> Option<Painted> {
        self.answers.recv().await
    }

    /// Forgets everything that belongs to a session; answers that are under way are dropped with it.
    pub(super) fn forget_session(&mut self) {
        self.send(Work::ForgetSession);
        while self.answers.try_recv().is_ok() {}
    }
}

/// What decides a picture, besides the lists and the store.
#[derive(Clone, Debug, PartialEq)]
struct Inputs {
    eye: Pose,
    environment: Environment,
    moved: Vec<Moved>,
    views: Vec<ViewSetup>,
    shares: Vec<Share>,
    format: PixelFormat,
    weights: Vec<VersionWeights>,
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
    outbox: mpsc::Sender<Painted>,
    outlet: Option<mpsc::Sender<Vec<Bytes>>>,
    /// The compositor lacks tiles that were drawn: all must be sent.
    is_behind: bool,
    /// The wiring under which tiles were sent last.
    sent_epoch: Option<Epoch>,
    views: Vec<ViewSetup>,
    lists: BTreeMap<ViewId, Vec<SubobjectId>>,
    /// The frame that `pictures` show; `None` also when a list has changed since.
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
        let _ = self.outbox.blocking_send(painted);
    }

    fn take(&mut self, work: Work, job: &mut Option<Job>) -> Result<(), String> {
        match work {
            Work::Offer(ids) => {
                let lacking = ids.into_iter().filter(|id| !self.store.holds(id)).collect();
                self.answer(Painted::Lacking(lacking));
            }
            Work::Mesh(id, bytes) => {
                named(id, &bytes)?;
                let mesh = decode_mesh(bytes).map_err(|error| error.to_string())?;
                self.store.insert_mesh(id, mesh).map_err(|error| error.to_string())?;
            }
            Work::Texture(id, bytes) => {
                named(id, &bytes)?;
                let texture = decode_texture(bytes).map_err(|error| error.to_string())?;
                self.store.insert_texture(id, texture).map_err(|error| error.to_string())?;
            }
            Work::Table(scene, bytes) => {
                named(scene, &bytes)?;
                let table = decode_table(bytes).map_err(|error| error.to_string())?;
                self.store.set_table(table).map_err(|error| error.to_string())?;
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
            Work::ForgetSession => {
                self.lists.clear();
                self.views.clear();
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
    fn follow(&mut self, header: FrameHeader, payload: &[u8], shares: Vec<Share>) -> Result<Option<Job>, String> {
        let content = FramePayload::decode(&header, payload).map_err(|error| error.to_string())?;
        if let Some(views) = header.views {
            // The compositor clears its canvas when sizes or places change.
            self.is_behind |= views.iter().map(shape).ne(self.views.iter().map(shape));
            self.views = views;
        }
        let mut scripts = &content.scripts[..];
        let mut kept = BTreeMap::new();
        let limit = self.store.subobjects();
        for update in &header.lists {
            // `FramePayload::decode` has checked the sum.
            let (script, rest) = scripts.split_at(update.script_bytes as usize);
            scripts = rest;
            let last = self.lists.remove(&update.view);
            let list = match (update.base, last) {
                (ListBase::Same, Some(last)) => last,
                (ListBase::Last, Some(last)) => {
                    let mut list = Vec::new();
                    apply(&last, script, limit, &mut list).map_err(|error| error.to_string())?;
                    self.drawn = None;
                    list
                }
                (ListBase::Empty, _) => {
                    let mut list = Vec::new();
                    apply(&[], script, limit, &mut list).map_err(|error| error.to_string())?;
                    self.drawn = None;
                    list
                }
                (ListBase::Same | ListBase::Last, None) => return Err("changes to a list that was never sent".into()),
            };
            kept.insert(update.view, list);
        }
        self.lists = kept;
        let FrameState { eye, environment, .. } = header.state;
        let inputs = Inputs {
            eye,
            environment,
            moved: content.moved,
            views: self.views.clone(),
            shares,
            format: header.format,
            weights: content.weights,
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
            let set =
                self.store.set_moved(&job.inputs.moved).and_then(|()| self.store.set_weights(&job.inputs.weights));
            if let Err(error) = set {
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
            let list = self.lists.get(&share.view).map_or(&[][..], Vec::as_slice);
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
