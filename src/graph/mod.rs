//! From RON text to a plan.
//!
//! | module | does |
//! |---|---|
//! | `syntax` | takes RON text apart, with exact places |
//! | `file` | a graph file as written |
//! | `overrides` | `--set`, and the variants |
//! | `flatten` | opens subgraph calls, looks up params and axes |
//! | `axes` | lists, files and pairs |
//! | `wires`, `check` | what wires mean, and whether they fit |
//! | `bind` | typed params |
//! | `expand`, `assemble` | repeats nodes along axes and merges equal calls |
//! | [`plan`](mod@plan) | the result |
//! | `observed` | what planning looked at, to be looked at again |
//! | [`picture`] | the plan as a picture |

mod assemble;
mod axes;
mod bind;
mod check;
mod expand;
mod file;
mod flatten;
mod observed;
mod overrides;
pub mod picture;
pub mod plan;
mod syntax;
#[cfg(test)]
mod tests;
mod wires;

use std::path::Path;
use std::rc::Rc;

use salient_sdk::Registry;

pub use observed::{Difference, Observed};
pub use overrides::Overrides;
pub use plan::{Call, Plan, Shown, Wire};

use crate::diagnostics::Diagnostics;
use assemble::Assembly;
use axes::Globs;
use bind::Binder;
use expand::MOST_CALLS;
use file::{Files, GraphFile};
use flatten::{Kinds, Walk};
use overrides::{Fate, Override, Point, Sets, applies, no_variant, unmatched};

/// The code of the error that a graph with inputs cannot run by itself.
pub const OPEN_INPUT: &str = "open-input";

/// Reads a graph file and makes a plan of it, or says all that is wrong with it at once.
pub fn plan(file: &Path, overrides: &Overrides, registry: &Registry) -> Result<Plan, Diagnostics> {
    plan_observed(file, overrides, registry).0
}

/// As [`plan()`], with all that was looked at on the way: as long as none of it changes, neither does the result.
pub fn plan_observed(file: &Path, overrides: &Overrides, registry: &Registry) -> (Result<Plan, Diagnostics>, Observed) {
    let mut planner = Planner {
        report: Diagnostics::default(),
        files: Files::default(),
        globs: Globs::default(),
        kinds: Kinds::new(registry),
        binder: Binder::default(),
        assembly: Assembly::default(),
    };
    planner.run(file, overrides);
    let Planner { mut report, files, globs, binder, assembly, .. } = planner;
    let observed = Observed { texts: files.texts, globs: globs.known, files: binder.exists.into_iter().collect() };
    if !report.is_empty() {
        report.tidy();
        return (Err(report), observed);
    }
    let mut plan = assembly.plan;
    plan.planned_from = files.planned_from;
    plan.planned_from.extend(globs.folders);
    (Ok(plan), observed)
}

/// What the variants of one plan share.
struct Planner<'r> {
    report: Diagnostics,
    files: Files,
    globs: Globs,
    kinds: Kinds<'r>,
    binder: Binder,
    assembly: Assembly,
}

/// What became of `--set` over all variants.
struct Outside {
    sets: Sets,
    fates: Vec<Fate>,
    /// Addresses to suggest.
    known: Vec<String>,
    /// Whether a part of the graph could not be read.
    holes: bool,
}

impl Planner<'_> {
    fn run(&mut self, path: &Path, overrides: &Overrides) {
        let sets = overrides::parse(&mut self.report, &overrides.sets);
        let fates = vec![Fate::default(); sets.nodes.len()];
        let mut outside = Outside { sets, fates, known: Vec::new(), holes: false };
        let Some(file) = self.files.load(&mut self.report, path, None, &[]) else { return };
        for (name, _) in &file.inputs {
            let message = format!("the input `{}` is open: this graph can only be called", name.text);
            self.report.error(name.span, OPEN_INPUT, message).hint("call it with `graph(file: ..)`");
        }
        let points = overrides::points(&mut self.report, &file.variants, overrides.variants.as_deref());
        for point in &points {
            self.variant(&file, point, &mut outside);
        }
        if !outside.holes {
            let known: Vec<&str> = outside.known.iter().map(String::as_str).collect();
            let groups: Vec<&str> = points.iter().map(|p| p.group.as_str()).filter(|g| !g.is_empty()).collect();
            let sets = outside.sets.nodes.iter().zip(&outside.fates);
            for (set, fate) in sets.filter(|(_, fate)| !fate.matched) {
                if points.iter().any(|point| applies(set, point)) {
                    unmatched(&mut self.report, set, fate, &known);
                } else {
                    no_variant(&mut self.report, set, &groups);
                }
            }
        }
        path.clone_into(&mut self.assembly.plan.file);
        let names = points.into_iter().map(|p| p.name).filter(|name| !name.is_empty());
        self.assembly.plan.variants = names.collect();
    }

    fn variant(&mut self, file: &Rc<GraphFile>, point: &Point, outside: &mut Outside) {
        let mut changes: Vec<Override> = point.changes.clone();
        changes.extend(outside.sets.nodes.iter().filter(|o| applies(o, point)).cloned());
        let mut walk = Walk::new(&mut self.report, &mut self.files, &mut self.kinds, &mut self.globs, changes);
        // `--set` wins over the variant.
        let params: Vec<_> = point.params.iter().chain(&outside.sets.params).cloned().collect();
        walk.root(file, &params);
        let prefix = if point.name.is_empty() { String::new() } else { format!("{}:", point.name) };
        let variant = walk.finish(&mut self.binder, file, prefix);
        outside.holes |= walk.holes;
        let fates = walk.fates.iter().skip(point.changes.len());
        let totals = outside.sets.nodes.iter().zip(&mut outside.fates);
        for ((_, total), fate) in totals.filter(|(set, _)| applies(set, point)).zip(fates) {
            total.matched |= fate.matched;
            total.wire |= fate.wire;
            total.lacks = total.lacks.take().or_else(|| fate.lacks.clone());
        }
        if outside.known.is_empty() {
            outside.known = variant.addresses.iter().flatten().cloned().collect();
            outside.known.sort();
        }
        let Walk { flats, axes, .. } = walk;
        if self.assembly.plan.addresses.len() + variant.calls > MOST_CALLS {
            let message = format!("the plan would have more than {MOST_CALLS} calls");
            self.report.error(file.span, "too-large", message);
        }
        if self.report.is_empty() {
            self.assembly.add(&self.binder, &flats, &axes, &variant);
        }
    }
}
