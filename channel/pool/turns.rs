//! Whose turn it is when there are fewer processors than threads that could run.
//!
//! Who only passes on words, or changes a picture at a moment, needs little and keeps everybody waiting: it goes first. Who draws goes along, and who makes what no
//! frame waits for goes behind, or last. Even who goes first waits for the slice of who runs, a millisecond or more; who can't, as all others change their pictures at that moment,
//! is woken at once. On Linux each thread has its own niceness, which those that it starts begin with, and no process number means the calling thread.

use rustix::io;
use rustix::process::{getpriority_process, setpriority_process};
use std::sync::OnceLock;

/// Before what is as important as most things.
const FIRST: i32 = -10;
/// Beside threads that are busy it gets a tenth of what one of them does.
const BEHIND: i32 = 10;
/// All that a thread can yield.
const LAST: i32 = 19;

/// What the program was started with.
static GIVEN: OnceLock<i32> = OnceLock::new();

/// Lets the calling thread go before others. That is a privilege (`CAP_SYS_NICE`, or a service's `LimitNICE=`); without it, on a machine with work for all its
/// processors, displays change a millisecond apart now and then, and a board that is starved of its turn may be taken for dead.
pub fn go_first() {
    let given =
        getpriority_process(None).and_then(|now| setpriority_process(None, FIRST.min(*GIVEN.get_or_init(|| now))));
    say(given, "it gets its turn like any other thread");
}

/// As the program was started, though the thread that started the calling one goes first.
pub fn go_along() {
    // If nobody goes first, this one doesn't either.
    if let Some(given) = GIVEN.get() {
        say(setpriority_process(None, *given), "it goes before others, though it needn't");
    }
}

/// Yields to others, but doesn't starve; one that yields more already is left alone.
pub fn go_behind() {
    // Of a thread that was started by one that goes first, what counts is what the program was started with.
    let now = GIVEN.get().map_or_else(|| getpriority_process(None), |given| Ok(*given));
    let given = now.and_then(|now| setpriority_process(None, now.max(BEHIND)));
    say(given, "what should yield runs like any other thread");
}

/// Takes what others leave.
pub fn go_last() {
    say(setpriority_process(None, LAST), "what could wait is done like anything else");
}

/// Does something before which the calling thread sleeps, woken before all that goes in turns (`SCHED_FIFO`, for so long as this takes): short work whose moment matters. That is a
/// privilege too (`CAP_SYS_NICE`, or a service's `LimitRTPRIO=`). A thread that isn't scheduled in turns anyway is left alone.
pub fn at_once<T>(work: impl FnOnce() -> T) -> T {
    let _in_turns_again = AtOnce::begin();
    work()
}

/// The calling thread is woken before all that goes in turns, until this is dropped.
struct AtOnce;

impl AtOnce {
    fn begin() -> Option<Self> {
        (policy() == libc::SCHED_OTHER && schedule(libc::SCHED_FIFO, 1)).then_some(Self)
    }
}

impl Drop for AtOnce {
    fn drop(&mut self) {
        // Nothing refuses to give a privilege up.
        schedule(libc::SCHED_OTHER, 0);
    }
}

/// How the calling thread is scheduled.
fn policy() -> i32 {
    // SAFETY: it takes nothing but a number, and 0 is the calling thread.
    unsafe { libc::sched_getscheduler(0) }
}

/// Whether the calling thread is scheduled so from now on; its niceness remains.
fn schedule(policy: i32, priority: i32) -> bool {
    let param = libc::sched_param { sched_priority: priority };
    // SAFETY: it reads the parameter, which lives until it returns, and 0 is the calling thread.
    unsafe { libc::sched_setscheduler(0, policy, &raw const param) == 0 }
}

fn say(given: io::Result<()>, otherwise: &str) {
    if let Err(error) = given {
        tracing::debug!(%error, "{otherwise}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::catch_unwind;

    fn niceness() -> i32 {
        getpriority_process(None).unwrap()
    }

    /// Whether this process has the privilege, by the system's own word (`CAP_SYS_NICE`, number 23).
    fn is_privileged() -> bool {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let effective = status.lines().find_map(|line| line.strip_prefix("CapEff:")).unwrap();
        u64::from_str_radix(effective.trim(), 16).unwrap() & (1 << 23) != 0
    }

    #[test]
    fn who_is_started_by_one_that_goes_first_can_go_along_behind_or_last() {
        let before = niceness();
        let after = |go: fn()| {
            let thread = std::thread::spawn(move || {
                go();
                niceness()
            });
            thread.join().unwrap()
        };
        let first = std::thread::spawn(move || {
            go_first();
            assert_eq!(niceness(), if is_privileged() { FIRST.min(before) } else { before });
            assert_eq!([go_along, go_behind, go_last].map(after), [before, BEHIND.max(before), LAST]);
        });
        first.join().unwrap();
        assert_eq!(niceness(), before, "of other threads nothing changes");
    }

    #[test]
    fn a_thread_is_as_before_after_what_it_did_at_once() {
        let before = (policy(), niceness());
        // Some kernels refuse it to groups of processes that have no time set aside, whatever privileges these have.
        let can = schedule(libc::SCHED_FIFO, 1);
        schedule(before.0, 0);
        assert_eq!(at_once(policy), if can { libc::SCHED_FIFO } else { before.0 });
        assert_eq!((policy(), niceness()), before);
        assert!(catch_unwind(|| at_once(|| panic!("on purpose"))).is_err(), "it panics");
        assert_eq!((policy(), niceness()), before, "after a panic too");
    }
}
