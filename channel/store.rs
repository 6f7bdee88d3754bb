//! What a board holds of a scene: meshes and textures by content, and the tables that place them.
//!
//! Everything came over a wire. It is checked here, once, so that the stages behind may index without fear: whatever the
//! store holds has indices in range, arrays of equal length and finite numbers. Meshes, textures and tables may come
//! in any order; what a list still lacks is asked for with [`SceneStore::missing`].
//!
//! Contents have a *slot*, a small number given at first mention, so that a frame finds its meshes by index and not by
//! name. Nothing is ever iterated in hash order.

use crate::texture::{MipTexture, TextureError};
use glam::DAffine3;
use proto::frame::Moved;
use proto::ids::{ContentId, ObjectId, SubobjectId};
use proto::limits::TRIANGLES_PER_SUBOBJECT_MAX;
use proto::scene::{Alpha, Mesh, SceneTable, Texture, TextureUse};
use std::collections::BTreeMap;
use thiserror::Error;

/// Texture coordinate sets a mesh may have.
pub const TEXCOORD_SETS_MAX: usize = 2;

/// Why something from outside is refused. The store is as it was before.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum StoreError {
    /// An array of per-vertex data has another length than the positions.
    #[error("mesh {mesh}: {found} {what} for {vertices} positions")]
    VertexArray {
        /// Which mesh.
        mesh: ContentId,
        /// Which array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// Number of positions.
        vertices: usize,
    },
    /// A triangle names a vertex that isn't there.
    #[error("mesh {mesh}: triangle {triangle} names vertex {index} of {vertices}")]
    VertexIndex {
        /// Which mesh.
        mesh: ContentId,
        /// Which triangle.
        triangle: usize,
        /// What it names.
        index: u32,
        /// Number of positions.
        vertices: usize,
    },
    /// The face numbers are not one per triangle.
    #[error("mesh {mesh}: {found} face numbers for {triangles} triangles")]
    FaceNumbers {
        /// Which mesh.
        mesh: ContentId,
        /// Number of face numbers.
        found: usize,
        /// Number of triangles.
        triangles: usize,
    },
    /// More triangles than a subobject may have.
    #[error("mesh {mesh}: {triangles} triangles, allowed are {TRIANGLES_PER_SUBOBJECT_MAX}")]
    MeshTooLarge {
        /// Which mesh.
        mesh: ContentId,
        /// Number of triangles.
        triangles: usize,
    },
    /// More texture coordinate sets than allowed.
    #[error("mesh {mesh}: {sets} texture coordinate sets, allowed are {TEXCOORD_SETS_MAX}")]
    TexcoordSets {
        /// Which mesh.
        mesh: ContentId,
        /// Number of sets.
        sets: usize,
    },
    /// A number is NaN or infinite.
    #[error("mesh {mesh}: {what} has a number that is not finite")]
    NotFinite {
        /// Which mesh.
        mesh: ContentId,
        /// In which array or factor.
        what: &'static str,
    },
    /// The texture contradicts itself.
    #[error("texture {texture}: {error}")]
    Texture {
        /// Which texture.
        texture: ContentId,
        /// What is wrong with it.
        #[source]
        error: TextureError,
    },
    /// A subobject names an object that the table doesn't have.
    #[error("subobject {subobject} belongs to object {object} of {objects}")]
    ObjectOutOfRange {
        /// Which row.
        subobject: usize,
        /// What it names.
        object: ObjectId,
        /// Number of objects.
        objects: usize,
    },
    /// A frame moves an object that the table doesn't have.
    #[error("object {object} of {objects} can't be moved")]
    MovedOutOfRange {
        /// Which object.
        object: ObjectId,
        /// Number of objects.
        objects: usize,
    },
    /// A transformation has a number that is NaN or infinite.
    #[error("the transformation of object {object} is not finite")]
    TransformNotFinite {
        /// Which object.
        object: ObjectId,
    },
}

/// A mesh whose indices, lengths and numbers have been checked.
#[derive(Debug)]
pub struct StoredMesh {
    /// The mesh as it came.
    pub mesh: Mesh,
    /// Slot of the base colour texture.
    pub base_texture: Option<usize>,
    /// Slot of the emissive texture.
    pub emissive_texture: Option<usize>,
}

/// A row of the subobject table with its mesh looked up.
#[derive(Clone, Copy, Debug)]
struct Placed {
    object: usize,
    mesh: usize,
}

/// What a board holds. See the module.
#[derive(Debug, Default)]
pub struct SceneStore {
    mesh_slots: BTreeMap<ContentId, usize>,
    meshes: Vec<Option<StoredMesh>>,
    texture_slots: BTreeMap<ContentId, usize>,
    textures: Vec<Option<MipTexture>>,
    /// Names by slot, for [`SceneStore::missing`].
    mesh_names: Vec<ContentId>,
    texture_names: Vec<ContentId>,
    table: SceneTable,
    placed: Vec<Placed>,
    /// Where each object is this frame: the table's transformation unless it was moved.
    transforms: Vec<DAffine3>,
    moved: Vec<usize>,
}

/// The slot of `id`, a new one at its end if it has none.
fn slot<T>(
    slots: &mut BTreeMap<ContentId, usize>,
    names: &mut Vec<ContentId>,
    contents: &mut Vec<Option<T>>,
    id: ContentId,
) -> usize {
    *slots.entry(id).or_insert_with(|| {
        names.push(id);
        contents.push(None);
        contents.len() - 1
    })
}

impl SceneStore {
    /// A store that holds nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes a mesh in. One that is held already is left as it is: equal names mean equal bytes.
    ///
    /// # Errors
    /// [`StoreError`] says in what the mesh contradicts itself or a limit.
    pub fn insert_mesh(&mut self, id: ContentId, mesh: Mesh) -> Result<(), StoreError> {
        check_mesh(id, &mesh)?;
        let material = mesh.material;
        let base_texture = self.texture_slot(material.base_texture);
        let emissive_texture = self.texture_slot(material.emissive_texture);
        let slot = slot(&mut self.mesh_slots, &mut self.mesh_names, &mut self.meshes, id);
        self.meshes[slot].get_or_insert(StoredMesh { mesh, base_texture, emissive_texture });
        Ok(())
    }

    /// Takes a texture in and makes its halved copies.
    ///
    /// # Errors
    /// [`StoreError::Texture`] when size and texels don't agree.
    pub fn insert_texture(&mut self, id: ContentId, texture: Texture) -> Result<(), StoreError> {
        let slot = slot(&mut self.texture_slots, &mut self.texture_names, &mut self.textures, id);
        if self.textures[slot].is_none() {
            let made = MipTexture::new(texture).map_err(|error| StoreError::Texture { texture: id, error })?;
            self.textures[slot] = Some(made);
        }
        Ok(())
    }

    fn texture_slot(&mut self, usage: Option<TextureUse>) -> Option<usize> {
        usage.map(|u| slot(&mut self.texture_slots, &mut self.texture_names, &mut self.textures, u.texture))
    }

    /// Whether the mesh or texture of that name is here.
    pub fn holds(&self, id: &ContentId) -> bool {
        self.mesh_slots.get(id).is_some_and(|slot| self.meshes[*slot].is_some())
            || self.texture_slots.get(id).is_some_and(|slot| self.textures[*slot].is_some())
    }

    /// The names of all meshes and textures that are here: meshes first, each ascending.
    pub fn contents(&self) -> impl Iterator<Item = ContentId> + '_ {
        let meshes = self.mesh_slots.iter().filter(|(_, slot)| self.meshes[**slot].is_some());
        let textures = self.texture_slots.iter().filter(|(_, slot)| self.textures[**slot].is_some());
        meshes.chain(textures).map(|(id, _)| *id)
    }

    /// Replaces the tables; every object is then where the table says. Meshes may still be missing.
    ///
    /// # Errors
    /// When a row names what isn't there or has a number that is not finite; the old table is kept.
    pub fn set_table(&mut self, table: SceneTable) -> Result<(), StoreError> {
        let objects = table.objects.len();
        for (i, row) in table.objects.iter().enumerate() {
            if !row.transform.is_finite() {
                return Err(StoreError::TransformNotFinite { object: ObjectId(i as u32) });
            }
        }
        for (subobject, row) in table.subobjects.iter().enumerate() {
            if row.object.0 as usize >= objects {
                return Err(StoreError::ObjectOutOfRange { subobject, object: row.object, objects });
            }
        }
        self.placed = table
            .subobjects
            .iter()
            .map(|row| Placed {
                object: row.object.0 as usize,
                mesh: slot(&mut self.mesh_slots, &mut self.mesh_names, &mut self.meshes, row.mesh),
            })
            .collect();
        self.transforms = table.objects.iter().map(|row| row.transform).collect();
        self.moved.clear();
        self.table = table;
        Ok(())
    }

    /// The objects that are elsewhere than the table says, from now on; all others are where the table says. Where
    /// an object is named twice the later counts.
    ///
    /// # Errors
    /// When an object isn't in the table or a number is not finite; nothing is moved then.
    pub fn set_moved(&mut self, moved: &[Moved]) -> Result<(), StoreError> {
        let objects = self.transforms.len();
        for row in moved {
            if row.object.0 as usize >= objects {
                return Err(StoreError::MovedOutOfRange { object: row.object, objects });
            }
            if !row.transform.is_finite() {
                return Err(StoreError::TransformNotFinite { object: row.object });
            }
        }
        for object in self.moved.drain(..) {
            self.transforms[object] = self.table.objects[object].transform;
        }
        for row in moved {
            self.transforms[row.object.0 as usize] = row.transform;
            self.moved.push(row.object.0 as usize);
        }
        Ok(())
    }

    /// What must still come before `list` can be drawn: meshes, and textures of those meshes that are here; each
    /// once, ascending. Ids beyond the table are no content and are left out; drawing reports them.
    pub fn missing(&self, list: &[SubobjectId]) -> Vec<ContentId> {
        let mut missing = Vec::new();
        for placed in list.iter().filter_map(|id| self.placed.get(id.0 as usize)) {
            match &self.meshes[placed.mesh] {
                None => missing.push(self.mesh_names[placed.mesh]),
                Some(mesh) => missing.extend(
                    [mesh.base_texture, mesh.emissive_texture]
                        .into_iter()
                        .flatten()
                        .filter(|slot| self.textures[*slot].is_none())
                        .map(|slot| self.texture_names[slot]),
                ),
            }
        }
        missing.sort_unstable();
        missing.dedup();
        missing
    }

    /// Number of rows of the subobject table.
    pub fn subobjects(&self) -> usize {
        self.placed.len()
    }

    /// The mesh of a subobject and where it is this frame; `None` if the row or the mesh isn't there.
    pub(crate) fn placed(&self, id: SubobjectId) -> Option<(&StoredMesh, &DAffine3)> {
        let placed = self.placed.get(id.0 as usize)?;
        Some((self.meshes[placed.mesh].as_ref()?, &self.transforms[placed.object]))
    }

    /// The texture in a slot, if it has come.
    pub(crate) fn texture(&self, slot: usize) -> Option<&MipTexture> {
        self.textures[slot].as_ref()
    }
}

fn check_mesh(id: ContentId, mesh: &Mesh) -> Result<(), StoreError> {
    let vertices = mesh.positions.len();
    let length = |what, found: usize, optional: bool| {
        if found == vertices || (optional && found == 0) {
            Ok(())
        } else {
            Err(StoreError::VertexArray { mesh: id, what, found, vertices })
        }
    };
    length("normals", mesh.normals.len(), true)?;
    length("colours", mesh.colors.len(), true)?;
    if mesh.texcoords.len() > TEXCOORD_SETS_MAX {
        return Err(StoreError::TexcoordSets { mesh: id, sets: mesh.texcoords.len() });
    }
    for set in &mesh.texcoords {
        length("texture coordinates", set.len(), false)?;
    }
    let triangles = mesh.triangles.len();
    if triangles > TRIANGLES_PER_SUBOBJECT_MAX {
        return Err(StoreError::MeshTooLarge { mesh: id, triangles });
    }
    if mesh.face_numbers.len() != triangles {
        return Err(StoreError::FaceNumbers { mesh: id, found: mesh.face_numbers.len(), triangles });
    }
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(index) = corners.iter().copied().find(|i| *i as usize >= vertices) {
            return Err(StoreError::VertexIndex { mesh: id, triangle, index, vertices });
        }
    }
    let finite = |what, is_finite: bool| if is_finite { Ok(()) } else { Err(StoreError::NotFinite { mesh: id, what }) };
    finite("origin", mesh.origin.is_finite())?;
    finite("positions", all_finite(&mesh.positions))?;
    finite("normals", all_finite(&mesh.normals))?;
    finite("colours", all_finite(&mesh.colors))?;
    finite("texture coordinates", mesh.texcoords.iter().all(|set| all_finite(set)))?;
    let material = &mesh.material;
    finite("base colour", all_finite(&[material.base_color]))?;
    finite("emissive colour", all_finite(&[material.emissive]))?;
    for usage in [material.base_texture, material.emissive_texture].into_iter().flatten() {
        finite("texture transformation", all_finite(&usage.transform))?;
    }
    if let Alpha::Mask { cutoff } = material.alpha {
        finite("alpha cut-off", cutoff.is_finite())?;
    }
    Ok(())
}

fn all_finite<const N: usize>(numbers: &[[f32; N]]) -> bool {
    numbers.as_flattened().iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::oracle::{mesh_of, place};
    use glam::DVec3;

    fn id(n: u8) -> ContentId {
        ContentId([n; 16])
    }

    fn triangle() -> Mesh {
        mesh_of(&[[DVec3::ZERO, DVec3::X, DVec3::Y]], [1.0; 4])
    }

    #[test]
    fn a_mesh_that_contradicts_itself_is_refused_by_name() {
        let refused = |change: fn(&mut Mesh)| {
            let mut mesh = triangle();
            change(&mut mesh);
            let mut store = SceneStore::new();
            let error = store.insert_mesh(id(1), mesh).unwrap_err();
            assert!(!store.holds(&id(1)), "{error}");
            error.to_string()
        };
        let m = "mesh 01010101010101010101010101010101";
        assert_eq!(refused(|m| m.triangles[0][2] = 3), format!("{m}: triangle 0 names vertex 3 of 3"));
        assert_eq!(refused(|m| m.normals.push([0.0; 3])), format!("{m}: 1 normals for 3 positions"));
        assert_eq!(refused(|m| m.colors.push([0.0; 4])), format!("{m}: 1 colours for 3 positions"));
        assert_eq!(refused(|m| m.texcoords.push(vec![])), format!("{m}: 0 texture coordinates for 3 positions"));
        assert_eq!(refused(|m| m.face_numbers.clear()), format!("{m}: 0 face numbers for 1 triangles"));
        assert_eq!(
            refused(|m| m.positions[1][0] = f32::NAN),
            format!("{m}: positions has a number that is not finite")
        );
        assert_eq!(
            refused(|m| m.texcoords = vec![vec![[0.0; 2]; 3]; 3]),
            format!("{m}: 3 texture coordinate sets, allowed are 2")
        );
        assert_eq!(
            refused(|m| {
                m.triangles = vec![[0, 1, 2]; 2049];
                m.face_numbers = vec![0; 2049];
            }),
            format!("{m}: 2049 triangles, allowed are 2048")
        );
    }

    #[test]
    fn meshes_textures_and_tables_come_in_any_order() {
        let mut mesh = triangle();
        mesh.material.base_texture = Some(crate::oracle::texture_use(id(2)));
        let mut store = SceneStore::new();
        let list = [SubobjectId(0), SubobjectId(0), SubobjectId(7)];
        store.set_table(place(&[(id(1), DAffine3::IDENTITY)])).unwrap();
        assert_eq!(store.missing(&list), [id(1)]);
        store.insert_mesh(id(1), mesh).unwrap();
        assert_eq!(store.missing(&list), [id(2)]);
        store.insert_texture(id(2), Texture { width: 1, height: 1, texels: vec![[255; 4]] }).unwrap();
        assert_eq!(store.missing(&list), []);
        assert!(store.holds(&id(1)) && store.holds(&id(2)) && !store.holds(&id(3)), "what came is held");
        assert_eq!(store.contents().collect::<Vec<_>>(), [id(1), id(2)]);
    }

    #[test]
    fn moving_replaces_the_earlier_moves_and_is_checked() {
        let mut store = SceneStore::new();
        store.insert_mesh(id(1), triangle()).unwrap();
        store.set_table(place(&[(id(1), DAffine3::IDENTITY), (id(1), DAffine3::IDENTITY)])).unwrap();
        let there = DAffine3::from_translation(DVec3::X);
        let x = |store: &SceneStore, n| store.placed(SubobjectId(n)).unwrap().1.translation.x;
        store.set_moved(&[Moved { object: ObjectId(0), transform: there }]).unwrap();
        assert_eq!((x(&store, 0), x(&store, 1)), (1.0, 0.0));
        let beyond = Moved { object: ObjectId(2), transform: there };
        assert_eq!(store.set_moved(&[beyond]), Err(StoreError::MovedOutOfRange { object: ObjectId(2), objects: 2 }));
        assert_eq!((x(&store, 0), x(&store, 1)), (1.0, 0.0), "nothing changes on error");
        store.set_moved(&[Moved { object: ObjectId(1), transform: there }]).unwrap();
        assert_eq!((x(&store, 0), x(&store, 1)), (0.0, 1.0));
        let nowhere = DAffine3::from_translation(DVec3::NAN);
        assert_eq!(
            store.set_moved(&[Moved { object: ObjectId(1), transform: nowhere }]),
            Err(StoreError::TransformNotFinite { object: ObjectId(1) })
        );
    }
}
