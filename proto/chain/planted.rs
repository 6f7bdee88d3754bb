//! Three bugs, each of which can be planted to see that every layer of proof that should catch it does (docs/chain.md).
//!
//! Without the feature `planted`, and in every build without debug assertions, `is_planted` is false and the
//! compiler leaves nothing of them. The switch is one for the whole process, because a model checker has threads: tests that
//! plant run one at a time.

/// A bug.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Bug {
    /// A board that is wired anew keeps the id that it had.
    OldPlaceKept = 1,
    /// A wiring closes when every board is placed, though not all know the total.
    AcknowledgementsNotAwaited = 2,
    /// A board follows a backplane whose term is lower than the one it has granted.
    TermNotCompared = 3,
}

#[cfg(all(feature = "planted", debug_assertions))]
mod switch {
    use super::Bug;
    use std::sync::atomic::{AtomicU8, Ordering};

    static PLANTED: AtomicU8 = AtomicU8::new(0);

    /// Plants a bug, or none.
    pub fn plant(bug: Option<Bug>) {
        PLANTED.store(bug.map_or(0, |bug| bug as u8), Ordering::SeqCst);
    }

    pub(in super::super) fn is_planted(bug: Bug) -> bool {
        PLANTED.load(Ordering::Relaxed) == bug as u8
    }
}

#[cfg(all(feature = "planted", debug_assertions))]
pub(super) use switch::is_planted;
#[cfg(all(feature = "planted", debug_assertions))]
pub use switch::plant;

#[cfg(not(all(feature = "planted", debug_assertions)))]
pub(super) const fn is_planted(_: Bug) -> bool {
    false
}
