//! What recent runs did: for `plan --why`, and for estimates of time.

use std::collections::BTreeMap;
use std::path::Path;

use petgraph::graph::NodeIndex;
use serde::{Deserialize, Serialize};

use super::cache::{Cache, CacheError, Entry, list, remove};
use super::key::Digest;
use super::schedule::State;
use crate::graph::Plan;

/// How many run records are kept at most.
const KEPT: usize = 50;
/// How many bytes of run records are kept at most, besides the latest.
const KEPT_BYTES: u64 = 64 << 20;

/// One run, as remembered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    /// The graph file, absolute where that can be told.
    pub graph: String,
    /// When it began, in milliseconds since 1970.
    pub when: u64,
    /// Wall time in seconds.
    pub seconds: f64,
    /// Variants in the plan.
    pub variants: Vec<String>,
    /// How each call ended.
    pub calls: Vec<RunCall>,
}

/// One call of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunCall {
    /// All its addresses.
    pub addresses: Vec<String>,
    /// Its kind.
    pub kind: String,
    /// How it ended.
    pub outcome: RunOutcome,
    /// Its key, if there is an output; the record under it says all else.
    pub key: Option<Digest>,
    /// Hash of its output.
    pub digest: Option<Digest>,
    /// How long computing the output took, in this run or in the one that did it.
    pub seconds: Option<f64>,
    /// Why it failed.
    pub message: Option<String>,
}

/// How a call ended, without details.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunOutcome {
    /// Taken from the cache.
    Hit,
    /// Executed.
    Computed,
    /// Failed.
    Failed,
    /// Rests on a failed call.
    Skipped,
    /// Not done when the run was stopped.
    Cancelled,
}

impl RunRecord {
    pub(super) fn new(plan: &Plan, states: &BTreeMap<NodeIndex, State>, when: u64, seconds: f64) -> Self {
        let call = |(call, state): (&NodeIndex, &State)| {
            let it = &plan.dag[*call];
            let record = state.record();
            let (outcome, message) = match state {
                State::Hit(_) => (RunOutcome::Hit, None),
                State::Computed(_) => (RunOutcome::Computed, None),
                State::Failed(error) => (RunOutcome::Failed, Some(error.message.clone())),
                State::Skipped(_) => (RunOutcome::Skipped, None),
                State::Cancelled => (RunOutcome::Cancelled, None),
            };
            RunCall {
                addresses: it.addresses.clone(),
                kind: it.node.kind().to_owned(),
                outcome,
                key: record.map(|r| r.ingredients.key()),
                digest: record.map(|r| r.digest),
                seconds: record.map(|r| r.seconds),
                message,
            }
        };
        Self {
            graph: absolute(&plan.file),
            when,
            seconds,
            variants: plan.variants.clone(),
            calls: states.iter().map(call).collect(),
        }
    }

    /// The call of an address.
    #[must_use]
    pub fn call(&self, address: &str) -> Option<&RunCall> {
        self.calls.iter().find(|call| call.addresses.iter().any(|a| a == address))
    }

    pub(super) fn write(&self, cache: &Cache) -> Result<(), CacheError> {
        let runs = cache.root.join("runs");
        let name = format!("{:014}-{}-{}.json", self.when, std::process::id(), tag(&self.graph));
        cache.write_sealed(&runs.join(name), self)?;
        let mut bytes = 0;
        for (rank, old) in list(&runs)?.iter().rev().enumerate() {
            bytes += std::fs::metadata(old).map_or(0, |meta| meta.len());
            if rank > 0 && (rank >= KEPT || bytes > KEPT_BYTES) {
                remove(old)?;
            }
        }
        Ok(())
    }
}

impl Cache {
    /// Recent runs, latest first; of one graph file only, if given.
    pub fn runs(&self, graph: Option<&Path>) -> Result<impl Iterator<Item = RunRecord>, CacheError> {
        let ending = graph.map(|graph| format!("-{}.json", tag(&absolute(graph))));
        let mut paths = list(&self.root.join("runs"))?;
        paths.retain(|path| ending.as_ref().is_none_or(|ending| path.to_string_lossy().ends_with(ending)));
        paths.reverse();
        let cache = self.clone();
        Ok(paths.into_iter().filter_map(move |path| match cache.sealed(&path, |_| true) {
            Ok(Entry::Found(run)) => Some(run),
            _ => None,
        }))
    }
}

fn absolute(path: &Path) -> String {
    path.canonicalize().unwrap_or_else(|_| path.to_owned()).display().to_string()
}

fn tag(graph: &str) -> String {
    Digest::of(graph.as_bytes()).short()
}

/// What each call is expected to take, in seconds: as in the last run of the graph, else the mean of
/// its kind in that run. Calls of which nothing is known are left out.
pub(super) fn weights(plan: &Plan, cache: &Cache) -> Result<BTreeMap<NodeIndex, f64>, CacheError> {
    let Some(run) = cache.runs(Some(&plan.file))?.next() else { return Ok(BTreeMap::new()) };
    let mut calls: BTreeMap<&str, f64> = BTreeMap::new();
    let mut kinds: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
    for call in &run.calls {
        let Some(seconds) = call.seconds else { continue };
        calls.extend(call.addresses.iter().map(|a| (a.as_str(), seconds)));
        let kind = kinds.entry(&call.kind).or_default();
        *kind = (kind.0 + seconds, kind.1 + 1.0);
    }
    let weight = |index: NodeIndex| {
        let known = calls.get(plan.name(index)).copied();
        let kind = || kinds.get(plan.dag[index].node.kind()).map(|(sum, count)| sum / count);
        Some((index, known.or_else(kind)?))
    };
    Ok(plan.dag.node_indices().filter_map(weight).collect())
}
