//! Whose turn it is when there are fewer processors than threads that could run. On Linux each thread has its own niceness, which those that it starts
//! begin with, and no process number means the calling thread.

use rustix::io;
use rustix::process::{getpriority_process, setpriority_process};

/// A swap waits for the wake-up of each display, and what they do takes little.
const FIRST: i32 = -10;
/// All that a thread can yield.
const LAST: i32 = 19;

/// Lets the calling thread go before others, boards that draw for one. That is a privilege (`CAP_SYS_NICE`, or a service's `Nice=`); without it displays on a
/// machine with work for all its processors change a millisecond apart now and then.
pub fn go_first() {
    say(
        getpriority_process(None).and_then(|now| setpriority_process(None, now.min(FIRST))),
        "boards may get their turn before displays",
    );
}

/// Takes what others leave: for what no frame waits for.
pub(crate) fn go_last() {
    say(setpriority_process(None, LAST), "what could wait is done like anything else");
}

/// Like any other thread, though the one that started it goes first.
pub(crate) fn go_along() {
    say(
        getpriority_process(None).and_then(|now| setpriority_process(None, now.max(0))),
        "files are written before boards get their turn",
    );
}

fn say(given: io::Result<()>, otherwise: &str) {
    if let Err(error) = given {
        tracing::debug!(%error, "{otherwise}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_that_is_started_by_one_that_goes_first_can_go_along_or_last() {
        let niceness = || getpriority_process(None).unwrap();
        let before = niceness();
        let first = std::thread::spawn(move || {
            go_first();
            // Without the privilege it stays as it is.
            assert!([before, FIRST.min(before)].contains(&niceness()));
            let own = niceness();
            let of = |go: fn()| {
                let thread = std::thread::spawn(move || {
                    go();
                    niceness()
                });
                thread.join().unwrap()
            };
            assert_eq!((of(go_along), of(go_last)), (own.max(0), LAST));
        });
        first.join().unwrap();
        assert_eq!(niceness(), before, "of other threads nothing changes");
    }
}
