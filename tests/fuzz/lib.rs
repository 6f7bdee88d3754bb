//! Fuzzing of every decoder: what each must hold for any bytes whatever, and a corpus to begin with.
//!
//! A target takes bytes and panics if something is wrong. Beside not panicking themselves, decoders must be one-to-one: what decodes, encodes
//! to something that decodes to the same. That is compared as bytes, for NaN isn't equal to itself.
//!
//! `tests/fuzz/run` drives the targets with libFuzzer, which is told by the compiler which ways through the code an input has taken. The corpus
//! (`corpus/TARGET/`) is made by [`corpus::made`]; inputs that once found something lie beside what is made, as `found-…`. An ordinary test
//! runs all of it.
#![forbid(unsafe_code)]

pub mod corpus;
mod links;
mod messages;
mod pieces;
#[cfg(feature = "scenes")]
mod scenes;

/// What is done with bytes.
pub type Target = fn(&[u8]);

/// Every target, with its name.
pub const TARGETS: &[(&str, Target)] = &[
    ("to-board", messages::to_board),
    ("from-board", messages::from_board),
    ("tiles", messages::tiles),
    ("compositor", messages::compositor),
    ("peers", messages::peers),
    ("lists", messages::lists),
    ("pieces", pieces::pieces),
    ("slices", pieces::slices),
    ("poses", links::poses),
    ("stream", links::stream),
    #[cfg(feature = "scenes")]
    ("baked", scenes::baked),
    #[cfg(feature = "scenes")]
    ("gltf", scenes::gltf),
];

/// The target of that name.
pub fn target(name: &str) -> Option<Target> {
    TARGETS.iter().find(|(of, _)| *of == name).map(|(_, target)| *target)
}
