//! The scene database: import, tree, bounds, built-in scenes.

pub mod builtin;
pub mod glb;
#[cfg(feature = "import")]
pub mod import;
