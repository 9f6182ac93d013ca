//! How an artefact becomes bytes: plain arrays and one small JSON header in the safetensors layout,
//! so that numpy reads any cached intermediate.
//!
//! The bytes are canonical: equal artefacts give equal bytes. All metadata is under the single key
//! `salient` (safetensors keeps its metadata in a map of random order), NaN and infinities are
//! refused, and -0.0 is written as 0.0.

use std::collections::{BTreeMap, HashMap};

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

/// The bytes are not a valid artefact of the expected type, or an artefact cannot be written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct FormatError(pub String);

struct Array {
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

/// Collects the header and arrays of one artefact.
pub struct Encoder {
    kind: &'static str,
    format: u32,
    header: BTreeMap<String, Value>,
    arrays: BTreeMap<String, Array>,
    changed: bool,
    error: Option<FormatError>,
}

impl Encoder {
    pub(crate) fn new(kind: &'static str, format: u32) -> Self {
        Self { kind, format, header: BTreeMap::new(), arrays: BTreeMap::new(), changed: false, error: None }
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
        if let Some(at) = values.iter().position(|x| !x.is_finite()) {
            self.fail(format!("array `{name}` holds {} at entry {at}", values[at]));
        }
        let negative_zero = |x: &f64| *x == 0.0 && x.is_sign_negative();
        self.changed |= values.iter().any(negative_zero);
        // Adding 0.0 turns -0.0 into 0.0 and leaves every other value as it is.
        let bytes = values.iter().flat_map(|x| (x + 0.0).to_le_bytes()).collect();
        self.push(name, Dtype::F64, shape, values.len(), bytes);
    }

    /// Adds an array of points, shape `[n, 3]`.
    pub fn points(&mut self, name: &str, points: &[[f64; 3]]) {
        self.f64(name, points.as_flattened(), &[points.len(), 3]);
    }

    /// Adds an array of unsigned 32-bit integers of the given shape, row-major.
    pub fn u32(&mut self, name: &str, values: &[u32], shape: &[usize]) {
        let bytes = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.push(name, Dtype::U32, shape, values.len(), bytes);
    }

    /// Adds an array of index triples, shape `[n, 3]`.
    pub fn triples(&mut self, name: &str, triples: &[[u32; 3]]) {
        self.u32(name, triples.as_flattened(), &[triples.len(), 3]);
    }

    fn push(&mut self, name: &str, dtype: Dtype, shape: &[usize], len: usize, bytes: Vec<u8>) {
        if shape.iter().product::<usize>() != len {
            self.fail(format!("array `{name}` has {len} entries, not the shape {shape:?}"));
        }
        self.arrays.insert(name.to_owned(), Array { dtype, shape: shape.to_vec(), bytes });
    }

    fn fail(&mut self, message: String) {
        self.error.get_or_insert(FormatError(message));
    }

    /// The bytes, and whether a value was rewritten (-0.0): then what is in memory is not what a
    /// later run reads, and the host must go on with the decoded bytes.
    pub(crate) fn finish(self) -> Result<(Vec<u8>, bool), FormatError> {
        if let Some(error) = self.error {
            return Err(error);
        }
        let header = serde_json::json!({ "type": self.kind, "format": self.format, "header": self.header });
        let metadata = HashMap::from([("salient".to_owned(), header.to_string())]);
        let mut views = Vec::with_capacity(self.arrays.len());
        for (name, array) in &self.arrays {
            let view = TensorView::new(array.dtype, array.shape.clone(), &array.bytes)
                .map_err(|e| FormatError(format!("array `{name}`: {e}")))?;
            views.push((name.as_str(), view));
        }
        let bytes = safetensors::serialize(views, Some(metadata)).map_err(|e| FormatError(e.to_string()))?;
        Ok((bytes, self.changed))
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
