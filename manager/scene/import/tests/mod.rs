//! Tests of the importer: what must load, what must be refused, and that nothing panics.
//!
//! Files are built here, byte by byte, so that each test shows what it is about.

mod bad_input;
mod features;
mod models;
mod mutations;
mod scene_extras;

use super::{ImportError, load_glb};
use crate::scene::Scene;
use serde_json::{Value, json};

/// A .glb of this JSON and binary part.
fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut text = json.as_bytes().to_vec();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut data = binary.to_vec();
    data.resize(data.len().next_multiple_of(4), 0);
    let length = 12 + 8 + text.len() + 8 + data.len();
    let mut out = b"glTF".to_vec();
    out.extend(2u32.to_le_bytes());
    out.extend((length as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(text);
    out.extend((data.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(data);
    out
}

/// A file under construction: JSON to be changed at will, and the data of buffer 0.
struct File {
    json: Value,
    binary: Vec<u8>,
}

impl File {
    /// One node "tower" with one triangle: accessor 0 positions, accessor 1 indices (u16).
    fn triangle() -> Self {
        let mut file = Self {
            json: json!({
                "asset": {"version": "2.0"},
                "scene": 0,
                "scenes": [{"nodes": [0]}],
                "nodes": [{"name": "tower", "mesh": 0}],
                "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
                "buffers": [], "bufferViews": [], "accessors": []
            }),
            binary: Vec::new(),
        };
        file.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        file.accessor(5123, "SCALAR", 3, &[0, 0, 1, 0, 2, 0]);
        file
    }

    /// Adds data and its view; the view's index.
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let offset = self.binary.len();
        self.binary.extend(bytes);
        push(&mut self.json["bufferViews"], json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    /// Adds an accessor with data of its own; its index.
    fn accessor(&mut self, component: u32, kind: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessor = json!({"bufferView": view, "componentType": component, "count": count, "type": kind});
        push(&mut self.json["accessors"], accessor)
    }

    fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.accessor(5126, kind, values.len() / width, &bytes)
    }

    /// The first primitive.
    fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    fn bytes(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        if json["buffers"] == json!([]) {
            json["buffers"] = json!([{"byteLength": self.binary.len()}]);
        }
        glb(&json.to_string(), &self.binary)
    }

    fn load(&self) -> Result<Scene, ImportError> {
        load_glb(&self.bytes(), "scene.glb")
    }

    /// The one-line message with which the file is refused.
    fn refusal(&self) -> String {
        let message = self.load().expect_err("the file must be refused").to_string();
        assert!(!message.contains('\n'), "more than one line: {message}");
        assert!(!message.ends_with('.'), "no full stop: {message}");
        message
    }
}

fn push(list: &mut Value, entry: Value) -> usize {
    let list = list.as_array_mut().unwrap();
    list.push(entry);
    list.len() - 1
}

fn only_mesh(scene: &Scene) -> std::sync::Arc<proto::scene::Mesh> {
    assert_eq!(scene.meshes.len(), 1);
    scene.meshes.all().unwrap().into_values().next().unwrap()
}
