//! Meshes and textures by content.
//!
//! They are the bulk of a scene, and most of them are asked for once, to be sent to a board. So a scene from a baked file
//! doesn't hold them: each is read when somebody wants it, checked against its name, which is the hash of its bytes, and handed over.
//! Nothing is kept here of what was read; the system's page cache does that better. A scene that was imported holds its
//! contents in memory, and asking for them can't fail.

use super::baked::{BakedError, BakedFile, IndexRow, Section};
use bytes::Bytes;
use proto::codec;
use proto::ids::ContentId;
use proto::scene::{Mesh, Texture};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use thiserror::Error;

/// Why a mesh or texture can't be had. Nothing has changed; the file's fault, or of who asks for what there isn't.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ContentError {
    /// The scene has no such thing.
    #[error("the scene has no {what} {id}")]
    Missing {
        /// `mesh` or `texture`.
        what: &'static str,
        /// Its name.
        id: ContentId,
    },
    /// The baked file doesn't give it.
    #[error(transparent)]
    Baked(#[from] BakedError),
}

/// What has a name by content: a [`Mesh`] or a [`Texture`].
pub trait Content: Clone + sealed::Sealed {
    /// What one is called in messages.
    const WHAT: &'static str;

    /// Its payload, the bytes whose hash is its name.
    fn encode(&self) -> Bytes;

    /// What a payload means, checked as far as whoever draws it could stumble.
    ///
    /// # Errors
    /// What is wrong, in words.
    fn decode(payload: Bytes) -> Result<Self, String>;

    /// Vertices and triangles of a mesh, width and height of a texture.
    fn size(&self) -> [u32; 2];
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for proto::scene::Mesh {}
    impl Sealed for proto::scene::Texture {}
}

impl Content for Mesh {
    const WHAT: &'static str = "mesh";

    fn encode(&self) -> Bytes {
        codec::encode_mesh(self)
    }

    fn decode(payload: Bytes) -> Result<Self, String> {
        let mesh = codec::decode_mesh(payload).map_err(|error| error.to_string())?;
        let vertices = mesh.positions.len();
        if let Some(index) = mesh.triangles.as_flattened().iter().find(|index| **index as usize >= vertices) {
            return Err(format!("a triangle has the corner {index}, but there are {vertices} vertices"));
        }
        if !mesh.origin.is_finite() || mesh.positions.as_flattened().iter().any(|number| !number.is_finite()) {
            return Err("a position is not finite".into());
        }
        Ok(mesh)
    }

    fn size(&self) -> [u32; 2] {
        [self.positions.len() as u32, self.triangles.len() as u32]
    }
}

impl Content for Texture {
    const WHAT: &'static str = "texture";

    fn encode(&self) -> Bytes {
        codec::encode_texture(self)
    }

    fn decode(payload: Bytes) -> Result<Self, String> {
        codec::decode_texture(payload).map_err(|error| error.to_string())
    }

    fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }
}

/// All meshes, or all textures, of a scene.
#[derive(Clone)]
pub struct Contents<T>(Held<T>);

#[derive(Clone)]
enum Held<T> {
    Here(BTreeMap<ContentId, Arc<T>>),
    Baked(Shelf),
}

/// What a baked file holds of one kind.
#[derive(Clone)]
struct Shelf {
    file: Arc<BakedFile>,
    section: Section,
    /// By ascending name.
    rows: Arc<[IndexRow]>,
}

impl<T: Content> Contents<T> {
    /// What a baked file has in `section`; `rows` ascend by name.
    pub(super) fn baked(file: Arc<BakedFile>, section: Section, rows: Arc<[IndexRow]>) -> Self {
        Self(Held::Baked(Shelf { file, section, rows }))
    }

    /// Whether they are in a baked file.
    pub fn is_baked(&self) -> bool {
        matches!(self.0, Held::Baked(_))
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        match &self.0 {
            Held::Here(all) => all.len(),
            Held::Baked(shelf) => shelf.rows.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All names, ascending.
    pub fn keys(&self) -> impl Iterator<Item = &ContentId> {
        let (here, baked) = match &self.0 {
            Held::Here(all) => (Some(all.keys()), None),
            Held::Baked(shelf) => (None, Some(shelf.rows.iter().map(|row| &row.id))),
        };
        here.into_iter().flatten().chain(baked.into_iter().flatten())
    }

    /// Whether there is one of that name.
    pub fn contains(&self, id: &ContentId) -> bool {
        match &self.0 {
            Held::Here(all) => all.contains_key(id),
            Held::Baked(shelf) => shelf.find(id).is_some(),
        }
    }

    /// Every name with its [`Content::size`], ascending by name; nothing is read for it.
    pub fn sizes(&self) -> impl Iterator<Item = (&ContentId, [u32; 2])> {
        let (here, baked) = match &self.0 {
            Held::Here(all) => (Some(all.iter().map(|(id, held)| (id, held.size()))), None),
            Held::Baked(shelf) => (None, Some(shelf.rows.iter().map(|row| (&row.id, row.size)))),
        };
        here.into_iter().flatten().chain(baked.into_iter().flatten())
    }

    /// The payload of that name, ready to send: its hash is its name.
    ///
    /// # Errors
    /// [`ContentError`].
    pub fn payload(&self, id: &ContentId) -> Result<Bytes, ContentError> {
        let missing = || ContentError::Missing { what: T::WHAT, id: *id };
        match &self.0 {
            Held::Here(all) => all.get(id).map(|held| held.encode()).ok_or_else(missing),
            Held::Baked(shelf) => Ok(shelf.payload::<T>(shelf.find(id).ok_or_else(missing)?)?),
        }
    }

    /// The mesh or texture of that name. From a baked file it is read anew each time.
    ///
    /// # Errors
    /// [`ContentError`].
    pub fn get(&self, id: &ContentId) -> Result<Arc<T>, ContentError> {
        let missing = || ContentError::Missing { what: T::WHAT, id: *id };
        match &self.0 {
            Held::Here(all) => all.get(id).cloned().ok_or_else(missing),
            Held::Baked(shelf) => Ok(Arc::new(shelf.get(shelf.find(id).ok_or_else(missing)?)?)),
        }
    }

    /// All of them at once, for who needs them all.
    ///
    /// # Errors
    /// [`ContentError`] at the first that can't be had.
    pub fn all(&self) -> Result<BTreeMap<ContentId, Arc<T>>, ContentError> {
        match &self.0 {
            Held::Here(all) => Ok(all.clone()),
            Held::Baked(shelf) => shelf.rows.iter().map(|row| Ok((row.id, Arc::new(shelf.get(row)?)))).collect(),
        }
    }
}

impl Shelf {
    fn find(&self, id: &ContentId) -> Option<&IndexRow> {
        self.rows.binary_search_by(|row| row.id.cmp(id)).ok().map(|at| &self.rows[at])
    }

    fn payload<T: Content>(&self, row: &IndexRow) -> Result<Bytes, BakedError> {
        self.file.piece(self.section, row, T::WHAT)
    }

    fn get<T: Content>(&self, row: &IndexRow) -> Result<T, BakedError> {
        let wrong = |what: String| self.file.bad_piece(self.section, row, T::WHAT, what);
        let held = T::decode(self.payload::<T>(row)?).map_err(wrong)?;
        if held.size() != row.size {
            return Err(wrong(format!("it is {:?}, the index says {:?}", held.size(), row.size)));
        }
        Ok(held)
    }
}

impl<T> From<BTreeMap<ContentId, Arc<T>>> for Contents<T> {
    fn from(all: BTreeMap<ContentId, Arc<T>>) -> Self {
        Self(Held::Here(all))
    }
}

impl<T> fmt::Debug for Contents<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Held::Here(all) => write!(f, "{} in memory", all.len()),
            Held::Baked(shelf) => write!(f, "{} in a baked file", shelf.rows.len()),
        }
    }
}
