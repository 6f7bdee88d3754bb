//! The links between boards. Each is a task that only moves messages; what they mean is [`proto::chain::BoardChain`]'s.

use futures_util::StreamExt;
use proto::chain::LinkId;
use proto::ids::Epoch;
use proto::limits;
use proto::link::{self, LinkError};
use proto::message::NeighbourMessage;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// Facts that may wait for the session.
const FACTS: usize = 64;
/// Messages that may wait for one neighbour; a wiring needs two.
const OUTBOX: usize = 8;
/// A neighbour link that isn't up by then has failed.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(300);
/// Links at once: two are in use, some may be ending.
const LINKS_MAX: usize = 32;

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
}

impl Neighbours {
    /// Listens for right neighbours as long as the runtime lives.
    pub(super) fn listen(listener: TcpListener) -> Self {
        let (facts, inbox) = mpsc::channel(FACTS);
        let next = Arc::new(AtomicU64::new(1));
        tokio::spawn(accept(listener, facts.clone(), next.clone()));
        Self { facts, inbox, links: BTreeMap::new(), next }
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

    /// Opens the link to the left neighbour.
    pub(super) fn connect(&self, epoch: Epoch, address: String) {
        let (facts, link) = (self.facts.clone(), LinkId(self.next.fetch_add(1, Ordering::Relaxed)));
        tokio::spawn(async move {
            let stream = tokio::time::timeout(CONNECT_TIMEOUT, TcpStream::connect(&address)).await;
            let result = match stream {
                Ok(Ok(stream)) => serve(stream, link, Some(epoch), &facts).await,
                Ok(Err(error)) => Err(error.into()),
                Err(_) => Err(LinkError::Io(std::io::ErrorKind::TimedOut.into())),
            };
            if let Err(error) = result {
                tracing::info!(%address, %error, "no link to the left neighbour");
                // The session has ended if nobody listens.
                let _ = facts.send(NeighbourEvent::Failed(epoch)).await;
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
        for (_, outbox) in std::mem::take(&mut self.links) {
            outbox.cut.cancel();
        }
    }
}

async fn accept(listener: TcpListener, facts: mpsc::Sender<NeighbourEvent>, next: Arc<AtomicU64>) {
    let places = Arc::new(tokio::sync::Semaphore::new(LINKS_MAX));
    loop {
        // The semaphore is never closed.
        let Ok(place) = places.clone().acquire_owned().await else { return };
        match listener.accept().await {
            Ok((stream, from)) => {
                let (facts, link) = (facts.clone(), LinkId(next.fetch_add(1, Ordering::Relaxed)));
                tokio::spawn(async move {
                    let _place = place;
                    if let Err(error) = serve(stream, link, None, &facts).await {
                        tracing::info!(%from, %error, "neighbour link refused");
                    }
                });
            }
            Err(error) => {
                tracing::warn!(%error, "accept failed");
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
}

/// Carries one link from its preamble to its end. An error is one of the preamble; later ends are facts.
async fn serve(
    stream: TcpStream,
    link: LinkId,
    epoch: Option<Epoch>,
    facts: &mpsc::Sender<NeighbourEvent>,
) -> Result<(), LinkError> {
    stream.set_nodelay(true)?;
    let opened = tokio::time::timeout(CONNECT_TIMEOUT, link::open(stream, limits::CONTROL_MESSAGE_MAX)).await;
    let Ok(opened) = opened else { return Err(LinkError::Io(std::io::ErrorKind::TimedOut.into())) };
    let (mut sink, mut source) = opened?.split();
    let (queue, mut waiting) = mpsc::channel(OUTBOX);
    let cut = CancellationToken::new();
    let outbox = Outbox { queue, cut: cut.clone() };
    if facts.send(NeighbourEvent::Up { link, outbox, epoch }).await.is_err() {
        return Ok(());
    }
    let reading = async {
        while let Ok(Some((message, _))) = link::receive(&mut source).await {
            if facts.send(NeighbourEvent::Message(link, message)).await.is_err() {
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
    Ok(())
}
