//! The console of flying rigs: in a real browser (Chromium, spoken to by its `DevTools` protocol), and as programs use it.
//!
//! Where there is no Chromium the browser's tests say `SKIPPED` and pass. `CYCLORAMA_CHROMIUM` names one elsewhere. With `CYCLORAMA_SCREENSHOTS=docs`
//! `pictures_for_the_docs` writes the pictures of docs/console.md.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test suite: a panic is a failure, and what is printed is its report"
)]

mod access;
mod browser;
mod observe;
#[cfg(feature = "otlp")]
mod otlp;
mod page;
mod stream;

#[path = "../picture/towers.rs"]
mod towers;

#[path = "../rig/program.rs"]
#[allow(dead_code, reason = "what all suites share; each uses a part")]
mod program;
