//! What can be wrong with a baked file, in words that say where and what to do.

use crate::scene::AssembleError;
use proto::ids::ContentId;
use std::fmt;
use std::io;
use thiserror::Error;

/// Why a baked file can't be opened, read or written: one line, the file's name first.
#[derive(Debug)]
pub struct BakedError {
    /// The file, as the caller named it.
    pub file: String,
    /// What was wrong.
    pub fault: Box<BakedFault>,
}

impl fmt::Display for BakedError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.file, self.fault)
    }
}

impl std::error::Error for BakedError {
    // The fault is printed with the file; what lies behind it is not.
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.fault.source()
    }
}

/// What was wrong. Those about sections are the file's fault: it was damaged, cut short, or made by somebody who means harm.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BakedFault {
    /// The system would not let us; the reason is this error's source.
    #[error("cannot be {what}")]
    Io {
        /// `opened`, `mapped`, `written` …
        what: &'static str,
        /// Why.
        #[source]
        error: io::Error,
    },
    /// A folder or device.
    #[error("is not an ordinary file; name a file that `cyclorama bake` wrote")]
    NotAFile,
    /// It begins with something else.
    #[error("is not a baked scene (it begins with something else); bake it from its glTF file")]
    NotBaked,
    /// Shorter than its header, or than that says.
    #[error("damaged: {has} bytes long, {needs} are expected; bake it again")]
    Length {
        /// How long it should be.
        needs: u64,
        /// How long it is.
        has: u64,
    },
    /// Written on a machine of the other byte order.
    #[error("was baked on a machine with the other byte order; bake it on this kind of machine")]
    Endianness,
    /// Another version of the format.
    #[error("has format version {found}, this program reads {ours}; bake it again with this program")]
    Format {
        /// The file's.
        found: u32,
        /// Ours.
        ours: u32,
    },
    /// Header or index don't have the checksum that they name.
    #[error("damaged: its header and index don't have their checksum; bake it again")]
    Header,
    /// The index contradicts itself.
    #[error("section {section}: the index says that {what}; bake it again")]
    Index {
        /// Which section.
        section: &'static str,
        /// What can't be.
        what: String,
    },
    /// More than a limit allows.
    #[error("section {section}: {count} rows, at most {limit} are possible; split the scene")]
    TooMany {
        /// Which section.
        section: &'static str,
        /// How many.
        count: u64,
        /// How many may be.
        limit: u64,
    },
    /// A section's content doesn't have its checksum.
    #[error("section {section}: damaged, its content doesn't have its checksum; bake it again")]
    Checksum {
        /// Which section.
        section: &'static str,
    },
    /// A row that can't be.
    #[error("section {section}, row {row}: {what}; bake it again")]
    Row {
        /// Which section.
        section: &'static str,
        /// Which row.
        row: usize,
        /// What is wrong with it.
        what: String,
    },
    /// A mesh or texture that isn't what it is called.
    #[error("section {section}: {what} {id}: {why}; bake the scene again")]
    Piece {
        /// Which section.
        section: &'static str,
        /// `mesh` or `texture`.
        what: &'static str,
        /// Its name.
        id: ContentId,
        /// What is wrong with it.
        why: String,
    },
    /// The file has another length than when it was opened.
    #[error(
        "was changed while in use ({had} bytes when it was opened, {has} now); bake replaces files whole, other programs must too"
    )]
    Changed {
        /// Its length when it was opened.
        had: u64,
        /// Its length now.
        has: u64,
    },
    /// Whoever watched the writing had it stopped.
    #[error("is not written: interrupted; what was there before is as it was")]
    Interrupted,
    /// Somebody else writes the same file.
    #[error("is being written by another bake; wait for that")]
    Busy,
    /// The rows are right but don't make a scene.
    #[error(transparent)]
    Assemble(#[from] AssembleError),
}

impl BakedFault {
    pub(super) fn of(self, file: &str) -> BakedError {
        BakedError { file: file.to_owned(), fault: Box::new(self) }
    }
}
