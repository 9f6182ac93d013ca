//! What recent runs did: for `plan --why`, `runs`, `compare`, and estimates of time.
//!
//! A run is remembered with its plan: every call with its kind, params, files and wires, how it ended, and if it was
//! executed, why. That is enough to make each call's ingredients again after the records of the cache are gone.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use petgraph::graph::NodeIndex;
use salient_sdk::Defect;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::cache::{Cache, CacheError, list, remove};
use super::event::Totals;
use super::key::{Digest, FileIngredient, Ingredients, InputIngredient};
use super::record::{seal, unseal};
use super::why::Cause;
use crate::graph::Plan;

/// How many runs are remembered at most.
const KEPT: usize = 50;
/// How many bytes of them are kept at most, besides the latest.
const KEPT_BYTES: u64 = 256 << 20;
/// How many bytes of former runs of a graph are read to explain or estimate another, besides the latest.
const READ_BYTES: u64 = 32 << 20;

/// What a run came to, in short.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunSummary {
    /// The graph file, absolute where that can be told.
    pub graph: String,
    /// When it began, in milliseconds since 1970.
    pub when: u64,
    /// Wall time in seconds.
    pub seconds: f64,
    /// How many threads computed.
    pub jobs: usize,
    /// Variants in the plan.
    pub variants: Vec<String>,
    /// How the calls ended.
    pub totals: Totals,
    /// By kind of node.
    pub stages: BTreeMap<String, Stage>,
    /// The most memory that the process has had since it was started, in bytes; absent where the system does not tell.
    pub peak_memory: Option<u64>,
}

/// The calls of one kind in a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// How many calls there are.
    pub calls: usize,
    /// How many were executed.
    pub computed: usize,
    /// How long the executed ones took together, in seconds.
    pub seconds: f64,
    /// How many have an output.
    pub outputs: usize,
    /// How long computing those took together, in this run or in an earlier one, in seconds.
    pub output_seconds: f64,
    /// Size of the outputs in bytes.
    pub bytes: u64,
    /// The most memory that one needed while it was computed, besides its inputs, in bytes; of those that were measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub working: Option<u64>,
}

/// One run, as remembered.
#[derive(Clone, Debug, PartialEq)]
pub struct RunRecord {
    /// What it came to.
    pub summary: RunSummary,
    /// Its plan, and how each call ended.
    pub body: RunBody,
}

/// The plan of a run, and how each call ended.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunBody {
    /// Kinds of node.
    pub kinds: Vec<RunKind>,
    /// Typed params.
    pub params: Vec<Value>,
    /// The calls, producers before consumers.
    pub calls: Vec<RunCall>,
    /// What was asked for: address and call.
    pub shown: Vec<(String, usize)>,
}

/// A kind of node, as it was.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct RunKind {
    /// Its name.
    pub name: String,
    /// Its version.
    pub version: u32,
    /// Type of its output.
    pub output: String,
    /// Version of that type's byte layout.
    pub format: u32,
}

/// One call of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunCall {
    /// All its addresses.
    pub addresses: Vec<String>,
    /// Its kind, in the body's list.
    pub kind: usize,
    /// Its params, in the body's list.
    pub params: usize,
    /// Input files by param.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, FileIngredient>,
    /// What is wired to it: port, label, and the producing call.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<(String, String, usize)>,
    /// How it ended.
    pub outcome: RunOutcome,
    /// Its key, if there is an output.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key: Option<Digest>,
    /// Hash of its output.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<Digest>,
    /// Size of its output.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// How long computing the output took, in this run or in the one that did it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// The most memory that the process gained while it was computed, in bytes, if nothing else was done meanwhile.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub working: Option<u64>,
    /// What is doubtful about its output.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub defects: Vec<Defect>,
    /// Why it failed, or the address of the failed call for which it was skipped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
    /// Why it was executed. Causes of a changed input stand at its producer.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub why: Vec<Cause>,
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

impl RunOutcome {
    /// Its name, as in JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Hit => "hit",
            Self::Computed => "computed",
            Self::Failed => "failed",
            Self::Skipped => "skipped",
            Self::Cancelled => "cancelled",
        }
    }
}

impl RunBody {
    /// The kind of a call.
    #[must_use]
    pub fn kind(&self, call: usize) -> &RunKind {
        &self.kinds[self.calls[call].kind]
    }

    /// All that a call depended on; inputs without an output are left out.
    #[must_use]
    pub fn ingredients(&self, call: usize) -> Ingredients {
        let (it, kind) = (&self.calls[call], self.kind(call));
        let input = |(port, label, from): &(String, String, usize)| {
            let producer = &self.calls[*from];
            Some(InputIngredient {
                port: port.clone(),
                label: label.clone(),
                digest: producer.digest?,
                from: producer.addresses.first().cloned().unwrap_or_default(),
            })
        };
        Ingredients {
            kind: kind.name.clone(),
            version: kind.version,
            output: kind.output.clone(),
            format: kind.format,
            params: self.params[it.params].clone(),
            files: it.files.clone(),
            inputs: it.inputs.iter().filter_map(input).collect(),
        }
    }

    /// Every address and its call.
    #[must_use]
    pub fn addresses(&self) -> HashMap<&str, usize> {
        let calls = self.calls.iter().enumerate();
        calls.flat_map(|(i, call)| call.addresses.iter().map(move |address| (address.as_str(), i))).collect()
    }

    /// Why a call was executed, each changed input followed up to what changed.
    #[must_use]
    pub fn why(&self, call: usize) -> Vec<Cause> {
        self.follow(call, &self.addresses(), &mut BTreeSet::new())
    }

    fn follow(&self, call: usize, index: &HashMap<&str, usize>, seen: &mut BTreeSet<usize>) -> Vec<Cause> {
        seen.insert(call);
        let mut causes = self.calls[call].why.clone();
        for cause in &mut causes {
            if let Cause::Input { from, because, .. } = cause
                && let Some(producer) = index.get(from.as_str()).copied()
                && !seen.contains(&producer)
            {
                *because = self.follow(producer, index, seen);
            }
        }
        causes
    }

    /// Whether all indices are in range: a body from another program's hand must not make us panic.
    fn is_sound(&self) -> bool {
        let n = self.calls.len();
        let call = |(i, call): (usize, &RunCall)| {
            call.kind < self.kinds.len()
                && call.params < self.params.len()
                && call.inputs.iter().all(|(_, _, from)| *from < i)
        };
        self.calls.iter().enumerate().all(call) && self.shown.iter().all(|(_, call)| *call < n)
    }
}

/// A remembered run that has not been read yet.
#[derive(Clone, Debug)]
pub struct RunEntry {
    /// Names it on the command line: eight digits.
    pub id: String,
    /// What it came to.
    pub summary: RunSummary,
    path: PathBuf,
    bytes: u64,
}

impl RunEntry {
    /// Reads all of it; `None` if it was removed or damaged.
    #[must_use]
    pub fn read(&self) -> Option<RunRecord> {
        let text = fs::read(&self.path).ok()?;
        let end = text.iter().position(|byte| *byte == b'\n')?;
        let body: RunBody = unseal(&text[end + 1..])?;
        body.is_sound().then(|| RunRecord { summary: self.summary.clone(), body })
    }
}

impl RunRecord {
    pub(super) fn write(&self, cache: &Cache) -> Result<(), CacheError> {
        let runs = cache.root.join("runs");
        let summary = &self.summary;
        let name = format!("{:014}-{}-{}.json", summary.when, std::process::id(), tag(&summary.graph));
        let path = runs.join(name);
        let failed = |e: serde_json::Error| CacheError::new("write", &path, &e.into());
        let text = seal(summary).map_err(failed)? + &seal(&self.body).map_err(failed)?;
        cache.write(&path, text.as_bytes())?;
        let mut bytes = 0;
        for (rank, old) in list(&runs)?.iter().rev().enumerate() {
            bytes += fs::metadata(old).map_or(0, |meta| meta.len());
            if rank > 0 && (rank >= KEPT || bytes > KEPT_BYTES) {
                remove(old)?;
            }
        }
        Ok(())
    }
}

impl Cache {
    /// Remembered runs, latest first; of one graph file only, if given.
    pub fn runs(&self, graph: Option<&Path>) -> Result<Vec<RunEntry>, CacheError> {
        let ending = graph.map(|graph| format!("-{}.json", tag(&absolute(graph))));
        let mut paths = list(&self.root.join("runs"))?;
        paths.retain(|path| ending.as_ref().is_none_or(|ending| path.to_string_lossy().ends_with(ending)));
        Ok(paths.into_iter().rev().filter_map(entry).collect())
    }

    /// The latest runs of a graph file, latest first, as many as are read in reasonable time.
    pub(super) fn recent(&self, graph: &Path) -> Result<Vec<RunRecord>, CacheError> {
        Ok(read_some(&self.runs(Some(graph))?))
    }

    /// The latest runs of any graph, latest first, as many as are read in reasonable time.
    pub(super) fn readable(&self) -> Result<Vec<RunRecord>, CacheError> {
        Ok(read_some(&self.runs(None)?))
    }
}

fn read_some(runs: &[RunEntry]) -> Vec<RunRecord> {
    let (mut read, mut bytes) = (Vec::new(), 0);
    for run in runs {
        bytes += run.bytes;
        if !read.is_empty() && bytes > READ_BYTES {
            break;
        }
        read.extend(run.read());
    }
    read
}

/// A run's first line, which is all that lists of runs need.
fn entry(path: PathBuf) -> Option<RunEntry> {
    let file = fs::File::open(&path).ok()?;
    let bytes = file.metadata().map_or(0, |meta| meta.len());
    let mut line = Vec::new();
    BufReader::new(file).read_until(b'\n', &mut line).ok()?;
    let summary = unseal(&line)?;
    let name = path.file_stem()?.to_string_lossy();
    let id = Digest::of(name.as_bytes()).to_string().chars().take(8).collect();
    Some(RunEntry { id, summary, path, bytes })
}

fn absolute(path: &Path) -> String {
    path.canonicalize().unwrap_or_else(|_| path.to_owned()).display().to_string()
}

/// The graph file of a plan as runs name it.
pub(super) fn graph_name(plan: &Plan) -> String {
    absolute(&plan.file)
}

fn tag(graph: &str) -> String {
    Digest::of(graph.as_bytes()).short()
}

/// What calls have cost so far.
#[derive(Default)]
pub(super) struct Costs {
    /// By address, from the latest run of the graph that knows it.
    addresses: HashMap<String, f64>,
    /// By key, from the runs read.
    keys: HashMap<Digest, f64>,
    /// Mean of each kind over the remembered runs of any graph.
    kinds: HashMap<String, f64>,
}

impl Costs {
    /// From former runs of a plan's graph, and from those of other graphs for what it never did.
    pub(super) fn of(plan: &Plan, cache: &Cache) -> Result<Self, CacheError> {
        let mut costs = Self::default();
        for run in cache.recent(&plan.file)? {
            costs.take(&run.body);
        }
        let mut kinds: BTreeMap<String, (f64, f64)> = BTreeMap::new();
        for (kind, stage) in cache.runs(None)?.iter().flat_map(|run| &run.summary.stages) {
            let sum = kinds.entry(kind.clone()).or_default();
            *sum = (sum.0 + stage.output_seconds, sum.1 + stage.outputs as f64);
        }
        let mean = |(kind, (sum, count)): (String, (f64, f64))| (count > 0.0).then(|| (kind, sum / count));
        costs.kinds = kinds.into_iter().filter_map(mean).collect();
        Ok(costs)
    }

    /// Adds what other graphs' calls took, by key.
    pub(super) fn add_others(&mut self, cache: &Cache) -> Result<(), CacheError> {
        for call in cache.readable()?.into_iter().flat_map(|run| run.body.calls) {
            if let Some((key, seconds)) = call.key.zip(call.seconds) {
                self.keys.entry(key).or_insert(seconds);
            }
        }
        Ok(())
    }

    fn take(&mut self, body: &RunBody) {
        for call in &body.calls {
            let Some(seconds) = call.seconds else { continue };
            for address in &call.addresses {
                self.addresses.entry(address.clone()).or_insert(seconds);
            }
            if let Some(key) = call.key {
                self.keys.entry(key).or_insert(seconds);
            }
        }
    }

    /// What a call is expected to take, in seconds: what the same computation took, else the call of its address, else
    /// the mean of its kind. `None` if nothing is known.
    pub(super) fn expect(&self, plan: &Plan, call: NodeIndex, key: Option<&Digest>) -> Option<f64> {
        let known = key.and_then(|key| self.keys.get(key));
        let addresses = || plan.dag[call].addresses.iter().find_map(|address| self.addresses.get(address));
        let kind = || self.kinds.get(plan.dag[call].node.kind());
        known.or_else(addresses).or_else(kind).copied()
    }

    /// The expected cost of every call of which something is known.
    pub(super) fn weights(&self, plan: &Plan) -> BTreeMap<NodeIndex, f64> {
        plan.dag.node_indices().filter_map(|call| Some((call, self.expect(plan, call, None)?))).collect()
    }
}
