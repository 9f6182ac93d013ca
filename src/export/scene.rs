//! What is drawn, and the text and binary formats that hold it.

use std::fmt::Write as _;

use salient_sdk::FormatError;

use super::colour::Colour;
use super::{Format, glb};

/// Vertices, and what is made of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Positions.
    pub vertices: Vec<[f64; 3]>,
    /// A colour for each vertex, or none at all.
    pub colours: Vec<Colour>,
    /// Triangles.
    pub faces: Vec<[u32; 3]>,
    /// Lines.
    pub edges: Vec<[u32; 2]>,
    /// Vertices that are drawn as points.
    pub points: Vec<u32>,
    /// Numbers for each vertex, by name; only PLY has them.
    pub properties: Vec<(&'static str, Vec<f64>)>,
}

impl Scene {
    /// As the bytes of a file.
    pub fn write(&self, format: Format) -> Result<Vec<u8>, FormatError> {
        match format {
            Format::Obj => Ok(self.obj()),
            Format::Off => self.off(),
            Format::Ply => Ok(self.ply()),
            Format::Glb => glb::glb(self),
            other => Err(FormatError(format!("{} is no format for drawings", other.extension()))),
        }
    }

    /// The least and the greatest coordinates.
    pub(super) fn bounds(vertices: &[[f64; 3]]) -> [[f64; 3]; 2] {
        let first = vertices.first().copied().unwrap_or_default();
        let fold =
            |of: fn(f64, f64) -> f64| vertices.iter().fold(first, |a, b| std::array::from_fn(|k| of(a[k], b[k])));
        [fold(f64::min), fold(f64::max)]
    }

    /// Numbers are the shortest that read back as the same.
    fn obj(&self) -> Vec<u8> {
        let mut text = String::new();
        // Writing to a string cannot fail.
        for (i, [x, y, z]) in self.vertices.iter().enumerate() {
            let _ = write!(text, "v {x} {y} {z}");
            if let Some(colour) = self.colours.get(i) {
                let [r, g, b] = colour.map(|c| f64::from(c) / 255.0);
                let _ = write!(text, " {r:.4} {g:.4} {b:.4}");
            }
            text.push('\n');
        }
        for face in &self.faces {
            let [a, b, c] = face.map(|i| i + 1);
            let _ = writeln!(text, "f {a} {b} {c}");
        }
        for edge in &self.edges {
            let [a, b] = edge.map(|i| i + 1);
            let _ = writeln!(text, "l {a} {b}");
        }
        for point in &self.points {
            let _ = writeln!(text, "p {}", point + 1);
        }
        text.into_bytes()
    }

    fn off(&self) -> Result<Vec<u8>, FormatError> {
        if !(self.edges.is_empty() && self.points.is_empty()) {
            return Err(FormatError("OFF has no points and lines; write ply, obj or glb".into()));
        }
        let kind = if self.colours.is_empty() { "OFF" } else { "COFF" };
        let mut text = format!("{kind}\n{} {} 0\n", self.vertices.len(), self.faces.len());
        for (i, [x, y, z]) in self.vertices.iter().enumerate() {
            let _ = write!(text, "{x} {y} {z}");
            if let Some([r, g, b]) = self.colours.get(i) {
                let _ = write!(text, " {r} {g} {b} 255");
            }
            text.push('\n');
        }
        for [a, b, c] in &self.faces {
            let _ = writeln!(text, "3 {a} {b} {c}");
        }
        Ok(text.into_bytes())
    }

    fn ply(&self) -> Vec<u8> {
        let mut text = "ply\nformat binary_little_endian 1.0\ncomment made by salient\n".to_owned();
        let _ = writeln!(
            text,
            "element vertex {}\nproperty double x\nproperty double y\nproperty double z",
            self.vertices.len()
        );
        if !self.colours.is_empty() {
            text.push_str("property uchar red\nproperty uchar green\nproperty uchar blue\n");
        }
        for (name, _) in &self.properties {
            let _ = writeln!(text, "property double {name}");
        }
        if !self.faces.is_empty() {
            let _ = writeln!(text, "element face {}\nproperty list uchar int vertex_indices", self.faces.len());
        }
        if !self.edges.is_empty() {
            let _ = writeln!(text, "element edge {}\nproperty int vertex1\nproperty int vertex2", self.edges.len());
        }
        text.push_str("end_header\n");
        let mut bytes = text.into_bytes();
        for (i, vertex) in self.vertices.iter().enumerate() {
            bytes.extend(vertex.iter().flat_map(|x| x.to_le_bytes()));
            bytes.extend(self.colours.get(i).into_iter().flatten());
            bytes.extend(self.properties.iter().flat_map(|(_, values)| values[i].to_le_bytes()));
        }
        for face in &self.faces {
            bytes.push(3);
            bytes.extend(face.iter().flat_map(|i| i.to_le_bytes()));
        }
        bytes.extend(self.edges.as_flattened().iter().flat_map(|i| i.to_le_bytes()));
        bytes
    }
}
