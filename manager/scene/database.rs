//! The scene as the manager holds it.
//!
//! Nodes lie in depth-first order, the order in which a reader of the file meets them: a node's subtree is a range of
//! indices that begins with the node, and since objects and subobjects are numbered on the same walk, it owns a range of
//! those too. That order is also the *file order* by which coinciding faces are told apart, so it is part of the picture.
//!
//! A *shape* is a mesh of the file after splitting: several objects may show one shape. Shapes keep what culling asks
//! (bounds) and the name of the geometry; the geometry itself is in [`Scene::meshes`], by content.

use super::blocks::{Blocks, Bodies, Content};
use super::bounds;
use super::bvh::{Bvh, Cut};
use super::contents::Contents;
use super::extras::{Extras, Traits};
use super::models::{self, Model};
use super::parts::{AssembleError, COORDINATE_MAX, LightSource, NodeSource, Parts};
use super::planes;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use proto::ids::{ContentId, ModelId, ObjectId, SubobjectId};
use proto::limits;
use proto::scene::{
    Alpha, Box3, LightRow, Material, Mesh, ModelPart, NO_PLANE, ObjectRow, PlaneRow, SceneTable, Sphere, SubobjectRow,
    Texture,
};
use std::collections::BTreeMap;
use std::ops::Range;

/// Index into [`Scene::nodes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeIndex(pub u32);

/// Index into [`Scene::shapes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ShapeIndex(pub u32);

/// A node of the tree. An instance of `EXT_mesh_gpu_instancing` is a node too, a child of the one that carries the
/// extension.
#[derive(Clone, Debug)]
pub struct Node {
    /// The name in the file, empty if it has none; not necessarily the only one of that name.
    pub name: String,
    /// The node above; `None` for a root.
    pub parent: Option<NodeIndex>,
    /// One past the last node below this one.
    pub end: u32,
    /// This node's space → its parent's.
    pub local: DAffine3,
    /// This node's space → world, as the file has it.
    pub world: DAffine3,
    /// The rotations from the root down to here, one after another: the orientation that a pose replaces.
    pub orientation: DQuat,
    /// The object that this node is, if it carries a mesh.
    pub object: Option<ObjectId>,
    /// The objects from here down.
    pub objects: Range<u32>,
    /// The model that it begins or is a part of.
    pub model: Option<ModelId>,
    /// The version of the model that it is a part of; `None` outside of models, and for what all versions share.
    pub version: Option<u32>,
    /// Encloses all of them where the file puts them, world; negative radius if there is none.
    pub sphere: Sphere,
}

impl Node {
    /// What is left of the world transformation when position and orientation are taken out: the scale that an entity
    /// keeps when a pose moves it (with shears, if scales above it turned into such).
    pub fn own_scale(&self) -> DMat3 {
        DMat3::from_quat(self.orientation.conjugate()) * self.world.matrix3
    }

    /// Its place in a model.
    pub fn part(&self) -> Option<ModelPart> {
        self.model.zip(self.version).map(|(model, version)| ModelPart { model, version })
    }
}

/// A node that carries a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Object {
    /// Which node.
    pub node: NodeIndex,
    /// Which mesh.
    pub shape: ShapeIndex,
    /// Its first subobject; it has as many as the shape has pieces, one after the other.
    pub first_subobject: SubobjectId,
    /// Encloses it where the file puts it, world.
    pub sphere: Sphere,
    /// What the scene extras of its node, of those above and of its mesh say about it.
    pub traits: Traits,
}

/// A mesh of the file, cut into pieces.
#[derive(Clone, Debug)]
pub struct Shape {
    /// The mesh's name in the file, or empty.
    pub name: String,
    /// The scene extras of the mesh.
    pub extras: Extras,
    /// In the order of the file's primitives, then as [`super::split`] cut them. At least one.
    pub pieces: Vec<Piece>,
    /// Encloses all pieces; mesh space.
    pub sphere: Sphere,
    /// Encloses all pieces; mesh space.
    pub bounds: Box3,
    /// Over the pieces; mesh space.
    pub tree: Bvh,
}

/// What the manager keeps at hand of a piece of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// The geometry.
    pub mesh: ContentId,
    /// Encloses it; mesh space.
    pub sphere: Sphere,
    /// Encloses it; mesh space.
    pub bounds: Box3,
    /// Number of triangles.
    pub triangles: u32,
    /// Number of vertices.
    pub vertices: u32,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Which primitive of the mesh it is a part of.
    pub primitive: u32,
    /// Its coplanar layer, if primitive, material or mesh say one; otherwise the node's holds.
    pub layer: Option<i32>,
    /// Whether primitive, material or mesh mark it as merged.
    pub merged: bool,
}

/// A material of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialEntry {
    /// Its name in the file, or empty.
    pub name: String,
    /// What it looks like.
    pub material: Material,
}

/// A world. Made by [`Scene::assemble`]; the fields are open to be read.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Scene {
    /// The file's or built-in scene's name.
    pub name: String,
    /// Depth-first.
    pub nodes: Vec<Node>,
    /// The nodes without a parent, in order.
    pub roots: Vec<NodeIndex>,
    /// By [`ObjectId`]; in the order of their nodes.
    pub objects: Vec<Object>,
    /// Meshes of the file that an object shows, in order of first use.
    pub shapes: Vec<Shape>,
    /// Materials of the file that a piece has, in order of first use.
    pub materials: Vec<MaterialEntry>,
    /// All geometry, by content.
    pub meshes: Contents<Mesh>,
    /// All textures, by content.
    pub textures: Contents<Texture>,
    /// By [`ModelId`]; in the order of their nodes.
    pub models: Vec<Model>,
    /// What boards are sent: where objects are, which subobjects they have, and the lights.
    pub table: SceneTable,
    /// What selection walks: a tree over the balls of [`Scene::objects`] and those of their subobjects, where the file puts them.
    pub blocks: Blocks,
    /// Encloses everything, world; negative radius for an empty scene.
    pub sphere: Sphere,
    /// Encloses everything, world; `None` for an empty scene.
    pub bounds: Option<Box3>,
    /// What the importer had to leave out or mend, one sentence each.
    pub warnings: Vec<String>,
    /// Named nodes, by name, then in order.
    names: Vec<NodeIndex>,
    /// See [`Self::model_of`].
    pub(super) model_names: BTreeMap<String, ModelId>,
    /// Nodes with an entity number.
    entities: BTreeMap<u64, NodeIndex>,
}

/// What takes long to find out about a scene, or lies elsewhere than in its parts: a baked file brings it along.
#[derive(Debug)]
pub(super) struct Known {
    /// By content.
    pub meshes: Contents<Mesh>,
    /// By content.
    pub textures: Contents<Texture>,
    /// Named nodes, by name, then in order.
    pub names: Vec<NodeIndex>,
    /// Planes that faces share.
    pub planes: Planes,
}

/// The part of [`SceneTable`] that [`planes::find`] makes.
#[derive(Debug)]
pub(super) struct Planes {
    /// Indexed by plane.
    pub planes: Vec<PlaneRow>,
    /// For each face of each subobject that has any.
    pub of_faces: Vec<u32>,
    /// By subobject: where its faces begin, or [`NO_PLANE`]. Empty if none has any.
    pub of_subobjects: Vec<u32>,
}

impl Planes {
    fn enter(self, table: &mut SceneTable) {
        for (row, begin) in table.subobjects.iter_mut().zip(self.of_subobjects) {
            row.planes = (begin != NO_PLANE).then_some(begin);
        }
        (table.planes, table.face_planes) = (self.planes, self.of_faces);
    }
}

impl Scene {
    /// Puts the parts together: numbers objects and subobjects, carries transformations down the tree, bounds
    /// everything.
    ///
    /// # Errors
    /// [`AssembleError`] when something is too far away or too many.
    ///
    /// # Panics
    /// If the nodes are not in depth-first order: the importer's own mistake.
    pub fn assemble(parts: Parts) -> Result<Self, AssembleError> {
        Self::assemble_watched(parts, &|_| ())
    }

    /// The same; `watch` hears how far it is, from 0 to 1, on any thread.
    ///
    /// # Errors
    /// [`AssembleError`].
    pub fn assemble_watched(parts: Parts, watch: &(dyn Fn(f64) + Sync)) -> Result<Self, AssembleError> {
        Self::build(parts, None, watch)
    }

    /// The same with what is known already; the parts have no meshes and textures of their own.
    pub(super) fn assemble_known(parts: Parts, known: Known) -> Result<Self, AssembleError> {
        Self::build(parts, Some(known), &|_| ())
    }

    fn build(parts: Parts, known: Option<Known>, watch: &(dyn Fn(f64) + Sync)) -> Result<Self, AssembleError> {
        let Parts { name, nodes: sources, shapes, materials, meshes, textures, mut warnings } = parts;
        check_counts(&sources, &shapes)?;
        let mut nodes: Vec<Node> = Vec::with_capacity(sources.len());
        let mut objects: Vec<Object> = Vec::new();
        let mut table = SceneTable::default();
        let mut subobject_spheres = Vec::new();
        let mut bounds_all: Option<Box3> = None;
        let mut finder = models::Finder::default();
        let mut entities: BTreeMap<u64, NodeIndex> = BTreeMap::new();
        let mut said: Vec<Extras> = Vec::with_capacity(sources.len());
        let nothing = Extras::default();
        let mut primitives = 0;

        for (number, source) in sources.into_iter().enumerate() {
            let index = NodeIndex(number as u32);
            let parent = source.parent.map(|parent| &nodes[parent as usize]);
            let world = parent.map_or(source.local, |parent| parent.world * source.local);
            let orientation =
                parent.map_or(source.rotation, |parent| (parent.orientation * source.rotation).normalize());
            let (model, version) = finder.place(&source, index, parent, &nodes)?;
            let outer = source.parent.map_or(&nothing, |parent| &said[parent as usize]);
            let extras = source.extras.clone().inside(outer);
            let first_object = objects.len() as u32;
            let mut node = Node {
                name: source.name.clone(),
                parent: source.parent.map(NodeIndex),
                end: index.0 + 1,
                local: source.local,
                world,
                orientation,
                object: None,
                objects: first_object..first_object,
                model,
                version,
                sphere: bounds::NOTHING,
            };
            let label = || node_label(&source.name, number);
            if let Some(shape_index) = source.shape {
                let shape = &shapes[shape_index.0 as usize];
                let id = ObjectId(first_object);
                let stretch = bounds::stretch(&world);
                node.sphere = bounds::ball_moved_by(&world, stretch, shape.sphere);
                let own = bounds::box_moved(&world, shape.bounds);
                objects.push(Object {
                    node: index,
                    shape: shape_index,
                    first_subobject: SubobjectId(table.subobjects.len() as u32),
                    sphere: node.sphere,
                    traits: shape.extras.clone().inside(&extras).traits(),
                });
                table.objects.push(ObjectRow { transform: world });
                let marked = if shape.pieces.iter().any(|piece| piece.merged) {
                    finder.marked_parts(&source, id, &node, index, &nodes)?
                } else {
                    None
                };
                for piece in &shape.pieces {
                    table.subobjects.push(SubobjectRow {
                        object: id,
                        mesh: piece.mesh,
                        primitive: primitives + piece.primitive,
                        layer: piece.layer.or(extras.layer).unwrap_or(0),
                        part_of: if piece.merged { marked } else { node.part() },
                        planes: None,
                    });
                    subobject_spheres.push(bounds::ball_moved_by(&world, stretch, piece.sphere));
                }
                primitives += shape.pieces.last().map_or(0, |piece| piece.primitive + 1);
                bounds_all = Some(bounds_all.map_or(own, |sum| bounds::box_union(sum, own)));
                node.object = Some(id);
                node.objects.end += 1;
            }
            let usable = |number: f64| number < COORDINATE_MAX; // which NaN is not
            let reach = node.sphere.centre.abs().max_element() + node.sphere.radius.abs();
            if !(world.is_finite() && usable(world.translation.abs().max_element()) && usable(reach)) {
                return Err(AssembleError::OutOfRange { node: label(), limit: COORDINATE_MAX });
            }
            if let Some(light) = source.light {
                table.lights.push(placed(light, &world, orientation));
            }
            if let Some(number) = source.extras.entity {
                if let Some(&other) = entities.get(&number) {
                    let other = node_label(&nodes[other.0 as usize].name, other.0 as usize);
                    return Err(AssembleError::EntityTwice { node: label(), other, number });
                }
                entities.insert(number, index);
            }
            nodes.push(node);
            said.push(extras);
        }
        let (what, count, limit) = ("models", finder.models.len(), limits::MODELS_MAX);
        if count > limit {
            return Err(AssembleError::TooMany { what, count, limit });
        }
        table.models = finder.rows();
        let model_names = finder.names(&nodes);
        close_subtrees(&mut nodes);
        let bodies =
            Assembled { objects: &objects, shapes: &shapes, materials: &materials, spheres: &subobject_spheres };
        let blocks = Blocks::build(&bodies, Cut::Middle);
        let (meshes, textures, names) = match known {
            Some(known) => {
                known.planes.enter(&mut table);
                (known.meshes, known.textures, known.names)
            }
            None => {
                planes::find(&objects, &shapes, &meshes, &mut table, &mut warnings, watch);
                (meshes.into(), textures.into(), by_name(&nodes))
            }
        };
        Ok(Self {
            name,
            roots: (0..nodes.len() as u32)
                .map(NodeIndex)
                .filter(|node| nodes[node.0 as usize].parent.is_none())
                .collect(),
            blocks,
            sphere: bounds::ball_of_balls(objects.iter().map(|object| object.sphere)),
            nodes,
            objects,
            shapes,
            materials,
            meshes,
            textures,
            model_names,
            models: finder.models,
            table,
            bounds: bounds_all,
            warnings,
            names,
            entities,
        })
    }

    /// Whether its meshes and textures are read from a baked file when they are asked for.
    pub fn is_baked(&self) -> bool {
        self.meshes.is_baked()
    }

    /// The node at `index`.
    pub fn node(&self, index: NodeIndex) -> &Node {
        &self.nodes[index.0 as usize]
    }

    /// The children of a node, in order.
    pub fn children(&self, index: NodeIndex) -> impl Iterator<Item = NodeIndex> + '_ {
        let end = self.node(index).end;
        let mut next = index.0 + 1;
        std::iter::from_fn(move || {
            (next < end).then(|| {
                let child = NodeIndex(next);
                next = self.node(child).end;
                child
            })
        })
    }

    /// The first node of that name.
    pub fn node_by_name(&self, name: &str) -> Option<NodeIndex> {
        let first = self.names.partition_point(|&node| self.node(node).name.as_str() < name);
        self.names.get(first).copied().filter(|&node| self.node(node).name == name)
    }

    /// The node that a host calls by this number (`entity` in its scene extras).
    pub fn node_by_entity(&self, number: u64) -> Option<NodeIndex> {
        self.entities.get(&number).copied()
    }

    /// Named nodes, by name, then in order.
    pub(super) fn named_nodes(&self) -> &[NodeIndex] {
        &self.names
    }

    /// Every number that [`Self::node_by_entity`] knows, ascending, with its node.
    pub fn entities(&self) -> impl Iterator<Item = (u64, NodeIndex)> + '_ {
        self.entities.iter().map(|(&number, &node)| (number, node))
    }

    /// All names of nodes, sorted; each as often as it occurs.
    pub fn node_names(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(|&node| self.node(node).name.as_str())
    }

    /// The object `id`.
    pub fn object(&self, id: ObjectId) -> &Object {
        &self.objects[id.0 as usize]
    }

    /// The shape of an object.
    pub fn shape_of(&self, object: &Object) -> &Shape {
        &self.shapes[object.shape.0 as usize]
    }

    /// The subobjects of an object.
    pub fn subobjects_of(&self, object: &Object) -> Range<u32> {
        let first = object.first_subobject.0;
        first..first + self.shape_of(object).pieces.len() as u32
    }
}

/// The nodes that have a name, by name, then in order.
fn by_name(nodes: &[Node]) -> Vec<NodeIndex> {
    let named = |node: &NodeIndex| !nodes[node.0 as usize].name.is_empty();
    let mut names: Vec<NodeIndex> = (0..nodes.len() as u32).map(NodeIndex).filter(named).collect();
    names.sort_by(|a, b| nodes[a.0 as usize].name.cmp(&nodes[b.0 as usize].name).then(a.cmp(b)));
    names
}

/// What the database of balls is made from.
struct Assembled<'a> {
    objects: &'a [Object],
    shapes: &'a [Shape],
    materials: &'a [MaterialEntry],
    /// By subobject.
    spheres: &'a [Sphere],
}

impl Assembled<'_> {
    fn shape(&self, object: u32) -> &Shape {
        &self.shapes[self.objects[object as usize].shape.0 as usize]
    }
}

impl Bodies for Assembled<'_> {
    fn count(&self) -> usize {
        self.objects.len()
    }

    fn ball(&self, object: u32) -> Sphere {
        self.objects[object as usize].sphere
    }

    fn pieces(&self, object: u32) -> Range<u32> {
        let first = self.objects[object as usize].first_subobject.0;
        first..first + self.shape(object).pieces.len() as u32
    }

    fn piece_ball(&self, piece: u32) -> Sphere {
        self.spheres[piece as usize]
    }

    fn content(&self, object: u32) -> Content {
        let first = self.pieces(object).start as usize;
        self.shape(object).pieces.iter().zip(&self.spheres[first..]).fold(Content::default(), |sum, (piece, sphere)| {
            let material = self.materials.get(piece.material as usize);
            let is_translucent = material.is_some_and(|entry| entry.material.alpha == Alpha::Blend);
            let is_textured = material.is_some_and(|entry| entry.material.base_texture.is_some());
            let scale = if piece.sphere.radius > 0.0 { sphere.radius / piece.sphere.radius } else { 0.0 };
            let area = (bounds::seen_area(&piece.bounds) * scale * scale) as f32;
            Content {
                vertices: sum.vertices.saturating_add(piece.vertices),
                triangles: sum.triangles.saturating_add(piece.triangles),
                area: sum.area + area,
                textured: sum.textured + if is_textured { area } else { 0.0 },
                translucent: sum.translucent + if is_translucent { area } else { 0.0 },
            }
        })
    }
}

/// A light where its node stands. Scale does not change what it gives, only a mirror where it points.
fn placed(light: LightSource, world: &DAffine3, orientation: DQuat) -> LightRow {
    let direction = world.transform_vector3(DVec3::NEG_Z).try_normalize().unwrap_or(orientation * DVec3::NEG_Z);
    LightRow { kind: light.kind, intensity: light.intensity, position: world.translation, direction }
}

fn check_counts(sources: &[NodeSource], shapes: &[Shape]) -> Result<(), AssembleError> {
    let shown = || sources.iter().filter_map(|node| node.shape);
    let objects = shown().count();
    let subobjects = shown().map(|shape| shapes[shape.0 as usize].pieces.len()).sum();
    let lights = sources.iter().filter(|node| node.light.is_some()).count();
    // Numbers of primitives, which are u32; shapes have at least one piece.
    let primitives =
        shown().map(|shape| shapes[shape.0 as usize].pieces.last().map_or(0, |last| last.primitive as usize + 1)).sum();
    let versions = sources.iter().map(|node| node.levels as usize).max().unwrap_or(0);
    for (what, count, limit) in [
        ("objects", objects, limits::OBJECTS_MAX),
        ("subobjects", subobjects, limits::SUBOBJECTS_MAX),
        ("primitives", primitives, u32::MAX as usize),
        ("lights", lights, limits::LIGHTS_MAX),
        ("levels of detail of one model", versions, limits::VERSIONS_MAX),
    ] {
        if count > limit {
            return Err(AssembleError::TooMany { what, count, limit });
        }
    }
    Ok(())
}

/// Gives every node the end of its subtree, and bounds and objects of all below: from the leaves up, since children
/// come after their parents.
fn close_subtrees(nodes: &mut [Node]) {
    for index in (0..nodes.len()).rev() {
        let (before, from_here) = nodes.split_at_mut(index);
        let node = &from_here[0];
        if let Some(parent) = node.parent {
            let (end, last_object) = (node.end, node.objects.end);
            let parent = &mut before[parent.0 as usize];
            parent.end = parent.end.max(end);
            parent.objects.end = parent.objects.end.max(last_object);
        }
    }
    for index in (0..nodes.len()).rev() {
        let end = nodes[index].end as usize;
        let mut around: Vec<Sphere> = vec![nodes[index].sphere];
        let mut child = index + 1;
        while child < end {
            assert_eq!(nodes[child].parent, Some(NodeIndex(index as u32)), "nodes must come depth-first");
            around.push(nodes[child].sphere);
            child = nodes[child].end as usize;
        }
        nodes[index].sphere = bounds::ball_of_balls(around.iter());
    }
}

/// How messages name a node: `node "tower"`, or `node 12` if it has no name.
pub(crate) fn node_label(name: &str, index: usize) -> String {
    if name.is_empty() { format!("node {index}") } else { format!("node {name:?}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::parts::PieceSource;
    use crate::scene::split::{Primitive, split};

    fn triangle() -> Vec<PieceSource> {
        let primitive = Primitive {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2]],
            ..Primitive::default()
        };
        PieceSource::plain(split(&primitive), 0)
    }

    fn node(name: &str, parent: Option<u32>, x: f64, shape: Option<ShapeIndex>) -> NodeSource {
        NodeSource {
            name: name.into(),
            parent,
            local: DAffine3::from_translation(DVec3::X * x),
            shape,
            ..NodeSource::default()
        }
    }

    #[test]
    fn subtrees_are_ranges_of_nodes_and_of_objects() {
        let mut parts = Parts::default();
        let shape = parts.add_shape("t", Extras::default(), triangle());
        parts.nodes = vec![
            node("a", None, 10.0, None),
            node("b", Some(0), 1.0, shape),
            node("c", Some(1), 1.0, shape),
            node("d", Some(0), 2.0, shape),
            node("b", None, 0.0, shape),
        ];
        let scene = Scene::assemble(parts).unwrap();
        let ends: Vec<_> = scene.nodes.iter().map(|node| node.end).collect();
        assert_eq!(ends, [4, 3, 3, 4, 5]);
        assert_eq!(scene.node(NodeIndex(0)).objects, 0..3);
        assert_eq!(scene.node(NodeIndex(1)).objects, 0..2);
        assert_eq!(scene.roots, [NodeIndex(0), NodeIndex(4)]);
        assert_eq!(scene.children(NodeIndex(0)).collect::<Vec<_>>(), [NodeIndex(1), NodeIndex(3)]);
        assert_eq!(scene.table.objects[1].transform.translation, DVec3::X * 12.0);
        assert_eq!(scene.node_by_name("b"), Some(NodeIndex(1)), "the first of a name");
        assert_eq!(scene.node_by_name("e"), None);
        assert_eq!(scene.meshes.len(), 1, "four objects share one mesh");
        let (whole, part) = (scene.node(NodeIndex(0)).sphere, scene.objects[2].sphere);
        assert!(whole.centre.distance(part.centre) + part.radius <= whole.radius * (1.0 + 1e-12));
    }

    #[test]
    fn what_lies_beyond_all_numbers_is_refused_by_name() {
        let mut parts = Parts::default();
        let shape = parts.add_shape("t", Extras::default(), triangle());
        parts.nodes = vec![node("far", None, 1e200, shape)];
        let error = Scene::assemble(parts).unwrap_err();
        assert!(error.to_string().starts_with("node \"far\" lies beyond"), "{error}");
    }

    #[test]
    fn an_empty_scene_is_a_scene() {
        let scene = Scene::assemble(Parts::default()).unwrap();
        assert_eq!((scene.bounds, scene.sphere), (None, bounds::NOTHING));
    }
}
