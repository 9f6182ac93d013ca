//! Wavefront OBJ, parsed by tobj.
//!
//! tobj numbers vertices in the order in which the faces of each object first use them, forgets those that no face
//! uses, and says no line numbers. The file is therefore checked line by line first, and what tobj is given is one
//! object whose first face names every vertex in order: then its numbering is that of the `v` lines.
//! Materials, normals, texture coordinates, lines and points are not read.

use std::fmt::Write;

use salient_sdk::NodeError;

use super::raw::{Polygons, Raw, bad};

const FORMAT: &str = "OBJ";

/// Reads an OBJ file.
pub fn read(bytes: &[u8]) -> Result<Raw, NodeError> {
    let Checked { body, vertices, .. } = check(bytes)?;
    let mut text = String::with_capacity(body.len() + 8 * vertices);
    text.push('f');
    for i in 1..=vertices {
        // Writing to a string cannot fail.
        let _ = write!(text, " {i}");
    }
    text.push('\n');
    text.push_str(&body);
    drop(body);
    let options = tobj::LoadOptions::default();
    let no_material = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) =
        tobj::load_obj_buf(&mut text.as_bytes(), &options, no_material).map_err(|e| bad(FORMAT, "file", e))?;
    let [model] = &models[..] else { return Err(bad(FORMAT, "file", "no object")) };
    let (positions, indices) = (model.mesh.positions.as_chunks().0, &model.mesh.indices);
    let mut polygons = Polygons::default();
    let mut rest = &indices[vertices.min(indices.len())..];
    let arities = model.mesh.face_arities.get(1..).unwrap_or_default();
    let mut arity = arities.iter().map(|&n| n as usize);
    while !rest.is_empty() {
        // Without arities all faces are triangles.
        let (face, after) = rest
            .split_at_checked(arity.next().unwrap_or(3))
            .ok_or_else(|| bad(FORMAT, "file", "a face has too few corners"))?;
        polygons.push(face.iter().copied());
        rest = after;
    }
    polygons.into_raw(FORMAT, positions.to_vec())
}

/// The `v` and `f` lines of a file that were found to be sound.
#[derive(Default)]
struct Checked {
    body: String,
    vertices: usize,
    /// Line and largest vertex number of the faces that name vertices not yet seen.
    ahead: Vec<(usize, usize)>,
}

fn check(bytes: &[u8]) -> Result<Checked, NodeError> {
    let mut out = Checked::default();
    let mut lines = bytes.split(|&b| b == b'\n').enumerate();
    let mut joined = Vec::new();
    while let Some((i, line)) = lines.next() {
        let mut line = line.strip_suffix(b"\r").unwrap_or(line);
        if line.ends_with(b"\\") {
            joined.clear();
            while let Some(open) = line.strip_suffix(b"\\") {
                joined.extend_from_slice(open);
                joined.push(b' ');
                line = lines.next().map_or(&[][..], |(_, next)| next);
                line = line.strip_suffix(b"\r").unwrap_or(line);
            }
            joined.extend_from_slice(line);
            line = &joined;
        }
        let content = line.split(|&b| b == b'#').next().unwrap_or_default().trim_ascii();
        let keyword = content.split(u8::is_ascii_whitespace).next().unwrap_or_default();
        if keyword == b"v" || keyword == b"f" {
            let at = |what: String| bad(FORMAT, format_args!("line {}", i + 1), what);
            let text = std::str::from_utf8(content).map_err(|_| at("not text".into()))?;
            let words: Vec<&str> = text[1..].split_whitespace().collect();
            if keyword == b"v" { out.vertex(&words) } else { out.face(&words, i + 1) }.map_err(at)?;
        }
    }
    if let Some((line, index)) = out.ahead.iter().find(|(_, index)| *index > out.vertices) {
        let what = format!("the face names vertex {index}, but the file has {}", out.vertices);
        return Err(bad(FORMAT, format_args!("line {line}"), what));
    }
    Ok(out)
}

impl Checked {
    fn vertex(&mut self, words: &[&str]) -> Result<(), String> {
        // Three coordinates; then maybe a weight to divide by, or a colour of three or four numbers.
        let kept = match words.len() {
            3 | 6 | 7 => &words[..3],
            4 => words,
            n => return Err(format!("a vertex of {n} numbers; 3, 4, 6 or 7 are understood")),
        };
        for (k, word) in kept.iter().enumerate() {
            let number: f64 = word.parse().map_err(|_| format!("`{word}` is not a number"))?;
            if !number.is_finite() || (k == 3 && number == 0.0) {
                return Err(format!("vertex {} has the coordinate {word}", self.vertices + 1));
            }
        }
        self.vertices += 1;
        self.line('v', kept);
        Ok(())
    }

    fn face(&mut self, words: &[&str], line: usize) -> Result<(), String> {
        if words.len() < 3 {
            return Err(format!("a face of {} corners", words.len()));
        }
        let mut largest = 0;
        for word in words {
            let mut parts = word.split('/');
            let number = parts.next().unwrap_or_default();
            let index: isize = number.parse().map_err(|_| format!("`{word}` is not a corner of a face"))?;
            if parts.clone().count() > 2 || parts.any(|p| !p.is_empty() && p.parse::<isize>().is_err()) {
                return Err(format!("`{word}` is not a corner of a face"));
            }
            if index == 0 || index < 0 && index.unsigned_abs() > self.vertices {
                let seen = self.vertices;
                return Err(format!("the face names vertex {index}; {seen} came before, counted from 1"));
            }
            largest = largest.max(index);
        }
        if largest as usize > self.vertices {
            self.ahead.push((line, largest as usize));
        }
        self.line('f', words);
        Ok(())
    }

    fn line(&mut self, keyword: char, words: &[&str]) {
        self.body.push(keyword);
        for word in words {
            self.body.push(' ');
            self.body.push_str(word);
        }
        self.body.push('\n');
    }
}
