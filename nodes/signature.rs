//! One vector that stands for a whole shape. Not a node: made by `shape_dna`, `heat_signature`, `wave_signature` and others, and compared by
//! `signature_similarity`.

use std::sync::Arc;

use salient_sdk::{Artefact, Decoder, Encoder, FormatError, Inputs, NodeError, Port, PortValues, Table};
use serde_json::{Value, json};

use crate::eigensolve::Eigenpairs;

/// The input of the nodes whose signatures rest on eigenpairs alone.
pub struct Spectral {
    /// Eigenpairs of the shape's Laplacian.
    pub basis: Arc<Eigenpairs>,
}

impl Inputs for Spectral {
    const PORTS: &'static [Port] = &[Port::one::<Eigenpairs>("basis", "eigenpairs of the shape's Laplacian")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { basis: from.one("basis")? })
    }
}

/// A vector that stands for a shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Signature {
    /// What it is, in a few words; signatures of different kinds are not compared.
    pub kind: String,
    /// Its values, without unit.
    pub values: Vec<f64>,
}

impl Artefact for Signature {
    const TYPE: &'static str = "signature";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "A vector `values` that stands for a whole shape, free of its size and placement; the header's `kind` says what it is.";

    fn encode(&self, out: &mut Encoder) {
        out.f64("values", &self.values, &[self.values.len()]);
        out.header("kind", &self.kind);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        Ok(Self { kind: from.header("kind")?, values: from.f64("values")?.0 })
    }

    fn json(&self) -> Value {
        json!({ "kind": self.kind, "values": self.values })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        vec![("kind", self.kind.clone()), ("values", self.values.len().to_string())]
    }

    fn table(&self) -> Option<Table> {
        let row = |(i, x): (usize, &f64)| vec![i.to_string(), x.to_string()];
        Some(Table::new(&["i", "value"], self.values.iter().enumerate().map(row).collect()))
    }
}
