//! The compositor: it stitches the tiles of all boards to the views, and the views to one picture.
//!
//! [`stitch`] is the pure part, [`sinks`] write what was stitched, [`manifest`] writes what it was, `preview` makes the console's pictures,
//! [`window`] shows them on a desktop, [`shell`] is the daemon.
#![forbid(unsafe_code)]

mod backplanes;
pub mod manifest;
mod pattern;
mod preview;
pub mod shell;
pub mod sinks;
pub mod stitch;
mod terms;
mod together;
pub mod window;
