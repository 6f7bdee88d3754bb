//! Models: layers that are merged, and versions that are mixed (picture.md, "Translucency").
//!
//! Going outward from the eye, a fragment of version v of model g contributes
//!
//! ```text
//! c · α · w_v · T_{g,v} · Π_{h≠g} T_h        T_h = Σ_v w_v T_{h,v}
//! ```
//!
//! where `T_{g,v}` is what the nearer fragments of that version let through. Weights that are less than 1 together are completed
//! by a version that shows nothing, so T is computed as 1 − Σ w (1 − T): 1 to the bit before the first fragment, whatever
//! the weights' rounding. The product leaves g out rather than dividing by g's own T, which may be 0; a sample rarely
//! meets more than a few models. What belongs to no model is a model of its own, and of all such together only the
//! product of their (1 − α) is needed.
//!
//! The order of the factors is that in which a sample meets the models on its way outward: a property of the picture, not
//! of a list.

use super::compose::Through;
use crate::room::room;
use proto::limits::VERSIONS_MAX;

/// What a subobject's fragments belong to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Member<'a> {
    /// Which model.
    pub model: u32,
    /// Index of its version in `weights`.
    pub version: usize,
    /// One weight per version; their sum is 1 at most.
    pub weights: &'a [f64],
    /// Whether only the nearest translucent fragment of each version counts.
    pub merged: bool,
}

/// A model on the way outward.
#[derive(Clone, Copy, Debug)]
struct Open {
    model: u32,
    /// Bit v: a translucent fragment of version v was met.
    met: u32,
    /// What the fragments met let through, by version.
    through: [f64; VERSIONS_MAX],
    /// What they let through together, by weight.
    passed: f64,
}

/// One sample's light on the way outward through models and what belongs to none.
#[derive(Debug, Default)]
pub struct Mix {
    rgb: [f64; 3],
    /// What the fragments of no model let through.
    ordinary: f64,
    open: Vec<Open>,
}

room!(Mix: open; rgb, ordinary);

impl Mix {
    /// Begins at the eye.
    pub fn clear(&mut self) {
        self.rgb = [0.0; 3];
        self.ordinary = 1.0;
        self.open.clear();
    }

    /// Whether a fragment of that part adds nothing and changes nothing, so that its colour needn't be known: its version lets no light
    /// through any more, or a nearer one of its merged version was met.
    pub fn is_lost(&self, part: &Member<'_>, is_translucent: bool) -> bool {
        self.open.iter().find(|open| open.model == part.model).is_some_and(|open| {
            let is_merged_away = part.merged && is_translucent && open.met >> part.version & 1 != 0;
            is_merged_away || open.through[part.version] == 0.0
        })
    }

    /// The next fragment outward: its colour and saturation, and what it belongs to.
    pub fn add(&mut self, part: Option<&Member<'_>>, is_translucent: bool, [r, g, b, alpha]: [f64; 4]) {
        // Saturations are in (0, 1]: what has none is no fragment, nor the nearest of a merged version.
        if alpha == 0.0 {
            return;
        }
        let share = match part {
            None => {
                let share = self.transmitted() * alpha;
                self.ordinary *= 1.0 - alpha;
                share
            }
            Some(part) => {
                let place = self.place(part.model);
                let others = self.open.iter().enumerate().filter(|(k, _)| *k != place);
                let others = others.fold(self.ordinary, |product, (_, open)| product * open.passed);
                let open = &mut self.open[place];
                let share = others * part.weights[part.version] * open.through[part.version] * alpha;
                open.met |= u32::from(is_translucent) << part.version;
                open.through[part.version] *= 1.0 - alpha;
                let held: f64 = part.weights.iter().zip(&open.through).map(|(w, t)| w * (1.0 - t)).sum();
                open.passed = (1.0 - held).max(0.0);
                share
            }
        };
        self.rgb[0] += r * share;
        self.rgb[1] += g * share;
        self.rgb[2] += b * share;
    }

    /// Where a model stands, from now on if it wasn't met before.
    fn place(&mut self, model: u32) -> usize {
        self.open.iter().position(|open| open.model == model).unwrap_or_else(|| {
            self.open.push(Open { model, met: 0, through: [1.0; VERSIONS_MAX], passed: 1.0 });
            self.open.len() - 1
        })
    }

    /// What is let through of the background.
    pub fn transmitted(&self) -> f64 {
        self.open.iter().fold(self.ordinary, |product, open| product * open.passed)
    }

    /// All of it.
    pub fn through(&self) -> Through {
        Through { rgb: self.rgb, transmitted: self.transmitted() }
    }
}
