//! A real board against a backplane that the test plays: what it must not say.

use crate::program::{HANG, cyclorama};
use bytes::Bytes;
use proto::chain::{FromBoardChain, Left, ToBoardChain};
use proto::codec::{self, encode};
use proto::debug::DebugPicture;
use proto::frame::{Environment, FrameState, PixelFormat};
use proto::ids::{BoardKey, ContentId, Epoch, FrameNumber};
use proto::message::{Changes, FrameHeader, FramePayload, FromBoard, Hello, ListBase, ListUpdate, ToBoard};
use proto::scene::SceneTable;
use proto::view::{Pose, Samples, Tangents, View, ViewSetup};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Stdio};

struct Backplane {
    board: Child,
    link: TcpStream,
}

impl Drop for Backplane {
    fn drop(&mut self) {
        let _ = self.board.kill();
        let _ = self.board.wait();
    }
}

impl Backplane {
    /// Starts a board, and takes it with an empty scene.
    fn new() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let args = ["channel", "--backplane", &address, "--threads", "1", "--memory-limit", "64"];
        let board = cyclorama().args(args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let (mut link, _) = listener.accept().unwrap();
        link.set_read_timeout(Some(HANG)).unwrap();
        link.write_all(&codec::preamble(codec::VERSIONS)).unwrap();
        link.read_exact(&mut [0; codec::PREAMBLE_LEN]).unwrap();
        let mut backplane = Self { board, link };
        backplane.hear::<Hello>();
        backplane.say(&ToBoard::Welcome { key: BoardKey(7) }, &[]);
        let table = codec::encode_table(&SceneTable::default());
        backplane.say(&ToBoard::Table { scene: ContentId::of(&table) }, &table);
        backplane.until(|message| matches!(message, FromBoard::Loaded { .. }));
        backplane
    }

    fn say(&mut self, message: &ToBoard, payload: &[u8]) {
        let bytes = encode(message, payload);
        self.link.write_all(&(bytes.len() as u32).to_le_bytes()).unwrap();
        self.link.write_all(&bytes).unwrap();
    }

    fn hear<M: serde::de::DeserializeOwned>(&mut self) -> M {
        let mut length = [0; 4];
        self.link.read_exact(&mut length).unwrap();
        let mut bytes = vec![0; u32::from_le_bytes(length) as usize];
        self.link.read_exact(&mut bytes).unwrap();
        codec::decode(Bytes::from(bytes)).unwrap().0
    }

    /// Everything that the board says up to what is looked for.
    fn until(&mut self, is_it: impl Fn(&FromBoard) -> bool) -> Vec<FromBoard> {
        let mut heard = Vec::new();
        loop {
            let message = self.hear();
            let is_last = is_it(&message);
            heard.push(message);
            if is_last {
                return heard;
            }
        }
    }

    fn wire(&mut self, epoch: Epoch, from: FrameNumber) {
        self.say(&ToBoard::Chain(ToBoardChain::Wire { epoch, left: Left::Backplane, right: None }), &[]);
        self.say(&ToBoard::Chain(ToBoardChain::Id { epoch, id: 0 }), &[]);
        self.until(|message| matches!(message, FromBoard::Chain(FromBoardChain::Acknowledge { .. })));
        self.say(&ToBoard::Chain(ToBoardChain::Activate { epoch, frame: from, weights: vec![1] }), &[]);
    }

    fn frame(&mut self, frame: FrameNumber, epoch: Epoch) {
        let row = View::row(1, 64, 48, Tangents::symmetric(45.0, 64, 48), Samples::One);
        let state = FrameState {
            frame,
            epoch,
            eye: Pose::IDENTITY,
            environment: Environment::default(),
            debug: DebugPicture::Off,
        };
        let none = Changes { base: ListBase::Empty, count: 0 };
        let views: Vec<ViewSetup> = row.into_iter().map(ViewSetup::new).collect();
        let lists: Vec<ListUpdate> = Vec::new();
        let header =
            FrameHeader { state, views: Some(views), format: PixelFormat::Srgb8, lists, moved: none, weights: none };
        let payload = FramePayload { moved: Vec::new(), weights: Vec::new(), scripts: Vec::new() };
        self.say(&ToBoard::Frame(header), &payload.encode());
    }
}

fn ready(heard: &[FromBoard]) -> Vec<(FrameNumber, Epoch)> {
    let of = |message: &FromBoard| match message {
        FromBoard::Ready { frame, epoch, .. } => Some((*frame, *epoch)),
        _ => None,
    };
    heard.iter().filter_map(of).collect()
}

#[test]
fn a_board_is_not_ready_with_a_frame_under_a_wiring_that_it_has_no_place_in() {
    let mut backplane = Backplane::new();
    // Nobody has wired it.
    backplane.frame(FrameNumber(1), Epoch(3));
    backplane.wire(Epoch(4), FrameNumber(2));
    // A place of another epoch is none either.
    backplane.frame(FrameNumber(2), Epoch(3));
    backplane.frame(FrameNumber(3), Epoch(4));
    let is_last = |message: &FromBoard| matches!(message, FromBoard::Ready { frame: FrameNumber(3), .. });
    assert_eq!(ready(&backplane.until(is_last)), [(FrameNumber(3), Epoch(4))]);
}

#[test]
fn a_board_that_hears_no_beat_any_more_connects_anew() {
    let mut backplane = Backplane::new();
    backplane.say(&ToBoard::Alive, &[]);
    // It beats until it has had enough of silence; then the link ends.
    let mut all = Vec::new();
    backplane.link.read_to_end(&mut all).unwrap();
    assert!(!all.is_empty(), "boards beat");
}
