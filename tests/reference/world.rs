//! What is drawn: meshes in their places, in the order of the file.
//!
//! A [`World`] is made of a scene's tables ([`World::of_scene`]) or put together by a test. Of the tables' planes
//! (`SceneTable::planes`) only the depth of their faces is taken; which of two faces in one plane is in front is found
//! out here, see [`crate::plane`].

use crate::plane::{LIES_IN, ScenePlane};
use crate::translucency::{Member, Model};
use glam::{DAffine3, DVec3};
use proto::frame::{Moved, VersionWeights};
use proto::ids::{ContentId, ModelId, ObjectId, SubobjectId};
use proto::scene::{LightRow, Mesh, NO_PLANE, SceneTable, Texture};
use std::collections::BTreeMap;
use std::sync::Arc;
use thiserror::Error;

/// A mesh in its place.
#[derive(Clone, Debug)]
pub struct Instance<'a> {
    /// The geometry and its material.
    pub mesh: &'a Mesh,
    /// Mesh space → world.
    pub transform: DAffine3,
    /// Where planes coincide the higher layer wins; in one layer the later primitive, then the later face.
    pub layer: i32,
    /// Number of the primitive in the file.
    pub primitive: u32,
    /// Which version of which model it belongs to; `None`: each face stands for itself.
    pub member: Option<Member>,
    /// For each triangle of the mesh the index of the plane in [`World::planes`] that it takes its depth from, if that
    /// isn't its own; empty: all have their own.
    pub planes: Vec<Option<u32>>,
}

impl Instance<'_> {
    /// What picture.md's tolerance for faces in one plane is relative to: the larger of a triangle's extent and its
    /// coordinates in the mesh, as long as the transformation makes that, m.
    pub fn reach(&self, triangle: usize) -> f64 {
        let linear = self.transform.matrix3;
        let [a, b, c] = self.mesh.triangles[triangle].map(|c| self.mesh.position(c as usize));
        let extent = [b - a, c - b, a - c].map(|side| (linear * side).length()).into_iter().fold(0.0, f64::max);
        let stretch = [linear.x_axis, linear.y_axis, linear.z_axis].map(DVec3::length).into_iter().fold(0.0, f64::max);
        extent.max(a.abs().max(b.abs()).max(c.abs()).max_element() * stretch)
    }
}

/// Everything there is to be seen.
#[derive(Clone, Debug, Default)]
pub struct World<'a> {
    /// In the order of the file.
    pub instances: Vec<Instance<'a>>,
    /// The textures that materials name.
    pub textures: BTreeMap<ContentId, &'a Texture>,
    /// The models that [`Instance::member`] names by index.
    pub models: Vec<Model>,
    /// The planes that [`Instance::planes`] names by index.
    pub planes: Vec<ScenePlane>,
    /// The lights of the file; they shine if the frame asks for them.
    pub lights: Vec<LightRow>,
}

/// Why a scene can't be drawn. The caller's fault.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum WorldError {
    /// The table names a mesh that wasn't given.
    #[error("subobject {subobject}: mesh {mesh} is not among the meshes")]
    Mesh {
        /// Which row.
        subobject: SubobjectId,
        /// What it names.
        mesh: ContentId,
    },
    /// A material names a texture that wasn't given.
    #[error("subobject {subobject}: texture {texture} is not among the textures")]
    Texture {
        /// Which row.
        subobject: SubobjectId,
        /// What its material names.
        texture: ContentId,
    },
    /// The table names an object beyond its end.
    #[error("subobject {subobject}: there is no such object")]
    Object {
        /// Which row.
        subobject: SubobjectId,
    },
    /// A model or version beyond the table's end.
    #[error("{model}: there is no such model, or not that version of it")]
    Model {
        /// Which model.
        model: ModelId,
    },
    /// A plane names an object beyond the table's end.
    #[error("plane {plane}: there is no such object")]
    PlaneObject {
        /// Which row of planes.
        plane: usize,
    },
    /// The table gives a face a plane that there is not, or that the face doesn't lie in.
    #[error("subobject {subobject}: triangle {triangle} does not lie in the plane that the table says")]
    Plane {
        /// Which row.
        subobject: SubobjectId,
        /// Index of the triangle in its mesh.
        triangle: usize,
    },
}

impl<'a> World<'a> {
    /// All subobjects of a scene, with the objects of `moved` where those say, and the versions of models mixed as
    /// `weights` say; a model that they don't name shows its finest version alone.
    ///
    /// # Errors
    /// [`WorldError`] when the tables name what isn't there, or a plane for a face that doesn't lie in it.
    pub fn of_scene(
        table: &SceneTable,
        meshes: &'a BTreeMap<ContentId, Arc<Mesh>>,
        textures: &'a BTreeMap<ContentId, Arc<Texture>>,
        moved: &[Moved],
        weights: &[VersionWeights],
    ) -> Result<Self, WorldError> {
        let moved: BTreeMap<_, _> = moved.iter().map(|moved| (moved.object, moved.transform)).collect();
        let finest = |versions: u32| (0..versions).map(|v| f64::from(u8::from(v == 0))).collect();
        let mut models: Vec<Model> =
            table.models.iter().map(|row| Model { weights: finest(row.versions), merged: row.merged }).collect();
        for given in weights {
            let model = models.get_mut(given.model.0 as usize).filter(|m| m.weights.len() == given.weights.len());
            let model = model.ok_or(WorldError::Model { model: given.model })?;
            model.weights = given.weights.iter().map(|w| f64::from(*w)).collect();
        }
        let mut world = Self {
            instances: Vec::new(),
            textures: textures.iter().map(|(id, texture)| (*id, texture.as_ref())).collect(),
            models,
            planes: Vec::new(),
            lights: table.lights.clone(),
        };
        let home = |object: ObjectId| table.objects.get(object.0 as usize).map(|row| row.transform);
        let place = |object: ObjectId| home(object).map(|home| moved.get(&object).copied().unwrap_or(home));
        for (plane, row) in table.planes.iter().enumerate() {
            let transform = place(row.object).ok_or(WorldError::PlaneObject { plane })?;
            world.planes.push(ScenePlane { transform, normal: row.normal, offset: row.offset });
        }
        for (row, number) in table.subobjects.iter().zip(0..) {
            let subobject = SubobjectId(number);
            let mesh = meshes.get(&row.mesh).ok_or(WorldError::Mesh { subobject, mesh: row.mesh })?;
            for used in [mesh.material.base_texture, mesh.material.emissive_texture].into_iter().flatten() {
                if !textures.contains_key(&used.texture) {
                    return Err(WorldError::Texture { subobject, texture: used.texture });
                }
            }
            let transform = place(row.object).ok_or(WorldError::Object { subobject })?;
            let member =
                row.part_of.map(|part| Member { model: part.model.0 as usize, version: part.version as usize });
            if let (Some(member), Some(part)) = (member, row.part_of) {
                let versions = world.models.get(member.model).map_or(0, |model| model.weights.len());
                if member.version >= versions {
                    return Err(WorldError::Model { model: part.model });
                }
            }
            // A plane holds for a face as long as both are where the table says, or are moved as one.
            let is_home = |object: ObjectId| place(object) == home(object);
            let holds = |of: ObjectId| of == row.object || (is_home(of) && is_home(row.object));
            let mut planes = Vec::new();
            if let Some(start) = row.planes {
                for triangle in 0..mesh.triangles.len() {
                    let wrong = || WorldError::Plane { subobject, triangle };
                    let plane = *table.face_planes.get(start as usize + triangle).ok_or_else(wrong)?;
                    if plane == NO_PLANE {
                        planes.push(None);
                        continue;
                    }
                    let of = table.planes.get(plane as usize).ok_or_else(wrong)?.object;
                    planes.push(holds(of).then_some(plane));
                }
            }
            let (layer, primitive) = (row.layer, row.primitive);
            world.instances.push(Instance { mesh, transform, layer, primitive, member, planes });
        }
        world.check_planes()?;
        Ok(world)
    }

    /// Whether each face lies in the plane that it takes its depth from.
    fn check_planes(&self) -> Result<(), WorldError> {
        let mut reach = vec![0.0f64; self.planes.len()];
        for (instance, _, triangle, plane) in self.faces_with_planes() {
            reach[plane] = reach[plane].max(instance.reach(triangle));
        }
        for (instance, number, triangle, plane) in self.faces_with_planes() {
            let distance =
                |c: u32| self.planes[plane].distance(&instance.transform, instance.mesh.position(c as usize));
            // A NaN is not within either.
            if !instance.mesh.triangles[triangle].into_iter().all(|c| distance(c) <= LIES_IN * reach[plane]) {
                return Err(WorldError::Plane { subobject: SubobjectId(number), triangle });
            }
        }
        Ok(())
    }

    /// The faces that take their depth from a plane: instance, its number, triangle, plane.
    fn faces_with_planes(&self) -> impl Iterator<Item = (&Instance<'a>, u32, usize, usize)> {
        self.instances.iter().zip(0..).flat_map(|(instance, number)| {
            let faces = instance.planes.iter().enumerate();
            faces.filter_map(move |(triangle, plane)| Some((instance, number, triangle, (*plane)? as usize)))
        })
    }

    /// The same with a depth of its own for each face.
    pub fn without_planes(&self) -> Self {
        let mut world = self.clone();
        world.instances.iter_mut().for_each(|instance| instance.planes.clear());
        world
    }

    /// Adds a mesh with nothing special about it, as the next primitive of the file.
    pub fn add(&mut self, mesh: &'a Mesh, transform: DAffine3) {
        let primitive = self.instances.len() as u32;
        self.instances.push(Instance { mesh, transform, layer: 0, primitive, member: None, planes: Vec::new() });
    }
}
