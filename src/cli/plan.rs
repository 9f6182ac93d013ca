//! `salient check`, `salient plan` and `salient graph`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::IsTerminal;

use petgraph::graph::NodeIndex;
use salient_sdk::Registry;
use serde_json::{Value, json};

use super::args::{CheckArgs, GraphArgs, GraphChoice, Picture, PlanArgs};
use super::fail::Fail;
use super::progress::some;
use super::text::{ago, complain, count, print, print_json, seconds, table};
use crate::diagnostics::Diagnostics;
use crate::engine::forecast::{Forecast, Verdict};
use crate::engine::why::{Cause, Explanation, why};
use crate::graph::picture::{to_dot, to_mermaid};
use crate::graph::{OPEN_INPUT, Overrides, Plan};

/// Plans a graph, or says all that is wrong with it.
pub fn load(choice: &GraphChoice, registry: &Registry) -> Result<Plan, Fail> {
    crate::graph::plan(&choice.graph, &overrides(choice), registry).map_err(Fail::Graph)
}

/// What the command line changes in a graph.
pub fn overrides(choice: &GraphChoice) -> Overrides {
    let variants: Vec<String> = choice.variants.iter().flat_map(|names| separated(names)).collect();
    let variants = (!variants.is_empty()).then_some(variants);
    Overrides { sets: choice.sets.clone(), variants }
}

/// Names between commas; those in brackets are part of a name, as in `radius[radius=1.7,unit=Area]`.
fn separated(names: &str) -> Vec<String> {
    let mut depth = 0_usize;
    let split = |c: char| {
        match c {
            '[' => depth += 1,
            ']' => depth = depth.saturating_sub(1),
            _ => {}
        }
        c == ',' && depth == 0
    };
    names.split(split).map(str::to_owned).collect()
}

/// Diagnostics on standard error, with the places in the graph file.
pub fn show(diagnostics: &Diagnostics) {
    let color = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    complain(diagnostics.render(color).trim_end());
}

/// The call of an address.
pub fn find(plan: &Plan, address: &str) -> Result<NodeIndex, Fail> {
    if let Some(call) = plan.addresses.get(address) {
        return Ok(*call);
    }
    let nearest = plan
        .addresses
        .keys()
        .map(|name| (strsim::damerau_levenshtein(name, address), name))
        .min()
        .filter(|(distance, name)| *distance <= name.len().max(3) / 2);
    let help = match nearest {
        Some((_, name)) => format!("did you mean `{name}`?"),
        None => format!("`salient graph {}` shows all of them", plan.file.display()),
    };
    let message = format!("no node has the address `{address}`");
    Err(Fail::Usage { message, help: Some(help) })
}

/// `salient check`.
pub fn check(args: &CheckArgs, registry: &Registry) -> Result<(), Fail> {
    let (mut documents, mut wrong) = (Vec::new(), false);
    let overrides = Overrides { sets: args.sets.clone(), variants: None };
    for file in &args.graphs {
        let name = file.display().to_string();
        match crate::graph::plan(file, &overrides, registry) {
            Ok(plan) if args.json => documents.push(json!({
                "graph": name,
                "ok": true,
                "nodes": plan.dag.node_count(),
                "results": plan.show.len(),
                "diagnostics": [],
            })),
            Ok(plan) => {
                let (nodes, results) = (plan.dag.node_count(), plan.show.len());
                let sizes = format!("{}, {}", count(nodes, "node"), count(results, "result"));
                print(format!("{name}: {sizes}\n").as_bytes())?;
            }
            // Open inputs are all that keeps it from running: a graph for others to call.
            Err(diagnostics) if diagnostics.iter().all(|d| d.code == OPEN_INPUT) => {
                let inputs = diagnostics.iter().map(|d| diagnostics.text(d)).collect::<Vec<_>>();
                if args.json {
                    documents.push(json!({ "graph": name, "ok": true, "inputs": inputs, "diagnostics": [] }));
                } else {
                    print(format!("{name}: a graph to be called, with the input {}\n", inputs.join(", ")).as_bytes())?;
                }
            }
            Err(diagnostics) => {
                wrong = true;
                if args.json {
                    let list = diagnostics.json();
                    documents.push(json!({ "graph": name, "ok": false, "diagnostics": list }));
                } else {
                    show(&diagnostics);
                }
            }
        }
    }
    if args.json {
        print_json(&documents)?;
    }
    if wrong { Err(Fail::WrongReported) } else { Ok(()) }
}

/// How many nodes of a kind that come to the same are listed for people; programs are told of all.
const LISTED: usize = 12;

/// `salient plan`.
pub fn plan(args: &PlanArgs, registry: &Registry) -> Result<(), Fail> {
    let plan = load(&args.graph, registry)?;
    let asked = args.why.as_ref().map(|address| find(&plan, address)).transpose()?;
    let cache = args.cache.open()?;
    let mut wanted: Vec<_> = plan.show.iter().map(|shown| shown.call).collect();
    wanted.extend(asked);
    let forecast = Forecast::new(&plan, &wanted, &cache)?;
    if let Some(call) = asked {
        let explanation = why(&plan, &forecast, call, &cache)?;
        return if args.json { print_json(&explanation) } else { print(explain(&explanation).as_bytes()) };
    }
    if args.json {
        print_json(&forecast_json(&plan, &forecast))
    } else {
        print(forecast_text(&plan, &forecast).as_bytes())
    }
}

fn forecast_json(plan: &Plan, forecast: &Forecast) -> Value {
    let call = |call: &NodeIndex| {
        let prospect = &forecast.calls[call];
        let mut value = json!(prospect.verdict);
        value["node"] = plan.name(*call).into();
        value["addresses"] = json!(plan.dag[*call].addresses);
        value["kind"] = plan.dag[*call].node.kind().into();
        value["expected_seconds"] = json!(prospect.seconds);
        value["digest"] = json!(prospect.record.as_ref().map(|record| record.digest));
        value
    };
    json!({
        "graph": plan.file.display().to_string(),
        "calls": forecast.order.iter().map(call).collect::<Vec<_>>(),
    })
}

fn forecast_text(plan: &Plan, forecast: &Forecast) -> String {
    let mut rows = Vec::new();
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    let mut alike: BTreeMap<(&str, &str), usize> = BTreeMap::new();
    let mut expected = 0.0;
    for call in &forecast.order {
        let prospect = &forecast.calls[call];
        let (word, note) = match &prospect.verdict {
            Verdict::Hit => ("hit", String::new()),
            Verdict::Miss => ("miss", String::new()),
            Verdict::Evicted { needed_by } => {
                ("evicted", format!("known, but its bytes were collected and {needed_by} needs them"))
            }
            Verdict::DependsOnMiss { of } => ("depends on a miss", some(of)),
            Verdict::Unreadable { message } => ("unreadable", message.clone()),
        };
        *counts.entry(word).or_default() += 1;
        let time = prospect.seconds.filter(|_| prospect.verdict.executes());
        expected += time.unwrap_or_default();
        let time = time.map(|time| format!("{} s", seconds(time))).unwrap_or_default();
        let kind = plan.dag[*call].node.kind();
        let so_far = alike.entry((kind, word)).or_default();
        *so_far += 1;
        if *so_far <= LISTED {
            rows.push(vec![word.to_owned(), plan.name(*call).to_owned(), kind.to_owned(), time, note]);
        }
    }
    let counts: Vec<_> = counts.into_iter().map(|(word, count)| format!("{count} {word}")).collect();
    let mut text = table(&rows, 0, &[3]);
    for ((kind, word), all) in alike.into_iter().filter(|(_, all)| *all > LISTED) {
        let _ = writeln!(text, "and {} more of {kind}: {word}", all - LISTED);
    }
    let _ = write!(text, "\n{}: {}", count(forecast.order.len(), "node"), counts.join(", "));
    if expected > 0.0 {
        let _ = write!(text, "; about {} s of computing, by former runs", seconds(expected));
    }
    text + "\n"
}

/// An explanation as indented lines, each input followed up to what changed.
fn explain(explanation: &Explanation) -> String {
    let Explanation { node, verdict, since, causes } = explanation;
    let what = match verdict {
        Verdict::Hit => return format!("{node} is in the cache\n"),
        Verdict::DependsOnMiss { .. } => "rests on nodes that would be computed",
        Verdict::Unreadable { .. } => "would fail",
        _ => "would be computed",
    };
    let since = match since {
        Some(when) => format!(" (compared with the run {})", ago(*when)),
        None => " (this graph has not computed it; compared with the nearest node of its kind)".into(),
    };
    let since = if causes == &[Cause::NeverComputed] { String::new() } else { since };
    let mut text = format!("{node} {what}{since}:\n");
    cause_lines(causes, 1, &mut text);
    text
}

/// Causes as indented lines, each followed by its own.
pub fn cause_lines(causes: &[Cause], depth: usize, text: &mut String) {
    for cause in causes {
        let _ = writeln!(text, "{}{cause}", "  ".repeat(depth));
        if let Cause::Input { because, .. } = cause {
            cause_lines(because, depth + 1, text);
        }
    }
}

/// `salient graph`.
pub fn graph(args: &GraphArgs, registry: &Registry) -> Result<(), Fail> {
    let plan = load(&args.graph, registry)?;
    let text = match args.format {
        Picture::Dot => to_dot(&plan),
        Picture::Mermaid => to_mermaid(&plan),
    };
    print(text.as_bytes())
}
