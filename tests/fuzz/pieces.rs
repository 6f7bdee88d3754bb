//! Meshes, textures and tables, and the slices that they travel in.

use bytes::Bytes;
use proto::codec::{CodecError, decode_mesh, decode_table, decode_texture, encode_mesh, encode_table, encode_texture};
use proto::ids::ContentId;
use proto::limits;
use proto::piece::{Assembler, PieceKind, SliceHeader, mesh_memory, texture_memory};

/// What decodes, encodes to something that decodes to the same.
fn round<T>(bytes: &[u8], decode: fn(Bytes) -> Result<T, CodecError>, encode: fn(&T) -> Bytes) -> Option<T> {
    let piece = decode(Bytes::copy_from_slice(bytes)).ok()?;
    let again = encode(&piece);
    let twice = decode(again.clone()).expect("what was decoded can be sent");
    assert!(encode(&twice) == again, "and comes as it went");
    Some(piece)
}

/// A whole piece.
pub(crate) fn pieces(bytes: &[u8]) {
    if let Some(mesh) = round(bytes, decode_mesh, encode_mesh) {
        assert!(bytes.len() as u64 <= mesh_memory(&mesh), "its memory is no less than what came");
    }
    if let Some(texture) = round(bytes, decode_texture, encode_texture) {
        assert!(bytes.len() as u64 <= texture_memory(texture.width, texture.height), "likewise");
    }
    round(bytes, decode_table, encode_table);
}

/// Two bytes for the length of each piece; then slices, each of a byte for what is wrong with it, one for its length, and its content.
pub(crate) fn slices(bytes: &[u8]) {
    let Some((total, mut bytes)) = bytes.split_first_chunk() else { return };
    let mut assembler = Assembler::default();
    let (mut came, total) = (Vec::new(), u64::from(u16::from_le_bytes(*total)));
    while let [wrong, len, rest @ ..] = bytes {
        let (slice, rest) = rest.split_at(usize::from(*len).min(rest.len()));
        bytes = rest;
        let head = SliceHeader {
            id: ContentId([wrong & 1; 16]),
            kind: if wrong & 2 == 0 { PieceKind::Mesh } else { PieceKind::Texture },
            total: if wrong & 4 == 0 { total } else { u64::from(*wrong) << (wrong % 60) },
            offset: if wrong & 8 == 0 { came.len() as u64 } else { u64::from(*wrong) },
        };
        match assembler.take(&head, slice) {
            Ok(None) => came.extend_from_slice(slice),
            Ok(Some((_, _, whole))) => {
                came.extend_from_slice(slice);
                assert!(whole == came, "what came, in order");
                assert!(whole.len() as u64 == head.total && whole.len() <= limits::BULK_MESSAGE_MAX, "all of it");
                came.clear();
            }
            // The peer is dropped for it.
            Err(_) => return,
        }
    }
}
