//! All that runs and watches tell the outside: one closed enum for terminal, JSON lines and reports.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::key::Digest;

/// Something that happened in a run. As JSON: one object with the variant in `event`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// First of every run.
    RunStarted {
        /// The graph file.
        graph: String,
        /// How many calls the wanted results need.
        calls: usize,
        /// Addresses of the wanted results.
        shown: Vec<String>,
        /// How many workers there are.
        jobs: usize,
    },
    /// The output was in the cache.
    Hit {
        /// Address of the call.
        node: String,
        /// Its kind.
        kind: String,
        /// Hash of its output.
        digest: Digest,
    },
    /// A call began to execute.
    Started {
        /// Address of the call.
        node: String,
        /// Its kind.
        kind: String,
    },
    /// A call reports how far it is.
    Progress {
        /// Address of the call.
        node: String,
        /// From 0 to 1.
        fraction: f64,
    },
    /// How far the run is; about once a second.
    Tally {
        /// Calls that are settled, in whatever way.
        done: usize,
        /// All calls of the run.
        calls: usize,
        /// How long the rest may take, in seconds; null while too little is known.
        remaining: Option<f64>,
    },
    /// A call was executed and its output kept.
    Finished {
        /// Address of the call.
        node: String,
        /// Its kind.
        kind: String,
        /// How long it took.
        seconds: f64,
        /// Size of its output.
        bytes: u64,
        /// Hash of its output.
        digest: Digest,
        /// Figures that it recorded.
        figures: Map<String, Value>,
    },
    /// A call failed; what depends on it is skipped.
    Failed {
        /// Address of the call.
        node: String,
        /// Its kind.
        kind: String,
        /// The files that its params name.
        files: Vec<String>,
        /// What is wrong.
        message: String,
        /// What to do about it.
        help: Option<String>,
    },
    /// A call was not tried, because one that it depends on failed.
    Skipped {
        /// Address of the call.
        node: String,
        /// Its kind.
        kind: String,
        /// Address of the call that failed.
        because: String,
    },
    /// A damaged file was found in the cache and removed; what it held is computed again.
    CacheCorrupt {
        /// Address of the call whose output it held.
        node: String,
        /// The file.
        path: String,
    },
    /// A call whose output had been evicted gave other bytes this time: it is not a pure function
    /// on these machines. What depends on it is computed from the new output.
    Irreproducible {
        /// Address of the call.
        node: String,
        /// Hash of the output on record.
        recorded: Digest,
        /// Hash of the output now.
        now: Digest,
    },
    /// `watch`: inputs are not as the last run, or the one that is running, found them.
    Changed {
        /// Files with other content.
        changed: Vec<String>,
        /// Files that are new.
        added: Vec<String>,
        /// Files that are gone.
        removed: Vec<String>,
        /// Whether a run was going on.
        running: bool,
    },
    /// `watch`: the graph cannot be planned. The last results stand.
    Broken {
        /// What is wrong, as `check --json` says it.
        diagnostics: Value,
        /// The same for people.
        text: String,
    },
    /// After a run that saw one state of its inputs: what it found, as far as its calls did not fail.
    Results {
        /// One object for each: `node` (the address), `kind`, `type`, `digest`, `summary`, `defects`.
        results: Vec<Value>,
        /// One object for each call that failed: `node`, `kind`, `files`, `message`, `help`, `skipped`.
        failures: Vec<Value>,
    },
    /// `watch`: nothing is left to do until an input changes.
    Watching {
        /// The graph file.
        graph: String,
        /// How many files are watched, there or not.
        files: usize,
        /// How many folders are watched for them.
        folders: usize,
        /// How often all is looked at, in seconds, whatever the system tells.
        every: f64,
    },
    /// Last of every run that the cache did not stop.
    RunFinished {
        /// How the calls ended.
        #[serde(flatten)]
        totals: Totals,
        /// Wall time of the run.
        seconds: f64,
    },
}

/// How many calls ended how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Totals {
    /// Outputs taken from the cache.
    pub hits: usize,
    /// Calls executed.
    pub computed: usize,
    /// Calls that failed.
    pub failed: usize,
    /// Calls that rest on a failed one.
    pub skipped: usize,
    /// Calls that an interrupted run did not come to.
    pub cancelled: usize,
}
