//! The command line: every flag is defined here once; parsing, `--help` and the tests come from it. A room for each family of commands,
//! and two for what they share: groups of flags (`look`), and how values are read (`value`).

mod bench;
mod daemon;
mod host;
mod keys;
mod look;
mod rig;
mod scene;
mod service;
#[cfg(test)]
mod used;
mod value;

pub(crate) use bench::{
    BenchCommand, ChainArgs, ConsoleArgs, FleetArgs, FlightArgs, LatencyArgs, ListsArgs, OpenArgs, PeerArgs,
    PixelsArgs, WireArgs,
};
pub(crate) use daemon::{ChannelArgs, CompositorArgs, ManagerArgs, Supervision};
pub(crate) use host::{HostCommand, HostPlayArgs};
pub(crate) use keys::{KeysArgs, KeysCommand, KeysInitArgs, KeysIssueArgs, KeysShowArgs, TrustArgs};
pub(crate) use look::{AirArgs, DebugArg, DetailArg, ModeArg, RowArgs, SelectAheadArg};
pub(crate) use rig::{CheckArgs, RigArgs};
pub(crate) use scene::{BakeArgs, InspectArgs, RenderArgs, SceneArgs};
pub(crate) use service::{CompletionsArgs, HealthArgs, ManArgs};
pub(crate) use value::Console;

use clap::{Parser, Subcommand, ValueEnum};

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
}
