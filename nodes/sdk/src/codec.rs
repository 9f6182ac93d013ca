//! How an artefact becomes bytes: plain arrays and one small JSON header in the safetensors layout,
//! so that numpy reads any cached intermediate.
//!
//! The bytes are canonical: equal artefacts give equal bytes. All metadata is under the single key
//! `salient` (safetensors keeps its metadata in a map of random order), NaN and infinities are
//! refused, and -0.0 is written as 0.0.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

use safetensors::tensor::{Dtype, Metadata, SafeTensors, TensorInfo};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

/// The bytes are not a valid artefact of the expected type, or an artefact cannot be written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct FormatError(pub String);

/// An artefact could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// It cannot be written anywhere.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The file could not be written.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// What the bytes of an artefact came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written {
    /// How many they are.
    pub bytes: u64,
    /// Whether a value was rewritten (-0.0): then what is in memory is not what a later run reads, and the host must go on with the decoded bytes.
    pub changed: bool,
}

/// Numbers that become bytes at a time.
const PIECE: usize = 1 << 16;

struct Array {
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: usize,
}

/// Where the arrays of an artefact begin, and what goes before them.
struct Layout {
    head: Vec<u8>,
    starts: BTreeMap<String, u64>,
    bytes: u64,
}

/// A place for bytes in any order.
trait Sink {
    fn put(&mut self, position: u64, bytes: &[u8]) -> io::Result<()>;
}

impl Sink for Vec<u8> {
    fn put(&mut self, position: u64, bytes: &[u8]) -> io::Result<()> {
        let begin = position as usize;
        self.resize(self.len().max(begin + bytes.len()), 0);
        self[begin..begin + bytes.len()].copy_from_slice(bytes);
        Ok(())
    }
}

impl Sink for File {
    fn put(&mut self, position: u64, bytes: &[u8]) -> io::Result<()> {
        self.seek(SeekFrom::Start(position))?;
        self.write_all(bytes)
    }
}

/// Takes the header and arrays of one artefact: first their sizes, then, in another pass, their bytes, so that these are never in memory as a whole.
pub struct Encoder<'s> {
    kind: &'static str,
    format: u32,
    header: BTreeMap<String, Value>,
    arrays: BTreeMap<String, Array>,
    changed: bool,
    error: Option<WriteError>,
    writing: Option<(Layout, &'s mut dyn Sink)>,
}

impl<'s> Encoder<'s> {
    fn new(kind: &'static str, format: u32) -> Self {
        let (header, arrays) = (BTreeMap::new(), BTreeMap::new());
        Self { kind, format, header, arrays, changed: false, error: None, writing: None }
    }

    /// The bytes of the artefact of this type and format that `encode` describes.
    pub(crate) fn bytes(
        kind: &'static str,
        format: u32,
        encode: impl Fn(&mut Encoder),
    ) -> Result<(Vec<u8>, bool), FormatError> {
        let mut bytes = Vec::new();
        match Encoder::new(kind, format).run(encode, &mut bytes) {
            Ok(written) => Ok((bytes, written.changed)),
            Err(WriteError::Format(error)) => Err(error),
            Err(WriteError::Io(error)) => Err(FormatError(error.to_string())),
        }
    }

    /// Writes them to an empty file.
    pub(crate) fn write(
        kind: &'static str,
        format: u32,
        encode: impl Fn(&mut Encoder),
        file: &mut File,
    ) -> Result<Written, WriteError> {
        Encoder::new(kind, format).run(encode, file)
    }

    fn run(mut self, encode: impl Fn(&mut Encoder), sink: &'s mut dyn Sink) -> Result<Written, WriteError> {
        encode(&mut self);
        if let Some(error) = self.error.take() {
            return Err(error);
        }
        let layout = self.layout()?;
        let written = Written { bytes: layout.bytes, changed: self.changed };
        sink.put(0, &layout.head)?;
        self.writing = Some((layout, sink));
        encode(&mut self);
        self.error.map_or(Ok(written), Err)
    }

    /// Adds a header entry: anything small that serialises to JSON.
    pub fn header(&mut self, name: &str, value: &impl Serialize) {
        match serde_json::to_value(value) {
            Ok(value) => drop(self.header.insert(name.to_owned(), value)),
            Err(e) => self.fail(format!("header `{name}` cannot be written: {e}")),
        }
    }

    /// Adds an array of doubles of the given shape, row-major. Values must be finite.
    pub fn f64(&mut self, name: &str, values: &[f64], shape: &[usize]) {
        if self.writing.is_none() {
            if let Some(at) = values.iter().position(|x| !x.is_finite()) {
                self.fail(format!("array `{name}` holds {} at entry {at}", values[at]));
            }
            self.changed |= values.iter().any(|x| *x == 0.0 && x.is_sign_negative());
        }
        // Adding 0.0 turns -0.0 into 0.0 and leaves every other value as it is.
        self.array(name, Dtype::F64, shape, values, |x| (x + 0.0).to_le_bytes());
    }

    /// Adds an array of points, shape `[n, 3]`.
    pub fn points(&mut self, name: &str, points: &[[f64; 3]]) {
        self.f64(name, points.as_flattened(), &[points.len(), 3]);
    }

    /// Adds an array of unsigned 32-bit integers of the given shape, row-major.
    pub fn u32(&mut self, name: &str, values: &[u32], shape: &[usize]) {
        self.array(name, Dtype::U32, shape, values, u32::to_le_bytes);
    }

    /// Adds an array of index triples, shape `[n, 3]`.
    pub fn triples(&mut self, name: &str, triples: &[[u32; 3]]) {
        self.u32(name, triples.as_flattened(), &[triples.len(), 3]);
    }

    /// Notes an array's size, or writes it.
    fn array<T: Copy, const B: usize>(
        &mut self,
        name: &str,
        dtype: Dtype,
        shape: &[usize],
        values: &[T],
        bytes: impl Fn(T) -> [u8; B],
    ) {
        let Some((layout, sink)) = &mut self.writing else {
            if shape.iter().product::<usize>() != values.len() {
                self.fail(format!("array `{name}` has {} entries, not the shape {shape:?}", values.len()));
            }
            let array = Array { dtype, shape: shape.to_vec(), bytes: values.len() * B };
            self.arrays.insert(name.to_owned(), array);
            return;
        };
        let Some(mut position) = layout.starts.get(name).copied() else {
            self.fail(format!("array `{name}` was not there when sizes were asked for"));
            return;
        };
        let mut piece: Vec<[u8; B]> = Vec::with_capacity(PIECE.min(values.len()));
        for values in values.chunks(PIECE) {
            piece.clear();
            piece.extend(values.iter().map(|x| bytes(*x)));
            if let Err(error) = sink.put(position, piece.as_flattened()) {
                self.error.get_or_insert(error.into());
                return;
            }
            position += (values.len() * B) as u64;
        }
    }

    fn fail(&mut self, message: String) {
        self.error.get_or_insert(FormatError(message).into());
    }

    /// Where arrays go: by falling alignment, then by name, as the library orders them.
    fn layout(&self) -> Result<Layout, FormatError> {
        let header = serde_json::json!({ "type": self.kind, "format": self.format, "header": self.header });
        let metadata = HashMap::from([("salient".to_owned(), header.to_string())]);
        let mut arrays: Vec<_> = self.arrays.iter().collect();
        arrays.sort_by(|a, b| b.1.dtype.cmp(&a.1.dtype).then(a.0.cmp(b.0)));
        let (mut infos, mut starts, mut end) = (Vec::with_capacity(arrays.len()), BTreeMap::new(), 0);
        for (name, Array { dtype, shape, bytes }) in arrays {
            let data_offsets = (end, end + bytes);
            infos.push((name.clone(), TensorInfo { dtype: *dtype, shape: shape.clone(), data_offsets }));
            starts.insert(name.clone(), end as u64);
            end += bytes;
        }
        let unwritable = |e: String| FormatError(format!("the header cannot be written: {e}"));
        let metadata = Metadata::new(Some(metadata), infos).map_err(|e| unwritable(e.to_string()))?;
        let mut text = serde_json::to_vec(&metadata).map_err(|e| unwritable(e.to_string()))?;
        // Arrays begin at a multiple of eight.
        text.resize(text.len().next_multiple_of(8), b' ');
        let head = [&(text.len() as u64).to_le_bytes(), text.as_slice()].concat();
        for start in starts.values_mut() {
            *start += head.len() as u64;
        }
        Ok(Layout { bytes: (head.len() + end) as u64, head, starts })
    }
}

/// One array of an encoded artefact, as raw little-endian bytes.
#[derive(Clone, Debug)]
pub struct ArrayView<'a> {
    /// Its name.
    pub name: String,
    /// `"f64"` or `"u32"`.
    pub dtype: &'static str,
    /// Its shape, row-major.
    pub shape: Vec<usize>,
    /// Its values, little-endian.
    pub bytes: &'a [u8],
}

/// Reads an artefact's header and arrays back.
pub struct Decoder<'a> {
    kind: String,
    format: u32,
    header: Value,
    arrays: SafeTensors<'a>,
}

impl<'a> Decoder<'a> {
    /// Parses the bytes of any artefact.
    pub fn new(bytes: &'a [u8]) -> Result<Self, FormatError> {
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| FormatError(e.to_string()))?;
        let text = metadata
            .metadata()
            .as_ref()
            .and_then(|m| m.get("salient"))
            .ok_or_else(|| FormatError("no `salient` header: not an artefact of ours".into()))?;
        let mut header: Value = serde_json::from_str(text).map_err(|e| FormatError(e.to_string()))?;
        let kind = header["type"].as_str().unwrap_or_default().to_owned();
        let format = header["format"].as_u64().unwrap_or_default() as u32;
        let arrays = SafeTensors::deserialize(bytes).map_err(|e| FormatError(e.to_string()))?;
        Ok(Self { kind, format, header: header["header"].take(), arrays })
    }

    /// The artefact's type name.
    #[must_use]
    pub fn kind(&self) -> &str {
        &self.kind
    }

    /// The artefact's format version.
    #[must_use]
    pub fn format(&self) -> u32 {
        self.format
    }

    /// All header entries as one JSON object.
    #[must_use]
    pub fn headers(&self) -> &Value {
        &self.header
    }

    /// A header entry.
    pub fn header<T: DeserializeOwned>(&self, name: &str) -> Result<T, FormatError> {
        T::deserialize(&self.header[name]).map_err(|e| FormatError(format!("header `{name}`: {e}")))
    }

    /// All arrays, ordered by name.
    #[must_use]
    pub fn arrays(&self) -> Vec<ArrayView<'a>> {
        let mut views: Vec<_> = self
            .arrays
            .tensors()
            .into_iter()
            .map(|(name, view)| ArrayView {
                name,
                dtype: if view.dtype() == Dtype::F64 { "f64" } else { "u32" },
                shape: view.shape().to_vec(),
                bytes: view.data(),
            })
            .collect();
        views.sort_by(|a, b| a.name.cmp(&b.name));
        views
    }

    /// Whether there is an array of this name.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.arrays.tensor(name).is_ok()
    }

    /// An array of doubles, flat and row-major, with its shape.
    pub fn f64(&self, name: &str) -> Result<(Vec<f64>, Vec<usize>), FormatError> {
        let (bytes, shape) = self.raw(name, Dtype::F64)?;
        Ok((bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect(), shape))
    }

    /// An array of unsigned 32-bit integers, flat and row-major, with its shape.
    pub fn u32(&self, name: &str) -> Result<(Vec<u32>, Vec<usize>), FormatError> {
        let (bytes, shape) = self.raw(name, Dtype::U32)?;
        Ok((bytes.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect(), shape))
    }

    /// An array of points, shape `[n, 3]`.
    pub fn points(&self, name: &str) -> Result<Vec<[f64; 3]>, FormatError> {
        let (flat, shape) = self.f64(name)?;
        Self::three(name, &flat, &shape)
    }

    /// An array of index triples, shape `[n, 3]`.
    pub fn triples(&self, name: &str) -> Result<Vec<[u32; 3]>, FormatError> {
        let (flat, shape) = self.u32(name)?;
        Self::three(name, &flat, &shape)
    }

    fn three<T: Copy>(name: &str, flat: &[T], shape: &[usize]) -> Result<Vec<[T; 3]>, FormatError> {
        match flat.as_chunks() {
            (rows, []) if shape.len() == 2 && shape[1] == 3 => Ok(rows.to_vec()),
            _ => Err(FormatError(format!("array `{name}` has shape {shape:?}, not [n, 3]"))),
        }
    }

    fn raw(&self, name: &str, dtype: Dtype) -> Result<(&'a [u8], Vec<usize>), FormatError> {
        let view = self.arrays.tensor(name).map_err(|e| FormatError(format!("array `{name}`: {e}")))?;
        if view.dtype() != dtype {
            return Err(FormatError(format!("array `{name}` is {:?}, not {dtype:?}", view.dtype())));
        }
        Ok((view.data(), view.shape().to_vec()))
    }
}
