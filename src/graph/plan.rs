//! The plan: a checked, expanded, static DAG of calls. What the engine runs.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use petgraph::graph::{DiGraph, NodeIndex};
use salient_sdk::{AnyNode, BoundNode};

/// One call of a node kind with its params; equal calls on equal inputs are one call.
#[derive(Clone)]
pub struct Call {
    /// The kind.
    pub node: &'static dyn AnyNode,
    /// Its typed params.
    pub bound: Arc<dyn BoundNode>,
    /// The input files by file param, resolved against the graph file (or, for `--set`, the
    /// working directory).
    pub files: BTreeMap<String, PathBuf>,
    /// Every address that means this call, in order of the file; the first is its name in messages.
    /// `fa/basis` is `basis` inside the subgraph call `fa`, `mesh[cat]` an instance on an axis,
    /// `paper:match` a node of a variant.
    pub addresses: Vec<String>,
}

/// The output of the source call feeds a port of the target call. Wires into one port keep the
/// order of their edge indices.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wire {
    /// The port's name.
    pub port: &'static str,
    /// For a port that takes many: the label of the instance on its axis, or the position in a list of wires.
    /// It is part of the key, so it never holds a node's name.
    pub label: String,
}

/// A result that the graph asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shown {
    /// The address by which the graph asked.
    pub address: String,
    /// The call.
    pub call: NodeIndex,
}

/// A static DAG of calls.
#[derive(Clone, Default)]
pub struct Plan {
    /// The calls and wires; acyclic.
    pub dag: DiGraph<Call, Wire>,
    /// What is shown, in the order of the file.
    pub show: Vec<Shown>,
    /// Every address and the call that it means.
    pub addresses: BTreeMap<String, NodeIndex>,
    /// The graph file.
    pub file: PathBuf,
    /// Names of the variants in the plan; empty for a graph without.
    pub variants: Vec<String>,
    /// Graph files read and folders listed while planning, for watching.
    pub planned_from: Vec<PathBuf>,
}

impl Plan {
    /// The name of a call in messages.
    #[must_use]
    pub fn name(&self, call: NodeIndex) -> &str {
        self.dag[call].addresses.first().map_or("", String::as_str)
    }
}
