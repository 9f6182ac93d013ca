//! The plan as a picture, for Graphviz and Mermaid.

use std::collections::BTreeSet;

use petgraph::graph::NodeIndex;
use petgraph::visit::{EdgeRef, IntoNodeReferences};

use super::plan::Plan;

/// The plan in the language of Graphviz; what is shown has a double border.
#[must_use]
pub fn to_dot(plan: &Plan) -> String {
    let mut out = String::from(
        "digraph plan {\n    rankdir=LR;\n    node [shape=box, fontname=\"sans-serif\"];\n",
    );
    let shown = shown(plan);
    for (call, node) in plan.dag.node_references() {
        let label = format!("{}\n{}", plan.name(call), node.node.kind());
        let border = if shown.contains(&call) { ", peripheries=2" } else { "" };
        out.push_str(&format!("    n{} [label=\"{}\"{border}];\n", call.index(), dot(&label)));
    }
    for edge in plan.dag.edge_references() {
        let (from, to) = (edge.source().index(), edge.target().index());
        let port = dot(edge.weight().port);
        out.push_str(&format!("    n{from} -> n{to} [label=\"{port}\"];\n"));
    }
    out.push_str("}\n");
    out
}

/// The plan as a Mermaid flowchart; what is shown has rounded ends.
#[must_use]
pub fn to_mermaid(plan: &Plan) -> String {
    let mut out = String::from("flowchart LR\n");
    let shown = shown(plan);
    for (call, node) in plan.dag.node_references() {
        let label = format!("{}<br/>{}", mermaid(plan.name(call)), mermaid(node.node.kind()));
        let (open, close) = if shown.contains(&call) { ("([", "])") } else { ("[", "]") };
        out.push_str(&format!("    n{}{open}\"{label}\"{close}\n", call.index()));
    }
    for edge in plan.dag.edge_references() {
        let (from, to) = (edge.source().index(), edge.target().index());
        out.push_str(&format!("    n{from} -->|{}| n{to}\n", mermaid(edge.weight().port)));
    }
    out
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
