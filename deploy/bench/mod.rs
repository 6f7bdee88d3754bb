//! `cyclorama bench`: figures, as ratios in one run where that is possible, each answer checked before its time counts.
//!
//! What is measured and how it is written lives in `tests/bench`; here it is done: `pixels` is the command, `entrant` are
//! those that draw in it, turn by turn, `flight` draws one path for long, `lists` selects from made-up worlds, `open` opens scenes, `instructions` counts
//! what times can't tell on a busy machine, `truth` says how far their pictures are from the reference, `peer` is the process
//! that llvmpipe draws in; `wire` flies real rigs and counts what travels; `chain` takes the boards of one away and brings others, which `fleet` starts,
//! and `disturbed` does so while every view is compared; `latency` lets such a rig fly and says how long it takes from packet to swap, `console` what it
//! costs it to be looked at.

mod chain;
mod console;
mod disturbed;
mod entrant;
mod fleet;
mod flight;
mod instructions;
mod latency;
mod lists;
mod open;
mod pair;
mod peer;
mod pixels;
mod truth;
mod wire;

pub(crate) use chain::chain;
pub(crate) use console::console;
pub(crate) use flight::flight;
pub(crate) use latency::latency;
pub(crate) use lists::lists;
pub(crate) use open::open;
pub(crate) use peer::peer;
pub(crate) use pixels::pixels;
pub(crate) use wire::wire;

use crate::in_process::look;
use manager::host::camera::{CameraFile, CameraPose};
use std::num::NonZeroUsize;

/// The background of both sides when there is a peer, linear: that of `llvmpipe.py`, which the peer is checked against.
/// The sky is ours alone, so a picture with one could not be compared.
const PEER_BACKGROUND: [f64; 3] = [0.53, 0.70, 0.92];

/// `count` poses, evenly spread over a path.
fn spread(camera: &CameraFile, count: NonZeroUsize) -> Vec<&CameraPose> {
    let all = &camera.poses;
    let count = count.get().min(all.len());
    (0..count).map(|k| &all[k * all.len() / count]).collect()
}
