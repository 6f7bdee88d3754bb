//! Everything that the command prints: results to stdout, complaints and progress to stderr, and the log.
#![expect(clippy::print_stderr, reason = "this is the one place that prints")]

use crate::cli::{Command, LogFormat};
use crate::error::CommandError;
use std::io::{IsTerminal, Write};
use tracing_subscriber::EnvFilter;

/// Starts the log on stderr. Daemons say what happens, the other commands only what goes wrong.
pub(crate) fn start_log(level: Option<&str>, format: LogFormat, command: Option<&Command>) {
    let is_daemon = matches!(command, Some(Command::Manager(_) | Command::Channel(_) | Command::Compositor(_)));
    let default = if is_daemon { "info" } else { "warn" };
    let filter = EnvFilter::try_new(level.unwrap_or(default)).unwrap_or_else(|_| EnvFilter::new(default));
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    // A second start (in tests) keeps the first.
    let _ = match format {
        LogFormat::Text => log.with_ansi(std::io::stderr().is_terminal()).with_target(false).try_init(),
        LogFormat::Json => log.json().flatten_event(true).try_init(),
    };
}

/// An error with its causes, in one line. A cause that the error's own text names already isn't said again.
pub(crate) fn complain(error: &CommandError) {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(error) = cause {
        let said = error.to_string();
        if !text.contains(&said) {
            text = format!("{text}: {said}");
        }
        cause = error.source();
    }
    eprintln!("cyclorama: {}", text.replace('\n', " "));
}

/// A line for people on stderr, where it doesn't mix with results.
pub(crate) fn note(line: &str) {
    eprintln!("{line}");
}

/// A line of result.
pub(crate) fn say(line: &str) {
    let mut out = std::io::stdout().lock();
    // Whoever reads us may have gone away; that is no failure of ours.
    let _ = writeln!(out, "{line}").and_then(|()| out.flush());
}
