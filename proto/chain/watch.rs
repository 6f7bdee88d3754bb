//! Who is silent: failure detection by the absence of any word.
//!
//! Everybody in the row says something at least every [`BEAT`], a frame's *ready* or else a beat. Who has said nothing for
//! [`SILENCE`] is taken for dead. Think of a night watchman who must turn a key every hour: he isn't asked, he is missed.
//! Asking (ping and answer) would cost a message more each time and notice later by one way.
//!
//! A watcher that has slept itself must not blame others for what it didn't hear. It looks every [`LOOK`], and when it
//! comes late to that, everybody's time is put off by as much.

use crate::ids::BoardKey;
use crate::time::Time;
use std::collections::BTreeMap;
use std::time::Duration;

/// One frame at 60 Hz, the rate that the times of failure detection are meant for.
pub const PERIOD: Duration = Duration::from_nanos(16_666_667);
/// How often a board says that it is there, if it has nothing else to say. 45 times a second, so that a still rig
/// sends less than 1000 bytes a second per board.
pub const BEAT: Duration = Duration::from_nanos(22_222_222);
/// Silence that means death: a quarter of a period less than the four periods in which it must be noticed, for the
/// message that was under way and for the timer.
pub const SILENCE: Duration = Duration::from_nanos(62_500_000);
/// A watcher looks at least this often.
const LOOK: Duration = PERIOD;
/// How late a look may be before it counts as sleep of the watcher's own.
const LATE: Duration = Duration::from_millis(4);

const _: () = assert!(
    BEAT.as_nanos() + 2 * PERIOD.as_nanos() + 6_000_000 < SILENCE.as_nanos(),
    "a stall of two periods, and 6 ms of jitter, are no silence"
);
const _: () = assert!(SILENCE.as_nanos() + 4_000_000 < 4 * PERIOD.as_nanos(), "noticed within four periods");

/// See the module's head.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Watch<K = BoardKey> {
    /// When each was last heard.
    heard: BTreeMap<K, Time>,
    /// At or before the first of these: of the last look. Most of the time that is enough to know that the next look is due first.
    since: Time,
    limit: Duration,
    look: Time,
}

impl<K> Default for Watch<K> {
    fn default() -> Self {
        Self::new(SILENCE)
    }
}

impl<K> Watch<K> {
    /// A watch over nobody, which takes a silence of `limit` for death.
    pub fn new(limit: Duration) -> Self {
        Self { heard: BTreeMap::new(), since: Time(0), limit, look: Time(0) }
    }
}

impl<K: Ord + Copy> Watch<K> {
    /// Begins to watch, or has heard, somebody.
    pub fn on_heard(&mut self, now: Time, who: K) {
        if self.heard.is_empty() {
            (self.look, self.since) = (now + LOOK, now);
        }
        self.heard.insert(who, now);
    }

    /// From now on a silence of `limit` is death.
    pub fn set_limit(&mut self, limit: Duration) {
        self.limit = limit;
    }

    /// Whether it is watched.
    pub fn is_watched(&self, who: K) -> bool {
        self.heard.contains_key(&who)
    }

    /// How long it has said nothing; `None` if it isn't watched.
    pub fn silence(&self, now: Time, who: K) -> Option<Duration> {
        self.heard.get(&who).map(|heard| now.since(*heard))
    }

    /// No longer watches it.
    pub fn forget(&mut self, who: K) {
        self.heard.remove(&who);
    }

    /// When to look again.
    pub fn next_timeout(&self) -> Option<Time> {
        if self.since + self.limit >= self.look {
            return (!self.heard.is_empty()).then_some(self.look);
        }
        let first = self.heard.values().min()?;
        Some(self.look.min(*first + self.limit))
    }

    /// How long the watcher itself has slept: how late it is to look. Nothing but what has come meanwhile was missed by others.
    pub fn slept(&self, now: Time) -> Duration {
        let late = self.next_timeout().map_or(Duration::ZERO, |due| now.since(due));
        if late > LATE { late } else { Duration::ZERO }
    }

    /// Looks; those that are silent are returned and no longer watched.
    pub fn on_timeout(&mut self, now: Time) -> Vec<K> {
        if self.next_timeout().is_none_or(|due| now < due) {
            return Vec::new();
        }
        let slept = self.slept(now);
        for heard in self.heard.values_mut() {
            *heard = (*heard + slept).min(now);
        }
        self.look = now + LOOK;
        let silent: Vec<_> =
            self.heard.iter().filter(|(_, heard)| now.since(**heard) >= self.limit).map(|(who, _)| *who).collect();
        for who in &silent {
            self.heard.remove(who);
        }
        self.since = self.heard.values().copied().min().unwrap_or(now);
        silent
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Time {
        Time(ms * 1_000_000)
    }

    /// Looks whenever it is due, up to `end`, but for the gap in which the watcher sleeps.
    fn look(watch: &mut Watch, end: Time, asleep: std::ops::Range<Time>) -> Option<Time> {
        while let Some(due) = watch.next_timeout().filter(|due| *due <= end) {
            let now = if asleep.contains(&due) { asleep.end } else { due };
            if !watch.on_timeout(now).is_empty() {
                return Some(now);
            }
        }
        None
    }

    #[test]
    fn a_silent_board_is_noticed_within_four_periods() {
        let mut watch = Watch::default();
        watch.on_heard(ms(0), BoardKey(1));
        let noticed = look(&mut watch, ms(100), ms(0)..ms(0)).expect("noticed");
        assert!(noticed.since(ms(0)) < 4 * PERIOD, "{noticed:?}");
    }

    #[test]
    fn a_longer_limit_holds_for_who_is_watched_already() {
        let mut watch = Watch::default();
        watch.on_heard(ms(0), BoardKey(1));
        watch.set_limit(2 * SILENCE);
        let noticed = look(&mut watch, ms(1000), ms(0)..ms(0)).expect("noticed");
        assert_eq!(noticed, Time(0) + 2 * SILENCE);
    }

    #[test]
    fn a_stall_of_two_periods_after_a_beat_is_no_death() {
        let mut watch = Watch::default();
        watch.on_heard(ms(0), BoardKey(1));
        let next = Time(0) + BEAT + 2 * PERIOD;
        assert_eq!(look(&mut watch, next, ms(0)..ms(0)), None);
        watch.on_heard(next, BoardKey(1));
        assert_eq!(watch.silence(next, BoardKey(1)), Some(Duration::ZERO));
    }

    #[test]
    fn a_watcher_that_slept_blames_nobody() {
        let mut watch = Watch::default();
        watch.on_heard(ms(0), BoardKey(1));
        assert_eq!(look(&mut watch, ms(1000), ms(10)..ms(1000)), None, "it slept for a second itself");
        let noticed = look(&mut watch, ms(2000), ms(0)..ms(0)).expect("silence goes on while it is awake");
        assert!(noticed < ms(1100), "{noticed:?}");
    }
}
