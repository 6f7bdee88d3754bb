//! Bytes: how a message becomes a frame on a stream and back.
//!
//! A connection begins with a *preamble* of 16 fixed bytes from either side, so that two programs of different versions
//! can still tell each other so. After it come frames: a length (u32, little endian, not counting itself), then a header length (u32), the header in
//! bincode, and a raw payload that may be empty. Small things are typed headers; vertices, texels, lists and pixels are
//! payload, little-endian and unparsed, because they are megabytes.
//!
//! bincode has one safe form here: fixed-size integers, a limit, a slice, and no trailing bytes. Nothing else in the
//! project may call it (`clippy.toml` bans the free functions).

use crate::ids::{ContentId, ModelId, ObjectId};
use crate::limits;
use crate::scene::{
    Box3, LightKind, LightRow, Material, Mesh, ModelPart, ModelRow, NO_PLANE, ObjectRow, PlaneRow, SceneTable, Sphere,
    SubobjectRow, Texture,
};
use bincode::Options;
use bytes::{Buf, BufMut, Bytes, BytesMut};
use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::io;
use thiserror::Error;
use tokio_util::codec::{Decoder, Encoder};

#[cfg(target_endian = "big")]
compile_error!("bulk payloads are cast, not converted: the wire is little-endian and so must the machine be");

/// Versions of the protocol that this program speaks, both ends included.
pub const VERSIONS: VersionRange = VersionRange { min: 5, max: 5 };

/// First bytes of every connection.
pub const MAGIC: [u8; 8] = *b"CYCLORMA";

/// Length of a preamble: magic, lowest version (u16), highest version (u16), zero (u32); little endian.
pub const PREAMBLE_LEN: usize = 16;

/// Why bytes are no message.
#[derive(Debug, Error)]
pub enum CodecError {
    /// The preamble's magic is something else: not a Cyclorama program. The peer's fault.
    #[error("not a cyclorama connection (it begins with {0:02x?})")]
    Magic([u8; 8]),
    /// No common version. Nobody's fault: one side must be upgraded.
    #[error(
        "no common protocol version: we speak {ours}, the other side speaks {theirs}; install the same release on both"
    )]
    Version {
        /// What we speak.
        ours: VersionRange,
        /// What the peer speaks.
        theirs: VersionRange,
    },
    /// The header does not decode, or something is left over.
    #[error("malformed message: {0}")]
    Header(#[from] bincode::Error),
    /// The frame or payload is shorter than it says.
    #[error("truncated message: {what} needs {needed} bytes, {left} are there")]
    Truncated {
        /// Which part.
        what: &'static str,
        /// How many bytes it wants.
        needed: u64,
        /// How many are left.
        left: usize,
    },
    /// Bytes after the end.
    #[error("{0} bytes too many after {1}")]
    Trailing(usize, &'static str),
    /// A number beyond its limit.
    #[error("{what} is {value}, at most {limit} are allowed")]
    Limit {
        /// Which number.
        what: &'static str,
        /// Its value.
        value: u64,
        /// The limit.
        limit: u64,
    },
}

/// A range of protocol versions, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VersionRange {
    /// Lowest.
    pub min: u16,
    /// Highest.
    pub max: u16,
}

impl std::fmt::Display for VersionRange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.min == self.max {
            write!(f, "version {}", self.min)
        } else {
            write!(f, "versions {} to {}", self.min, self.max)
        }
    }
}

/// The bytes that open a connection.
pub fn preamble(versions: VersionRange) -> [u8; PREAMBLE_LEN] {
    let mut bytes = [0; PREAMBLE_LEN];
    bytes[..8].copy_from_slice(&MAGIC);
    bytes[8..10].copy_from_slice(&versions.min.to_le_bytes());
    bytes[10..12].copy_from_slice(&versions.max.to_le_bytes());
    bytes
}

/// The highest version that both sides speak.
///
/// # Errors
/// [`CodecError::Magic`] and [`CodecError::Version`], which names both sides' versions.
pub fn agree(ours: VersionRange, preamble: &[u8; PREAMBLE_LEN]) -> Result<u16, CodecError> {
    let mut magic = [0; 8];
    magic.copy_from_slice(&preamble[..8]);
    if magic != MAGIC {
        return Err(CodecError::Magic(magic));
    }
    let theirs = VersionRange {
        min: u16::from_le_bytes([preamble[8], preamble[9]]),
        max: u16::from_le_bytes([preamble[10], preamble[11]]),
    };
    let common = ours.max.min(theirs.max);
    if common < ours.min.max(theirs.min) {
        return Err(CodecError::Version { ours, theirs });
    }
    Ok(common)
}

/// The frames of a link: a length (u32, little endian, not counting itself), then that many bytes.
///
/// What may come in has a limit of its own, for a peer that only says small things must not be able to make us reserve
/// what we may send it.
#[derive(Clone, Debug)]
pub struct Framing {
    incoming_max: usize,
    /// Length of the frame whose beginning has come.
    awaited: Option<usize>,
}

impl Framing {
    /// Frames of which at most `incoming_max` bytes are taken.
    pub fn new(incoming_max: usize) -> Self {
        Self { incoming_max, awaited: None }
    }

    /// Changes what is taken from the next frame on. What has come already isn't lost.
    pub fn set_incoming_max(&mut self, incoming_max: usize) {
        self.incoming_max = incoming_max;
    }
}

impl Decoder for Framing {
    type Item = BytesMut;
    type Error = io::Error;

    fn decode(&mut self, bytes: &mut BytesMut) -> io::Result<Option<BytesMut>> {
        let len = match self.awaited {
            Some(len) => len,
            None if bytes.len() < size_of::<u32>() => return Ok(None),
            None => {
                let len = u64::from(bytes.get_u32_le());
                within("bytes of a message", len, self.incoming_max).map_err(invalid)?
            }
        };
        if bytes.len() < len {
            self.awaited = Some(len);
            // A claim alone reserves this much; what is larger grows with what comes.
            bytes.reserve((len - bytes.len()).min(limits::CLAIM_MAX));
            return Ok(None);
        }
        self.awaited = None;
        Ok(Some(bytes.split_to(len)))
    }
}

impl Encoder<Bytes> for Framing {
    type Error = io::Error;

    fn encode(&mut self, message: Bytes, bytes: &mut BytesMut) -> io::Result<()> {
        within("bytes of a message", message.len() as u64, limits::BULK_MESSAGE_MAX).map_err(invalid)?;
        bytes.reserve(size_of::<u32>() + message.len());
        bytes.put_u32_le(message.len() as u32);
        bytes.extend_from_slice(&message);
        Ok(())
    }
}

fn invalid(error: CodecError) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, error)
}

fn options() -> impl Options {
    bincode::DefaultOptions::new().with_fixint_encoding().with_limit(limits::CONTROL_MESSAGE_MAX as u64)
}

/// One frame's content: `header` in bincode, then `payload` as it is.
///
/// # Panics
/// If the header is larger than [`limits::CONTROL_MESSAGE_MAX`]: our own mistake, for everything of unbounded length is
/// payload.
pub fn encode<M: Serialize>(header: &M, payload: &[u8]) -> Bytes {
    let len = options().serialized_size(header).expect("headers are bounded by construction");
    let mut frame = Vec::with_capacity(4 + len as usize + payload.len());
    frame.put_u32_le(len as u32);
    // With a limit it would be measured again.
    options().with_no_limit().serialize_into(&mut frame, header).expect("a vector takes what it is given");
    frame.extend_from_slice(payload);
    frame.into()
}

/// The reverse of [`encode`].
///
/// # Errors
/// [`CodecError`] when the frame is too short, or the header is malformed or followed by more bytes than it says.
pub fn decode<M: DeserializeOwned>(mut frame: Bytes) -> Result<(M, Bytes), CodecError> {
    if frame.len() < 4 {
        return Err(CodecError::Truncated { what: "header length", needed: 4, left: frame.len() });
    }
    let len = frame.get_u32_le() as usize;
    if len > frame.len() {
        return Err(CodecError::Truncated { what: "header", needed: len as u64, left: frame.len() });
    }
    let head = frame.split_to(len);
    Ok((options().deserialize(&head)?, frame))
}

/// Takes typed pieces off a payload; every take can fail.
#[derive(Debug)]
pub struct Reader<'a> {
    left: &'a [u8],
    what: &'static str,
}

impl<'a> Reader<'a> {
    /// A reader of `payload`, named `what` in errors.
    pub fn new(payload: &'a [u8], what: &'static str) -> Self {
        Self { left: payload, what }
    }

    /// The next `len` bytes.
    ///
    /// # Errors
    /// [`CodecError::Truncated`].
    pub fn bytes(&mut self, len: usize) -> Result<&'a [u8], CodecError> {
        let Some((taken, rest)) = self.left.split_at_checked(len) else {
            return Err(CodecError::Truncated { what: self.what, needed: len as u64, left: self.left.len() });
        };
        self.left = rest;
        Ok(taken)
    }

    /// The next `count` plain values. Nothing is reserved before the bytes are known to be there.
    ///
    /// # Errors
    /// [`CodecError::Truncated`].
    pub fn values<T: bytemuck::AnyBitPattern>(&mut self, count: usize) -> Result<Vec<T>, CodecError> {
        let len = count.checked_mul(size_of::<T>()).ok_or(CodecError::Limit {
            what: self.what,
            value: count as u64,
            limit: limits::BULK_MESSAGE_MAX as u64,
        })?;
        Ok(self.bytes(len)?.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect())
    }

    /// The next value.
    ///
    /// # Errors
    /// [`CodecError::Truncated`].
    pub fn value<T: bytemuck::AnyBitPattern>(&mut self) -> Result<T, CodecError> {
        Ok(bytemuck::pod_read_unaligned(self.bytes(size_of::<T>())?))
    }

    /// Ends the reading.
    ///
    /// # Errors
    /// [`CodecError::Trailing`] if anything is left.
    pub fn finish(self) -> Result<(), CodecError> {
        if self.left.is_empty() { Ok(()) } else { Err(CodecError::Trailing(self.left.len(), self.what)) }
    }
}

/// Checks a count against its limit.
///
/// # Errors
/// [`CodecError::Limit`].
pub fn within(what: &'static str, value: u64, limit: usize) -> Result<usize, CodecError> {
    if value > limit as u64 {
        return Err(CodecError::Limit { what, value, limit: limit as u64 });
    }
    Ok(value as usize)
}

/// Names of pieces as a payload, 16 bytes each.
pub fn encode_ids(ids: &[ContentId]) -> Vec<u8> {
    ids.iter().flat_map(|id| id.0).collect()
}

/// The reverse of [`encode_ids`], of at most `limit` names.
///
/// # Errors
/// [`CodecError`].
pub fn decode_ids(payload: &[u8], limit: usize) -> Result<Vec<ContentId>, CodecError> {
    let count = within("names of pieces", (payload.len() / 16) as u64, limit)?;
    let mut reader = Reader::new(payload, "names of pieces");
    let ids = reader.values::<[u8; 16]>(count)?;
    reader.finish()?;
    Ok(ids.into_iter().map(ContentId).collect())
}

#[derive(Serialize, Deserialize)]
struct MeshHeader {
    origin: DVec3,
    vertices: u32,
    triangles: u32,
    has_normals: bool,
    has_colors: bool,
    texcoord_sets: u8,
    material: Material,
    sphere: Sphere,
    bounds: Box3,
}

/// A mesh as it travels and as it is named: [`ContentId::of`] these bytes.
pub fn encode_mesh(mesh: &Mesh) -> Bytes {
    let header = MeshHeader {
        origin: mesh.origin,
        vertices: mesh.positions.len() as u32,
        triangles: mesh.triangles.len() as u32,
        has_normals: !mesh.normals.is_empty(),
        has_colors: !mesh.colors.is_empty(),
        texcoord_sets: mesh.texcoords.len() as u8,
        material: mesh.material,
        sphere: mesh.sphere,
        bounds: mesh.bounds,
    };
    let mut payload: Vec<u8> = Vec::new();
    payload.extend_from_slice(bytemuck::cast_slice(&mesh.positions));
    payload.extend_from_slice(bytemuck::cast_slice(&mesh.normals));
    payload.extend_from_slice(bytemuck::cast_slice(&mesh.colors));
    for set in &mesh.texcoords {
        payload.extend_from_slice(bytemuck::cast_slice(set));
    }
    payload.extend_from_slice(bytemuck::cast_slice(&mesh.triangles));
    payload.extend_from_slice(bytemuck::cast_slice(&mesh.face_numbers));
    encode(&header, &payload)
}

/// The reverse of [`encode_mesh`]. Lengths are checked; what the numbers mean (indices in range, finite) is checked by
/// whoever draws them.
///
/// # Errors
/// [`CodecError`].
pub fn decode_mesh(bytes: Bytes) -> Result<Mesh, CodecError> {
    let (header, payload): (MeshHeader, Bytes) = decode(bytes)?;
    let triangles = within("triangles of a subobject", header.triangles.into(), limits::TRIANGLES_PER_SUBOBJECT_MAX)?;
    let vertices = within("vertices of a subobject", header.vertices.into(), 3 * limits::TRIANGLES_PER_SUBOBJECT_MAX)?;
    let sets = within("texture coordinate sets", header.texcoord_sets.into(), 2)?;
    let mut reader = Reader::new(&payload, "mesh");
    let mesh = Mesh {
        origin: header.origin,
        positions: reader.values(vertices)?,
        normals: reader.values(if header.has_normals { vertices } else { 0 })?,
        colors: reader.values(if header.has_colors { vertices } else { 0 })?,
        texcoords: (0..sets).map(|_| reader.values(vertices)).collect::<Result<_, _>>()?,
        triangles: reader.values(triangles)?,
        face_numbers: reader.values(triangles)?,
        material: header.material,
        sphere: header.sphere,
        bounds: header.bounds,
    };
    reader.finish()?;
    Ok(mesh)
}

/// A texture as it travels and as it is named.
pub fn encode_texture(texture: &Texture) -> Bytes {
    encode(&(texture.width, texture.height), bytemuck::cast_slice(&texture.texels))
}

/// The reverse of [`encode_texture`].
///
/// # Errors
/// [`CodecError`].
pub fn decode_texture(bytes: Bytes) -> Result<Texture, CodecError> {
    let ((width, height), payload): ((u32, u32), Bytes) = decode(bytes)?;
    for side in [width, height] {
        within("side of a texture", side.into(), limits::TEXTURE_SIZE_MAX as usize)?;
        if side == 0 {
            return Err(CodecError::Limit { what: "empty textures", value: 1, limit: 0 });
        }
    }
    let mut reader = Reader::new(&payload, "texture");
    let texels = reader.values(width as usize * height as usize)?;
    reader.finish()?;
    Ok(Texture { width, height, texels })
}

#[derive(Serialize, Deserialize)]
struct TableHeader {
    objects: u64,
    subobjects: u64,
    models: u64,
    planes: u64,
    face_planes: u64,
    lights: u64,
}

/// Bytes of the rows of a table.
const OBJECT_BYTES: usize = 96;
const SUBOBJECT_BYTES: usize = 4 + 16 + 4 + 4 + 4 + 4 + 4;
const MODEL_BYTES: usize = 8;
const PLANE_BYTES: usize = 4 + 32;
const LIGHT_BYTES: usize = 4 + 12 + 8 + 8 + 24 + 24;
/// No model, no planes.
const NONE: u32 = u32::MAX;

/// The scene's tables as they travel: object transformations, then rows of subobjects (object, mesh, primitive, layer,
/// model, version, planes), models (merged, versions), planes (object, normal, offset), face planes, lights.
pub fn encode_table(table: &SceneTable) -> Bytes {
    let mut payload = Vec::with_capacity(table.objects.len() * OBJECT_BYTES + table.subobjects.len() * SUBOBJECT_BYTES);
    for object in &table.objects {
        put_affine(&mut payload, &object.transform);
    }
    for row in &table.subobjects {
        payload.extend_from_slice(&row.object.0.to_le_bytes());
        payload.extend_from_slice(&row.mesh.0);
        payload.extend_from_slice(&row.primitive.to_le_bytes());
        payload.extend_from_slice(&row.layer.to_le_bytes());
        payload.extend_from_slice(&row.part_of.map_or(NONE, |part| part.model.0).to_le_bytes());
        payload.extend_from_slice(&row.part_of.map_or(0, |part| part.version).to_le_bytes());
        payload.extend_from_slice(&row.planes.unwrap_or(NONE).to_le_bytes());
    }
    for model in &table.models {
        payload.extend_from_slice(&u32::from(model.merged).to_le_bytes());
        payload.extend_from_slice(&model.versions.to_le_bytes());
    }
    for plane in &table.planes {
        payload.extend_from_slice(&plane.object.0.to_le_bytes());
        payload.extend_from_slice(bytemuck::cast_slice(&plane.normal.to_array()));
        payload.extend_from_slice(&plane.offset.to_le_bytes());
    }
    payload.extend_from_slice(bytemuck::cast_slice(&table.face_planes));
    for light in &table.lights {
        let (kind, range, cones) = match light.kind {
            LightKind::Directional => (0u32, None, [0.0; 2]),
            LightKind::Point { range } => (1, range, [0.0; 2]),
            LightKind::Spot { range, inner_cos, outer_cos } => (2, range, [inner_cos, outer_cos]),
        };
        payload.extend_from_slice(&kind.to_le_bytes());
        payload.extend_from_slice(bytemuck::cast_slice(&light.intensity));
        payload.extend_from_slice(&range.unwrap_or(f64::INFINITY).to_le_bytes());
        payload.extend_from_slice(bytemuck::cast_slice(&cones));
        payload.extend_from_slice(bytemuck::cast_slice(&light.position.to_array()));
        payload.extend_from_slice(bytemuck::cast_slice(&light.direction.to_array()));
    }
    let header = TableHeader {
        objects: table.objects.len() as u64,
        subobjects: table.subobjects.len() as u64,
        models: table.models.len() as u64,
        planes: table.planes.len() as u64,
        face_planes: table.face_planes.len() as u64,
        lights: table.lights.len() as u64,
    };
    encode(&header, &payload)
}

/// The reverse of [`encode_table`]. Every row that a row names exists; a subobject's faces are as many as its mesh has
/// only if whoever draws it finds so.
///
/// # Errors
/// [`CodecError`].
pub fn decode_table(bytes: Bytes) -> Result<SceneTable, CodecError> {
    let (header, payload): (TableHeader, Bytes) = decode(bytes)?;
    let objects = within("objects", header.objects, limits::OBJECTS_MAX)?;
    let subobjects = within("subobjects", header.subobjects, limits::SUBOBJECTS_MAX)?;
    let models = within("models", header.models, limits::OBJECTS_MAX)?;
    let planes = within("planes", header.planes, limits::SUBOBJECTS_MAX)?;
    let face_planes = within("faces in planes", header.face_planes, limits::BULK_MESSAGE_MAX / 4)?;
    let lights = within("lights", header.lights, limits::LIGHTS_MAX)?;
    let needed = objects * OBJECT_BYTES
        + subobjects * SUBOBJECT_BYTES
        + models * MODEL_BYTES
        + planes * PLANE_BYTES
        + face_planes * 4
        + lights * LIGHT_BYTES;
    if payload.len() != needed {
        return Err(CodecError::Truncated { what: "scene table", needed: needed as u64, left: payload.len() });
    }
    let mut reader = Reader::new(&payload, "scene table");
    let mut table = SceneTable::default();
    for _ in 0..objects {
        table.objects.push(ObjectRow { transform: take_affine(&mut reader)? });
    }
    for _ in 0..subobjects {
        let object = row_number("object of a subobject", reader.value()?, objects)?;
        let mesh = ContentId(reader.value()?);
        let (primitive, layer) = (reader.value()?, reader.value()?);
        let (model, version): (u32, u32) = (reader.value()?, reader.value()?);
        let part_of = match model {
            NONE => None,
            model => Some(ModelPart { model: ModelId(row_number("model of a subobject", model, models)?), version }),
        };
        let planes = Some(reader.value()?).filter(|first| *first != NONE);
        if let Some(first) = planes {
            row_number("planes of a subobject", first, face_planes)?;
        }
        table.subobjects.push(SubobjectRow { object: ObjectId(object), mesh, primitive, layer, part_of, planes });
    }
    for _ in 0..models {
        let (merged, versions): (u32, u32) = (reader.value()?, reader.value()?);
        within("versions of a model", versions.into(), limits::VERSIONS_MAX)?;
        table.models.push(ModelRow { merged: merged != 0, versions });
    }
    for row in &table.subobjects {
        if let Some(part) = row.part_of {
            row_number("version of a subobject", part.version, table.models[part.model.0 as usize].versions as usize)?;
        }
    }
    for _ in 0..planes {
        let object = ObjectId(row_number("object of a plane", reader.value()?, objects)?);
        table.planes.push(PlaneRow { object, normal: DVec3::from_array(reader.value()?), offset: reader.value()? });
    }
    table.face_planes = reader.values(face_planes)?;
    for plane in table.face_planes.iter().filter(|plane| **plane != NO_PLANE) {
        row_number("plane of a face", *plane, planes)?;
    }
    for _ in 0..lights {
        let kind: u32 = reader.value()?;
        let intensity = reader.value()?;
        let range = Some(reader.value::<f64>()?).filter(|range| range.is_finite());
        let [inner_cos, outer_cos] = reader.value()?;
        let kind = match kind {
            0 => LightKind::Directional,
            1 => LightKind::Point { range },
            2 => LightKind::Spot { range, inner_cos, outer_cos },
            _ => return Err(CodecError::Limit { what: "kind of a light", value: kind.into(), limit: 2 }),
        };
        let (position, direction) = (DVec3::from_array(reader.value()?), DVec3::from_array(reader.value()?));
        table.lights.push(LightRow { kind, intensity, position, direction });
    }
    reader.finish()?;
    Ok(table)
}

/// Checks that a table of `rows` rows has the row `number`.
fn row_number(what: &'static str, number: u32, rows: usize) -> Result<u32, CodecError> {
    if (number as usize) < rows {
        return Ok(number);
    }
    // The limit is exclusive; a table without rows has no largest number to name.
    Err(CodecError::Limit { what, value: u64::from(number) + 1, limit: rows as u64 })
}

/// Appends an affine map: 12 little-endian f64, the three columns of the matrix and the translation.
pub fn put_affine(out: &mut Vec<u8>, map: &DAffine3) {
    out.extend_from_slice(bytemuck::cast_slice(&map.to_cols_array()));
}

/// The reverse of [`put_affine`].
///
/// # Errors
/// [`CodecError::Truncated`].
pub fn take_affine(reader: &mut Reader<'_>) -> Result<DAffine3, CodecError> {
    Ok(DAffine3::from_cols_array(&reader.value::<[f64; 12]>()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{FromBoard, NeighbourMessage, TileMessage, ToBoard, split_tiles};
    use proptest::prelude::*;

    fn mesh() -> Mesh {
        Mesh {
            origin: DVec3::new(1.0, 2.0, 3.0),
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            normals: vec![[0.0, 0.0, 1.0]; 3],
            colors: Vec::new(),
            texcoords: vec![vec![[0.0; 2]; 3]],
            triangles: vec![[0, 1, 2]],
            face_numbers: vec![7],
            material: Material::default(),
            sphere: Sphere { centre: DVec3::ZERO, radius: 1.0 },
            bounds: Box3 { min: DVec3::ZERO, max: DVec3::ONE },
        }
    }

    #[test]
    fn meshes_textures_and_tables_come_back_as_they_went() {
        assert_eq!(decode_mesh(encode_mesh(&mesh())).unwrap(), mesh());
        let texture = Texture { width: 2, height: 1, texels: vec![[1, 2, 3, 4], [5, 6, 7, 8]] };
        assert_eq!(decode_texture(encode_texture(&texture)).unwrap(), texture);
        assert_eq!(decode_table(encode_table(&table())).unwrap(), table());
    }

    fn table() -> SceneTable {
        let part_of = Some(ModelPart { model: ModelId(0), version: 1 });
        SceneTable {
            objects: vec![ObjectRow { transform: DAffine3::from_translation(DVec3::X) }],
            subobjects: vec![SubobjectRow {
                object: ObjectId(0),
                mesh: ContentId([3; 16]),
                primitive: 5,
                layer: -2,
                part_of,
                planes: Some(0),
            }],
            models: vec![ModelRow { merged: true, versions: 2 }],
            planes: vec![PlaneRow { object: ObjectId(0), normal: DVec3::Y, offset: 3.0 }],
            face_planes: vec![0, NO_PLANE],
            lights: vec![LightRow {
                kind: LightKind::Spot { range: Some(9.0), inner_cos: 0.9, outer_cos: 0.8 },
                intensity: [1.0, 2.0, 3.0],
                position: DVec3::X,
                direction: DVec3::NEG_Y,
            }],
        }
    }

    #[test]
    fn a_row_that_names_a_row_that_is_not_there_is_refused() {
        let broken: [fn(&mut SceneTable); 6] = [
            |t| t.subobjects[0].object = ObjectId(1),
            |t| t.objects.clear(),
            |t| t.models.clear(),
            |t| t.models[0].versions = 1,
            |t| t.planes[0].object = ObjectId(7),
            |t| t.face_planes[0] = 1,
        ];
        for (i, break_it) in broken.iter().enumerate() {
            let mut table = table();
            break_it(&mut table);
            assert!(decode_table(encode_table(&table)).is_err(), "case {i}");
        }
    }

    #[test]
    fn names_of_pieces_come_back_and_are_bounded() {
        let ids = [ContentId([1; 16]), ContentId([2; 16])];
        let payload = encode_ids(&ids);
        assert_eq!(decode_ids(&payload, 2).unwrap(), ids);
        assert!(matches!(decode_ids(&payload, 1), Err(CodecError::Limit { .. })));
        assert!(matches!(decode_ids(&payload[..31], 2), Err(CodecError::Trailing(15, _))));
    }

    #[test]
    fn a_version_mismatch_names_both_sides() {
        let theirs = preamble(VersionRange { min: 7, max: 9 });
        let error = agree(VersionRange { min: 1, max: 2 }, &theirs).unwrap_err().to_string();
        assert!(error.contains("versions 1 to 2") && error.contains("versions 7 to 9"), "{error}");
        assert_eq!(agree(VersionRange { min: 1, max: 8 }, &theirs).unwrap(), 8);
        assert!(matches!(agree(VERSIONS, b"GET / HTTP/1.1\r\n"), Err(CodecError::Magic(_))));
    }

    #[test]
    fn a_claimed_giant_reserves_nothing() {
        let frame = encode(&[u64::MAX; 6], &[]);
        assert!(matches!(decode_table(frame), Err(CodecError::Limit { .. })));
        let mut header = BytesMut::new();
        header.put_u32_le(u32::MAX);
        assert!(matches!(decode::<u8>(header.freeze()), Err(CodecError::Truncated { .. })));
    }

    #[test]
    fn a_frame_too_large_is_refused_by_its_length_alone() {
        let mut framing = Framing::new(10);
        let mut bytes = BytesMut::from(&[11, 0, 0, 0][..]);
        let error = framing.decode(&mut bytes).unwrap_err().to_string();
        assert_eq!(error, "bytes of a message is 11, at most 10 are allowed");
        assert!(bytes.capacity() < 10, "{} bytes were reserved", bytes.capacity());
    }

    #[test]
    fn a_claim_reserves_no_more_than_its_bound_before_bytes_come() {
        let mut framing = Framing::new(limits::BULK_MESSAGE_MAX);
        let mut bytes = BytesMut::from(&(limits::BULK_MESSAGE_MAX as u32).to_le_bytes()[..]);
        assert!(framing.decode(&mut bytes).unwrap().is_none());
        assert!(bytes.capacity() <= 2 * limits::CLAIM_MAX, "{} bytes were reserved", bytes.capacity());
    }

    #[test]
    fn frames_come_out_whole_however_they_come_in_and_under_a_limit_that_changes() {
        let mut wire = BytesMut::new();
        let mut framing = Framing::new(4);
        for message in [&b"abc"[..], b"", b"abcdefgh"] {
            framing.encode(Bytes::from_static(message), &mut wire).unwrap();
        }
        let (mut bytes, mut frames) = (BytesMut::new(), Vec::new());
        for byte in wire {
            bytes.put_u8(byte);
            while let Some(frame) = framing.decode(&mut bytes).unwrap() {
                framing.set_incoming_max(8);
                frames.push(frame);
            }
        }
        assert_eq!(frames, [&b"abc"[..], b"", b"abcdefgh"]);
    }

    proptest! {
        #[test]
        fn random_bytes_never_panic_any_decoder(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            let bytes = Bytes::from(bytes);
            let _ = decode_mesh(bytes.clone());
            let _ = decode_texture(bytes.clone());
            let _ = decode_table(bytes.clone());
            let _ = decode::<ToBoard>(bytes.clone());
            let _ = decode::<FromBoard>(bytes.clone());
            let _ = decode::<TileMessage>(bytes.clone());
            let _ = decode::<NeighbourMessage>(bytes.clone());
            let _ = split_tiles(&bytes, 3, (100, 100), crate::frame::PixelFormat::Srgb8);
        }

        #[test]
        fn a_damaged_mesh_is_refused_or_has_equal_lengths(at in 0usize..400, byte in any::<u8>()) {
            let mut bytes = encode_mesh(&mesh()).to_vec();
            let at = at % bytes.len();
            bytes[at] = byte;
            if let Ok(mesh) = decode_mesh(bytes.into()) {
                prop_assert!(mesh.normals.is_empty() || mesh.normals.len() == mesh.positions.len());
                prop_assert_eq!(mesh.triangles.len(), mesh.face_numbers.len());
            }
        }
    }
}
