//! What is drawn: meshes in their places, in the order of the file.
//!
//! A [`World`] is made of a scene's tables ([`World::of_scene`]) or put together by a test. The tables' list of planes
//! (`SceneTable::planes`) is not read: which faces lie in one plane is found out here, see [`crate::plane`].

use crate::translucency::{Member, Model};
use glam::DAffine3;
use proto::frame::{Moved, VersionWeights};
use proto::ids::{ContentId, ModelId, SubobjectId};
use proto::scene::{LightRow, Mesh, SceneTable, Texture};
use std::collections::BTreeMap;
use std::sync::Arc;
use thiserror::Error;

/// A mesh in its place.
#[derive(Clone, Copy, Debug)]
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
}

impl<'a> World<'a> {
    /// All subobjects of a scene, with the objects of `moved` where those say, and the versions of models mixed as
    /// `weights` say; a model that they don't name shows its finest version alone.
    ///
    /// # Errors
    /// [`WorldError`] when the tables name what isn't there.
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
            lights: table.lights.clone(),
        };
        for (row, number) in table.subobjects.iter().zip(0..) {
            let subobject = SubobjectId(number);
            let mesh = meshes.get(&row.mesh).ok_or(WorldError::Mesh { subobject, mesh: row.mesh })?;
            for used in [mesh.material.base_texture, mesh.material.emissive_texture].into_iter().flatten() {
                if !textures.contains_key(&used.texture) {
                    return Err(WorldError::Texture { subobject, texture: used.texture });
                }
            }
            let object = table.objects.get(row.object.0 as usize).ok_or(WorldError::Object { subobject })?;
            let transform = moved.get(&row.object).copied().unwrap_or(object.transform);
            let member =
                row.part_of.map(|part| Member { model: part.model.0 as usize, version: part.version as usize });
            if let (Some(member), Some(part)) = (member, row.part_of) {
                let versions = world.models.get(member.model).map_or(0, |model| model.weights.len());
                if member.version >= versions {
                    return Err(WorldError::Model { model: part.model });
                }
            }
            world.instances.push(Instance { mesh, transform, layer: row.layer, primitive: row.primitive, member });
        }
        Ok(world)
    }

    /// Adds a mesh with nothing special about it, as the next primitive of the file.
    pub fn add(&mut self, mesh: &'a Mesh, transform: DAffine3) {
        let primitive = self.instances.len() as u32;
        self.instances.push(Instance { mesh, transform, layer: 0, primitive, member: None });
    }
}
