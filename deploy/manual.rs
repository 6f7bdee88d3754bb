//! `cyclorama completions` and `cyclorama man`: both follow from the definition of the command line.

use crate::cli::{Cli, CompletionsArgs, ManArgs};
use crate::error::CommandError;
use crate::output::{note, say};
use clap::CommandFactory;
use clap_complete::Shell;

/// `cyclorama completions`.
pub(crate) fn completions(args: &CompletionsArgs) -> Result<(), CommandError> {
    say(script(args.shell)?.trim_end());
    Ok(())
}

fn script(shell: Shell) -> Result<String, CommandError> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "cyclorama", &mut script);
    String::from_utf8(script).map_err(|error| CommandError::said(error.to_string()))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page() {
        let folder = tempfile::tempdir().unwrap();
        let args = ManArgs { folder: folder.path().join("man1") };
        pages(&args).unwrap();
        let page = |name: &str| std::fs::read_to_string(args.folder.join(name)).unwrap();
        assert!(page("cyclorama-channel.1").contains("\\-\\-backplane"), "flags");
        for command in Cli::command().get_subcommands() {
            let name = command.get_name();
            assert!(page("cyclorama.1").contains(name), "the first page names {name}");
            let own = page(&format!("cyclorama-{name}.1"));
            assert!(own.contains("Example") || command.has_subcommands(), "the page of {name} has an example");
            for part in command.get_subcommands() {
                page(&format!("cyclorama-{name}-{}.1", part.get_name()));
            }
        }
    }

    #[test]
    fn completions_know_every_command() {
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish, Shell::Elvish, Shell::PowerShell] {
            let script = script(shell).unwrap();
            for command in Cli::command().get_subcommands() {
                assert!(script.contains(command.get_name()), "{shell}: {}", command.get_name());
            }
        }
    }
}
