//! What `bench pixels` measures: a row for each scene, renderer and number of samples.

mod figures;
mod table;

pub use figures::{SCENES, Setting, figures};
pub use table::table;

use crate::Spread;
use serde::{Serialize, Serializer};
use std::fmt;

/// Who drew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Renderer {
    /// We.
    Cyclorama,
    /// The peer.
    Llvmpipe,
    /// Nobody: the frame is written and nothing drawn.
    Memory,
}

impl fmt::Display for Renderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cyclorama => "cyclorama",
            Self::Llvmpipe => "llvmpipe",
            Self::Memory => "memory",
        })
    }
}

/// How a pixel's colour is found. In JSON the number of points, or `"exact"`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampling {
    /// From so many points; 0: llvmpipe without multisampling, which is one point.
    Points(usize),
    /// By area.
    Exact,
}

impl fmt::Display for Sampling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Points(n) => n.fmt(f),
            Self::Exact => f.pad("exact"),
        }
    }
}

impl Serialize for Sampling {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Points(n) => serializer.serialize_u64(*n as u64),
            Self::Exact => serializer.serialize_str("exact"),
        }
    }
}

/// One scene, drawn by one renderer in one way.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The scene's name or file.
    pub scene: String,
    /// Who drew.
    pub renderer: Renderer,
    /// Which options were unlike those that a rig has; `None`: none. Figures are of rows without any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variant: Option<String>,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// `None` where nothing is drawn.
    pub samples: Option<Sampling>,
    /// Threads.
    pub threads: usize,
    /// How many poses were drawn.
    pub poses: usize,
    /// Time of a frame.
    pub ms: Spread,
    /// Instructions of a frame, counted on one thread.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instructions: Option<u64>,
    /// What only we know of ourselves.
    #[serde(flatten)]
    pub work: Option<Work>,
    /// Against the reference, linear full scale: root mean square over edge pixels.
    pub rms_edges: Option<f64>,
    /// … and over all.
    pub rms_all: Option<f64>,
    /// … and the largest error of all.
    pub max_all: Option<f64>,
    /// Against the reference, 1/255 of the encoded value.
    pub errors_255: Option<Errors255>,
}

impl Row {
    /// A row of which nothing but the times is known yet; not of none.
    pub fn timed(scene: &str, renderer: Renderer, samples: Option<Sampling>, times_ms: &[f64]) -> Self {
        Self {
            scene: scene.into(),
            renderer,
            variant: None,
            size: [0; 2],
            samples,
            threads: 1,
            poses: times_ms.len(),
            ms: Spread::of(times_ms),
            instructions: None,
            work: None,
            rms_edges: None,
            rms_all: None,
            max_all: None,
            errors_255: None,
        }
    }
}

/// Where time went, and what was skipped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Work {
    /// Medians over the poses.
    pub stage_ms: StageMs,
    /// Triangles of the selected subobjects; mean over the poses, as all counts here.
    pub triangles: u64,
    /// Triangles that a tile had to look at.
    pub triangles_drawn: u64,
    /// Translucent fragments.
    pub fragments: u64,
    /// Time of the thread that worked longest against the mean of all; 1 is an even share. Median over the poses.
    pub imbalance: f64,
    /// What was not done.
    pub skipped: Skips,
}

/// Medians over the poses; raster to resolve summed over threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[expect(missing_docs, reason = "the stages' names")]
pub struct StageMs {
    pub select: f64,
    pub geometry: f64,
    pub raster: f64,
    pub translucency: f64,
    pub resolve: f64,
}

/// Means over the poses; the names are those of the statistics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[expect(missing_docs, reason = "the names of the statistics")]
pub struct Skips {
    pub culled: u64,
    pub occluded_subobjects: u64,
    pub occluded: u64,
    pub backface: u64,
    pub tiles_opaque: u64,
    pub pixels_single: u64,
}

/// proof.md's measures of one picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors255 {
    /// Root mean square over edge pixels.
    pub edges_rms: f64,
    /// Largest error of an interior pixel.
    pub interior_max: f64,
    /// … that sees no texture.
    pub untextured_max: f64,
    /// 99th percentile where textures are magnified.
    pub magnified_p99: f64,
    /// … and where they are reduced.
    pub minified_p99: f64,
    /// How many edge pixels there are.
    pub edge_pixels: usize,
    /// How many interior pixels see textures.
    pub textured_pixels: usize,
}
