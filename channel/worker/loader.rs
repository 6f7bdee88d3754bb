//! The loader: a thread that turns pieces of the scene into what the store keeps, so that a large texture doesn't hold up
//! the frame that is drawn meanwhile.
//!
//! A piece is handed to the painter first and confirmed after: the backplane names it in a frame only when it has heard so, and that frame
//! comes to the painter after the piece.

use super::painter::{Painted, Work};
use crate::store::Prepared;
use bytes::Bytes;
use proto::ids::ContentId;
use proto::piece::PieceKind;
use std::sync::mpsc::{Receiver, Sender};
use tokio::sync::mpsc;

/// A piece as it came, and in which session.
#[derive(Debug)]
pub(super) struct Raw {
    pub session: u64,
    pub id: ContentId,
    pub kind: PieceKind,
    pub bytes: Bytes,
}

/// Works until nobody sends any more.
pub(super) fn run(inbox: &Receiver<Raw>, painter: &Sender<Work>, answers: &mpsc::Sender<(u64, Painted)>) {
    while let Ok(Raw { session, id, kind, bytes }) = inbox.recv() {
        let len = bytes.len() as u64;
        let answer = match Prepared::of_piece(id, kind, bytes) {
            Ok(piece) => {
                if painter.send(Work::Piece(session, piece)).is_err() {
                    return;
                }
                Painted::Stored { id, len }
            }
            Err(error) => Painted::Refused(error.to_string()),
        };
        if answers.blocking_send((session, answer)).is_err() {
            return;
        }
    }
}
