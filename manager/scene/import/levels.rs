//! Levels of detail of the file: which nodes are versions of one thing.
//!
//! Three notations: `MSFT_lod` at the finest node, with the indices of the coarser ones; `levels` in a node's scene extras, with
//! the names of all; and siblings called `hut_LOD0`, `hut_LOD1` … (0 the finest). All three become the same thing: a
//! node that begins a model, and the roots of its versions at or below it. A root that the file has elsewhere (beside the
//! finest, or nowhere in the scene) is *adopted*: taken from its place and put below the model's node, where its
//! transformation is made relative to that node so that it stands where it stood. Then whoever moves the model's node
//! moves all versions, which is what a host means by it.

use super::Warnings;
use super::accessor::at;
use super::error::Fault;
use super::tree::{children, label};
use crate::scene::Extras;
use gltf::json::Root;
use serde::Deserialize;
use std::collections::BTreeMap;

/// `MSFT_lod` at a node.
#[derive(Debug, Deserialize)]
struct MsftLod {
    ids: Vec<usize>,
}

/// What is a version of what; indices are those of the file's nodes.
#[derive(Debug, Default)]
pub(super) struct Levels {
    /// How many versions the model has that begins here.
    pub(super) models: BTreeMap<usize, u32>,
    /// Which version has its root here.
    pub(super) versions: BTreeMap<usize, u32>,
    /// The model's node that adopts this one.
    pub(super) adopted_by: BTreeMap<usize, usize>,
    /// Whom a model's node adopts.
    pub(super) adopts: BTreeMap<usize, Vec<usize>>,
}

/// Finds all levels of detail. `parents` and `said` (the scene extras) are by node.
pub(super) fn find(
    root: &Root,
    parents: &[Option<usize>],
    said: &[Extras],
    warnings: &mut Warnings,
) -> Result<Levels, Fault> {
    let mut levels = Levels::default();
    for (node, described) in root.nodes.iter().enumerate() {
        let lod = described.extensions.as_ref().and_then(|all| all.others.get("MSFT_lod"));
        if let Some(lod) = lod {
            let place = label(root, node);
            let MsftLod { ids } = MsftLod::deserialize(lod)
                .map_err(|error| Fault::Json { message: format!("{place}: MSFT_lod: {error}") })?;
            for &id in &ids {
                at(&root.nodes, id, "node", &place)?;
            }
            let all: Vec<usize> = std::iter::once(node).chain(ids).collect();
            levels.add(root, parents, node, &all)?;
        }
    }
    let mut by_name: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    if said.iter().any(|extras| extras.levels.is_some()) {
        for (node, described) in root.nodes.iter().enumerate() {
            by_name.entry(described.name.as_deref().unwrap_or_default()).or_default().push(node);
        }
    }
    for (node, extras) in said.iter().enumerate() {
        let Some(names) = &extras.levels else { continue };
        if levels.models.contains_key(&node) {
            warnings.add(format!("{}: it has MSFT_lod, so extras.cyclorama.levels is ignored", label(root, node)));
            continue;
        }
        let all = names
            .iter()
            .map(|name| {
                let called = by_name.get(name.as_str()).map_or(&[][..], Vec::as_slice);
                nearest(parents, node, called).ok_or_else(|| Fault::Levels {
                    place: label(root, node),
                    what: format!("there is no node {name:?}, which it names as a level of detail"),
                })
            })
            .collect::<Result<Vec<usize>, Fault>>()?;
        if all.iter().skip(1).any(|&level| level == node) {
            let what = "it is named among its own levels of detail, but not as the finest".into();
            return Err(Fault::Levels { place: label(root, node), what });
        }
        levels.add(root, parents, node, &all)?;
    }
    levels.siblings(root, parents, warnings)?;
    levels.check(root, parents)?;
    Ok(levels)
}

/// Of nodes with one name the one that `node` means: itself, else one below it, else one beside it, else the first.
fn nearest(parents: &[Option<usize>], node: usize, called: &[usize]) -> Option<usize> {
    let find = |means: &dyn Fn(usize) -> bool| called.iter().copied().find(|&candidate| means(candidate));
    find(&|candidate| candidate == node)
        .or_else(|| find(&|candidate| is_below(parents, candidate, node)))
        .or_else(|| find(&|candidate| parents[candidate] == parents[node]))
        .or_else(|| called.first().copied())
}

fn is_below(parents: &[Option<usize>], mut node: usize, above: usize) -> bool {
    while let Some(parent) = parents[node] {
        if parent == above {
            return true;
        }
        node = parent;
    }
    false
}

/// `("hut", 1)` of `hut_LOD1`.
fn suffix(name: &str) -> Option<(&str, u32)> {
    let digits = name.len() - name.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    let (rest, number) = name.split_at(name.len() - digits);
    let base = rest.len().checked_sub(4)?;
    let (base, mark) = (rest.get(..base)?, rest.get(base..)?);
    mark.eq_ignore_ascii_case("_LOD").then_some(())?;
    Some((base, number.parse().ok()?))
}

impl Levels {
    /// Makes `all`, finest first, the versions of a model that begins at `model`.
    fn add(&mut self, root: &Root, parents: &[Option<usize>], model: usize, all: &[usize]) -> Result<(), Fault> {
        if all.len() < 2 {
            return Ok(()); // one level is what every node has
        }
        self.models.insert(model, all.len() as u32);
        for (version, &level) in all.iter().enumerate() {
            let refuse = |what: String| Err(Fault::Levels { place: label(root, level), what });
            if self.versions.insert(level, version as u32).is_some() {
                return refuse("it is a level of detail twice".into());
            }
            if level == model || is_below(parents, level, model) {
                continue;
            }
            if is_below(parents, model, level) {
                return refuse(format!("it is a level of detail of {}, which is below it", label(root, model)));
            }
            self.adopted_by.insert(level, model);
            self.adopts.entry(model).or_default().push(level);
        }
        Ok(())
    }

    /// Siblings whose names end with `_LOD` and a number. Of several sets of one name, as instances make them, the
    /// first finest goes with the first of each other level, and so on.
    fn siblings(&mut self, root: &Root, parents: &[Option<usize>], warnings: &mut Warnings) -> Result<(), Fault> {
        /// Number → node.
        type Set = BTreeMap<u32, usize>;
        // By parent and name; ordered, so that the outcome is.
        let mut sets: BTreeMap<(Option<usize>, &str), Vec<Set>> = BTreeMap::new();
        for (node, described) in root.nodes.iter().enumerate() {
            let name = described.name.as_deref().unwrap_or_default();
            let Some((base, number)) = suffix(name) else { continue };
            if self.versions.contains_key(&node) || self.models.contains_key(&node) {
                continue;
            }
            let sets = sets.entry((parents[node], base)).or_default();
            match sets.iter_mut().find(|set| !set.contains_key(&number)) {
                Some(set) => _ = set.insert(number, node),
                None => sets.push(BTreeMap::from([(number, node)])),
            }
        }
        for set in sets.into_values().flatten() {
            let all: Vec<usize> = set.values().copied().collect();
            match set.get(&0) {
                Some(&finest) => self.add(root, parents, finest, &all)?,
                None => warnings.add(format!(
                    "{}: there is no finest level _LOD0 beside it, so it is drawn always",
                    label(root, all[0])
                )),
            }
        }
        Ok(())
    }

    /// Adoption must leave a tree.
    fn check(&self, root: &Root, parents: &[Option<usize>]) -> Result<(), Fault> {
        if self.adopted_by.is_empty() {
            return Ok(());
        }
        let above = |node: usize| self.adopted_by.get(&node).copied().or(parents[node]);
        let mut reached = vec![false; parents.len()];
        let mut open: Vec<usize> = (0..parents.len()).filter(|&node| above(node).is_none()).collect();
        while let Some(node) = open.pop() {
            reached[node] = true;
            open.extend(self.children(root, node));
        }
        match reached.iter().position(|reached| !reached) {
            None => Ok(()),
            Some(node) => {
                let how = "is a level of detail of something below itself".into();
                Err(Fault::NotATree { place: label(root, node), how })
            }
        }
    }

    /// The children of a node when all adoptions are done.
    pub(super) fn children<'a>(
        &'a self,
        root: &'a Root,
        node: usize,
    ) -> impl DoubleEndedIterator<Item = usize> + use<'a> {
        let adopted = self.adopts.get(&node).into_iter().flatten().copied();
        children(root, node).filter(|child| !self.adopted_by.contains_key(child)).chain(adopted)
    }
}

#[cfg(test)]
mod tests {
    use super::suffix;

    #[test]
    fn the_suffix_is_a_mark_and_a_number() {
        assert_eq!(suffix("hut_LOD0"), Some(("hut", 0)));
        assert_eq!(suffix("old hut_lod12"), Some(("old hut", 12)));
        for plain in ["hut", "hut_LOD", "LOD1", "hut1", "hut_LOD1b", "é1", ""] {
            assert_eq!(suffix(plain), None, "{plain}");
        }
    }
}
