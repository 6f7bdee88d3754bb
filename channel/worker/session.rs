//! What the backplanes say, and what is done for the one that is served.
//!
//! There is a session for each backplane that is there: it is beaten to, and asked and answered. Only the session that is served ([`Terms`])
//! has a wiring, neighbours, links to the compositors and work for the painter; when another begins to be served, all that is dropped, but
//! neither the scene nor the last picture. A backplane hears what the board holds when it begins to be served, or when nobody is.

mod service;

use super::backplanes::{BackplaneEvent, Backplanes};
use super::neighbours::Neighbours;
use super::painter::{Painter, Work};
use super::terms::{Heed, Terms};
use super::{Config, LEAVE_TIMEOUT, WorkerError, outlet};
use ::link::Outbox;
use bytes::Bytes;
use proto::chain::{Answer, BoardChain, BoardOutput, ToBoardChain};
use proto::codec::{self, CodecError, encode};
use proto::ids::{BoardKey, Term};
use proto::limits;
use proto::link::LinkError;
use proto::message::{FromBoard, TileSink, ToBoard};
use proto::time::Time;
use service::Service;
use std::sync::Arc;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

/// Why no more of a session is followed.
enum Stop {
    /// The link is dropped, and made again.
    Link(LinkError),
    /// The board ends.
    End(Result<(), WorkerError>),
}

impl From<CodecError> for Stop {
    fn from(error: CodecError) -> Self {
        Self::Link(error.into())
    }
}

/// Whether a backplane knows what the board holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    No,
    /// The painter has been asked.
    Asked,
    /// When the board served this term.
    Yes(Term),
}

struct Session {
    outbox: Outbox,
    /// What the backplane calls us, once it has welcomed us.
    key: Option<BoardKey>,
    chain: BoardChain,
    /// Who is to the left under the newest wiring.
    left: Option<BoardKey>,
    /// Whom tiles go to.
    compositors: Vec<TileSink>,
    told: Told,
}

/// The board's main task.
pub(super) struct Board {
    config: Arc<Config>,
    started: Instant,
    sessions: Vec<Option<Session>>,
    /// Links that we have closed, and whose end is no news.
    closed: Vec<bool>,
    terms: Terms,
    service: Service,
    painter: Painter,
    neighbours: Neighbours,
}

impl Board {
    /// A board without links.
    pub(super) fn new(config: Arc<Config>, painter: Painter, neighbours: Neighbours) -> Self {
        let backplanes = config.backplanes.len();
        Self {
            config,
            started: Instant::now(),
            sessions: (0..backplanes).map(|_| None).collect(),
            closed: vec![false; backplanes],
            terms: Terms::new(backplanes),
            service: Service::default(),
            painter,
            neighbours,
        }
    }

    /// Serves until `shutdown`, or until the rig ends when that is to be the end.
    pub(super) async fn run(
        mut self,
        mut backplanes: Backplanes,
        shutdown: &CancellationToken,
    ) -> Result<(), WorkerError> {
        let mut leaving = None;
        loop {
            let due = self.next_beat().map(|at| at.since(self.now()));
            let beat = async {
                match due {
                    Some(wait) => tokio::time::sleep(wait).await,
                    None => std::future::pending().await,
                }
            };
            let deadline = async {
                match leaving {
                    Some(at) => tokio::time::sleep_until(at).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                event = backplanes.next() => {
                    let result = self.on_event(event);
                    let is_released = leaving.is_some() && self.terms.served().is_none();
                    match result {
                        Err(_) if leaving.is_some() => return Ok(()),
                        Err(end) => return end,
                        Ok(()) if is_released => return Ok(()),
                        Ok(()) => {}
                    }
                }
                event = self.neighbours.next() => self.on_neighbour(event),
                painted = self.painter.painted() => {
                    let Some(painted) = painted else { return Err(WorkerError::Painter) };
                    self.on_painted(painted);
                }
                () = shutdown.cancelled(), if leaving.is_none() => {
                    if self.sessions.iter().all(Option::is_none) {
                        return Ok(());
                    }
                    leaving = Some(Instant::now() + LEAVE_TIMEOUT);
                    for index in 0..self.sessions.len() {
                        self.say(index, &FromBoard::Leave, &[]);
                    }
                }
                () = deadline => return Ok(()),
                () = beat => {}
            }
            self.drain();
        }
    }

    fn now(&self) -> Time {
        Time(self.started.elapsed().as_nanos() as u64)
    }

    fn next_beat(&self) -> Option<Time> {
        let welcomed = self.sessions.iter().flatten().filter(|session| session.key.is_some());
        welcomed.map(|session| session.chain.next_timeout()).min()
    }

    fn say(&mut self, index: usize, message: &FromBoard, payload: &[u8]) {
        let now = self.now();
        if let Some(session) = &mut self.sessions[index] {
            session.chain.on_sent(now);
            session.outbox.send(encode(message, payload));
        }
    }

    /// Says something to the backplane that is served.
    fn report(&mut self, message: &FromBoard, payload: &[u8]) {
        if let Some(index) = self.terms.served() {
            self.say(index, message, payload);
        }
    }

    fn on_event(&mut self, event: BackplaneEvent) -> Result<(), Result<(), WorkerError>> {
        match event {
            BackplaneEvent::Up(index, outbox) => {
                self.closed[index] = false;
                let (chain, told) = (BoardChain::new(BoardKey(0)), Told::No);
                let compositors = Vec::new();
                self.sessions[index] = Some(Session { outbox, key: None, chain, left: None, compositors, told });
            }
            BackplaneEvent::Said(index, message, payload) if self.sessions[index].is_some() => {
                match self.on_message(index, *message, payload) {
                    Ok(()) => {}
                    Err(Stop::End(end)) => return Err(end),
                    Err(Stop::Link(error)) => self.close(index, &error),
                }
            }
            // Of a link that we have closed.
            BackplaneEvent::Said(..) => {}
            BackplaneEvent::Down(index, error) => {
                if !std::mem::take(&mut self.closed[index]) {
                    self.log_down(index, &error);
                }
                self.lose(index);
            }
        }
        Ok(())
    }

    fn log_down(&self, index: usize, error: &LinkError) {
        tracing::info!(backplane = %self.config.backplanes[index], %error, "no backplane; trying again");
    }

    /// Closes a link for that reason; it is made again.
    fn close(&mut self, index: usize, error: &LinkError) {
        self.log_down(index, error);
        self.closed[index] = true;
        self.lose(index);
    }

    fn lose(&mut self, index: usize) {
        self.sessions[index] = None;
        if self.terms.on_lost(index) {
            self.end_service();
        }
        if self.terms.served().is_none() {
            // Whoever leads next, or only waits to, may know already.
            self.tell();
        }
    }

    /// From now on nothing is done for who was served.
    fn end_service(&mut self) {
        self.neighbours.close_all();
        // The painter forgets the outlets with the session.
        self.service = Service::default();
        self.painter.forget_session();
        // The answer would be of a session that is over.
        for session in self.sessions.iter_mut().flatten().filter(|session| session.told == Told::Asked) {
            session.told = Told::No;
        }
    }

    /// A backplane is served that wasn't.
    fn begin_service(&mut self, index: usize) {
        let (backplane, term) = (&self.config.backplanes[index], self.terms.term());
        tracing::info!(%backplane, %term, "serving");
        self.end_service();
        for (other, session) in self.sessions.iter_mut().enumerate() {
            let Some(session) = session else { continue };
            if other != index || session.told != Told::Yes(term) {
                session.told = Told::No;
            }
            if other == index {
                session.chain = BoardChain::new(session.key.unwrap_or(BoardKey(0)));
                session.left = None;
            }
        }
        for other in (0..self.sessions.len()).filter(|other| *other != index && term > Term(0)) {
            // Who has led until now needn't find out by itself.
            self.say(other, &FromBoard::Answer(Answer::Refused { term }), &[]);
        }
        self.tell();
        self.open_outlets(index);
    }

    /// Has the painter say what the board holds, if somebody should know it and doesn't.
    fn tell(&mut self) {
        let served = self.terms.served();
        let mut is_asked = false;
        for (index, session) in self.sessions.iter_mut().enumerate() {
            let Some(session) = session else { continue };
            let should_know = session.key.is_some() && served.is_none_or(|served| served == index);
            if should_know && session.told == Told::No {
                session.told = Told::Asked;
                is_asked = true;
            }
        }
        if is_asked {
            self.painter.send(Work::Inventory);
        }
    }

    /// Keeps links to the compositors that there are, and to no others.
    fn open_outlets(&mut self, index: usize) {
        let Some(Session { key: Some(key), compositors, .. }) = &self.sessions[index] else { return };
        let gone: Vec<_> = self
            .service
            .outlets
            .keys()
            .filter(|key| compositors.iter().all(|sink| sink.key != **key))
            .copied()
            .collect();
        for key in gone {
            self.service.outlets.remove(&key);
            self.painter.send(Work::OutletDown(key));
        }
        for sink in compositors {
            self.service
                .outlets
                .entry(sink.key)
                .or_insert_with(|| outlet::keep(sink.clone(), *key, self.painter.work(), self.config.trust.clone()));
        }
    }

    /// Whether a word is to be followed that only who leads says.
    fn heeds(&mut self, index: usize, heed: Heed) -> bool {
        if heed == Heed::Begin {
            self.begin_service(index);
        }
        heed != Heed::Ignore
    }

    fn on_message(&mut self, index: usize, message: ToBoard, payload: Bytes) -> Result<(), Stop> {
        let now = self.now();
        match message {
            ToBoard::Welcome { key } => self.on_welcome(index, key),
            ToBoard::Refused { reason } => return Err(self.on_refused(index, reason)),
            ToBoard::Goodbye => return Err(self.on_goodbye(index)),
            ToBoard::Compositors(sinks) => {
                codec::within("compositors", sinks.len() as u64, limits::COMPOSITORS_MAX)?;
                if let Some(session) = &mut self.sessions[index] {
                    session.compositors = sinks;
                }
                if self.terms.served() == Some(index) {
                    self.open_outlets(index);
                }
            }
            ToBoard::Alive => self.terms.on_alive(now, index),
            ToBoard::Ask(ask) => {
                let (answer, begins) = self.terms.on_ask(now, index, ask);
                self.say(index, &FromBoard::Answer(answer), &[]);
                if begins {
                    self.begin_service(index);
                }
            }
            ToBoard::Chain(message) => {
                if let ToBoardChain::Wire { epoch, .. } = &message {
                    let placed = self.sessions[index].as_ref().and_then(|session| session.chain.placed());
                    self.terms.on_wired(index, epoch.term(), placed);
                }
                let heed = self.terms.on_leader(now, index, message.epoch().term());
                if self.heeds(index, heed) {
                    self.on_chain(index, message);
                } else {
                    let term = self.terms.term();
                    self.say(index, &FromBoard::Answer(Answer::Refused { term }), &[]);
                }
            }
            ToBoard::Frame(header) => {
                // A frame builds on what came before it, so it is never a leader's first word.
                if self.terms.on_leader(now, index, header.state.epoch.term()) == Heed::Follow {
                    self.on_frame(index, header, payload)?;
                }
            }
            ToBoard::Piece(_) | ToBoard::Evict | ToBoard::Table { .. } | ToBoard::Neighbours(_) => {
                let heed = self.terms.on_word(now, index);
                if self.heeds(index, heed) {
                    self.on_content(message, payload)?;
                }
            }
        }
        Ok(())
    }

    fn on_welcome(&mut self, index: usize, key: BoardKey) {
        tracing::info!(%key, backplane = %self.config.backplanes[index], "connected");
        if let Some(session) = &mut self.sessions[index] {
            session.key = Some(key);
            session.chain = BoardChain::new(key);
        }
        if let Some(term) = self.terms.remembered() {
            // One that was started anew must not lead as if there had been nothing.
            self.say(index, &FromBoard::Answer(Answer::Refused { term }), &[]);
        }
        self.tell();
    }

    fn on_refused(&mut self, index: usize, reason: String) -> Stop {
        let backplane = self.config.backplanes[index].clone();
        if self.sessions.len() == 1 {
            return Stop::End(Err(WorkerError::Refused(backplane, reason)));
        }
        tracing::warn!(%backplane, %reason, "refused by one of the backplanes");
        Stop::Link(LinkError::Closed)
    }

    fn on_goodbye(&mut self, index: usize) -> Stop {
        if self.sessions.len() == 1 && self.config.once {
            return Stop::End(Ok(()));
        }
        let backplane = &self.config.backplanes[index];
        if self.sessions.len() == 1 {
            tracing::info!(%backplane, "the rig has ended; waiting for the next");
        } else {
            tracing::info!(%backplane, "this backplane has ended; waiting for it, or the other one");
        }
        Stop::Link(LinkError::Closed)
    }

    fn drain(&mut self) {
        let now = self.now();
        for index in 0..self.sessions.len() {
            let is_served = self.terms.served() == Some(index);
            if let Some(session) = self.sessions[index].as_mut().filter(|session| session.key.is_some()) {
                session.chain.on_timeout(now);
            }
            while let Some(session) = &mut self.sessions[index]
                && let Some(output) = session.chain.poll_output()
            {
                let left = session.left;
                match output {
                    BoardOutput::Beat => session.outbox.send(encode(&FromBoard::Alive, &[])),
                    // Of a wiring that is no longer any of ours.
                    _ if !is_served => {}
                    BoardOutput::ConnectLeft { epoch, address } => self.neighbours.connect(epoch, address, left),
                    BoardOutput::ToBackplane(message) => self.say(index, &FromBoard::Chain(message), &[]),
                    BoardOutput::ToNeighbour(link, message) => self.neighbours.send(link, message),
                    BoardOutput::Close(link) => self.neighbours.close(link),
                }
            }
        }
    }
}
