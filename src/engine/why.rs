//! Why a call is not in the cache: what changed, since when, back to the file or param that did it.

use std::collections::{BTreeMap, BTreeSet};

use petgraph::graph::NodeIndex;
use serde::Serialize;
use serde_json::Value;

use super::cache::{Cache, CacheError};
use super::forecast::{Forecast, Verdict};
use super::history::{RunOutcome, RunRecord};
use super::key::{Ingredients, wires};
use super::record::Record;
use super::sources::Sources;
use crate::graph::Plan;

/// How many changed inputs of one call are followed up.
const MAX_INPUTS: usize = 5;
/// How many records of a kind are compared when the graph has not run before.
const MAX_RECORDS: usize = 200;

/// One thing that is not as it was.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "cause", rename_all = "snake_case")]
pub enum Cause {
    /// Nothing like it was ever computed in this cache.
    NeverComputed,
    /// It failed in the run compared with.
    FailedBefore {
        /// What it said.
        message: String,
    },
    /// A param has another value. For a file param this is the extension.
    Param {
        /// The param.
        name: String,
        /// Its value then; none if it did not exist.
        before: Option<Value>,
        /// Its value now.
        now: Option<Value>,
    },
    /// An input file has other content.
    File {
        /// The param that names it.
        param: String,
        /// Its path then.
        before: String,
        /// Its path now.
        now: String,
    },
    /// A file that the node found beside its own has other content, appeared or vanished.
    Read {
        /// The param beside whose file it lies.
        param: String,
        /// Its path relative to that file's folder.
        beside: String,
    },
    /// An input has other content, or may have, as its call executes.
    Input {
        /// The port.
        port: String,
        /// The label on a port that takes many.
        label: String,
        /// Address of the producer now.
        from: String,
        /// Why that is; empty if it was said before.
        because: Vec<Cause>,
    },
    /// More inputs changed than are listed.
    MoreInputs {
        /// How many.
        count: usize,
    },
    /// A port is fed by another number of calls, or by calls of other labels.
    Rewired {
        /// The port.
        port: String,
        /// Producers then.
        before: Vec<String>,
        /// Producers now.
        now: Vec<String>,
    },
    /// The node has another version.
    Version {
        /// Then.
        before: u32,
        /// Now.
        now: u32,
    },
    /// The output has another byte layout.
    Format {
        /// Then.
        before: u32,
        /// Now.
        now: u32,
    },
    /// The output is known, but its bytes were collected, and they are needed.
    Evicted {
        /// Address of a call that needs them.
        needed_by: String,
    },
    /// Nothing changed, but the record of the output was collected or damaged.
    RecordGone,
    /// An input file cannot be read.
    Unreadable {
        /// Which, and why.
        message: String,
    },
}

/// Why a call would execute.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Explanation {
    /// Its address.
    pub node: String,
    /// What would become of it.
    #[serde(flatten)]
    pub verdict: Verdict,
    /// When the run was that it is compared with, in milliseconds since 1970.
    pub since: Option<u64>,
    /// What changed; empty for a hit.
    pub causes: Vec<Cause>,
}

/// Explains what would become of a call that is in the forecast.
pub fn why(plan: &Plan, forecast: &Forecast, call: NodeIndex, cache: &Cache) -> Result<Explanation, CacheError> {
    let verdict = forecast.calls[&call].verdict.clone();
    let runs: Vec<_> = cache.runs(Some(&plan.file))?.collect();
    let mut inquiry = Inquiry { plan, forecast, cache, runs, sources: Sources::new(), seen: BTreeSet::new() };
    let causes = match &verdict {
        Verdict::Hit => Vec::new(),
        _ => inquiry.causes(call)?,
    };
    let since = inquiry.before(call)?.and_then(|before| before.when);
    Ok(Explanation { node: plan.name(call).to_owned(), verdict, since, causes })
}

struct Inquiry<'a> {
    plan: &'a Plan,
    forecast: &'a Forecast,
    cache: &'a Cache,
    /// Runs of this graph file, latest first.
    runs: Vec<RunRecord>,
    sources: Sources,
    seen: BTreeSet<NodeIndex>,
}

/// What a call is compared with.
struct Before {
    record: Option<Record>,
    /// The message of its failure.
    failed: Option<String>,
    /// When the run was, if it is one of this graph.
    when: Option<u64>,
}

impl Inquiry<'_> {
    /// The latest run of this graph in which the call came to something, else the nearest record of
    /// its kind.
    fn before(&self, call: NodeIndex) -> Result<Option<Before>, CacheError> {
        let mut failed = None;
        for run in &self.runs {
            let addresses = &self.plan.dag[call].addresses;
            let Some(then) = addresses.iter().find_map(|address| run.call(address)) else {
                continue;
            };
            if then.outcome == RunOutcome::Failed {
                failed.get_or_insert((then.message.clone().unwrap_or_default(), run.when));
            }
            let Some(key) = then.key else { continue };
            let found = self.cache.records(&key)?.0;
            let record = found.into_iter().find(|record| Some(record.digest) == then.digest);
            let failed = failed.map(|(message, _)| message);
            return Ok(Some(Before { record, failed, when: Some(run.when) }));
        }
        let nearest = self.nearest(call)?;
        Ok(match (nearest, failed) {
            (record, Some((message, when))) => Some(Before { record, failed: Some(message), when: Some(when) }),
            (Some(record), None) => Some(Before { record: Some(record), failed: None, when: None }),
            (None, None) => None,
        })
    }

    /// The record of the call's kind, from any recent run, that differs from it in the fewest things.
    fn nearest(&self, call: NodeIndex) -> Result<Option<Record>, CacheError> {
        let Some(now) = &self.forecast.calls[&call].ingredients else { return Ok(None) };
        let mut keys = Vec::new();
        for run in self.cache.runs(None)? {
            let of_kind = run.calls.into_iter().filter(|then| then.kind == now.kind);
            keys.extend(of_kind.filter_map(|then| then.key));
            if keys.len() >= MAX_RECORDS {
                break;
            }
        }
        let distinct: BTreeSet<_> = keys.into_iter().take(MAX_RECORDS).collect();
        let mut best: Option<(usize, Record)> = None;
        for key in distinct {
            for record in self.cache.records(&key)?.0 {
                let distance = distance(&record.ingredients, now);
                if best.as_ref().is_none_or(|(least, _)| distance < *least) {
                    best = Some((distance, record));
                }
            }
        }
        Ok(best.map(|(_, record)| record))
    }

    fn causes(&mut self, call: NodeIndex) -> Result<Vec<Cause>, CacheError> {
        self.seen.insert(call);
        let forecast = self.forecast;
        let prospect = &forecast.calls[&call];
        match &prospect.verdict {
            Verdict::Unreadable { message } => {
                return Ok(vec![Cause::Unreadable { message: message.clone() }]);
            }
            Verdict::Evicted { needed_by } => {
                return Ok(vec![Cause::Evicted { needed_by: needed_by.clone() }]);
            }
            _ => {}
        }
        let Some(before) = self.before(call)? else { return Ok(vec![Cause::NeverComputed]) };
        let mut causes = Vec::new();
        causes.extend(before.failed.map(|message| Cause::FailedBefore { message }));
        if let (Some(then), Some(now)) = (&before.record, &prospect.ingredients) {
            causes.extend(own_changes(&then.ingredients, now));
            self.input_changes(call, &then.ingredients, &mut causes)?;
            if let Ok(Some(read)) = then.changed_read(&self.plan.dag[call], &self.sources) {
                let (param, beside) = (read.param.clone(), read.beside.clone());
                causes.push(Cause::Read { param, beside });
            }
        }
        if causes.is_empty() {
            causes.push(Cause::RecordGone);
        }
        Ok(causes)
    }

    fn input_changes(
        &mut self,
        call: NodeIndex,
        then: &Ingredients,
        causes: &mut Vec<Cause>,
    ) -> Result<(), CacheError> {
        let mut ports: BTreeMap<&str, Vec<(String, NodeIndex)>> = BTreeMap::new();
        for (wire, from) in wires(self.plan, call) {
            ports.entry(wire.port).or_default().push((wire.label.clone(), from));
        }
        let names: BTreeSet<&str> = ports.keys().copied().chain(then.inputs.iter().map(|i| i.port.as_str())).collect();
        let mut changed = Vec::new();
        for port in names {
            let now = ports.get(port).map_or(&[][..], Vec::as_slice);
            let before: Vec<_> = then.inputs.iter().filter(|i| i.port == port).collect();
            let same_labels = before.iter().map(|i| &i.label).eq(now.iter().map(|(l, _)| l));
            if !same_labels {
                causes.push(Cause::Rewired {
                    port: port.to_owned(),
                    before: before.iter().map(|i| i.from.clone()).collect(),
                    now: now.iter().map(|(_, from)| self.plan.name(*from).to_owned()).collect(),
                });
                continue;
            }
            for (input, (label, from)) in before.iter().zip(now) {
                let digest = self.forecast.calls[from].record.as_ref().map(|r| r.digest);
                if digest != Some(input.digest) {
                    changed.push((port.to_owned(), label.clone(), *from));
                }
            }
        }
        let more = changed.len().saturating_sub(MAX_INPUTS);
        for (port, label, from) in changed.into_iter().take(MAX_INPUTS) {
            let because = if self.seen.contains(&from) { Vec::new() } else { self.causes(from)? };
            let from = self.plan.name(from).to_owned();
            causes.push(Cause::Input { port, label, from, because });
        }
        if more > 0 {
            causes.push(Cause::MoreInputs { count: more });
        }
        Ok(())
    }
}

/// What changed of the call itself: node, params and files.
fn own_changes(then: &Ingredients, now: &Ingredients) -> Vec<Cause> {
    let mut causes = Vec::new();
    if then.version != now.version {
        causes.push(Cause::Version { before: then.version, now: now.version });
    }
    if (&then.output, then.format) != (&now.output, now.format) {
        causes.push(Cause::Format { before: then.format, now: now.format });
    }
    let names = |params: &Value| -> BTreeSet<String> {
        params.as_object().into_iter().flatten().map(|(name, _)| name.clone()).collect()
    };
    for name in names(&then.params).union(&names(&now.params)) {
        let (before, now) = (then.params.get(name).cloned(), now.params.get(name).cloned());
        if before != now {
            causes.push(Cause::Param { name: name.clone(), before, now });
        }
    }
    for (param, file) in &now.files {
        if let Some(before) = then.files.get(param).filter(|b| b.digest != file.digest) {
            let (before, now) = (before.path.clone(), file.path.clone());
            causes.push(Cause::File { param: param.clone(), before, now });
        }
    }
    causes
}

fn distance(then: &Ingredients, now: &Ingredients) -> usize {
    let digests = |of: &Ingredients| -> BTreeSet<_> {
        of.inputs.iter().map(|i| (i.port.clone(), i.label.clone(), i.digest)).collect()
    };
    let inputs = digests(then).symmetric_difference(&digests(now)).count();
    own_changes(then, now).len() + inputs
}
