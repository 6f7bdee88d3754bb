//! Peers with good keys that say they are somebody else: no board can speak for another, nor a board for a compositor.

use crate::keys::{Authority, Daemon, manager};
use crate::program::{HANG, stats, wait_for};
use ::link::{Arrival, Expected, Listener, NodeRole, Stream, Trust};
use proto::chain::{FromBoardChain, Left, Side, ToBoardChain};
use proto::frame::{PixelFormat, REFERENCE_TILE};
use proto::ids::{BoardKey, Epoch};
use proto::limits;
use proto::link::{self, Link};
use proto::message::{FromBoard, Hello, NeighbourMessage, Role, TileMessage, ToBoard, ToCompositor};
use serde::Serialize;
use std::net::SocketAddr;

/// The backplane of a rig whose only other daemon is the one under test.
struct Backplane {
    listener: Listener,
    address: String,
}

/// At any port of this machine.
async fn listen(trust: Trust) -> Listener {
    Listener::bind(SocketAddr::from(([127, 0, 0, 1], 0)), trust).await.unwrap()
}

impl Backplane {
    async fn open(authority: &Authority) -> Self {
        let listener = listen(trust(authority, NodeRole::Manager, "desk")).await;
        let address = listener.local_addr().unwrap().to_string();
        Self { listener, address }
    }

    async fn greet(&mut self) -> (Link<Stream>, Hello, ::link::Place) {
        let Arrival::Peer(incoming) = self.listener.next().await else { panic!("nobody else comes") };
        let greeting = |stream: Stream| async {
            let mut opened = link::open(stream, limits::BULK_MESSAGE_MAX).await?;
            let (hello, _) = link::expect::<Hello>(&mut opened).await?;
            Ok((opened, hello))
        };
        let ((opened, hello), place) = incoming.greet(HANG, greeting).await.unwrap();
        (opened, hello, place)
    }
}

fn trust(authority: &Authority, role: NodeRole, name: &str) -> Trust {
    Trust::with_keys(&authority.issue(role.name(), name), role).unwrap()
}

async fn say<M: Serialize>(opened: &mut Link<Stream>, message: &M) {
    link::send(opened, message, &[]).await.unwrap();
}

/// Opens a link with these keys and says this.
async fn knock<M: Serialize>(keys: &Trust, address: &str, role: NodeRole, says: &M) -> Link<Stream> {
    let stream = keys.connect(address, &Expected::any(role)).await.unwrap();
    let mut opened = link::open(stream, limits::CONTROL_MESSAGE_MAX).await.unwrap();
    say(&mut opened, says).await;
    opened
}

/// A real board, with keys of the name `first`.
fn first_board(authority: &Authority, backplane: &Backplane) -> Daemon {
    let keys = authority.issue("board", "first");
    let link = ["--backplane", &backplane.address, "--keys", keys.to_str().unwrap()];
    Daemon::start(&[&["channel", "--threads", "1"][..], &link].concat())
}

/// Waits until the other side has closed.
async fn closes(opened: &mut Link<Stream>) {
    let closing = async { while let Ok(Some(_)) = link::receive::<NeighbourMessage>(opened).await {} };
    tokio::time::timeout(HANG, closing).await.expect("it is closed");
}

#[tokio::test]
async fn a_neighbour_must_have_the_certificate_of_the_board_that_it_says_it_is() {
    let authority = Authority::new();
    let [second, other] = ["second", "other"].map(|name| trust(&authority, NodeRole::Board, name));
    let mut backplane = Backplane::open(&authority).await;
    let _board = first_board(&authority, &backplane);
    let (mut board, hello, _place) = backplane.greet().await;
    let Role::Board { link: address, .. } = hello.role else { panic!("it is a board") };

    let epoch = Epoch(1);
    let wire = ToBoardChain::Wire { epoch, left: Left::Backplane, right: Some(BoardKey(2)) };
    say(&mut board, &ToBoard::Welcome { key: BoardKey(1) }).await;
    say(&mut board, &ToBoard::Neighbours(vec![(BoardKey(2), "second".into())])).await;
    say(&mut board, &ToBoard::Chain(wire)).await;
    say(&mut board, &ToBoard::Chain(ToBoardChain::Id { epoch, id: 0 })).await;

    let second_says = NeighbourMessage::Hello { key: BoardKey(2), epoch };
    closes(&mut knock(&other, &address, NodeRole::Board, &second_says).await).await;
    let mut right = knock(&second, &address, NodeRole::Board, &second_says).await;
    let (id, _) = link::expect::<NeighbourMessage>(&mut right).await.unwrap();
    assert_eq!(id, NeighbourMessage::Id { epoch, id: 1 });
    // Nor can it be another afterwards.
    say(&mut right, &NeighbourMessage::Hello { key: BoardKey(3), epoch: Epoch(2) }).await;
    closes(&mut right).await;
}

#[tokio::test]
async fn a_board_takes_no_place_from_a_left_neighbour_that_is_another() {
    let authority = Authority::new();
    let mut backplane = Backplane::open(&authority).await;
    let _board = first_board(&authority, &backplane);
    let (mut board, _, _place) = backplane.greet().await;

    let mut other = listen(trust(&authority, NodeRole::Board, "other")).await;
    let address = other.local_addr().unwrap().to_string();
    let epoch = Epoch(1);
    say(&mut board, &ToBoard::Welcome { key: BoardKey(1) }).await;
    say(&mut board, &ToBoard::Neighbours(vec![(BoardKey(2), "second".into())])).await;
    let left = Left::Board { key: BoardKey(2), address };
    say(&mut board, &ToBoard::Chain(ToBoardChain::Wire { epoch, left, right: None })).await;

    let Arrival::Peer(incoming) = other.next().await else { panic!("it is let in") };
    let greeting = |stream: Stream| async { link::open(stream, limits::CONTROL_MESSAGE_MAX).await };
    assert!(incoming.greet(HANG, greeting).await.is_err(), "the board doesn't speak with it");
    loop {
        let (message, _) = link::expect::<FromBoard>(&mut board).await.unwrap();
        if let FromBoard::Chain(message) = message {
            assert_eq!(message, FromBoardChain::LinkLost { epoch, side: Side::Left });
            return;
        }
    }
}

#[tokio::test]
async fn tiles_are_taken_from_the_board_alone_whose_they_are() {
    let authority = Authority::new();
    let [first, second] = ["first", "second"].map(|name| trust(&authority, NodeRole::Board, name));
    let mut backplane = Backplane::open(&authority).await;
    let keys = authority.issue("compositor", "wall");
    let compositor =
        Daemon::start(&["compositor", "--backplane", &backplane.address, "--keys", keys.to_str().unwrap()]);
    let (mut opened, hello, _place) = backplane.greet().await;
    let Role::Compositor { listen: address, .. } = hello.role else { panic!("it is a compositor") };
    say(&mut opened, &ToCompositor::Welcome).await;

    let first_says = TileMessage::Hello { key: BoardKey(1) };
    // It is quicker than the backplane's word of it.
    let mut right = knock(&first, &address, NodeRole::Compositor, &first_says).await;
    let names = vec![(BoardKey(1), "first".into()), (BoardKey(2), "second".into())];
    say(&mut opened, &ToCompositor::Boards(names)).await;
    closes(&mut knock(&second, &address, NodeRole::Compositor, &first_says).await).await;
    compositor.says("with the certificate of board second");
    let waiting = link::receive::<TileMessage>(&mut right);
    let is_open = tokio::time::timeout(std::time::Duration::from_millis(1), waiting).await.is_err();
    assert!(is_open, "the right one has kept its link");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_board_does_not_pass_for_a_compositor_nor_for_a_manager_nor_the_reverse() {
    let authority = Authority::new();
    let (_manager, backplane, console) = manager(Some(&authority.issue("manager", "desk")));
    let address = backplane.to_string();
    let [board, compositor] =
        [(NodeRole::Board, "pc1"), (NodeRole::Compositor, "wall")].map(|(role, name)| trust(&authority, role, name));
    let says = |role: Role| Hello { name: "impostor".into(), role };
    let as_board = says(Role::Board { threads: 1, link: "127.0.0.1:1".into(), memory: 1 << 30, drawn: REFERENCE_TILE });
    let (listen, format) = ("127.0.0.1:1".into(), PixelFormat::Srgb8);
    let as_compositor = says(Role::Compositor { listen, format, records: false, views: Vec::new() });
    closes(&mut knock(&board, &address, NodeRole::Manager, &as_compositor).await).await;
    closes(&mut knock(&compositor, &address, NodeRole::Manager, &as_board).await).await;
    closes(&mut knock(&board, &address, NodeRole::Manager, &says(Role::Backplane)).await).await;
    let other = trust(&authority, NodeRole::Manager, "spare");
    closes(&mut knock(&other, &address, NodeRole::Manager, &as_board).await).await;
    let reasons = [
        "it says that it is a compositor, with the certificate of board pc1",
        "it says that it is a board, with the certificate of compositor wall",
        "it says that it is a manager, with the certificate of board pc1",
        "it says that it is a board, with the certificate of manager spare",
    ];
    wait_for("all refusals in the log", || {
        let events = stats(console)?["events"].to_string();
        reasons.iter().all(|reason| events.contains(reason)).then_some(())
    });
}
