//! PLY, text and binary of either byte order, parsed by `ply-rs-bw`.
//!
//! Of element `vertex` the properties x, y, z are read, of element `face` the list `vertex_indices` (or `vertex_index`);
//! all else is skipped. Counts are checked against the bytes that are there before anything is allocated.

use std::io::{BufRead, Cursor};

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};
use salient_sdk::NodeError;

use super::raw::{Polygons, Raw, bad};

const FORMAT: &str = "PLY";

/// One element of any kind: what of it is wanted.
#[derive(Default)]
struct Element {
    point: [Option<f64>; 3],
    corners: Option<Vec<u32>>,
    /// How many numbers it took.
    numbers: usize,
}

impl PropertyAccess for Element {
    fn new() -> Self {
        Self::default()
    }
    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        self.numbers += list_len(&value).map_or(1, |n| n + 1);
        match name {
            "x" => self.point[0] = scalar(&value),
            "y" => self.point[1] = scalar(&value),
            "z" => self.point[2] = scalar(&value),
            "vertex_indices" | "vertex_index" => self.corners = value.to_u32_list(),
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

fn scalar(value: &Property) -> Option<f64> {
    match *value {
        Property::Char(x) => Some(x.into()),
        Property::UChar(x) => Some(x.into()),
        Property::Short(x) => Some(x.into()),
        Property::UShort(x) => Some(x.into()),
        Property::Int(x) => Some(x.into()),
        Property::UInt(x) => Some(x.into()),
        Property::Float(x) => Some(x.into()),
        Property::Double(x) => Some(x),
        _ => None,
    }
}

fn list_len(value: &Property) -> Option<usize> {
    match value {
        Property::ListChar(l) => Some(l.len()),
        Property::ListUChar(l) => Some(l.len()),
        Property::ListShort(l) => Some(l.len()),
        Property::ListUShort(l) => Some(l.len()),
        Property::ListInt(l) => Some(l.len()),
        Property::ListUInt(l) => Some(l.len()),
        Property::ListFloat(l) => Some(l.len()),
        Property::ListDouble(l) => Some(l.len()),
        _ => None,
    }
}

/// Reads a PLY file.
pub fn read(bytes: &[u8]) -> Result<Raw, NodeError> {
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<Element>::new().read_header(&mut reader).map_err(|e| {
        let line = e.line().unwrap_or(1);
        bad(FORMAT, format_args!("line {line}"), one_line(&e.to_string()))
    })?;
    let start = reader.get_ref().position() as usize;
    check_header(&header, bytes, start)?;
    let mut body = Body { cursor: Cursor::new(bytes), encoding: header.encoding, line: 0 };
    body.cursor.set_position(start as u64);
    body.line = bytes[..start].split(|b| *b == b'\n').count() - 1;
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for (name, definition) in &header.elements {
        for i in 0..definition.count {
            let (element, place) = body.element(name, i, definition)?;
            match name.as_str() {
                "vertex" => vertices.push(point(&element, i, &place)?),
                "face" => faces.push((corners(element, i, &place)?, place)),
                _ => {}
            }
        }
    }
    body.end()?;
    let mut polygons = Polygons::default();
    for (i, (face, place)) in faces.into_iter().enumerate() {
        if let Some(index) = face.iter().find(|v| **v as usize >= vertices.len()) {
            let n = vertices.len();
            return Err(bad(
                FORMAT,
                place,
                format_args!("face {i} names vertex {index}, but there are {n}, counted from 0"),
            ));
        }
        polygons.push(face);
    }
    polygons.into_raw(FORMAT, vertices)
}

fn point(element: &Element, i: usize, place: &Place) -> Result<[f64; 3], NodeError> {
    let [Some(x), Some(y), Some(z)] = element.point else {
        return Err(bad(FORMAT, place, format_args!("vertex {i} lacks x, y or z")));
    };
    if [x, y, z].iter().any(|x| !x.is_finite()) {
        return Err(bad(FORMAT, place, format_args!("vertex {i} has a coordinate that is not finite")));
    }
    Ok([x, y, z])
}

fn corners(element: Element, i: usize, place: &Place) -> Result<Vec<u32>, NodeError> {
    match element.corners {
        None => Err(bad(FORMAT, place, format_args!("face {i} has no list of vertex indices, or one below zero"))),
        Some(few) if few.len() < 3 => Err(bad(FORMAT, place, format_args!("face {i} has {} corners", few.len()))),
        Some(corners) => Ok(corners),
    }
}

/// Refuses what would be misread or allocated in vain: repeated names, and counts that the bytes cannot hold.
fn check_header(header: &Header, bytes: &[u8], start: usize) -> Result<(), NodeError> {
    let says =
        |word: &[u8]| bytes[..start].split(|b| *b == b'\n' || *b == b'\r').filter(|l| l.starts_with(word)).count();
    let properties: usize = header.elements.iter().map(|(_, e)| e.properties.len()).sum();
    if says(b"element ") != header.elements.len() || says(b"property ") != properties {
        return Err(bad(FORMAT, "header", "an element or property is given twice"));
    }
    let has = |name: &str| header.elements.iter().any(|(n, _)| n == name);
    if has("tristrips") && !has("face") {
        return Err(bad(FORMAT, "header", "the faces are triangle strips, which are not read"));
    }
    let mut left = bytes.len() - start;
    for (name, element) in &header.elements {
        let each = smallest(element, header.encoding);
        let needed = each.saturating_mul(element.count);
        if element.count > 0 && each == 0 {
            return Err(bad(FORMAT, "header", format_args!("element `{name}` has no properties")));
        }
        // The last line of a text file needs no newline.
        if needed > left + usize::from(header.encoding == Encoding::Ascii) {
            return Err(bad(
                FORMAT,
                "header",
                format_args!(
                    "the header counts {} of element `{name}`, at least {needed} bytes, but {left} are left",
                    element.count
                ),
            ));
        }
        left = left.saturating_sub(needed);
    }
    Ok(())
}

/// The fewest bytes that an element can take.
fn smallest(element: &ElementDef, encoding: Encoding) -> usize {
    let size = |of: &ScalarType| match of {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    let least = |of: &PropertyType| match of {
        // A digit and a space or newline.
        _ if encoding == Encoding::Ascii => 2,
        PropertyType::Scalar(of) | PropertyType::List(of, _) => size(of),
    };
    element.properties.iter().map(|(_, p)| least(&p.data_type)).sum()
}

/// A place in a file.
enum Place {
    Line(usize),
    Byte(u64),
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
        }
    }
}

/// The file after its header.
struct Body<'a> {
    cursor: Cursor<&'a [u8]>,
    encoding: Encoding,
    line: usize,
}

impl Body<'_> {
    fn element(&mut self, name: &str, i: usize, definition: &ElementDef) -> Result<(Element, Place), NodeError> {
        let parser = Parser::<Element>::new();
        let byte = Place::Byte(self.cursor.position());
        let failed = |place: &Place, e: &dyn std::fmt::Display| {
            bad(FORMAT, place, format_args!("{name} {i} of {}: {}", definition.count, one_line(&e.to_string())))
        };
        let read = match self.encoding {
            Encoding::Ascii => {
                let text = self.text().map_err(|e| failed(&Place::Line(self.line), &e))?;
                let place = Place::Line(self.line);
                let Some(text) = text else {
                    return Err(failed(&place, &"the file ends before it"));
                };
                let element = parser.read_ascii_element(&text, definition).map_err(|e| failed(&place, &e))?;
                let given = text.split_whitespace().count();
                if given != element.numbers {
                    let what = format!("{} numbers are wanted, {given} are there", element.numbers);
                    return Err(failed(&place, &what));
                }
                return Ok((element, place));
            }
            Encoding::BinaryLittleEndian => parser.read_little_endian_element(&mut self.cursor, definition),
            Encoding::BinaryBigEndian => parser.read_big_endian_element(&mut self.cursor, definition),
        };
        Ok((read.map_err(|e| failed(&byte, &e))?, byte))
    }

    /// The next line that is not blank.
    fn text(&mut self) -> std::io::Result<Option<String>> {
        loop {
            let mut text = String::new();
            if self.cursor.read_line(&mut text)? == 0 {
                return Ok(None);
            }
            self.line += 1;
            if !text.trim().is_empty() {
                return Ok(Some(text.trim().to_owned()));
            }
        }
    }

    /// Refuses a file that goes on after the last element.
    fn end(&self) -> Result<(), NodeError> {
        let at = self.cursor.position() as usize;
        let rest = self.cursor.get_ref().get(at..).unwrap_or_default();
        match rest.iter().position(|b| !b.is_ascii_whitespace()) {
            Some(i) => Err(bad(FORMAT, Place::Byte((at + i) as u64), "more data than the header counts")),
            None => Ok(()),
        }
    }
}

fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}
