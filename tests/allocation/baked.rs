//! What a baked file can make its reader reserve: a small multiple of the file's own length, whatever the file says.
//!
//! In a binary of its own, because the allocator that counts is the whole process's.
#![allow(clippy::unwrap_used, reason = "a test suite: a panic is a failure")]

use cyclorama_manager::scene::split::{Primitive, split};
use cyclorama_manager::scene::{Extras, NodeSource, Parts, PieceSource, Scene, baked};
use proto::scene::Material;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use std::ops::ControlFlow;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Bytes that opening may ask for in all, for each byte of the file: what it copies, makes of it, and lets go again.
const PER_BYTE: usize = 32;
/// And whatever the file's length: threads, messages.
const ANYWAY: usize = 1 << 18;

/// Sections of a file; header and each entry of the index have 64 bytes.
const SECTIONS: usize = 17;

fn file() -> Vec<u8> {
    let mut parts = Parts { name: "scene".into(), ..Parts::default() };
    parts
        .materials
        .push(cyclorama_manager::scene::MaterialEntry { name: "paint".into(), material: Material::default() });
    let primitive = Primitive {
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        triangles: vec![[0, 1, 2]],
        ..Primitive::default()
    };
    let shape = parts.add_shape("t", Extras::default(), PieceSource::plain(split(&primitive), 0));
    let node =
        |i: u32| NodeSource { name: format!("node {i}"), parent: i.checked_sub(1), shape, ..NodeSource::default() };
    parts.nodes = (0..40).map(node).collect();
    let scene = Scene::assemble(parts.clone()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.baked");
    baked::write(&parts, &scene, &path, &mut |_| ControlFlow::Continue(())).unwrap();
    std::fs::read(path).unwrap()
}

/// Makes the checksums right again: of tables within the file, and of header and index.
fn vouch(bytes: &mut [u8]) {
    for entry in (1..=SECTIONS).map(|at| 64 * at) {
        let word = |k: usize| u64::from_le_bytes(bytes[entry + 8 * k..][..8].try_into().unwrap()) as usize;
        let range = word(1)..word(1).saturating_add(word(2));
        let is_payload = bytes[entry + 32..entry + 64] == [0; 32];
        if let Some(content) = bytes.get(range).filter(|_| !is_payload) {
            let checksum = *blake3::hash(content).as_bytes();
            bytes[entry + 32..entry + 64].copy_from_slice(&checksum);
        }
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update(&bytes[..32]).update(&bytes[64..64 * (SECTIONS + 1)]);
    let checksum = *hasher.finalize().as_bytes();
    bytes[32..64].copy_from_slice(&checksum);
}

/// Opens the file and uses all of it; returns whether it was opened.
fn measured(bytes: &[u8], what: &dyn Fn() -> String) -> bool {
    let copy = bytes.to_vec();
    let region = Region::new(ALLOCATOR);
    let opened = baked::open_bytes(copy, "scene.baked").map(|scene| baked::check_all(&scene).is_ok());
    let asked = region.change().bytes_allocated;
    let allowed = PER_BYTE * bytes.len() + ANYWAY;
    assert!(asked <= allowed, "{} bytes were asked for, {allowed} are allowed: {}", asked, what());
    opened.is_ok()
}

#[test]
fn no_file_makes_its_reader_reserve_more_than_a_small_multiple_of_its_length() {
    let good = file();
    // The first use of a pool of threads starts it.
    baked::open_bytes(good.clone(), "warm-up").unwrap();
    assert!(measured(&good, &|| "the file itself".into()));

    let mut opened = 0;
    let mut tried = 0;
    let mut attempt = |bytes: &mut [u8], what: &dyn Fn() -> String| {
        vouch(bytes);
        tried += 1;
        opened += usize::from(measured(bytes, what));
    };
    // Counts and lengths of sections.
    for entry in (1..=SECTIONS).map(|at| 64 * at) {
        for word in [1, 2, 3] {
            for value in [1u64 << 20, 1 << 31, 1 << 40, u64::MAX] {
                let mut bytes = good.clone();
                let at = entry + 8 * word;
                bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
                attempt(&mut bytes, &|| format!("word {word} of the entry at {entry} is {value}"));
            }
        }
    }
    // Every number of every table.
    for entry in (1..=SECTIONS).map(|at| 64 * at) {
        let word = |k: usize| u64::from_le_bytes(good[entry + 8 * k..][..8].try_into().unwrap()) as usize;
        for at in (word(1)..word(1) + word(2)).step_by(4).filter(|at| at + 4 <= good.len()) {
            for value in [1u32 << 12, 1 << 24, 1 << 31, u32::MAX - 1] {
                let mut bytes = good.clone();
                bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
                attempt(&mut bytes, &|| format!("the number at byte {at} is {value}"));
            }
        }
    }
    assert!(opened > 100 && opened < tried, "{opened} of {tried} files were opened: both kinds must occur");
}
