//! The links to the backplanes, of which one leads and another may stand by: each is a task that only moves messages ([`::link::keep`]). What they
//! mean is the session's matter, and whom the board serves is that of `terms`.

use super::Config;
use crate::reference_tile;
use ::link::{Expected, Kept, NodeRole, Silence, Stream};
use proto::limits;
use proto::link::{self, Link, LinkError};
use proto::message::{Hello, Role, ToBoard};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc;

/// Messages of backplanes that may wait for the session. Beyond, TCP holds them back.
const FACTS: usize = 64;
/// Messages that may wait for one backplane. What a board holds is told in thousands at most, of many names each.
const OUTBOX: usize = 2048;
/// A backplane that beats, and then says nothing for so long, is cut off: it has put us out by now, and its word of that is lost. Longer than a
/// busy machine keeps a process waiting.
const BACKPLANE_SILENCE: Duration = Duration::from_secs(2);

/// What happened on a link to a backplane; which one is its place in [`Config::backplanes`].
pub(super) type BackplaneEvent = Kept<ToBoard>;

/// Links to all backplanes, kept as long as the runtime lives.
#[derive(Debug)]
pub(super) struct Backplanes(mpsc::Receiver<BackplaneEvent>);

impl Backplanes {
    /// Connects to those that `config` names. `listening` is where neighbours reach us.
    pub(super) fn keep(config: &Arc<Config>, listening: SocketAddr) -> Self {
        let (facts, inbox) = mpsc::channel(FACTS);
        for index in 0..config.backplanes.len() {
            let (config, facts) = (config.clone(), facts.clone());
            let silence = Silence { after: |message| *message == ToBoard::Alive, limit: BACKPLANE_SILENCE };
            tokio::spawn(async move {
                let backoff = config.trust.backoff((index as u64) << 32);
                ::link::keep(index, backoff, OUTBOX, Some(silence), facts, || open(&config, index, listening)).await;
            });
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

/// Connects and says hello.
async fn open(config: &Config, index: usize, listening: SocketAddr) -> Result<Link<Stream>, LinkError> {
    // Each time: a board that has run for a year is no better than its memory is today. And first, for who listens waits for nobody.
    let simd = config.simd;
    let drawn = tokio::task::spawn_blocking(move || reference_tile::draw(simd)).await.map_err(std::io::Error::other)?;
    let drawn = drawn.map_err(|error| std::io::Error::other(format!("the reference tile can't be drawn: {error}")))?;
    let stream = config.trust.connect(&config.backplanes[index], &Expected::any(NodeRole::Manager)).await?;
    // Listening on any address, we are reached at the one that reaches the backplane.
    let ip = if listening.ip().is_unspecified() { stream.local_addr()?.ip() } else { listening.ip() };
    let link = config.advertise.clone().unwrap_or_else(|| SocketAddr::new(ip, listening.port()).to_string());
    let mut backplane = link::open(stream, limits::BULK_MESSAGE_MAX).await?;
    let role = Role::Board { threads: config.threads.get() as u32, link, memory: config.memory, drawn };
    link::send(&mut backplane, &Hello { name: config.name.clone(), role }, &[]).await?;
    Ok(backplane)
}
