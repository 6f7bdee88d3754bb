//! What libFuzzer drives: one target, named by `CYCLORAMA_FUZZ`. `tests/fuzz/run` builds and starts it.
#![no_main]

use cyclorama_fuzz::{TARGETS, Target, target};
use std::sync::OnceLock;

static CHOSEN: OnceLock<Target> = OnceLock::new();

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let chosen = CHOSEN.get_or_init(|| {
        let name = std::env::var("CYCLORAMA_FUZZ").unwrap_or_default();
        target(&name).unwrap_or_else(|| {
            let names: Vec<_> = TARGETS.iter().map(|(name, _)| *name).collect();
            panic!("CYCLORAMA_FUZZ is {name:?}, and must be one of {names:?}")
        })
    });
    chosen(bytes);
});
