//! Who may come in: how many connections, from where, how fast. No sockets and no clock here.
//!
//! A connection is *greeting* until its peer has said who it is, and *in* after that. Places for greetings are few, and when there
//! is none the oldest greeting ends: a flood of connections that say nothing ends itself, while honest peers, which need milliseconds, get
//! through.

use proto::limits;
use proto::time::Time;
use std::collections::{BTreeMap, VecDeque};
use std::net::{IpAddr, Ipv6Addr};
use thiserror::Error;
use tokio_util::sync::CancellationToken;

/// Why somebody isn't let in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub(crate) enum Full {
    #[error("{} connections are open, as many as there may be", limits::CONNECTIONS_MAX)]
    All,
    #[error("{} connections of its address are open, as many as there may be", limits::CONNECTIONS_PER_ADDRESS_MAX)]
    Address,
    #[error("its address connects more than {} times a second", limits::CONNECTIONS_PER_SECOND_MAX)]
    Rate,
    #[error("too many addresses have connected within seconds")]
    Addresses,
}

/// One address' account.
#[derive(Debug)]
struct Account {
    open: usize,
    /// Connections that it may make at once.
    credit: f64,
    /// When that was so.
    at: Time,
}

impl Account {
    fn new(now: Time) -> Self {
        Self { open: 0, credit: f64::from(limits::CONNECTIONS_BURST_MAX), at: now }
    }

    fn refill(&mut self, now: Time) {
        let earned = now.since(self.at).as_secs_f64() * f64::from(limits::CONNECTIONS_PER_SECOND_MAX);
        self.credit = (self.credit + earned).min(f64::from(limits::CONNECTIONS_BURST_MAX));
        self.at = now;
    }

    fn is_new(&self) -> bool {
        self.open == 0 && self.credit >= f64::from(limits::CONNECTIONS_BURST_MAX)
    }
}

#[derive(Debug)]
struct Greeting {
    ticket: u64,
    from: IpAddr,
    end: CancellationToken,
}

/// See the module's head.
#[derive(Debug, Default)]
pub(crate) struct Gate {
    accounts: BTreeMap<IpAddr, Account>,
    open: usize,
    /// The oldest first.
    greeting: VecDeque<Greeting>,
    next_ticket: u64,
}

impl Gate {
    /// A connection has come. Its ticket, and what tells that it must end because others want in.
    pub(crate) fn on_arrival(&mut self, now: Time, from: IpAddr) -> Result<(u64, CancellationToken), Full> {
        let from = account_of(from);
        if self.accounts.len() >= limits::ADDRESSES_MAX && !self.accounts.contains_key(&from) {
            self.forget_idle(now);
            if self.accounts.len() >= limits::ADDRESSES_MAX {
                return Err(Full::Addresses);
            }
        }
        let account = self.accounts.entry(from).or_insert_with(|| Account::new(now));
        account.refill(now);
        if account.credit < 1.0 {
            return Err(Full::Rate);
        }
        account.credit -= 1.0;
        self.make_room(from);
        let account = self.accounts.entry(from).or_insert_with(|| Account::new(now));
        if account.open >= limits::CONNECTIONS_PER_ADDRESS_MAX {
            return Err(Full::Address);
        }
        if self.open >= limits::CONNECTIONS_MAX {
            return Err(Full::All);
        }
        account.open += 1;
        self.open += 1;
        self.next_ticket += 1;
        let end = CancellationToken::new();
        self.greeting.push_back(Greeting { ticket: self.next_ticket, from, end: end.clone() });
        Ok((self.next_ticket, end))
    }

    /// A peer has said who it is.
    pub(crate) fn on_greeted(&mut self, ticket: u64) {
        self.greeting.retain(|greeting| greeting.ticket != ticket);
    }

    /// A connection is over.
    pub(crate) fn on_end(&mut self, ticket: u64, from: IpAddr) {
        self.greeting.retain(|greeting| greeting.ticket != ticket);
        self.open = self.open.saturating_sub(1);
        if let Some(account) = self.accounts.get_mut(&account_of(from)) {
            account.open = account.open.saturating_sub(1);
        }
    }

    /// Ends the oldest greeting where there are too many. It counts as open until its task has ended.
    fn make_room(&mut self, from: IpAddr) {
        let is_ours = |greeting: &&Greeting| greeting.from == from;
        let oldest = if self.greeting.iter().filter(is_ours).count() >= limits::GREETINGS_PER_ADDRESS_MAX {
            self.greeting.iter().position(|greeting| greeting.from == from)
        } else {
            (self.greeting.len() >= limits::GREETINGS_MAX).then_some(0)
        };
        if let Some(greeting) = oldest.and_then(|at| self.greeting.remove(at)) {
            greeting.end.cancel();
        }
    }

    /// Accounts that say no more than a new one would.
    fn forget_idle(&mut self, now: Time) {
        self.accounts.retain(|_, account| {
            account.refill(now);
            !account.is_new()
        });
    }
}

/// Whom connections count for: an IPv4 address, or the network of an IPv6 address, in which a machine has as many as it likes.
fn account_of(ip: IpAddr) -> IpAddr {
    match ip.to_canonical() {
        IpAddr::V6(ip) => {
            let [a, b, c, d, ..] = ip.segments();
            IpAddr::V6(Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0))
        }
        v4 @ IpAddr::V4(_) => v4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    /// How many seconds until an address that has used its burst up is forgotten.
    const REST_S: u64 = (limits::CONNECTIONS_BURST_MAX / limits::CONNECTIONS_PER_SECOND_MAX) as u64 + 1;

    fn address(k: u32) -> IpAddr {
        IpAddr::V4(Ipv4Addr::from(0x0a00_0000 + k))
    }

    fn second(k: u64) -> Time {
        Time(k * 1_000_000_000)
    }

    #[test]
    fn peers_that_say_nothing_make_room_for_newer_ones() {
        let mut gate = Gate::default();
        let stalled: Vec<_> =
            (0..limits::GREETINGS_PER_ADDRESS_MAX).map(|_| gate.on_arrival(Time(0), address(1)).unwrap().1).collect();
        assert!(stalled.iter().all(|end| !end.is_cancelled()), "there is room for all");
        let (_, end) = gate.on_arrival(Time(0), address(1)).unwrap();
        assert!(stalled[0].is_cancelled() && !stalled[1].is_cancelled() && !end.is_cancelled());
    }

    #[test]
    fn silent_peers_of_many_addresses_make_room_too() {
        let mut gate = Gate::default();
        let stalled: Vec<_> =
            (0..limits::GREETINGS_MAX as u32).map(|k| gate.on_arrival(Time(0), address(k)).unwrap().1).collect();
        assert!(gate.on_arrival(Time(0), address(9999)).is_ok());
        assert_eq!(stalled.iter().filter(|end| end.is_cancelled()).count(), 1);
        assert!(stalled[0].is_cancelled(), "it is the oldest that ends");
    }

    #[test]
    fn who_has_greeted_is_never_ended_by_others() {
        let mut gate = Gate::default();
        let (ticket, end) = gate.on_arrival(Time(0), address(1)).unwrap();
        gate.on_greeted(ticket);
        for _ in 0..limits::CONNECTIONS_BURST_MAX {
            // Refused or not, others mustn't matter to it.
            let _ = gate.on_arrival(Time(0), address(1));
        }
        assert!(!end.is_cancelled());
    }

    #[test]
    fn an_address_has_its_share_of_places_and_others_have_theirs() {
        let mut gate = Gate::default();
        let mut tickets = Vec::new();
        for _ in 0..limits::CONNECTIONS_PER_ADDRESS_MAX {
            let (ticket, _) = gate.on_arrival(Time(0), address(1)).unwrap();
            gate.on_greeted(ticket);
            tickets.push(ticket);
        }
        assert_eq!(gate.on_arrival(Time(0), address(1)).unwrap_err(), Full::Address);
        assert!(gate.on_arrival(Time(0), address(2)).is_ok());
        gate.on_end(tickets[0], address(1));
        assert!(gate.on_arrival(Time(0), address(1)).is_ok());
    }

    #[test]
    fn all_addresses_together_have_a_limit() {
        let mut gate = Gate::default();
        for k in 0..limits::CONNECTIONS_MAX {
            let (ticket, _) = gate.on_arrival(Time(0), address(k as u32)).unwrap();
            gate.on_greeted(ticket);
        }
        assert_eq!(gate.on_arrival(Time(0), address(9999)).unwrap_err(), Full::All);
    }

    #[test]
    fn an_address_that_connects_too_fast_is_refused_until_it_has_rested() {
        let mut gate = Gate::default();
        for _ in 0..limits::CONNECTIONS_BURST_MAX {
            let (ticket, _) = gate.on_arrival(Time(0), address(1)).unwrap();
            gate.on_end(ticket, address(1));
        }
        assert_eq!(gate.on_arrival(Time(0), address(1)).unwrap_err(), Full::Rate);
        assert!(gate.on_arrival(Time(0), address(2)).is_ok());
        assert!(gate.on_arrival(second(1), address(1)).is_ok());
    }

    #[test]
    fn accounts_are_bounded_and_forgotten() {
        let mut gate = Gate::default();
        for k in 0..limits::ADDRESSES_MAX as u32 {
            let (ticket, _) = gate.on_arrival(Time(0), address(k)).unwrap();
            gate.on_end(ticket, address(k));
        }
        let late = address(limits::ADDRESSES_MAX as u32);
        assert_eq!(gate.on_arrival(Time(0), late).unwrap_err(), Full::Addresses);
        assert!(gate.on_arrival(second(REST_S), late).is_ok());
        assert_eq!(gate.accounts.len(), 1);
    }

    #[test]
    fn addresses_of_one_ipv6_network_are_one() {
        let [a, b]: [IpAddr; 2] = ["2001:db8::1".parse().unwrap(), "2001:db8::ffff:1".parse().unwrap()];
        assert_eq!(account_of(a), account_of(b));
        assert_eq!(account_of("::ffff:10.0.0.1".parse().unwrap()), address(1));
    }
}
