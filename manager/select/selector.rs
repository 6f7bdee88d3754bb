//! The steps of a selection, one after another, and what is kept from one to the next.

use super::cost::CostModel;
use super::dispatch::{Crossbar, Dispatch};
use super::eyepoint::{Eyepoint, Objects, eyepoints};
use super::frustum::Frustum;
use super::gather::{Gather, Gathered};
use super::moving::Moving;
use super::overlap::Overlaps;
use super::sort::{self, Entry, PowerRange, Steps, entry, ordered};
use super::spread::{Plan, Seen};
use super::walk::{Flags, Found, Node, SeenBlock, SeenPiece, Walk};
use super::world::{Placed, World};
use super::{Counters, Selection, Sight, detail, merge, power};
use crate::scene::blocks::BLOCK;
use crate::scene::{Entities, Scene};
use fearless_simd::Level;
use pool::Pool;
use proto::frame::VersionWeights;
use proto::limits;
use proto::view::{Pose, View};
use std::io;
use std::num::NonZeroUsize;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Blocks that a processor takes at a time to gather from.
const BLOCKS_AT_A_TIME: usize = 16;

/// How long the steps of the last selection took; nothing for steps that were not needed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StageTimes {
    /// The tree, and what moved.
    pub walk: Duration,
    /// Overlaps, groups and their mixing.
    pub mark: Duration,
    /// Powers of subobjects.
    pub gather: Duration,
    /// Sorting them.
    pub sort: Duration,
    /// Merging what each processor sorted.
    pub merge: Duration,
}

/// All that a selection depends on.
#[derive(Clone, Debug, PartialEq)]
struct Asked {
    serial: u64,
    eye: Pose,
    views: Vec<View>,
    visibility_m: Option<f64>,
    least_elements: Option<f64>,
    lists: NonZeroUsize,
    shown_set: u64,
    moved_set: u64,
    moved_places: u64,
}

/// A processor's memory.
#[derive(Clone, Debug, Default)]
struct Processor {
    found: Found,
    gathered: Gathered,
}

/// Selects; holds working memory from one call to the next, and the last answer.
#[derive(Debug)]
pub struct Selector {
    level: Level,
    dispatch: Dispatch,
    pool: Option<Pool>,
    processors: Vec<Processor>,
    crossbar: Crossbar,
    asked: Option<Asked>,
    frusta: Vec<Frustum>,
    eyepoints: Vec<Eyepoint>,
    flags: Flags,
    /// By block.
    moved: Vec<Objects>,
    /// By block; empty if there are none.
    conditional: Vec<Objects>,
    /// Those marked in `moved`, by slot.
    marked: Vec<u32>,
    /// Blocks of which something is seen, eyepoint after eyepoint, the nearest first.
    blocks: Vec<SeenBlock>,
    /// By eyepoint: its stretch of `blocks`.
    stretches: Vec<Range<usize>>,
    /// By eyepoint: the powers in these.
    ranges: Vec<PowerRange>,
    /// By eyepoint.
    steps: Vec<Steps>,
    /// By view: what the walk counted.
    walked: Vec<Counters>,
    moving: Moving,
    overlaps: Overlaps,
    plan: Plan,
    /// By view, by list: of what moved.
    moved_lists: Vec<Vec<Entry>>,
    unsorted: Vec<Entry>,
    sorting: sort::Scratch,
    merging: merge::Scratch,
    found: Vec<Selection>,
    shown: Vec<u16>,
    shown_before: Vec<u16>,
    shown_set: u64,
    times: StageTimes,
}

impl Default for Selector {
    fn default() -> Self {
        Self::new()
    }
}

impl Selector {
    /// One processor, which is the caller's thread.
    pub fn new() -> Self {
        Self {
            level: Level::new(),
            dispatch: Dispatch::default(),
            pool: None,
            processors: vec![Processor::default()],
            crossbar: Crossbar::default(),
            asked: None,
            frusta: Vec::new(),
            eyepoints: Vec::new(),
            flags: Flags::default(),
            moved: Vec::new(),
            conditional: Vec::new(),
            marked: Vec::new(),
            blocks: Vec::new(),
            stretches: Vec::new(),
            ranges: Vec::new(),
            steps: Vec::new(),
            walked: Vec::new(),
            moving: Moving::default(),
            overlaps: Overlaps::default(),
            plan: Plan::default(),
            moved_lists: Vec::new(),
            unsorted: Vec::new(),
            sorting: sort::Scratch::default(),
            merging: merge::Scratch::default(),
            found: Vec::new(),
            shown: Vec::new(),
            shown_before: Vec::new(),
            shown_set: 0,
            times: StageTimes::default(),
        }
    }

    /// So many processors, at most 64, each a thread of its own, unless it is one.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn with_processors(count: NonZeroUsize, dispatch: Dispatch) -> io::Result<Self> {
        let count = count.min(PROCESSORS_MAX);
        let pool = if count.get() > 1 {
            Some(Pool::new(count, "object-processor", |_| pool::turns::go_along())?)
        } else {
            None
        };
        Ok(Self { pool, dispatch, processors: vec![Processor::default(); count.get()], ..Self::new() })
    }

    /// For tests and benchmarks: which instruction set to use. All give the same lists.
    pub fn set_level(&mut self, level: Level) {
        self.level = level;
    }

    /// What `sight` shows of `scene`, `entities` being where they are. What has no weight is left out; a model without `weights` shows its finest
    /// version alone. Returns whether anything may have changed since the last call: if not, [`Self::found`] is what it was, and nothing was done.
    ///
    /// Nothing that could colour a sample is left out, unless `sight` asks for that; something that can't may be in.
    pub fn select(
        &mut self,
        scene: &Scene,
        entities: &Entities,
        weights: &[VersionWeights],
        sight: &Sight<'_>,
    ) -> bool {
        let mut shown = std::mem::take(&mut self.shown);
        std::mem::swap(&mut shown, &mut self.shown_before);
        shown.clear();
        shown.resize(scene.models.len(), 1);
        for model in weights {
            if let Some(shown) = shown.get_mut(model.model.0 as usize) {
                let weights = model.weights.iter().take(limits::VERSIONS_MAX).enumerate();
                *shown = weights.fold(0, |bits, (version, &weight)| bits | (u16::from(weight > 0.0) << version));
            }
        }
        self.shown_set += u64::from(shown != self.shown_before);
        let placed = Placed { scene, entities, shown: &shown, shown_set: self.shown_set };
        let is_new = self.select_in(&placed, sight);
        self.shown = shown;
        is_new
    }

    /// What the last selection found, by view.
    pub fn found(&self) -> &[Selection] {
        &self.found
    }

    /// What the last selection found, by view. Whatever is taken out of it comes back only with the next answer that is new.
    pub fn found_mut(&mut self) -> &mut [Selection] {
        &mut self.found
    }

    /// How long the steps of the last selection took.
    pub fn times(&self) -> StageTimes {
        self.times
    }

    /// Nodes that each processor looked at in the last walk.
    pub fn looked(&self) -> Vec<u64> {
        self.crossbar.looked().collect()
    }

    /// The groups of more than one object of the view that was planned last.
    #[cfg(test)]
    pub(super) fn last_groups<W: World>(&self, world: &W) -> Vec<Vec<u32>> {
        let slots = world.blocks().count();
        let object = |node: u32| match (node as usize).checked_sub(slots) {
            None => world.blocks().object(node as usize),
            Some(mover) => world.moved_object(self.moving.movers[mover].moved as usize),
        };
        let sorted = |group: Vec<u32>| {
            let mut group: Vec<u32> = group.into_iter().map(object).collect();
            group.sort_unstable();
            group
        };
        self.plan.last_groups().map(sorted).collect()
    }

    /// Bytes that are kept for the objects of a database, beside the database.
    pub fn bytes(&self) -> usize {
        let masks = (self.moved.capacity() + self.conditional.capacity()) * size_of::<Objects>();
        masks + self.flags.bytes() + self.overlaps.bytes() + self.plan.bytes()
    }

    /// [`Self::select`] in any world.
    pub fn select_in<W: World>(&mut self, world: &W, sight: &Sight<'_>) -> bool {
        assert!(sight.views.len() <= limits::VIEWS_MAX, "a frame has {} views at most", limits::VIEWS_MAX);
        self.times = StageTimes::default();
        let (at_rest_is_old, all_is_old) = self.ask(world, sight);
        if all_is_old {
            return false;
        }
        let elements = detail::display_factor(sight.views);
        let reach = sight.least_elements.map(|least| elements / least);
        let started = Instant::now();
        if !at_rest_is_old {
            self.walk(world, sight, reach);
        }
        self.follow(world, reach, sight.views.len(), at_rest_is_old);
        let walked = Instant::now();
        if sight.lists.get() > 1 {
            self.spread(world, sight, elements);
        }
        let marked = Instant::now();
        if !at_rest_is_old {
            self.gather(world, sight);
        }
        let gathered = Instant::now();
        self.sort_moved(world, sight.lists.get() * sight.views.len(), sight.lists.get());
        let sorted = Instant::now();
        self.merge(world, sight);
        // Sorting goes on while gathering, in each processor.
        let sorting = self.processors.iter().map(|processor| processor.gathered.sorting).max().unwrap_or_default();
        let sorting = if at_rest_is_old { Duration::ZERO } else { sorting.min(gathered - marked) };
        self.times = StageTimes {
            walk: walked - started,
            mark: marked - walked,
            gather: (gathered - marked) - sorting,
            sort: (sorted - gathered) + sorting,
            merge: sorted.elapsed(),
        };
        true
    }

    /// Takes note of what is asked; says whether it is what was asked last, but for what moved, and altogether.
    fn ask<W: World>(&mut self, world: &W, sight: &Sight<'_>) -> (bool, bool) {
        let (serial, moved_set, shown_set) = (world.blocks().serial(), world.moved_set(), world.shown_set());
        let moved_places = world.moved_places();
        let last = self.asked.as_ref();
        let is_same_scene = last.is_some_and(|last| last.serial == serial);
        let is_same = last.is_some_and(|last| {
            let look = (last.eye, &last.views[..]) == (sight.eye, sight.views);
            let limits = (last.visibility_m, last.least_elements, last.lists);
            let sets = (last.serial, last.shown_set, last.moved_set) == (serial, shown_set, moved_set);
            look && sets && limits == (sight.visibility_m, sight.least_elements, sight.lists)
        });
        let is_all = is_same && last.is_some_and(|last| last.moved_places == moved_places);
        if !is_same_scene {
            self.take_scene(world);
        }
        if !is_same_scene || last_set(&self.asked) != Some(moved_set) {
            self.mark_moved(world);
        }
        let mut views = self.asked.take().map(|asked| asked.views).unwrap_or_default();
        views.clear();
        views.extend_from_slice(sight.views);
        let Sight { eye, visibility_m, least_elements, lists, .. } = *sight;
        self.asked =
            Some(Asked { serial, eye, views, visibility_m, least_elements, lists, shown_set, moved_set, moved_places });
        // With several lists, what moved decides which list others are in.
        (is_same && sight.lists.get() == 1, is_all)
    }

    fn take_scene<W: World>(&mut self, world: &W) {
        let blocks = world.blocks();
        self.blocks.clear();
        self.flags = Flags::default();
        self.moved.clear();
        self.moved.resize(blocks.block_count(), 0);
        self.marked.clear();
        self.conditional.clear();
        world.conditional(&mut |object| {
            self.conditional.resize(blocks.block_count(), 0);
            let slot = blocks.slot(object);
            self.conditional[slot / BLOCK] |= 1 << (slot % BLOCK);
        });
    }

    fn mark_moved<W: World>(&mut self, world: &W) {
        for slot in self.marked.drain(..) {
            self.moved[slot as usize / BLOCK] = 0;
        }
        for moved in 0..world.moved_count() {
            let slot = world.blocks().slot(world.moved_object(moved));
            self.moved[slot / BLOCK] |= 1 << (slot % BLOCK);
            self.marked.push(slot as u32);
        }
    }

    /// Walks the tree for each eyepoint.
    fn walk<W: World>(&mut self, world: &W, sight: &Sight<'_>, reach: Option<f64>) {
        let (views, blocks) = (sight.views.len(), world.blocks());
        for seen in self.blocks.drain(..) {
            self.flags.clear(self.walked.len(), seen.block as usize);
        }
        self.flags.fit(views, blocks.block_count());
        eyepoints(sight.eye, sight.views, sight.visibility_m, &mut self.frusta, &mut self.eyepoints);
        self.stretches.clear();
        self.ranges.clear();
        self.walked.clear();
        self.walked.resize(views, Counters::default());
        self.processors.iter_mut().for_each(|processor| processor.found.clear(views));
        for eyepoint in &self.eyepoints {
            let from = self.blocks.len();
            if !blocks.tree.branches.is_empty() {
                let walk = Walk {
                    world,
                    apex: eyepoint.apex,
                    frusta: &self.frusta,
                    reach,
                    level: self.level,
                    moved: &self.moved,
                    conditional: &self.conditional,
                    flags: &self.flags,
                };
                let look = |processor: &mut Processor, node, point: &mut dyn FnMut(Node)| {
                    walk.look(&mut processor.found, node, point);
                };
                let root = Node::root(eyepoint.views);
                self.crossbar.run(self.dispatch, self.pool.as_mut(), &mut self.processors, root, look);
            }
            let mut range = PowerRange::NONE;
            for Processor { found, .. } in &mut self.processors {
                self.blocks.append(&mut found.blocks);
                range = range.and(std::mem::replace(&mut found.range, PowerRange::NONE));
            }
            self.ranges.push(range);
            self.blocks[from..].sort_unstable();
            self.stretches.push(from..self.blocks.len());
        }
        for counters in self.processors.iter().map(|processor| &processor.found.counters) {
            for (sum, counters) in self.walked.iter_mut().zip(counters) {
                sum.add(counters);
            }
        }
    }

    /// Asks what moved, and finds the range of powers of all that is seen.
    fn follow<W: World>(&mut self, world: &W, reach: Option<f64>, views: usize, at_rest_is_old: bool) {
        self.found.resize_with(views, Selection::default);
        for (found, walked) in self.found.iter_mut().zip(&self.walked) {
            found.counters = *walked;
        }
        let mut counters = [Counters::default(); limits::VIEWS_MAX];
        self.moving.clear();
        if !at_rest_is_old {
            self.steps.clear();
        }
        for (at, eyepoint) in self.eyepoints.iter().enumerate() {
            let from = self.moving.movers.len();
            self.moving.find(world, self.level, eyepoint, &self.frusta, reach, &mut counters[..views]);
            // What is kept was gathered with the steps of its frame; what moved beyond their range has the first or the last of them.
            if !at_rest_is_old {
                let movers = self.moving.movers[from..].iter();
                let range = movers.fold(self.ranges[at], |range, mover| range.with(mover.ball, eyepoint.apex));
                self.steps.push(Steps::over(range.least, range.most));
            }
        }
        for (found, counters) in self.found.iter_mut().zip(&counters) {
            found.counters.add(counters);
        }
    }

    /// Marks, groups and mixes.
    fn spread<W: World>(&mut self, world: &W, sight: &Sight<'_>, elements: f64) {
        let (views, movers) = (sight.views.len(), &self.moving.movers[..]);
        self.overlaps.find(self.level, world.blocks(), &self.flags, views, movers);
        let seen = Seen { blocks: world.blocks(), flags: &self.flags, model: CostModel::MEASURED, elements, movers };
        self.plan.begin(self.level, &seen, views, sight.lists);
        for ((eyepoint, &steps), stretch) in self.eyepoints.iter().zip(&self.steps).zip(&self.stretches) {
            self.plan.add(&seen, eyepoint, steps, &self.blocks[stretch.clone()], &self.overlaps);
        }
        for (found, [overlapping, groups]) in self.found.iter_mut().zip(&self.plan.marked) {
            (found.counters.objects_overlapping, found.counters.groups) = (*overlapping, *groups);
        }
    }

    /// Gathers what is seen of objects at rest.
    fn gather<W: World>(&mut self, world: &W, sight: &Sight<'_>) {
        let (blocks, lists) = (world.blocks(), sight.lists.get());
        let plan = (lists > 1).then_some(&self.plan);
        let gather = Gather { blocks, flags: &self.flags, level: self.level, plan, lists };
        for Processor { gathered, .. } in &mut self.processors {
            gathered.clear(lists * sight.views.len());
        }
        let (eyepoints, steps) = (&self.eyepoints, &self.steps);
        let of_view = |view: u32| {
            let at = eyepoints.iter().position(|eyepoint| eyepoint.views >> view & 1 == 1);
            let at = at.expect("each view has an eyepoint");
            (&eyepoints[at], steps[at])
        };
        // What was asked one by one, where it was found.
        for Processor { found, gathered, .. } in &mut self.processors {
            for &SeenPiece { view, slot, place } in &found.pieces {
                let (eyepoint, steps) = of_view(view);
                let (slot, place) = (slot as usize, place as usize);
                let list =
                    plan.map_or(0, |plan| plan.list_of_slot(view as usize, slot, blocks.ball(slot), eyepoint, steps));
                let step = steps.of(power(eyepoint.apex, blocks.piece_ball(slot, place)));
                gathered.lists[view as usize * lists + list].push(entry(step, blocks.id(slot, place)));
            }
        }
        let powers = Powers { world, eyepoints: &self.eyepoints };
        let power = |view: usize, id: u32| powers.of(view, id);
        for ((eyepoint, &steps), stretch) in self.eyepoints.iter().zip(&self.steps).zip(&self.stretches) {
            let seen = &self.blocks[stretch.clone()];
            let next = AtomicUsize::new(0);
            each(&mut self.pool, &mut self.processors, |processor| {
                loop {
                    let from = next.fetch_add(BLOCKS_AT_A_TIME, Ordering::Relaxed);
                    let Some(rest) = seen.get(from..).filter(|rest| !rest.is_empty()) else { break };
                    let part = &rest[..rest.len().min(BLOCKS_AT_A_TIME)];
                    gather.blocks(&mut processor.gathered, eyepoint, steps, part, &power);
                }
            });
        }
        let outputs = lists * sight.views.len();
        each(&mut self.pool, &mut self.processors, |processor| processor.gathered.finish(outputs, lists, power));
        self.make_room(outputs);
    }

    /// Gives every processor the room that all of them needed together: who does what is different the next time, and then nobody is to ask for memory.
    fn make_room(&mut self, outputs: usize) {
        if self.processors.len() == 1 {
            return;
        }
        let sum = |count: &dyn Fn(&Processor) -> usize| self.processors.iter().map(count).sum::<usize>();
        let (blocks, pieces) = (self.blocks.len(), sum(&|processor| processor.found.pieces.len()));
        let steps = self.processors.iter().map(|processor| processor.gathered.steps_room()).max().unwrap_or(0);
        self.processors.iter_mut().for_each(|processor| {
            processor.found.make_room(blocks, pieces);
            processor.gathered.make_room_for_steps(steps);
        });
        for output in 0..outputs {
            let entries = self.processors.iter().map(|processor| processor.gathered.lists[output].sorted.len()).sum();
            self.processors.iter_mut().for_each(|processor| processor.gathered.make_room(output, entries));
        }
    }

    /// Sorts what moved.
    fn sort_moved<W: World>(&mut self, world: &W, outputs: usize, lists: usize) {
        self.moved_lists.resize_with(outputs.max(self.moved_lists.len()), Vec::new);
        self.moved_lists.iter_mut().for_each(Vec::clear);
        let powers = Powers { world, eyepoints: &self.eyepoints };
        for piece in &self.moving.pieces {
            let (view, mover) = (piece.view as usize, &self.moving.movers[piece.mover as usize]);
            let at = powers.eyepoint_of(view);
            let moved = mover.moved as usize;
            let step =
                self.steps[at].of(power(self.eyepoints[at].apex, world.moved_piece_ball(moved, piece.piece as usize)));
            let id = world.first_piece(world.moved_object(moved)) + piece.piece;
            let list = if lists > 1 { usize::from(self.plan.movers[view][piece.mover as usize]) } else { 0 };
            self.moved_lists[view * lists + list].push(entry(step, id));
        }
        for (output, list) in self.moved_lists[..outputs].iter_mut().enumerate() {
            self.unsorted.clear();
            self.unsorted.append(list);
            sort::append(&mut self.unsorted, &mut self.sorting, |id| powers.of(output / lists, id), list);
        }
    }

    /// Brings together what processors sorted and what moved.
    fn merge<W: World>(&mut self, world: &W, sight: &Sight<'_>) {
        let lists = sight.lists.get();
        let powers = Powers { world, eyepoints: &self.eyepoints };
        let all = world.blocks();
        for (view, found) in self.found.iter_mut().enumerate() {
            found.subobjects.clear();
            found.ends.clear();
            found.costs.clear();
            if lists > 1 {
                found.costs.extend_from_slice(&self.plan.costs[view * lists..(view + 1) * lists]);
            }
            for list in 0..lists {
                let output = view * lists + list;
                let mut runs: [&[Entry]; PROCESSORS_MAX.get() + 1] = [&[]; PROCESSORS_MAX.get() + 1];
                let mut count = 0;
                let gathered = self.processors.iter().map(|processor| &processor.gathered.lists[output].sorted);
                for run in gathered.chain([&self.moved_lists[output]]).filter(|run| !run.is_empty()) {
                    runs[count] = run;
                    count += 1;
                }
                let power = |id| powers.of(view, id);
                merge::merge(&runs[..count], &mut self.merging, power, &mut found.subobjects);
                found.ends.push(found.subobjects.len());
            }
            let counters = &mut found.counters;
            counters.objects_culled = all.count() as u64 - counters.objects_visible;
            counters.subobjects_visible = found.subobjects.len() as u64;
            counters.subobjects_culled = all.piece_count() as u64 - counters.subobjects_visible;
        }
    }
}

/// Most processors: what a merge has room for.
const PROCESSORS_MAX: NonZeroUsize = NonZeroUsize::new(64).expect("not 0");

fn last_set(asked: &Option<Asked>) -> Option<u64> {
    asked.as_ref().map(|asked| asked.moved_set)
}

/// Lets every processor do `work` once.
fn each(pool: &mut Option<Pool>, processors: &mut [Processor], work: impl Fn(&mut Processor) + Sync) {
    match pool {
        None => processors.iter_mut().for_each(work),
        Some(pool) => {
            let mut none = [(); PROCESSORS_MAX.get()];
            let count = processors.len();
            pool.for_each(&mut none[..count], processors, |(), processor| work(processor));
        }
    }
}

/// The exact powers of subobjects, where steps don't tell them apart.
struct Powers<'a, W> {
    world: &'a W,
    eyepoints: &'a [Eyepoint],
}

impl<W: World> Powers<'_, W> {
    fn eyepoint_of(&self, view: usize) -> usize {
        let at = self.eyepoints.iter().position(|eyepoint| eyepoint.views >> view & 1 == 1);
        at.expect("each view has an eyepoint")
    }

    /// As ordered bits.
    fn of(&self, view: usize, id: u32) -> u64 {
        let blocks = self.world.blocks();
        let object = blocks.object_of(id);
        let slot = blocks.slot(object);
        let piece = (id - self.world.first_piece(object)) as usize;
        let ball = match self.world.moved_number(object) {
            Some(moved) => self.world.moved_piece_ball(moved, piece),
            None => blocks.piece_ball(slot, blocks.places(slot).start + piece),
        };
        ordered(power(self.eyepoints[self.eyepoint_of(view)].apex, ball))
    }
}
