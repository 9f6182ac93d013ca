//! `salient compare`: variants, graphs and runs side by side.

use std::collections::BTreeSet;
use std::path::Path;

use salient_sdk::{Registry, Table};
use serde_json::{Value, json};

use super::args::{CompareArgs, CsvOf, GraphChoice};
use super::compare_text;
use super::fail::Fail;
use super::plan::load;
use super::run::{compute, listen, verdict};
use super::runs::find;
use super::text::{complain, print, print_json};
use crate::compare::{self, Comparison, Depth, Figure, Library, Side, StageRow, sides};
use crate::engine::history::RunRecord;
use crate::engine::{Cache, Cancel};
use crate::export::csv;
use crate::graph::Plan;

/// How many nodes of a kind are looked into for people; programs are told of all.
const PER_KIND: usize = 6;

/// All that a comparison found.
pub struct Found<'a> {
    pub sides: &'a [Side<'a>],
    pub figures: Vec<Figure>,
    pub stages: Vec<StageRow>,
    pub pairs: Vec<Comparison>,
}

/// `salient compare`.
pub fn compare(args: &CompareArgs, registry: &Registry) -> Result<(), Fail> {
    let plans = plans(args, registry)?;
    let report = args.report.target()?;
    let cache = args.cache.open()?;
    let mut runs = former(args, &plans, &cache)?;
    let columns = |variants: usize| variants.max(1);
    let known = runs.iter().map(|(_, run)| columns(run.summary.variants.len())).sum::<usize>();
    if known + plans.iter().map(|plan| columns(plan.variants.len())).sum::<usize>() < 2 {
        let message = "there is nothing to compare with: the graph has no two variants, and no run of it is remembered";
        let help = Some("run it, change it, and then compare; or name another graph, or a run with --run".into());
        return Err(Fail::Usage { message: message.into(), help });
    }
    let mut ended = Ok(());
    let cancel = if plans.is_empty() { Cancel::new() } else { listen()? };
    for (graph, plan) in args.graphs.iter().zip(&plans) {
        let wanted: Vec<_> = plan.show.iter().map(|shown| shown.call).collect();
        let outcome = compute(plan, &wanted, &cache, &args.effort, false, &cancel)?;
        let name = if plans.len() + runs.len() > 1 { column_name(graph, args, &runs) } else { String::new() };
        ended = ended.and_then(|()| verdict(&outcome));
        if let Err(Fail::Interrupted) = ended {
            return ended;
        }
        runs.push((name, outcome.record));
    }
    let all: Vec<Side> = runs.iter().flat_map(|(name, run)| sides(name, run)).collect();
    let library = Library::new(&cache, registry);
    let depth = if args.json || args.csv.is_some() { Depth::All } else { Depth::PerKind(PER_KIND) };
    let mut pairs = Vec::new();
    for (i, j) in chosen(args, &all)? {
        pairs.push(compare::compare(&all[i], &all[j], depth, &library)?);
    }
    if let Some(report) = report {
        let summaries: Vec<_> = runs.iter().map(|(_, run)| &run.summary).collect();
        report.write(&summaries, &all, &pairs, &library)?;
    }
    let figures = compare::figures(&all, &library)?;
    let found = Found { sides: &all, figures, stages: compare::stages(&all), pairs };
    let printed = match (args.json, args.csv) {
        (true, _) => print_json(&document(&found)),
        (_, Some(what)) => print(&csv(&if what == CsvOf::Table { table(&found) } else { differences(&found) })),
        _ => print(compare_text::text(&found).as_bytes()),
    };
    match printed {
        Ok(()) | Err(Fail::Pipe) => ended,
        other => other,
    }
}

/// The plans of the graphs, or all that is wrong with the first that has errors.
fn plans(args: &CompareArgs, registry: &Registry) -> Result<Vec<Plan>, Fail> {
    let plan = |graph: &std::path::PathBuf| {
        let (sets, variants) = (args.sets.clone(), args.variants.clone());
        load(&GraphChoice { graph: graph.clone(), sets, variants }, registry)
    };
    args.graphs.iter().map(plan).collect()
}

/// Recorded runs that are compared, each with the head of its column.
fn former(args: &CompareArgs, plans: &[Plan], cache: &Cache) -> Result<Vec<(String, RunRecord)>, Fail> {
    let graph = args.graphs.first().filter(|_| args.graphs.len() == 1).map(std::path::PathBuf::as_path);
    let mut runs = Vec::new();
    for name in &args.runs {
        // `last` is the graph's own; other names may be of any graph.
        let of = graph.filter(|_| name.starts_with("last"));
        let (entry, run) = find(cache, of, name)?;
        runs.push((format!("run {}", entry.id), run));
    }
    if runs.len() == 1 && plans.is_empty() {
        return Err(Fail::usage("one run alone cannot be compared; name a second one with --run, or a graph"));
    }
    let alone = plans.len() == 1 && runs.is_empty() && plans[0].variants.len() < 2;
    if let Some(graph) = graph.filter(|_| alone || args.last)
        && let Some(entry) = cache.runs(Some(graph))?.first()
    {
        let run =
            entry.read().ok_or_else(|| Fail::Lacking(format!("the record of the run {} is damaged", entry.id)))?;
        complain(&format!("comparing with the run {}", entry.id));
        runs.push(("last run".to_owned(), run));
    }
    Ok(runs)
}

fn column_name(graph: &Path, args: &CompareArgs, runs: &[(String, RunRecord)]) -> String {
    if args.graphs.len() == 1 && !runs.is_empty() {
        return "now".into();
    }
    // The file's name tells graphs apart, unless two folders have one of that name.
    let name = graph.file_name();
    let same = args.graphs.iter().filter(|other| other.file_name() == name).count();
    let short = name.filter(|_| same == 1).map(|name| name.to_string_lossy().into_owned());
    short.unwrap_or_else(|| graph.display().to_string())
}

/// The pairs of sides to compare.
fn chosen(args: &CompareArgs, all: &[Side]) -> Result<Vec<(usize, usize)>, Fail> {
    let pairs = (0..all.len()).flat_map(|i| (i + 1..all.len()).map(move |j| (i, j)));
    let Some(name) = &args.against else { return Ok(pairs.collect()) };
    let Some(base) = all.iter().position(|side| side.name == *name) else {
        let names: BTreeSet<&str> = all.iter().map(|side| side.name.as_str()).collect();
        let help = Some(format!("there are {}", names.into_iter().collect::<Vec<_>>().join(", ")));
        return Err(Fail::Usage { message: format!("nothing is called `{name}` here"), help });
    };
    // The one compared against comes first.
    Ok((0..all.len()).filter(|other| *other != base).map(|other| (base, other)).collect())
}

fn document(found: &Found) -> Value {
    let side = |side: &Side| {
        let defects = side.shown.iter().flat_map(|(address, call)| {
            let of = side.defects(*call).into_iter();
            of.map(move |(node, defect)| json!({ "result": address, "node": node, "defect": defect, "text": defect.to_string() }))
        });
        let outcome = |call: usize| side.call(call);
        let failed = side.calls.iter().filter(|(call, _)| outcome(*call).digest.is_none());
        json!({
            "name": side.name,
            "nodes": side.calls.len(),
            "results": side.shown.iter().map(|(address, _)| address).collect::<Vec<_>>(),
            "defects": defects.collect::<Vec<_>>(),
            "failed": failed.map(|(call, node)| {
                json!({ "node": node, "outcome": outcome(*call).outcome, "message": outcome(*call).message })
            }).collect::<Vec<_>>(),
        })
    };
    json!({
        "sides": found.sides.iter().map(side).collect::<Vec<_>>(),
        "figures": found.figures,
        "stages": found.stages,
        "pairs": found.pairs,
    })
}

/// Figures and costs, one line for each and every column.
fn table(found: &Found) -> Table {
    let mut rows = Vec::new();
    for it in &found.figures {
        for (side, cell) in found.sides.iter().zip(&it.values) {
            let value = match cell {
                compare::Cell::Value(text) => text.clone(),
                compare::Cell::Absent => String::new(),
                compare::Cell::Failed(why) => why.clone(),
            };
            rows.push(vec![side.name.clone(), it.node.clone(), it.kind.clone(), it.figure.clone(), value]);
        }
    }
    for it in &found.stages {
        for (side, cost) in found.sides.iter().zip(&it.costs) {
            let Some(cost) = cost else { continue };
            let mut figures = vec![
                ("calls", cost.calls.to_string()),
                ("seconds", cost.seconds.to_string()),
                ("output_bytes", cost.output_bytes.to_string()),
                ("held_bytes", cost.held_bytes.to_string()),
            ];
            figures.extend(cost.working_bytes.map(|working| ("working_bytes", working.to_string())));
            rows.extend(figures.into_iter().map(|(figure, value)| {
                vec![side.name.clone(), String::new(), it.kind.clone(), figure.to_owned(), value]
            }));
        }
    }
    Table::new(&["column", "node", "kind", "figure", "value"], rows)
}

/// Every difference of every pair, one line each.
fn differences(found: &Found) -> Table {
    let mut rows = Vec::new();
    for pair in &found.pairs {
        for node in &pair.nodes {
            for it in node.differences.iter().flatten() {
                let [one, other] = it.values.map_or([String::new(), String::new()], |v| v.map(|x| x.to_string()));
                let names = [&pair.left, &pair.right, &node.node, &node.kind, &it.figure].map(Clone::clone);
                rows.push([&names[..], &[it.size.to_string(), one, other, it.text.clone()]].concat());
            }
        }
    }
    let columns = ["left", "right", "node", "kind", "figure", "size", "left_value", "right_value", "text"];
    Table::new(&columns, rows)
}
