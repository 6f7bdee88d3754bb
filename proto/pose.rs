//! Native pose packets: how a host without CIGI flies the eye. One UDP datagram is one packet; little endian.
//!
//! Host → manager (72 bytes, then 32 more with a lens, then 72 per entity):
//!
//! | offset | type | name | meaning |
//! |---|---|---|---|
//! | 0 | u8 × 4 | magic | `CYCP` |
//! | 4 | u16 | version | 1 |
//! | 6 | u16 | flags | bit 0: answer me; bit 1: a lens follows; the others are zero |
//! | 8 | u32 | sequence | +1 each packet; a packet that is not newer than the last (modulo 2³²) is dropped |
//! | 12 | u16 | entities | how many entity blocks follow, at most 512 |
//! | 14 | u16 | models | how many model blocks follow the entities, at most 64 |
//! | 16 | f64 × 3 | position | the eye, world frame, m |
//! | 40 | f64 × 4 | orientation | eye → world, quaternion x y z w |
//! | 72 | f64 × 4 | lens | only with flag bit 1: tangents left, right, bottom, top of a view's window |
//!
//! Entity block:
//!
//! | offset | type | name | meaning |
//! |---|---|---|---|
//! | 0 | u32 | kind | 0: `entity` is the scene's entity number; 1: it is the FNV-1a 64 hash of the node's name in UTF-8 |
//! | 4 | u32 | reserved | zero |
//! | 8 | u64 | entity | which |
//! | 16 | f64 × 3 | position | world frame, m |
//! | 40 | f64 × 4 | orientation | entity → world, quaternion x y z w |
//!
//! Model block, for models with versions (levels of detail) that the host mixes itself:
//!
//! | offset | type | name | meaning |
//! |---|---|---|---|
//! | 0 | u64 | name | FNV-1a 64 hash of the name of the model's node |
//! | 8 | u32 | count | how many weights follow, at most 16 |
//! | 12 | u32 | reserved | zero |
//! | 16 | f32 × count | weights | one per version, finest first, each 0 to 1; what is missing to 1 shows nothing |
//!
//! Entities keep their last pose until they get another; models are mixed only in the frames whose packet says so.
//!
//! Manager → host, in answer to packets with flag bit 0 (16 bytes): magic `CYCS`, u16 version, u16 flags (bit 0: lock-step,
//! the host sends the next pose only after this), u32 the sequence that was drawn last, u32 low half of the frame number
//! that showed it.
//!
//! The newest packet of a frame wins. Reserved fields are ignored on receipt.

use crate::codec::{CodecError, Reader, within};
use crate::limits;
use crate::view::{Pose, PoseError, Tangents};
use glam::{DQuat, DVec3};
use thiserror::Error;

/// Version of the packets.
pub const VERSION: u16 = 1;
/// Length of a pose packet without lens and entities.
pub const POSE_PACKET_LEN: usize = 72;
const LENS_LEN: usize = 32;
const ENTITY_LEN: usize = 72;
/// Length of an answer.
pub const ANSWER_LEN: usize = 16;
const FLAG_ANSWER: u16 = 1;
const FLAG_LENS: u16 = 2;

const _: () = assert!(
    POSE_PACKET_LEN
        + LENS_LEN
        + limits::POSE_ENTITIES_MAX * ENTITY_LEN
        + limits::POSE_MODELS_MAX * (16 + 4 * limits::VERSIONS_MAX)
        <= 65_507,
    "a full packet must fit a UDP datagram"
);

/// How a packet names an entity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum EntityRef {
    /// The scene's entity number (`extras.cyclorama.entity`).
    Number(u64),
    /// [`name_hash`] of the node's name.
    NameHash(u64),
}

/// FNV-1a, 64 bits, of the name's UTF-8 bytes.
pub fn name_hash(name: &str) -> u64 {
    name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// An entity and where the host wants it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EntityPose {
    /// Which.
    pub entity: EntityRef,
    /// World frame.
    pub pose: Pose,
}

/// A model and how its versions are mixed.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelWeights {
    /// [`name_hash`] of its node's name.
    pub name: u64,
    /// One per version, finest first.
    pub weights: Vec<f32>,
}

/// What a host says once per frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PosePacket {
    /// Counts the host's packets.
    pub sequence: u32,
    /// Whether the host wants an [`Answer`].
    pub answer: bool,
    /// The eyepoint, world frame.
    pub eye: Pose,
    /// A new window for the default views.
    pub lens: Option<Tangents>,
    /// Entities to move; the others stay.
    pub entities: Vec<EntityPose>,
    /// Models whose versions are mixed in this frame.
    pub models: Vec<ModelWeights>,
}

/// What the manager says back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Whether the host must wait for this before it sends the next pose.
    pub lock_step: bool,
    /// The newest sequence that is on the screen.
    pub sequence: u32,
    /// Low half of the frame number that showed it.
    pub frame: u32,
}

/// Why a datagram is no pose packet.
#[derive(Debug, Error)]
pub enum PacketError {
    /// Something else entirely.
    #[error("not a pose packet")]
    Magic,
    /// Another version of the format.
    #[error("pose packet version {0}, this program reads version {VERSION}")]
    Version(u16),
    /// The numbers are no pose.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// The lens is no window.
    #[error("the lens is not a window: left < right and bottom < top must hold")]
    Lens,
    /// The weights are no mixture.
    #[error("the weights of a model's versions must each be 0 to 1, and together at most 1")]
    Weights,
    /// Too short, too long or too many.
    #[error(transparent)]
    Codec(#[from] CodecError),
}

impl PosePacket {
    /// The datagram.
    ///
    /// # Panics
    /// With more than [`limits::POSE_ENTITIES_MAX`] entities, [`limits::POSE_MODELS_MAX`] models or
    /// [`limits::VERSIONS_MAX`] weights.
    pub fn encode(&self) -> Vec<u8> {
        assert!(self.models.len() <= limits::POSE_MODELS_MAX, "{} models in one packet", self.models.len());
        assert!(self.entities.len() <= limits::POSE_ENTITIES_MAX, "{} entities in one packet", self.entities.len());
        let mut out = Vec::with_capacity(POSE_PACKET_LEN + LENS_LEN + self.entities.len() * ENTITY_LEN);
        out.extend_from_slice(b"CYCP");
        out.extend_from_slice(&VERSION.to_le_bytes());
        let flags = u16::from(self.answer) * FLAG_ANSWER + u16::from(self.lens.is_some()) * FLAG_LENS;
        out.extend_from_slice(&flags.to_le_bytes());
        out.extend_from_slice(&self.sequence.to_le_bytes());
        out.extend_from_slice(&(self.entities.len() as u16).to_le_bytes());
        out.extend_from_slice(&(self.models.len() as u16).to_le_bytes());
        put_pose(&mut out, &self.eye);
        if let Some(lens) = self.lens {
            out.extend_from_slice(bytemuck::cast_slice(&[lens.left, lens.right, lens.bottom, lens.top]));
        }
        for EntityPose { entity, pose } in &self.entities {
            let (kind, number) = match entity {
                EntityRef::Number(n) => (0u64, *n),
                EntityRef::NameHash(h) => (1, *h),
            };
            out.extend_from_slice(&kind.to_le_bytes());
            out.extend_from_slice(&number.to_le_bytes());
            put_pose(&mut out, pose);
        }
        for ModelWeights { name, weights } in &self.models {
            assert!(weights.len() <= limits::VERSIONS_MAX, "{} versions of one model", weights.len());
            out.extend_from_slice(&name.to_le_bytes());
            out.extend_from_slice(&(weights.len() as u64).to_le_bytes());
            out.extend_from_slice(bytemuck::cast_slice(weights));
        }
        out
    }

    /// Reads a datagram. Orientations are renormalised.
    ///
    /// # Errors
    /// [`PacketError`]; a packet is taken whole or not at all.
    pub fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut reader = Reader::new(datagram, "pose packet");
        if reader.bytes(4).map_err(|_| PacketError::Magic)? != b"CYCP" {
            return Err(PacketError::Magic);
        }
        let version: u16 = reader.value()?;
        if version != VERSION {
            return Err(PacketError::Version(version));
        }
        let flags: u16 = reader.value()?;
        let sequence = reader.value()?;
        let count: u16 = reader.value()?;
        let count = within("entities of a pose packet", count.into(), limits::POSE_ENTITIES_MAX)?;
        let models: u16 = reader.value()?;
        let models = within("models of a pose packet", models.into(), limits::POSE_MODELS_MAX)?;
        let eye = take_pose(&mut reader)?;
        let lens = if flags & FLAG_LENS == 0 {
            None
        } else {
            let [left, right, bottom, top] = reader.value::<[f64; 4]>()?;
            let lens = Tangents { left, right, bottom, top };
            if !lens.is_valid() {
                return Err(PacketError::Lens);
            }
            Some(lens)
        };
        let mut entities = Vec::with_capacity(count);
        for _ in 0..count {
            let kind: u32 = reader.value()?;
            reader.bytes(4)?;
            let number = reader.value()?;
            let entity = match kind {
                0 => EntityRef::Number(number),
                1 => EntityRef::NameHash(number),
                _ => return Err(CodecError::Limit { what: "entity kind", value: kind.into(), limit: 1 }.into()),
            };
            entities.push(EntityPose { entity, pose: take_pose(&mut reader)? });
        }
        let models = (0..models).map(|_| take_model(&mut reader)).collect::<Result<_, _>>()?;
        reader.finish()?;
        Ok(Self { sequence, answer: flags & FLAG_ANSWER != 0, eye, lens, entities, models })
    }
}

impl Answer {
    /// The datagram.
    pub fn encode(&self) -> [u8; ANSWER_LEN] {
        let mut out = [0; ANSWER_LEN];
        out[..4].copy_from_slice(b"CYCS");
        out[4..6].copy_from_slice(&VERSION.to_le_bytes());
        out[6..8].copy_from_slice(&u16::from(self.lock_step).to_le_bytes());
        out[8..12].copy_from_slice(&self.sequence.to_le_bytes());
        out[12..].copy_from_slice(&self.frame.to_le_bytes());
        out
    }

    /// Reads a datagram.
    ///
    /// # Errors
    /// [`PacketError`].
    pub fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut reader = Reader::new(datagram, "answer");
        if reader.bytes(4).map_err(|_| PacketError::Magic)? != b"CYCS" {
            return Err(PacketError::Magic);
        }
        let version: u16 = reader.value()?;
        if version != VERSION {
            return Err(PacketError::Version(version));
        }
        let flags: u16 = reader.value()?;
        let answer = Self { lock_step: flags & 1 != 0, sequence: reader.value()?, frame: reader.value()? };
        reader.finish()?;
        Ok(answer)
    }
}

fn put_pose(out: &mut Vec<u8>, pose: &Pose) {
    out.extend_from_slice(bytemuck::cast_slice(&pose.position.to_array()));
    out.extend_from_slice(bytemuck::cast_slice(&pose.orientation.to_array()));
}

fn take_model(reader: &mut Reader<'_>) -> Result<ModelWeights, PacketError> {
    let name = reader.value()?;
    let count: u32 = reader.value()?;
    reader.bytes(4)?;
    let weights = reader.values::<f32>(within("versions of a model", count.into(), limits::VERSIONS_MAX)?)?;
    let sum: f32 = weights.iter().sum();
    if !weights.iter().all(|w| (0.0..=1.0).contains(w)) || sum > 1.0 + 1e-6 {
        return Err(PacketError::Weights);
    }
    Ok(ModelWeights { name, weights })
}

fn take_pose(reader: &mut Reader<'_>) -> Result<Pose, PacketError> {
    let position = DVec3::from_array(reader.value()?);
    let orientation = DQuat::from_array(reader.value()?);
    Ok(Pose::checked(position, orientation)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn packet() -> PosePacket {
        PosePacket {
            sequence: 7,
            answer: true,
            eye: Pose { position: DVec3::new(1.0, 2.0, 3.0), orientation: DQuat::IDENTITY },
            lens: Some(Tangents { left: -1.0, right: 1.0, bottom: -0.5, top: 0.5 }),
            entities: vec![
                EntityPose { entity: EntityRef::NameHash(name_hash("airliner")), pose: Pose::IDENTITY },
                EntityPose { entity: EntityRef::Number(4), pose: Pose::IDENTITY },
            ],
            models: vec![ModelWeights { name: name_hash("bus"), weights: vec![0.25, 0.75] }],
        }
    }

    #[test]
    fn the_layout_is_the_documented_one() {
        let bytes = packet().encode();
        assert_eq!(bytes.len(), 72 + 32 + 2 * 72 + 16 + 8);
        assert_eq!(bytes[..16], *b"CYCP\x01\x00\x03\x00\x07\x00\x00\x00\x02\x00\x01\x00");
        assert_eq!(bytes[16..24], 1.0f64.to_le_bytes());
        assert_eq!(bytes[64..72], 1.0f64.to_le_bytes(), "w of the orientation");
        assert_eq!(bytes[72..80], (-1.0f64).to_le_bytes(), "left tangent");
        assert_eq!(bytes[104..112], [1, 0, 0, 0, 0, 0, 0, 0], "kind: name hash");
        assert_eq!(name_hash("a"), 0xaf63_dc4c_8601_ec8c, "published FNV-1a vector");
    }

    #[test]
    fn packets_and_answers_come_back_as_they_went() {
        assert_eq!(PosePacket::decode(&packet().encode()).unwrap(), packet());
        let answer = Answer { lock_step: true, sequence: 9, frame: 3 };
        assert_eq!(Answer::decode(&answer.encode()).unwrap(), answer);
    }

    #[test]
    fn a_packet_with_a_nan_is_refused() {
        let mut bytes = packet().encode();
        bytes[16..24].copy_from_slice(&f64::NAN.to_le_bytes());
        assert!(matches!(PosePacket::decode(&bytes), Err(PacketError::Pose(PoseError::Position))));
    }

    proptest! {
        #[test]
        fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = PosePacket::decode(&bytes);
            let _ = Answer::decode(&bytes);
        }

        #[test]
        fn a_damaged_packet_is_refused_or_valid(at in 0usize..272, byte in any::<u8>(), cut in 0usize..272) {
            let mut bytes = packet().encode();
            bytes[at] = byte;
            if let Ok(packet) = PosePacket::decode(&bytes) {
                prop_assert!(packet.eye.position.is_finite());
                prop_assert!((packet.eye.orientation.length() - 1.0).abs() < 1e-9);
            }
            prop_assert!(PosePacket::decode(&bytes[..cut]).is_err(), "a truncated packet has no meaning");
        }
    }
}
