//! The links to the backplanes, of which one leads and another may stand by: each is a task that only moves messages ([`::link::keep`]).

use crate::shell::Config;
use ::link::{Expected, Kept, NodeRole, Stream};
use bytes::Bytes;
use proto::frame::PixelFormat;
use proto::limits;
use proto::link::{self, Link, LinkError};
use proto::message::{Hello, Role, ToCompositor};
use std::net::SocketAddr;
use tokio::sync::mpsc;

/// Messages of backplanes that may wait for the main task. Beyond, TCP holds them back.
const FACTS: usize = 64;
/// Messages that may wait for one backplane: a word per frame, and seldom a preview.
const OUTBOX: usize = 64;

/// What happened on a link to a backplane; which one is its place in [`Config::backplanes`]. One that doesn't take us says so before its link is up.
pub(crate) type BackplaneEvent = Kept<ToCompositor>;

/// Keeps links to all backplanes, as long as the runtime lives. `listening` is where boards reach us.
pub(crate) fn keep(config: &Config, listening: SocketAddr, format: PixelFormat) -> mpsc::Receiver<BackplaneEvent> {
    let (facts, inbox) = mpsc::channel(FACTS);
    for index in 0..config.backplanes.len() {
        let (config, facts) = (config.clone(), facts.clone());
        tokio::spawn(async move {
            let backoff = config.trust.backoff((index as u64) << 32);
            let greet = || greet(&config, index, listening, format, &facts);
            ::link::keep(index, backoff, OUTBOX, None, facts.clone(), greet).await;
        });
    }
    inbox
}

/// Connects, says hello and hears whether we are taken.
async fn greet(
    config: &Config,
    index: usize,
    listening: SocketAddr,
    format: PixelFormat,
    facts: &mpsc::Sender<BackplaneEvent>,
) -> Result<Link<Stream>, LinkError> {
    let stream = config.trust.connect(&config.backplanes[index], &Expected::any(NodeRole::Manager)).await?;
    // Listening on any address, we are reached at the one that reaches the backplane.
    let ip = if listening.ip().is_unspecified() { stream.local_addr()?.ip() } else { listening.ip() };
    let listen = SocketAddr::new(ip, listening.port()).to_string();
    let mut backplane = link::open(stream, limits::CONTROL_MESSAGE_MAX).await?;
    let (records, views) = (config.manifest.is_some(), config.views.clone());
    let hello = Hello { name: "compositor".into(), role: Role::Compositor { listen, format, records, views } };
    link::send(&mut backplane, &hello, &[]).await?;
    match link::expect(&mut backplane).await?.0 {
        refused @ ToCompositor::Refused { .. } => {
            // The daemon has ended if nobody listens.
            let _ = facts.send(Kept::Said(index, Box::new(refused), Bytes::new())).await;
            Err(LinkError::Closed)
        }
        _ => Ok(backplane),
    }
}
