//! Flags of the commands that take a scene and need no rig: `render`, `bake`, `inspect`, `scene`.

use super::value::{boards, samples, simd, size};
use super::{AirArgs, DebugArg, DetailArg, ModeArg};
use clap::Args;
use std::num::NonZeroUsize;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama render airport --pose 600 -o airport.png\n  cyclorama render model.glb --camera path.json --samples 64 --size 1920x1080 -o picture.png --stats"
)]
pub(crate) struct RenderArgs {
    /// A glTF file (.glb, .gltf), a baked file, or the name of a built-in scene
    pub scene: String,
    /// Camera file; the built-in scene's, `SCENE.path.json`, or a look at the whole scene by default
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Which pose of the camera file, from 0
    #[arg(long, default_value_t = 0, value_name = "K")]
    pub pose: usize,
    /// Size of the picture, pixels
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = size)]
    pub size: (u32, u32),
    /// Points looked at in each pixel: 1, 4, 8, 16 or 64; or exact: areas instead of points
    #[arg(long, default_value = "16", value_name = "N", value_parser = samples)]
    pub samples: proto::view::Samples,
    #[command(flatten)]
    pub air: AirArgs,
    /// Which levels of detail are shown, of models that have them
    #[arg(long, value_enum, default_value_t)]
    pub detail: DetailArg,
    /// Threads to draw with; one per processor by default
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Instruction set to draw with, the best by default; pictures are the same with all
    #[arg(long, value_name = "LEVEL", value_parser = simd)]
    pub simd: Option<channel::simd::SimdLevel>,
    /// Draw in the shares of this many boards, and stitch; the picture is the same
    #[arg(long, default_value = "1", value_name = "N", value_parser = boards)]
    pub boards: NonZeroUsize,
    /// How the picture is shared between boards
    #[arg(long, value_enum, default_value_t)]
    pub mode: ModeArg,
    /// Draw what drawing takes instead of the picture: depth: how many faces cover each pixel; levels: the picture in grey, tinted by levels of
    /// detail; skips: by which shortcut each block and pixel is drawn, and what is hidden there. Colours: docs/console.md
    #[arg(long, value_enum, default_value_t, value_name = "PICTURE")]
    pub debug: DebugArg,
    /// The picture to write: .png (sRGB, 8 bits), .exr (linear, unclamped) or .rgb (bare pixels)
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Print times and counts as JSON
    #[arg(long)]
    pub stats: bool,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  cyclorama bake city.glb -o city.baked && cyclorama rig city.baked\n\nThe file is written beside its place, as FILE.part, and takes its name when it is complete: whatever interrupts a bake, FILE is the whole old one or the whole new one. A rig that has the old one open keeps it."
)]
pub(crate) struct BakeArgs {
    /// A glTF file (.glb, .gltf) or the name of a built-in scene
    pub scene: String,
    /// The file to write; the scene's camera path, if it has one, goes beside it unless there is one
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama inspect model.glb")]
pub(crate) struct InspectArgs {
    /// A glTF file (.glb, .gltf), a baked file, or the name of a built-in scene
    pub scene: String,
    /// Of a baked file, read every mesh and texture too, and compare it with its checksum
    #[arg(long)]
    pub check: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama scene airport -o airport.glb")]
pub(crate) struct SceneArgs {
    /// Name of the scene: airport
    pub name: String,
    /// The file to write; the camera path goes beside it, as NAME.path.json
    #[arg(short, long, value_name = "FILE.glb")]
    pub output: PathBuf,
}
