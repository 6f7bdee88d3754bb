//! The links between boards. Each is a task that only moves messages; what they mean is [`proto::chain::BoardChain`]'s.
//!
//! Where there are keys, a neighbour must have the certificate of the board that it says it is. The backplane tells the names
//! ([`Neighbours::expect`]); a neighbour that is quicker than the backplane's word waits for it before the chain hears anything of it.

use ::link::{Arrival, Expected, Incoming, Listener, NodeRole, Roster, Stream, Trust, check_board, denied};
use futures_util::StreamExt;
use proto::chain::LinkId;
use proto::ids::{BoardKey, Epoch};
use proto::limits;
use proto::link::{self, Link, LinkError};
use proto::message::NeighbourMessage;
use std::collections::BTreeMap;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Facts that may wait for the session.
const FACTS: usize = 64;
/// Messages that may wait for one neighbour; a wiring needs two.
const OUTBOX: usize = 8;
/// A neighbour link that isn't up by then has failed.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(300);
/// A neighbour that hasn't said who it is by then, or whom the backplane hasn't named, is dropped. A wiring takes no longer.
const GREETING_TIMEOUT: Duration = Duration::from_millis(500);

/// What happened on a neighbour link.
#[derive(Debug)]
pub(super) enum NeighbourEvent {
    /// A link is up; `epoch` is set when we opened it.
    Up { link: LinkId, outbox: Outbox, epoch: Option<Epoch> },
    /// The neighbour said something.
    Message(LinkId, NeighbourMessage),
    /// The link is down.
    Down(LinkId),
    /// The link to the left couldn't be made.
    Failed(Epoch),
}

#[derive(Debug)]
pub(super) struct Outbox {
    queue: mpsc::Sender<NeighbourMessage>,
    cut: CancellationToken,
}

/// All neighbour links of this board.
#[derive(Debug)]
pub(super) struct Neighbours {
    facts: mpsc::Sender<NeighbourEvent>,
    inbox: mpsc::Receiver<NeighbourEvent>,
    links: BTreeMap<LinkId, Outbox>,
    next: Arc<AtomicU64>,
    trust: Trust,
    roster: watch::Sender<Roster>,
}

impl Neighbours {
    /// Listens for right neighbours as long as the runtime lives.
    pub(super) fn listen(listener: Listener, trust: Trust) -> Self {
        let (facts, inbox) = mpsc::channel(FACTS);
        let next = Arc::new(AtomicU64::new(1));
        let roster = watch::Sender::new(Roster::new());
        tokio::spawn(accept(listener, facts.clone(), next.clone(), roster.subscribe()));
        Self { facts, inbox, links: BTreeMap::new(), next, trust, roster }
    }

    /// Who the neighbours are by their certificates, from now on.
    pub(super) fn expect(&self, names: Vec<(BoardKey, String)>) {
        self.roster.send_replace(names.into_iter().collect());
    }

    /// The next fact. Cancel-safe.
    pub(super) async fn next(&mut self) -> NeighbourEvent {
        // `self` holds a sender, so the channel is never closed.
        match self.inbox.recv().await {
            Some(event) => event,
            None => std::future::pending().await,
        }
    }

    /// Keeps a link that came up.
    pub(super) fn keep(&mut self, link: LinkId, outbox: Outbox) {
        self.links.insert(link, outbox);
    }

    /// Opens the link to the left neighbour, which the backplane calls `left`.
    pub(super) fn connect(&self, epoch: Epoch, address: String, left: Option<BoardKey>) {
        let (facts, link) = (self.facts.clone(), LinkId(self.next.fetch_add(1, Ordering::Relaxed)));
        let (trust, name) = (self.trust.clone(), left.and_then(|key| self.roster.borrow().get(&key).cloned()));
        tokio::spawn(async move {
            match open(&trust, &address, name).await {
                Ok(opened) => carry(opened, link, Some(epoch), None, &facts).await,
                Err(error) => {
                    tracing::info!(%address, %error, "no link to the left neighbour");
                    // The session has ended if nobody listens.
                    let _ = facts.send(NeighbourEvent::Failed(epoch)).await;
                }
            }
        });
    }

    /// Sends over a link; a neighbour that doesn't take its two messages is hung, and the link is cut.
    pub(super) fn send(&mut self, link: LinkId, message: NeighbourMessage) {
        if let Some(outbox) = self.links.get(&link)
            && outbox.queue.try_send(message).is_err()
        {
            outbox.cut.cancel();
        }
    }

    /// Closes a link.
    pub(super) fn close(&mut self, link: LinkId) {
        if let Some(outbox) = self.links.remove(&link) {
            outbox.cut.cancel();
        }
    }

    /// Closes all links.
    pub(super) fn close_all(&mut self) {
        self.roster.send_replace(Roster::new());
        for (_, outbox) in std::mem::take(&mut self.links) {
            outbox.cut.cancel();
        }
    }
}

async fn accept(
    mut listener: Listener,
    facts: mpsc::Sender<NeighbourEvent>,
    next: Arc<AtomicU64>,
    roster: watch::Receiver<Roster>,
) {
    loop {
        match listener.next().await {
            Arrival::Peer(incoming) => {
                let (facts, link) = (facts.clone(), LinkId(next.fetch_add(1, Ordering::Relaxed)));
                tokio::spawn(serve(incoming, link, facts, roster.clone()));
            }
            Arrival::Refused { count, from, reason } => {
                tracing::warn!(count, %from, %reason, "neighbour links refused");
            }
        }
    }
}

/// Connects to the left neighbour, and with keys makes sure that it is the one of this name.
async fn open(trust: &Trust, address: &str, name: Option<String>) -> Result<Link<Stream>, LinkError> {
    if trust.has_keys() && name.is_none() {
        return Err(denied("the backplane has not said who is there".into()));
    }
    let expected = Expected { role: NodeRole::Board, name };
    let stream = tokio::time::timeout(CONNECT_TIMEOUT, trust.connect(address, &expected));
    let stream = stream.await.map_err(|_| LinkError::Io(io::ErrorKind::TimedOut.into()))??;
    let opened = tokio::time::timeout(CONNECT_TIMEOUT, link::open(stream, limits::CONTROL_MESSAGE_MAX));
    opened.await.map_err(|_| LinkError::Io(io::ErrorKind::TimedOut.into()))?
}

/// Hears who a right neighbour is, and makes sure of it.
async fn greet(
    stream: Stream,
    mut roster: watch::Receiver<Roster>,
) -> Result<(Link<Stream>, NeighbourMessage), LinkError> {
    let identity = stream.peer().cloned();
    let mut opened = link::open(stream, limits::CONTROL_MESSAGE_MAX).await?;
    let (hello, _) = link::expect::<NeighbourMessage>(&mut opened).await?;
    let NeighbourMessage::Hello { key, .. } = hello else {
        return Err(denied("it doesn't say hello first".into()));
    };
    if let Some(identity) = identity {
        check_board(key, &identity, &mut roster).await?;
    }
    Ok((opened, hello))
}

async fn serve(incoming: Incoming, link: LinkId, facts: mpsc::Sender<NeighbourEvent>, roster: watch::Receiver<Roster>) {
    let from = incoming.from();
    match incoming.greet(GREETING_TIMEOUT, |stream| greet(stream, roster)).await {
        Ok(((opened, hello), _place)) => carry(opened, link, None, Some(hello), &facts).await,
        Err(error) => tracing::info!(%from, %error, "neighbour link refused"),
    }
}

/// Carries one link to its end. `hello` is what the right neighbour has said already.
async fn carry(
    opened: Link<Stream>,
    link: LinkId,
    epoch: Option<Epoch>,
    hello: Option<NeighbourMessage>,
    facts: &mpsc::Sender<NeighbourEvent>,
) {
    let (mut sink, mut source) = opened.split();
    let (queue, mut waiting) = mpsc::channel(OUTBOX);
    let cut = CancellationToken::new();
    let outbox = Outbox { queue, cut: cut.clone() };
    if facts.send(NeighbourEvent::Up { link, outbox, epoch }).await.is_err() {
        return;
    }
    let reading = async {
        if let Some(hello) = hello
            && facts.send(NeighbourEvent::Message(link, hello)).await.is_err()
        {
            return;
        }
        while let Ok(Some((message, _))) = link::receive(&mut source).await {
            // Who has said who it is can't be another.
            if matches!(message, NeighbourMessage::Hello { .. })
                || facts.send(NeighbourEvent::Message(link, message)).await.is_err()
            {
                break;
            }
        }
    };
    let writing = async {
        while let Some(message) = waiting.recv().await {
            if link::send(&mut sink, &message, &[]).await.is_err() {
                break;
            }
        }
    };
    tokio::select! {
        () = reading => {}
        () = writing => {}
        () = cut.cancelled() => {}
    }
    // The session has ended if nobody listens.
    let _ = facts.send(NeighbourEvent::Down(link)).await;
}
