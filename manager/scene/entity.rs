//! What the host has moved.
//!
//! A pose puts a node somewhere in the world: its position and orientation replace the node's, its own scale stays, and
//! everything below moves along. The scene itself does not change, and neither does its culling tree: the objects of a
//! moved node are looked at one by one instead ([`Entities::objects`]), and the tree's finds of them are ignored
//! ([`Entities::is_moved`]). That costs a test per moved object and frame, where rebuilding the tree would cost a
//! sort; a simulator moves dozens of things, not thousands.
//!
//! Poses are absolute, so their order doesn't matter: a moved node below a moved node stands where its own pose says.

use super::bounds;
use super::database::{NodeIndex, Scene};
use glam::{DAffine3, DMat3};
use proto::frame::Moved;
use proto::ids::ObjectId;
use proto::scene::Sphere;
use proto::view::Pose;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

/// Marks an object that is where the file puts it.
const AT_REST: u32 = u32::MAX;

/// An object that is not where the file puts it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovedObject {
    /// Which object.
    pub object: ObjectId,
    /// Mesh space → world.
    pub transform: DAffine3,
    /// Encloses it, world.
    pub sphere: Sphere,
}

/// The poses in force, and what follows from them. Made for one scene and used with that one only.
#[derive(Clone, Debug)]
pub struct Entities {
    poses: BTreeMap<NodeIndex, Pose>,
    /// Objects that are not at rest, in no order.
    objects: Vec<MovedObject>,
    /// By object: its place in `objects`, or [`AT_REST`].
    slots: Vec<u32>,
    /// World transformations of a subtree while it is being moved; `None`: at rest.
    scratch: Vec<Option<DAffine3>>,
    /// See [`Self::revision`].
    revision: u64,
    /// See [`Self::set_revision`].
    set_revision: u64,
}

/// A number that nothing else in this process has.
fn unique() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

impl Entities {
    /// Everything at rest.
    pub fn new(scene: &Scene) -> Self {
        Self {
            poses: BTreeMap::new(),
            objects: Vec::new(),
            slots: vec![AT_REST; scene.objects.len()],
            scratch: Vec::new(),
            revision: unique(),
            set_revision: unique(),
        }
    }

    /// Differs between any two states of entities that were made in this process, but for copies and states that are equal anyway.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Differs between any two states in which different objects have moved, or are in different places of [`Self::objects`].
    pub fn set_revision(&self) -> u64 {
        self.set_revision
    }

    /// The place in [`Self::objects`] of an object that isn't where the file puts it.
    pub fn moved_number(&self, object: ObjectId) -> Option<usize> {
        let slot = self.slots[object.0 as usize];
        (slot != AT_REST).then_some(slot as usize)
    }

    /// Puts `node` and all below it at `pose`. Cost: the nodes of the subtree.
    pub fn set(&mut self, scene: &Scene, node: NodeIndex, pose: Pose) {
        if self.poses.insert(node, pose) != Some(pose) {
            self.place(scene, node);
        }
    }

    /// Takes the node's pose away: it is where the file or a moved node above it puts it.
    pub fn unset(&mut self, scene: &Scene, node: NodeIndex) {
        if self.poses.remove(&node).is_some() {
            self.place(scene, node);
        }
    }

    /// Everything at rest again.
    pub fn clear(&mut self) {
        self.poses.clear();
        (self.revision, self.set_revision) = (unique(), unique());
        for moved in self.objects.drain(..) {
            self.slots[moved.object.0 as usize] = AT_REST;
        }
    }

    /// The poses in force.
    pub fn poses(&self) -> &BTreeMap<NodeIndex, Pose> {
        &self.poses
    }

    /// The objects that are not where the file puts them, in no particular order.
    pub fn objects(&self) -> &[MovedObject] {
        &self.objects
    }

    /// Whether the object is not where the file puts it.
    pub fn is_moved(&self, object: ObjectId) -> bool {
        self.slots[object.0 as usize] != AT_REST
    }

    /// Where the object is: mesh space → world.
    pub fn transform(&self, scene: &Scene, object: ObjectId) -> DAffine3 {
        match self.slots[object.0 as usize] {
            AT_REST => scene.table.objects[object.0 as usize].transform,
            slot => self.objects[slot as usize].transform,
        }
    }

    /// What boards must be told, by ascending object; replaces the content of `out`.
    pub fn moved(&self, out: &mut Vec<Moved>) {
        out.clear();
        out.extend(self.objects.iter().map(|moved| Moved { object: moved.object, transform: moved.transform }));
        out.sort_unstable_by_key(|moved| moved.object);
    }

    /// The world transformation of a node that has a pose or is below one; `None` if it is at rest. Multiplied from the
    /// nearest pose down, as [`Self::place`] does, so that the bits don't depend on the order of calls.
    fn world(&self, scene: &Scene, node: NodeIndex) -> Option<DAffine3> {
        let mut path = Vec::new();
        let mut at = node;
        let mut world = loop {
            if let Some(pose) = self.poses.get(&at) {
                break posed(scene.node(at).own_scale(), *pose);
            }
            path.push(at);
            at = scene.node(at).parent?;
        };
        for node in path.into_iter().rev() {
            world *= scene.node(node).local;
        }
        Some(world)
    }

    /// Brings the objects of a subtree to where poses now put them.
    fn place(&mut self, scene: &Scene, root: NodeIndex) {
        self.revision = unique();
        let mut worlds = std::mem::take(&mut self.scratch);
        worlds.clear();
        for index in root.0..scene.node(root).end {
            let node = scene.node(NodeIndex(index));
            let world = match node.parent.filter(|_| index != root.0) {
                None => self.world(scene, root),
                Some(parent) => match self.poses.get(&NodeIndex(index)) {
                    Some(pose) => Some(posed(node.own_scale(), *pose)),
                    None => worlds[(parent.0 - root.0) as usize].map(|parent: DAffine3| parent * node.local),
                },
            };
            worlds.push(world);
            match (node.object, world) {
                (Some(object), Some(world)) => self.put(scene, object, world),
                (Some(object), None) => self.rest(object),
                (None, _) => {}
            }
        }
        self.scratch = worlds;
    }

    fn put(&mut self, scene: &Scene, object: ObjectId, transform: DAffine3) {
        let shape = scene.shape_of(scene.object(object));
        let moved = MovedObject { object, transform, sphere: bounds::ball_moved(&transform, shape.sphere) };
        let slot = &mut self.slots[object.0 as usize];
        if *slot == AT_REST {
            *slot = self.objects.len() as u32;
            self.objects.push(moved);
            self.set_revision = unique();
        } else {
            self.objects[*slot as usize] = moved;
        }
    }

    fn rest(&mut self, object: ObjectId) {
        let slot = std::mem::replace(&mut self.slots[object.0 as usize], AT_REST);
        if slot != AT_REST {
            self.set_revision = unique();
            self.objects.swap_remove(slot as usize);
            if let Some(filled) = self.objects.get(slot as usize) {
                self.slots[filled.object.0 as usize] = slot;
            }
        }
    }
}

/// The pose's position and orientation over the node's own scale.
fn posed(own_scale: DMat3, pose: Pose) -> DAffine3 {
    DAffine3 { matrix3: DMat3::from_quat(pose.orientation) * own_scale, translation: pose.position }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::split::{Primitive, split};
    use crate::scene::{Extras, NodeSource, Parts, PieceSource};
    use glam::{DQuat, DVec3};

    /// A mirrored, stretched body with a wheel below it, under a turned root; and a bystander.
    fn scene() -> Scene {
        let primitive = Primitive {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2]],
            ..Primitive::default()
        };
        let mut parts = Parts::default();
        let shape = parts.add_shape("t", Extras::default(), PieceSource::plain(split(&primitive), 0));
        let mut add = |name: &str, parent, scale, rotation, translation, shape| {
            let local = DAffine3::from_scale_rotation_translation(scale, rotation, translation);
            parts.nodes.push(NodeSource { name: name.into(), parent, local, rotation, shape, ..NodeSource::default() });
        };
        let turn = DQuat::from_rotation_y(1.0);
        add("root", None, DVec3::splat(2.0), turn, DVec3::new(5.0, 0.0, 0.0), None);
        add("body", Some(0), DVec3::new(-1.0, 3.0, 1.0), DQuat::from_rotation_z(0.5), DVec3::Y, shape);
        add("wheel", Some(1), DVec3::ONE, DQuat::IDENTITY, DVec3::X, shape);
        add("stone", None, DVec3::ONE, DQuat::IDENTITY, DVec3::Z, shape);
        Scene::assemble(parts).unwrap()
    }

    fn close(a: DAffine3, b: DAffine3) -> bool {
        a.abs_diff_eq(b, 1e-12)
    }

    #[test]
    fn a_pose_replaces_position_and_orientation_and_keeps_the_scale() {
        let scene = scene();
        let mut entities = Entities::new(&scene);
        let body = scene.node_by_name("body").unwrap();
        let pose = Pose { position: DVec3::new(1.0, 2.0, 3.0), orientation: DQuat::from_rotation_x(0.3) };
        entities.set(&scene, body, pose);
        let expected =
            DAffine3::from_scale_rotation_translation(DVec3::new(-2.0, 6.0, 2.0), pose.orientation, pose.position);
        assert!(close(entities.transform(&scene, ObjectId(0)), expected));
        let wheel = expected * DAffine3::from_translation(DVec3::X);
        assert!(close(entities.transform(&scene, ObjectId(1)), wheel), "what is below moves along");
        assert!(!entities.is_moved(ObjectId(2)), "what is beside stays");
    }

    #[test]
    fn the_pose_that_a_node_has_anyway_changes_nothing() {
        let scene = scene();
        let mut entities = Entities::new(&scene);
        let body = scene.node_by_name("body").unwrap();
        let node = scene.node(body);
        entities.set(&scene, body, Pose { position: node.world.translation, orientation: node.orientation });
        for object in 0..3 {
            let object = ObjectId(object);
            let file = scene.table.objects[object.0 as usize].transform;
            assert!(close(entities.transform(&scene, object), file), "{object:?}");
        }
    }

    #[test]
    fn poses_of_nested_entities_hold_in_any_order_and_are_taken_back_one_by_one() {
        let scene = scene();
        let (body, wheel) = (scene.node_by_name("body").unwrap(), scene.node_by_name("wheel").unwrap());
        let pose = |x: f64| Pose { position: DVec3::X * x, orientation: DQuat::from_rotation_y(x) };
        let (mut one, mut other) = (Entities::new(&scene), Entities::new(&scene));
        one.set(&scene, body, pose(10.0));
        one.set(&scene, wheel, pose(20.0));
        other.set(&scene, wheel, pose(20.0));
        other.set(&scene, body, pose(10.0));
        let (mut a, mut b) = (Vec::new(), Vec::new());
        one.moved(&mut a);
        other.moved(&mut b);
        assert_eq!(a, b);
        assert_eq!(a[1].transform.translation, DVec3::X * 20.0);

        one.unset(&scene, body);
        assert!(!one.is_moved(ObjectId(0)));
        assert_eq!(one.transform(&scene, ObjectId(1)).translation, DVec3::X * 20.0);
        one.unset(&scene, wheel);
        assert!(one.objects().is_empty() && one.poses().is_empty());
        other.clear();
        assert!(other.objects().is_empty() && !other.is_moved(ObjectId(0)));
    }
}
