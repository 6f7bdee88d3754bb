//! How long to wait before trying to reach the backplane again: doubling, jittered, so that a rig of boards whose
//! manager restarts doesn't knock at the same moment.

use std::time::Duration;

/// First wait, before jitter.
const FIRST_MS: u64 = 50;
/// Longest wait, before jitter: a restarted manager must see its boards again within two seconds.
const LONGEST_MS: u64 = 800;

/// A sequence of waits.
#[derive(Clone, Debug)]
pub struct Backoff {
    state: u64,
    wait_ms: u64,
}

impl Backoff {
    /// Randomness comes from `seed`; give each daemon its own.
    pub fn new(seed: u64) -> Self {
        Self { state: seed, wait_ms: FIRST_MS }
    }

    /// The next wait: between half and one and a half of the nominal one.
    pub fn next_wait(&mut self) -> Duration {
        self.state = self.state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let jittered = self.wait_ms / 2 + (self.state >> 33) % self.wait_ms;
        self.wait_ms = (self.wait_ms * 2).min(LONGEST_MS);
        Duration::from_millis(jittered)
    }

    /// It worked: the next failure begins anew.
    pub fn reset(&mut self) {
        self.wait_ms = FIRST_MS;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_to_a_limit_and_differ_by_seed() {
        let waits = |seed| {
            let mut backoff = Backoff::new(seed);
            (0..20).map(|_| backoff.next_wait()).collect::<Vec<_>>()
        };
        assert!(waits(1).iter().all(|w| *w <= Duration::from_millis(LONGEST_MS * 3 / 2)));
        assert!(waits(1)[10..].iter().all(|w| *w >= Duration::from_millis(LONGEST_MS / 2)));
        assert_ne!(waits(1), waits(2));
    }
}
