//! The network: links that keep their order, as TCP does, between processes that may be cut off from each other.
//!
//! Within a link nothing is lost, repeated or overtaken; a loss that TCP can't mend is a link that breaks. Between links
//! there is no order. Where the way from one machine to another is cut, what is sent waits, the end of a link included,
//! until the way is open again: a silent cut, which only a timer can notice.

use crate::random::Random;
use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap, VecDeque};

/// A machine with its one process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Node {
    /// A manager's backplane: 0, or 1 for the stand-by.
    Manager(u8),
    /// A channel worker.
    Board(u8),
    /// A display: shows some of the views.
    Display(u8),
}

/// A link, never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Wire(pub u32);

/// What a link is for, as its maker says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// Board to manager.
    Session,
    /// Board to its left neighbour, for this epoch.
    Neighbour(proto::ids::Epoch),
    /// Board to display, under the name that this manager knows the board by.
    Tiles(u8, proto::ids::BoardKey),
    /// Display to manager.
    Show,
    /// Stand-by to manager.
    Watch,
}

/// What happens at a moment.
#[derive(Debug)]
pub(crate) enum Event<P> {
    /// The link is up at this end.
    Up(Node, Wire, Purpose),
    /// A link to that node couldn't be made.
    Failed(Node, Node, Purpose),
    /// A process is to start.
    Boot(Node),
    /// Something came over a link.
    Packet(Node, Wire, P),
    /// The link is down.
    Down(Node, Wire),
    /// A timer of that life of the node.
    Wake(Node),
    /// The fault of this number begins (true) or ends.
    Fault(usize, bool),
    /// Time for the checkers to look.
    Look,
}

#[derive(Debug)]
enum Item<P> {
    Arrive {
        wire: Wire,
        end: u8,
    },
    Wake {
        at: Node,
        life: u32,
    },
    /// Seldom; apart, so that what is sorted is small.
    Rare(Box<Rare<P>>),
}

#[derive(Debug)]
enum Rare<P> {
    Connect { from: Node, life: u32, to: Node, purpose: Purpose, patience: u64 },
    Up { at: Node, life: u32, wire: Wire, purpose: Purpose },
    Failed { at: Node, life: u32, to: Node, purpose: Purpose },
    Plain(Event<P>),
}

#[derive(Debug)]
enum Sent<P> {
    Data(P),
    End,
}

#[derive(Debug)]
struct Link<P> {
    ends: [(Node, u32); 2],
    /// What is under way to each end.
    queues: [VecDeque<Sent<P>>; 2],
    /// When the last of it arrives.
    last: [u64; 2],
    /// How many arrivals a cut has held up.
    held: [u32; 2],
    /// Whether each end still listens.
    open: [bool; 2],
}

struct Scheduled<P>(u64, u64, Item<P>);

impl<P> PartialEq for Scheduled<P> {
    fn eq(&self, other: &Self) -> bool {
        (self.0, self.1) == (other.0, other.1)
    }
}
impl<P> Eq for Scheduled<P> {}
impl<P> PartialOrd for Scheduled<P> {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl<P> Ord for Scheduled<P> {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.0, self.1).cmp(&(other.0, other.1))
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Process {
    life: u32,
    is_up: bool,
    stalled_until: u64,
    /// When its next timer is due, so that only one waits.
    wake: Option<u64>,
}

/// See the module's head. `P` is what travels.
pub(crate) struct Network<P> {
    now: u64,
    order: u64,
    queue: BinaryHeap<Reverse<Scheduled<P>>>,
    links: Vec<Link<P>>,
    cuts: BTreeSet<(Node, Node)>,
    processes: [Process; 16],
    random: Random,
    /// Least and most one-way delay, ns.
    delay: (u64, u64),
}

impl<P> std::fmt::Debug for Network<P> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Network at {} ns, {} links", self.now, self.links.len())
    }
}

/// How long making a link is tried over a way that is cut.
const CONNECT_PATIENCE: u64 = 300_000_000;

fn index(node: Node) -> usize {
    match node {
        Node::Board(i) => usize::from(i),
        Node::Manager(i) => 10 + usize::from(i),
        Node::Display(i) => 12 + usize::from(i),
    }
}

impl<P> Network<P> {
    /// A network whose one-way delays lie between `delay.0` and `delay.1` ns.
    pub(crate) fn new(seed: u64, delay: (u64, u64)) -> Self {
        Self {
            now: 0,
            order: 0,
            queue: BinaryHeap::new(),
            links: Vec::new(),
            cuts: BTreeSet::new(),
            processes: [Process::default(); 16],
            random: Random::new(seed),
            delay,
        }
    }

    /// The moment, ns.
    pub(crate) fn now(&self) -> u64 {
        self.now
    }

    /// Whether the node's process runs.
    pub(crate) fn is_up(&self, node: Node) -> bool {
        self.processes[index(node)].is_up
    }

    /// Whether the node's process runs, and isn't stalled.
    pub(crate) fn is_awake(&self, node: Node) -> bool {
        self.is_up(node) && self.stalled(node).is_none()
    }

    /// Starts the node's process; its first timer is due at once.
    pub(crate) fn start(&mut self, node: Node) {
        let process = &mut self.processes[index(node)];
        process.life += 1;
        process.is_up = true;
        process.stalled_until = 0;
        process.wake = None;
        self.wake(node, self.now);
    }

    /// Ends the node's process. If `silently`, nobody is told: the machine has no power. Otherwise its links end.
    pub(crate) fn stop(&mut self, node: Node, silently: bool) {
        for i in 0..self.links.len() {
            for end in [0, 1] {
                if self.links[i].ends[end].0 == node && self.links[i].open[end] {
                    if silently {
                        self.links[i].open[end] = false;
                    } else {
                        self.close(node, Wire(i as u32));
                    }
                }
            }
        }
        self.processes[index(node)].is_up = false;
    }

    /// The process does nothing for so long; what comes meanwhile waits.
    pub(crate) fn stall(&mut self, node: Node, ns: u64) {
        let process = &mut self.processes[index(node)];
        process.stalled_until = process.stalled_until.max(self.now + ns);
    }

    /// Cuts the way from one node to another.
    pub(crate) fn cut(&mut self, from: Node, to: Node) {
        self.cuts.insert((from, to));
    }

    /// Whether the way is cut.
    pub(crate) fn is_cut(&self, from: Node, to: Node) -> bool {
        self.cuts.contains(&(from, to))
    }

    /// Opens the way again.
    pub(crate) fn heal(&mut self, from: Node, to: Node) {
        if !self.cuts.remove(&(from, to)) {
            return;
        }
        for i in 0..self.links.len() {
            for end in [0, 1] {
                let link = &mut self.links[i];
                if link.ends[1 - end].0 == from && link.ends[end].0 == to {
                    for _ in 0..std::mem::take(&mut link.held[end]) {
                        self.arrive(Wire(i as u32), end);
                    }
                }
            }
        }
    }

    /// Asks for a link; [`Event::Up`] at both ends or [`Event::Failed`] follows.
    pub(crate) fn connect(&mut self, from: Node, to: Node, purpose: Purpose) {
        let life = self.processes[index(from)].life;
        let at = self.now + self.draw_delay();
        self.push_rare(at, Rare::Connect { from, life, to, purpose, patience: at + CONNECT_PATIENCE });
    }

    /// Sends over a link that is up at the sender's end; what is sent over another one is lost.
    pub(crate) fn send(&mut self, from: Node, wire: Wire, packet: P) {
        let Some(end) = self.end_of(from, wire) else { return };
        self.links[wire.0 as usize].queues[1 - end].push_back(Sent::Data(packet));
        self.arrive(wire, 1 - end);
    }

    /// Ends a link from one side; the other side hears of it after what has been sent.
    pub(crate) fn close(&mut self, from: Node, wire: Wire) {
        let Some(end) = self.end_of(from, wire) else { return };
        let link = &mut self.links[wire.0 as usize];
        link.open[end] = false;
        link.queues[1 - end].push_back(Sent::End);
        self.arrive(wire, 1 - end);
    }

    /// Breaks a link: what is under way is lost, and both ends hear of it.
    pub(crate) fn break_link(&mut self, wire: Wire) {
        for end in [0, 1] {
            let link = &mut self.links[wire.0 as usize];
            if link.open[end] {
                link.queues[end].clear();
                link.held[end] = 0;
                link.queues[end].push_back(Sent::End);
                self.arrive(wire, end);
            }
        }
    }

    /// The links between two nodes that are up at both ends.
    pub(crate) fn between(&self, a: Node, b: Node) -> impl Iterator<Item = Wire> + '_ {
        let joins = move |link: &Link<P>| {
            let nodes = (link.ends[0].0, link.ends[1].0);
            link.open == [true, true] && (nodes == (a, b) || nodes == (b, a))
        };
        (0..self.links.len()).filter(move |i| joins(&self.links[*i])).map(|i| Wire(i as u32))
    }

    /// Who is at the other end.
    pub(crate) fn peer(&self, node: Node, wire: Wire) -> Node {
        let ends = &self.links[wire.0 as usize].ends;
        if ends[0].0 == node { ends[1].0 } else { ends[0].0 }
    }

    /// Whether the node made the link, or listened.
    pub(crate) fn is_opener(&self, node: Node, wire: Wire) -> bool {
        self.links[wire.0 as usize].ends[0].0 == node
    }

    /// Sets the node's timer, if it isn't due earlier already.
    pub(crate) fn wake(&mut self, node: Node, at: u64) {
        let process = &mut self.processes[index(node)];
        if process.wake.is_none_or(|due| at < due) {
            process.wake = Some(at);
            let life = process.life;
            self.push(at.max(self.now), Item::Wake { at: node, life });
        }
    }

    /// Lets something else happen at a moment.
    pub(crate) fn schedule(&mut self, at: u64, event: Event<P>) {
        self.push_rare(at, Rare::Plain(event));
    }

    /// The next event and its moment; `None` after `end`.
    pub(crate) fn next(&mut self, end: u64) -> Option<Event<P>> {
        loop {
            let Reverse(Scheduled(at, ..)) = self.queue.peek()?;
            if *at > end {
                return None;
            }
            let Reverse(Scheduled(at, _, item)) = self.queue.pop()?;
            self.now = at;
            if let Some(event) = self.happen(item) {
                return Some(event);
            }
        }
    }

    fn happen(&mut self, item: Item<P>) -> Option<Event<P>> {
        match item {
            Item::Wake { at, life } => {
                let process = &mut self.processes[index(at)];
                if process.life != life || !process.is_up || process.wake.is_none_or(|due| due > self.now) {
                    return None;
                }
                if process.stalled_until >= self.now {
                    let until = process.stalled_until + 1;
                    self.push(until, Item::Wake { at, life });
                    return None;
                }
                process.wake = None;
                Some(Event::Wake(at))
            }
            Item::Arrive { wire, end } => self.on_arrive(wire, end.into()),
            Item::Rare(rare) => self.happen_rarely(*rare),
        }
    }

    fn happen_rarely(&mut self, rare: Rare<P>) -> Option<Event<P>> {
        match rare {
            Rare::Plain(event) => Some(event),
            Rare::Connect { from, life, to, purpose, patience } => {
                self.on_connect(from, life, to, purpose, patience);
                None
            }
            Rare::Up { at, life, wire, purpose } => {
                if let Some(until) = self.stalled(at) {
                    self.push_rare(until, Rare::Up { at, life, wire, purpose });
                    return None;
                }
                self.end_of(at, wire).filter(|_| self.is_alive(at, life)).map(|_| Event::Up(at, wire, purpose))
            }
            Rare::Failed { at, life, to, purpose } => {
                if let Some(until) = self.stalled(at) {
                    self.push_rare(until, Rare::Failed { at, life, to, purpose });
                    return None;
                }
                self.is_alive(at, life).then_some(Event::Failed(at, to, purpose))
            }
        }
    }

    fn on_connect(&mut self, from: Node, life: u32, to: Node, purpose: Purpose, patience: u64) {
        if !self.is_alive(from, life) {
            return;
        }
        let back = self.now + self.draw_delay();
        if self.is_cut(from, to) || self.is_cut(to, from) {
            if self.now < patience {
                self.push_rare(self.now + 20_000_000, Rare::Connect { from, life, to, purpose, patience });
            } else {
                self.push_rare(back, Rare::Failed { at: from, life, to, purpose });
            }
            return;
        }
        if !self.is_up(to) {
            self.push_rare(back, Rare::Failed { at: from, life, to, purpose });
            return;
        }
        let wire = Wire(self.links.len() as u32);
        let there = self.processes[index(to)].life;
        self.links.push(Link {
            ends: [(from, life), (to, there)],
            queues: [VecDeque::new(), VecDeque::new()],
            last: [back, self.now],
            held: [0, 0],
            open: [true, true],
        });
        // The listener knows first, as with TCP.
        self.push_rare(self.now, Rare::Up { at: to, life: there, wire, purpose });
        self.push_rare(back, Rare::Up { at: from, life, wire, purpose });
    }

    fn on_arrive(&mut self, wire: Wire, end: usize) -> Option<Event<P>> {
        let link = &mut self.links[wire.0 as usize];
        let (to, life) = link.ends[end];
        if self.cuts.contains(&(link.ends[1 - end].0, to)) {
            link.held[end] += 1;
            return None;
        }
        let process = &self.processes[index(to)];
        if !link.open[end] || process.life != life || !process.is_up {
            return None;
        }
        if process.stalled_until >= self.now {
            let until = process.stalled_until + 1;
            self.push(until, Item::Arrive { wire, end: end as u8 });
            return None;
        }
        match link.queues[end].pop_front()? {
            Sent::Data(packet) => Some(Event::Packet(to, wire, packet)),
            Sent::End => {
                link.open[end] = false;
                Some(Event::Down(to, wire))
            }
        }
    }

    fn arrive(&mut self, wire: Wire, end: usize) {
        let delay = self.draw_delay();
        let link = &mut self.links[wire.0 as usize];
        link.last[end] = (self.now + delay).max(link.last[end] + 1);
        let at = link.last[end];
        self.push(at, Item::Arrive { wire, end: end as u8 });
    }

    fn end_of(&self, node: Node, wire: Wire) -> Option<usize> {
        let link = self.links.get(wire.0 as usize)?;
        (0..2).find(|end| link.ends[*end] == (node, self.processes[index(node)].life) && link.open[*end])
    }

    fn is_alive(&self, node: Node, life: u32) -> bool {
        let process = &self.processes[index(node)];
        process.is_up && process.life == life
    }

    fn stalled(&self, node: Node) -> Option<u64> {
        let until = self.processes[index(node)].stalled_until;
        (until >= self.now).then_some(until + 1)
    }

    fn draw_delay(&mut self) -> u64 {
        // Mostly near the least, now and then near the most.
        let (least, most) = self.delay;
        let span = most - least;
        if self.random.chance(5) {
            least + self.random.below(span + 1)
        } else {
            least + self.random.below(span / 8 + 1)
        }
    }

    fn push_rare(&mut self, at: u64, rare: Rare<P>) {
        self.push(at, Item::Rare(Box::new(rare)));
    }

    fn push(&mut self, at: u64, item: Item<P>) {
        self.order += 1;
        self.queue.push(Reverse(Scheduled(at, self.order, item)));
    }
}
