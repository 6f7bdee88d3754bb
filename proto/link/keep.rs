//! A link to a backplane that is kept: dialled again and again with a jittered back-off, and, while it is up, two loops that only move messages.
//! Boards and compositors have one to each backplane that they know; what is said means nothing here.
//!
//! No link is waited for: one that doesn't take what is said is hung, and cut, so that a backplane that is stopped doesn't hold the other one up.

use crate::Stream;
use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use proto::backoff::Backoff;
use proto::codec;
use proto::link::{Link, LinkError};
use serde::de::DeserializeOwned;
use std::io;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// A link that hasn't been greeted by then is dialled again.
const GREETING_TIMEOUT: Duration = Duration::from_secs(5);

/// What happened on a link; which one is the number that it is kept under.
#[derive(Debug)]
pub enum Kept<M> {
    /// It is up, and has been greeted.
    Up(usize, Outbox),
    /// The backplane said something.
    Said(usize, Box<M>, Bytes),
    /// It is down, or couldn't be made.
    Down(usize, LinkError),
}

/// The owner's end of a link; dropping it cuts the link.
#[derive(Debug)]
pub struct Outbox {
    queue: mpsc::Sender<Bytes>,
    cut: CancellationToken,
}

impl Outbox {
    /// Queues a message; cuts the link if there is no room.
    pub fn send(&self, message: Bytes) {
        if self.queue.try_send(message).is_err() {
            self.cut.cancel();
        }
    }
}

impl Drop for Outbox {
    fn drop(&mut self) {
        self.cut.cancel();
    }
}

/// How long a backplane may say nothing. Before its first such word it may be silent for ever.
#[derive(Debug)]
pub struct Silence<M> {
    /// The words after which it must go on.
    pub after: fn(&M) -> bool,
    /// How long until it is thought cut off.
    pub limit: Duration,
}

/// Keeps the link that `greet` opens, until nobody takes `facts`. At most `room` messages may wait for the backplane.
pub async fn keep<M, F>(
    index: usize,
    mut backoff: Backoff,
    room: usize,
    silence: Option<Silence<M>>,
    facts: mpsc::Sender<Kept<M>>,
    greet: impl Fn() -> F,
) where
    M: DeserializeOwned,
    F: Future<Output = Result<Link<Stream>, LinkError>>,
{
    loop {
        let greeted = tokio::time::timeout(GREETING_TIMEOUT, greet()).await;
        let error = match greeted.unwrap_or_else(|_| Err(timed_out())) {
            Ok(opened) => {
                backoff.reset();
                carry(opened, index, room, silence.as_ref(), &facts).await
            }
            Err(error) => error,
        };
        if facts.send(Kept::Down(index, error)).await.is_err() {
            return;
        }
        tokio::time::sleep(backoff.next_wait()).await;
    }
}

fn timed_out() -> LinkError {
    LinkError::Io(io::ErrorKind::TimedOut.into())
}

/// Carries a link to its end; returns why it ended.
async fn carry<M: DeserializeOwned>(
    opened: Link<Stream>,
    index: usize,
    room: usize,
    silence: Option<&Silence<M>>,
    facts: &mpsc::Sender<Kept<M>>,
) -> LinkError {
    let (mut sink, mut source) = opened.split();
    let (queue, mut waiting) = mpsc::channel::<Bytes>(room);
    let cut = CancellationToken::new();
    if facts.send(Kept::Up(index, Outbox { queue, cut: cut.clone() })).await.is_err() {
        return LinkError::Closed;
    }
    let reading = async {
        let mut limit = None;
        loop {
            let silent = async {
                match limit {
                    Some(limit) => tokio::time::sleep(limit).await,
                    None => std::future::pending().await,
                }
            };
            let frame = tokio::select! {
                frame = source.next() => frame,
                () = silent => return timed_out(),
            };
            let decoded = match frame {
                None => return LinkError::Closed,
                Some(Err(error)) => return error.into(),
                Some(Ok(frame)) => codec::decode::<M>(frame.freeze()),
            };
            let (message, payload) = match decoded {
                Err(error) => return error.into(),
                Ok(decoded) => decoded,
            };
            if let Some(silence) = silence.filter(|silence| (silence.after)(&message)) {
                limit = Some(silence.limit);
            }
            if facts.send(Kept::Said(index, Box::new(message), payload)).await.is_err() {
                return LinkError::Closed;
            }
        }
    };
    let writing = async {
        while let Some(message) = waiting.recv().await {
            sink.feed(message).await?;
            // Everything that waits goes out in one flush.
            while let Ok(message) = waiting.try_recv() {
                sink.feed(message).await?;
            }
            sink.flush().await?;
        }
        Ok::<_, io::Error>(())
    };
    tokio::select! {
        error = reading => error,
        written = writing => written.map_or_else(LinkError::Io, |()| LinkError::Closed),
        () = cut.cancelled() => LinkError::Closed,
    }
}
