//! `salient run`, and how any command runs a plan.

use std::path::PathBuf;

use petgraph::graph::NodeIndex;
use salient_sdk::Registry;

use super::args::{CacheChoice, Effort, RunArgs};
use super::fail::Fail;
use super::failures;
use super::plan::load;
use super::progress::{Progress, json_line, totals};
use super::results::{result, stages};
use super::text::{complain, print};
use crate::engine::{Cache, Cancel, Event, Options, Outcome, run as run_plan};
use crate::graph::Plan;

impl CacheChoice {
    /// Opens the chosen cache.
    pub fn open(&self) -> Result<Cache, Fail> {
        Ok(Cache::open(&self.path()?)?)
    }

    /// The directory of the chosen cache.
    pub fn path(&self) -> Result<PathBuf, Fail> {
        let var = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        let chosen = self.dir.clone().or_else(|| var("SALIENT_CACHE"));
        let default = || Some(var("XDG_CACHE_HOME")?.join("salient"));
        let home = || Some(var("HOME")?.join(".cache/salient"));
        chosen
            .or_else(default)
            .or_else(home)
            .ok_or_else(|| Fail::usage("there is no home directory for the cache; name one with --cache"))
    }
}

impl Effort {
    /// As the engine takes it.
    pub fn options(&self) -> Options {
        let default = Options::default();
        let jobs = self.jobs.map_or(default.jobs, usize::from);
        Options { jobs, memory: self.memory, fail_fast: self.fail_fast }
    }
}

/// Stops the run at the first signal and the process at the second.
pub fn listen() -> Result<Cancel, Fail> {
    let cancel = Cancel::new();
    let to_stop = cancel.clone();
    let handler = move || {
        if to_stop.is_cancelled() {
            std::process::exit(130);
        }
        to_stop.cancel();
        complain("stopping; once more to stop at once");
    };
    ctrlc::set_handler(handler).map_err(|e| Fail::Lacking(format!("cannot listen for interrupts: {e}")))?;
    Ok(cancel)
}

/// Runs a plan and shows its events. Signals stop it by way of `cancel`.
pub fn compute(
    plan: &Plan,
    wanted: &[NodeIndex],
    cache: &Cache,
    effort: &Effort,
    json: bool,
    cancel: &Cancel,
) -> Result<Outcome, Fail> {
    let mut progress = Progress::new(json, cancel);
    let outcome = run_plan(plan, wanted, cache, effort.options(), cancel, &mut |e| progress.event(e));
    progress.finish()?;
    Ok(outcome?)
}

/// How the command ends, by how the run did.
pub fn verdict(outcome: &Outcome) -> Result<(), Fail> {
    match outcome {
        outcome if outcome.complete() => Ok(()),
        outcome if outcome.cancelled => Err(Fail::Interrupted),
        _ => Err(Fail::NodeReported),
    }
}

/// `salient run`.
pub fn run(args: &RunArgs, registry: &Registry) -> Result<(), Fail> {
    let plan = load(&args.graph, registry)?;
    let report = args.report.target()?;
    let cache = args.cache.open()?;
    let wanted: Vec<_> = plan.show.iter().map(|shown| shown.call).collect();
    let outcome = compute(&plan, &wanted, &cache, &args.effort, args.json, &listen()?)?;
    let told = tell(args, &plan, &outcome, &cache);
    if let Some(report) = report.filter(|_| !outcome.cancelled) {
        report.run(&outcome.record, &cache, registry)?;
    }
    match told {
        // A reader who has seen enough does not make a failed run a good one.
        Ok(()) | Err(Fail::Pipe) => verdict(&outcome),
        Err(fail) => Err(fail),
    }
}

/// Prints and writes what a run found.
fn tell(args: &RunArgs, plan: &Plan, outcome: &Outcome, cache: &Cache) -> Result<(), Fail> {
    let mut lines = Vec::new();
    let failed = failures::failures(plan, outcome);
    for shown in &plan.show {
        let Some(found) = result(plan, outcome, shown, cache)? else { continue };
        if args.json {
            lines.push(found.json());
        } else {
            print(found.text().as_bytes())?;
        }
        if let Some(dir) = &args.out {
            found.write(dir)?;
        }
    }
    if args.json {
        json_line(&Event::Results { results: lines, failures: failures::json(&failed) })?;
    } else {
        // Times vary from run to run, so they are not among the results.
        complain(&format!("\n{}", stages(plan, outcome)));
        complain(&totals(&outcome.totals, outcome.seconds));
        if !failed.is_empty() {
            complain(failures::text(&failed).trim_end());
        }
    }
    Ok(())
}
