//! A stream that is plain or TLS; whoever reads and writes it needn't know which.

use crate::explain::plainly;
use crate::identity::Identity;
use crate::network::Socket;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio_rustls::TlsStream;

#[derive(Debug)]
enum Inner {
    Plain(Socket),
    // Hundreds of bytes of keys and state, beside a socket's few.
    Tls(Box<TlsStream<Socket>>),
}

/// A connection to a peer whose certificate, where there are keys, has been found good.
#[derive(Debug)]
pub struct Stream {
    inner: Inner,
    peer: Option<Identity>,
}

impl Stream {
    pub(crate) fn plain(stream: Socket) -> Self {
        Self { inner: Inner::Plain(stream), peer: None }
    }

    /// After the handshake; an error if the certificate is no node's.
    pub(crate) fn tls(stream: TlsStream<Socket>) -> io::Result<Self> {
        let certificates = stream.get_ref().1.peer_certificates();
        let peer = certificates.and_then(|chain| Identity::of(chain.first()?));
        let peer = peer.ok_or_else(|| io::Error::other("its certificate names no node of a rig"))?;
        Ok(Self { inner: Inner::Tls(Box::new(stream)), peer: Some(peer) })
    }

    /// Who the peer is by its certificate; `None` without keys.
    pub fn peer(&self) -> Option<&Identity> {
        self.peer.as_ref()
    }

    /// Our end's address.
    ///
    /// # Errors
    /// The system's.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        match &self.inner {
            Inner::Plain(stream) => stream.local_addr(),
            Inner::Tls(stream) => stream.get_ref().0.local_addr(),
        }
    }

    /// The other end's address.
    ///
    /// # Errors
    /// The system's.
    pub fn peer_addr(&self) -> io::Result<SocketAddr> {
        match &self.inner {
            Inner::Plain(stream) => stream.peer_addr(),
            Inner::Tls(stream) => stream.get_ref().0.peer_addr(),
        }
    }
}

impl AsyncRead for Stream {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        match &mut self.inner {
            Inner::Plain(stream) => Pin::new(stream).poll_read(cx, buf),
            Inner::Tls(stream) => match ready!(Pin::new(stream).poll_read(cx, buf)) {
                // A process that is killed doesn't say goodbye. Frames know their lengths, so one that was cut is noticed.
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Poll::Ready(Ok(())),
                read => Poll::Ready(read.map_err(plainly)),
            },
        }
    }
}

impl AsyncWrite for Stream {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        match &mut self.inner {
            Inner::Plain(stream) => Pin::new(stream).poll_write(cx, bytes),
            Inner::Tls(stream) => Pin::new(stream).poll_write(cx, bytes).map_err(plainly),
        }
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match &mut self.inner {
            Inner::Plain(stream) => Pin::new(stream).poll_flush(cx),
            Inner::Tls(stream) => Pin::new(stream).poll_flush(cx).map_err(plainly),
        }
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match &mut self.inner {
            Inner::Plain(stream) => Pin::new(stream).poll_shutdown(cx),
            Inner::Tls(stream) => Pin::new(stream).poll_shutdown(cx).map_err(plainly),
        }
    }
}
