//! The network of a host: turmoil's sockets behind the seam of [`link::Network`], counted, and a diary of who dialled whom.

use link::{Network, Port, Waiting, Wire};
use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use turmoil::net::{TcpListener, TcpStream};

/// A connection that was tried.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// When it was begun, in virtual time.
    pub at: Duration,
    /// By which host.
    pub from: &'static str,
    /// `host:port`.
    pub to: String,
    /// What became of it.
    pub came: Result<(), io::ErrorKind>,
}

type Diary = Arc<Mutex<Vec<Entry>>>;

/// A host's view of the network. Clones share what they count.
#[derive(Clone, Debug)]
pub struct Ground {
    host: &'static str,
    seed: u64,
    diary: Diary,
    open: Arc<AtomicUsize>,
}

impl Ground {
    /// Of a host; its waits begin with `seed`, and it writes into that diary.
    pub fn new(host: &'static str, seed: u64, diary: Diary) -> Self {
        Self { host, seed, diary, open: Arc::default() }
    }

    /// How many connections this host has open.
    pub fn open(&self) -> usize {
        self.open.load(Ordering::Relaxed)
    }

    fn hold(&self, stream: TcpStream) -> Box<dyn Wire> {
        self.open.fetch_add(1, Ordering::Relaxed);
        Box::new(Simulated { stream, open: self.open.clone() })
    }
}

impl Network for Ground {
    fn dial<'a>(&'a self, address: &'a str) -> Waiting<'a, Box<dyn Wire>> {
        Box::pin(async move {
            let at = turmoil::sim_elapsed().unwrap_or_default();
            let dialled = Dialled { ground: self, at, address, came: Err(io::ErrorKind::TimedOut) };
            dialled.dial().await
        })
    }

    fn listen(&self, address: SocketAddr) -> Waiting<'_, Box<dyn Port>> {
        Box::pin(async move {
            let listener = TcpListener::bind(address).await?;
            Ok(Box::new(Listening { listener, ground: self.clone() }) as Box<dyn Port>)
        })
    }

    fn seed(&self) -> u64 {
        self.seed
    }
}

/// A connection that is being made. Whoever waits for it may give up: then this is dropped, and writes down that it took too long.
struct Dialled<'a> {
    ground: &'a Ground,
    at: Duration,
    address: &'a str,
    came: Result<(), io::ErrorKind>,
}

impl Dialled<'_> {
    async fn dial(mut self) -> io::Result<Box<dyn Wire>> {
        let stream = TcpStream::connect(self.address).await;
        self.came = stream.as_ref().map(drop).map_err(io::Error::kind);
        Ok(self.ground.hold(stream?))
    }
}

impl Drop for Dialled<'_> {
    fn drop(&mut self) {
        let Self { ground, at, address, came } = self;
        let entry = Entry { at: *at, from: ground.host, to: (*address).to_owned(), came: *came };
        ground.diary.lock().unwrap_or_else(PoisonError::into_inner).push(entry);
    }
}

struct Listening {
    listener: TcpListener,
    ground: Ground,
}

impl fmt::Debug for Listening {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Listening({:?})", self.listener.local_addr())
    }
}

impl Port for Listening {
    fn accept(&self) -> Waiting<'_, (Box<dyn Wire>, SocketAddr)> {
        Box::pin(async move {
            let (stream, from) = self.listener.accept().await?;
            Ok((self.ground.hold(stream), from))
        })
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

#[derive(Debug)]
struct Simulated {
    stream: TcpStream,
    open: Arc<AtomicUsize>,
}

impl Drop for Simulated {
    fn drop(&mut self) {
        self.open.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Wire for Simulated {
    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.stream.local_addr()
    }

    fn peer_addr(&self) -> io::Result<SocketAddr> {
        self.stream.peer_addr()
    }
}

impl AsyncRead for Simulated {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buf)
    }
}

impl AsyncWrite for Simulated {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(cx, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}
