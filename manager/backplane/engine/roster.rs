//! Who is who, where there are keys: what boards and compositors need to know so that no board can speak for another.
//!
//! Names, not fingerprints: a certificate that is renewed under load has another fingerprint, and whoever still expected the old one would
//! refuse a board that has done nothing wrong.

use super::Engine;
use proto::chain::{Left, ToBoardChain};
use proto::codec::encode;
use proto::ids::BoardKey;
use proto::message::{ToBoard, ToCompositor};

impl Engine {
    /// Before a board is wired: who its neighbours are by their certificates.
    pub(super) fn tell_neighbours(&self, key: BoardKey, message: &ToBoardChain) {
        let ToBoardChain::Wire { left, right, .. } = message else { return };
        let Some(board) = self.boards.get(&key).filter(|board| board.certified.is_some()) else { return };
        let left = match left {
            Left::Backplane => None,
            Left::Board { key, .. } => Some(*key),
        };
        let names = self.certified(left.into_iter().chain(*right));
        board.outbox.send(encode(&ToBoard::Neighbours(names), &[]));
    }

    /// Whenever a board comes: who all are by their certificates. Who has gone is left out the next time.
    pub(super) fn tell_compositors_boards(&self) {
        let names = self.certified(self.boards.keys().copied());
        if !names.is_empty() {
            self.compositors.tell(&ToCompositor::Boards(names));
        }
    }

    fn certified(&self, keys: impl Iterator<Item = BoardKey>) -> Vec<(BoardKey, String)> {
        keys.filter_map(|key| Some((key, self.boards.get(&key)?.certified.clone()?))).collect()
    }
}
