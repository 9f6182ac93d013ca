//! The plan as a picture, for Graphviz and Mermaid.

use std::collections::BTreeSet;

use petgraph::graph::NodeIndex;
use petgraph::visit::{EdgeRef, IntoNodeReferences};

use super::plan::Plan;

/// The plan in the language of Graphviz; what is shown has a double border.
#[must_use]
pub fn to_dot(plan: &Plan) -> String {
    let mut lines = vec!["digraph plan {".to_owned(), "    rankdir=LR;".to_owned()];
    lines.push("    node [shape=box, fontname=\"sans-serif\"];".to_owned());
    let shown = shown(plan);
    for (call, node) in plan.dag.node_references() {
        let label = format!("{}\n{}", plan.name(call), node.node.kind());
        let border = if shown.contains(&call) { ", peripheries=2" } else { "" };
        lines.push(format!("    n{} [label=\"{}\"{border}];", call.index(), dot(&label)));
    }
    for edge in plan.dag.edge_references() {
        let (from, to) = (edge.source().index(), edge.target().index());
        let port = dot(edge.weight().port);
        lines.push(format!("    n{from} -> n{to} [label=\"{port}\"];"));
    }
    lines.push("}\n".to_owned());
    lines.join("\n")
}

/// The plan as a Mermaid flowchart; what is shown has rounded ends.
#[must_use]
pub fn to_mermaid(plan: &Plan) -> String {
    let mut lines = vec!["flowchart LR".to_owned()];
    let shown = shown(plan);
    for (call, node) in plan.dag.node_references() {
        let label = format!("{}<br/>{}", mermaid(plan.name(call)), mermaid(node.node.kind()));
        let (open, close) = if shown.contains(&call) { ("([", "])") } else { ("[", "]") };
        lines.push(format!("    n{}{open}\"{label}\"{close}", call.index()));
    }
    for edge in plan.dag.edge_references() {
        let (from, to) = (edge.source().index(), edge.target().index());
        lines.push(format!("    n{from} -->|{}| n{to}", mermaid(edge.weight().port)));
    }
    lines.push(String::new());
    lines.join("\n")
}

fn shown(plan: &Plan) -> BTreeSet<NodeIndex> {
    plan.show.iter().map(|shown| shown.call).collect()
}

fn dot(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

fn mermaid(text: &str) -> String {
    text.replace('#', "#35;").replace('"', "#quot;").replace('<', "#lt;").replace('>', "#gt;")
}
