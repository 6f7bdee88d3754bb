//! A board's shell as `channel/worker` has it, less sockets and pixels: sessions with the backplanes, neighbour links, a
//! painter that draws one frame at a time, and newest wins.

use crate::context::{Context, Masks, Packet};
use crate::net::{Node, Purpose, Wire};
use crate::random::Random;
use proto::backoff::Backoff;
use proto::chain::{
    Answer, BACKPLANE_BEAT, BoardChain, BoardOutput, BoardTerm, FromBoardChain, LinkId, Seen, ToBoardChain, Watch,
};
use proto::codec::decode;
use proto::frame::REFERENCE_TILE;
use proto::ids::{BoardKey, ContentId, Epoch, FrameNumber, Term};
use proto::message::{BoardReport, FromBoard, Hello, NeighbourMessage, Role, TileMessage, Timeline, ToBoard};
use proto::share::shares;
use proto::time::Time;
use std::collections::BTreeMap;
use std::time::Duration;

/// Time until a board that was welcomed holds the scene, at most, ns.
const LOADING: u64 = 80_000_000;

/// How long until a link to a display is tried again.
const TILES_AGAIN: Duration = Duration::from_millis(50);

#[derive(Debug)]
struct Session {
    wire: Wire,
    key: BoardKey,
    chain: BoardChain,
    /// By which term its backplane leads.
    term: Term,
    tiles: BTreeMap<u8, Wire>,
    /// When the scene is there.
    loaded: Option<Time>,
    watch: Watch<()>,
    masks: Option<(Epoch, u32, Masks)>,
    /// The last that it began to draw.
    frame: Option<FrameNumber>,
}

#[derive(Clone, Debug)]
struct Work {
    rank: usize,
    /// By which its backplane knows the board.
    key: BoardKey,
    frame: FrameNumber,
    epoch: Epoch,
    masks: Option<Masks>,
    cost: Duration,
}

/// See the module's head.
#[derive(Debug)]
pub(crate) struct Board {
    node: Node,
    index: u8,
    random: Random,
    sessions: [Option<Session>; 2],
    backoff: [Backoff; 2],
    again: [Option<Time>; 2],
    term: BoardTerm,
    /// Which manager leads it.
    served: Option<usize>,
    /// Which session's chain a neighbour link belongs to.
    neighbours: BTreeMap<LinkId, usize>,
    drawing: Option<(Time, Work)>,
    waiting: Option<Work>,
    /// When links to displays are tried again.
    tiles_again: BTreeMap<(usize, u8), Time>,
    /// How many times as long it takes to draw.
    pub(crate) slowness: u64,
    /// Its painter does nothing.
    pub(crate) is_hung: bool,
    /// It has asked to leave, or has left.
    pub(crate) is_leaving: bool,
}

fn rank_of(epoch: Epoch) -> usize {
    (epoch.term().0 % 2) as usize
}

impl Board {
    /// A board whose process has just started.
    pub(crate) fn new(index: u8, seed: u64) -> Self {
        let mut random = Random::new(seed);
        Self {
            node: Node::Board(index),
            index,
            backoff: [Backoff::new(random.bits()), Backoff::new(random.bits())],
            random,
            sessions: [None, None],
            again: [Some(Time(0)), Some(Time(0))],
            term: BoardTerm::default(),
            served: None,
            neighbours: BTreeMap::new(),
            drawing: None,
            waiting: None,
            tiles_again: BTreeMap::new(),
            slowness: 1,
            is_hung: false,
            is_leaving: false,
        }
    }

    /// Whether it remembers a term.
    pub(crate) fn remembers(&self) -> bool {
        self.term.remembered().is_some()
    }

    /// A link is up.
    pub(crate) fn on_up(&mut self, context: &mut Context, wire: Wire, purpose: Purpose) {
        match purpose {
            Purpose::Session => {
                let Node::Manager(rank) = context.net.peer(self.node, wire) else { return };
                let role = Role::Board { threads: 1, link: self.index.to_string(), memory: 0, drawn: REFERENCE_TILE };
                context.net.send(self.node, wire, Packet::of(&Hello { name: String::new(), role }));
                let now = context.local(self.node);
                let mut watch = Watch::new(BACKPLANE_BEAT * 4);
                watch.on_heard(now, ());
                self.backoff[usize::from(rank)].reset();
                self.sessions[usize::from(rank)] = Some(Session {
                    wire,
                    key: BoardKey(0),
                    chain: BoardChain::new(BoardKey(0)),
                    term: Term(0),
                    tiles: BTreeMap::new(),
                    loaded: None,
                    watch,
                    masks: None,
                    frame: None,
                });
            }
            // Whoever opened it knows the wiring; the other end learns it from the hello.
            Purpose::Neighbour(epoch) => {
                if context.net.is_opener(self.node, wire) {
                    let link = LinkId(wire.0.into());
                    self.neighbours.insert(link, rank_of(epoch));
                    if let Some(session) = &mut self.sessions[rank_of(epoch)] {
                        session.chain.on_left_linked(epoch, link);
                    }
                }
            }
            Purpose::Tiles(rank, key) => {
                let Node::Display(display) = context.net.peer(self.node, wire) else { return };
                match &mut self.sessions[usize::from(rank)] {
                    Some(session) if session.key == key => drop(session.tiles.insert(display, wire)),
                    _ => context.net.close(self.node, wire),
                }
            }
            Purpose::Show | Purpose::Watch => {}
        }
        self.turn(context);
    }

    /// A link couldn't be made.
    pub(crate) fn on_failed(&mut self, context: &mut Context, to: Node, purpose: Purpose) {
        let now = context.local(self.node);
        match (purpose, to) {
            (Purpose::Session, Node::Manager(rank)) => {
                let rank = usize::from(rank);
                self.again[rank] = Some(now + self.backoff[rank].next_wait());
            }
            (Purpose::Tiles(rank, _), Node::Display(display)) => {
                self.tiles_again.insert((rank.into(), display), now + TILES_AGAIN);
            }
            (Purpose::Neighbour(epoch), _) => {
                if let Some(session) = &mut self.sessions[rank_of(epoch)] {
                    session.chain.on_link_lost(Some(epoch), None);
                }
            }
            _ => {}
        }
        self.turn(context);
    }

    /// A link is down.
    pub(crate) fn on_down(&mut self, context: &mut Context, wire: Wire) {
        let now = context.local(self.node);
        let link = LinkId(wire.0.into());
        if let Some(rank) = (0..2).find(|rank| self.sessions[*rank].as_ref().is_some_and(|s| s.wire == wire)) {
            self.end_session(context, rank);
            self.again[rank] = Some(now + self.backoff[rank].next_wait());
        } else if let Some(rank) = self.neighbours.remove(&link) {
            if let Some(session) = &mut self.sessions[rank] {
                session.chain.on_link_lost(None, Some(link));
            }
        } else {
            for rank in 0..2 {
                let Some(session) = &mut self.sessions[rank] else { continue };
                let gone = session.tiles.iter().find(|(_, tiles)| **tiles == wire).map(|(display, _)| *display);
                if let Some(display) = gone {
                    session.tiles.remove(&display);
                    self.tiles_again.insert((rank, display), now + TILES_AGAIN);
                }
            }
        }
        self.turn(context);
    }

    fn end_session(&mut self, context: &mut Context, rank: usize) {
        let Some(session) = self.sessions[rank].take() else { return };
        self.term.on_leader_lost(session.term);
        if self.served == Some(rank) {
            self.served = None;
            if context.plan.managers == 1 || self.term.remembered().is_none() {
                // Without terms a backplane that comes back numbers its frames from 0.
                self.term = BoardTerm::default();
                self.waiting = None;
                self.drawing = None;
            }
        }
        context.net.close(self.node, session.wire);
        for wire in session.tiles.into_values() {
            context.net.close(self.node, wire);
        }
        for link in self.neighbours.iter().filter(|(_, of)| **of == rank).map(|(link, _)| *link) {
            context.net.close(self.node, Wire(link.0 as u32));
        }
        self.neighbours.retain(|_, of| *of != rank);
    }

    /// Something came over a link.
    pub(crate) fn on_packet(&mut self, context: &mut Context, wire: Wire, packet: Packet) {
        let bytes = packet.bytes;
        match context.net.peer(self.node, wire) {
            Node::Manager(rank) => {
                let rank = usize::from(rank);
                if self.sessions[rank].as_ref().is_some_and(|session| session.wire == wire)
                    && let Ok((message, _)) = decode::<ToBoard>(bytes)
                {
                    self.on_backplane(context, rank, message);
                }
            }
            Node::Board(_) => {
                if let Ok((message, _)) = decode::<NeighbourMessage>(bytes) {
                    self.on_neighbour(context, wire, message);
                }
            }
            Node::Display(_) => {}
        }
        self.turn(context);
    }

    fn on_neighbour(&mut self, context: &mut Context, wire: Wire, message: NeighbourMessage) {
        let link = LinkId(wire.0.into());
        if let NeighbourMessage::Hello { epoch, .. } = message {
            self.neighbours.entry(link).or_insert(rank_of(epoch));
        }
        let rank = self.neighbours.get(&link).copied();
        match rank.map(|rank| self.sessions[rank].as_mut()) {
            Some(Some(session)) => session.chain.on_neighbour(link, message),
            // Of a session that is over.
            Some(None) => context.net.close(self.node, wire),
            // Without a hello before it, it is slipped in.
            None => {}
        }
    }

    fn on_backplane(&mut self, context: &mut Context, rank: usize, message: ToBoard) {
        let now = context.local(self.node);
        let Some(session) = &mut self.sessions[rank] else { return };
        session.watch.on_heard(now, ());
        match message {
            ToBoard::Welcome { key } => {
                session.key = key;
                session.chain = BoardChain::new(key);
                session.loaded = Some(now + Duration::from_nanos(self.random.below(LOADING)));
                // One that was started anew must not lead as if there had been nothing. The daemon says so also if another leads; here what
                // follows must do without.
                if let Some(term) = self.term.remembered().filter(|_| self.served.is_none()) {
                    self.say(context, rank, &FromBoard::Answer(Answer::Refused { term }));
                }
                for display in 0..context.plan.displays {
                    context.net.connect(self.node, Node::Display(display), Purpose::Tiles(rank as u8, key));
                }
            }
            ToBoard::Chain(message) => self.on_chain(context, now, rank, message),
            ToBoard::Frame(header) => self.on_frame(context, now, rank, header.state.frame, header.state.epoch),
            ToBoard::Alive if self.served == Some(rank) => drop(self.term.on_leader(now, session.term)),
            ToBoard::Ask(ask) => {
                let answer = self.term.on_ask(now, ask);
                if let Answer::Granted { .. } = answer {
                    self.served = Some(rank);
                    if ask.leads {
                        self.term.on_leader(now, ask.term);
                        session.term = ask.term;
                    }
                }
                context.log(self.node, || format!("{ask:?} {answer:?}"));
                self.say(context, rank, &FromBoard::Answer(answer));
            }
            ToBoard::Goodbye => {
                self.end_session(context, rank);
                self.again[rank] = Some(now + self.backoff[rank].next_wait());
            }
            _ => {}
        }
    }

    fn on_chain(&mut self, context: &mut Context, now: Time, rank: usize, message: ToBoardChain) {
        let epoch = message.epoch();
        if let (ToBoardChain::Wire { .. }, true) = (&message, self.served == Some(rank)) {
            let placed = self.sessions[rank].as_ref().and_then(|session| session.chain.placed());
            self.term.on_wired(epoch.term(), placed);
        }
        if !self.term.on_leader(now, epoch.term()) {
            let answer = Answer::Refused { term: self.term.term() };
            self.say(context, rank, &FromBoard::Answer(answer));
            return;
        }
        self.served = Some(rank);
        let Some(session) = &mut self.sessions[rank] else { return };
        session.term = epoch.term();
        session.chain.on_backplane(message);
    }

    fn on_frame(&mut self, context: &mut Context, now: Time, rank: usize, frame: FrameNumber, epoch: Epoch) {
        if !self.term.on_leader(now, epoch.term()) {
            return;
        }
        let Some(session) = &mut self.sessions[rank] else { return };
        self.term.on_frame(frame);
        let Some(place) = session.chain.place(epoch) else {
            // It must not say that it is ready: nobody else draws what it should.
            context.log(self.node, || format!("no place for {frame:?} of {epoch:?}"));
            return;
        };
        // Frames come once each and in order; one that is repeated is slipped in.
        if session.frame.is_some_and(|last| last >= frame) {
            return;
        }
        session.frame = Some(frame);
        self.term.on_active(Seen { epoch, id: place.id.0, total: place.weights.len() as u32 });
        if session.masks.as_ref().is_none_or(|(of, id, _)| (*of, *id) != (epoch, place.id.0)) {
            let mut masks = vec![0; context.views.len()];
            for share in shares(place.id, &place.weights, &context.views) {
                let view = &context.views[share.view.0 as usize].view;
                let columns = view.width.div_ceil(proto::frame::TILE);
                for tile in share.part.tiles(view.width, view.height) {
                    masks[share.view.0 as usize] |= 1_u64 << (u32::from(tile.y) * columns + u32::from(tile.x));
                }
            }
            session.masks = Some((epoch, place.id.0, masks.into()));
        }
        let (key, masks) = (session.key, session.masks.as_ref().map(|(.., masks)| masks.clone()));
        let tiles: u32 = masks.iter().flat_map(|masks| masks.iter()).map(|mask| mask.count_ones()).sum();
        let part = u64::from(tiles) * 1000 / (15 * u64::from(context.plan.views));
        let cost = context.plan.load / 1000 * part * self.slowness;
        let cost = Duration::from_nanos(cost * self.random.between(90, 110) / 100 + 100_000);
        self.waiting = Some(Work { rank, key, frame, epoch, masks, cost });
    }

    /// Its timer is due.
    pub(crate) fn on_wake(&mut self, context: &mut Context) {
        self.turn(context);
    }

    fn turn(&mut self, context: &mut Context) {
        let now = context.local(self.node);
        self.connect(context, now);
        self.connect_tiles(context, now);
        self.paint(context, now);
        for rank in 0..2 {
            let Some(session) = &mut self.sessions[rank] else { continue };
            if session.loaded.is_some_and(|at| now >= at) {
                session.loaded = None;
                self.say(context, rank, &FromBoard::Loaded { scene: ContentId([0; 16]) });
            }
            let Some(session) = &mut self.sessions[rank] else { continue };
            if !session.watch.on_timeout(now).is_empty() {
                self.end_session(context, rank);
                self.again[rank] = Some(now + self.backoff[rank].next_wait());
                continue;
            }
            session.chain.on_timeout(now);
            self.drain(context, now, rank);
        }
        context.wake(self.node, self.next_timeout());
    }

    fn next_timeout(&self) -> Option<Time> {
        let sessions = self.sessions.iter().flatten();
        let sessions =
            sessions.flat_map(|s| [s.loaded, Some(s.chain.next_timeout()), s.watch.next_timeout()]).flatten();
        let painter = self.drawing.as_ref().map(|(at, _)| *at).filter(|_| !self.is_hung);
        let again = self.again.iter().flatten().chain(self.tiles_again.values()).copied();
        sessions.chain(painter).chain(again).min()
    }

    fn connect(&mut self, context: &mut Context, now: Time) {
        if self.is_leaving && self.sessions.iter().all(Option::is_none) {
            self.again = [None, None];
        }
        for rank in 0..usize::from(context.plan.managers) {
            if self.again[rank].is_some_and(|at| now >= at) {
                self.again[rank] = None;
                context.net.connect(self.node, Node::Manager(rank as u8), Purpose::Session);
            }
        }
        if context.plan.managers == 1 {
            self.again[1] = None;
        }
    }

    fn connect_tiles(&mut self, context: &mut Context, now: Time) {
        while let Some((rank, display)) = self.tiles_again.iter().find(|(_, at)| now >= **at).map(|(of, _)| *of) {
            self.tiles_again.remove(&(rank, display));
            if let Some(session) = self.sessions[rank].as_ref().filter(|session| !session.tiles.contains_key(&display))
            {
                let purpose = Purpose::Tiles(rank as u8, session.key);
                context.net.connect(self.node, Node::Display(display), purpose);
            }
        }
    }

    fn paint(&mut self, context: &mut Context, now: Time) {
        if let Some((_, work)) = self.drawing.take_if(|(at, _)| now >= *at && !self.is_hung) {
            self.deliver(context, work);
        }
        if self.drawing.is_none()
            && let Some(work) = self.waiting.take()
        {
            self.drawing = Some((now + work.cost, work));
        }
    }

    fn deliver(&mut self, context: &mut Context, work: Work) {
        let Work { rank, key, frame, epoch, masks, cost } = work;
        let Some(session) = &mut self.sessions[rank] else { return };
        if let Some(masks) = &masks {
            context.checks.on_drawn(context.net.now(), (self.index, key), frame, epoch, masks);
        }
        for display in 0..context.plan.displays {
            if let Some(wire) = session.tiles.get(&display) {
                let packet = Packet { tiles: masks.clone(), ..Packet::of(&TileMessage::Done { frame, epoch }) };
                context.send(self.node, *wire, packet, true);
            }
        }
        let report = BoardReport { raster_ns: cost.as_nanos() as u64, ..BoardReport::default() };
        self.say(context, rank, &FromBoard::Ready { frame, epoch, report, timeline: Timeline::default() });
    }

    fn say(&mut self, context: &mut Context, rank: usize, message: &FromBoard) {
        let now = context.local(self.node);
        if let Some(session) = &mut self.sessions[rank] {
            session.chain.on_sent(now);
            let is_kept = matches!(message, FromBoard::Chain(_) | FromBoard::Ready { .. } | FromBoard::Alive);
            context.send(self.node, session.wire, Packet::of(message), is_kept);
        }
    }

    fn drain(&mut self, context: &mut Context, _now: Time, rank: usize) {
        while let Some(output) = self.sessions[rank].as_mut().and_then(|session| session.chain.poll_output()) {
            context.log(self.node, || format!("{output:?}"));
            match output {
                BoardOutput::ConnectLeft { epoch, address } => {
                    if let Ok(left) = address.parse() {
                        context.net.connect(self.node, Node::Board(left), Purpose::Neighbour(epoch));
                    }
                }
                BoardOutput::ToBackplane(message) => self.say(context, rank, &FromBoard::Chain(message)),
                BoardOutput::ToNeighbour(link, message) => {
                    context.send(self.node, Wire(link.0 as u32), Packet::of(&message), true);
                }
                BoardOutput::Close(link) => {
                    self.neighbours.remove(&link);
                    context.net.close(self.node, Wire(link.0 as u32));
                }
                BoardOutput::Beat => self.say(context, rank, &FromBoard::Alive),
            }
        }
    }

    /// Asks to leave, or is to come back.
    pub(crate) fn leave(&mut self, context: &mut Context, is_leaving: bool) {
        self.is_leaving = is_leaving;
        for rank in 0..2 {
            if is_leaving {
                self.say(context, rank, &FromBoard::Leave);
            } else if self.sessions[rank].is_none() {
                self.again[rank] = Some(context.local(self.node));
            }
        }
        self.turn(context);
    }
}

/// What a hostile or late sender might say that is about another epoch than `epoch`.
pub(crate) fn forge(random: &mut Random, epoch: Epoch) -> (ToBoard, FromBoard, NeighbourMessage) {
    let old = Epoch(epoch.0.saturating_sub(random.between(1, 5)));
    let number = random.below(10) as u32;
    let to_board = ToBoard::Chain(match random.below(2) {
        0 => ToBoardChain::Id { epoch: old, id: number },
        _ => ToBoardChain::Activate { epoch: old, frame: FrameNumber(0), weights: vec![1; number as usize + 1] },
    });
    let from_board = match random.below(4) {
        0 => FromBoard::Chain(FromBoardChain::Placed { epoch: old, id: number }),
        1 => FromBoard::Chain(FromBoardChain::Acknowledge { epoch: old, id: number, total: number + 1 }),
        2 => FromBoard::Chain(FromBoardChain::LinkLost { epoch: old, side: proto::chain::Side::Left }),
        _ => {
            let (frame, report, timeline) =
                (FrameNumber(random.below(400)), BoardReport::default(), Timeline::default());
            FromBoard::Ready { frame, epoch: old, report, timeline }
        }
    };
    let neighbour = match random.below(2) {
        0 => NeighbourMessage::Id { epoch: old, id: number },
        _ => NeighbourMessage::Total { epoch: old, total: number + 1 },
    };
    (to_board, from_board, neighbour)
}
