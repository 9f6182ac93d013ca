//! What failed in a run, listed at its end.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use petgraph::graph::NodeIndex;
use serde_json::{Value, json};

use super::text::count;
use crate::engine::{Outcome, State};
use crate::graph::Plan;

/// How many failures are listed for people.
const LISTED: usize = 100;

/// A call that failed.
pub struct Failure {
    node: String,
    kind: &'static str,
    files: Vec<String>,
    message: String,
    help: Option<String>,
    /// How many calls were not tried because of it.
    skipped: usize,
}

/// The failures of a run, in the order of the plan.
pub fn failures(plan: &Plan, outcome: &Outcome) -> Vec<Failure> {
    let mut skipped: BTreeMap<&str, usize> = BTreeMap::new();
    for state in outcome.states.values() {
        if let State::Skipped(because) = state {
            *skipped.entry(because).or_default() += 1;
        }
    }
    let failure = |(call, state): (&NodeIndex, &State)| {
        let State::Failed(error) = state else { return None };
        let it = &plan.dag[*call];
        Some(Failure {
            node: plan.name(*call).to_owned(),
            kind: it.node.kind(),
            files: it.files.values().map(|path| path.display().to_string()).collect(),
            message: error.message.clone(),
            help: error.help.clone(),
            skipped: skipped.get(plan.name(*call)).copied().unwrap_or_default(),
        })
    };
    outcome.states.iter().filter_map(failure).collect()
}

/// The list for people; empty if nothing failed.
pub fn text(failures: &[Failure]) -> String {
    let mut text = String::new();
    for Failure { node, kind, files, message, help, skipped } in failures.iter().take(LISTED) {
        let files = if files.is_empty() { String::new() } else { format!(" on {}", files.join(", ")) };
        let _ = writeln!(text, "  {node} ({kind}){files}: {message}");
        if let Some(help) = help {
            let _ = writeln!(text, "    help: {help}");
        }
        if *skipped > 0 {
            let _ = writeln!(text, "    {} not tried because of it", count(*skipped, "node"));
        }
    }
    if failures.len() > LISTED {
        let _ = writeln!(text, "  and {} more", failures.len() - LISTED);
    }
    if text.is_empty() { text } else { format!("{} failed:\n{text}", count(failures.len(), "node")) }
}

/// The list for programs.
pub fn json(failures: &[Failure]) -> Vec<Value> {
    let value = |it: &Failure| {
        json!({
            "node": it.node,
            "kind": it.kind,
            "files": it.files,
            "message": it.message,
            "help": it.help,
            "skipped": it.skipped,
        })
    };
    failures.iter().map(value).collect()
}
