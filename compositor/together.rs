//! Changing the picture together with the other displays: at the moment that the swap names, by the machines' clocks.
//!
//! The moment is a few milliseconds after the swap was said, so that the last tiles and the word itself have come to all displays by then, and nothing
//! but a wake-up decides how far apart they are. A display whose clock is behind changes later than the others, but never waits longer than that lead.

use pool::turns;
use proto::message::Moment;
use std::time::{Duration, SystemTime};

/// The runtime's timers count in milliseconds; the rest is slept for by the thread.
const COARSE: Duration = Duration::from_millis(2);

/// Nanoseconds since 1970, by this machine.
pub(crate) fn wall_clock_ns() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}

/// How long until that moment.
fn wait(moment: Option<Moment>, now_ns: u64) -> Duration {
    let wait = moment.map(|moment| moment.at_ns.saturating_sub(now_ns).min(moment.lead_ns.into()));
    Duration::from_nanos(wait.unwrap_or(0))
}

/// Changes the picture at that moment, or at once if none is named; on a thread that has nothing else to do.
pub(crate) fn at<T>(moment: Option<Moment>, change: impl FnOnce() -> T) -> T {
    if moment.is_none() {
        return change();
    }
    turns::at_once(|| {
        std::thread::sleep(wait(moment, wall_clock_ns()));
        change()
    })
}

/// Likewise, and lets other tasks run most of the time until then.
pub(crate) async fn change<T>(moment: Option<Moment>, change: impl FnOnce() -> T) -> T {
    if let Some(coarse) = wait(moment, wall_clock_ns()).checked_sub(COARSE) {
        tokio::time::sleep(coarse).await;
    }
    at(moment, change)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_waited_for_but_never_longer_than_the_lead() {
        let now = 1_000_000_000;
        let wait = |at_ns| wait(Some(Moment { at_ns, lead_ns: 3_000_000 }), now);
        assert_eq!(wait(now + 2_000_000), Duration::from_millis(2));
        assert_eq!(wait(now - 1), Duration::ZERO, "it is past");
        assert_eq!(wait(now + 3_600_000_000_000), Duration::from_millis(3), "the clocks are an hour apart");
        assert_eq!(super::wait(None, now), Duration::ZERO, "none is named");
    }

    #[tokio::test]
    async fn nobody_is_early() {
        for ms in [0, 1, 3, 5] {
            let at_ns = wall_clock_ns() + ms * 1_000_000;
            let changed = change(Some(Moment { at_ns, lead_ns: 10_000_000 }), wall_clock_ns).await;
            assert!(changed >= at_ns, "{ms} ms");
        }
    }
}
