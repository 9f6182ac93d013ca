//! `salient nodes`: documentation made from the registry.

use std::fmt::Write as _;

use salient_sdk::{AnyNode, Arity, ParamInfo, Registry};

use super::args::NodesArgs;
use super::fail::Fail;
use super::text::{print, print_json, table};
use crate::diagnostics::first_sentence;

/// `salient nodes`.
pub fn nodes(args: &NodesArgs, registry: &Registry) -> Result<(), Fail> {
    let Some(kind) = &args.kind else { return print(overview(registry).as_bytes()) };
    let node = registry.get(kind).ok_or_else(|| unknown(kind, registry))?;
    if args.schema { print_json(&node.schema()) } else { print(document(node).as_bytes()) }
}

fn unknown(kind: &str, registry: &Registry) -> Fail {
    let nearest = registry
        .iter()
        .map(|node| (strsim::damerau_levenshtein(node.kind(), kind), node.kind()))
        .min()
        .filter(|(distance, _)| *distance <= 3);
    let help = nearest
        .map_or_else(|| "`salient nodes` lists all of them".to_owned(), |(_, name)| format!("did you mean `{name}`?"));
    Fail::Usage { message: format!("no node is called `{kind}`"), help: Some(help) }
}

fn overview(registry: &Registry) -> String {
    let row = |node: &'static dyn AnyNode| {
        let first = first_sentence(node.doc());
        let makes = format!("-> {}", node.output().name);
        vec![node.kind().to_owned(), makes, first.trim_end_matches('.').to_owned()]
    };
    let rows: Vec<_> = registry.iter().map(row).collect();
    table(&rows, 0, &[]) + "\n`salient nodes KIND` documents one in full.\n"
}

fn document(node: &'static dyn AnyNode) -> String {
    let output = node.output();
    let mut text = format!("{} (version {})\n\n", node.kind(), node.version());
    text.push_str(&wrap(node.doc(), 0));
    text.push_str("\ninputs\n");
    if node.ports().is_empty() {
        text.push_str("  none\n");
    }
    for port in node.ports() {
        let arity = match port.arity {
            Arity::One => "",
            Arity::Optional => ", optional",
            Arity::Many => ", any number",
            Arity::Surviving => ", any number; without those that failed",
        };
        let _ = writeln!(text, "  {}: {}{arity}", port.name, port.artefact);
        text.push_str(&wrap(port.doc, 6));
    }
    text.push_str("\nparams\n");
    let params = node.params();
    if params.is_empty() {
        text.push_str("  none\n");
    }
    for param in &params {
        let _ = writeln!(text, "  {}: {}", param.name, signature(param));
        text.push_str(&wrap(&param.doc, 6));
    }
    let _ = writeln!(text, "\noutput\n  {} (format {})", output.name, output.format);
    text.push_str(&wrap(output.doc, 6));
    if !node.example().trim().is_empty() {
        text.push_str("\nexample\n");
        for line in node.example().trim().lines() {
            let _ = writeln!(text, "  {}", line.trim());
        }
    }
    text
}

fn signature(param: &ParamInfo) -> String {
    let range = match param.range {
        (Some(low), Some(high)) => format!(", {low} to {high}"),
        (Some(low), None) => format!(", at least {low}"),
        (None, Some(high)) => format!(", at most {high}"),
        (None, None) => String::new(),
    };
    let default = match &param.default {
        None => ", required".to_owned(),
        Some(serde_json::Value::Null) => ", optional".to_owned(),
        Some(serde_json::Value::String(name)) if param.form.contains(name.as_str()) => {
            format!(", default {name}")
        }
        Some(value) => format!(", default {value}"),
    };
    format!("{}{range}{default}", param.form)
}

/// Text in lines of at most 96 characters; blank lines of the source part paragraphs.
fn wrap(text: &str, indent: usize) -> String {
    let mut out = String::new();
    for paragraph in text.split("\n\n") {
        let mut line = String::new();
        for word in paragraph.split_whitespace() {
            if !line.is_empty() && indent + line.chars().count() + 1 + word.chars().count() > 96 {
                let _ = writeln!(out, "{}{line}", " ".repeat(indent));
                line.clear();
            }
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
        if !line.is_empty() {
            let _ = writeln!(out, "{}{line}", " ".repeat(indent));
        }
    }
    out
}
