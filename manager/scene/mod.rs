//! The scene database: import, tree, bounds, built-in scenes.
//!
//! A [`Scene`] is what the manager knows of a world: the file's *nodes* with their transformations, *objects* (nodes that
//! carry a mesh), and *subobjects*, the pieces of those meshes that lists name and boards draw. It is made once, from a
//! file ([`import`]) or from parts ([`Parts`]), and never changes: what a host moves is kept beside it, in
//! [`Entities`], so that one scene serves any number of frames, threads and eyepoints.
//!
//! A scene can be written to a file that opens in milliseconds ([`baked`]); then [`Contents`], its meshes and textures, are read
//! from there when somebody asks.
//!
//! `extras` is what modellers say about parts of a scene, `models` what merges or has versions, `planes` which faces lie
//! over each other in one plane. [`split`] cuts primitives into subobjects, [`bounds`] puts balls and boxes round things, [`bvh`] arranges the balls for
//! culling, [`inspect`] describes the result to a person.

pub mod baked;
pub mod blocks;
pub mod bounds;
pub mod builtin;
pub mod bvh;
mod contents;
mod database;
mod entity;
mod extras;
pub mod glb;
#[cfg(feature = "import")]
pub mod import;
pub mod inspect;
mod models;
mod parts;
mod planes;
pub mod split;

pub use contents::{Content, ContentError, Contents};
pub use database::{MaterialEntry, Node, NodeIndex, Object, Piece, Scene, Shape, ShapeIndex};
pub use entity::{Entities, MovedObject};
pub use extras::{Extras, Traits};
pub use models::{Model, VersionsError};
pub use parts::{AssembleError, COORDINATE_MAX, LightSource, NodeSource, Parts, PieceSource};
