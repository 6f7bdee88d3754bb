//! Writes binary glTF 2.0.
//!
//! A [`GlbBuilder`] collects pictures, materials, meshes and a tree of nodes, and [`GlbBuilder::write`] lays them out as
//! one `.glb`: a JSON chunk and a binary chunk. It writes what the built-in scenes need and no more: one scene, one
//! buffer, one buffer view per accessor, 32-bit floats and indices. The same calls give the same bytes on every machine and with every set of
//! crate features; hence structs with fixed field order rather than JSON maps, and PNG files with stored (not
//! compressed) data, which need no codec crate.

use glam::{DQuat, DVec3};
use serde::Serialize;
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
        let view = self.view(&png(picture), None);
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
        let indices =
            self.accessor(Accessor { buffer_view, component_type: UNSIGNED_INT, count, kind: "SCALAR", min: None, max: None });
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

// The numbers that glTF takes over from OpenGL.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const LINEAR: u32 = 9729;
const LINEAR_MIPMAP_LINEAR: u32 = 9987;
const REPEAT: u32 = 10497;
const CLAMP_TO_EDGE: u32 = 33071;
const UNLIT: &str = "KHR_materials_unlit";

#[derive(Clone, Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
struct Document {
    asset: Asset,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    extensions_used: Vec<&'static str>,
    scene: usize,
    scenes: Vec<Scene>,
    nodes: Vec<NodeJson>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    meshes: Vec<Mesh>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    materials: Vec<Material>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    textures: Vec<Texture>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    images: Vec<Image>,
    samplers: Vec<Sampler>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    accessors: Vec<Accessor>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    buffer_views: Vec<BufferView>,
    buffers: Vec<Buffer>,
}

#[derive(Clone, Debug, Default, Serialize)]
struct Asset {
    version: &'static str,
    generator: &'static str,
}

#[derive(Clone, Debug, Default, Serialize)]
struct Scene {
    nodes: Vec<usize>,
}

#[derive(Clone, Debug, Serialize)]
struct NodeJson {
    name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    translation: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rotation: Option<[f64; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    scale: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    children: Vec<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    extras: Option<Value>,
}

#[derive(Clone, Debug, Serialize)]
struct Mesh {
    name: String,
    primitives: Vec<Primitive>,
}

#[derive(Clone, Debug, Serialize)]
struct Primitive {
    attributes: Attributes,
    indices: usize,
    material: usize,
}

#[derive(Clone, Debug, Serialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: usize,
    #[serde(rename = "NORMAL")]
    normal: usize,
    #[serde(rename = "COLOR_0", skip_serializing_if = "Option::is_none")]
    color: Option<usize>,
    #[serde(rename = "TEXCOORD_0", skip_serializing_if = "Option::is_none")]
    texcoord: Option<usize>,
}

#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Material {
    name: String,
    pbr_metallic_roughness: Pbr,
    emissive_factor: [f32; 3],
    alpha_mode: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    alpha_cutoff: Option<f32>,
    double_sided: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    extensions: Option<Extensions>,
}

#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Pbr {
    base_color_factor: [f32; 4],
    #[serde(skip_serializing_if = "Option::is_none")]
    base_color_texture: Option<TextureInfo>,
    metallic_factor: f32,
    roughness_factor: f32,
}

#[derive(Clone, Debug, Serialize)]
struct TextureInfo {
    index: usize,
}

#[derive(Clone, Debug, Default, Serialize)]
struct Extensions {
    #[serde(rename = "KHR_materials_unlit")]
    unlit: Empty,
}

#[derive(Clone, Debug, Default, Serialize)]
struct Empty {}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Texture {
    sampler: usize,
    source: usize,
}

#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Image {
    name: String,
    buffer_view: usize,
    mime_type: &'static str,
}

#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Sampler {
    mag_filter: u32,
    min_filter: u32,
    wrap_s: u32,
    wrap_t: u32,
}

#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    kind: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    min: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max: Option<[f32; 3]>,
}

#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    buffer: usize,
    byte_offset: usize,
    byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    target: Option<u32>,
}

#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Buffer {
    byte_length: usize,
}

/// A PNG file with stored data: PNG 1.2 around zlib (RFC 1950) around stored blocks (RFC 1951, 3.2.4).
fn png(picture: &Picture) -> Vec<u8> {
    let stride = picture.width as usize * picture.channels as usize;
    assert!(
        stride > 0 && picture.bytes.len() == stride * picture.height as usize,
        "a picture's bytes must fit its size"
    );
    let color_type = match picture.channels {
        Channels::Grey => 0,
        Channels::Rgb => 2,
        Channels::Rgba => 6,
    };
    let mut header = Vec::new();
    header.extend_from_slice(&picture.width.to_be_bytes());
    header.extend_from_slice(&picture.height.to_be_bytes());
    header.extend_from_slice(&[8, color_type, 0, 0, 0]);

    // Each row begins with its filter: none.
    let rows: Vec<u8> = picture.bytes.chunks(stride).flat_map(|row| [0].iter().chain(row)).copied().collect();
    let mut data = vec![0x78, 0x01];
    let mut blocks = rows.chunks(0xFFFF).peekable();
    while let Some(block) = blocks.next() {
        let length = u16::try_from(block.len()).expect("chunks are at most 0xFFFF long");
        data.push(u8::from(blocks.peek().is_none()));
        data.extend_from_slice(&length.to_le_bytes());
        data.extend_from_slice(&(!length).to_le_bytes());
        data.extend_from_slice(block);
    }
    let (mut a, mut b) = (1u32, 0u32); // Adler-32, RFC 1950, 8.2
    for &byte in &rows {
        a = (a + u32::from(byte)) % 65521;
        b = (b + a) % 65521;
    }
    data.extend_from_slice(&((b << 16) | a).to_be_bytes());

    let table = crc_table();
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    for (kind, content) in [(b"IHDR", &header), (b"IDAT", &data), (b"IEND", &Vec::new())] {
        file.extend_from_slice(&u32::try_from(content.len()).expect("pictures are small").to_be_bytes());
        let start = file.len();
        file.extend_from_slice(kind);
        file.extend_from_slice(content);
        let crc = !file[start..].iter().fold(!0u32, |crc, &byte| table[((crc ^ u32::from(byte)) & 0xFF) as usize] ^ (crc >> 8));
        file.extend_from_slice(&crc.to_be_bytes());
    }
    file
}

/// The table of the CRC of PNG 1.2, appendix D.
fn crc_table() -> [u32; 256] {
    let mut table = [0; 256];
    for (row, n) in table.iter_mut().zip(0u32..) {
        *row = (0..8).fold(n, |c, _| if c & 1 == 1 { 0xEDB8_8320 ^ (c >> 1) } else { c >> 1 });
    }
    table
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
    fn checksums_are_those_of_the_standards() {
        let crc = |bytes: &[u8]| {
            let table = crc_table();
            !bytes.iter().fold(!0u32, |crc, &b| table[((crc ^ u32::from(b)) & 0xFF) as usize] ^ (crc >> 8))
        };
        assert_eq!(crc(b"123456789"), 0xCBF4_3926);
        let file = png(&Picture { width: 1, height: 1, channels: Channels::Grey, bytes: vec![7] });
        assert_eq!(&file[file.len() - 4..], &0xAE42_6082u32.to_be_bytes(), "IEND always has this checksum");
    }

    #[cfg(feature = "import")]
    #[test]
    fn a_picture_comes_back_from_its_png() {
        for channels in [Channels::Grey, Channels::Rgb, Channels::Rgba] {
            let (width, height) = (300, 91);
            let count = width as usize * height as usize * channels as usize;
            let bytes: Vec<u8> = (0..count).map(|i| (i * 31 % 251) as u8).collect();
            let file = png(&Picture { width, height, channels, bytes: bytes.clone() });
            let read = image::load_from_memory(&file).unwrap();
            assert_eq!((read.width(), read.height(), read.as_bytes()), (width, height, &bytes[..]));
        }
    }

    #[test]
    #[should_panic(expected = "out of range")]
    fn an_index_out_of_range_is_caught() {
        let mut builder = GlbBuilder::new("test");
        let white = builder.material("white", &Surface::default());
        builder.mesh("bad", &[(Geometry { triangles: vec![[0, 1, 3]], ..triangle() }, white)]);
    }
}
