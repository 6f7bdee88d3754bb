//! The scene as payloads: what a board that holds nothing is sent, each piece under its name, encoded once for all boards.

use crate::scene::{ContentError, Scene};
use bytes::Bytes;
use proto::codec;
use proto::ids::ContentId;
use proto::message::ToBoard;
use std::collections::BTreeMap;

/// See the module's head.
#[derive(Debug)]
pub(crate) struct Content {
    /// The content id of the tables: the scene's name on the wire.
    pub scene: ContentId,
    /// The tables, ready to send.
    pub table: Bytes,
    /// Every texture and mesh, ready to send.
    pieces: BTreeMap<ContentId, Bytes>,
    /// Textures before the meshes that use them.
    order: Vec<ContentId>,
}

impl Content {
    /// # Errors
    /// When the scene is in a baked file that doesn't give all of it.
    pub(crate) fn of(scene: &Scene) -> Result<Self, ContentError> {
        let payload = codec::encode_table(&scene.table);
        let id = ContentId::of(&payload);
        let mut pieces = BTreeMap::new();
        let mut order = Vec::new();
        for id in scene.textures.keys() {
            let message = codec::encode(&ToBoard::Texture { id: *id }, &scene.textures.payload(id)?);
            pieces.insert(*id, message);
            order.push(*id);
        }
        for id in scene.meshes.keys() {
            let message = codec::encode(&ToBoard::Mesh { id: *id }, &scene.meshes.payload(id)?);
            pieces.insert(*id, message);
            order.push(*id);
        }
        let table = codec::encode(&ToBoard::Table { scene: id }, &payload);
        Ok(Self { scene: id, table, pieces, order })
    }

    /// The question which pieces a board lacks: every id.
    pub(crate) fn offer(&self) -> Bytes {
        let ids: Vec<u8> = self.order.iter().flat_map(|id| id.0).collect();
        codec::encode(&ToBoard::Offer { scene: self.scene }, &ids)
    }

    /// A piece, ready to send.
    pub(crate) fn piece(&self, id: &ContentId) -> Option<Bytes> {
        self.pieces.get(id).cloned()
    }

    /// How many pieces there are.
    pub(crate) fn len(&self) -> usize {
        self.order.len()
    }
}
