//! Messages of every link, with what their payloads are.

use bytes::Bytes;
use proto::chain::BetweenBackplanes;
use proto::codec::{decode, decode_ids, decode_table, encode, encode_ids, encode_table};
use proto::ids::SubobjectId;
use proto::limits;
use proto::list::{ListEncoder, apply};
use proto::message::{
    FramePayload, FromBoard, FromCompositor, Hello, NeighbourMessage, TileMessage, ToBoard, ToCompositor, split_tiles,
};
use serde::{Serialize, de::DeserializeOwned};

/// Decodes a message; what it encodes to is what it was.
fn round<M: Serialize + DeserializeOwned>(bytes: &[u8]) -> Option<(M, Bytes)> {
    let (message, payload) = decode::<M>(Bytes::copy_from_slice(bytes)).ok()?;
    assert!(encode(&message, &payload) == bytes, "a message has one form only");
    Some((message, payload))
}

fn ids(payload: &[u8]) {
    if let Ok(ids) = decode_ids(payload, limits::PIECE_NAMES_MAX) {
        assert!(encode_ids(&ids) == payload, "names come back as they went");
    }
}

/// A backplane to a board.
pub(crate) fn to_board(bytes: &[u8]) {
    let Some((message, payload)) = round::<ToBoard>(bytes) else { return };
    match message {
        ToBoard::Frame(header) => {
            if let Ok(frame) = FramePayload::decode(&header, &payload) {
                assert!(frame.encode() == payload, "a frame's payload has one form only");
            }
        }
        ToBoard::Evict => ids(&payload),
        ToBoard::Table { .. } => {
            if let Ok(table) = decode_table(payload) {
                let again = encode_table(&table);
                let table = decode_table(again.clone()).expect("a table that was decoded can be sent");
                assert!(encode_table(&table) == again, "and comes as it went");
            }
        }
        _ => {}
    }
}

/// A board to a backplane.
pub(crate) fn from_board(bytes: &[u8]) {
    if let Some((FromBoard::Holding { .. } | FromBoard::Stored, payload)) = round::<FromBoard>(bytes) {
        ids(&payload);
    }
}

/// A board to a compositor.
pub(crate) fn tiles(bytes: &[u8]) {
    if let Some((TileMessage::Tiles { count, size, format, .. }, payload)) = round::<TileMessage>(bytes)
        && let Ok((tiles, pixels)) = split_tiles(&payload, count, size, format)
    {
        let area: usize = tiles.iter().map(|tile| tile.rect(size.0, size.1).area()).sum();
        assert_eq!(tiles.len(), count as usize, "as many as it says");
        assert_eq!(pixels.len(), area * format.bytes(), "a pixel for each that the tiles have");
        assert!(tiles.iter().all(|tile| tile.rect(size.0, size.1).area() > 0), "every tile lies in the view");
    }
}

/// A backplane and a compositor.
pub(crate) fn compositor(bytes: &[u8]) {
    round::<ToCompositor>(bytes);
    round::<FromCompositor>(bytes);
}

/// Neighbours, the two backplanes, and whoever says hello.
pub(crate) fn peers(bytes: &[u8]) {
    round::<NeighbourMessage>(bytes);
    round::<BetweenBackplanes>(bytes);
    round::<Hello>(bytes);
}

/// A script over a list of as many ids as the first byte says.
pub(crate) fn lists(bytes: &[u8]) {
    let Some((len, script)) = bytes.split_first() else { return };
    let old: Vec<_> = (0..u32::from(*len)).map(|i| SubobjectId(i * 7 % 257)).collect();
    let mut new = Vec::new();
    if apply(&old, script, 300, &mut new).is_err() {
        return;
    }
    assert!(new.len() <= 300 && new.iter().all(|id| id.0 < 300), "within the limit");
    let (mut script, mut again) = (Vec::new(), Vec::new());
    ListEncoder::default().encode(&old, &new, &mut script);
    apply(&old, &script, 300, &mut again).expect("a list that came can be sent");
    assert_eq!(again, new, "and comes as it went");
}
