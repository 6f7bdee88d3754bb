//! Names of things: newtypes, so that an index, a count and an id can't be mistaken for one another.

use serde::{Deserialize, Serialize};
use std::fmt;

macro_rules! number_id {
    ($(#[$doc:meta])* $name:ident($inner:ty), $prefix:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
        pub struct $name(pub $inner);

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!($prefix, "{}"), self.0)
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}", self.0)
            }
        }
    };
}

number_id! {
    /// A board's place in the row: 0 at the left end, one more at each board to the right. Valid for one [`Epoch`].
    BoardId(u32), "board "
}
number_id! {
    /// The backplane's name for one connection of one board, never used again. A board that comes back gets a new key;
    /// its [`BoardId`] is its place, its key is its person.
    BoardKey(u64), "key "
}
number_id! {
    /// One wiring of the row of boards. A later wiring has the larger number.
    Epoch(u64), "epoch "
}
number_id! {
    /// One leadership of a backplane. Odd and even terms are different backplanes' ([`crate::chain::StandBy`]).
    Term(u64), "term "
}
number_id! {
    /// One picture of the whole rig. Every view of a swap shows the same frame number.
    FrameNumber(u64), "frame "
}
number_id! {
    /// Index of a view in the rig's list of views.
    ViewId(u32), "view "
}
number_id! {
    /// Index into the object table of a scene: a node that carries a mesh, and what moves as one.
    ObjectId(u32), "object "
}
number_id! {
    /// Index into the plane table of a scene: faces of one plane that lie over each other.
    PlaneId(u32), "plane "
}
number_id! {
    /// Index into the model table of a scene: what merges its translucent layers, or has versions.
    ModelId(u32), "model "
}
number_id! {
    /// Index into the subobject table of a scene: one mesh drawn with one object's transformation; what lists name.
    SubobjectId(u32), "subobject "
}

/// Bits of an epoch that count the wirings of one term; as many are left for terms. At one a millisecond they last seven weeks, at the rate at
/// which terms can be asked for in vain, ninety years.
const EPOCH_BITS: u32 = 32;

impl Epoch {
    /// The number below all epochs of a term, and above all epochs of lower ones.
    pub fn first_of(term: Term) -> Self {
        Self(term.0 << EPOCH_BITS)
    }

    /// The term in which it was made; 0 where no backplane can replace another.
    pub fn term(self) -> Term {
        Term(self.0 >> EPOCH_BITS)
    }
}

impl Term {
    /// The lowest term above this one that is the backplane's of this rank, 0 or 1.
    pub fn next_of(self, rank: u64) -> Self {
        Self(self.0 + 1 + (self.0 + 1 + rank) % 2)
    }
}

/// The name of a payload by what is in it: the first 128 bits of its BLAKE3 hash.
///
/// A board that holds a payload of this name holds these very bytes, whoever sent them.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ContentId(pub [u8; 16]);

impl ContentId {
    /// The name of `payload`.
    pub fn of(payload: &[u8]) -> Self {
        let mut id = [0; 16];
        id.copy_from_slice(&blake3::hash(payload).as_bytes()[..16]);
        Self(id)
    }
}

impl fmt::Debug for ContentId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Display for ContentId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self, f)
    }
}
