//! Pictures of the whole way from file to bytes, by the program itself.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test suite: a panic is a failure, and what is printed is its report"
)]

mod bytes;
mod models;
mod towers;

use std::path::{Path, PathBuf};
use std::process::Command;

/// Draws with the program; panics with its message if it fails. Returns the picture's pixels.
fn render(scene: &Path, args: &[&str]) -> image::RgbImage {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("picture.png");
    let output = Command::new(env!("CARGO_BIN_EXE_cyclorama"))
        .arg("render")
        .arg(scene)
        .args(args)
        .arg("-o")
        .arg(&file)
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}: {}", scene.display(), String::from_utf8_lossy(&output.stderr));
    image::open(file).unwrap().into_rgb8()
}

/// The folder of real models and recordings, or `None` with a loud word.
fn data() -> Option<PathBuf> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("CYCLORAMA_DATA").map_or(default, PathBuf::from);
    if folder.join("models").is_dir() {
        return Some(folder);
    }
    println!("SKIPPED: no models at {}; set CYCLORAMA_DATA", folder.display());
    None
}
