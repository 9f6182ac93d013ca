//! How alike shapes are: a matrix of queries against targets, the greater the more alike. Not a node: what several nodes make and
//! `rank`, `fuse`, `diffuse` and `shortlist` take.

use std::sync::Arc;

use salient_sdk::{Artefact, Decoder, Encoder, FormatError, Inputs, NodeError, Port, PortValues, Table};
use serde_json::{Value, json};

/// How alike each query and each target are.
#[derive(Clone, Debug, PartialEq)]
pub struct Similarity {
    /// What was compared, in a few words.
    pub measure: String,
    /// Names of the queries: one row each.
    pub queries: Vec<String>,
    /// Names of the targets: one column each. A database that is its own set of queries has the same names twice.
    pub targets: Vec<String>,
    /// Row-major; the greater the more alike. A distance is its negative.
    pub values: Vec<f64>,
    /// Where a shortlist chose what to compare: 1 for pairs that were, 0 for the others, whose values are below.
    pub compared: Option<Vec<u32>>,
    /// Shapes that could not be compared with any, because they failed on the way here.
    pub missing: Vec<String>,
}

impl Similarity {
    /// The values of a query.
    #[must_use]
    pub fn row(&self, query: usize) -> &[f64] {
        &self.values[query * self.targets.len()..(query + 1) * self.targets.len()]
    }

    /// Whether every query is a target too, in the same order: a database against itself.
    #[must_use]
    pub fn is_square(&self) -> bool {
        self.queries == self.targets
    }

    /// Refuses another set of shapes.
    pub fn must_fit(&self, other: &Self) -> Result<(), NodeError> {
        if self.queries == other.queries && self.targets == other.targets {
            return Ok(());
        }
        let message = format!(
            "{} is of {} by {} shapes, {} of {} by {}, or they differ in name",
            self.measure,
            self.queries.len(),
            self.targets.len(),
            other.measure,
            other.queries.len(),
            other.targets.len()
        );
        Err(NodeError::new(message)
            .help("wire similarities of the same shapes, gathered by `all(..)` along the same axes"))
    }
}

/// Names in one of two lists or in both, each once, sorted.
#[must_use]
pub fn united(a: &[String], b: &[String]) -> Vec<String> {
    let mut all = [a, b].concat();
    all.sort();
    all.dedup();
    all
}

/// A line of a summary about shapes that failed, if there are any.
#[must_use]
pub fn missing_line(missing: &[String]) -> Option<(&'static str, String)> {
    const SHOWN: usize = 8;
    let more = if missing.len() > SHOWN { format!(" and {} more", missing.len() - SHOWN) } else { String::new() };
    let names = missing.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
    (!missing.is_empty()).then(|| ("failed", format!("{}: {names}{more}", missing.len())))
}

/// The input of nodes that rest on one table alone.
pub struct Single {
    /// The table.
    pub similarity: Arc<Similarity>,
}

impl Inputs for Single {
    const PORTS: &'static [Port] = &[Port::one::<Similarity>("similarity", "how alike queries and targets are")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { similarity: from.one("similarity")? })
    }
}

impl Artefact for Similarity {
    const TYPE: &'static str = "similarity";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "How alike shapes are: `values` [queries, targets], the greater the more alike (a distance is its negative); where a \
        shortlist chose the pairs, `compared` [queries, targets] is 1 for those; the header has the names and the shapes that failed.";

    fn encode(&self, out: &mut Encoder) {
        let shape = [self.queries.len(), self.targets.len()];
        out.f64("values", &self.values, &shape);
        if let Some(compared) = &self.compared {
            out.u32("compared", compared, &shape);
        }
        out.header("measure", &self.measure);
        out.header("queries", &self.queries);
        out.header("targets", &self.targets);
        out.header("missing", &self.missing);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let (values, shape) = from.f64("values")?;
        let compared = from.has("compared").then(|| from.u32("compared")).transpose()?;
        let (queries, targets): (Vec<String>, Vec<String>) = (from.header("queries")?, from.header("targets")?);
        let expected = [queries.len(), targets.len()];
        if shape != expected || compared.as_ref().is_some_and(|(_, s)| *s != expected) {
            return Err(FormatError(format!("values of shape {shape:?} for {expected:?} names")));
        }
        let compared = compared.map(|(compared, _)| compared);
        Ok(Self {
            measure: from.header("measure")?,
            queries,
            targets,
            values,
            compared,
            missing: from.header("missing")?,
        })
    }

    fn json(&self) -> Value {
        let rows: Vec<&[f64]> = (0..self.queries.len()).map(|q| self.row(q)).collect();
        json!({
            "measure": self.measure,
            "queries": self.queries,
            "targets": self.targets,
            "values": rows,
            "failed": self.missing,
        })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let mut lines = vec![
            ("measure", self.measure.clone()),
            ("queries", self.queries.len().to_string()),
            ("targets", self.targets.len().to_string()),
        ];
        if let Some(compared) = &self.compared {
            let count = compared.iter().filter(|c| **c == 1).count();
            lines.push(("compared", format!("{count} of {} pairs", compared.len())));
        }
        lines.extend(missing_line(&self.missing));
        lines
    }

    fn table(&self) -> Option<Table> {
        let columns = std::iter::once("query".to_owned()).chain(self.targets.iter().cloned()).collect();
        let row = |(q, name): (usize, &String)| {
            std::iter::once(name.clone()).chain(self.row(q).iter().map(f64::to_string)).collect()
        };
        Some(Table { columns, rows: self.queries.iter().enumerate().map(row).collect() })
    }

    fn differences(&self, other: &Self, _: &salient_sdk::Surfaces) -> Vec<salient_sdk::Difference> {
        crate::differences::similarities(self, other)
    }
}
