//! What can be wrong with a scene file, in words that say where and what to do.

use crate::scene::AssembleError;
use std::fmt;
use std::io;
use thiserror::Error;

/// Why a file could not be imported: one line, the file's name first.
#[derive(Debug)]
pub struct ImportError {
    /// The file, as the caller named it.
    pub file: String,
    /// What was wrong.
    pub fault: Box<Fault>,
}

impl fmt::Display for ImportError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.file, self.fault)
    }
}

impl std::error::Error for ImportError {
    // The fault is printed with the file; what lies behind it is not.
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.fault.source()
    }
}

/// What was wrong with the file. All of them are the file's fault, or that of whoever named it; nothing was loaded.
///
/// `place` is where in the scene, most often `node "name"`.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Fault {
    /// The scene file does not exist.
    #[error("no such file; check the path")]
    NoSuchFile,
    /// A folder or device.
    #[error("{path} is not an ordinary file; name a .glb or .gltf file")]
    NotAFile {
        /// What was named.
        path: String,
    },
    /// The system would not let us read it; the reason is this error's source.
    #[error("{path} cannot be read")]
    Unreadable {
        /// Which file.
        path: String,
        /// Why.
        #[source]
        error: io::Error,
    },
    /// A buffer or image in a file of its own does not exist.
    #[error("{what} is in \"{path}\", which does not exist; put that file beside the scene or export as .glb")]
    MissingFile {
        /// `buffer 0`, `image 3`.
        what: String,
        /// Where it was looked for.
        path: String,
    },
    /// A buffer or image names a place that a scene may not read from.
    #[error("{what} has the address \"{uri}\", {reason}; put the file in the scene's folder or export as .glb")]
    Address {
        /// `buffer 0`, `image 3`.
        what: String,
        /// The address, shortened.
        uri: String,
        /// Why it is refused.
        reason: &'static str,
    },
    /// A `data:` URI that does not decode.
    #[error("{what} has a malformed data URI ({reason}); export the scene again")]
    DataUri {
        /// `buffer 0`, `image 3`.
        what: String,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// Neither `glTF` magic nor JSON.
    #[error("neither binary glTF nor glTF JSON; export the scene as .glb or .gltf, version 2.0")]
    NotGltf,
    /// A glTF of another version.
    #[error("glTF version {version} is not supported; export the scene as version 2.0")]
    Version {
        /// The file's version.
        version: String,
    },
    /// The container of a .glb is damaged.
    #[error("damaged .glb: {what}; copy or export it again")]
    Container {
        /// What does not fit.
        what: String,
    },
    /// The JSON part is not glTF.
    #[error("malformed glTF: {message}; export the scene again")]
    Json {
        /// The parser's words, with line and column.
        message: String,
    },
    /// An extension without which the file can't be shown.
    #[error("requires the extension {name}, which is not supported; {remedy}")]
    Extension {
        /// Its name.
        name: String,
        /// What to do.
        remedy: String,
    },
    /// An index points at nothing.
    #[error("{place}: there is no {what} {index}, the file has {count}; export the scene again")]
    Dangling {
        /// Who points.
        place: String,
        /// At what kind of thing.
        what: &'static str,
        /// Which one.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A node has two parents, or is its own ancestor.
    #[error("{place} {how}; nodes must form a tree, so export the scene again")]
    NotATree {
        /// The node.
        place: String,
        /// `has two parents, …` or `is below itself`.
        how: String,
    },
    /// A node's transformation can't be used.
    #[error("{place} has {what}; set its transformation again")]
    Transform {
        /// The node.
        place: String,
        /// What is wrong.
        what: &'static str,
    },
    /// Levels of detail that don't make one thing.
    #[error("{place}: {what}; set its levels again")]
    Levels {
        /// The node.
        place: String,
        /// What is wrong.
        what: String,
    },
    /// A buffer has less data than it says.
    #[error("buffer {buffer} has {has} bytes, {needs} are declared; copy or export the scene again")]
    ShortBuffer {
        /// Which buffer.
        buffer: usize,
        /// Declared length.
        needs: u64,
        /// True length.
        has: usize,
    },
    /// A buffer without data.
    #[error("buffer {buffer} has no data: no URI and no binary part of a .glb; export the scene again")]
    NoBuffer {
        /// Which buffer.
        buffer: usize,
    },
    /// A buffer view or accessor reaches beyond what it looks into.
    #[error("{place}: {what} needs {needs} bytes of {whole}, which has {has}; copy or export the scene again")]
    OutOfBounds {
        /// Who needs it.
        place: String,
        /// `accessor 7`, `buffer view 2`.
        what: String,
        /// End of its data; [`u64::MAX`] if that can't even be computed.
        needs: u64,
        /// `buffer view 3`, `buffer 0`.
        whole: String,
        /// Its length.
        has: u64,
    },
    /// An accessor that can't be what it is used for.
    #[error("{place}: accessor {accessor} {what}; re-export the mesh")]
    Accessor {
        /// Who uses it.
        place: String,
        /// Which one.
        accessor: usize,
        /// What is wrong with it.
        what: String,
    },
    /// A number that is none.
    #[error("{place}: accessor {accessor} has {value} at element {element}; re-export the mesh")]
    NotFinite {
        /// Who uses it.
        place: String,
        /// Which accessor.
        accessor: usize,
        /// Which element.
        element: usize,
        /// `a NaN` or `an infinity`.
        value: &'static str,
    },
    /// A triangle corner that does not exist.
    #[error(
        "{place}: accessor {accessor} has index {index} at element {element}, but there are {vertices} vertices; re-export the mesh"
    )]
    IndexOutOfRange {
        /// Who uses it.
        place: String,
        /// Which accessor.
        accessor: usize,
        /// Which element.
        element: usize,
        /// Its value.
        index: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// Two attributes of one mesh differ in length.
    #[error("{place}: {attribute} has {count} elements for {vertices} vertices; re-export the mesh")]
    Length {
        /// The node.
        place: String,
        /// The attribute.
        attribute: String,
        /// Its length.
        count: usize,
        /// The number of positions.
        vertices: usize,
    },
    /// A material that can't be used.
    #[error("{material}: {what}; set it again")]
    Material {
        /// `material "glass"` or `material 3`.
        material: String,
        /// What is wrong with it.
        what: String,
    },
    /// A picture that can't be read.
    #[error("{what} {reason}")]
    Picture {
        /// `image 3 "wall"`.
        what: String,
        /// Why, and what to do.
        reason: String,
    },
    /// More than a limit allows.
    #[error("{place}: {count} {what}, at most {limit} are possible; split the scene")]
    TooMany {
        /// Where.
        place: String,
        /// Of what.
        what: &'static str,
        /// How many.
        count: u64,
        /// How many may be.
        limit: u64,
    },
    /// The parts are right but don't make a scene.
    #[error(transparent)]
    Assemble(#[from] AssembleError),
}
