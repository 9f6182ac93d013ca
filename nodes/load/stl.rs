//! STL, text and binary, parsed by `stl_io`.
//!
//! Corners come out three for each facet, unwelded, as single-precision numbers (which is what STL holds). Whether a
//! file is text is decided by its length, not by its first word: binary files that begin with `solid` are common.
//! Normals are not read. Several solids in one text file are one mesh.

use std::io::Cursor;

use salient_sdk::NodeError;

use super::raw::{Raw, bad};

const FORMAT: &str = "STL";
const HEADER: usize = 84;
const FACET: usize = 50;

/// Reads an STL file.
pub fn read(bytes: &[u8]) -> Result<Raw, NodeError> {
    let counted = bytes.get(80..HEADER).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let promised = counted.map_or(0, |n| HEADER + FACET * n as usize);
    if counted.is_some() && promised == bytes.len() {
        return binary(bytes);
    }
    if let Some(text) = Text::of(bytes) {
        return text.read();
    }
    let Some(count) = counted else {
        return Err(bad(FORMAT, "file", format_args!("{} bytes are too few", bytes.len())));
    };
    let there = (bytes.len() - HEADER) / FACET;
    Err(bad(
        FORMAT,
        "byte 80",
        format_args!(
            "the header counts {count} facets ({promised} bytes), but the file has {} bytes, room for {there}",
            bytes.len()
        ),
    ))
}

fn binary(bytes: &[u8]) -> Result<Raw, NodeError> {
    // A header that begins with `solid` would make stl_io read text.
    let mut masked = bytes.to_vec();
    masked[..80].fill(0);
    let place = |facet: usize| format!("facet {facet} (byte {})", HEADER + FACET * facet);
    collect(&masked, place)
}

fn collect(bytes: &[u8], place: impl Fn(usize) -> String) -> Result<Raw, NodeError> {
    let mut cursor = Cursor::new(bytes);
    let facets = stl_io::create_stl_reader(&mut cursor).map_err(|e| bad(FORMAT, place(0), e))?;
    let mut raw = Raw::default();
    for (i, facet) in facets.enumerate() {
        let facet = facet.map_err(|e| bad(FORMAT, place(i), e))?;
        for corner in facet.vertices {
            let point = corner.0.map(f64::from);
            if point.iter().any(|x| !x.is_finite()) {
                return Err(bad(FORMAT, place(i), "a coordinate is not finite"));
            }
            raw.vertices.push(point);
        }
        if raw.vertices.len() >= u32::MAX as usize {
            return Err(bad(FORMAT, place(i), "too many facets"));
        }
        let next = 3 * i as u32;
        raw.faces.push([next, next + 1, next + 2]);
    }
    Ok(raw)
}

/// A text file brought into the one form that `stl_io` reads: one solid, lower case, normals zero.
struct Text {
    body: String,
    /// The line of each facet, from 1.
    facets: Vec<usize>,
    lines: usize,
    ended: bool,
}

impl Text {
    /// `None` if the file is not text that begins with `solid`.
    fn of(bytes: &[u8]) -> Option<Self> {
        let text = std::str::from_utf8(bytes).ok()?.trim_start();
        let skipped = std::str::from_utf8(bytes).ok()?[..bytes.len() - text.len()].lines().count();
        if !text.get(..5)?.eq_ignore_ascii_case("solid") {
            return None;
        }
        let mut out = Self { body: "solid x\n".into(), facets: vec![], lines: 0, ended: false };
        for (i, line) in text.lines().enumerate() {
            let line = line.trim().to_ascii_lowercase();
            match line.split_whitespace().next() {
                None | Some("solid") => continue,
                Some("endsolid") => {
                    out.ended = true;
                    continue;
                }
                // The normal is ignored, and some files have nan there.
                Some("facet") => {
                    out.facets.push(skipped + i + 1);
                    out.body.push_str("facet normal 0 0 0");
                }
                Some(_) => out.body.push_str(&line),
            }
            out.ended = false;
            out.body.push('\n');
            out.lines = skipped + i + 1;
        }
        out.body.push_str("endsolid x\n");
        Some(out)
    }

    fn read(&self) -> Result<Raw, NodeError> {
        if !self.ended {
            return Err(bad(FORMAT, format_args!("line {}", self.lines), "the file ends before `endsolid`"));
        }
        let place = |facet: usize| {
            let line = self.facets.get(facet).or(self.facets.last()).unwrap_or(&1);
            format!("facet {facet} (line {line})")
        };
        collect(self.body.as_bytes(), place)
    }
}
