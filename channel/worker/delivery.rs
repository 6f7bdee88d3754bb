//! Tiles on their way to the compositors: each gets those of the views that it shows, as the pixels that it wants, and only what differs from what
//! it was sent last.
//!
//! All tiles are sent after a new wiring, over a new link, or after a frame whose tiles found no room in the link's queue; only then may a
//! compositor count on what it has.

use crate::pipeline::TilePictures;
use bytes::Bytes;
use proto::codec::encode;
use proto::frame::{PixelFormat, TileIndex};
use proto::ids::{BoardKey, Epoch, FrameNumber, ViewId};
use proto::message::{TileMessage, TileSink};
use proto::view::ViewSetup;
use std::collections::BTreeMap;
use tokio::sync::mpsc;

/// Most pixels in one tile message, bytes: large shares go in several, so that sending overlaps stitching.
const TILE_MESSAGE_BYTES: usize = 8 << 20;

/// A compositor that can be reached.
#[derive(Debug)]
struct Outlet {
    sink: TileSink,
    queue: mpsc::Sender<Vec<Bytes>>,
    /// It lacks tiles that were drawn: all must be sent.
    is_behind: bool,
    /// The wiring under which tiles were sent last.
    epoch: Option<Epoch>,
}

/// All of them.
#[derive(Debug, Default)]
pub(super) struct Outlets(BTreeMap<BoardKey, Outlet>);

/// What was drawn.
pub(super) struct Delivery<'a> {
    pub frame: FrameNumber,
    pub epoch: Epoch,
    pub views: &'a [ViewSetup],
    /// What pixels the pictures have; those with linear ones have the others too.
    pub format: PixelFormat,
    pub pictures: &'a BTreeMap<ViewId, TilePictures>,
    /// By view: the tiles that differ from those drawn last.
    pub changed: &'a BTreeMap<ViewId, Vec<usize>>,
}

impl Outlets {
    /// A compositor can be reached, anew or over a new link.
    pub(super) fn open(&mut self, sink: TileSink, queue: mpsc::Sender<Vec<Bytes>>) {
        self.0.insert(sink.key, Outlet { sink, queue, is_behind: true, epoch: None });
    }

    /// It can't any more.
    pub(super) fn close(&mut self, key: BoardKey) {
        self.0.remove(&key);
    }

    /// What they have counts no more.
    pub(super) fn fall_behind(&mut self) {
        self.0.values_mut().for_each(|outlet| outlet.is_behind = true);
    }

    /// A frame is drawn under that wiring. Who was sent nothing under it yet drops what it has of this board.
    pub(super) fn on_epoch(&mut self, epoch: Epoch) {
        self.0.values_mut().for_each(|outlet| outlet.is_behind |= outlet.epoch != Some(epoch));
    }

    /// Whether nobody has what was drawn last.
    pub(super) fn is_behind(&self) -> bool {
        self.0.values().all(|outlet| outlet.is_behind)
    }

    /// Queues tiles for all, or for one. Returns the bytes.
    pub(super) fn deliver(&mut self, to: Option<BoardKey>, drawn: &Delivery<'_>) -> u64 {
        // Of a link that was opened while it was given up.
        self.0.retain(|_, outlet| !outlet.queue.is_closed());
        let wanted = self.0.values_mut().filter(|outlet| to.is_none_or(|to| to == outlet.sink.key));
        wanted.map(|outlet| outlet.deliver(drawn)).sum()
    }
}

impl Outlet {
    fn deliver(&mut self, drawn: &Delivery<'_>) -> u64 {
        let Delivery { frame, epoch, views, pictures, changed, .. } = *drawn;
        let format = self.sink.format;
        if format == PixelFormat::LinearF32 && drawn.format != format {
            // It came while frames were drawn without them; the next ones have them.
            self.is_behind = true;
            return 0;
        }
        if self.queue.capacity() == 0 {
            // Nothing is copied for who doesn't take it.
            self.is_behind = true;
            return 0;
        }
        let mut messages = Vec::new();
        for (view, picture) in pictures.iter().filter(|(view, _)| self.sink.wants(**view)) {
            let Some(size) = views.get(view.0 as usize).map(|setup| (setup.view.width, setup.view.height)) else {
                continue;
            };
            let all: Vec<usize>;
            let tiles = if self.is_behind {
                all = (0..picture.tiles.len()).collect();
                &all
            } else {
                changed.get(view).map_or(&[][..], Vec::as_slice)
            };
            let head = TileMessage::Tiles { frame, epoch, view: *view, count: 0, size, format };
            tile_messages(picture, tiles, format, &head, &mut messages);
        }
        messages.push(encode(&TileMessage::Done { frame, epoch }, &[]));
        let bytes = messages.iter().map(|message| message.len() as u64).sum();
        // All or nothing. Without room the compositor hangs or is gone, and the board goes on without it.
        self.is_behind = self.queue.try_send(messages).is_err();
        if self.is_behind {
            return 0;
        }
        self.epoch = Some(epoch);
        bytes
    }
}

/// A tile's pixels as they are sent.
pub(super) fn pixels(picture: &TilePictures, k: usize, format: PixelFormat) -> &[u8] {
    match (format, picture.tile_linear(k)) {
        // f32 are sent as they lie in memory: `proto::codec` refuses to be built for a big-endian machine.
        (PixelFormat::LinearF32, Some(linear)) => bytemuck::cast_slice(linear),
        _ => picture.tile(k),
    }
}

/// The messages that carry the tiles numbered in `tiles`; `head` says which picture they are of.
fn tile_messages(
    picture: &TilePictures,
    tiles: &[usize],
    format: PixelFormat,
    head: &TileMessage,
    messages: &mut Vec<Bytes>,
) {
    let mut rest = tiles;
    while !rest.is_empty() {
        let mut bytes = 0;
        let fits = rest.iter().take_while(|k| {
            bytes += pixels(picture, **k, format).len();
            bytes <= TILE_MESSAGE_BYTES
        });
        let (run, after) = rest.split_at(fits.count().max(1));
        rest = after;
        let mut payload = Vec::with_capacity(bytes + run.len() * size_of::<TileIndex>());
        for k in run {
            let tile = picture.tiles[*k];
            payload.extend_from_slice(&tile.x.to_le_bytes());
            payload.extend_from_slice(&tile.y.to_le_bytes());
        }
        for k in run {
            payload.extend_from_slice(pixels(picture, *k, format));
        }
        let mut head = head.clone();
        if let TileMessage::Tiles { count, .. } = &mut head {
            *count = run.len() as u32;
        }
        messages.push(encode(&head, &payload));
    }
}
