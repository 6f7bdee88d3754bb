//! What the console may ask of the engine, and what it is told. Nothing here waits for anybody: an answer that nobody wants any more is dropped.
//!
//! *Pause* lets one more frame open, of which a picture is made, so that what is looked at is what is on the displays. *Step* is one frame more.
//! A board that is *taken out* goes as one that asked to leave does: it draws until a wiring without it is in effect, so that no frame is late. Its link
//! stays, it is fed as before, and it is back within a wiring when it is put back. A *debug picture* is drawn from the next frame on; of a rig that is
//! paused one more frame is opened for it, so that whoever looks sees what he asked for. Who stands by has nothing to control.

use super::{Board, Engine};
use crate::backplane::live::{BoardLine, BoardState, Command, CommandError, Live};
use crate::backplane::statistics::LinkBytes;
use proto::chain::ClockMode;
use proto::codec::encode;
use proto::debug::DebugPicture;
use proto::ids::BoardKey;
use proto::message::ToBoard;
use proto::time::Time;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Boards that are gone and still told of.
const GONE_MAX: usize = 16;
/// One that left by itself is told of for so long, one that was lost until it is back or ten minutes have passed.
const LEFT_TOLD: Duration = Duration::from_secs(10);
const LOST_TOLD: Duration = Duration::from_secs(600);
/// How far back the console's frames go.
const RECENT: Duration = Duration::from_secs(1);
/// Events that the console shows.
const EVENTS: usize = 60;

/// What stands between the engine and its next frame, and who is missed.
#[derive(Debug, Default)]
pub(super) struct Control {
    is_paused: bool,
    /// Frames that may still be opened.
    steps: u32,
    /// What pixels say, from the next frame on.
    pub(super) debug: DebugPicture,
    /// Boards that are gone, and when they went.
    gone: VecDeque<(Time, BoardLine)>,
    /// When a frame was last shown, or needed not be.
    pub(super) shown: Option<Time>,
}

impl Control {
    pub(super) fn may_open(&self) -> bool {
        !self.is_paused || self.steps > 0
    }

    /// A frame is opened, or passed over for it would show nothing new.
    pub(super) fn on_open(&mut self) {
        self.steps = self.steps.saturating_sub(1);
    }

    /// Whether each frame's picture is wanted, for it may stand for long.
    pub(super) fn is_paused(&self) -> bool {
        self.is_paused
    }

    /// A board is there.
    pub(super) fn on_hello(&mut self, name: &str) {
        self.gone.retain(|(_, line)| *line.name != *name);
    }

    pub(super) fn on_gone(&mut self, now: Time, key: BoardKey, board: &Board, why: &str) {
        let state = match (board.is_out, board.is_leaving) {
            (true, _) => BoardState::PutOut,
            (false, true) => BoardState::Left,
            (false, false) => BoardState::Lost,
        };
        if self.gone.len() >= GONE_MAX {
            self.gone.pop_front();
        }
        let line = BoardLine { key, name: Arc::clone(&board.name), state, why: why.to_owned(), memory: None };
        self.gone.push_back((now, line));
    }

    fn forget_gone(&mut self, now: Time) {
        let told = |state| if state == BoardState::Left { LEFT_TOLD } else { LOST_TOLD };
        self.gone.retain(|(at, line)| now.since(*at) < told(line.state));
    }
}

impl Engine {
    /// Carries out what somebody asks at the console; returns what to tell him.
    ///
    /// # Errors
    /// [`CommandError`]: nothing has changed.
    pub(super) fn on_command(&mut self, command: Command, from: &str) -> Result<String, CommandError> {
        if let Some(of) = self.leader() {
            return Err(CommandError::StandsBy(of));
        }
        let said = match command {
            Command::Pause if self.control.is_paused => "paused already".to_owned(),
            Command::Pause => {
                (self.control.is_paused, self.control.steps) = (true, 1);
                "paused after the next frame".to_owned()
            }
            Command::Resume => {
                (self.control.is_paused, self.control.steps) = (false, 0);
                "goes on".to_owned()
            }
            Command::Step if !self.control.is_paused => return Err(CommandError::NotPaused),
            Command::Step => {
                self.control.steps = self.control.steps.saturating_add(1);
                format!("one step, {:?}", self.clock.next_frame())
            }
            Command::TakeOut(key) => self.take_out(key)?,
            Command::PutBack(key) => self.put_back(key)?,
            Command::Mode(mode) => {
                self.director.set_sharing(Some(mode), None);
                format!("views shared by {mode:?} from the next frame on").to_lowercase()
            }
            Command::Samples(samples) => {
                self.director.set_sharing(None, Some(samples));
                format!("{samples} points a pixel from the next frame on")
            }
            Command::Debug(debug) => {
                let is_new = std::mem::replace(&mut self.control.debug, debug) != debug;
                self.control.steps = self.control.steps.saturating_add((is_new && self.control.is_paused).into());
                match debug {
                    DebugPicture::Off => "the picture itself from the next frame on".to_owned(),
                    debug => format!("debug picture {} from the next frame on, on the displays too", debug.name()),
                }
            }
        };
        self.log("control", format!("{said} ({from})"));
        Ok(said)
    }

    fn take_out(&mut self, key: BoardKey) -> Result<String, CommandError> {
        let now = self.now();
        let others = self.boards.iter().filter(|(other, board)| **other != key && board.is_in_row()).count();
        let board = self.boards.get_mut(&key).filter(|board| !board.is_out).ok_or(CommandError::NoBoard(key.0))?;
        let name = Arc::clone(&board.name);
        if board.is_leaving || board.is_held {
            return Err(CommandError::Leaving(name));
        }
        if board.has_joined && others == 0 {
            return Err(CommandError::LastBoard(name));
        }
        board.is_held = true;
        if board.has_joined {
            self.chain.on_leave(now, key);
        }
        Ok(format!("board {name} ({key:?}) taken out"))
    }

    fn put_back(&mut self, key: BoardKey) -> Result<String, CommandError> {
        let now = self.now();
        let board = self.boards.get_mut(&key).filter(|board| !board.is_out).ok_or(CommandError::NoBoard(key.0))?;
        let name = Arc::clone(&board.name);
        if !board.is_held {
            return Err(CommandError::NotOut(name));
        }
        (board.is_held, board.since) = (false, now);
        Ok(format!("board {name} ({key:?}) put back"))
    }

    /// A board's share is drawn by others: it may go, unless it is only taken out.
    pub(super) fn release(&mut self, key: BoardKey) {
        let Some(board) = self.boards.get_mut(&key) else { return };
        if board.is_leaving {
            board.outbox.send(encode(&ToBoard::Goodbye, &[]));
            board.outbox.close();
        } else {
            (board.has_joined, board.draws) = (false, false);
            self.log_out(key);
        }
    }

    /// A board that is in no row asks to leave: nobody waits for it.
    pub(super) fn release_waiting(&mut self, key: BoardKey) {
        if self.boards.get(&key).is_some_and(|board| board.is_leaving && !board.has_joined) {
            self.release(key);
        }
    }

    fn log_out(&mut self, key: BoardKey) {
        if let Some(board) = self.boards.get(&key) {
            let detail = format!("board {} ({key:?}) is out of the row", board.name);
            self.log("out", detail);
        }
    }

    /// The rig at this moment.
    pub(super) fn live(&mut self) -> Live {
        let now = self.now();
        self.control.forget_gone(now);
        let wiring = self.chain.active().cloned();
        let line = |(key, board): (&BoardKey, &Board)| BoardLine {
            key: *key,
            name: Arc::clone(&board.name),
            state: self.state_of(*key, board),
            why: String::new(),
            memory: self.stream.memory(*key),
        };
        let mut boards: Vec<_> = self.boards.iter().map(line).collect();
        boards.extend(self.control.gone.iter().map(|(_, line)| line.clone()));
        let (in_transition, models) = self.director.in_transition();
        let (frame_times, latency_times, stage_times) = self.statistics.counts();
        let count = |bytes: &AtomicU64| bytes.load(Ordering::Relaxed);
        let tiles = self.statistics.bytes_from_boards;
        let (to_boards, from_boards) = (count(&self.traffic.to_boards), count(&self.traffic.from_boards));
        Live {
            now,
            frame: self.last_swap.as_ref().map(|swap| swap.frame),
            period: match self.config.mode {
                ClockMode::RealTime { period } => Some(period),
                ClockMode::LockStep => None,
            },
            divider: self.clock.divider(),
            scale: self.clock.scale(),
            is_paused: self.control.is_paused,
            debug: self.control.debug,
            lead: self.lead_line(),
            shown: self.control.shown,
            epoch: self.chain.epoch().0,
            wiring,
            row: self.chain.len(),
            views: self.director.views().to_vec(),
            layout: self.director.layout().to_vec(),
            views_revision: self.director.views_revision,
            boards,
            has_compositor: !self.compositors.is_empty(),
            display_factor: self.director.display_factor(),
            in_transition,
            models,
            totals: self.statistics.totals(),
            link_bytes: LinkBytes { to_boards, from_boards, tiles },
            scene_bytes: self.stream.catalogue().total(),
            frame_times,
            latency_times,
            stage_times,
            recent: self.traces.since(Time(now.0.saturating_sub(RECENT.as_nanos() as u64))),
            events: self.statistics.newest_events(EVENTS),
        }
    }

    fn state_of(&self, key: BoardKey, board: &Board) -> BoardState {
        let is_member = self.chain.active().is_some_and(|wiring| wiring.members.contains(&key));
        if board.is_held && !board.has_joined {
            BoardState::Out
        } else if board.is_leaving || board.is_held {
            BoardState::Leaving
        } else if !board.has_joined {
            BoardState::Loading
        } else if !is_member || !board.draws {
            BoardState::Joining
        } else if self.last_swap.as_ref().is_some_and(|swap| swap.boards.contains(&key)) {
            BoardState::Drawing
        } else {
            BoardState::Late
        }
    }
}
