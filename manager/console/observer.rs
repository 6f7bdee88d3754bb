//! Looks at the rig four times a second and tells all viewers; keeps the last minute for those who come later.

use super::history::{History, Sample};
use super::state::State;
use crate::backplane::desk::{Desk, Silence};
use axum::extract::ws::Utf8Bytes;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::watch;

/// How often it looks: as often as a person can read.
const PERIOD: Duration = Duration::from_millis(250);

/// What viewers are told, as text, which all share; `None` at first.
pub(super) type Told = Option<Utf8Bytes>;

/// See the module's head.
#[derive(Debug)]
pub(super) struct Observer {
    told: watch::Sender<Told>,
    history: Mutex<History>,
}

impl Default for Observer {
    fn default() -> Self {
        Self { told: watch::Sender::new(None), history: Mutex::default() }
    }
}

impl Observer {
    /// Goes on until the rig has ended.
    pub(super) async fn run(&self, desk: &Desk) {
        let mut ticks = tokio::time::interval(PERIOD);
        ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            ticks.tick().await;
            let text = match desk.live().await {
                Ok(live) => {
                    let mut history = self.history.lock().unwrap_or_else(PoisonError::into_inner);
                    let sample = history.on_live(&live);
                    drop(history);
                    // Told to nobody, it needs not be written.
                    (self.told.receiver_count() > 0)
                        .then(|| serde_json::json!({ "state": State::of(&live), "sample": sample }).to_string())
                }
                Err(Silence::Ended) => return,
                Err(stuck) => Some(serde_json::json!({ "silence": stuck.to_string() }).to_string()),
            };
            if let Some(text) = text {
                self.told.send_replace(Some(text.into()));
            }
        }
    }

    /// Hears what is told from now on.
    pub(super) fn subscribe(&self) -> watch::Receiver<Told> {
        self.told.subscribe()
    }

    /// How many do.
    pub(super) fn viewers(&self) -> usize {
        self.told.receiver_count()
    }

    /// The last minute.
    pub(super) fn history(&self) -> Vec<Sample> {
        self.history.lock().unwrap_or_else(PoisonError::into_inner).samples()
    }
}
