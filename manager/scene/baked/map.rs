//! A file's bytes: mapped into memory, or read.
//!
//! A map is as good as the file below it. Another program may write into the file or cut it short while it is mapped, and no language
//! rule or checksum at opening can prevent that. So the map is never looked at in place: whoever wants bytes gets a *copy*, and
//! checks and uses that. What changes after the copy changes nothing, what changed before it has another checksum, and what changes
//! during it does too.
//!
//! Touching a page beyond the end of a file that was cut short ends the process with SIGBUS. So the file's length is asked before
//! each copy, and another one than at opening is an error. That leaves the microseconds of the copy itself: only a program that
//! truncates a scene in place at that very moment can do harm. `bake` doesn't: it replaces files whole, and the old one lives on
//! below its maps.
#![expect(unsafe_code, reason = "the one place that reads mapped memory; see the safety comment")]

use super::error::BakedFault;
use memmap2::{MmapOptions, MmapRaw};
use std::fs::File;
use std::path::Path;

/// See the module's head.
#[derive(Debug)]
pub(super) enum Source {
    /// A file in the page cache.
    Mapped { map: MmapRaw, file: File },
    /// The whole in memory of our own.
    Memory(Vec<u8>),
}

impl Source {
    /// Maps an ordinary file.
    pub(super) fn map(path: &Path) -> Result<Self, BakedFault> {
        let file = ordinary(path)?;
        // Maps of nothing are refused by the system, and there is nothing to read in it.
        if length_of(&file)? == 0 {
            return Ok(Self::Memory(Vec::new()));
        }
        let map = MmapOptions::new().map_raw_read_only(&file);
        let map = map.map_err(|error| BakedFault::Io { what: "mapped into memory", error })?;
        Ok(Self::Mapped { map, file })
    }

    /// Bytes at hand; as long as the file was when it was opened.
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Mapped { map, .. } => map.len(),
            Self::Memory(bytes) => bytes.len(),
        }
    }

    /// Copies the bytes from `from` on into `to`.
    ///
    /// # Panics
    /// If they reach beyond [`Self::len`]: the caller's mistake, who checks what a file says.
    pub(super) fn copy(&self, from: usize, to: &mut [u8]) -> Result<(), BakedFault> {
        let end = from.checked_add(to.len()).filter(|end| *end <= self.len());
        assert!(end.is_some(), "bytes {from} and {} more of {}", to.len(), self.len());
        match self {
            Self::Memory(bytes) => to.copy_from_slice(&bytes[from..from + to.len()]),
            Self::Mapped { map, file } => {
                let (had, has) = (map.len() as u64, length_of(file)?);
                if had != has {
                    return Err(BakedFault::Changed { had, has });
                }
                // SAFETY: `from + to.len()` is within the map (asserted above), which lives as long as `self`, and `to` is our
                // caller's own memory and no part of it. No reference into the map is ever made, so nothing is assumed about bytes that
                // another process may be writing: the copy then has some mixture of them, and its checksum tells. If the file
                // has been cut short since its length was asked, the system ends this process with SIGBUS; memory is not corrupted.
                unsafe { std::ptr::copy_nonoverlapping(map.as_ptr().add(from), to.as_mut_ptr(), to.len()) }
            }
        }
        Ok(())
    }
}

/// An ordinary file, opened to be read. A device could go on for ever, so it is refused.
fn ordinary(path: &Path) -> Result<File, BakedFault> {
    let cannot = |error| BakedFault::Io { what: "opened", error };
    // Before it is opened: opening a pipe would wait for its writer.
    if !std::fs::metadata(path).map_err(cannot)?.is_file() {
        return Err(BakedFault::NotAFile);
    }
    File::open(path).map_err(cannot)
}

fn length_of(file: &File) -> Result<u64, BakedFault> {
    Ok(file.metadata().map_err(|error| BakedFault::Io { what: "looked at", error })?.len())
}

/// Reads an ordinary file whole: the plain alternative to a map.
pub(super) fn read(path: &Path) -> Result<Source, BakedFault> {
    ordinary(path)?;
    std::fs::read(path).map(Source::Memory).map_err(|error| BakedFault::Io { what: "read", error })
}
