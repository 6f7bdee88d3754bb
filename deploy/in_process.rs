//! A manager's selection and one renderer in this process: what `render` and `bench` draw with, the same stages that a
//! rig runs, without a network.

use crate::cli::AirArgs;
use crate::error::CommandError;
use crate::{rig_file, settings};
use channel::pipeline::{DrawStats, Renderer, TilePictures};
use channel::store::SceneStore;
use glam::{DQuat, DVec3};
use manager::host::camera::CameraPose;
use manager::scene::{Entities, Scene};
use manager::select::{Detail, DetailMode, LevelTable, Selection, Selector, Sight, detail};
use proto::debug::DebugPicture;
use proto::frame::{FrameState, Moved, VersionWeights};
use proto::ids::{Epoch, FrameNumber};
use proto::share::Part;
use proto::view::{Pose, Samples, View};
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Instant;

/// See the module's head.
pub(crate) struct InProcess<'a> {
    scene: &'a Scene,
    store: SceneStore,
    renderer: Renderer,
    detail: Detail,
    weights: Vec<VersionWeights>,
    selector: Selector,
    /// Time of the last selection, ms.
    pub select_ms: f64,
}

fn said(error: impl std::fmt::Display) -> CommandError {
    CommandError::said(error.to_string())
}

impl<'a> InProcess<'a> {
    /// Takes the scene's content in.
    pub(crate) fn new(scene: &'a Scene, threads: NonZeroUsize, detail: DetailMode) -> Result<Self, CommandError> {
        let mut store = SceneStore::new();
        for id in scene.textures.keys() {
            store.insert_texture(*id, Arc::unwrap_or_clone(scene.textures.get(id)?)).map_err(said)?;
        }
        for id in scene.meshes.keys() {
            store.insert_mesh(*id, Arc::unwrap_or_clone(scene.meshes.get(id)?)).map_err(said)?;
        }
        store.set_table(scene.table.clone()).map_err(said)?;
        let renderer = Renderer::new(threads).map_err(said)?;
        let selector = Selector::new();
        let detail = Detail::new(scene, detail, LevelTable::default());
        Ok(Self { scene, store, renderer, detail, weights: Vec::new(), selector, select_ms: 0.0 })
    }

    /// Its renderer, to set options of.
    pub(crate) fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// Puts entities and versions where the pose wants them and selects for the view.
    pub(crate) fn select(&mut self, pose: &CameraPose, state: &FrameState, view: &View) -> Result<(), CommandError> {
        let started = Instant::now();
        let entities = placed(self.scene, pose)?;
        let mut moved: Vec<Moved> = Vec::new();
        entities.moved(&mut moved);
        self.store.set_moved(&moved).map_err(said)?;
        let given = self.scene.version_weights(&pose.versions).map_err(said)?;
        let visibility = state.environment.visibility_m;
        let (factor, eye) = (detail::display_factor([view]), state.eye.position);
        self.detail.select(self.scene, &entities, &given, eye, factor, visibility, &mut self.weights);
        self.store.set_weights(&self.weights).map_err(said)?;
        let sight = Sight::whole(state.eye, std::slice::from_ref(view), visibility);
        self.selector.select(self.scene, &entities, &self.weights, &sight);
        self.select_ms = started.elapsed().as_secs_f64() * 1e3;
        Ok(())
    }

    /// What the view sees.
    ///
    /// # Panics
    /// If nothing was selected yet.
    pub(crate) fn selection(&self) -> &Selection {
        &self.selector.found()[0]
    }

    /// Draws a part of what was selected.
    pub(crate) fn draw(
        &mut self,
        state: &FrameState,
        view: &View,
        part: &Part,
        out: &mut TilePictures,
    ) -> Result<DrawStats, CommandError> {
        let list = &self.selector.found()[0].subobjects;
        self.renderer.draw(&self.store, state, view, list, part, out).map_err(said)
    }
}

/// The scene's entities where the pose puts them.
pub(crate) fn placed(scene: &Scene, pose: &CameraPose) -> Result<Entities, CommandError> {
    let mut entities = Entities::new(scene);
    for entity in &pose.entities {
        let Some(node) = scene.node_by_name(&entity.node) else {
            return Err(said(format!("the camera moves {:?}, but the scene has no such node", entity.node)));
        };
        let at = Pose::checked(DVec3::from_array(entity.position), DQuat::from_array(entity.orientation));
        entities.set(scene, node, at.map_err(said)?);
    }
    Ok(entities)
}

/// What is drawn of a pose: frame 0, the whole of one view.
pub(crate) fn look(
    pose: &CameraPose,
    (width, height): (u32, u32),
    air: &AirArgs,
    samples: Samples,
) -> Result<(FrameState, View), CommandError> {
    let view = View {
        offset: Pose::IDENTITY,
        tangents: pose.lens(width, height),
        width,
        height,
        near: View::NEAR_DEFAULT,
        samples,
    };
    let state = FrameState {
        frame: FrameNumber(0),
        epoch: Epoch(1),
        eye: pose.pose().map_err(said)?,
        environment: settings::environment(air, &rig_file::Air::default())?,
        debug: DebugPicture::Off,
    };
    Ok((state, view))
}
