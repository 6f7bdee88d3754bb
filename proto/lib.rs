//! What crosses a wire in Cyclorama, and the rules for it.
//!
//! Everything the daemons say to each other is a type of this crate, and everything they must *agree* on without
//! saying it is a pure function of this crate: the frames of reference and frusta ([`view`]), which board draws which
//! part of a view ([`share`]), and the chain's state machine ([`chain`]). There are no sockets, no clocks and no pixels
//! here, so that a simulator, a model checker and the daemons run the very same code.
#![forbid(unsafe_code)]

pub mod backoff;
pub mod chain;
pub mod codec;
pub mod debug;
pub mod frame;
pub mod ids;
pub mod limits;
pub mod link;
pub mod list;
pub mod message;
pub mod piece;
pub mod pose;
pub mod scene;
pub mod share;
pub mod time;
pub mod view;
