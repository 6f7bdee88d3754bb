//! The manifest: what each frame was, so that two flights, or two rigs, are compared without pictures.
//!
//! One JSON object a line, in the order in which frames were shown: number, what the picture depends on, and for each view that is shown here whether it
//! is new and the hash of every tile, row by row. Nothing in it depends on boards or time, so two flights in lock-step that show the same
//! have the same file, byte for byte.

use crate::sinks::SinkError;
use crate::stitch::{Shown, Stitcher};
use proto::frame::FrameRecord;
use proto::ids::FrameNumber;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Digits of a tile's hash: 64 bits.
const HASH_DIGITS: usize = 16;

/// A line.
#[derive(Serialize)]
struct Line<'a> {
    frame: FrameNumber,
    #[serde(flatten)]
    record: Option<&'a FrameRecord>,
    views: Vec<ViewLine>,
}

#[derive(Serialize)]
struct ViewLine {
    complete: bool,
    tiles: Vec<String>,
}

/// Records that may wait for their frame to be shown: more than frames can be under way.
const RECORDS_MAX: usize = 256;

/// A manifest that is being written.
#[derive(Debug)]
pub struct Manifest {
    path: PathBuf,
    file: BufWriter<File>,
    records: BTreeMap<FrameNumber, FrameRecord>,
}

impl Manifest {
    /// Begins a file anew.
    ///
    /// # Errors
    /// [`SinkError`] names the file.
    pub fn create(path: &Path) -> Result<Self, SinkError> {
        let file = File::create(path).map_err(|error| SinkError::new(path, error))?;
        Ok(Self { path: path.to_owned(), file: BufWriter::new(file), records: BTreeMap::new() })
    }

    /// What a frame depends on that will be shown, or passed over.
    pub fn on_record(&mut self, frame: FrameNumber, record: FrameRecord) {
        self.records.insert(frame, record);
        if self.records.len() > RECORDS_MAX {
            self.records.pop_first();
        }
    }

    /// Writes the line of the frame that is on the canvas. It is in the file when this returns, however the program ends.
    ///
    /// # Errors
    /// [`SinkError`] names the file.
    pub fn write(&mut self, shown: &Shown, stitcher: &Stitcher) -> Result<(), SinkError> {
        let short = |hash: blake3::Hash| hash.to_hex()[..HASH_DIGITS].to_owned();
        let views = stitcher.tile_hashes().into_iter().map(|(view, tiles)| ViewLine {
            complete: shown.complete.get(view.0 as usize).copied().unwrap_or(false),
            tiles: tiles.into_iter().map(short).collect(),
        });
        let later = self.records.split_off(&FrameNumber(shown.frame.0 + 1));
        let earlier = std::mem::replace(&mut self.records, later);
        let line = Line { frame: shown.frame, record: earlier.get(&shown.frame), views: views.collect() };
        let mut write = || -> std::io::Result<()> {
            serde_json::to_writer(&mut self.file, &line)?;
            self.file.write_all(b"\n")?;
            self.file.flush()
        };
        write().map_err(|error| SinkError::new(&self.path, error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::debug::DebugPicture;
    use proto::frame::{Environment, PixelFormat};
    use proto::view::{Pose, Samples, Tangents, View, ViewSetup};

    #[test]
    fn a_line_tells_a_tile_from_another_and_what_the_frame_depends_on() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("manifest.jsonl");
        let mut stitcher = Stitcher::new(PixelFormat::Srgb8, Vec::new());
        let row = View::row(2, 40, 33, Tangents::symmetric(45.0, 40, 33), Samples::One);
        assert!(stitcher.set_views(&row.into_iter().map(ViewSetup::new).collect::<Vec<_>>()));
        let record = FrameRecord {
            eye: Pose::IDENTITY,
            environment: Environment::default(),
            weights: Vec::new(),
            debug: DebugPicture::Off,
        };
        let shown = Shown {
            frame: FrameNumber(7),
            preview: false,
            moment: None,
            complete: vec![true, false],
            tiles: 0,
            skipped: 0,
        };
        let mut manifest = Manifest::create(&path).unwrap();
        manifest.on_record(FrameNumber(7), record);
        manifest.write(&shown, &stitcher).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let line: serde_json::Value = serde_json::from_str(text.trim_end()).unwrap();
        assert_eq!(line["frame"], 7);
        assert!(line["eye"]["position"].is_array() && line["environment"]["sun"].is_number(), "{line}");
        let [first, second] = [0, 1].map(|view| &line["views"][view]);
        assert_eq!((&first["complete"], &second["complete"]), (&true.into(), &false.into()));
        let tiles = first["tiles"].as_array().unwrap();
        assert_eq!(tiles.len(), 4, "two columns and two rows");
        assert_ne!(tiles[0], tiles[1], "of another size");
        assert_eq!(first["tiles"], second["tiles"], "both are black");
        let error = Manifest::create(Path::new("/dev/null/x")).unwrap_err().to_string();
        assert!(error.starts_with("/dev/null/x: "), "{error}");
    }
}
