//! What fuzzing begins with: every message once, with every kind of payload, a few bytes each.

use bytes::Bytes;
use glam::{DAffine3, DQuat, DVec3};
use proto::chain::{
    Answer as Grant, Ask, BetweenBackplanes, FromBoardChain, Left, NoStandBy, Seen, Side, ToBoardChain,
};
use proto::codec::{VERSIONS, encode, encode_ids, encode_mesh, encode_table, encode_texture, preamble};
use proto::debug::DebugPicture;
use proto::frame::{Environment, FrameRecord, FrameState, Moved, PixelFormat, VersionWeights};
use proto::ids::{BoardKey, ContentId, Epoch, FrameNumber, ModelId, ObjectId, PlaneId, SubobjectId, Term, ViewId};
use proto::list::ListEncoder;
use proto::message::{
    BoardReport, Changes, FrameHeader, FramePayload, FromBoard, FromCompositor, Hello, ListBase, ListUpdate, Moment,
    NeighbourMessage, Role, Stage, StageSpan, Swap, TileMessage, TileSink, Timeline, ToBoard, ToCompositor,
};
use proto::piece::{PieceKind, SliceHeader};
use proto::pose::{Answer, EntityPose, EntityRef, ModelWeights, PosePacket};
use proto::scene::{
    Alpha, Box3, Filter, LightKind, LightRow, Material, Mesh, ModelPart, ModelRow, NO_PLANE, ObjectRow, PlaneRow,
    SceneTable, Sphere, SubobjectRow, TRANSFORM_IDENTITY, Texture, TextureUse, Wrap,
};
use proto::view::{Pose, Samples, Tangents, View, ViewSetup};
use serde::Serialize;

const FRAME: FrameNumber = FrameNumber(41);
const EPOCH: Epoch = Epoch(3);
const KEY: BoardKey = BoardKey(2);
const CONTENT: ContentId = ContentId([7; 16]);
const SEEN: Seen = Seen { epoch: EPOCH, id: 1, total: 3 };

/// Inputs to begin with: the target, a name, the bytes.
#[derive(Debug, Default)]
struct Made(Vec<(&'static str, String, Vec<u8>)>);

impl Made {
    fn bytes(&mut self, target: &'static str, name: &str, bytes: impl Into<Vec<u8>>) {
        self.0.push((target, name.to_owned(), bytes.into()));
    }

    fn messages<M: Serialize>(&mut self, target: &'static str, name: &str, messages: &[M]) {
        for (i, message) in messages.iter().enumerate() {
            self.bytes(target, &format!("{name}-{i}"), encode(message, &[]));
        }
    }
}

/// All that is made: the target, a name, the bytes.
pub fn made() -> Vec<(&'static str, String, Vec<u8>)> {
    let mut made = Made::default();
    to_board(&mut made);
    from_board(&mut made);
    show(&mut made);
    peers(&mut made);
    lists(&mut made);
    pieces(&mut made);
    poses(&mut made);
    #[cfg(feature = "scenes")]
    crate::scenes::made(|target, name, bytes| made.bytes(target, name, bytes));
    made.0
}

fn views() -> Vec<ViewSetup> {
    let row = View::row(2, 96, 64, Tangents::symmetric(40.0, 96, 64), Samples::Four);
    row.into_iter().map(|view| ViewSetup { at: Some([5, 0]), ..ViewSetup::new(view) }).collect()
}

fn to_board(made: &mut Made) {
    let epoch = EPOCH;
    let left = Left::Board { key: KEY, address: "10.0.0.1:7000".into() };
    made.messages(
        "to-board",
        "chain",
        &[
            ToBoard::Chain(ToBoardChain::Wire { epoch, left: Left::Backplane, right: None }),
            ToBoard::Chain(ToBoardChain::Wire { epoch, left, right: Some(KEY) }),
            ToBoard::Chain(ToBoardChain::Id { epoch, id: 0 }),
            ToBoard::Chain(ToBoardChain::Activate { epoch, frame: FRAME, weights: vec![1, 8, 3] }),
        ],
    );
    let sink = |key, views, format| TileSink { key: BoardKey(key), address: "10.0.0.2:7402".into(), views, format };
    let sinks = vec![sink(8, Vec::new(), PixelFormat::Srgb8), sink(9, vec![ViewId(1)], PixelFormat::LinearF32)];
    made.messages(
        "to-board",
        "other",
        &[
            ToBoard::Welcome { key: KEY },
            ToBoard::Refused { reason: "full".into() },
            ToBoard::Compositors(sinks),
            ToBoard::Compositors(Vec::new()),
            ToBoard::Goodbye,
            ToBoard::Alive,
            ToBoard::Ask(Ask { term: Term(3), leads: true }),
            ToBoard::Neighbours(vec![(KEY, "pc2".into())]),
        ],
    );
    let head = SliceHeader { id: CONTENT, kind: PieceKind::Texture, total: 9, offset: 4 };
    made.bytes("to-board", "piece", encode(&ToBoard::Piece(head), b"slice"));
    made.bytes("to-board", "evict", encode(&ToBoard::Evict, &encode_ids(&[CONTENT; 2])));
    made.bytes("to-board", "table", encode(&ToBoard::Table { scene: CONTENT }, &encode_table(&table())));
    let payload = FramePayload {
        moved: vec![Moved { object: ObjectId(4), transform: DAffine3::from_translation(DVec3::Y) }],
        weights: vec![VersionWeights { model: ModelId(1), weights: vec![0.25, 0.75] }],
        scripts: vec![4, 0, 3, 10],
    };
    let header = FrameHeader {
        state: state(),
        views: Some(views()),
        format: PixelFormat::LinearF32,
        lists: vec![ListUpdate { view: ViewId(1), base: ListBase::Last, script_bytes: 4 }],
        moved: Changes { base: ListBase::Empty, count: 1 },
        weights: Changes { base: ListBase::Last, count: 1 },
    };
    made.bytes("to-board", "frame", encode(&ToBoard::Frame(header.clone()), &payload.encode()));
    let still = FrameHeader { views: None, lists: Vec::new(), moved: Changes::NONE, weights: Changes::NONE, ..header };
    made.messages("to-board", "still", &[ToBoard::Frame(still)]);
}

fn state() -> FrameState {
    let environment = Environment { visibility_m: Some(2e4), fog: Some([0.5; 3]), ..Environment::default() };
    FrameState { frame: FRAME, epoch: EPOCH, eye: Pose::IDENTITY, environment, debug: DebugPicture::Levels }
}

fn from_board(made: &mut Made) {
    let (epoch, frame) = (EPOCH, FRAME);
    let report = BoardReport { raster_ns: 5_000_000, ..BoardReport::default() };
    let span = StageSpan { stage: Stage::Queue, view: Some(ViewId(0)), begin_ns: 5_000, end_ns: 9_000 };
    let timeline = Timeline { ready_ns: 6_000_000, stages: vec![span] };
    made.messages(
        "from-board",
        "message",
        &[
            FromBoard::Loaded { scene: CONTENT },
            FromBoard::Chain(FromBoardChain::Placed { epoch, id: 1 }),
            FromBoard::Chain(FromBoardChain::Total { epoch, total: 3 }),
            FromBoard::Chain(FromBoardChain::Acknowledge { epoch, id: 1, total: 3 }),
            FromBoard::Chain(FromBoardChain::LinkLost { epoch, side: Side::Right }),
            FromBoard::Ready { frame, epoch, report, timeline },
            FromBoard::Leave,
            FromBoard::Alive,
            FromBoard::Answer(Grant::Granted { term: Term(3), wiring: Some(SEEN), newest: frame }),
            FromBoard::Answer(Grant::Refused { term: Term(2) }),
        ],
    );
    let names = encode_ids(&[CONTENT; 3]);
    let holding = FromBoard::Holding { term: Term(2), scene: Some(CONTENT), more: true };
    made.bytes("from-board", "holding", encode(&holding, &names));
    made.bytes("from-board", "stored", encode(&FromBoard::Stored, &names));
}

fn show(made: &mut Made) {
    let (epoch, frame) = (EPOCH, FRAME);
    made.messages("tiles", "message", &[TileMessage::Hello { key: KEY }, TileMessage::Done { frame, epoch }]);
    for (name, format) in [("srgb", PixelFormat::Srgb8), ("linear", PixelFormat::LinearF32)] {
        let (view, size) = (ViewId(0), (34, 3));
        let tiles = TileMessage::Tiles { frame, epoch, view, count: 2, size, format };
        // The second one is two pixels wide.
        let mut payload = vec![0, 0, 0, 0, 1, 0, 0, 0];
        payload.resize(payload.len() + 34 * 3 * format.bytes(), 200);
        made.bytes("tiles", name, encode(&tiles, &payload));
    }
    let moment = Some(Moment { at_ns: 1_700_000_000_000_000_000, lead_ns: 3_000_000 });
    let swap = Swap { frame, epoch, complete: vec![true, false], boards: vec![KEY], preview: true, moment };
    let weights = vec![VersionWeights { model: ModelId(0), weights: vec![1.0] }];
    let record =
        FrameRecord { eye: Pose::IDENTITY, environment: state().environment, weights, debug: DebugPicture::Off };
    made.messages(
        "compositor",
        "to",
        &[
            ToCompositor::Welcome,
            ToCompositor::Refused { reason: "another one is there".into() },
            ToCompositor::Views(views()),
            ToCompositor::Record { frame, record },
            ToCompositor::Swap(swap),
            ToCompositor::Goodbye,
            ToCompositor::Boards(vec![(KEY, "pc2".into())]),
        ],
    );
    made.messages(
        "compositor",
        "from",
        &[
            FromCompositor::Presented { frame, stitch_ns: 900_000, at_ns: 1_700_000_000_000_000_000 },
            FromCompositor::Preview { frame },
            FromCompositor::Missing { frame },
        ],
    );
}

fn peers(made: &mut Made) {
    let epoch = EPOCH;
    made.messages(
        "peers",
        "neighbour",
        &[
            NeighbourMessage::Hello { key: KEY, epoch },
            NeighbourMessage::Id { epoch, id: 2 },
            NeighbourMessage::Total { epoch, total: 3 },
        ],
    );
    made.messages(
        "peers",
        "backplanes",
        &[
            BetweenBackplanes::Leads { term: Term(2) },
            BetweenBackplanes::Consent { epoch },
            BetweenBackplanes::Consented { epoch },
            BetweenBackplanes::Refused { why: NoStandBy::Taken },
            BetweenBackplanes::Stands { highest: Term(1) },
        ],
    );
    let listen = "10.0.0.3:7402".into();
    let hello = |role| Hello { name: "pc2".into(), role };
    made.messages(
        "peers",
        "hello",
        &[
            hello(Role::Board { threads: 2, link: "10.0.0.2:7001".into(), memory: 1 << 30, drawn: CONTENT }),
            hello(Role::Compositor {
                listen,
                format: PixelFormat::Srgb8,
                records: true,
                views: vec![ViewId(0), ViewId(2)],
            }),
            hello(Role::Backplane),
        ],
    );
}

fn lists(made: &mut Made) {
    let old: Vec<_> = (0..40).map(|i| SubobjectId(i * 7 % 257)).collect();
    let mut turned = old.clone();
    turned.rotate_left(9);
    turned.insert(3, SubobjectId(299));
    for (name, new) in [("same", old.clone()), ("turned", turned), ("new", vec![SubobjectId(5), SubobjectId(298)])] {
        let mut script = vec![old.len() as u8];
        ListEncoder::default().encode(&old, &new, &mut script);
        made.bytes("lists", name, script);
    }
}

fn mesh() -> Mesh {
    let texture = TextureUse {
        texture: CONTENT,
        set: 0,
        transform: TRANSFORM_IDENTITY,
        wrap_u: Wrap::Mirror,
        wrap_v: Wrap::Clamp,
        magnify: Filter::Nearest,
    };
    Mesh {
        origin: DVec3::new(1.0, 2.0, 3.0),
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        normals: vec![[0.0, 0.0, 1.0]; 3],
        colors: vec![[1.0, 0.5, 0.25, 1.0]; 3],
        texcoords: vec![vec![[0.5; 2]; 3]],
        triangles: vec![[0, 1, 2]],
        face_numbers: vec![7],
        material: Material { base_texture: Some(texture), alpha: Alpha::Mask { cutoff: 0.5 }, ..Material::default() },
        sphere: Sphere { centre: DVec3::ZERO, radius: 1.0 },
        bounds: Box3 { min: DVec3::ZERO, max: DVec3::ONE },
    }
}

fn table() -> SceneTable {
    let part_of = Some(ModelPart { model: ModelId(0), version: 1 });
    let light = |kind| LightRow { kind, intensity: [1.0, 2.0, 3.0], position: DVec3::X, direction: DVec3::NEG_Y };
    let subobject =
        SubobjectRow { object: ObjectId(0), mesh: CONTENT, primitive: 5, layer: -2, part_of, planes: Some(0) };
    SceneTable {
        objects: vec![ObjectRow { transform: DAffine3::from_rotation_translation(DQuat::IDENTITY, DVec3::X) }],
        subobjects: vec![subobject, SubobjectRow { part_of: None, planes: None, ..subobject }],
        models: vec![ModelRow { merged: true, versions: 2 }],
        planes: vec![PlaneRow { object: ObjectId(0), normal: DVec3::Y, offset: 3.0 }],
        face_planes: vec![PlaneId(0).0, NO_PLANE],
        lights: vec![
            light(LightKind::Directional),
            light(LightKind::Point { range: None }),
            light(LightKind::Spot { range: Some(9.0), inner_cos: 0.9, outer_cos: 0.8 }),
        ],
    }
}

fn pieces(made: &mut Made) {
    let bare = Mesh { normals: Vec::new(), colors: Vec::new(), texcoords: Vec::new(), ..mesh() };
    made.bytes("pieces", "mesh", encode_mesh(&mesh()));
    made.bytes("pieces", "mesh-bare", encode_mesh(&bare));
    made.bytes("pieces", "texture", encode_texture(&Texture { width: 2, height: 1, texels: vec![[1, 2, 3, 4]; 2] }));
    made.bytes("pieces", "table", encode_table(&table()));
    made.bytes("pieces", "table-empty", encode_table(&SceneTable::default()));
    // Bytes of the whole; what is wrong with a slice, its length, its content.
    made.bytes("slices", "whole", [&[5, 0, 0, 2][..], b"ab", &[0, 3], b"cde"].concat());
    made.bytes("slices", "two", [&[2, 0, 0, 2][..], b"ab", &[0, 2], b"cd"].concat());
    made.bytes("slices", "wrong", [&[9, 0, 0, 2][..], b"ab", &[8, 2], b"cd"].concat());
}

fn poses(made: &mut Made) {
    let entity = |entity| EntityPose { entity, pose: Pose::IDENTITY };
    let packet = PosePacket {
        sequence: 7,
        answer: true,
        eye: Pose { position: DVec3::new(1.0, 2.0, 3.0), orientation: DQuat::IDENTITY },
        lens: Some(Tangents { left: -1.0, right: 1.0, bottom: -0.5, top: 0.5 }),
        entities: vec![entity(EntityRef::Number(4)), entity(EntityRef::NameHash(9))],
        models: vec![ModelWeights { name: 3, weights: vec![0.25, 0.75] }],
    };
    let bare = PosePacket { answer: false, lens: None, entities: Vec::new(), models: Vec::new(), ..packet.clone() };
    made.bytes("poses", "packet", packet.encode());
    made.bytes("poses", "packet-bare", bare.encode());
    made.bytes("poses", "answer", Answer { lock_step: true, sequence: 9, frame: 3 }.encode());
    let frame = |bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes()[..], bytes].concat();
    let opening = preamble(VERSIONS);
    let frames = [&[3][..], &opening, &frame(b"abc"), &frame(b""), &frame(&[1; 40])].concat();
    made.bytes("stream", "frames", frames);
    made.bytes("stream", "large", [&[1][..], &opening, &Bytes::from_static(&[255, 1, 0, 0]), &[0; 9]].concat());
    made.bytes("stream", "other", [&[1][..], b"GET / HTTP/1.1\r\n", b"\0"].concat());
}
