//! Object processors: who looks at which node of the tree (seed 002, claims 2 to 6).
//!
//! A node is given to one processor, which returns pointers to nodes below (claim 1) before it does the node's features (claim 6; see [`super::walk`]).
//! A processor that has nothing to do says so with its idle flag (claims 2 and 5). Three ways to bring nodes to processors:
//!
//! * [`Dispatch::Stealing`]: each keeps the pointers that it found, takes the newest of its own, and an idle one takes the oldest, which stands for the
//!   largest part of the tree, from whoever has some. The shared bus of claim 2 is empty as long as nobody is idle.
//! * [`Dispatch::Groups`]: all pointers go to the bus. Processors stand in groups of [`GROUP`], and a group's local controller takes from the bus as many
//!   nodes as it has idle processors, no more (claim 3). The controller is a lock that its own processors hold in turn, not a thread.
//! * [`Dispatch::Spread`]: each pointer goes to a processor chosen pseudo-randomly by the node's number (claim 4), and stays there.
//!
//! They differ in time only. What is found is a set, sorted later, and counters are sums, so who found what can't be told from the result.

use super::walk::Node;
use pool::Pool;
use serde::Serialize;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Processors behind one local controller.
pub const GROUP: usize = 2;

/// Looks in vain before a processor lets others have its core.
const SPINS: u32 = 64;

/// How nodes come to processors; see the module's head.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Dispatch {
    /// Whoever is idle takes from whoever has.
    #[default]
    Stealing,
    /// Local controllers take from the bus for the idle ones of their groups.
    Groups,
    /// Pseudo-random, once and for all.
    Spread,
}

impl Dispatch {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Stealing, Self::Groups, Self::Spread];
}

/// Nodes that wait for a processor.
type Queue = Mutex<VecDeque<Node>>;

/// The ways from processor to processor; kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Crossbar {
    /// By processor.
    own: Vec<Queue>,
    /// By group.
    groups: Vec<Queue>,
    bus: Queue,
    /// By processor: set while it has nothing to do.
    idle: Vec<AtomicBool>,
    /// Nodes that wait or are being looked at.
    open: AtomicUsize,
    /// By processor: nodes that it looked at.
    looked: Vec<AtomicU64>,
}

fn lock(queue: &Queue) -> MutexGuard<'_, VecDeque<Node>> {
    // Nothing panics while it holds the lock.
    queue.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Well mixed bits of a number (the finaliser of `SplitMix64`).
fn mixed(number: u32) -> usize {
    let mut z = u64::from(number).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z ^ z >> 31) as usize
}

impl Crossbar {
    /// Nodes that each processor looked at in the last run.
    pub(super) fn looked(&self) -> impl Iterator<Item = u64> {
        self.looked.iter().map(|count| count.load(Ordering::Relaxed))
    }

    /// Looks at `root` and at all that `look` points to, with the processors of `pool`, or with one if there is no pool. Processor k has state k.
    pub(super) fn run<S: Send>(
        &mut self,
        way: Dispatch,
        pool: Option<&mut Pool>,
        states: &mut [S],
        root: Node,
        look: impl Fn(&mut S, Node, &mut dyn FnMut(Node)) + Sync,
    ) {
        let count = pool.as_ref().map_or(1, |pool| pool.threads()).min(states.len());
        self.own.resize_with(count.max(self.own.len()), Queue::default);
        self.groups.resize_with(count.div_ceil(GROUP).max(self.groups.len()), Queue::default);
        self.idle.resize_with(count, AtomicBool::default);
        self.looked.clear();
        self.looked.resize_with(count, AtomicU64::default);
        self.open.store(1, Ordering::Relaxed);
        match way {
            Dispatch::Groups => lock(&self.bus).push_back(root),
            Dispatch::Stealing => lock(&self.own[0]).push_back(root),
            Dispatch::Spread => lock(&self.own[mixed(root.branch) % count]).push_back(root),
        }
        let all = &*self;
        match pool {
            Some(pool) if count > 1 => {
                // One item for each processor: who comes late finds its item taken by another, who then does two in turn.
                let mut numbers = [(); 64].map(|()| 0);
                let numbers = &mut numbers[..count.min(64)];
                numbers.iter_mut().enumerate().for_each(|(k, number)| *number = k);
                pool.for_each(states, numbers, |state, number| all.serve(way, *number, state, &look));
            }
            _ => all.serve(way, 0, &mut states[0], &look),
        }
    }

    /// A processor's work until there is none for anybody.
    fn serve<S>(&self, way: Dispatch, own: usize, state: &mut S, look: &impl Fn(&mut S, Node, &mut dyn FnMut(Node))) {
        let mut vain = 0;
        let mut looked = 0;
        self.idle[own].store(true, Ordering::Relaxed);
        while self.open.load(Ordering::Acquire) > 0 {
            let Some(node) = self.take(way, own) else {
                vain += 1;
                if vain % SPINS == 0 {
                    std::thread::yield_now();
                } else {
                    std::hint::spin_loop();
                }
                continue;
            };
            self.idle[own].store(false, Ordering::Relaxed);
            look(state, node, &mut |pointer| {
                self.open.fetch_add(1, Ordering::Relaxed);
                let queue = match way {
                    Dispatch::Stealing => &self.own[own],
                    Dispatch::Groups => &self.bus,
                    Dispatch::Spread => &self.own[mixed(pointer.branch) % self.idle.len()],
                };
                lock(queue).push_back(pointer);
            });
            looked += 1;
            self.idle[own].store(true, Ordering::Relaxed);
            // What it did is seen by whoever sees that all is done.
            self.open.fetch_sub(1, Ordering::Release);
        }
        self.looked[own].fetch_add(looked, Ordering::Relaxed);
    }

    fn take(&self, way: Dispatch, own: usize) -> Option<Node> {
        match way {
            Dispatch::Spread => lock(&self.own[own]).pop_front(),
            Dispatch::Stealing => {
                let newest = lock(&self.own[own]).pop_back();
                let count = self.idle.len();
                newest.or_else(|| (1..count).find_map(|by| lock(&self.own[(own + by) % count]).pop_front()))
            }
            Dispatch::Groups => {
                let group = own / GROUP;
                let mut waiting = lock(&self.groups[group]);
                if waiting.is_empty() {
                    let members = &self.idle[group * GROUP..self.idle.len().min((group + 1) * GROUP)];
                    let idle = members.iter().filter(|idle| idle.load(Ordering::Relaxed)).count();
                    let mut bus = lock(&self.bus);
                    let taken = bus.len().min(idle);
                    waiting.extend(bus.drain(..taken));
                }
                waiting.pop_front()
            }
        }
    }
}
