//! The solver's entry: heuristics, then branch and bound; what may be asked of it and what it returns.

use std::cell::Cell;
use std::fmt;

use super::canonical::Canonical;
use super::evolve::Evolution;
use super::model::Model;
use super::problem::Problem;
use super::tables::Tables;
use super::tree::Tree;
use crate::stop::{NEVER, Stop};

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
    /// Rounds of the heuristic search (`evolve`), each a short tabu search. One is made before the root's bound; all the others during it where
    /// that leaves a wide gap, else a few for every node. Those left at the node limit are made then. Easy problems need none of them.
    pub starts: usize,
    /// Moves without improvement that end a round.
    pub idle_moves: usize,
    /// Seed of the tabu search.
    pub seed: u64,
    /// How many best distinct assignments are wanted (1 or more). The search ends when all of them are proved: nothing outside of
    /// [`Solution::ranked`] is better than its last.
    pub solutions: usize,
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
            starts: 3000,
            idle_moves: 100,
            seed: 0,
            solutions: 1,
            memory: 256 << 20,
        }
    }
}

/// State of the search: after some rounds of the heuristics and after each node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Nodes so far.
    pub nodes: u64,
    /// Objective of the best assignment so far.
    pub objective: f64,
    /// Upper bound so far; infinite before the root's.
    pub upper_bound: f64,
    /// The search has ended with a proof.
    pub proved: bool,
}

/// Calls a function for every index below a number, in any order, perhaps several at a time; returns when all are done.
pub type Spread<'a> = &'a dyn Fn(usize, &(dyn Fn(usize) + Sync));

/// The caller's hooks. The kernel reads no clock: a time limit is a `stop` that reads one, and its results are then not reproducible.
pub struct Control<'a> {
    /// Asked often (per sweep, and every few moves); on `true` the search ends with the best found and its valid bound.
    pub stop: &'a dyn Fn() -> bool,
    /// Asked more often, and before there is anything to return, too; once true (and from then on), the search ends with
    /// [`SolveError::Cancelled`].
    pub cancelled: Stop<'a>,
    /// Called after some rounds of the heuristics and after each node.
    pub progress: &'a dyn Fn(&Progress),
    /// Lends threads: independent parts of the heuristic search go through it. The result is the same for any number of threads.
    pub spread: Spread<'a>,
}

impl Default for Control<'_> {
    fn default() -> Self {
        Self { stop: NEVER, cancelled: NEVER, progress: &|_| {}, spread: &|n, call| (0..n).for_each(call) }
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
    /// [`Control::cancelled`] said so.
    Cancelled,
}

impl fmt::Display for SolveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Infeasible => "no one-to-one choice of candidates matches every feature that must be matched",
            Self::Cancelled => "cancelled",
        })
    }
}

impl std::error::Error for SolveError {}

/// One of the best assignments.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranked {
    /// Candidate indices, by (left, right).
    pub candidates: Vec<usize>,
    /// [`Problem::objective`] of these candidates.
    pub objective: f64,
}

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
    /// Objective before branching: of the heuristics and what the root's bound led to.
    pub heuristic_objective: f64,
    /// The assignment is optimal, up to [`Self::resolution`].
    pub proved: bool,
    /// Objectives closer than this are not told apart. 0 when scores and costs are integers of moderate size.
    pub resolution: f64,
    /// Subproblems whose bound was computed.
    pub nodes: u64,
    /// Of these, how many had been when the best assignment was found; 0 if the heuristics found it.
    pub nodes_to_best: u64,
    /// The best distinct assignments found, best first, at most [`Limits::solutions`]; the first is the one above. If the search ended with
    /// [`StopReason::Proved`], no other assignment is better than the last of them (up to [`Self::resolution`]).
    pub ranked: Vec<Ranked>,
    /// The same call gives the same result: false if [`Control::stop`] ended the search.
    pub reproducible: bool,
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

/// Maximises the problem's objective. The order in which candidates and pairs were added makes no difference, nor does a swap of left and right,
/// as both are brought into one form first; among equal objectives the first found is kept.
pub fn solve(problem: &Problem, limits: &Limits, control: &Control) -> Result<Solution, SolveError> {
    let go_on = || if (control.cancelled)() { Err(SolveError::Cancelled) } else { Ok(()) };
    let canonical = Canonical::new(problem);
    go_on()?;
    let primal = Model::plain(&canonical);
    go_on()?;
    let objective = |set: &[u32]| objective(problem, &canonical, set);
    let known = Cell::new((i64::MIN, 0.0));
    let dual = primal.bounding(control.cancelled);
    go_on()?;
    let report = |nodes: u64, best: (i64, &[u32]), upper: Option<i64>| {
        if known.get().0 != best.0 {
            known.set((best.0, objective(best.1)));
        }
        let objective = known.get().1;
        let upper_bound = upper.map_or(f64::INFINITY, |u| dual.to_real(u).max(objective));
        (control.progress)(&Progress { nodes, objective, upper_bound, proved: upper.is_some_and(|u| u <= best.0) });
    };
    let tables = Tables::new(&primal);
    let mut heuristic = Evolution::new(&tables, limits.seed, limits.solutions, control.spread);
    // With no round wanted, the greedy assignment is still there.
    let halts = || (control.stop)() || (control.cancelled)();
    if !heuristic.first(if limits.starts == 0 { 0 } else { limits.idle_moves }, &halts) {
        return Err(SolveError::Infeasible);
    }
    go_on()?;
    report(0, heuristic.search.pool().best().ok_or(SolveError::Infeasible)?, None);
    let mut tree = Tree::new(&dual, heuristic, limits, (&halts, control.cancelled), &report);
    let root_bound = tree.root();
    go_on()?;
    let before = tree.heuristic.search.pool().best().map_or(0.0, |b| objective(b.1));
    let stop = tree.search();
    go_on()?;
    tree.tell();
    let (best, set) = tree.heuristic.search.pool().best().ok_or(SolveError::Infeasible)?;
    let ranked = |set: &[u32]| {
        let candidates = set.iter().map(|&a| canonical.source[a as usize]).collect();
        Ranked { objective: objective(set), candidates: problem.in_order(candidates) }
    };
    let first = ranked(set);
    let real = |bound: i64| dual.to_real(bound).max(first.objective);
    Ok(Solution {
        pairs: first.candidates.iter().map(|&a| problem.candidates[a]).collect(),
        upper_bound: real(tree.upper()),
        root_bound: real(root_bound),
        heuristic_objective: before,
        proved: tree.upper() <= best,
        resolution: dual.resolution(&canonical),
        nodes: tree.nodes,
        nodes_to_best: tree.nodes_to_best,
        ranked: tree.heuristic.search.pool().sets().iter().map(|s| ranked(&s.1)).collect(),
        reproducible: stop != StopReason::Stopped,
        stop,
        objective: first.objective,
        candidates: first.candidates,
    })
}

fn objective(problem: &Problem, canonical: &Canonical, set: &[u32]) -> f64 {
    let candidates: Vec<usize> = set.iter().map(|&a| canonical.source[a as usize]).collect();
    problem.objective(&candidates).expect("the search keeps its assignments one to one and complete")
}
