//! The core against a model of boards that does as the real ones do: pieces come behind messages, frames are drawn some time after they
//! came and only the newest, and whatever a frame names must be there when it is drawn.

use super::catalogue::Entry;
use super::*;
use proptest::prelude::*;
use proto::frame::VersionWeights;
use proto::ids::{ModelId, ObjectId};
use proto::scene::{ModelPart, ModelRow, SceneTable, SubobjectRow};
use std::collections::{BTreeSet, VecDeque};

/// A model's versions in the scene of the tests.
const VERSIONS: u32 = 3;

fn name(kind: u8, k: usize) -> ContentId {
    let mut id = [kind; 16];
    id[1..9].copy_from_slice(&(k as u64).to_be_bytes());
    ContentId(id)
}

/// `plain` subobjects of a mesh each, every other with a texture that four share; then `models` of three versions, the finest of two
/// meshes.
fn catalogue(plain: usize, models: usize, memory: impl Fn(usize) -> u64) -> Catalogue {
    let textures = (0..plain.div_ceil(4))
        .map(|k| Entry { id: name(0, k), memory: memory(k * 3 + 1), textures: [None; 2] })
        .collect();
    let worn =
        |k: usize| if k < plain && k % 2 == 1 { [Some(name(0, k / 4)), Some(name(0, k / 4))] } else { [None; 2] };
    let all = plain + models * 4;
    let meshes = (0..all).map(|k| Entry { id: name(1, k), memory: memory(k), textures: worn(k) }).collect();
    let part = |k: usize| {
        let k = k.checked_sub(plain)?;
        Some(ModelPart { model: ModelId((k / 4) as u32), version: [0, 0, 1, 2][k % 4] })
    };
    let subobjects = (0..all).map(|k| SubobjectRow {
        object: ObjectId(0),
        mesh: name(1, k),
        primitive: 0,
        layer: 0,
        part_of: part(k),
        planes: None,
    });
    let table = SceneTable {
        subobjects: subobjects.collect(),
        models: vec![ModelRow { merged: false, versions: VERSIONS }; models],
        ..SceneTable::default()
    };
    Catalogue::new(textures, meshes, &table)
}

fn ids(list: &[u32]) -> Vec<SubobjectId> {
    list.iter().map(|k| SubobjectId(*k)).collect()
}

const KEY: BoardKey = BoardKey(1);

/// A board's side.
struct Board {
    key: BoardKey,
    limit: u64,
    held: BTreeSet<ContentId>,
    bytes: u64,
    /// What waits: messages go before pieces.
    messages: VecDeque<Message>,
    pieces: VecDeque<u32>,
    /// The newest frame that has come and isn't drawn: what it names.
    frame: Option<(FrameNumber, Vec<ContentId>)>,
}

enum Message {
    Evict(Vec<ContentId>),
    Frame(FrameNumber, Vec<ContentId>),
}

impl Board {
    fn new(key: BoardKey, limit: u64) -> Self {
        let held = BTreeSet::new();
        Self { key, limit, held, bytes: 0, messages: VecDeque::new(), pieces: VecDeque::new(), frame: None }
    }

    fn take(&mut self, plan: Plan) {
        if !plan.evict.is_empty() {
            self.messages.push_back(Message::Evict(plan.evict));
        }
        self.pieces.extend(plan.send);
    }

    /// One message or piece comes; what it confirms.
    fn receive(&mut self, catalogue: &Catalogue) -> Option<ContentId> {
        match self.messages.pop_front() {
            Some(Message::Evict(ids)) => {
                for id in ids {
                    assert!(self.held.remove(&id), "only what is held is given up");
                    self.bytes -= catalogue.memory(catalogue.find(&id).unwrap());
                }
                None
            }
            Some(Message::Frame(frame, names)) => {
                self.frame = Some((frame, names));
                None
            }
            None => {
                let piece = self.pieces.pop_front()?;
                assert!(self.held.insert(catalogue.id(piece)), "nothing is sent twice");
                self.bytes += catalogue.memory(piece);
                assert!(self.bytes <= self.limit, "{} bytes of {}", self.bytes, self.limit);
                Some(catalogue.id(piece))
            }
        }
    }

    /// Draws what waits.
    fn draw(&mut self) -> Option<FrameNumber> {
        let (frame, names) = self.frame.take()?;
        for id in names {
            assert!(self.held.contains(&id), "{frame:?} names {id}, which is not here");
        }
        Some(frame)
    }
}

/// A manager with boards.
struct Rig {
    residency: Residency,
    boards: Vec<Board>,
    /// Which board draws which views.
    wiring: Vec<(BoardKey, Vec<ViewId>)>,
    wanted: Vec<Vec<SubobjectId>>,
    lists: Vec<(u64, Vec<SubobjectId>)>,
    weights: Vec<VersionWeights>,
    frame: u64,
    key: u64,
}

impl Rig {
    fn new(catalogue: Catalogue, views: usize) -> Self {
        let mut residency = Residency::new(catalogue);
        residency.set_views(views);
        let (wanted, lists) = (vec![Vec::new(); views], vec![(0, Vec::new()); views]);
        let (boards, wiring) = (Vec::new(), Vec::new());
        Self { residency, boards, wiring, wanted, lists, weights: Vec::new(), frame: 0, key: 0 }
    }

    fn join(&mut self, limit: u64, kept: &[ContentId]) {
        self.key += 1;
        let mut board = Board::new(BoardKey(self.key), limit);
        self.residency.on_board(board.key, limit, u64::MAX);
        for id in kept {
            let bytes = self.residency.catalogue().memory(self.residency.catalogue().find(id).unwrap());
            if board.bytes + bytes <= limit && board.held.insert(*id) {
                board.bytes += bytes;
            }
        }
        let ids: Vec<ContentId> = board.held.iter().copied().collect();
        assert_eq!(self.residency.on_holding(board.key, &ids, false), Ok(vec![]));
        self.boards.push(board);
    }

    /// The boards that are ready are wired, the views dealt out in turn.
    fn wire(&mut self) {
        let ready: Vec<BoardKey> =
            self.boards.iter().map(|board| board.key).filter(|key| self.residency.is_ready(*key)).collect();
        let views = self.lists.len();
        self.wiring = ready
            .iter()
            .enumerate()
            .map(|(i, key)| {
                let own = (0..views).filter(|view| view % ready.len() == i % views || i % views == *view);
                (*key, own.map(|view| ViewId(view as u32)).collect())
            })
            .collect();
        for board in &self.boards {
            let own = self.wiring.iter().find(|(key, _)| *key == board.key).map(|(_, views)| views.clone());
            self.residency.set_serves(board.key, own);
        }
    }

    fn want(&mut self, view: usize, list: &[u32]) {
        self.wanted[view] = ids(list);
        let wanted = self.wanted[view].clone();
        self.residency.set_wanted(view, &wanted);
    }

    /// Sends a frame to the boards of the wiring, less those whose queue is full; returns what it shows.
    fn send(&mut self, patience: Patience, is_full: impl Fn(BoardKey) -> bool) -> Vec<Vec<SubobjectId>> {
        self.frame += 1;
        let available = self.residency.available(&self.wiring, patience);
        let catalogue = self.residency.catalogue();
        let mixed = substitute::models(catalogue, &self.wanted, &self.weights, &available);
        let weights = mixed.map_or_else(|| self.weights.clone(), |(weights, _)| weights);
        let mut shown = Vec::new();
        for (view, wanted) in self.wanted.iter().enumerate() {
            // A selection by weights: of each model in the list, the versions that have some.
            let mut list = Vec::new();
            let mut models = BTreeSet::new();
            for subobject in wanted {
                let Some(part) = catalogue.part(*subobject) else {
                    list.push(*subobject);
                    continue;
                };
                if models.insert(part.model) {
                    let of = |k: &u32| catalogue.part(SubobjectId(*k)).filter(|other| other.model == part.model);
                    let rows = 0..self.residency.catalogue().len() as u32;
                    list.extend(rows.filter(|k| of(k).is_some_and(|p| weight(&weights, p) > 0.0)).map(SubobjectId));
                }
            }
            substitute::omit(catalogue, view, &mut list, &available);
            shown.push(list);
        }
        for (view, list) in shown.iter().enumerate() {
            if self.lists[view].1 != *list || self.lists[view].0 == 0 {
                self.lists[view] = (self.lists[view].0 + 1, list.clone());
            }
            self.residency.on_list(view, self.lists[view].0, list);
        }
        let frame = FrameNumber(self.frame);
        for (key, views) in &self.wiring {
            let Some(board) = self.boards.iter_mut().find(|board| board.key == *key && !is_full(*key)) else {
                continue;
            };
            let catalogue = self.residency.catalogue();
            let lists = views.iter().flat_map(|view| &shown[view.0 as usize]);
            let names = lists.flat_map(|id| catalogue.unit(catalogue.mesh_of(*id).unwrap())).map(|p| catalogue.id(p));
            board.messages.push_back(Message::Frame(frame, names.collect()));
            let named = views.iter().map(|view| (*view, self.lists[view.0 as usize].0)).collect();
            self.residency.on_sent(*key, frame, named);
        }
        shown
    }

    fn plan(&mut self) {
        for board in &mut self.boards {
            let plan = self.residency.plan(board.key);
            board.take(plan);
            let [limit, held, _] = self.residency.memory(board.key).unwrap();
            assert!(held <= limit, "{held} bytes of {limit}");
        }
    }

    fn receive(&mut self, k: usize) {
        if let Some(id) = self.boards[k].receive(self.residency.catalogue()) {
            assert_eq!(self.residency.on_stored(self.boards[k].key, &[id]), Ok(()));
        }
    }

    fn draw(&mut self, k: usize) {
        if let Some(frame) = self.boards[k].draw() {
            self.residency.on_ready(self.boards[k].key, frame);
        }
    }

    /// Until nothing more is sent.
    fn settle(&mut self) {
        loop {
            self.plan();
            let mut is_quiet = true;
            for k in 0..self.boards.len() {
                let board = &self.boards[k];
                is_quiet &= board.messages.is_empty() && board.pieces.is_empty() && board.frame.is_none();
                while !(self.boards[k].messages.is_empty() && self.boards[k].pieces.is_empty()) {
                    self.receive(k);
                }
                self.draw(k);
            }
            if is_quiet {
                return;
            }
        }
    }
}

fn weight(weights: &[VersionWeights], part: ModelPart) -> f32 {
    let given = weights.iter().find(|row| row.model == part.model);
    let finest = f32::from(u8::from(part.version == 0));
    given.map_or(finest, |row| row.weights[part.version as usize])
}

/// What happens to a rig.
#[derive(Clone, Debug)]
enum Step {
    Join(u64, Vec<u8>),
    Lose(u8),
    Want(u8, Vec<u32>),
    Soon(u8, u8, Vec<u32>),
    Mix(u8, u8),
    Wire,
    Frame(u8),
    Plan,
    Receive(u8),
    Draw(u8),
}

/// Number of subobjects without and of models with versions.
const PLAIN: usize = 40;
const MODELS: usize = 5;

fn list() -> impl Strategy<Value = Vec<u32>> {
    // Plain ones and finest versions; every one at most once.
    prop::collection::btree_set(0u32..(PLAIN + MODELS) as u32, 0..40).prop_map(|set| {
        let plain = PLAIN as u32;
        let finest =
            |k: u32| if k < plain { vec![k] } else { vec![plain + (k - plain) * 4, plain + (k - plain) * 4 + 1] };
        set.into_iter().flat_map(finest).collect()
    })
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        1 => (2000u64..120_000, prop::collection::vec(any::<u8>(), 0..20)).prop_map(|(limit, kept)| Step::Join(limit, kept)),
        1 => any::<u8>().prop_map(Step::Lose),
        3 => (any::<u8>(), list()).prop_map(|(view, list)| Step::Want(view, list)),
        2 => (any::<u8>(), 0u8..3, list()).prop_map(|(view, ahead, list)| Step::Soon(view, ahead, list)),
        1 => (any::<u8>(), any::<u8>()).prop_map(|(model, version)| Step::Mix(model, version)),
        2 => Just(Step::Wire),
        6 => any::<u8>().prop_map(Step::Frame),
        6 => Just(Step::Plan),
        12 => any::<u8>().prop_map(Step::Receive),
        6 => any::<u8>().prop_map(Step::Draw),
    ]
}

/// Between 1 and 4 kB, some much more.
fn size(k: usize) -> u64 {
    1024 + (k as u64 * 997) % 3000 + if k % 13 == 5 { 20_000 } else { 0 }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Boards come, go and are lost, the eye does as it likes, messages take as long as they like: no board ever holds more than its
    /// limit, every frame names only what is there when it is drawn, and in the end all that is needed and has room is there.
    #[test]
    fn frames_name_what_all_boards_hold_and_memory_is_never_exceeded(steps in prop::collection::vec(step(), 1..250)) {
        let mut rig = Rig::new(catalogue(PLAIN, MODELS, size), 2);
        rig.join(60_000, &[]);
        for step in steps {
            let boards = rig.boards.len().max(1);
            match step {
                Step::Join(limit, kept) if rig.boards.len() < 5 => {
                    let kept: Vec<ContentId> = kept.iter().map(|k| {
                        let catalogue = rig.residency.catalogue();
                        catalogue.id(u32::from(*k) % catalogue.len() as u32)
                    }).collect();
                    rig.join(limit, &kept);
                }
                Step::Lose(k) if rig.boards.len() > 1 => {
                    let board = rig.boards.remove(k as usize % boards);
                    rig.residency.on_lost(board.key);
                    rig.wiring.retain(|(key, _)| *key != board.key);
                }
                Step::Want(view, list) => rig.want(view as usize % 2, &list),
                Step::Soon(view, ahead, list) => rig.residency.set_soon(view as usize % 2, ahead.into(), &ids(&list)),
                Step::Mix(model, version) => {
                    let model = ModelId(u32::from(model) % MODELS as u32);
                    let mut weights = vec![0.0; VERSIONS as usize];
                    weights[version as usize % 3] = 0.75;
                    weights[(version as usize + 1) % 3] = 0.25;
                    rig.weights.retain(|row| row.model != model);
                    rig.weights.push(VersionWeights { model, weights });
                    rig.weights.sort_by_key(|row| row.model);
                }
                Step::Wire => rig.wire(),
                Step::Frame(full) => drop(rig.send(Patience::None, |key| key.0 % 5 == u64::from(full) % 16)),
                Step::Plan => rig.plan(),
                Step::Receive(k) => rig.receive(k as usize % boards),
                Step::Draw(k) => rig.draw(k as usize % boards),
                Step::Join(..) | Step::Lose(_) => {}
            }
        }
        rig.settle();
        for k in 0..rig.boards.len() {
            prop_assert!(rig.residency.is_ready(rig.boards[k].key), "what is needed and has room has come");
        }
    }

    /// A target is no larger than the limit, has every mesh's textures before it, and all that is needed now if that has room.
    #[test]
    fn a_target_is_what_is_needed_as_far_as_it_has_room(
        now in list(), soon in list(), limit in 1000u64..200_000,
    ) {
        let mut residency = Residency::new(catalogue(PLAIN, MODELS, size));
        let (now, soon) = (residency.need(&ids(&now)), residency.need(&ids(&soon)));
        let catalogue = residency.catalogue();
        let found = target(catalogue, limit, &[&now], &[&soon]);
        let bytes = |pieces: &[u32]| pieces.iter().map(|piece| catalogue.memory(*piece)).sum::<u64>();
        prop_assert!(bytes(&found.order) <= limit);
        prop_assert_eq!(found.order.iter().copied().collect::<BTreeSet<_>>().len(), found.order.len(), "each once");
        prop_assert_eq!(found.set.iter().collect::<Vec<_>>(), found.order.iter().copied().collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>());
        let mut come = BTreeSet::new();
        for piece in &found.order {
            come.insert(*piece);
            prop_assert!(catalogue.unit(*piece).all(|needed| come.contains(&needed)), "textures before the mesh");
        }
        let needed: BTreeSet<u32> = now.meshes.iter().flat_map(|mesh| catalogue.unit(*mesh)).collect();
        let needed: Vec<u32> = needed.into_iter().collect();
        if bytes(&needed) <= limit {
            prop_assert_eq!(found.now.iter().collect::<Vec<_>>(), needed, "and nothing else is for now");
        }
    }

    /// A model's weights keep their sum, and only versions that are everywhere have any.
    #[test]
    fn weights_move_to_versions_that_are_everywhere(held in prop::collection::btree_set(0u32..64, 0..64), fine in 0u16..=256) {
        let catalogue = catalogue(PLAIN, MODELS, size);
        let mut bits = Bits::new(catalogue.len());
        held.iter().filter(|piece| (**piece as usize) < catalogue.len()).for_each(|piece| bits.set(*piece));
        let available = Available { views: vec![Some(bits), None] };
        let fine = f32::from(fine) / 256.0;
        let weights = vec![VersionWeights { model: ModelId(2), weights: vec![0.0, fine, 1.0 - fine] }];
        let all: Vec<u32> = (0..(PLAIN + 4 * MODELS) as u32).collect();
        let lists = [ids(&all), Vec::new()];
        let Some((mixed, count)) = substitute::models(&catalogue, &lists, &weights, &available) else { return Ok(()) };
        prop_assert!(count > 0);
        for row in &mixed {
            let is_held = |version: usize| catalogue.versions(row.model.0)[version].iter().all(|mesh| available.has(&catalogue, 0, *mesh));
            let any = (0..3).any(is_held);
            prop_assert_eq!(row.weights.iter().sum::<f32>(), if any { 1.0 } else { 0.0 }, "{:?}", row);
            prop_assert!((0..3).all(|version| row.weights[version] == 0.0 || is_held(version)), "{:?}", row);
        }
    }
}

#[test]
fn the_nearest_version_stands_in_and_of_two_as_near_the_finer() {
    let catalogue = catalogue(0, 1, size);
    let shown = |held: &[usize], version: usize| {
        let mut bits = Bits::new(catalogue.len());
        for version in held {
            catalogue.versions(0)[*version].iter().for_each(|mesh| bits.set(*mesh));
        }
        let mut wanted = vec![0.0; 3];
        wanted[version] = 1.0;
        let weights = vec![VersionWeights { model: ModelId(0), weights: wanted }];
        let available = Available { views: vec![Some(bits)] };
        let mixed = substitute::models(&catalogue, &[ids(&[0, 1, 2, 3])], &weights, &available);
        mixed.map(|(rows, _)| rows[0].weights.clone())
    };
    assert_eq!(shown(&[0, 1, 2], 0), None, "what is there is shown");
    assert_eq!(shown(&[2], 0), Some(vec![0.0, 0.0, 1.0]));
    assert_eq!(shown(&[1, 2], 0), Some(vec![0.0, 1.0, 0.0]));
    assert_eq!(shown(&[0, 2], 1), Some(vec![1.0, 0.0, 0.0]));
    assert_eq!(shown(&[], 1), Some(vec![0.0; 3]), "nothing is held: nothing is shown");
}

#[test]
fn a_scene_that_has_room_comes_whole_and_what_is_needed_comes_first() {
    let mut rig = Rig::new(catalogue(200, 3, size), 1);
    rig.join(u64::MAX, &[]);
    rig.want(0, &[150, 7, 200, 201]);
    rig.plan();
    let first: Vec<u32> = rig.boards[0].pieces.iter().copied().take(4).collect();
    let catalogue = rig.residency.catalogue();
    let needed: Vec<u32> =
        [150, 7, 200, 201].iter().flat_map(|k| catalogue.unit(catalogue.mesh_of(SubobjectId(*k)).unwrap())).collect();
    assert_eq!(first, needed[..4]);
    let coming: u64 = rig.boards[0].pieces.iter().map(|piece| catalogue.memory(*piece)).sum();
    assert!(coming <= proto::limits::PIECES_IN_FLIGHT_MAX, "{coming} bytes under way");
    rig.settle();
    assert!(rig.residency.is_whole());
}

#[test]
fn what_was_not_used_for_longest_is_given_up_first() {
    let mut rig = Rig::new(catalogue(12, 0, |_| 1024), 1);
    // Meshes 0, 2, 4 … have no texture: four have room, 3 more than the frame needs.
    rig.join(4 * 1024, &[]);
    for k in [0, 2, 4, 6] {
        rig.want(0, &[k]);
        rig.settle();
        rig.wire();
        rig.send(Patience::None, |_| false);
        rig.settle();
    }
    rig.want(0, &[0]);
    rig.send(Patience::None, |_| false);
    rig.settle();
    rig.want(0, &[8]);
    rig.plan();
    let gone: Vec<ContentId> = rig.boards[0]
        .messages
        .iter()
        .flat_map(|message| match message {
            Message::Evict(ids) => ids.clone(),
            Message::Frame(..) => Vec::new(),
        })
        .collect();
    assert_eq!(gone, [name(1, 2), name(1, 4)], "a little more than must be; 0 was used again");
}

#[test]
fn lock_step_shows_the_same_whatever_was_before() {
    let limit = 30_000;
    let views: [Vec<u32>; 3] = [(0..30).collect(), (10..40).chain([40, 41]).collect(), (0..40).rev().collect()];
    let flown = |order: &[usize], boards: usize| {
        let mut rig = Rig::new(catalogue(PLAIN, MODELS, size), 1);
        for _ in 0..boards {
            rig.join(limit, &[]);
        }
        let mut shown = Vec::new();
        for k in order {
            rig.want(0, &views[*k]);
            rig.settle();
            rig.wire();
            assert_eq!(rig.wiring.len(), boards, "all are ready");
            shown = rig.send(Patience::Whole, |_| false);
            rig.settle();
        }
        shown
    };
    let alone = flown(&[2], 1);
    assert!(!alone[0].is_empty() && alone[0].len() < 40, "{} of 40", alone[0].len());
    assert_eq!(flown(&[0, 1, 2], 1), alone);
    assert_eq!(flown(&[1, 0, 2], 3), alone, "and on how many boards");
}

#[test]
fn a_board_that_says_what_cannot_be_is_told_apart() {
    let catalogue = || catalogue(4, 0, |_| 2048);
    let fresh = |limit| {
        let mut residency = Residency::new(catalogue());
        residency.on_board(KEY, limit, u64::MAX);
        residency
    };
    let mut residency = fresh(1 << 20);
    assert_eq!(residency.on_stored(KEY, &[name(1, 0)]), Err(Violation::NotSent));
    assert_eq!(residency.on_stored(KEY, &[name(9, 9)]), Err(Violation::Unknown));
    assert_eq!(residency.on_holding(KEY, &[name(9, 9), name(1, 0)], true), Ok(vec![name(9, 9)]));
    assert_eq!(residency.on_holding(KEY, &[name(1, 0)], false), Err(Violation::Unasked), "the same once more");
    let mut residency = fresh(1 << 20);
    assert_eq!(residency.on_holding(KEY, &[], false), Ok(vec![]));
    assert_eq!(residency.on_holding(KEY, &[], false), Err(Violation::Unasked));
    residency.set_wanted(0, &ids(&[0]));
    let sent = residency.plan(KEY).send;
    let id = residency.catalogue().id(sent[0]);
    assert_eq!(residency.on_stored(KEY, &[id, id]), Err(Violation::NotSent), "twice");
    assert_eq!(fresh(4000).on_holding(KEY, &[name(1, 0), name(1, 2)], false), Err(Violation::OverLimit));
    assert_eq!(
        fresh(1500).on_holding(KEY, &[name(9, 0), name(9, 1)], false),
        Err(Violation::OverLimit),
        "of another scene"
    );
    // The rig allows less than the board has: it is told to give something up, and isn't ready before.
    let mut residency = Residency::new(catalogue());
    residency.on_board(KEY, 1 << 20, 5000);
    residency.set_wanted(0, &ids(&[0]));
    let kept = [name(1, 0), name(1, 2), name(1, 3)];
    assert_eq!(residency.on_holding(KEY, &kept, false), Ok(vec![]));
    assert!(!residency.is_ready(KEY));
    let plan = residency.plan(KEY);
    assert!(!plan.evict.is_empty() && !plan.evict.contains(&name(1, 0)), "{plan:?}");
    assert!(residency.is_ready(KEY));
}
