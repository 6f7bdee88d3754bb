//! The scene as payloads: what boards are sent, each piece under its name. Pieces are encoded when they are sent, not kept: the scene has
//! them already.

use crate::scene::Scene;
use bytes::Bytes;
use proto::codec;
use proto::ids::ContentId;
use proto::message::ToBoard;
use proto::piece::{PieceKind, Slices};
use std::sync::Arc;

/// See the module's head.
#[derive(Debug)]
pub(crate) struct Content {
    /// The content id of the tables: the scene's name on the wire.
    pub id: ContentId,
    /// The tables, ready to send.
    pub table: Bytes,
    scene: Arc<Scene>,
}

impl Content {
    pub(crate) fn of(scene: Arc<Scene>) -> Self {
        let payload = codec::encode_table(&scene.table);
        let id = ContentId::of(&payload);
        Self { id, table: codec::encode(&ToBoard::Table { scene: id }, &payload), scene }
    }

    /// A piece, ready to send slice by slice; nothing, and a line in the log, if the scene doesn't have it or its file doesn't give it.
    /// Boards then never have it, and something else is shown.
    pub(crate) fn piece(&self, id: ContentId, kind: PieceKind) -> impl Iterator<Item = Bytes> + Send + use<> {
        let bytes = match kind {
            PieceKind::Mesh => self.scene.meshes.payload(&id),
            PieceKind::Texture => self.scene.textures.payload(&id),
        };
        let bytes = bytes.inspect_err(|error| tracing::error!(%id, %error, "a piece of the scene can't be sent"));
        let slices = bytes.into_iter().flat_map(move |bytes| Slices::of(id, kind, bytes));
        slices.map(|(head, slice)| codec::encode(&ToBoard::Piece(head), &slice))
    }
}
