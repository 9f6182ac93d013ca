//! `salient runs`: what was run, and why it computed what it did.

use std::fmt::Write as _;
use std::path::Path;

use serde_json::{Value, json};

use super::args::RunsArgs;
use super::fail::Fail;
use super::plan::cause_lines;
use super::progress::totals;
use super::text::{ago, bytes, count, print, print_json, seconds, table, working};
use crate::engine::Cache;
use crate::engine::history::{RunCall, RunEntry, RunOutcome, RunRecord};

/// How many executed calls of one run are listed for people.
const LISTED: usize = 60;

/// `salient runs`.
pub fn runs(args: &RunsArgs) -> Result<(), Fail> {
    let cache = args.cache.open()?;
    let graph = args.graph.as_deref();
    if args.run.is_none() && args.why.is_none() {
        let all = cache.runs(graph)?;
        return if args.json {
            print_json(&all.iter().map(summary).collect::<Vec<_>>())
        } else {
            print(overview(&all).as_bytes())
        };
    }
    let (entry, run) = find(&cache, graph, args.run.as_deref().unwrap_or("last"))?;
    if let Some(address) = &args.why {
        return explain(args, &entry, &run, address);
    }
    if args.json {
        let mut value = summary(&entry);
        value["shown"] = json!(run.body.shown.iter().map(|(address, _)| address).collect::<Vec<_>>());
        value["calls"] = (0..run.body.calls.len()).map(|call| call_json(&run, call)).collect();
        print_json(&value)
    } else {
        print(document(&entry, &run).as_bytes())
    }
}

/// A remembered run by its name: the first digits of its id, `last`, or `last~2` for the second one before that.
pub fn find(cache: &Cache, graph: Option<&Path>, name: &str) -> Result<(RunEntry, RunRecord), Fail> {
    let all = cache.runs(graph)?;
    let fail = |message: String| Fail::Usage { message, help: Some("`salient runs` lists the runs remembered".into()) };
    let back = match name.strip_prefix("last") {
        Some("") => Some(0),
        Some(rest) => rest.strip_prefix('~').and_then(|n| n.parse::<usize>().ok()),
        None => None,
    };
    let entry = if let Some(back) = back {
        all.into_iter().nth(back).ok_or_else(|| fail(format!("there is no run `{name}`")))?
    } else {
        let mut found = all.into_iter().filter(|run| !name.is_empty() && run.id.starts_with(name));
        match (found.next(), found.next()) {
            (Some(run), None) => run,
            (Some(_), Some(_)) => return Err(fail(format!("several runs have a name that begins with `{name}`"))),
            (None, _) => return Err(fail(format!("no run is called `{name}`"))),
        }
    };
    let run = entry.read().ok_or_else(|| fail(format!("the record of the run {} is damaged or gone", entry.id)))?;
    Ok((entry, run))
}

fn summary(run: &RunEntry) -> Value {
    let mut value = json!(run.summary);
    value["run"] = run.id.as_str().into();
    value
}

fn overview(all: &[RunEntry]) -> String {
    if all.is_empty() {
        return "no run is remembered\n".into();
    }
    let mut rows = vec![["run", "when", "graph", "nodes", "computed", "failed", "seconds"].map(str::to_owned).to_vec()];
    rows.extend(all.iter().map(|run| {
        let it = &run.summary;
        let t = it.totals;
        let nodes = t.hits + t.computed + t.failed + t.skipped + t.cancelled;
        let name = Path::new(&it.graph).file_name().map_or_else(|| it.graph.clone(), |n| n.to_string_lossy().into());
        let counts = [nodes, t.computed, t.failed].map(|n| n.to_string());
        let mut row = vec![run.id.clone(), ago(it.when), name];
        row.extend(counts);
        row.push(seconds(it.seconds));
        row
    }));
    table(&rows, 0, &[3, 4, 5, 6])
}

fn document(entry: &RunEntry, run: &RunRecord) -> String {
    let it = &run.summary;
    let mut text = format!("run {} of {}, {}\n", entry.id, it.graph, ago(it.when));
    if !it.variants.is_empty() {
        let _ = writeln!(text, "variants: {}", it.variants.join(", "));
    }
    let _ = writeln!(text, "{} with {}", totals(&it.totals, it.seconds), count(it.jobs, "thread"));
    if let Some(peak) = it.peak_memory {
        let _ = writeln!(text, "at most {} of memory", bytes(peak));
    }
    let mut rows = vec![["stage", "calls", "computed", "seconds", "output", "at work"].map(str::to_owned).to_vec()];
    rows.extend(it.stages.iter().map(|(kind, s)| {
        let counts = [s.calls, s.computed].map(|n| n.to_string());
        [vec![kind.clone()], counts.to_vec(), vec![seconds(s.seconds), bytes(s.bytes), working(s.working)]].concat()
    }));
    let _ = write!(text, "\n{}\n", table(&rows, 0, &[1, 2, 3, 4, 5]));
    let executed = |call: &&RunCall| matches!(call.outcome, RunOutcome::Computed | RunOutcome::Failed);
    let all: Vec<_> = run.body.calls.iter().filter(executed).collect();
    for call in all.iter().take(LISTED) {
        let message = call.message.as_ref().map(|message| format!(": {message}")).unwrap_or_default();
        let name = call.addresses.first().map_or("", String::as_str);
        let _ = writeln!(text, "{} {name}{message}", call.outcome.name());
        let mut why = String::new();
        cause_lines(&call.why, 1, &mut why);
        text.push_str(&why.replace(" changed or may change (see above)", " changed"));
    }
    if all.len() > LISTED {
        let _ = writeln!(text, "and {} more; `--json` lists all", all.len() - LISTED);
    }
    text
}

fn call_json(run: &RunRecord, call: usize) -> Value {
    let (it, kind) = (&run.body.calls[call], run.body.kind(call));
    let inputs = it.inputs.iter().map(|(port, label, from)| {
        let from = run.body.calls[*from].addresses.first();
        json!({ "port": port, "label": label, "from": from })
    });
    json!({
        "node": it.addresses.first(),
        "addresses": it.addresses,
        "kind": kind.name,
        "version": kind.version,
        "params": run.body.params[it.params],
        "files": it.files,
        "inputs": inputs.collect::<Vec<_>>(),
        "outcome": it.outcome,
        "key": it.key,
        "digest": it.digest,
        "bytes": it.bytes,
        "seconds": it.seconds,
        "working": it.working,
        "message": it.message,
        "why": it.why,
    })
}

fn explain(args: &RunsArgs, entry: &RunEntry, run: &RunRecord, address: &str) -> Result<(), Fail> {
    let Some(call) = run.body.addresses().get(address).copied() else {
        return Err(Fail::usage(format!("the run {} had no node of the address `{address}`", entry.id)));
    };
    let (it, causes) = (&run.body.calls[call], run.body.why(call));
    if args.json {
        return print_json(&json!({ "run": entry.id, "node": address, "outcome": it.outcome, "causes": causes }));
    }
    let what = match it.outcome {
        RunOutcome::Hit => "was in the cache",
        RunOutcome::Computed => "was computed:",
        RunOutcome::Failed => "failed:",
        RunOutcome::Skipped => "was not tried, because this failed:",
        RunOutcome::Cancelled => "was not done when the run was stopped",
    };
    let mut text = format!("{address} {what}\n");
    if let Some(message) = &it.message {
        let _ = writeln!(text, "  {message}");
    }
    cause_lines(&causes, 1, &mut text);
    print(text.replace(" changed or may change", " changed").as_bytes())
}
