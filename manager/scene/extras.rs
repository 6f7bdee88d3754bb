//! What a modeller can say about a part of a scene: the scene extras of operations.md, `extras.cyclorama` in a glTF file.
//!
//! They may stand at a node, a mesh, a material or a primitive, and the narrower place wins: what a primitive says beats
//! its material, that beats its mesh, and that beats its node; a node that says nothing has what the node above it
//! has. (A material is wider than a primitive because many primitives share one: "all white paint is layer 2, but not this".)
//!
//! | key | meaning | stands at | inherited |
//! |---|---|---|---|
//! | `layer` | coplanar layer; also `extras.layer` alone | anything | yes |
//! | `merged` | a model whose translucent layers merge: a node and all below, or the so marked parts of one node's mesh | anything | the model is all below |
//! | `surface`, `critical_radius`, `cue`, `static` | kept with the object, see [`Traits`] | node, mesh | yes |
//! | `levels` | a level-of-detail model: names of nodes, finest first | node | no |
//! | `entity` | the host's number for the node | node | no |

use serde::Serialize;

/// What one place says; `None`: nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Extras {
    /// Coplanar layer.
    pub layer: Option<i32>,
    /// Whether the model merges its translucent layers.
    pub merged: Option<bool>,
    /// Whether it is a feature on the ground.
    pub surface: Option<bool>,
    /// Critical radius, m.
    pub critical_radius: Option<f64>,
    /// Whether it keeps its detail under overload.
    pub cue: Option<bool>,
    /// Whether it stands where the file puts it for ever.
    pub is_static: Option<bool>,
    /// Names of the nodes that are its levels of detail, finest first.
    pub levels: Option<Vec<String>>,
    /// The host's number for it.
    pub entity: Option<u64>,
}

impl Extras {
    /// What is in force where `self` is said inside of what `outer` is said about. `merged`, `levels` and `entity` belong
    /// to their own place and don't come from outside.
    #[must_use]
    pub(crate) fn inside(self, outer: &Self) -> Self {
        Self {
            layer: self.layer.or(outer.layer),
            surface: self.surface.or(outer.surface),
            critical_radius: self.critical_radius.or(outer.critical_radius),
            cue: self.cue.or(outer.cue),
            is_static: self.is_static.or(outer.is_static),
            ..self
        }
    }

    /// What detail selection and the shadow maker ask of an object.
    pub(crate) fn traits(&self) -> Traits {
        Traits {
            surface: self.surface.unwrap_or(false),
            critical_radius: self.critical_radius,
            cue: self.cue.unwrap_or(false),
            is_static: self.is_static.unwrap_or(true),
        }
    }
}

/// What an object is like, for whoever chooses its detail or makes its shadow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Traits {
    /// A feature on the ground, whose detail goes by its lying shape and not by its ball.
    pub surface: bool,
    /// The modeller's own critical radius, m; `None`: that of the ball.
    pub critical_radius: Option<f64>,
    /// Keeps its detail under overload.
    pub cue: bool,
    /// Stands for ever; only such objects share planes with others and cast baked shadows.
    pub is_static: bool,
}
