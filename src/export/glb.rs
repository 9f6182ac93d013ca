//! Binary glTF 2.0 (sections 3.6, 3.7 and 4.4): one mesh, whose triangles, lines and points share their vertices.

use salient_sdk::FormatError;
use serde_json::{Value, json};

use super::colour::linear;
use super::scene::Scene;

/// Numbers of the format: kinds of components and of primitives, and what a buffer holds.
const FLOAT: u32 = 5126;
const SHORT: u32 = 5123;
const INTEGER: u32 = 5125;
const POINTS: u32 = 0;
const LINES: u32 = 1;
const TRIANGLES: u32 = 4;
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;

#[derive(Default)]
struct Document {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    primitives: Vec<Value>,
}

impl Document {
    /// A buffer view with an accessor of all of it; the accessor's number.
    fn add(&mut self, bytes: impl IntoIterator<Item = u8>, target: u32, mut accessor: Value) -> usize {
        let start = self.binary.len();
        self.binary.extend(bytes);
        let length = self.binary.len() - start;
        self.views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": length, "target": target}));
        accessor["bufferView"] = json!(self.views.len() - 1);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// What is drawn of vertices; nothing if there are no indices.
    fn primitive(&mut self, mode: u32, indices: &[u32], attributes: &Value) {
        if indices.is_empty() {
            return;
        }
        let accessor = json!({"componentType": INTEGER, "type": "SCALAR", "count": indices.len()});
        let at = self.add(indices.iter().flat_map(|i| i.to_le_bytes()), INDICES, accessor);
        self.primitives.push(json!({"attributes": attributes, "indices": at, "mode": mode, "material": 0}));
    }
}

pub fn glb(scene: &Scene) -> Result<Vec<u8>, FormatError> {
    let positions: Vec<[f32; 3]> = scene.vertices.iter().map(|p| p.map(|x| x as f32)).collect();
    if !positions.as_flattened().iter().all(|x| x.is_finite()) {
        return Err(FormatError("a coordinate is too large for glTF, which has single precision".into()));
    }
    let [low, high] = Scene::bounds(&scene.vertices).map(|p| p.map(|x| x as f32));
    let mut document = Document::default();
    let accessor = json!({"componentType": FLOAT, "type": "VEC3", "count": positions.len(), "min": low, "max": high});
    let at = document.add(positions.as_flattened().iter().flat_map(|x| x.to_le_bytes()), VERTICES, accessor);
    let mut attributes = json!({"POSITION": at});
    if !scene.colours.is_empty() {
        // Colours are linear light here, for which eight bits would be few; the fourth component keeps vertices aligned.
        let sixteen =
            |c: &[u8; 3]| [linear(c[0]), linear(c[1]), linear(c[2]), 1.0].map(|x| (x * 65535.0).round() as u16);
        let accessor =
            json!({"componentType": SHORT, "normalized": true, "type": "VEC4", "count": scene.colours.len()});
        let bytes = scene.colours.iter().flat_map(|c| sixteen(c).into_iter().flat_map(u16::to_le_bytes));
        attributes["COLOR_0"] = json!(document.add(bytes, VERTICES, accessor));
    }
    document.primitive(TRIANGLES, scene.faces.as_flattened(), &attributes);
    document.primitive(LINES, scene.edges.as_flattened(), &attributes);
    document.primitive(POINTS, &scene.points, &attributes);
    file(&document)
}

fn file(document: &Document) -> Result<Vec<u8>, FormatError> {
    let binary = &document.binary;
    let text = json!({
        "asset": {"version": "2.0", "generator": "salient"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": document.primitives}],
        // Not a metal, which is the default and looks dark.
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.8}, "doubleSided": true}],
        "accessors": document.accessors,
        "bufferViews": document.views,
        "buffers": [{"byteLength": binary.len()}],
    });
    let mut text = text.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length =
        |n: usize| u32::try_from(n).map_err(|_| FormatError("a GLB holds at most 4 GB; write ply instead".into()));
    let mut bytes = b"glTF".to_vec();
    for number in [2, length(12 + 8 + text.len() + 8 + binary.len())?, length(text.len())?] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(text);
    bytes.extend(length(binary.len())?.to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    Ok(bytes)
}
