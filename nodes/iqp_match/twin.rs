//! The mirror twin of a match: on a symmetric shape a match and its mirror image score (nearly) the same.
//!
//! It is the best match under a fine on every candidate that sends a feature (nearly) where the match does. The fine is the
//! match's mean score per pair. Repeating a share s of the match then costs s against at most s² of its score, so no
//! share pays by itself; but a feature on the plane of symmetry, which belongs to the twin as well, earns about twice the
//! mean there and stays. What was found is improved without the fine. A second round then fines only features that the first one
//! moved.
//!
//! A shape may nearly have other symmetries: a standing figure looks alike from front and back. So further ones are sought,
//! under a fine on all that was found before, and the orientation of the surface has more to choose from.

use salient_kernels::assignment::{self, Control, Limits, Problem};
use salient_sdk::{Context, NodeError};

use super::model::Model;

/// Partners nearer than this, over the square root of the right shape's area, are the same place.
pub(crate) const NEAR: f64 = 0.2;
/// Rounds of search.
const ROUNDS: usize = 2;
/// Rounds of the heuristics in each.
const STARTS: usize = 200;
/// Passes of the improvement; each changes something, and a few are enough.
const PASSES: usize = 100;

/// How many are sought: left to right, front to back, and both, make three.
const SOUGHT: usize = 3;
/// One that scores less than this share of the match is none.
const WORTH: f64 = 0.5;

/// Candidates of a twin, ascending, and the share of features matched in both that lie apart from the match.
pub(super) struct Found {
    pub chosen: Vec<usize>,
    pub objective: f64,
    pub moved: f64,
}

/// Twins of the match `chosen`, best first.
pub(super) fn search(
    model: &Model,
    problem: &Problem,
    chosen: &[usize],
    objective: f64,
    cx: Context,
) -> Result<Vec<Found>, NodeError> {
    let mut twins: Vec<Found> = Vec::new();
    if chosen.is_empty() || objective <= 0.0 {
        return Ok(twins);
    }
    let fine = objective / chosen.len() as f64;
    let own = near(model, chosen);
    let mut before = own.clone();
    for _ in 0..SOUGHT {
        let twin = another(model, problem, &before, fine, cx)?;
        let value = problem.objective(&twin).unwrap_or(f64::NEG_INFINITY);
        if value < WORTH * objective || moved(model, chosen, &twin, &before) <= 0.0 {
            break;
        }
        for (b, n) in before.iter_mut().zip(near(model, &twin)) {
            *b |= n;
        }
        let moved = moved(model, chosen, &twin, &own);
        twins.push(Found { chosen: twin, objective: value, moved });
    }
    twins.sort_by(|a, b| b.objective.total_cmp(&a.objective));
    Ok(twins)
}

/// The best match under a fine on candidates in `before`, improved without it.
fn another(model: &Model, problem: &Problem, before: &[bool], fine: f64, cx: Context) -> Result<Vec<usize>, NodeError> {
    let limits = Limits { node_limit: 0, root_rounds: 0, starts: STARTS, ..Limits::default() };
    let stop = || cx.cancelled();
    let control = Control { cancelled: &stop, ..Control::default() };
    let (mut fined, mut twin) = (before.to_vec(), Vec::new());
    for _ in 0..ROUNDS {
        let scores = problem.scores().iter().zip(&fined).map(|(c, fined)| if *fined { c - fine } else { *c });
        let harder = problem.with_scores(scores.collect()).map_err(|e| super::unbuildable(&e))?;
        let found = assignment::solve(&harder, &limits, &control).map_err(super::unsolvable)?;
        twin = improved(model, problem, found.candidates, cx)?;
        let stay: Vec<usize> = twin.iter().filter(|a| before[**a]).map(|a| model.candidates[*a].left).collect();
        fined = (0..before.len()).map(|a| before[a] && !stay.contains(&model.candidates[a].left)).collect();
    }
    Ok(twin)
}

/// Of the features that both match, the share whose partner in the twin is not `near`.
fn moved(model: &Model, chosen: &[usize], twin: &[usize], near: &[bool]) -> f64 {
    let lefts: Vec<usize> = chosen.iter().map(|a| model.candidates[*a].left).collect();
    let both: Vec<usize> = twin.iter().copied().filter(|a| lefts.contains(&model.candidates[*a].left)).collect();
    let apart = both.iter().filter(|a| !near[**a]).count();
    if both.is_empty() { 0.0 } else { apart as f64 / both.len() as f64 }
}

/// For each candidate, whether it sends its left feature near to where the match sends it.
fn near(model: &Model, chosen: &[usize]) -> Vec<bool> {
    let is_near = |c: &super::model::Candidate| {
        let own = chosen.iter().map(|a| &model.candidates[*a]).find(|own| own.left == c.left);
        own.is_some_and(|own| model.apart(own.right, c.right) <= NEAR)
    };
    model.candidates.iter().map(is_near).collect()
}

/// Adds, drops and exchanges candidates one at a time as long as that raises the score, the best change first.
fn improved(model: &Model, problem: &Problem, mut chosen: Vec<usize>, cx: Context) -> Result<Vec<usize>, NodeError> {
    let all = &model.candidates;
    // What each candidate earns with those that are chosen, and saves as the cost of two unmatched features.
    let mut earns: Vec<f64> = problem.scores().iter().map(|c| c + model.saves()).collect();
    let change = |earns: &mut [f64], a: usize, sign: f64| {
        problem.pair_scores(a).for_each(|(b, h)| earns[b] += sign * h);
    };
    for a in &chosen {
        change(&mut earns, *a, 1.0);
    }
    for _ in 0..PASSES {
        cx.check()?;
        let gain = |a: usize| {
            if chosen.contains(&a) {
                return -earns[a];
            }
            // At most two: they lose what they earn, but what they earn together only once.
            let out: Vec<usize> = chosen.iter().copied().filter(|b| all[*b].excludes(&all[a])).collect();
            let mut gain = earns[a] - out.iter().map(|b| earns[*b]).sum::<f64>();
            if let [b, c] = out[..] {
                gain += model.together(&all[b], &all[c]);
            }
            gain
        };
        let best = (0..all.len()).map(|a| (a, gain(a))).max_by(|x, y| x.1.total_cmp(&y.1).then(y.0.cmp(&x.0)));
        let Some((a, _)) = best.filter(|(_, gain)| *gain > 1e-9) else { break };
        let (gone, kept): (Vec<usize>, Vec<usize>) =
            chosen.iter().partition(|b| **b == a || all[**b].excludes(&all[a]));
        for b in &gone {
            change(&mut earns, *b, -1.0);
        }
        chosen = kept;
        if !gone.contains(&a) {
            change(&mut earns, a, 1.0);
            chosen.push(a);
        }
    }
    chosen.sort_unstable();
    Ok(chosen)
}
