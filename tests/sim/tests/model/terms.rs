//! Two backplanes and three boards: who leads, and what may be shown. Time is as bad as it can be: every board takes its
//! backplane for silent whenever it is asked, and a stand-by asks whenever it likes. Wirings are taken for closed at once. The rig has
//! a term from the beginning; `first_term` looks at how it gets there.

use super::{alone, depth, look};
use proto::chain::planted::{Bug, plant};
use proto::chain::{Answer, Ask, BetweenBackplanes, BoardTerm, Quorum, Seen, StandBy, StandByOutput, Wiring};
use proto::ids::{BoardKey, Epoch, FrameNumber, Term};
use proto::time::Time;
use stateright::{Model, Property};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

const BOARDS: usize = 3;
/// When leaders are heard, and when boards are asked: long after.
const HEARD: Time = Time(0);
const ASKED: Time = Time(1 << 50);
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Message {
    Ask(Ask),
    Answer(Answer),
    /// A new wiring begins.
    Wire(Epoch),
    Frame {
        term: Term,
        seen: Seen,
        frame: FrameNumber,
    },
    Ready {
        epoch: Epoch,
        frame: FrameNumber,
    },
    Between(BetweenBackplanes),
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Leader {
    pub(super) term: Term,
    epoch: Epoch,
    pub(super) quorum: Quorum,
    /// Boards that are connected.
    pub(super) members: Vec<usize>,
    /// The boards of the wiring in effect, in the order of their places.
    pub(super) active: Vec<usize>,
    /// The members have changed since the last wiring took effect.
    is_rewired: bool,
    next: FrameNumber,
    opened: u64,
    open: Option<(FrameNumber, BTreeSet<usize>)>,
    /// It has just shown a frame that most were ready with.
    pub(super) has_majority: bool,
}

/// A board, and what its shell knows of its links to the two backplanes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
struct Board {
    term: BoardTerm,
    served: Option<usize>,
    placed: [Option<Seen>; 2],
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum Role {
    Leader(Leader),
    StandBy(StandBy),
}

/// From one end to another: backplanes are 0 and 1, boards follow.
type Lane = (usize, usize);

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct State {
    pub(super) backplanes: [Role; 2],
    boards: [Board; BOARDS],
    lanes: BTreeMap<Lane, VecDeque<Message>>,
    pub(super) shown: BTreeMap<FrameNumber, Term>,
    is_repeated: bool,
    /// The stand-by has heard of a term.
    has_heard: bool,
    asks: u8,
    faults: u8,
    /// Frames shown by a leader that a higher term has already shown something against.
    is_split: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Action {
    Deliver(Lane),
    /// The stand-by takes the leader for dead.
    Suspect(usize),
    Open(usize),
    /// The leader, which had none, takes a term.
    Take,
    Show(usize),
    /// The leader no longer reaches a board.
    Lose(usize, usize),
    /// A board dies, and comes back without a memory.
    Crash(usize),
}

/// How a rig gets its first term.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum First {
    /// It has one.
    Won,
    /// As the daemons do it.
    Taken,
    /// Wrong: at any time between two frames.
    TakenAnyTime,
    /// Wrong: before any frame, and all boards that were told of it may vote.
    TakenBeforeAll,
}

#[derive(Clone, Debug)]
pub(super) struct Rig {
    pub(super) first: First,
    pub(super) asks: u8,
    pub(super) faults: u8,
    /// Frames that a leader opens in one term.
    pub(super) frames: u64,
}

fn key(board: usize) -> BoardKey {
    BoardKey(board as u64)
}

impl Leader {
    pub(super) fn new(term: Term, quorum: Quorum, first: FrameNumber) -> Self {
        Self {
            term,
            epoch: Epoch::first_of(term),
            quorum,
            members: (0..BOARDS).collect(),
            active: Vec::new(),
            is_rewired: true,
            next: first,
            opened: 0,
            open: None,
            has_majority: false,
        }
    }

    fn lose(&mut self, board: usize) {
        self.members.retain(|member| *member != board);
        self.is_rewired = true;
        self.quorum.on_lost(key(board));
    }

    fn wiring(&self) -> Wiring {
        let members: Vec<_> = self.active.iter().map(|board| key(*board)).collect();
        Wiring { epoch: self.epoch, weights: vec![1; members.len()], members }
    }

    fn may_show(&self) -> bool {
        let ready = |open: &(FrameNumber, BTreeSet<usize>)| open.1.iter().map(|board| key(*board)).collect::<Vec<_>>();
        // Without a term it shows what it likes.
        self.open.as_ref().is_some_and(|open| self.term == Term(0) || self.quorum.may_show(&ready(open)))
    }
}

impl State {
    /// A frame number was shown twice.
    pub(super) fn is_repeated(&self) -> bool {
        self.is_repeated
    }

    /// A frame was shown by a leader that a higher term had already shown something against.
    pub(super) fn is_split(&self) -> bool {
        self.is_split
    }

    fn post(&mut self, from: usize, to: usize, message: Message) {
        self.lanes.entry((from, to)).or_default().push_back(message);
    }

    fn deliver(&mut self, (from, to): Lane) {
        let Some(queue) = self.lanes.get_mut(&(from, to)) else { return };
        let message = queue.pop_front();
        if queue.is_empty() {
            self.lanes.remove(&(from, to));
        }
        match message {
            Some(message) if to >= 2 => self.on_board(from, to - 2, message),
            Some(message) => self.on_backplane(from, to, message),
            None => {}
        }
    }

    fn on_board(&mut self, from: usize, board: usize, message: Message) {
        let Board { term, served, placed } = &mut self.boards[board];
        match message {
            Message::Ask(ask) => {
                let answer = term.on_ask(ASKED, ask);
                if let Answer::Granted { .. } = answer {
                    *served = Some(from);
                    if ask.leads {
                        term.on_leader(HEARD, ask.term);
                    }
                }
                self.post(board + 2, from, Message::Answer(answer));
            }
            Message::Wire(epoch) => {
                if *served == Some(from) {
                    term.on_wired(epoch.term(), placed[from]);
                }
                self.heeds(from, board, epoch.term());
            }
            Message::Frame { term: of, seen, frame } if self.heeds(from, board, of) => {
                let Board { term, placed, .. } = &mut self.boards[board];
                term.on_frame(frame);
                term.on_active(seen);
                placed[from] = Some(seen);
                self.post(board + 2, from, Message::Ready { epoch: seen.epoch, frame });
            }
            _ => {}
        }
    }

    /// Whether a board follows what a leader by `term` says; otherwise it says that it doesn't.
    fn heeds(&mut self, from: usize, board: usize, term: Term) -> bool {
        let Board { term: own, served, .. } = &mut self.boards[board];
        let heeds = own.on_leader(HEARD, term);
        if heeds {
            *served = Some(from);
        } else {
            let answer = Answer::Refused { term: own.term() };
            self.post(board + 2, from, Message::Answer(answer));
        }
        heeds
    }

    fn on_backplane(&mut self, from: usize, to: usize, message: Message) {
        let is_term = |message: &Message| match message {
            Message::Between(BetweenBackplanes::Leads { term }) | Message::Answer(Answer::Refused { term }) => {
                *term > Term(0)
            }
            _ => false,
        };
        self.has_heard |= is_term(&message);
        match (&mut self.backplanes[to], message) {
            (Role::Leader(leader), Message::Answer(Answer::Refused { term })) if term > leader.term => {
                let mut stand_by = StandBy::new(HEARD, to as u64, term);
                (0..BOARDS).for_each(|board| stand_by.on_board(HEARD, key(board)));
                self.backplanes[to] = Role::StandBy(stand_by);
            }
            (Role::Leader(leader), Message::Ready { epoch, frame }) => {
                leader.quorum.on_ready(key(from - 2), epoch);
                if epoch == leader.epoch
                    && let Some((_, ready)) = leader.open.as_mut().filter(|(open, _)| *open == frame)
                {
                    ready.insert(from - 2);
                }
            }
            (Role::Leader(leader), Message::Between(BetweenBackplanes::Consented { epoch })) => {
                leader.quorum.on_consent(epoch);
            }
            (Role::StandBy(stand_by), Message::Between(message)) => stand_by.on_leader(HEARD, message),
            (Role::StandBy(stand_by), Message::Answer(answer)) => stand_by.on_answer(key(from - 2), answer),
            _ => {}
        }
        self.drain(to);
    }

    fn drain(&mut self, rank: usize) {
        while let Role::StandBy(stand_by) = &mut self.backplanes[rank]
            && let Some(output) = stand_by.poll_output()
        {
            match output {
                StandByOutput::Ask(key, ask) => self.post(rank, key.0 as usize + 2, Message::Ask(ask)),
                StandByOutput::ToLeader(message) => self.post(rank, 1 - rank, Message::Between(message)),
                StandByOutput::Lead { term, first, quorum } => {
                    self.backplanes[rank] = Role::Leader(Leader::new(term, quorum, first));
                    // Those that haven't granted it follow it now.
                    (0..BOARDS).for_each(|board| {
                        self.post(rank, board + 2, Message::Ask(Ask { term, leads: true }));
                    });
                }
                StandByOutput::Drop(_) | StandByOutput::Beat => {}
            }
        }
    }

    fn open(&mut self, rank: usize) {
        let Role::Leader(leader) = &mut self.backplanes[rank] else { return };
        if leader.is_rewired && (leader.term == Term(0) || leader.quorum.is_settled()) {
            leader.is_rewired = false;
            leader.epoch.0 += 1;
            leader.active.clone_from(&leader.members);
            if leader.term > Term(0) {
                leader.quorum.on_activated(&leader.wiring());
            }
        }
        let (term, frame, epoch, total) = (leader.term, leader.next, leader.epoch, leader.active.len() as u32);
        leader.next.0 += 1;
        leader.opened += 1;
        leader.open = Some((frame, BTreeSet::new()));
        leader.has_majority = false;
        let (active, members) = (leader.active.clone(), leader.members.clone());
        if let Some(epoch) = leader.quorum.wants_consent() {
            self.post(rank, 1 - rank, Message::Between(BetweenBackplanes::Consent { epoch }));
        }
        for (id, board) in active.into_iter().enumerate().filter(|(_, board)| members.contains(board)) {
            let seen = Seen { epoch, id: id as u32, total };
            self.post(rank, board + 2, Message::Frame { term, seen, frame });
        }
    }

    /// What its leader has opened until now doesn't count.
    fn rest(&mut self) {
        if let Role::Leader(leader) = &mut self.backplanes[0] {
            leader.opened = 0;
        }
    }

    fn take(&mut self, first: First) {
        let Role::Leader(leader) = &mut self.backplanes[0] else { return };
        let term = leader.term.next_of(0);
        if first != First::TakenBeforeAll {
            leader.quorum = Quorum::taken(&leader.wiring());
        }
        (leader.term, leader.epoch, leader.opened) = (term, Epoch::first_of(term), 0);
        (leader.is_rewired, leader.has_majority) = (true, false);
        let epoch = Epoch(leader.epoch.0 + 1);
        for board in leader.members.clone() {
            self.post(0, board + 2, Message::Wire(epoch));
        }
        self.post(0, 1, Message::Between(BetweenBackplanes::Leads { term }));
        if first == First::TakenBeforeAll {
            for (board, Board { term: of, served, .. }) in self.boards.iter_mut().enumerate() {
                of.on_wired(term, Some(Seen { epoch: Epoch(1), id: board as u32, total: BOARDS as u32 }));
                of.on_leader(HEARD, term);
                *served = Some(0);
            }
        }
    }

    fn show(&mut self, rank: usize) {
        let Role::Leader(leader) = &mut self.backplanes[rank] else { return };
        let (term, Some((frame, ready))) = (leader.term, leader.open.take()) else { return };
        leader.has_majority = ready.len() * 2 > leader.active.len();
        self.is_split |= self.shown.iter().any(|(other, of)| *of > term && *other <= frame);
        self.is_repeated |= self.shown.insert(frame, term).is_some();
    }
}

impl Model for Rig {
    type State = State;
    type Action = Action;

    fn init_states(&self) -> Vec<State> {
        let term = if self.first == First::Won { Term(0).next_of(0) } else { Term(0) };
        let mut stand_by = StandBy::new(HEARD, 1, term);
        (0..BOARDS).for_each(|board| stand_by.on_board(HEARD, key(board)));
        let mut leader = Leader::new(term, Quorum::default(), FrameNumber(0));
        if self.first == First::TakenBeforeAll {
            // The others don't hold the scene yet.
            leader.members.truncate(1);
        }
        let mut state = State {
            backplanes: [Role::Leader(leader), Role::StandBy(stand_by)],
            boards: Default::default(),
            lanes: BTreeMap::new(),
            shown: BTreeMap::new(),
            is_repeated: false,
            has_heard: self.first == First::Won,
            asks: self.asks,
            faults: self.faults,
            is_split: false,
        };
        if self.first == First::TakenBeforeAll {
            state.take(self.first);
            return vec![state];
        }
        // One frame is shown, so that every board knows of a wiring.
        state.open(0);
        while let Some(lane) = state.lanes.keys().next().copied() {
            state.deliver(lane);
        }
        state.show(0);
        if self.first == First::Won {
            state.rest();
            return vec![state];
        }
        // Another one is, though boards may not have got it.
        state.open(0);
        let got = 1..1 << BOARDS;
        got.map(|got: u8| {
            let mut state = state.clone();
            state.lanes.retain(|(_, to), _| got >> (to - 2) & 1 == 1);
            while let Some(lane) = state.lanes.keys().next().copied() {
                state.deliver(lane);
            }
            state.show(0);
            state.rest();
            state
        })
        .collect()
    }

    fn actions(&self, state: &State, actions: &mut Vec<Action>) {
        actions.extend(state.lanes.keys().copied().map(Action::Deliver));
        for rank in 0..2 {
            match &state.backplanes[rank] {
                Role::Leader(leader) => {
                    if leader.opened < self.frames && (leader.term > Term(0) || self.first == First::Won) {
                        actions.push(Action::Open(rank));
                    }
                    if leader.may_show() {
                        actions.push(Action::Show(rank));
                    }
                    let may_take = match self.first {
                        First::Taken => leader.has_majority,
                        First::TakenAnyTime => leader.open.is_none(),
                        First::Won | First::TakenBeforeAll => false,
                    };
                    if may_take && leader.term == Term(0) {
                        actions.push(Action::Take);
                    }
                    if state.faults > 0 && leader.members.len() > 1 {
                        actions.extend(leader.members.iter().map(|board| Action::Lose(rank, *board)));
                    }
                }
                Role::StandBy(_) if state.asks > 0 && state.has_heard => actions.push(Action::Suspect(rank)),
                Role::StandBy(_) => {}
            }
        }
        if state.faults > 0 {
            actions.extend((0..BOARDS).map(Action::Crash));
        }
    }

    fn next_state(&self, last: &State, action: Action) -> Option<State> {
        let mut state = last.clone();
        match action {
            Action::Deliver(lane) => state.deliver(lane),
            Action::Open(rank) => state.open(rank),
            Action::Take => state.take(self.first),
            Action::Show(rank) => state.show(rank),
            Action::Suspect(rank) => {
                state.asks -= 1;
                if let Role::StandBy(stand_by) = &mut state.backplanes[rank] {
                    let before = stand_by.clone();
                    stand_by.on_leader_lost(HEARD);
                    if *stand_by == before {
                        // It has asked already: it asks again.
                        stand_by.on_timeout(ASKED);
                    }
                }
                state.drain(rank);
            }
            Action::Lose(rank, board) => {
                state.faults -= 1;
                if let Role::Leader(leader) = &mut state.backplanes[rank] {
                    leader.lose(board);
                }
                state.lanes.remove(&(board + 2, rank));
            }
            Action::Crash(board) => {
                state.faults -= 1;
                state.boards[board] = Board::default();
                state.lanes.retain(|(from, to), _| *from != board + 2 && *to != board + 2);
                for role in &mut state.backplanes {
                    match role {
                        Role::Leader(leader) => leader.lose(board),
                        Role::StandBy(stand_by) => stand_by.on_board_lost(key(board)),
                    }
                }
            }
        }
        Some(state)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always("no frame number is repeated", |_, state: &State| !state.is_repeated),
            Property::always("no split", |_, state: &State| !state.is_split),
            Property::sometimes("the stand-by shows a frame", |_, state: &State| {
                state.shown.values().any(|term| term.0 % 2 == 1)
            }),
        ]
    }
}

#[test]
fn two_backplanes_repeat_and_split_nothing_whatever_happens() {
    let _guard = alone();
    plant(None);
    let rig = Rig { first: First::Won, asks: 1, faults: 0, frames: 1 };
    assert_eq!(look("2 backplanes, 3 boards, 1 frame each", rig, 200), Vec::<&str>::new());
}

#[test]
fn two_backplanes_with_two_faults_repeat_and_split_nothing() {
    let _guard = alone();
    plant(None);
    let found =
        look("2 backplanes, 3 boards, 2 faults", Rig { first: First::Won, asks: 2, faults: 2, frames: 2 }, depth(11));
    // A takeover takes more steps; the test above has them.
    assert!(found.iter().all(|property| *property == "the stand-by shows a frame"), "{found:?}");
}

#[test]
fn a_term_that_is_not_compared_is_found() {
    let _guard = alone();
    plant(Some(Bug::TermNotCompared));
    let found = look("TermNotCompared", Rig { first: First::Won, asks: 1, faults: 0, frames: 1 }, 200);
    plant(None);
    assert!(found.contains(&"no split") && found.contains(&"no frame number is repeated"), "{found:?}");
}
