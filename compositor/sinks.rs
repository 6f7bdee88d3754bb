//! Where stitched pictures go: files of every frame. (The console's are in `preview`.)
//!
//! Each sink has a thread of its own, because encoding takes longer than stitching. Files are never lost: their queue
//! is short and the daemon waits for room, which in lock-step holds the rig back to the speed of the disk.

use image::codecs::openexr::OpenExrEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageResult};
use proto::frame::PixelFormat;
use proto::ids::FrameNumber;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;
use tokio::sync::mpsc;

/// Pictures that may wait for the disk.
const FILES_QUEUE: usize = 4;

/// A stitched picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Which frame.
    pub frame: FrameNumber,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// What a pixel is.
    pub format: PixelFormat,
    /// All pixels, row-major, tightly packed.
    pub pixels: Vec<u8>,
}

/// What frames are written as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FileKind {
    /// PNG, sRGB, 8 bits.
    #[default]
    Png,
    /// OpenEXR, linear and unclamped, 32-bit floats.
    Exr,
    /// The bare pixels, 3 bytes each, sRGB, row-major: what a video encoder reads.
    Raw,
}

impl FileKind {
    /// What pixels it needs.
    pub const fn format(self) -> PixelFormat {
        match self {
            Self::Png | Self::Raw => PixelFormat::Srgb8,
            Self::Exr => PixelFormat::LinearF32,
        }
    }

    /// The files' extension.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Exr => "exr",
            Self::Raw => "rgb",
        }
    }

    /// The kind with this extension.
    pub fn of_extension(extension: &str) -> Option<Self> {
        [Self::Png, Self::Exr, Self::Raw].into_iter().find(|kind| kind.extension() == extension)
    }

    /// Writes a picture to a file, which appears only when it is whole.
    ///
    /// # Errors
    /// [`SinkError`] names the file.
    pub fn write(self, path: &Path, picture: &Picture) -> Result<(), SinkError> {
        if picture.format != self.format() {
            return Err(SinkError::new(path, "the picture's pixels are not what this kind of file has"));
        }
        let mut partial = path.as_os_str().to_owned();
        partial.push(".partial");
        let partial = PathBuf::from(partial);
        let write = || -> ImageResult<()> {
            let mut file = BufWriter::new(File::create(&partial)?);
            self.encode(&mut file, picture)?;
            file.flush()?;
            Ok(fs::rename(&partial, path)?)
        };
        write().map_err(|error| SinkError::new(path, error))
    }

    fn encode(self, file: &mut (impl Write + io::Seek), picture: &Picture) -> ImageResult<()> {
        let Picture { width, height, pixels, .. } = picture;
        match self {
            Self::Png => {
                let encoder = PngEncoder::new_with_quality(file, CompressionType::Fast, FilterType::Adaptive);
                encoder.write_image(pixels, *width, *height, ExtendedColorType::Rgb8)
            }
            Self::Exr => OpenExrEncoder::new(file).write_image(pixels, *width, *height, ExtendedColorType::Rgb32F),
            Self::Raw => Ok(file.write_all(pixels)?),
        }
    }
}

/// A sink failed.
#[derive(Debug, Error)]
#[error("{path}: {what}")]
pub struct SinkError {
    path: String,
    what: String,
}

impl SinkError {
    pub(crate) fn new(path: &Path, what: impl ToString) -> Self {
        Self { path: path.display().to_string(), what: what.to_string() }
    }
}

/// Writes every picture as `frame-00000.png` and so on.
#[derive(Debug)]
pub struct Files {
    queue: mpsc::Sender<Arc<Picture>>,
    thread: std::thread::JoinHandle<Result<u64, SinkError>>,
}

impl Files {
    /// Makes the folder and starts the writer.
    ///
    /// # Errors
    /// When the folder can't be made or the thread not be started.
    pub fn new(folder: PathBuf, kind: FileKind) -> Result<Self, SinkError> {
        fs::create_dir_all(&folder).map_err(|error| SinkError::new(&folder, error))?;
        let (queue, mut pictures) = mpsc::channel::<Arc<Picture>>(FILES_QUEUE);
        let path = folder.clone();
        let write_all = move || {
            pool::turns::go_along();
            let mut written = 0;
            while let Some(picture) = pictures.blocking_recv() {
                let file = folder.join(format!("frame-{:05}.{}", picture.frame.0, kind.extension()));
                kind.write(&file, &picture)?;
                written += 1;
            }
            Ok(written)
        };
        let thread = std::thread::Builder::new()
            .name("files".into())
            .spawn(write_all)
            .map_err(|error: io::Error| SinkError::new(&path, error))?;
        Ok(Self { queue, thread })
    }

    /// Hands a picture over; waits while the queue is full. False: the writer has failed, and [`Self::finish`] says why.
    pub async fn write(&self, picture: Arc<Picture>) -> bool {
        self.queue.send(picture).await.is_ok()
    }

    /// Waits until everything is on disk. Returns the number of files.
    ///
    /// # Errors
    /// The first file that couldn't be written.
    pub fn finish(self) -> Result<u64, SinkError> {
        drop(self.queue);
        self.thread.join().unwrap_or_else(|_| Err(SinkError { path: "file writer".into(), what: "it panicked".into() }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(frame: u64, format: PixelFormat, pixels: Vec<u8>) -> Picture {
        Picture { frame: FrameNumber(frame), width: 2, height: 1, format, pixels }
    }

    fn write(kind: FileKind, pictures: Vec<Picture>) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let count = pictures.len();
        let sink = Files::new(folder.path().join("new"), kind).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        for picture in pictures {
            assert!(runtime.block_on(sink.write(Arc::new(picture))));
        }
        assert_eq!(sink.finish().unwrap(), count as u64);
        assert_eq!(fs::read_dir(folder.path().join("new")).unwrap().count(), count, "no partial file is left");
        folder
    }

    #[test]
    fn files_are_whole_and_named_by_frame() {
        let pixels = vec![9, 8, 7, 6, 5, 4];
        let of = |frame| picture(frame, PixelFormat::Srgb8, pixels.clone());
        let folder = write(FileKind::Png, vec![of(3), of(12)]);
        let read = image::open(folder.path().join("new/frame-00012.png")).unwrap().into_rgb8();
        assert_eq!(read.as_raw(), &pixels);
        let folder = write(FileKind::Raw, vec![of(0)]);
        assert_eq!(fs::read(folder.path().join("new/frame-00000.rgb")).unwrap(), pixels);
    }

    #[test]
    fn exr_keeps_linear_values_beyond_one() {
        let values = [0.0f32, 0.25, 3.5, -0.125, 1e-6, 1.0];
        let pixels = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let folder = write(FileKind::Exr, vec![picture(1, PixelFormat::LinearF32, pixels)]);
        let read = image::open(folder.path().join("new/frame-00001.exr")).unwrap().into_rgb32f();
        assert_eq!(read.as_raw(), &values);
    }

    #[test]
    fn an_unwritable_folder_is_named() {
        let error = Files::new(PathBuf::from("/dev/null/x"), FileKind::Png).unwrap_err().to_string();
        assert!(error.starts_with("/dev/null/x: "), "{error}");
    }
}
