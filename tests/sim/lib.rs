//! The chain under a seeded network: a whole rig of backplanes, boards and displays in virtual time, in one thread.
//!
//! The cores are those of the daemons ([`proto::chain`]); the shells are written anew, as small as they can be, and every message
//! is encoded and decoded on its way. A seed decides the rig, its network and its faults; the same seed gives the same log, byte
//! for byte. Checkers stand outside and look only at what is sent, drawn and shown ([`check`]).
#![forbid(unsafe_code)]

mod board;
pub mod check;
mod context;
mod display;
mod manager;
mod net;
pub mod plan;
mod random;
mod world;

pub use net::Node;
pub use world::{Outcome, run, run_plan};
