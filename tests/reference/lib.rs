//! The reference: what the right picture is, computed slowly and plainly in f64.
//!
//! Checks compare the pipeline's pictures with the ones made here. This crate follows one page, picture.md of the
//! design book, and shares no code with `channel/`, only the scene types of `proto`; where the page leaves a choice,
//! the file that makes it says so under "Choices". It values being obviously right over being fast: every point of
//! every pixel is asked of every face whose extent reaches the pixel, all fragments are kept and sorted, and nothing
//! is approximated but a texture's average.
//!
//! Two ways to a pixel:
//!
//! * [`sample()`] looks at given points of each pixel, with vertices either true ([`Vertices::Exact`]) or rounded to
//!   the pipeline's grid ([`Vertices::Rounded`]); with the pipeline's points and grid its coverage is the pipeline's to
//!   the bit. [`points::spread`] makes any number of points, 1024 of them being "the truth" for textured scenes.
//! * [`integrate()`] computes the box filter itself for scenes without textures: the pixel is cut into polygons in
//!   which the stack of faces is constant, and their colours are added up by area.
//!
//! In the order of the data's way: [`world`] what is drawn; [`camera`] and [`screen`] where it lands; [`coverage`]
//! which points a face hits; [`plane`] which faces lie in one plane; [`depth`] how far off they are; [`texture`] and
//! [`shade`] what colour a face has at a point; [`translucency`] how fragments add up; [`sampling`] and [`integral`]
//! the two renderers; [`mod@compare`] how far another picture is from ours.
#![forbid(unsafe_code)]

pub mod camera;
pub mod compare;
pub mod coverage;
pub mod depth;
pub mod integral;
pub mod picture;
pub mod plane;
pub mod points;
pub mod sampling;
pub mod screen;
pub mod shade;
pub mod texture;
pub mod translucency;
pub mod world;

#[cfg(test)]
mod analytic;

pub use compare::{Report, Shown, compare, difference_picture};
pub use integral::integrate;
pub use picture::Picture;
pub use sampling::{Options, sample};
pub use screen::{Grid, Vertices};
pub use texture::Filtering;
pub use translucency::{Fragment, Member, Model, composite};
pub use world::{Instance, World, WorldError};
