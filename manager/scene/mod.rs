//! The scene database: import, tree, bounds, built-in scenes.
//!
//! A [`Scene`] is what the manager knows of a world: the file's *nodes* with their transformations, *objects* (nodes that
//! carry a mesh), and *subobjects*, the pieces of those meshes that lists name and boards draw. It is made once, from a
//! file ([`import`]) or from parts ([`Parts`]), and never changes: what a host moves is kept beside it, in
//! [`Entities`], so that one scene serves any number of frames, threads and eyepoints.
//!
//! [`split`] cuts primitives into subobjects, [`bounds`] puts balls and boxes round things, [`bvh`] arranges the balls for
//! culling, [`inspect`] describes the result to a person.

pub mod bounds;
pub mod builtin;
pub mod bvh;
mod database;
mod entity;
pub mod glb;
#[cfg(feature = "import")]
pub mod import;
pub mod inspect;
pub mod split;

pub use database::{
    AssembleError, COORDINATE_MAX, MaterialEntry, Node, NodeIndex, NodeSource, Object, Parts, Piece, Scene, Shape,
    ShapeIndex,
};
pub use entity::{Entities, MovedObject};
