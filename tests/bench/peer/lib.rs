//! The peer that benchmarks run beside Cyclorama: the same scene drawn by OpenGL on Mesa's llvmpipe, the fastest general
//! rasterizer for CPUs that there is.
//!
//! It is there to be hard to beat, so it does what suits llvmpipe: static geometry in one vertex buffer in world space,
//! batches culled by their balls and drawn front to back, reversed depth in 32-bit floats, one matrix a frame, lighting
//! per vertex, no picture read back within the time. Translucent faces are blended back to front by object, coplanar
//! layers are moved by polygon offset. Where the two renderers can't do the same the peer has the easier task: its 8 bits
//! are linear and not encoded, translucency is sorted by object and not exact, double-sided faces have one normal. The
//! picture that its *error* is told from, on the other hand, is as good as it can make it: lit per pixel, kept in floats.
//!
//! | module | does |
//! |---|---|
//! | `gl` | the only unsafe code: OpenGL, opened at run time |
//! | `geometry` | scene → vertex buffer and batches |
//! | `frustum` | which batches are in view, in which order |
//! | `peer` | one frame |
//! | [`protocol`] | what is said to a peer in a process of its own |
//!
//! It runs in a process of its own ([`protocol::Child`]): its driver takes settings from the environment, starts threads,
//! and compiles code, none of which may happen to the renderer that it is compared with.

mod frustum;
mod geometry;
mod gl;
mod peer;
pub mod protocol;

pub use geometry::Unsupported;
pub use gl::GlError;
pub use peer::{Drawn, Look, Peer, PeerError};
