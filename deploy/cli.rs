//! The command line: every flag is defined here once; parsing, `--help` and the tests come from it.

mod bench;
mod keys;
mod service;
#[cfg(test)]
mod used;

pub(crate) use bench::{
    BenchCommand, ChainArgs, ConsoleArgs, FleetArgs, FlightArgs, LatencyArgs, ListsArgs, OpenArgs, PeerArgs,
    PixelsArgs, WireArgs,
};
pub(crate) use keys::{KeysArgs, KeysCommand, KeysInitArgs, KeysIssueArgs, KeysShowArgs, TrustArgs};
pub(crate) use service::{CompletionsArgs, HealthArgs, ManArgs};

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::net::SocketAddr;
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;

/// A distributed multichannel image generator: what stands behind the projectors of a flight simulator.
///
/// Without a command it runs `rig`: manager, boards, compositor and a host that flies the built-in scene, all on this
/// machine.
#[derive(Debug, Parser)]
#[command(
    name = "cyclorama",
    version,
    after_help = "Examples:\n  cyclorama\n  cyclorama rig model.glb --views 3 --boards 5\n  cyclorama render airport --pose 600 --samples 64 -o airport.png"
)]
pub(crate) struct Cli {
    /// What to log: error, warn, info, debug, trace, or a filter like `channel=debug`
    #[arg(long, global = true, env = "CYCLORAMA_LOG", value_name = "LEVEL")]
    pub log: Option<String>,
    /// What the log is written as; json: an object a line, for collectors
    #[arg(long, global = true, env = "CYCLORAMA_LOG_FORMAT", value_enum, default_value_t, value_name = "FORMAT")]
    pub log_format: LogFormat,
    #[command(subcommand)]
    pub command: Option<Command>,
}

/// What the log is written as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum LogFormat {
    /// Lines for people
    #[default]
    Text,
    /// JSON, an object a line
    Json,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Run a whole rig on this machine: manager, boards, compositor and host as separate processes
    Rig(Box<RigArgs>),
    /// Run the scene-manager daemon
    Manager(Box<ManagerArgs>),
    /// Run a board: a channel worker
    Channel(ChannelArgs),
    /// Run the compositor
    Compositor(CompositorArgs),
    /// Make the rig's authority and its nodes' keys
    Keys(KeysArgs),
    /// Ask a rig whether it is well
    Health(HealthArgs),
    /// Be a host
    #[command(subcommand)]
    Host(HostCommand),
    /// Draw one picture, without a network
    Render(Box<RenderArgs>),
    /// Import a scene once and write it to a file that opens in milliseconds
    Bake(BakeArgs),
    /// Say what is in a scene
    Inspect(InspectArgs),
    /// Write a built-in scene and its camera path
    Scene(SceneArgs),
    /// Say whether a rig file is right, and what each view sees
    Check(CheckArgs),
    /// Measure
    #[command(subcommand)]
    Bench(BenchCommand),
    /// Print a shell's completions for this command
    Completions(CompletionsArgs),
    /// Write the manual's pages
    Man(ManArgs),
}

impl Default for Command {
    fn default() -> Self {
        Self::Rig(Box::new(RigArgs::parse_from(["rig"])))
    }
}

/// How a view is shared between boards.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum ModeArg {
    /// Every k-th tile of a skewed lattice
    #[default]
    Interleave,
    /// A rectangle each
    Region,
}

impl From<ModeArg> for proto::view::Mode {
    fn from(mode: ModeArg) -> Self {
        match mode {
            ModeArg::Interleave => Self::Interleave,
            ModeArg::Region => Self::Region,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum DetailArg {
    /// Levels of detail by what they span on the picture
    #[default]
    Auto,
    /// All at their finest and unfaded
    Finest,
}

impl DetailArg {
    /// As the flag that says it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Finest => "finest",
        }
    }
}

impl From<DetailArg> for manager::select::DetailMode {
    fn from(detail: DetailArg) -> Self {
        match detail {
            DetailArg::Auto => Self::Auto,
            DetailArg::Finest => Self::Finest,
        }
    }
}

/// A debug picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum DebugArg {
    /// The picture itself
    #[default]
    Off,
    /// How many faces cover each pixel
    Depth,
    /// Levels of detail
    Levels,
    /// Skipped work
    Skips,
}

impl From<DebugArg> for proto::debug::DebugPicture {
    fn from(debug: DebugArg) -> Self {
        match debug {
            DebugArg::Off => Self::Off,
            DebugArg::Depth => Self::Depth,
            DebugArg::Levels => Self::Levels,
            DebugArg::Skips => Self::Skips,
        }
    }
}

/// What the views look like, for `rig` and `manager`.
#[derive(Clone, Debug, Args)]
pub(crate) struct RowArgs {
    /// How many views stand side by side
    #[arg(long, env = "CYCLORAMA_VIEWS", value_name = "N", value_parser = views)]
    pub views: Option<NonZeroU32>,
    /// Size of each view, pixels
    #[arg(long, env = "CYCLORAMA_SIZE", value_name = "WxH", value_parser = size)]
    pub size: Option<(u32, u32)>,
    /// Points looked at in each pixel: 1, 4, 8, 16 or 64; or exact: areas instead of points
    #[arg(long, env = "CYCLORAMA_SAMPLES", value_name = "N", value_parser = samples)]
    pub samples: Option<proto::view::Samples>,
}

/// Light and air.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct AirArgs {
    /// A constant background, linear light, instead of the sky
    #[arg(long, value_name = "R,G,B", value_parser = triple)]
    pub background: Option<[f64; 3]>,
    /// Direction towards the sun, world frame
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    pub sun: Option<[f64; 3]>,
    /// Visibility range: what is this far away is 98 % faded, m
    #[arg(long, value_name = "M", value_parser = positive)]
    pub visibility: Option<f64>,
    /// Colour that things fade to, linear light, instead of the horizon's
    #[arg(long, value_name = "R,G,B", value_parser = triple)]
    pub fog: Option<[f64; 3]>,
    /// Let the lights of the scene's file shine too
    #[arg(long)]
    pub scene_lights: bool,
}

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
    /// What somebody must know to change anything at the console, at least 12 characters; better by the environment, for all of this machine
    /// can read a command line
    #[arg(long, env = "CYCLORAMA_CONSOLE_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub console_token: Option<String>,
    /// Send every frame as a trace to this collector (OTLP over HTTP, as `http://collector:4318`); needs a build with `--features otlp`
    #[arg(long, env = "CYCLORAMA_OTLP", value_name = "URL")]
    pub otlp: Option<String>,
    /// Print the statistics as one JSON object at the end
    #[arg(long)]
    pub json: bool,
}

/// Where the console is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Console {
    Off,
    At(SocketAddr),
}

#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama manager --rig rig.toml\n  cyclorama manager --scene airport --views 3\n  cyclorama manager --listen 0.0.0.0:7400 --keys desk\n  cyclorama manager --rig rig.toml --standby desk:7400    # takes over when the manager there dies\n\nBoards, compositor and host must know both: channel and compositor with --backplane twice, host play with --to twice.\n\nPorts: 7400 boards and compositor (TCP), 7401 pose packets (UDP), 7480 console (HTTP)."
)]
pub(crate) struct ManagerArgs {
    /// Rig file (TOML); flags override what it says
    #[arg(long, env = "CYCLORAMA_RIG", value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// A glTF file, a baked file, or the name of a built-in scene
    #[arg(long, env = "CYCLORAMA_SCENE")]
    pub scene: Option<String>,
    /// Camera file whose first pose is shown until a host speaks
    #[arg(long, env = "CYCLORAMA_CAMERA", value_name = "FILE")]
    pub camera: Option<PathBuf>,
    #[command(flatten)]
    pub row: RowArgs,
    #[command(flatten)]
    pub air: AirArgs,
    /// Frames a second
    #[arg(long, env = "CYCLORAMA_RATE", value_name = "HZ", value_parser = rate)]
    pub rate: Option<f64>,
    /// How a view is shared between boards
    #[arg(long, env = "CYCLORAMA_MODE", value_enum)]
    pub mode: Option<ModeArg>,
    /// Which levels of detail are shown, of models that have them
    #[arg(long, env = "CYCLORAMA_DETAIL", value_enum)]
    pub detail: Option<DetailArg>,
    /// How far resolution may fall when boards can't follow at an eighth of the rate: one pixel drawn for N of the picture's, each way
    #[arg(long, env = "CYCLORAMA_LOWEST_RESOLUTION", value_name = "1|2|4", value_parser = resolution)]
    pub lowest_resolution: Option<u32>,
    /// Most memory of each board that is used for meshes and textures, MiB; all that boards offer by default
    #[arg(long, env = "CYCLORAMA_BOARD_MEMORY", value_name = "MIB", value_parser = mebibytes)]
    pub board_memory: Option<u64>,
    /// One frame for each pose, waiting for everybody, instead of a rate
    #[arg(long)]
    pub lock_step: bool,
    /// End after N frames
    #[arg(long, value_name = "N")]
    pub frames: Option<u64>,
    /// Hold the first frame until N boards are there
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub wait_for_boards: usize,
    /// Hold the first frame until the compositor is there
    #[arg(long)]
    pub wait_for_compositor: bool,
    /// Stand by for the manager whose backplane is there, and lead when it dies or falls silent; without an address, for that of the rig file. It
    /// listens at 7410, 7411 and 7490, or where `standby` in the rig file says
    #[arg(long, env = "CYCLORAMA_STANDBY", value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = "", conflicts_with_all = ["lock_step", "frames"])]
    pub standby: Option<String>,
    /// Where boards and the compositor connect (TCP)
    #[arg(long, env = "CYCLORAMA_LISTEN", value_name = "ADDR")]
    pub listen: Option<SocketAddr>,
    /// Where native pose packets arrive (UDP)
    #[arg(long, env = "CYCLORAMA_POSE_LISTEN", value_name = "ADDR")]
    pub pose_listen: Option<SocketAddr>,
    /// Where the console is served (HTTP); `off` for none
    #[arg(long, env = "CYCLORAMA_CONSOLE", value_name = "ADDR", value_parser = console)]
    pub console: Option<Console>,
    /// What somebody must know to change anything at the console, at least 12 characters; better by the environment, for all of this machine
    /// can read a command line. Without it, a console beyond this machine is read-only
    #[arg(long, env = "CYCLORAMA_CONSOLE_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub console_token: Option<String>,
    /// Send every frame as a trace to this collector (OTLP over HTTP, as `http://collector:4318`); needs a build with `--features otlp`
    #[arg(long, env = "CYCLORAMA_OTLP", value_name = "URL")]
    pub otlp: Option<String>,
    #[command(flatten)]
    pub trust: TrustArgs,
    /// Print the statistics as one JSON object at the end
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub supervision: Supervision,
}

/// How `rig` starts its daemons.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct Supervision {
    /// Report on stdout in JSON lines, and end when stdin ends
    #[arg(long, hide = true)]
    pub supervised: bool,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama channel --backplane 127.0.0.1:7400\n  cyclorama channel --backplane desk:7400 --listen 0.0.0.0:0 --keys pc1\n  cyclorama channel --backplane desk:7400 --backplane spare:7400 --listen 0.0.0.0:0 --keys pc1"
)]
pub(crate) struct ChannelArgs {
    /// Where the backplane listens; given twice, or with a comma between: that of the stand-by too
    #[arg(
        long,
        env = "CYCLORAMA_BACKPLANE",
        default_value = "127.0.0.1:7400",
        value_name = "HOST:PORT",
        value_delimiter = ','
    )]
    pub backplane: Vec<String>,
    /// Where to listen for the neighbour board
    #[arg(long, env = "CYCLORAMA_LISTEN", default_value = "127.0.0.1:0", value_name = "ADDR")]
    pub listen: SocketAddr,
    /// Where the neighbour board reaches this one, if not at the listening address
    #[arg(long, env = "CYCLORAMA_ADVERTISE", value_name = "HOST:PORT")]
    pub advertise: Option<String>,
    /// Threads to draw with; one per processor by default
    #[arg(long, env = "CYCLORAMA_THREADS", value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Instruction set to draw with, the best by default; pictures are the same with all
    #[arg(long, env = "CYCLORAMA_SIMD", value_name = "LEVEL", value_parser = simd)]
    pub simd: Option<channel::simd::SimdLevel>,
    /// Memory for meshes and textures, MiB; half of this machine's by default. What has no room is left out of pictures, or shown
    /// less detailed
    #[arg(long, env = "CYCLORAMA_MEMORY_LIMIT", value_name = "MIB", value_parser = mebibytes)]
    pub memory_limit: Option<u64>,
    /// A name for logs and the console; the machine's and the process number by default, and in a container the container's
    #[arg(long, env = "CYCLORAMA_NAME")]
    pub name: Option<String>,
    #[command(flatten)]
    pub trust: TrustArgs,
    #[command(flatten)]
    pub supervision: Supervision,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama compositor --backplane 127.0.0.1:7400 --out frames\n  cyclorama compositor --backplane desk:7400 --backplane spare:7400 --listen 0.0.0.0:0 --keys wall"
)]
pub(crate) struct CompositorArgs {
    /// Where the backplane listens; given twice, or with a comma between: that of the stand-by too
    #[arg(
        long,
        env = "CYCLORAMA_BACKPLANE",
        default_value = "127.0.0.1:7400",
        value_name = "HOST:PORT",
        value_delimiter = ','
    )]
    pub backplane: Vec<String>,
    /// Where to listen for boards
    #[arg(long, env = "CYCLORAMA_LISTEN", default_value = "127.0.0.1:0", value_name = "ADDR")]
    pub listen: SocketAddr,
    /// Write every stitched frame as frame-00000.png … into this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// What frames are written as: png (sRGB, 8 bits), exr (linear, unclamped) or rgb (bare pixels)
    #[arg(long, default_value = "png", value_parser = file_kind, value_name = "KIND")]
    pub format: compositor::sinks::FileKind,
    /// Write a line for each frame into this file: its number, what it depends on, and the hash of each tile
    #[arg(long, value_name = "FILE")]
    pub manifest: Option<PathBuf>,
    #[command(flatten)]
    pub trust: TrustArgs,
    #[command(flatten)]
    pub supervision: Supervision,
}

#[derive(Debug, Subcommand)]
pub(crate) enum HostCommand {
    /// Send a camera file as pose packets
    Play(HostPlayArgs),
}

#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama host play flight.json --to 127.0.0.1:7401 --rate 60 --repeat\n  cyclorama host play airport --repeat\n  cyclorama host play flight.json --to desk:7401 --to spare:7401 --repeat    # a manager and its stand-by"
)]
pub(crate) struct HostPlayArgs {
    /// The camera file, or the name of a built-in scene: its own path
    pub file: PathBuf,
    /// Where the manager takes pose packets; given twice, or with a comma between: the stand-by too
    #[arg(long, default_value = "127.0.0.1:7401", value_name = "HOST:PORT", value_delimiter = ',')]
    pub to: Vec<String>,
    /// Poses a second, for files without times; files with times are flown by those
    #[arg(long, default_value_t = 60.0, value_name = "HZ", value_parser = rate)]
    pub rate: f64,
    /// Send the next pose only when the manager has shown the last
    #[arg(long)]
    pub lock_step: bool,
    /// Begin again at the end
    #[arg(long)]
    pub repeat: bool,
    /// Size of the default views: sends the poses' field of view along
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<(u32, u32)>,
    #[command(flatten)]
    pub supervision: Supervision,
}

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

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama scene airport -o airport.glb")]
pub(crate) struct SceneArgs {
    /// Name of the scene: airport
    pub name: String,
    /// The file to write; the camera path goes beside it, as NAME.path.json
    #[arg(short, long, value_name = "FILE.glb")]
    pub output: PathBuf,
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    let limit = proto::limits::VIEW_SIZE_MAX;
    match parsed {
        Some((w, h)) if (1..=limit).contains(&w) && (1..=limit).contains(&h) => Ok((w, h)),
        _ => Err(format!("expected WIDTHxHEIGHT in pixels, each 1 to {limit}, as in 1280x720")),
    }
}

fn file_kind(text: &str) -> Result<compositor::sinks::FileKind, String> {
    compositor::sinks::FileKind::of_extension(text).ok_or_else(|| "expected png, exr or rgb".into())
}

fn simd(text: &str) -> Result<channel::simd::SimdLevel, String> {
    text.parse().map_err(|error: channel::simd::SimdLevelError| error.to_string())
}

fn samples(text: &str) -> Result<proto::view::Samples, String> {
    proto::view::Samples::from_name(text).ok_or_else(|| format!("expected {}", proto::view::Samples::NAMES))
}

fn triple(text: &str) -> Result<[f64; 3], String> {
    let parts: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let finite = parts.filter(|parts| parts.iter().all(|p: &f64| p.is_finite()));
    finite.and_then(|parts| parts.try_into().ok()).ok_or_else(|| "expected three numbers, as in 0.5,0.6,0.7".into())
}

fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n: &f64| n.is_finite() && *n > 0.0);
    number.ok_or_else(|| "expected a number above zero".into())
}

/// Bytes of a number of MiB.
fn mebibytes(text: &str) -> Result<u64, String> {
    positive(text).map(|mib| (mib * f64::from(1 << 20)) as u64).map_err(|_| "expected MiB, above zero".into())
}

fn resolution(text: &str) -> Result<u32, String> {
    match text {
        "1" | "2" | "4" => text.parse().map_err(|error| format!("{error}")),
        _ => Err("expected 1, 2 or 4".into()),
    }
}

fn rate(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n: &f64| (0.01..=10_000.0).contains(n));
    number.ok_or_else(|| "expected frames a second, 0.01 to 10000".into())
}

fn views(text: &str) -> Result<NonZeroU32, String> {
    let most = proto::limits::VIEWS_MAX;
    let number = text.parse().ok().filter(|n: &NonZeroU32| n.get() as usize <= most);
    number.ok_or_else(|| format!("expected 1 to {most}"))
}

fn boards(text: &str) -> Result<NonZeroUsize, String> {
    let most = proto::limits::BOARDS_MAX;
    let number = text.parse().ok().filter(|n: &NonZeroUsize| n.get() <= most);
    number.ok_or_else(|| format!("expected 1 to {most}"))
}

fn console(text: &str) -> Result<Console, String> {
    if text == "off" {
        return Ok(Console::Off);
    }
    text.parse().map(Console::At).map_err(|_| "expected an address like 127.0.0.1:7480, or `off`".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_commands_help_ends_with_an_example() {
        let mut cli = Cli::command();
        for command in cli.get_subcommands_mut() {
            let mut shown = command.get_subcommands().next().unwrap_or(command).clone();
            let help = shown.render_long_help().to_string();
            assert!(help.contains("Example"), "{}", command.get_name());
        }
    }

    #[test]
    fn numbers_that_are_none_are_refused_with_an_example() {
        assert_eq!(size("640x360"), Ok((640, 360)));
        assert!(size("0x5").is_err() && size("640").unwrap_err().contains("1280x720"));
        assert!(triple("1,2").is_err() && triple("nan,0,0").is_err());
        assert_eq!(mebibytes("0.5"), Ok(1 << 19));
        assert!(mebibytes("0").is_err() && mebibytes("lots").unwrap_err().contains("MiB"));
        assert!(positive("-1").is_err() && positive("inf").is_err());
        assert_eq!(console("off"), Ok(Console::Off));
    }
}
