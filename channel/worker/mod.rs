//! The board as a daemon: it connects to the backplane, takes its place in the row, and draws what it is told.
//!
//! | thread or task | owns | waits for |
//! |---|---|---|
//! | main task (`session`) | a session with each backplane, whom it serves (`terms`) | messages, neighbours, the painter, shutdown |
//! | backplane tasks (`backplanes`) | the link to a backplane each | its words |
//! | neighbour tasks (`neighbours`) | the listening socket, one link each | a neighbour's words |
//! | outlet tasks (`outlet`) | the link to a compositor each | tiles from the painter |
//! | painter thread (`painter`) | the scene store, the lists (`follow`), the pictures, what compositors have of them (`delivery`) | work, in the order in which it came |
//! | loader thread (`loader`) | the piece that it prepares | pieces of the scene |
//! | renderer threads | their tiles | the painter |
//!
//! Nothing is drawn on tokio's threads. When the backplane is gone the board keeps its scene and its last picture, and knocks
//! again with a jittered back-off; when it is let in, or the stand-by leads, only what it lacks is sent.
//!
//! Shutdown travels as one [`CancellationToken`]: the main task asks to leave, waits for the backplane's goodbye at
//! most 0.7 s, and drops everything else.

mod backplanes;
mod delivery;
mod follow;
mod loader;
mod neighbours;
mod outlet;
mod painter;
mod session;
pub mod simulation;
mod terms;
mod timeline;

use crate::pipeline::Renderer;
use crate::simd::SimdLevel;
use backplanes::Backplanes;
use link::{Listener, Trust};
use neighbours::Neighbours;
use painter::Painter;
use session::Board;
use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;
use thiserror::Error;
use tokio_util::sync::CancellationToken;

/// How long a board that was told to end waits until others draw its share.
const LEAVE_TIMEOUT: Duration = Duration::from_millis(700);

/// How a board is set up.
#[derive(Clone, Debug)]
pub struct Config {
    /// Where the backplanes listen, `host:port` each: one leads, another may stand by.
    pub backplanes: Vec<String>,
    /// How links are protected.
    pub trust: Trust,
    /// Where to listen for the right neighbour; port 0: any free port.
    pub listen: SocketAddr,
    /// Where the right neighbour reaches us, `host:port`, if not at the address that reaches the backplane.
    pub advertise: Option<String>,
    /// Threads to draw with.
    pub threads: NonZeroUsize,
    /// Instruction set to draw with.
    pub simd: SimdLevel,
    /// What meshes and textures may count for, bytes ([`proto::piece`]).
    pub memory: u64,
    /// A name for people.
    pub name: String,
    /// End when the rig ends, instead of waiting for the next one.
    pub once: bool,
}

/// Why a board ends.
#[derive(Debug, Error)]
pub enum WorkerError {
    /// The listening socket.
    #[error("cannot listen on {0}: {1}; choose another with --listen")]
    Listen(SocketAddr, std::io::Error),
    /// The backplane doesn't want us.
    #[error("the backplane at {0} refused this board: {1}")]
    Refused(String, String),
    /// The renderer's or painter's threads couldn't be started.
    #[error("cannot start drawing threads: {0}")]
    Threads(String),
    /// The painter ended: our own mistake.
    #[error("the painter thread ended unexpectedly; please report this with the log")]
    Painter,
}

/// Runs until `shutdown`, or until the rig ends when `config.once`. `listening` hears the neighbours' address.
///
/// # Errors
/// [`WorkerError`].
pub async fn run(
    config: Config,
    shutdown: CancellationToken,
    listening: impl FnOnce(SocketAddr),
) -> Result<(), WorkerError> {
    let cannot_listen = |error| WorkerError::Listen(config.listen, error);
    let listener = Listener::bind(config.listen, config.trust.clone()).await.map_err(cannot_listen)?;
    let address = listener.local_addr().map_err(cannot_listen)?;
    let painter = paint(&config)?;
    listening(address);
    serve(config, listener, address, painter, &shutdown).await
}

/// Starts the threads that draw.
fn paint(config: &Config) -> Result<Painter, WorkerError> {
    let mut renderer = Renderer::new(config.threads).map_err(|error| WorkerError::Threads(error.to_string()))?;
    renderer.set_simd(config.simd);
    Painter::start(renderer, config.memory).map_err(|error| WorkerError::Threads(error.to_string()))
}

/// Carries all links, until `shutdown` or the rig's end. `address` is where `listener` listens.
async fn serve(
    config: Config,
    listener: Listener,
    address: SocketAddr,
    painter: Painter,
    shutdown: &CancellationToken,
) -> Result<(), WorkerError> {
    let neighbours = Neighbours::listen(listener, config.trust.clone());
    let config = Arc::new(config);
    let backplanes = Backplanes::keep(&config, address);
    Board::new(config, painter, neighbours).run(backplanes, shutdown).await
}
