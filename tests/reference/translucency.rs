//! How the fragments at a point add up: picture.md, "Translucency", term by term.
//!
//! Going outward from the eye, a fragment of version v of model g contributes
//!
//! ```text
//! c · α · w_v · T_{g,v} · Π_{h≠g} T_h        T_h = Σ_v w_v T_{h,v}
//! ```
//!
//! where T_{g,v} is the product of (1 − α) over the fragments of that version nearer than this one; the background gets
//! `Π T_h`. A fragment that belongs to no model is a model of its own with one version: its own T is 1, so it
//! contributes c · α · Π T, and of all such together no more is needed than the product of their (1 − α). That is the
//! ordinary front-to-back "over", and consequence *(b)*.
//!
//! A *merged* model counts only its nearest translucent fragment per version; opaque ones count as ever.

/// A model whose faces are not each a layer of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// The weight of each version. What is missing to a sum of 1 is a version that shows nothing. A model with one
    /// version has `[1.0]`.
    pub weights: Vec<f64>,
    /// Whether only the nearest translucent fragment of each version counts.
    pub merged: bool,
}

/// Which version of which model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Member {
    /// Index of the model.
    pub model: usize,
    /// Index of the version.
    pub version: usize,
}

/// What one face contributes at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fragment {
    /// Larger is farther.
    pub depth: f64,
    /// Of two that are equally far, the larger is in front: (layer, primitive, face).
    pub rank: (i32, u32, u32),
    /// Linear RGB.
    pub color: [f64; 3],
    /// Saturation, 0..=1.
    pub alpha: f64,
    /// Whether the face is opaque rather than translucent with a saturation that may be 1.
    pub is_opaque: bool,
    /// What it belongs to.
    pub member: Option<Member>,
}

/// A model's state on the way outward.
struct Open {
    model: usize,
    /// T_{g,v} by version.
    through: Vec<f64>,
    /// Versions of which a translucent fragment was met.
    met: Vec<bool>,
}

/// The colour at a point with these fragments, in any order, before `background`.
///
/// # Panics
/// If a fragment names a model or a version that `models` doesn't have.
pub fn composite(fragments: &[Fragment], models: &[Model], background: [f64; 3]) -> [f64; 3] {
    let mut sorted = fragments.to_vec();
    sorted.sort_by(|a, b| a.depth.total_cmp(&b.depth).then(b.rank.cmp(&a.rank)));
    composite_sorted(&sorted, models, background)
}

/// The same for fragments that are in order, nearest first.
///
/// # Panics
/// As [`composite`].
pub fn composite_sorted(fragments: &[Fragment], models: &[Model], background: [f64; 3]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let mut ordinary = 1.0;
    let mut open: Vec<Open> = Vec::new();
    for fragment in fragments {
        let others = ordinary * through_models(&open, models, fragment.member.map(|member| member.model));
        let share = match fragment.member {
            None => {
                ordinary *= 1.0 - fragment.alpha;
                others
            }
            Some(Member { model, version }) => {
                let Model { weights, merged } = &models[model];
                let place = open.iter().position(|entry| entry.model == model).unwrap_or_else(|| {
                    let count = weights.len();
                    open.push(Open { model, through: vec![1.0; count], met: vec![false; count] });
                    open.len() - 1
                });
                let entry = &mut open[place];
                if *merged && !fragment.is_opaque && std::mem::replace(&mut entry.met[version], true) {
                    continue;
                }
                let share = others * weights[version] * entry.through[version];
                entry.through[version] *= 1.0 - fragment.alpha;
                share
            }
        };
        add(&mut sum, fragment.color, share * fragment.alpha);
    }
    add(&mut sum, background, ordinary * through_models(&open, models, None));
    sum
}

/// `Π T_h` over all models met, except one.
fn through_models(open: &[Open], models: &[Model], except: Option<usize>) -> f64 {
    let of = |entry: &Open| -> f64 {
        let weights = &models[entry.model].weights;
        let nothing = (1.0 - weights.iter().sum::<f64>()).max(0.0);
        nothing + weights.iter().zip(&entry.through).map(|(w, t)| w * t).sum::<f64>()
    };
    open.iter().filter(|entry| Some(entry.model) != except).map(of).product()
}

fn add(sum: &mut [f64; 3], color: [f64; 3], share: f64) {
    // Nothing of an infinitely bright colour is nothing.
    if share != 0.0 {
        for (sum, c) in sum.iter_mut().zip(color) {
            *sum += c * share;
        }
    }
}
