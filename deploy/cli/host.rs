//! Flags of `cyclorama host`.

use super::Supervision;
use super::value::{rate, size};
use clap::{Args, Subcommand};
use std::path::PathBuf;

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
