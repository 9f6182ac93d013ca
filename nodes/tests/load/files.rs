//! One tetrahedron, written by hand in every format.

use serde_json::{Value, json};

/// Exact in single precision; in the order in which the faces first use them, as STL would number them.
pub const POINTS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [0.0, 1.5, 0.0], [1.0, 0.0, 0.0], [0.0, 0.25, -2.25]];
pub const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

pub fn points() -> Vec<[f64; 3]> {
    // The first face uses 0, 2, 1: STL numbers them in that order.
    POINTS.iter().map(|p| p.map(f64::from)).collect()
}

fn lines<T: std::fmt::Display>(rows: &[[T; 3]], before: &str) -> String {
    rows.iter().map(|[a, b, c]| format!("{before}{a} {b} {c}\n")).collect()
}

pub fn obj() -> Vec<u8> {
    let from_one = FACES.map(|f| f.map(|v| v + 1));
    format!("# a tetrahedron\no a\n{}{}", lines(&POINTS, "v "), lines(&from_one, "f ")).into_bytes()
}

pub fn off() -> Vec<u8> {
    format!("OFF\n4 4 6\n{}{}", lines(&POINTS, ""), lines(&FACES, "3 ")).into_bytes()
}

fn ply_header(format: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment by hand\nelement vertex 4\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
    )
}

pub fn ply_text() -> Vec<u8> {
    let rows: String = POINTS.iter().map(|[x, y, z]| format!("{x} {y} {z} 255\n")).collect();
    format!("{}{rows}{}", ply_header("ascii"), lines(&FACES, "3 ")).into_bytes()
}

pub fn ply_binary(big: bool) -> Vec<u8> {
    let name = if big { "binary_big_endian" } else { "binary_little_endian" };
    let mut out = ply_header(name).into_bytes();
    let bytes = |x: u32| if big { x.to_be_bytes() } else { x.to_le_bytes() };
    for point in POINTS {
        out.extend(point.iter().flat_map(|x| bytes(x.to_bits())));
        out.push(255);
    }
    for face in FACES {
        out.push(3);
        out.extend(face.iter().flat_map(|v| bytes(*v)));
    }
    out
}

pub fn stl_text() -> Vec<u8> {
    let facet = |face: [u32; 3]| {
        let corners = lines(&face.map(|v| POINTS[v as usize]), "  vertex ");
        format!("facet normal 0 0 nan\n outer loop\n{corners} endloop\nendfacet\n")
    };
    format!("solid\n{}endsolid\n", FACES.map(facet).concat()).into_bytes()
}

pub fn stl_binary(header: &[u8]) -> Vec<u8> {
    let mut out = header.to_vec();
    out.resize(80, b' ');
    out.extend(4u32.to_le_bytes());
    for face in FACES {
        out.extend([0; 12]);
        face.iter().flat_map(|v| POINTS[*v as usize]).for_each(|x| out.extend(x.to_le_bytes()));
        out.extend([0; 2]);
    }
    out
}

/// Collects the binary part of a glTF document.
#[derive(Default)]
pub struct Builder {
    pub bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Builder {
    fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        self.views.push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()}));
        self.bytes.extend(bytes);
        self.views.len() - 1
    }

    fn accessor(&mut self, value: Value) -> usize {
        self.accessors.push(value);
        self.accessors.len() - 1
    }

    pub fn floats(&mut self, kind: &str, rows: &[impl AsRef<[f32]>]) -> usize {
        let bytes: Vec<u8> = rows.iter().flat_map(AsRef::as_ref).flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes);
        let width = rows[0].as_ref().len();
        let extreme = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..width).map(|k| rows.iter().map(|r| r.as_ref()[k]).reduce(pick).unwrap()).collect()
        };
        self.accessor(json!({
            "bufferView": view, "componentType": 5126, "count": rows.len(), "type": kind,
            "min": extreme(f32::min), "max": extreme(f32::max),
        }))
    }

    pub fn bytes(&mut self, kind: &str, rows: &[impl AsRef<[u8]>], normalized: bool) -> usize {
        let bytes: Vec<u8> = rows.iter().flat_map(|r| r.as_ref().to_vec()).collect();
        let view = self.view(&bytes);
        let normalized = json!({
            "bufferView": view, "componentType": 5121, "count": rows.len(), "type": kind, "normalized": normalized,
        });
        self.accessor(normalized)
    }

    /// A sparse accessor of points: zeros, but for some.
    pub fn sparse_points(&mut self, count: usize, at: &[u8], points: &[[f32; 3]]) -> usize {
        let indices = self.view(at);
        let bytes: Vec<u8> = points.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let values = self.view(&bytes);
        self.accessor(json!({
            "componentType": 5126, "count": count, "type": "VEC3", "min": [-9, -9, -9], "max": [9, 9, 9],
            "sparse": {"count": at.len(), "indices": {"bufferView": indices, "componentType": 5121},
                       "values": {"bufferView": values}},
        }))
    }

    /// The document with its other parts, without a URI for its buffer.
    pub fn document(&self, parts: Value) -> Value {
        let mut document = json!({
            "asset": {"version": "2.0"}, "buffers": [{"byteLength": self.bytes.len()}],
            "bufferViews": self.views, "accessors": self.accessors,
        });
        document.as_object_mut().unwrap().extend(parts.as_object().unwrap().clone());
        document
    }

    /// The document as text with its buffer in a data URI.
    pub fn gltf(&self, parts: Value) -> Vec<u8> {
        let mut document = self.document(parts);
        document["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{}", base64(&self.bytes)));
        document.to_string().into_bytes()
    }

    pub fn glb(&self, parts: Value) -> Vec<u8> {
        let mut text = self.document(parts).to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut data = self.bytes.clone();
        data.resize(data.len().next_multiple_of(4), 0);
        let mut out = b"glTF\x02\0\0\0".to_vec();
        out.extend((28 + text.len() as u32 + data.len() as u32).to_le_bytes());
        for (name, chunk) in [(b"JSON", text), (b"BIN\0", data)] {
            out.extend((chunk.len() as u32).to_le_bytes());
            out.extend(name);
            out.extend(chunk);
        }
        out
    }
}

pub fn base64(bytes: &[u8]) -> String {
    let digits = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::new();
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().fold(0, |w, b| w << 8 | u32::from(*b)) << (8 * (3 - chunk.len()));
        let digit = |k: usize| char::from(digits[(word >> (18 - 6 * k) & 63) as usize]);
        out.extend((0..=chunk.len()).map(digit));
        out.extend(std::iter::repeat_n('=', 3 - chunk.len()));
    }
    out
}

/// The tetrahedron's buffer and a document that draws it with one node.
pub fn tetrahedron() -> (Builder, Value) {
    let mut builder = Builder::default();
    let positions = builder.floats("VEC3", &POINTS);
    let corners: Vec<[u8; 1]> = FACES.as_flattened().iter().map(|v| [*v as u8]).collect();
    let indices = builder.bytes("SCALAR", &corners, false);
    let parts = json!({
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": positions}, "indices": indices}]}],
    });
    (builder, parts)
}
