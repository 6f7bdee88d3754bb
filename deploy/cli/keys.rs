//! Flags about trust: the command `keys`, and what daemons say of their links.

use clap::{Args, Subcommand, ValueEnum};
use link::NodeRole;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// How a daemon's links are protected.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct TrustArgs {
    /// Folder of this node's keys, made by `cyclorama keys issue`: all its links are encrypted, and both ends prove who they are
    #[arg(long, env = "CYCLORAMA_KEYS", value_name = "DIR")]
    pub keys: Option<PathBuf>,
    /// Allow addresses beyond this machine for what isn't encrypted: links without --keys, pose packets, the console
    #[arg(long)]
    pub insecure: bool,
}

#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "Examples:\n  cyclorama keys rig-keys --boards 5\n  cyclorama keys rig-keys --board pc1,pc2,left-wall\n  cyclorama keys issue rig-keys/authority --role board --name pc3 --out rig-keys/pc3\n\nKeys that are there already are kept, so the same command with more boards adds what is missing."
)]
pub(crate) struct KeysArgs {
    /// Make a whole rig's keys in this folder: `authority`, and a folder each for `manager`, `compositor` and the boards
    #[arg(required = true)]
    pub folder: Option<PathBuf>,
    /// How many boards, called board-1, board-2 …; 3 if none are named
    #[arg(long, value_name = "N", value_parser = super::value::boards, conflicts_with = "board")]
    pub boards: Option<NonZeroUsize>,
    /// Names of the boards. Boards that share one machine can share one name
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = board_name)]
    pub board: Vec<String>,
    /// How long the nodes' keys can be used, days
    #[arg(long, default_value_t = 365, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=36_500))]
    pub days: u32,
    /// Issue the nodes' keys anew, in place of those that are there; the authority stays
    #[arg(long)]
    pub renew: bool,
    #[command(subcommand)]
    pub command: Option<KeysCommand>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum KeysCommand {
    /// Make a rig's authority alone: what all its keys are issued by
    Init(KeysInitArgs),
    /// Issue keys for one node, or new ones in place of its old ones
    Issue(KeysIssueArgs),
    /// Say what is in a folder of keys, and until when it can be used
    Show(KeysShowArgs),
}

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  cyclorama keys init authority\n\nKeep the folder where no rig runs: who has it can issue keys for any node."
)]
pub(crate) struct KeysInitArgs {
    /// The folder to make it in
    pub folder: PathBuf,
    /// How long its certificate holds, days
    #[arg(long, default_value_t = 3650, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=36_500))]
    pub days: u32,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama keys issue authority --role manager --name desk --out desk\n  cyclorama keys issue authority --role board --name pc1 --out pc1 --days 90\n\nCopy the folder to the node and nowhere else. Running daemons take new keys from it by themselves."
)]
pub(crate) struct KeysIssueArgs {
    /// The authority's folder
    pub authority: PathBuf,
    /// What the node is
    #[arg(long, value_enum)]
    pub role: RoleArg,
    /// What it is called: small letters, digits and hyphens. Nodes of one name can speak for each other
    #[arg(long, value_parser = node_name)]
    pub name: String,
    /// The folder that the keys go into
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// How long they can be used, days
    #[arg(long, default_value_t = 365, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=36_500))]
    pub days: u32,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama keys show pc1")]
pub(crate) struct KeysShowArgs {
    /// A node's folder, or the authority's
    pub folder: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// What keys are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum RoleArg {
    /// The scene manager
    Manager,
    /// A board (`cyclorama channel`)
    Board,
    /// The compositor
    Compositor,
}

impl From<RoleArg> for NodeRole {
    fn from(role: RoleArg) -> Self {
        match role {
            RoleArg::Manager => Self::Manager,
            RoleArg::Board => Self::Board,
            RoleArg::Compositor => Self::Compositor,
        }
    }
}

fn node_name(text: &str) -> Result<String, String> {
    let right = "small letters, digits and hyphens, at most 63, with a letter or digit at both ends";
    if link::is_node_name(text) { Ok(text.to_owned()) } else { Err(format!("expected {right}, like left-wall-2")) }
}

/// A board's name, which is its folder's too.
fn board_name(text: &str) -> Result<String, String> {
    match node_name(text)?.as_str() {
        taken @ ("authority" | "manager" | "compositor") => Err(format!("the folder {taken} is for another's keys")),
        name => Ok(name.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::{board_name, node_name};

    #[test]
    fn a_name_that_is_none_is_refused_with_an_example() {
        assert_eq!(node_name("pc1"), Ok("pc1".into()));
        assert!(node_name("PC 1").unwrap_err().contains("left-wall-2"));
        assert_eq!(board_name("pc1"), Ok("pc1".into()));
        assert!(board_name("manager").unwrap_err().contains("another's"));
    }
}
