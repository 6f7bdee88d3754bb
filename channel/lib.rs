//! The channel worker ("board"): geometry → raster → translucency → resolve, tile by tile, on the CPU.
//!
//! The picture it makes is the one that the design book's page *The right picture* defines, to the byte, whatever the
//! number of threads, the share of tiles or the order of the list. The way of one frame, in the order pixels are made:
//!
//! 1. [`pipeline::Renderer::draw`] takes a [`store::SceneStore`], the frame's state, a view, the list of subobjects and
//!    the share of tiles.
//! 2. [`geometry`] moves vertices to the eye in f64, clips, rounds them to 1/256 pixel and sets triangles up.
//! 3. [`raster`] sorts them into tiles and decides, tile by tile, which face each sample sees: coverage in integers,
//!    depth as one plane per face. No colour is computed yet.
//! 4. [`translucency`] collects the translucent fragments that lie in front of that, all of them, orders them, and mixes
//!    the versions of models that are in transition.
//! 5. [`resolve`] shades each face that a pixel sees once ([`shade`], [`lights`], [`texture`]), averages the samples ([`samples`])
//!    and writes 8-bit sRGB or linear floats.
//!
//! 6. Asked for by [`proto::view::Samples::Exact`], [`exact`] computes the pixels that points don't give exactly, from the areas of their faces.
//!
//! For who wants to see what all that takes, [`debug`] paints the tiles over.
//!
//! Stages are pure functions over plain data; the buffers are the caller's and are used again. Nothing here knows
//! sockets, clocks (except to report stage times, which never reach a pixel) or how many boards there are.
// `unsafe` is in `prefetch` alone.
#![allow(clippy::needless_range_loop, reason = "lanes and channels are indices into several arrays at once")]

pub mod debug;
pub mod exact;
pub mod frame;
pub mod geometry;
pub mod lights;
pub mod pipeline;
mod prefetch;
pub mod raster;
pub mod reference_tile;
pub mod resolve;
mod room;
pub mod samples;
pub mod shade;
pub mod simd;
pub mod store;
pub mod texture;
pub mod translucency;
pub mod worker;

#[cfg(test)]
mod oracle;
#[cfg(test)]
mod picture_tests;
#[cfg(test)]
mod torture;
