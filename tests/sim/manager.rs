//! A manager's shell as `manager/backplane` has it, less scene and sockets; with a stand-by, either of the two may lead.

use crate::check::LIFE_SHIFT;
use crate::context::{Context, Packet};
use crate::net::{Node, Purpose, Wire};
use proto::chain::{
    Answer, Ask, BEAT, BackplaneChain, BackplaneOutput, BetweenBackplanes, ClockMode, ClockOutput, FrameClock, PERIOD,
    StandBy, StandByOutput, Wiring,
};
use proto::codec::{decode, encode};
use proto::debug::DebugPicture;
use proto::frame::{Environment, FrameState, PixelFormat};
use proto::ids::{BoardKey, Epoch, FrameNumber, Term};
use proto::message::{
    Changes, FrameHeader, FromBoard, FromCompositor, Hello, ListBase, Role as Guest, Swap, ToBoard, ToCompositor,
};
use proto::time::Time;
use proto::view::Pose;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// Whole frames before none is opened where nothing moves; the daemon waits for more.
const CALM: u32 = 3;
/// How long until the link to the other backplane is tried again.
const AGAIN: Duration = Duration::from_millis(30);

#[derive(Debug)]
struct Peer {
    wire: Wire,
    node: Node,
    address: String,
    is_loaded: bool,
    has_views: bool,
}

#[derive(Debug)]
struct Leading {
    term: Term,
    chain: BackplaneChain,
    clock: FrameClock,
    beat: Time,
    asked: Option<Epoch>,
    /// It leads without a term, and a stand-by has come that has heard of no term above this.
    awaits: Option<Term>,
    /// Boards that remember this term, though it has none.
    claims: BTreeMap<BoardKey, Term>,
    /// Frames in a row that were whole, and of the same wiring.
    whole: u32,
}

#[derive(Debug)]
enum Role {
    Leading(Box<Leading>),
    /// It has heard of no term yet: nobody could grant one.
    Waits,
    StandBy(Box<StandBy>),
}

/// See the module's head.
#[derive(Debug)]
pub(crate) struct Manager {
    node: Node,
    rank: u8,
    life: u64,
    role: Role,
    boards: BTreeMap<BoardKey, Peer>,
    keys: BTreeMap<Wire, BoardKey>,
    displays: BTreeSet<Wire>,
    /// The other backplane's links to this one, and this one's to the other.
    watchers: BTreeSet<Wire>,
    watched: Option<Wire>,
    again: Option<Time>,
    next_key: u64,
}

impl Manager {
    /// A manager in the given one of its lives, counted from 0. It leads, without a term, or has heard of none that it could ask for.
    pub(crate) fn new(context: &Context, rank: u8, life: u64, leads: bool) -> Self {
        let node = Node::Manager(rank);
        let now = context.local(node);
        let role = if leads {
            let chain = BackplaneChain::new();
            Role::Leading(Box::new(Leading::new(now, Term(0), chain, FrameNumber(0), context.plan.views)))
        } else {
            Role::Waits
        };
        Self {
            node,
            rank,
            life,
            again: (!leads).then_some(now),
            role,
            boards: BTreeMap::new(),
            keys: BTreeMap::new(),
            displays: BTreeSet::new(),
            watchers: BTreeSet::new(),
            watched: None,
            next_key: life << LIFE_SHIFT,
        }
    }

    /// By which term it leads; 0: none, or it doesn't lead.
    pub(crate) fn term(&self) -> Term {
        if let Role::Leading(leading) = &self.role { leading.term } else { Term(0) }
    }

    /// The boards of the wiring in effect, if it leads.
    pub(crate) fn members(&self) -> Option<usize> {
        match &self.role {
            Role::Leading(leading) => leading.chain.active().map(|wiring| wiring.members.len()),
            _ => None,
        }
    }

    /// The newest epoch, if it leads.
    pub(crate) fn epoch(&self) -> Option<Epoch> {
        match &self.role {
            Role::Leading(leading) => Some(leading.chain.epoch()),
            _ => None,
        }
    }

    /// A link is up.
    pub(crate) fn on_up(&mut self, context: &mut Context, wire: Wire, purpose: Purpose) {
        match purpose {
            Purpose::Watch if context.net.is_opener(self.node, wire) => {
                self.watched = Some(wire);
                context.send(self.node, wire, Packet::of(&BetweenBackplanes::Stands { highest: Term(0) }), false);
            }
            Purpose::Watch => drop(self.watchers.insert(wire)),
            // Boards and displays say hello first.
            _ => {}
        }
        self.turn(context);
    }

    /// A link to the other backplane couldn't be made.
    pub(crate) fn on_failed(&mut self, context: &mut Context) {
        self.on_watched_lost(context);
        self.turn(context);
    }

    fn on_watched_lost(&mut self, context: &Context) {
        let now = context.local(self.node);
        self.watched = None;
        self.again = Some(now + AGAIN);
        if let Role::StandBy(stand_by) = &mut self.role {
            stand_by.on_leader_lost(now);
        }
    }

    /// A link is down.
    pub(crate) fn on_down(&mut self, context: &mut Context, wire: Wire) {
        if let Some(key) = self.keys.get(&wire).copied() {
            self.lose(context, key);
        }
        self.displays.remove(&wire);
        self.watchers.remove(&wire);
        if let Role::Leading(leading) = &mut self.role
            && self.watchers.is_empty()
        {
            leading.awaits = None;
        }
        if self.watched == Some(wire) {
            self.on_watched_lost(context);
        }
        self.turn(context);
    }

    fn lose(&mut self, context: &mut Context, key: BoardKey) {
        let Some(peer) = self.boards.remove(&key) else { return };
        self.keys.remove(&peer.wire);
        context.net.close(self.node, peer.wire);
        let now = context.local(self.node);
        match &mut self.role {
            Role::Leading(leading) => {
                context.checks.on_lost(context.net.now());
                leading.chain.on_lost(now, key);
                leading.clock.on_lost(now, key);
                leading.claims.remove(&key);
                leading.whole = 0;
            }
            Role::StandBy(stand_by) => stand_by.on_board_lost(key),
            Role::Waits => {}
        }
    }

    /// Something came over a link.
    pub(crate) fn on_packet(&mut self, context: &mut Context, wire: Wire, packet: Packet) {
        let bytes = packet.bytes;
        if let Some(key) = self.keys.get(&wire).copied() {
            if let Ok((message, _)) = decode::<FromBoard>(bytes) {
                self.on_board(context, key, message);
            }
        } else if self.watchers.contains(&wire) || self.watched == Some(wire) {
            if let Ok((message, _)) = decode::<BetweenBackplanes>(bytes) {
                self.on_other(context, message);
            }
        } else if self.displays.contains(&wire) {
            // What a display says matters in lock-step only.
            drop(decode::<FromCompositor>(bytes));
        } else if let Ok((hello, _)) = decode::<Hello>(bytes) {
            self.on_hello(context, wire, hello);
        }
        self.turn(context);
    }

    fn on_hello(&mut self, context: &mut Context, wire: Wire, hello: Hello) {
        let now = context.local(self.node);
        match hello.role {
            Guest::Board { link, .. } => {
                self.next_key += 1;
                let key = BoardKey(self.next_key);
                let node = context.net.peer(self.node, wire);
                let peer = Peer { wire, node, address: link, is_loaded: false, has_views: false };
                self.boards.insert(key, peer);
                self.keys.insert(wire, key);
                context.send(self.node, wire, Packet::of(&ToBoard::Welcome { key }), false);
                match &mut self.role {
                    Role::StandBy(stand_by) => stand_by.on_board(now, key),
                    // Who comes after the term was won has perhaps a grant to add.
                    Role::Leading(leading) if leading.term > Term(0) => {
                        let ask = ToBoard::Ask(Ask { term: leading.term, leads: true });
                        context.send(self.node, wire, Packet::of(&ask), false);
                    }
                    Role::Leading(_) | Role::Waits => {}
                }
            }
            Guest::Compositor { .. } => {
                self.displays.insert(wire);
            }
            // Its links are told from others by their purpose.
            Guest::Backplane => {}
        }
    }

    fn on_other(&mut self, context: &mut Context, message: BetweenBackplanes) {
        let now = context.local(self.node);
        match (&mut self.role, message) {
            (Role::Waits, BetweenBackplanes::Leads { term }) => {
                self.stand_by(context, term);
                self.on_other(context, message);
            }
            (Role::StandBy(stand_by), message) => stand_by.on_leader(now, message),
            (Role::Leading(leading), BetweenBackplanes::Stands { highest }) if leading.term == Term(0) => {
                leading.awaits = leading.awaits.max(Some(highest));
                leading.whole = 0;
            }
            (Role::Leading(leading), BetweenBackplanes::Consented { epoch }) => leading.chain.on_consent(epoch),
            (Role::Leading(leading), BetweenBackplanes::Leads { term }) if term > leading.term => {
                self.resign(context, term);
            }
            _ => {}
        }
    }

    fn on_board(&mut self, context: &mut Context, key: BoardKey, message: FromBoard) {
        let now = context.local(self.node);
        let Some(peer) = self.boards.get_mut(&key) else { return };
        if let FromBoard::Loaded { .. } = message {
            peer.is_loaded = true;
        }
        match &mut self.role {
            Role::StandBy(stand_by) => {
                stand_by.on_heard(now, key);
                if let FromBoard::Answer(answer) = message {
                    stand_by.on_answer(key, answer);
                }
            }
            Role::Waits => {
                if let FromBoard::Answer(Answer::Refused { term }) = message
                    && term > Term(0)
                {
                    self.stand_by(context, term);
                }
            }
            Role::Leading(leading) => match message {
                FromBoard::Answer(Answer::Refused { term }) if term > leading.term => {
                    leading.claims.insert(key, term);
                    // Where there is no stand-by, one board alone doesn't end the rig.
                    if leading.term > Term(0) || leading.claims.len() * 2 > self.boards.len() {
                        self.resign(context, term);
                    }
                }
                message => leading.on_board(now, key, message, peer),
            },
        }
    }

    fn resign(&mut self, context: &mut Context, highest: Term) {
        context.log(self.node, || format!("resigns, for there is {highest:?}"));
        self.stand_by(context, highest);
    }

    fn stand_by(&mut self, context: &Context, highest: Term) {
        let now = context.local(self.node);
        let mut stand_by = StandBy::new(now, self.rank.into(), highest);
        for key in self.boards.keys() {
            stand_by.on_board(now, *key);
        }
        self.role = Role::StandBy(Box::new(stand_by));
        self.again = self.watched.is_none().then_some(now);
    }

    /// Its timer is due.
    pub(crate) fn on_wake(&mut self, context: &mut Context) {
        self.turn(context);
    }

    fn turn(&mut self, context: &mut Context) {
        let now = context.local(self.node);
        if self.again.is_some_and(|at| now >= at) {
            self.again = None;
            if !matches!(self.role, Role::Leading(_)) {
                context.net.connect(self.node, Node::Manager(1 - self.rank), Purpose::Watch);
            }
        }
        if let Role::StandBy(stand_by) = &mut self.role {
            stand_by.on_timeout(now);
            self.drain_stand_by(context, now);
        }
        if let Role::Leading(leading) = &mut self.role {
            leading.chain.on_timeout(now);
            leading.clock.on_timeout(now);
            self.drain(context, now);
            self.open_if_due(context, now);
            self.beat(context, now);
        }
        let due = match &self.role {
            Role::Leading(leading) => leading.next_timeout(),
            Role::StandBy(stand_by) => stand_by.next_timeout(),
            Role::Waits => None,
        };
        context.wake(self.node, [due, self.again].into_iter().flatten().min());
    }

    fn drain_stand_by(&mut self, context: &mut Context, now: Time) {
        while let Role::StandBy(stand_by) = &mut self.role
            && let Some(output) = stand_by.poll_output()
        {
            if output != StandByOutput::Beat {
                context.log(self.node, || format!("{output:?}"));
            }
            match output {
                StandByOutput::Ask(key, ask) => {
                    if let Some(peer) = self.boards.get(&key) {
                        context.send(self.node, peer.wire, Packet::of(&ToBoard::Ask(ask)), false);
                    }
                }
                StandByOutput::Beat => self.tell_all(context),
                StandByOutput::Drop(key) => self.lose(context, key),
                StandByOutput::ToLeader(message) => {
                    if let Some(wire) = self.watched {
                        context.send(self.node, wire, Packet::of(&message), false);
                    }
                }
                StandByOutput::Lead { term, first, quorum } => {
                    context.checks.on_takeover(context.net.now());
                    let mut chain = BackplaneChain::in_term(term, quorum);
                    for (key, peer) in self.boards.iter_mut().filter(|(_, peer)| peer.is_loaded) {
                        peer.has_views = false;
                        chain.on_join(now, *key, peer.address.clone());
                    }
                    self.role = Role::Leading(Box::new(Leading::new(now, term, chain, first, context.plan.views)));
                    // Those that haven't granted it follow it now.
                    let ask = Packet::of(&ToBoard::Ask(Ask { term, leads: true }));
                    for peer in self.boards.values() {
                        context.send(self.node, peer.wire, ask.clone(), false);
                    }
                }
            }
        }
    }

    fn beat(&mut self, context: &mut Context, now: Time) {
        let Role::Leading(leading) = &mut self.role else { return };
        let wanted = leading.chain.wants_consent();
        let is_due = now >= leading.beat;
        if leading.term == Term(0) || (!is_due && wanted == leading.asked) {
            return;
        }
        leading.asked = wanted;
        if is_due {
            leading.beat = now + BEAT;
        }
        for wire in self.watchers.iter().chain(&self.watched) {
            context.send(self.node, *wire, Packet::of(&BetweenBackplanes::Leads { term: leading.term }), false);
            if let Some(epoch) = wanted {
                context.send(self.node, *wire, Packet::of(&BetweenBackplanes::Consent { epoch }), false);
            }
        }
    }

    fn open_if_due(&mut self, context: &mut Context, now: Time) {
        let Role::Leading(leading) = &mut self.role else { return };
        if !leading.clock.wants_open(now) {
            return;
        }
        let next = leading.clock.next_frame();
        let Some(wiring) = leading.chain.on_frame(now, next).cloned() else { return };
        self.drain(context, now);
        let Role::Leading(leading) = &mut self.role else { return };
        // In stretches without motion a frame is opened now and then, as the daemon does: after a few that were whole, and of the same wiring.
        let rests = context.plan.rests && now.0 / 400_000_000 % 2 == 1 && next.0 % 8 != 0;
        if rests && leading.whole >= CALM && leading.chain.epoch() == wiring.epoch {
            leading.clock.on_idle(now);
            return;
        }
        let frame = leading.clock.on_open(now, &wiring);
        context.checks.on_opened(context.net.now(), self.rank, frame, wiring.epoch);
        for key in &wiring.members {
            if !self.boards.contains_key(key) {
                leading.clock.on_lost(now, *key);
            }
        }
        self.send_frame(context, frame, &wiring);
        self.drain(context, now);
    }

    fn send_frame(&mut self, context: &mut Context, frame: FrameNumber, wiring: &Wiring) {
        let state = FrameState {
            frame,
            epoch: wiring.epoch,
            eye: Pose::IDENTITY,
            environment: Environment::default(),
            debug: DebugPicture::Off,
        };
        let header = |views| FrameHeader {
            state,
            views,
            format: PixelFormat::default(),
            lists: Vec::new(),
            moved: Changes { base: ListBase::Same, count: 0 },
            weights: Changes::NONE,
        };
        let plain = encode(&ToBoard::Frame(header(None)), &[]);
        for key in &wiring.members {
            let Some(peer) = self.boards.get_mut(key) else { continue };
            let bytes = if peer.has_views {
                plain.clone()
            } else {
                peer.has_views = true;
                encode(&ToBoard::Frame(header(Some(context.views.clone()))), &[])
            };
            let wire = peer.wire;
            context.send(self.node, wire, Packet { bytes, tiles: None }, true);
        }
    }

    fn drain(&mut self, context: &mut Context, now: Time) {
        while let Role::Leading(leading) = &mut self.role
            && let Some(ClockOutput::Swap { swap, opened, late, missing }) = leading.clock.poll_output()
        {
            leading.chain.on_frame_over(now, &missing);
            let may_show = leading.chain.may_show(&swap.boards);
            leading.whole = if late || !may_show { 0 } else { leading.whole + 1 };
            let takes_term = leading.awaits.is_some() && leading.chain.may_take_term(&swap);
            self.swap(context, swap, now.since(opened), late, may_show);
            if takes_term {
                self.take_first_term(context, now);
            }
        }
        while let Role::Leading(leading) = &mut self.role
            && let Some(output) = leading.chain.poll_output()
        {
            if output != BackplaneOutput::Beat {
                context.log(self.node, || format!("{output:?}"));
            }
            match output {
                BackplaneOutput::Send(key, message) => self.say(context, key, &ToBoard::Chain(message), true),
                BackplaneOutput::Released(key) => self.say(context, key, &ToBoard::Goodbye, false),
                BackplaneOutput::PutOut(key, why) => {
                    if let Some(peer) = self.boards.get(&key) {
                        context.checks.on_put_out(context.net.now(), peer.node, why);
                    }
                    self.lose(context, key);
                }
                BackplaneOutput::Closed(_) => drop(leading.clock.on_rewired()),
                BackplaneOutput::Beat => self.tell_all(context),
            }
        }
    }

    fn take_first_term(&mut self, context: &mut Context, now: Time) {
        let Role::Leading(leading) = &mut self.role else { return };
        let Some(highest) = leading.awaits.take() else { return };
        // The daemon takes the time of day, which is above the terms of its earlier lives.
        let past = leading.claims.values().copied().max().unwrap_or_default();
        let term = past.max(highest).max(Term(2 * self.life)).next_of(0);
        (leading.term, leading.beat, leading.whole) = (term, now, 0);
        leading.claims.clear();
        leading.chain.on_term(now, term);
        for peer in self.boards.values().filter(|peer| !peer.is_loaded) {
            context.send(self.node, peer.wire, Packet::of(&ToBoard::Ask(Ask { term, leads: true })), false);
        }
        context.log(self.node, || format!("takes {term:?}, the first"));
    }

    fn tell_all(&self, context: &mut Context) {
        for peer in self.boards.values() {
            context.send(self.node, peer.wire, Packet::of(&ToBoard::Alive), false);
        }
    }

    fn say(&mut self, context: &mut Context, key: BoardKey, message: &ToBoard, is_kept: bool) {
        if let Some(peer) = self.boards.get(&key) {
            context.send(self.node, peer.wire, Packet::of(message), is_kept);
        }
    }

    fn swap(&mut self, context: &mut Context, swap: Swap, took: Duration, late: bool, may_show: bool) {
        if !may_show {
            context.checks.counts.held += 1;
            return;
        }
        let now = context.net.now();
        context.log(self.node, || {
            format!("swap {:?} of {:?}{}", swap.frame, swap.epoch, if late { ", late" } else { "" })
        });
        let opened = now.saturating_sub(took.as_nanos() as u64);
        context.checks.on_swap(now, &swap, opened, late);
        let packet = Packet::of(&ToCompositor::Swap(swap));
        for wire in &self.displays {
            context.send(self.node, *wire, packet.clone(), true);
        }
    }
}

impl Leading {
    fn new(now: Time, term: Term, chain: BackplaneChain, first: FrameNumber, views: u32) -> Self {
        let clock = FrameClock::new(ClockMode::RealTime { period: PERIOD }, first, views);
        let claims = BTreeMap::new();
        Self { term, chain, clock, beat: now, asked: None, awaits: None, claims, whole: 0 }
    }

    fn next_timeout(&self) -> Option<Time> {
        let can_open = self.clock.open_frame().is_some() || self.chain.active().is_some() || self.chain.has_closed();
        let clock = self.clock.next_timeout().filter(|_| can_open);
        let beat = (self.term > Term(0)).then_some(self.beat);
        [self.chain.next_timeout(), clock, beat].into_iter().flatten().min()
    }

    fn on_board(&mut self, now: Time, key: BoardKey, message: FromBoard, peer: &Peer) {
        match message {
            FromBoard::Loaded { .. } => drop(self.chain.on_join(now, key, peer.address.clone())),
            FromBoard::Chain(message) => {
                self.whole = 0;
                self.chain.on_message(now, key, message);
            }
            FromBoard::Ready { frame, epoch, report, .. } => {
                self.chain.on_ready(now, key, epoch, Duration::from_nanos(report.raster_ns));
                self.clock.on_ready(now, key, frame, epoch);
            }
            FromBoard::Leave => self.chain.on_leave(now, key),
            FromBoard::Alive => self.chain.on_heard(now, key),
            FromBoard::Answer(Answer::Granted { wiring: Some(seen), .. }) => self.chain.on_granted(key, seen),
            _ => {}
        }
    }
}
