//! What a frame shows: the scene with its moved entities, the eye, the views, and each view's list.

use super::lists::Lists;
use crate::scene::{Entities, NodeIndex, Scene};
use crate::select::{Counters, Selection, Selector};
use proto::frame::{Environment, Moved};
use proto::pose::{EntityRef, PosePacket, name_hash};
use proto::view::{Pose, Samples, Tangents, View};
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
}

impl DefaultRow {
    /// The views behind a window.
    pub fn views(&self, tangents: Tangents) -> Vec<View> {
        View::row(self.count, self.width, self.height, tangents, self.samples)
    }
}

/// What a manager shows.
#[derive(Clone, Debug)]
pub struct Stage {
    /// The world.
    pub scene: Arc<Scene>,
    /// The projectors.
    pub views: Vec<View>,
    /// Set when the views are a default row; a host's lens then makes them anew.
    pub row: Option<DefaultRow>,
    /// Light and air.
    pub environment: Environment,
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
    selector: Selector,
    selection: Selection,
    pub lists: Lists,
    pub moved: Vec<Moved>,
    /// Grows when the views change.
    pub views_revision: u64,
}

impl Director {
    pub(crate) fn new(stage: Stage) -> Self {
        let entities = Entities::new(&stage.scene);
        let names = stage.scene.node_names();
        let by_hash = names.filter_map(|n| Some((name_hash(n), stage.scene.node_by_name(n)?))).collect();
        Self {
            stage,
            entities,
            by_hash,
            selector: Selector::new(),
            selection: Selection::default(),
            lists: Lists::default(),
            moved: Vec::new(),
            views_revision: 1,
        }
    }

    pub(crate) fn views(&self) -> &[View] {
        &self.stage.views
    }

    pub(crate) fn eye(&self) -> Pose {
        self.stage.eye
    }

    pub(crate) fn environment(&self) -> Environment {
        self.stage.environment
    }

    /// Takes what a host said. Returns how many entities the scene doesn't have.
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
                EntityRef::Number(_) => None,
            };
            match node {
                Some(node) => self.entities.set(&self.stage.scene, node, entity.pose),
                None => unknown += 1,
            }
        }
        unknown
    }

    /// Makes the lists of all views for the present eye and entities. Returns the counts, one entry per view.
    pub(crate) fn select(&mut self) -> impl Iterator<Item = Counters> {
        self.entities.moved(&mut self.moved);
        let mut counts = Vec::with_capacity(self.stage.views.len());
        for (i, view) in self.stage.views.iter().enumerate() {
            let Stage { scene, eye, environment, .. } = &self.stage;
            let visibility = environment.visibility_m;
            self.selector.select(scene, &self.entities, *eye, view, visibility, &mut self.selection);
            counts.push(self.selection.counters);
            self.lists.set(i, &mut self.selection.subobjects);
        }
        counts.into_iter()
    }
}
