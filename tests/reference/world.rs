//! What is drawn: meshes in their places, in the order of the file.
//!
//! A [`World`] is made of a scene's tables ([`World::of_scene`]) or put together by a test. What `proto`'s tables can't
//! say yet, layers of coplanar faces and membership of models with versions, stands beside each mesh in its
//! [`Instance`], so that a test can state it.

use crate::translucency::{Member, Model};
use glam::DAffine3;
use proto::frame::Moved;
use proto::ids::{ContentId, SubobjectId};
use proto::scene::{Mesh, SceneTable, Texture};
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
    /// Where planes coincide the higher layer wins.
    pub layer: i32,
    /// Which version of which model it belongs to; `None`: each face stands for itself.
    pub member: Option<Member>,
}

/// Everything there is to be seen. Where faces coincide the later instance wins, in one instance the later face.
#[derive(Clone, Debug, Default)]
pub struct World<'a> {
    /// In the order of the file.
    pub instances: Vec<Instance<'a>>,
    /// The textures that materials name.
    pub textures: BTreeMap<ContentId, &'a Texture>,
    /// The models that [`Instance::member`] names by index.
    pub models: Vec<Model>,
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
}

impl<'a> World<'a> {
    /// All subobjects of a scene, with the objects of `moved` where those say; ordinary in every other respect.
    ///
    /// # Errors
    /// [`WorldError`] when the tables name what isn't there.
    pub fn of_scene(
        table: &SceneTable,
        meshes: &'a BTreeMap<ContentId, Arc<Mesh>>,
        textures: &'a BTreeMap<ContentId, Arc<Texture>>,
        moved: &[Moved],
    ) -> Result<Self, WorldError> {
        let moved: BTreeMap<_, _> = moved.iter().map(|moved| (moved.object, moved.transform)).collect();
        let mut world =
            Self { textures: textures.iter().map(|(id, texture)| (*id, texture.as_ref())).collect(), ..Self::default() };
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
            world.instances.push(Instance { mesh, transform, layer: 0, member: None });
        }
        Ok(world)
    }

    /// Adds a mesh with nothing special about it.
    pub fn add(&mut self, mesh: &'a Mesh, transform: DAffine3) {
        self.instances.push(Instance { mesh, transform, layer: 0, member: None });
    }
}
