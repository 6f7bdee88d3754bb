//! Times selections.

use super::check::{check, visible};
use super::field::{Field, PIECES, VISIBILITY, views};
use crate::cli::ListsArgs;
use crate::error::CommandError;
use ::bench::Spread;
use ::bench::lists::paper::{self, Ball, Object};
use ::bench::lists::{Change, Counted, Row, Stages, What, comparison};
use manager::select::{Dispatch, Selector, Sight, StageTimes, World, detail};
use proto::scene::Sphere;
use proto::view::View;
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

/// Frames before time counts: buffers grow.
const WARM_UP: u32 = 3;
/// Processors of the walks that are compared.
const WALKERS: [usize; 2] = [2, 4];

/// What the frames of a benchmark have in common.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setup {
    pub(super) lists: NonZeroUsize,
    pub(super) frames: u32,
    pub(super) least_elements: Option<f64>,
    pub(super) visibility: f64,
}

impl Setup {
    pub(super) fn new(args: &ListsArgs) -> Self {
        Self { lists: args.lists, frames: args.frames.get(), least_elements: Some(1.0), visibility: VISIBILITY }
    }

    pub(super) fn sight<'a>(&self, field: &Field, frame: u32, views: &'a [View]) -> Sight<'a> {
        Sight {
            eye: field.eye(frame, self.frames),
            views,
            visibility_m: Some(self.visibility),
            least_elements: self.least_elements,
            lists: self.lists,
        }
    }
}

fn failed(error: impl std::fmt::Display) -> CommandError {
    CommandError::said(error.to_string())
}

/// What the processor has given to this thread.
fn cpu_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// One selector over the frames of a flight. The first and the last answer are checked.
pub(super) fn frames(
    field: &mut Field,
    setup: &Setup,
    what: What,
    change: Change,
    processors: NonZeroUsize,
) -> Result<Row, CommandError> {
    let views = views();
    let mut selector = Selector::with_processors(processors, Dispatch::default()).map_err(failed)?;
    let mut times: Vec<(Duration, Duration, StageTimes)> = Vec::new();
    for frame in 0..setup.frames + WARM_UP {
        let eye = if change == Change::Eye { frame } else { setup.frames / 2 };
        field.set_frame(if change == Change::Nothing { 0 } else { frame });
        let sight = setup.sight(field, eye, &views);
        let (cpu, started) = (cpu_time(), Instant::now());
        selector.select_in(field, &sight);
        let (wall, cpu) = (started.elapsed(), cpu_time() - cpu);
        if frame >= WARM_UP {
            times.push((wall, cpu, selector.times()));
        }
        if frame == 0 || frame + 1 == setup.frames + WARM_UP {
            check(field, &sight, selector.found()).map_err(failed)?;
        }
    }
    let sight = setup.sight(field, setup.frames, &views);
    let in_view = if change == Change::Eye {
        visible(field, &Sight { least_elements: None, ..sight }).iter().map(Vec::len).sum()
    } else {
        0
    };
    let sum = |count: fn(&manager::select::Counters) -> u64| {
        selector.found().iter().map(|found| count(&found.counters)).sum()
    };
    let counted = Counted {
        balls: sum(|c| c.branches_tested + c.objects_tested + c.subobjects_tested),
        measured: sum(|c| c.objects_measured),
        sorted: sum(|c| c.subobjects_visible),
    };
    let count = field.blocks().count();
    let is_headline =
        (what, change, processors) == (What::Frame, Change::Eye, NonZeroUsize::MIN) && setup.least_elements.is_some();
    let walls: Vec<f64> = times.iter().map(|(wall, ..)| ms(*wall)).collect();
    let cpus: Vec<f64> = times.iter().map(|(_, cpu, _)| ms(*cpu)).collect();
    times.sort_by_key(|(wall, ..)| *wall);
    let middle = times[(times.len() - 1) / 2].2;
    Ok(Row {
        what,
        objects: count,
        change,
        processors: processors.get(),
        lists: setup.lists.get(),
        variant: None,
        least_elements: setup.least_elements,
        ms: Spread::of(&walls),
        cpu_ms: (processors == NonZeroUsize::MIN).then(|| Spread::of(&cpus)),
        stage_ms: Some(Stages {
            walk: ms(middle.walk),
            mark: ms(middle.mark),
            gather: ms(middle.gather),
            sort: ms(middle.sort),
            merge: ms(middle.merge),
        }),
        in_view: in_view as u64,
        visible: sum(|c| c.objects_visible),
        subobjects: sum(|c| c.subobjects_visible),
        overlapping: sum(|c| c.objects_overlapping),
        groups: sum(|c| c.groups),
        bytes_per_object: (field.blocks().bytes() + selector.bytes()) as f64 / count as f64,
        operations: is_headline.then(|| comparison(&counted, count, count as f64 * 0.06)),
    })
}

fn paper_ball(ball: Sphere) -> Ball {
    Ball { centre: ball.centre.to_array(), radius: ball.radius }
}

/// The paper's plain algorithm over the same views, once. Its visible objects, groups and lists are what ours are checked against elsewhere; here it is timed.
pub(super) fn plain(field: &mut Field, setup: &Setup) -> Row {
    let views = views();
    field.set_frame(0);
    let sight = setup.sight(field, 0, &views);
    let count = field.blocks().count();
    let all: Vec<Object> = (0..count as u32)
        .map(|object| Object {
            ball: paper_ball(field.ball(object)),
            subobjects: (object * PIECES..(object + 1) * PIECES)
                .map(|id| (id, paper_ball(field.piece_ball(id))))
                .collect(),
        })
        .collect();
    let elements = detail::display_factor(&views);
    let started = Instant::now();
    let (mut shown, mut groups, mut overlapping, mut subobjects) = (0, 0, 0, 0);
    for view in &views {
        let frustum = manager::select::Frustum::new(sight.eye, view, sight.visibility_m);
        let is_visible = |object: usize| {
            super::check::is_visible(&frustum, field.ball(object as u32), sight.least_elements, elements)
        };
        let is_seen = |object: usize, piece: usize| {
            frustum.ball(field.piece_ball(object as u32 * PIECES + piece as u32)) != manager::select::Where::Outside
        };
        let found = paper::plain(&all, sight.eye.position.to_array(), is_visible, is_seen);
        shown += found.objects.len();
        let several = || found.groups.iter().filter(|group| group.len() > 1);
        groups += several().count();
        overlapping += several().map(Vec::len).sum::<usize>();
        subobjects += found.group_lists.iter().map(Vec::len).sum::<usize>();
    }
    let time = ms(started.elapsed());
    Row {
        what: What::Plain,
        objects: count,
        change: Change::Eye,
        processors: 1,
        lists: setup.lists.get(),
        variant: None,
        least_elements: setup.least_elements,
        ms: Spread::of(&[time]),
        cpu_ms: None,
        stage_ms: None,
        in_view: 0,
        visible: shown as u64,
        subobjects: subobjects as u64,
        overlapping: overlapping as u64,
        groups: groups as u64,
        bytes_per_object: 0.0,
        operations: None,
    }
}

/// The walk by each way to hand out nodes, turn by turn, frame for frame; each finds the same.
pub(super) fn walks(field: &mut Field, setup: &Setup, tree: &str, ways: &[Dispatch]) -> Result<Vec<Row>, CommandError> {
    let views = views();
    let setup = Setup { lists: NonZeroUsize::MIN, ..*setup };
    let mut entrants = Vec::new();
    let one = Selector::new();
    entrants.push((one, 1, "one processor".to_owned(), Vec::new()));
    for processors in WALKERS {
        for &way in ways {
            let count = NonZeroUsize::new(processors).unwrap_or(NonZeroUsize::MIN);
            let selector = Selector::with_processors(count, way).map_err(failed)?;
            entrants.push((selector, processors, format!("{way:?}").to_lowercase(), Vec::new()));
        }
    }
    for frame in 0..setup.frames + WARM_UP {
        field.set_frame(frame);
        let sight = setup.sight(field, frame, &views);
        let mut first: Option<Vec<manager::select::Selection>> = None;
        for (selector, _, name, times) in &mut entrants {
            selector.select_in(field, &sight);
            if frame >= WARM_UP {
                times.push(ms(selector.times().walk));
            } else {
                match &first {
                    None => first = Some(selector.found().to_vec()),
                    Some(first) if first == selector.found() => {}
                    Some(_) => {
                        return Err(CommandError::said(format!("{name} finds something else than one processor does")));
                    }
                }
            }
        }
    }
    let count = field.blocks().count();
    let rows = entrants.iter().map(|(selector, processors, name, times)| Row {
        what: What::Walk,
        objects: count,
        change: Change::Eye,
        processors: *processors,
        lists: 1,
        variant: Some(format!("{tree} tree, {name}, nodes {:?}", selector.looked())),
        least_elements: setup.least_elements,
        ms: Spread::of(times),
        cpu_ms: None,
        stage_ms: None,
        in_view: 0,
        visible: selector.found().iter().map(|found| found.counters.objects_visible).sum(),
        subobjects: selector.found().iter().map(|found| found.counters.subobjects_visible).sum(),
        overlapping: 0,
        groups: 0,
        bytes_per_object: (field.blocks().bytes() + selector.bytes()) as f64 / count as f64,
        operations: None,
    });
    Ok(rows.collect())
}
