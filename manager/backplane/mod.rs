//! The backplane: the tokio shell that ties scene, host and boards together.
//!
//! [`run`] starts it. One thread, the engine, owns all state: the chain's cores, the scene's selection and the
//! statistics; everything else moves bytes between sockets and the engine's queue. So there are no locks, and one
//! place where a frame is made.
//!
//! | module | what |
//! |---|---|
//! | `links` | sockets of boards, compositors and the other backplane |
//! | `engine` | the loop: facts in, frames and swaps out |
//! | `director` | what a frame shows: poses, views, selection |
//! | `lists` | list scripts from revision to revision |
//! | `changes` | likewise for moved objects and weights |
//! | `residency` | what each board holds, is sent and gives up |
//! | `stream` | feeds residency with what is seen and foreseen |
//! | `calm` | whether a frame would show anything new |
//! | `content` | the scene as payloads |
//! | `statistics` | counts and times |
//! | `trace` | what the last frames did, and when |
//! | `spans` | the same as spans, for traces |
//! | `live` | what the console is told, and may ask for |
//! | `desk` | where the console asks; itself it is the room beside this one |
//! | `simulation` | all of it in simulated time, for tests |
//! | `token` | what somebody must know to change anything there |

mod ahead;
mod calm;
mod changes;
mod content;
#[cfg(feature = "console")]
pub(crate) mod desk;
mod director;
mod engine;
mod genlock;
mod links;
mod lists;
pub(crate) mod live;
mod residency;
pub mod simulation;
#[cfg(feature = "console")]
pub(crate) mod spans;
pub(crate) mod statistics;
mod stream;
mod token;
pub(crate) mod trace;

pub use ahead::SelectAhead;
pub use director::{DefaultRow, Stage};
pub use statistics::{
    BoardMemory, Dropped, EventEntry, LinkBytes, Report, Skipped, StageTimes, Streaming, TimeSummary,
};
pub use token::{Token, TokenError};

use crate::host::native::SequenceFilter;
use content::Content;
use engine::{Answers, Engine, Event};
use link::{Listener, Trust};
use links::Traffic;
use proto::chain::ClockMode;
use proto::pose::PosePacket;
use proto::time::Time;
use residency::Catalogue;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::mpsc::SyncSender;
use std::time::Duration;
use thiserror::Error;
use tokio::net::{TcpListener, UdpSocket};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

/// Facts that may wait for the engine. A burst of 256 boards' reports fits many times over.
const ENGINE_QUEUE: usize = 8192;

/// How a manager is set up.
#[derive(Debug)]
pub struct Config {
    /// What is shown.
    pub stage: Stage,
    /// Real time or lock-step.
    pub mode: ClockMode,
    /// End after this many frames.
    pub frames: Option<u64>,
    /// Hold the first frame until this many boards are in the row.
    pub wait_for_boards: usize,
    /// Hold the first frame until a compositor is there.
    pub wait_for_compositor: bool,
    /// When boards can't follow, how many of the picture's pixels, each way, one pixel drawn may stand for: a power of two; 1: resolution stays.
    pub scale_max: u32,
    /// Whether selection goes ahead of the tick, in real time.
    pub select_ahead: SelectAhead,
    /// How long before its moment a swap is said, in real time, where there are several displays: what their links and wake-ups may take.
    pub swap_lead: Duration,
    /// Bytes that each board may use for meshes and textures, however many it has.
    pub board_memory: u64,
    /// How links to boards and compositors are protected.
    pub trust: Trust,
    /// Stand by for the manager whose backplane is at this `host:port`; `None`: lead.
    pub stands_by_for: Option<String>,
    /// Where boards and compositors connect (TCP).
    pub listen: SocketAddr,
    /// Where native pose packets arrive (UDP).
    pub pose_listen: SocketAddr,
    /// Where the console is served (HTTP); `None`: nowhere.
    pub console_listen: Option<SocketAddr>,
    /// What somebody must know to change anything there. `None`: nothing, on this machine; beyond it nobody changes anything.
    pub console_token: Option<Token>,
    /// Where frames are sent as traces (OTLP over HTTP); taken by builds with the feature `otlp` only.
    pub otlp: Option<String>,
    /// Counts frames as they are swapped, for whoever shows progress.
    pub progress: Arc<AtomicU64>,
}

/// Where a running manager can be reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Addresses {
    /// The backplane (TCP).
    pub backplane: SocketAddr,
    /// Native pose packets (UDP).
    pub pose: SocketAddr,
    /// The console (HTTP).
    pub console: Option<SocketAddr>,
}

/// Why a manager can't run.
#[derive(Debug, Error)]
pub enum ManagerError {
    /// A port is taken, or isn't ours to take.
    #[error(
        "cannot listen on {address} for {what}: {error}; end the program that holds it, or choose another with {option}"
    )]
    Listen {
        /// The address.
        address: SocketAddr,
        /// For what.
        what: &'static str,
        /// The option that changes it.
        option: &'static str,
        /// The reason.
        error: std::io::Error,
    },
    /// A mesh or texture can't be had.
    #[error(transparent)]
    Content(#[from] crate::scene::ContentError),
    /// A thread couldn't be started.
    #[error("cannot start the engine: {0}")]
    Thread(std::io::Error),
    /// Traces can't be sent there.
    #[error("--otlp {0}")]
    Otlp(std::io::Error),
    /// The engine panicked: our own mistake.
    #[error("the engine ended unexpectedly; please report this with the log")]
    Engine,
}

/// Runs the manager until `shutdown`, or until its frames are done. `listening` hears the addresses once all are open.
///
/// # Errors
/// [`ManagerError`].
pub async fn run(
    config: Config,
    shutdown: CancellationToken,
    listening: impl FnOnce(Addresses),
) -> Result<Report, ManagerError> {
    let cannot = |address, what, option| move |error| ManagerError::Listen { address, what, option, error };
    let failed = cannot(config.listen, "boards", "--listen");
    let backplane = Listener::bind(config.listen, config.trust.clone()).await.map_err(failed)?;
    let failed = cannot(config.pose_listen, "pose packets", "--pose-listen");
    let poses = Arc::new(UdpSocket::bind(config.pose_listen).await.map_err(failed)?);
    let console = match config.console_listen {
        Some(address) if cfg!(feature = "console") => {
            Some(TcpListener::bind(address).await.map_err(cannot(address, "the console", "--console"))?)
        }
        _ => None,
    };
    let addresses = Addresses {
        backplane: backplane.local_addr().map_err(ManagerError::Thread)?,
        pose: poses.local_addr().map_err(ManagerError::Thread)?,
        console: console.as_ref().and_then(|listener| listener.local_addr().ok()),
    };

    #[cfg(feature = "console")]
    let console_token = config.console_token;
    #[cfg(feature = "otlp")]
    let otlp = config.otlp.clone();
    let content = Arc::new(Content::of(config.stage.scene.clone()));
    let catalogue = Catalogue::of(&config.stage.scene)?;
    let traffic = Arc::new(Traffic::default());
    let (facts, inbox) = std::sync::mpsc::sync_channel(ENGINE_QUEUE);
    let started = Instant::now();
    let dialled = config.stands_by_for.clone().map(|address| (address, config.trust.clone()));
    let outlet = poses.clone();
    let answers: Answers = Box::new(move |answer, to| outlet.try_send_to(answer, to));
    let engine = Engine::new(config, content.clone(), catalogue, answers, traffic.clone(), started);
    let (ended, end) = tokio::sync::oneshot::channel();
    std::thread::Builder::new()
        .name("engine".into())
        // The receiver only goes away when the whole manager is being dropped.
        .spawn(move || {
            // It selects, which takes as long as drawing may.
            pool::turns::go_along();
            drop(ended.send(engine.run(&inbox)));
        })
        .map_err(ManagerError::Thread)?;

    let mut tasks = tokio::task::JoinSet::new();
    let keys = links::first_key(dialled.is_some());
    tasks.spawn(links::listen(backplane, facts.clone(), content.clone(), traffic.clone(), keys));
    if let Some((address, trust)) = dialled {
        tasks.spawn(links::dial(address, trust, facts.clone(), content, traffic));
    }
    tasks.spawn(receive_poses(poses, facts.clone(), started));
    #[cfg(feature = "console")]
    let _console = match console {
        Some(listener) => {
            let desk = desk::Desk::new(facts.clone());
            Some(crate::console::Console::start(listener, console_token, desk).map_err(ManagerError::Thread)?)
        }
        None => None,
    };
    #[cfg(feature = "otlp")]
    if let Some(url) = otlp {
        crate::otlp::start(&url, desk::Desk::new(facts.clone())).map_err(ManagerError::Otlp)?;
    }
    listening(addresses);

    let mut end = std::pin::pin!(end);
    let report = tokio::select! {
        report = &mut end => report,
        () = shutdown.cancelled() => {
            links::post(&facts, Event::Shutdown).await;
            end.await
        }
    };
    // Goodbyes are queued; their writers get a moment to flush them.
    tokio::time::sleep(Duration::from_millis(100)).await;
    tasks.shutdown().await;
    report.map_err(|_| ManagerError::Engine)
}

async fn receive_poses(socket: Arc<UdpSocket>, engine: SyncSender<Event>, started: Instant) {
    let mut filter = SequenceFilter::default();
    let mut datagram = vec![0; 65_536];
    loop {
        let (len, from) = match socket.recv_from(&mut datagram).await {
            Ok(received) => received,
            Err(error) => {
                // A host that is gone comes back as "connection refused" on some systems: no reason to stop listening.
                tracing::debug!(%error, "pose socket");
                continue;
            }
        };
        let now = Time(started.elapsed().as_nanos() as u64);
        let event = match PosePacket::decode(&datagram[..len]) {
            Ok(packet) => {
                let freshness = filter.on_packet(now, from, packet.sequence);
                Event::Pose { packet, from, received: now, freshness }
            }
            Err(error) => {
                tracing::debug!(%from, %error, "pose packet dropped");
                Event::BadPose
            }
        };
        if !links::post(&engine, event).await {
            return;
        }
    }
}
