//! One frame: what every board must know to draw it, and the pieces of picture that come back.

use crate::debug::DebugPicture;
use crate::ids::{ContentId, Epoch, FrameNumber, ModelId, ObjectId};
use crate::view::Pose;
use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize};

/// What is seen where nothing is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Background {
    /// The sky of picture.md: horizon (0.60, 0.70, 0.80) to zenith (0.15, 0.30, 0.60) by elevation angle.
    Sky,
    /// One linear RGB colour.
    Constant([f32; 3]),
}

/// Light and air: the same for every board of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Environment {
    /// Ambient light, linear.
    pub ambient: f32,
    /// The sun's light, linear.
    pub sun: f32,
    /// Unit vector towards the sun, world frame.
    pub sun_direction: DVec3,
    /// Behind everything.
    pub background: Background,
    /// Distance at which 98 % is faded and beyond which nothing is drawn, m; `None`: clear air.
    pub visibility_m: Option<f64>,
    /// The colour that things fade to; `None`: the horizon's, or the constant background.
    pub fog: Option<[f32; 3]>,
    /// Whether the lights of the scene's file shine too.
    pub scene_lights: bool,
}

impl Default for Environment {
    fn default() -> Self {
        Self {
            ambient: 0.3,
            sun: 0.7,
            sun_direction: DVec3::new(0.35, 0.80, 0.48).normalize(),
            background: Background::Sky,
            visibility_m: None,
            fog: None,
            scene_lights: false,
        }
    }
}

/// What all boards share of one frame. With the scene it decides every byte of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameState {
    /// Which frame.
    pub frame: FrameNumber,
    /// The wiring it is drawn under.
    pub epoch: Epoch,
    /// The eyepoint, world frame.
    pub eye: Pose,
    /// Light and air.
    pub environment: Environment,
    /// What pixels say.
    pub debug: DebugPicture,
}

/// An object that is somewhere else than the scene table says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Moved {
    /// Which object.
    pub object: ObjectId,
    /// Mesh space → world.
    pub transform: DAffine3,
}

/// How a model's versions are mixed. A model that no frame names shows its finest version alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VersionWeights {
    /// Which model.
    pub model: ModelId,
    /// One weight per version, finest first, each in 0..=1; what is missing to a sum of 1 is a version that shows nothing.
    pub weights: Vec<f32>,
}

/// What a frame's picture depends on, beside the scene and where its objects are: for manifests.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// The eyepoint, world frame.
    pub eye: Pose,
    /// Light and air.
    pub environment: Environment,
    /// How models are mixed.
    pub weights: Vec<VersionWeights>,
    /// What pixels say.
    pub debug: DebugPicture,
}

/// Side of a tile, pixels: the grain of shares, of raster work and of change detection. A build for measuring can take 16 or 64, by the
/// environment variable `CYCLORAMA_TILE`; programs of one rig must be of one build then.
pub const TILE: u32 = match option_env!("CYCLORAMA_TILE") {
    Some(side) => match side.as_bytes() {
        b"16" => 16,
        b"32" => 32,
        b"64" => 64,
        _ => panic!("CYCLORAMA_TILE is none of 16, 32 and 64"),
    },
    None => 32,
};

/// A tile's place in its view: column and row, in tiles from the upper left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Pod, Zeroable)]
#[repr(C)]
pub struct TileIndex {
    /// Column.
    pub x: u16,
    /// Row.
    pub y: u16,
}

/// The pixels of a view that a tile covers: `x0..x1` × `y0..y1`, upper ends excluded; cut off at the view's border.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelRect {
    /// Left, included.
    pub x0: u32,
    /// Top, included.
    pub y0: u32,
    /// Right, excluded.
    pub x1: u32,
    /// Bottom, excluded.
    pub y1: u32,
}

impl PixelRect {
    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.x1 - self.x0
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.y1 - self.y0
    }

    /// Number of pixels.
    pub fn area(&self) -> usize {
        self.width() as usize * self.height() as usize
    }
}

impl TileIndex {
    /// The pixels of this tile in a view of `width` × `height`.
    pub fn rect(self, width: u32, height: u32) -> PixelRect {
        let (x0, y0) = (u32::from(self.x) * TILE, u32::from(self.y) * TILE);
        PixelRect { x0: x0.min(width), y0: y0.min(height), x1: (x0 + TILE).min(width), y1: (y0 + TILE).min(height) }
    }
}

/// Number of tile columns and rows of a view.
pub fn tile_grid(width: u32, height: u32) -> (u32, u32) {
    (width.div_ceil(TILE), height.div_ceil(TILE))
}

/// What a board that draws rightly makes of the reference tile (`channel/reference_tile.rs`). It changes whenever pixels are meant to.
pub const REFERENCE_TILE: ContentId =
    ContentId([0x44, 0xc0, 0x21, 0xf1, 0x26, 0x92, 0x78, 0xe9, 0xe9, 0xa9, 0x9c, 0x0c, 0x28, 0x21, 0xe6, 0xd9]);

/// What a finished pixel is on its way from a board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum PixelFormat {
    /// RGB, sRGB-encoded, 8 bits each.
    #[default]
    Srgb8,
    /// RGB, linear and unclamped, three little-endian f32.
    LinearF32,
}

impl PixelFormat {
    /// Bytes of one pixel.
    pub const fn bytes(self) -> usize {
        match self {
            Self::Srgb8 => 3,
            Self::LinearF32 => 12,
        }
    }
}
