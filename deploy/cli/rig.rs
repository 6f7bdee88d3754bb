//! Flags of `cyclorama rig`, and of `check`, which looks at the file of one.

use super::daemon::ObservedArgs;
use super::value::{Console, boards, console, file_kind, mebibytes, rate};
use super::{AirArgs, DetailArg, ModeArg, RowArgs};
use clap::{Args, Parser};
use std::num::NonZeroUsize;
use std::path::PathBuf;

#[derive(Debug, Parser)]
#[command(
    after_help = "Example:\n  cyclorama rig --frames 120 --views 3 --boards 3 --size 640x360 --out frames --json\n\nThe console (a page with the picture and the statistics) is at the address that the rig prints."
)]
pub(crate) struct RigArgs {
    /// A glTF file (.glb, .gltf), a baked file, or the name of a built-in scene
    #[arg(default_value = "airport")]
    pub scene: String,
    #[command(flatten)]
    pub row: RowArgs,
    #[command(flatten)]
    pub air: AirArgs,
    /// How many boards; as many as views by default
    #[arg(long, value_name = "N", value_parser = boards)]
    pub boards: Option<NonZeroUsize>,
    /// Frames a second
    #[arg(long, default_value_t = 60.0, value_name = "HZ", value_parser = rate)]
    pub rate: f64,
    /// How a view is shared between boards
    #[arg(long, value_enum, default_value_t)]
    pub mode: ModeArg,
    /// Which levels of detail are shown, of models that have them
    #[arg(long, value_enum, default_value_t)]
    pub detail: DetailArg,
    /// Camera file to fly; the built-in scene's, `SCENE.path.json`, or a flight round the scene by default
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Memory of each board for meshes and textures, MiB; half of this machine's, shared evenly, by default
    #[arg(long, value_name = "MIB", value_parser = mebibytes)]
    pub memory_limit: Option<u64>,
    /// End after N frames
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub frames: Option<u64>,
    /// Write every stitched frame as frame-00000.png … into this folder; pose k is then frame k and nothing is skipped
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// What frames are written as: png (sRGB, 8 bits), exr (linear, unclamped) or rgb (bare pixels)
    #[arg(long, default_value = "png", value_parser = file_kind, value_name = "KIND")]
    pub format: compositor::sinks::FileKind,
    /// Write a line for each frame into this file: its number, what it depends on, and the hash of each tile; pose k is then frame k
    #[arg(long, value_name = "FILE")]
    pub manifest: Option<PathBuf>,
    /// Folder of an authority, made by `cyclorama keys init`: the rig's processes get keys of it, and all their links are encrypted
    #[arg(long, value_name = "DIR")]
    pub keys: Option<PathBuf>,
    /// Where the console is served; `off` for none. The default takes a free port when 7480 is in use
    #[arg(long, env = "CYCLORAMA_CONSOLE", value_name = "ADDR", value_parser = console)]
    pub console: Option<Console>,
    #[command(flatten)]
    pub observed: ObservedArgs,
    /// Print the statistics as one JSON object at the end
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama check rig.toml -o frusta.svg")]
pub(crate) struct CheckArgs {
    /// The rig file
    pub rig: PathBuf,
    /// Draw the frusta from above into this file
    #[arg(short, long, value_name = "FILE.svg")]
    pub output: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}
