//! A scene into a file.
//!
//! Sections are written one after another while their checksums are made; header and index, which need those, come last, into the room
//! left for them. No more than one table and one payload are in memory beside the scene.

use super::error::{BakedError, BakedFault};
use super::file::{self, Entry, SECTIONS_BEGIN, Section};
use super::replace::Replacement;
use super::rows::{
    BoundsRow, BranchRow, ContentRow, ExtrasRow, LightRow, MaterialRow, NONE, NodeRow, PieceRow, PlaneRow, ShapeRow,
};
use crate::scene::bvh::Bvh;
use crate::scene::contents::Content;
use crate::scene::{Parts, Scene};
use proto::ids::ContentId;
use proto::scene::TextureUse;
use std::collections::BTreeMap;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

/// Hears how far the writing is, from 0 to 1, and says whether it is to go on.
pub type Watch<'a> = &'a mut dyn FnMut(f64) -> ControlFlow<()>;

/// Writes the scene that `scene` is, assembled from `parts`, to `target`: whole, or not at all.
///
/// `watch` is told now and then how far it is, from 0 to 1, and can end it.
///
/// # Errors
/// [`BakedError`]; the target is as it was then, unless it is the error of the last step, that the folder can't be synchronised.
pub fn write(parts: &Parts, scene: &Scene, target: &Path, watch: Watch<'_>) -> Result<(), BakedError> {
    let name = target.display().to_string();
    let begun = Replacement::begin(target).map_err(|fault| fault.of(&name))?;
    let written = write_sections(parts, scene, begun.file(), watch);
    written.and_then(|()| begun.finish()).map_err(|fault| fault.of(&name))
}

/// The same into memory.
#[cfg(test)]
pub(in crate::scene) fn to_bytes(parts: &Parts, scene: &Scene) -> Result<Vec<u8>, BakedFault> {
    let mut out = std::io::Cursor::new(Vec::new());
    write_sections(parts, scene, &mut out, &mut |_| ControlFlow::Continue(()))?;
    Ok(out.into_inner())
}

fn failed(error: std::io::Error) -> BakedFault {
    BakedFault::Io { what: "written", error }
}

struct Writer<W: Write + Seek> {
    out: BufWriter<W>,
    at: u64,
    entries: Vec<Entry>,
}

impl<W: Write + Seek> Writer<W> {
    fn bytes(&mut self, bytes: &[u8]) -> Result<(), BakedFault> {
        self.out.write_all(bytes).map_err(failed)?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// Goes to where a section may begin.
    fn begin(&mut self) -> Result<u64, BakedFault> {
        let begin = file::next_begin(self.at).ok_or(BakedFault::Length { needs: u64::MAX, has: self.at })?;
        self.bytes(&[0; 64][..(begin - self.at) as usize])?;
        Ok(begin)
    }

    fn table<T: bytemuck::NoUninit>(&mut self, section: Section, rows: &[T]) -> Result<(), BakedFault> {
        let bytes: &[u8] = bytemuck::cast_slice(rows);
        let begin = self.begin()?;
        // Before it is written: a scene that is too large should fail early.
        let entry = file::entry(section, begin, bytes.len() as u64, *blake3::hash(bytes).as_bytes())?;
        self.entries.push(entry);
        self.bytes(bytes)
    }

    /// Payloads and the table of them.
    fn contents<T: Content>(
        &mut self,
        (payloads, index): (Section, Section),
        all: &BTreeMap<ContentId, Arc<T>>,
        watch: &mut dyn FnMut(usize) -> ControlFlow<()>,
    ) -> Result<(), BakedFault> {
        let begin = self.begin()?;
        let mut rows = Vec::with_capacity(all.len());
        for (number, (id, held)) in all.iter().enumerate() {
            let payload = held.encode();
            rows.push(ContentRow { id: id.0, length: payload.len() as u32, size: held.size() });
            self.bytes(&payload)?;
            if watch(number + 1).is_break() {
                return Err(BakedFault::Interrupted);
            }
        }
        self.entries.push(file::entry(payloads, begin, self.at - begin, [0; 32])?);
        self.table(index, &rows)
    }
}

fn write_sections(parts: &Parts, scene: &Scene, out: impl Write + Seek, watch: Watch<'_>) -> Result<(), BakedFault> {
    let mut writer = Writer { out: BufWriter::with_capacity(1 << 20, out), at: 0, entries: Vec::new() };
    writer.bytes(&[0; SECTIONS_BEGIN])?;

    let mut lights = Vec::new();
    let mut light = |source| {
        lights.push(LightRow::of(source));
        lights.len() as u32 - 1
    };
    let nodes: Vec<NodeRow> =
        parts.nodes.iter().map(|node| NodeRow::of(node, node.light.as_ref().map(&mut light))).collect();
    writer.table(Section::Nodes, &nodes)?;
    drop(nodes);

    let shapes: Vec<ShapeRow> = scene
        .shapes
        .iter()
        .map(|shape| ShapeRow {
            bounds: BoundsRow::of(shape.sphere, shape.bounds),
            extras: ExtrasRow::of(&shape.extras),
            pieces: shape.pieces.len() as u32,
            branches: shape.tree.branches.len() as u32,
            items: shape.tree.items.len() as u32,
            zero: 0,
        })
        .collect();
    writer.table(Section::Shapes, &shapes)?;

    let row_of = |ids: Vec<ContentId>| move |id: &ContentId| ids.binary_search(id).map_or(NONE, |row| row as u32);
    let mesh = row_of(parts.meshes.keys().copied().collect());
    let pieces = scene.shapes.iter().flat_map(|shape| &shape.pieces);
    let pieces: Vec<PieceRow> = pieces.map(|piece| PieceRow::of(piece, mesh(&piece.mesh))).collect();
    writer.table(Section::Pieces, &pieces)?;
    drop(pieces);

    let texture = row_of(parts.textures.keys().copied().collect());
    let of_use = |usage: &TextureUse| texture(&usage.texture);
    let materials: Vec<MaterialRow> =
        scene.materials.iter().map(|entry| MaterialRow::of(&entry.material, of_use)).collect();
    writer.table(Section::Materials, &materials)?;
    writer.table(Section::Lights, &lights)?;

    let texts = || {
        std::iter::once(&scene.name)
            .chain(parts.nodes.iter().map(|node| &node.name))
            .chain(scene.shapes.iter().map(|shape| &shape.name))
            .chain(scene.materials.iter().map(|entry| &entry.name))
            .chain(&scene.warnings)
    };
    let lengths: Vec<u32> = texts().map(|text| text.len() as u32).collect();
    writer.table(Section::Lengths, &lengths)?;
    let text: Vec<u8> = texts().flat_map(|text| text.bytes()).collect();
    writer.table(Section::Text, &text)?;
    drop((lengths, text));

    let trees = || scene.shapes.iter().map(|shape| &shape.tree);
    let branches: Vec<BranchRow> = trees().flat_map(|tree: &Bvh| tree.branches.iter().map(BranchRow::of)).collect();
    writer.table(Section::Branches, &branches)?;
    drop(branches);
    let items: Vec<u32> = trees().flat_map(|tree| tree.items.iter().copied()).collect();
    writer.table(Section::Items, &items)?;
    drop(items);
    let names: Vec<u32> = scene.named_nodes().iter().map(|node| node.0).collect();
    writer.table(Section::Names, &names)?;
    drop(names);

    let table = &scene.table;
    let of_subobjects: Vec<u32> = if table.planes.is_empty() {
        Vec::new()
    } else {
        table.subobjects.iter().map(|row| row.planes.unwrap_or(NONE)).collect()
    };
    writer.table(Section::SubobjectPlanes, &of_subobjects)?;
    let planes: Vec<PlaneRow> = table.planes.iter().map(PlaneRow::of).collect();
    writer.table(Section::Planes, &planes)?;
    writer.table(Section::FacePlanes, &table.face_planes)?;

    // Nearly all bytes are in the payloads.
    let bytes = |sizes: [u32; 2], each: [f64; 2]| f64::from(sizes[0]) * each[0] + f64::from(sizes[1]) * each[1];
    let weights: Vec<f64> = parts
        .meshes
        .values()
        .map(|mesh| bytes(mesh.size(), [24.0, 16.0]))
        .chain(parts.textures.values().map(|texture| f64::from(texture.width) * f64::from(texture.height) * 4.0))
        .collect();
    let total: f64 = weights.iter().sum::<f64>().max(1.0);
    let (mut done, before) = (0.0, parts.meshes.len());
    let mut reached = |number: usize| {
        done += weights[number - 1];
        watch(done / total)
    };
    writer.contents((Section::Meshes, Section::MeshIndex), &parts.meshes, &mut reached)?;
    let of_texture = &mut |number| reached(before + number);
    writer.contents((Section::Textures, Section::TextureIndex), &parts.textures, of_texture)?;

    let head = file::head(&writer.entries, writer.at);
    writer.out.seek(SeekFrom::Start(0)).map_err(failed)?;
    writer.out.write_all(&head).and_then(|()| writer.out.flush()).map_err(failed)
}
