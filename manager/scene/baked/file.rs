//! The file's frame: a header, an index of sections, and the sections.
//!
//! | bytes | what |
//! |---|---|
//! | 0–7 | magic `\x89CYBAKE\n`: no text, and a transfer that changes line ends destroys it |
//! | 8–11 | the number 0x01020304: another byte order gives another one |
//! | 12–15 | format version |
//! | 16–19 | number of sections |
//! | 20–23 | zero |
//! | 24–31 | length of the file |
//! | 32–63 | BLAKE3 of bytes 0 to 31 and the index |
//! | 64… | the index, 64 bytes a section: number of the section, bytes a row, offset, length in bytes, rows, BLAKE3 of its content |
//!
//! All sections of [`SECTIONS`] are there, in that order, each at the next multiple of 64 behind the one before; so they can't overlap.
//! A *table* is copied, checked against its checksum and read when the file is opened. *Payloads* (meshes, textures) are read when
//! somebody wants one; each has its own checksum, its name, in a table, and the index has none for them together.

use super::error::{BakedError, BakedFault};
use super::map::Source;
use super::rows::{self, ContentRow};
use bytemuck::{Pod, Zeroable};
use bytes::Bytes;
use proto::ids::ContentId;
use proto::limits;
use std::path::Path;

/// The format version that this program writes and reads.
pub const FORMAT: u32 = 1;

/// First bytes of every baked file.
pub const MAGIC: [u8; 8] = *b"\x89CYBAKE\n";

const ORDER: u32 = 0x0102_0304;

/// Sections begin at multiples of this, so that any row is aligned.
const ALIGN: usize = 64;

/// A section of the file. The number is its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::scene) enum Section {
    /// The node tree, depth-first.
    Nodes,
    /// Meshes of the scene.
    Shapes,
    /// Their pieces.
    Pieces,
    /// Materials.
    Materials,
    /// Lights of nodes.
    Lights,
    /// Lengths of all texts: the scene's name, names of nodes, shapes, materials, then warnings.
    Lengths,
    /// All texts, one behind the other, UTF-8.
    Text,
    /// Culling trees of the shapes.
    Branches,
    /// What their branches enclose.
    Items,
    /// Nodes that have a name, by name.
    Names,
    /// For each subobject where its planes begin in the next but one; empty if none has any.
    SubobjectPlanes,
    /// Planes that faces share.
    Planes,
    /// For each face of such a subobject its plane.
    FacePlanes,
    /// Payloads of meshes.
    Meshes,
    /// Their names and lengths.
    MeshIndex,
    /// Payloads of textures.
    Textures,
    /// Their names and lengths.
    TextureIndex,
}

/// What is known of a section before any file is looked at.
#[derive(Clone, Copy, Debug)]
struct Spec {
    section: Section,
    name: &'static str,
    row_bytes: usize,
    rows_max: u64,
    is_payload: bool,
}

const fn table<T>(section: Section, name: &'static str, rows_max: usize) -> Spec {
    Spec { section, name, row_bytes: size_of::<T>(), rows_max: rows_max as u64, is_payload: false }
}

const fn payload(section: Section, name: &'static str) -> Spec {
    Spec { section, name, row_bytes: 1, rows_max: limits::BAKED_BYTES_MAX, is_payload: true }
}

const COUNT: usize = 17;

const SECTIONS: [Spec; COUNT] = [
    table::<rows::NodeRow>(Section::Nodes, "nodes", limits::NODES_MAX),
    table::<rows::ShapeRow>(Section::Shapes, "shapes", limits::OBJECTS_MAX),
    table::<rows::PieceRow>(Section::Pieces, "pieces", limits::SUBOBJECTS_MAX),
    table::<rows::MaterialRow>(Section::Materials, "materials", limits::CONTENTS_MAX),
    table::<rows::LightRow>(Section::Lights, "lights", limits::LIGHTS_MAX),
    table::<u32>(Section::Lengths, "lengths", 4 * limits::NODES_MAX),
    table::<u8>(Section::Text, "text", limits::TEXT_MAX),
    table::<rows::BranchRow>(Section::Branches, "branches", limits::SUBOBJECTS_MAX),
    table::<u32>(Section::Items, "items", 2 * limits::SUBOBJECTS_MAX),
    table::<u32>(Section::Names, "names", limits::NODES_MAX),
    table::<u32>(Section::SubobjectPlanes, "subobject planes", limits::SUBOBJECTS_MAX),
    table::<rows::PlaneRow>(Section::Planes, "planes", limits::SUBOBJECTS_MAX),
    table::<u32>(Section::FacePlanes, "face planes", limits::BULK_MESSAGE_MAX / 4),
    payload(Section::Meshes, "meshes"),
    table::<ContentRow>(Section::MeshIndex, "mesh index", limits::CONTENTS_MAX),
    payload(Section::Textures, "textures"),
    table::<ContentRow>(Section::TextureIndex, "texture index", limits::CONTENTS_MAX),
];

const _: () = {
    let mut at = 0;
    while at < COUNT {
        assert!(SECTIONS[at].section as usize == at, "the table is in the order of the sections");
        at += 1;
    }
};

impl Section {
    /// All, in order.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        SECTIONS.iter().map(|spec| spec.section)
    }

    fn spec(self) -> &'static Spec {
        &SECTIONS[self as usize]
    }

    /// What it is called in messages.
    pub(super) fn name(self) -> &'static str {
        self.spec().name
    }

    /// Whether it is read piece by piece, when somebody asks.
    pub(super) fn is_payload(self) -> bool {
        self.spec().is_payload
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Header {
    magic: [u8; 8],
    order: u32,
    format: u32,
    sections: u32,
    zero: u32,
    length: u64,
    checksum: [u8; 32],
}

/// A section in the index.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Entry {
    section: u32,
    row_bytes: u32,
    pub offset: u64,
    pub length: u64,
    pub rows: u64,
    checksum: [u8; 32],
}

/// Where the first section begins.
pub(super) const SECTIONS_BEGIN: usize = size_of::<Header>() + COUNT * size_of::<Entry>();

const _: () = assert!(size_of::<Header>() == 64 && size_of::<Entry>() == 64, "the table in the module's head");

/// Where the section after one that ends at `end` begins.
pub(super) fn next_begin(end: u64) -> Option<u64> {
    end.checked_next_multiple_of(ALIGN as u64)
}

/// An entry of the index for a section that is written.
pub(super) fn entry(section: Section, offset: u64, length: u64, checksum: [u8; 32]) -> Result<Entry, BakedFault> {
    let spec = section.spec();
    let rows = length / spec.row_bytes as u64;
    if rows > spec.rows_max {
        return Err(BakedFault::TooMany { section: spec.name, count: rows, limit: spec.rows_max });
    }
    let checksum = if spec.is_payload { [0; 32] } else { checksum };
    Ok(Entry { section: section as u32, row_bytes: spec.row_bytes as u32, offset, length, rows, checksum })
}

/// Header and index of a file of these sections.
pub(super) fn head(entries: &[Entry], length: u64) -> Vec<u8> {
    let sections = entries.len() as u32;
    let mut header =
        Header { magic: MAGIC, order: ORDER, format: FORMAT, sections, zero: 0, length, checksum: [0; 32] };
    let index: &[u8] = bytemuck::cast_slice(entries);
    header.checksum = checksum(&header, index);
    [bytemuck::bytes_of(&header), index].concat()
}

fn checksum(header: &Header, index: &[u8]) -> [u8; 32] {
    let covered = size_of::<Header>() - size_of_val(&header.checksum);
    let mut hasher = blake3::Hasher::new();
    hasher.update(&bytemuck::bytes_of(header)[..covered]).update(index);
    *hasher.finalize().as_bytes()
}

/// A mesh or texture in the file.
#[derive(Clone, Copy, Debug)]
pub(in crate::scene) struct IndexRow {
    /// Its name.
    pub id: ContentId,
    /// Where its payload begins in the file.
    pub start: usize,
    /// Length of its payload, bytes.
    pub length: usize,
    /// Vertices and triangles, or width and height.
    pub size: [u32; 2],
}

/// The rows of a table: a copy whose checksum is right.
#[derive(Debug)]
pub(super) struct Table {
    /// As many words as the bytes fill, so that rows are aligned.
    words: Vec<u64>,
    bytes: usize,
}

impl Table {
    /// The rows.
    pub(super) fn rows<T: Pod>(&self) -> &[T] {
        bytemuck::cast_slice(&bytemuck::cast_slice::<u64, u8>(&self.words)[..self.bytes])
    }
}

/// A baked file whose header and index are in order.
#[derive(Debug)]
pub(in crate::scene) struct BakedFile {
    name: String,
    source: Source,
    entries: [Entry; COUNT],
}

impl BakedFile {
    /// Maps the file and checks header and index.
    pub(super) fn map(path: &Path) -> Result<Self, BakedError> {
        let name = path.display().to_string();
        let source = Source::map(path).map_err(|fault| fault.of(&name))?;
        Self::new(name, source)
    }

    /// The same for bytes from `source`, called `name` in messages.
    pub(super) fn new(name: String, source: Source) -> Result<Self, BakedError> {
        match read_head(&source) {
            Ok(entries) => Ok(Self { name, source, entries }),
            Err(fault) => Err(fault.of(&name)),
        }
    }

    /// An error about this file.
    pub(super) fn error(&self, fault: BakedFault) -> BakedError {
        fault.of(&self.name)
    }

    /// Where a section is and how much it has.
    pub(super) fn entry(&self, section: Section) -> &Entry {
        &self.entries[section as usize]
    }

    /// Length of the file, bytes.
    pub(super) fn len(&self) -> usize {
        self.source.len()
    }

    /// A table, copied and checked. It takes as much memory as it has bytes.
    pub(super) fn table(&self, section: Section) -> Result<Table, BakedError> {
        let entry = self.entry(section);
        let bytes = entry.length as usize;
        let mut words = vec![0u64; bytes.div_ceil(size_of::<u64>())];
        let to = &mut bytemuck::cast_slice_mut::<u64, u8>(&mut words)[..bytes];
        self.source.copy(entry.offset as usize, to).map_err(|fault| self.error(fault))?;
        if *blake3::hash(to).as_bytes() != entry.checksum {
            return Err(self.error(BakedFault::Checksum { section: section.name() }));
        }
        Ok(Table { words, bytes })
    }

    /// The payload of a mesh or texture (`what`), copied and checked against its name.
    pub(in crate::scene) fn piece(
        &self,
        section: Section,
        row: &IndexRow,
        what: &'static str,
    ) -> Result<Bytes, BakedError> {
        let mut bytes = vec![0u8; row.length];
        self.source.copy(row.start, &mut bytes).map_err(|fault| self.error(fault))?;
        if ContentId::of(&bytes) != row.id {
            return Err(self.bad_piece(section, row, what, "damaged, its content has another name".into()));
        }
        Ok(bytes.into())
    }

    /// What is wrong with a mesh or texture.
    pub(in crate::scene) fn bad_piece(
        &self,
        section: Section,
        row: &IndexRow,
        what: &'static str,
        why: String,
    ) -> BakedError {
        self.error(BakedFault::Piece { section: section.name(), what, id: row.id, why })
    }
}

/// Reads and checks header and index. When it returns, every section lies within the file, has whole rows, and no more of them than
/// its limit.
fn read_head(source: &Source) -> Result<[Entry; COUNT], BakedFault> {
    let mut header = Header::zeroed();
    let has = source.len() as u64;
    let magic = bytemuck::bytes_of_mut(&mut header);
    let begin = source.len().min(magic.len());
    source.copy(0, &mut magic[..begin])?;
    let shown = begin.min(MAGIC.len());
    if begin == 0 || header.magic[..shown] != MAGIC[..shown] {
        return Err(BakedFault::NotBaked);
    }
    if has < SECTIONS_BEGIN as u64 {
        return Err(BakedFault::Length { needs: SECTIONS_BEGIN as u64, has });
    }
    if header.order == ORDER.swap_bytes() {
        return Err(BakedFault::Endianness);
    }
    // The checksum of another version may be anywhere; so its number comes first.
    if header.order == ORDER && header.format != FORMAT {
        return Err(BakedFault::Format { found: header.format, ours: FORMAT });
    }
    let mut entries = [Entry::zeroed(); COUNT];
    source.copy(size_of::<Header>(), bytemuck::cast_slice_mut(&mut entries))?;
    if header.checksum != checksum(&header, bytemuck::cast_slice(&entries)) {
        return Err(BakedFault::Header);
    }
    if header.length != has {
        return Err(BakedFault::Length { needs: header.length, has });
    }
    let fault = |spec: &Spec, what: String| Err(BakedFault::Index { section: spec.name, what });
    if header.order != ORDER || header.sections as usize != COUNT {
        return fault(&SECTIONS[0], format!("there are {} sections; there should be {COUNT}", header.sections));
    }
    let mut end = SECTIONS_BEGIN as u64;
    for (spec, entry) in SECTIONS.iter().zip(&entries) {
        if entry.section != spec.section as u32 || entry.row_bytes as usize != spec.row_bytes {
            return fault(spec, format!("it is section {} with rows of {} bytes", entry.section, entry.row_bytes));
        }
        if entry.rows > spec.rows_max {
            return Err(BakedFault::TooMany { section: spec.name, count: entry.rows, limit: spec.rows_max });
        }
        if entry.rows.checked_mul(spec.row_bytes as u64) != Some(entry.length) {
            return fault(spec, format!("{} rows take {} bytes", entry.rows, entry.length));
        }
        if Some(entry.offset) != next_begin(end) {
            return fault(spec, format!("it begins at byte {}, the one before ends at {end}", entry.offset));
        }
        end = match entry.offset.checked_add(entry.length) {
            Some(end) if end <= has => end,
            _ => return fault(spec, format!("it ends beyond the file's {has} bytes")),
        };
    }
    if end != has {
        return fault(&SECTIONS[COUNT - 1], format!("it ends at byte {end} of {has}, and nothing follows"));
    }
    Ok(entries)
}
