//! How a stream between two daemons begins, and messages over it: the part of every shell that is the same.
//!
//! Generic over the stream: a TCP socket in the rig, a pipe in memory in tests, a TLS session where there are keys. Nothing here
//! opens a socket or reads a clock; who wants a time limit puts one round it.

use crate::codec::{self, CodecError, Framing, PREAMBLE_LEN, VERSIONS};
use bytes::Bytes;
use futures_util::{SinkExt, Stream, StreamExt};
use serde::{Serialize, de::DeserializeOwned};
use std::io;
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio_util::codec::Framed;

/// A stream of frames after the preambles.
pub type Link<S> = Framed<S, Framing>;

/// Why a link is over.
#[derive(Debug, Error)]
pub enum LinkError {
    /// The stream failed or ended in the middle.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The peer broke the protocol, or is of another version.
    #[error(transparent)]
    Codec(#[from] CodecError),
    /// The peer closed where a message was due.
    #[error("the other side closed the connection")]
    Closed,
}

/// Exchanges preambles and agrees on a version; frames of at most `limit` bytes are taken afterwards.
///
/// # Errors
/// [`LinkError`]; a version mismatch names both sides' versions, on both sides.
pub async fn open<S: AsyncRead + AsyncWrite + Unpin>(mut stream: S, limit: usize) -> Result<Link<S>, LinkError> {
    stream.write_all(&codec::preamble(VERSIONS)).await?;
    stream.flush().await?;
    let mut theirs = [0; PREAMBLE_LEN];
    stream.read_exact(&mut theirs).await?;
    codec::agree(VERSIONS, &theirs)?;
    Ok(Framed::new(stream, Framing::new(limit)))
}

/// The next message, or `None` when the peer closed the stream.
///
/// # Errors
/// [`LinkError`].
pub async fn receive<M: DeserializeOwned>(
    link: &mut (impl Stream<Item = io::Result<bytes::BytesMut>> + Unpin),
) -> Result<Option<(M, Bytes)>, LinkError> {
    match link.next().await {
        None => Ok(None),
        Some(frame) => Ok(Some(codec::decode(frame?.freeze())?)),
    }
}

/// The next message, which must come.
///
/// # Errors
/// [`LinkError`]; [`LinkError::Closed`] at the stream's end.
pub async fn expect<M: DeserializeOwned>(
    link: &mut (impl Stream<Item = io::Result<bytes::BytesMut>> + Unpin),
) -> Result<(M, Bytes), LinkError> {
    receive(link).await?.ok_or(LinkError::Closed)
}

/// Sends one message and flushes.
///
/// # Errors
/// [`LinkError::Io`].
pub async fn send<M: Serialize>(
    link: &mut (impl futures_util::Sink<Bytes, Error = io::Error> + Unpin),
    header: &M,
    payload: &[u8],
) -> Result<(), LinkError> {
    Ok(link.send(codec::encode(header, payload)).await?)
}
