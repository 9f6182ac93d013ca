//! The part of a plan that the wanted results rest on.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use petgraph::Direction;
use petgraph::algo::toposort;
use petgraph::graph::NodeIndex;
use petgraph::visit::EdgeRef;
use salient_sdk::Arity;

use crate::graph::Plan;

/// One call of the cone.
pub(super) struct Place {
    /// Calls whose output it takes, each once.
    pub producers: BTreeSet<NodeIndex>,
    /// Those of them that may fail: it takes their output only at ports that do without.
    pub dispensable: BTreeSet<NodeIndex>,
    /// Calls of the cone that take its output.
    pub consumers: BTreeSet<NodeIndex>,
    /// Whether its output is wanted itself.
    pub wanted: bool,
    /// Time along the longest path from its start to the end of the run, in seconds.
    pub urgency: f64,
    /// The most urgent call without inputs that it rests on.
    pub root: Root,
    /// What it is expected to cost, in seconds, if anything is known.
    pub cost: Option<f64>,
}

/// A call without inputs, by its urgency in bits (non-negative doubles order as their bits do); the greatest is to be done first, with all that rests
/// on it: of a thousand shapes each is done to its end before the next is begun, so that the outputs of few are held at once.
pub(super) type Root = (u64, Reverse<NodeIndex>);

/// The calls that the wanted results rest on, wanted ones included.
pub(super) struct Cone {
    places: BTreeMap<NodeIndex, Place>,
    /// In an order in which producers come before consumers.
    order: Vec<NodeIndex>,
}

/// Producers of a call whose output it takes only at ports that do without what failed.
fn dispensable(plan: &Plan, call: NodeIndex) -> BTreeSet<NodeIndex> {
    let surviving =
        |port: &str| plan.dag[call].node.ports().iter().any(|p| p.name == port && p.arity == Arity::Surviving);
    let (mut all, mut needed) = (BTreeSet::new(), BTreeSet::new());
    for edge in plan.dag.edges_directed(call, Direction::Incoming) {
        if surviving(edge.weight().port) {
            all.insert(edge.source())
        } else {
            needed.insert(edge.source())
        };
    }
    all.retain(|producer| !needed.contains(producer));
    all
}

/// These calls in the order of the graph file, which the indices of a plan follow, if that has producers before consumers;
/// else as they are.
pub(super) fn in_file_order(plan: &Plan, mut calls: Vec<NodeIndex>) -> Vec<NodeIndex> {
    let ascending = |call: &NodeIndex| plan.dag.neighbors_directed(*call, Direction::Incoming).all(|from| from < *call);
    if calls.iter().all(ascending) {
        calls.sort_unstable();
    }
    calls
}

impl Cone {
    pub(super) fn of(plan: &Plan, wanted: &[NodeIndex], cost: &BTreeMap<NodeIndex, f64>) -> Self {
        let mut places: BTreeMap<NodeIndex, Place> = BTreeMap::new();
        let wanted: BTreeSet<_> = wanted.iter().copied().collect();
        let mut left: Vec<_> = wanted.iter().copied().collect();
        while let Some(call) = left.pop() {
            if places.contains_key(&call) {
                continue;
            }
            let producers: BTreeSet<_> = plan.dag.neighbors_directed(call, Direction::Incoming).collect();
            left.extend(&producers);
            let place = Place {
                dispensable: dispensable(plan, call),
                producers,
                consumers: BTreeSet::new(),
                wanted: wanted.contains(&call),
                urgency: 0.0,
                root: (0, Reverse(call)),
                cost: cost.get(&call).copied(),
            };
            places.insert(call, place);
        }
        // A plan is acyclic by contract; were it not, the order would miss the cycle's calls and
        // the run would report them as not done.
        let sorted = toposort(&plan.dag, None).unwrap_or_default();
        let order: Vec<_> = sorted.into_iter().filter(|call| places.contains_key(call)).collect();
        for call in order.iter().rev() {
            let place = &places[call];
            let after = place.consumers.iter().map(|c| places[c].urgency).fold(0.0, f64::max);
            let producers = place.producers.clone();
            if let Some(place) = places.get_mut(call) {
                place.urgency = after + cost.get(call).copied().unwrap_or(1.0);
            }
            for producer in producers {
                if let Some(place) = places.get_mut(&producer) {
                    place.consumers.insert(*call);
                }
            }
        }
        for call in &order {
            let place = &places[call];
            let own = (place.urgency.max(0.0).to_bits(), Reverse(*call));
            let root = place.producers.iter().map(|p| places[p].root).max().unwrap_or(own);
            if let Some(place) = places.get_mut(call) {
                place.root = root;
            }
        }
        Self { places, order }
    }

    pub(super) fn len(&self) -> usize {
        self.places.len()
    }

    /// All calls, producers before consumers.
    pub(super) fn calls(&self) -> impl Iterator<Item = NodeIndex> + '_ {
        self.order.iter().copied()
    }

    pub(super) fn place(&self, call: NodeIndex) -> &Place {
        &self.places[&call]
    }
}
