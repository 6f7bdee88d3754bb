//! A whole rig in virtual time: events out of the network's queue, faults out of the plan.

use crate::board::{Board, forge};
use crate::check::{Checks, Counts};
use crate::context::{Context, Packet};
use crate::display::Display;
use crate::manager::Manager;
use crate::net::{Event, Network, Node, Purpose, Wire};
use crate::plan::{END, Fault, Faults, Kind, Plan};
use crate::random::Random;
use proto::ids::Term;
use proto::view::{Mode, Samples, Tangents, View, ViewSetup};
use std::collections::VecDeque;

/// How often the checkers look at the displays, ns.
const LOOK: u64 = 50_000_000;
/// How often messages are slipped in, ns.
const INJECT: u64 = 15_000_000;

/// How long a leader is down that was killed in its first term, ns.
const DOWN: u64 = 1_200_000_000;

/// How old what is slipped in again is at least, ns: more than any delay.
const OVERTAKEN: u64 = 5_000_000;

/// What came of a run.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// What was wrong; nothing if all was right.
    pub violations: Vec<String>,
    /// What was counted.
    pub counts: Counts,
    /// What happened, if it was wanted.
    pub log: Option<String>,
}

#[derive(Debug)]
struct World {
    context: Context,
    random: Random,
    managers: [Option<Manager>; 2],
    lives: [u64; 2],
    boards: Vec<Option<Board>>,
    displays: Vec<Option<Display>>,
    /// The leader's first term is still to come, and a fault with it.
    awaits_term: bool,
}

/// Runs what `seed` decides. The same seed gives the same log, byte for byte.
pub fn run(seed: u64, faults: Faults, with_log: bool) -> Outcome {
    run_plan(seed, Plan::draw(seed, faults), with_log)
}

/// Runs a plan, with delays drawn from `seed`.
pub fn run_plan(seed: u64, plan: Plan, with_log: bool) -> Outcome {
    let mut world = World::new(seed, plan, with_log);
    world.start();
    while let Some(event) = world.context.net.next(END) {
        world.on_event(event);
    }
    world.finish()
}

/// Five by three tiles each, so that a view's tiles are the bits of a number.
fn views(count: u32, random: &mut Random) -> Vec<ViewSetup> {
    let (width, height) = (5 * proto::frame::TILE, 3 * proto::frame::TILE);
    let row = View::row(count, width, height, Tangents::symmetric(40.0, width, height), Samples::One);
    let mode = |random: &mut Random| if random.chance(50) { Mode::Region } else { Mode::Interleave };
    row.into_iter().map(|view| ViewSetup { mode: mode(random), ..ViewSetup::new(view) }).collect()
}

impl World {
    fn new(seed: u64, plan: Plan, with_log: bool) -> Self {
        let mut random = Random::new(seed ^ 0x5eed);
        let views = views(plan.views, &mut random);
        let context = Context {
            net: Network::new(random.bits(), plan.delay),
            checks: Checks::default(),
            views,
            log: with_log.then(String::new),
            history: VecDeque::new(),
            injects: plan.faults.iter().any(|fault| fault.kind == Kind::Inject),
            plan,
        };
        let (boards, displays) = (context.plan.boards.into(), context.plan.displays.into());
        let none = |count| (0..count).map(|_| None).collect();
        Self {
            awaits_term: context.plan.first_term.is_some(),
            context,
            random,
            managers: [None, None],
            lives: [0, 0],
            boards: none(boards),
            displays: (0..displays).map(|_: usize| None).collect(),
        }
    }

    fn start(&mut self) {
        let plan = self.context.plan.clone();
        for rank in 0..plan.managers {
            match plan.standby_from {
                0 => self.boot(Node::Manager(rank)),
                _ if rank == 0 => self.boot(Node::Manager(0)),
                from => self.context.net.schedule(from, Event::Boot(Node::Manager(rank))),
            }
        }
        for display in 0..plan.displays {
            self.boot(Node::Display(display));
        }
        for board in 0..plan.boards - plan.late_boards {
            self.boot(Node::Board(board));
        }
        // The rig fills: until all are in the row once, frames may be late.
        self.context.checks.begin(1_000_000_000);
        for (i, fault) in plan.faults.iter().enumerate() {
            self.context.net.schedule(fault.from, Event::Fault(i, true));
            if fault.until > fault.from && fault.kind != Kind::Inject {
                self.context.net.schedule(fault.until, Event::Fault(i, false));
            }
        }
        for board in plan.boards - plan.late_boards..plan.boards {
            let at = self.random.between(400_000_000, 2_500_000_000);
            self.context.net.schedule(at, Event::Boot(Node::Board(board)));
        }
        self.context.net.schedule(LOOK, Event::Look);
    }

    fn boot(&mut self, node: Node) {
        if self.context.net.is_up(node) {
            return;
        }
        self.context.log(node, || "starts".into());
        self.context.net.start(node);
        match node {
            Node::Board(i) => self.boards[usize::from(i)] = Some(Board::new(i, self.random.bits())),
            Node::Display(i) => self.displays[usize::from(i)] = Some(Display::new(i)),
            Node::Manager(i) => {
                // In place of what boards and the other one would say to it within milliseconds.
                let is_led = self.managers.iter().flatten().any(|other| other.term() > Term(0));
                let leads = i == 0 && !is_led && !self.boards.iter().flatten().any(Board::remembers);
                let life = &mut self.lives[usize::from(i)];
                self.managers[usize::from(i)] = Some(Manager::new(&self.context, i, *life, leads));
                *life += 1;
                if leads {
                    self.context.checks.on_restart();
                    // It numbers everything anew: what is left of its last life would look like news.
                    self.context.history.clear();
                }
            }
        }
    }

    fn halt(&mut self, node: Node, silently: bool) {
        if !self.context.net.is_up(node) {
            return;
        }
        self.context.log(node, || "stops".into());
        self.context.net.stop(node, silently);
        match node {
            Node::Board(i) => {
                self.boards[usize::from(i)] = None;
                self.context.checks.on_board_lost(i);
            }
            Node::Display(i) => {
                self.displays[usize::from(i)] = None;
                self.context.checks.on_display_lost(i);
            }
            Node::Manager(i) => self.managers[usize::from(i)] = None,
        }
    }

    fn on_event(&mut self, event: Event<Packet>) {
        if self.awaits_term && self.managers[0].as_ref().is_some_and(|manager| manager.term() > Term(0)) {
            self.on_first_term();
        }
        match event {
            Event::Fault(i, begins) => self.on_fault(i, begins),
            Event::Boot(node) => self.boot(node),
            Event::Look => self.look(),
            Event::Up(node, wire, purpose) => self.on_up(node, wire, purpose),
            Event::Failed(node, to, purpose) => self.on_failed(node, to, purpose),
            Event::Packet(node, wire, packet) => self.on_packet(node, wire, packet),
            Event::Down(node, wire) => self.on_down(node, wire),
            Event::Wake(node) => self.on_wake(node),
        }
    }

    fn on_up(&mut self, node: Node, wire: Wire, purpose: Purpose) {
        let context = &mut self.context;
        match node {
            Node::Board(i) => self.boards[usize::from(i)].as_mut().map(|b| b.on_up(context, wire, purpose)),
            Node::Display(i) => self.displays[usize::from(i)].as_mut().map(|d| d.on_up(context, wire, purpose)),
            Node::Manager(i) => self.managers[usize::from(i)].as_mut().map(|m| m.on_up(context, wire, purpose)),
        };
    }

    fn on_failed(&mut self, node: Node, to: Node, purpose: Purpose) {
        let context = &mut self.context;
        let rank = if let Node::Manager(rank) = to { usize::from(rank) } else { 0 };
        match node {
            Node::Board(i) => self.boards[usize::from(i)].as_mut().map(|b| b.on_failed(context, to, purpose)),
            Node::Display(i) => self.displays[usize::from(i)].as_mut().map(|d| d.on_failed(context, rank)),
            Node::Manager(i) => self.managers[usize::from(i)].as_mut().map(|m| m.on_failed(context)),
        };
    }

    fn on_packet(&mut self, node: Node, wire: Wire, packet: Packet) {
        let context = &mut self.context;
        match node {
            Node::Board(i) => self.boards[usize::from(i)].as_mut().map(|b| b.on_packet(context, wire, packet)),
            Node::Display(i) => self.displays[usize::from(i)].as_mut().map(|d| d.on_packet(context, wire, packet)),
            Node::Manager(i) => self.managers[usize::from(i)].as_mut().map(|m| m.on_packet(context, wire, packet)),
        };
    }

    fn on_down(&mut self, node: Node, wire: Wire) {
        let context = &mut self.context;
        match node {
            Node::Board(i) => self.boards[usize::from(i)].as_mut().map(|b| b.on_down(context, wire)),
            Node::Display(i) => self.displays[usize::from(i)].as_mut().map(|d| d.on_down(context, wire)),
            Node::Manager(i) => self.managers[usize::from(i)].as_mut().map(|m| m.on_down(context, wire)),
        };
    }

    /// The leader has taken its first term: it is killed, if that is planned.
    fn on_first_term(&mut self) {
        let now = self.context.net.now();
        self.awaits_term = false;
        let from = now + self.context.plan.first_term.unwrap_or(0);
        let fault = Fault { kind: Kind::Crash(Node::Manager(0)), from, until: from + DOWN };
        let number = self.context.plan.faults.len();
        self.context.plan.faults.push(fault);
        self.context.net.schedule(from, Event::Fault(number, true));
        self.context.net.schedule(from + DOWN, Event::Fault(number, false));
    }

    fn on_wake(&mut self, node: Node) {
        let context = &mut self.context;
        match node {
            Node::Board(i) => self.boards[usize::from(i)].as_mut().map(|b| b.on_wake(context)),
            Node::Display(i) => self.displays[usize::from(i)].as_mut().map(|d| d.on_wake(context)),
            Node::Manager(i) => self.managers[usize::from(i)].as_mut().map(|m| m.on_wake(context)),
        };
    }

    fn look(&mut self) {
        let now = self.context.net.now();
        for (i, display) in self.displays.iter().enumerate() {
            if let Some(display) = display {
                self.context.checks.look(now, i as u8, display.shown());
            }
        }
        self.context.net.schedule(now + LOOK, Event::Look);
    }

    fn on_fault(&mut self, index: usize, begins: bool) {
        let fault = self.context.plan.faults[index].clone();
        self.context.log(Node::Manager(0), || format!("{} {:?}", if begins { "FAULT" } else { "end of" }, fault.kind));
        if begins {
            self.note(&fault);
        }
        match fault.kind {
            Kind::Crash(node) | Kind::PowerOff(node) if begins => {
                self.halt(node, matches!(fault.kind, Kind::PowerOff(_)));
            }
            Kind::Crash(node) | Kind::PowerOff(node) => self.boot(node),
            Kind::Stall(node) if begins => self.context.net.stall(node, fault.until - fault.from),
            Kind::Stall(_) => {}
            Kind::Break(a, b) => {
                let wires: Vec<Wire> = self.context.net.between(a, b).collect();
                if !wires.is_empty() {
                    let wire = self.random.pick(&wires);
                    self.context.net.break_link(wire);
                }
            }
            Kind::CutOneWay(a, b) => self.cut(a, b, begins),
            Kind::Cut(a, b) => {
                self.cut(a, b, begins);
                self.cut(b, a, begins);
            }
            Kind::Isolate(node, from, to) => {
                for other in self.context.plan.nodes() {
                    if other != node && from {
                        self.cut(node, other, begins);
                    }
                    if other != node && to {
                        self.cut(other, node, begins);
                    }
                }
            }
            Kind::Slow(node, times) => {
                self.with_board(node, |board, _| board.slowness = if begins { times } else { 1 });
            }
            Kind::Hang(node) => self.with_board(node, |board, context| {
                board.is_hung = begins;
                board.on_wake(context);
            }),
            Kind::Leave(node) => self.with_board(node, |board, context| board.leave(context, begins)),
            Kind::Inject => self.inject(index, &fault),
        }
    }

    fn with_board(&mut self, node: Node, change: impl FnOnce(&mut Board, &mut Context)) {
        if let Node::Board(i) = node
            && let Some(board) = &mut self.boards[usize::from(i)]
        {
            change(board, &mut self.context);
        }
    }

    fn cut(&mut self, from: Node, to: Node, begins: bool) {
        if begins { self.context.net.cut(from, to) } else { self.context.net.heal(from, to) }
    }

    /// Tells the checkers what this fault may have for consequences.
    fn note(&mut self, fault: &Fault) {
        let (now, until) = (fault.from, fault.until);
        let checks = &mut self.context.checks;
        match fault.kind {
            // Nobody may be hurt by these.
            Kind::Leave(_) | Kind::Inject => {}
            Kind::Stall(node) => checks.on_stall(now, node, until),
            Kind::Break(a, b) | Kind::CutOneWay(a, b) | Kind::Cut(a, b) => {
                checks.disturb(now, until);
                checks.excuse(a, until);
                checks.excuse(b, until);
            }
            Kind::Crash(node) | Kind::PowerOff(node) | Kind::Isolate(node, ..) => {
                checks.disturb(now, until);
                checks.excuse(node, until);
            }
            Kind::Slow(node, _) | Kind::Hang(node) => {
                checks.disturb(now, until);
                checks.excuse(node, until);
            }
        }
    }

    /// Slips a few messages in: repeated ones, and ones about other epochs.
    fn inject(&mut self, index: usize, fault: &Fault) {
        for _ in 0..4 {
            if !self.context.history.is_empty() {
                let at = self.random.below(self.context.history.len() as u64) as usize;
                let (sent, from, to, packet) = self.context.history[at].clone();
                // A copy doesn't overtake what it is a copy of.
                if self.context.net.now() > sent + OVERTAKEN {
                    self.slip(from, to, packet);
                }
            }
        }
        if let Some(epoch) = self.managers.iter().flatten().find_map(Manager::epoch) {
            let (to_board, from_board, neighbour) = forge(&mut self.random, epoch);
            let boards = u64::from(self.context.plan.boards);
            let [a, b] = [(); 2].map(|()| Node::Board(self.random.below(boards) as u8));
            let manager = Node::Manager(0);
            self.slip(manager, a, Packet::of(&to_board));
            self.slip(a, manager, Packet::of(&from_board));
            self.slip(a, b, Packet::of(&neighbour));
        }
        let next = self.context.net.now() + INJECT;
        if next < fault.until {
            self.context.net.schedule(next, Event::Fault(index, true));
        }
    }

    fn slip(&mut self, from: Node, to: Node, packet: Packet) {
        let wires: Vec<Wire> = self.context.net.between(from, to).collect();
        if from != to && !wires.is_empty() && self.context.net.is_awake(to) {
            let wire = self.random.pick(&wires);
            self.on_packet(to, wire, packet);
        }
    }

    fn finish(mut self) -> Outcome {
        let now = self.context.net.now();
        let is_expected = |board: &&Option<Board>| board.as_ref().is_some_and(|board| !board.is_leaving);
        let expected = self.boards.iter().filter(is_expected).count();
        let leading = self.managers.iter().flatten().max_by_key(|manager| manager.epoch());
        let members = leading.and_then(Manager::members);
        let plan = self.context.plan.clone();
        self.context.checks.on_end(now, &plan, members, expected);
        let checks = self.context.checks;
        Outcome { violations: checks.violations().to_vec(), counts: checks.counts, log: self.context.log }
    }
}
