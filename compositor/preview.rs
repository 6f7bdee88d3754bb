//! Pictures for the console: made small, encoded, and sent to the backplane when that is asked, on a thread that takes what no frame needs.
//!
//! The thread is given the newest picture and forgets an older one that it hasn't begun: so it is never behind, however slow it is, and of the
//! last frame of a rig that is held there always is one.

use crate::sinks::Picture;
use pool::turns;
use proto::frame::PixelFormat;
use proto::ids::FrameNumber;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use tokio::sync::mpsc;

/// A preview is made no wider than this, pixels.
const WIDTH_MAX: u32 = 1920;
const QUALITY: u8 = 85;

/// What waits for the thread.
#[derive(Debug, Default)]
struct Slot {
    picture: Option<Picture>,
    is_over: bool,
}

type Shared = (Mutex<Slot>, Condvar);

/// See the module's head. The thread ends when this goes.
#[derive(Debug)]
pub(crate) struct Previews(Arc<Shared>);

fn locked(shared: &Shared) -> MutexGuard<'_, Slot> {
    shared.0.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Previews {
    /// Starts the thread; it puts into `made` what it has made.
    ///
    /// # Errors
    /// When it can't be started.
    pub(crate) fn start(made: mpsc::Sender<(FrameNumber, Vec<u8>)>) -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let own = Arc::clone(&shared);
        std::thread::Builder::new().name("preview".into()).spawn(move || {
            turns::go_last();
            while let Some(picture) = next(&own) {
                // Nobody takes it when the link is over.
                if made.blocking_send((picture.frame, preview(&picture))).is_err() {
                    return;
                }
            }
        })?;
        Ok(Self(shared))
    }

    /// Has a preview made of this picture, and of none that was offered before and isn't begun.
    pub(crate) fn offer(&self, picture: Picture) {
        locked(&self.0).picture = Some(picture);
        self.0.1.notify_one();
    }
}

impl Drop for Previews {
    fn drop(&mut self) {
        locked(&self.0).is_over = true;
        self.0.1.notify_one();
    }
}

/// Waits for a picture; `None` at the end.
fn next(shared: &Shared) -> Option<Picture> {
    let mut slot = locked(shared);
    loop {
        if slot.is_over {
            return None;
        }
        if let Some(picture) = slot.picture.take() {
            return Some(picture);
        }
        slot = shared.1.wait(slot).unwrap_or_else(PoisonError::into_inner);
    }
}

/// A JPEG of the picture, at most 1920 pixels wide (whole-number box reduction).
fn preview(picture: &Picture) -> Vec<u8> {
    let step = picture.width.div_ceil(WIDTH_MAX).max(1) as usize;
    let (width, height) = (picture.width as usize / step, picture.height as usize / step);
    let row = picture.width as usize * 3;
    let mut small = Vec::with_capacity(width * height * 3);
    let (mut line, mut sums) = (vec![0; row], vec![0u32; width * 3]);
    for y in 0..height {
        sums.fill(0);
        for dy in 0..step {
            shown(picture, y * step + dy, &mut line);
            for (sum, block) in sums.chunks_exact_mut(3).zip(line.chunks_exact(3 * step)) {
                for pixel in block.chunks_exact(3) {
                    sum.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += u32::from(*value));
                }
            }
        }
        let area = (step * step) as u32;
        small.extend(sums.iter().map(|sum| (sum / area) as u8));
    }
    let mut jpeg = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut jpeg, QUALITY);
    let (Ok(w), Ok(h)) = (u16::try_from(width), u16::try_from(height)) else { return Vec::new() };
    match encoder.encode(&small, w, h, jpeg_encoder::ColorType::Rgb) {
        Ok(()) => jpeg,
        Err(error) => {
            tracing::warn!(%error, "preview not encoded");
            Vec::new()
        }
    }
}

/// A row of the picture as a screen shows it. Linear light is encoded only roughly (a power of 1/2.2): this is for a look, the files
/// have the exact values.
fn shown(picture: &Picture, y: usize, line: &mut [u8]) {
    let bytes = line.len() * picture.format.bytes() / 3;
    let row = &picture.pixels[y * bytes..(y + 1) * bytes];
    match picture.format {
        PixelFormat::Srgb8 => line.copy_from_slice(row),
        PixelFormat::LinearF32 => {
            for (value, bytes) in line.iter_mut().zip(row.chunks_exact(4)) {
                let linear = f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
                *value = (linear.clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0) as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(frame: u64, width: u32, height: u32, format: PixelFormat, pixels: Vec<u8>) -> Picture {
        Picture { frame: FrameNumber(frame), width, height, format, pixels }
    }

    #[test]
    fn a_wide_picture_becomes_a_narrow_preview_of_means() {
        // Columns of 100 and 140 by turns.
        let pixels = (0..3840 * 20 * 3).map(|i| if i / 3 % 2 == 0 { 100 } else { 140 }).collect();
        let jpeg = preview(&picture(0, 3840, 20, PixelFormat::Srgb8, pixels));
        let jpeg = image::load_from_memory(&jpeg).unwrap().into_rgb8();
        assert_eq!((jpeg.width(), jpeg.height()), (1920, 10));
        assert!(jpeg.as_raw().iter().all(|value| value.abs_diff(120) <= 1));
    }

    #[test]
    fn linear_light_is_shown_about_as_bright_as_it_is() {
        let pixels = (0..16 * 16 * 3).flat_map(|_| 0.25f32.to_le_bytes()).collect();
        let jpeg = preview(&picture(0, 16, 16, PixelFormat::LinearF32, pixels));
        let jpeg = image::load_from_memory(&jpeg).unwrap().into_rgb8();
        assert!(jpeg.as_raw().iter().all(|value| value.abs_diff(135) <= 2));
    }

    #[test]
    fn the_newest_picture_is_always_made() {
        let (made, mut taken) = mpsc::channel(1);
        let previews = Previews::start(made).unwrap();
        for frame in 0..200 {
            previews.offer(picture(frame, 64, 64, PixelFormat::Srgb8, vec![9; 64 * 64 * 3]));
        }
        let mut frames = Vec::new();
        while frames.last() != Some(&FrameNumber(199)) {
            frames.push(taken.blocking_recv().unwrap().0);
        }
        assert!(frames.is_sorted() && frames.len() <= 200, "{frames:?}");
        drop(previews);
        assert!(taken.blocking_recv().is_none(), "the thread has ended");
    }
}
