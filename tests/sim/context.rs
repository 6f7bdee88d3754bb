//! What every process of the rig is given: the network, the checkers, the log.

use crate::check::Checks;
use crate::net::{Network, Node, Wire};
use crate::plan::Plan;
use bytes::Bytes;
use proto::codec::encode;
use proto::time::Time;
use proto::view::ViewSetup;
use std::fmt::Write as _;
use std::rc::Rc;

/// Which tiles of each view; one bit a tile.
pub(crate) type Masks = Rc<[u64]>;

/// What travels: the bytes of a message, and instead of pixels which tiles they would be.
#[derive(Clone, Debug)]
pub(crate) struct Packet {
    /// As the daemons send them.
    pub(crate) bytes: Bytes,
    /// With a board's *done*: what it has drawn.
    pub(crate) tiles: Option<Masks>,
}

impl Packet {
    /// A message.
    pub(crate) fn of<M: serde::Serialize>(message: &M) -> Self {
        Self { bytes: encode(message, &[]), tiles: None }
    }
}

/// See the module's head.
#[derive(Debug)]
pub(crate) struct Context {
    /// The network.
    pub(crate) net: Network<Packet>,
    /// The checkers.
    pub(crate) checks: Checks,
    /// The run.
    pub(crate) plan: Plan,
    /// The views.
    pub(crate) views: Vec<ViewSetup>,
    /// What has happened, if it is wanted.
    pub(crate) log: Option<String>,
    /// Whether messages are to be slipped in.
    pub(crate) injects: bool,
    /// What may be slipped in again: when it was sent, by whom, to whom; the newest last.
    pub(crate) history: std::collections::VecDeque<(u64, Node, Node, Packet)>,
}

/// Messages that are remembered.
const HISTORY: usize = 128;

impl Context {
    /// The moment on this node's clock.
    pub(crate) fn local(&self, node: Node) -> Time {
        let now = self.net.now() as i64;
        Time((now + now / 1_000_000 * self.skew(node)) as u64)
    }

    fn skew(&self, node: Node) -> i64 {
        self.plan.skew_ppm[match node {
            Node::Board(i) => usize::from(i),
            Node::Manager(i) => 10 + usize::from(i),
            Node::Display(i) => 12 + usize::from(i),
        }]
    }

    /// Sets a node's timer for a moment on its own clock.
    pub(crate) fn wake(&mut self, node: Node, at: Option<Time>) {
        let Some(Time(at)) = at else { return };
        let mut due = (at as i64 - at as i64 / 1_000_000 * self.skew(node)).max(0);
        // A timer is never early, or it would be set again at once.
        while due + due / 1_000_000 * self.skew(node) < at as i64 {
            due += (at as i64 - due - due / 1_000_000 * self.skew(node)).max(1);
        }
        self.net.wake(node, (due as u64).max(self.net.now() + 1));
    }

    /// Sends, and remembers what was sent if it may be slipped in again.
    pub(crate) fn send(&mut self, from: Node, wire: Wire, packet: Packet, is_kept: bool) {
        if is_kept && self.injects {
            if self.history.len() == HISTORY {
                self.history.pop_front();
            }
            let (now, to) = (self.net.now(), self.net.peer(from, wire));
            self.history.push_back((now, from, to, packet.clone()));
        }
        self.net.send(from, wire, packet);
    }

    /// Writes a line of the log. What is said is made only if there is one.
    pub(crate) fn log(&mut self, node: Node, what: impl FnOnce() -> String) {
        let now = self.net.now();
        if let Some(log) = &mut self.log {
            // Writing to a string doesn't fail.
            let _ = writeln!(log, "{:>4}.{:06} {node:?}: {}", now / 1_000_000, now % 1_000_000, what());
        }
    }
}
