//! `cyclorama completions` and `cyclorama man`: both follow from the definition of the command line.

use crate::cli::{Cli, CompletionsArgs, ManArgs};
use crate::error::CommandError;
use crate::output::{note, say};
use clap::CommandFactory;

/// `cyclorama completions`.
pub(crate) fn completions(args: &CompletionsArgs) -> Result<(), CommandError> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "cyclorama", &mut script);
    let script = String::from_utf8(script).map_err(|error| CommandError::said(error.to_string()))?;
    say(script.trim_end());
    Ok(())
}

/// `cyclorama man`: one page for each command, as `cyclorama-host-play.1`.
pub(crate) fn pages(args: &ManArgs) -> Result<(), CommandError> {
    let folder = &args.folder;
    let failed = |error| CommandError::file(folder, error);
    std::fs::create_dir_all(folder).map_err(failed)?;
    // The terminal's width isn't the page's.
    clap_mangen::generate_to(Cli::command().disable_help_subcommand(true).term_width(0), folder).map_err(failed)?;
    note(&format!("man {}/cyclorama.1 shows the first", folder.display()));
    Ok(())
}
