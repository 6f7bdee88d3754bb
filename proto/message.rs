//! What the daemons say to each other, link by link. Every message is a typed header and maybe a raw payload
//! ([`crate::codec::encode`]); the payload of each is named here. New variants go to the end.

use crate::chain::{Answer, Ask, FromBoardChain, ToBoardChain};
use crate::codec::{CodecError, Reader, put_affine, take_affine, within};
use crate::frame::{FrameRecord, FrameState, Moved, PixelFormat, TileIndex, VersionWeights};
use crate::ids::{BoardKey, ContentId, Epoch, FrameNumber, ModelId, ObjectId, Term, ViewId};
use crate::limits;
use crate::piece::SliceHeader;
use crate::view::ViewSetup;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// First message of whoever connects to the backplane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// A name for people: in logs and on the console.
    pub name: String,
    /// What it is.
    pub role: Role,
}

/// What connects to the backplane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Role {
    /// A channel worker.
    Board {
        /// Threads that it draws with.
        threads: u32,
        /// Where its right neighbour can reach it, `host:port`.
        link: String,
        /// Bytes that it has for meshes and textures, counted as in [`crate::piece`].
        memory: u64,
        /// What it made of the reference tile, just now ([`crate::frame::REFERENCE_TILE`]).
        drawn: ContentId,
    },
    /// A compositor.
    Compositor {
        /// Where boards can reach it, `host:port`.
        listen: String,
        /// What it wants pixels as.
        format: PixelFormat,
        /// Whether it wants to know what each frame's picture depends on.
        records: bool,
        /// The views that it shows, in ascending order; none: all, as one picture. One that shows some is a display.
        views: Vec<ViewId>,
    },
    /// Another backplane. Both then say [`crate::chain::BetweenBackplanes`], whichever of them leads.
    Backplane,
}

/// Backplane → board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToBoard {
    /// The board is taken.
    Welcome {
        /// Its key.
        key: BoardKey,
    },
    /// The board or compositor is not taken.
    Refused {
        /// Why, for people.
        reason: String,
    },
    /// A slice of a mesh or texture. Payload: its bytes.
    Piece(SliceHeader),
    /// Give these up. Payload: [`crate::codec::encode_ids`]. No frame that comes after names them.
    Evict,
    /// The tables. Payload: [`crate::codec::encode_table`].
    Table {
        /// The content id of the payload.
        scene: ContentId,
    },
    /// The compositors that there are now.
    Compositors(Vec<TileSink>),
    /// The chain's own messages.
    Chain(ToBoardChain),
    /// Draw a frame. Payload: [`FramePayload`].
    Frame(FrameHeader),
    /// The rig ends, or the board has drained.
    Goodbye,
    /// The backplane is there, and has nothing else to say.
    Alive,
    /// A stand-by wants to lead.
    Ask(Ask),
    /// Before each wiring, where there are keys: the names in the certificates of this board's neighbours. Who says to be
    /// one of them must have that name; who isn't here is no neighbour.
    Neighbours(Vec<(BoardKey, String)>),
}

/// A compositor, as boards know it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileSink {
    /// Which.
    pub key: BoardKey,
    /// Where it listens, `host:port`.
    pub address: String,
    /// The views whose tiles it wants; none: all.
    pub views: Vec<ViewId>,
    /// What it wants pixels as.
    pub format: PixelFormat,
}

impl TileSink {
    /// Whether it wants a view's tiles.
    pub fn wants(&self, view: ViewId) -> bool {
        self.views.is_empty() || self.views.contains(&view)
    }
}

/// Board → backplane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum FromBoard {
    /// After the welcome, if no other backplane is served, and whenever this one begins to be: what has been kept. Payload:
    /// [`crate::codec::encode_ids`], at most [`limits::PIECE_NAMES_MAX`] of them.
    Holding {
        /// The term that the board serves. Whoever leads by another one wasn't meant.
        term: Term,
        /// The scene whose tables are here.
        scene: Option<ContentId>,
        /// Whether another such message follows.
        more: bool,
    },
    /// These have come and can be drawn. Payload: [`crate::codec::encode_ids`].
    Stored,
    /// The tables are here.
    Loaded {
        /// Which scene.
        scene: ContentId,
    },
    /// The chain's own messages.
    Chain(FromBoardChain),
    /// The board's share of every view of this frame is drawn, and handed to the compositor's link if that is up and keeps pace.
    Ready {
        /// Which frame.
        frame: FrameNumber,
        /// Under which wiring.
        epoch: Epoch,
        /// What it cost.
        report: BoardReport,
        /// When it was done.
        timeline: Timeline,
    },
    /// The board wants to leave; it stays until told [`ToBoard::Goodbye`].
    Leave,
    /// The board is there, and has had nothing else to say for [`crate::chain::BEAT`].
    Alive,
    /// The answer to a stand-by.
    Answer(Answer),
}

/// What one frame cost one board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BoardReport {
    /// Time in geometry, ns.
    pub geometry_ns: u64,
    /// Time in raster, ns.
    pub raster_ns: u64,
    /// Time in translucency, ns.
    pub translucency_ns: u64,
    /// Time in resolve, ns.
    pub resolve_ns: u64,
    /// Time for comparing tiles and handing them to the compositor's link, ns.
    pub transfer_ns: u64,
    /// Triangles that came in.
    pub triangles: u64,
    /// Triangles dropped because they show their back.
    pub backface: u64,
    /// Triangles, blocks and pixels dropped because something nearer covers them.
    pub occluded: u64,
    /// Translucent fragments.
    pub fragments: u64,
    /// Tiles without any translucent fragment.
    pub tiles_opaque: u64,
    /// Pixels shaded once.
    pub pixels_single: u64,
    /// Pixels shaded for more than one face.
    pub pixels_multi: u64,
    /// Tiles drawn but equal to what was sent last.
    pub tiles_unchanged: u64,
    /// One if nothing changed and nothing was drawn.
    pub frames_unchanged: u64,
    /// Bytes of tiles sent.
    pub tile_bytes: u64,
}

impl BoardReport {
    /// What drawing took, without what depends on the compositor's link.
    pub fn drawing(&self) -> Duration {
        let stages = [self.geometry_ns, self.raster_ns, self.translucency_ns, self.resolve_ns];
        Duration::from_nanos(stages.into_iter().fold(0, u64::saturating_add))
    }
}

/// When a board did what, by its own clock, ns since the frame's message had come.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Timeline {
    /// When it was ready.
    pub ready_ns: u64,
    /// What it did, in order, one after the other; at most [`limits::STAGE_SPANS_MAX`].
    pub stages: Vec<StageSpan>,
}

/// A stage of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageSpan {
    /// Which.
    pub stage: Stage,
    /// Of which view; `None`: of all that the board draws.
    pub view: Option<ViewId>,
    /// When it began.
    pub begin_ns: u64,
    /// When it was over.
    pub end_ns: u64,
}

/// What a board does with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stage {
    /// It waits for the painter, who is busy with another.
    Queue,
    /// From the list to triangles in tiles.
    Geometry,
    /// Which face each sample sees.
    Raster,
    /// Translucent fragments are gathered.
    Translucency,
    /// Shading, mixing, encoding.
    Resolve,
    /// Comparing tiles and handing them to the compositor's link.
    Transfer,
}

impl Stage {
    /// Its name in traces.
    pub fn name(self) -> &'static str {
        match self {
            Self::Queue => "queue",
            Self::Geometry => "geometry",
            Self::Raster => "raster",
            Self::Translucency => "translucency",
            Self::Resolve => "resolve",
            Self::Transfer => "transfer",
        }
    }
}

/// The head of a frame for one board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameHeader {
    /// What all boards share.
    pub state: FrameState,
    /// The views, when they are not those of the frame before.
    pub views: Option<Vec<ViewSetup>>,
    /// What pixels are sent as.
    pub format: PixelFormat,
    /// For each view that this board draws, how its list changes.
    pub lists: Vec<ListUpdate>,
    /// How the objects change that are elsewhere than the tables say.
    pub moved: Changes,
    /// How the models change that don't show their finest version alone.
    pub weights: Changes,
}

/// How a set of named things changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Changes {
    /// What the entries are laid over: nothing, or what was last.
    pub base: ListBase,
    /// How many entries the payload has.
    pub count: u32,
}

impl Changes {
    /// Nothing changes.
    pub const NONE: Self = Self { base: ListBase::Same, count: 0 };
}

/// How one view's list changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ListUpdate {
    /// Which view.
    pub view: ViewId,
    /// What the script is applied to.
    pub base: ListBase,
    /// Length of the script in the payload, bytes.
    pub script_bytes: u32,
}

/// What a list script starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ListBase {
    /// The empty list.
    Empty,
    /// The view's last list.
    Last,
    /// The view's last list, and there is no script: nothing changed.
    Same,
}

/// The payload of a frame: objects that have moved, models whose weights have changed, then the list scripts one after the
/// other. An object that is back where the tables have it is named once with that transformation, a model that shows its finest
/// version alone again is named once without weights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FramePayload {
    /// Objects that have moved.
    pub moved: Vec<Moved>,
    /// Models whose weights have changed; none: the finest version alone.
    pub weights: Vec<VersionWeights>,
    /// List scripts, in the order of [`FrameHeader::lists`].
    pub scripts: Vec<u8>,
}

impl FramePayload {
    /// The bytes: 100 per moved object (u32 id, 12 f64); per model u32 id, u32 count, that many f32; then the scripts.
    pub fn encode(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(self.moved.len() * 100 + self.scripts.len());
        for moved in &self.moved {
            out.extend_from_slice(&moved.object.0.to_le_bytes());
            put_affine(&mut out, &moved.transform);
        }
        for VersionWeights { model, weights } in &self.weights {
            out.extend_from_slice(&model.0.to_le_bytes());
            out.extend_from_slice(&(weights.len() as u32).to_le_bytes());
            out.extend_from_slice(bytemuck::cast_slice(weights));
        }
        out.extend_from_slice(&self.scripts);
        out
    }

    /// The reverse of [`Self::encode`].
    ///
    /// # Errors
    /// [`CodecError`] when the payload does not have exactly the length that the header says.
    pub fn decode(header: &FrameHeader, payload: &[u8]) -> Result<Self, CodecError> {
        let count = within("moved objects", header.moved.count.into(), limits::MOVED_MAX)?;
        let mut reader = Reader::new(payload, "frame payload");
        let mut moved = Vec::with_capacity(count.min(payload.len() / 100));
        for _ in 0..count {
            let object = ObjectId(reader.value()?);
            moved.push(Moved { object, transform: take_affine(&mut reader)? });
        }
        let count = within("models with weights", header.weights.count.into(), limits::MODELS_MAX)?;
        let mut weights = Vec::with_capacity(count.min(payload.len() / 8));
        for _ in 0..count {
            let model = ModelId(reader.value()?);
            let versions = within("versions of a model", reader.value::<u32>()?.into(), limits::VERSIONS_MAX)?;
            weights.push(VersionWeights { model, weights: reader.values(versions)? });
        }
        let total: u64 = header.lists.iter().map(|l| u64::from(l.script_bytes)).sum();
        let scripts = reader.bytes(within("list scripts", total, limits::BULK_MESSAGE_MAX)?)?.to_vec();
        reader.finish()?;
        Ok(Self { moved, weights, scripts })
    }
}

/// When several displays change their pictures, by the clocks of their machines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Moment {
    /// Since 1970, ns.
    pub at_ns: u64,
    /// How long before it that was said, ns. A display that would have to wait longer has another clock.
    pub lead_ns: u32,
}

/// A frame is over.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Swap {
    /// Which frame.
    pub frame: FrameNumber,
    /// Under which wiring it was drawn.
    pub epoch: Epoch,
    /// For each view whether it is complete; one that is not repeats its last image as a whole.
    pub complete: Vec<bool>,
    /// The boards whose tiles make up the complete views.
    pub boards: Vec<BoardKey>,
    /// Whether the compositor shall make a preview picture for the console.
    pub preview: bool,
    /// When to change to it, so that all displays do together; `None`: at once.
    pub moment: Option<Moment>,
}

/// Backplane → compositor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToCompositor {
    /// The compositor is taken.
    Welcome,
    /// Not taken.
    Refused {
        /// Why, for people.
        reason: String,
    },
    /// The views from the next swap on.
    Views(Vec<ViewSetup>),
    /// What the picture of a frame depends on that has been opened; only to who wants to know.
    Record {
        /// Which frame.
        frame: FrameNumber,
        /// What it depends on.
        record: FrameRecord,
    },
    /// Show a frame.
    Swap(Swap),
    /// The rig ends: finish what is queued, then end.
    Goodbye,
    /// Where there are keys: the names in the certificates of all boards. Who sends tiles as one of them must have that name.
    Boards(Vec<(BoardKey, String)>),
}

/// Compositor → backplane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum FromCompositor {
    /// The frame is stitched and handed to every sink.
    Presented {
        /// Which frame.
        frame: FrameNumber,
        /// Time from the last tile's arrival to the finished picture, ns.
        stitch_ns: u64,
        /// When the picture was finished, by the clock of its machine: ns since 1970. Only as good as the machines' clocks agree.
        at_ns: u64,
    },
    /// The newest picture for the console. Payload: a JPEG.
    Preview {
        /// Which frame.
        frame: FrameNumber,
    },
    /// The frame can't be shown: a board's link broke before its tiles were here.
    Missing {
        /// Which frame.
        frame: FrameNumber,
    },
}

/// Board → compositor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TileMessage {
    /// First message: who sends.
    Hello {
        /// The board's key with the backplane.
        key: BoardKey,
    },
    /// Tiles that changed. Payload: 4 bytes per tile index, then the pixels, each tile row-major and tightly
    /// packed, one tile after the other.
    Tiles {
        /// Which frame.
        frame: FrameNumber,
        /// Under which wiring.
        epoch: Epoch,
        /// Which view.
        view: ViewId,
        /// How many tiles.
        count: u32,
        /// Size of the view that they belong to, pixels.
        size: (u32, u32),
        /// What the pixels are.
        format: PixelFormat,
    },
    /// All tiles of the frame have been sent.
    Done {
        /// Which frame.
        frame: FrameNumber,
        /// Under which wiring.
        epoch: Epoch,
    },
}

/// Takes the payload of [`TileMessage::Tiles`] apart and checks that every tile lies in the view and the pixels are as many as
/// the tiles have.
///
/// # Errors
/// [`CodecError`].
pub fn split_tiles(
    payload: &[u8],
    count: u32,
    size: (u32, u32),
    format: PixelFormat,
) -> Result<(Vec<TileIndex>, &[u8]), CodecError> {
    for side in [size.0, size.1] {
        within("side of a view", side.into(), limits::VIEW_SIZE_MAX as usize)?;
    }
    let (columns, rows) = crate::frame::tile_grid(size.0, size.1);
    let count = within("tiles of a view", count.into(), columns as usize * rows as usize)?;
    let mut reader = Reader::new(payload, "tiles");
    let tiles: Vec<TileIndex> = reader.values(count)?;
    let mut pixels = 0;
    for tile in &tiles {
        within("tile column", tile.x.into(), columns.saturating_sub(1) as usize)?;
        within("tile row", tile.y.into(), rows.saturating_sub(1) as usize)?;
        pixels += tile.rect(size.0, size.1).area();
    }
    let pixels = reader.bytes(pixels * format.bytes())?;
    reader.finish()?;
    Ok((tiles, pixels))
}

/// Board ↔ board: the neighbour link. The right board opens it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum NeighbourMessage {
    /// From the right board, first: who I am and for which wiring.
    Hello {
        /// The right board's key.
        key: BoardKey,
        /// The wiring.
        epoch: Epoch,
    },
    /// Left to right: your place.
    Id {
        /// The wiring.
        epoch: Epoch,
        /// The receiver's id.
        id: u32,
    },
    /// Right to left: how many boards there are.
    Total {
        /// The wiring.
        epoch: Epoch,
        /// The number.
        total: u32,
    },
}
