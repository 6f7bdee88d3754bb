//! Where stitched pictures go: PNG files, and the console's preview.
//!
//! Each sink has a thread of its own, because encoding takes longer than stitching. Files are never lost: their queue
//! is short and the daemon waits for room, which in lock-step holds the rig back to the speed of the disk. A preview is
//! only ever a look: when the encoder is busy the picture is skipped.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use proto::ids::FrameNumber;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;
use tokio::sync::mpsc;

/// Pictures that may wait for the disk.
const FILES_QUEUE: usize = 4;
/// A preview is made narrower than this, pixels.
const PREVIEW_WIDTH_MAX: u32 = 1920;
const PREVIEW_QUALITY: u8 = 85;

/// A stitched picture: sRGB, 3 bytes a pixel, row-major.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Which frame.
    pub frame: FrameNumber,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// All pixels.
    pub rgb: Vec<u8>,
}

/// A sink failed.
#[derive(Debug, Error)]
#[error("{path}: {what}")]
pub struct SinkError {
    path: String,
    what: String,
}

impl SinkError {
    fn new(path: &Path, what: impl ToString) -> Self {
        Self { path: path.display().to_string(), what: what.to_string() }
    }
}

/// Writes `rgb` (or linear grey when `color` says so) as PNG to a file that appears only when it is whole.
///
/// # Errors
/// [`SinkError`] names the file.
pub fn write_png(path: &Path, width: u32, height: u32, rgb: &[u8]) -> Result<(), SinkError> {
    let partial = path.with_extension("png.partial");
    let write = || -> Result<(), image::ImageError> {
        let mut file = BufWriter::new(File::create(&partial)?);
        PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Adaptive).write_image(
            rgb,
            width,
            height,
            ExtendedColorType::Rgb8,
        )?;
        file.flush()?;
        Ok(fs::rename(&partial, path)?)
    };
    write().map_err(|error| SinkError::new(path, error))
}

/// Writes every picture as `frame-00000.png` and so on.
#[derive(Debug)]
pub struct PngFiles {
    queue: mpsc::Sender<Arc<Picture>>,
    thread: std::thread::JoinHandle<Result<u64, SinkError>>,
}

impl PngFiles {
    /// Makes the folder and starts the writer.
    ///
    /// # Errors
    /// When the folder can't be made or the thread not be started.
    pub fn new(folder: PathBuf) -> Result<Self, SinkError> {
        fs::create_dir_all(&folder).map_err(|error| SinkError::new(&folder, error))?;
        let (queue, mut pictures) = mpsc::channel::<Arc<Picture>>(FILES_QUEUE);
        let path = folder.clone();
        let write_all = move || {
            let mut written = 0;
            while let Some(picture) = pictures.blocking_recv() {
                let file = folder.join(format!("frame-{:05}.png", picture.frame.0));
                write_png(&file, picture.width, picture.height, &picture.rgb)?;
                written += 1;
            }
            Ok(written)
        };
        let thread = std::thread::Builder::new()
            .name("png".into())
            .spawn(write_all)
            .map_err(|error: io::Error| SinkError::new(&path, error))?;
        Ok(Self { queue, thread })
    }

    /// Hands a picture over; waits while the queue is full. An error of the writer comes out of [`Self::finish`], and
    /// false from here.
    pub async fn write(&self, picture: Arc<Picture>) -> bool {
        self.queue.send(picture).await.is_ok()
    }

    /// Waits until everything is on disk. Returns the number of files.
    ///
    /// # Errors
    /// The first file that couldn't be written.
    pub fn finish(self) -> Result<u64, SinkError> {
        drop(self.queue);
        self.thread.join().unwrap_or_else(|_| Err(SinkError { path: "png writer".into(), what: "it panicked".into() }))
    }
}

/// A JPEG of the picture for the console, at most 1920 pixels wide (whole-number box reduction).
pub fn preview(picture: &Picture) -> Vec<u8> {
    let step = picture.width.div_ceil(PREVIEW_WIDTH_MAX).max(1);
    let (width, height) = (picture.width / step, picture.height / step);
    let mut small = Vec::with_capacity((width * height * 3) as usize);
    for y in 0..height {
        for x in 0..width {
            for c in 0..3 {
                let sum: u32 = (0..step * step)
                    .map(|k| {
                        let (px, py) = (x * step + k % step, y * step + k / step);
                        u32::from(picture.rgb[((py * picture.width + px) * 3 + c) as usize])
                    })
                    .sum();
                small.push((sum / (step * step)) as u8);
            }
        }
    }
    let mut jpeg = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut jpeg, PREVIEW_QUALITY);
    let (Ok(w), Ok(h)) = (u16::try_from(width), u16::try_from(height)) else { return Vec::new() };
    match encoder.encode(&small, w, h, jpeg_encoder::ColorType::Rgb) {
        Ok(()) => jpeg,
        Err(error) => {
            tracing::warn!(%error, "preview not encoded");
            Vec::new()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_whole_and_named_by_frame() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("new");
        let sink = PngFiles::new(out.clone()).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        for frame in [3, 12] {
            let picture = Picture { frame: FrameNumber(frame), width: 2, height: 1, rgb: vec![9, 8, 7, 6, 5, 4] };
            assert!(runtime.block_on(sink.write(Arc::new(picture))));
        }
        assert_eq!(sink.finish().unwrap(), 2);
        let read = image::open(out.join("frame-00012.png")).unwrap().into_rgb8();
        assert_eq!(read.as_raw(), &[9, 8, 7, 6, 5, 4]);
        assert_eq!(fs::read_dir(&out).unwrap().count(), 2, "no partial file is left");
    }

    #[test]
    fn an_unwritable_folder_is_named() {
        let error = PngFiles::new(PathBuf::from("/dev/null/x")).unwrap_err().to_string();
        assert!(error.starts_with("/dev/null/x: "), "{error}");
    }

    #[test]
    fn a_wide_picture_becomes_a_narrow_preview() {
        let picture = Picture { frame: FrameNumber(0), width: 3840, height: 20, rgb: vec![100; 3840 * 20 * 3] };
        let jpeg = image::load_from_memory(&preview(&picture)).unwrap();
        assert_eq!((jpeg.width(), jpeg.height()), (1920, 10));
    }
}
