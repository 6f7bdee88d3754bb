//! Pictures on their way from the compositor to viewers.
//!
//! The compositor makes one when it is asked, and it is asked when some viewer has shown what he had: so a picture is made as often as the
//! quickest viewer shows it, at most eleven times a second, and not at all while nobody looks. Each viewer gets the newest when he is ready for
//! one; what he is too slow for, he never sees.

use crate::backplane::desk::{Desk, Silence};
use bytes::Bytes;
use proto::ids::FrameNumber;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use tokio::sync::{Notify, watch};

/// Shortest time between two questions.
const PERIOD: Duration = Duration::from_millis(45);
/// After so long without a question, what the engine has may be from long ago.
const STALE: Duration = Duration::from_secs(1);

/// A JPEG, behind the number of its frame: 8 bytes, little-endian.
pub(super) type Picture = Option<(FrameNumber, Bytes)>;

/// See the module's head.
#[derive(Debug)]
pub(super) struct Pictures {
    newest: watch::Sender<Picture>,
    waiting: AtomicUsize,
    begun: Notify,
}

impl Default for Pictures {
    fn default() -> Self {
        Self { newest: watch::Sender::new(None), waiting: AtomicUsize::new(0), begun: Notify::new() }
    }
}

/// A viewer who is ready for a picture; as long as there is one, pictures are made.
#[derive(Debug)]
pub(super) struct Waiting<'a>(&'a Pictures);

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        self.0.waiting.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Pictures {
    /// Goes on until the rig has ended.
    pub(super) async fn run(&self, desk: &Desk) {
        let mut asked: Option<Instant> = None;
        loop {
            while self.waiting.load(Ordering::Relaxed) == 0 {
                self.begun.notified().await;
            }
            let is_stale = asked.is_none_or(|at| at.elapsed() > STALE);
            asked = Some(Instant::now());
            match desk.picture().await {
                Ok(Some((frame, jpeg))) if !is_stale => self.offer(frame, &jpeg),
                Ok(_) | Err(Silence::Stuck) => {}
                Err(Silence::Ended) => return,
            }
            tokio::time::sleep(PERIOD).await;
        }
    }

    fn offer(&self, frame: FrameNumber, jpeg: &[u8]) {
        if self.newest.borrow().as_ref().is_none_or(|(last, _)| *last != frame) {
            let mut message = Vec::with_capacity(8 + jpeg.len());
            message.extend_from_slice(&frame.0.to_le_bytes());
            message.extend_from_slice(jpeg);
            self.newest.send_replace(Some((frame, message.into())));
        }
    }

    /// Hears of new pictures.
    pub(super) fn subscribe(&self) -> watch::Receiver<Picture> {
        self.newest.subscribe()
    }

    /// A viewer is ready for a picture.
    pub(super) fn wait(&self) -> Waiting<'_> {
        self.waiting.fetch_add(1, Ordering::Relaxed);
        self.begun.notify_one();
        Waiting(self)
    }
}
