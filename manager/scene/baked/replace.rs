//! A file that is written whole or not at all.
//!
//! The new content goes to a file beside the target, `NAME.part`, which takes the target's name only when all of it is on the disk:
//! renaming is one step of the file system, so at any time, also after a crash, the target's name means the whole old file or
//! the whole new one. Whoever has the old one open keeps it. What an interrupted write leaves behind is the part file, with a name that
//! says so; the next one takes it over. A lock on it, which ends with its process, tells a leftover from a file that somebody is
//! writing.

use super::error::BakedFault;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// A file under way; when it is dropped before [`Self::finish`], it is removed and the target stays as it was.
#[derive(Debug)]
pub(super) struct Replacement {
    file: File,
    part: PathBuf,
    target: PathBuf,
    is_finished: bool,
}

fn cannot(what: &'static str) -> impl Fn(io::Error) -> BakedFault {
    move |error| BakedFault::Io { what, error }
}

impl Replacement {
    /// Begins to replace `target`, which may not exist yet.
    pub(super) fn begin(target: &Path) -> Result<Self, BakedFault> {
        // A link stays a link: what it leads to is replaced.
        let target = match std::fs::canonicalize(target) {
            Ok(path) if !path.is_file() => return Err(BakedFault::NotAFile),
            Ok(path) => path,
            Err(error) if error.kind() == io::ErrorKind::NotFound => target.to_owned(),
            Err(error) => return Err(cannot("written")(error)),
        };
        let part = part_of(&target);
        loop {
            // Not emptied yet: it may be somebody's.
            let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&part);
            let file = file.map_err(cannot("written"))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(BakedFault::Busy),
                Err(TryLockError::Error(error)) => return Err(cannot("locked")(error)),
            }
            // Whoever held the lock until now may have given the file its final name: then it is not ours to write into.
            if is_at(&file, &part).map_err(cannot("written"))? {
                file.set_len(0).map_err(cannot("written"))?;
                return Ok(Self { file, part, target, is_finished: false });
            }
        }
    }

    /// Where the new content goes.
    pub(super) fn file(&self) -> &File {
        &self.file
    }

    /// Gives the new content the target's name.
    pub(super) fn finish(mut self) -> Result<(), BakedFault> {
        self.file.sync_all().map_err(cannot("written"))?;
        std::fs::rename(&self.part, &self.target).map_err(cannot("given its name"))?;
        self.is_finished = true;
        // The name is on the disk when its folder is.
        let folder = self.target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        File::open(folder).and_then(|folder| folder.sync_all()).map_err(cannot("given its name"))
    }
}

impl Drop for Replacement {
    fn drop(&mut self) {
        if !self.is_finished {
            // If even that fails the next writer takes the file over.
            let _ = std::fs::remove_file(&self.part);
        }
    }
}

/// Where the content of `target` is while it is written: beside it, since renaming doesn't cross file systems.
pub fn part_of(target: &Path) -> PathBuf {
    let mut name = target.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    target.with_file_name(name)
}

/// Whether `path` leads to `file`.
fn is_at(file: &File, path: &Path) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    let own = file.metadata()?;
    match std::fs::metadata(path) {
        Ok(there) => Ok((there.dev(), there.ino()) == (own.dev(), own.ino())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn the_old_file_stays_until_the_new_one_is_finished() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("city.baked");
        std::fs::write(&target, "old").unwrap();
        let mut reader = File::open(&target).unwrap();
        let new = Replacement::begin(&target).unwrap();
        new.file().write_all(b"new").unwrap();
        assert_eq!(std::fs::read(&target).unwrap(), b"old");
        new.finish().unwrap();
        assert_eq!(std::fs::read(&target).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["city.baked"]);
        assert_eq!(io::read_to_string(&mut reader).unwrap(), "old", "who has the old one open keeps it");
    }

    #[test]
    fn what_is_given_up_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("city.baked");
        let new = Replacement::begin(&target).unwrap();
        new.file().write_all(b"half").unwrap();
        assert_eq!(names(folder.path()), ["city.baked.part"]);
        drop(new);
        assert_eq!(names(folder.path()), Vec::<String>::new());
    }

    #[test]
    fn a_leftover_is_taken_over_and_a_busy_file_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("city.baked");
        std::fs::write(part_of(&target), "left over by a bake that was killed, and longer than the new one").unwrap();
        let new = Replacement::begin(&target).unwrap();
        assert!(matches!(Replacement::begin(&target), Err(BakedFault::Busy)));
        new.file().write_all(b"new").unwrap();
        new.finish().unwrap();
        assert_eq!(std::fs::read(&target).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["city.baked"]);
    }

    #[test]
    fn a_link_stays_a_link_and_a_folder_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let (target, link) = (folder.path().join("city.baked"), folder.path().join("link"));
        std::fs::write(&target, "old").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        let new = Replacement::begin(&link).unwrap();
        new.file().write_all(b"new").unwrap();
        new.finish().unwrap();
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(std::fs::read(&target).unwrap(), b"new");
        assert!(matches!(Replacement::begin(folder.path()), Err(BakedFault::NotAFile)));
    }
}
