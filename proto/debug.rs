//! Debug pictures: what boards draw in place of the picture for who wants to see what drawing it takes, and what their colours mean.
//!
//! Which one it is travels in the frame's state, so all boards change it with the same frame. Boards and console must agree on the colours
//! without saying them: hence they are here. Steps of a count get lighter one by one, so that those who see few hues read them too.

use serde::{Deserialize, Serialize};

/// sRGB-encoded red, green and blue.
pub type Rgb = [u8; 3];

/// What pixels say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DebugPicture {
    /// What is seen: no debug picture.
    #[default]
    Off,
    /// How many faces cover each pixel, seen or hidden.
    Depth,
    /// The picture, tinted by the level of detail that each object is shown at.
    Levels,
    /// By which shortcut each block and pixel was drawn, and what was left out there.
    Skips,
}

/// What a colour, or a mark, means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct LegendEntry {
    /// The colour.
    pub color: Rgb,
    /// How it is put on.
    pub mark: Mark,
    /// What it means.
    pub means: &'static str,
}

/// How a colour is put on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mark {
    /// All over.
    Plain,
    /// In stripes from the lower left to the upper right.
    Stripes,
    /// As a square in the upper left of a block of 8 × 8 pixels.
    Square,
    /// At half the brightness.
    Dark,
}

const fn entry(color: Rgb, means: &'static str) -> LegendEntry {
    LegendEntry { color, mark: Mark::Plain, means }
}

const fn marked(color: Rgb, mark: Mark, means: &'static str) -> LegendEntry {
    LegendEntry { color, mark, means }
}

/// Steps of depth complexity.
const DEPTHS: [LegendEntry; 10] = [
    entry([0, 0, 4], "no face"),
    entry([40, 17, 89], "1 face"),
    entry([84, 15, 109], "2 faces"),
    entry([122, 29, 109], "3 or 4"),
    entry([165, 44, 96], "5 to 8"),
    entry([207, 68, 70], "9 to 16"),
    entry([237, 105, 37], "17 to 32"),
    entry([251, 155, 6], "33 to 64"),
    entry([247, 209, 61], "65 to 128"),
    entry([252, 255, 164], "more"),
];

/// The colour of what so many faces cover.
pub const fn depth_color(faces: u32) -> Rgb {
    // Twice as many, one step more.
    let step = match faces {
        0 => 0,
        more => 1 + (u32::BITS - (more - 1).leading_zeros()) as usize,
    };
    DEPTHS[if step < DEPTHS.len() { step } else { DEPTHS.len() - 1 }].color
}

/// Levels that have colours of their own; the others have that of the last.
const LEVELS_TOLD_APART: usize = 7;

/// Levels of detail, then what isn't one.
const LEVELS: [LegendEntry; LEVELS_TOLD_APART + 2] = [
    entry([0, 158, 115], "level 0, the finest"),
    entry([86, 180, 233], "level 1"),
    entry([240, 228, 66], "level 2"),
    entry([230, 159, 0], "level 3"),
    entry([213, 94, 0], "level 4"),
    entry([204, 121, 167], "level 5"),
    entry([150, 80, 200], "level 6 and coarser"),
    entry(NO_LEVELS, "no levels: the picture in grey"),
    marked([163, 204, 150], Mark::Stripes, "between levels, whose colours are mixed, or fading"),
];

/// The colour of what has no levels of detail, and of the background.
pub const NO_LEVELS: Rgb = [190, 196, 204];

/// The colour of a level of detail; 0 is the finest.
pub const fn level_color(level: usize) -> Rgb {
    LEVELS[if level < LEVELS_TOLD_APART { level } else { LEVELS_TOLD_APART - 1 }].color
}

/// How a pixel was drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// In a block of which no face covers anything.
    Background,
    /// In a block that one face of one colour fills, which is written as such.
    Constant,
    /// In a block that one face fills which is shaded by its normals, 16 pixels at a time.
    ByNormal,
    /// One face, or nothing, at all of its points: shaded once.
    Single,
    /// Several faces, averaged over its points.
    Several,
    /// Translucent layers, or a model between two levels, in front.
    Layers,
}

/// Of [`Way`]s in their order, then marks.
const WAYS: [LegendEntry; 8] = [
    entry([17, 28, 84], "background, the whole block"),
    entry([0, 92, 66], "one face of one colour, the whole block"),
    entry([0, 158, 115], "one face by its normals, the whole block"),
    entry([86, 180, 233], "a pixel that is shaded once"),
    entry([230, 159, 0], "a pixel of several faces, averaged"),
    entry([204, 81, 137], "a pixel behind translucent layers"),
    marked(HIDDEN, Mark::Square, "faces behind what is seen, left out in the block: 1, 4, 16, 64 or more"),
    marked([43, 79, 116], Mark::Dark, "a tile like that of the frame before: not sent again"),
];

/// The colour of the squares that say how many faces were left out.
pub const HIDDEN: Rgb = [255, 255, 255];

/// Side, pixels, of the square of a block in which so many faces are behind what is seen.
pub const fn hidden_side(faces: u32) -> u32 {
    match faces {
        0 => 0,
        1..=3 => 1,
        4..=15 => 2,
        16..=63 => 3,
        _ => 4,
    }
}

/// The colour of pixels that were drawn that way.
pub const fn way_color(way: Way) -> Rgb {
    WAYS[way as usize].color
}

impl DebugPicture {
    /// All, the picture itself first.
    pub const ALL: [Self; 4] = [Self::Off, Self::Depth, Self::Levels, Self::Skips];
    /// Their names, for people.
    pub const NAMES: &str = "off, depth, levels or skips";

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Depth => "depth",
            Self::Levels => "levels",
            Self::Skips => "skips",
        }
    }

    /// The one of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|picture| picture.name() == name)
    }

    /// What its colours mean.
    pub const fn legend(self) -> &'static [LegendEntry] {
        match self {
            Self::Off => &[],
            Self::Depth => &DEPTHS,
            Self::Levels => &LEVELS,
            Self::Skips => &WAYS,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_are_the_steps_that_the_legend_says() {
        let step = |faces| DEPTHS.iter().position(|entry| entry.color == depth_color(faces)).unwrap();
        for (first, last, expected) in [
            (0, 0, 0),
            (1, 1, 1),
            (2, 2, 2),
            (3, 4, 3),
            (5, 8, 4),
            (9, 16, 5),
            (17, 32, 6),
            (33, 64, 7),
            (65, 128, 8),
            (129, u32::MAX, 9),
        ] {
            assert_eq!((step(first), step(last)), (expected, expected), "{first} to {last}");
        }
    }

    #[test]
    fn no_two_colours_of_a_legend_are_alike() {
        for picture in DebugPicture::ALL {
            assert_eq!(DebugPicture::from_name(picture.name()), Some(picture));
            let legend = picture.legend();
            for (k, entry) in legend.iter().enumerate() {
                let is_like = |other: &LegendEntry| (0..3).all(|c| other.color[c].abs_diff(entry.color[c]) < 16);
                assert!(!legend[..k].iter().any(is_like), "{picture:?}: {}", entry.means);
            }
        }
        let brightness = |entry: &LegendEntry| entry.color.iter().map(|c| u32::from(*c)).sum::<u32>();
        assert!(DEPTHS.is_sorted_by_key(brightness), "more faces are brighter");
    }
}
