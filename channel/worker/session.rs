//! One session with a backplane, from hello to the end of the link.

use super::neighbours::{NeighbourEvent, Neighbours};
use super::painter::{Painted, Painter, Work};
use super::{Config, LEAVE_TIMEOUT, outlet};
use ::link::{Expected, NodeRole, Stream, Trust};
use bytes::Bytes;
use proto::chain::{BoardChain, BoardOutput, Left, ToBoardChain};
use proto::codec::{CodecError, decode_ids, encode_ids};
use proto::ids::BoardKey;
use proto::limits;
use proto::link::{self, Link, LinkError};
use proto::message::{FrameHeader, FromBoard, Hello, Role, ToBoard};
use proto::piece::{Assembler, SliceHeader};
use proto::share::shares;
use proto::time::Time;
use proto::view::ViewSetup;
use std::net::SocketAddr;
use std::time::{Duration, Instant};
use tokio_util::sync::{CancellationToken, DropGuard};

const GREETING_TIMEOUT: Duration = Duration::from_secs(5);
/// A backplane that beats, and then says nothing for so long, is cut off: it has put us out by now, and its word of that is lost. Longer than a
/// busy machine keeps a process waiting.
const BACKPLANE_SILENCE: Duration = Duration::from_secs(2);

/// Why a session is over.
#[derive(Debug)]
pub(super) enum End {
    /// The rig ended, or released us.
    Goodbye,
    /// We were told to end.
    Shutdown,
    /// The link broke.
    Lost(LinkError),
    /// The backplane doesn't want us.
    Refused(String),
    /// The painter ended.
    Painter,
}

pub(super) struct Session {
    backplane: Link<Stream>,
    trust: Trust,
    chain: BoardChain,
    started: Instant,
    /// Who is to the left under the newest wiring.
    left: Option<BoardKey>,
    key: BoardKey,
    views: Vec<ViewSetup>,
    outlet: Option<(String, DropGuard)>,
    assembler: Assembler,
    /// Bytes of pieces that have begun to come and aren't ready to be drawn.
    loading: u64,
    /// When the backplane was last heard, once it beats: before that it may have nothing to say.
    heard: Option<tokio::time::Instant>,
}

impl Session {
    /// Connects and says hello.
    pub(super) async fn open(config: &Config, listening: SocketAddr) -> Result<Self, LinkError> {
        let greeting = async {
            let stream = config.trust.connect(&config.backplane, &Expected::any(NodeRole::Manager)).await?;
            // Listening on any address, we are reached at the one that reaches the backplane.
            let ip = if listening.ip().is_unspecified() { stream.local_addr()?.ip() } else { listening.ip() };
            let link = config.advertise.clone();
            let link = link.unwrap_or_else(|| SocketAddr::new(ip, listening.port()).to_string());
            let mut backplane = link::open(stream, limits::BULK_MESSAGE_MAX).await?;
            let role = Role::Board { threads: config.threads.get() as u32, link, memory: config.memory };
            link::send(&mut backplane, &Hello { name: config.name.clone(), role }, &[]).await?;
            Ok::<_, LinkError>(backplane)
        };
        let Ok(backplane) = tokio::time::timeout(GREETING_TIMEOUT, greeting).await else {
            return Err(LinkError::Io(std::io::ErrorKind::TimedOut.into()));
        };
        let key = BoardKey(0);
        Ok(Self {
            backplane: backplane?,
            trust: config.trust.clone(),
            chain: BoardChain::new(key),
            started: Instant::now(),
            left: None,
            key,
            views: Vec::new(),
            outlet: None,
            assembler: Assembler::default(),
            loading: 0,
            heard: None,
        })
    }

    /// Serves until the end of the session.
    pub(super) async fn run(
        mut self,
        painter: &mut Painter,
        neighbours: &mut Neighbours,
        shutdown: &CancellationToken,
    ) -> End {
        let mut leaving = None;
        loop {
            let beat = tokio::time::sleep(self.chain.next_timeout().since(self.now()));
            let deadline = async {
                match leaving {
                    Some(at) => tokio::time::sleep_until(at).await,
                    None => std::future::pending().await,
                }
            };
            let silence = async {
                match self.heard {
                    Some(at) => tokio::time::sleep_until(at + BACKPLANE_SILENCE).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                message = link::receive::<ToBoard>(&mut self.backplane) => {
                    let result = match message {
                        Err(error) => Err(End::Lost(error)),
                        Ok(None) => Err(End::Lost(LinkError::Closed)),
                        Ok(Some((message, payload))) => self.on_message(message, payload, painter, neighbours),
                    };
                    if let Err(end) = result {
                        return if leaving.is_some() { End::Shutdown } else { end };
                    }
                }
                event = neighbours.next() => self.on_neighbour(event, neighbours),
                painted = painter.painted() => {
                    let Some(painted) = painted else { return End::Painter };
                    if let Err(error) = self.on_painted(painted).await {
                        return End::Lost(error);
                    }
                }
                () = shutdown.cancelled(), if leaving.is_none() => {
                    leaving = Some(tokio::time::Instant::now() + LEAVE_TIMEOUT);
                    if link::send(&mut self.backplane, &FromBoard::Leave, &[]).await.is_err() {
                        return End::Shutdown;
                    }
                }
                () = deadline => return End::Shutdown,
                () = silence => return End::Lost(LinkError::Io(std::io::ErrorKind::TimedOut.into())),
                () = beat, if self.key != BoardKey(0) => self.chain.on_timeout(self.now()),
            }
            if let Err(error) = self.drain(neighbours).await {
                return End::Lost(error);
            }
        }
    }

    fn now(&self) -> Time {
        Time(self.started.elapsed().as_nanos() as u64)
    }

    async fn say(&mut self, message: &FromBoard, payload: &[u8]) -> Result<(), LinkError> {
        self.chain.on_sent(self.now());
        link::send(&mut self.backplane, message, payload).await
    }

    fn on_message(
        &mut self,
        message: ToBoard,
        payload: Bytes,
        painter: &Painter,
        neighbours: &Neighbours,
    ) -> Result<(), End> {
        if self.heard.is_some() || message == ToBoard::Alive {
            self.heard = Some(tokio::time::Instant::now());
        }
        match message {
            ToBoard::Welcome { key } => {
                tracing::info!(%key, "connected");
                self.key = key;
                self.chain = BoardChain::new(key);
                painter.send(Work::Inventory);
            }
            ToBoard::Refused { reason } => return Err(End::Refused(reason)),
            ToBoard::Goodbye => return Err(End::Goodbye),
            ToBoard::Compositor { address } => {
                if self.outlet.as_ref().map(|(at, _)| at) != address.as_ref() {
                    self.outlet = None;
                    let keep =
                        |at: String| (at.clone(), outlet::keep(at, self.key, painter.work(), self.trust.clone()));
                    self.outlet = address.map(keep);
                }
            }
            ToBoard::Piece(head) => self.on_slice(&head, &payload, painter).map_err(|e| End::Lost(e.into()))?,
            ToBoard::Evict => {
                let ids = decode_ids(&payload, limits::SUBOBJECTS_MAX).map_err(|e| End::Lost(e.into()))?;
                painter.send(Work::Evict(ids));
            }
            ToBoard::Table { scene } => painter.send(Work::Table(scene, payload)),
            ToBoard::Neighbours(names) => neighbours.expect(names),
            ToBoard::Chain(message) => {
                if let ToBoardChain::Wire { left: Left::Board { key, .. }, .. } = &message {
                    self.left = Some(*key);
                }
                self.chain.on_backplane(message);
            }
            ToBoard::Frame(header) => self.on_frame(header, payload, painter)?,
            // The link is alive. A board that knows one backplane has no term to grant.
            ToBoard::Alive | ToBoard::Ask(_) => {}
        }
        Ok(())
    }

    fn on_slice(&mut self, head: &SliceHeader, slice: &[u8], painter: &Painter) -> Result<(), CodecError> {
        if head.offset == 0 {
            let (value, limit) = (self.loading.saturating_add(head.total), limits::PIECES_IN_FLIGHT_MAX);
            if self.loading > 0 && value > limit {
                return Err(CodecError::Limit { what: "bytes of pieces under way", value, limit });
            }
            self.loading = value;
        }
        if let Some((id, kind, bytes)) = self.assembler.take(head, slice)? {
            painter.load(id, kind, bytes);
        }
        Ok(())
    }

    fn on_frame(&mut self, header: FrameHeader, payload: Bytes, painter: &Painter) -> Result<(), End> {
        if let Some(views) = &header.views {
            if views.is_empty() || views.len() > limits::VIEWS_MAX || !views.iter().all(ViewSetup::is_valid) {
                return Err(End::Lost(LinkError::Codec(CodecError::Limit {
                    what: "views that can be drawn, of those sent,",
                    value: views.len() as u64,
                    limit: limits::VIEWS_MAX as u64,
                })));
            }
            self.views.clone_from(views);
        }
        let epoch = header.state.epoch;
        let shares = match self.chain.place(epoch) {
            Some(place) => Some(shares(place.id, &place.weights, &self.views)),
            None => {
                tracing::warn!(frame = %header.state.frame, %epoch, "a frame under a wiring that we have no place in");
                None
            }
        };
        // Even without a place the lists must be followed.
        painter.send(Work::Frame { header: Box::new(header), payload, shares });
        Ok(())
    }

    fn on_neighbour(&mut self, event: NeighbourEvent, neighbours: &mut Neighbours) {
        match event {
            NeighbourEvent::Up { link, outbox, epoch } => {
                neighbours.keep(link, outbox);
                if let Some(epoch) = epoch {
                    self.chain.on_left_linked(epoch, link);
                }
            }
            NeighbourEvent::Message(link, message) => self.chain.on_neighbour(link, message),
            NeighbourEvent::Down(link) => {
                neighbours.close(link);
                self.chain.on_link_lost(None, Some(link));
            }
            NeighbourEvent::Failed(epoch) => self.chain.on_link_lost(Some(epoch), None),
        }
    }

    async fn on_painted(&mut self, painted: Painted) -> Result<(), LinkError> {
        match painted {
            Painted::Holding { scene, ids } => {
                let mut runs = ids.chunks(limits::PIECE_NAMES_MAX).peekable();
                loop {
                    let names = encode_ids(runs.next().unwrap_or_default());
                    let more = runs.peek().is_some();
                    self.say(&FromBoard::Holding { scene, more }, &names).await?;
                    if !more {
                        return Ok(());
                    }
                }
            }
            Painted::Stored { id, len } => {
                self.loading = self.loading.saturating_sub(len);
                self.say(&FromBoard::Stored, &id.0).await
            }
            Painted::Loaded(scene) => self.say(&FromBoard::Loaded { scene }, &[]).await,
            Painted::Ready { frame, epoch, report } => self.say(&FromBoard::Ready { frame, epoch, report }, &[]).await,
            Painted::Refused(error) => {
                tracing::error!(%error, "the backplane sent something that can't be drawn");
                Err(LinkError::Closed)
            }
        }
    }

    async fn drain(&mut self, neighbours: &mut Neighbours) -> Result<(), LinkError> {
        while let Some(output) = self.chain.poll_output() {
            match output {
                BoardOutput::ConnectLeft { epoch, address } => neighbours.connect(epoch, address, self.left),
                BoardOutput::ToBackplane(message) => {
                    self.say(&FromBoard::Chain(message), &[]).await?;
                }
                BoardOutput::ToNeighbour(link, message) => neighbours.send(link, message),
                BoardOutput::Close(link) => neighbours.close(link),
                BoardOutput::Beat => self.say(&FromBoard::Alive, &[]).await?,
            }
        }
        Ok(())
    }
}
