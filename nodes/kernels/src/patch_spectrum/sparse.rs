//! The lowest values of both problems by Lanczos, certified by inertia counts at the shift and above the last value.

use super::PatchError;
use super::factor::Factor;
use super::lanczos::{Lanczos, Ritz};
use super::memory::Memory;
use super::problem::Problem;
use crate::eigen::Hooks;
use crate::multifrontal::Fronts;
use std::f64::consts::PI;

/// Accepted bound of the relative error of a value.
const TOLERANCE: f64 = 1e-11;
/// Accepted effect of the rounding of solves on a value, relative to it.
const ROUNDING: f64 = 1e-10;
/// How far, relatively, Rayleigh quotients may be from the Ritz values that they replace.
const AGREEMENT: f64 = 1e-4;
/// The cut lies in a gap at least this wide, relative to the value above it.
const GAP: f64 = 1e-6;
/// The share of the wanted values below the shift: inside the spectrum it needs a quarter fewer vectors than below it.
const SHIFT_AT: f64 = 0.65;
/// Shifts tried in a row.
const SHIFTS: usize = 8;

/// The lowest `count` positive eigenvalues of one or two problems together, ascending, by panels of B vectors.
///
/// `Ok(None)` if they could not be certified.
pub(super) fn lowest<const B: usize>(
    problems: &[Problem],
    count: usize,
    seed: u64,
    memory: &mut Memory,
    hooks: &dyn Hooks,
) -> Result<Option<Vec<f64>>, PatchError> {
    // Weyl's law for the closed surface, of area 2 if doubled.
    let expected = 4.0 * PI * count as f64 / problems.len() as f64;
    let mut shift = SHIFT_AT * expected * (1.0 + 0.07 * seed as f64);
    let mut nudged = false;
    let Memory { fronts, factors, bases } = memory;
    for _ in 0..SHIFTS {
        if hooks.cancelled() {
            return Err(PatchError::Cancelled);
        }
        let Some(below) = factor(problems, shift, factors, fronts) else {
            shift *= 1.013;
            continue;
        };
        let found: usize = below.iter().sum();
        let target = SHIFT_AT * count as f64;
        let well_placed = found as f64 >= 0.5 * target - 1.0 && found as f64 <= 1.4 * target + 1.0;
        if !well_placed && !nudged {
            shift *= ((target + 0.5) / (found as f64 + 0.5)).clamp(0.2, 5.0);
            continue;
        }
        let parts = problems.iter().zip(&*factors).zip(&mut *bases);
        let runs = parts.map(|((problem, factor), basis)| Lanczos::new(problem, factor, basis, shift, seed));
        let Some(runs) = runs.collect::<Option<Vec<_>>>() else {
            // Too near an eigenvalue of one of the problems.
            shift *= 1.013;
            nudged = true;
            continue;
        };
        return Search::<B> { problems, runs, fronts, count, below_shift: below, shift, hooks }.run();
    }
    Ok(None)
}

/// Factors A - shift I of each problem; the number of its positive eigenvalues below the shift. `None` if one breaks down.
fn factor(problems: &[Problem], shift: f64, factors: &mut [Factor; 2], fronts: &mut Fronts) -> Option<[usize; 2]> {
    let mut below = [0; 2];
    for ((problem, factor), below) in problems.iter().zip(factors).zip(&mut below) {
        *below = positive(problem, factor.compute(problem, shift, fronts)?);
    }
    Some(below)
}

/// Of so many eigenvalues those that are not the null vector's.
fn positive(problem: &Problem, count: usize) -> usize {
    count.saturating_sub(usize::from(problem.has_null))
}

struct Search<'a, const B: usize> {
    problems: &'a [Problem],
    runs: Vec<Lanczos<'a, B>>,
    fronts: &'a mut Fronts,
    count: usize,
    /// Positive eigenvalues of each problem below the shift.
    below_shift: [usize; 2],
    shift: f64,
    hooks: &'a dyn Hooks,
}

/// What the Ritz values say.
enum Verdict {
    /// So many panels more seem to be needed, by problem.
    Wait([usize; 2]),
    /// These, each with the problem that it belongs to: the wanted ones and what is in a cluster with the last; and a cut above them.
    Settled { found: Vec<(f64, usize)>, cut: f64 },
}

impl<const B: usize> Search<'_, B> {
    fn run(mut self) -> Result<Option<Vec<f64>>, PatchError> {
        // Measured: so many vectors are needed for half of the values, which is a problem's usual share.
        let share = self.count.div_ceil(self.runs.len()) as f64;
        let first = ((1.5 * share + 13.0 + 5.0 * B as f64) / B as f64).ceil() as usize;
        let limit = 6 * first + 20;
        let mut next = [first; 2];
        let mut misses = 0;
        loop {
            for (run, &next) in self.runs.iter_mut().zip(&next) {
                while run.steps() < next {
                    if self.hooks.cancelled() {
                        return Err(PatchError::Cancelled);
                    }
                    run.step();
                }
            }
            match self.verdict() {
                Some(Verdict::Wait(more)) => next = [next[0] + more[0], next[1] + more[1]],
                Some(Verdict::Settled { found, cut }) => {
                    if self.certified(cut, &found) {
                        return Ok(self.accurate(&found));
                    }
                    // A value is missing that a few more panels may show.
                    misses += 1;
                    next = next.map(|n| n + 3);
                    if misses == 3 {
                        return Ok(None);
                    }
                }
                None => return Ok(None),
            }
            if next.iter().any(|&n| n > limit) {
                return Ok(None);
            }
        }
    }

    /// The values wanted, the low ones by Rayleigh quotients if rounding may be in them.
    fn accurate(&self, found: &[(f64, usize)]) -> Option<Vec<f64>> {
        let low = found.iter().take_while(|f| self.runs.iter().any(|run| run.rounding(f.0) > ROUNDING)).count();
        let mut values: Vec<f64> = found.iter().map(|f| f.0).collect();
        values.truncate(self.count);
        if low == 0 {
            return Some(values);
        }
        let mut all = Vec::new();
        for (which, run) in self.runs.iter().enumerate() {
            let count = found[..low].iter().filter(|f| f.1 == which).count();
            all.extend(run.rayleigh_quotients(count)?);
        }
        all.extend(found[low..].iter().map(|f| f.0));
        all.sort_by(f64::total_cmp);
        all.truncate(self.count);
        // They see errors of vectors squared: if they are far from the Ritz values, those are wrong by more than rounding.
        let near = |(new, old): (&f64, &f64)| (new - old).abs() <= AGREEMENT * old;
        all.iter().zip(&values).all(near).then_some(all)
    }

    /// Whether both problems have as many values below the cut as were found.
    fn certified(&mut self, cut: f64, found: &[(f64, usize)]) -> bool {
        let below: [usize; 2] = std::array::from_fn(|which| found.iter().filter(|f| f.1 == which).count());
        let fronts = &mut *self.fronts;
        self.problems.iter().zip(below).all(|(problem, below)| {
            problem.count_below(cut, fronts).is_some_and(|count| positive(problem, count) == below)
        })
    }

    fn verdict(&self) -> Option<Verdict> {
        let mut all: Vec<(Ritz, usize)> = Vec::new();
        for (which, run) in self.runs.iter().enumerate() {
            all.extend(run.ritz()?.into_iter().map(|ritz| (ritz, which)));
        }
        all.sort_by(|a, b| a.0.value.total_cmp(&b.0.value));
        let value = |i: usize| all[i].0.value;
        // The first gap above the last wanted value; past the last Ritz value there is none.
        let gap = |i: &usize| *i + 1 < all.len() && value(i + 1) - value(*i) > GAP * value(i + 1);
        let Some(last) = (self.count - 1..all.len()).find(gap) else { return Some(Verdict::Wait([2; 2])) };
        let of = |which: usize| all.iter().filter(move |r| r.1 == which).map(|r| r.0);
        let wait = |which: usize| {
            let found = of(which).take_while(|r| r.value <= value(last));
            let worst =
                found.fold(0.0f64, |worst, r| if r.error > worst || r.error.is_nan() { r.error } else { worst });
            if worst > TOLERANCE || worst.is_nan() {
                // Each panel divides errors by about a hundred.
                let panels = (worst / TOLERANCE).ln() / 4.6;
                return if panels.is_finite() { (panels.ceil() as usize).clamp(1, 6) } else { 2 };
            }
            let below_shift = of(which).filter(|r| r.value < self.shift).count();
            if below_shift == self.below_shift[which] { 0 } else { 2 }
        };
        let more = [0, 1].map(wait);
        if more != [0; 2] {
            return Some(Verdict::Wait(more));
        }
        let cut = value(last) + 0.4 * (value(last + 1) - value(last));
        let found = all[..=last].iter().map(|r| (r.0.value, r.1)).collect();
        Some(Verdict::Settled { found, cut })
    }
}
