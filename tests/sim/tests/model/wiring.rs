//! One backplane and a few boards: wirings, with boards that crash, leave and join, and ways that are cut. Whatever may happen
//! next may happen; only what goes one way between the same two ends keeps its order.

use super::{alone, depth, look};
use proto::chain::planted::{Bug, plant};
use proto::chain::{BackplaneChain, BackplaneOutput, BoardChain, BoardOutput, FromBoardChain, LinkId, ToBoardChain};
use proto::ids::{BoardKey, Epoch, FrameNumber};
use proto::message::NeighbourMessage;
use proto::time::Time;
use stateright::{Model, Property};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// No time passes: what timers do is a fact like any other.
const NOW: Time = Time(0);

#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Lane {
    ToBoard(BoardKey),
    ToBackplane(BoardKey),
    Connect(BoardKey, Epoch),
    /// To this end of a link.
    Link(LinkId, BoardKey),
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Flight {
    ToBoard(ToBoardChain),
    /// A frame of this wiring.
    Frame(Epoch),
    ToBackplane(FromBoardChain),
    Connect(BoardKey),
    Neighbour(NeighbourMessage),
    Down,
    /// The backplane hears that the link is closed.
    Lost,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct State {
    backplane: BackplaneChain,
    boards: BTreeMap<BoardKey, BoardChain>,
    links: BTreeMap<LinkId, (BoardKey, BoardKey)>,
    lanes: BTreeMap<Lane, VecDeque<Flight>>,
    next_link: u64,
    frames: u64,
    /// Pairs between which no link can be made any more.
    cut: BTreeSet<(BoardKey, BoardKey)>,
    to_join: Vec<BoardKey>,
    leaving: BTreeSet<BoardKey>,
    faults: u8,
    /// A board was to draw under a wiring in which it has no place.
    has_hole: bool,
    put_out: BTreeSet<BoardKey>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Action {
    Deliver(Lane),
    OpenFrame,
    Crash(BoardKey),
    Cut(BoardKey, BoardKey),
    Leave(BoardKey),
    Join,
}

#[derive(Clone, Debug)]
pub(super) struct Rig {
    boards: u64,
    joins: u64,
    faults: u8,
    /// Wirings after the first flight beyond which nothing is looked at: while the end of a dead board's link is under way,
    /// its neighbours may fail to reach it again and again.
    wirings: u64,
}

impl State {
    fn post(&mut self, lane: Lane, flight: Flight) {
        self.lanes.entry(lane).or_default().push_back(flight);
    }

    fn join(&mut self, key: BoardKey) {
        self.boards.insert(key, BoardChain::new(key));
        self.backplane.on_join(NOW, key, key.0.to_string());
    }

    fn end_links(&mut self, key: BoardKey) {
        let ended: Vec<_> =
            self.links.iter().filter(|(_, e)| e.0 == key || e.1 == key).map(|(l, e)| (*l, *e)).collect();
        for (link, (right, left)) in ended {
            self.links.remove(&link);
            self.post(Lane::Link(link, if right == key { left } else { right }), Flight::Down);
        }
    }

    fn drain(&mut self) {
        while let Some(output) = self.backplane.poll_output() {
            match output {
                BackplaneOutput::Send(key, message) => self.post(Lane::ToBoard(key), Flight::ToBoard(message)),
                BackplaneOutput::Released(key) => self.remove(key),
                BackplaneOutput::PutOut(key, _) => {
                    self.put_out.insert(key);
                    self.remove(key);
                }
                BackplaneOutput::Closed(_) | BackplaneOutput::Beat => {}
            }
        }
        for key in self.boards.keys().copied().collect::<Vec<_>>() {
            while let Some(output) = self.boards.get_mut(&key).and_then(BoardChain::poll_output) {
                self.carry_out(key, output);
            }
        }
    }

    fn carry_out(&mut self, key: BoardKey, output: BoardOutput) {
        match output {
            BoardOutput::ConnectLeft { epoch, address } => {
                let to = BoardKey(address.parse().unwrap());
                self.post(Lane::Connect(key, epoch), Flight::Connect(to));
            }
            BoardOutput::ToBackplane(message) => self.post(Lane::ToBackplane(key), Flight::ToBackplane(message)),
            BoardOutput::ToNeighbour(link, message) => {
                if let Some((right, left)) = self.links.get(&link) {
                    let to = if *right == key { *left } else { *right };
                    self.post(Lane::Link(link, to), Flight::Neighbour(message));
                }
            }
            BoardOutput::Close(link) => {
                if let Some((right, left)) = self.links.remove(&link) {
                    self.post(Lane::Link(link, if right == key { left } else { right }), Flight::Down);
                }
            }
            BoardOutput::Beat => {}
        }
    }

    /// A board's process is over.
    fn remove(&mut self, key: BoardKey) {
        if self.boards.remove(&key).is_some() {
            self.end_links(key);
            self.lanes.remove(&Lane::ToBoard(key));
        }
    }

    fn deliver(&mut self, lane: &Lane) {
        let Some(queue) = self.lanes.get_mut(lane) else { return };
        let flight = queue.pop_front();
        if queue.is_empty() {
            self.lanes.remove(lane);
        }
        match (lane, flight) {
            (Lane::ToBoard(key), Some(Flight::ToBoard(message))) => {
                if let Some(board) = self.boards.get_mut(key) {
                    board.on_backplane(message);
                }
            }
            (Lane::ToBoard(key), Some(Flight::Frame(epoch))) => {
                self.has_hole |= self.boards.get(key).is_some_and(|board| board.place(epoch).is_none());
            }
            (Lane::ToBackplane(key), Some(Flight::ToBackplane(message))) => {
                self.backplane.on_message(NOW, *key, message);
            }
            (Lane::ToBackplane(key), Some(Flight::Lost)) => self.backplane.on_lost(NOW, *key),
            (Lane::Connect(from, epoch), Some(Flight::Connect(to))) => self.connect(*from, *epoch, to),
            (Lane::Link(link, key), Some(flight)) => {
                let Some(board) = self.boards.get_mut(key) else { return };
                match flight {
                    Flight::Neighbour(message) => board.on_neighbour(*link, message),
                    _ => board.on_link_lost(None, Some(*link)),
                }
            }
            _ => {}
        }
    }

    fn connect(&mut self, from: BoardKey, epoch: Epoch, to: BoardKey) {
        let is_cut = self.cut.contains(&(from, to)) || !self.boards.contains_key(&to);
        let Some(board) = self.boards.get_mut(&from) else { return };
        if is_cut {
            board.on_link_lost(Some(epoch), None);
        } else {
            let link = LinkId(self.next_link);
            self.next_link += 1;
            self.links.insert(link, (from, to));
            board.on_left_linked(epoch, link);
        }
    }

    fn open_frame(&mut self) {
        self.frames += 1;
        let Some(wiring) = self.backplane.on_frame(NOW, FrameNumber(self.frames)).cloned() else { return };
        self.drain();
        for key in wiring.members {
            if self.boards.contains_key(&key) {
                self.post(Lane::ToBoard(key), Flight::Frame(wiring.epoch));
            }
        }
    }

    fn is_quiet(&self) -> bool {
        self.lanes.is_empty() && !self.backplane.has_closed()
    }

    fn is_whole(&self) -> bool {
        let present: BTreeSet<_> = self.boards.keys().copied().collect();
        let members =
            self.backplane.active().map(|wiring| wiring.members.iter().copied().collect()).unwrap_or_default();
        present == members
    }
}

/// Two boards that both have a place in the same wiring agree on it, and aren't at the same one.
fn places_agree(state: &State) -> bool {
    let Some(wiring) = state.backplane.active() else { return true };
    let places: Vec<_> = state.boards.values().filter_map(|board| board.place(wiring.epoch)).collect();
    let ids: BTreeSet<_> = places.iter().map(|place| place.id).collect();
    ids.len() == places.len() && places.iter().all(|place| place.weights == wiring.weights)
}

fn nobody_is_blamed(state: &State) -> bool {
    state.put_out.iter().all(|key| state.cut.iter().any(|(a, b)| a == key || b == key))
}

impl Model for Rig {
    type State = State;
    type Action = Action;

    fn init_states(&self) -> Vec<State> {
        let mut state = State {
            backplane: BackplaneChain::new(),
            boards: BTreeMap::new(),
            links: BTreeMap::new(),
            lanes: BTreeMap::new(),
            next_link: 0,
            frames: 0,
            cut: BTreeSet::new(),
            to_join: (0..self.joins).map(|i| BoardKey(self.boards + 1 + i)).collect(),
            leaving: BTreeSet::new(),
            faults: self.faults,
            has_hole: false,
            put_out: BTreeSet::new(),
        };
        // A rig that flies.
        for key in 1..=self.boards {
            state.join(BoardKey(key));
            state.drain();
        }
        while let Some(lane) = state.lanes.keys().next().cloned() {
            state.deliver(&lane);
            state.drain();
        }
        state.open_frame();
        state.drain();
        while let Some(lane) = state.lanes.keys().next().cloned() {
            state.deliver(&lane);
            state.drain();
        }
        assert!(state.is_whole(), "the rig flies before anything goes wrong");
        vec![state]
    }

    fn actions(&self, state: &State, actions: &mut Vec<Action>) {
        actions.extend(state.lanes.keys().cloned().map(Action::Deliver));
        if state.backplane.has_closed() {
            actions.push(Action::OpenFrame);
        }
        if !state.to_join.is_empty() {
            actions.push(Action::Join);
        }
        if state.faults > 0 {
            let keys: Vec<_> = state.boards.keys().copied().collect();
            for (i, key) in keys.iter().enumerate() {
                actions.push(Action::Crash(*key));
                if !state.leaving.contains(key) {
                    actions.push(Action::Leave(*key));
                }
                if let Some(other) = keys.get(i + 1) {
                    actions.push(Action::Cut(*other, *key));
                }
            }
        }
    }

    fn next_state(&self, last: &State, action: Action) -> Option<State> {
        let mut state = last.clone();
        match action {
            Action::Deliver(lane) => state.deliver(&lane),
            Action::OpenFrame => state.open_frame(),
            Action::Crash(key) => {
                state.faults -= 1;
                state.remove(key);
                state.post(Lane::ToBackplane(key), Flight::Lost);
            }
            Action::Cut(from, to) => {
                state.faults -= 1;
                state.cut.insert((from, to));
                let cut = state.links.iter().find(|(_, ends)| **ends == (from, to)).map(|(link, _)| *link);
                if let Some(link) = cut {
                    state.links.remove(&link);
                    state.post(Lane::Link(link, from), Flight::Down);
                    state.post(Lane::Link(link, to), Flight::Down);
                }
            }
            Action::Leave(key) => {
                state.faults -= 1;
                state.leaving.insert(key);
                state.backplane.on_leave(NOW, key);
            }
            Action::Join => {
                let key = state.to_join.pop()?;
                state.join(key);
            }
        }
        state.drain();
        Some(state)
    }

    fn within_boundary(&self, state: &State) -> bool {
        state.backplane.epoch().0 <= self.boards + self.wirings
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always("one place each", |_, state| places_agree(state)),
            Property::always("no hole", |_, state: &State| !state.has_hole),
            Property::always("nobody put out without cause", |_, state| nobody_is_blamed(state)),
            Property::always("whole again when all is quiet", |_, state: &State| !state.is_quiet() || state.is_whole()),
            Property::sometimes("every fault has happened", |_, state: &State| state.faults == 0),
        ]
    }
}

#[test]
fn three_boards_with_two_faults_are_right_to_depth_eleven() {
    let _guard = alone();
    plant(None);
    let rig = Rig { boards: 3, joins: 0, faults: 2, wirings: 4 };
    assert_eq!(look("3 boards, 2 faults", rig, depth(11)), Vec::<&str>::new());
}

#[test]
fn five_boards_with_two_faults_are_right_to_depth_seven() {
    let _guard = alone();
    plant(None);
    let rig = Rig { boards: 5, joins: 0, faults: 2, wirings: 4 };
    assert_eq!(look("5 boards, 2 faults", rig, depth(7)), Vec::<&str>::new());
}

#[test]
fn two_boards_with_a_fault_are_whole_again_whatever_happens() {
    let _guard = alone();
    plant(None);
    let rig = Rig { boards: 2, joins: 0, faults: 1, wirings: 2 };
    assert_eq!(look("2 boards, 1 fault, 2 wirings", rig, 60), Vec::<&str>::new());
}

#[test]
fn planted_bugs_in_wirings_are_found() {
    let _guard = alone();
    for (bug, wrong) in
        [(Bug::OldPlaceKept, "nobody put out without cause"), (Bug::AcknowledgementsNotAwaited, "no hole")]
    {
        plant(Some(bug));
        let found = look(&format!("{bug:?}"), Rig { boards: 3, joins: 0, faults: 1, wirings: 2 }, 16);
        plant(None);
        assert!(found.contains(&wrong), "{bug:?}: {found:?}");
    }
}
