//! What a run would do, without running anything.

use std::collections::BTreeMap;
use std::sync::Arc;

use petgraph::graph::NodeIndex;
use serde::Serialize;

use super::cache::{Cache, CacheError};
use super::cone::{Cone, in_file_order};
use super::history::Costs;
use super::key::Ingredients;
use super::record::Record;
use super::sources::Sources;
use super::worker::{Halt, lookup};
use crate::graph::Plan;

/// So few lookups are not worth a thread.
const SMALL_WAVE: usize = 64;

/// What would become of a call.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "verdict", rename_all = "snake_case")]
pub enum Verdict {
    /// Its output is in the cache.
    Hit,
    /// Its output is known, but its bytes were collected, and they are needed: it executes.
    Evicted {
        /// Address of a call that needs them, or its own if they are wanted themselves.
        needed_by: String,
    },
    /// It executes.
    Miss,
    /// It rests on calls that execute; should their outputs come out as before, it is a hit.
    DependsOnMiss {
        /// Addresses of those among its inputs.
        of: Vec<String>,
    },
    /// An input file cannot be read: it would fail.
    Unreadable {
        /// Which, and why.
        message: String,
    },
}

/// What is known of a call before a run.
#[derive(Clone, Debug)]
pub struct Prospect {
    /// What would become of it.
    pub verdict: Verdict,
    /// What its output depends on, without inputs if one of those is not known yet.
    pub ingredients: Option<Arc<Ingredients>>,
    /// Its recorded output.
    pub record: Option<Record>,
    /// How long it took when it was computed, or last time, or calls of its kind did, in seconds.
    pub seconds: Option<f64>,
}

/// What is known of all calls that the wanted results rest on.
pub struct Forecast {
    /// By call.
    pub calls: BTreeMap<NodeIndex, Prospect>,
    /// The calls, producers before consumers.
    pub order: Vec<NodeIndex>,
}

impl Forecast {
    /// Looks every call up.
    pub fn new(plan: &Plan, wanted: &[NodeIndex], cache: &Cache) -> Result<Self, CacheError> {
        let mut costs = Costs::of(plan, cache)?;
        let cone = Cone::of(plan, wanted, &costs.weights(plan));
        let sources = Sources::new();
        let order = in_file_order(plan, cone.calls().collect());
        let mut it = Self { calls: BTreeMap::new(), order };
        for wave in it.waves(&cone) {
            let found = it.look_up(plan, &wave, cache, &sources)?;
            it.calls.extend(wave.into_iter().zip(found));
        }
        it.find_evicted(plan, &cone, cache);
        if it.calls.values().any(|prospect| prospect.verdict == Verdict::Miss) {
            costs.add_others(cache)?;
        }
        for (call, prospect) in &mut it.calls {
            let recorded = prospect.record.as_ref().map(|record| record.seconds);
            let whole = prospect.ingredients.as_ref().filter(|_| prospect.verdict == Verdict::Miss);
            let key = whole.map(|ingredients| ingredients.key());
            prospect.seconds = recorded.or_else(|| costs.expect(plan, *call, key.as_ref()));
        }
        Ok(it)
    }

    /// Calls by the length of the longest path to them: those of one wave do not rest on each other.
    fn waves(&self, cone: &Cone) -> Vec<Vec<NodeIndex>> {
        let (mut depths, mut waves): (BTreeMap<NodeIndex, usize>, Vec<Vec<NodeIndex>>) = Default::default();
        for call in &self.order {
            let depth = cone.place(*call).producers.iter().map(|from| depths[from] + 1).max().unwrap_or_default();
            depths.insert(*call, depth);
            waves.resize_with(waves.len().max(depth + 1), Vec::new);
            waves[depth].push(*call);
        }
        waves
    }

    /// Looks up the calls of a wave, on all processors.
    fn look_up(
        &self,
        plan: &Plan,
        wave: &[NodeIndex],
        cache: &Cache,
        sources: &Sources,
    ) -> Result<Vec<Prospect>, CacheError> {
        let share = wave.len().div_ceil(salient_sdk::context::processors()).max(SMALL_WAVE);
        let look = |calls: &[NodeIndex]| -> Result<Vec<Prospect>, CacheError> {
            calls.iter().map(|call| self.prospect(plan, *call, cache, sources)).collect()
        };
        let results: Vec<_> = std::thread::scope(|scope| {
            let rest: Vec<_> = wave.chunks(share).skip(1).map(|calls| scope.spawn(move || look(calls))).collect();
            let first = wave.chunks(share).next().map(look);
            let join = |thread: std::thread::ScopedJoinHandle<'_, _>| {
                thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            first.into_iter().chain(rest.into_iter().map(join)).collect()
        });
        let mut found = Vec::with_capacity(wave.len());
        for result in results {
            found.extend(result?);
        }
        Ok(found)
    }

    fn prospect(&self, plan: &Plan, call: NodeIndex, cache: &Cache, sources: &Sources) -> Result<Prospect, CacheError> {
        let bare = |verdict| Prospect { verdict, ingredients: None, record: None, seconds: None };
        let own = match Ingredients::own(plan, call, sources) {
            Ok(own) => own,
            Err(error) => return Ok(bare(Verdict::Unreadable { message: error.message })),
        };
        let digest = |from: NodeIndex| Some(self.calls[&from].record.as_ref()?.digest);
        let mut of: Vec<_> = plan
            .dag
            .neighbors_directed(call, petgraph::Direction::Incoming)
            .filter(|from| digest(*from).is_none())
            .map(|from| plan.name(from).to_owned())
            .collect();
        of.sort();
        of.dedup();
        if !of.is_empty() {
            let verdict = Verdict::DependsOnMiss { of };
            return Ok(Prospect { ingredients: Some(Arc::new(own)), ..bare(verdict) });
        }
        let digests: BTreeMap<_, _> = plan
            .dag
            .neighbors_directed(call, petgraph::Direction::Incoming)
            .filter_map(|from| Some((from, digest(from)?)))
            .collect();
        let ingredients = Arc::new(own.with_inputs(plan, call, |from| digests.get(&from).copied()));
        match lookup(&plan.dag[call], &ingredients.key(), cache, sources) {
            Ok((record, _)) => {
                let shared = |record: Record| Record { ingredients: ingredients.clone(), ..record };
                let record = record.map(shared);
                let verdict = if record.is_some() { Verdict::Hit } else { Verdict::Miss };
                let ingredients = Some(ingredients);
                Ok(Prospect { verdict, ingredients, record, seconds: None })
            }
            Err(Halt::Node(error)) => Ok(bare(Verdict::Unreadable { message: error.message })),
            Err(Halt::Cache(error)) => Err(error),
        }
    }

    /// Finds known outputs whose bytes are gone and needed.
    fn find_evicted(&mut self, plan: &Plan, cone: &Cone, cache: &Cache) {
        for call in self.order.clone().into_iter().rev() {
            let Prospect { verdict: Verdict::Hit, record: Some(record), .. } = &self.calls[&call] else {
                continue;
            };
            let place = cone.place(call);
            let executes = |c: &&NodeIndex| self.calls[c].verdict.executes();
            let needed_by = if place.wanted { Some(call) } else { place.consumers.iter().find(executes).copied() };
            let Some(needed_by) = needed_by else { continue };
            if !cache.has_object(&record.digest) {
                let needed_by = plan.name(needed_by).to_owned();
                if let Some(prospect) = self.calls.get_mut(&call) {
                    prospect.verdict = Verdict::Evicted { needed_by };
                }
            }
        }
    }
}

impl Verdict {
    /// Whether the call would execute, for all one can tell.
    #[must_use]
    pub fn executes(&self) -> bool {
        matches!(self, Self::Miss | Self::Evicted { .. } | Self::DependsOnMiss { .. })
    }
}
