//! Accepting connections, within bounds.

use crate::gate::{Full, Gate};
use crate::network::{Door, Socket};
use crate::stream::Stream;
use crate::trust::Trust;
use proto::link::LinkError;
use proto::time::Time;
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

/// Whoever is refused at the door is counted, and told of so often at most.
const TELL_PERIOD: Duration = Duration::from_secs(1);
/// Without file descriptors nothing can be accepted until others are given back.
const FAILED_PAUSE: Duration = Duration::from_millis(100);

/// What has come.
#[derive(Debug)]
pub enum Arrival {
    /// Somebody, who has yet to say who it is.
    Peer(Incoming),
    /// Connections that were closed at once.
    Refused {
        /// How many, since the last such word.
        count: u64,
        /// Where the last came from.
        from: SocketAddr,
        /// Why it was refused.
        reason: String,
    },
}

#[derive(Debug)]
struct Tally {
    count: u64,
    from: SocketAddr,
    reason: Full,
    tell_at: Instant,
}

/// A listening socket with its bounds.
#[derive(Debug)]
pub struct Listener {
    door: Door,
    trust: Trust,
    gate: Arc<Mutex<Gate>>,
    started: Instant,
    refused: Option<Tally>,
}

impl Listener {
    /// Takes connections at `address`, protected as `trust` says; port 0: any free port.
    ///
    /// # Errors
    /// The system's.
    pub async fn bind(address: SocketAddr, trust: Trust) -> io::Result<Self> {
        let door = trust.listen(address).await?;
        Ok(Self { door, trust, gate: Arc::default(), started: Instant::now(), refused: None })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// The system's.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        self.door.local_addr()
    }

    /// The next arrival. Cancel-safe.
    pub async fn next(&mut self) -> Arrival {
        loop {
            if let Some(told) = self.refused.take_if(|tally| tally.tell_at <= Instant::now()) {
                return Arrival::Refused { count: told.count, from: told.from, reason: told.reason.to_string() };
            }
            let tell_at = self.refused.as_ref().map(|tally| tally.tell_at);
            let accepted = tokio::select! {
                accepted = self.door.accept() => accepted,
                () = sleep_until(tell_at) => continue,
            };
            match accepted {
                Ok((stream, from)) => match self.admit(stream, from) {
                    Ok(incoming) => return Arrival::Peer(incoming),
                    Err(reason) => self.tally(from, reason),
                },
                Err(error) => {
                    tracing::warn!(%error, "accept failed");
                    tokio::time::sleep(FAILED_PAUSE).await;
                }
            }
        }
    }

    fn admit(&self, stream: Socket, from: SocketAddr) -> Result<Incoming, Full> {
        let now = Time(self.started.elapsed().as_nanos() as u64);
        let (ticket, end) = lock(&self.gate).on_arrival(now, from.ip())?;
        let place = Place { gate: self.gate.clone(), ticket, from, end };
        Ok(Incoming { stream, place, trust: self.trust.clone() })
    }

    fn tally(&mut self, from: SocketAddr, reason: Full) {
        match &mut self.refused {
            Some(tally) => (tally.count, tally.from, tally.reason) = (tally.count + 1, from, reason),
            None => self.refused = Some(Tally { count: 1, from, reason, tell_at: Instant::now() + TELL_PERIOD }),
        }
    }
}

async fn sleep_until(at: Option<Instant>) {
    match at {
        Some(at) => tokio::time::sleep_until(at).await,
        None => std::future::pending().await,
    }
}

/// Nothing panics while it holds the gate.
fn lock(gate: &Mutex<Gate>) -> MutexGuard<'_, Gate> {
    gate.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A connection's place among those that there may be; dropping it gives the place back.
#[derive(Debug)]
pub struct Place {
    gate: Arc<Mutex<Gate>>,
    ticket: u64,
    from: SocketAddr,
    /// It must end because others want in. Never after the greeting.
    end: CancellationToken,
}

impl Drop for Place {
    fn drop(&mut self) {
        lock(&self.gate).on_end(self.ticket, self.from.ip());
    }
}

/// Somebody who has connected.
#[derive(Debug)]
pub struct Incoming {
    stream: Socket,
    place: Place,
    trust: Trust,
}

impl Incoming {
    /// Its address.
    pub fn from(&self) -> SocketAddr {
        self.place.from
    }

    /// Makes sure of who it is, then lets `greeting` hear what it says first; both together within `limit`, and unless others need
    /// the place. The link keeps the place until that is dropped.
    ///
    /// # Errors
    /// [`LinkError`], of whatever failed.
    pub async fn greet<T, F>(self, limit: Duration, greeting: impl FnOnce(Stream) -> F) -> Result<(T, Place), LinkError>
    where
        F: Future<Output = Result<T, LinkError>>,
    {
        let Self { stream, place, trust } = self;
        if !trust.may_reach(place.from.ip()) {
            return Err(refused(io::ErrorKind::PermissionDenied, "it is not on this machine, and there are no keys"));
        }
        let greeting = async { greeting(trust.accept(stream).await?).await };
        let greeted = tokio::select! {
            greeted = tokio::time::timeout(limit, greeting) => greeted,
            () = place.end.cancelled() => {
                return Err(refused(io::ErrorKind::TimedOut, "it said nothing, and others wanted in"));
            }
        };
        let Ok(greeted) = greeted else {
            return Err(refused(io::ErrorKind::TimedOut, "it didn't say who it is in time"));
        };
        let greeted = greeted?;
        lock(&place.gate).on_greeted(place.ticket);
        Ok((greeted, place))
    }
}

fn refused(kind: io::ErrorKind, why: &'static str) -> LinkError {
    LinkError::Io(io::Error::new(kind, why))
}
