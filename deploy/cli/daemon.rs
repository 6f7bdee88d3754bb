//! Flags of the daemons: manager, board and compositor.

use super::value::{Console, console, file_kind, mebibytes, place, rate, resolution, shown_view, simd, swap_lead};
use super::{AirArgs, DetailArg, ModeArg, RowArgs, SelectAheadArg, TrustArgs};
use clap::Args;
use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::path::PathBuf;

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
    /// How long before its moment a swap is said to displays, ms, if there are several: enough for the last tiles to come over their links
    #[arg(long, env = "CYCLORAMA_SWAP_LEAD", value_name = "MS", value_parser = swap_lead)]
    pub swap_lead: Option<f64>,
    /// Whether the next frame is selected while boards draw the present one, which costs it a period of latency
    #[arg(long, env = "CYCLORAMA_SELECT_AHEAD", value_enum)]
    pub select_ahead: Option<SelectAheadArg>,
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
    /// Hold the first frame until every view is shown by some compositor; in lock-step every frame
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
    #[command(flatten)]
    pub observed: ObservedArgs,
    #[command(flatten)]
    pub trust: TrustArgs,
    /// Print the statistics as one JSON object at the end
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub supervision: Supervision,
}

/// What a manager is told about who looks at it, whether it is started by hand or by `rig`.
#[derive(Debug, Args)]
pub(crate) struct ObservedArgs {
    /// What somebody must know to change anything at the console, at least 12 characters; better by the environment, for all of this machine
    /// can read a command line. Without it, a console beyond this machine is read-only
    #[arg(long, env = "CYCLORAMA_CONSOLE_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub console_token: Option<String>,
    /// Send every frame as a trace to this collector (OTLP over HTTP, as `http://collector:4318`)
    #[arg(long, env = "CYCLORAMA_OTLP", value_name = "URL")]
    pub otlp: Option<String>,
}

/// How `rig` starts its daemons.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct Supervision {
    /// Report on stdout in JSON lines, and end when stdin ends
    #[arg(long, hide = true)]
    pub supervised: bool,
}

/// Whom boards and the compositor belong to.
#[derive(Clone, Debug, Args)]
pub(crate) struct LeaderArgs {
    /// Where the backplane listens; given twice, or with a comma between: that of the stand-by too
    #[arg(
        long,
        env = "CYCLORAMA_BACKPLANE",
        default_value = "127.0.0.1:7400",
        value_name = "HOST:PORT",
        value_delimiter = ','
    )]
    pub backplane: Vec<String>,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama channel --backplane 127.0.0.1:7400\n  cyclorama channel --backplane desk:7400 --listen 0.0.0.0:0 --keys pc1\n  cyclorama channel --backplane desk:7400 --listen 0.0.0.0:0 --keys pc1 --display 0 --display-at 1920,0 --display-keys wall-1\n  cyclorama channel --backplane desk:7400 --backplane spare:7400 --listen 0.0.0.0:0 --keys pc1"
)]
pub(crate) struct ChannelArgs {
    #[command(flatten)]
    pub leader: LeaderArgs,
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
    /// Be the display of this view too, counted from 0, whoever draws it: in a window
    #[arg(long, env = "CYCLORAMA_DISPLAY", value_name = "N", value_parser = shown_view)]
    pub display: Option<u32>,
    /// Where its window is on the desktop: the upper left corner, for a window without borders
    #[arg(long, env = "CYCLORAMA_DISPLAY_AT", value_name = "X,Y", value_parser = place, requires = "display", allow_hyphen_values = true)]
    pub display_at: Option<compositor::window::Place>,
    /// Show a pattern to set up the projector by, in place of the picture: `compositor --help` says what is on it
    #[arg(long, requires = "display")]
    pub pattern: bool,
    /// Folder with a compositor's keys, for the display: those of a board don't show pictures
    #[arg(long, env = "CYCLORAMA_DISPLAY_KEYS", value_name = "DIR", requires = "display")]
    pub display_keys: Option<PathBuf>,
    #[command(flatten)]
    pub trust: TrustArgs,
    #[command(flatten)]
    pub supervision: Supervision,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama compositor --backplane 127.0.0.1:7400 --out frames\n  cyclorama compositor --views 0 --window=1920,0    # the display of the view on the left, on the second screen\n  cyclorama compositor --views 0 --window=1920,0 --pattern    # the same, to set up its projector\n  cyclorama compositor --backplane desk:7400 --backplane spare:7400 --listen 0.0.0.0:0 --keys wall"
)]
pub(crate) struct CompositorArgs {
    #[command(flatten)]
    pub leader: LeaderArgs,
    /// Where to listen for boards
    #[arg(long, env = "CYCLORAMA_LISTEN", default_value = "127.0.0.1:0", value_name = "ADDR")]
    pub listen: SocketAddr,
    /// Show these views only, counted from 0: be the display of a projector. All by default, as one picture
    #[arg(long, env = "CYCLORAMA_SHOWN_VIEWS", value_name = "N", value_delimiter = ',', value_parser = shown_view)]
    pub views: Vec<u32>,
    /// Show the picture in a window; with =X,Y in one without borders, its upper left corner there on the desktop, as for a projector
    #[arg(long, env = "CYCLORAMA_WINDOW", value_name = "X,Y", num_args = 0..=1, require_equals = true, default_missing_value = "", value_parser = place, allow_hyphen_values = true)]
    pub window: Option<compositor::window::Place>,
    /// Show a pattern to set up projectors by, in place of the picture: borders, lines every 5° that go on from view to view, the view's number, colours and greys, and a
    /// block that runs along the top, at the same place on all displays that show the same frame
    #[arg(long)]
    pub pattern: bool,
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
