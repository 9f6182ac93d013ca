//! Branch and bound, best bound first, over the dual bound of [`super::bound`].

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fmt;

use super::bound::{Ascent, Outcome, Scratch};
use super::sub::{Branch, Sub};
use super::model::Model;
use super::problem::Problem;
use super::tabu::Search;

/// How much work [`solve`] may do. Equal limits give bit-identical results.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// Subproblems whose bound may be computed, the root included. 0 leaves the heuristics and the root's first, unimproved bound.
    pub node_limit: u64,
    /// Rounds of the relaxation at the root, of [`Self::iterations`] each.
    pub root_rounds: usize,
    /// Rounds of the relaxation at every other node.
    pub node_rounds: usize,
    /// Iterations of the relaxation between two evaluations of the bound.
    pub iterations: usize,
    /// Runs of the tabu search before branching.
    pub starts: usize,
    /// Moves without improvement that end a run.
    pub idle_moves: usize,
    /// Seed of the tabu search.
    pub seed: u64,
    /// Bytes of open subproblems above which the search goes depth first until it is below again (by then it may exceed this by
    /// one subproblem per level). Does not bound the problem itself.
    pub memory: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            node_limit: 1000,
            root_rounds: 30,
            node_rounds: 4,
            iterations: 40,
            starts: 10,
            idle_moves: 1000,
            seed: 0,
            memory: 256 << 20,
        }
    }
}

/// State of the search, after each node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Nodes so far.
    pub nodes: u64,
    /// Objective of the best assignment so far.
    pub objective: f64,
    /// Upper bound so far.
    pub upper_bound: f64,
}

/// The caller's hooks. The kernel reads no clock: a time limit is a `stop` that reads one, and its results are then not reproducible.
pub struct Control<'a> {
    /// Asked often (per sweep, and every few moves); on `true` the search ends with the best found and its valid bound.
    pub stop: &'a dyn Fn() -> bool,
    /// Called after each node.
    pub progress: &'a dyn Fn(&Progress),
}

impl Default for Control<'_> {
    fn default() -> Self {
        Self { stop: &|| false, progress: &|_| {} }
    }
}

/// What ended the search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// Nothing was left to search.
    Proved,
    /// [`Limits::node_limit`].
    NodeLimit,
    /// [`Control::stop`].
    Stopped,
}

/// Why there is no solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum SolveError {
    /// Every feature of the smaller side must be matched, and no one-to-one choice of candidates does that. This is proved.
    Infeasible,
}

impl fmt::Display for SolveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("no one-to-one choice of candidates matches every feature that must be matched")
    }
}

impl std::error::Error for SolveError {}

/// The best assignment found, and what is proved about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Matched (left, right) features, ascending.
    pub pairs: Vec<(usize, usize)>,
    /// The candidate index of each pair.
    pub candidates: Vec<usize>,
    /// [`Problem::objective`] of these candidates.
    pub objective: f64,
    /// No assignment has an objective above this.
    pub upper_bound: f64,
    /// The bound at the root.
    pub root_bound: f64,
    /// Objective of the heuristics' assignment, before branching.
    pub heuristic_objective: f64,
    /// The assignment is optimal, up to [`Self::resolution`].
    pub proved: bool,
    /// Objectives closer than this are not told apart. 0 when scores and costs are integers of moderate size.
    pub resolution: f64,
    /// Subproblems whose bound was computed.
    pub nodes: u64,
    /// What ended the search.
    pub stop: StopReason,
}

impl Solution {
    /// `upper_bound - objective`, at least 0.
    #[must_use]
    pub fn gap(&self) -> f64 {
        self.upper_bound - self.objective
    }

    /// The gap as a fraction of the objective's magnitude; 0 when both are 0, infinite when only the objective is.
    #[must_use]
    pub fn relative_gap(&self) -> f64 {
        if self.gap() == 0.0 { 0.0 } else { self.gap() / self.objective.abs() }
    }
}

/// Maximises the problem's objective. The order in which candidates and pairs were added makes no difference to the pairs found, as long as
/// scores are summed alike: variables are ordered by (left, right), and among equal objectives the first found is kept.
pub fn solve(problem: &Problem, limits: &Limits, control: &Control) -> Result<Solution, SolveError> {
    let primal = Model::new(problem, false);
    let mut heuristic = Search::new(&primal, limits.seed);
    heuristic.run(limits.starts, limits.idle_moves, control.stop);
    let (_, set) = heuristic.best().ok_or(SolveError::Infeasible)?;
    let heuristic_objective = objective(problem, &primal, set);
    let dual = Model::new(problem, true);
    let mut tree = Tree::new(problem, &primal, &dual, heuristic, limits, control);
    let root_bound = tree.root();
    let stop = tree.search();
    let (best, set) = tree.heuristic.best().ok_or(SolveError::Infeasible)?;
    let mut candidates: Vec<usize> = set.iter().filter_map(|&a| primal.source[a as usize]).collect();
    candidates.sort_unstable_by_key(|&a| problem.candidates[a]);
    let objective = objective(problem, &primal, set);
    let upper = tree.upper();
    let real = |bound: i64| dual.to_real(bound).max(objective);
    Ok(Solution {
        pairs: candidates.iter().map(|&a| problem.candidates[a]).collect(),
        candidates,
        objective,
        upper_bound: real(upper),
        root_bound: real(root_bound),
        heuristic_objective,
        proved: upper <= best,
        resolution: dual.resolution(problem),
        nodes: tree.nodes,
        stop: if upper <= best { StopReason::Proved } else { stop },
    })
}

fn objective(problem: &Problem, model: &Model, set: &[u32]) -> f64 {
    let candidates: Vec<usize> = set.iter().filter_map(|&a| model.source[a as usize]).collect();
    problem.objective(&candidates).expect("the search keeps its assignments one to one and complete")
}

/// Best bound first, then deeper first, then first made.
type Key = (Reverse<i64>, Reverse<usize>, u64);

struct Open {
    /// Index into [`Tree::parents`]; `None` for the root.
    parent: Option<usize>,
    branch: Option<Branch>,
}

struct Tree<'a> {
    dual: &'a Model,
    heuristic: Search<'a>,
    limits: &'a Limits,
    control: &'a Control<'a>,
    problem: &'a Problem,
    primal: &'a Model,
    /// Heuristic variable of each candidate.
    variable: Vec<u32>,
    scratch: Scratch,
    /// Expanded subproblems with their number of open children.
    parents: Vec<Option<(Sub, usize)>>,
    vacant: Vec<usize>,
    bytes: usize,
    open: BTreeMap<Key, Open>,
    newest: BTreeMap<u64, Key>,
    made: u64,
    nodes: u64,
    root: Option<Sub>,
}

impl<'a> Tree<'a> {
    fn new(
        problem: &'a Problem,
        primal: &'a Model,
        dual: &'a Model,
        heuristic: Search<'a>,
        limits: &'a Limits,
        control: &'a Control<'a>,
    ) -> Self {
        let mut variable = vec![0; problem.candidates.len()];
        primal.source.iter().enumerate().for_each(|(v, a)| a.iter().for_each(|&a| variable[a] = v as u32));
        Self {
            dual,
            heuristic,
            limits,
            control,
            problem,
            primal,
            variable,
            scratch: Scratch::default(),
            parents: Vec::new(),
            vacant: Vec::new(),
            bytes: 0,
            open: BTreeMap::new(),
            newest: BTreeMap::new(),
            made: 0,
            nodes: 0,
            root: Some(Sub::root(dual)),
        }
    }

    fn best(&self) -> i64 {
        self.heuristic.best().map_or(i64::MIN / 4, |b| b.0)
    }

    /// Bounds at or below this cannot hold a better assignment, since objectives are multiples of `step`.
    fn threshold(&self) -> i64 {
        self.best() + self.dual.step - 1
    }

    /// Largest possible objective at or below a bound.
    fn floor(&self, bound: i64) -> i64 {
        bound.div_euclid(self.dual.step) * self.dual.step
    }

    fn upper(&self) -> i64 {
        self.open.keys().next().map_or(i64::MIN, |k| k.0.0).max(self.best())
    }

    /// Bounds the root and opens it or its branches; returns its bound.
    fn root(&mut self) -> i64 {
        let Some(mut sub) = self.root.take() else {
            return self.best();
        };
        let rounds = if self.limits.node_limit == 0 { 0 } else { self.limits.root_rounds };
        if rounds > 0 {
            self.nodes = 1;
        }
        let bound = self.ascend(&mut sub, rounds, 100_000, i64::MAX);
        let value = bound.map_or(self.best(), |b| self.floor(b).max(self.best()));
        if let Some(bound) = bound {
            if self.limits.node_limit == 0 {
                self.push(bound, 0, Open { parent: None, branch: None });
            } else {
                self.expand(sub, bound);
            }
        }
        self.report();
        value
    }

    fn search(&mut self) -> StopReason {
        loop {
            let Some(&first) = self.open.keys().next() else {
                return StopReason::Proved;
            };
            if first.0.0 <= self.threshold() {
                self.open.clear();
                return StopReason::Proved;
            }
            if self.nodes >= self.limits.node_limit {
                return StopReason::NodeLimit;
            }
            if (self.control.stop)() {
                return StopReason::Stopped;
            }
            let key = if self.bytes > self.limits.memory { self.newest.values().next_back().copied() } else { None }
                .unwrap_or(first);
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
            self.report();
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
        let how = Ascent { threshold: self.threshold(), rounds, iterations: self.limits.iterations, patience, stop: self.control.stop };
        let Outcome::Bound(bound) = sub.ascend(&mut self.scratch, &how) else {
            return None;
        };
        let set: Vec<u32> =
            sub.completion().iter().filter_map(|&v| self.dual.source[v as usize]).map(|a| self.variable[a]).collect();
        self.heuristic.polish(&set, self.dual.n_left);
        let bound = bound.min(known);
        (bound > self.threshold()).then_some(bound)
    }

    fn expand(&mut self, sub: Sub, bound: i64) {
        let mut options = sub.branches(self.threshold());
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

    fn report(&self) {
        let objective = self.heuristic.best().map_or(f64::NEG_INFINITY, |b| objective(self.problem, self.primal, b.1));
        let upper_bound = self.dual.to_real(self.upper()).max(objective);
        (self.control.progress)(&Progress { nodes: self.nodes, objective, upper_bound });
    }
}
