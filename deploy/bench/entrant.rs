//! Those that draw in a benchmark, turn by turn.
//!
//! These machines drift by a third within a minute, so renderers that are compared draw the same pose one after the
//! other before any draws the next. What the one left in the caches would then be in the other's time; so in each turn an
//! entrant draws the pose before once more, unmeasured, and then its pose: as in a flight, where the frame before was its
//! own too.

use super::{look, peer};
use crate::cli::PixelsArgs;
use crate::error::CommandError;
use crate::in_process::InProcess;
use ::bench::Spread;
use ::bench::memory::FrameStore;
use ::bench::pixels::{Renderer, Row, Sampling, Skips, StageMs, Work};
use ::peer::protocol::Child;
use channel::pipeline::{DrawStats, TilePictures};
use manager::host::camera::CameraPose;
use manager::scene::Scene;
use manager::select::DetailMode;
use proto::share::Part;
use proto::view::Samples;
use std::num::NonZeroUsize;
use std::time::Instant;

/// What is the same for all entrants of a scene, and kept once.
pub(super) struct Field<'a> {
    /// Our renderers, each with a scene: all numbers of samples use one.
    drawers: Vec<InProcess<'a>>,
    out: TilePictures,
    pub(super) peer: Option<Child>,
    memory: FrameStore,
    args: &'a PixelsArgs,
}

/// How an entrant draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum How {
    /// By this one of the field's renderers.
    Ours { drawer: usize, samples: Samples },
    /// By the peer with so many samples.
    Peer { samples: usize },
    /// Not at all: it only writes the frame.
    Memory,
}

/// One row in the making.
pub(super) struct Entrant {
    pub(super) how: How,
    /// Whether its picture is of the scene that the reference draws, and no other entrant's has the same errors.
    pub(super) is_judged: bool,
    scene: String,
    threads: NonZeroUsize,
    /// What it does otherwise than a rig.
    variant: Option<String>,
    times: Vec<f64>,
    draws: Vec<(DrawStats, f64)>,
    culled: u64,
}

impl Entrant {
    pub(super) fn new(scene: &str, how: How, threads: NonZeroUsize, is_judged: bool) -> Self {
        let (times, draws) = (Vec::new(), Vec::new());
        Self { how, is_judged, scene: scene.into(), threads, variant: None, times, draws, culled: 0 }
    }

    /// The same, named by what it does otherwise.
    pub(super) fn named(self, variant: String) -> Self {
        Self { variant: Some(variant), ..self }
    }

    /// Draws `before` unmeasured and `pose` measured.
    pub(super) fn turn(
        &mut self,
        field: &mut Field<'_>,
        before: &CameraPose,
        pose: &CameraPose,
    ) -> Result<(), CommandError> {
        match self.how {
            How::Ours { drawer, samples } => {
                field.draw_ours(drawer, before, samples)?;
                let (ms, stats) = field.draw_ours(drawer, pose, samples)?;
                self.times.push(ms);
                self.draws.push((stats, field.drawers[drawer].select_ms));
                self.culled += field.drawers[drawer].selection().counters.subobjects_culled;
            }
            How::Peer { samples } => {
                field.draw_peer(before, samples)?;
                self.times.push(field.draw_peer(pose, samples)?);
            }
            How::Memory => {
                field.memory.write();
                self.times.push(field.memory.write());
            }
        }
        Ok(())
    }

    /// What came of it.
    pub(super) fn row(&self, args: &PixelsArgs) -> Row {
        let (renderer, samples) = match self.how {
            How::Ours { samples: Samples::Exact, .. } => (Renderer::Cyclorama, Some(Sampling::Exact)),
            How::Ours { samples, .. } => (Renderer::Cyclorama, Some(Sampling::Points(samples.count()))),
            How::Peer { samples } => (Renderer::Llvmpipe, Some(Sampling::Points(samples))),
            How::Memory => (Renderer::Memory, None),
        };
        Row {
            variant: self.variant.clone(),
            size: [args.size.0, args.size.1],
            threads: self.threads.get(),
            work: (!self.draws.is_empty()).then(|| work(&self.draws, self.culled, self.threads.get() as u64)),
            ..Row::timed(&self.scene, renderer, samples, &self.times)
        }
    }
}

impl<'a> Field<'a> {
    /// Nobody yet but the memory.
    pub(super) fn new(args: &'a PixelsArgs) -> Self {
        let (width, height) = args.size;
        let memory = FrameStore::new(width, height, args.threads);
        Self { drawers: Vec::new(), out: TilePictures::new(), peer: None, memory, args }
    }

    /// One more renderer of ours; its number.
    pub(super) fn add(&mut self, scene: &'a Scene, threads: NonZeroUsize) -> Result<usize, CommandError> {
        let mut drawer = InProcess::new(scene, threads, DetailMode::Finest)?;
        drawer.renderer().set_simd(self.args.simd.unwrap_or_default());
        self.drawers.push(drawer);
        Ok(self.drawers.len() - 1)
    }

    /// A renderer that works otherwise.
    pub(super) fn renderer(&mut self, drawer: usize) -> &mut channel::pipeline::Renderer {
        self.drawers[drawer].renderer()
    }

    /// Selects and draws; ms, and what the pipeline counted.
    fn draw_ours(
        &mut self,
        drawer: usize,
        pose: &CameraPose,
        samples: Samples,
    ) -> Result<(f64, DrawStats), CommandError> {
        let (state, view) = look(pose, self.args.size, &self.args.air, samples)?;
        let drawer = &mut self.drawers[drawer];
        let started = Instant::now();
        drawer.select(pose, &state, &view)?;
        let stats = drawer.draw(&state, &view, &Part::WHOLE, &mut self.out)?;
        Ok((started.elapsed().as_secs_f64() * 1e3, stats))
    }

    fn draw_peer(&mut self, pose: &CameraPose, samples: usize) -> Result<f64, CommandError> {
        let (state, view) = look(pose, self.args.size, &self.args.air, Samples::One)?;
        let look = peer::peer_look(&state, &view, samples).map_err(CommandError::said)?;
        let Some(child) = &mut self.peer else {
            return Err(CommandError::said("the peer has gone"));
        };
        Ok(child.draw(&look).map_err(peer::failed)?.ms)
    }

    /// Our picture of a pose, also linear.
    pub(super) fn picture(
        &mut self,
        drawer: usize,
        pose: &CameraPose,
        samples: Samples,
        size: (u32, u32),
    ) -> Result<TilePictures, CommandError> {
        let mut out = TilePictures::with_linear();
        let (state, view) = look(pose, size, &self.args.air, samples)?;
        let drawer = &mut self.drawers[drawer];
        drawer.select(pose, &state, &view)?;
        drawer.draw(&state, &view, &Part::WHOLE, &mut out)?;
        Ok(out)
    }
}

fn work(draws: &[(DrawStats, f64)], culled: u64, threads: u64) -> Work {
    let n = draws.len() as u64;
    let mean = |count: fn(&DrawStats) -> u64| draws.iter().map(|(s, _)| count(s)).sum::<u64>() / n;
    let median_ms = |count: fn(&DrawStats) -> u64| {
        let all: Vec<f64> = draws.iter().map(|(s, _)| count(s) as f64 / 1e6).collect();
        Spread::of(&all).median
    };
    let imbalance = |s: &DrawStats| (s.busiest_ns * threads) as f64 / s.busy_ns.max(1) as f64;
    let imbalances: Vec<f64> = draws.iter().map(|(s, _)| imbalance(s)).collect();
    let select: Vec<f64> = draws.iter().map(|(_, ms)| *ms).collect();
    Work {
        stage_ms: StageMs {
            select: Spread::of(&select).median,
            geometry: median_ms(|s| s.geometry_ns),
            raster: median_ms(|s| s.raster_ns),
            translucency: median_ms(|s| s.translucency_ns),
            resolve: median_ms(|s| s.resolve_ns),
        },
        triangles: mean(|s| s.geometry.faces_in),
        triangles_drawn: mean(|s| s.triangles_drawn),
        fragments: mean(|s| s.fragments),
        imbalance: Spread::of(&imbalances).median,
        skipped: Skips {
            culled: culled / n,
            occluded_subobjects: mean(|s| s.geometry.hidden_subobjects),
            occluded: mean(|s| s.opaque.occluded + s.translucent.occluded),
            backface: mean(|s| s.geometry.backface),
            tiles_opaque: mean(|s| s.tiles_opaque),
            pixels_single: mean(|s| s.pixels.pixels_single),
        },
    }
}
