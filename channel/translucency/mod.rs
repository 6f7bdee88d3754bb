//! Translucency: every fragment that lies in front of a tile's opaque faces, and the light that comes through them.
//!
//! Nothing is approximated and nothing is lost: a pixel keeps as many fragments as there are, each with the samples it is
//! seen at. Going outward from the eye, a fragment contributes its colour times its saturation times what the fragments
//! nearer than it let through; the background gets the rest ("over", picture.md). A model in
//! transition gives all of its faces, opaque ones as well, weighted by their versions. The order is by depth at each sample,
//! and where two are equally near the one of the larger (layer, primitive, face number) is in front, as for opaque faces;
//! the order of the list never matters.
//!
//! - [`gather`]: triangles → fragments per pixel.
//! - [`models`]: layers that are merged, and versions that are mixed.
//! - [`compose`]: fragments and what is behind them → the samples' colours.

pub mod compose;
pub mod gather;
pub mod models;
