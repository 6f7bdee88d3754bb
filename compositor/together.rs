//! Changing the picture together with the other displays: at the moment that the swap names, by the machines' clocks.
//!
//! The moment is a few milliseconds after the swap was said, so that the last tiles and the word itself have come to all displays by then, and nothing
//! but a wake-up decides how far apart they are. A clock that disagrees costs nothing but that: a moment that is past, or too far off to be meant, is
//! now.

use std::time::{Duration, SystemTime};

/// A moment further off than this is not waited for.
const WAIT_MAX: Duration = Duration::from_millis(20);
/// The runtime's timers count in milliseconds; the rest is slept for by the thread.
const COARSE: Duration = Duration::from_millis(2);

/// Nanoseconds since 1970, by this machine.
pub(crate) fn wall_clock_ns() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}

/// How long until that moment, if it is to be waited for.
fn wait(at_ns: u64, now_ns: u64) -> Duration {
    let wait = Duration::from_nanos(at_ns.saturating_sub(now_ns));
    if wait > WAIT_MAX { Duration::ZERO } else { wait }
}

/// Sleeps until that moment; on a thread that has nothing else to do.
pub(crate) fn sleep_until(at_ns: u64) {
    std::thread::sleep(wait(at_ns, wall_clock_ns()));
}

/// Likewise, and lets other tasks run most of that time.
pub(crate) async fn until(at_ns: u64) {
    if let Some(coarse) = wait(at_ns, wall_clock_ns()).checked_sub(COARSE) {
        tokio::time::sleep(coarse).await;
    }
    sleep_until(at_ns);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_waited_for_if_it_is_near_and_to_come() {
        let now = 1_000_000_000;
        assert_eq!(wait(now + 3_000_000, now), Duration::from_millis(3));
        assert_eq!(wait(now - 1, now), Duration::ZERO, "it is past");
        assert_eq!(wait(0, now), Duration::ZERO, "none is named");
        assert_eq!(wait(now + 3_600_000_000_000, now), Duration::ZERO, "the clocks are an hour apart");
    }

    #[tokio::test]
    async fn nobody_is_early() {
        for ms in [0, 1, 3, 5] {
            let at = wall_clock_ns() + ms * 1_000_000;
            until(at).await;
            assert!(wall_clock_ns() >= at, "{ms} ms");
        }
    }
}
