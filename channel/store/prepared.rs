//! Meshes and textures as a store keeps them, made from what came over the wire. That takes time (a large texture's halved
//! copies: a second), so it is done apart from the store, on any thread; putting one into the store takes none.

use super::{StoreError, StoredMesh, check_mesh};
use crate::texture::MipTexture;
use bytes::Bytes;
use proto::codec::{CodecError, decode_mesh, decode_texture};
use proto::ids::ContentId;
use proto::piece::{PieceKind, mesh_memory, texture_memory};
use proto::scene::{Mesh, Texture};
use thiserror::Error;

/// Why a piece from outside is refused.
#[derive(Debug, Error)]
pub enum PieceError {
    /// Its bytes are another piece's.
    #[error("payload {0} has other content than its name says")]
    Name(ContentId),
    /// Its bytes are none.
    #[error(transparent)]
    Codec(#[from] CodecError),
    /// It contradicts itself.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// A mesh or texture that is ready to be drawn.
#[derive(Debug)]
pub struct Prepared {
    pub(super) id: ContentId,
    pub(super) memory: u64,
    pub(super) content: PreparedContent,
}

#[derive(Debug)]
pub(super) enum PreparedContent {
    Mesh(Box<StoredMesh>),
    Texture(MipTexture),
}

impl Prepared {
    /// From a piece's bytes, which must be what its name says.
    ///
    /// # Errors
    /// [`PieceError`].
    pub fn of_piece(id: ContentId, kind: PieceKind, bytes: Bytes) -> Result<Self, PieceError> {
        if ContentId::of(&bytes) != id {
            return Err(PieceError::Name(id));
        }
        Ok(match kind {
            PieceKind::Mesh => Self::mesh(id, decode_mesh(bytes)?)?,
            PieceKind::Texture => Self::texture(id, decode_texture(bytes)?)?,
        })
    }

    /// # Errors
    /// [`StoreError`] says in what the mesh contradicts itself or a limit.
    pub fn mesh(id: ContentId, mesh: Mesh) -> Result<Self, StoreError> {
        check_mesh(id, &mesh)?;
        let memory = mesh_memory(&mesh);
        Ok(Self { id, memory, content: PreparedContent::Mesh(Box::new(StoredMesh::new(mesh))) })
    }

    /// Makes the halved copies.
    ///
    /// # Errors
    /// [`StoreError::Texture`] when size and texels don't agree.
    pub fn texture(id: ContentId, texture: Texture) -> Result<Self, StoreError> {
        let memory = texture_memory(texture.width, texture.height);
        let made = MipTexture::new(texture).map_err(|error| StoreError::Texture { texture: id, error })?;
        Ok(Self { id, memory, content: PreparedContent::Texture(made) })
    }

    /// Its name.
    pub fn id(&self) -> ContentId {
        self.id
    }

    /// Bytes that it counts for.
    pub fn memory(&self) -> u64 {
        self.memory
    }
}
