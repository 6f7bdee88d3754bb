//! What carries links: the system's sockets or, in tests, a network that is simulated.
//!
//! A shell says whom to dial and where to listen, and never holds a socket of its own, so the same shell runs over both. Which it is, is decided while
//! the program runs, not by a feature: features of a workspace are built together, and the real program must not contain the simulated network.
//! The system's sockets are a variant rather than a trait object; what that costs is one branch per read and write of kilobytes.
//!
//! Poses come as datagrams from outside the rig, and browsers ask for pages: neither is a link, and neither comes through here.

use socket2::{SockRef, TcpKeepalive};
use std::fmt;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, IoSlice};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};

/// After so long without a word the other machine is asked whether it is there, and again this often; the system gives up after some nine times. Boards
/// and backplanes find each other out much sooner, by their beats; nobody beats to a compositor, nor to a neighbour.
const PROBE_AFTER: Duration = Duration::from_secs(2);
const PROBE_PERIOD: Duration = Duration::from_secs(1);

/// What is waited for.
pub type Waiting<'a, T> = Pin<Box<dyn Future<Output = io::Result<T>> + Send + 'a>>;

/// A network other than the system's.
pub trait Network: fmt::Debug + Send + Sync {
    /// Opens a connection to `host:port`.
    fn dial<'a>(&'a self, address: &'a str) -> Waiting<'a, Box<dyn Wire>>;

    /// Takes connections at an address of this host; port 0: any free port.
    fn listen(&self, address: SocketAddr) -> Waiting<'_, Box<dyn Port>>;

    /// What this daemon's chances begin with: how long it waits before it dials again. Another for each daemon.
    fn seed(&self) -> u64;
}

/// A connection over a [`Network`]: bytes in order, or an end.
pub trait Wire: AsyncRead + AsyncWrite + fmt::Debug + Send + Unpin {
    /// Our end's address.
    ///
    /// # Errors
    /// The network's.
    fn local_addr(&self) -> io::Result<SocketAddr>;

    /// The other end's address.
    ///
    /// # Errors
    /// The network's.
    fn peer_addr(&self) -> io::Result<SocketAddr>;
}

/// A place of a [`Network`] to which others connect.
pub trait Port: fmt::Debug + Send + Sync {
    /// The next connection, and where it comes from. Cancel-safe.
    fn accept(&self) -> Waiting<'_, (Box<dyn Wire>, SocketAddr)>;

    /// Where it listens.
    ///
    /// # Errors
    /// The network's.
    fn local_addr(&self) -> io::Result<SocketAddr>;
}

/// Over what a daemon's links go.
#[derive(Clone, Debug)]
pub(crate) enum Ground {
    System,
    Other(Arc<dyn Network>),
}

impl Ground {
    pub(crate) async fn dial(&self, address: &str) -> io::Result<Socket> {
        match self {
            Self::System => {
                let socket = Socket::Tcp(TcpStream::connect(address).await?);
                socket.set_up()?;
                Ok(socket)
            }
            Self::Other(network) => Ok(Socket::Other(network.dial(address).await?)),
        }
    }

    pub(crate) async fn listen(&self, address: SocketAddr) -> io::Result<Door> {
        match self {
            Self::System => Ok(Door::Tcp(TcpListener::bind(address).await?)),
            Self::Other(network) => Ok(Door::Other(network.listen(address).await?)),
        }
    }

    pub(crate) fn seed(&self) -> u64 {
        match self {
            // Not the process's number: the first process of every container has the same.
            Self::System => RandomState::new().build_hasher().finish(),
            Self::Other(network) => network.seed(),
        }
    }
}

#[derive(Debug)]
pub(crate) enum Door {
    Tcp(TcpListener),
    Other(Box<dyn Port>),
}

impl Door {
    /// Cancel-safe.
    pub(crate) async fn accept(&self) -> io::Result<(Socket, SocketAddr)> {
        match self {
            Self::Tcp(listener) => {
                let (stream, from) = listener.accept().await?;
                Ok((Socket::Tcp(stream), from))
            }
            Self::Other(port) => {
                let (wire, from) = port.accept().await?;
                Ok((Socket::Other(wire), from))
            }
        }
    }

    pub(crate) fn local_addr(&self) -> io::Result<SocketAddr> {
        match self {
            Self::Tcp(listener) => listener.local_addr(),
            Self::Other(port) => port.local_addr(),
        }
    }
}

/// A connection before anything has been said over it.
#[derive(Debug)]
pub(crate) enum Socket {
    Tcp(TcpStream),
    Other(Box<dyn Wire>),
}

impl Socket {
    /// A message goes out when it is flushed, however small it is; and a machine that loses its power, or is cut off, while nobody has anything to say to
    /// it is found out, for it says nothing of that itself.
    pub(crate) fn set_up(&self) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => {
                stream.set_nodelay(true)?;
                let probes = TcpKeepalive::new().with_time(PROBE_AFTER).with_interval(PROBE_PERIOD);
                SockRef::from(stream).set_tcp_keepalive(&probes)
            }
            Self::Other(_) => Ok(()),
        }
    }

    pub(crate) fn local_addr(&self) -> io::Result<SocketAddr> {
        match self {
            Self::Tcp(stream) => stream.local_addr(),
            Self::Other(wire) => wire.local_addr(),
        }
    }

    pub(crate) fn peer_addr(&self) -> io::Result<SocketAddr> {
        match self {
            Self::Tcp(stream) => stream.peer_addr(),
            Self::Other(wire) => wire.peer_addr(),
        }
    }
}

impl AsyncRead for Socket {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Tcp(stream) => Pin::new(stream).poll_read(cx, buf),
            Self::Other(wire) => Pin::new(wire).poll_read(cx, buf),
        }
    }
}

impl AsyncWrite for Socket {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        match self.get_mut() {
            Self::Tcp(stream) => Pin::new(stream).poll_write(cx, bytes),
            Self::Other(wire) => Pin::new(wire).poll_write(cx, bytes),
        }
    }

    /// TLS hands over several records at once.
    fn poll_write_vectored(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        match self.get_mut() {
            Self::Tcp(stream) => Pin::new(stream).poll_write_vectored(cx, slices),
            Self::Other(wire) => Pin::new(wire).poll_write_vectored(cx, slices),
        }
    }

    fn is_write_vectored(&self) -> bool {
        match self {
            Self::Tcp(stream) => stream.is_write_vectored(),
            Self::Other(wire) => wire.is_write_vectored(),
        }
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Tcp(stream) => Pin::new(stream).poll_flush(cx),
            Self::Other(wire) => Pin::new(wire).poll_flush(cx),
        }
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Tcp(stream) => Pin::new(stream).poll_shutdown(cx),
            Self::Other(wire) => Pin::new(wire).poll_shutdown(cx),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn whoever_is_gone_without_a_word_is_found_out_at_both_ends() {
        let ground = Ground::System;
        let door = ground.listen(SocketAddr::from(([127, 0, 0, 1], 0))).await.unwrap();
        let address = door.local_addr().unwrap().to_string();
        let (dialled, accepted) = tokio::join!(ground.dial(&address), door.accept());
        let accepted = accepted.unwrap().0;
        accepted.set_up().unwrap();
        for socket in [dialled.unwrap(), accepted] {
            let Socket::Tcp(stream) = socket else { panic!("the system's") };
            let socket = SockRef::from(&stream);
            assert!(socket.keepalive().unwrap() && stream.nodelay().unwrap(), "{stream:?}");
            assert_eq!(socket.tcp_keepalive_time().unwrap(), PROBE_AFTER);
        }
    }
}
