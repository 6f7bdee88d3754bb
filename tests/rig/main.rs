//! Real rigs of real processes on loopback: flown, killed, cut off, and fed with rubbish.
//!
//! Nothing here waits for a while and hopes: each test waits for an event, with a limit only so that a hang becomes a
//! failure.

mod bad_input;
mod hostile;
mod lifecycle;
mod pictures;
mod program;
