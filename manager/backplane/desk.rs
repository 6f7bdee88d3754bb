//! Where the console asks the engine. Questions go into the engine's queue like everything else; it answers in its turn, and never waits.

use super::engine::Event;
use super::links::post;
use super::live::{Command, CommandError, Live};
use super::statistics::Report;
use super::trace::FrameTrace;
use bytes::Bytes;
use proto::ids::FrameNumber;
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};
use tokio::sync::{Mutex, oneshot};

/// An engine that hasn't answered by then stands still, or its machine does.
const PATIENCE: Duration = Duration::from_secs(3);
/// How old the answer to [`Desk::live`] may be: however many ask, the engine is asked this often.
const FRESH: Duration = Duration::from_millis(100);

/// Why there is no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Silence {
    #[error("the rig has ended")]
    Ended,
    #[error("the engine has not answered for {} s", PATIENCE.as_secs())]
    Stuck,
}

/// See the module's head.
#[derive(Debug)]
pub(crate) struct Desk {
    engine: SyncSender<Event>,
    live: Mutex<Option<(Instant, Arc<Live>)>>,
}

impl Desk {
    pub(crate) fn new(engine: SyncSender<Event>) -> Self {
        Self { engine, live: Mutex::new(None) }
    }

    /// How the rig is, or was a tenth of a second ago.
    pub(crate) async fn live(&self) -> Result<Arc<Live>, Silence> {
        // Those who come while one asks wait for his answer.
        let mut last = self.live.lock().await;
        if let Some((_, live)) = last.as_ref().filter(|(at, _)| at.elapsed() < FRESH) {
            return Ok(Arc::clone(live));
        }
        let live = Arc::new(self.ask(Event::Live).await?);
        *last = Some((Instant::now(), Arc::clone(&live)));
        Ok(live)
    }

    /// The statistics, of this moment: clocks are compared by them.
    pub(crate) async fn report(&self) -> Result<Report, Silence> {
        self.ask(Event::Report).await
    }

    /// The newest picture that was made; asking has another made, with the next frame.
    pub(crate) async fn picture(&self) -> Result<Option<(FrameNumber, Bytes)>, Silence> {
        self.ask(Event::Picture).await
    }

    /// The last frames, the oldest first.
    pub(crate) async fn traces(&self) -> Result<Vec<Arc<FrameTrace>>, Silence> {
        self.ask(Event::Traces).await
    }

    /// Has something done.
    pub(crate) async fn command(
        &self,
        command: Command,
        from: String,
    ) -> Result<Result<String, CommandError>, Silence> {
        self.ask(|answer| Event::Command { command, from, answer }).await
    }

    async fn ask<T>(&self, question: impl FnOnce(oneshot::Sender<T>) -> Event) -> Result<T, Silence> {
        let (answer, answered) = oneshot::channel();
        let asking = async {
            if !post(&self.engine, question(answer)).await {
                return Err(Silence::Ended);
            }
            answered.await.map_err(|_| Silence::Ended)
        };
        tokio::time::timeout(PATIENCE, asking).await.unwrap_or(Err(Silence::Stuck))
    }
}
