//! How the chain grows with boards: the table of docs/chain.md, made from the cores and the codec. A table that has changed is written
//! anew with `CYCLORAMA_RENEW=1 cargo test -p cyclorama-sim --test scaling`.
#![expect(clippy::unwrap_used, reason = "a test that can't go on has failed")]

use bytes::Bytes;
use proto::chain::{BackplaneChain, BackplaneOutput, BoardChain, BoardOutput, LinkId};
use proto::codec::encode;
use proto::debug::DebugPicture;
use proto::frame::{Environment, FrameState, PixelFormat};
use proto::ids::{BoardKey, Epoch, FrameNumber, ViewId};
use proto::message::{
    BoardReport, Changes, FrameHeader, FromBoard, NeighbourMessage, Stage, StageSpan, Swap, Timeline, ToBoard,
    ToCompositor,
};
use proto::time::Time;
use proto::view::Pose;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Length prefix of a message on its stream.
const PREFIX: usize = 4;

/// A network in which everything takes one delay.
struct Rounds {
    backplane: BackplaneChain,
    boards: BTreeMap<BoardKey, BoardChain>,
    links: BTreeMap<LinkId, (BoardKey, BoardKey)>,
    next: Vec<(u32, Step)>,
    round: u32,
    messages: usize,
    bytes: usize,
    closed: Option<u32>,
}

#[derive(Clone)]
enum Step {
    ToBoard(BoardKey, proto::chain::ToBoardChain),
    ToBackplane(BoardKey, proto::chain::FromBoardChain),
    Linked(BoardKey, Epoch, BoardKey),
    Neighbour(BoardKey, LinkId, NeighbourMessage),
}

impl Rounds {
    fn new(boards: u64) -> Self {
        let mut rounds = Self {
            backplane: BackplaneChain::new(),
            boards: BTreeMap::new(),
            links: BTreeMap::new(),
            next: Vec::new(),
            round: 0,
            messages: 0,
            bytes: 0,
            closed: None,
        };
        // Only the last of these wirings is carried out.
        for key in (1..=boards).map(BoardKey) {
            while rounds.backplane.poll_output().is_some() {}
            rounds.boards.insert(key, BoardChain::new(key));
            rounds.backplane.on_join(Time(0), key, key.0.to_string());
        }
        rounds
    }

    fn send(&mut self, delays: u32, bytes: &Bytes, step: Step) {
        self.messages += 1;
        self.bytes += PREFIX + bytes.len();
        self.next.push((self.round + delays, step));
    }

    fn drain(&mut self) {
        while let Some(output) = self.backplane.poll_output() {
            match output {
                BackplaneOutput::Send(key, message) => {
                    let bytes = encode(&ToBoard::Chain(message.clone()), &[]);
                    self.send(1, &bytes, Step::ToBoard(key, message));
                }
                BackplaneOutput::Closed(_) => self.closed = Some(self.round),
                other => assert_eq!(other, BackplaneOutput::Beat, "nobody leaves"),
            }
        }
        for key in self.boards.keys().copied().collect::<Vec<_>>() {
            while let Some(output) = self.boards.get_mut(&key).unwrap().poll_output() {
                match output {
                    BoardOutput::ToBackplane(message) => {
                        let bytes = encode(&FromBoard::Chain(message), &[]);
                        self.send(1, &bytes, Step::ToBackplane(key, message));
                    }
                    // There and back.
                    BoardOutput::ConnectLeft { epoch, address } => {
                        let left = BoardKey(address.parse().unwrap());
                        self.next.push((self.round + 2, Step::Linked(key, epoch, left)));
                    }
                    BoardOutput::ToNeighbour(link, message) => {
                        let (right, left) = self.links[&link];
                        let to = if right == key { left } else { right };
                        self.send(1, &encode(&message, &[]), Step::Neighbour(to, link, message));
                    }
                    BoardOutput::Close(_) | BoardOutput::Beat => {}
                }
            }
        }
    }

    fn run(&mut self) {
        self.drain();
        while !self.next.is_empty() {
            self.round += 1;
            let due: Vec<_> = self.next.extract_if(.., |(at, _)| *at <= self.round).collect();
            for (_, step) in due {
                match step {
                    Step::ToBoard(key, message) => self.boards.get_mut(&key).unwrap().on_backplane(message),
                    Step::ToBackplane(key, message) => self.backplane.on_message(Time(0), key, message),
                    Step::Linked(key, epoch, left) => {
                        let link = LinkId(key.0);
                        self.links.insert(link, (key, left));
                        self.boards.get_mut(&key).unwrap().on_left_linked(epoch, link);
                    }
                    Step::Neighbour(key, link, message) => {
                        self.boards.get_mut(&key).unwrap().on_neighbour(link, message);
                    }
                }
            }
            self.drain();
            if self.closed == Some(self.round) {
                self.backplane.on_frame(Time(0), FrameNumber(0));
                self.drain();
            }
        }
    }
}

/// Bytes of a frame in which nothing changes but the eye: to each board, from each board, to the compositor.
fn frame_bytes(boards: u64) -> usize {
    let state = FrameState {
        frame: FrameNumber(0),
        epoch: Epoch(0),
        eye: Pose::IDENTITY,
        environment: Environment::default(),
        debug: DebugPicture::Off,
    };
    let header = FrameHeader {
        state,
        views: None,
        format: PixelFormat::default(),
        lists: Vec::new(),
        moved: Changes::NONE,
        weights: Changes::NONE,
    };
    let frame = encode(&ToBoard::Frame(header), &[]).len();
    // Every board draws a part of one view.
    let span = StageSpan { stage: Stage::Geometry, view: Some(ViewId(0)), begin_ns: 0, end_ns: 0 };
    let (report, timeline) = (BoardReport::default(), Timeline { ready_ns: 0, stages: vec![span; 7] });
    let ready = FromBoard::Ready { frame: FrameNumber(0), epoch: Epoch(0), report, timeline };
    let ready = encode(&ready, &[]).len();
    let members = (0..boards).map(BoardKey).collect();
    let swap = Swap {
        frame: FrameNumber(0),
        epoch: Epoch(0),
        complete: vec![true; 4],
        boards: members,
        preview: false,
        moment: None,
    };
    let swap = encode(&ToCompositor::Swap(swap), &[]).len();
    boards as usize * (2 * PREFIX + frame + ready) + PREFIX + swap
}

fn table() -> String {
    let mut text = String::from(
        "| boards | messages a frame | bytes a frame | messages a wiring | bytes a wiring | closed after, one-way delays |\n|---|---|---|---|---|---|\n",
    );
    for boards in [1, 4, 16, 64, 256] {
        let mut rounds = Rounds::new(boards);
        rounds.run();
        let closed = rounds.closed.expect("the wiring closes");
        let (messages, frame) = (rounds.messages, 2 * boards + 1);
        // The formulas of the text.
        assert_eq!(messages as u64, 7 * boards - 1, "messages of {boards} boards");
        assert_eq!(u64::from(closed), if boards == 1 { 2 } else { 2 * boards + 3 }, "delays of {boards} boards");
        writeln!(text, "| {boards} | {frame} | {} | {messages} | {} | {closed} |", frame_bytes(boards), rounds.bytes)
            .unwrap();
    }
    text
}

#[test]
fn the_table_in_the_docs_is_what_the_cores_do() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/chain.md");
    let docs = std::fs::read_to_string(path).unwrap();
    let (begin, end) = ("<!-- scaling -->\n", "<!-- /scaling -->");
    let (before, rest) = docs.split_once(begin).expect("the table's begin");
    let (kept, after) = rest.split_once(end).expect("the table's end");
    let made = table();
    if std::env::var_os("CYCLORAMA_RENEW").is_some() {
        std::fs::write(path, format!("{before}{begin}{made}{end}{after}")).unwrap();
    } else {
        assert_eq!(kept, made);
    }
}
