//! The links to the backplanes, of which one leads and another may stand by. Each is a task that connects, again and again with a
//! jittered back-off, and only moves messages: what they mean is the session's matter, and whom the board serves is that of `terms`.
//!
//! No link is waited for: one that doesn't take what is said is hung, and cut, so that a backplane that is stopped doesn't hold the other one up.

use super::Config;
use crate::reference_tile;
use ::link::{Expected, NodeRole, Stream};
use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use proto::backoff::Backoff;
use proto::codec;
use proto::limits;
use proto::link::{self, Link, LinkError};
use proto::message::{Hello, Role, ToBoard};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// Messages of backplanes that may wait for the session. Beyond, TCP holds them back.
const FACTS: usize = 64;
/// Messages that may wait for one backplane. What a board holds is told in thousands at most, of many names each.
const OUTBOX: usize = 2048;
const GREETING_TIMEOUT: Duration = Duration::from_secs(5);
/// A backplane that beats, and then says nothing for so long, is cut off: it has put us out by now, and its word of that is lost. Longer than a
/// busy machine keeps a process waiting.
const BACKPLANE_SILENCE: Duration = Duration::from_secs(2);

/// What happened on a link to a backplane; which one is its place in [`Config::backplanes`].
#[derive(Debug)]
pub(super) enum BackplaneEvent {
    /// It is up, and we have said hello.
    Up(usize, Outbox),
    /// The backplane said something.
    Said(usize, Box<ToBoard>, Bytes),
    /// The link is down, or couldn't be made.
    Down(usize, LinkError),
}

/// The session's end of a link.
#[derive(Debug)]
pub(super) struct Outbox {
    queue: mpsc::Sender<Bytes>,
    cut: CancellationToken,
}

impl Outbox {
    /// Queues a message; cuts the link if there is no room.
    pub(super) fn send(&self, message: Bytes) {
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

/// Links to all backplanes, kept as long as the runtime lives.
#[derive(Debug)]
pub(super) struct Backplanes(mpsc::Receiver<BackplaneEvent>);

impl Backplanes {
    /// Connects to those that `config` names. `listening` is where neighbours reach us.
    pub(super) fn keep(config: &Arc<Config>, listening: SocketAddr) -> Self {
        let (facts, inbox) = mpsc::channel(FACTS);
        for index in 0..config.backplanes.len() {
            tokio::spawn(keep(config.clone(), index, listening, facts.clone()));
        }
        Self(inbox)
    }

    /// The next fact. Cancel-safe.
    pub(super) async fn next(&mut self) -> BackplaneEvent {
        match self.0.recv().await {
            Some(event) => event,
            // Tasks end with the runtime only.
            None => std::future::pending().await,
        }
    }
}

async fn keep(config: Arc<Config>, index: usize, listening: SocketAddr, facts: mpsc::Sender<BackplaneEvent>) {
    let mut backoff = Backoff::new(u64::from(std::process::id()) ^ (index as u64) << 32);
    loop {
        let opened = tokio::time::timeout(GREETING_TIMEOUT, open(&config, index, listening)).await;
        let error = match opened.unwrap_or_else(|_| Err(timed_out())) {
            Ok(opened) => {
                backoff.reset();
                carry(opened, index, &facts).await
            }
            Err(error) => error,
        };
        if facts.send(BackplaneEvent::Down(index, error)).await.is_err() {
            return;
        }
        tokio::time::sleep(backoff.next_wait()).await;
    }
}

fn timed_out() -> LinkError {
    LinkError::Io(io::ErrorKind::TimedOut.into())
}

/// Connects and says hello.
async fn open(config: &Config, index: usize, listening: SocketAddr) -> Result<Link<Stream>, LinkError> {
    // Each time: a board that has run for a year is no better than its memory is today. And first, for who listens waits for nobody.
    let simd = config.simd;
    let drawn = tokio::task::spawn_blocking(move || reference_tile::draw(simd)).await.map_err(io::Error::other)?;
    let drawn = drawn.map_err(|error| io::Error::other(format!("the reference tile can't be drawn: {error}")))?;
    let stream = config.trust.connect(&config.backplanes[index], &Expected::any(NodeRole::Manager)).await?;
    // Listening on any address, we are reached at the one that reaches the backplane.
    let ip = if listening.ip().is_unspecified() { stream.local_addr()?.ip() } else { listening.ip() };
    let link = config.advertise.clone().unwrap_or_else(|| SocketAddr::new(ip, listening.port()).to_string());
    let mut backplane = link::open(stream, limits::BULK_MESSAGE_MAX).await?;
    let role = Role::Board { threads: config.threads.get() as u32, link, memory: config.memory, drawn };
    link::send(&mut backplane, &Hello { name: config.name.clone(), role }, &[]).await?;
    Ok(backplane)
}

/// Carries a link to its end; returns why it ended.
async fn carry(opened: Link<Stream>, index: usize, facts: &mpsc::Sender<BackplaneEvent>) -> LinkError {
    let (mut sink, mut source) = opened.split();
    let (queue, mut waiting) = mpsc::channel::<Bytes>(OUTBOX);
    let cut = CancellationToken::new();
    let outbox = Outbox { queue, cut: cut.clone() };
    if facts.send(BackplaneEvent::Up(index, outbox)).await.is_err() {
        return LinkError::Closed;
    }
    let reading = async {
        // Before it beats it may have nothing to say.
        let mut beats = false;
        loop {
            let silence = async {
                if beats { tokio::time::sleep(BACKPLANE_SILENCE).await } else { std::future::pending().await }
            };
            let frame = tokio::select! {
                frame = source.next() => frame,
                () = silence => return timed_out(),
            };
            let decoded = match frame {
                None => return LinkError::Closed,
                Some(Err(error)) => return error.into(),
                Some(Ok(frame)) => codec::decode::<ToBoard>(frame.freeze()),
            };
            match decoded {
                Err(error) => return error.into(),
                Ok((message, payload)) => {
                    beats |= message == ToBoard::Alive;
                    if facts.send(BackplaneEvent::Said(index, Box::new(message), payload)).await.is_err() {
                        return LinkError::Closed;
                    }
                }
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
