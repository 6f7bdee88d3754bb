//! What viewers are sent: no more than they show, and a viewer who doesn't read holds up nobody.

use crate::program::{HANG, Rig, wait_for};
use serde_json::Value;
use std::net::TcpStream;
use std::time::Duration;
use tungstenite::{Message, WebSocket};

const SMALL: [&str; 8] = ["--views", "1", "--boards", "2", "--size", "320x180", "--samples", "1"];

fn watch(rig: &Rig) -> WebSocket<TcpStream> {
    let stream = TcpStream::connect(rig.console()).unwrap();
    stream.set_read_timeout(Some(HANG)).unwrap();
    tungstenite::client(format!("ws://{}/api/v1/watch", rig.console()), stream).unwrap().0
}

#[test]
fn a_viewer_gets_two_pictures_until_he_has_shown_one() {
    let rig = Rig::start(&SMALL);
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(5));
    let mut viewer = watch(&rig);
    let Message::Text(first) = viewer.read().unwrap() else { panic!("text comes first") };
    let first: Value = serde_json::from_str(&first).unwrap();
    assert_eq!(first["hello"]["controls"], "open");
    let (mut pictures, mut states) = (Vec::new(), 0);
    // Twelve looks are three seconds, in which a viewer who keeps up gets thirty pictures.
    while states < 12 {
        match viewer.read().unwrap() {
            Message::Binary(bytes) => pictures.push(bytes),
            Message::Text(text) => {
                let state: Value = serde_json::from_str(&text).unwrap();
                assert!(state["state"]["boards"].is_array() && state["sample"]["frames"].is_number(), "{state}");
                states += 1;
            }
            _ => {}
        }
    }
    assert_eq!(pictures.len(), 2, "none is sent that is not asked for");
    for bytes in &pictures {
        let picture = image::load_from_memory(&bytes[8..]).unwrap();
        assert_eq!((picture.width(), picture.height()), (320, 180));
    }
    let frame = |bytes: &[u8]| u64::from_le_bytes(bytes[..8].try_into().unwrap());
    assert!(frame(&pictures[0]) < frame(&pictures[1]));
    viewer.send(Message::text("shown")).unwrap();
    let third = wait_for("one more", || match viewer.read().unwrap() {
        Message::Binary(bytes) => Some(bytes),
        _ => None,
    });
    assert!(frame(&third) > frame(&pictures[1]), "the newest, not the next");
}

#[test]
fn a_viewer_who_reads_nothing_holds_up_nobody() {
    let rig = Rig::start(&SMALL);
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(5));
    let sleepers: Vec<_> = (0..8).map(|_| watch(&rig)).collect();
    let mut viewer = watch(&rig);
    let mut shown = 0;
    while shown < 20 {
        if let Message::Binary(_) = viewer.read().unwrap() {
            shown += 1;
            viewer.send(Message::text("shown")).unwrap();
        }
    }
    let before = rig.stats().unwrap()["frames"].as_u64();
    rig.wait("flight", |stats| stats["frames"].as_u64() > before.map(|frames| frames + 20));
    drop(sleepers);
}

#[test]
fn nobody_is_let_in_beyond_the_most_there_can_be() {
    let rig = Rig::start(&SMALL);
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(5));
    let mut viewers: Vec<_> = (0..64).map(|_| watch(&rig)).collect();
    // Each has been let in when it has heard something.
    viewers.iter_mut().for_each(|viewer| drop(viewer.read().unwrap()));
    let stream = TcpStream::connect(rig.console()).unwrap();
    let refused = tungstenite::client(format!("ws://{}/api/v1/watch", rig.console()), stream);
    assert!(refused.is_err_and(|error| error.to_string().contains("503")));
    viewers.clear();
    std::thread::sleep(Duration::from_millis(100));
    wait_for("room", || {
        let stream = TcpStream::connect(rig.console()).ok()?;
        tungstenite::client(format!("ws://{}/api/v1/watch", rig.console()), stream).ok().map(drop)
    });
}
