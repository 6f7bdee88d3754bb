//! Chance by a seed for the whole process.
//!
//! tokio draws lots where several branches of a `select!` are ready, from a seed that the standard library gets from the system. The library looks the
//! system's function up by its name so that it can be exchanged, and here it is. Building tokio with a seed of ours would be the other way: that
//! needs a flag for every crate, and so everything built twice.
#![expect(unsafe_code, reason = "a function of C with another body")]

use std::ffi::{c_uint, c_void};
use std::sync::atomic::{AtomicU64, Ordering};

static STATE: AtomicU64 = AtomicU64::new(0);

/// From now on what the system calls random follows from `seed`.
pub(crate) fn begin(seed: u64) {
    STATE.store(seed, Ordering::Relaxed);
}

/// `SplitMix64`.
fn next() -> u64 {
    let state = STATE.fetch_add(0x9e37_79b9_7f4a_7c15, Ordering::Relaxed);
    let mixed = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    mixed ^ (mixed >> 31)
}

/// `getrandom(2)` as libc has it: fills `len` bytes at `buffer`, and says how many it has filled.
#[unsafe(no_mangle)]
extern "C" fn getrandom(buffer: *mut c_void, len: usize, _flags: c_uint) -> isize {
    if buffer.is_null() {
        return 0;
    }
    // SAFETY: as for the function whose place this takes, `buffer` points to `len` bytes that the caller may write; it isn't null.
    let bytes = unsafe { std::slice::from_raw_parts_mut(buffer.cast::<u8>(), len) };
    for chunk in bytes.chunks_mut(8) {
        chunk.copy_from_slice(&next().to_le_bytes()[..chunk.len()]);
    }
    len as isize
}
