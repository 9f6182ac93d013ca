//! Buffers and accessors, checked at every step.

use std::sync::Arc;

use gltf::json::accessor::{ComponentType, Type};
use gltf::json::buffer::View;
use gltf::json::validation::Checked;
use gltf::json::{Accessor, Index, Root};
use salient_sdk::{Context, NodeError};

use super::{FORMAT, bad, get};

/// Accessors without a buffer view are zeros of any number: more than this many are refused.
const MOST_ZEROS: usize = 1 << 24;

/// The bytes of a document's buffers.
pub struct Buffers(Vec<Arc<[u8]>>);

impl Buffers {
    /// Takes the GLB chunk, decodes data URIs and reads files beside the document.
    pub fn resolve(root: &Root, blob: Option<Vec<u8>>, cx: Context) -> Result<Self, NodeError> {
        let mut blob = blob;
        let mut buffers = Vec::new();
        for (i, buffer) in root.buffers.iter().enumerate() {
            let place = format!("buffer {i}");
            let bytes: Arc<[u8]> = match buffer.uri.as_deref() {
                None => blob.take().ok_or_else(|| bad(FORMAT, &place, "has neither a URI nor a GLB chunk"))?.into(),
                Some(uri) => match uri.strip_prefix("data:") {
                    Some(data) => {
                        let (_, text) = data
                            .split_once(";base64,")
                            .ok_or_else(|| bad(FORMAT, &place, "the data URI is not base64"))?;
                        base64(text).map_err(|e| bad(FORMAT, &place, e))?.into()
                    }
                    None => cx.read_beside("path", &percent_decoded(uri))?,
                },
            };
            let length = buffer.byte_length.0 as usize;
            if length > bytes.len() {
                let n = bytes.len();
                return Err(bad(FORMAT, place, format_args!("{length} bytes are promised, {n} are there")));
            }
            buffers.push(bytes);
        }
        Ok(Self(buffers))
    }

    /// The numbers of an accessor, `width` to an element; normalised integers as fractions.
    pub fn read(&self, root: &Root, index: Index<Accessor>, width: usize, place: &str) -> Result<Vec<f64>, NodeError> {
        let accessor = get(root, index, "accessor")?;
        let at = |what: String| bad(FORMAT, format_args!("{place}, accessor {}", index.value()), what);
        let (Checked::Valid(component), Checked::Valid(shape)) = (accessor.component_type, accessor.type_) else {
            return Err(at("has no known type".into()));
        };
        if components(shape) != width {
            return Err(at(format!("has {} numbers to an element, not {width}", components(shape))));
        }
        let count = accessor.count.0 as usize;
        let component = Component { of: component.0, normalized: accessor.normalized };
        let mut out = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |o| o.0) as usize;
                self.strided(root, view, offset, count, width, component).map_err(at)?
            }
            None if count > MOST_ZEROS => {
                return Err(at(format!("counts {count} elements without data")));
            }
            None => vec![0.0; count * width],
        };
        if let Some(sparse) = &accessor.sparse {
            let n = sparse.count.0 as usize;
            let Checked::Valid(of) = sparse.indices.component_type else {
                return Err(at("has sparse indices of no known type".into()));
            };
            let plain = Component { of: of.0, normalized: false };
            let (indices, values) = (&sparse.indices, &sparse.values);
            let offset = indices.byte_offset.0 as usize;
            let places = self.strided(root, indices.buffer_view, offset, n, 1, plain).map_err(at)?;
            let offset = values.byte_offset.0 as usize;
            let values = self.strided(root, values.buffer_view, offset, n, width, component).map_err(at)?;
            for (k, place) in places.iter().enumerate() {
                let i = *place as usize;
                if i >= count {
                    return Err(at(format!("sparse index {k} is {i}, but there are {count} elements")));
                }
                out[i * width..(i + 1) * width].copy_from_slice(&values[k * width..(k + 1) * width]);
            }
        }
        Ok(out)
    }

    fn strided(
        &self,
        root: &Root,
        view: Index<View>,
        offset: usize,
        count: usize,
        width: usize,
        component: Component,
    ) -> Result<Vec<f64>, String> {
        let size = component.size() * width;
        let past = || format!("{count} elements reach past the end of buffer view {}", view.value());
        let json = root.get(view).ok_or_else(past)?;
        let bytes = self.0.get(json.buffer.value()).ok_or_else(past)?;
        let start = json.byte_offset.map_or(0, |o| o.0) as usize;
        let end = start.checked_add(json.byte_length.0 as usize).ok_or_else(past)?;
        let bytes = bytes.get(start..end).ok_or_else(past)?;
        let stride = json.byte_stride.map_or(size, |s| s.0);
        if stride < size {
            return Err(format!("a stride of {stride} bytes for elements of {size}"));
        }
        if count == 0 {
            return Ok(Vec::new());
        }
        let length = stride.checked_mul(count - 1).and_then(|n| n.checked_add(size));
        let end = length.and_then(|n| n.checked_add(offset)).ok_or_else(past)?;
        let bytes = bytes.get(offset..end).ok_or_else(past)?;
        let element = |i: usize| bytes[i * stride..i * stride + size].chunks_exact(component.size());
        Ok((0..count).flat_map(element).map(|b| component.value(b)).collect())
    }
}

/// How one number is stored.
#[derive(Clone, Copy)]
struct Component {
    of: ComponentType,
    normalized: bool,
}

impl Component {
    fn size(self) -> usize {
        match self.of {
            ComponentType::I8 | ComponentType::U8 => 1,
            ComponentType::I16 | ComponentType::U16 => 2,
            ComponentType::U32 | ComponentType::F32 => 4,
        }
    }

    /// The number in little-endian bytes of [`size`](Self::size). Normalised as in section 3.11 of the specification.
    fn value(self, bytes: &[u8]) -> f64 {
        let (number, most) = match (self.of, bytes) {
            (ComponentType::I8, &[a, ..]) => (f64::from(a as i8), 127.0),
            (ComponentType::U8, &[a, ..]) => (f64::from(a), 255.0),
            (ComponentType::I16, &[a, b, ..]) => (f64::from(i16::from_le_bytes([a, b])), 32767.0),
            (ComponentType::U16, &[a, b, ..]) => (f64::from(u16::from_le_bytes([a, b])), 65535.0),
            (ComponentType::U32, &[a, b, c, d, ..]) => (f64::from(u32::from_le_bytes([a, b, c, d])), 1.0),
            (ComponentType::F32, &[a, b, c, d, ..]) => (f64::from(f32::from_le_bytes([a, b, c, d])), 1.0),
            _ => (f64::NAN, 1.0),
        };
        if self.normalized { (number / most).max(-1.0) } else { number }
    }
}

/// Numbers to an element.
fn components(shape: Type) -> usize {
    match shape {
        Type::Scalar => 1,
        Type::Vec2 => 2,
        Type::Vec3 => 3,
        Type::Vec4 | Type::Mat2 => 4,
        Type::Mat3 => 9,
        Type::Mat4 => 16,
    }
}

/// Decodes base64 (RFC 4648, section 4).
fn base64(text: &str) -> Result<Vec<u8>, String> {
    let digits = text.trim_end_matches('=');
    let mut out = Vec::with_capacity(digits.len() / 4 * 3 + 2);
    let (mut bits, mut held) = (0u32, 0);
    for (i, c) in digits.bytes().enumerate() {
        let digit = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return Err(format!("byte {i} of the base64 data is no base64 digit")),
        };
        bits = (bits << 6 | u32::from(digit)) & 0x00ff_ffff;
        held += 6;
        if held >= 8 {
            held -= 8;
            out.push((bits >> held) as u8);
        }
    }
    if digits.len() % 4 == 1 { Err("the base64 data is cut short".into()) } else { Ok(out) }
}

/// Undoes percent-encoding in a relative URI.
fn percent_decoded(uri: &str) -> String {
    let bytes = uri.as_bytes();
    let (mut out, mut i) = (Vec::with_capacity(bytes.len()), 0);
    while i < bytes.len() {
        let hex = (bytes[i] == b'%').then(|| uri.get(i + 1..i + 3)).flatten();
        if let Some(byte) = hex.and_then(|h| u8::from_str_radix(h, 16).ok()) {
            out.push(byte);
            i += 3;
        } else {
            out.push(bytes[i]);
            i += 1;
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}
