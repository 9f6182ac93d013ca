//! A run as it is remembered: made from its plan and from how the calls ended.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::time::Duration;

use petgraph::graph::NodeIndex;
use serde_json::Value;

use super::cache::{Cache, CacheError};
use super::cone::in_file_order;
use super::history::{RunBody, RunCall, RunKind, RunOutcome, RunRecord, RunSummary, Stage, graph_name};
use super::key::{Ingredients, canonical, wires};
use super::schedule::{State, count};
use super::sources::Sources;
use super::why::{Cause, Hindsight};
use super::working;
use crate::graph::Plan;

/// How a run went, for its record.
pub(super) struct Course<'a> {
    pub plan: &'a Plan,
    pub wanted: &'a [NodeIndex],
    /// The calls of the run, producers before consumers.
    pub order: &'a [NodeIndex],
    pub states: &'a BTreeMap<NodeIndex, State>,
    /// Calls executed again because their bytes were gone, with a call that needed them.
    pub evicted: &'a BTreeMap<NodeIndex, NodeIndex>,
    pub sources: &'a Sources,
    /// Milliseconds since 1970.
    pub when: u64,
    pub jobs: usize,
}

impl Course<'_> {
    /// The record of the run.
    pub(super) fn record(&self, cache: &Cache, elapsed: Duration) -> Result<RunRecord, CacheError> {
        let mut why = self.causes(cache)?;
        let order = in_file_order(self.plan, self.order.to_vec());
        let mut tables = Tables::default();
        let rank: HashMap<NodeIndex, usize> = order.iter().enumerate().map(|(i, call)| (*call, i)).collect();
        let mut stages: BTreeMap<String, Stage> = BTreeMap::new();
        let mut calls = Vec::with_capacity(order.len());
        for call in &order {
            let made = self.call(*call, &rank, &mut tables, why.remove(call).unwrap_or_default());
            let stage = stages.entry(self.plan.dag[*call].node.kind().to_owned()).or_default();
            tally(stage, &made);
            calls.push(made);
        }
        let wanted: BTreeSet<_> = self.wanted.iter().collect();
        let mut shown: Vec<_> = self
            .plan
            .show
            .iter()
            .filter(|s| wanted.contains(&s.call))
            .map(|s| (s.address.clone(), rank[&s.call]))
            .collect();
        if shown.is_empty() {
            shown = self.wanted.iter().map(|call| (self.plan.name(*call).to_owned(), rank[call])).collect();
        }
        let summary = RunSummary {
            graph: graph_name(self.plan),
            when: self.when,
            seconds: elapsed.as_secs_f64(),
            jobs: self.jobs,
            variants: self.plan.variants.clone(),
            totals: count(self.states),
            stages,
            peak_memory: working::most(),
        };
        Ok(RunRecord { summary, body: RunBody { kinds: tables.kinds, params: tables.params, calls, shown } })
    }

    fn call(&self, call: NodeIndex, rank: &HashMap<NodeIndex, usize>, tables: &mut Tables, why: Vec<Cause>) -> RunCall {
        let (it, state) = (&self.plan.dag[call], &self.states[&call]);
        let record = state.record();
        let (outcome, message) = match state {
            State::Hit(_) => (RunOutcome::Hit, None),
            State::Computed(_) => (RunOutcome::Computed, None),
            State::Failed(error) => (RunOutcome::Failed, Some(error.message.clone())),
            State::Skipped(because) => (RunOutcome::Skipped, Some(because.clone())),
            State::Cancelled => (RunOutcome::Cancelled, None),
        };
        // Files of calls that were never come to are not looked at now: a run that is stopped ends at once.
        let own = match state {
            State::Failed(_) => Ingredients::own(self.plan, call, self.sources).ok(),
            _ => None,
        };
        let ingredients = record.map(|record| &*record.ingredients).or(own.as_ref());
        let output = it.node.output();
        let kind = RunKind {
            name: it.node.kind().to_owned(),
            version: it.node.version(),
            output: output.name.to_owned(),
            format: output.format,
        };
        let input = |(wire, from): (&crate::graph::Wire, NodeIndex)| {
            Some((wire.port.to_owned(), wire.label.clone(), *rank.get(&from)?))
        };
        let mut inputs: Vec<_> = wires(self.plan, call).into_iter().filter_map(input).collect();
        // As in `Ingredients`, so that they can be compared.
        inputs.sort_by(|a, b| a.0.cmp(&b.0));
        RunCall {
            addresses: it.addresses.clone(),
            kind: tables.kind(kind),
            params: match ingredients {
                Some(ingredients) => tables.params(&ingredients.params),
                None => tables.params(&Ingredients::params_of(it)),
            },
            files: ingredients.map(|i| i.files.clone()).unwrap_or_default(),
            inputs,
            outcome,
            key: record.map(|r| r.ingredients.key()),
            digest: record.map(|r| r.digest),
            bytes: record.map(|r| r.bytes),
            seconds: record.map(|r| r.seconds),
            working: record.and_then(|r| r.working),
            defects: record.map(|r| r.defects.clone()).unwrap_or_default(),
            message,
            why,
        }
    }

    /// Why each call that was executed, or failed, was not in the cache.
    fn causes(&self, cache: &Cache) -> Result<BTreeMap<NodeIndex, Vec<Cause>>, CacheError> {
        let tried = |call: &&NodeIndex| matches!(self.states[*call], State::Computed(_) | State::Failed(_));
        let mut tried = self.order.iter().filter(tried).peekable();
        if tried.peek().is_none() {
            return Ok(BTreeMap::new());
        }
        let hindsight = Hindsight::new(self.plan, self.states, self.sources, cache)?;
        let mut all = hindsight.all(tried.copied().filter(|call| !self.evicted.contains_key(call)))?;
        for (call, needed_by) in self.evicted {
            all.insert(*call, vec![Cause::Evicted { needed_by: self.plan.name(*needed_by).to_owned() }]);
        }
        Ok(all)
    }
}

fn tally(stage: &mut Stage, call: &RunCall) {
    stage.calls += 1;
    let seconds = call.seconds.unwrap_or_default();
    if call.outcome == RunOutcome::Computed {
        stage.computed += 1;
        stage.seconds += seconds;
    }
    if call.digest.is_some() {
        stage.outputs += 1;
        stage.output_seconds += seconds;
        stage.bytes += call.bytes.unwrap_or_default();
        stage.working = stage.working.max(call.working);
    }
}

/// Kinds and params, each once.
#[derive(Default)]
struct Tables {
    kinds: Vec<RunKind>,
    params: Vec<Value>,
    known_kinds: HashMap<String, usize>,
    known_params: HashMap<String, usize>,
}

impl Tables {
    fn kind(&mut self, kind: RunKind) -> usize {
        let next = self.kinds.len();
        let number = *self.known_kinds.entry(kind.name.clone()).or_insert(next);
        if number == next {
            self.kinds.push(kind);
        }
        number
    }

    fn params(&mut self, params: &Value) -> usize {
        let next = self.params.len();
        let number = *self.known_params.entry(canonical(params)).or_insert(next);
        if number == next {
            self.params.push(params.clone());
        }
        number
    }
}
