//! What a baked file says about itself, for `inspect`.

use super::error::BakedError;
use super::file::{BakedFile, FORMAT, MAGIC, Section};
use serde::Serialize;
use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// A baked file's frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Facts {
    /// Its format version.
    pub format: u32,
    /// Length of the file, bytes.
    pub bytes: u64,
    /// In the order in which they are in the file.
    pub sections: Vec<SectionFacts>,
}

/// A section of a baked file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SectionFacts {
    /// What it is called in messages.
    pub name: &'static str,
    /// Its rows; for payloads, their bytes.
    pub rows: u64,
    /// Its length, bytes.
    pub bytes: u64,
    /// When it is compared with its checksum: `opening`, or `use`, each mesh or texture by itself.
    pub checked_at: &'static str,
}

/// Whether a file begins like a baked one. Endings don't matter.
pub fn is_baked(path: &Path) -> bool {
    let mut begin = [0; MAGIC.len()];
    // A pipe would wait, and can't be read twice.
    path.is_file() && File::open(path).and_then(|mut file| file.read_exact(&mut begin)).is_ok() && begin == MAGIC
}

/// Reads a file's header and index.
///
/// # Errors
/// [`BakedError`].
pub fn facts(path: &Path) -> Result<Facts, BakedError> {
    let file = BakedFile::map(path)?;
    let sections = Section::all()
        .map(|section| SectionFacts {
            name: section.name(),
            rows: file.entry(section).rows,
            bytes: file.entry(section).length,
            checked_at: if section.is_payload() { "use" } else { "opening" },
        })
        .collect();
    Ok(Facts { format: FORMAT, bytes: file.len() as u64, sections })
}

impl fmt::Display for Facts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "baked file, format version {}, {} bytes", self.format, self.bytes)?;
        writeln!(f, "  {:<18} {:>12} {:>14}  checked at", "section", "rows", "bytes")?;
        for section in &self.sections {
            let SectionFacts { name, rows, bytes, checked_at } = section;
            writeln!(f, "  {name:<18} {rows:>12} {bytes:>14}  {checked_at}")?;
        }
        Ok(())
    }
}
