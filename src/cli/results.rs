//! The results of a run, for people, for programs and as files.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Component, Path, PathBuf};

use petgraph::graph::NodeIndex;
use salient_sdk::{AnyArtefact, Defect};
use serde_json::{Value, json};

use super::fail::Fail;
use super::text::{seconds, table};
use crate::engine::cache::write_atomic;
use crate::engine::{Cache, Outcome, State};
use crate::export::{Format, export};
use crate::graph::{Plan, Shown};

/// Defects that are listed for people: a result over a database may rest on hundreds.
const DEFECTS_SHOWN: usize = 10;

/// A shown result.
pub struct Found<'a> {
    shown: &'a Shown,
    kind: &'static str,
    artefact: std::sync::Arc<dyn AnyArtefact>,
    digest: String,
    /// What is doubtful about what it rests on, each with the address where it was first found.
    defects: Vec<(String, Defect)>,
}

/// A result that was found, read from the cache if it is not in memory; `None` if its call did not
/// get done.
pub fn result<'a>(
    plan: &'a Plan,
    outcome: &Outcome,
    shown: &'a Shown,
    cache: &Cache,
) -> Result<Option<Found<'a>>, Fail> {
    let Some(record) = outcome.states.get(&shown.call).and_then(State::record) else {
        return Ok(None);
    };
    let lost = || {
        let message = format!("the output of {} vanished from the cache; run again", shown.address);
        Fail::Lacking(message)
    };
    let artefact = outcome.artefact(plan, shown.call, cache)?.ok_or_else(lost)?;
    Ok(Some(Found {
        shown,
        kind: plan.dag[shown.call].node.kind(),
        digest: record.digest.to_string(),
        defects: defects(plan, outcome, shown.call, artefact.as_ref()),
        artefact,
    }))
}

/// Its defects and those of all it rests on, each once, where it was found first.
fn defects(plan: &Plan, outcome: &Outcome, call: NodeIndex, artefact: &dyn AnyArtefact) -> Vec<(String, Defect)> {
    let (mut found, mut left) = (BTreeMap::from([(call, artefact.defects())]), vec![call]);
    while let Some(call) = left.pop() {
        for producer in plan.dag.neighbors_directed(call, petgraph::Direction::Incoming) {
            if found.contains_key(&producer) {
                continue;
            }
            let record = outcome.states.get(&producer).and_then(State::record);
            found.insert(producer, record.map(|r| r.defects.clone()).unwrap_or_default());
            left.push(producer);
        }
    }
    // A node passes on the defects of what it was given: they are shown where they arose.
    let arose = |call: NodeIndex, defect: &Defect| {
        let mut producers = plan.dag.neighbors_directed(call, petgraph::Direction::Incoming);
        !producers.any(|p| found.get(&p).is_some_and(|known| known.contains(defect)))
    };
    let mut all = Vec::new();
    for (call, defects) in &found {
        for defect in defects.iter().filter(|defect| arose(*call, defect)) {
            all.push((plan.name(*call).to_owned(), defect.clone()));
        }
    }
    all
}

impl Found<'_> {
    /// The address by which it was asked for.
    pub fn address(&self) -> &str {
        &self.shown.address
    }

    /// Its title, summary and defects.
    pub fn text(&self) -> String {
        let rows: Vec<_> =
            self.artefact.summary().into_iter().map(|(label, value)| vec![label.to_owned(), value]).collect();
        let mut text = format!("{} ({})\n{}", self.shown.address, self.kind, table(&rows, 2, &[]));
        for (address, defect) in self.defects.iter().take(DEFECTS_SHOWN) {
            let _ = writeln!(text, "  ! {address}: {defect}");
        }
        if let Some(more) = self.defects.len().checked_sub(DEFECTS_SHOWN).filter(|more| *more > 0) {
            let _ = writeln!(text, "  ! and {more} more such lines: `--json` has all");
        }
        text
    }

    /// What `run --json` says of it.
    pub fn json(&self) -> Value {
        let summary: serde_json::Map<String, Value> =
            self.artefact.summary().into_iter().map(|(label, value)| (label.to_owned(), value.into())).collect();
        let defects: Vec<_> = self
            .defects
            .iter()
            .map(|(address, defect)| json!({ "node": address, "defect": defect, "text": defect.to_string() }))
            .collect();
        json!({
            "node": self.shown.address,
            "kind": self.kind,
            "type": self.artefact.type_name(),
            "digest": self.digest,
            "summary": summary,
            "defects": defects,
        })
    }

    /// Writes it to a folder as JSON and as safetensors: `fa/basis` is `fa/basis.json` there. Returns the files.
    pub fn write(&self, dir: &Path) -> Result<[PathBuf; 2], Fail> {
        let name = PathBuf::from(self.shown.address.as_str());
        if !name.components().all(|part| matches!(part, Component::Normal(_))) {
            let message = format!("`{}` cannot be the name of a file", self.shown.address);
            return Err(Fail::Lacking(message));
        }
        let formats = [Format::Json, Format::Safetensors];
        let files = formats.map(|format| {
            let mut path = dir.join(&name).into_os_string();
            path.push(".");
            path.push(format.extension());
            PathBuf::from(path)
        });
        for (path, format) in files.iter().zip(formats) {
            write(path, &export(self.artefact.as_ref(), format).map_err(|e| Fail::Lacking(e.0))?)?;
        }
        Ok(files)
    }
}

/// Writes a file: whole, or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Fail> {
    let parent = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let failed = |error| Fail::Write { path: path.display().to_string(), error };
    std::fs::create_dir_all(parent).map_err(failed)?;
    if path.is_file() || !path.exists() {
        write_atomic(path, parent, bytes).map_err(failed)
    } else {
        // A device or a pipe cannot be replaced.
        std::fs::write(path, bytes).map_err(failed)
    }
}

/// Time by kind of node, slowest first.
pub fn stages(plan: &Plan, outcome: &Outcome) -> String {
    #[derive(Default)]
    struct Stage {
        calls: usize,
        executed: usize,
        hits: usize,
        seconds: f64,
    }
    let mut stages: BTreeMap<&str, Stage> = BTreeMap::new();
    for (call, state) in &outcome.states {
        let stage = stages.entry(plan.dag[*call].node.kind()).or_default();
        stage.calls += 1;
        match state {
            State::Hit(_) => stage.hits += 1,
            State::Computed(record) => {
                stage.executed += 1;
                stage.seconds += record.seconds;
            }
            _ => {}
        }
    }
    let mut stages: Vec<_> = stages.into_iter().collect();
    stages.sort_by(|(_, a), (_, b)| b.seconds.total_cmp(&a.seconds));
    let mut rows = vec![["stage", "calls", "computed", "cached", "seconds"].map(str::to_owned).to_vec()];
    rows.extend(stages.into_iter().map(|(kind, stage)| {
        let counts = [stage.calls, stage.executed, stage.hits].map(|count| count.to_string());
        let mut row = vec![kind.to_owned()];
        row.extend(counts);
        row.push(seconds(stage.seconds));
        row
    }));
    table(&rows, 0, &[1, 2, 3, 4])
}
