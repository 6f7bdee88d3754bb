//! Instructions of a frame, counted by valgrind: the same number twice on any machine, however busy it is.
//!
//! This program is run under callgrind with one pose of the path and with two; what the second run does more is two frames (see
//! [`super::entrant`]), whatever loading the scene took. Valgrind knows no AVX-512, so there the instruction set is AVX2 at best.

use crate::cli::PixelsArgs;
use crate::error::CommandError;
use proto::view::Samples;
use std::process::Command;

/// Mean of the first and the middle pose of the scene's path, on one thread.
pub(super) fn of_a_frame(scene: &str, samples: Samples, args: &PixelsArgs) -> Result<u64, CommandError> {
    let [one, two] = [collected(scene, samples, args, 1)?, collected(scene, samples, args, 2)?];
    Ok(two.saturating_sub(one) / 2)
}

/// Instructions of a whole run of that many poses.
fn collected(scene: &str, samples: Samples, args: &PixelsArgs, poses: usize) -> Result<u64, CommandError> {
    let program = std::env::current_exe().map_err(|error| CommandError::said(format!("this program: {error}")))?;
    let mut command = Command::new("valgrind");
    command.args(["--tool=callgrind", "--callgrind-out-file=/dev/null"]).arg(program);
    command.args(["bench", "pixels", scene, "--alone", "--threads", "1", "--json", "--poses", &poses.to_string()]);
    command.args(["--size", &format!("{}x{}", args.size.0, args.size.1), "--samples", &samples.to_string()]);
    if let Some(camera) = &args.camera {
        command.arg("--camera").arg(camera);
    }
    if let Some(level) = args.simd {
        command.args(["--simd", &level.to_string()]);
    }
    let output = command.output().map_err(|error| {
        CommandError::said(format!(
            "valgrind can't be run: {error}; --instructions needs it (Debian: apt-get install valgrind)"
        ))
    })?;
    let said = String::from_utf8_lossy(&output.stderr);
    let count = said.lines().find_map(|line| line.split_once("Collected : ")?.1.trim().parse().ok());
    count.ok_or_else(|| {
        let last = said.lines().last().unwrap_or_default();
        CommandError::said(format!("valgrind said no number of instructions; its last line: {last}"))
    })
}
