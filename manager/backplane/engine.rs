//! The engine: the one thread that makes frames.
//!
//! It takes facts from its queue, hands them to the cores ([`BackplaneChain`], [`FrameClock`], [`Director`]), and carries
//! out what they want. A frame goes: pose → selection → one message per board → readies → swap → (lock-step: shown by
//! the compositors → the host's answer). `frame` opens frames, `swap` ends them, `compositors` shows them, `host` takes poses, `feed` sends pieces of the
//! scene, `control` does what the console asks, `standby` says whether any of this is ours to do.

mod compositors;
mod control;
mod feed;
mod frame;
mod host;
mod roster;
mod standby;
mod swap;

use super::Config;
use super::ahead::Ahead;
use super::calm::Calm;
use super::content::Content;
use super::director::Director;
use super::links::{Outbox, Traffic};
use super::live::{Command, CommandError, Live};
use super::residency::Catalogue;
use super::statistics::{BoardMemory, LinkBytes, Present, Report, Statistics};
use super::stream::Stream;
use super::trace::{FrameTrace, Traces};
use crate::host::native::Freshness;
use bytes::Bytes;
use compositors::Compositors;
use control::Control;
use link::Identity;
use proto::chain::{BackplaneChain, BackplaneOutput, BetweenBackplanes, ClockMode, ClockOutput, FrameClock};
use proto::codec::encode;
use proto::frame::{PixelFormat, REFERENCE_TILE};
use proto::ids::{BoardKey, FrameNumber, Term, ViewId};
use proto::limits;
use proto::message::{FromBoard, FromCompositor, Hello, Role, Swap, TileSink, ToBoard};
use proto::pose::{Answer, PosePacket};
use proto::time::Time;
pub(crate) use standby::OPENED;
use standby::{Held, Leadership};
use std::collections::{BTreeMap, VecDeque};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::time::Instant;

/// Facts taken before the clock is looked at again.
const FACTS_PER_TURN: usize = 256;
/// Longest sleep: nothing is due, but a look at the state costs nothing.
const IDLE: Duration = Duration::from_millis(100);
/// How often an engine in a task looks into its queue, and is looked at.
const TASK_PERIOD: Duration = Duration::from_millis(1);
const LOOK_PERIOD: Duration = Duration::from_millis(10);
/// Silence that means death where frames have no deadline: nobody is late there, so a machine may be as busy as it likes.
const LOCK_STEP_SILENCE: Duration = Duration::from_secs(5);
/// How long after the last request for the console's picture previews are still made.
const PREVIEW_INTEREST: Duration = Duration::from_secs(3);
/// Shortest time between previews.
const PREVIEW_PERIOD: Duration = Duration::from_millis(90);

/// Where answers to hosts go; sending never waits.
pub(crate) type Answers = Box<dyn Fn(&[u8], SocketAddr) -> std::io::Result<usize> + Send>;

/// A fact.
#[derive(Debug)]
pub(crate) enum Event {
    /// Somebody connected and said who it is.
    Hello { key: BoardKey, hello: Hello, from: SocketAddr, identity: Option<Identity>, outbox: Outbox },
    /// A link is over.
    Lost { key: BoardKey, reason: String },
    /// Somebody connected and wasn't let in, or so many, the last from there.
    Refused { from: SocketAddr, error: String, count: u64 },
    /// A board said something.
    Board { key: BoardKey, message: FromBoard, payload: Bytes },
    /// The compositor said something.
    Compositor { key: BoardKey, message: FromCompositor, payload: Bytes },
    /// The other backplane said something.
    Peer { key: BoardKey, message: BetweenBackplanes },
    /// The host said something.
    Pose { packet: PosePacket, from: SocketAddr, received: Time, freshness: Freshness },
    /// A datagram that is no pose packet.
    BadPose,
    /// The console wants the statistics.
    #[cfg_attr(not(feature = "console"), expect(dead_code, reason = "only the console asks"))]
    Report(oneshot::Sender<Report>),
    /// The console wants the newest picture.
    #[cfg_attr(not(feature = "console"), expect(dead_code, reason = "only the console asks"))]
    Picture(oneshot::Sender<Option<(FrameNumber, Bytes)>>),
    /// The console wants to know how the rig is.
    #[cfg_attr(not(feature = "console"), expect(dead_code, reason = "only the console asks"))]
    Live(oneshot::Sender<Live>),
    /// The console wants the last frames.
    #[cfg_attr(not(feature = "console"), expect(dead_code, reason = "only the console asks"))]
    Traces(oneshot::Sender<Vec<Arc<FrameTrace>>>),
    /// Somebody at the console wants something done.
    #[cfg_attr(not(feature = "console"), expect(dead_code, reason = "only the console asks"))]
    Command { command: Command, from: String, answer: oneshot::Sender<Result<String, CommandError>> },
    /// The manager ends.
    Shutdown,
}

#[derive(Debug)]
struct Board {
    name: Arc<str>,
    /// The name in its certificate, where there are keys.
    certified: Option<String>,
    /// Where its right neighbour reaches it.
    link: String,
    outbox: Outbox,
    /// Revision of each view's list that it holds.
    lists: BTreeMap<ViewId, u64>,
    /// Revisions of what is moved and mixed that it holds.
    moved: Option<u64>,
    mixtures: Option<u64>,
    /// Revision of the views that it holds.
    views: u64,
    /// When it came.
    since: Time,
    /// Whether it has the tables, and is in the row.
    has_table: bool,
    has_joined: bool,
    /// Whether it has said all that it holds.
    is_known: bool,
    /// Whether it asked to leave, or was told to.
    is_leaving: bool,
    /// Whether its link has been cut: what it still says doesn't count.
    is_out: bool,
    /// Whether it was taken out at the console, until it is put back.
    is_held: bool,
    /// Whether a frame has been shown that it drew a part of.
    draws: bool,
    /// What it says it has room for, bytes.
    memory: u64,
    /// Whether it drew for the backplane that led before.
    is_heir: bool,
    /// The term that it serves, if that isn't ours.
    claims: Option<Term>,
    held: Held,
}

impl Board {
    fn new(name: String, certified: Option<String>, link: String, memory: u64, outbox: Outbox, since: Time) -> Self {
        Self {
            name: name.into(),
            certified,
            link,
            outbox,
            lists: BTreeMap::new(),
            moved: None,
            mixtures: None,
            views: 0,
            since,
            has_table: false,
            has_joined: false,
            is_known: false,
            is_leaving: false,
            is_out: false,
            is_held: false,
            draws: false,
            memory,
            is_heir: false,
            claims: None,
            held: Held::default(),
        }
    }

    /// Whether it is to stay in the row.
    fn is_in_row(&self) -> bool {
        self.has_joined && !(self.is_leaving || self.is_out || self.is_held)
    }
}

/// A pose that waits for its frame, or whose frame waits for its swap.
#[derive(Clone, Copy, Debug)]
struct Source {
    from: SocketAddr,
    sequence: u32,
    answer: bool,
    received: Time,
}

pub(crate) struct Engine {
    config: Config,
    content: Arc<Content>,
    answers: Answers,
    started: Instant,
    chain: BackplaneChain,
    clock: FrameClock,
    leadership: Leadership,
    director: Director,
    stream: Stream,
    traffic: Arc<Traffic>,
    calm: Calm,
    ahead: Ahead<(PosePacket, Source)>,
    /// What the present selection took.
    selecting: Duration,
    /// The frames sent last, and when.
    sent: [(FrameNumber, Time); 2],
    control: Control,
    traces: Traces,
    /// Subobjects that the present selection leaves out.
    culled: u64,
    /// The last frame that waited for pieces.
    waited: Option<FrameNumber>,
    boards: BTreeMap<BoardKey, Board>,
    compositors: Compositors,
    statistics: Statistics,
    /// Lock-step: poses whose frames are still to come.
    poses_waiting: VecDeque<(PosePacket, Source)>,
    /// The newest pose, not yet in a frame.
    fresh: Option<Source>,
    /// The pose of the frame in flight, or of the last one.
    shown: Option<Source>,
    answered: Option<(SocketAddr, Answer)>,
    last_swap: Option<Swap>,
    /// What the last frame's pixels are.
    format: PixelFormat,
    first_open: Option<Time>,
    /// Since when some view can't be whole, and how many frames there were by then; `None`: all is well.
    broken: Option<(Time, u64)>,
    picture: Option<(FrameNumber, Bytes)>,
    picture_wanted: Option<Time>,
    picture_made: Option<Time>,
    is_over: bool,
}

/// A clock whose first frame is that one.
fn clock(config: &Config, first: FrameNumber, views: usize) -> FrameClock {
    let mut clock = FrameClock::new(config.mode, first, views as u32);
    clock.allow_scale(config.scale_max);
    clock
}

impl Engine {
    pub(crate) fn new(
        mut config: Config,
        content: Arc<Content>,
        catalogue: Catalogue,
        answers: Answers,
        traffic: Arc<Traffic>,
        started: Instant,
    ) -> Self {
        config.wait_for_boards = config.wait_for_boards.max(1);
        let stream = Stream::new(catalogue);
        let director = Director::new(config.stage.clone());
        let mut chain = BackplaneChain::new();
        match config.mode {
            ClockMode::RealTime { period } => chain.set_period(period),
            ClockMode::LockStep => chain.set_silence(LOCK_STEP_SILENCE),
        }
        let clock = clock(&config, FrameNumber(0), director.views().len());
        let ahead = Ahead::new(config.select_ahead);
        let leadership = Leadership::new(config.stands_by_for.as_deref());
        Self {
            config,
            content,
            answers,
            started,
            chain,
            clock,
            leadership,
            director,
            stream,
            traffic,
            calm: Calm::default(),
            ahead,
            selecting: Duration::ZERO,
            sent: [(FrameNumber(u64::MAX), Time(0)); 2],
            control: Control::default(),
            traces: Traces::default(),
            culled: 0,
            waited: None,
            boards: BTreeMap::new(),
            compositors: Compositors::default(),
            statistics: Statistics::default(),
            poses_waiting: VecDeque::new(),
            fresh: None,
            shown: None,
            answered: None,
            last_swap: None,
            format: PixelFormat::default(),
            first_open: None,
            broken: None,
            picture: None,
            picture_wanted: None,
            picture_made: None,
            is_over: false,
        }
    }

    /// Runs to the end of the rig and returns what it has done.
    pub(crate) fn run(mut self, inbox: &Receiver<Event>) -> Report {
        while !self.is_over {
            match inbox.recv_timeout(self.sleep()) {
                Ok(event) => self.turn(std::iter::once(event).chain(inbox.try_iter())),
                Err(RecvTimeoutError::Timeout) => self.turn(std::iter::empty()),
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        self.end()
    }

    /// Likewise on the clock of the task's runtime, which may be a simulated one. Nothing wakes a task that a thread's queue is for, so it looks
    /// into that every millisecond; `look` hears how the rig is, every so often.
    pub(crate) async fn run_in_task(mut self, inbox: Receiver<Event>, mut look: impl FnMut(Report) + Send) -> Report {
        let mut looked = None;
        while !self.is_over {
            let now = self.now();
            if looked.is_none_or(|at| now.since(at) >= LOOK_PERIOD) {
                looked = Some(now);
                look(self.report());
            }
            self.turn(inbox.try_iter());
            tokio::time::sleep(self.sleep().clamp(Duration::from_micros(1), TASK_PERIOD)).await;
        }
        self.end()
    }

    /// Takes what has come, and does what is due.
    fn turn(&mut self, events: impl Iterator<Item = Event>) {
        for event in events.take(FACTS_PER_TURN + 1) {
            self.on_event(event);
        }
        let now = self.now();
        self.chain.on_timeout(now);
        self.clock.on_timeout(now);
        self.drain();
        self.attend();
        self.admit();
        self.take_waiting_pose();
        self.open_if_due();
        self.select_ahead_if_due();
        self.drain();
    }

    /// Says goodbye; what was done.
    fn end(&self) -> Report {
        for board in self.boards.values() {
            board.outbox.send(encode(&ToBoard::Goodbye, &[]));
            board.outbox.close();
        }
        self.compositors.dismiss();
        self.report()
    }

    fn now(&self) -> Time {
        Time(self.started.elapsed().as_nanos() as u64)
    }

    fn sleep(&self) -> Duration {
        let now = self.now();
        let clock = self.clock.next_timeout().filter(|_| self.clock.open_frame().is_some() || self.may_open());
        let timeouts = [self.chain.next_timeout(), clock, self.ahead_due(), self.leadership.next_timeout()];
        let due = timeouts.into_iter().flatten().min();
        due.map_or(IDLE, |due| due.since(now)).min(IDLE)
    }

    /// Whether everything but the time is there for the next frame.
    fn may_open(&self) -> bool {
        let is_first = self.first_open.is_none();
        let has_boards = self.chain.active().is_some() || self.chain.has_closed();
        let has_enough = !is_first || (self.chain.has_closed() && self.chain.len() >= self.config.wait_for_boards);
        // In lock-step every frame is to be shown: whoever waits for the compositor once waits for it always.
        let needs_compositor = self.config.wait_for_compositor && (is_first || self.is_lock_step());
        let has_compositor = !needs_compositor || self.compositors.show_all(self.director.views().len());
        let has_pose = match self.config.mode {
            ClockMode::RealTime { .. } => true,
            // A frame that is drawn again has its pose already.
            ClockMode::LockStep => self.fresh.is_some() || self.clock.is_redraw(),
        };
        has_boards && has_enough && has_compositor && has_pose && self.control.may_open() && !self.is_done()
    }

    fn is_lock_step(&self) -> bool {
        self.config.mode == ClockMode::LockStep
    }

    fn is_done(&self) -> bool {
        self.config.frames.is_some_and(|frames| self.clock.next_frame().0 >= frames)
    }

    fn on_event(&mut self, event: Event) {
        match event {
            Event::Hello { key, hello, from, identity, outbox } => self.on_hello(key, hello, from, identity, outbox),
            Event::Lost { key, reason } => self.on_lost(key, &reason),
            Event::Refused { from, error, count } => {
                self.statistics.dropped.connections += count;
                let more = if count > 1 { format!(" ({count} connections)") } else { String::new() };
                self.log("refused", format!("{from}: {error}{more}"));
            }
            Event::Board { key, message, payload } => self.on_board(key, message, &payload),
            // One that was refused may still be talking.
            Event::Compositor { key, message, payload } => self.on_compositor(key, message, payload),
            Event::Peer { key, message } => self.on_peer_said(key, message),
            Event::Pose { packet, from, received, freshness } => self.on_pose(packet, from, received, freshness),
            Event::BadPose => self.statistics.dropped.pose_packets += 1,
            // Whoever asked may have gone away meanwhile.
            Event::Report(answer) => drop(answer.send(self.report())),
            Event::Picture(answer) => {
                self.picture_wanted = Some(self.now());
                drop(answer.send(self.picture.clone()));
            }
            Event::Live(answer) => drop(answer.send(self.live())),
            Event::Traces(answer) => drop(answer.send(self.traces.all())),
            Event::Command { command, from, answer } => drop(answer.send(self.on_command(command, &from))),
            Event::Shutdown => self.is_over = true,
        }
    }

    fn log(&mut self, event: &'static str, detail: String) {
        self.statistics.on_event(self.started.elapsed(), self.clock.next_frame().0, event, detail);
    }

    fn on_hello(&mut self, key: BoardKey, hello: Hello, from: SocketAddr, identity: Option<Identity>, outbox: Outbox) {
        match hello.role {
            Role::Board { .. } if self.boards.len() >= limits::BOARDS_MAX => {
                let reason = format!("this rig has {} boards already, the most there can be", self.boards.len());
                outbox.send(encode(&ToBoard::Refused { reason }, &[]));
                outbox.close();
                self.log("refused", format!("a board too many, from {from}"));
            }
            Role::Board { drawn, .. } if drawn != REFERENCE_TILE => {
                let reason = format!(
                    "it draws the reference tile as {drawn}, not as {REFERENCE_TILE}: its machine is faulty, or it is of another version"
                );
                self.log("refused", format!("board {} ({from}): {reason}", hello.name));
                outbox.send(encode(&ToBoard::Refused { reason }, &[]));
                outbox.close();
            }
            Role::Board { threads, link, memory, .. } => {
                let sinks = self.compositors.sinks();
                let certified = identity.map(|identity| identity.name);
                let is_taken = outbox.send(encode(&ToBoard::Welcome { key }, &[]))
                    && outbox.send(encode(&ToBoard::Compositors(sinks), &[]));
                if is_taken {
                    let (name, room) = (&hello.name, memory >> 20);
                    let detail = format!("board {name} ({from}, {threads} threads, {room} MiB), {key:?}");
                    self.log("connected", detail);
                    self.stream.on_board(key, memory, self.config.board_memory);
                    self.control.on_hello(&hello.name);
                    let now = self.now();
                    self.boards.insert(key, Board::new(hello.name, certified, link, memory, outbox, now));
                    self.tell_compositors_boards();
                    self.on_board_there(key);
                }
            }
            Role::Compositor { listen, format, records, views } => {
                self.on_compositor_hello(
                    TileSink { key, address: listen, views, format },
                    records,
                    identity.map(|identity| identity.name),
                    from,
                    outbox,
                );
            }
            Role::Backplane => self.on_peer(key, &hello.name, from, outbox),
        }
    }

    fn tell_boards(&self, message: &ToBoard) {
        let bytes = encode(message, &[]);
        for board in self.boards.values() {
            board.outbox.send(bytes.clone());
        }
    }

    fn on_lost(&mut self, key: BoardKey, reason: &str) {
        let now = self.now();
        if let Some(board) = self.boards.remove(&key) {
            self.on_board_gone(key);
            self.stream.on_lost(key);
            self.control.on_gone(now, key, &board, reason);
            self.calm.disturb();
            self.chain.on_lost(now, key);
            self.clock.on_lost(now, key);
            // A wiring without it may have closed already, because it asked to leave.
            if self.chain.has_closed() {
                self.clock.on_rewired();
            }
            let event = if board.is_leaving { "left" } else { "lost" };
            self.log(event, format!("board {} ({key:?}): {reason}", board.name));
            if board.draws && !board.is_leaving {
                self.broken.get_or_insert((now, self.statistics.late_frames));
            }
        } else if !self.on_compositor_lost(key, reason) {
            self.on_peer_lost(key, reason);
        }
    }

    fn on_board(&mut self, key: BoardKey, message: FromBoard, payload: &Bytes) {
        let now = self.now();
        if self.on_board_term(key, &message, payload) {
            return;
        }
        self.chain.on_heard(now, key);
        // A message that was under way when the board was dropped.
        let Some(board) = self.boards.get_mut(&key).filter(|board| !board.is_out) else { return };
        match message {
            FromBoard::Holding { scene, more, .. } => self.on_holding(key, scene, more, payload),
            FromBoard::Stored => self.on_stored(key, payload),
            FromBoard::Loaded { scene } => self.on_loaded(key, scene),
            FromBoard::Chain(message) => self.chain.on_message(now, key, message),
            FromBoard::Ready { frame, epoch, report, timeline } => {
                self.statistics.on_board_report(&report);
                if let Some((_, at)) = self.sent.iter().find(|(sent, _)| *sent == frame) {
                    self.ahead.on_drawn(now.since(*at));
                }
                self.traces.on_ready(now, frame, key, &board.name, &report, timeline);
                tracing::trace!(frame = frame.0, epoch = epoch.0, board = %board.name, ?report, "ready");
                self.chain.on_ready(now, key, epoch, report.drawing());
                self.clock.on_ready(now, key, frame, epoch);
                self.stream.on_ready(key, frame);
                self.feed(key);
            }
            FromBoard::Leave => {
                board.is_leaving = true;
                self.chain.on_leave(now, key);
                self.release_waiting(key);
            }
            // It has been heard.
            FromBoard::Alive | FromBoard::Answer(_) => {}
        }
    }

    fn put_out(&mut self, key: BoardKey, why: &str) {
        if let Some(board) = self.boards.get_mut(&key).filter(|board| !board.is_out) {
            board.is_out = true;
            board.outbox.cut();
            let name = board.name.clone();
            self.statistics.dropped.boards += 1;
            self.log("put out", format!("board {name} ({key:?}): {why}"));
        }
    }

    /// Carries out what the cores want.
    fn drain(&mut self) {
        while let Some(ClockOutput::Swap { swap, opened, late, missing }) = self.clock.poll_output() {
            self.chain.on_frame_over(self.now(), &missing);
            if self.chain.may_show(&swap.boards) {
                self.swap(swap.clone(), opened, late);
                self.take_first_term_if_due(&swap);
            } else {
                self.hold(&swap);
            }
            if let ClockMode::RealTime { period } = self.config.mode {
                self.chain.set_period(period * self.clock.divider());
            }
        }
        while let Some(output) = self.chain.poll_output() {
            match output {
                BackplaneOutput::Send(key, message) => {
                    self.tell_neighbours(key, &message);
                    if let Some(board) = self.boards.get(&key) {
                        board.outbox.send(encode(&ToBoard::Chain(message), &[]));
                    }
                }
                BackplaneOutput::Released(key) => self.release(key),
                BackplaneOutput::PutOut(key, why) => self.put_out(key, why),
                BackplaneOutput::Beat => self.tell_boards(&ToBoard::Alive),
                BackplaneOutput::Closed(_) => {
                    self.log("wired", format!("epoch {}: {} boards", self.epochs(), self.chain.len()));
                    self.clock.on_rewired();
                }
            }
        }
    }

    fn report(&self) -> Report {
        let memory = self.boards.iter().filter_map(|(key, board)| {
            let [limit_bytes, held_bytes, peak_bytes] = self.stream.memory(*key)?;
            Some(BoardMemory { board: board.name.to_string(), limit_bytes, held_bytes, peak_bytes })
        });
        let count = |bytes: &AtomicU64| bytes.load(Ordering::Relaxed);
        let (to_boards, from_boards) = (count(&self.traffic.to_boards), count(&self.traffic.from_boards));
        self.statistics.report(Present {
            time: self.started.elapsed(),
            views: self.director.views().len() as u32,
            boards: self.chain.len(),
            epochs: self.epochs(),
            leads: self.leadership.leads(),
            term: self.leadership.term().0,
            divider: self.clock.divider(),
            scale: self.clock.scale(),
            seconds: self.first_open.map_or(0.0, |first| self.now().since(first).as_secs_f64()),
            link_bytes: LinkBytes { to_boards, from_boards, ..LinkBytes::default() },
            scene_bytes: self.stream.catalogue().total(),
            memory: memory.collect(),
        })
    }
}
