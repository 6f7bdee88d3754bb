//! Flags of `cyclorama bench`.

use super::AirArgs;
use super::value::{boards, positive, samples, simd, size, views};
use clap::{Args, Subcommand};
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;

#[derive(Debug, Subcommand)]
pub(crate) enum BenchCommand {
    /// Time to draw scenes, and with --reference their error
    Pixels(Box<PixelsArgs>),
    /// Time to select what views see, by the number of objects, and beside the plainest way
    Lists(ListsArgs),
    /// A long flight: frame times from the median to the worst, and memory
    Flight(FlightArgs),
    /// What travels on a rig's links: list changes with a moving eye, and a still scene's bytes; and what each process takes at rest
    Wire(WireArgs),
    /// How long a flying rig takes to notice that a board has gone, to be whole again, and to take one in
    Chain(ChainArgs),
    /// How long it takes from the host's packet to the swap, in real time
    Latency(LatencyArgs),
    /// What it costs a flying rig that nobody, one or twenty look at its console
    Console(ConsoleArgs),
    /// Time to import a scene, beside that to open what was baked from it
    Open(OpenArgs),
    /// Time for llvmpipe to draw a scene, alone: the peer that `pixels --peer` runs beside
    Peer(PeerArgs),
}

#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama bench pixels city runway --samples 1,64\n  cyclorama bench pixels --peer --reference --reference-size 480x270 --plot charts\n  cyclorama bench pixels overdraw --samples 1 --ablate\n  cyclorama bench pixels model.glb --reference --size 640x360 --poses 1 --diff differences"
)]
pub(crate) struct PixelsArgs {
    /// glTF files, baked files or names of built-in scenes; the five benchmark scenes by default
    pub scenes: Vec<String>,
    /// Camera file for all scenes; each scene's own by default
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Size of the picture, pixels
    #[arg(long, default_value = "1920x1080", value_name = "WxH", value_parser = size)]
    pub size: (u32, u32),
    /// Points per pixel, or exact; one row for each
    #[arg(long, default_value = "1,4,8,16,64", value_delimiter = ',', value_parser = samples)]
    pub samples: Vec<proto::view::Samples>,
    #[command(flatten)]
    pub air: AirArgs,
    /// Threads to draw with
    #[arg(long, default_value = "2", value_name = "N")]
    pub threads: NonZeroUsize,
    /// Instruction set to draw with, the best by default; pictures are the same with all
    #[arg(long, value_name = "LEVEL", value_parser = simd)]
    pub simd: Option<channel::simd::SimdLevel>,
    /// How many poses, spread over the camera path
    #[arg(long, default_value = "10", value_name = "N")]
    pub poses: NonZeroUsize,
    /// Draw also with each skip turned off and with each instruction set, at the first of --samples
    #[arg(long)]
    pub ablate: bool,
    /// Count the instructions of a frame too: each row is drawn again on one thread under valgrind, which takes a hundred times as long
    #[arg(long)]
    pub instructions: bool,
    /// Draw nothing but what is asked for: be the child that instructions are counted of
    #[arg(long, hide = true)]
    pub alone: bool,
    /// Draw everything with llvmpipe too, pose by pose in turn; the background is then constant. Needs Mesa
    #[arg(long)]
    pub peer: bool,
    /// Compare the middle pose's picture with the reference renderer's; slow
    #[arg(long)]
    pub reference: bool,
    /// Size of the pictures that are compared; that of --size by default, where `smoke` takes most of an hour
    #[arg(long, value_name = "WxH", value_parser = size, requires = "reference")]
    pub reference_size: Option<(u32, u32)>,
    /// Write difference pictures into this folder
    #[arg(long, value_name = "DIR", requires = "reference")]
    pub diff: Option<PathBuf>,
    /// Write a chart of error against time per scene into this folder
    #[arg(long, value_name = "DIR", requires = "reference")]
    pub plot: Option<PathBuf>,
    /// Keep the report in this folder, as pixels-DATE-COMMIT.json
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama bench lists --objects 1000,10000 --no-tree\n  cyclorama bench lists --json\n  cyclorama bench lists --fit"
)]
pub(crate) struct ListsArgs {
    /// Objects of the worlds; one block of rows for each
    #[arg(long, default_value = "100,1000,10000,100000,1000000,10000000", value_delimiter = ',', value_name = "N", value_parser = objects)]
    pub objects: Vec<usize>,
    /// Object processors, each a thread; one row for each number, at most 64
    #[arg(long, default_value = "1,2", value_delimiter = ',', value_name = "N")]
    pub processors: Vec<NonZeroUsize>,
    /// Lists that each view's work is mixed to
    #[arg(long, default_value = "2", value_name = "N", value_parser = list_count)]
    pub lists: NonZeroUsize,
    /// Frames that are timed, at 150 m/s and 60 Hz
    #[arg(long, default_value = "60", value_name = "N")]
    pub frames: NonZeroU32,
    /// Run the paper's plain algorithm beside it up to so many objects; its time goes with the square
    #[arg(long, default_value = "10000", value_name = "N")]
    pub plain_objects: usize,
    /// Objects of the tree of which 1 % is in view
    #[arg(long, default_value = "10000000", value_name = "N", value_parser = objects)]
    pub tree_objects: usize,
    /// Leave that tree out: it takes a minute to build, and 3 GB
    #[arg(long)]
    pub no_tree: bool,
    /// Objects of the trees, balanced and lopsided, whose nodes are handed out in three ways
    #[arg(long, default_value = "200000", value_name = "N", value_parser = objects)]
    pub walk_objects: usize,
    /// Draw the benchmark scenes instead, and fit the cost model to the times
    #[arg(long)]
    pub fit: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// A number of objects that a scene may have.
fn objects(text: &str) -> Result<usize, String> {
    let most = proto::limits::OBJECTS_MAX;
    let count: usize = text.parse().map_err(|error| format!("{error}"))?;
    if (1..=most).contains(&count) { Ok(count) } else { Err(format!("from 1 to {most}")) }
}

/// A number of lists of a view: a board each.
fn list_count(text: &str) -> Result<NonZeroUsize, String> {
    let most = proto::limits::BOARDS_MAX;
    let count: NonZeroUsize = text.parse().map_err(|error| format!("{error}"))?;
    if count.get() <= most { Ok(count) } else { Err(format!("from 1 to {most}")) }
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama bench flight airport --seconds 600 --size 640x360 --samples 4")]
pub(crate) struct FlightArgs {
    /// A glTF file, a baked file, or the name of a built-in scene
    #[arg(default_value = "airport")]
    pub scene: String,
    /// Camera file to fly, again and again; the built-in scene's, `SCENE.path.json`, or a flight round the scene by default
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// How long, s
    #[arg(long, default_value = "600", value_name = "S", value_parser = positive)]
    pub seconds: f64,
    /// Size of the picture, pixels
    #[arg(long, default_value = "640x360", value_name = "WxH", value_parser = size)]
    pub size: (u32, u32),
    /// Points per pixel, or exact
    #[arg(long, default_value = "4", value_name = "N", value_parser = samples)]
    pub samples: proto::view::Samples,
    #[command(flatten)]
    pub air: AirArgs,
    /// Threads to draw with
    #[arg(long, default_value = "2", value_name = "N")]
    pub threads: NonZeroUsize,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama bench wire city --views 3 --boards 3 --json")]
pub(crate) struct WireArgs {
    /// A glTF file or the name of a built-in scene
    #[arg(default_value = "city")]
    pub scene: String,
    /// How many views
    #[arg(long, default_value = "3", value_name = "N", value_parser = views)]
    pub views: NonZeroU32,
    /// How many boards
    #[arg(long, default_value = "3", value_name = "N", value_parser = boards)]
    pub boards: NonZeroUsize,
    /// Size of each view, pixels
    #[arg(long, default_value = "320x180", value_name = "WxH", value_parser = size)]
    pub size: (u32, u32),
    /// Frames of the flight, one for each pose of the camera path
    #[arg(long, default_value = "300", value_name = "N", value_parser = clap::value_parser!(u64).range(2..))]
    pub frames: u64,
    /// How long the still scene is watched, s
    #[arg(long, default_value = "10", value_name = "S", value_parser = positive)]
    pub seconds: f64,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// A rig in real time that a benchmark flies.
#[derive(Debug, Args)]
pub(crate) struct FleetArgs {
    /// A glTF file, a baked file, or the name of a built-in scene
    #[arg(default_value = "city")]
    pub scene: String,
    /// How many views
    #[arg(long, default_value = "3", value_name = "N", value_parser = views)]
    pub views: NonZeroU32,
    /// How many boards
    #[arg(long, default_value = "3", value_name = "N", value_parser = boards)]
    pub boards: NonZeroUsize,
    /// Size of each view, pixels; small, for all boards share this machine
    #[arg(long, default_value = "96x54", value_name = "WxH", value_parser = size)]
    pub size: (u32, u32),
    /// Frames a second
    #[arg(long, default_value = "60", value_name = "HZ", value_parser = positive)]
    pub rate: f64,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama bench chain --json\n  cyclorama bench chain --kills 10 --silent 5 --leaves 5 --stalls 5 --restarts 1\n  cyclorama bench chain --flight 600"
)]
pub(crate) struct ChainArgs {
    #[command(flatten)]
    pub fleet: FleetArgs,
    /// How often a board is killed
    #[arg(long, default_value = "200", value_name = "N")]
    pub kills: usize,
    /// How often a board falls silent without closing its links
    #[arg(long, default_value = "50", value_name = "N")]
    pub silent: usize,
    /// How often a board is asked to leave
    #[arg(long, default_value = "50", value_name = "N")]
    pub leaves: usize,
    /// How often a board is stopped for two frame periods while all cores are busy
    #[arg(long, default_value = "50", value_name = "N")]
    pub stalls: usize,
    /// How often the manager is killed and started again
    #[arg(long, default_value = "5", value_name = "N")]
    pub restarts: usize,
    /// Instead of all that, fly for so long, s, with boards killed, stopped, asked to leave and added and their links cut, silent one way, slowed,
    /// limited, reset or without a segment, and compare every view that is shown with an undisturbed flight's
    #[arg(long, value_name = "S", value_parser = positive)]
    pub flight: Option<f64>,
    /// How often something is done in such a flight, s
    #[arg(long, default_value = "5", value_name = "S", value_parser = positive)]
    pub every: f64,
    /// How often a manager that has a stand-by is killed, and how often stopped
    #[arg(long, default_value = "5", value_name = "N")]
    pub standbys: usize,
    /// Which boards, and when, follows from this number
    #[arg(long, default_value = "1", value_name = "N")]
    pub seed: u64,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama bench latency city --seconds 60")]
pub(crate) struct LatencyArgs {
    #[command(flatten)]
    pub fleet: FleetArgs,
    /// How long it flies, s
    #[arg(long, default_value = "600", value_name = "S", value_parser = positive)]
    pub seconds: f64,
    /// One compositor for all views, instead of a display for each
    #[arg(long)]
    pub stitched: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama bench console city --size 480x270 --rounds 60")]
pub(crate) struct ConsoleArgs {
    #[command(flatten)]
    pub fleet: FleetArgs,
    /// How long each turn is timed, s
    #[arg(long, default_value = "3", value_name = "S", value_parser = positive)]
    pub seconds: f64,
    /// Turns with no viewer, one and twenty: single turns scatter by some percent, so that many tell more than long ones
    #[arg(long, default_value = "40", value_name = "N")]
    pub rounds: NonZeroUsize,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama bench open dense")]
pub(crate) struct OpenArgs {
    /// glTF files or names of built-in scenes
    #[arg(default_value = "dense")]
    pub scenes: Vec<String>,
    /// How often each is opened; imported a fifth as often
    #[arg(long, default_value = "25", value_name = "N")]
    pub times: NonZeroUsize,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama bench peer city --poses 60")]
pub(crate) struct PeerArgs {
    /// A glTF file, a baked file, or the name of a built-in scene
    pub scene: String,
    /// Size of the picture, pixels
    #[arg(long, default_value = "1920x1080", value_name = "WxH", value_parser = size)]
    pub size: (u32, u32),
    /// Samples per pixel, one row for each: 0 or what the driver offers
    #[arg(long, default_value = "0,4", value_delimiter = ',', value_name = "N")]
    pub samples: Vec<usize>,
    /// Threads to rasterize with
    #[arg(long, default_value = "2", value_name = "N")]
    pub threads: NonZeroUsize,
    /// How many poses, spread over the camera path
    #[arg(long, default_value = "60", value_name = "N")]
    pub poses: NonZeroUsize,
    /// Be the child of a benchmark: answer on stdout what is asked on stdin
    #[arg(long, hide = true)]
    pub serve: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}
