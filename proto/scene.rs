//! The scene as it travels: textures and subobject meshes by content, and the tables that place them.
//!
//! A *subobject* is the unit of work that a list names: a piece of a mesh primitive with at most
//! [`TRIANGLES_PER_SUBOBJECT_MAX`](crate::limits::TRIANGLES_PER_SUBOBJECT_MAX) triangles, a material and tight bounds. An *object* is a
//! node that carries a mesh; its transformation is shared by all of its subobjects.

use crate::ids::{ContentId, ModelId, ObjectId};
use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize};

/// A ball that encloses something.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sphere {
    /// Centre, m.
    pub centre: DVec3,
    /// Radius, m; negative when nothing is enclosed.
    pub radius: f64,
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Box3 {
    /// Smallest coordinates, m.
    pub min: DVec3,
    /// Largest coordinates, m.
    pub max: DVec3,
}

/// How a texture goes on beyond its border.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Wrap {
    /// Repeats.
    #[default]
    Repeat,
    /// Repeats, every other time mirrored.
    Mirror,
    /// The border's texel.
    Clamp,
}

/// How a texture is read between texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Filter {
    /// Linear interpolation.
    #[default]
    Linear,
    /// The nearest texel.
    Nearest,
}

/// A picture on a surface. RGBA, 8 bits a channel, colour encoded as sRGB and alpha linear; row-major, tightly packed,
/// the first row at v = 0.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Texture {
    /// Width in texels, 1 to [`TEXTURE_SIZE_MAX`](crate::limits::TEXTURE_SIZE_MAX).
    pub width: u32,
    /// Height in texels, likewise.
    pub height: u32,
    /// `width × height` texels.
    pub texels: Vec<[u8; 4]>,
}

/// One use of a texture by a material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TextureUse {
    /// Which texture.
    pub texture: ContentId,
    /// Index into [`Mesh::texcoords`]; a mesh without that set has (0, 0) everywhere.
    pub set: u32,
    /// `KHR_texture_transform` as a matrix of two rows: u' = row0 · (u, v, 1), v' = row1 · (u, v, 1).
    pub transform: [[f32; 3]; 2],
    /// Beyond the left and right border.
    pub wrap_u: Wrap,
    /// Beyond the upper and lower border.
    pub wrap_v: Wrap,
    /// When a texel is larger than a pixel.
    pub magnify: Filter,
}

/// The texture transformation that changes nothing.
pub const TRANSFORM_IDENTITY: [[f32; 3]; 2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// What alpha means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Alpha {
    /// Nothing: the surface is opaque.
    #[default]
    Opaque,
    /// The surface exists where alpha is at least the cut-off.
    Mask {
        /// The cut-off.
        cutoff: f32,
    },
    /// Alpha is the surface's saturation.
    Blend,
}

/// What a surface looks like.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Base colour, linear RGB, and alpha; each in 0..=1.
    pub base_color: [f32; 4],
    /// Multiplies the base colour.
    pub base_texture: Option<TextureUse>,
    /// Added to the lit colour, linear RGB.
    pub emissive: [f32; 3],
    /// Multiplies the emissive colour.
    pub emissive_texture: Option<TextureUse>,
    /// What alpha means.
    pub alpha: Alpha,
    /// Whether it is seen from behind.
    pub double_sided: bool,
    /// Whether light is ignored (`KHR_materials_unlit`).
    pub unlit: bool,
}

impl Default for Material {
    /// glTF's default material: white, opaque, single-sided.
    fn default() -> Self {
        Self {
            base_color: [1.0; 4],
            base_texture: None,
            emissive: [0.0; 3],
            emissive_texture: None,
            alpha: Alpha::Opaque,
            double_sided: false,
            unlit: false,
        }
    }
}

/// A subobject's geometry and material, in the mesh's own space (counter-clockwise is front).
///
/// The true position of vertex i is `origin + positions[i]`, added in f64; the importer chooses `origin` so that this is
/// *exactly* the coordinate in the file, and pieces of one mesh that share a vertex therefore agree on it to the bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mesh {
    /// Local origin, m.
    pub origin: DVec3,
    /// Vertices relative to `origin`, m.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals, as many as positions; zero where the face's own normal counts. Empty: flat throughout.
    pub normals: Vec<[f32; 3]>,
    /// Vertex colours, linear RGBA, as many as positions. Empty: white.
    pub colors: Vec<[f32; 4]>,
    /// Texture coordinate sets, each as many as positions. At most two.
    pub texcoords: Vec<Vec<[f32; 2]>>,
    /// Three vertex indices per triangle.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle its number in the primitive of the file; where faces coincide the later wins.
    pub face_numbers: Vec<u32>,
    /// The surface.
    pub material: Material,
    /// Encloses all vertices; mesh space.
    pub sphere: Sphere,
    /// Encloses all vertices; mesh space.
    pub bounds: Box3,
}

impl Mesh {
    /// Vertex i in mesh space, m.
    pub fn position(&self, i: usize) -> DVec3 {
        let p = self.positions[i];
        self.origin + DVec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]))
    }
}

/// One row of the object table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectRow {
    /// Mesh space → world.
    pub transform: DAffine3,
}

/// One row of the subobject table.
///
/// Where faces coincide, the one with the larger (layer, primitive, face number) wins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SubobjectRow {
    /// Whose transformation.
    pub object: ObjectId,
    /// Which geometry.
    pub mesh: ContentId,
    /// Number of the primitive that it is a piece of, counted over all objects in the order of the file.
    pub primitive: u32,
    /// Coplanar layer; a higher one is painted over a lower one.
    pub layer: i32,
    /// The model that it is a part of, if that merges layers or has versions.
    pub part_of: Option<ModelPart>,
    /// Where the planes of its faces begin in [`SceneTable::face_planes`]; `None`: no face lies over another.
    pub planes: Option<u32>,
}

/// A place in a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ModelPart {
    /// Which model.
    pub model: ModelId,
    /// Which of its versions, 0 the finest.
    pub version: u32,
}

/// One row of the model table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelRow {
    /// Only the nearest translucent fragment of each version counts (smoke, cloud).
    pub merged: bool,
    /// Number of versions, at least one.
    pub versions: u32,
}

/// One row of the plane table: n · p = offset in an object's mesh space. All faces of the plane take their depth from it, so
/// that their order is that of their layers and not of rounding.
///
/// It holds for a face as long as neither the face's object nor the plane's is elsewhere than the table says, or they are the
/// same object.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlaneRow {
    /// In whose mesh space.
    pub object: ObjectId,
    /// Unit normal.
    pub normal: DVec3,
    /// Distance from the origin along the normal, m.
    pub offset: f64,
}

/// What shines (`KHR_lights_punctual`); used only when [`crate::frame::Environment::scene_lights`] asks for it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightRow {
    /// Kind and shape.
    pub kind: LightKind,
    /// Colour times intensity, linear RGB: lux for a directional light, candela for the others.
    pub intensity: [f32; 3],
    /// World, m; of no meaning for a directional light.
    pub position: DVec3,
    /// Unit vector along which it shines, world; of no meaning for a point light.
    pub direction: DVec3,
}

/// Shape of a light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum LightKind {
    /// From infinity.
    Directional,
    /// In all directions.
    Point {
        /// Beyond it there is no light, m.
        range: Option<f64>,
    },
    /// In a cone.
    Spot {
        /// Beyond it there is no light, m.
        range: Option<f64>,
        /// Cosine of the angle within which it is full.
        inner_cos: f32,
        /// Cosine of the angle beyond which it is nothing.
        outer_cos: f32,
    },
}

/// A face without a plane, in [`SceneTable::face_planes`].
pub const NO_PLANE: u32 = u32::MAX;

/// The tables that place a scene's meshes. Sent once to each board; frames then name rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneTable {
    /// Indexed by [`ObjectId`].
    pub objects: Vec<ObjectRow>,
    /// Indexed by [`SubobjectId`](crate::ids::SubobjectId).
    pub subobjects: Vec<SubobjectRow>,
    /// Indexed by [`ModelId`].
    pub models: Vec<ModelRow>,
    /// Indexed by [`PlaneId`](crate::ids::PlaneId).
    pub planes: Vec<PlaneRow>,
    /// For each face of each subobject that has any: its plane, or [`NO_PLANE`].
    pub face_planes: Vec<u32>,
    /// The lights of the file.
    pub lights: Vec<LightRow>,
}
