//! A scene file made of other files: a grid of models, each with a box as its coarser level of detail. It is made in a folder of the
//! test's own; the models stay where they are.

use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Distance between models, m.
pub(crate) const STEP: f64 = 12.0;

/// Arrays of a glTF document that other parts name by index.
const ARRAYS: [&str; 9] =
    ["buffers", "bufferViews", "accessors", "images", "samplers", "textures", "materials", "meshes", "nodes"];

/// The folder with other people's models, if it is there.
pub(crate) fn models() -> Option<PathBuf> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("CYCLORAMA_DATA").map_or(default, PathBuf::from).join("models");
    folder.is_dir().then_some(folder)
}

/// Writes a grid of `side` × `side` models round the origin into `folder`; returns the file.
pub(crate) fn write(models: &Path, folder: &Path, side: usize) -> PathBuf {
    let mut files: Vec<PathBuf> = Vec::new();
    let city = std::fs::read_dir(models.join("kenney-city")).unwrap().map(|entry| entry.unwrap().path());
    files.extend(city.filter(|path| path.extension().is_some_and(|extension| extension == "glb")));
    files.sort();
    let others =
        ["house", "odyssey-controller-left", "TextureSettingsTest", "VertexColorTest", "a4-skyhawk/a4-skyhawk"];
    files.extend(others.map(|name| models.join(name).with_extension("glb")));
    let mut grid = Grid::new(folder);
    let roots: Vec<Vec<Value>> = files.iter().map(|file| grid.add(file)).collect();
    for k in 0..side * side {
        let at = |k: usize| (k as f64 - (side as f64 - 1.0) / 2.0) * STEP;
        grid.place(&roots[k * 7 % roots.len()], [at(k % side), 0.0, at(k / side)]);
    }
    grid.write()
}

struct Grid {
    folder: PathBuf,
    document: Value,
    /// The nodes of all models as they came, to be copied for each place.
    nodes: Vec<Value>,
}

impl Grid {
    fn new(folder: &Path) -> Self {
        // A box of a metre, for all.
        let corner = |k: u16| [k & 1, k >> 1 & 1, k >> 2 & 1].map(|c| f32::from(c) * 2.0);
        let mut bytes: Vec<u8> = (0..8).flat_map(corner).flat_map(f32::to_le_bytes).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces = quads.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]);
        bytes.extend(faces.flat_map(|k: u16| k.to_le_bytes()));
        std::fs::write(folder.join("box.bin"), &bytes).unwrap();
        let document = json!({
            "asset": {"version": "2.0"}, "scene": 0, "extensionsUsed": ["MSFT_lod"],
            "buffers": [{"byteLength": bytes.len(), "uri": "box.bin"}],
            "bufferViews": [{"buffer": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 72}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [0, 0, 0], "max": [2, 2, 2]},
                {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
            ],
            "images": [], "samplers": [], "textures": [], "materials": [{"doubleSided": true}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
            "nodes": [], "scenes": [{"nodes": []}],
        });
        Self { folder: folder.to_owned(), document, nodes: Vec::new() }
    }

    fn len(&self, array: &str) -> usize {
        if array == "nodes" { self.nodes.len() } else { self.document[array].as_array().unwrap().len() }
    }

    /// Takes a model's parts in; returns the nodes that it begins with, as indices into `nodes`.
    fn add(&mut self, file: &Path) -> Vec<Value> {
        let bytes = std::fs::read(file).unwrap();
        let length = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        let json_len = length(12);
        let mut model: Value = serde_json::from_slice(&bytes[20..20 + json_len]).unwrap();
        let binary = &bytes[28 + json_len..28 + json_len + length(20 + json_len)];
        let name = format!("{}.bin", self.len("buffers"));
        std::fs::write(self.folder.join(&name), binary).unwrap();
        model["buffers"][0]["uri"] = json!(name);
        let base = ARRAYS.map(|array| self.len(array));
        let base = |array: &str| base[ARRAYS.iter().position(|other| *other == array).unwrap()];
        let shift = |value: &mut Value, array: &str| {
            if let Some(index) = value.as_u64() {
                *value = json!(index + base(array) as u64);
            }
        };
        for array in ARRAYS {
            let mut entries = model[array].take();
            for entry in entries.as_array_mut().into_iter().flatten() {
                for (key, target) in [
                    ("buffer", "buffers"),
                    ("bufferView", "bufferViews"),
                    ("sampler", "samplers"),
                    ("source", "images"),
                    ("mesh", "meshes"),
                ] {
                    if let Some(value) = entry.get_mut(key) {
                        shift(value, target);
                    }
                }
                for value in entry.get_mut("children").and_then(Value::as_array_mut).into_iter().flatten() {
                    shift(value, "nodes");
                }
                for primitive in entry.get_mut("primitives").and_then(Value::as_array_mut).into_iter().flatten() {
                    for value in primitive["attributes"].as_object_mut().unwrap().values_mut() {
                        shift(value, "accessors");
                    }
                    for (key, target) in [("indices", "accessors"), ("material", "materials")] {
                        if let Some(value) = primitive.get_mut(key) {
                            shift(value, target);
                        }
                    }
                }
                if array == "materials" {
                    textures(entry, &|value| shift(value, "textures"));
                }
                if let Some(uri) = entry.get("uri").and_then(Value::as_str).filter(|_| array == "images") {
                    let copy = format!("{}-{}", base("images"), uri.replace('/', "-"));
                    std::fs::copy(file.with_file_name("").join(uri), self.folder.join(&copy)).unwrap();
                    entry["uri"] = json!(copy);
                }
                if array == "nodes" {
                    self.nodes.push(entry.take());
                } else {
                    self.document[array].as_array_mut().unwrap().push(entry.take());
                }
            }
        }
        let scene = model["scene"].as_u64().unwrap_or(0) as usize;
        let mut roots = model["scenes"][scene]["nodes"].as_array().unwrap().clone();
        roots.iter_mut().for_each(|root| shift(root, "nodes"));
        roots
    }

    /// Puts a copy of a model somewhere, with a box for when it is far away.
    fn place(&mut self, roots: &[Value], at: [f64; 3]) {
        let children: Vec<usize> = roots.iter().map(|root| self.copy(root.as_u64().unwrap() as usize)).collect();
        let nodes = self.document["nodes"].as_array_mut().unwrap();
        let number = nodes.len();
        nodes.push(json!({
            "name": format!("model {number}"), "translation": at, "children": children,
            "extensions": {"MSFT_lod": {"ids": [number + 1]}},
        }));
        nodes.push(json!({"name": format!("box {number}"), "translation": at, "mesh": 0}));
        self.document["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(number));
    }

    fn copy(&mut self, node: usize) -> usize {
        let mut copied = self.nodes[node].clone();
        for part in ["skin", "camera", "extensions", "extras", "weights"] {
            copied.as_object_mut().unwrap().remove(part);
        }
        if let Some(children) = copied.get("children").and_then(Value::as_array).cloned() {
            let children: Vec<usize> =
                children.iter().map(|child| self.copy(child.as_u64().unwrap() as usize)).collect();
            copied["children"] = json!(children);
        }
        let nodes = self.document["nodes"].as_array_mut().unwrap();
        nodes.push(copied);
        nodes.len() - 1
    }

    fn write(mut self) -> PathBuf {
        for array in ["images", "samplers", "textures"] {
            if self.document[array].as_array().unwrap().is_empty() {
                self.document.as_object_mut().unwrap().remove(array);
            }
        }
        let path = self.folder.join("grid.gltf");
        std::fs::write(&path, self.document.to_string()).unwrap();
        path
    }
}

/// Calls `shift` on every texture index of a material.
fn textures(material: &mut Value, shift: &dyn Fn(&mut Value)) {
    for (name, part) in material.as_object_mut().into_iter().flatten() {
        if name.ends_with("Texture") {
            shift(&mut part["index"]);
        } else if part.is_object() {
            textures(part, shift);
        }
    }
}
