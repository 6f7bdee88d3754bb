//! The node tree of the file: that it is one, and where its nodes stand.
//!
//! The `gltf` crate reads transformations as f32. A scene in earth coordinates has translations of millions of metres
//! and centimetres that count, so they are read a second time here, as f64. All walks are loops with their own stack,
//! because a file may well have a chain of a million nodes.

use super::accessor::{For, at};
use super::error::Fault;
use super::extras::At;
use super::{Importer, extras, levels};
use crate::scene::database::node_label;
use crate::scene::{Extras, NodeSource};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use gltf::json::Root;
use proto::limits;
use serde::Deserialize;

/// The transformations of all nodes in full precision.
#[derive(Debug, Default, Deserialize)]
pub(super) struct Placements {
    #[serde(default)]
    nodes: Vec<Placement>,
}

#[derive(Debug, Deserialize)]
struct Placement {
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

/// `EXT_mesh_gpu_instancing`: indices of accessors.
#[derive(Debug, Deserialize)]
struct Instancing {
    attributes: InstanceAttributes,
}

#[derive(Debug, Deserialize)]
struct InstanceAttributes {
    #[serde(rename = "TRANSLATION")]
    translation: Option<usize>,
    #[serde(rename = "ROTATION")]
    rotation: Option<usize>,
    #[serde(rename = "SCALE")]
    scale: Option<usize>,
}

pub(super) fn label(root: &Root, node: usize) -> String {
    let name = root.nodes.get(node).and_then(|node| node.name.as_deref()).unwrap_or_default();
    node_label(name, node)
}

/// The children of a node, as plain indices.
pub(super) fn children(root: &Root, node: usize) -> impl DoubleEndedIterator<Item = usize> + '_ {
    root.nodes[node].children.iter().flatten().map(|child| child.value())
}

/// Checks that no node has two parents or is below itself, scene or not, and gives each node's parent.
fn parents(root: &Root) -> Result<Vec<Option<usize>>, Fault> {
    let mut parents: Vec<Option<usize>> = vec![None; root.nodes.len()];
    for node in 0..root.nodes.len() {
        for child in children(root, node) {
            at(&root.nodes, child, "node", &label(root, node))?;
            if let Some(other) = parents[child].replace(node) {
                let how = format!("has two parents, {} and {}", label(root, other), label(root, node));
                return Err(Fault::NotATree { place: label(root, child), how });
            }
        }
    }
    // With one parent each, whatever can't be reached from a node without a parent is on or below a circle.
    let mut reached = vec![false; root.nodes.len()];
    let mut open: Vec<usize> = (0..root.nodes.len()).filter(|&node| parents[node].is_none()).collect();
    while let Some(node) = open.pop() {
        reached[node] = true;
        open.extend(children(root, node));
    }
    if let Some(mut node) = reached.iter().position(|reached| !reached) {
        for _ in 0..root.nodes.len() {
            node = parents[node].unwrap_or(node); // after so many steps up, we are on the circle
        }
        return Err(Fault::NotATree { place: label(root, node), how: "is below itself".into() });
    }
    Ok(parents)
}

/// The nodes that the scene begins with.
fn roots(root: &Root, parents: &[Option<usize>]) -> Result<Vec<usize>, Fault> {
    let scene = match root.scene {
        Some(scene) => Some(at(&root.scenes, scene.value(), "scene", "the file")?),
        None => root.scenes.first(),
    };
    let Some(scene) = scene else {
        return Ok((0..parents.len()).filter(|&node| parents[node].is_none()).collect());
    };
    let mut listed = vec![false; parents.len()];
    let mut roots = Vec::new();
    for node in scene.nodes.iter().map(|node| node.value()) {
        at(&root.nodes, node, "node", "the scene")?;
        if let Some(parent) = parents[node] {
            let how = format!("begins the scene, yet is below {}", label(root, parent));
            return Err(Fault::NotATree { place: label(root, node), how });
        }
        if std::mem::replace(&mut listed[node], true) {
            return Err(Fault::NotATree { place: label(root, node), how: "begins the scene twice".into() });
        }
        roots.push(node);
    }
    Ok(roots)
}

const FLAT_MODEL: &str = "levels of detail, but a scale of 0";

/// Where a node stands as seen from another at the same place in the tree; to the bit nothing if they stand alike.
fn relative(node: (DAffine3, DQuat), to: (DAffine3, DQuat)) -> Option<(DAffine3, DQuat)> {
    if node == to {
        return Some((DAffine3::IDENTITY, DQuat::IDENTITY));
    }
    let local = to.0.inverse() * node.0;
    local.is_finite().then(|| (local, (to.1.conjugate() * node.1).normalize()))
}

impl Importer<'_> {
    /// Walks the scene's tree, depth first, and hands over its nodes and what they show.
    pub(super) fn tree(&mut self, placements: &Placements) -> Result<(), Fault> {
        let root = self.data.root;
        let parents = parents(root)?;
        let said: Vec<Extras> = (0..root.nodes.len())
            .map(|node| extras::read(&root.nodes[node].extras, At::Node, &|| label(root, node), &mut self.warnings))
            .collect();
        let levels = levels::find(root, &parents, &said, &mut self.warnings)?;
        let stand = |node: usize| {
            placements.nodes.get(node).map_or(Ok((DAffine3::IDENTITY, DQuat::IDENTITY)), |placement| {
                placement.resolve().map_err(|what| Fault::Transform { place: label(root, node), what })
            })
        };
        let begin = roots(root, &parents)?.into_iter().rev().filter(|node| !levels.adopted_by.contains_key(node));
        let mut open: Vec<(usize, Option<u32>)> = begin.map(|node| (node, None)).collect();
        while let Some((index, parent)) = open.pop() {
            let place = label(root, index);
            let node = &root.nodes[index];
            let own = self.parts.nodes.len() as u32;
            let (mut local, mut rotation) = stand(index)?;
            if let Some(&model) = levels.adopted_by.get(&index) {
                (local, rotation) = relative((local, rotation), stand(model)?)
                    .ok_or_else(|| Fault::Transform { place: label(root, model), what: FLAT_MODEL })?;
            }
            if node.skin.is_some() {
                self.warnings.add("skins are not applied: meshes keep the pose they were modelled in");
            }
            let shape = match node.mesh {
                Some(mesh) => self.shape(mesh.value(), &place)?,
                None => None,
            };
            let extensions = node.extensions.as_ref();
            let instancing = extensions.and_then(|all| all.others.get("EXT_mesh_gpu_instancing"));
            let name = node.name.clone().unwrap_or_default();
            let shown = if instancing.is_some() { None } else { shape };
            let lights = extensions.and_then(|all| all.khr_lights_punctual.as_ref());
            let light = match lights {
                Some(lights) => self.light(lights.light.value(), &place)?,
                None => None,
            };
            self.parts.nodes.push(NodeSource {
                name: name.clone(),
                parent,
                local,
                rotation,
                shape: shown,
                extras: said[index].clone(),
                levels: levels.models.get(&index).copied().unwrap_or(0),
                version: levels.versions.get(&index).copied(),
                light,
            });
            if let (Some(instancing), Some(_)) = (instancing, shape) {
                let instancing = Instancing::deserialize(instancing)
                    .map_err(|error| Fault::Json { message: format!("{place}: EXT_mesh_gpu_instancing: {error}") })?;
                let instances = self.instances(&instancing.attributes, &place)?;
                // Each gets the node's name: a long one many times over would be more than any file.
                let (count, limit) = (name.len() as u64 * instances.len() as u64, limits::TEXT_MAX as u64);
                if count > limit {
                    return Err(Fault::TooMany { place, what: "bytes of instances' names", count, limit });
                }
                for (i, (local, rotation)) in instances.into_iter().enumerate() {
                    let name = if name.is_empty() { String::new() } else { format!("{name}[{i}]") };
                    let instance =
                        NodeSource { name, parent: Some(own), local, rotation, shape, ..NodeSource::default() };
                    self.parts.nodes.push(instance);
                }
            }
            open.extend(levels.children(root, index).rev().map(|child| (child, Some(own))));
        }
        Ok(())
    }

    /// The transformations of a node's instances.
    fn instances(&self, accessors: &InstanceAttributes, place: &str) -> Result<Vec<(DAffine3, DQuat)>, Fault> {
        let vectors = |accessor: Option<usize>| {
            accessor.map(|accessor| self.data.vectors::<3>(For { place, accessor })).transpose()
        };
        let translations = vectors(accessors.translation)?;
        let scales = vectors(accessors.scale)?;
        let rotations =
            accessors.rotation.map(|accessor| self.data.vectors::<4>(For { place, accessor })).transpose()?;
        let lengths = [
            ("TRANSLATION", translations.as_ref().map(Vec::len)),
            ("ROTATION", rotations.as_ref().map(Vec::len)),
            ("SCALE", scales.as_ref().map(Vec::len)),
        ];
        let Some(count) = lengths.iter().find_map(|(_, length)| *length) else {
            return Err(Fault::Json {
                message: format!("{place}: EXT_mesh_gpu_instancing without TRANSLATION, ROTATION or SCALE"),
            });
        };
        for (attribute, length) in lengths {
            if let Some(length) = length.filter(|&length| length != count) {
                let attribute = format!("instance attribute {attribute}");
                return Err(Fault::Length { place: place.into(), attribute, count: length, vertices: count });
            }
        }
        if count + self.parts.nodes.len() > limits::OBJECTS_MAX {
            let (count, limit) = (count as u64, limits::OBJECTS_MAX as u64);
            return Err(Fault::TooMany { place: place.into(), what: "instances", count, limit });
        }
        let wide = |vector: [f32; 3]| vector.map(f64::from);
        (0..count)
            .map(|i| {
                let placement = Placement {
                    matrix: None,
                    translation: translations.as_ref().map(|all| wide(all[i])),
                    rotation: rotations.as_ref().map(|all| all[i].map(f64::from)),
                    scale: scales.as_ref().map(|all| wide(all[i])),
                };
                let fault = |what| Fault::Transform { place: format!("{place}, instance {i}"), what };
                placement.resolve().map_err(fault)
            })
            .collect()
    }
}

impl Placement {
    /// The transformation and the rotation in it.
    fn resolve(&self) -> Result<(DAffine3, DQuat), &'static str> {
        if let Some(m) = self.matrix {
            if m.iter().any(|number| !number.is_finite()) {
                return Err("a matrix with a number that is not finite");
            }
            let last_row = [m[3], m[7], m[11], m[15] - 1.0];
            if last_row.iter().any(|number| number.abs() > 1e-6) {
                return Err("a matrix that is not affine (its last row is not 0 0 0 1)");
            }
            let column = |i: usize| DVec3::new(m[4 * i], m[4 * i + 1], m[4 * i + 2]);
            let local = DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) };
            return Ok((local, rotation_of(local.matrix3)));
        }
        let translation = self.translation.map_or(DVec3::ZERO, DVec3::from_array);
        let rotation = self.rotation.map_or(DQuat::IDENTITY, DQuat::from_array);
        let scale = self.scale.map_or(DVec3::ONE, DVec3::from_array);
        if !(translation.is_finite() && rotation.is_finite() && scale.is_finite()) {
            return Err("a transformation with a number that is not finite");
        }
        let length = rotation.length();
        if !(1e-6..1e6).contains(&length) {
            return Err("a rotation that is not a unit quaternion");
        }
        // Exactly nothing when there is nothing to do: normalising would cost the last bit.
        let rotation = if self.rotation.is_none() { rotation } else { rotation.normalize() };
        Ok((DAffine3::from_scale_rotation_translation(scale, rotation, translation), rotation))
    }
}

/// The rotation in a matrix: its columns made perpendicular one after the other; a mirror is taken to be along x, as
/// exporters do.
fn rotation_of(matrix: DMat3) -> DQuat {
    let z = matrix.z_axis.try_normalize();
    let y = z.and_then(|z| (matrix.y_axis - z * z.dot(matrix.y_axis)).try_normalize());
    match (y, z) {
        (Some(y), Some(z)) => DQuat::from_mat3(&DMat3::from_cols(y.cross(z), y, z)).normalize(),
        _ => DQuat::IDENTITY, // flat: it has no orientation that could be kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_gives_the_same_rotation_as_the_parts_it_was_made_of() {
        let rotation = DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(-1.2);
        for scale in [DVec3::new(1.0, 2.0, 3.0), DVec3::new(-1.0, 2.0, 3.0)] {
            let map = DAffine3::from_scale_rotation_translation(scale, rotation, DVec3::ONE);
            let found = rotation_of(map.matrix3);
            assert!(found.dot(rotation).abs() > 1.0 - 1e-12, "{scale}");
        }
    }

    #[test]
    fn translations_keep_their_double_precision() {
        let placements: Placements =
            serde_json::from_str(r#"{"nodes":[{"translation":[6378137.0625,0.1,-16777217.0]}]}"#).unwrap();
        let (local, _) = placements.nodes[0].resolve().unwrap();
        assert_eq!(local.translation, DVec3::new(6_378_137.062_5, 0.1, -16_777_217.0));
    }
}
