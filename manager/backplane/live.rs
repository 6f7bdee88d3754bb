//! What the console is told of a rig at one moment. All of it is counts, names and shared frames: telling it costs the engine
//! microseconds, and whatever must be computed from it is computed by who asks.
#![cfg_attr(not(feature = "console"), allow(dead_code, reason = "only the console asks"))]

use super::statistics::{EventEntry, LinkBytes, STAGES, TimeCounts, Totals};
use super::trace::FrameTrace;
use proto::chain::Wiring;
use proto::debug::DebugPicture;
use proto::ids::{BoardKey, FrameNumber};
use proto::time::Time;
use proto::view::ViewSetup;
use serde::Serialize;
use std::sync::Arc;
use std::time::Duration;

/// What a board is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum BoardState {
    /// Connected, and being sent what it needs.
    Loading,
    /// In the row, under a wiring that isn't in effect yet.
    Joining,
    /// Its share was in the last swap.
    Drawing,
    /// Its share was not.
    Late,
    /// It draws until a wiring without it is in effect.
    Leaving,
    /// Taken out at the console; it is fed, and can be put back.
    Out,
    /// It went by itself.
    Left,
    /// Its link broke.
    Lost,
    /// It was put out.
    PutOut,
}

/// A board, there or gone.
#[derive(Clone, Debug)]
pub(crate) struct BoardLine {
    pub key: BoardKey,
    pub name: Arc<str>,
    pub state: BoardState,
    /// Why it is gone.
    pub why: String,
    /// Limit, held, peak, bytes.
    pub memory: Option<[u64; 3]>,
}

/// Which of two managers this is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct LeadLine {
    pub leads: bool,
    /// By which term it leads, or of the highest that it has heard of; 0: of none.
    pub term: u64,
    /// When it began to lead, or to stand by.
    pub since: Time,
    /// The other manager, if there is a link to it, and since when.
    pub other: Option<(Arc<str>, Time)>,
    /// For whom it stands by.
    pub of: Option<Arc<str>>,
}

/// See the module's head.
#[derive(Clone, Debug)]
pub(crate) struct Live {
    pub now: Time,
    /// The frame last swapped.
    pub frame: Option<FrameNumber>,
    /// Nominal; `None`: lock-step.
    pub period: Option<Duration>,
    pub divider: u32,
    /// Pixels of the picture, each way, that one pixel drawn stands for.
    pub scale: u32,
    pub is_paused: bool,
    pub debug: DebugPicture,
    pub lead: LeadLine,
    /// When a frame was last on the displays, or left as it was because nothing had changed.
    pub shown: Option<Time>,
    pub epoch: u64,
    /// The wiring in effect.
    pub wiring: Option<Wiring>,
    /// Boards that are to be in the row.
    pub row: usize,
    pub views: Vec<ViewSetup>,
    /// The same at full resolution: what the picture is made of.
    pub layout: Vec<ViewSetup>,
    pub views_revision: u64,
    /// Those that are there, as their links came up; then those that are gone.
    pub boards: Vec<BoardLine>,
    pub has_compositor: bool,
    pub display_factor: f64,
    pub in_transition: usize,
    pub models: usize,
    pub totals: Totals,
    pub link_bytes: LinkBytes,
    pub scene_bytes: u64,
    pub frame_times: TimeCounts,
    pub latency_times: TimeCounts,
    pub stage_times: [TimeCounts; STAGES.len()],
    /// The frames of the last second.
    pub recent: Vec<Arc<FrameTrace>>,
    pub events: Vec<EventEntry>,
}

/// What the console asks of a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Command {
    /// Open no more frames.
    Pause,
    /// Go on.
    Resume,
    /// Open one.
    Step,
    /// Take a board out of the row, and keep it out.
    TakeOut(BoardKey),
    /// Let it in again.
    PutBack(BoardKey),
    /// Share all views in this way.
    Mode(proto::view::Mode),
    /// Look at so many points of each pixel.
    Samples(proto::view::Samples),
    /// Draw that in place of the picture.
    Debug(DebugPicture),
}

/// Why a command isn't carried out; nothing has changed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum CommandError {
    #[error("no board with key {0} is connected")]
    NoBoard(u64),
    #[error("board {0} is the last in the row: without it there is no picture; put another in first")]
    LastBoard(Arc<str>),
    #[error("board {0} is leaving already")]
    Leaving(Arc<str>),
    #[error("board {0} has not been taken out")]
    NotOut(Arc<str>),
    #[error("the rig is not paused; pause it to go step by step")]
    NotPaused,
    #[error("this manager stands by for {0}, which leads: use the console there")]
    StandsBy(Arc<str>),
}
