//! What `deploy/` hands to others, held against what they read: Kubernetes' own types, systemd, and dpkg.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test suite: a panic is a failure, and what is printed is its report"
)]

mod kubernetes;
mod kustomize;
mod package;
mod systemd;

use std::path::{Path, PathBuf};

/// The folder `deploy`.
fn deploy() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_owned()
}
