//! Flags of the commands that help to put a rig into service: `health`, `completions`, `man`.

use clap::Args;
use clap_complete::Shell;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  cyclorama health\n  cyclorama health http://127.0.0.1:7480/ready\n  cyclorama health http://desk:7480/api/v1/stats --board pc1\n\nFor containers that have no shell, and for scripts: the exit code is 0 if all is well and 1 if not."
)]
pub(crate) struct HealthArgs {
    /// What to ask, of the manager's console
    #[arg(env = "CYCLORAMA_HEALTH", value_name = "URL", default_value = "http://127.0.0.1:7480/health")]
    pub url: String,
    /// Ask whether the board of this name is in the row (this machine's name if none is given); URL is then that of the statistics
    #[arg(long, value_name = "NAME", num_args = 0..=1, default_missing_value = "", requires = "url")]
    pub board: Option<String>,
    /// How long to wait for an answer, s
    #[arg(long, default_value_t = 3, value_name = "S", value_parser = clap::value_parser!(u64).range(1..=3600))]
    pub timeout: u64,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama completions bash > cyclorama.bash && . ./cyclorama.bash")]
pub(crate) struct CompletionsArgs {
    /// The shell
    #[arg(value_enum)]
    pub shell: Shell,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  cyclorama man man1 && man ./man1/cyclorama.1")]
pub(crate) struct ManArgs {
    /// The folder that they are written into
    pub folder: PathBuf,
}
