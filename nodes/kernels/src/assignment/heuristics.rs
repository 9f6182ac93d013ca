//! Primal heuristics, each callable by itself: an assignment, and no bound. Deterministic; where there is chance, it has a seed.

use super::canonical::Canonical;
use super::evolve::Evolution;
use super::lap::Lap;
use super::model::Model;
use super::problem::{Problem, ProblemBuilder};
use super::solve::{Control, Limits, solve};
use super::tables::Tables;
use super::tabu::Search;
use crate::stop::NEVER;

/// An assignment that a heuristic proposes.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// Candidate indices, by (left, right).
    pub candidates: Vec<usize>,
    /// [`Problem::objective`] of these candidates.
    pub objective: f64,
}

/// A problem prepared for the heuristics. Every method returns `None` only if not all features that must be matched can be, or a start given to
/// it is no assignment of this problem.
pub struct Heuristics<'a> {
    problem: &'a Problem,
    canonical: Canonical,
    model: Model,
    /// First variable of each left.
    start: Vec<u32>,
    /// Scores by which floating-point iterations run.
    linear: Vec<f64>,
    pairs: Vec<f64>,
}

impl<'a> Heuristics<'a> {
    /// Prepares a problem.
    #[must_use]
    pub fn new(problem: &'a Problem) -> Self {
        let canonical = Canonical::new(problem);
        let model = Model::plain(&canonical);
        let largest = model.linear.iter().chain(&model.val).map(|v| v.unsigned_abs()).max().unwrap_or(1).max(1) as f64;
        let mut start = vec![0_u32; model.n_left + 1];
        model.left.iter().for_each(|&k| start[k as usize + 1] += 1);
        (0..model.n_left).for_each(|k| start[k + 1] += start[k]);
        let real = |v: &[i64]| v.iter().map(|&v| v as f64 / largest).collect();
        let (linear, pairs) = (real(&model.linear), real(&model.val));
        Self { problem, canonical, model, start, linear, pairs }
    }

    /// Insertion of the candidate with the best gain, plus an estimate of what it will still earn, until none gains.
    #[must_use]
    pub fn greedy(&self) -> Option<Proposal> {
        let tables = Tables::new(&self.model);
        let mut search = Search::new(&tables, 0, 1);
        search.construct().then(|| self.best_of(&search))?
    }

    /// Spectral matching (Leordeanu & Hebert 2005): the leading eigenvector of the matrix of scores, made an assignment. At most
    /// `iterations` products with the matrix.
    #[must_use]
    pub fn spectral(&self, iterations: usize) -> Option<Proposal> {
        let m = self.model.left.len();
        // Negative terms could make another eigenvalue larger in magnitude: a shift prevents that.
        let negative = |a: usize| {
            self.pairs[self.model.row[a]..self.model.row[a + 1]].iter().map(|h| (-h).max(0.0)).sum::<f64>()
                + (-self.linear[a]).max(0.0)
        };
        let shift = (0..m).map(negative).fold(0.0, f64::max);
        let mut x = vec![1.0 / (m.max(1) as f64).sqrt(); m];
        for _ in 0..iterations {
            let mut y = self.product(&x);
            for ((y, x), c) in y.iter_mut().zip(&x).zip(&self.linear) {
                *y += (c + shift) * x;
            }
            let length = y.iter().map(|v| v * v).sum::<f64>().sqrt();
            if length == 0.0 {
                break;
            }
            for v in &mut y {
                *v /= length;
            }
            let change = x.iter().zip(&y).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            x = y;
            if change < 1e-9 {
                break;
            }
        }
        let set = self.nearest(&x)?;
        self.proposal_of(&set)
    }

    /// Frank-Wolfe with integer projected steps (IPFP, Leordeanu, Hebert & Sukthankar 2009): linear assignments to the gradient, with the best
    /// step towards each; the best of the assignments met. Starts from `from`, or from all candidates alike.
    #[must_use]
    pub fn frank_wolfe(&self, from: Option<&Proposal>, iterations: usize) -> Option<Proposal> {
        let m = self.model.left.len();
        let mut best = None;
        let mut x = vec![1.0 / self.model.n_right.max(1) as f64; m];
        if let Some(from) = from {
            x.fill(0.0);
            let set = self.variables(from)?;
            for &v in &set {
                x[v as usize] = 1.0;
            }
            best = self.proposal_of(&set);
        }
        for _ in 0..iterations {
            let mut gradient = self.product(&x);
            gradient.iter_mut().zip(&self.linear).for_each(|(g, c)| *g += c);
            let set = self.nearest(&gradient)?;
            let proposal = self.proposal_of(&set)?;
            if best.as_ref().is_none_or(|b| b.objective < proposal.objective) {
                best = Some(proposal);
            }
            let mut direction: Vec<f64> = x.iter().map(|v| -v).collect();
            for &v in &set {
                direction[v as usize] += 1.0;
            }
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let (slope, curve) = (dot(&gradient, &direction), dot(&self.product(&direction), &direction));
            if slope <= 1e-12 {
                break;
            }
            let step = if curve < 0.0 { (-slope / curve).min(1.0) } else { 1.0 };
            x.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
        }
        let last = self.nearest(&x).and_then(|set| self.proposal_of(&set))?;
        best.into_iter().chain([last]).reduce(|a, b| if b.objective > a.objective { b } else { a })
    }

    /// Tabu search over insertions that eject what they conflict with: from `from`, or from the greedy assignment, then `rounds` rounds of the
    /// heuristic search of [`solve()`] (many short searches that start between good assignments; not from `from`), each until `idle` moves bring no improvement.
    #[must_use]
    pub fn tabu(&self, from: Option<&Proposal>, rounds: usize, idle: usize, seed: u64) -> Option<Proposal> {
        let tables = Tables::new(&self.model);
        let mut search = Evolution::new(&tables, seed, 1, Control::default().spread);
        if let Some(from) = from {
            search.search.polish(&self.variables(from)?, idle, NEVER);
        } else if !search.first(idle, NEVER) {
            return None;
        }
        while search.rounds < rounds {
            search.advance(rounds - search.rounds, idle);
        }
        self.best_of(&search.search)
    }

    /// Fusion of proposals: the best assignment made of their candidates only, by branch and bound on those, within `node_limit` nodes. Never
    /// worse than the best of them; contains the fusion moves of Hutschenreiter et al. (2021), which choose between two.
    #[must_use]
    pub fn fuse(&self, proposals: &[Proposal], node_limit: u64) -> Option<Proposal> {
        let mut kept: Vec<usize> = proposals.iter().flat_map(|p| p.candidates.iter().copied()).collect();
        kept.sort_unstable();
        kept.dedup();
        let best = proposals.iter().cloned().reduce(|a, b| if b.objective > a.objective { b } else { a });
        let part = restricted(self.problem, &kept)?;
        let limits = Limits { node_limit, starts: 1, idle_moves: 100, ..Limits::default() };
        let fused = solve(&part, &limits, &Control::default()).ok().map(|s| {
            let candidates: Vec<usize> = s.candidates.iter().map(|&a| kept[a]).collect();
            Proposal { candidates: self.problem.in_order(candidates), objective: s.objective }
        });
        best.into_iter().chain(fused).reduce(|a, b| if b.objective > a.objective { b } else { a })
    }

    /// `H x`.
    fn product(&self, x: &[f64]) -> Vec<f64> {
        let m = &self.model;
        let row = |a: usize| m.row[a]..m.row[a + 1];
        (0..x.len())
            .map(|a| m.col[row(a)].iter().zip(&self.pairs[row(a)]).map(|(&b, h)| h * x[b as usize]).sum())
            .collect()
    }

    /// The assignment of the greatest sum of `weight`; nothing of weight 0 or less unless it must be.
    fn nearest(&self, weight: &[f64]) -> Option<Vec<u32>> {
        let largest = weight.iter().map(|w| w.abs()).fold(0.0, f64::max);
        let unit = if largest > 0.0 { 2.0_f64.powi(40) / largest } else { 1.0 };
        let w: Vec<i64> = weight.iter().map(|w| (w * unit) as i64).collect();
        let (m, mut lap) = (&self.model, Lap::default());
        lap.solve(&self.start, &m.right, &w, m.n_right, !m.mandatory, usize::MAX)?;
        Some(lap.used.iter().copied().filter(|&v| v != u32::MAX).collect())
    }

    fn best_of(&self, search: &Search) -> Option<Proposal> {
        self.proposal_of(search.pool().best()?.1)
    }

    fn proposal_of(&self, set: &[u32]) -> Option<Proposal> {
        let candidates = set.iter().map(|&v| self.canonical.source[v as usize]).collect();
        let candidates = self.problem.in_order(candidates);
        Some(Proposal { objective: self.problem.objective(&candidates)?, candidates })
    }

    fn variables(&self, of: &Proposal) -> Option<Vec<u32>> {
        self.problem.objective(&of.candidates)?;
        let mut variable = vec![0_u32; self.canonical.source.len()];
        self.canonical.source.iter().enumerate().for_each(|(v, &a)| variable[a] = v as u32);
        Some(of.candidates.iter().map(|&a| variable[a]).collect())
    }
}

/// The problem with only these candidates (ascending).
fn restricted(p: &Problem, kept: &[usize]) -> Option<Problem> {
    let mut builder = ProblemBuilder::new(p.n_left, p.n_right);
    let mut index = vec![None; p.candidates.len()];
    for &a in kept {
        let (i, j) = p.candidates[a];
        index[a] = builder.candidate(i, j, p.linear[a]).ok();
    }
    for &a in kept {
        for e in p.row[a]..p.row[a + 1] {
            let b = p.col[e] as usize;
            if let (Some(x), Some(y)) = (index[a], index[b])
                && a < b
            {
                builder.pair(x, y, p.val[e]).ok()?;
            }
        }
    }
    builder.unmatched_costs(&p.left_cost, &p.right_cost).ok()?;
    builder.must_match_all(p.must_match_all);
    builder.build().ok()
}
