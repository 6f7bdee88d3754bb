//! The corpus runs through its targets, and is what the program makes. It is written anew with
//! `CYCLORAMA_RENEW=1 cargo test -p cyclorama-fuzz`.
#![expect(clippy::unwrap_used, reason = "a test that can't go on has failed")]

use cyclorama_fuzz::{TARGETS, corpus, target};
use std::collections::BTreeMap;
use std::path::PathBuf;

fn folder(target: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target)
}

/// Every file of a target's corpus, by name.
fn files(target: &str) -> BTreeMap<String, Vec<u8>> {
    let Ok(entries) = std::fs::read_dir(folder(target)) else { return BTreeMap::new() };
    let read = |path: PathBuf| (path.file_name().unwrap().to_str().unwrap().to_string(), std::fs::read(&path).unwrap());
    entries.map(|entry| read(entry.unwrap().path())).collect()
}

#[test]
fn the_corpus_is_what_the_program_makes_and_what_was_found() {
    let made = corpus::made();
    if std::env::var_os("CYCLORAMA_RENEW").is_some() {
        for (target, name, bytes) in &made {
            std::fs::create_dir_all(folder(target)).unwrap();
            std::fs::write(folder(target).join(name), bytes).unwrap();
        }
    }
    for target in made.iter().map(|(target, ..)| *target) {
        for name in files(target).keys().filter(|name| !name.starts_with("found-")) {
            assert!(
                made.iter().any(|(of, made, _)| (*of, made) == (target, name)),
                "{target}/{name} isn't made any more"
            );
        }
    }
    for (target, name, bytes) in &made {
        assert!(files(target).get(name) == Some(bytes), "{target}/{name} is not what the program makes");
    }
}

#[test]
fn every_input_of_the_corpus_and_its_damaged_twins_are_decoded_rightly_or_refused() {
    let mut runs = 0;
    for (name, run) in TARGETS {
        let files = files(name);
        for bytes in files.values() {
            run(bytes);
            runs += 1;
            // Cut off at every place, and with every byte changed.
            for at in (0..bytes.len()).step_by(1 + bytes.len() / 500) {
                run(&bytes[..at]);
                let mut damaged = bytes.clone();
                damaged[at] ^= 0x81;
                run(&damaged);
                runs += 2;
            }
        }
        assert!(!files.is_empty() || cfg!(feature = "scenes"), "{name} has nothing to begin with");
    }
    assert!(runs > 5000 && target("to-board").is_some(), "{runs} inputs");
}
