//! Pieces of the scene on their way to boards, and boards on their way into the row.

use super::{Board, BoardKey, Engine};
use crate::backplane::residency::Violation;
use bytes::Bytes;
use proto::codec::{CodecError, decode_ids, encode, encode_ids};
use proto::ids::ContentId;
use proto::limits::PIECE_NAMES_MAX;
use proto::message::ToBoard;
use std::time::Duration;

/// In real time, when nobody draws yet, a board is taken after this long even if it still lacks something: a picture with gaps that
/// close is better than none.
const JOIN_PATIENCE: Duration = Duration::from_secs(2);

/// Why a board is put out.
fn why(broken: &Result<Violation, CodecError>) -> String {
    match broken {
        Ok(violation) => violation.to_string(),
        Err(error) => error.to_string(),
    }
}

impl Engine {
    /// A board says what it has kept.
    pub(super) fn on_holding(&mut self, key: BoardKey, scene: Option<ContentId>, more: bool, payload: &Bytes) {
        let ids = decode_ids(payload, PIECE_NAMES_MAX).map_err(Err);
        let held = ids.and_then(|ids| {
            let foreign = self.stream.on_holding(key, &ids, more).map_err(Ok)?;
            self.statistics.skipped.meshes_cached += (ids.len() - foreign.len()) as u64;
            Ok(foreign)
        });
        let foreign = match held {
            Ok(foreign) => foreign,
            Err(broken) => return self.put_out(key, &why(&broken)),
        };
        let Some(board) = self.boards.get_mut(&key) else { return };
        if !foreign.is_empty() {
            board.outbox.send(encode(&ToBoard::Evict, &encode_ids(&foreign)));
        }
        if more {
            return;
        }
        board.is_known = true;
        if scene == Some(self.content.id) {
            board.has_table = true;
        } else {
            board.outbox.send(self.content.table.clone());
        }
        self.feed(key);
    }

    /// A board can draw pieces that it was sent.
    pub(super) fn on_stored(&mut self, key: BoardKey, payload: &Bytes) {
        let ids = decode_ids(payload, PIECE_NAMES_MAX).map_err(Err);
        match ids.and_then(|ids| self.stream.on_stored(key, &ids).map_err(Ok)) {
            Ok(()) => self.feed(key),
            Err(broken) => self.put_out(key, &why(&broken)),
        }
    }

    /// A board has the tables.
    pub(super) fn on_loaded(&mut self, key: BoardKey, scene: ContentId) {
        let Some(board) = self.boards.get_mut(&key) else { return };
        if scene != self.content.id || board.has_table {
            self.put_out(key, "it loaded another scene, or this one twice");
            return;
        }
        board.has_table = true;
    }

    /// Sends a board what it should have next, and has it give up what must go for that.
    pub(super) fn feed(&mut self, key: BoardKey) {
        let Some(board) = self.boards.get(&key).filter(|board| board.outbox.has_room() && !board.is_out) else {
            return;
        };
        let plan = self.stream.plan(key);
        let streaming = &mut self.statistics.streaming;
        if !plan.evict.is_empty() {
            streaming.evicted += plan.evict.len() as u64;
            board.outbox.send(encode(&ToBoard::Evict, &encode_ids(&plan.evict)));
        }
        for piece in plan.send {
            let catalogue = self.stream.catalogue();
            streaming.pieces += 1;
            streaming.piece_bytes += catalogue.memory(piece);
            if !board.outbox.send_piece(catalogue.id(piece), catalogue.kind(piece)) {
                return;
            }
        }
    }

    /// Likewise all boards.
    pub(super) fn feed_all(&mut self) {
        let keys: Vec<BoardKey> = self.boards.keys().copied().collect();
        keys.into_iter().for_each(|key| self.feed(key));
    }

    /// Takes boards into the row that hold what is needed now, as far as they have room.
    pub(super) fn admit(&mut self) {
        if !self.leadership.leads() {
            return;
        }
        let now = self.now();
        let is_waiting = |board: &Board| !(board.has_joined || board.is_leaving || board.is_out || board.is_held);
        let waiting = self.boards.iter().filter(|(_, board)| is_waiting(board));
        let waiting: Vec<BoardKey> = waiting.map(|(key, _)| *key).collect();
        if waiting.is_empty() {
            return;
        }
        self.refresh(now);
        for key in waiting {
            self.feed(key);
            let is_ready = self.stream.is_ready(key);
            let Some(board) = self.boards.get_mut(&key).filter(|board| board.has_table) else { continue };
            let is_patient = self.config.mode == super::ClockMode::LockStep || !self.chain.is_empty();
            // Who has drawn until now draws on: what it lacks, nobody shows.
            if !is_ready && !board.is_heir && (is_patient || now.since(board.since) < JOIN_PATIENCE) {
                continue;
            }
            board.has_joined = true;
            let (link, name) = (board.link.clone(), board.name.clone());
            if self.chain.on_join(now, key, link) {
                self.log("joined", format!("board {name} ({key:?})"));
            } else {
                self.put_out(key, "the row is full, or it joined twice");
            }
        }
    }
}
