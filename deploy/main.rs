//! The `cyclorama` command: a distributed multichannel image generator. Parses, runs, and maps errors to exit codes
//! (1: failed, 2: usage).
#![forbid(unsafe_code)]

mod bake;
mod bench;
mod check;
mod cli;
mod error;
mod health;
mod host;
mod in_process;
mod keys;
mod manual;
mod output;
mod render;
mod rig;
mod rig_file;
mod serve;
mod settings;
mod source;

use clap::Parser;
use cli::{BenchCommand, Cli, Command, HostCommand};
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = Cli::parse();
    output::start_log(cli.log.as_deref(), cli.log_format, cli.command.as_ref());
    let result = match cli.command.unwrap_or_default() {
        Command::Rig(args) => rig::run(&args),
        Command::Manager(args) => serve::manager(&args),
        Command::Channel(args) => serve::channel(&args),
        Command::Compositor(args) => serve::compositor(&args),
        Command::Keys(args) => keys::run(&args),
        Command::Health(args) => health::run(&args),
        Command::Host(HostCommand::Play(args)) => host::play(&args),
        Command::Render(args) => render::run(&args),
        Command::Bake(args) => bake::run(&args),
        Command::Inspect(args) => source::inspect(&args),
        Command::Scene(args) => source::write_scene(&args),
        Command::Check(args) => check::run(&args),
        Command::Bench(BenchCommand::Pixels(args)) => bench::pixels(&args),
        Command::Bench(BenchCommand::Lists(args)) => bench::lists(&args),
        Command::Bench(BenchCommand::Flight(args)) => bench::flight(&args),
        Command::Bench(BenchCommand::Wire(args)) => bench::wire(&args),
        Command::Bench(BenchCommand::Chain(args)) => bench::chain(&args),
        Command::Bench(BenchCommand::Latency(args)) => bench::latency(&args),
        Command::Bench(BenchCommand::Console(args)) => bench::console(&args),
        Command::Bench(BenchCommand::Open(args)) => bench::open(&args),
        Command::Bench(BenchCommand::Peer(args)) => bench::peer(&args),
        Command::Completions(args) => manual::completions(&args),
        Command::Man(args) => manual::pages(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            output::complain(&error);
            ExitCode::FAILURE
        }
    }
}
