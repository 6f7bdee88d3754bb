//! The board in simulated time, for tests of the shell: all links and what is done with them are those of [`super::run`], over whatever network
//! [`Config::trust`] has, and it draws with the same threads; but between the shell and these stands a task that gives them one thing at a time and
//! waits, without letting simulated time pass, until it is done. What drawing took is then made up. So where the runtime's clock and the network are
//! simulated, nothing depends on the machine.

use super::loader::Raw;
use super::painter::{ANSWERS, Painted, Painter, Work};
use super::{Config, WorkerError, paint, serve};
use link::Listener;
use proto::message::{BoardReport, Timeline};
use std::sync::mpsc::{Receiver, TryRecvError};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// How often work is looked for: nothing wakes a task that a thread's queue is for.
const PERIOD: Duration = Duration::from_millis(1);

/// Runs a board until `shutdown`, or until the rig ends when `config.once`. Each frame takes as long as `drawing` says, in simulated time.
///
/// # Errors
/// [`WorkerError`].
pub async fn run(
    config: Config,
    shutdown: CancellationToken,
    drawing: impl FnMut() -> Duration + Send + 'static,
) -> Result<(), WorkerError> {
    let cannot_listen = |error| WorkerError::Listen(config.listen, error);
    let listener = Listener::bind(config.listen, config.trust.clone()).await.map_err(cannot_listen)?;
    let address = listener.local_addr().map_err(cannot_listen)?;
    let painter = in_step(paint(&config)?, drawing);
    serve(config, listener, address, painter, &shutdown).await
}

/// Something that a painter or its loader is asked to do.
enum Asked {
    Work(Work),
    Piece(Raw),
}

/// A painter that has done what it is asked before anybody else goes on.
fn in_step(painter: Painter, drawing: impl FnMut() -> Duration + Send + 'static) -> Painter {
    let (work, asked) = std::sync::mpsc::channel();
    let (pieces, raw) = std::sync::mpsc::channel();
    let (outbox, answers) = mpsc::channel(ANSWERS);
    tokio::spawn(async move {
        // The session has ended if nobody listens.
        let _ = go(painter, asked, raw, outbox, drawing).await;
    });
    Painter { work, pieces, answers, session: 0 }
}

async fn go(
    mut painter: Painter,
    asked: Receiver<Work>,
    raw: Receiver<Raw>,
    outbox: mpsc::Sender<(u64, Painted)>,
    mut drawing: impl FnMut() -> Duration,
) -> Option<()> {
    loop {
        // The painter must have forgotten the last session before it is given pieces of the next.
        let next = match asked.try_recv() {
            Ok(work) => Asked::Work(work),
            Err(TryRecvError::Disconnected) => return None,
            Err(TryRecvError::Empty) => match raw.try_recv() {
                Ok(piece) => Asked::Piece(piece),
                Err(_) => {
                    tokio::time::sleep(PERIOD).await;
                    continue;
                }
            },
        };
        for (session, answer) in do_all(&mut painter, next)? {
            let answer = match answer {
                Painted::Ready { frame, epoch, report, .. } => {
                    let took = drawing();
                    tokio::time::sleep(took).await;
                    Painted::Ready { frame, epoch, report: made_up(report, took), timeline: Timeline::default() }
                }
                other => other,
            };
            outbox.send((session, answer)).await.ok()?;
        }
    }
}

/// The threads' own times are the machine's.
fn made_up(report: BoardReport, took: Duration) -> BoardReport {
    let raster_ns = took.as_nanos() as u64;
    BoardReport { geometry_ns: 0, raster_ns, translucency_ns: 0, resolve_ns: 0, transfer_ns: 0, ..report }
}

/// Has something done; returns once it is, with all answers. `None`: the threads have ended.
fn do_all(painter: &mut Painter, asked: Asked) -> Option<Vec<(u64, Painted)>> {
    // A frame is drawn when nothing else waits, so only its own answer says that it has been; after other work a question says it, which is answered
    // in its turn.
    let (is_frame, is_piece, is_question) = match &asked {
        Asked::Work(work) => {
            (matches!(work, Work::Frame { shares: Some(_), .. }), false, matches!(work, Work::Inventory))
        }
        Asked::Piece(_) => (false, true, false),
    };
    match asked {
        Asked::Work(work) => painter.work.send(work).ok()?,
        Asked::Piece(piece) => painter.pieces.send(piece).ok()?,
    }
    let adds_question = !is_frame && !is_piece && !is_question;
    if adds_question {
        painter.work.send(Work::Inventory).ok()?;
    }
    let mut answers = Vec::new();
    loop {
        let answer = match painter.answers.try_recv() {
            Ok(answer) => answer,
            Err(mpsc::error::TryRecvError::Disconnected) => return None,
            Err(mpsc::error::TryRecvError::Empty) => {
                std::thread::yield_now();
                continue;
            }
        };
        let is_last = match &answer.1 {
            Painted::Ready { .. } => is_frame,
            Painted::Stored { .. } => is_piece,
            Painted::Refused(_) => is_frame || is_piece,
            Painted::Holding { .. } => is_question || adds_question,
            Painted::Loaded(_) => false,
        };
        if !(is_last && adds_question) {
            answers.push(answer);
        }
        if is_last {
            return Some(answers);
        }
    }
}
