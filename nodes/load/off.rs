//! OFF, the Object File Format of Geomview, as text.
//!
//! Read line by line: a header `[ST][C][N]OFF`, the counts of vertices, faces and (ignored) edges on the same or the
//! next line, then a line for each vertex and each face. Colours, normals and texture coordinates are skipped.
//! Comments run from `#` to the end of the line. Binary, 4-dimensional and n-dimensional OFF are refused.

use salient_sdk::NodeError;

use super::raw::{Polygons, Raw, bad};

const FORMAT: &str = "OFF";

type Rest<'a> = std::iter::Enumerate<std::slice::Split<'a, u8, fn(&u8) -> bool>>;

/// Lines with something on them.
struct Lines<'a> {
    rest: Rest<'a>,
    /// Number of the last line, from 1.
    at: usize,
}

impl<'a> Lines<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        let newline: fn(&u8) -> bool = |b| *b == b'\n';
        Self { rest: bytes.split(newline).enumerate(), at: 0 }
    }

    fn next(&mut self) -> Result<Option<Vec<&'a str>>, NodeError> {
        while let Some((i, line)) = self.rest.next() {
            self.at = i + 1;
            let line = line.split(|b| *b == b'#').next().unwrap_or_default();
            let text = std::str::from_utf8(line).map_err(|_| self.bad("not text"))?;
            let words: Vec<_> = text.split_whitespace().collect();
            if !words.is_empty() {
                return Ok(Some(words));
            }
        }
        Ok(None)
    }

    fn expect(&mut self, what: &str) -> Result<Vec<&'a str>, NodeError> {
        self.next()?.ok_or_else(|| self.bad(format_args!("the file ends before {what}")))
    }

    fn bad(&self, what: impl std::fmt::Display) -> NodeError {
        bad(FORMAT, format_args!("line {}", self.at.max(1)), what)
    }

    fn number<T: std::str::FromStr>(&self, word: &str, what: &str) -> Result<T, NodeError> {
        word.parse().map_err(|_| self.bad(format_args!("`{word}` is not {what}")))
    }
}

/// Reads an OFF file.
pub fn read(bytes: &[u8]) -> Result<Raw, NodeError> {
    let mut lines = Lines::new(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes));
    let header = lines.expect("its header")?;
    let (extras, after) = keyword(&lines, header[0])?;
    let mut counts: Vec<&str> = if after.is_empty() { Vec::new() } else { vec![after] };
    counts.extend(&header[1..]);
    if counts.first().is_some_and(|w| w.eq_ignore_ascii_case("binary")) {
        return Err(lines.bad("binary OFF is not read").help("convert it to text or to PLY"));
    }
    if counts.is_empty() {
        counts = lines.expect("its counts")?;
    }
    if !(2..=3).contains(&counts.len()) {
        return Err(lines.bad("expected the counts of vertices, faces and edges"));
    }
    let vertex_count: usize = lines.number(counts[0], "a count")?;
    let face_count: usize = lines.number(counts[1], "a count")?;
    let vertices = vertices(&mut lines, vertex_count, &extras, bytes.len())?;
    let polygons = faces(&mut lines, face_count, vertices.len())?;
    if lines.next()?.is_some() {
        return Err(lines.bad(format_args!(
            "more lines than the {vertex_count} vertices and {face_count} faces that the header counts"
        )));
    }
    polygons.into_raw(FORMAT, vertices)
}

/// How many numbers may follow a vertex's coordinates, and what is glued to the keyword (as in `ModelNet40`).
fn keyword<'a>(lines: &Lines, word: &'a str) -> Result<(Vec<usize>, &'a str), NodeError> {
    let Some((prefix, after)) = word.split_once("OFF") else {
        return Err(lines.bad("does not begin with OFF"));
    };
    if prefix.contains(['4', 'n']) {
        return Err(lines.bad(format_args!("{prefix}OFF has vertices of other than three dimensions")));
    }
    let (texture, rest) = prefix.strip_prefix("ST").map_or((0, prefix), |rest| (2, rest));
    let (colour, rest) = rest.strip_prefix('C').map_or((false, rest), |rest| (true, rest));
    let (normal, rest) = rest.strip_prefix('N').map_or((0, rest), |rest| (3, rest));
    if !rest.is_empty() || !after.bytes().all(|b| b.is_ascii_digit()) {
        return Err(lines.bad(format_args!("`{word}` is no header of OFF")));
    }
    // Plain OFF often has colours all the same.
    let colours: &[usize] = match (colour, normal + texture) {
        (true, _) => &[3, 4],
        (false, 0) => &[0, 3, 4],
        (false, _) => &[0],
    };
    Ok((colours.iter().map(|n| n + normal + texture).collect(), after))
}

fn vertices(lines: &mut Lines, count: usize, extras: &[usize], bytes: usize) -> Result<Vec<[f64; 3]>, NodeError> {
    // The count may lie: a vertex takes at least six bytes.
    let mut vertices = Vec::with_capacity(count.min(bytes / 6));
    while vertices.len() < count {
        let i = vertices.len();
        let words = lines.expect(&format!("vertex {i} of {count}"))?;
        if words.len() < 3 || !extras.contains(&(words.len() - 3)) {
            return Err(lines.bad(format_args!("vertex {i} has {} numbers", words.len())));
        }
        let mut point = [0.0; 3];
        for (k, word) in words.iter().enumerate() {
            let number: f64 = lines.number(word, "a number")?;
            if k < 3 {
                point[k] = number;
            }
        }
        if point.iter().any(|x| !x.is_finite()) {
            return Err(lines.bad(format_args!("vertex {i} has a coordinate that is not finite")));
        }
        vertices.push(point);
    }
    Ok(vertices)
}

fn faces(lines: &mut Lines, count: usize, vertices: usize) -> Result<Polygons, NodeError> {
    let mut polygons = Polygons::default();
    for i in 0..count {
        let words = lines.expect(&format!("face {i} of {count}"))?;
        let corners: usize = lines.number(words[0], "a number of corners")?;
        if corners < 3 {
            return Err(lines.bad(format_args!("face {i} has {corners} corners")));
        }
        // What follows the corners is a colour: an index into a table, or three or four numbers.
        let given = words.len() - 1;
        if given < corners || !matches!(given - corners, 0 | 1 | 3 | 4) {
            return Err(lines.bad(format_args!("face {i} says {corners} corners, but {given} numbers follow")));
        }
        let mut face = Vec::with_capacity(corners);
        for word in &words[1..=corners] {
            let index: i64 = lines.number(word, "a vertex index")?;
            if index < 0 || index as usize >= vertices {
                return Err(
                    lines.bad(format_args!("face {i} names vertex {index}, but there are {vertices}, counted from 0"))
                );
            }
            face.push(index as u32);
        }
        polygons.push(face);
    }
    Ok(polygons)
}
