//! A stand-in for the planner, only until branch `graph` is merged: one call a line, wires by name.

use std::path::Path;

use petgraph::graph::NodeIndex;
use salient_sdk::Registry;

use super::{Call, Plan, Shown, Wire};

/// Stand-in.
#[derive(Default)]
pub struct Overrides {
    /// Stand-in.
    pub sets: Vec<String>,
    /// Stand-in.
    pub variants: Option<Vec<String>>,
}

/// Stand-in.
#[derive(Debug)]
pub struct Diagnostics(String);
impl std::fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}
impl std::error::Error for Diagnostics {}
impl miette::Diagnostic for Diagnostics {}
impl Diagnostics {
    /// Stand-in.
    #[must_use]
    pub fn json(&self) -> serde_json::Value {
        serde_json::json!([{ "message": self.0 }])
    }
}

/// Stand-in.
pub fn plan(file: &Path, overrides: &Overrides, registry: &Registry) -> Result<Plan, Diagnostics> {
    let bad = |what: &str| Diagnostics(format!("{}: {what}", file.display()));
    let text = std::fs::read_to_string(file).map_err(|e| bad(&e.to_string()))?;
    let mut plan = Plan { file: file.to_owned(), ..Plan::default() };
    for line in text.lines().map(str::trim) {
        if let Some(list) = line.strip_prefix("}, show: [") {
            for name in list.trim_end_matches("])").split(", ") {
                let name = name.trim_matches('"');
                let call = *plan.addresses.get(name).ok_or_else(|| bad(name))?;
                plan.show.push(Shown { address: name.into(), call });
            }
            continue;
        }
        let Some((name, rest)) = line.strip_prefix('"').and_then(|l| l.split_once("\": ")) else {
            continue;
        };
        let (kind, body) = rest.split_once('(').ok_or_else(|| bad(line))?;
        let body = body.trim_end_matches(',').trim_end_matches(')');
        let node = registry.get(kind).ok_or_else(|| bad(&format!("unknown kind {kind}")))?;
        let mut wires: Vec<(&'static str, NodeIndex)> = vec![];
        let mut fields: Vec<(String, String)> = vec![];
        for field in body.split(", ").filter(|f| !f.is_empty()) {
            let (key, value) = field.split_once(": ").ok_or_else(|| bad(field))?;
            match node.ports().iter().find(|p| p.name == key) {
                Some(port) => wires.push((
                    port.name,
                    *plan.addresses.get(value.trim_matches('"')).ok_or_else(|| bad(value))?,
                )),
                None => fields.push((key.into(), value.into())),
            }
        }
        for set in &overrides.sets {
            let (at, value) = set.split_once('=').ok_or_else(|| bad(set))?;
            if let Some((to, param)) = at.split_once('.').filter(|(to, _)| *to == name) {
                let _ = to;
                fields.retain(|(key, _)| key != param);
                fields.push((param.into(), value.into()));
            }
        }
        let borrowed: Vec<_> = fields.iter().map(|(a, b)| (a.as_str(), b.as_str())).collect();
        let bound = node.bind(&borrowed).map_err(|e| bad(&e[0].message))?;
        let is_file = |key: &str| node.params().iter().any(|p| p.name == key && p.file);
        let folder = file.parent().unwrap_or(Path::new(""));
        let files = fields
            .iter()
            .filter(|(key, _)| is_file(key))
            .map(|(key, value)| (key.clone(), folder.join(value.trim_matches('"'))))
            .collect();
        let call = plan.dag.add_node(Call { node, bound, files, addresses: vec![name.into()] });
        for (i, (port, from)) in wires.iter().enumerate() {
            let label = if wires.len() > 1 { i.to_string() } else { String::new() };
            plan.dag.add_edge(*from, call, Wire { port, label });
        }
        plan.addresses.insert(name.into(), call);
    }
    Ok(plan)
}
