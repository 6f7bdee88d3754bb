//! The scene-manager daemon: it loads the scene, follows the host's poses, culls, sorts and streams lists of subobjects
//! to the boards, and swaps the frames that come back (seed 000, seed 002).
//!
//! [`scene`] is the database, [`select`] the pure functions that make lists from it, [`host`] turns packets into
//! poses, and [`backplane`] is the tokio shell that ties them to the boards.
#![deny(unsafe_code)]

pub mod backplane;
#[cfg(feature = "console")]
mod console;
pub mod host;
#[cfg(feature = "otlp")]
mod otlp;
pub mod scene;
pub mod select;
