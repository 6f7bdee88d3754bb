//! Translucency: every fragment that lies in front of a tile's opaque faces, and the light that comes through them.
//!
//! Nothing is approximated and nothing is lost: a pixel keeps as many fragments as there are, each with the samples it is
//! seen at. Going outward from the eye, a fragment contributes its colour times its saturation times what the fragments
//! nearer than it let through; the background gets the rest ("over", picture.md). A model in
//! transition gives all of its faces, opaque ones as well, weighted by their versions. The order is by depth at each sample,
//! and where two are equally near the one of the larger (layer, primitive, face number) is in front, as for opaque faces;
//! the order of the list never matters.
//!
//! - [`gather`]: triangles → layers of blocks.
//! - [`blend`]: the layers of a block → the light of its pixels.
//! - [`compose`]: the fragments of one pixel → the light of its samples, where they differ in order or belong to models.
//! - [`models`]: layers that are merged, and versions that are mixed.

pub mod blend;
pub mod compose;
pub mod gather;
pub mod models;
