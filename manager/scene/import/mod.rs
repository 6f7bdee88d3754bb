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
use proto::ids::ContentId;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

/// Most warnings that a scene keeps; a million broken primitives say no more than a hundred do.
const WARNINGS_MAX: usize = 100;

/// Loads a .glb or .gltf file with all that belongs to it.
///
/// # Errors
/// [`ImportError`], one line with the file's name.
pub fn load(path: &Path) -> Result<Scene, ImportError> {
    let file = path.display().to_string();
    let name = path.file_stem().map_or_else(|| file.clone(), |stem| stem.to_string_lossy().into_owned());
    uri::read_file(path)
        .and_then(|bytes| import(&bytes, name, Some(path.parent().unwrap_or(Path::new("")))))
        .map_err(|fault| ImportError { file, fault: Box::new(fault) })
}

/// Loads a scene that is in memory and complete in itself: a .glb, or glTF JSON with data URIs. `name` stands for the
/// file in messages.
///
/// # Errors
/// [`ImportError`], one line that begins with `name`.
pub fn load_glb(bytes: &[u8], name: &str) -> Result<Scene, ImportError> {
    import(bytes, name.to_owned(), None).map_err(|fault| ImportError { file: name.to_owned(), fault: Box::new(fault) })
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
}

fn import(bytes: &[u8], name: String, folder: Option<&Path>) -> Result<Scene, Fault> {
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
    };
    importer.tree(&placements)?;
    let Importer { mut parts, mut warnings, .. } = importer;
    if parts.nodes.iter().all(|node| node.shape.is_none()) {
        warnings.add("nothing is drawn: no node of the scene has a mesh with triangles");
    }
    parts.warnings = warnings.finish();
    Ok(Scene::assemble(parts)?)
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
