//! Models: what merges its translucent layers, or exists in several versions (picture.md, "Translucency").
//!
//! A model is a node and all below it. Models don't nest, because the formula has no meaning for it; that is checked
//! here, while nodes are met in order. In a level-of-detail model each version has a root of its own at or below the
//! model's node; what belongs to none of them is drawn always, like anything that is in no model.

use super::database::{Node, NodeIndex, Scene, node_label};
use super::parts::{AssembleError, NodeSource};
use proto::frame::VersionWeights;
use proto::ids::{ModelId, ObjectId};
use proto::limits;
use proto::scene::{ModelPart, ModelRow};
use std::collections::BTreeMap;
use thiserror::Error;

/// How much more than 1 a list of weights may sum up to: what decimal digits in a file cost.
const SUM_TOLERANCE: f64 = 1e-6;

/// A model of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Model {
    /// The node that it begins with.
    pub node: NodeIndex,
    /// If only a part of that node's mesh is marked: that object. Then nothing below belongs to it.
    pub only: Option<ObjectId>,
    /// Whether its translucent layers merge.
    pub merged: bool,
    /// Number of versions, at least 1.
    pub versions: u32,
}

/// Why weights of versions can't be used.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum VersionsError {
    /// No model of that name.
    #[error("no model begins at a node {name:?}; models are nodes that are merged or have levels of detail")]
    Unknown {
        /// The name.
        name: String,
    },
    /// Too few or too many weights.
    #[error("{name:?} has {versions} versions, {count} weights are given")]
    Count {
        /// The name.
        name: String,
        /// How many versions there are.
        versions: u32,
        /// How many weights were given.
        count: usize,
    },
    /// A weight below 0, or that is no number.
    #[error("{name:?} is given the weight {weight}; weights are from 0 to 1")]
    Weight {
        /// The name.
        name: String,
        /// The weight.
        weight: f64,
    },
    /// More than the whole.
    #[error("the weights of {name:?} sum up to {sum}, at most 1 is possible (less means that a part shows nothing)")]
    Sum {
        /// The name.
        name: String,
        /// The sum.
        sum: f64,
    },
    /// Two names for one model.
    #[error("{first:?} and {second:?} are the same model; give its weights once")]
    Twice {
        /// One name.
        first: String,
        /// The other.
        second: String,
    },
}

/// Finds the models while the nodes are met, depth first.
#[derive(Debug, Default)]
pub(super) struct Finder {
    pub(super) models: Vec<Model>,
}

impl Finder {
    /// Where a node belongs: its model, and the version there.
    pub(super) fn place(
        &mut self,
        source: &NodeSource,
        index: NodeIndex,
        parent: Option<&Node>,
        nodes: &[Node],
    ) -> Result<(Option<ModelId>, Option<u32>), AssembleError> {
        let around = parent.and_then(|parent| parent.model);
        let begins_levels = source.levels > 1;
        let root_of_version = source.version.filter(|_| !begins_levels && around.is_some());
        let merged = source.extras.merged == Some(true);
        if begins_levels || (merged && root_of_version.is_none()) {
            let how = if begins_levels { "has levels of detail" } else { "is merged" };
            if let Some(outer) = around {
                return Err(self.nested(source, index, how, outer, nodes));
            }
            let versions = source.levels.max(1);
            let id = self.add(Model { node: index, only: None, merged, versions });
            return Ok((Some(id), if begins_levels { source.version } else { Some(0) }));
        }
        if let (Some(version), Some(model)) = (root_of_version, around) {
            self.models[model.0 as usize].merged |= merged; // each level is marked: so the model is
            return Ok((around, Some(version)));
        }
        Ok((around, parent.and_then(|parent| parent.version)))
    }

    /// The model of those parts of an object's mesh that are marked as merged themselves.
    pub(super) fn marked_parts(
        &mut self,
        source: &NodeSource,
        object: ObjectId,
        node: &Node,
        index: NodeIndex,
        nodes: &[Node],
    ) -> Result<Option<ModelPart>, AssembleError> {
        let model = match node.model {
            None => self.add(Model { node: index, only: Some(object), merged: true, versions: 1 }),
            // The mark says again what holds already.
            Some(outer) if self.models[outer.0 as usize].merged => return Ok(node.part()),
            Some(outer) => return Err(self.nested(source, index, "shows a mesh with a merged part", outer, nodes)),
        };
        Ok(Some(ModelPart { model, version: 0 }))
    }

    pub(super) fn rows(&self) -> Vec<ModelRow> {
        self.models.iter().map(|model| ModelRow { merged: model.merged, versions: model.versions }).collect()
    }

    /// What the models are called: by their nodes, the first of a name; and by the common name of sibling levels, where
    /// that is nobody's own.
    pub(super) fn names(&self, nodes: &[Node]) -> BTreeMap<String, ModelId> {
        let mut names = BTreeMap::new();
        let of = |model: &Model| nodes[model.node.0 as usize].name.as_str();
        let common = |model: &Model| {
            let name = of(model);
            let at = name.len().checked_sub(LOD0.len()).filter(|_| model.versions > 1)?;
            name.get(at..).filter(|end| end.eq_ignore_ascii_case(LOD0))?;
            name.get(..at)
        };
        let ids = || (0..).map(ModelId).zip(&self.models);
        let own = ids().map(|(id, model)| (id, Some(of(model))));
        for (id, name) in own.chain(ids().map(|(id, model)| (id, common(model)))) {
            if let Some(name) = name.filter(|name| !name.is_empty()) {
                names.entry(name.to_owned()).or_insert(id);
            }
        }
        names
    }

    fn add(&mut self, model: Model) -> ModelId {
        self.models.push(model);
        ModelId(self.models.len() as u32 - 1)
    }

    fn nested(
        &self,
        source: &NodeSource,
        index: NodeIndex,
        how: &'static str,
        outer: ModelId,
        nodes: &[Node],
    ) -> AssembleError {
        let outer = self.models[outer.0 as usize].node;
        let label = |name: &str, index: NodeIndex| node_label(name, index.0 as usize);
        // The outer node may be this very node, which is not in the list yet.
        let outer_name = nodes.get(outer.0 as usize).map_or(source.name.as_str(), |node| node.name.as_str());
        AssembleError::NestedModel { node: label(&source.name, index), how, outer: label(outer_name, outer) }
    }
}

impl Scene {
    /// The first model that begins at a node of that name; for one made of siblings `hut_LOD0`, `hut_LOD1` …, `hut` is a name
    /// too.
    pub fn model_of(&self, node_name: &str) -> Option<ModelId> {
        self.model_names.get(node_name).copied()
    }

    /// Every name that [`Self::model_of`] knows, with its model.
    pub fn model_names(&self) -> impl Iterator<Item = (&str, ModelId)> {
        self.model_names.iter().map(|(name, &model)| (name.as_str(), model))
    }

    /// The weights that a pose gives to versions, by the names of nodes, finest first: checked, by model.
    ///
    /// # Errors
    /// [`VersionsError`], with the name.
    pub fn version_weights(&self, versions: &BTreeMap<String, Vec<f64>>) -> Result<Vec<VersionWeights>, VersionsError> {
        let mut found: BTreeMap<ModelId, (&String, Vec<f32>)> = BTreeMap::new();
        for (name, weights) in versions {
            let model = self.model_of(name).ok_or_else(|| VersionsError::Unknown { name: name.clone() })?;
            let versions = self.models[model.0 as usize].versions;
            if weights.len() != versions as usize {
                return Err(VersionsError::Count { name: name.clone(), versions, count: weights.len() });
            }
            if let Some(&weight) = weights.iter().find(|weight| !(0.0..=1.0 + SUM_TOLERANCE).contains(*weight)) {
                return Err(VersionsError::Weight { name: name.clone(), weight });
            }
            let sum: f64 = weights.iter().sum();
            if sum > 1.0 + SUM_TOLERANCE {
                return Err(VersionsError::Sum { name: name.clone(), sum });
            }
            let weights = weights.iter().map(|&weight| weight.min(1.0) as f32).collect();
            if let Some((first, _)) = found.insert(model, (name, weights)) {
                return Err(VersionsError::Twice { first: first.clone(), second: name.clone() });
            }
        }
        Ok(found.into_iter().map(|(model, (_, weights))| VersionWeights { model, weights }).collect())
    }
}

/// What the finest of sibling levels is called; in any case of letters.
const LOD0: &str = "_LOD0";

const _: () = assert!(limits::VERSIONS_MAX <= 16, "selection keeps a bit for each version of a model in a u16");
