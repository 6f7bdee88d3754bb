//! How a connection begins, how it is cut into frames, and datagrams.

use bytes::{Bytes, BytesMut};
use proto::codec::{Framing, PREAMBLE_LEN, VERSIONS, VersionRange, agree, preamble};
use proto::pose::{Answer, PosePacket};
use tokio_util::codec::{Decoder, Encoder};

/// What is taken of a frame at most, bytes.
const FRAME_MAX: usize = 300;

/// Datagrams of hosts, and answers to them.
pub(crate) fn poses(bytes: &[u8]) {
    if let Ok(packet) = PosePacket::decode(bytes) {
        let again = packet.encode();
        // Orientations are renormalised, which may change the last bit, but no more.
        let twice = PosePacket::decode(&again).expect("a packet that was decoded can be sent");
        let near = (twice.eye.orientation.dot(packet.eye.orientation) - 1.0).abs() < 1e-12;
        assert!(near && twice.eye.position == packet.eye.position, "the eye comes as it went");
        let rest = |packet: &PosePacket| (packet.sequence, packet.answer, packet.lens);
        assert_eq!(rest(&twice), rest(&packet), "and the rest");
        assert_eq!(twice.models, packet.models, "and the models");
        let entities = || packet.entities.iter().zip(&twice.entities);
        assert!(twice.entities.len() == packet.entities.len(), "all entities");
        assert!(entities().all(|(a, b)| a.entity == b.entity && a.pose.position == b.pose.position), "as they went");
    }
    if let Ok(answer) = Answer::decode(bytes) {
        assert_eq!(Answer::decode(&answer.encode()).expect("it can be sent"), answer, "and comes as it went");
    }
}

/// A preamble, and then frames, in portions as the first byte says.
pub(crate) fn stream(bytes: &[u8]) {
    let Some((portion, bytes)) = bytes.split_first() else { return };
    let Some((opening, bytes)) = bytes.split_first_chunk::<PREAMBLE_LEN>() else { return };
    if let Ok(version) = agree(VERSIONS, opening) {
        assert!((VERSIONS.min..=VERSIONS.max).contains(&version), "one that we speak");
        let theirs = VersionRange { min: version, max: version };
        assert_eq!(agree(VERSIONS, &preamble(theirs)).ok(), Some(version), "and they may say only that");
    }
    let whole = frames(bytes, bytes.len().max(1));
    assert_eq!(frames(bytes, usize::from(*portion).max(1)), whole, "however it comes");
    let mut framing = Framing::new(FRAME_MAX);
    let mut again = BytesMut::new();
    for frame in &whole {
        framing.encode(frame.clone(), &mut again).expect("what came can be sent");
    }
    assert!(bytes.starts_with(&again), "and goes as it came");
}

fn frames(bytes: &[u8], portion: usize) -> Vec<Bytes> {
    let (mut framing, mut left, mut frames) = (Framing::new(FRAME_MAX), BytesMut::new(), Vec::new());
    for portion in bytes.chunks(portion) {
        left.extend_from_slice(portion);
        loop {
            match framing.decode(&mut left) {
                Ok(Some(frame)) => frames.push(frame.freeze()),
                Ok(None) => break,
                // The peer is dropped for it.
                Err(_) => return frames,
            }
        }
        assert!(left.len() <= FRAME_MAX + portion.len(), "no more waits than a frame and what came last");
    }
    frames
}
