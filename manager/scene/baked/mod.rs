//! The baked file: a scene as the manager holds it, in one file that opens in milliseconds.
//!
//! Importing a scene reads text, unpacks pictures, cuts meshes into pieces and looks for faces that share planes. Baking does that once. What
//! is written is what the importer hands over ([`Parts`](super::Parts)) and what takes long to find out about it; the little that follows
//! from them quickly is made anew at opening, by the same code as ever. Meshes and textures are written as they travel to boards, under the
//! same names, so the manager can send them as they lie there, and a name proves its content.
//!
//! There are no halved copies of textures (mip-maps) in it: boards make them, as 16-bit linear numbers, from the texels that travel.
//! ARCHITECTURE.md says why.
//!
//! `file` is the format's frame, `rows` its records, `write` and `open` the two ways, `map` gives bytes, `replace` makes a
//! file appear whole, [`BakedError`] says what is wrong. Nothing of it knows glTF: a manager without an importer opens baked scenes.

mod error;
mod facts;
mod file;
mod map;
mod open;
mod replace;
mod rows;
#[cfg(test)]
mod tests;
mod write;

pub use error::{BakedError, BakedFault};
pub use facts::{Facts, SectionFacts, facts, is_baked};
pub(super) use file::{BakedFile, IndexRow, Section};
pub use file::{FORMAT, MAGIC};
pub use open::{check_all, open, open_by_reading, open_bytes};
pub use replace::part_of;
pub use write::{Watch, write};
