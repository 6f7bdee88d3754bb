//! Once warm, a frame allocates nothing: neither its selection nor its drawing, whatever the threads and the sampling. What the allocator
//! is asked for is counted; a flight is flown once, so that buffers grow to what its frames need, and then again. With two threads selection has two processors too, and
//! mixes two lists.
//!
//! It is a program of its own without the usual harness, because the count is the whole process's, and the harness has a thread that
//! speaks up when a test takes long.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test suite: a panic is a failure, and what is printed is its report"
)]

use channel::pipeline::{Renderer, TilePictures};
use channel::store::SceneStore;
use glam::{DQuat, DVec3};
use manager::host::camera::CameraPose;
use manager::scene::{Entities, Scene, builtin, import};
use manager::select::{Dispatch, Selector, Sight};
use proto::debug::DebugPicture;
use proto::frame::{Environment, FrameState, VersionWeights};
use proto::ids::{Epoch, FrameNumber};
use proto::share::{Lattice, Part};
use proto::view::{Pose, Samples, View};
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use std::alloc::System;
use std::num::NonZeroUsize;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Width and height, pixels: several tiles for each of two threads, none of them whole at the right and below.
const SIZE: (u32, u32) = (180, 100);
/// What is drawn with areas, which take far longer in `smoke`: each fourth tile.
const PART_EXACT: Part = Part::Lattice(Lattice { modulus: 4, skew: 1, first: 0, end: 1 });
/// Poses of a flight that are drawn.
const POSES: usize = 3;

/// How often memory was asked for, since the process began.
fn asked() -> usize {
    let stats = ALLOCATOR.stats();
    stats.allocations + stats.reallocations
}

/// A pose with all that is made of it before a frame begins.
#[derive(Clone)]
struct Stop {
    state: FrameState,
    pose: CameraPose,
    entities: Entities,
    weights: Vec<VersionWeights>,
}

impl Stop {
    fn new(scene: &Scene, pose: &CameraPose) -> Self {
        let environment = Environment { scene_lights: true, visibility_m: Some(20_000.0), ..Environment::default() };
        let state = FrameState {
            frame: FrameNumber(0),
            epoch: Epoch(1),
            eye: pose.pose().unwrap(),
            environment,
            debug: DebugPicture::Off,
        };
        let mut entities = Entities::new(scene);
        for entity in &pose.entities {
            let at = Pose::checked(DVec3::from_array(entity.position), DQuat::from_array(entity.orientation));
            entities.set(scene, scene.node_by_name(&entity.node).unwrap(), at.unwrap());
        }
        let weights = scene.version_weights(&pose.versions).unwrap();
        Self { state, pose: pose.clone(), entities, weights }
    }

    fn view(&self, samples: Samples) -> View {
        let (width, height) = SIZE;
        let (offset, tangents, near) = (Pose::IDENTITY, self.pose.lens(width, height), View::NEAR_DEFAULT);
        View { offset, tangents, width, height, near, samples }
    }
}

/// Selects and draws the stops; returns how often memory was asked for at each, by the selection and by the drawing.
fn fly(
    scene: &Scene,
    store: &mut SceneStore,
    stops: &[Stop],
    samples: Samples,
    lists: NonZeroUsize,
    selector: &mut Selector,
    renderer: &mut Renderer,
    out: &mut TilePictures,
) -> Vec<[usize; 2]> {
    let mut moved = Vec::new();
    let mut counts = Vec::with_capacity(stops.len());
    for stop in stops {
        let Stop { state, entities, weights, .. } = stop;
        let view = stop.view(samples);
        let part = if samples == Samples::Exact { PART_EXACT } else { Part::WHOLE };
        entities.moved(&mut moved);
        store.set_moved(&moved).unwrap();
        store.set_weights(weights).unwrap();
        let visibility = state.environment.visibility_m;

        let before = asked();
        let sight = Sight { lists, ..Sight::whole(state.eye, std::slice::from_ref(&view), visibility) };
        selector.select(scene, entities, weights, &sight);
        let selected = asked();
        let stats = renderer.draw(store, state, &view, &selector.found()[0].subobjects, &part, out).unwrap();
        let drawn = asked();
        counts.push([selected - before, drawn - selected]);
        assert!(stats.triangles_drawn > 0, "the flight shows something");
    }
    counts
}

/// The airport moves aircraft, `smoke` is layers, `city` selects more than a thousand subobjects.
const SCENES: [&str; 3] = ["airport", "smoke", "city"];

fn a_frame_allocates_nothing_once_its_flight_was_flown(name: &str) {
    let built = builtin::build(name).unwrap();
    let scene = import::load_glb(&built.glb, name).unwrap();
    let all = &built.camera.poses;
    let stops: Vec<_> = (0..POSES).map(|k| Stop::new(&scene, &all[k * all.len() / POSES])).collect();
    let mut store = SceneStore::new();
    for (id, texture) in &scene.textures.all().unwrap() {
        store.insert_texture(*id, texture.as_ref().clone()).unwrap();
    }
    for (id, mesh) in &scene.meshes.all().unwrap() {
        store.insert_mesh(*id, mesh.as_ref().clone()).unwrap();
    }
    store.set_table(scene.table.clone()).unwrap();
    for threads in [1, 2] {
        let mut renderer = Renderer::new(NonZeroUsize::new(threads).unwrap()).unwrap();
        let lists = NonZeroUsize::new(threads).unwrap();
        let mut selector = Selector::with_processors(lists, Dispatch::default()).unwrap();
        let mut out = TilePictures::with_linear();
        for samples in [Samples::One, Samples::Sixteen, Samples::SixtyFour, Samples::Exact] {
            let mut flight = || fly(&scene, &mut store, &stops, samples, lists, &mut selector, &mut renderer, &mut out);
            let (first, second) = (flight(), flight());
            println!("{name}, {threads} threads, {samples}: [select, draw] {first:?}, then {second:?}");
            let is_quiet = second.iter().all(|counts| *counts == [0, 0]);
            assert!(is_quiet, "{name}, {threads} threads, {samples}: memory was asked for {second:?} times");
        }
        // What debug pictures need comes on top.
        for debug in DebugPicture::ALL.into_iter().filter(|debug| *debug != DebugPicture::Off) {
            let stops: Vec<_> =
                stops.iter().map(|stop| Stop { state: FrameState { debug, ..stop.state }, ..stop.clone() }).collect();
            let mut flight =
                || fly(&scene, &mut store, &stops, Samples::One, lists, &mut selector, &mut renderer, &mut out);
            let (_, second) = (flight(), flight());
            let is_quiet = second.iter().all(|counts| *counts == [0, 0]);
            assert!(is_quiet, "{name}, {threads} threads, {debug:?}: memory was asked for {second:?} times");
        }
    }
}

fn main() {
    // As with the usual harness, a name or a part of one chooses, and a list is only a list.
    const NAME: &str = "a_frame_allocates_nothing_once_its_flight_was_flown";
    let args: Vec<String> = std::env::args().skip(1).collect();
    if args.iter().any(|arg| arg == "--list") {
        println!("{NAME}: test");
        return;
    }
    let mut names = args.iter().filter(|arg| !arg.starts_with('-')).peekable();
    if names.peek().is_some() && !names.any(|name| NAME.contains(name.as_str())) {
        println!("test result: ok. 0 passed; 0 failed; 1 filtered out");
        return;
    }
    SCENES.into_iter().for_each(a_frame_allocates_nothing_once_its_flight_was_flown);
    println!("test result: ok. 1 passed; 0 failed");
}
