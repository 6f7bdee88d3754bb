//! What `bench lists` measures: selections of made-up worlds, the paper's plain algorithm beside them, and ways to hand out nodes.

mod figures;
mod operations;
pub mod paper;
mod table;

pub use figures::figures;
pub use operations::{Counted, PLANES, POINTS, comparison, ours};
pub use table::table;

use crate::Spread;
use paper::Operations;
use serde::Serialize;
use std::fmt;

/// What is timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// A frame's selection.
    Frame,
    /// The same by the paper's plain algorithm.
    Plain,
    /// A tree of which little is in view.
    Tree,
    /// What is in view of that tree, in a tree of its own.
    TreeAlone,
    /// The walk by several processors; the other stages are not in the time.
    Walk,
}

/// What changes from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// The eye, and one object in a hundred.
    Eye,
    /// One object in a hundred.
    Objects,
    /// Nothing.
    Nothing,
}

impl fmt::Display for What {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Frame => "frame",
            Self::Plain => "plain",
            Self::Tree => "tree",
            Self::TreeAlone => "tree alone",
            Self::Walk => "walk",
        })
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Eye => "eye",
            Self::Objects => "objects",
            Self::Nothing => "nothing",
        })
    }
}

/// Medians of a frame's stages, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Stages {
    /// The tree, and what moved.
    pub walk: f64,
    /// Overlaps, groups, mixing.
    pub mark: f64,
    /// Powers of subobjects.
    pub gather: f64,
    /// Sorting.
    pub sort: f64,
    /// Merging.
    pub merge: f64,
}

/// One measurement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// What was timed.
    pub what: What,
    /// Objects in the world.
    pub objects: usize,
    /// What changed from frame to frame.
    pub change: Change,
    /// Object processors, each a thread.
    pub processors: usize,
    /// Lists of a view.
    pub lists: usize,
    /// How nodes were handed out, and in which tree, where that is compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variant: Option<String>,
    /// Display elements below which objects are dropped.
    pub least_elements: Option<f64>,
    /// Of a frame, all views together.
    pub ms: Spread,
    /// The same as the time that the processor gave to it: what the clock would say on a machine of one's own. With one thread only.
    pub cpu_ms: Option<Spread>,
    /// By stage, of the frame in the middle.
    pub stage_ms: Option<Stages>,
    /// Objects in view, dropped ones included; all views.
    pub in_view: u64,
    /// Objects selected; all views.
    pub visible: u64,
    /// Subobjects in the lists; all views.
    pub subobjects: u64,
    /// Objects that overlap another, in any view.
    pub overlapping: u64,
    /// Groups of more than one.
    pub groups: u64,
    /// What the database holds, and what selection keeps beside it, bytes per object.
    pub bytes_per_object: f64,
    /// Operations of ours as counted, and of the paper's formulas for as many objects. Of one frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub operations: Option<[Operations; 2]>,
}
