//! The manager in simulated time, for tests of the shell: links, gates, queues and time-outs are those of [`super::run`], over whatever network
//! [`Config::trust`] has; the engine is the same too, but turned by a task on the runtime's clock. So where that clock and the network are
//! simulated, nothing depends on the machine.
//!
//! There is no console, and the host is a function: what comes from outside the rig has no simulated sockets.

use super::content::Content;
use super::engine::{Engine, Event};
use super::links::{self, Traffic};
use super::residency::Catalogue;
use super::{Config, ManagerError, Report};
use crate::host::native::Freshness;
use link::Listener;
use proto::pose::PosePacket;
use proto::time::Time;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::Instant;

/// How often the host speaks.
const HOST_PERIOD: Duration = Duration::from_millis(16);
/// Facts that may wait for the engine.
const ENGINE_QUEUE: usize = 8192;

/// Runs a manager until its frames are done, or for ever. `host` says the pose of a number, one after the other; `look` hears how the rig is.
///
/// # Errors
/// [`ManagerError`].
pub async fn run(
    config: Config,
    mut host: impl FnMut(u32) -> PosePacket + Send + 'static,
    look: impl FnMut(Report) + Send,
) -> Result<Report, ManagerError> {
    let (address, what, option) = (config.listen, "boards", "--listen");
    let cannot = |error| ManagerError::Listen { address, what, option, error };
    let listener = Listener::bind(config.listen, config.trust.clone()).await.map_err(cannot)?;
    let content = Arc::new(Content::of(config.stage.scene.clone()));
    let catalogue = Catalogue::of(&config.stage.scene)?;
    let traffic = Arc::new(Traffic::default());
    let (facts, inbox) = std::sync::mpsc::sync_channel(ENGINE_QUEUE);
    let started = Instant::now();
    let dialled = config.stands_by_for.clone().map(|address| (address, config.trust.clone()));
    let nobody = Box::new(|answer: &[u8], _| Ok(answer.len()));
    let engine = Engine::new(config, content.clone(), catalogue, nobody, traffic.clone(), started);

    let mut tasks = tokio::task::JoinSet::new();
    let first_key = links::first_key(dialled.is_some());
    tasks.spawn(links::listen(listener, facts.clone(), content.clone(), traffic.clone(), first_key));
    if let Some((address, trust)) = dialled {
        tasks.spawn(links::dial(address, trust, facts.clone(), content, traffic));
    }
    tasks.spawn(async move {
        let from = SocketAddr::from((Ipv4Addr::LOCALHOST, 1));
        for sequence in 0.. {
            let received = Time(started.elapsed().as_nanos() as u64);
            let event = Event::Pose { packet: host(sequence), from, received, freshness: Freshness::New };
            if !links::post(&facts, event).await {
                return;
            }
            tokio::time::sleep(HOST_PERIOD).await;
        }
    });
    let report = engine.run_in_task(inbox, look).await;
    tasks.shutdown().await;
    Ok(report)
}
