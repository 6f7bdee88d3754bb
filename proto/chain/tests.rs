//! The two ends of the chain wired together in memory: every message is encoded and decoded on its way, links take a
//! random time, and boards come and go by a seed.

mod terms;

use super::*;
use crate::codec;
use crate::message::NeighbourMessage;
use crate::time::Time;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::time::Duration;

/// What is under way.
#[derive(Clone, Debug)]
enum Flight {
    ToBoard(BoardKey, ToBoardChain),
    ToBackplane(BoardKey, FromBoardChain),
    Connect { from: BoardKey, to: BoardKey, epoch: Epoch },
    Neighbour { to: BoardKey, link: LinkId, message: NeighbourMessage },
    Down { at: BoardKey, link: LinkId },
}

struct World {
    now: Time,
    backplane: BackplaneChain,
    boards: BTreeMap<BoardKey, BoardChain>,
    /// Both ends of each link: the right board (which opened it) and the left one.
    links: BTreeMap<LinkId, (BoardKey, BoardKey)>,
    flights: Vec<Flight>,
    next_link: u64,
    seed: u64,
    released: Vec<BoardKey>,
    put_out: Vec<BoardKey>,
}

fn copy<M: Serialize + serde::de::DeserializeOwned>(message: &M) -> M {
    codec::decode(codec::encode(message, &[])).unwrap().0
}

impl World {
    fn new(seed: u64) -> Self {
        Self {
            now: Time(0),
            backplane: BackplaneChain::new(),
            boards: BTreeMap::new(),
            links: BTreeMap::new(),
            flights: Vec::new(),
            next_link: 0,
            seed,
            released: Vec::new(),
            put_out: Vec::new(),
        }
    }

    fn random(&mut self, below: usize) -> usize {
        self.seed = self.seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.seed >> 33) as usize % below
    }

    fn join(&mut self, key: u64) {
        let key = BoardKey(key);
        self.boards.insert(key, BoardChain::new(key));
        assert!(self.backplane.on_join(self.now, key, key.0.to_string()), "room in the row");
        self.drain();
    }

    fn kill(&mut self, key: u64) {
        let key = BoardKey(key);
        self.boards.remove(&key);
        let dead: Vec<_> = self.links.iter().filter(|(_, e)| e.0 == key || e.1 == key).map(|(l, e)| (*l, *e)).collect();
        for (link, (right, left)) in dead {
            self.links.remove(&link);
            self.flights.push(Flight::Down { at: if right == key { left } else { right }, link });
        }
        self.backplane.on_lost(self.now, key);
        self.drain();
    }

    fn drain(&mut self) {
        while let Some(output) = self.backplane.poll_output() {
            match output {
                BackplaneOutput::Send(key, message) => self.flights.push(Flight::ToBoard(key, copy(&message))),
                BackplaneOutput::Released(key) => self.released.push(key),
                BackplaneOutput::PutOut(key, _) => self.put_out.push(key),
                BackplaneOutput::Closed(_) | BackplaneOutput::Beat => {}
            }
        }
        let keys: Vec<_> = self.boards.keys().copied().collect();
        for key in keys {
            while let Some(output) = self.boards.get_mut(&key).unwrap().poll_output() {
                match output {
                    BoardOutput::ConnectLeft { epoch, address } => {
                        let to = BoardKey(address.parse().unwrap());
                        self.flights.push(Flight::Connect { from: key, to, epoch });
                    }
                    BoardOutput::ToBackplane(message) => self.flights.push(Flight::ToBackplane(key, copy(&message))),
                    BoardOutput::ToNeighbour(link, message) => {
                        if let Some((right, left)) = self.links.get(&link) {
                            let to = if *right == key { *left } else { *right };
                            self.flights.push(Flight::Neighbour { to, link, message: copy(&message) });
                        }
                    }
                    BoardOutput::Beat => {}
                    BoardOutput::Close(link) => {
                        if let Some((right, left)) = self.links.remove(&link) {
                            self.flights.push(Flight::Down { at: if right == key { left } else { right }, link });
                        }
                    }
                }
            }
        }
    }

    /// Delivers one random message; those between the same two ends keep their order.
    fn step(&mut self) -> bool {
        if self.flights.is_empty() {
            return false;
        }
        let chosen = self.random(self.flights.len());
        let lane = lane_of(&self.flights[chosen]);
        let first = self.flights.iter().position(|f| lane_of(f) == lane).unwrap();
        match self.flights.remove(first) {
            Flight::ToBoard(key, message) => {
                if let Some(board) = self.boards.get_mut(&key) {
                    board.on_backplane(message);
                }
            }
            Flight::ToBackplane(key, message) => {
                if self.boards.contains_key(&key) {
                    self.backplane.on_message(self.now, key, message);
                }
            }
            Flight::Connect { from, to, epoch } => {
                let link = LinkId(self.next_link);
                self.next_link += 1;
                if self.boards.contains_key(&to) && self.boards.contains_key(&from) {
                    self.links.insert(link, (from, to));
                    self.boards.get_mut(&from).unwrap().on_left_linked(epoch, link);
                } else if let Some(board) = self.boards.get_mut(&from) {
                    board.on_link_lost(Some(epoch), None);
                }
            }
            Flight::Neighbour { to, link, message } => {
                if let Some(board) = self.boards.get_mut(&to) {
                    board.on_neighbour(link, message);
                }
            }
            Flight::Down { at, link } => {
                if let Some(board) = self.boards.get_mut(&at) {
                    board.on_link_lost(None, Some(link));
                }
            }
        }
        self.drain();
        true
    }

    fn settle(&mut self) {
        for _ in 0..100_000 {
            if !self.step() {
                return;
            }
        }
        panic!("messages without end: {:?}", self.flights.iter().take(10).collect::<Vec<_>>());
    }

    fn places(&mut self, frame: u64) -> Vec<u64> {
        self.backplane.on_frame(self.now, FrameNumber(frame));
        self.drain();
        self.settle();
        let wiring = self.backplane.active().expect("a wiring is in effect").clone();
        for (i, key) in wiring.members.iter().enumerate() {
            let place = self.boards[key].place(wiring.epoch).expect("every member knows its place");
            assert_eq!(place.id.0 as usize, i);
            assert_eq!(place.weights.len(), wiring.members.len());
        }
        wiring.members.iter().map(|key| key.0).collect()
    }
}

fn lane_of(flight: &Flight) -> (u8, u64, u64) {
    match flight {
        Flight::ToBoard(key, _) => (0, key.0, 0),
        Flight::ToBackplane(key, _) => (1, key.0, 0),
        Flight::Connect { from, epoch, .. } => (2, from.0, epoch.0),
        Flight::Neighbour { to, link, .. } => (3, to.0, link.0),
        Flight::Down { at, link } => (3, at.0, link.0),
    }
}

#[test]
fn three_boards_learn_their_places_from_each_other() {
    let mut world = World::new(1);
    for key in [10, 20, 30] {
        world.join(key);
    }
    world.settle();
    assert_eq!(world.places(0), [10, 20, 30]);
}

#[test]
fn a_board_that_joins_later_is_counted_from_the_next_frame_on() {
    let mut world = World::new(2);
    world.join(1);
    world.settle();
    assert_eq!(world.places(0), [1]);
    world.join(2);
    world.settle();
    assert_eq!(world.backplane.active().unwrap().members.len(), 1, "the frame in flight keeps its wiring");
    assert_eq!(world.places(1), [1, 2]);
}

#[test]
fn the_row_closes_up_when_the_middle_board_is_killed() {
    let mut world = World::new(3);
    for key in 1..=5 {
        world.join(key);
    }
    world.settle();
    world.places(0);
    world.kill(3);
    world.settle();
    assert_eq!(world.places(1), [1, 2, 4, 5]);
    assert!(world.put_out.is_empty(), "nobody else is blamed: {:?}", world.put_out);
}

#[test]
fn a_board_that_leaves_is_released_only_when_others_draw_its_share() {
    let mut world = World::new(4);
    world.join(1);
    world.join(2);
    world.settle();
    world.places(0);
    world.backplane.on_leave(world.now, BoardKey(1));
    world.drain();
    world.settle();
    assert!(world.released.is_empty(), "it still draws the frame in flight");
    assert_eq!(world.places(1), [2]);
    assert_eq!(world.released, [BoardKey(1)]);
}

/// Board 2 is deaf: whatever it should hear is lost. Only `beating` boards are heard from. Returns when it is put out.
fn put_out_deaf_board(beating: &[u64]) -> (World, Duration) {
    let mut world = World::new(5);
    for key in 1..=3 {
        world.join(key);
    }
    while world.put_out.is_empty() {
        while !world.flights.is_empty() {
            world
                .flights
                .retain(|f| !matches!(f, Flight::ToBoard(BoardKey(2), _) | Flight::Neighbour { to: BoardKey(2), .. }));
            world.step();
        }
        world.now = world.backplane.next_timeout().expect("somebody is watched");
        for key in beating {
            world.backplane.on_heard(world.now, BoardKey(*key));
        }
        world.backplane.on_timeout(world.now);
        world.drain();
    }
    let took = world.now.since(Time(0));
    assert_eq!(world.put_out, [BoardKey(2)], "after {took:?}");
    world.kill(2);
    world.settle();
    assert_eq!(world.places(0), [1, 3]);
    (world, took)
}

#[test]
fn a_silent_board_is_put_out_within_four_periods_and_the_rest_goes_on() {
    let (_, took) = put_out_deaf_board(&[1, 3]);
    assert!(took < 4 * PERIOD, "{took:?}");
}

#[test]
fn a_board_that_beats_but_never_takes_its_place_is_tried_elsewhere_and_then_put_out() {
    let (_, took) = put_out_deaf_board(&[1, 2, 3]);
    assert!(took >= Duration::from_millis(900), "it had two wirings: {took:?}");
}

#[test]
fn two_boards_that_cannot_reach_each_other_are_kept_apart() {
    let mut world = World::new(8);
    for key in 1..=4 {
        world.join(key);
    }
    // Board 3 can't connect to board 2.
    while !world.flights.is_empty() {
        let is_cut = |f: &Flight| matches!(f, Flight::Connect { from: BoardKey(3), to: BoardKey(2), .. });
        for flight in world.flights.extract_if(.., |f| is_cut(f)).collect::<Vec<_>>() {
            let Flight::Connect { epoch, .. } = flight else { unreachable!() };
            world.boards.get_mut(&BoardKey(3)).unwrap().on_link_lost(Some(epoch), None);
            world.drain();
        }
        world.step();
    }
    assert_eq!(world.places(0), [1, 2, 4, 3]);
    assert!(world.put_out.is_empty());
}

#[test]
fn a_board_may_join_anywhere_in_the_row() {
    let mut world = World::new(9);
    world.join(1);
    world.join(2);
    world.boards.insert(BoardKey(3), BoardChain::new(BoardKey(3)));
    assert!(world.backplane.on_join_at(world.now, BoardKey(3), "3".into(), 1));
    world.drain();
    world.settle();
    assert_eq!(world.places(0), [1, 3, 2]);
}

#[test]
fn a_board_that_hangs_gets_less_and_is_then_put_out_but_not_when_all_are_late() {
    let mut world = World::new(10);
    for key in 1..=3 {
        world.join(key);
    }
    world.settle();
    world.places(0);
    for _ in 0..20 {
        world.backplane.on_frame_over(world.now, &[BoardKey(1), BoardKey(2), BoardKey(3)]);
    }
    assert!(world.put_out.is_empty() && !world.backplane.has_closed(), "the load is to blame");
    for misses in 1..=8 {
        world.backplane.on_frame_over(world.now, &[BoardKey(2)]);
        world.drain();
        world.settle();
        if misses == 4 {
            world.places(misses);
            assert_eq!(world.backplane.active().unwrap().weights, [2, 1, 2], "it is given less");
        }
        assert_eq!(world.put_out.is_empty(), misses < 8, "{misses} misses");
    }
}

#[test]
fn of_two_boards_the_one_that_hangs_is_put_out_if_the_other_has_time_to_spare() {
    for (cost_ms, is_put_out) in [(2, true), (14, false)] {
        let mut world = World::new(10);
        (1..=2).for_each(|key| world.join(key));
        world.settle();
        world.places(0);
        world.backplane.set_period(Duration::from_millis(16));
        let mut number = 0;
        let mut frame = |world: &mut World, missing: &[u64]| {
            for key in (1..=2).filter(|key| !missing.contains(key)) {
                let epoch = world.backplane.active().unwrap().epoch;
                world.backplane.on_ready(world.now, BoardKey(key), epoch, Duration::from_millis(cost_ms));
            }
            let missing: Vec<_> = missing.iter().map(|key| BoardKey(*key)).collect();
            world.backplane.on_frame_over(world.now, &missing);
            world.drain();
            world.settle();
            number += 1;
            world.places(number);
        };
        (0..20).for_each(|_| frame(&mut world, &[]));
        (0..20).for_each(|_| frame(&mut world, &[1, 2]));
        assert!(world.put_out.is_empty(), "both were late");
        (0..7).for_each(|_| frame(&mut world, &[2]));
        assert!(world.put_out.is_empty());
        (0..3).for_each(|_| frame(&mut world, &[2]));
        assert_eq!(world.put_out, if is_put_out { vec![BoardKey(2)] } else { Vec::new() }, "{cost_ms} ms");
    }
}

#[test]
fn a_board_that_lies_about_its_place_is_put_out() {
    let mut world = World::new(6);
    world.join(1);
    world.join(2);
    let epoch = world.backplane.epoch();
    world.backplane.on_message(world.now, BoardKey(2), FromBoardChain::Placed { epoch, id: 0 });
    world.drain();
    assert_eq!(world.put_out, [BoardKey(2)]);
}

/// Found by simulation: a hello that came twice over a link closed it, and the row was wired anew.
#[test]
fn a_repeated_hello_does_not_close_the_link() {
    let mut board = BoardChain::new(BoardKey(1));
    let hello = |epoch| NeighbourMessage::Hello { key: BoardKey(2), epoch: Epoch(epoch) };
    board.on_neighbour(LinkId(7), hello(3));
    board.on_neighbour(LinkId(7), hello(3));
    board.on_backplane(ToBoardChain::Wire { epoch: Epoch(3), left: Left::Backplane, right: Some(BoardKey(2)) });
    for epoch in [3, 2, 4] {
        board.on_neighbour(LinkId(7), hello(epoch));
    }
    board.on_backplane(ToBoardChain::Id { epoch: Epoch(3), id: 0 });
    let said: Vec<_> = std::iter::from_fn(|| board.poll_output()).collect();
    assert!(said.contains(&BoardOutput::ToNeighbour(LinkId(7), NeighbourMessage::Id { epoch: Epoch(3), id: 1 })));
    assert!(!said.iter().any(|output| matches!(output, BoardOutput::Close(_))), "{said:?}");
}

#[test]
fn a_frame_swaps_when_all_are_ready_and_repeats_views_when_they_are_not() {
    let period = Duration::from_millis(16);
    let wiring = Wiring { epoch: Epoch(1), members: vec![BoardKey(1), BoardKey(2)], weights: vec![1, 1] };
    let mut clock = FrameClock::new(ClockMode::RealTime { period }, FrameNumber(0), 2);
    assert!(clock.wants_open(Time(0)));
    let frame = clock.on_open(Time(0), &wiring);
    clock.on_ready(Time(1), BoardKey(1), frame, Epoch(1));
    assert_eq!(clock.poll_output(), None);
    clock.on_ready(Time(2), BoardKey(2), frame, Epoch(1));
    let Some(ClockOutput::Swap { swap, late, .. }) = clock.poll_output() else { panic!("swapped at once") };
    assert_eq!((swap.complete, late), (vec![true, true], false));

    let tick = clock.next_timeout().unwrap();
    let frame = clock.on_open(tick, &wiring);
    clock.on_ready(tick, BoardKey(1), frame, Epoch(1));
    clock.on_ready(tick, BoardKey(2), FrameNumber(0), Epoch(1));
    clock.on_timeout(clock.next_timeout().unwrap());
    let Some(ClockOutput::Swap { swap, late, .. }) = clock.poll_output() else { panic!("swapped at the deadline") };
    assert_eq!((swap.complete, late), (vec![true, false], true), "the second view repeats");
}

/// Frames of two boards, each at its tick; those of `late` are never ready with theirs. Returns when the last was opened.
fn fly(clock: &mut FrameClock, wiring: &Wiring, frames: usize, late: &[BoardKey]) -> Time {
    let mut opened = Time(0);
    for _ in 0..frames {
        opened = clock.next_timeout().unwrap();
        let frame = clock.on_open(opened, wiring);
        for key in wiring.members.iter().filter(|key| !late.contains(key)) {
            clock.on_ready(opened, *key, frame, wiring.epoch);
        }
        clock.on_timeout(clock.next_timeout().unwrap());
        assert!(clock.is_idle(), "frame {frame} is swapped at its end");
    }
    opened
}

#[test]
fn frames_that_were_late_for_a_dead_board_alone_do_not_slow_the_others_down() {
    let period = Duration::from_millis(16);
    let [a, b] = [BoardKey(1), BoardKey(2)];
    let wiring = Wiring { epoch: Epoch(1), members: vec![a, b], weights: vec![1, 1] };
    let clock = || {
        let mut clock = FrameClock::new(ClockMode::RealTime { period }, FrameNumber(0), 2);
        fly(&mut clock, &wiring, 5, &[]);
        clock
    };
    let mut silent = clock();
    let opened = fly(&mut silent, &wiring, 4, &[b]);
    assert_eq!(silent.divider(), 2, "half of the boards are late");
    let now = silent.next_timeout().unwrap() - Duration::from_millis(20);
    silent.on_lost(now, b);
    assert_eq!(silent.divider(), 1);
    let tick = silent.next_timeout().unwrap();
    assert!(tick >= now && tick <= opened + period * 2, "{now:?} {tick:?}");
    // Its successor isn't blamed for it either.
    let alone = Wiring { epoch: Epoch(2), members: vec![a], weights: vec![1] };
    fly(&mut silent, &alone, 2, &[a]);
    assert_eq!(silent.divider(), 1, "two late frames are no three");

    let mut busy = clock();
    fly(&mut busy, &wiring, 4, &[a, b]);
    busy.on_lost(busy.next_timeout().unwrap(), b);
    assert_eq!(busy.divider(), 2, "the other one was late too");
    let mut slow = clock();
    fly(&mut slow, &wiring, 4, &[b]);
    fly(&mut slow, &wiring, 1, &[]);
    slow.on_lost(slow.next_timeout().unwrap(), b);
    assert_eq!(slow.divider(), 2, "it could follow at half the rate");
}

#[test]
fn a_frame_that_has_waited_for_boards_gets_half_a_period_or_more() {
    let period = Duration::from_millis(10);
    let wiring = Wiring { epoch: Epoch(1), members: vec![BoardKey(1)], weights: vec![1] };
    for (late_ms, next_ms) in [(0, 10), (4, 10), (6, 16), (9, 19), (12, 22)] {
        let mut clock = FrameClock::new(ClockMode::RealTime { period }, FrameNumber(0), 1);
        let opened = Time(0) + Duration::from_millis(late_ms);
        clock.on_open(opened, &wiring);
        assert_eq!(clock.next_timeout(), Some(Time(next_ms * 1_000_000)), "opened {late_ms} ms after its tick");
    }
}

#[test]
fn a_tick_that_passes_without_a_frame_uses_up_its_number() {
    let period = Duration::from_millis(16);
    let wiring = Wiring { epoch: Epoch(1), members: vec![BoardKey(1)], weights: vec![1] };
    let mut clock = FrameClock::new(ClockMode::RealTime { period }, FrameNumber(0), 1);
    assert_eq!(clock.on_idle(Time(0)), FrameNumber(0));
    assert!(!clock.wants_open(Time(0)) && clock.is_idle());
    let tick = clock.next_timeout().unwrap();
    assert_eq!(tick, Time(0) + period, "ticks keep their grid");
    assert!(clock.wants_open(tick));
    let frame = clock.on_open(tick, &wiring);
    assert_eq!(frame, FrameNumber(1));
    clock.on_ready(tick, BoardKey(1), frame, Epoch(1));
    assert!(matches!(clock.poll_output(), Some(ClockOutput::Swap { swap, .. }) if swap.frame == frame));
}

#[test]
fn lock_step_draws_a_frame_again_when_its_board_died() {
    let both = Wiring { epoch: Epoch(1), members: vec![BoardKey(1), BoardKey(2)], weights: vec![1, 1] };
    let one = Wiring { epoch: Epoch(2), members: vec![BoardKey(1)], weights: vec![1] };
    let mut clock = FrameClock::new(ClockMode::LockStep, FrameNumber(5), 1);
    clock.on_open(Time(0), &both);
    clock.on_lost(Time(1), BoardKey(2));
    clock.on_ready(Time(2), BoardKey(1), FrameNumber(5), Epoch(1));
    assert_eq!(clock.poll_output(), None, "half a picture is not shown");
    assert!(clock.on_rewired());
    assert_eq!(clock.on_open(Time(3), &one), FrameNumber(5), "the same frame again");
    clock.on_ready(Time(4), BoardKey(1), FrameNumber(5), Epoch(2));
    assert!(matches!(clock.poll_output(), Some(ClockOutput::Swap { late: false, .. })));
    assert!(!clock.wants_open(Time(5)), "the compositor hasn't shown it");
    clock.on_presented(FrameNumber(5));
    assert!(clock.wants_open(Time(6)));
}

/// Found by review: a board that had said ready and died before the others left a swap that nobody could carry out.
#[test]
fn lock_step_draws_again_when_a_board_dies_after_it_was_ready() {
    let both = Wiring { epoch: Epoch(1), members: vec![BoardKey(1), BoardKey(2)], weights: vec![1, 1] };
    let mut clock = FrameClock::new(ClockMode::LockStep, FrameNumber(0), 1);
    clock.on_open(Time(0), &both);
    clock.on_ready(Time(1), BoardKey(1), FrameNumber(0), Epoch(1));
    clock.on_lost(Time(2), BoardKey(1));
    clock.on_ready(Time(3), BoardKey(2), FrameNumber(0), Epoch(1));
    assert_eq!(clock.poll_output(), None, "its tiles went with its link");
    assert!(clock.on_rewired() && clock.is_redraw());

    // And one that dies while the compositor still waits for its tiles.
    clock.on_open(Time(4), &both);
    for key in [1, 2] {
        clock.on_ready(Time(5), BoardKey(key), FrameNumber(0), Epoch(1));
    }
    assert!(clock.poll_output().is_some() && !clock.is_idle());
    clock.on_lost(Time(6), BoardKey(2));
    assert!(clock.is_idle() && clock.is_redraw() && clock.next_frame() == FrameNumber(0));
}

proptest! {
    #[test]
    fn whatever_comes_and_goes_the_row_settles_on_the_boards_that_are_there(
        seed in any::<u64>(),
        events in prop::collection::vec((0u64..8, any::<bool>(), 0usize..40), 1..40),
    ) {
        let mut world = World::new(seed);
        let mut present = std::collections::BTreeSet::new();
        let mut incarnation = 0;
        let mut keys = BTreeMap::new();
        for (name, join, steps) in events {
            if join && !present.contains(&name) {
                incarnation += 1;
                keys.insert(name, incarnation);
                world.join(incarnation);
                present.insert(name);
            } else if !join && present.remove(&name) {
                world.kill(keys[&name]);
            }
            for _ in 0..steps {
                world.step();
            }
        }
        world.settle();
        prop_assert!(world.put_out.is_empty(), "nobody is put out without cause: {:?}", world.put_out);
        if !present.is_empty() {
            let mut members = world.places(1);
            members.sort_unstable();
            let mut expected: Vec<_> = present.iter().map(|name| keys[name]).collect();
            expected.sort_unstable();
            prop_assert_eq!(members, expected);
        }
    }
}
