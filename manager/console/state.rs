//! What a viewer is told four times a second: computed here, from what the engine said, off its thread.

use crate::backplane::live::{BoardLine, BoardState, LeadLine, Live};
use crate::backplane::statistics::{EventEntry, Totals};
use proto::debug::LegendEntry;
use proto::frame::tile_grid;
use proto::ids::{BoardId, BoardKey};
use proto::share::{Part, shares};
use proto::time::Time;
use proto::view::{Mode, ViewSetup};
use serde::Serialize;
use std::collections::BTreeMap;

/// What the rig as a whole is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Doing {
    /// Another manager leads.
    StandsBy,
    /// No board is in the row.
    NoBoards,
    /// There are boards, and nobody to show what they draw.
    NoCompositor,
    /// Somebody at a console holds it.
    Paused,
    /// Frames are shown.
    Running,
    /// Nothing has been shown yet, or not for long.
    Waiting,
}

/// A board, as its place on the page shows it.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Board {
    pub(super) key: u64,
    pub(super) name: String,
    /// Its place in the wiring in effect.
    pub(super) id: Option<usize>,
    state: BoardState,
    why: String,
    /// How much of all views it draws, %.
    pub(super) share_percent: f64,
    /// Mean over the last second of what drawing took, ms.
    draw_ms: Option<f64>,
    /// Likewise with comparing and sending tiles.
    pub(super) frame_ms: Option<f64>,
    /// What drawing takes of a frame's time, %.
    pub(super) load_percent: Option<f64>,
    pub(super) memory_limit_bytes: Option<u64>,
    pub(super) memory_held_bytes: Option<u64>,
}

impl Board {
    /// Whether its share was in the last swap.
    pub(super) fn is_drawing(&self) -> bool {
        self.state == BoardState::Drawing
    }
}

/// A view's place in the stitched picture.
#[derive(Clone, Debug, Serialize)]
struct View {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
    samples: String,
    mode: &'static str,
}

/// What boards draw in place of the picture, and what its colours mean.
#[derive(Clone, Debug, Serialize)]
struct Debug {
    picture: &'static str,
    legend: &'static [LegendEntry],
}

/// Which of two managers this is.
#[derive(Clone, Debug, Serialize)]
struct Lead {
    leads: bool,
    /// For whom it stands by.
    of: Option<String>,
    term: u64,
    /// When it began to lead, or to stand by.
    since_s: f64,
    /// Where the other manager is, and since when there is a link to it.
    other: Option<String>,
    other_since_s: Option<f64>,
}

/// See the module's head.
#[derive(Clone, Debug, Serialize)]
pub(super) struct State {
    time_s: f64,
    doing: Doing,
    lead: Lead,
    debug: Debug,
    frame: Option<u64>,
    /// Nominal; `None`: lock-step, where frames come as poses do.
    rate_hz: Option<f64>,
    divider: u32,
    resolution_divider: u32,
    /// How long a frame may take; `None`: as long as it likes.
    pub(super) deadline_ms: Option<f64>,
    is_paused: bool,
    has_compositor: bool,
    epoch: u64,
    views_revision: u64,
    size: [u32; 2],
    views: Vec<View>,
    pub(super) boards: Vec<Board>,
    /// The factor K of detail.
    display_factor: f64,
    models_in_transition: usize,
    models: usize,
    scene_bytes: u64,
    totals: Totals,
    events: Vec<EventEntry>,
}

pub(super) fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Interleave => "interleave",
        Mode::Region => "region",
    }
}

impl State {
    pub(super) fn of(live: &Live) -> Self {
        let deadline_s = live.period.map(|period| (period * live.divider).as_secs_f64());
        let (places, size) = ViewSetup::layout(&live.layout).unwrap_or_default();
        let view = |(setup, [x, y]): (&ViewSetup, [u32; 2])| View {
            x,
            y,
            width: setup.view.width,
            height: setup.view.height,
            samples: setup.view.samples.to_string(),
            mode: mode_name(setup.mode),
        };
        Self {
            time_s: seconds(live.now),
            doing: doing(live),
            lead: lead(live),
            debug: Debug { picture: live.debug.name(), legend: live.debug.legend() },
            frame: live.frame.map(|frame| frame.0),
            rate_hz: live.period.map(|period| (1e3 / period.as_secs_f64()).round() / 1e3),
            divider: live.divider,
            resolution_divider: live.scale,
            deadline_ms: deadline_s.map(|s| s * 1e3),
            is_paused: live.is_paused,
            has_compositor: live.has_compositor,
            epoch: live.epoch,
            views_revision: live.views_revision,
            size,
            views: live.layout.iter().zip(places).map(view).collect(),
            boards: boards(live, deadline_s),
            display_factor: (live.display_factor * 10.0).round() / 10.0,
            models_in_transition: live.in_transition,
            models: live.models,
            scene_bytes: live.scene_bytes,
            totals: live.totals,
            events: live.events.clone(),
        }
    }
}

/// To the millisecond.
fn seconds(at: Time) -> f64 {
    (at.0 as f64 / 1e6).round() / 1e3
}

fn lead(live: &Live) -> Lead {
    let LeadLine { leads, term, since, other, of } = &live.lead;
    Lead {
        leads: *leads,
        of: of.as_ref().map(ToString::to_string),
        term: *term,
        since_s: seconds(*since),
        other: other.as_ref().map(|(at, _)| at.to_string()),
        other_since_s: other.as_ref().map(|(_, since)| seconds(*since)),
    }
}

fn doing(live: &Live) -> Doing {
    let is_shown = live.shown.is_some_and(|at| live.now.since(at) < super::health::shown_within(live));
    match () {
        () if !live.lead.leads => Doing::StandsBy,
        () if live.row == 0 => Doing::NoBoards,
        () if !live.has_compositor => Doing::NoCompositor,
        () if live.is_paused => Doing::Paused,
        () if is_shown => Doing::Running,
        () => Doing::Waiting,
    }
}

/// What each board of the wiring in effect draws of all views, 0 to 1.
pub(super) fn shares_of(live: &Live) -> BTreeMap<BoardKey, f64> {
    let Some(wiring) = &live.wiring else { return BTreeMap::new() };
    let tiles = |part: &Part, setup: &ViewSetup| part.tiles(setup.view.width, setup.view.height).count();
    let all = |setup: &ViewSetup| {
        let (columns, rows) = tile_grid(setup.view.width, setup.view.height);
        columns as usize * rows as usize
    };
    let total: usize = live.views.iter().map(all).sum();
    let of = |id: usize| {
        let own = shares(BoardId(id as u32), &wiring.weights, &live.views);
        own.iter().filter_map(|share| Some(tiles(&share.part, live.views.get(share.view.0 as usize)?))).sum::<usize>()
    };
    wiring.members.iter().enumerate().map(|(id, key)| (*key, of(id) as f64 / total.max(1) as f64)).collect()
}

fn boards(live: &Live, deadline_s: Option<f64>) -> Vec<Board> {
    let shares = shares_of(live);
    // Drawing and all of it, s, and frames, over the last second.
    let mut took: BTreeMap<BoardKey, (f64, f64, u32)> = BTreeMap::new();
    let (mut frames, mut frame_s) = (0u32, 0.0);
    for trace in &live.recent {
        frames += 1;
        frame_s += trace.swapped.map_or(0.0, |at| at.since(trace.opened).as_secs_f64());
        for drawn in &trace.boards {
            let (drawing, whole, count) = took.entry(drawn.key).or_default();
            let s = drawn.report.drawing().as_secs_f64();
            *drawing += s;
            *whole += s + drawn.report.transfer_ns as f64 / 1e9;
            *count += 1;
        }
    }
    // Where nothing is late a board is as busy as it is needed.
    let frame_s = deadline_s.unwrap_or(frame_s / f64::from(frames.max(1)));
    let place = |key| live.wiring.as_ref()?.members.iter().position(|member| *member == key);
    let rounded = |value: f64, steps: f64| (value * steps).round() / steps;
    let board = |line: &BoardLine| {
        let is_gone = matches!(line.state, BoardState::Left | BoardState::Lost | BoardState::PutOut);
        let took = took.get(&line.key).filter(|_| !is_gone);
        let mean = |sum: f64, count: u32| sum / f64::from(count.max(1));
        Board {
            key: line.key.0,
            name: line.name.to_string(),
            id: place(line.key).filter(|_| !is_gone),
            state: line.state,
            why: line.why.clone(),
            share_percent: rounded(shares.get(&line.key).filter(|_| !is_gone).unwrap_or(&0.0) * 100.0, 10.0),
            draw_ms: took.map(|(drawing, _, count)| rounded(mean(*drawing, *count) * 1e3, 100.0)),
            frame_ms: took.map(|(_, whole, count)| rounded(mean(*whole, *count) * 1e3, 100.0)),
            load_percent: took
                .filter(|_| frame_s > 0.0)
                .map(|(drawing, _, count)| rounded(mean(*drawing, *count) / frame_s * 100.0, 1.0)),
            memory_limit_bytes: line.memory.map(|[limit, _, _]| limit),
            memory_held_bytes: line.memory.map(|[_, held, _]| held),
        }
    };
    let mut boards: Vec<_> = live.boards.iter().map(board).collect();
    boards.sort_by_key(|board| (board.id.is_none(), board.id, board.key));
    boards
}
