//! A rig of the real shells over a simulated network: the manager's links and engine, boards' sessions and neighbours, the compositor, all as the
//! program runs them, in one thread and in virtual time.
//!
//! [`Ground`] is the network, over turmoil's sockets; [`Rig`] the hosts. The seed decides delays, waits and what is done to whom. Pictures are really
//! drawn, tiny ones, while virtual time stands still. What isn't simulated: TLS, the host's datagrams, the console, and TCP's retransmission (what a
//! *partition* drops is lost for good, and the connection with it; what a *hold* delays comes later, in order).
#![cfg(feature = "import")]
#![forbid(unsafe_code)]

mod network;
mod rig;

pub use network::{Entry, Ground};
pub use rig::{Census, Rig, of, undisturbed};
