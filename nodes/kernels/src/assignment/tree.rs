//! The search tree: best bound first, over the dual bound of [`super::bound`].

use std::cmp::Reverse;
use std::collections::BTreeMap;

use super::bound::{Ascent, Outcome, Scratch};
use super::evolve::Evolution;
use super::model::Model;
use super::solve::{Limits, StopReason};
use super::sub::{Branch, Sub};
use super::symmetry::Symmetry;
use crate::stop::Stop;

/// Best bound first, then deeper first, then first made.
type Key = (Reverse<i64>, Reverse<usize>, u64);

/// Takes the number of nodes, the best assignment with its value, and the upper bound.
pub(super) type Report<'a> = dyn Fn(u64, (i64, &[u32]), Option<i64>) + 'a;

struct Open {
    /// Index into [`Tree::parents`]; `None` for the root.
    parent: Option<usize>,
    branch: Option<Branch>,
}

pub(super) struct Tree<'a> {
    dual: &'a Model,
    pub heuristic: Evolution<'a>,
    /// Not used where several solutions are wanted, as images of each other are different ones.
    symmetry: Option<Symmetry>,
    limits: &'a Limits,
    /// Ends the search with what it has; throws it away.
    stop: Stop<'a>,
    cancelled: Stop<'a>,
    report: &'a Report<'a>,
    scratch: Scratch,
    /// Expanded subproblems with their number of open children.
    parents: Vec<Option<(Sub, usize)>>,
    vacant: Vec<usize>,
    bytes: usize,
    open: BTreeMap<Key, Open>,
    newest: BTreeMap<u64, Key>,
    made: u64,
    /// Bound of the root while it is worked on; below all others before and after.
    root: i64,
    pub nodes: u64,
    /// Nodes when the best assignment was found.
    pub nodes_to_best: u64,
}

/// Nodes before which every node's assignment is improved by tabu search; later every eighth is.
const EAGER: u64 = 16;

impl<'a> Tree<'a> {
    pub fn new(
        dual: &'a Model,
        heuristic: Evolution<'a>,
        limits: &'a Limits,
        (stop, cancelled): (Stop<'a>, Stop<'a>),
        report: &'a Report<'a>,
    ) -> Self {
        Self {
            dual,
            heuristic,
            symmetry: if limits.solutions <= 1 { Symmetry::new(dual) } else { None },
            limits,
            stop,
            cancelled,
            report,
            scratch: Scratch::default(),
            parents: Vec::new(),
            vacant: Vec::new(),
            bytes: 0,
            open: BTreeMap::new(),
            newest: BTreeMap::new(),
            made: 0,
            root: i64::MIN,
            nodes: 0,
            nodes_to_best: 0,
        }
    }

    fn best(&self) -> i64 {
        self.heuristic.search.pool().best().map_or(i64::MIN / 4, |b| b.0)
    }

    /// Bounds at or below this cannot hold an assignment that is wanted, since objectives are multiples of `step`.
    fn threshold(&self) -> i64 {
        self.heuristic.search.pool().threshold() + self.dual.step - 1
    }

    /// Largest possible objective at or below a bound.
    fn floor(&self, bound: i64) -> i64 {
        bound.div_euclid(self.dual.step) * self.dual.step
    }

    pub fn upper(&self) -> i64 {
        self.open.keys().next().map_or(self.root, |k| k.0.0).max(self.best())
    }

    /// Bounds the root, round by round, and opens it or its branches; returns its bound.
    pub fn root(&mut self) -> i64 {
        let mut sub = Sub::root(self.dual);
        let rounds = if self.limits.node_limit == 0 { 0 } else { self.limits.root_rounds };
        self.nodes = u64::from(rounds > 0);
        let mut bound = self.ascend(&mut sub, 0, 0, i64::MAX);
        let (mut done, mut step) = (0, 1);
        while let Some(before) = bound
            && done < rounds
            && !(self.stop)()
        {
            // Shorter at first: an early assignment improves what follows.
            step = (2 * step).min(rounds - done);
            bound = self.ascend(&mut sub, step, 100, before);
            done += step;
            // Too wide for the bound alone: whatever is found now prunes from the start.
            self.root = bound.unwrap_or(i64::MIN);
            self.starts(|tree| tree.wide(tree.upper(), 10));
            let missing = before - self.threshold();
            if bound.is_some_and(|b| (before - b).saturating_mul(100) < missing) {
                break;
            }
        }
        self.root = i64::MIN;
        let value = bound.map_or(self.best(), |b| self.floor(b).max(self.best()));
        if let Some(bound) = bound {
            if self.limits.node_limit == 0 {
                self.push(bound, 0, Open { parent: None, branch: None });
            } else {
                self.expand(sub, bound);
            }
        }
        self.tell();
        value
    }

    /// Whether a bound is above the best by more than one part in `parts`.
    fn wide(&self, bound: i64, parts: i64) -> bool {
        bound.saturating_sub(self.best()) > self.best().saturating_abs() / parts
    }

    /// Rounds of the heuristics as long as there are some left, and `wanted`.
    fn starts(&mut self, wanted: impl Fn(&Self) -> bool) {
        while self.heuristic.rounds < self.limits.starts && wanted(self) && !(self.stop)() {
            let before = self.best();
            self.heuristic.advance(self.limits.starts - self.heuristic.rounds, self.limits.idle_moves);
            if self.best() > before {
                self.nodes_to_best = self.nodes;
            }
            self.tell();
        }
    }

    pub fn search(&mut self) -> StopReason {
        loop {
            let Some(&first) = self.open.keys().next() else {
                return StopReason::Proved;
            };
            if first.0.0 <= self.threshold() {
                self.open.clear();
                return StopReason::Proved;
            }
            if (self.stop)() {
                return StopReason::Stopped;
            }
            let ends = self.nodes >= self.limits.node_limit;
            // Easy problems need hardly any: a few for every node, all where many nodes are to be expected.
            self.starts(|tree| {
                let open = tree.upper() > tree.threshold();
                open && (ends || tree.wide(tree.upper(), 50) || tree.nodes >= tree.heuristic.rounds as u64)
            });
            if ends && first.0.0 > self.threshold() {
                return StopReason::NodeLimit;
            }
            if first.0.0 <= self.threshold() {
                continue;
            }
            let deepest = (self.bytes > self.limits.memory).then(|| self.newest.values().next_back().copied());
            let key = deepest.flatten().unwrap_or(first);
            let Some(node) = self.open.remove(&key) else {
                return StopReason::Proved;
            };
            self.newest.remove(&key.2);
            let sub = if key.0.0 > self.threshold() { self.materialise(&node) } else { None };
            self.release(node.parent);
            let Some(mut sub) = sub else { continue };
            self.nodes += 1;
            if let Some(bound) = self.ascend(&mut sub, self.limits.node_rounds, 10, key.0.0) {
                self.expand(sub, bound);
            }
            self.tell();
        }
    }

    fn materialise(&self, node: &Open) -> Option<Sub> {
        let (parent, _) = self.parents[node.parent?].as_ref()?;
        Some(parent.child(node.branch?))
    }

    fn release(&mut self, parent: Option<usize>) {
        let Some(at) = parent else { return };
        if let Some((sub, children)) = &mut self.parents[at] {
            *children -= 1;
            if *children == 0 {
                self.bytes -= sub.bytes();
                self.parents[at] = None;
                self.vacant.push(at);
            }
        }
    }

    /// The bound of a subproblem (at most `known`), unless it is pruned. May find a better assignment.
    fn ascend(&mut self, sub: &mut Sub, rounds: usize, patience: i64, known: i64) -> Option<i64> {
        let how = Ascent {
            threshold: self.threshold(),
            rounds,
            iterations: self.limits.iterations,
            patience,
            stop: self.stop,
            cancelled: self.cancelled,
        };
        let Outcome::Bound(bound) = sub.ascend(&mut self.scratch, &how) else {
            return None;
        };
        // Variables of the heuristics are the candidates.
        let chosen = sub.completion().into_iter().filter_map(|v| self.dual.source[v as usize]);
        let set: Vec<u32> = chosen.map(|a| a as u32).collect();
        let eager = self.nodes < EAGER || self.nodes.is_multiple_of(8);
        let before = self.best();
        let moves = if self.nodes <= 1 { 4 * self.dual.n_left } else { self.dual.n_left };
        self.heuristic.search.polish(&set, if eager { moves } else { 0 }, self.stop);
        if self.best() > before {
            self.nodes_to_best = self.nodes;
        }
        let bound = bound.min(known);
        (bound > self.threshold()).then_some(bound)
    }

    fn expand(&mut self, sub: Sub, bound: i64) {
        let mut options = sub.branches(self.threshold(), self.dual, self.symmetry.as_ref());
        if options.is_empty() {
            return;
        }
        let depth = sub.fixed.len() + 1;
        let at = self.vacant.pop().unwrap_or_else(|| {
            self.parents.push(None);
            self.parents.len() - 1
        });
        self.bytes += sub.bytes();
        self.parents[at] = Some((sub, options.len()));
        // The best branch last, so that depth first takes it first.
        options.reverse();
        for (own, branch) in options {
            self.push(own.min(bound), depth, Open { parent: Some(at), branch: Some(branch) });
        }
    }

    fn push(&mut self, bound: i64, depth: usize, node: Open) {
        let key = (Reverse(self.floor(bound)), Reverse(depth), self.made);
        self.newest.insert(self.made, key);
        self.made += 1;
        self.open.insert(key, node);
    }

    /// Reports the present state.
    pub fn tell(&self) {
        if let Some(best) = self.heuristic.search.pool().best() {
            (self.report)(self.nodes, best, Some(self.upper()));
        }
    }
}
