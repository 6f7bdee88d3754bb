//! Native pose packets off a UDP socket ([`proto::pose`] has the bytes).
//!
//! The newest packet wins. Packets carry a sequence, and one that is not newer than the last of the same sender is stale; a
//! sender that was silent for a second, or one at another address, begins anew, because a restarted host counts from zero.

use proto::time::Time;
use std::net::SocketAddr;
use std::time::Duration;

/// After this long a host is taken to have restarted.
const SILENCE: Duration = Duration::from_secs(1);

/// What a packet's sequence says about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freshness {
    /// Newer than all before.
    New,
    /// The very last one once more: its answer may have been lost.
    Repeated,
    /// Older.
    Stale,
}

/// Tells new packets from old ones.
#[derive(Clone, Debug, Default)]
pub struct SequenceFilter {
    last: Option<(SocketAddr, u32, Time)>,
}

impl SequenceFilter {
    /// A packet has come.
    pub fn on_packet(&mut self, now: Time, from: SocketAddr, sequence: u32) -> Freshness {
        if let Some((sender, newest, at)) = &mut self.last
            && *sender == from
            && now.since(*at) < SILENCE
        {
            *at = now;
            // Modulo 2³²: newer means less than half the circle ahead.
            return match sequence.wrapping_sub(*newest) {
                0 => Freshness::Repeated,
                ahead if ahead < 1 << 31 => {
                    *newest = sequence;
                    Freshness::New
                }
                _ => Freshness::Stale,
            };
        }
        if let Some((sender, newest, at)) = &mut self.last
            && *sender == from
            && *newest == sequence
        {
            *at = now;
            return Freshness::Repeated;
        }
        self.last = Some((from, sequence, now));
        Freshness::New
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 1);
    const B: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 2);

    fn ms(ms: u64) -> Time {
        Time(ms * 1_000_000)
    }

    #[test]
    fn newest_wins_also_round_the_end_of_the_count() {
        let mut filter = SequenceFilter::default();
        assert_eq!(filter.on_packet(ms(0), A, u32::MAX), Freshness::New);
        assert_eq!(filter.on_packet(ms(1), A, 0), Freshness::New);
        assert_eq!(filter.on_packet(ms(2), A, u32::MAX), Freshness::Stale);
        assert_eq!(filter.on_packet(ms(3), A, 0), Freshness::Repeated);
    }

    #[test]
    fn a_restarted_host_is_heard() {
        let mut filter = SequenceFilter::default();
        filter.on_packet(ms(0), A, 1000);
        assert_eq!(filter.on_packet(ms(10), B, 0), Freshness::New, "from another port at once");
        filter.on_packet(ms(20), A, 1001);
        assert_eq!(filter.on_packet(ms(30), A, 0), Freshness::Stale);
        assert_eq!(filter.on_packet(ms(2000), A, 1), Freshness::New, "after a silence");
    }

    #[test]
    fn a_lock_step_host_that_asks_again_after_long_is_answered() {
        let mut filter = SequenceFilter::default();
        filter.on_packet(ms(0), A, 7);
        assert_eq!(filter.on_packet(ms(5000), A, 7), Freshness::Repeated);
    }
}
