//! One column of a comparison.

use std::collections::{BTreeMap, HashMap, VecDeque};

use salient_sdk::{Defect, Mesh};

use crate::engine::Ingredients;
use crate::engine::history::{RunBody, RunCall, RunKind, RunRecord};

/// A variant, a graph or a run: part of a recorded run, with addresses as the graph has them without variants.
pub struct Side<'a> {
    /// The head of its column.
    pub name: String,
    /// The run that it is part of.
    pub body: &'a RunBody,
    /// Its calls by address, without the variant.
    pub addresses: BTreeMap<&'a str, usize>,
    /// Its calls and their first addresses, producers before consumers.
    pub calls: Vec<(usize, &'a str)>,
    /// Its results.
    pub shown: Vec<(&'a str, usize)>,
    /// What its addresses begin with in the run.
    prefix: String,
    /// Length of the longest path that leads to each call.
    depths: HashMap<usize, usize>,
}

/// The sides that a run has: one for each of its variants, or one. `name` is put before the variants' names, if not
/// empty.
#[must_use]
pub fn sides<'a>(name: &str, run: &'a RunRecord) -> Vec<Side<'a>> {
    if run.summary.variants.is_empty() {
        let name = if name.is_empty() { "graph" } else { name };
        return vec![Side::new(name.to_owned(), &run.body, "")];
    }
    let side = |variant: &String| {
        let name = if name.is_empty() { variant.clone() } else { format!("{name}:{variant}") };
        Side::new(name, &run.body, &format!("{variant}:"))
    };
    run.summary.variants.iter().map(side).collect()
}

impl<'a> Side<'a> {
    fn new(name: String, body: &'a RunBody, prefix: &str) -> Self {
        let (mut addresses, mut calls, mut depths) = (BTreeMap::new(), Vec::new(), HashMap::new());
        for (i, call) in body.calls.iter().enumerate() {
            let own: Vec<&str> = call.addresses.iter().filter_map(|a| a.strip_prefix(prefix)).collect();
            let Some(first) = own.first() else { continue };
            calls.push((i, *first));
            addresses.extend(own.iter().map(|address| (*address, i)));
            let before = call.inputs.iter().filter_map(|(_, _, from)| depths.get(from)).max();
            depths.insert(i, before.map_or(0, |depth: &usize| depth + 1));
        }
        let shown = body.shown.iter().filter_map(|(a, call)| Some((a.strip_prefix(prefix)?, *call))).collect();
        Self { name, body, addresses, calls, shown, prefix: prefix.to_owned(), depths }
    }

    /// The addresses of a call, its first one first.
    pub fn addresses_of(&self, call: usize) -> impl Iterator<Item = &'a str> {
        self.call(call).addresses.iter().filter_map(|address| address.strip_prefix(self.prefix.as_str()))
    }

    /// A call.
    #[must_use]
    pub fn call(&self, call: usize) -> &'a RunCall {
        &self.body.calls[call]
    }

    /// Its kind.
    #[must_use]
    pub fn kind(&self, call: usize) -> &'a RunKind {
        self.body.kind(call)
    }

    /// All that it depended on.
    #[must_use]
    pub fn ingredients(&self, call: usize) -> Ingredients {
        self.body.ingredients(call)
    }

    /// How far from the first inputs a call is.
    #[must_use]
    pub fn depth(&self, call: usize) -> usize {
        self.depths.get(&call).copied().unwrap_or_default()
    }

    /// The address of a call.
    #[must_use]
    pub fn name_of(&self, call: usize) -> &'a str {
        let found = self.calls.binary_search_by_key(&call, |(call, _)| *call);
        found.map_or("", |at| self.calls[at].1)
    }

    /// The nearest call that makes a mesh, from this one upward, itself included.
    #[must_use]
    pub fn surface(&self, call: usize) -> Option<usize> {
        let is_mesh = |call: usize| self.kind(call).output == <Mesh as salient_sdk::Artefact>::TYPE;
        let (mut left, mut seen) = (VecDeque::from([call]), std::collections::BTreeSet::from([call]));
        while let Some(call) = left.pop_front() {
            if is_mesh(call) {
                return Some(call);
            }
            left.extend(self.call(call).inputs.iter().map(|(_, _, from)| *from).filter(|from| seen.insert(*from)));
        }
        None
    }

    /// What is doubtful about what a call rests on, each with the address where it arose.
    #[must_use]
    pub fn defects(&self, call: usize) -> Vec<(&'a str, &'a Defect)> {
        let (mut left, mut cone) = (vec![call], std::collections::BTreeSet::from([call]));
        while let Some(call) = left.pop() {
            left.extend(self.call(call).inputs.iter().map(|(_, _, from)| *from).filter(|from| cone.insert(*from)));
        }
        let mut all = Vec::new();
        for call in cone {
            let it = self.call(call);
            // A node passes on the defects of what it was given.
            let passed =
                |defect: &Defect| it.inputs.iter().any(|(_, _, from)| self.call(*from).defects.contains(defect));
            all.extend(it.defects.iter().filter(|d| !passed(d)).map(|defect| (self.name_of(call), defect)));
        }
        all
    }
}
