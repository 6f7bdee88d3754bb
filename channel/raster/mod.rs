//! Raster: which face each sample of a tile sees.
//!
//! A tile (32 × 32 pixels) is worked on by one thread from start to end, with buffers that stay in its cache. No colour is
//! computed here but the alpha of MASK surfaces, which decides whether a fragment exists.
//!
//! - [`bins`]: triangles sorted into the tiles of this board's share.
//! - [`fronts`]: subobjects that need no vertex, because what is nearer covers their tiles.
//! - [`coverage`]: which samples of which pixels a triangle covers; integers only.
//! - [`depth`]: of two faces, which is in front at which samples of a pixel.
//! - [`visible`]: the tile's visible faces: per pixel one face, or a short list of (face, samples).
//! - [`opaque`]: the stage itself, triangle by triangle.

pub mod bins;
pub mod coverage;
pub mod depth;
pub mod fronts;
pub mod opaque;
pub mod visible;
