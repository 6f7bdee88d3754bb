//! What is looked at and how: flags that commands with pictures have in common.

use super::value::{positive, samples, size, triple, views};
use clap::{Args, ValueEnum};
use serde::Deserialize;
use std::num::NonZeroU32;

/// How a view is shared between boards.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum ModeArg {
    /// Every k-th tile of a skewed lattice
    #[default]
    Interleave,
    /// A rectangle each
    Region,
}

impl From<ModeArg> for proto::view::Mode {
    fn from(mode: ModeArg) -> Self {
        match mode {
            ModeArg::Interleave => Self::Interleave,
            ModeArg::Region => Self::Region,
        }
    }
}

/// A debug picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum DebugArg {
    /// The picture itself
    #[default]
    Off,
    /// How many faces cover each pixel
    Depth,
    /// Levels of detail
    Levels,
    /// Skipped work
    Skips,
}

impl From<DebugArg> for proto::debug::DebugPicture {
    fn from(debug: DebugArg) -> Self {
        match debug {
            DebugArg::Off => Self::Off,
            DebugArg::Depth => Self::Depth,
            DebugArg::Levels => Self::Levels,
            DebugArg::Skips => Self::Skips,
        }
    }
}

/// Whether selection goes ahead of the tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SelectAheadArg {
    /// When a period isn't enough for selecting and drawing
    #[default]
    Auto,
    /// In every frame
    Always,
    /// The rate falls instead
    Never,
}

impl From<SelectAheadArg> for manager::backplane::SelectAhead {
    fn from(ahead: SelectAheadArg) -> Self {
        match ahead {
            SelectAheadArg::Auto => Self::Auto,
            SelectAheadArg::Always => Self::Always,
            SelectAheadArg::Never => Self::Never,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum DetailArg {
    /// Levels of detail by what they span on the picture
    #[default]
    Auto,
    /// All at their finest and unfaded
    Finest,
}

impl DetailArg {
    /// As the flag that says it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Finest => "finest",
        }
    }
}

impl From<DetailArg> for manager::select::DetailMode {
    fn from(detail: DetailArg) -> Self {
        match detail {
            DetailArg::Auto => Self::Auto,
            DetailArg::Finest => Self::Finest,
        }
    }
}

/// What the views look like, for `rig` and `manager`.
#[derive(Clone, Debug, Args)]
pub(crate) struct RowArgs {
    /// How many views stand side by side
    #[arg(long, env = "CYCLORAMA_VIEWS", value_name = "N", value_parser = views)]
    pub views: Option<NonZeroU32>,
    /// Size of each view, pixels
    #[arg(long, env = "CYCLORAMA_SIZE", value_name = "WxH", value_parser = size)]
    pub size: Option<(u32, u32)>,
    /// Points looked at in each pixel: 1, 4, 8, 16 or 64; or exact: areas instead of points
    #[arg(long, env = "CYCLORAMA_SAMPLES", value_name = "N", value_parser = samples)]
    pub samples: Option<proto::view::Samples>,
}

/// Light and air.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct AirArgs {
    /// A constant background, linear light, instead of the sky
    #[arg(long, value_name = "R,G,B", value_parser = triple)]
    pub background: Option<[f64; 3]>,
    /// Direction towards the sun, world frame
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    pub sun: Option<[f64; 3]>,
    /// Visibility range: what is this far away is 98 % faded, m
    #[arg(long, value_name = "M", value_parser = positive)]
    pub visibility: Option<f64>,
    /// Colour that things fade to, linear light, instead of the horizon's
    #[arg(long, value_name = "R,G,B", value_parser = triple)]
    pub fog: Option<[f64; 3]>,
    /// Let the lights of the scene's file shine too
    #[arg(long)]
    pub scene_lights: bool,
}
