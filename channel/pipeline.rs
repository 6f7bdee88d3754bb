//! The pipeline: one call draws one view's share of a frame.
//!
//! Geometry runs in parallel over runs of the list, raster to resolve over tiles, on a pool of threads of its own. Which thread does
//! what, and when, has no influence on a pixel: runs are joined in the order of the list, and a tile is made by one thread from
//! data that no one changes. All buffers stay with the [`Renderer`] from frame to frame: once they are as large as its pictures need, a
//! frame allocates nothing.
//!
//! If the pool has as many threads as the process may use CPUs, each is pinned to one: measured, unpinned threads that sleep
//! between frames are woken on the waker's CPU and do half of the frame one after the other. A smaller pool isn't pinned,
//! because several boards on one machine would all choose the same CPUs.

use crate::debug::{self, DebugScratch};
use crate::exact::stage::{ExactScratch, integrate_tile};
use crate::frame::{Frame, RUN_TRIANGLES_MAX, RUNS_MAX, triangle_number};
use crate::geometry::camera::Camera;
use crate::geometry::clip::CORNERS_MAX;
use crate::geometry::coarse::Coarse;
use crate::geometry::transform::{GeometryCounts, GeometryRun, Item};
use crate::lights::Light;
use crate::raster::bins::{RunBins, TileMap};
use crate::raster::coverage::{BLOCKS, SampleTables};
use crate::raster::fronts::{BoxExtent, TileFronts};
use crate::raster::opaque::{RasterCounts, draw_opaque};
use crate::raster::visible::{TILE_TRIANGLES_MAX, Visible};
use crate::resolve::colour::decode_srgb;
use crate::resolve::tile::{ResolveCounts, ResolveScratch, Resolved, TileOutput, resolve};
use crate::room::{emptied, room, share_room};
use crate::samples::Pattern;
use crate::shade::tile::TileFaces;
use crate::simd::{SimdLevel, at_level};
use crate::store::SceneStore;
use crate::translucency::gather::{TileLayers, gather};
use fearless_simd::Simd;
use pool::Pool;
use proto::debug::DebugPicture;
use proto::frame::{Environment, FrameState, PixelRect, TileIndex};
use proto::ids::{ContentId, SubobjectId};
use proto::limits::TRIANGLES_PER_SUBOBJECT_MAX;
use proto::share::Part;
use proto::view::{Pose, View};
use std::num::NonZeroUsize;
use std::ops::Range;
use std::time::Instant;
use thiserror::Error;

/// Why a frame wasn't drawn. The output is then empty.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum DrawError {
    /// The view's numbers are out of range; whoever described the view is at fault.
    #[error("the view is not drawable: its size, tangents, near plane or pose is out of range")]
    View,
    /// The eyepoint or the environment has a number that is not finite, or a range of visibility that is not positive.
    #[error("the frame's state has a number that is not finite, or a visibility that is not positive")]
    State,
    /// The list names a row that the table doesn't have.
    #[error("the list names subobject {subobject} of {subobjects}")]
    UnknownSubobject {
        /// What the list names.
        subobject: SubobjectId,
        /// Number of rows.
        subobjects: usize,
    },
    /// A mesh or a texture has not come yet; [`SceneStore::missing`] says which.
    #[error("subobject {subobject} can't be drawn: its mesh or a texture is not here yet")]
    Missing {
        /// The first that can't be drawn.
        subobject: SubobjectId,
    },
    /// More faces than can be numbered.
    #[error("{faces} faces in the list, allowed are {FACES_MAX}")]
    TooManyFaces {
        /// Faces of the listed meshes.
        faces: usize,
    },
}

/// What a frame cost. Times are for people and for scheduling; they never reach a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DrawStats {
    /// What became of the faces.
    pub geometry: GeometryCounts,
    /// Triangles that went to the tiles.
    pub triangles_drawn: u64,
    /// Opaque and MASK triangles in the tiles.
    pub opaque: RasterCounts,
    /// Translucent triangles in the tiles.
    pub translucent: RasterCounts,
    /// Translucent fragments that were kept.
    pub fragments: u64,
    /// Pixels by the way they were found.
    pub pixels: ResolveCounts,
    /// Of these, pixels computed by areas.
    pub pixels_exact: u64,
    /// Of these, pixels with too many faces for areas: see [`crate::exact::SAMPLES_INSTEAD`].
    pub pixels_exact_by_points: u64,
    /// Tiles drawn.
    pub tiles: u64,
    /// Of these, tiles without a translucent fragment.
    pub tiles_opaque: u64,
    /// Time that the threads worked, ns, together.
    pub busy_ns: u64,
    /// Time that the one that worked longest did, ns.
    pub busiest_ns: u64,
    /// From the list to triangles in bins, ns.
    pub geometry_ns: u64,
    /// Raster, ns, summed over threads.
    pub raster_ns: u64,
    /// Gathering of translucent fragments, ns, summed over threads.
    pub translucency_ns: u64,
    /// Shading, mixing and encoding, ns, summed over threads.
    pub resolve_ns: u64,
    /// The whole call, ns.
    pub total_ns: u64,
}

/// The finished tiles of a share.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TilePictures {
    /// Which tiles, row by row of the view.
    pub tiles: Vec<TileIndex>,
    /// sRGB-encoded RGB, 3 bytes a pixel: each tile's rectangle row-major and tightly packed, one tile after the other.
    pub rgb: Vec<u8>,
    /// The same in linear, unclamped floats, if asked for with [`TilePictures::with_linear`].
    pub linear: Option<Vec<f32>>,
    /// The names of the pixels that [`DebugPicture::Skips`] has painted over, tile by tile; else empty.
    plain: Vec<ContentId>,
    /// Where each tile's pixels begin, pixels; one more for the end.
    starts: Vec<usize>,
}

impl TilePictures {
    /// An empty output for 8-bit pixels.
    pub fn new() -> Self {
        Self::default()
    }

    /// An empty output for linear floats beside the 8-bit pixels.
    pub fn with_linear() -> Self {
        Self { linear: Some(Vec::new()), ..Self::default() }
    }

    /// The 8-bit pixels of the tile `tiles[k]`.
    ///
    /// # Panics
    /// If there is no such tile.
    pub fn tile(&self, k: usize) -> &[u8] {
        &self.rgb[self.starts[k] * 3..self.starts[k + 1] * 3]
    }

    /// The linear pixels of the tile `tiles[k]`, if they were asked for.
    ///
    /// # Panics
    /// If there is no such tile.
    pub fn tile_linear(&self, k: usize) -> Option<&[f32]> {
        self.linear.as_ref().map(|linear| &linear[self.starts[k] * 3..self.starts[k + 1] * 3])
    }

    /// Darkens the tiles whose pixels, before they were painted over, were those that `before` has at the same place.
    pub fn darken_unchanged(&mut self, before: &Self) {
        if self.tiles != before.tiles || self.plain.is_empty() {
            return;
        }
        for (k, (own, old)) in self.plain.iter().zip(&before.plain).enumerate() {
            if own == old {
                let channels = self.starts[k] * 3..self.starts[k + 1] * 3;
                self.rgb[channels.clone()].iter_mut().for_each(|value| *value /= 2);
                if let Some(linear) = &mut self.linear {
                    let codes = &self.rgb[channels.clone()];
                    for (to, code) in linear[channels].chunks_exact_mut(3).zip(codes.chunks_exact(3)) {
                        to.copy_from_slice(&decode_srgb([code[0], code[1], code[2]]));
                    }
                }
            }
        }
    }

    fn begin(&mut self, part: &Part, width: u32, height: u32, debug: DebugPicture) {
        self.tiles.clear();
        self.tiles.extend(part.tiles(width, height));
        self.starts.clear();
        self.starts.push(0);
        let mut pixels = 0;
        for tile in &self.tiles {
            pixels += tile.rect(width, height).area();
            self.starts.push(pixels);
        }
        self.rgb.resize(pixels * 3, 0);
        self.plain.clear();
        if debug == DebugPicture::Skips {
            self.plain.resize(self.tiles.len(), ContentId([0; 16]));
        }
        if let Some(linear) = &mut self.linear {
            linear.resize(pixels * 3, 0.0);
        }
    }

    fn clear(&mut self) {
        self.tiles.clear();
        self.rgb.clear();
        self.plain.clear();
        self.starts.clear();
        if let Some(linear) = &mut self.linear {
            linear.clear();
        }
    }
}

/// Work that a scene may not need, and that is left out where it doesn't. All are on by default; a benchmark turns one off to
/// measure what it saves. No picture depends on any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Skips {
    /// Subobjects behind faces that cover their tiles, or in no tile of this board, by their boxes and before a vertex is touched.
    pub hidden: bool,
    /// Back faces of single-sided surfaces, before they become triangles; if not, after it is known which pixels they cover. With
    /// [`proto::view::Samples::Exact`] always.
    pub back_faces: bool,
    /// Triangles behind what is already drawn, block by block and tile by tile.
    pub occluded: bool,
    /// Pixels that one face fills: taken many at a time and shaded once, not looked at sample by sample.
    pub single: bool,
    /// Tiles without a translucent fragment: that stage.
    pub opaque_tiles: bool,
}

impl Default for Skips {
    fn default() -> Self {
        Self { hidden: true, back_faces: true, occluded: true, single: true, opaque_tiles: true }
    }
}

/// What one thread needs for a tile.
#[derive(Debug, Default)]
struct TileScratch {
    /// How long the thread has worked in this frame, ns.
    busy_ns: u64,
    /// The tile's triangles: the opaque ones, then the others.
    numbers: Vec<u32>,
    visible: Visible,
    tables: SampleTables,
    layers: TileLayers,
    faces: TileFaces,
    resolve: ResolveScratch,
    exact: ExactScratch,
    debug: DebugScratch,
}

room!(TileScratch: numbers, visible, layers, faces, resolve, exact, debug; tables, busy_ns);

/// One run of the list on its way through geometry.
#[derive(Debug)]
struct RunJob<'a> {
    range: Range<usize>,
    run: &'a mut GeometryRun,
    bins: &'a mut RunBins,
}

/// One tile on its way through the stages.
#[derive(Debug)]
struct TileJob<'a> {
    slot: usize,
    rect: PixelRect,
    out: TileOutput<'a>,
    /// Where the name of its pixels goes, if they are painted over and it is asked for.
    plain: Option<&'a mut ContentId>,
    stats: DrawStats,
}

/// The pixel pipeline with its threads and buffers.
#[derive(Debug)]
pub struct Renderer {
    pool: Pool,
    runs: Vec<GeometryRun>,
    bins: Vec<RunBins>,
    map: TileMap,
    fronts: TileFronts,
    level: SimdLevel,
    skips: Skips,
    coarse: Coarse,
    /// One per thread.
    scratch: Vec<TileScratch>,
    /// Which items a run has.
    ranges: Vec<Range<usize>>,
    lights: Vec<Light>,
    surroundings: Vec<(f64, usize)>,
    // What borrows from a frame is here between frames, always empty: only its room is used again.
    items: Vec<Item<'static>>,
    run_jobs: Vec<RunJob<'static>>,
    tile_jobs: Vec<TileJob<'static>>,
}

/// The pool's threads could not be started.
#[derive(Debug, Error)]
#[error("the renderer's {threads} threads could not be started")]
pub struct RendererError {
    threads: usize,
    source: std::io::Error,
}

/// Runs per thread that the list is cut into: enough that an uneven one doesn't keep the others waiting. A guess.
const RUNS_PER_THREAD: usize = 8;

/// Fewest faces of a run: below, handing it to a thread costs as much as the work. A guess.
const RUN_FACES_MIN: usize = 512;

/// Fewest faces of a subobject whose box is asked first: a box costs as much as some dozen vertices. A guess.
const FACES_WORTH_A_BOX: usize = 8;

/// Most faces of a run, a subobject more or less: cut into as many pieces as can be, they still have numbers.
const RUN_FACES_MAX: usize = RUN_TRIANGLES_MAX / (CORNERS_MAX - 2) - TRIANGLES_PER_SUBOBJECT_MAX;

/// Most faces of a list.
pub const FACES_MAX: usize = RUN_FACES_MAX * (RUNS_MAX / 2);

impl Renderer {
    /// A renderer with that many threads of its own.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn new(threads: NonZeroUsize) -> Result<Self, RendererError> {
        let count = threads.get();
        let cpus = allowed_cpus();
        let pins = (cpus.len() == count).then_some(cpus);
        let pin = move |thread: usize| {
            pool::turns::go_along();
            if let Some(cpu) = pins.as_ref().and_then(|cpus| cpus.get(thread)) {
                let mut set = rustix::thread::CpuSet::new();
                set.set(*cpu);
                // Refused in some containers; the frame is then slower, not wrong.
                let _ = rustix::thread::sched_setaffinity(None, &set);
            }
        };
        let pool = Pool::new(threads, "pixels", pin).map_err(|source| RendererError { threads: count, source })?;
        Ok(Self {
            pool,
            runs: Vec::new(),
            bins: Vec::new(),
            map: TileMap::default(),
            fronts: TileFronts::default(),
            level: SimdLevel::best(),
            skips: Skips::default(),
            coarse: Coarse::default(),
            scratch: (0..count).map(|_| TileScratch::default()).collect(),
            ranges: Vec::new(),
            lights: Vec::new(),
            surroundings: Vec::new(),
            items: Vec::new(),
            run_jobs: Vec::new(),
            tile_jobs: Vec::new(),
        })
    }

    /// Draws with that instruction set from now on; no picture depends on it.
    pub fn set_simd(&mut self, level: SimdLevel) {
        self.level = level;
    }

    /// Leaves out what `skips` says from now on.
    pub fn set_skips(&mut self, skips: Skips) {
        self.skips = skips;
    }

    /// Puts vertices on the screen that way from now on; pictures depend on it.
    pub fn set_coarse(&mut self, coarse: Coarse) {
        self.coarse = coarse;
    }

    /// Number of threads.
    pub fn threads(&self) -> usize {
        self.scratch.len()
    }

    /// Draws the tiles of `part` of a view: the subobjects of `list`, from front to back for speed (the order has no
    /// influence on the picture), where `scene` has them now. `out` is overwritten.
    ///
    /// # Errors
    /// [`DrawError`]; `out` is then empty and the renderer as good as before.
    pub fn draw(
        &mut self,
        scene: &SceneStore,
        state: &FrameState,
        view: &View,
        list: &[SubobjectId],
        part: &Part,
        out: &mut TilePictures,
    ) -> Result<DrawStats, DrawError> {
        let begun = Instant::now();
        out.clear();
        if !view.is_valid() {
            return Err(DrawError::View);
        }
        let state = checked(state)?;
        let camera = Camera::new(&state, view);
        let mut items = std::mem::take(&mut self.items);
        let found = items_of(scene, &camera, list, &mut items);
        let drawn = found.and_then(|()| self.draw_items(begun, scene, &state, view, &camera, &mut items, part, out));
        self.items = emptied(items);
        let mut stats = drawn?;
        stats.total_ns = nanoseconds(begun);
        Ok(stats)
    }

    /// [`Renderer::draw`] of what the list names.
    fn draw_items(
        &mut self,
        begun: Instant,
        scene: &SceneStore,
        state: &FrameState,
        view: &View,
        camera: &Camera,
        items: &mut Vec<Item<'_>>,
        part: &Part,
        out: &mut TilePictures,
    ) -> Result<DrawStats, DrawError> {
        let pattern = Pattern::of(view.samples);
        sort_surroundings(camera, items, &mut self.surroundings);

        let mut stats = DrawStats::default();
        out.begin(part, view.width, view.height, state.debug);
        self.map.set(view.width, view.height, &out.tiles);
        let visibility_m = state.environment.visibility_m.unwrap_or(f64::INFINITY);
        let runs = self.geometry(camera, pattern, visibility_m, items, state.debug, &mut stats)?;
        stats.geometry_ns = nanoseconds(begun);

        self.lights.clear();
        if state.environment.scene_lights {
            self.lights.extend(scene.lights().iter().map(|row| Light::new(row, camera)));
        }
        let frame = Frame::new(camera, pattern, &state.environment, &self.lights, items, &self.runs[..runs]);
        let mut jobs = std::mem::take(&mut self.tile_jobs);
        tile_jobs(out, view, &mut jobs);
        let (bins, level, skips, debug) = (&self.bins[..runs], self.level.level(), self.skips, state.debug);
        self.pool.for_each(&mut self.scratch, &mut jobs, |scratch, job| {
            let begun = Instant::now();
            at_level!(level, simd => draw_tile(simd, &frame, bins, skips, debug, scratch, job));
            scratch.busy_ns += nanoseconds(begun);
        });
        for job in &jobs {
            stats.add_tile(&job.stats);
        }
        stats.busy_ns = self.scratch.iter().map(|scratch| scratch.busy_ns).sum();
        stats.busiest_ns = self.scratch.iter().map(|scratch| scratch.busy_ns).max().unwrap_or(0);
        self.tile_jobs = emptied(jobs);
        share_room(&mut self.scratch);
        Ok(stats)
    }

    /// The list through geometry and into bins; returns the number of runs.
    fn geometry(
        &mut self,
        camera: &Camera,
        pattern: &Pattern,
        visibility_m: f64,
        items: &[Item<'_>],
        debug: DebugPicture,
        stats: &mut DrawStats,
    ) -> Result<usize, DrawError> {
        let faces: usize = items.iter().map(|item| item.stored.mesh.triangles.len()).sum();
        if faces > FACES_MAX {
            return Err(DrawError::TooManyFaces { faces });
        }
        let run_faces = (faces / (self.scratch.len() * RUNS_PER_THREAD)).clamp(RUN_FACES_MIN, RUN_FACES_MAX);
        self.ranges.clear();
        let (mut first, mut in_run) = (0, 0);
        for (i, item) in items.iter().enumerate() {
            in_run += item.stored.mesh.triangles.len();
            if in_run >= run_faces || i + 1 == items.len() {
                self.ranges.push(first..i + 1);
                (first, in_run) = (i + 1, 0);
            }
        }
        let count = self.ranges.len();
        if self.runs.len() < count {
            self.runs.resize_with(count, GeometryRun::default);
            self.bins.resize_with(count, RunBins::default);
        }
        let mut jobs = std::mem::take(&mut self.run_jobs);
        let buffers = self.runs.iter_mut().zip(&mut self.bins);
        jobs.extend(self.ranges.iter().zip(buffers).map(|(range, (run, bins))| RunJob {
            range: range.clone(),
            run,
            bins,
        }));
        self.fronts.clear(self.map.bins());
        let (map, fronts, level) = (&self.map, &self.fronts, self.level.level());
        let (keeps_back, coarse) = (!self.skips.back_faces && !pattern.is_exact(), self.coarse);
        // Areas also ask for what is a little beside a tile's points.
        let drops_any = !pattern.is_exact() && !debug::counts_hidden(debug);
        let looks = self.skips.hidden && drops_any;
        let drops = self.skips.occluded && drops_any;
        let is_hidden = |item: &Item<'_>| {
            looks
                && item.stored.mesh.triangles.len() >= FACES_WORTH_A_BOX
                && BoxExtent::of(camera, item).is_some_and(|extent| fronts.hide(map, &extent))
        };
        // From front to back, whichever thread: what is near hides what comes later.
        for scratch in &mut self.scratch {
            scratch.busy_ns = 0;
        }
        self.pool.for_each_in_turn(&mut self.scratch, &mut jobs, |scratch, RunJob { range, run, bins }| {
            let begun = Instant::now();
            let own = &items[range.clone()];
            at_level!(level, simd => {
                (run.keeps_back, run.coarse) = (keeps_back, coarse);
                run.fill(simd, camera, pattern, visibility_m, own, range.start, is_hidden);
                bins.fill(pattern, map, fronts, &run.triangles, drops, |t| items[t.item as usize].is_fragments());
            });
            scratch.busy_ns += nanoseconds(begun);
        });
        self.run_jobs = emptied(jobs);
        for (run, bins) in self.runs.iter().zip(&self.bins).take(count) {
            stats.geometry.add(&run.counts);
            stats.triangles_drawn += run.triangles.len() as u64;
            stats.opaque.occluded += bins.hidden;
        }
        Ok(count)
    }
}

/// A frame's state, refused unless its numbers can be computed with; the eyepoint's rotation made a unit one.
fn checked(state: &FrameState) -> Result<FrameState, DrawError> {
    let eye = Pose::checked(state.eye.position, state.eye.orientation).map_err(|_| DrawError::State)?;
    let e: &Environment = &state.environment;
    let colours = [e.fog, if let proto::frame::Background::Constant(c) = e.background { Some(c) } else { None }];
    let are_finite = e.ambient.is_finite()
        && e.sun.is_finite()
        && e.sun_direction.is_finite()
        && colours.into_iter().flatten().flatten().all(f32::is_finite)
        && e.visibility_m.is_none_or(|v| v.is_finite() && v > 0.0);
    if are_finite { Ok(FrameState { eye, ..*state }) } else { Err(DrawError::State) }
}

/// The list's subobjects, ready to be drawn; replaces the content of `items`.
pub(crate) fn items_of<'a>(
    scene: &'a SceneStore,
    camera: &Camera,
    list: &[SubobjectId],
    items: &mut Vec<Item<'a>>,
) -> Result<(), DrawError> {
    items.clear();
    for subobject in list {
        items.extend(item(scene, camera, *subobject)?);
    }
    Ok(())
}

/// Puts the subobjects whose balls hold the eye, which a list begins with, in the order of the nearest points of their boxes. The
/// list's own key says nothing about those (the eye's power is negative, whatever is in front), and large things near the eye are
/// just what hides the rest. The picture doesn't depend on the order. `keyed` is a buffer.
fn sort_surroundings(camera: &Camera, items: &mut Vec<Item<'_>>, keyed: &mut Vec<(f64, usize)>) {
    let holds_eye = |item: &Item<'_>| {
        let ball = item.stored.mesh.sphere;
        let m = &item.linear;
        let stretch = [m.x_axis, m.y_axis, m.z_axis].iter().map(|axis| axis.length_squared()).sum::<f64>();
        (m * ball.centre + item.relative).length_squared() < ball.radius * ball.radius * stretch
    };
    let count = items.iter().take_while(|item| holds_eye(item)).count();
    keyed.clear();
    keyed.extend(items[..count].iter().enumerate().map(|(k, item)| (nearest(camera, item), k)));
    keyed.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    // A copy behind the others, to pick from.
    let copy = items.len();
    items.extend_from_within(..count);
    for (to, (_, from)) in keyed.iter().enumerate() {
        items[to] = items[copy + from];
    }
    items.truncate(copy);
}

/// Least distance along the line of sight of a subobject's box, m.
fn nearest(camera: &Camera, item: &Item<'_>) -> f64 {
    let b = item.stored.mesh.bounds;
    let corner = |k: usize| {
        let pick = |axis: usize| if k >> axis & 1 == 0 { b.min[axis] } else { b.max[axis] };
        camera.view_point(item.linear * glam::DVec3::new(pick(0), pick(1), pick(2)) + item.relative).w
    };
    (0..8).map(corner).fold(f64::INFINITY, |least, w| if w < least { w } else { least })
}

/// One of them; `None` if nothing of it is shown.
fn item<'a>(scene: &'a SceneStore, camera: &Camera, subobject: SubobjectId) -> Result<Option<Item<'a>>, DrawError> {
    let subobjects = scene.subobjects();
    if subobject.0 as usize >= subobjects {
        return Err(DrawError::UnknownSubobject { subobject, subobjects });
    }
    let missing = DrawError::Missing { subobject };
    let found = scene.find(subobject).ok_or_else(|| missing.clone())?;
    let Some(mut item) = Item::new(&found, camera) else { return Ok(None) };
    let texture = |slot: Option<usize>| match slot {
        None => Ok(None),
        Some(slot) => scene.texture(slot).map(Some).ok_or_else(|| missing.clone()),
    };
    item.base_texture = texture(found.stored.base_texture)?;
    item.emissive_texture = texture(found.stored.emissive_texture)?;
    Ok(Some(item))
}

/// The tiles of `out` with their pixels, put into the empty `jobs`.
fn tile_jobs<'a>(out: &'a mut TilePictures, view: &View, jobs: &mut Vec<TileJob<'a>>) {
    let mut rgb = out.rgb.as_mut_slice();
    let mut linear = out.linear.as_deref_mut();
    let mut plain = out.plain.iter_mut();
    for (slot, tile) in out.tiles.iter().enumerate() {
        let rect = tile.rect(view.width, view.height);
        let channels = rect.area() * 3;
        let (bytes, rest) = rgb.split_at_mut(channels);
        rgb = rest;
        let floats = linear.take().map(|all| {
            let (floats, rest) = all.split_at_mut(channels);
            linear = Some(rest);
            floats
        });
        let out = TileOutput { rgb: bytes, linear: floats };
        jobs.push(TileJob { slot, rect, out, plain: plain.next(), stats: DrawStats::default() });
    }
}

/// One tile from bins to bytes.
#[inline(always)]
fn draw_tile<S: Simd>(
    simd: S,
    frame: &Frame<'_>,
    bins: &[RunBins],
    skips: Skips,
    debug: DebugPicture,
    scratch: &mut TileScratch,
    job: &mut TileJob<'_>,
) {
    let TileScratch {
        numbers, visible, tables, layers, faces, resolve: resolve_scratch, exact, debug: painted, ..
    } = scratch;
    let stats = &mut job.stats;
    let begun = Instant::now();
    numbers.clear();
    for (run, bins) in bins.iter().enumerate() {
        numbers.extend(bins.opaque(job.slot).iter().map(|place| triangle_number(run, *place)));
    }
    let opaque = numbers.len();
    for (run, bins) in bins.iter().enumerate() {
        numbers.extend(bins.translucent(job.slot).iter().map(|place| triangle_number(run, *place)));
    }
    assert!(numbers.len() <= TILE_TRIANGLES_MAX, "a tile's triangles are numbered in 31 bits");
    visible.clear(frame.pattern.full);
    layers.clear();
    faces.begin(numbers.len());
    let counts = &mut stats.opaque;
    simd.vectorize(
        #[inline(always)]
        || draw_opaque(simd, frame, job.rect, &numbers[..opaque], visible, tables, faces.general(), skips, counts),
    );
    stats.raster_ns = nanoseconds(begun);

    if opaque < numbers.len() || !skips.opaque_tiles {
        let begun = Instant::now();
        let counts = &mut stats.translucent;
        let general = faces.general();
        simd.vectorize(
            #[inline(always)]
            || gather(simd, frame, job.rect, numbers, opaque, visible, layers, tables, general, skips, counts),
        );
        for block in 0..BLOCKS {
            layers.sort(block);
        }
        stats.translucency_ns = nanoseconds(begun);
    }
    stats.fragments = layers.fragments() as u64;
    stats.tiles = 1;
    stats.tiles_opaque = u64::from(layers.fragments() == 0);

    let begun = Instant::now();
    let out = TileOutput { rgb: job.out.rgb, linear: job.out.linear.as_deref_mut() };
    let tile = Resolved { frame, rect: job.rect, numbers, visible, layers };
    simd.vectorize(
        #[inline(always)]
        || resolve(simd, tile, faces, resolve_scratch, out, &mut stats.pixels),
    );
    if frame.pattern.is_exact() {
        simd.vectorize(
            #[inline(always)]
            || {
                [stats.pixels_exact, stats.pixels_exact_by_points] =
                    integrate_tile(simd, tile, opaque, faces, exact, &mut job.out);
            },
        );
    }
    if debug != DebugPicture::Off {
        if let Some(plain) = &mut job.plain {
            **plain = name_of(&job.out);
        }
        debug::paint(simd, debug, tile, faces, painted, &mut job.out);
    }
    stats.resolve_ns = nanoseconds(begun);
}

/// The name of a tile's pixels.
fn name_of(out: &TileOutput<'_>) -> ContentId {
    match &out.linear {
        Some(linear) => ContentId::of(bytemuck::cast_slice(linear)),
        None => ContentId::of(out.rgb),
    }
}

impl DrawStats {
    /// Adds what a tile counted; geometry and the total are the frame's own.
    fn add_tile(&mut self, tile: &Self) {
        self.opaque.add(&tile.opaque);
        self.translucent.add(&tile.translucent);
        self.fragments += tile.fragments;
        self.pixels.pixels_single += tile.pixels.pixels_single;
        self.pixels.pixels_multi += tile.pixels.pixels_multi;
        self.pixels_exact += tile.pixels_exact;
        self.pixels_exact_by_points += tile.pixels_exact_by_points;
        self.tiles += tile.tiles;
        self.tiles_opaque += tile.tiles_opaque;
        self.raster_ns += tile.raster_ns;
        self.translucency_ns += tile.translucency_ns;
        self.resolve_ns += tile.resolve_ns;
    }
}

fn nanoseconds(since: Instant) -> u64 {
    u64::try_from(since.elapsed().as_nanos()).unwrap_or(u64::MAX)
}

/// The CPUs that this process may use, ascending; none if the system doesn't say.
fn allowed_cpus() -> Vec<usize> {
    let set = rustix::thread::sched_getaffinity(None);
    set.map(|set| (0..rustix::thread::CpuSet::MAX_CPU).filter(|cpu| set.is_set(*cpu)).collect()).unwrap_or_default()
}
