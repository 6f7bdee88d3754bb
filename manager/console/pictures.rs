//! Pictures on their way from the compositor to viewers.
//!
//! The compositor makes one when it is asked, and it is asked when some viewer has shown what he had: so a picture is made as often as the
//! quickest viewer shows it, at most eleven times a second, and not at all while nobody looks. Each viewer gets the newest when he is ready for
//! one; what he is too slow for, he never sees. All get the same bytes, which are never copied here.
//!
//! What it costs to send them grows with the number of viewers, and what a rig can spare does not: so all of them together get so many pictures
//! and so many bytes a second at most ([`period`]), and each the fewer the more they are. And on a machine on which this thread, which yields to others,
//! gets its turn late, there is nothing to spare at all: then it waits as many times longer.

use crate::backplane::desk::{Desk, Silence};
use bytes::Bytes;
use proto::ids::FrameNumber;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use tokio::sync::{Notify, watch};

/// Shortest time between two questions.
const PERIOD: Duration = Duration::from_millis(45);
/// Longest, however many there are and however busy the machine.
const PERIOD_MAX: Duration = Duration::from_millis(1000);
/// Most pictures a second, to all viewers together: what four get that are sent all there are. Measured, twenty who got eleven each made
/// frames 7 % longer.
const SENDS_PER_S: f64 = 44.0;
/// Most bytes a second, likewise: what 100 Mbit/s carry.
const BYTES_PER_S: f64 = 12.5e6;
/// A timer that is as late as this finds a machine without a free core.
const LATE: Duration = Duration::from_millis(10);

/// How long after a picture of so many bytes the next is asked for, with so many viewers, when timers come so late.
fn period(viewers: usize, bytes: usize, late: Duration) -> Duration {
    let viewers = viewers as f64;
    let shared = (viewers / SENDS_PER_S).max(viewers * bytes as f64 / BYTES_PER_S);
    let busy = (late.as_secs_f64() / LATE.as_secs_f64()).max(1.0);
    Duration::from_secs_f64((PERIOD.as_secs_f64().max(shared) * busy).min(PERIOD_MAX.as_secs_f64()))
}

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
        // The longest that a timer has been late, which is forgotten slowly.
        let mut late = Duration::ZERO;
        loop {
            while self.waiting.load(Ordering::Relaxed) == 0 {
                self.begun.notified().await;
            }
            let is_stale = asked.is_none_or(|at| at.elapsed() > STALE + PERIOD_MAX);
            asked = Some(Instant::now());
            match desk.picture().await {
                Ok(Some((frame, jpeg))) if !is_stale => self.offer(frame, &jpeg),
                Ok(_) | Err(Silence::Stuck) => {}
                Err(Silence::Ended) => return,
            }
            let bytes = self.newest.borrow().as_ref().map_or(0, |(_, message)| message.len());
            let (begun, wait) = (Instant::now(), period(self.newest.receiver_count(), bytes, late));
            tokio::time::sleep(wait).await;
            late = begun.elapsed().saturating_sub(wait).max(late.mul_f64(0.8));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_viewers_together_get_no_more_than_a_few_do() {
        let every = |viewers, bytes, late| period(viewers, bytes, Duration::from_millis(late)).as_secs_f64();
        assert_eq!(every(1, 100_000, 0), PERIOD.as_secs_f64());
        for viewers in [4, 10, 20, 40] {
            let sends = viewers as f64 / every(viewers, 100_000, 0);
            assert!(
                sends < SENDS_PER_S + 1e-6 || every(viewers, 100_000, 0) == PERIOD.as_secs_f64(),
                "{viewers}: {sends}"
            );
        }
        assert_eq!(period(20, 1_000_000, Duration::ZERO), PERIOD_MAX, "one a second there always is");
        assert!((4.0 * 500e3 / every(4, 500_000, 0) - BYTES_PER_S).abs() < 1.0, "large pictures");
        assert!((every(1, 1000, 40) / every(1, 1000, 0) - 4.0).abs() < 1e-6, "a busy machine");
        assert_eq!(period(64, 1 << 24, PERIOD_MAX), PERIOD_MAX);
    }
}
