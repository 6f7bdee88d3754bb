//! How a daemon's links are protected, and how they are opened.

use crate::explain::plainly;
use crate::identity::{Identity, NodeRole};
use crate::keys::{Credentials, Keys, KeysError};
use crate::network::{Door, Ground, Network, Socket};
use crate::stream::Stream;
use proto::backoff::Backoff;
use rustls::pki_types::ServerName;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_rustls::{TlsAcceptor, TlsConnector};

/// A rig's machines are near each other: what doesn't answer a connection in this time is gone, perhaps to another address, and is better looked for again.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);

/// A handshake needs two round trips and about a millisecond; a stalled machine may take a second.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(2);
/// How long, and for how many bytes, a peer that was refused is still listened to.
const LINGER: Duration = Duration::from_millis(200);
const LINGER_BYTES: u64 = 64 << 10;

/// Who is expected at the other end of a link that is opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Expected {
    /// Its role.
    pub role: NodeRole,
    /// Its name, if it must be a certain node.
    pub name: Option<String>,
}

impl Expected {
    /// Any node of this role.
    pub fn any(role: NodeRole) -> Self {
        Self { role, name: None }
    }

    /// The name that its certificate must have.
    fn server_name(&self) -> io::Result<ServerName<'static>> {
        let name = match &self.name {
            Some(name) => self.role.node_name(name),
            None => self.role.role_name(),
        };
        ServerName::try_from(name).map_err(|_| io::Error::other("it is expected under a name that no node can have"))
    }
}

#[derive(Clone, Debug)]
enum Means {
    Plain { beyond_this_machine: bool },
    Keys(Arc<Keys>),
}

/// How a daemon's links are protected, and over what they go. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Trust {
    means: Means,
    ground: Ground,
}

impl Trust {
    /// Without keys, and therefore only to and from this machine.
    pub const LOOPBACK: Self = Self { means: Means::Plain { beyond_this_machine: false }, ground: Ground::System };
    /// Without keys, and anywhere: for networks where everybody is trusted.
    pub const INSECURE: Self = Self { means: Means::Plain { beyond_this_machine: true }, ground: Ground::System };

    /// With the keys in `folder`, which must be those of a node of this role.
    ///
    /// # Errors
    /// [`KeysError`].
    pub fn with_keys(folder: &Path, role: NodeRole) -> Result<Self, KeysError> {
        Ok(Self { means: Means::Keys(Arc::new(Keys::open(folder, role)?)), ground: Ground::System })
    }

    /// The same over another network than the system's.
    #[must_use]
    pub fn over(self, network: Arc<dyn Network>) -> Self {
        Self { ground: Ground::Other(network), ..self }
    }

    /// How long to wait before a link is dialled again; `which` tells this daemon's links from each other.
    pub fn backoff(&self, which: u64) -> Backoff {
        Backoff::new(self.ground.seed() ^ which)
    }

    pub(crate) async fn listen(&self, address: SocketAddr) -> io::Result<Door> {
        self.ground.listen(address).await
    }

    /// Whether links are TLS.
    pub fn has_keys(&self) -> bool {
        matches!(self.means, Means::Keys(_))
    }

    /// Whether a link to or from this address may be without further ado, or be tried with keys.
    pub fn may_reach(&self, ip: IpAddr) -> bool {
        match self.means {
            Means::Plain { beyond_this_machine } => beyond_this_machine || is_on_this_machine(ip),
            Means::Keys(_) => true,
        }
    }

    /// Who we are by the keys that the next handshake will use.
    pub async fn identity(&self) -> Option<Identity> {
        match &self.means {
            Means::Keys(keys) => Some(current(keys).await.ok()?.identity.clone()),
            Means::Plain { .. } => None,
        }
    }

    /// Opens a connection to `address`, `host:port`, and with keys makes sure of who is there.
    ///
    /// # Errors
    /// The system's, or why the other side isn't who it should be.
    pub async fn connect(&self, address: &str, expected: &Expected) -> io::Result<Stream> {
        let silent = || io::Error::new(io::ErrorKind::TimedOut, "nobody answers there");
        let stream = tokio::time::timeout(CONNECT_TIMEOUT, self.ground.dial(address)).await.map_err(|_| silent())??;
        match &self.means {
            Means::Keys(keys) => {
                let connector = TlsConnector::from(current(keys).await?.client.clone());
                let shaking = connector.connect(expected.server_name()?, stream);
                Stream::tls(in_time(shaking).await?.map_err(plainly)?.into())
            }
            Means::Plain { .. } if !self.may_reach(stream.peer_addr()?.ip()) => {
                let what = "it is not on this machine, and without keys (--keys) nothing there is trusted";
                Err(io::Error::new(io::ErrorKind::PermissionDenied, what))
            }
            Means::Plain { .. } => Ok(Stream::plain(stream)),
        }
    }

    /// Makes sure of who has connected.
    pub(crate) async fn accept(&self, stream: Socket) -> io::Result<Stream> {
        stream.set_up()?;
        let Means::Keys(keys) = &self.means else { return Ok(Stream::plain(stream)) };
        let acceptor = TlsAcceptor::from(current(keys).await?.server.clone());
        match in_time(acceptor.accept(stream).into_fallible()).await? {
            Ok(stream) => Stream::tls(stream.into()),
            Err((error, stream)) => {
                linger(stream).await;
                Err(plainly(error))
            }
        }
    }
}

/// Whether an address is this machine's own.
pub fn is_on_this_machine(ip: IpAddr) -> bool {
    ip.to_canonical().is_loopback()
}

/// Files are read where a slow disk holds nobody up.
async fn current(keys: &Arc<Keys>) -> io::Result<Arc<Credentials>> {
    let keys = keys.clone();
    tokio::task::spawn_blocking(move || keys.current()).await.map_err(io::Error::other)
}

async fn in_time<T>(handshake: impl Future<Output = T>) -> io::Result<T> {
    let late = |_| io::Error::new(io::ErrorKind::TimedOut, "the TLS handshake took too long");
    tokio::time::timeout(HANDSHAKE_TIMEOUT, handshake).await.map_err(late)
}

/// Closes a connection so that the other side can read why: closing it with bytes of its unread would make the system reset it,
/// and what we have said would be lost.
async fn linger(mut stream: Socket) {
    let draining = async {
        // It may be gone already.
        let _ = stream.shutdown().await;
        let _ = tokio::io::copy(&mut (&mut stream).take(LINGER_BYTES), &mut tokio::io::sink()).await;
    };
    // It doesn't matter whether it has ended.
    let _ = tokio::time::timeout(LINGER, draining).await;
}
