//! Rubbish on every port of a flying rig: it is counted and dropped, and the rig goes on.

use crate::program::Rig;
use proto::chain::Answer;
use proto::codec::{self, encode_ids};
use proto::frame::REFERENCE_TILE;
use proto::ids::{ContentId, Term};
use proto::limits;
use proto::message::{FromBoard, Hello, Role};
use std::io::{Read, Write};
use std::net::{TcpStream, UdpSocket};

fn flying() -> (Rig, std::net::SocketAddr, std::net::SocketAddr) {
    let rig = Rig::start(&["--views", "1", "--boards", "2", "--size", "96x64", "--samples", "1"]);
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(5));
    // The boards' command lines have the backplane's address, the host's has the pose port.
    let argument = |words: &[&str], option: &str| {
        let pid = rig.children(words)[0];
        let command = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap();
        let mut args = command.split('\0').skip_while(|arg| *arg != option);
        args.nth(1).unwrap().parse().unwrap()
    };
    let (backplane, pose) = (argument(&["channel"], "--backplane"), argument(&["host"], "--to"));
    (rig, backplane, pose)
}

fn goes_on(rig: &Rig) {
    let frames = |stats: &serde_json::Value| stats["frames"].as_u64().unwrap();
    let now = frames(&rig.stats().unwrap());
    let stats = rig.wait("more frames", |stats| frames(stats) > now + 10);
    assert_eq!(stats["boards"], 2, "{stats}");
}

/// Bytes from a fixed seed.
fn noise(len: usize) -> Vec<u8> {
    let mut state = 7u64;
    (0..len)
        .map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 56) as u8
        })
        .collect()
}

#[test]
fn a_garbage_client_on_the_backplane_is_counted_and_dropped() {
    let (rig, backplane, _) = flying();
    for rubbish in [&b"GET / HTTP/1.1\r\n\r\n"[..], &noise(5000)] {
        let mut stream = TcpStream::connect(backplane).unwrap();
        // The manager may close while we still write.
        let _ = stream.write_all(rubbish);
        let _ = stream.read_to_end(&mut Vec::new());
    }
    // A right preamble and then a frame that claims four gigabytes.
    let mut stream = TcpStream::connect(backplane).unwrap();
    stream.write_all(&codec::preamble(codec::VERSIONS)).unwrap();
    let _ = stream.write_all(&[0xff; 64]);
    let _ = stream.read_to_end(&mut Vec::new());
    rig.wait("three dropped connections", |stats| stats["dropped"]["connections"] == 3);
    goes_on(&rig);
}

#[test]
fn a_peer_of_another_version_is_refused_by_both_versions_names() {
    let (rig, backplane, _) = flying();
    let mut stream = TcpStream::connect(backplane).unwrap();
    let theirs = codec::VersionRange { min: 7, max: 9 };
    stream.write_all(&codec::preamble(theirs)).unwrap();
    let mut answer = [0; codec::PREAMBLE_LEN];
    stream.read_exact(&mut answer).unwrap();
    let error = codec::agree(theirs, &answer).unwrap_err().to_string();
    let ours = codec::VERSIONS.max;
    let says_both = error.contains("versions 7 to 9") && error.contains(&format!("version {ours}"));
    assert!(says_both, "the peer can tell: {error}");
    let stats = rig.wait("the refusal", |stats| stats["dropped"]["connections"] == 1);
    let events = stats["events"].to_string();
    let said = format!("we speak version {ours}, the other side speaks versions 7 to 9");
    assert!(events.contains(&said), "{events}");
    goes_on(&rig);
}

#[test]
fn random_pose_packets_are_counted_and_the_flight_goes_on() {
    let (rig, _, pose) = flying();
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    for len in [0, 1, 16, 71, 72, 200, 1400] {
        socket.send_to(&noise(len), pose).unwrap();
    }
    let mut nan = b"CYCP\x01\x00\x00\x00".to_vec();
    nan.resize(72, 0xff);
    nan[12..14].fill(0);
    socket.send_to(&nan, pose).unwrap();
    rig.wait("eight dropped packets", |stats| stats["dropped"]["pose_packets"] == 8);
    goes_on(&rig);
}

#[test]
fn a_second_compositor_is_refused_and_told_why() {
    let (rig, backplane, _) = flying();
    let output = crate::program::run(&["compositor", "--backplane", &backplane.to_string()]);
    assert_eq!(output.status.code(), Some(1));
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(error.contains("refused this compositor: this rig has a compositor already"), "{error}");
    goes_on(&rig);
}

/// What a board says first.
fn hello(memory: u64) -> Vec<u8> {
    let role = Role::Board { threads: 1, link: "127.0.0.1:1".into(), memory, drawn: REFERENCE_TILE };
    framed(&codec::encode(&Hello { name: "impostor".into(), role }, &[]))
}

#[test]
fn a_board_that_draws_the_reference_tile_wrong_is_refused_by_name() {
    let (rig, backplane, _) = flying();
    let mut stream = TcpStream::connect(backplane).unwrap();
    stream.write_all(&codec::preamble(codec::VERSIONS)).unwrap();
    let mut drawn = REFERENCE_TILE;
    drawn.0[7] ^= 1;
    let role = Role::Board { threads: 1, link: "127.0.0.1:1".into(), memory: 1 << 30, drawn };
    stream.write_all(&framed(&codec::encode(&Hello { name: "left-wall".into(), role }, &[]))).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    assert!(String::from_utf8_lossy(&answer).contains("it draws the reference tile as"), "it is told why");
    let stats = rig.wait("its refusal", |stats| stats["events"].to_string().contains("board left-wall"));
    assert_eq!(stats["boards"], 2, "nobody has joined: {stats}");
    goes_on(&rig);
}

fn framed(message: &[u8]) -> Vec<u8> {
    [&(message.len() as u32).to_le_bytes(), message].concat()
}

#[test]
fn a_board_that_announces_more_than_boards_say_is_cut_before_it_comes() {
    let (rig, backplane, _) = flying();
    let mut stream = TcpStream::connect(backplane).unwrap();
    stream.write_all(&codec::preamble(codec::VERSIONS)).unwrap();
    let claim = (limits::CONTROL_MESSAGE_MAX as u32 + 1).to_le_bytes();
    stream.write_all(&[&hello(1 << 30)[..], &claim].concat()).unwrap();
    // Not one byte of it has been sent when the link ends.
    let _ = stream.read_to_end(&mut Vec::new());
    let stats = rig.wait("its being counted", |stats| stats["dropped"]["connections"] == 1);
    let events = stats["events"].to_string();
    assert!(events.contains("it broke the protocol: bytes of a message is 1048577"), "{events}");
    goes_on(&rig);
}

/// A board that says hello and then these; returns when its link is closed.
fn board(backplane: std::net::SocketAddr, memory: u64, says: &[(FromBoard, Vec<u8>)]) {
    let mut stream = TcpStream::connect(backplane).unwrap();
    stream.write_all(&codec::preamble(codec::VERSIONS)).unwrap();
    let mut bytes = hello(memory);
    for (message, payload) in says {
        bytes.extend(framed(&codec::encode(message, payload)));
    }
    stream.write_all(&bytes).unwrap();
    // It may be cut in the middle of what it is sent.
    let _ = stream.read_to_end(&mut Vec::new());
}

/// A board's memory limit, what it says, and why it is put out for that.
type Claim = (u64, Vec<(FromBoard, Vec<u8>)>, &'static str);

#[test]
fn a_board_that_claims_what_cannot_be_is_put_out_and_counted() {
    let (rig, backplane, _) = flying();
    let id = |k: u8| ContentId([k; 16]);
    let holding = |ids: &[ContentId]| (FromBoard::Holding { term: Term(0), scene: None, more: false }, encode_ids(ids));
    let gib = 1 << 30;
    let refused = |term| (FromBoard::Answer(Answer::Refused { term: Term(term) }), Vec::new());
    let cases: [Claim; 6] = [
        (gib, vec![refused(u64::MAX)], "a term, a place or a frame that there can't be"),
        (
            gib,
            vec![holding(&[]), (FromBoard::Stored, encode_ids(&[id(1)]))],
            "names a piece that the scene doesn't have",
        ),
        (gib, vec![holding(&[]), holding(&[])], "says twice what it holds"),
        (2048, vec![holding(&[id(1), id(2), id(3)])], "more than its own memory limit"),
        (gib, vec![(FromBoard::Stored, vec![7; 15])], "bytes too many"),
        (gib, vec![(FromBoard::Loaded { scene: id(3) }, Vec::new())], "loaded another scene"),
    ];
    for (k, (memory, says, why)) in cases.iter().enumerate() {
        board(backplane, *memory, says);
        let stats = rig.wait("its being put out", |stats| stats["dropped"]["boards"] == k + 1);
        assert!(stats["events"].to_string().contains(why), "{why}: {}", stats["events"]);
    }
    goes_on(&rig);
}

#[test]
fn one_board_that_claims_to_follow_another_manager_does_not_end_the_rig() {
    let (rig, backplane, _) = flying();
    let mut stream = TcpStream::connect(backplane).unwrap();
    stream.write_all(&codec::preamble(codec::VERSIONS)).unwrap();
    let claim = FromBoard::Answer(Answer::Refused { term: Term(5) });
    stream.write_all(&[hello(1 << 30), framed(&codec::encode(&claim, &[]))].concat()).unwrap();
    let stats = rig.wait("the claim in the log", |stats| stats["events"].to_string().contains("remembers term 5"));
    assert_eq!(stats["leads"], true, "{stats}");
    goes_on(&rig);
}
