//! Why a store refuses what comes from outside: each reason by name of the thing and its number.

use crate::texture::TextureError;
use proto::ids::{ContentId, ModelId, ObjectId};
use proto::limits::{LIGHTS_MAX, TRIANGLES_PER_SUBOBJECT_MAX, VERSIONS_MAX};
use thiserror::Error;

use super::TEXCOORD_SETS_MAX;

/// Why something from outside is refused. The store is as it was before.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum StoreError {
    /// An array of per-vertex data has another length than the positions.
    #[error("mesh {mesh}: {found} {what} for {vertices} positions")]
    VertexArray {
        /// Which mesh.
        mesh: ContentId,
        /// Which array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// Number of positions.
        vertices: usize,
    },
    /// A triangle names a vertex that isn't there.
    #[error("mesh {mesh}: triangle {triangle} names vertex {index} of {vertices}")]
    VertexIndex {
        /// Which mesh.
        mesh: ContentId,
        /// Which triangle.
        triangle: usize,
        /// What it names.
        index: u32,
        /// Number of positions.
        vertices: usize,
    },
    /// The face numbers are not one per triangle.
    #[error("mesh {mesh}: {found} face numbers for {triangles} triangles")]
    FaceNumbers {
        /// Which mesh.
        mesh: ContentId,
        /// Number of face numbers.
        found: usize,
        /// Number of triangles.
        triangles: usize,
    },
    /// More triangles than a subobject may have.
    #[error("mesh {mesh}: {triangles} triangles, allowed are {TRIANGLES_PER_SUBOBJECT_MAX}")]
    MeshTooLarge {
        /// Which mesh.
        mesh: ContentId,
        /// Number of triangles.
        triangles: usize,
    },
    /// More texture coordinate sets than allowed.
    #[error("mesh {mesh}: {sets} texture coordinate sets, allowed are {TEXCOORD_SETS_MAX}")]
    TexcoordSets {
        /// Which mesh.
        mesh: ContentId,
        /// Number of sets.
        sets: usize,
    },
    /// A number is NaN or infinite.
    #[error("mesh {mesh}: {what} has a number that is not finite")]
    NotFinite {
        /// Which mesh.
        mesh: ContentId,
        /// In which array or factor.
        what: &'static str,
    },
    /// The texture contradicts itself.
    #[error("texture {texture}: {error}")]
    Texture {
        /// Which texture.
        texture: ContentId,
        /// What is wrong with it.
        #[source]
        error: TextureError,
    },
    /// A subobject names an object that the table doesn't have.
    #[error("subobject {subobject} belongs to object {object} of {objects}")]
    ObjectOutOfRange {
        /// Which row.
        subobject: usize,
        /// What it names.
        object: ObjectId,
        /// Number of objects.
        objects: usize,
    },
    /// A frame moves an object that the table doesn't have.
    #[error("object {object} of {objects} can't be moved")]
    MovedOutOfRange {
        /// Which object.
        object: ObjectId,
        /// Number of objects.
        objects: usize,
    },
    /// A transformation has a number that is NaN or infinite.
    #[error("the transformation of object {object} is not finite")]
    TransformNotFinite {
        /// Which object.
        object: ObjectId,
    },
    /// A subobject names a model or a version that the table doesn't have.
    #[error("subobject {subobject} is a part of version {version} of model {model}, which is not in the table")]
    PartOutOfRange {
        /// Which row.
        subobject: usize,
        /// What it names.
        model: ModelId,
        /// What it names.
        version: u32,
    },
    /// A model has no version, or too many.
    #[error("model {model} has {versions} versions, allowed are 1 to {VERSIONS_MAX}")]
    Versions {
        /// Which model.
        model: ModelId,
        /// How many it has.
        versions: u32,
    },
    /// A plane names an object that isn't there, or has a number that is not finite.
    #[error("plane {plane} names no object of the table or is not finite")]
    Plane {
        /// Which row.
        plane: usize,
    },
    /// The planes of a subobject's faces begin beyond the array's end.
    #[error("subobject {subobject}: its faces' planes begin at {begin} of {found}")]
    FacePlanes {
        /// Which row.
        subobject: usize,
        /// Where they begin.
        begin: u32,
        /// Length of the array.
        found: usize,
    },
    /// A face names a plane that isn't there.
    #[error("a face lies in plane {plane} of {planes}")]
    FacePlane {
        /// What it names.
        plane: u32,
        /// Number of planes.
        planes: usize,
    },
    /// More lights than a scene may have.
    #[error("{lights} lights, allowed are {LIGHTS_MAX}")]
    Lights {
        /// Number of lights.
        lights: usize,
    },
    /// A light has a number that is not finite, or a range or a cone that is none.
    #[error("light {light} has a number that is not finite, or no range or cone")]
    Light {
        /// Which row.
        light: usize,
    },
    /// Weights for a model that the table doesn't have.
    #[error("weights for model {model} of {models}")]
    WeightsOutOfRange {
        /// Which model.
        model: ModelId,
        /// Number of models.
        models: usize,
    },
    /// Weights that are no mixture of a model's versions.
    #[error("the weights of model {model} are more than its versions, not within 0 to 1, or more than 1 in sum")]
    Weights {
        /// Which model.
        model: ModelId,
    },
}
