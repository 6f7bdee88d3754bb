//! What all shells share of links between daemons: sockets, TLS, and how many peers may come.
//!
//! The protocol itself ([`proto`]) knows no sockets; here is what stands between it and the network, once for manager,
//! boards and compositor.
//!
//! - [`Trust`] says how this daemon's links are protected, and connects. With keys every link is TLS 1.3 and both sides
//!   show a certificate of the rig's own authority; without, links stay on this machine unless that was waived.
//! - [`Listener`] accepts, within the bounds of [`proto::limits`]: [`Incoming::greet`] carries a peer from its first byte to
//!   the end of its greeting, or ends it.
//! - [`keep`] makes a link to a backplane again and again, and carries what is said.
//! - [`check_board`] holds a board's word against its certificate.
//! - [`Identity`] is what a certificate says of a peer: its role and its name. Role and name are two names of the domain
//!   `rig`: the board `pc1` has `board.rig` and `pc1.board.rig`, and is asked for by either. No name server knows them.
//!
//! Sockets are the system's, or those of another [`Network`]: a simulated one in tests.
//!
//! Files are read again when they have changed, at the next handshake; links that are up go on.
#![forbid(unsafe_code)]

mod date;
mod explain;
mod gate;
mod identity;
mod keep;
mod keys;
mod listener;
mod network;
mod roster;
mod stream;
#[cfg(test)]
mod tests;
mod trust;

pub use date::utc;
pub use identity::{Fingerprint, Identity, NodeRole, is_node_name};
pub use keep::{Kept, Outbox, Silence, keep};
pub use keys::{AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, KeysError};
pub use listener::{Arrival, Incoming, Listener, Place};
pub use network::{Network, Port, Waiting, Wire};
pub use roster::{Roster, check_board, denied};
pub use stream::Stream;
pub use trust::{Expected, Trust, is_on_this_machine};
