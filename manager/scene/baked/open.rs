//! A file into a scene.
//!
//! All that is not a payload is read at once: copied, checked against its checksum, and turned into what an importer would have handed
//! over, and into what takes long to find out (shared planes, culling trees, the order of names). [`Scene::assemble`]'s own
//! code then makes the scene of it, so a baked scene can't differ from an imported one by a second way of doing the same.
//!
//! A checksum says that a file is as it was written, not that it was written by us. So every number that something is looked up
//! with, and every count, is checked here; a file with wrong trees or planes may show nonsense, which is its author's business, but
//! nothing reads beyond an end.

use super::error::{BakedError, BakedFault};
use super::file::{BakedFile, IndexRow, Section, Table};
use super::map;
use super::rows::{BranchRow, ContentRow, LightRow, MaterialRow, NONE, NodeRow, PieceRow, PlaneRow, ShapeRow, some};
use crate::scene::bvh::Bvh;
use crate::scene::contents::Contents;
use crate::scene::database::{Known, Planes};
use crate::scene::{MaterialEntry, NodeIndex, NodeSource, Parts, Piece, Scene, Shape};
use proto::ids::ContentId;
use proto::limits;
use proto::scene::{Mesh, NO_PLANE, Texture};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// Opens a baked file by memory map. Meshes and textures are read and checked when somebody asks for them.
///
/// # Errors
/// [`BakedError`], one line with the file's name and the section.
pub fn open(path: &Path) -> Result<Scene, BakedError> {
    scene(BakedFile::map(path)?)
}

/// Opens a baked file by reading all of it: the plain alternative, for comparison.
///
/// # Errors
/// As [`open`].
pub fn open_by_reading(path: &Path) -> Result<Scene, BakedError> {
    let name = path.display().to_string();
    let source = map::read(path).map_err(|fault| fault.of(&name))?;
    scene(BakedFile::new(name, source)?)
}

/// Opens what a baked file has, from memory. `name` stands for the file in messages.
///
/// # Errors
/// As [`open`].
pub fn open_bytes(bytes: Vec<u8>, name: &str) -> Result<Scene, BakedError> {
    scene(BakedFile::new(name.to_owned(), map::Source::Memory(bytes))?)
}

fn scene(file: BakedFile) -> Result<Scene, BakedError> {
    let file = Arc::new(file);
    let reader = Reader::new(&file)?;
    reader.scene().map_err(|fault| file.error(fault))
}

/// A row that can't be.
fn bad(section: Section, row: usize, what: impl Into<String>) -> BakedFault {
    BakedFault::Row { section: section.name(), row, what: what.into() }
}

/// Checks that there is a row `number` among `count`.
fn within(section: Section, row: usize, what: &str, number: u32, count: usize) -> Result<usize, BakedFault> {
    if (number as usize) < count {
        Ok(number as usize)
    } else {
        Err(bad(section, row, format!("{what} {number}, there are {count}")))
    }
}

struct Reader<'a> {
    file: &'a Arc<BakedFile>,
    /// By section; none for payloads.
    tables: Vec<Option<Table>>,
}

/// Takes texts in order.
struct Texts<'a> {
    lengths: std::iter::Enumerate<std::slice::Iter<'a, u32>>,
    text: &'a [u8],
}

impl Texts<'_> {
    fn next(&mut self) -> Result<String, BakedFault> {
        let Some((row, &length)) = self.lengths.next() else {
            return Err(bad(Section::Lengths, 0, "there are fewer texts than things that have one"));
        };
        let Some((text, rest)) = self.text.split_at_checked(length as usize) else {
            return Err(bad(Section::Lengths, row, format!("{length} bytes of text, {} are left", self.text.len())));
        };
        self.text = rest;
        let text = std::str::from_utf8(text).map_err(|_| bad(Section::Lengths, row, "its text is not UTF-8"))?;
        Ok(text.to_owned())
    }
}

/// Takes the trees of shapes.
struct Trees<'a> {
    branches: &'a [BranchRow],
    items: &'a [u32],
    /// Rows taken so far.
    taken: [usize; 2],
}

impl Trees<'_> {
    /// The next tree, over `things` things, of so many branches and items.
    fn next(&mut self, branches: usize, items: usize, things: usize) -> Result<Bvh, BakedFault> {
        let [row, item_row] = self.taken;
        let (Some((taken, rest)), Some((indices, rest_indices))) =
            (self.branches.split_at_checked(branches), self.items.split_at_checked(items))
        else {
            return Err(bad(Section::Branches, row, format!("{branches} branches and {items} items are not there")));
        };
        (self.branches, self.items, self.taken) = (rest, rest_indices, [row + branches, item_row + items]);
        let mut found = vec![false; things];
        for (i, &item) in indices.iter().enumerate() {
            let thing = within(Section::Items, item_row + i, "item", item, things)?;
            if std::mem::replace(&mut found[thing], true) {
                return Err(bad(Section::Items, item_row + i, format!("item {item} is there twice")));
            }
        }
        let read = taken
            .iter()
            .enumerate()
            .map(|(i, branch)| branch.branch().map_err(|what| bad(Section::Branches, row + i, what)));
        let tree = Bvh { branches: read.collect::<Result<_, _>>()?, items: indices.to_vec() };
        match tree.fault() {
            None => Ok(tree),
            Some((branch, what)) => Err(bad(Section::Branches, row + branch, what)),
        }
    }
}

impl<'a> Reader<'a> {
    /// Reads and checks all tables, on all processors.
    fn new(file: &'a Arc<BakedFile>) -> Result<Self, BakedError> {
        let sections: Vec<Section> = Section::all().collect();
        let read = |section: &Section| {
            if section.is_payload() { Ok(None) } else { file.table(*section).map(Some) }
        };
        Ok(Self { file, tables: sections.par_iter().map(read).collect::<Result<_, _>>()? })
    }

    fn rows<T: bytemuck::Pod>(&self, section: Section) -> &[T] {
        self.tables[section as usize].as_ref().map_or(&[], Table::rows)
    }

    fn scene(&self) -> Result<Scene, BakedFault> {
        let mesh_index = self.contents(Section::MeshIndex, Section::Meshes)?;
        let texture_index = self.contents(Section::TextureIndex, Section::Textures)?;
        let mut texts =
            Texts { lengths: self.rows(Section::Lengths).iter().enumerate(), text: self.rows(Section::Text) };
        let mut trees =
            Trees { branches: self.rows(Section::Branches), items: self.rows(Section::Items), taken: [0; 2] };

        let name = texts.next()?;
        let nodes = self.nodes(&mut texts)?;
        let shapes = self.shapes(&mut texts, &mut trees, &mesh_index)?;
        let materials = self.materials(&mut texts, &texture_index)?;
        let mut warnings = Vec::new();
        while texts.lengths.len() > 0 {
            warnings.push(texts.next()?);
        }
        if !texts.text.is_empty() {
            return Err(bad(Section::Lengths, 0, format!("{} bytes of text are nobody's", texts.text.len())));
        }
        let objects = nodes.iter().filter(|node| node.shape.is_some()).count();
        if !trees.branches.is_empty() || !trees.items.is_empty() {
            let (branches, items) = (trees.branches.len(), trees.items.len());
            return Err(bad(
                Section::Branches,
                trees.taken[0],
                format!("{branches} branches and {items} items are nobody's"),
            ));
        }
        let planes = self.planes(objects)?;
        let names = self.names(&nodes)?;
        let known = Known {
            meshes: Contents::baked(Arc::clone(self.file), Section::Meshes, mesh_index),
            textures: Contents::baked(Arc::clone(self.file), Section::Textures, texture_index),
            names,
            planes,
        };
        let parts = Parts { name, nodes, shapes, materials, warnings, ..Parts::default() };
        let scene = Scene::assemble_known(parts, known)?;
        self.check(&scene)?;
        Ok(scene)
    }

    /// An index of payloads, with where each begins. They fill their section.
    fn contents(&self, index: Section, payloads: Section) -> Result<Arc<[IndexRow]>, BakedFault> {
        let entry = self.file.entry(payloads);
        let (mut start, end) = (entry.offset, entry.offset + entry.length);
        let rows: &[ContentRow] = self.rows(index);
        let mut read = Vec::with_capacity(rows.len());
        for (i, row) in rows.iter().enumerate() {
            if i > 0 && rows[i - 1].id >= row.id {
                return Err(bad(index, i, "names don't ascend"));
            }
            if row.length as usize > limits::BULK_MESSAGE_MAX {
                return Err(bad(index, i, format!("{} bytes, at most {}", row.length, limits::BULK_MESSAGE_MAX)));
            }
            if u64::from(row.length) > end - start {
                return Err(bad(index, i, format!("{} bytes, {} are left in the section", row.length, end - start)));
            }
            let size = row.size;
            read.push(IndexRow { id: ContentId(row.id), start: start as usize, length: row.length as usize, size });
            start += u64::from(row.length);
        }
        if start != end {
            return Err(bad(index, rows.len(), format!("{} bytes of payload are nobody's", end - start)));
        }
        Ok(read.into())
    }

    fn nodes(&self, texts: &mut Texts<'_>) -> Result<Vec<NodeSource>, BakedFault> {
        let rows: &[NodeRow] = self.rows(Section::Nodes);
        let lights: &[LightRow] = self.rows(Section::Lights);
        let shapes = self.rows::<ShapeRow>(Section::Shapes).len();
        let mut nodes: Vec<NodeSource> = Vec::with_capacity(rows.len());
        // The way from the root to the node before: the only nodes that a next one can hang on.
        let mut above: Vec<u32> = Vec::new();
        let mut next_light = 0;
        for (i, row) in rows.iter().enumerate() {
            let bad = |what: String| bad(Section::Nodes, i, what);
            let (mut node, light) = row.node().map_err(bad)?;
            node.name = texts.next()?;
            while above.last().copied() != node.parent {
                if above.pop().is_none() {
                    return Err(bad(format!("its parent is {:?}, which is not above the node before", node.parent)));
                }
            }
            above.push(i as u32);
            if let Some(shape) = node.shape {
                within(Section::Nodes, i, "shape", shape.0, shapes)?;
            }
            if let Some(light) = light {
                // Each light is a node's, in order: so a file can't make more of them than it has.
                if light != next_light {
                    return Err(bad(format!("light {light}, the next is {next_light}")));
                }
                let row = within(Section::Nodes, i, "light", light, lights.len())?;
                let read = lights[row].light().map_err(|what| self::bad(Section::Lights, row, what))?;
                (node.light, next_light) = (Some(read), light + 1);
            }
            nodes.push(node);
        }
        Ok(nodes)
    }

    fn shapes(
        &self,
        texts: &mut Texts<'_>,
        trees: &mut Trees<'_>,
        meshes: &[IndexRow],
    ) -> Result<Vec<Shape>, BakedFault> {
        let mut pieces = self.rows::<PieceRow>(Section::Pieces).iter().enumerate();
        let materials = self.rows::<MaterialRow>(Section::Materials).len();
        let mut shapes = Vec::with_capacity(self.rows::<ShapeRow>(Section::Shapes).len());
        for (i, row) in self.rows::<ShapeRow>(Section::Shapes).iter().enumerate() {
            let bad = |what: String| bad(Section::Shapes, i, what);
            let count = row.pieces as usize;
            if count == 0 || count > pieces.len() {
                return Err(bad(format!("{count} pieces, {} are left", pieces.len())));
            }
            let mut own: Vec<Piece> = Vec::with_capacity(count);
            for (at, row) in pieces.by_ref().take(count) {
                let piece = piece(at, row, meshes, materials)?;
                if own.last().is_some_and(|before| before.primitive > piece.primitive) {
                    return Err(self::bad(Section::Pieces, at, "primitives don't ascend"));
                }
                own.push(piece);
            }
            let (sphere, bounds) = row.bounds.bounds().map_err(bad)?;
            shapes.push(Shape {
                name: texts.next()?,
                extras: row.extras.extras().map_err(bad)?,
                pieces: own,
                sphere,
                bounds,
                tree: trees.next(row.branches as usize, row.items as usize, count)?,
            });
        }
        match pieces.len() {
            0 => Ok(shapes),
            left => Err(bad(Section::Shapes, shapes.len(), format!("{left} pieces are nobody's"))),
        }
    }

    fn materials(&self, texts: &mut Texts<'_>, textures: &[IndexRow]) -> Result<Vec<MaterialEntry>, BakedFault> {
        let rows: &[MaterialRow] = self.rows(Section::Materials);
        let id = |row: u32| {
            let found = textures.get(row as usize).map(|row| row.id);
            found.ok_or_else(|| format!("texture {row}, there are {}", textures.len()))
        };
        let mut materials = Vec::with_capacity(rows.len());
        for (i, row) in rows.iter().enumerate() {
            let material = row.material(id).map_err(|what| bad(Section::Materials, i, what))?;
            materials.push(MaterialEntry { name: texts.next()?, material });
        }
        Ok(materials)
    }

    fn planes(&self, objects: usize) -> Result<Planes, BakedFault> {
        let rows: &[PlaneRow] = self.rows(Section::Planes);
        let mut planes = Vec::with_capacity(rows.len());
        for (i, row) in rows.iter().enumerate() {
            within(Section::Planes, i, "object", row.object, objects)?;
            planes.push(row.plane().map_err(|what| bad(Section::Planes, i, what))?);
        }
        let of_faces: &[u32] = self.rows(Section::FacePlanes);
        if let Some(i) = of_faces.iter().position(|&plane| plane != NO_PLANE && plane as usize >= planes.len()) {
            within(Section::FacePlanes, i, "plane", of_faces[i], planes.len())?;
        }
        Ok(Planes { planes, of_faces: of_faces.to_vec(), of_subobjects: self.rows(Section::SubobjectPlanes).to_vec() })
    }

    /// The named nodes by name: as many as have one, strictly ascending, hence all of them.
    fn names(&self, nodes: &[NodeSource]) -> Result<Vec<NodeIndex>, BakedFault> {
        let rows: &[u32] = self.rows(Section::Names);
        let mut before: Option<(&str, u32)> = None;
        for (i, &node) in rows.iter().enumerate() {
            let name = nodes[within(Section::Names, i, "node", node, nodes.len())?].name.as_str();
            if name.is_empty() || before.is_some_and(|before| before >= (name, node)) {
                return Err(bad(Section::Names, i, format!("node {node} is not in order")));
            }
            before = Some((name, node));
        }
        let named = nodes.iter().filter(|node| !node.name.is_empty()).count();
        if named != rows.len() {
            return Err(bad(Section::Names, rows.len(), format!("{named} nodes have a name")));
        }
        Ok(rows.iter().map(|&node| NodeIndex(node)).collect())
    }

    /// What only the assembled scene tells.
    fn check(&self, scene: &Scene) -> Result<(), BakedFault> {
        let table = &scene.table;
        let given = self.rows::<u32>(Section::SubobjectPlanes);
        if !given.is_empty() && given.len() != table.subobjects.len() {
            let what = format!("there are {} subobjects", table.subobjects.len());
            return Err(bad(Section::SubobjectPlanes, given.len(), what));
        }
        if !given.is_empty() {
            let pieces = scene.objects.iter().flat_map(|object| &scene.shape_of(object).pieces);
            for (i, (piece, &begin)) in pieces.zip(given).enumerate() {
                let faces = table.face_planes.len();
                if some(begin).is_some_and(|begin| begin as usize + piece.triangles as usize > faces) {
                    let what = format!("its {} faces begin at {begin}, there are {faces}", piece.triangles);
                    return Err(bad(Section::SubobjectPlanes, i, what));
                }
            }
        }
        for (i, node) in scene.nodes.iter().enumerate() {
            let Some(part) = node.part() else { continue };
            let versions = table.models[part.model.0 as usize].versions;
            if part.version >= versions {
                return Err(bad(Section::Nodes, i, format!("version {} of {versions}", part.version)));
            }
        }
        Ok(())
    }
}

fn piece(at: usize, row: &PieceRow, meshes: &[IndexRow], materials: usize) -> Result<Piece, BakedFault> {
    let bad = |what: String| bad(Section::Pieces, at, what);
    let mesh = &meshes[within(Section::Pieces, at, "mesh", row.mesh, meshes.len())?];
    within(Section::Pieces, at, "material", row.material, materials)?;
    let [vertices, triangles] = mesh.size;
    for (what, count, limit) in [
        ("triangles", triangles, limits::TRIANGLES_PER_SUBOBJECT_MAX),
        ("vertices", vertices, 3 * limits::TRIANGLES_PER_SUBOBJECT_MAX),
    ] {
        if count as usize > limit {
            return Err(bad(format!("its mesh has {count} {what}, at most {limit} are possible")));
        }
    }
    if row.primitive == NONE {
        return Err(bad("a primitive without number".into()));
    }
    let (sphere, bounds) = row.bounds.bounds().map_err(bad)?;
    let (layer, merged) = row.marks().map_err(bad)?;
    Ok(Piece {
        mesh: mesh.id,
        sphere,
        bounds,
        triangles,
        vertices,
        material: row.material,
        primitive: row.primitive,
        layer,
        merged,
    })
}

/// Reads every mesh and texture and checks it, beyond what opening has checked.
///
/// # Errors
/// [`super::super::ContentError`] at the first that is damaged.
pub fn check_all(scene: &Scene) -> Result<(), super::super::ContentError> {
    fn each<T: super::super::Content>(contents: &Contents<T>) -> Result<(), super::super::ContentError> {
        contents.keys().try_for_each(|id| contents.get(id).map(drop))
    }
    each::<Mesh>(&scene.meshes).and_then(|()| each::<Texture>(&scene.textures))
}
