//! The links to the backplanes, of which one leads and another may stand by: each is a task that connects, again and again with a jittered
//! back-off, and only moves messages.
//!
//! No link is waited for: one that doesn't take what is said is hung, and cut, so that a backplane that is stopped doesn't hold up the other one's
//! pictures.

use crate::shell::Config;
use ::link::{Expected, NodeRole, Stream};
use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use proto::backoff::Backoff;
use proto::codec;
use proto::frame::PixelFormat;
use proto::limits;
use proto::link::{self, Link, LinkError};
use proto::message::{Hello, Role, ToCompositor};
use std::io;
use std::net::SocketAddr;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// Messages of backplanes that may wait for the main task. Beyond, TCP holds them back.
const FACTS: usize = 64;
/// Messages that may wait for one backplane: a word per frame, and seldom a preview.
const OUTBOX: usize = 64;
const GREETING_TIMEOUT: Duration = Duration::from_secs(5);

/// What happened on a link to a backplane; which one is its place in [`Config::backplanes`].
pub(crate) enum BackplaneEvent {
    /// It is up, and we have been taken.
    Up(usize, Outbox),
    /// The backplane said something.
    Said(usize, ToCompositor),
    /// We are not taken, and why.
    Refused(usize, String),
    /// The link is down, or couldn't be made.
    Down(usize, LinkError),
}

/// The main task's end of a link.
pub(crate) struct Outbox {
    queue: mpsc::Sender<Bytes>,
    cut: CancellationToken,
}

impl Outbox {
    /// Queues a message; cuts the link if there is no room.
    pub(crate) fn send(&self, message: Bytes) {
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

/// Keeps links to all backplanes, as long as the runtime lives. `listening` is where boards reach us.
pub(crate) fn keep(config: &Config, listening: SocketAddr, format: PixelFormat) -> mpsc::Receiver<BackplaneEvent> {
    let (facts, inbox) = mpsc::channel(FACTS);
    for index in 0..config.backplanes.len() {
        tokio::spawn(keep_one(config.clone(), index, listening, format, facts.clone()));
    }
    inbox
}

async fn keep_one(
    config: Config,
    index: usize,
    listening: SocketAddr,
    format: PixelFormat,
    facts: mpsc::Sender<BackplaneEvent>,
) {
    let mut backoff = Backoff::new(u64::from(std::process::id()) ^ (index as u64) << 32);
    loop {
        let greeted = tokio::time::timeout(GREETING_TIMEOUT, greet(&config, index, listening, format)).await;
        let error = match greeted.unwrap_or_else(|_| Err(LinkError::Io(io::ErrorKind::TimedOut.into()))) {
            Ok(Ok(opened)) => {
                backoff.reset();
                carry(opened, index, &facts).await
            }
            Ok(Err(reason)) => {
                if facts.send(BackplaneEvent::Refused(index, reason)).await.is_err() {
                    return;
                }
                LinkError::Closed
            }
            Err(error) => error,
        };
        if facts.send(BackplaneEvent::Down(index, error)).await.is_err() {
            return;
        }
        tokio::time::sleep(backoff.next_wait()).await;
    }
}

/// Connects, says hello and hears whether we are taken; if not, why.
async fn greet(
    config: &Config,
    index: usize,
    listening: SocketAddr,
    format: PixelFormat,
) -> Result<Result<Link<Stream>, String>, LinkError> {
    let stream = config.trust.connect(&config.backplanes[index], &Expected::any(NodeRole::Manager)).await?;
    // Listening on any address, we are reached at the one that reaches the backplane.
    let ip = if listening.ip().is_unspecified() { stream.local_addr()?.ip() } else { listening.ip() };
    let listen = SocketAddr::new(ip, listening.port()).to_string();
    let mut backplane = link::open(stream, limits::CONTROL_MESSAGE_MAX).await?;
    let (records, views) = (config.manifest.is_some(), config.views.clone());
    let hello = Hello { name: "compositor".into(), role: Role::Compositor { listen, format, records, views } };
    link::send(&mut backplane, &hello, &[]).await?;
    match link::expect(&mut backplane).await?.0 {
        ToCompositor::Refused { reason } => Ok(Err(reason)),
        _ => Ok(Ok(backplane)),
    }
}

/// Carries a link to its end; returns why it ended.
async fn carry(opened: Link<Stream>, index: usize, facts: &mpsc::Sender<BackplaneEvent>) -> LinkError {
    let (mut sink, mut source) = opened.split();
    let (queue, mut waiting) = mpsc::channel::<Bytes>(OUTBOX);
    let cut = CancellationToken::new();
    if facts.send(BackplaneEvent::Up(index, Outbox { queue, cut: cut.clone() })).await.is_err() {
        return LinkError::Closed;
    }
    let reading = async {
        while let Some(frame) = source.next().await {
            let message = match frame {
                Err(error) => return error.into(),
                Ok(frame) => codec::decode::<ToCompositor>(frame.freeze()),
            };
            match message {
                Err(error) => return error.into(),
                Ok((message, _)) => {
                    if facts.send(BackplaneEvent::Said(index, message)).await.is_err() {
                        break;
                    }
                }
            }
        }
        LinkError::Closed
    };
    let writing = async {
        while let Some(message) = waiting.recv().await {
            sink.send(message).await?;
        }
        Ok::<_, io::Error>(())
    };
    tokio::select! {
        error = reading => error,
        written = writing => written.map_or_else(LinkError::Io, |()| LinkError::Closed),
        () = cut.cancelled() => LinkError::Closed,
    }
}
