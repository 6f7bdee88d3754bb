//! `cyclorama host play`: a camera file flown as native pose packets.

use crate::cli::{HostPlayArgs, Supervision};
use crate::error::CommandError;
use crate::serve::{runtime, shutdown_token};
use crate::source;
use proto::pose::Answer;
use std::io::ErrorKind;
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// How long a lock-step host waits for an answer before it asks again.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(200);
/// How often the manager's name is looked up again. A datagram to a machine that is gone ends without an error, so it has to be asked.
const LOOK_PERIOD: Duration = Duration::from_secs(1);

/// `cyclorama host play`.
pub(crate) fn play(args: &HostPlayArgs) -> Result<(), CommandError> {
    let camera = source::camera(&args.file)?;
    if args.lock_step && args.to.len() > 1 {
        return Err(CommandError::said("in lock-step there is one manager; give one --to"));
    }
    let outlets = args.to.iter().map(|to| Outlet::open(to)).collect::<Result<Vec<_>, _>>()?;
    end_when_told(args.supervision)?;
    let mut sequence = 0;
    let mut epoch = Instant::now();
    loop {
        for k in 0..camera.poses.len() {
            let due = camera.poses[k].t.unwrap_or(k as f64 / args.rate);
            if !args.lock_step {
                let due = epoch + Duration::from_secs_f64((due - camera.poses[0].t.unwrap_or(0.0)).max(0.0));
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
            let packet = camera.packet(k, sequence, args.lock_step, args.size).encode();
            for outlet in &outlets {
                outlet.send(&packet, sequence, args.lock_step);
            }
            sequence = sequence.wrapping_add(1);
        }
        if !args.repeat {
            return Ok(());
        }
        // One period between the last pose and the first again.
        std::thread::sleep(if args.lock_step { Duration::ZERO } else { Duration::from_secs_f64(1.0 / args.rate) });
        epoch = Instant::now();
    }
}

/// Ends the program when it is told to. As the first process of a container it would hear of no signal that it doesn't listen for.
fn end_when_told(supervision: Supervision) -> Result<(), CommandError> {
    let runtime = runtime(1)?;
    let told = runtime.block_on(async { shutdown_token(supervision) })?;
    std::thread::spawn(move || {
        runtime.block_on(told.cancelled());
        std::process::exit(0);
    });
    Ok(())
}

/// Where packets leave for a manager, which may come back at another address of the same name.
struct Outlet {
    to: String,
    socket: UdpSocket,
    /// New addresses of the name.
    moves: Receiver<SocketAddr>,
}

impl Outlet {
    fn open(to: &str) -> Result<Self, CommandError> {
        let no_socket = |error| CommandError::said(format!("no UDP socket: {error}"));
        let no_peer =
            |error: std::io::Error| CommandError::said(format!("{to}: {error}; expected HOST:PORT of a manager"));
        let peer = to.to_socket_addrs().map_err(no_peer)?.next();
        let peer = peer.ok_or_else(|| no_peer(ErrorKind::AddrNotAvailable.into()))?;
        let any: SocketAddr = if peer.is_ipv4() { ([0; 4], 0).into() } else { ([0; 16], 0).into() };
        let socket = UdpSocket::bind(any).map_err(no_socket)?;
        socket.connect(peer).map_err(no_peer)?;
        socket.set_read_timeout(Some(ANSWER_TIMEOUT)).map_err(no_socket)?;
        let (sender, moves) = channel();
        if to.parse::<SocketAddr>().is_err() {
            // A name server may take seconds, and poses don't wait.
            let to = to.to_owned();
            std::thread::spawn(move || look_out(&to, peer, &sender));
        }
        Ok(Self { to: to.to_owned(), socket, moves })
    }

    fn follow(&self) {
        while let Ok(peer) = self.moves.try_recv() {
            match self.socket.connect(peer) {
                Ok(()) => tracing::warn!(to = self.to, %peer, "the manager has another address"),
                Err(error) => tracing::warn!(to = self.to, %peer, %error, "the manager's new address can't be used"),
            }
        }
    }

    /// Sends a pose; in lock-step again and again until the manager has shown it.
    fn send(&self, packet: &[u8], sequence: u32, lock_step: bool) {
        let mut answer = [0; 64];
        loop {
            self.follow();
            // "Refused" means that the manager isn't there at present: like JSBSim, go on.
            if let Err(error) = self.socket.send(packet) {
                tracing::debug!(%error, "pose not sent");
                if lock_step {
                    std::thread::sleep(ANSWER_TIMEOUT);
                }
            }
            if !lock_step {
                return;
            }
            loop {
                match self.socket.recv(&mut answer) {
                    Ok(len) if Answer::decode(&answer[..len]).is_ok_and(|answer| answer.sequence == sequence) => return,
                    Ok(_) => {}
                    Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => break,
                    // "Refused": nobody listens at present, and the next attempt would fail as fast.
                    Err(_) => {
                        std::thread::sleep(ANSWER_TIMEOUT);
                        break;
                    }
                }
            }
        }
    }
}

/// Tells when the name doesn't mean this address any more.
fn look_out(to: &str, mut peer: SocketAddr, moves: &Sender<SocketAddr>) {
    loop {
        std::thread::sleep(LOOK_PERIOD);
        // While a name server doesn't answer, or has nothing, things stay as they are.
        let found: Vec<_> = to.to_socket_addrs().into_iter().flatten().collect();
        if let Some(first) = found.first().filter(|_| !found.contains(&peer)) {
            peer = *first;
            if moves.send(peer).is_err() {
                return;
            }
        }
    }
}
