//! Real rigs of real processes on loopback: flown, killed, cut off, and fed with rubbish.
//!
//! Nothing here waits for a while and hopes: each test waits for an event, with a limit only so that a hang becomes a
//! failure.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test suite: a panic is a failure, and what is printed is its report"
)]

mod ahead;
mod bad_input;
mod bake;
mod displays;
mod events;
mod grid;
mod hostile;
mod impostor;
mod keys;
mod lifecycle;
mod lights;
mod namespaces;
mod pictures;
mod place;
#[allow(dead_code, reason = "what all suites share; each uses a part")]
mod program;
mod relayed;
mod standby;
mod still;
mod streaming;
mod transition;
mod trust;
mod turns;
mod window;
