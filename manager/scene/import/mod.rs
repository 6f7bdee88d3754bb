//! glTF 2.0 import: from a file's bytes to a [`Scene`].
//!
//! A scene file is outside input like a packet from the network: nothing in it is believed. The JSON is taken as plain
//! records from the `gltf` crate, whose own accessor code is not used, since it panics on files that its
//! validation has not seen; every index, length and number is checked where it is used, by the modules below, and a
//! fault names the place in the scene and the way out ([`Fault`]). What can be left out without a lie is left
//! out with a warning; what can't is refused.
//!
//! `container` opens a .glb, `uri` finds external parts, `accessor` reads binary data, `extension` decides what is
//! understood, `material` and `picture` make surfaces, `primitive` makes triangles, `light` makes lights, `extras` reads what
//! modellers say, `levels` finds levels of detail, `tree` walks the nodes.

mod accessor;
mod container;
mod error;
mod extension;
mod extras;
mod levels;
mod light;
mod material;
mod picture;
mod primitive;
#[cfg(test)]
mod tests;
mod tree;
mod uri;

pub use error::{Fault, ImportError};

use super::{Parts, Scene, ShapeIndex};
use accessor::Data;
use gltf::json::Root;
use gltf::json::mesh::Semantic;
use gltf::json::validation::Checked;
use proto::ids::ContentId;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// Most warnings that a scene keeps; a million broken primitives say no more than a hundred do.
const WARNINGS_MAX: usize = 100;

/// Loads a .glb or .gltf file with all that belongs to it.
///
/// # Errors
/// [`ImportError`], one line with the file's name.
pub fn load(path: &Path) -> Result<Scene, ImportError> {
    assemble(parts(path, &mut |_| ())?, &path.display().to_string())
}

/// What a .glb or .gltf file has, not yet assembled. `watch` is told now and then how much of it is read, from 0 to 1.
///
/// # Errors
/// As [`load`].
pub fn parts(path: &Path, watch: &mut dyn FnMut(f64)) -> Result<Parts, ImportError> {
    let file = path.display().to_string();
    let name = path.file_stem().map_or_else(|| file.clone(), |stem| stem.to_string_lossy().into_owned());
    uri::read_file(path)
        .and_then(|bytes| import(&bytes, name, Some(path.parent().unwrap_or(Path::new(""))), watch))
        .map_err(|fault| ImportError { file, fault: Box::new(fault) })
}

/// Loads a scene that is in memory and complete in itself: a .glb, or glTF JSON with data URIs. `name` stands for the
/// file in messages.
///
/// # Errors
/// [`ImportError`], one line that begins with `name`.
pub fn load_glb(bytes: &[u8], name: &str) -> Result<Scene, ImportError> {
    assemble(parts_glb(bytes, name, &mut |_| ())?, name)
}

/// What such a scene has, not yet assembled; see [`parts`].
///
/// # Errors
/// As [`load_glb`].
pub fn parts_glb(bytes: &[u8], name: &str, watch: &mut dyn FnMut(f64)) -> Result<Parts, ImportError> {
    let failed = |fault| ImportError { file: name.to_owned(), fault: Box::new(fault) };
    import(bytes, name.to_owned(), None, watch).map_err(failed)
}

fn assemble(parts: Parts, file: &str) -> Result<Scene, ImportError> {
    Scene::assemble(parts).map_err(|error| ImportError { file: file.to_owned(), fault: Box::new(error.into()) })
}

/// Sentences, each kept once.
#[derive(Debug, Default)]
struct Warnings {
    all: Vec<String>,
    more: usize,
}

impl Warnings {
    fn add(&mut self, warning: impl Into<String>) {
        let warning = warning.into();
        if self.all.contains(&warning) {
        } else if self.all.len() < WARNINGS_MAX {
            self.all.push(warning);
        } else {
            self.more += 1;
        }
    }

    fn finish(mut self) -> Vec<String> {
        if self.more > 0 {
            self.all.push(format!("and {} warnings more", self.more));
        }
        self.all
    }
}

/// What a picture counts as, in corners of triangles, to tell how far an import is. A guess: decoding takes some 5 ms, a corner 20 ns.
const PICTURE_CORNERS: u64 = 250_000;

/// Tells how far an import is.
struct Watch<'a> {
    tell: &'a mut dyn FnMut(f64),
    /// Corners of triangles, and pictures at what they count as.
    done: u64,
    all: u64,
}

impl<'a> Watch<'a> {
    /// Everything that the file describes; a scene may show less of it.
    fn new(root: &Root, tell: &'a mut dyn FnMut(f64)) -> Self {
        let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let corners = primitives.map(|primitive| corners(root, primitive)).fold(0u64, u64::saturating_add);
        let pictures = PICTURE_CORNERS.saturating_mul(root.images.len() as u64);
        Self { tell, done: 0, all: corners.saturating_add(pictures).max(1) }
    }

    fn on(&mut self, done: u64) {
        self.done = self.done.saturating_add(done);
        (self.tell)((self.done as f64 / self.all as f64).min(1.0));
    }
}

impl fmt::Debug for Watch<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {}", self.done, self.all)
    }
}

/// How many corners a primitive says that it has.
fn corners(root: &Root, primitive: &gltf::json::mesh::Primitive) -> u64 {
    let positions = || primitive.attributes.get(&Checked::Valid(Semantic::Positions)).copied();
    let accessor = primitive.indices.or_else(positions).and_then(|index| root.accessors.get(index.value()));
    accessor.map_or(0, |accessor| accessor.count.0)
}

/// An import under way: the file on one side, what has been made of it on the other.
#[derive(Debug)]
struct Importer<'a> {
    data: Data<'a>,
    folder: Option<&'a Path>,
    warnings: Warnings,
    parts: Parts,
    /// Meshes of the file that were made; `None`: without triangles.
    shapes: BTreeMap<usize, Option<ShapeIndex>>,
    /// Materials of the file that were made; key `None`: the default material.
    materials: BTreeMap<Option<usize>, material::Ready>,
    /// Images of the file that were made.
    textures: BTreeMap<usize, ContentId>,
    /// Triangles so far, each mesh once.
    triangles: u64,
    watch: Watch<'a>,
}

fn import(bytes: &[u8], name: String, folder: Option<&Path>, watch: &mut dyn FnMut(f64)) -> Result<Parts, Fault> {
    let (text, binary) = if bytes.starts_with(container::MAGIC) {
        container::chunks(bytes)?
    } else {
        (bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None)
    };
    if text.iter().find(|byte| !byte.is_ascii_whitespace()) != Some(&b'{') {
        return Err(Fault::NotGltf);
    }
    let malformed = |error: serde_json::Error| Fault::Json { message: error.to_string() };
    let root = Root::from_slice(text).map_err(malformed)?;
    if !root.asset.version.starts_with("2.") {
        return Err(Fault::Version { version: root.asset.version.chars().take(20).collect() });
    }
    let placements: tree::Placements = serde_json::from_slice(text).map_err(malformed)?;

    let mut warnings = Warnings::default();
    extension::check(&root, &mut warnings)?;
    if !root.animations.is_empty() {
        warnings.add("animations are not played: nodes stand where they are without them");
    }
    let data = Data { root: &root, buffers: buffers(&root, binary, folder)? };
    let mut importer = Importer {
        data,
        folder,
        warnings,
        parts: Parts { name, ..Parts::default() },
        shapes: BTreeMap::new(),
        materials: BTreeMap::new(),
        textures: BTreeMap::new(),
        triangles: 0,
        watch: Watch::new(&root, watch),
    };
    importer.tree(&placements)?;
    let Importer { mut parts, mut warnings, .. } = importer;
    if parts.nodes.iter().all(|node| node.shape.is_none()) {
        warnings.add("nothing is drawn: no node of the scene has a mesh with triangles");
    }
    parts.warnings = warnings.finish();
    Ok(parts)
}

/// All buffers of the file; the first may be the binary part of a .glb.
fn buffers<'a>(root: &Root, binary: Option<&'a [u8]>, folder: Option<&Path>) -> Result<Vec<Cow<'a, [u8]>>, Fault> {
    let mut all = Vec::with_capacity(root.buffers.len());
    for (buffer, described) in root.buffers.iter().enumerate() {
        let bytes: Cow<'a, [u8]> = match (&described.uri, binary) {
            (Some(address), _) => uri::read(address, &format!("buffer {buffer}"), folder)?.into(),
            (None, Some(binary)) if buffer == 0 => binary.into(),
            (None, _) => return Err(Fault::NoBuffer { buffer }),
        };
        if (bytes.len() as u64) < described.byte_length.0 {
            return Err(Fault::ShortBuffer { buffer, needs: described.byte_length.0, has: bytes.len() });
        }
        all.push(bytes);
    }
    Ok(all)
}
