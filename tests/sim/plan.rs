//! What a seed decides: the rig, its network, and the faults. As in `TigerBeetle`'s simulator some kinds of faults are wholly off in
//! each run, so that the rest can be seen alone, in all combinations.

use crate::net::Node;
use crate::random::Random;

/// A thousand of these are a microsecond.
const MS: u64 = 1_000_000;
/// Two frame periods at 60 Hz: a stall this long never expels anyone.
pub const STALL_HARMLESS: u64 = 33_333_333;
/// Boards of a rig, at most.
pub const BOARDS_MAX: u8 = 8;
/// When faults begin.
const BEGIN: u64 = 300 * MS;
/// When all faults are over.
pub const CALM: u64 = 3_800 * MS;
/// When a run ends. What must be whole again is looked at in its last part.
pub const END: u64 = 6_000 * MS;

/// What goes wrong, and for how long.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A board's process is killed; its links end. It comes back when the fault ends.
    Crash(Node),
    /// A machine loses its power: nobody is told.
    PowerOff(Node),
    /// A process does nothing for the duration.
    Stall(Node),
    /// One of the links between two nodes breaks.
    Break(Node, Node),
    /// The way from one node to another is cut.
    CutOneWay(Node, Node),
    /// Both ways are cut.
    Cut(Node, Node),
    /// All ways from, to, or both from and to a node are cut.
    Isolate(Node, bool, bool),
    /// A board takes so many times as long to draw.
    Slow(Node, u64),
    /// A board's painter hangs; it still beats.
    Hang(Node),
    /// A board asks to leave; it joins again when the fault ends.
    Leave(Node),
    /// Old, repeated and forged messages are slipped in.
    Inject,
}

/// A fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// What.
    pub kind: Kind,
    /// When it begins, ns.
    pub from: u64,
    /// When it ends, ns.
    pub until: u64,
}

/// A run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Number of boards.
    pub boards: u8,
    /// Of these, how many join only when the run has begun.
    pub late_boards: u8,
    /// Number of views.
    pub views: u32,
    /// Number of displays, which share the views.
    pub displays: u8,
    /// Number of backplanes: 1, or 2 with a stand-by.
    pub managers: u8,
    /// When the stand-by comes, ns; 0: at the beginning.
    pub standby_from: u64,
    /// How long after it has taken a first term the leader is killed, ns, if it is; it comes back.
    pub first_term: Option<u64>,
    /// Least and most one-way delay, ns.
    pub delay: (u64, u64),
    /// How much faster than true each node's clock runs, parts in a million.
    pub skew_ppm: [i64; 16],
    /// Time to draw all views on one board, ns.
    pub load: u64,
    /// Whether there are stretches in which nothing moves, so that no frames are opened.
    pub rests: bool,
    /// What goes wrong, by its beginning.
    pub faults: Vec<Fault>,
}

/// What faults may be drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Faults {
    /// None.
    None,
    /// Any.
    Any,
    /// Only such as cause nobody to be put out and no frame to be late: asked leaves, joins, and messages slipped in.
    Harmless,
    /// Stalls of at most two frame periods.
    ShortStalls,
    /// One crash of one board.
    OneCrash,
    /// One board that loses its power.
    OnePowerOff,
    /// The leading backplane of two is killed.
    LeaderCrash,
    /// The leading backplane of two loses its power.
    LeaderPowerOff,
    /// The leading backplane of two is cut off from some machines or all, and comes back.
    LeaderCut,
    /// A stand-by comes to a rig that flies, and the leader is killed within milliseconds of its first term.
    FirstTerm,
}

impl Faults {
    /// Each kind, with the name that commands know it by.
    pub const ALL: [(Self, &str); 10] = [
        (Self::None, "none"),
        (Self::Any, "any"),
        (Self::Harmless, "harmless"),
        (Self::ShortStalls, "short-stalls"),
        (Self::OneCrash, "crash"),
        (Self::OnePowerOff, "power-off"),
        (Self::LeaderCrash, "leader-crash"),
        (Self::LeaderPowerOff, "leader-power-off"),
        (Self::LeaderCut, "leader-cut"),
        (Self::FirstTerm, "first-term"),
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(faults, _)| *faults == self).map_or("", |(_, name)| name)
    }

    /// The kind of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, of)| *of == name).map(|(faults, _)| *faults)
    }
}

impl Plan {
    /// What `seed` decides.
    pub fn draw(seed: u64, faults: Faults) -> Self {
        let mut random = Random::new(seed);
        let terms =
            matches!(faults, Faults::LeaderCrash | Faults::LeaderPowerOff | Faults::LeaderCut | Faults::FirstTerm);
        let few = matches!(faults, Faults::Any) && random.chance(25);
        let boards = if few { random.between(1, 7) as u8 } else { BOARDS_MAX };
        let managers = if terms || (faults == Faults::Any && random.chance(30)) { 2 } else { 1 };
        let mut skew_ppm = [0; 16];
        if random.chance(50) {
            skew_ppm.iter_mut().for_each(|ppm| *ppm = random.below(401) as i64 - 200);
        }
        let least = random.between(20, 200) * 1000;
        let mut plan = Self {
            boards,
            late_boards: if random.chance(30) { random.below(u64::from(boards)) as u8 } else { 0 },
            views: random.between(1, 6) as u32,
            displays: random.between(1, 3) as u8,
            managers,
            standby_from: 0,
            first_term: None,
            delay: (least, least + random.between(10, 2_000) * 1000),
            skew_ppm,
            load: random.between(4, 9) * MS,
            rests: random.chance(25),
            faults: Vec::new(),
        };
        plan.draw_faults(&mut random, faults);
        plan.faults.sort_by_key(|fault| fault.from);
        plan
    }

    fn draw_faults(&mut self, random: &mut Random, faults: Faults) {
        let board = Node::Board(random.below(u64::from(self.boards)) as u8);
        let mut one =
            |kind, from: u64, ms: u64| self.faults.push(Fault { kind, from: from * MS, until: (from + ms) * MS });
        match faults {
            Faults::None => {}
            Faults::OneCrash => one(Kind::Crash(board), random.between(1000, 1100), 1500),
            Faults::OnePowerOff => one(Kind::PowerOff(board), random.between(1000, 1100), 1500),
            Faults::LeaderCrash => one(Kind::Crash(Node::Manager(0)), random.between(1000, 1100), 1500),
            Faults::LeaderPowerOff => one(Kind::PowerOff(Node::Manager(0)), random.between(1000, 1100), 1500),
            Faults::LeaderCut => {
                let leader = Node::Manager(0);
                let (from, ms) = (random.between(1000, 1100), random.between(100, 1500));
                let others: Vec<_> = self.nodes().into_iter().filter(|node| *node != leader).collect();
                let percent = random.pick(&[40, 70, 100]);
                for other in others {
                    if random.chance(percent) {
                        let until = (from + ms) * MS;
                        let kind = match random.below(4) {
                            0 => Kind::CutOneWay(leader, other),
                            1 => Kind::CutOneWay(other, leader),
                            _ => Kind::Cut(leader, other),
                        };
                        self.faults.push(Fault { kind, from: from * MS, until });
                    }
                }
            }
            Faults::FirstTerm => {
                self.standby_from = random.between(800 * MS, 1200 * MS);
                self.first_term = Some(random.below(8 * MS));
            }
            Faults::Harmless => {
                // One at a time, and each board back before the next: so there are always enough to draw.
                for (i, from) in (500..3200).step_by(600).enumerate() {
                    let kind = if i % 3 == 2 { Kind::Inject } else { Kind::Leave(self.any_board(random)) };
                    let from = from + random.below(100);
                    self.faults.push(Fault { kind, from: from * MS, until: (from + 300) * MS });
                }
            }
            Faults::ShortStalls => {
                for from in (500..3500).step_by(200) {
                    let node = if random.chance(20) { Node::Manager(0) } else { self.any_board(random) };
                    let from = from * MS + random.below(40 * MS);
                    self.faults.push(Fault {
                        kind: Kind::Stall(node),
                        from,
                        until: from + random.between(1, STALL_HARMLESS),
                    });
                }
            }
            Faults::Any => {
                if self.managers > 1 && random.chance(40) {
                    self.standby_from = random.between(BEGIN, CALM - 500 * MS);
                    self.first_term = Some(random.below(8 * MS)).filter(|_| random.chance(50));
                }
                self.draw_swarm(random);
            }
        }
    }

    fn draw_swarm(&mut self, random: &mut Random) {
        let mut kinds: Vec<u64> = (0..12).filter(|_| random.chance(45)).collect();
        if kinds.is_empty() {
            kinds.push(random.below(12));
        }
        for _ in 0..random.between(1, 12) {
            let from = random.between(BEGIN, CALM - 200 * MS);
            let longest = (CALM - from).min(1500 * MS);
            let until = from + random.between(MS, longest);
            let kind = random.pick(&kinds);
            let fault = self.draw_kind(random, kind, from, until);
            self.faults.push(fault);
        }
    }

    fn draw_kind(&self, random: &mut Random, kind: u64, from: u64, until: u64) -> Fault {
        let (a, b) = (self.any_board(random), self.any_node(random));
        let short = from + random.between(1, STALL_HARMLESS);
        let (kind, until) = match kind {
            0 => (Kind::Crash(a), until),
            1 => (Kind::PowerOff(a), until),
            2 => (Kind::Stall(a), short),
            3 => (Kind::Stall(b), until.min(from + 500 * MS)),
            4 => (Kind::Break(a, b), from),
            5 => (Kind::CutOneWay(a, b), until),
            6 => (Kind::Cut(a, b), until),
            7 => {
                let ways = random.between(1, 3);
                (Kind::Isolate(b, ways & 1 != 0, ways & 2 != 0), until)
            }
            8 => (Kind::Slow(a, random.between(2, 20)), until),
            9 => (Kind::Leave(a), until),
            10 if random.chance(40) => (Kind::Crash(b), until),
            10 => (Kind::Hang(a), until),
            _ => (Kind::Inject, until),
        };
        Fault { kind, from, until }
    }

    fn any_board(&self, random: &mut Random) -> Node {
        Node::Board(random.below(u64::from(self.boards)) as u8)
    }

    fn any_node(&self, random: &mut Random) -> Node {
        let all = self.nodes();
        all[random.below(all.len() as u64) as usize]
    }

    /// Whether so many boards may lose their memory that no majority is left that knows the last wiring. With two backplanes nobody may
    /// lead then: they can't know whether the other half is alive elsewhere.
    pub fn may_lose_majority(&self) -> bool {
        let forgets =
            |fault: &&Fault| matches!(fault.kind, Kind::Crash(Node::Board(_)) | Kind::PowerOff(Node::Board(_)));
        let shrinks = |fault: &Fault| {
            let harmless = matches!(fault.kind, Kind::Slow(..) | Kind::Inject | Kind::Break(..) | Kind::Crash(_));
            !harmless && !matches!(fault.kind, Kind::PowerOff(_))
        };
        let forgotten = self.faults.iter().filter(forgets).count();
        let few = self.faults.iter().any(shrinks) || forgotten * 3 >= usize::from(self.boards);
        self.managers > 1 && forgotten > 0 && few
    }

    /// Every machine.
    pub fn nodes(&self) -> Vec<Node> {
        let managers = (0..self.managers).map(Node::Manager);
        managers.chain((0..self.boards).map(Node::Board)).chain((0..self.displays).map(Node::Display)).collect()
    }
}
