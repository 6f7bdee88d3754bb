//! A relay between two processes that does to their connection what networks do: it can be cut, go silent one way or both, delay, limit the rate,
//! lose and reset.
//!
//! It passes on TCP's bytes, of which none can be left out without breaking what both ends have agreed on. So a *loss* here is what a lost segment
//! is to who reads: nothing comes for the time of a retransmission, and then all of it. What really doesn't come back is the connection: a *reset*.
//! What machines do to each other's segments is shown with real ones, in `tests/rig/namespaces.rs`.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Bytes that are passed on at once.
const CHUNK: usize = 8 << 10;
/// Chunks under way in one direction; beyond, the sender is held back, as by a full window.
const WINDOW: usize = 64;
/// How often a reader that hears nothing looks whether it has been cut.
const LOOK: Duration = Duration::from_millis(5);
/// How long TCP waits at least, on Linux, before it sends a lost segment again.
pub const RETRANSMISSION: Duration = Duration::from_millis(200);

/// One of the two directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// From who connects to the relay.
    There,
    /// To who connects to the relay.
    Back,
}

/// How slow a way is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Slowness {
    /// How long each chunk takes.
    pub delay: Duration,
    /// How much longer at most. Chunks stay in order.
    pub jitter: Duration,
    /// Bytes per second that pass at most; `None`: as many as come.
    pub rate: Option<u32>,
    /// What the jitter is drawn from, anew for each link.
    pub seed: u64,
}

#[derive(Debug, Default)]
struct Side {
    is_silent: bool,
    /// Until then nothing passes.
    lost_until: Option<Instant>,
    slowness: Slowness,
}

#[derive(Debug, Default)]
struct State {
    /// Links close, and no new one is made.
    is_broken: bool,
    /// Links that were made before this many resets are reset.
    resets: u64,
    sides: [Side; 2],
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.lock());
        self.changed.notify_all();
    }
}

/// Passes on what comes to `address`, until dropped.
#[derive(Debug)]
pub struct Relay {
    /// Where it listens, on loopback.
    pub address: SocketAddr,
    shared: Arc<Shared>,
}

impl Relay {
    /// To another address.
    ///
    /// # Errors
    /// If there is no port to listen at.
    pub fn to(to: SocketAddr) -> std::io::Result<Self> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared::default());
        let relay = shared.clone();
        std::thread::spawn(move || {
            // All links go through these threads: none of them may be late for want of a processor.
            pool::turns::go_first();
            for from in listener.incoming().map_while(Result::ok) {
                if relay.lock().is_broken {
                    continue;
                }
                let Ok(to) = TcpStream::connect(to) else { continue };
                // The system's own delays are none of ours. A link that fails at once is seen by who reads it.
                let _ = (from.set_nodelay(true), to.set_nodelay(true));
                for (way, from, to) in [(Way::There, &from, &to), (Way::Back, &to, &from)] {
                    let (Ok(from), Ok(to)) = (from.try_clone(), to.try_clone()) else { continue };
                    pass(&relay, way, from, to);
                }
            }
        });
        Ok(Self { address, shared })
    }

    /// From now on nothing passes; links stay open.
    pub fn silence(&self) {
        self.shared.change(|state| state.sides.iter_mut().for_each(|side| side.is_silent = true));
    }

    /// From now on nothing passes in this way; links stay open.
    pub fn silence_one(&self, way: Way) {
        self.shared.change(|state| state.sides[way as usize].is_silent = true);
    }

    /// From now on links close.
    pub fn break_links(&self) {
        self.shared.change(|state| state.is_broken = true);
    }

    /// Resets all links that are open, as a firewall does that has forgotten them; new ones are made.
    pub fn reset(&self) {
        self.shared.change(|state| state.resets += 1);
    }

    /// Loses a segment in this way: what comes waits for [`RETRANSMISSION`].
    pub fn lose(&self, way: Way) {
        self.shared.change(|state| state.sides[way as usize].lost_until = Some(Instant::now() + RETRANSMISSION));
    }

    /// Makes a way slow, for what comes from now on.
    pub fn slow(&self, way: Way, slowness: Slowness) {
        self.shared.change(|state| state.sides[way as usize].slowness = slowness);
    }

    /// All passes again at once, what was held up too.
    pub fn mend(&self) {
        self.shared.change(|state| *state = State { resets: state.resets, ..State::default() });
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.break_links();
    }
}

/// Bytes that have come, and when they are to go.
struct Chunk {
    due: Instant,
    bytes: Vec<u8>,
}

/// Numbers from a seed: `SplitMix64`.
struct Random(u64);

impl Random {
    /// Up to this long.
    fn up_to(&mut self, longest: Duration) -> Duration {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        longest.mul_f64(((mixed ^ (mixed >> 31)) >> 11) as f64 / (1_u64 << 53) as f64)
    }
}

/// When chunks go, given when they come.
struct Schedule {
    slowness: Slowness,
    random: Random,
    /// When the way is free for the next.
    free: Instant,
}

impl Schedule {
    fn new(now: Instant, slowness: Slowness) -> Self {
        Self { slowness, random: Random(slowness.seed), free: now }
    }

    fn due(&mut self, now: Instant, len: usize) -> Instant {
        let Slowness { delay, jitter, rate, .. } = self.slowness;
        let takes = rate.map_or(Duration::ZERO, |rate| Duration::from_secs_f64(len as f64 / f64::from(rate.max(1))));
        self.free = self.free.max(now + delay + self.random.up_to(jitter)) + takes;
        self.free
    }
}

/// Passes bytes on in one direction: one thread takes them, another gives them on when they are due.
fn pass(shared: &Arc<Shared>, way: Way, from: TcpStream, to: TcpStream) {
    let resets = shared.lock().resets;
    let (queue, waiting) = sync_channel(WINDOW);
    let (Ok(source), Ok(sink)) = (from.try_clone(), to.try_clone()) else { return };
    let relay = shared.clone();
    std::thread::spawn(move || {
        take(&relay, way, resets, source, &queue);
        // The other thread ends the link, when all that came before has gone.
    });
    let relay = shared.clone();
    std::thread::spawn(move || {
        let is_reset = give(&relay, way, resets, sink, &waiting);
        for stream in [&from, &to] {
            // It may be gone already.
            let _ = if is_reset {
                socket2::SockRef::from(stream).set_linger(Some(Duration::ZERO))
            } else {
                stream.shutdown(Shutdown::Both)
            };
        }
    });
}

/// Takes what comes, until the end.
fn take(shared: &Shared, way: Way, resets: u64, mut from: TcpStream, queue: &SyncSender<Chunk>) {
    // Without it a link that is cut would be noticed when something comes.
    let _ = from.set_read_timeout(Some(LOOK));
    let mut buffer = vec![0; CHUNK];
    let mut schedule = Schedule::new(Instant::now(), shared.lock().sides[way as usize].slowness);
    loop {
        let read = from.read(&mut buffer);
        let now = Instant::now();
        {
            let state = shared.lock();
            if state.is_broken || state.resets != resets {
                return;
            }
            let slowness = state.sides[way as usize].slowness;
            if schedule.slowness != slowness {
                schedule = Schedule::new(now, slowness);
            }
        }
        match read {
            Ok(0) => return,
            Ok(len) => {
                if queue.send(Chunk { due: schedule.due(now, len), bytes: buffer[..len].to_vec() }).is_err() {
                    return;
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return,
        }
    }
}

/// Gives on what has come, when it is due and may pass. Returns whether the link was reset.
fn give(shared: &Shared, way: Way, resets: u64, mut to: TcpStream, waiting: &Receiver<Chunk>) -> bool {
    while let Ok(Chunk { due, bytes }) = waiting.recv() {
        let mut state = shared.lock();
        loop {
            if state.is_broken || state.resets != resets {
                return state.resets != resets;
            }
            let (now, side) = (Instant::now(), &state.sides[way as usize]);
            // A way that is no longer slow has nothing under way.
            let due = if side.slowness == Slowness::default() { now } else { due };
            let free = due.max(side.lost_until.unwrap_or(now));
            if !side.is_silent && free <= now {
                break;
            }
            let longest = if side.is_silent { LOOK } else { free - now };
            state = shared.changed.wait_timeout(state, longest).unwrap_or_else(PoisonError::into_inner).0;
        }
        drop(state);
        if to.write_all(&bytes).is_err() {
            break;
        }
    }
    shared.lock().resets != resets
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both ends of a link through a relay.
    fn linked() -> (Relay, TcpStream, TcpStream) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let relay = Relay::to(listener.local_addr().unwrap()).unwrap();
        let near = TcpStream::connect(relay.address).unwrap();
        let (far, _) = listener.accept().unwrap();
        for stream in [&near, &far] {
            stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        }
        (relay, near, far)
    }

    fn hears(stream: &mut TcpStream, len: usize) -> Vec<u8> {
        let mut bytes = vec![0; len];
        stream.read_exact(&mut bytes).unwrap();
        bytes
    }

    #[test]
    fn a_slow_way_takes_its_time_and_the_other_does_not() {
        let (relay, mut near, mut far) = linked();
        let delay = Duration::from_millis(300);
        relay.slow(Way::There, Slowness { delay, jitter: Duration::from_millis(40), rate: None, seed: 7 });
        let since = Instant::now();
        near.write_all(b"there").unwrap();
        assert_eq!(hears(&mut far, 5), b"there");
        assert!(since.elapsed() >= delay, "{:?}", since.elapsed());
        far.write_all(b"back").unwrap();
        assert_eq!(hears(&mut near, 4), b"back");
        // More than fits under way, in order.
        let bytes: Vec<u8> = (0..1 << 20).map(|k: u32| (k % 251) as u8).collect();
        let sent = bytes.clone();
        let sender = std::thread::spawn(move || near.write_all(&sent).map(|()| near));
        assert!(hears(&mut far, bytes.len()) == bytes);
        sender.join().unwrap().unwrap();
    }

    #[test]
    fn when_chunks_go_follows_from_the_seed_and_they_stay_in_order() {
        let now = Instant::now();
        let dues = |slowness| {
            let mut schedule = Schedule::new(now, slowness);
            (0..50).map(|k| schedule.due(now + Duration::from_millis(k), 1000) - now).collect::<Vec<_>>()
        };
        let (delay, jitter) = (Duration::from_millis(30), Duration::from_millis(20));
        let slow = |seed| dues(Slowness { delay, jitter, rate: None, seed });
        assert_eq!(slow(1), slow(1));
        assert_ne!(slow(1), slow(2));
        assert!(slow(1).is_sorted());
        assert!(slow(1).iter().enumerate().all(|(k, due)| {
            let least = delay + Duration::from_millis(k as u64);
            *due >= least && *due <= delay + jitter + Duration::from_millis(49)
        }));
        let limited = dues(Slowness { rate: Some(10_000), ..Slowness::default() });
        assert_eq!(limited[49], Duration::from_secs(5), "50 times 1000 bytes at 10 000 a second");
    }

    #[test]
    fn silence_one_way_holds_up_that_way_only_until_it_is_mended() {
        let (relay, mut near, mut far) = linked();
        relay.silence_one(Way::Back);
        far.write_all(b"later").unwrap();
        near.write_all(b"now").unwrap();
        assert_eq!(hears(&mut far, 3), b"now");
        near.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        assert!(near.read(&mut [0; 1]).is_err(), "nothing comes");
        relay.mend();
        near.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        assert_eq!(hears(&mut near, 5), b"later");
    }

    #[test]
    fn a_loss_is_a_wait_for_the_retransmission_and_nothing_is_missing() {
        let (relay, mut near, mut far) = linked();
        let since = Instant::now();
        relay.lose(Way::There);
        near.write_all(b"lost").unwrap();
        assert_eq!(hears(&mut far, 4), b"lost");
        assert!(since.elapsed() >= RETRANSMISSION, "{:?}", since.elapsed());
    }

    #[test]
    fn a_reset_is_one_to_both_and_new_links_are_made() {
        let (relay, mut near, mut far) = linked();
        near.write_all(b"x").unwrap();
        assert_eq!(hears(&mut far, 1), b"x");
        relay.reset();
        for stream in [&mut near, &mut far] {
            assert_eq!(stream.read(&mut [0; 1]).unwrap_err().kind(), ErrorKind::ConnectionReset);
        }
        assert!(TcpStream::connect(relay.address).is_ok());
    }
}
