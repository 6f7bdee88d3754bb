//! Geometry: from meshes in the world to triangles on the screen.
//!
//! In: the list's subobjects with their transformations. Out: set-up triangles, with vertices rounded to 1/256 pixel, one
//! affine plane of inverse distance each, and everything dropped that no sample of the view can see (behind the near
//! plane, beside the view, facing away, too small to hold a sample, beyond visibility).
//!
//! - [`camera`]: one view's numbers, world → eye → screen.
//! - [`clip`]: what crosses the near plane or leaves the range of the integers, cut so that neighbours agree.
//! - [`plane`]: the plane of inverse distance that faces lying over each other share.
//! - [`setup`]: the triangle that the raster stage works on.
//! - [`vertices`]: vertices and normals to the screen, eight at a time.
//! - [`faces`]: which faces are drawn, sixteen at a time.
//! - [`fine`]: corners for pixels that are computed by areas.
//! - [`coarse`]: cheaper vertices, to be measured against.
//! - [`transform`]: the stage itself, subobject by subobject.
//!
//! Nothing here knows tiles or shares: every board gets the same triangles, to the bit.

pub mod camera;
pub mod clip;
pub mod coarse;
pub mod faces;
pub mod fine;
pub mod plane;
pub mod setup;
pub mod transform;
pub mod vertices;
