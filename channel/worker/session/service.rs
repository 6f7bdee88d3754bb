//! What is done for the backplane that is served: content is kept, frames are drawn, and neighbours are met.

use super::{Board, Stop, Told};
use crate::worker::neighbours::NeighbourEvent;
use crate::worker::painter::{Painted, Work};
use bytes::Bytes;
use proto::chain::{Left, Seen, ToBoardChain};
use proto::codec::{CodecError, decode_ids, encode_ids};
use proto::ids::BoardKey;
use proto::limits;
use proto::link::LinkError;
use proto::message::{FrameHeader, FromBoard, ToBoard};
use proto::piece::{Assembler, SliceHeader};
use proto::share::shares;
use proto::view::ViewSetup;
use std::collections::BTreeMap;
use std::time::Instant;
use tokio_util::sync::DropGuard;

/// What belongs to the session that is served.
#[derive(Default)]
pub(super) struct Service {
    views: Vec<ViewSetup>,
    /// Links to compositors, by their keys.
    pub(super) outlets: BTreeMap<BoardKey, DropGuard>,
    assembler: Assembler,
    /// Bytes of pieces that have begun to come and aren't ready to be drawn.
    loading: u64,
}

impl Board {
    pub(super) fn on_chain(&mut self, index: usize, message: ToBoardChain) {
        let Some(session) = &mut self.sessions[index] else { return };
        if let ToBoardChain::Wire { left: Left::Board { key, .. }, .. } = &message {
            session.left = Some(*key);
        }
        session.chain.on_backplane(message);
    }

    /// What the leader has of the scene for us, and of our neighbours.
    pub(super) fn on_content(&mut self, message: ToBoard, payload: Bytes) -> Result<(), Stop> {
        match message {
            ToBoard::Piece(head) => self.on_slice(&head, &payload)?,
            ToBoard::Evict => self.painter.send(Work::Evict(decode_ids(&payload, limits::SUBOBJECTS_MAX)?)),
            ToBoard::Table { scene } => self.painter.send(Work::Table(scene, payload)),
            ToBoard::Neighbours(names) => self.neighbours.expect(names),
            _ => {}
        }
        Ok(())
    }

    fn on_slice(&mut self, head: &SliceHeader, slice: &[u8]) -> Result<(), CodecError> {
        let service = &mut self.service;
        if head.offset == 0 {
            let (value, limit) = (service.loading.saturating_add(head.total), limits::PIECES_IN_FLIGHT_MAX);
            if service.loading > 0 && value > limit {
                return Err(CodecError::Limit { what: "bytes of pieces under way", value, limit });
            }
            service.loading = value;
        }
        if let Some((id, kind, bytes)) = service.assembler.take(head, slice)? {
            self.painter.load(id, kind, bytes);
        }
        Ok(())
    }

    pub(super) fn on_frame(&mut self, index: usize, header: FrameHeader, payload: Bytes) -> Result<(), Stop> {
        if let Some(views) = &header.views {
            if views.is_empty() || views.len() > limits::VIEWS_MAX || !views.iter().all(ViewSetup::is_valid) {
                return Err(Stop::Link(LinkError::Codec(CodecError::Limit {
                    what: "views that can be drawn, of those sent,",
                    value: views.len() as u64,
                    limit: limits::VIEWS_MAX as u64,
                })));
            }
            self.service.views.clone_from(views);
        }
        let epoch = header.state.epoch;
        self.terms.on_frame(header.state.frame);
        let place = self.sessions[index].as_ref().and_then(|session| session.chain.place(epoch));
        let shares = match place {
            Some(place) => {
                self.terms.on_active(Seen { epoch, id: place.id.0, total: place.weights.len() as u32 });
                Some(shares(place.id, &place.weights, &self.service.views))
            }
            None => {
                tracing::warn!(frame = %header.state.frame, %epoch, "a frame under a wiring that we have no place in");
                None
            }
        };
        // Even without a place the lists must be followed.
        self.painter.send(Work::Frame { header: Box::new(header), payload, shares, came: Instant::now() });
        Ok(())
    }

    pub(super) fn on_neighbour(&mut self, event: NeighbourEvent) {
        let served = self.terms.served().and_then(|index| self.sessions[index].as_mut());
        match event {
            NeighbourEvent::Up { link, outbox, epoch } => {
                self.neighbours.keep(link, outbox);
                match (served, epoch) {
                    (Some(session), Some(epoch)) => session.chain.on_left_linked(epoch, link),
                    (Some(_), None) => {}
                    // Nobody has wired us.
                    (None, _) => self.neighbours.close(link),
                }
            }
            NeighbourEvent::Message(link, message) => {
                if let Some(session) = served {
                    session.chain.on_neighbour(link, message);
                }
            }
            NeighbourEvent::Down(link) => {
                if let Some(session) = served {
                    session.chain.on_link_lost(None, Some(link));
                }
                self.neighbours.close(link);
            }
            NeighbourEvent::Failed(epoch) => {
                if let Some(session) = served {
                    session.chain.on_link_lost(Some(epoch), None);
                }
            }
        }
    }

    pub(super) fn on_painted(&mut self, painted: Painted) {
        let term = self.terms.term();
        match painted {
            Painted::Holding { scene, ids } => {
                for index in 0..self.sessions.len() {
                    let Some(session) = self.sessions[index].as_mut().filter(|s| s.told == Told::Asked) else {
                        continue;
                    };
                    session.told = Told::Yes(term);
                    let mut runs = ids.chunks(limits::PIECE_NAMES_MAX).peekable();
                    loop {
                        let names = encode_ids(runs.next().unwrap_or_default());
                        let more = runs.peek().is_some();
                        self.say(index, &FromBoard::Holding { term, scene, more }, &names);
                        if !more {
                            break;
                        }
                    }
                }
            }
            Painted::Stored { id, len } => {
                self.service.loading = self.service.loading.saturating_sub(len);
                self.report(&FromBoard::Stored, &id.0);
            }
            Painted::Loaded(scene) => self.report(&FromBoard::Loaded { scene }, &[]),
            Painted::Ready { frame, epoch, report, timeline } => {
                self.report(&FromBoard::Ready { frame, epoch, report, timeline }, &[]);
            }
            Painted::Refused(error) => {
                tracing::error!(%error, "the backplane sent something that can't be drawn");
                if let Some(index) = self.terms.served() {
                    self.close(index, &LinkError::Closed);
                }
            }
        }
    }
}
