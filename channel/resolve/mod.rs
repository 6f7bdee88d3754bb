//! Resolve: from what the samples of a tile see to its pixels.
//!
//! A pixel's value is the mean of its samples in linear light, unclamped, in f64 and in one fixed order (faces by
//! their first sample, so that the order in which faces were found has no say). It is written as 8-bit sRGB and, if
//! asked for, as linear floats as well.
//!
//! - [`background`]: what is seen where nothing is.
//! - [`colour`]: linear light ↔ sRGB bytes.
//! - [`tile`]: the stage itself.

pub mod background;
pub mod colour;
pub mod tile;
