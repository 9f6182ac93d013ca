//! The mirror twin of a match: on a symmetric shape a match and its mirror image score (nearly) the same.
//!
//! It is the best match under a fine on every candidate that sends a feature (nearly) where the match does. The fine is the
//! match's mean score per pair. Repeating a share s of the match then costs s against at most s² of its score, so no
//! share pays by itself; but a feature on the plane of symmetry, which belongs to the twin as well, earns about twice the
//! mean there and stays. What was found is improved without the fine. A second round then fines only features that the first one
//! moved.

use salient_kernels::assignment::{self, Control, Limits};
use salient_sdk::{Context, NodeError};

use super::model::Model;

/// Partners nearer than this, over the square root of the right shape's area, are the same place.
const NEAR: f64 = 0.2;
/// Rounds of search.
const ROUNDS: usize = 2;
/// Passes of the improvement; each changes something, and a few are enough.
const PASSES: usize = 100;

/// Candidates of the twin, ascending, and the share of features matched in both that lie apart.
pub(super) struct Found {
    pub chosen: Vec<usize>,
    pub objective: f64,
    pub moved: f64,
}

/// The twin of the match `chosen`, if one scores above zero and moves any feature.
pub(super) fn search(model: &Model, chosen: &[usize], objective: f64, cx: Context) -> Result<Option<Found>, NodeError> {
    if chosen.is_empty() || objective <= 0.0 {
        return Ok(None);
    }
    let near = near(model, chosen);
    let fine = objective / chosen.len() as f64;
    let limits = Limits { node_limit: 0, root_sweeps: 0, ..Limits::default() };
    let control = Control { stop: &|| cx.cancelled(), progress: &|_| {} };
    let (mut fined, mut twin) = (near.clone(), Vec::new());
    for _ in 0..ROUNDS {
        let problem = model.problem(|a| if fined[a] { -fine } else { 0.0 }).map_err(super::unbuildable)?;
        let found = assignment::solve(&problem, &limits, &control).map_err(super::unsolvable)?;
        cx.check()?;
        twin = improved(model, found.candidates);
        let stay: Vec<usize> = twin.iter().filter(|a| near[**a]).map(|a| model.candidates[*a].left).collect();
        fined = (0..near.len()).map(|a| near[a] && !stay.contains(&model.candidates[a].left)).collect();
    }
    let plain = model.problem(|_| 0.0).map_err(super::unbuildable)?;
    let value = plain.objective(&twin).unwrap_or(f64::NEG_INFINITY);
    let lefts: Vec<usize> = chosen.iter().map(|a| model.candidates[*a].left).collect();
    let both: Vec<usize> = twin.iter().copied().filter(|a| lefts.contains(&model.candidates[*a].left)).collect();
    let apart = both.iter().filter(|a| !near[**a]).count();
    if value <= 0.0 || apart == 0 {
        return Ok(None);
    }
    Ok(Some(Found { chosen: twin, objective: value, moved: apart as f64 / both.len() as f64 }))
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
fn improved(model: &Model, mut chosen: Vec<usize>) -> Vec<usize> {
    let all = &model.candidates;
    for _ in 0..PASSES {
        let gain = |a: usize| {
            let stays = |b: &&usize| **b != a && !all[**b].excludes(&all[a]);
            let earns = |c: usize, among: &mut dyn Iterator<Item = usize>| {
                model.alone(&all[c]) + among.map(|b| model.together(&all[c], &all[b])).sum::<f64>()
            };
            let own = earns(a, &mut chosen.iter().filter(stays).copied());
            if chosen.contains(&a) {
                return -own;
            }
            let mut left = chosen.clone();
            let mut loss = 0.0;
            for b in chosen.iter().filter(|b| all[**b].excludes(&all[a])) {
                left.retain(|c| c != b);
                loss += earns(*b, &mut left.iter().copied());
            }
            own - loss
        };
        let best = (0..all.len()).map(|a| (a, gain(a))).max_by(|x, y| x.1.total_cmp(&y.1).then(y.0.cmp(&x.0)));
        match best {
            Some((a, gain)) if gain > 1e-9 => {
                if chosen.contains(&a) {
                    chosen.retain(|b| *b != a);
                } else {
                    chosen.retain(|b| !all[*b].excludes(&all[a]));
                    chosen.push(a);
                }
            }
            _ => break,
        }
    }
    chosen.sort_unstable();
    chosen
}
