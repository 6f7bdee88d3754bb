//! Pieces: the meshes and textures of a scene, named by their content, on their way to a board and in its memory.
//!
//! A piece travels in slices, so that a frame never waits behind a large texture: the sender looks for frames between two slices. Its
//! memory is a number that manager and board compute alike, so that the manager knows to the byte what a board has room
//! for, without asking.

use crate::codec::{CodecError, within};
use crate::ids::ContentId;
use crate::limits;
use crate::scene::Mesh;
use bytes::Bytes;
use serde::{Deserialize, Serialize};

/// Most bytes of one slice: at a gigabit a second half a millisecond.
pub const SLICE_BYTES: usize = 64 << 10;

/// What a piece costs besides its arrays, bytes: its names, its place in tables, its material.
pub const PIECE_OVERHEAD: u64 = 1024;

/// What a piece is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PieceKind {
    /// [`crate::codec::encode_mesh`].
    Mesh,
    /// [`crate::codec::encode_texture`].
    Texture,
}

/// The head of a slice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SliceHeader {
    /// Of which piece.
    pub id: ContentId,
    /// What it is.
    pub kind: PieceKind,
    /// Bytes of the whole piece.
    pub total: u64,
    /// Where this slice begins.
    pub offset: u64,
}

/// A piece cut into slices, first to last.
#[derive(Clone, Debug)]
pub struct Slices {
    id: ContentId,
    kind: PieceKind,
    total: u64,
    left: Bytes,
}

impl Slices {
    /// Of a piece's bytes.
    pub fn of(id: ContentId, kind: PieceKind, bytes: Bytes) -> Self {
        Self { id, kind, total: bytes.len() as u64, left: bytes }
    }
}

impl Iterator for Slices {
    type Item = (SliceHeader, Bytes);

    fn next(&mut self) -> Option<Self::Item> {
        if self.left.is_empty() {
            return None;
        }
        let Self { id, kind, total, .. } = *self;
        let offset = total - self.left.len() as u64;
        let slice = self.left.split_to(SLICE_BYTES.min(self.left.len()));
        Some((SliceHeader { id, kind, total, offset }, slice))
    }
}

/// Puts slices together again. One piece is under way at a time; memory grows with what has come, not with what is claimed.
#[derive(Debug, Default)]
pub struct Assembler {
    current: Option<(ContentId, PieceKind, u64)>,
    bytes: Vec<u8>,
}

impl Assembler {
    /// Takes the next slice; returns the piece when it is whole.
    ///
    /// # Errors
    /// [`CodecError::Limit`] when a slice is empty, of another piece than the one under way, not the next one, or beyond the piece's
    /// end; or when the piece is larger than a bulk message may be.
    pub fn take(
        &mut self,
        head: &SliceHeader,
        slice: &[u8],
    ) -> Result<Option<(ContentId, PieceKind, Bytes)>, CodecError> {
        within("bytes of a piece", head.total, limits::BULK_MESSAGE_MAX)?;
        let piece = (head.id, head.kind, head.total);
        let expected = self.bytes.len() as u64;
        if head.offset != expected || self.current.is_some_and(|current| current != piece) {
            return Err(CodecError::Limit { what: "offset of a slice", value: head.offset, limit: expected });
        }
        let end = expected + slice.len() as u64;
        if slice.is_empty() || end > head.total {
            return Err(CodecError::Limit { what: "end of a slice", value: end, limit: head.total });
        }
        self.current = Some(piece);
        self.bytes.extend_from_slice(slice);
        if end < head.total {
            return Ok(None);
        }
        self.current = None;
        Ok(Some((head.id, head.kind, std::mem::take(&mut self.bytes).into())))
    }
}

/// Bytes that a board's memory limit counts for a mesh: the arrays as they came, and positions and normals once more in
/// the order that kernels read them in.
pub fn mesh_memory(mesh: &Mesh) -> u64 {
    let vertices = mesh.positions.len() as u64;
    // Kernels read 16 vertices at once.
    let padded = vertices.next_multiple_of(16) * 12;
    let normals = if mesh.normals.is_empty() { 0 } else { padded + 12 * mesh.normals.len() as u64 };
    let texcoords: u64 = mesh.texcoords.iter().map(|set| 8 * set.len() as u64).sum();
    let faces = 12 * mesh.triangles.len() as u64 + 4 * mesh.face_numbers.len() as u64;
    PIECE_OVERHEAD + 12 * vertices + padded + normals + 16 * mesh.colors.len() as u64 + texcoords + faces
}

/// Bytes that a board's memory limit counts for a texture: eight a texel, and the halved copies down to one texel.
pub fn texture_memory(width: u32, height: u32) -> u64 {
    let (mut width, mut height) = (u64::from(width), u64::from(height));
    let mut texels = width * height;
    while width > 1 || height > 1 {
        (width, height) = ((width / 2).max(1), (height / 2).max(1));
        texels += width * height;
    }
    PIECE_OVERHEAD + 8 * texels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::{encode_mesh, encode_texture};
    use crate::scene::{Box3, Material, Sphere, Texture};
    use glam::DVec3;
    use proptest::prelude::*;

    const ID: ContentId = ContentId([9; 16]);

    proptest! {
        #[test]
        fn slices_come_together_as_they_went(len in 1usize..200_000) {
            let bytes: Bytes = (0..len).map(|i| (i * 7 % 251) as u8).collect::<Vec<_>>().into();
            let mut assembler = Assembler::default();
            let mut whole = None;
            for (head, slice) in Slices::of(ID, PieceKind::Texture, bytes.clone()) {
                prop_assert!(whole.is_none(), "nothing comes after the last slice");
                prop_assert!(slice.len() <= SLICE_BYTES);
                whole = assembler.take(&head, &slice).unwrap();
            }
            prop_assert_eq!(whole, Some((ID, PieceKind::Texture, bytes)));
        }

        #[test]
        fn any_slice_but_the_next_is_refused_and_nothing_is_reserved(
            total in 0u64..1 << 40, offset in 0u64..4, len in 0usize..4, other in any::<bool>(),
        ) {
            let mut assembler = Assembler::default();
            let first = SliceHeader { id: ID, kind: PieceKind::Mesh, total: 4, offset: 0 };
            prop_assert_eq!(assembler.take(&first, &[1, 2]).unwrap(), None);
            let id = if other { ContentId([8; 16]) } else { ID };
            let head = SliceHeader { id, total, offset, ..first };
            let is_next = !other && total == 4 && offset == 2 && (1..=2).contains(&len);
            prop_assert_eq!(assembler.take(&head, &[0; 4][..len]).is_ok(), is_next);
            prop_assert!(assembler.bytes.capacity() < 64);
        }
    }

    #[test]
    fn memory_is_never_less_than_what_travels() {
        let mesh = |vertices: usize, full: bool| Mesh {
            origin: DVec3::ZERO,
            positions: vec![[0.0; 3]; vertices],
            normals: vec![[0.0; 3]; if full { vertices } else { 0 }],
            colors: vec![[0.0; 4]; if full { vertices } else { 0 }],
            texcoords: vec![vec![[0.0; 2]; vertices]; if full { 2 } else { 0 }],
            triangles: vec![[0; 3]; vertices],
            face_numbers: vec![0; vertices],
            material: Material::default(),
            sphere: Sphere { centre: DVec3::ZERO, radius: 1.0 },
            bounds: Box3 { min: DVec3::ZERO, max: DVec3::ZERO },
        };
        for mesh in [mesh(0, false), mesh(3, false), mesh(3, true), mesh(2000, true)] {
            assert!(encode_mesh(&mesh).len() as u64 <= mesh_memory(&mesh), "{} vertices", mesh.positions.len());
        }
        for (width, height) in [(1, 1), (5, 3), (1, 64), (256, 256)] {
            let texture = Texture { width, height, texels: vec![[0; 4]; (width * height) as usize] };
            assert!(encode_texture(&texture).len() as u64 <= texture_memory(width, height), "{width} x {height}");
        }
        assert_eq!(texture_memory(4, 2), PIECE_OVERHEAD + 8 * (8 + 2 + 1));
    }
}
