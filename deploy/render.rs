//! `cyclorama render`: one picture without a network, through the same selection, shares, drawing and stitching as a
//! rig's.

use crate::cli::RenderArgs;
use crate::error::CommandError;
use crate::output::say;
use crate::serve::processors;
use crate::{settings, source};
use bytes::Bytes;
use channel::pipeline::{DrawStats, Renderer, TilePictures};
use channel::store::SceneStore;
use compositor::sinks::write_png;
use compositor::stitch::Stitcher;
use glam::{DQuat, DVec3};
use manager::host::camera::CameraPose;
use manager::scene::{Entities, Scene};
use manager::select::{Selection, Selector};
use proto::frame::{FrameState, Moved};
use proto::ids::{BoardId, BoardKey, Epoch, FrameNumber};
use proto::message::Swap;
use proto::share::shares;
use proto::view::{Pose, View};
use std::num::NonZeroUsize;
use std::time::Instant;

/// Runs the command.
pub(crate) fn run(args: &RenderArgs) -> Result<(), CommandError> {
    if args.output.extension().is_none_or(|extension| extension != "png") {
        let shown = args.output.display();
        return Err(CommandError::said(format!("{shown}: only .png can be written; name the picture so")));
    }
    let source = source::load(&args.scene, args.camera.as_deref())?;
    let count = source.camera.poses.len();
    let Some(pose) = source.camera.poses.get(args.pose) else {
        return Err(CommandError::said(format!("--pose {}: the camera has poses 0 to {}", args.pose, count - 1)));
    };
    let (width, height) = args.size;
    let view = View {
        offset: Pose::IDENTITY,
        tangents: pose.lens(width, height),
        width,
        height,
        near: View::NEAR_DEFAULT,
        samples: args.samples,
    };
    let state = FrameState {
        frame: FrameNumber(args.pose as u64),
        epoch: Epoch(1),
        eye: pose.pose().map_err(|error| CommandError::said(error.to_string()))?,
        environment: settings::environment(&args.air, &crate::rig_file::Air::default())?,
    };
    let threads = args.threads.unwrap_or_else(processors);
    let mut bench = Bench::new(&source.scene, threads)?;
    let drawn = bench.draw(&source.scene, pose, &state, &view, args.boards)?;
    write_png(&args.output, width, height, drawn.stitcher.canvas())?;
    if args.stats {
        say(&drawn.to_json(args, threads));
    }
    Ok(())
}

/// A manager's selection and one renderer that plays all boards.
struct Bench {
    store: SceneStore,
    renderer: Renderer,
}

struct Drawn {
    stitcher: Stitcher,
    stats: Vec<DrawStats>,
    selected: Selection,
    select_ms: f64,
    total_ms: f64,
}

impl Bench {
    fn new(scene: &Scene, threads: NonZeroUsize) -> Result<Self, CommandError> {
        let mut store = SceneStore::new();
        let refused = |error: channel::store::StoreError| CommandError::said(error.to_string());
        for (id, texture) in &scene.textures {
            store.insert_texture(*id, texture.as_ref().clone()).map_err(refused)?;
        }
        for (id, mesh) in &scene.meshes {
            store.insert_mesh(*id, mesh.as_ref().clone()).map_err(refused)?;
        }
        store.set_table(scene.table.clone()).map_err(refused)?;
        let renderer = Renderer::new(threads).map_err(|error| CommandError::said(error.to_string()))?;
        Ok(Self { store, renderer })
    }

    fn draw(
        &mut self,
        scene: &Scene,
        pose: &CameraPose,
        state: &FrameState,
        view: &View,
        boards: NonZeroUsize,
    ) -> Result<Drawn, CommandError> {
        let started = Instant::now();
        let entities = placed(scene, pose)?;
        let mut moved: Vec<Moved> = Vec::new();
        entities.moved(&mut moved);
        self.store.set_moved(&moved).map_err(|error| CommandError::said(error.to_string()))?;
        let mut selected = Selection::default();
        let visibility = state.environment.visibility_m;
        Selector::new().select(scene, &entities, state.eye, view, visibility, &mut selected);
        let select_ms = started.elapsed().as_secs_f64() * 1e3;

        let weights = vec![1; boards.get()];
        let mut stitcher = Stitcher::new();
        stitcher.set_views(std::slice::from_ref(view));
        let mut pictures = TilePictures::new();
        let mut stats = Vec::new();
        let mut keys = Vec::new();
        for board in 0..boards.get() {
            let key = BoardKey(board as u64);
            stitcher.on_board(key);
            keys.push(key);
            for share in shares(BoardId(board as u32), &weights, 1) {
                let drawn =
                    self.renderer.draw(&self.store, state, view, &selected.subobjects, &share.lattice, &mut pictures);
                stats.push(drawn.map_err(|error| CommandError::said(error.to_string()))?);
                let (count, size) = (pictures.tiles.len() as u32, (view.width, view.height));
                let payload = tile_payload(&pictures);
                stitcher
                    .on_tiles(key, state.frame, state.epoch, share.view, count, size, payload)
                    .map_err(|error| CommandError::said(error.to_string()))?;
            }
            stitcher.on_done(key, state.frame, state.epoch);
        }
        let (frame, epoch) = (state.frame, state.epoch);
        stitcher.on_swap(Swap { frame, epoch, complete: vec![true], boards: keys, preview: false });
        if stitcher.poll().is_none() {
            return Err(CommandError::said("the shares don't make a whole picture; please report this"));
        }
        let total_ms = started.elapsed().as_secs_f64() * 1e3;
        Ok(Drawn { stitcher, stats, selected, select_ms, total_ms })
    }
}

fn tile_payload(pictures: &TilePictures) -> Bytes {
    let mut payload = Vec::with_capacity(pictures.tiles.len() * 4 + pictures.rgb.len());
    for tile in &pictures.tiles {
        payload.extend_from_slice(&tile.x.to_le_bytes());
        payload.extend_from_slice(&tile.y.to_le_bytes());
    }
    payload.extend_from_slice(&pictures.rgb);
    payload.into()
}

/// The scene's entities where the pose puts them.
fn placed(scene: &Scene, pose: &CameraPose) -> Result<Entities, CommandError> {
    let mut entities = Entities::new(scene);
    for entity in &pose.entities {
        let Some(node) = scene.node_by_name(&entity.node) else {
            return Err(CommandError::said(format!(
                "the camera moves {:?}, but the scene has no such node",
                entity.node
            )));
        };
        let at = Pose::checked(DVec3::from_array(entity.position), DQuat::from_array(entity.orientation));
        entities.set(scene, node, at.map_err(|error| CommandError::said(error.to_string()))?);
    }
    Ok(entities)
}

impl Drawn {
    fn to_json(&self, args: &RenderArgs, threads: NonZeroUsize) -> String {
        let sum = |count: fn(&DrawStats) -> u64| self.stats.iter().map(count).sum::<u64>();
        let ms = |count: fn(&DrawStats) -> u64| sum(count) as f64 / 1e6;
        serde_json::json!({
            "scene": args.scene,
            "size": [args.size.0, args.size.1],
            "samples": args.samples.count(),
            "threads": threads,
            "boards": args.boards,
            "ms": self.total_ms,
            "stage_ms": {
                "select": self.select_ms,
                "geometry": ms(|s| s.geometry_ns),
                "raster": ms(|s| s.raster_ns),
                "translucency": ms(|s| s.translucency_ns),
                "resolve": ms(|s| s.resolve_ns),
            },
            "subobjects": self.selected.counters.subobjects_visible,
            "triangles": sum(|s| s.geometry.faces_in),
            "triangles_drawn": sum(|s| s.triangles_drawn),
            "fragments": sum(|s| s.fragments),
            "skipped": {
                "culled": self.selected.counters.subobjects_culled,
                "occluded": sum(|s| s.opaque.occluded + s.translucent.occluded),
                "backface": sum(|s| s.geometry.backface),
                "tiles_opaque": sum(|s| s.tiles_opaque),
                "pixels_single": sum(|s| s.pixels.pixels_single),
            },
        })
        .to_string()
    }
}
