//! What a board holds of a scene: meshes and textures by content, and the tables that place them.
//!
//! Everything came over a wire. It is checked here, once, so that the stages behind may index without fear: whatever the
//! store holds has indices in range, arrays of equal length and finite numbers. Meshes, textures and tables may come
//! in any order; what a list still lacks is asked for with [`SceneStore::missing`].
//!
//! Contents have a *slot*, a small number given at first mention, so that a frame finds its meshes by index and not by
//! name. Nothing is ever iterated in hash order.
//!
//! What a piece counts for in a board's memory limit is the same number here and at the manager ([`proto::piece`]), which decides
//! what is kept.

mod check;
mod error;
mod prepared;
#[cfg(test)]
mod tests;

pub use error::StoreError;
pub use prepared::{PieceError, Prepared};

use crate::debug::NO_LEVEL;
use crate::geometry::plane::FacePlanes;
use crate::texture::MipTexture;
use crate::translucency::models::Member;
use check::{check_mesh, check_table, check_weights};
use glam::DAffine3;
use prepared::PreparedContent;
use proto::frame::{Moved, VersionWeights};
use proto::ids::{ContentId, ModelId, ObjectId, PlaneId, SubobjectId};
use proto::piece::mesh_memory;
use proto::scene::{LightRow, Mesh, ModelPart, NO_PLANE, PlaneRow, SceneTable, SubobjectRow, Texture, TextureUse};
use std::collections::BTreeMap;

/// Texture coordinate sets a mesh may have.
pub const TEXCOORD_SETS_MAX: usize = 2;

/// Arrays of a stored mesh are padded to a multiple of this, for kernels that work on so many elements at once.
const PADDING: usize = 16;

/// A mesh whose indices, lengths and numbers have been checked.
#[derive(Debug)]
pub struct StoredMesh {
    /// The mesh as it came.
    pub mesh: Mesh,
    /// The mesh's positions by coordinate, padded with zeros.
    positions: [Vec<f32>; 3],
    /// Smallest and largest coordinates of its vertices, the origin added; `None` without vertices.
    bounds: Option<[glam::DVec3; 2]>,
    /// The mesh's normals, made unit vectors, by coordinate; empty if it has none. A vertex without one has zeros.
    normals: [Vec<f32>; 3],
    /// Slot of the base colour texture.
    pub base_texture: Option<usize>,
    /// Slot of the emissive texture.
    pub emissive_texture: Option<usize>,
}

impl StoredMesh {
    /// Without textures: their slots are the store's to give.
    fn new(mesh: Mesh) -> Self {
        let unit = |n: &[f32; 3]| glam::DVec3::from(n.map(f64::from)).normalize_or_zero().as_vec3().to_array();
        let positions = by_coordinate(mesh.positions.iter().copied());
        let normals = by_coordinate(mesh.normals.iter().map(unit));
        let vertices = || (0..mesh.positions.len()).map(|vertex| mesh.position(vertex));
        let least = vertices().reduce(glam::DVec3::min);
        let bounds = least.zip(vertices().reduce(glam::DVec3::max)).map(|(low, high)| [low, high]);
        Self { mesh, positions, bounds, normals, base_texture: None, emissive_texture: None }
    }

    /// Smallest and largest coordinates of its vertices in the mesh's space, computed here; `None` without vertices.
    pub fn bounds(&self) -> Option<[glam::DVec3; 2]> {
        self.bounds
    }

    /// Positions by coordinate, padded with zeros to a multiple of 16.
    pub fn positions(&self) -> [&[f32]; 3] {
        self.positions.each_ref().map(Vec::as_slice)
    }

    /// Normals likewise; empty if the mesh has none.
    pub fn normals(&self) -> [&[f32]; 3] {
        self.normals.each_ref().map(Vec::as_slice)
    }

    /// Whether any vertex has a normal.
    pub fn has_normals(&self) -> bool {
        !self.mesh.normals.is_empty()
    }
}

/// Vectors as three arrays, padded.
fn by_coordinate(vectors: impl ExactSizeIterator<Item = [f32; 3]>) -> [Vec<f32>; 3] {
    let padded = vectors.len().next_multiple_of(PADDING);
    let mut out = [(); 3].map(|()| vec![0.0; padded]);
    for (i, vector) in vectors.enumerate() {
        for (out, c) in out.iter_mut().zip(vector) {
            out[i] = c;
        }
    }
    out
}

/// A row of the subobject table with its mesh looked up.
#[derive(Clone, Copy, Debug)]
struct Placed {
    object: usize,
    mesh: usize,
    /// Place of its (layer, primitive) among all of the table: where faces coincide the larger wins, then the face's number.
    rank: u32,
}

/// A subobject of a list, looked up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found<'a> {
    pub(crate) stored: &'a StoredMesh,
    /// Mesh space → world, this frame.
    pub(crate) transform: &'a DAffine3,
    pub(crate) rank: u32,
    pub(crate) planes: Option<FacePlanes<'a>>,
    pub(crate) presence: Presence<'a>,
    /// See [`crate::geometry::transform::Item::level`].
    pub(crate) level: u8,
}

/// What a frame shows of a subobject.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Presence<'a> {
    /// Nothing: its version has no weight.
    Absent,
    /// All of it, as if there were no models.
    Ordinary,
    /// Its translucent faces are a part of that model, its opaque ones are ordinary.
    Merged(Member<'a>),
    /// All of its faces are a part of that model, which is in transition.
    InTransition(Member<'a>),
}

/// What a board holds. See the module.
#[derive(Debug, Default)]
pub struct SceneStore {
    mesh_slots: BTreeMap<ContentId, usize>,
    meshes: Vec<Option<StoredMesh>>,
    texture_slots: BTreeMap<ContentId, usize>,
    /// With what each counts for.
    textures: Vec<Option<(MipTexture, u64)>>,
    /// The sum of what is here.
    memory: u64,
    /// Names by slot, for [`SceneStore::missing`].
    mesh_names: Vec<ContentId>,
    texture_names: Vec<ContentId>,
    table: SceneTable,
    placed: Vec<Placed>,
    /// Where each object is this frame: the table's transformation unless it was moved.
    transforms: Vec<DAffine3>,
    moved: Vec<usize>,
    /// Weights of the versions of the models that a frame named, one per version; all others show version 0.
    weights: BTreeMap<ModelId, Vec<f64>>,
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
        self.insert(Prepared::mesh(id, mesh)?);
        Ok(())
    }

    /// Takes a texture in and makes its halved copies.
    ///
    /// # Errors
    /// [`StoreError::Texture`] when size and texels don't agree.
    pub fn insert_texture(&mut self, id: ContentId, texture: Texture) -> Result<(), StoreError> {
        self.insert(Prepared::texture(id, texture)?);
        Ok(())
    }

    /// Takes a piece in that has been prepared. One that is held already is left as it is.
    pub fn insert(&mut self, piece: Prepared) {
        let Prepared { id, memory, content } = piece;
        if self.holds(&id) {
            return;
        }
        self.memory += memory;
        match content {
            PreparedContent::Mesh(mut stored) => {
                let material = stored.mesh.material;
                stored.base_texture = self.texture_slot(material.base_texture);
                stored.emissive_texture = self.texture_slot(material.emissive_texture);
                let slot = slot(&mut self.mesh_slots, &mut self.mesh_names, &mut self.meshes, id);
                self.meshes[slot] = Some(*stored);
            }
            PreparedContent::Texture(texture) => {
                let slot = slot(&mut self.texture_slots, &mut self.texture_names, &mut self.textures, id);
                self.textures[slot] = Some((texture, memory));
            }
        }
    }

    /// Gives a mesh or texture up. False: it wasn't here.
    pub fn remove(&mut self, id: &ContentId) -> bool {
        let mesh = self.mesh_slots.get(id).and_then(|slot| self.meshes[*slot].take());
        let texture = self.texture_slots.get(id).and_then(|slot| self.textures[*slot].take());
        let freed = mesh.map(|stored| mesh_memory(&stored.mesh)).or(texture.map(|(_, memory)| memory));
        self.memory -= freed.unwrap_or(0);
        freed.is_some()
    }

    /// Bytes that all that is here counts for.
    pub fn memory(&self) -> u64 {
        self.memory
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

    /// Replaces the tables; every object is then where the table says, every model shows its version 0. Meshes may still be
    /// missing.
    ///
    /// # Errors
    /// When a row names what isn't there or has a number that is not finite; the old table is kept.
    pub fn set_table(&mut self, table: SceneTable) -> Result<(), StoreError> {
        check_table(&table)?;
        let place = |row: &SubobjectRow| (row.layer, row.primitive);
        let mut places: Vec<_> = table.subobjects.iter().map(place).collect();
        places.sort_unstable();
        places.dedup();
        self.placed = table
            .subobjects
            .iter()
            .map(|row| Placed {
                object: row.object.0 as usize,
                mesh: slot(&mut self.mesh_slots, &mut self.mesh_names, &mut self.meshes, row.mesh),
                rank: places.partition_point(|other| *other < place(row)) as u32,
            })
            .collect();
        self.transforms = table.objects.iter().map(|row| row.transform).collect();
        self.moved.clear();
        self.weights.clear();
        self.table = table;
        Ok(())
    }

    /// How the versions of models are mixed from now on; a model that is not named shows version 0 alone. Where a model is
    /// named twice the later counts.
    ///
    /// # Errors
    /// When a model isn't in the table or its weights are no mixture of its versions; nothing is changed then.
    pub fn set_weights(&mut self, weights: &[VersionWeights]) -> Result<(), StoreError> {
        let mut checked = BTreeMap::new();
        for row in weights {
            checked.insert(row.model, check_weights(&self.table.models, row)?);
        }
        self.weights = checked;
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

    /// Where the table has an object; `None` if it has none of that number.
    pub fn home(&self, object: ObjectId) -> Option<DAffine3> {
        self.table.objects.get(object.0 as usize).map(|row| row.transform)
    }

    /// Number of rows of the subobject table.
    pub fn subobjects(&self) -> usize {
        self.placed.len()
    }

    /// A subobject with what a frame needs of it; `None` if the row or the mesh isn't there.
    pub(crate) fn find(&self, id: SubobjectId) -> Option<Found<'_>> {
        let placed = self.placed.get(id.0 as usize)?;
        let row = &self.table.subobjects[id.0 as usize];
        Some(Found {
            stored: self.meshes[placed.mesh].as_ref()?,
            transform: &self.transforms[placed.object],
            rank: placed.rank,
            planes: row.planes.map(|begin| FacePlanes::new(self, placed.object, begin as usize)),
            presence: self.presence(row),
            level: self.level(row),
        })
    }

    /// Which version of its model a subobject is; a model of one version has no levels.
    fn level(&self, row: &SubobjectRow) -> u8 {
        let has_levels = |part: &ModelPart| self.table.models[part.model.0 as usize].versions > 1;
        row.part_of.filter(has_levels).map_or(NO_LEVEL, |part| u8::try_from(part.version).unwrap_or(NO_LEVEL))
    }

    /// Whether and as what a subobject is shown.
    fn presence(&self, row: &SubobjectRow) -> Presence<'_> {
        let Some(part) = row.part_of else { return Presence::Ordinary };
        let version = part.version as usize;
        let merged = self.table.models[part.model.0 as usize].merged;
        let of = |weights| Member { model: part.model.0, version, weights, merged };
        match self.weights.get(&part.model) {
            None if version != 0 => Presence::Absent,
            Some(weights) if weights[version] == 0.0 => Presence::Absent,
            // The others' weights are 0, or the sum would be more.
            Some(weights) if weights[version] != 1.0 => Presence::InTransition(of(weights.as_slice())),
            // The others are absent: it is the only version.
            None | Some(_) if merged => Presence::Merged(Member { version: 0, ..of(&[1.0]) }),
            None | Some(_) => Presence::Ordinary,
        }
    }

    /// The plane of face `face` of a subobject whose faces' planes begin at `begin`; `None` if it has none. A mesh with
    /// more faces than the table tells planes for contradicts the table; the rest then has none.
    pub(crate) fn face_plane(&self, begin: usize, face: usize) -> Option<PlaneId> {
        self.table.face_planes.get(begin + face).filter(|id| **id != NO_PLANE).map(|id| PlaneId(*id))
    }

    /// A plane as it holds for the faces of `object`, and where it is; `None` if one of both was moved without the other.
    pub(crate) fn placed_plane(&self, object: usize, plane: PlaneId) -> Option<(&PlaneRow, &DAffine3)> {
        let row = &self.table.planes[plane.0 as usize];
        let other = row.object.0 as usize;
        let is_home = |o: usize| self.transforms[o] == self.table.objects[o].transform;
        (other == object || (is_home(other) && is_home(object))).then_some((row, &self.transforms[other]))
    }

    /// The lights of the scene's file.
    pub(crate) fn lights(&self) -> &[LightRow] {
        &self.table.lights
    }

    /// The texture in a slot, if it has come.
    pub(crate) fn texture(&self, slot: usize) -> Option<&MipTexture> {
        self.textures[slot].as_ref().map(|(texture, _)| texture)
    }
}
