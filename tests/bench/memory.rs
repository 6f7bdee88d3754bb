//! How long it takes to write a picture and nothing else: the floor under every renderer.
//!
//! Each thread writes its share of the frame with stores that pass by the caches, as a renderer's last step may; the next
//! frame goes to the next of a few places, so that none is still in a cache. Where the machine has no such stores, the
//! frame is filled as the compiler sees fit.
#![expect(unsafe_code, reason = "streaming stores are intrinsics")]

use std::num::NonZeroUsize;
use std::sync::Barrier;
use std::time::{Duration, Instant};

/// One vector, and the unit in which the frame is shared.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Line([u8; 64]);

/// Places for the frame: 4 × 8.3 MB is more than a last-level cache gives to one program.
const PLACES: usize = 4;
/// Frames per measurement; one alone would be no longer than it takes to wake a thread.
const FRAMES: usize = 16;

/// A frame that is written and never looked at.
#[derive(Debug)]
pub struct FrameStore {
    places: Vec<Vec<Line>>,
    threads: NonZeroUsize,
}

impl FrameStore {
    /// For frames of `width × height` pixels of 4 bytes.
    pub fn new(width: u32, height: u32, threads: NonZeroUsize) -> Self {
        let lines = (width as usize * height as usize * 4).div_ceil(size_of::<Line>());
        Self { places: vec![vec![Line([1; 64]); lines]; PLACES], threads }
    }

    /// Writes the frame some times and says how long one took, ms. Starting the threads is not in the time.
    pub fn write(&mut self) -> f64 {
        let threads = self.threads.get();
        // Thread k's shares of all places.
        let mut shares: Vec<Vec<&mut [Line]>> = (0..threads).map(|_| Vec::new()).collect();
        for place in &mut self.places {
            let each = place.len().div_ceil(threads).max(1);
            for (k, part) in place.chunks_mut(each).enumerate() {
                shares[k].push(part);
            }
        }
        let gate = Barrier::new(threads);
        // Each thread looks at the clock itself: on a busy machine the one that waits may wake after all is done.
        let write = |mut own: Vec<&mut [Line]>| {
            gate.wait();
            let started = Instant::now();
            for frame in 0..FRAMES {
                let places = own.len().max(1);
                if let Some(part) = own.get_mut(frame % places) {
                    fill(part, frame as u8);
                }
            }
            [started, Instant::now()]
        };
        let write = &write;
        let times: Vec<[Instant; 2]> = std::thread::scope(|scope| {
            let all: Vec<_> = shares.into_iter().map(|own| scope.spawn(move || write(own))).collect();
            all.into_iter().map(|thread| thread.join().expect("a thread that only writes does not panic")).collect()
        });
        let started = times.iter().map(|[started, _]| *started).min();
        let ended = times.iter().map(|[_, ended]| *ended).max();
        let took = started.zip(ended).map_or(Duration::ZERO, |(started, ended)| ended - started);
        took.as_secs_f64() * 1e3 / FRAMES as f64
    }
}

#[cfg(target_arch = "x86_64")]
fn fill(part: &mut [Line], value: u8) {
    use std::arch::x86_64::{__m128i, _mm_set1_epi8, _mm_sfence, _mm_stream_si128};
    let value = value.cast_signed();
    for line in part {
        let to = (&raw mut line.0).cast::<__m128i>();
        // SAFETY: SSE2 is part of x86_64; a line is 64 bytes, aligned to 64: four vectors of 16, each aligned.
        unsafe {
            let vector = _mm_set1_epi8(value);
            for k in 0..4 {
                _mm_stream_si128(to.add(k), vector);
            }
        }
    }
    // SAFETY: SSE is part of x86_64. Without the fence the stores may still be under way when the time is taken, and are
    // not ordered before what other threads read.
    unsafe { _mm_sfence() }
}

#[cfg(not(target_arch = "x86_64"))]
fn fill(part: &mut [Line], value: u8) {
    std::hint::black_box(part).fill(Line([value; 64]));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_of_every_place_is_written_by_any_number_of_threads() {
        for threads in 1..=5 {
            let mut store = FrameStore::new(37, 11, NonZeroUsize::new(threads).unwrap());
            assert!(store.write() > 0.0, "{threads} threads");
            for (k, place) in store.places.iter().enumerate() {
                let last = (FRAMES - PLACES + k) as u8;
                assert!(place.iter().all(|line| line.0 == [last; 64]), "{threads} threads, place {k}");
            }
        }
    }
}
