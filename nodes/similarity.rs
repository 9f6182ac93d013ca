//! How alike shapes are: a matrix of queries against targets, the greater the more alike. Not a node: what several nodes make and
//! `rank`, `fuse` and `diffuse` take. Of a large database it has the pairs of a shortlist alone.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use salient_sdk::{Artefact, Decoder, Encoder, FormatError, Inputs, NodeError, Port, PortValues, Table};
use serde_json::{Value, json};

use crate::lists::{self, Lists, Order};

/// How alike each query and each target are.
#[derive(Clone, Debug, PartialEq)]
pub struct Similarity {
    /// What was compared, in a few words.
    pub measure: String,
    /// Names of the queries: one row each.
    pub queries: Vec<String>,
    /// Names of the targets: one column each. A database that is its own set of queries has the same names twice.
    pub targets: Vec<String>,
    /// The greater the more alike, row by row. A distance is its negative.
    pub values: Vec<f64>,
    /// The pairs that were compared, which `values` is of; `None` for all.
    pub compared: Option<Lists>,
    /// Shapes that could not be compared with any, because they failed on the way here.
    pub missing: Vec<String>,
}

impl Similarity {
    /// How `values` are ordered.
    #[must_use]
    pub fn order(&self) -> Order<'_> {
        Order { targets: self.targets.len(), lists: self.compared.as_ref() }
    }

    /// The values of a query: of all targets, or of those on its list.
    #[must_use]
    pub fn row(&self, query: usize) -> &[f64] {
        &self.values[self.order().span(query)]
    }

    /// The targets that a query was compared with, ascending, each with its value.
    pub fn entries(&self, query: usize) -> impl Iterator<Item = (usize, f64)> {
        self.order().row(query).zip(self.row(query).iter().copied())
    }

    /// How alike two are, if they were compared.
    #[must_use]
    pub fn value(&self, query: usize, target: usize) -> Option<f64> {
        self.order().find(query, target).map(|at| self.values[at])
    }

    /// The same of these shapes alone, which it must have.
    #[must_use]
    pub fn of_shapes(&self, queries: &[String], targets: &[String]) -> Self {
        let (rows, columns) = (places(&self.queries, queries), places(&self.targets, targets));
        let mut renamed = vec![None; self.targets.len()];
        columns.iter().enumerate().for_each(|(to, from)| renamed[*from] = Some(to as u32));
        let mut of = Self {
            queries: queries.to_vec(),
            targets: targets.to_vec(),
            values: Vec::new(),
            compared: None,
            measure: self.measure.clone(),
            missing: self.missing.clone(),
        };
        if self.compared.is_none() {
            of.values = rows.iter().flat_map(|q| columns.iter().map(|t| self.row(*q)[*t])).collect();
            return of;
        }
        let mut lists = Vec::with_capacity(rows.len());
        for q in rows {
            let mut row: Vec<(u32, f64)> = self.entries(q).filter_map(|(t, x)| Some((renamed[t]?, x))).collect();
            row.sort_unstable_by_key(|(t, _)| *t);
            of.values.extend(row.iter().map(|(_, x)| x));
            lists.push(row.into_iter().map(|(t, _)| t).collect());
        }
        of.compared = Some(Lists::new(lists));
        of
    }

    /// Whether every query is a target too, in the same order: a database against itself.
    #[must_use]
    pub fn is_square(&self) -> bool {
        self.queries == self.targets
    }

    /// Refuses another set of pairs.
    pub fn must_fit(&self, other: &Self) -> Result<(), NodeError> {
        if self.queries == other.queries && self.targets == other.targets && self.compared == other.compared {
            return Ok(());
        }
        Err(NodeError::new(format!("{} and {} are not of the same pairs", self.measure, other.measure))
            .help("gather the same shapes for both by `all(..)`, and wire the same `shortlist` to both, or to none"))
    }

    /// The pairs on a shortlist that are of these shapes, which must be among its own.
    pub fn listed(&self, queries: &[String], targets: &[String]) -> Result<Lists, NodeError> {
        self.of_shapes(queries, targets).compared.ok_or_else(|| {
            NodeError::new("what is wired to `shortlist` has all pairs").help("wire a `shortlist` node, or nothing")
        })
    }
}

/// Leaves out the shapes that are not among `known`, and says which.
pub fn keep_known<T>(shapes: &mut Vec<(String, T)>, known: &[String]) -> Vec<String> {
    let known: BTreeSet<&String> = known.iter().collect();
    let lost = shapes.iter().filter(|(name, _)| !known.contains(name)).map(|(name, _)| name.clone()).collect();
    shapes.retain(|(name, _)| known.contains(name));
    lost
}

/// Where each of `wanted` is among `names`.
fn places(names: &[String], wanted: &[String]) -> Vec<usize> {
    let known: BTreeMap<&str, usize> = names.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect();
    wanted.iter().filter_map(|name| known.get(name.as_str()).copied()).collect()
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
    const FORMAT: u32 = 2;
    const DOC: &'static str = "How alike shapes are: `values` [queries, targets], the greater the more alike (a distance is its negative). Of a shortlist \
        `values` [pairs] of those on it: `listed` [pairs] (indices of targets), `lengths` [queries] of each query's list. The header has the names and \
        the shapes that failed.";

    fn encode(&self, out: &mut Encoder) {
        out.f64("values", &self.values, &self.order().shape(self.queries.len()));
        lists::encode(self.compared.as_ref(), out);
        out.header("measure", &self.measure);
        out.header("queries", &self.queries);
        out.header("targets", &self.targets);
        out.header("missing", &self.missing);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let (values, shape) = from.f64("values")?;
        let (queries, targets): (Vec<String>, Vec<String>) = (from.header("queries")?, from.header("targets")?);
        let compared = lists::decode(from, queries.len(), targets.len())?;
        let expected = Order { targets: targets.len(), lists: compared.as_ref() }.shape(queries.len());
        if shape != expected {
            return Err(FormatError(format!("values of shape {shape:?} in place of {expected:?}")));
        }
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
        let mut json = json!({
            "measure": self.measure,
            "queries": self.queries,
            "targets": self.targets,
            "values": rows,
            "failed": self.missing,
        });
        if let Some(lists) = &self.compared {
            json["listed"] = (0..self.queries.len()).map(|q| lists.of(q)).collect();
        }
        json
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let mut lines = vec![
            ("measure", self.measure.clone()),
            ("queries", self.queries.len().to_string()),
            ("targets", self.targets.len().to_string()),
        ];
        if self.compared.is_some() {
            lines.push(self.order().line(self.queries.len()));
        }
        lines.extend(missing_line(&self.missing));
        lines
    }

    fn table(&self) -> Option<Table> {
        if self.compared.is_some() {
            let row =
                |q: usize, (t, x): (usize, f64)| vec![self.queries[q].clone(), self.targets[t].clone(), x.to_string()];
            let rows = (0..self.queries.len()).flat_map(|q| self.entries(q).map(move |entry| row(q, entry)));
            return Some(Table::new(&["query", "target", "value"], rows.collect()));
        }
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
