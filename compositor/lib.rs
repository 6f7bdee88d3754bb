//! The compositor: it stitches the tiles of all boards to the views, and the views to one picture.
//!
//! [`stitch`] is the pure part, [`sinks`] write what was stitched, [`shell`] is the daemon.
#![forbid(unsafe_code)]

pub mod shell;
pub mod sinks;
pub mod stitch;
