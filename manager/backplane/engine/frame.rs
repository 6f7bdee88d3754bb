//! Opening frames: what they show is selected, made of what boards can draw, and sent, unless it would show nothing new.

use super::Engine;
use crate::backplane::calm::Shown;
use crate::backplane::director::Substituted;
use crate::backplane::residency::Patience;
use proto::chain::Wiring;
use proto::codec::encode;
use proto::frame::{FrameRecord, FrameState};
use proto::ids::{BoardId, FrameNumber};
use proto::message::{FrameHeader, FramePayload, ListUpdate, ToBoard, ToCompositor};
use proto::share::shares;
use proto::time::Time;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tokio::time::Instant;

/// How long a frame stands for where frames have no time: for the eye's speed.
const LOCK_STEP_PERIOD: Duration = Duration::from_nanos(16_666_667);

impl Engine {
    /// Brings the selection, and what is known of it, up to date.
    pub(super) fn refresh(&mut self, now: Time) {
        self.director.set_scale(self.clock.scale());
        let counts = self.director.select();
        if let Some(counts) = &counts {
            self.culled = counts.iter().map(|counts| counts.subobjects_culled).sum();
        }
        let frame = u32::try_from(self.clock.next_frame().0).unwrap_or(u32::MAX);
        let at = if self.is_lock_step() { Time(0) + LOCK_STEP_PERIOD * frame } else { now };
        self.stream.on_selected(&mut self.director, counts.is_some(), at);
    }

    /// When the next frame's selection should begin, if it is to be made while boards draw.
    pub(super) fn ahead_due(&self) -> Option<Time> {
        let may_be = self.clock.open_frame().is_some() || (self.ahead.is_always() && self.may_open());
        let tick = (may_be && !self.is_lock_step()).then(|| self.clock.next_tick().0)?;
        self.ahead.due(tick)
    }

    pub(super) fn select_ahead_if_due(&mut self) {
        let now = self.now();
        if self.ahead_due().is_some_and(|due| due <= now) {
            let before = Instant::now();
            self.refresh(now);
            self.selecting = before.elapsed();
            self.ahead.on_made();
            self.statistics.frames_ahead += 1;
        }
    }

    /// What was selected has been sent, or need not be: the next frame may show what has come since.
    fn on_sent(&mut self, frame: FrameNumber, selecting: Duration) {
        let selected = std::mem::take(&mut self.selecting) + selecting;
        let held = self.ahead.on_sent(selected, self.clock.next_tick().1);
        self.sent = [self.sent[1], (frame, self.now())];
        for (packet, source) in held {
            self.take_pose(&packet, source);
        }
    }

    pub(super) fn open_if_due(&mut self) {
        if self.is_done() && self.clock.is_idle() {
            self.is_over = true;
            return;
        }
        let now = self.now();
        if !self.may_open() || !self.clock.wants_open(now) {
            return;
        }
        let next = self.clock.next_frame();
        let Some(wiring) = self.chain.on_frame(now, next).cloned() else { return };
        // The boards must hear of the wiring before the first frame under it.
        self.drain();
        let _frame = tracing::debug_span!("frame", frame = next.0, epoch = wiring.epoch.0).entered();
        let before_select = Instant::now();
        tracing::debug_span!("select").in_scope(|| self.refresh(now));
        let views = self.director.views().len();
        self.stream.on_wiring(Some(&wiring), self.boards.keys().copied(), views);
        let patience = if self.is_lock_step() { Patience::Whole } else { Patience::None };
        if patience == Patience::Whole && self.is_waiting(next, &wiring) {
            return;
        }
        let substituted = self.stream.settle(&mut self.director, &wiring, patience);
        let selecting = before_select.elapsed();
        self.first_open.get_or_insert(now);
        self.format = self.compositors.format();
        let shown = self.shown_by(&wiring);
        let is_picture_wanted = self.is_picture_wanted(now) || self.control.is_paused();
        let is_picture_due = is_picture_wanted && self.last_swap.as_ref().is_none_or(|swap| !swap.preview);
        self.control.on_open();
        let source = self.fresh.take();
        if source.is_some() {
            self.shown = source;
        }
        self.count_substituted(next, substituted);
        if !self.is_lock_step() && !is_picture_due && self.calm.is_idle(now, &shown) {
            let frame = self.clock.on_idle(now);
            self.control.shown = Some(now);
            self.statistics.frames += 1;
            self.statistics.skipped.frames_idle += 1;
            self.config.progress.store(self.statistics.frames, Ordering::Relaxed);
            self.answer();
            self.on_sent(frame, selecting);
        } else {
            self.calm.on_open(now, shown);
            self.statistics.select.add(self.selecting + selecting);
            self.statistics.skipped.culled += self.culled;
            let frame = self.clock.on_open(now, &wiring);
            self.traces.on_open(frame, source.map(|source| source.received), now, self.selecting + selecting);
            // A member that is gone already says nothing any more.
            for key in &wiring.members {
                if !self.boards.contains_key(key) {
                    self.clock.on_lost(now, *key);
                }
            }
            self.update_compositor_views();
            self.tell_record(frame);
            let before_stream = Instant::now();
            tracing::debug_span!("stream").in_scope(|| self.send_frame(frame, &wiring));
            let streaming = before_stream.elapsed();
            self.statistics.stream.add(streaming);
            self.traces.on_sent(self.now(), frame, streaming);
            self.on_sent(frame, selecting + streaming);
        }
        self.feed_all();
    }

    /// Lock-step: whether some board still lacks what it needs for the next frame and has room for.
    fn is_waiting(&mut self, next: FrameNumber, wiring: &Wiring) -> bool {
        let mut is_waiting = false;
        for key in wiring.members.iter().filter(|key| self.boards.contains_key(key)) {
            is_waiting |= !self.stream.is_ready(*key);
        }
        if is_waiting {
            self.feed_all();
            if self.waited.replace(next) != Some(next) {
                self.statistics.streaming.frames_waited += 1;
            }
        }
        is_waiting
    }

    fn count_substituted(&mut self, frame: FrameNumber, substituted: Substituted) {
        if substituted == Substituted::default() {
            return;
        }
        let Substituted { models, omitted } = substituted;
        let streaming = &mut self.statistics.streaming;
        streaming.substitutions += models;
        streaming.omitted += omitted;
        streaming.frames_substituted += 1;
        if streaming.frames_substituted == 1 {
            let why = if self.is_lock_step() { "boards have too little memory" } else { "boards don't hold all yet" };
            let what =
                format!("{frame:?}: {models} models show other versions, {omitted} subobjects are left out: {why}");
            tracing::warn!("{what}");
            self.log("substituted", what);
        }
    }

    fn shown_by(&self, wiring: &Wiring) -> Shown {
        let director = &self.director;
        let mut revisions = vec![director.views_revision, director.moved.revision(), director.mixtures.revision()];
        revisions.extend((0..director.views().len()).map(|view| director.lists.revision(view)));
        Shown {
            eye: director.eye(),
            environment: director.environment(),
            debug: self.control.debug,
            format: self.format,
            epoch: wiring.epoch,
            compositors: self.compositors.keys(),
            revisions,
        }
    }

    /// Says what the frame that opens depends on, if that is wanted.
    fn tell_record(&self, frame: FrameNumber) {
        self.compositors.tell_record(|| {
            let weights = self.director.mixtures.since(None).1.to_vec();
            let (eye, environment) = (self.director.eye(), self.director.environment());
            let record = FrameRecord { eye, environment, weights, debug: self.control.debug };
            ToCompositor::Record { frame, record }
        });
    }

    /// Sends every board its frame.
    fn send_frame(&mut self, frame: FrameNumber, wiring: &Wiring) {
        let Self { boards, director, statistics, stream, calm, format, control, .. } = self;
        let (eye, environment) = (director.eye(), director.environment());
        let state = FrameState { frame, epoch: wiring.epoch, eye, environment, debug: control.debug };
        for (i, key) in wiring.members.iter().enumerate() {
            let Some(board) = boards.get_mut(key) else { continue };
            let (moved, places) = director.moved.since(board.moved);
            let (weights, mixtures) = director.mixtures.since(board.mixtures);
            let mut payload = FramePayload { moved: places.to_vec(), weights: mixtures.to_vec(), scripts: Vec::new() };
            let own = shares(BoardId(i as u32), &wiring.weights, director.views());
            let mut lists = Vec::with_capacity(own.len());
            for share in &own {
                let held = board.lists.get(&share.view).copied();
                let (base, script_bytes) = director.lists.script(share.view.0 as usize, held, &mut payload.scripts);
                lists.push(ListUpdate { view: share.view, base, script_bytes });
            }
            let views = (board.views != director.views_revision).then(|| director.views().to_vec());
            let header = FrameHeader { state, views, format: *format, lists, moved, weights };
            let message = encode(&ToBoard::Frame(header), &payload.encode());
            let len = message.len() as u64;
            if board.outbox.try_frame(message) {
                statistics.bytes_to_boards += len;
                board.views = director.views_revision;
                (board.moved, board.mixtures) = (Some(director.moved.revision()), Some(director.mixtures.revision()));
                // Lists of views that it no longer draws go out of date at the board: it must not be sent changes
                // to them later.
                board.lists =
                    own.iter().map(|share| (share.view, director.lists.revision(share.view.0 as usize))).collect();
                let named = board.lists.iter().map(|(view, revision)| (*view, *revision)).collect();
                stream.on_sent(*key, frame, named);
            } else {
                statistics.dropped.board_frames += 1;
                calm.disturb();
            }
        }
    }
}
