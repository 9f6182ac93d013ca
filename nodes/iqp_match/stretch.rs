//! The factor between the lengths of two shapes, where one is a part of the other or in another unit.

use salient_kernels::assignment::{self, Control, Limits};
use salient_sdk::{Context, NodeError};

use super::Params;
use super::model::Model;
use crate::patch_spectrum::Features;

/// Logarithmic step between factors tried.
const STEP: f64 = 0.1;
/// Distances below this share of the unit say little about the factor.
const SHORT: f64 = 0.2;

/// Rounds of the heuristics for each factor.
const ROUNDS: usize = 40;

/// The factor up to `params.stretch`, or its inverse, whose best match scores highest by the heuristics; the one nearest to 1
/// among equals. Refined once, by the median ratio of the distances that the match compares.
pub(super) fn search(left: &Features, right: &Features, params: &Params, cx: Context) -> Result<f64, NodeError> {
    let tried = factors(params);
    if tried.len() == 1 {
        return Ok(1.0);
    }
    let scores = cx.map(&tried, |_, log| {
        cx.check()?;
        score(left, right, params, *log, cx)
    })?;
    let mut best = 0;
    for (i, (value, _)) in scores.iter().enumerate() {
        if *value > scores[best].0 {
            best = i;
        }
    }
    let log = tried[best];
    let refined = (log + scores[best].1).clamp(-params.stretch.ln(), params.stretch.ln());
    let better = score(left, right, params, refined, cx)?.0 > scores[best].0;
    Ok(if better { refined } else { log }.exp())
}

/// Logarithms of the factors to try, those nearest to 0 first.
pub(super) fn factors(params: &Params) -> Vec<f64> {
    let steps = (params.stretch.ln() / STEP).ceil() as i32;
    let mut tried: Vec<f64> =
        (-steps..=steps).map(|i| f64::from(i) * params.stretch.ln() / f64::from(steps.max(1))).collect();
    tried.sort_by(|a, b| a.abs().total_cmp(&b.abs()).then(a.total_cmp(b)));
    tried
}

/// The heuristics' objective under a logarithmic factor, and by how much that factor seems to be wrong.
fn score(left: &Features, right: &Features, params: &Params, log: f64, cx: Context) -> Result<(f64, f64), NodeError> {
    let model = Model::new(left, right, params, log.exp(), cx)?;
    let problem = model.problem(cx)?;
    let limits = Limits { node_limit: 0, root_rounds: 0, starts: ROUNDS, ..Limits::default() };
    let stop = || cx.cancelled();
    let control = Control { cancelled: &stop, ..Control::default() };
    let found = assignment::solve(&problem, &limits, &control).map_err(super::unsolvable)?;
    let mut ratios = model.log_ratios(&found.candidates, SHORT);
    if ratios.is_empty() {
        return Ok((found.objective, 0.0));
    }
    let middle = ratios.len() / 2;
    Ok((found.objective, *ratios.select_nth_unstable_by(middle, f64::total_cmp).1))
}
