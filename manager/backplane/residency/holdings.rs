//! What one board holds, to the byte, and what is on its way there.

use super::bits::Bits;
use proto::limits::PIECES_IN_FLIGHT_MAX;
use thiserror::Error;

/// What a board says that can't be so.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub(crate) enum Violation {
    #[error("it says twice what it holds")]
    Unasked,
    #[error("it says that it holds more than its own memory limit")]
    OverLimit,
    #[error("it confirms a piece that it wasn't sent")]
    NotSent,
    #[error("it names a piece that the scene doesn't have")]
    Unknown,
}

/// See the module's head.
#[derive(Clone, Debug)]
pub(crate) struct Holdings {
    /// Bytes.
    limit: u64,
    held: Bits,
    coming: Bits,
    held_count: usize,
    /// Bytes of what is held or coming.
    bytes: u64,
    coming_bytes: u64,
    peak: u64,
}

impl Holdings {
    /// Nothing, of so many pieces.
    pub(crate) fn new(pieces: usize, limit: u64) -> Self {
        let (held, coming) = (Bits::new(pieces), Bits::new(pieces));
        Self { limit, held, coming, held_count: 0, bytes: 0, coming_bytes: 0, peak: 0 }
    }

    pub(crate) fn limit(&self) -> u64 {
        self.limit
    }

    /// Bytes of what is held or coming.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The most that [`Self::bytes`] ever was.
    pub(crate) fn peak(&self) -> u64 {
        self.peak
    }

    pub(crate) fn held(&self) -> &Bits {
        &self.held
    }

    /// Whether every piece is held.
    pub(crate) fn is_whole(&self) -> bool {
        self.held_count == self.held.len()
    }

    pub(crate) fn is_absent(&self, piece: u32) -> bool {
        !self.held.has(piece) && !self.coming.has(piece)
    }

    /// Whether so many bytes may be sent now, memory aside.
    pub(crate) fn may_send(&self, bytes: u64) -> bool {
        self.coming_bytes == 0 || self.coming_bytes + bytes <= PIECES_IN_FLIGHT_MAX
    }

    /// Whether so many bytes more are within the limit.
    pub(crate) fn has_room(&self, bytes: u64) -> bool {
        self.bytes.saturating_add(bytes) <= self.limit
    }

    /// The board says that it has kept a piece. False: it has said so before.
    pub(crate) fn on_kept(&mut self, piece: u32, bytes: u64) -> bool {
        if self.held.has(piece) {
            return false;
        }
        self.held.set(piece);
        self.held_count += 1;
        self.add(bytes);
        true
    }

    /// A piece that is absent is sent.
    pub(crate) fn on_send(&mut self, piece: u32, bytes: u64) {
        self.coming.set(piece);
        self.coming_bytes += bytes;
        self.add(bytes);
    }

    /// The board confirms a piece.
    pub(crate) fn on_stored(&mut self, piece: u32, bytes: u64) -> Result<(), Violation> {
        if !self.coming.has(piece) {
            return Err(Violation::NotSent);
        }
        self.coming.clear(piece);
        self.coming_bytes -= bytes;
        self.held.set(piece);
        self.held_count += 1;
        Ok(())
    }

    /// A piece that is held is given up.
    pub(crate) fn on_evict(&mut self, piece: u32, bytes: u64) {
        self.held.clear(piece);
        self.held_count -= 1;
        self.bytes -= bytes;
    }

    fn add(&mut self, bytes: u64) {
        self.bytes += bytes;
        self.peak = self.peak.max(self.bytes);
    }
}
