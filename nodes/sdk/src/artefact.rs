//! Typed outputs of nodes.

use std::any::Any;
use std::fs::File;
use std::sync::Arc;

use serde_json::Value;

use crate::codec::{Decoder, Encoder, FormatError, WriteError, Written};
use crate::difference::{Difference, Surfaces, of_summaries};
use crate::mesh::{Defect, Mesh};
use crate::view::View;

/// A node's typed output: plain arrays and a small header.
///
/// An artefact holds nothing that varies from run to run (no times, no thread counts): its digest is
/// the identity that downstream cache keys rest on.
pub trait Artefact: Send + Sync + Sized + 'static {
    /// Name of the type, as wires are checked by.
    const TYPE: &'static str;
    /// Version of the byte layout; bumped whenever [`encode`](Self::encode) changes.
    const FORMAT: u32;
    /// What it is, in one or two sentences, with units.
    const DOC: &'static str;
    /// Where it is in space. Known before anything is computed, so that a drawing can be refused in time.
    const PLACE: Place = Place::Nowhere;

    /// Describes header and arrays: called twice, for their sizes and for their bytes.
    fn encode(&self, out: &mut Encoder);

    /// Reads what [`encode`](Self::encode) wrote; never panics on foreign bytes.
    fn decode(from: &Decoder) -> Result<Self, FormatError>;

    /// The artefact as JSON with stable, documented keys (`salient get --format json`).
    fn json(&self) -> Value;

    /// What a person wants to know first: labels and values for the table of results.
    fn summary(&self) -> Vec<(&'static str, String)>;

    /// What is doubtful about it: shown beside every result that rests on it.
    fn defects(&self) -> Vec<Defect> {
        Vec::new()
    }

    /// The surface it carries, for export as OBJ, PLY or OFF.
    fn surface(&self) -> Option<&Mesh> {
        None
    }

    /// Rows for export as CSV.
    fn table(&self) -> Option<Table> {
        None
    }

    /// What can be seen of it, for reports: on the nearest surface upward, or between two.
    fn view(&self) -> View<'_> {
        View::default()
    }

    /// How `other`, an artefact of the same type, differs from this one, in the terms of the field and the most telling
    /// first; empty if in nothing that matters. By default, the lines of the summary that differ.
    fn differences(&self, other: &Self, _surfaces: &Surfaces) -> Vec<Difference> {
        of_summaries(&self.summary(), &other.summary())
    }
}

/// Where an artefact is in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// It has none, and cannot be drawn.
    Nowhere,
    /// It carries its own surface: [`Artefact::surface`] gives one.
    Itself,
    /// Its [`View`] has functions or points on the nearest mesh upward of its node.
    OnSurface,
    /// Its [`View`] has links between the nearest meshes upward of these two ports.
    Between([&'static str; 2]),
}

/// A table for export.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Rows, each as long as `columns`.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with these columns and rows.
    #[must_use]
    pub fn new(columns: &[&str], rows: Vec<Vec<String>>) -> Self {
        Self { columns: columns.iter().map(|c| (*c).to_owned()).collect(), rows }
    }
}

/// An artefact of any type, as the engine holds it.
pub trait AnyArtefact: Send + Sync {
    /// See [`Artefact::TYPE`].
    fn type_name(&self) -> &'static str;
    /// Canonical bytes, and whether they differ from what is in memory (see [`Written::changed`]).
    fn to_bytes(&self) -> Result<(Vec<u8>, bool), FormatError>;
    /// Writes the same bytes to an empty file, a piece at a time.
    fn write(&self, file: &mut File) -> Result<Written, WriteError>;
    /// See [`Artefact::json`].
    fn json(&self) -> Value;
    /// See [`Artefact::summary`].
    fn summary(&self) -> Vec<(&'static str, String)>;
    /// See [`Artefact::defects`].
    fn defects(&self) -> Vec<Defect>;
    /// See [`Artefact::surface`].
    fn surface(&self) -> Option<&Mesh>;
    /// See [`Artefact::table`].
    fn table(&self) -> Option<Table>;
    /// See [`Artefact::view`].
    fn view(&self) -> View<'_>;
    /// See [`Artefact::differences`]; `None` if the other is of another type.
    fn differences(&self, other: &dyn AnyArtefact, surfaces: &Surfaces) -> Option<Vec<Difference>>;
    /// For downcasting to the concrete type.
    fn as_any(&self) -> &dyn Any;
    /// For downcasting to the concrete type.
    fn into_any(self: Arc<Self>) -> Arc<dyn Any + Send + Sync>;
}

impl<T: Artefact> AnyArtefact for T {
    fn type_name(&self) -> &'static str {
        T::TYPE
    }
    fn to_bytes(&self) -> Result<(Vec<u8>, bool), FormatError> {
        Encoder::bytes(T::TYPE, T::FORMAT, |out| self.encode(out))
    }
    fn write(&self, file: &mut File) -> Result<Written, WriteError> {
        Encoder::write(T::TYPE, T::FORMAT, |out| self.encode(out), file)
    }
    fn json(&self) -> Value {
        Artefact::json(self)
    }
    fn summary(&self) -> Vec<(&'static str, String)> {
        Artefact::summary(self)
    }
    fn defects(&self) -> Vec<Defect> {
        Artefact::defects(self)
    }
    fn surface(&self) -> Option<&Mesh> {
        Artefact::surface(self)
    }
    fn table(&self) -> Option<Table> {
        Artefact::table(self)
    }
    fn view(&self) -> View<'_> {
        Artefact::view(self)
    }
    fn differences(&self, other: &dyn AnyArtefact, surfaces: &Surfaces) -> Option<Vec<Difference>> {
        Some(Artefact::differences(self, other.as_any().downcast_ref()?, surfaces))
    }
    fn as_any(&self) -> &dyn Any {
        self
    }
    fn into_any(self: Arc<Self>) -> Arc<dyn Any + Send + Sync> {
        self
    }
}

/// Reads an artefact of one type from its bytes.
pub type Decode = fn(&[u8]) -> Result<Arc<dyn AnyArtefact>, FormatError>;

/// A type of artefact as a value: what the engine knows of it without naming it.
#[derive(Clone, Copy)]
pub struct ArtefactType {
    /// See [`Artefact::TYPE`].
    pub name: &'static str,
    /// See [`Artefact::FORMAT`].
    pub format: u32,
    /// See [`Artefact::DOC`].
    pub doc: &'static str,
    /// See [`Artefact::PLACE`].
    pub place: Place,
    /// Reads an artefact of this type; the error says what is wrong with the bytes.
    pub decode: Decode,
}

impl ArtefactType {
    /// The descriptor of `T`.
    #[must_use]
    pub const fn of<T: Artefact>() -> Self {
        Self { name: T::TYPE, format: T::FORMAT, doc: T::DOC, place: T::PLACE, decode: decode::<T> }
    }
}

fn decode<T: Artefact>(bytes: &[u8]) -> Result<Arc<dyn AnyArtefact>, FormatError> {
    let from = Decoder::new(bytes)?;
    if (from.kind(), from.format()) != (T::TYPE, T::FORMAT) {
        return Err(FormatError(format!(
            "an artefact `{}` of format {}, not `{}` of format {}",
            from.kind(),
            from.format(),
            T::TYPE,
            T::FORMAT
        )));
    }
    Ok(Arc::new(T::decode(&from)?))
}
