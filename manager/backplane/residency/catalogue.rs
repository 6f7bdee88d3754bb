//! The pieces of a scene and what needs them, by small numbers: what planning looks up millions of times.

use crate::scene::{ContentError, Scene};
use proto::ids::{ContentId, SubobjectId};
use proto::piece::{PieceKind, mesh_memory, texture_memory};
use proto::scene::{ModelPart, SceneTable, SubobjectRow};
use std::collections::BTreeSet;

/// Nothing, where a number of a piece could be.
const NONE: u32 = u32::MAX;

/// A piece as the catalogue is made from it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    pub id: ContentId,
    /// What it counts for in a board's memory, bytes.
    pub memory: u64,
    /// The textures of a mesh.
    pub textures: [Option<ContentId>; 2],
}

/// See the module's head. Pieces are numbered: textures first, then meshes, each by ascending name.
#[derive(Debug)]
pub(crate) struct Catalogue {
    ids: Vec<ContentId>,
    memory: Vec<u64>,
    textures: u32,
    /// By mesh: its textures.
    worn: Vec<[u32; 2]>,
    /// By subobject: its mesh.
    mesh_of: Vec<u32>,
    /// By subobject: its place in a model of several versions. Empty if the scene has no such model.
    parts: Vec<Option<ModelPart>>,
    /// By model and version: the meshes. Nothing for a model of one version.
    models: Vec<Vec<Vec<u32>>>,
    /// All meshes in the order in which they are sent when nothing else is wished: every model's coarsest version, then as
    /// subobjects name them.
    pub rest: Vec<u32>,
    total: u64,
}

impl Catalogue {
    /// # Errors
    /// When the scene is in a baked file that doesn't give all of it.
    pub(crate) fn of(scene: &Scene) -> Result<Self, ContentError> {
        let texture = |(id, [width, height]): (&ContentId, [u32; 2])| Entry {
            id: *id,
            memory: texture_memory(width, height),
            textures: [None; 2],
        };
        let mesh = |id: &ContentId| {
            let mesh = scene.meshes.get(id)?;
            let uses = [mesh.material.base_texture, mesh.material.emissive_texture];
            Ok(Entry { id: *id, memory: mesh_memory(&mesh), textures: uses.map(|used| used.map(|used| used.texture)) })
        };
        let meshes = scene.meshes.keys().map(mesh).collect::<Result<_, ContentError>>()?;
        Ok(Self::new(scene.textures.sizes().map(texture).collect(), meshes, &scene.table))
    }

    /// Of entries in ascending order, which have what the table names. What no subobject needs is left out.
    pub(crate) fn new(mut textures: Vec<Entry>, mut meshes: Vec<Entry>, table: &SceneTable) -> Self {
        let named: BTreeSet<ContentId> = table.subobjects.iter().map(|row| row.mesh).collect();
        meshes.retain(|mesh| named.contains(&mesh.id));
        let worn: BTreeSet<ContentId> = meshes.iter().flat_map(|mesh| mesh.textures).flatten().collect();
        textures.retain(|texture| worn.contains(&texture.id));
        let count = textures.len() as u32;
        let find = |entries: &[Entry], id: &ContentId| entries.binary_search_by(|entry| entry.id.cmp(id)).ok();
        let texture = |id: Option<ContentId>| id.and_then(|id| find(&textures, &id)).map_or(NONE, |k| k as u32);
        let worn = meshes.iter().map(|mesh| mesh.textures.map(texture)).collect();
        let mesh = |id: &ContentId| find(&meshes, id).map_or(NONE, |k| count + k as u32);
        let mesh_of: Vec<u32> = table.subobjects.iter().map(|row| mesh(&row.mesh)).collect();
        let several = |part: &ModelPart| table.models[part.model.0 as usize].versions > 1;
        let part = |row: &SubobjectRow| row.part_of.filter(several);
        let has_parts = table.models.iter().any(|model| model.versions > 1);
        let parts = if has_parts { table.subobjects.iter().map(part).collect() } else { Vec::new() };
        let versions = |versions: u32| if versions > 1 { vec![Vec::new(); versions as usize] } else { Vec::new() };
        let mut models: Vec<Vec<Vec<u32>>> = table.models.iter().map(|model| versions(model.versions)).collect();
        for (part, mesh) in parts.iter().zip(&mesh_of) {
            if let Some(part) = part {
                models[part.model.0 as usize][part.version as usize].push(*mesh);
            }
        }
        let all: Vec<Entry> = textures.into_iter().chain(meshes).collect();
        let mut is_listed = vec![false; all.len()];
        let coarsest = models.iter().filter_map(|versions| versions.last()).flatten();
        let named = coarsest.chain(&mesh_of).copied().filter(|mesh| *mesh != NONE);
        let rest = named.filter(|mesh| !std::mem::replace(&mut is_listed[*mesh as usize], true)).collect();
        Self {
            ids: all.iter().map(|entry| entry.id).collect(),
            memory: all.iter().map(|entry| entry.memory).collect(),
            total: all.iter().map(|entry| entry.memory).sum(),
            textures: count,
            worn,
            mesh_of,
            parts,
            models,
            rest,
        }
    }

    /// Number of pieces.
    pub(crate) fn len(&self) -> usize {
        self.ids.len()
    }

    /// What all pieces count for together, bytes.
    pub(crate) fn total(&self) -> u64 {
        self.total
    }

    pub(crate) fn id(&self, piece: u32) -> ContentId {
        self.ids[piece as usize]
    }

    pub(crate) fn kind(&self, piece: u32) -> PieceKind {
        if piece < self.textures { PieceKind::Texture } else { PieceKind::Mesh }
    }

    pub(crate) fn memory(&self, piece: u32) -> u64 {
        self.memory[piece as usize]
    }

    pub(crate) fn find(&self, id: &ContentId) -> Option<u32> {
        let (textures, meshes) = self.ids.split_at(self.textures as usize);
        let mesh = || meshes.binary_search(id).ok().map(|k| k as u32 + self.textures);
        textures.binary_search(id).ok().map(|k| k as u32).or_else(mesh)
    }

    /// The mesh of a subobject; `None` for a row that the table doesn't have.
    pub(crate) fn mesh_of(&self, subobject: SubobjectId) -> Option<u32> {
        self.mesh_of.get(subobject.0 as usize).copied().filter(|mesh| *mesh != NONE)
    }

    /// The place of a subobject in a model of several versions.
    pub(crate) fn part(&self, subobject: SubobjectId) -> Option<ModelPart> {
        self.parts.get(subobject.0 as usize).copied().flatten()
    }

    /// The meshes of each version of a model, finest first; nothing if it has but one.
    pub(crate) fn versions(&self, model: u32) -> &[Vec<u32>] {
        &self.models[model as usize]
    }

    /// What must be there to draw a mesh: its textures, then itself.
    pub(crate) fn unit(&self, mesh: u32) -> impl Iterator<Item = u32> + use<> {
        let [a, b] = mesh.checked_sub(self.textures).map_or([NONE; 2], |k| self.worn[k as usize]);
        [a, if b == a { NONE } else { b }, mesh].into_iter().filter(|piece| *piece != NONE)
    }
}
