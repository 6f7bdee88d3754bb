//! What a frame shows: the scene with its moved entities, the eye, the views, and each view's list.

use super::lists::Lists;
use crate::scene::{Entities, NodeIndex, Scene};
use crate::select::{Counters, Detail, DetailMode, LevelTable, Selector, Sight, detail};
use proto::frame::{Environment, Moved, VersionWeights};
use proto::ids::ModelId;
use proto::pose::{EntityRef, PosePacket, name_hash};
use proto::view::{Mode, Pose, Samples, Tangents, View, ViewSetup};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The default views: a row round the eyepoint that follows the host's lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DefaultRow {
    /// How many.
    pub count: u32,
    /// Width of each, pixels.
    pub width: u32,
    /// Height of each, pixels.
    pub height: u32,
    /// Points per pixel.
    pub samples: Samples,
    /// How each is shared between boards.
    pub mode: Mode,
}

impl DefaultRow {
    /// The views behind a window.
    pub fn views(&self, tangents: Tangents) -> Vec<ViewSetup> {
        let views = View::row(self.count, self.width, self.height, tangents, self.samples);
        views.into_iter().map(|view| ViewSetup { mode: self.mode, ..ViewSetup::new(view) }).collect()
    }
}

/// What a manager shows.
#[derive(Clone, Debug)]
pub struct Stage {
    /// The world.
    pub scene: Arc<Scene>,
    /// The projectors.
    pub views: Vec<ViewSetup>,
    /// Set when the views are a default row; a host's lens then makes them anew.
    pub row: Option<DefaultRow>,
    /// Light and air.
    pub environment: Environment,
    /// Whether models are shown by the rules of detail.
    pub detail: DetailMode,
    /// The eye until a host speaks.
    pub eye: Pose,
}

/// See the module's head.
#[derive(Debug)]
pub(crate) struct Director {
    stage: Stage,
    entities: Entities,
    /// Nodes by the hash of their names, for hosts that name entities so.
    by_hash: BTreeMap<u64, NodeIndex>,
    /// Models by the hash of their nodes' names, and how many versions each has.
    models: BTreeMap<u64, (ModelId, u32)>,
    detail: Detail,
    selector: Selector,
    /// Those of the stage, as selection takes them.
    views: Vec<View>,
    pub lists: Lists,
    pub moved: Vec<Moved>,
    /// Models that the host mixes, ascending.
    given: Vec<VersionWeights>,
    /// How models are mixed in this frame, by the host or by detail; those that aren't named show their finest version.
    pub weights: Vec<VersionWeights>,
    /// Grows when the views change.
    pub views_revision: u64,
}

impl Director {
    pub(crate) fn new(stage: Stage) -> Self {
        let entities = Entities::new(&stage.scene);
        let names = stage.scene.node_names();
        let by_hash = names.filter_map(|n| Some((name_hash(n), stage.scene.node_by_name(n)?))).collect();
        let models = stage.scene.model_names().map(|(name, id)| {
            let versions = stage.scene.table.models[id.0 as usize].versions;
            (name_hash(name), (id, versions))
        });
        let models = models.collect();
        let detail = Detail::new(&stage.scene, stage.detail, LevelTable::default());
        Self {
            stage,
            entities,
            by_hash,
            models,
            detail,
            selector: Selector::new(),
            views: Vec::new(),
            lists: Lists::default(),
            moved: Vec::new(),
            given: Vec::new(),
            weights: Vec::new(),
            views_revision: 1,
        }
    }

    pub(crate) fn views(&self) -> &[ViewSetup] {
        &self.stage.views
    }

    pub(crate) fn eye(&self) -> Pose {
        self.stage.eye
    }

    pub(crate) fn environment(&self) -> Environment {
        self.stage.environment
    }

    /// Takes what a host said. Returns how many entities and models the scene doesn't have.
    pub(crate) fn on_pose(&mut self, packet: &PosePacket) -> u64 {
        self.stage.eye = packet.eye;
        if let (Some(lens), Some(row)) = (packet.lens, self.stage.row) {
            let views = row.views(lens);
            if views != self.stage.views {
                self.stage.views = views;
                self.views_revision += 1;
            }
        }
        let mut unknown = 0;
        for entity in &packet.entities {
            let node = match entity.entity {
                EntityRef::NameHash(hash) => self.by_hash.get(&hash).copied(),
                EntityRef::Number(number) => self.stage.scene.node_by_entity(number),
            };
            match node {
                Some(node) => self.entities.set(&self.stage.scene, node, entity.pose),
                None => unknown += 1,
            }
        }
        self.given.clear();
        for model in &packet.models {
            match self.models.get(&model.name) {
                Some((id, versions)) if *versions as usize == model.weights.len() => {
                    self.given.push(VersionWeights { model: *id, weights: model.weights.clone() });
                }
                _ => unknown += 1,
            }
        }
        // Two names can mean one model; the later word holds.
        self.given.reverse();
        self.given.sort_by_key(|given| given.model);
        self.given.dedup_by_key(|given| given.model);
        unknown
    }

    /// Makes the lists of all views for the present eye and entities. Returns the counts, one entry per view.
    pub(crate) fn select(&mut self) -> impl Iterator<Item = Counters> {
        self.entities.moved(&mut self.moved);
        let Stage { scene, views, environment, eye, .. } = &self.stage;
        let factor = detail::display_factor(views.iter().map(|setup| &setup.view));
        let (given, out) = (&self.given, &mut self.weights);
        self.detail.select(scene, &self.entities, given, eye.position, factor, environment.visibility_m, out);
        self.views.clear();
        self.views.extend(views.iter().map(|setup| setup.view));
        let sight = Sight::whole(*eye, &self.views, environment.visibility_m);
        if self.selector.select(scene, &self.entities, &self.weights, &sight) {
            for (i, selection) in self.selector.found_mut().iter_mut().enumerate() {
                self.lists.set(i, &mut selection.subobjects);
            }
        }
        self.selector.found().iter().map(|selection| selection.counters)
    }
}
