//! Which running nodes are worth finishing after an edit: those whose very computation is still wanted.

use std::collections::{BTreeMap, BTreeSet};

use petgraph::graph::NodeIndex;

use crate::engine::key::wires;
use crate::engine::sources::{Change, Sources};
use crate::engine::{Digest, Ingredients};
use crate::graph::Plan;

/// A plan and the content of its files.
#[derive(Clone, Copy)]
pub struct World<'a> {
    /// The plan.
    pub plan: &'a Plan,
    /// Its files.
    pub sources: &'a Sources,
}

/// The calls named in `running` that mean the same after the edit.
///
/// A call is known by its address, and means the same if it and all before it have the same kinds, params and
/// files. `changes` are the files that changed: if a node found one of them by itself, nobody knows what rests
/// on it, and nothing is spared.
pub fn spared(before: World, after: World, running: &BTreeSet<String>, changes: &[Change]) -> BTreeSet<NodeIndex> {
    let named: BTreeSet<_> = before.plan.dag.node_weights().flat_map(|call| call.files.values()).collect();
    if changes.iter().any(|change| !named.contains(&change.path)) {
        return BTreeSet::new();
    }
    let (mut then, mut now) = (Meanings::new(before), Meanings::new(after));
    let addresses = running.iter().filter_map(|address| Some((address, *before.plan.addresses.get(address)?)));
    let same = |(address, call): (&String, NodeIndex)| {
        let other = *after.plan.addresses.get(address)?;
        (then.of(call)? == now.of(other)?).then_some(call)
    };
    addresses.filter_map(same).collect()
}

/// What calls compute, as the hash of all that leads to their outputs.
struct Meanings<'a> {
    world: World<'a>,
    known: BTreeMap<NodeIndex, Option<Digest>>,
}

impl<'a> Meanings<'a> {
    fn new(world: World<'a>) -> Self {
        Self { world, known: BTreeMap::new() }
    }

    /// `None` if one of its files cannot be read.
    fn of(&mut self, call: NodeIndex) -> Option<Digest> {
        let World { plan, sources } = self.world;
        let mut left = vec![call];
        while let Some(at) = left.last().copied() {
            let producers: Vec<_> = wires(plan, at).into_iter().map(|(_, from)| from).collect();
            let unknown: Vec<_> = producers.iter().copied().filter(|from| !self.known.contains_key(from)).collect();
            if !unknown.is_empty() {
                left.extend(unknown);
                continue;
            }
            left.pop();
            let inputs: Option<BTreeMap<_, _>> =
                producers.iter().map(|from| self.known[from].map(|digest| (*from, digest))).collect();
            let own = Ingredients::own(plan, at, sources).ok();
            let meaning =
                own.zip(inputs).map(|(own, inputs)| own.with_inputs(plan, at, |from| inputs.get(&from).copied()).key());
            self.known.insert(at, meaning);
        }
        self.known.get(&call).copied().flatten()
    }
}
