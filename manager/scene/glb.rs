//! Writes binary glTF 2.0.
//!
//! A [`GlbBuilder`] collects pictures, materials, meshes and a tree of nodes, and [`GlbBuilder::write`] lays them out
//! as one `.glb`: a JSON chunk and a binary chunk. It writes what the built-in scenes need and no more: one scene, one
//! buffer, one buffer view per accessor, 32-bit floats and indices. The same calls give the same bytes on every
//! machine and with every set of crate features; hence structs with fixed field order rather than JSON maps, and PNG
//! files with stored (not compressed) data, which need no codec crate.

mod document;
mod png;

use document::{
    ARRAY_BUFFER, Accessor, Asset, Attributes, Buffer, BufferView, CLAMP_TO_EDGE, Document, ELEMENT_ARRAY_BUFFER,
    Extensions, FLOAT, Image, LINEAR, LINEAR_MIPMAP_LINEAR, Material, Mesh, NodeJson, Pbr, Primitive, REPEAT, Sampler,
    Scene, Texture, TextureInfo, UNLIT, UNSIGNED_INT,
};
use glam::{DQuat, DVec3};
use serde_json::Value;

/// A picture in the builder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureId(usize);

/// A material in the builder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaterialId(usize);

/// A mesh in the builder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshId(usize);

/// A node in the builder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeId(usize);

/// What the bytes of a [`Picture`] are; the number is the count of bytes per texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// One grey value, sRGB.
    Grey = 1,
    /// Red, green, blue, sRGB.
    Rgb = 3,
    /// The same and linear alpha.
    Rgba = 4,
}

/// A picture: row-major, tightly packed, the first row at v = 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// What a texel is.
    pub channels: Channels,
    /// `width × height × channels` bytes.
    pub bytes: Vec<u8>,
}

/// What alpha means.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Nothing.
    #[default]
    Opaque,
    /// The surface exists where alpha reaches this cut-off.
    Mask(f32),
    /// Alpha is the saturation.
    Blend,
}

/// What a surface looks like; `Surface::default()` is white, opaque and single-sided.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Linear RGB and alpha.
    pub base_color: [f32; 4],
    /// What alpha means.
    pub alpha: AlphaMode,
    /// Whether it is seen from behind.
    pub double_sided: bool,
    /// Added to the lit colour, linear RGB.
    pub emissive: [f32; 3],
    /// Whether light is ignored.
    pub unlit: bool,
    /// Multiplies the base colour.
    pub texture: Option<PictureId>,
    /// Whether the texture ends at its border instead of repeating.
    pub clamp: bool,
}

impl Default for Surface {
    fn default() -> Self {
        Self {
            base_color: [1.0; 4],
            alpha: AlphaMode::Opaque,
            double_sided: false,
            emissive: [0.0; 3],
            unlit: false,
            texture: None,
            clamp: false,
        }
    }
}

impl Surface {
    /// An opaque surface of one colour, linear RGB.
    pub fn plain(r: f32, g: f32, b: f32) -> Self {
        Self { base_color: [r, g, b, 1.0], ..Self::default() }
    }

    /// An opaque white surface with a repeating texture.
    pub fn textured(texture: PictureId) -> Self {
        Self { texture: Some(texture), ..Self::default() }
    }
}

/// Vertices and triangles, counter-clockwise in front.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Geometry {
    /// Mesh space, m.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals, as many as positions.
    pub normals: Vec<[f32; 3]>,
    /// Linear RGB, as many as positions; empty: white.
    pub colors: Vec<[f32; 3]>,
    /// As many as positions; empty: none.
    pub texcoords: Vec<[f32; 2]>,
    /// Three vertices per triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// A node to be added: a name, a place, perhaps a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    name: String,
    mesh: Option<MeshId>,
    translation: DVec3,
    rotation: DQuat,
    scale: DVec3,
    extras: Option<Value>,
}

impl Node {
    /// A node without a mesh, at its parent's place.
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            mesh: None,
            translation: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            scale: DVec3::ONE,
            extras: None,
        }
    }

    /// Shows `mesh`.
    #[must_use]
    pub fn mesh(mut self, mesh: MeshId) -> Self {
        self.mesh = Some(mesh);
        self
    }

    /// Moves the node, m.
    #[must_use]
    pub fn at(mut self, translation: DVec3) -> Self {
        self.translation = translation;
        self
    }

    /// Turns the node; node → parent.
    #[must_use]
    pub fn turned(mut self, rotation: DQuat) -> Self {
        self.rotation = rotation;
        self
    }

    /// Scales the node.
    #[must_use]
    pub fn scaled(mut self, scale: DVec3) -> Self {
        self.scale = scale;
        self
    }

    /// Attaches application data, such as `{"cyclorama": {"static": false}}`.
    #[must_use]
    pub fn extras(mut self, extras: Value) -> Self {
        self.extras = Some(extras);
        self
    }
}

/// Collects a scene and writes it.
#[derive(Debug, Default)]
pub struct GlbBuilder {
    document: Document,
    binary: Vec<u8>,
    triangles_of_mesh: Vec<usize>,
    triangles_drawn: usize,
}

impl GlbBuilder {
    /// An empty scene, made by `generator`.
    pub fn new(generator: &'static str) -> Self {
        let mut builder = Self::default();
        builder.document.asset = Asset { version: "2.0", generator };
        builder.document.scenes.push(Scene::default());
        // Index 0 repeats, index 1 clamps; both are linear with mip-maps.
        for wrap in [REPEAT, CLAMP_TO_EDGE] {
            builder.document.samplers.push(Sampler {
                mag_filter: LINEAR,
                min_filter: LINEAR_MIPMAP_LINEAR,
                wrap_s: wrap,
                wrap_t: wrap,
            });
        }
        builder
    }

    /// Adds a picture as PNG.
    ///
    /// # Panics
    /// When the bytes don't fit the size.
    pub fn picture(&mut self, name: &str, picture: &Picture) -> PictureId {
        let view = self.view(&png::encode(picture), None);
        self.document.images.push(Image { name: name.into(), buffer_view: view, mime_type: "image/png" });
        PictureId(self.document.images.len() - 1)
    }

    /// Adds a material.
    pub fn material(&mut self, name: &str, surface: &Surface) -> MaterialId {
        let texture = surface.texture.map(|picture| {
            let texture = Texture { sampler: usize::from(surface.clamp), source: picture.0 };
            let known = self.document.textures.iter().position(|t| *t == texture);
            let index = known.unwrap_or_else(|| {
                self.document.textures.push(texture);
                self.document.textures.len() - 1
            });
            TextureInfo { index }
        });
        let (alpha_mode, alpha_cutoff) = match surface.alpha {
            AlphaMode::Opaque => ("OPAQUE", None),
            AlphaMode::Mask(cutoff) => ("MASK", Some(cutoff)),
            AlphaMode::Blend => ("BLEND", None),
        };
        if surface.unlit && self.document.extensions_used.is_empty() {
            self.document.extensions_used.push(UNLIT);
        }
        self.document.materials.push(Material {
            name: name.into(),
            pbr_metallic_roughness: Pbr {
                base_color_factor: surface.base_color,
                base_color_texture: texture,
                metallic_factor: 0.0,
                roughness_factor: 1.0,
            },
            emissive_factor: surface.emissive,
            alpha_mode,
            alpha_cutoff,
            double_sided: surface.double_sided,
            extensions: surface.unlit.then(Extensions::default),
        });
        MaterialId(self.document.materials.len() - 1)
    }

    /// Adds a mesh of one primitive per part; parts without triangles are left out.
    ///
    /// # Panics
    /// When an attribute is neither empty nor as long as the positions, an index is out of range, or nothing is left.
    pub fn mesh(&mut self, name: &str, parts: &[(Geometry, MaterialId)]) -> MeshId {
        let mut primitives = Vec::new();
        let mut triangles = 0;
        for (geometry, material) in parts.iter().filter(|(geometry, _)| !geometry.triangles.is_empty()) {
            primitives.push(self.primitive(name, geometry, *material));
            triangles += geometry.triangles.len();
        }
        assert!(!primitives.is_empty(), "mesh {name:?} must have a triangle");
        self.document.meshes.push(Mesh { name: name.into(), primitives });
        self.triangles_of_mesh.push(triangles);
        MeshId(self.document.meshes.len() - 1)
    }

    /// Adds a node below `parent`, or at the root of the scene.
    pub fn node(&mut self, parent: Option<NodeId>, node: Node) -> NodeId {
        let id = self.document.nodes.len();
        match parent {
            Some(parent) => self.document.nodes[parent.0].children.push(id),
            None => self.document.scenes[0].nodes.push(id),
        }
        self.triangles_drawn += node.mesh.map_or(0, |mesh| self.triangles_of_mesh[mesh.0]);
        self.document.nodes.push(NodeJson {
            name: node.name,
            mesh: node.mesh.map(|mesh| mesh.0),
            translation: (node.translation != DVec3::ZERO).then(|| node.translation.to_array().map(shorten)),
            rotation: (node.rotation != DQuat::IDENTITY).then(|| node.rotation.to_array().map(shorten)),
            scale: (node.scale != DVec3::ONE).then(|| node.scale.to_array().map(shorten)),
            children: Vec::new(),
            extras: node.extras,
        });
        NodeId(id)
    }

    /// Triangles that the scene's nodes show, shared meshes counted as often as they are shown.
    pub fn triangles_drawn(&self) -> usize {
        self.triangles_drawn
    }

    /// Number of nodes so far.
    pub fn node_count(&self) -> usize {
        self.document.nodes.len()
    }

    /// The file.
    ///
    /// # Panics
    /// When the scene is larger than the 4 GiB that the format can say.
    pub fn write(&self) -> Vec<u8> {
        let mut document = self.document.clone();
        document.buffers = vec![Buffer { byte_length: self.binary.len() }];
        let mut json = serde_json::to_vec(&document).expect("no map with keys other than strings is in the document");
        pad(&mut json, b' ');
        let mut binary = self.binary.clone();
        pad(&mut binary, 0);

        let length = |bytes: usize| u32::try_from(bytes).expect("built-in scenes are far below 4 GiB").to_le_bytes();
        let mut file = Vec::with_capacity(28 + json.len() + binary.len());
        file.extend_from_slice(b"glTF");
        file.extend_from_slice(&2u32.to_le_bytes());
        file.extend_from_slice(&length(28 + json.len() + binary.len()));
        for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
            file.extend_from_slice(&length(chunk.len()));
            file.extend_from_slice(kind);
            file.extend_from_slice(chunk);
        }
        file
    }

    fn primitive(&mut self, name: &str, geometry: &Geometry, material: MaterialId) -> Primitive {
        let count = geometry.positions.len();
        let fits = |length: usize| length == 0 || length == count;
        assert!(geometry.normals.len() == count, "mesh {name:?} must have a normal per vertex");
        assert!(
            fits(geometry.colors.len()) && fits(geometry.texcoords.len()),
            "mesh {name:?}: an attribute is too short"
        );
        let in_range = geometry.triangles.as_flattened().iter().all(|&i| (i as usize) < count);
        assert!(in_range, "mesh {name:?}: an index is out of range");

        let mut bounds = (geometry.positions[0], geometry.positions[0]);
        for position in &geometry.positions {
            for (axis, &x) in position.iter().enumerate() {
                bounds.0[axis] = bounds.0[axis].min(x);
                bounds.1[axis] = bounds.1[axis].max(x);
            }
        }
        let position = self.floats(&geometry.positions, "VEC3", Some(bounds));
        let normal = self.floats(&geometry.normals, "VEC3", None);
        let color = (!geometry.colors.is_empty()).then(|| self.floats(&geometry.colors, "VEC3", None));
        let texcoord = (!geometry.texcoords.is_empty()).then(|| self.floats(&geometry.texcoords, "VEC2", None));
        let bytes: Vec<u8> = geometry.triangles.as_flattened().iter().flat_map(|i| i.to_le_bytes()).collect();
        let buffer_view = self.view(&bytes, Some(ELEMENT_ARRAY_BUFFER));
        let count = geometry.triangles.len() * 3;
        let indices = self.accessor(Accessor {
            buffer_view,
            component_type: UNSIGNED_INT,
            count,
            kind: "SCALAR",
            min: None,
            max: None,
        });
        Primitive { attributes: Attributes { position, normal, color, texcoord }, indices, material: material.0 }
    }

    fn floats<const N: usize>(
        &mut self,
        values: &[[f32; N]],
        kind: &'static str,
        bounds: Option<([f32; 3], [f32; 3])>,
    ) -> usize {
        let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        let buffer_view = self.view(&bytes, Some(ARRAY_BUFFER));
        let (min, max) = bounds.unzip();
        self.accessor(Accessor { buffer_view, component_type: FLOAT, count: values.len(), kind, min, max })
    }

    fn accessor(&mut self, accessor: Accessor) -> usize {
        self.document.accessors.push(accessor);
        self.document.accessors.len() - 1
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        pad(&mut self.binary, 0);
        let byte_offset = self.binary.len();
        self.binary.extend_from_slice(bytes);
        self.document.buffer_views.push(BufferView { buffer: 0, byte_offset, byte_length: bytes.len(), target });
        self.document.buffer_views.len() - 1
    }
}

/// Seven decimals: a tenth of a micrometre, and far fewer characters.
fn shorten(x: f64) -> f64 {
    libm::round(x * 1e7) / 1e7
}

fn pad(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(bytes.len().next_multiple_of(4), with);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle() -> Geometry {
        Geometry {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, -3.0]],
            normals: vec![[0.0, 0.0, 1.0]; 3],
            triangles: vec![[0, 1, 2]],
            ..Geometry::default()
        }
    }

    #[test]
    fn a_small_scene_has_the_layout_of_the_specification() {
        let mut builder = GlbBuilder::new("test");
        let red = builder.material("red", &Surface { unlit: true, ..Surface::plain(1.0, 0.0, 0.0) });
        let mesh = builder.mesh("triangle", &[(triangle(), red)]);
        let parent = builder.node(None, Node::new("parent").at(DVec3::new(1.0, 0.0, 0.0)));
        builder.node(Some(parent), Node::new("child").mesh(mesh));
        let file = builder.write();

        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&file[..4], word(4), word(8)), (&b"glTF"[..], 2, file.len()));
        let json = &file[20..20 + word(12)];
        let binary = 20 + word(12);
        assert_eq!((&file[16..20], &file[binary + 4..binary + 8]), (&b"JSON"[..], &b"BIN\0"[..]));
        assert_eq!(binary + 8 + word(binary), file.len(), "the binary chunk ends the file");

        let document: Value = serde_json::from_slice(json).unwrap();
        assert_eq!(document["nodes"][0]["children"][0], 1);
        assert_eq!(document["scenes"][0]["nodes"], serde_json::json!([0]));
        assert_eq!(document["accessors"][0]["max"], serde_json::json!([1.0, 2.0, 0.0]));
        assert_eq!(document["accessors"][0]["min"], serde_json::json!([0.0, 0.0, -3.0]));
        assert_eq!(document["extensionsUsed"][0], UNLIT);
        assert_eq!(builder.triangles_drawn(), 1);
    }

    #[test]
    #[should_panic(expected = "out of range")]
    fn an_index_out_of_range_is_caught() {
        let mut builder = GlbBuilder::new("test");
        let white = builder.material("white", &Surface::default());
        builder.mesh("bad", &[(Geometry { triangles: vec![[0, 1, 3]], ..triangle() }, white)]);
    }
}
