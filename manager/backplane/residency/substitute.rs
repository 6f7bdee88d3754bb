//! What a frame shows of what isn't at every board of its view: the best version of a model that is, or nothing.
//!
//! Decided here, once for all boards, when lists are made; a board never chooses, so the boards of a view never differ. A model is
//! shown alike in all views that it is seen in, or it would have a seam at their border.
//!
//! A mesh whose textures are missing counts as missing: with another look it would change its colour when they come, and boards would
//! need yet another number to agree on what to draw.

use super::bits::Bits;
use super::catalogue::Catalogue;
use proto::frame::VersionWeights;
use proto::ids::{ModelId, SubobjectId};
use std::collections::BTreeMap;

/// By view: what all of its boards hold; `None`: every piece.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Available {
    pub views: Vec<Option<Bits>>,
}

impl Available {
    /// Whether there is nothing that isn't everywhere.
    pub(crate) fn is_all(&self) -> bool {
        self.views.iter().all(Option::is_none)
    }

    /// Whether all boards of the view can draw the mesh.
    pub(crate) fn has(&self, catalogue: &Catalogue, view: usize, mesh: u32) -> bool {
        match self.views.get(view) {
            Some(Some(held)) => catalogue.unit(mesh).all(|piece| held.has(piece)),
            _ => true,
        }
    }
}

/// The weights that models have instead of `weights` (ascending, as is what is returned) when the views list `lists`, and how many models
/// that changes. `None`: none.
pub(crate) fn models(
    catalogue: &Catalogue,
    lists: &[Vec<SubobjectId>],
    weights: &[VersionWeights],
    available: &Available,
) -> Option<(Vec<VersionWeights>, u64)> {
    // By model of several versions: the views that it is seen in.
    let mut seen: BTreeMap<u32, u64> = BTreeMap::new();
    for (view, list) in lists.iter().enumerate() {
        for part in list.iter().filter_map(|subobject| catalogue.part(*subobject)) {
            *seen.entry(part.model.0).or_default() |= 1 << view;
        }
    }
    let mut changed: BTreeMap<u32, Vec<f32>> = BTreeMap::new();
    for (model, views) in seen {
        let versions = catalogue.versions(model);
        let is_held = |version: usize| {
            let mut views = (0..lists.len()).filter(|view| views >> view & 1 == 1);
            views.all(|view| versions[version].iter().all(|mesh| available.has(catalogue, view, *mesh)))
        };
        let given = weights.binary_search_by_key(&model, |row| row.model.0).ok().map(|k| &weights[k].weights);
        let wanted = |version: usize| match given {
            Some(weights) => weights.get(version).copied().unwrap_or(0.0),
            None => f32::from(u8::from(version == 0)),
        };
        if (0..versions.len()).all(|version| wanted(version) == 0.0 || is_held(version)) {
            continue;
        }
        let held: Vec<usize> = (0..versions.len()).filter(|version| is_held(*version)).collect();
        let mut mixed = vec![0.0; versions.len()];
        for version in 0..versions.len() {
            // The next coarser or finer; of two as near, the finer.
            if let Some(best) = held.iter().min_by_key(|other| (other.abs_diff(version), **other)) {
                mixed[*best] += wanted(version);
            }
        }
        changed.insert(model, mixed);
    }
    if changed.is_empty() {
        return None;
    }
    let count = changed.len() as u64;
    let kept = weights.iter().filter(|row| !changed.contains_key(&row.model.0)).cloned();
    let mut all: Vec<VersionWeights> = kept.collect();
    all.extend(changed.into_iter().map(|(model, weights)| VersionWeights { model: ModelId(model), weights }));
    all.sort_by_key(|row| row.model);
    Some((all, count))
}

/// Leaves out of a view's list what not all of its boards can draw; returns how many that are.
pub(crate) fn omit(catalogue: &Catalogue, view: usize, list: &mut Vec<SubobjectId>, available: &Available) -> u64 {
    let before = list.len();
    list.retain(|subobject| catalogue.mesh_of(*subobject).is_some_and(|mesh| available.has(catalogue, view, mesh)));
    (before - list.len()) as u64
}
