//! What a frame shows: the scene with its moved entities, the eye, the views, and each view's list.
//!
//! Two steps. [`Director::select`] says what should be seen, if anything has changed that decides it; [`Director::settle`] makes of that what
//! frames show, given what boards can draw. A still scene passes both without any work.

use super::changes::Book;
use super::lists::Lists;
use super::residency::{Available, Catalogue, foresight, substitute};
use crate::scene::{Entities, NodeIndex, Scene};
use crate::select::{Counters, Detail, DetailMode, LevelTable, Selector, Sight, detail};
use proto::frame::{Environment, Moved, VersionWeights};
use proto::ids::{ModelId, SubobjectId};
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
    /// The projectors, at full resolution.
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

/// What a frame shows instead of what it should.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Substituted {
    /// Models that show other versions than they should.
    pub models: u64,
    /// Subobjects left out, each view counted.
    pub omitted: u64,
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
    /// How many pixels of the stage's views, each way, one pixel drawn stands for.
    scale: u32,
    /// The stage's views at that scale: what boards draw.
    drawn: Vec<ViewSetup>,
    selector: Selector,
    /// Asks what else than now and here: other versions, other places. Apart, so that the first has its last answer again.
    elsewhere: Selector,
    /// Those that are drawn, as selection takes them.
    views: Vec<View>,
    /// A list in the making.
    list: Vec<SubobjectId>,
    /// The views' lists if every board held everything.
    wanted: Vec<Vec<SubobjectId>>,
    /// Likewise how models are mixed, by the host or by detail; those that aren't named show their finest version.
    weights: Vec<VersionWeights>,
    /// Something has changed since the last selection that decides what is seen.
    is_stale: bool,
    /// For which choice of what is available lists were made last.
    settled: Option<Available>,
    substituted: Substituted,
    /// What frames show.
    pub lists: Lists,
    /// The objects that aren't where the tables have them.
    pub moved: Book<Moved>,
    /// How models are mixed in frames.
    pub mixtures: Book<VersionWeights>,
    /// Models that the host mixes, ascending.
    given: Vec<VersionWeights>,
    /// Grows when what boards draw changes its views.
    pub views_revision: u64,
    /// Grows when the stage's views change.
    pub layout_revision: u64,
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
        let drawn = stage.views.clone();
        Self {
            stage,
            scale: 1,
            drawn,
            entities,
            by_hash,
            models,
            detail,
            selector: Selector::new(),
            elsewhere: Selector::new(),
            views: Vec::new(),
            list: Vec::new(),
            wanted: Vec::new(),
            weights: Vec::new(),
            is_stale: true,
            settled: None,
            substituted: Substituted::default(),
            lists: Lists::default(),
            moved: Book::default(),
            mixtures: Book::default(),
            given: Vec::new(),
            views_revision: 1,
            layout_revision: 1,
        }
    }

    /// What boards draw.
    pub(crate) fn views(&self) -> &[ViewSetup] {
        &self.drawn
    }

    /// What the stitched picture is made of: the same at full resolution.
    pub(crate) fn layout(&self) -> &[ViewSetup] {
        &self.stage.views
    }

    /// Lets one pixel drawn stand for so many of the picture's, each way.
    pub(crate) fn set_scale(&mut self, scale: u32) {
        if scale != self.scale {
            self.scale = scale;
            self.draw_anew();
        }
    }

    /// Shares all views in this way from the next frame on, or looks at so many points of each pixel.
    pub(crate) fn set_sharing(&mut self, mode: Option<Mode>, samples: Option<Samples>) {
        for setup in &mut self.stage.views {
            setup.mode = mode.unwrap_or(setup.mode);
            setup.view.samples = samples.unwrap_or(setup.view.samples);
        }
        if let Some(row) = &mut self.stage.row {
            row.mode = mode.unwrap_or(row.mode);
            row.samples = samples.unwrap_or(row.samples);
        }
        self.layout_revision += 1;
        self.draw_anew();
    }

    fn draw_anew(&mut self) {
        let scale = self.scale;
        let drawn = self.stage.views.iter().map(|setup| ViewSetup { view: setup.view.at_scale(scale), ..*setup });
        self.drawn = drawn.collect();
        self.views_revision += 1;
        self.is_stale = true;
    }

    /// The factor K of detail: display elements that a critical radius spans, times its distance in radii.
    pub(crate) fn display_factor(&self) -> f64 {
        detail::display_factor(self.drawn.iter().map(|setup| &setup.view))
    }

    /// Models that are between two levels, or fading; and how many there are.
    pub(crate) fn in_transition(&self) -> (usize, usize) {
        let is_between = |row: &&VersionWeights| row.weights.iter().any(|weight| *weight > 0.0 && *weight < 1.0);
        (self.weights.iter().filter(is_between).count(), self.stage.scene.table.models.len())
    }

    pub(crate) fn eye(&self) -> Pose {
        self.stage.eye
    }

    pub(crate) fn environment(&self) -> Environment {
        self.stage.environment
    }

    /// Takes what a host said. Returns how many entities and models the scene doesn't have.
    pub(crate) fn on_pose(&mut self, packet: &PosePacket) -> u64 {
        self.is_stale |= self.stage.eye != packet.eye;
        self.stage.eye = packet.eye;
        if let (Some(lens), Some(row)) = (packet.lens, self.stage.row) {
            let views = row.views(lens);
            if views != self.stage.views {
                self.stage.views = views;
                self.layout_revision += 1;
                self.draw_anew();
            }
        }
        let mut unknown = 0;
        for entity in &packet.entities {
            let node = match entity.entity {
                EntityRef::NameHash(hash) => self.by_hash.get(&hash).copied(),
                EntityRef::Number(number) => self.stage.scene.node_by_entity(number),
            };
            match node {
                Some(node) => {
                    self.is_stale |= self.entities.poses().get(&node) != Some(&entity.pose);
                    self.entities.set(&self.stage.scene, node, entity.pose);
                }
                None => unknown += 1,
            }
        }
        let before = std::mem::take(&mut self.given);
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
        self.is_stale |= self.given != before;
        unknown
    }

    /// Selects what all views should show to the present eye with the present entities; the counts, one entry per view. `None`: nothing
    /// has changed since, and what was selected holds.
    pub(crate) fn select(&mut self) -> Option<Vec<Counters>> {
        if !std::mem::take(&mut self.is_stale) {
            return None;
        }
        self.settled = None;
        let (Stage { scene, environment, eye, .. }, views) = (&self.stage, &self.drawn);
        let factor = detail::display_factor(views.iter().map(|setup| &setup.view));
        let (given, out) = (&self.given, &mut self.weights);
        self.detail.select(scene, &self.entities, given, eye.position, factor, environment.visibility_m, out);
        self.views.clear();
        self.views.extend(views.iter().map(|setup| setup.view));
        self.wanted.resize(self.views.len(), Vec::new());
        let sight = Sight::whole(*eye, &self.views, environment.visibility_m);
        self.selector.select(scene, &self.entities, &self.weights, &sight);
        let found = self.selector.found();
        for (wanted, selection) in self.wanted.iter_mut().zip(found) {
            wanted.clone_from(&selection.subobjects);
        }
        Some(found.iter().map(|selection| selection.counters).collect())
    }

    /// What a view should show.
    pub(crate) fn wanted(&self, view: usize) -> &[SubobjectId] {
        self.wanted.get(view).map_or(&[], Vec::as_slice)
    }

    /// Makes of what should be seen what frames show, boards having what is available.
    pub(crate) fn settle(&mut self, catalogue: &Catalogue, available: &Available) -> Substituted {
        if self.settled.as_ref() == Some(available) {
            return self.substituted;
        }
        self.substituted = Substituted::default();
        let mixed = if available.is_all() {
            None
        } else {
            substitute::models(catalogue, &self.wanted, &self.weights, available)
        };
        let mut weights = match mixed {
            Some((weights, models)) => {
                self.substituted.models = models;
                weights
            }
            None => self.weights.clone(),
        };
        let has_others = self.substituted.models > 0;
        if has_others {
            // Other versions are seen elsewhere.
            let Stage { scene, environment, eye, .. } = &self.stage;
            let sight = Sight::whole(*eye, &self.views, environment.visibility_m);
            self.elsewhere.select(scene, &self.entities, &weights, &sight);
        }
        for view in 0..self.wanted.len() {
            let list = &mut self.list;
            list.clone_from(if has_others { &self.elsewhere.found()[view].subobjects } else { &self.wanted[view] });
            if !available.is_all() {
                self.substituted.omitted += substitute::omit(catalogue, view, list, available);
            }
            self.lists.set(view, list);
        }
        self.mixtures.set(&mut weights, |row| row.model, |row| VersionWeights { weights: Vec::new(), ..row.clone() });
        let mut moved = Vec::new();
        self.entities.moved(&mut moved);
        let home = &self.stage.scene.table.objects;
        let rest = |row: &Moved| Moved { transform: home[row.object.0 as usize].transform, ..*row };
        self.moved.set(&mut moved, |row| row.object, rest);
        self.settled = Some(available.clone());
        self.substituted
    }

    /// What a view, a little widened, would show to an eye elsewhere.
    pub(crate) fn foresee(&mut self, view: usize, eye: Pose) -> &[SubobjectId] {
        let (Stage { scene, environment, .. }, views) = (&self.stage, &self.drawn);
        let Some(setup) = views.get(view) else { return &[] };
        let factor = detail::display_factor(views.iter().map(|setup| &setup.view));
        let (entities, visibility) = (&self.entities, environment.visibility_m);
        let mut weights = Vec::new();
        self.detail.select(scene, entities, &self.given, eye.position, factor, visibility, &mut weights);
        let view = foresight::widened(&setup.view);
        let sight = Sight::whole(eye, std::slice::from_ref(&view), visibility);
        self.elsewhere.select(scene, entities, &weights, &sight);
        &self.elsewhere.found()[0].subobjects
    }
}
