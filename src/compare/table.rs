//! The columns side by side: what each result says, and what each stage cost.

use std::collections::BTreeMap;

use serde::Serialize;

use super::library::Library;
use super::side::Side;
use crate::engine::CacheError;

/// One line of the table: a figure of a result, on every side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// Address of the result.
    pub node: String,
    /// Kind of its node.
    pub kind: String,
    /// What the figure is, as in the result's summary.
    pub figure: String,
    /// By side.
    pub values: Vec<Cell>,
}

/// What a side has in a line.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cell {
    /// The figure.
    Value(String),
    /// The side has no such result or figure.
    Absent,
    /// There is no output, and why.
    Failed(String),
}

impl Cell {
    /// For people.
    #[must_use]
    pub fn text(&self) -> String {
        match self {
            Self::Value(text) => text.clone(),
            Self::Absent => "-".into(),
            Self::Failed(why) => why.clone(),
        }
    }
}

/// The figures of all results, in the order of the sides.
pub fn figures(sides: &[Side], library: &Library) -> Result<Vec<Figure>, CacheError> {
    let mut nodes: Vec<&str> = Vec::new();
    let mut seen = std::collections::BTreeSet::new();
    for (address, _) in sides.iter().flat_map(|side| &side.shown) {
        if seen.insert(*address) {
            nodes.push(address);
        }
    }
    let mut rows = Vec::new();
    for node in nodes {
        let mut labels: Vec<&str> = Vec::new();
        let (mut kind, mut columns) = ("", Vec::new());
        for side in sides {
            let column = column(side, node, library)?;
            if let Some((of, Ok(summary))) = &column {
                kind = of;
                for (label, _) in summary {
                    if !labels.contains(label) {
                        labels.push(label);
                    }
                }
            }
            columns.push(column);
        }
        if labels.is_empty() {
            labels.push("");
        }
        for label in labels {
            let values = columns.iter().map(|column| cell(column.as_ref(), label)).collect();
            let (node, kind, figure) = (node.to_owned(), kind.to_owned(), label.to_owned());
            rows.push(Figure { node, kind, figure, values });
        }
    }
    Ok(rows)
}

type Column<'a> = (&'a str, Result<Vec<(&'static str, String)>, String>);

/// The summary of a result on a side, or why there is none; `None` if the side has no such node.
fn column<'a>(side: &Side<'a>, node: &str, library: &Library) -> Result<Option<Column<'a>>, CacheError> {
    let Some(call) = side.addresses.get(node).copied() else { return Ok(None) };
    let kind = side.kind(call).name.as_str();
    if side.call(call).digest.is_none() {
        return Ok(Some((kind, Err(side.call(call).outcome.name().to_owned()))));
    }
    let Some(artefact) = library.artefact(side, call)? else {
        return Ok(Some((kind, Err("collected".into()))));
    };
    let mut summary = artefact.summary();
    let doubts = side.defects(call).len();
    if doubts > 0 {
        summary.push(("doubts", doubts.to_string()));
    }
    Ok(Some((kind, Ok(summary))))
}

fn cell(column: Option<&Column>, label: &str) -> Cell {
    match column {
        None => Cell::Absent,
        Some((_, Err(why))) => Cell::Failed(why.clone()),
        Some((_, Ok(summary))) => {
            let found = summary.iter().find(|(name, _)| *name == label);
            found.map_or(Cell::Absent, |(_, value)| Cell::Value(value.clone()))
        }
    }
}

/// What the calls of one kind cost, on every side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageRow {
    /// The kind.
    pub kind: String,
    /// By side; `None` where there is no such call.
    pub costs: Vec<Option<Cost>>,
}

/// What the calls of one kind cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Cost {
    /// How many calls there are.
    pub calls: usize,
    /// How long computing their outputs took together, in this run or when it was done, in seconds.
    pub seconds: f64,
    /// Size of their outputs in bytes.
    pub output_bytes: u64,
    /// The most that one of them had to hold, its inputs and its output, in bytes.
    pub held_bytes: u64,
    /// The most that one of them needed while it was computed, besides its inputs, in bytes; of those that were measured
    /// because nothing else was done meanwhile.
    pub working_bytes: Option<u64>,
}

/// What each stage cost, the dearest first.
#[must_use]
pub fn stages(sides: &[Side]) -> Vec<StageRow> {
    let mut rows: BTreeMap<&str, Vec<Option<Cost>>> = BTreeMap::new();
    for (column, side) in sides.iter().enumerate() {
        for (call, _) in &side.calls {
            let row = rows.entry(side.kind(*call).name.as_str()).or_insert_with(|| vec![None; sides.len()]);
            let cost = row[column].get_or_insert_default();
            let it = side.call(*call);
            let bytes = it.bytes.unwrap_or_default();
            let inputs: BTreeMap<usize, u64> =
                it.inputs.iter().map(|(_, _, from)| (*from, side.call(*from).bytes.unwrap_or_default())).collect();
            cost.calls += 1;
            cost.seconds += it.seconds.unwrap_or_default();
            cost.output_bytes += bytes;
            cost.working_bytes = cost.working_bytes.max(it.working);
            cost.held_bytes = cost.held_bytes.max(bytes + inputs.values().sum::<u64>());
        }
    }
    let seconds = |row: &StageRow| row.costs.iter().flatten().map(|cost| cost.seconds).fold(0.0, f64::max);
    let mut rows: Vec<_> = rows.into_iter().map(|(kind, costs)| StageRow { kind: kind.to_owned(), costs }).collect();
    rows.sort_by(|a, b| seconds(b).total_cmp(&seconds(a)));
    rows
}
