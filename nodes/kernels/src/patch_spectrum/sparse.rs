//! The lowest values of both problems by Lanczos, certified by inertia counts at the shift and above the last value.

use super::PatchError;
use super::factor::{Counts, Factoriser};
use super::lanczos::{Lanczos, Ritz};
use super::problem::Doubled;
use crate::eigen::Hooks;
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

/// The lowest `count` positive eigenvalues of A and its leading block together, ascending. Lanes and block size as in [`Lanczos`].
///
/// `Ok(None)` if they could not be certified.
pub(super) fn lowest<const L: usize, const B: usize>(
    factoriser: &Factoriser<'_>,
    problem: &Doubled,
    count: usize,
    seed: u64,
    hooks: &dyn Hooks,
) -> Result<Option<Vec<f64>>, PatchError> {
    let problems = L / B;
    // Weyl's law for the closed surface, of area 2 if doubled.
    let expected = 4.0 * PI * count as f64 / problems as f64;
    let mut shift = SHIFT_AT * expected * (1.0 + 0.07 * seed as f64);
    let mut nudged = false;
    for _ in 0..SHIFTS {
        if hooks.cancelled() {
            return Err(PatchError::Cancelled);
        }
        let Some(numbers) = factoriser.factor(shift) else {
            shift *= 1.013;
            continue;
        };
        let below = positive(numbers.counts(), problems);
        let found = total(below);
        let target = SHIFT_AT * count as f64;
        let well_placed = found as f64 >= 0.5 * target - 1.0 && found as f64 <= 1.4 * target + 1.0;
        if !well_placed && !nudged {
            shift *= ((target + 0.5) / (found as f64 + 0.5)).clamp(0.2, 5.0);
            continue;
        }
        let packed = numbers.packed();
        let Some(run) = Lanczos::<L, B>::new(problem, &packed, shift, seed) else {
            // Too near an eigenvalue of one of the problems.
            shift *= 1.013;
            nudged = true;
            continue;
        };
        return Search { factoriser, run, count, below_shift: below, shift, hooks }.run();
    }
    Ok(None)
}

/// Counts without the Neumann problem's zero; without a Dirichlet problem its count is 0.
fn positive(counts: Counts, problems: usize) -> [usize; 2] {
    [counts.neumann.saturating_sub(1), if problems == 2 { counts.dirichlet } else { 0 }]
}

fn total(counts: [usize; 2]) -> usize {
    counts[0] + counts[1]
}

struct Search<'a, const L: usize, const B: usize> {
    factoriser: &'a Factoriser<'a>,
    run: Lanczos<'a, L, B>,
    count: usize,
    /// Positive eigenvalues of each problem below the shift.
    below_shift: [usize; 2],
    shift: f64,
    hooks: &'a dyn Hooks,
}

/// What the Ritz values say.
enum Verdict {
    /// This many panels more seem to be needed.
    Wait(usize),
    /// These, each with the problem that it belongs to: the wanted ones and what is in a cluster with the last; and a cut above them.
    Settled { found: Vec<(f64, usize)>, cut: f64 },
}

impl<const L: usize, const B: usize> Search<'_, L, B> {
    const PROBLEMS: usize = L / B;

    fn run(mut self) -> Result<Option<Vec<f64>>, PatchError> {
        // Measured: so many vectors are needed for half of the values, which is a problem's usual share.
        let share = self.count.div_ceil(Self::PROBLEMS) as f64;
        let mut next = ((1.5 * share + 13.0 + 5.0 * B as f64) / B as f64).ceil() as usize;
        let limit = 6 * next + 20;
        let mut misses = 0;
        loop {
            while self.run.steps() < next {
                if self.hooks.cancelled() {
                    return Err(PatchError::Cancelled);
                }
                self.run.step();
            }
            match self.verdict() {
                Some(Verdict::Wait(more)) => next += more,
                Some(Verdict::Settled { found, cut }) => {
                    if self.certified(cut, &found) {
                        return Ok(self.accurate(&found));
                    }
                    // A value is missing that a few more panels may show.
                    misses += 1;
                    next += 3;
                    if misses == 3 {
                        return Ok(None);
                    }
                }
                None => return Ok(None),
            }
            if next > limit {
                return Ok(None);
            }
        }
    }

    /// The values wanted, the low ones by Rayleigh quotients if rounding may be in them.
    fn accurate(&self, found: &[(f64, usize)]) -> Option<Vec<f64>> {
        let low = found.iter().take_while(|f| self.run.rounding(f.0) > ROUNDING).count();
        let mut values: Vec<f64> = found.iter().map(|f| f.0).collect();
        values.truncate(self.count);
        if low == 0 {
            return Some(values);
        }
        let mut all = Vec::new();
        for which in 0..Self::PROBLEMS {
            let count = found[..low].iter().filter(|f| f.1 == which).count();
            all.extend(self.run.rayleigh_quotients(which, count)?);
        }
        all.extend(found[low..].iter().map(|f| f.0));
        all.sort_by(f64::total_cmp);
        all.truncate(self.count);
        // They see errors of vectors squared: if they are far from the Ritz values, those are wrong by more than rounding.
        let near = |(new, old): (&f64, &f64)| (new - old).abs() <= AGREEMENT * old;
        all.iter().zip(&values).all(near).then_some(all)
    }

    /// Whether both problems have as many values below the cut as were found.
    fn certified(&self, cut: f64, found: &[(f64, usize)]) -> bool {
        let below: [usize; 2] = std::array::from_fn(|which| found.iter().filter(|f| f.1 == which).count());
        let counts = self.factoriser.factor(cut).map(|numbers| numbers.counts());
        counts.is_some_and(|counts| positive(counts, Self::PROBLEMS) == below)
    }

    fn verdict(&self) -> Option<Verdict> {
        let mut all: Vec<(Ritz, usize)> = Vec::new();
        for which in 0..Self::PROBLEMS {
            all.extend(self.run.ritz(which)?.into_iter().map(|ritz| (ritz, which)));
        }
        all.sort_by(|a, b| a.0.value.total_cmp(&b.0.value));
        let value = |i: usize| all[i].0.value;
        // The first gap above the last wanted value; past the last Ritz value there is none.
        let gap = |i: &usize| *i + 1 < all.len() && value(i + 1) - value(*i) > GAP * value(i + 1);
        let Some(last) = (self.count - 1..all.len()).find(gap) else { return Some(Verdict::Wait(2)) };
        let worst = all[..=last].iter().fold(0.0f64, |m, r| m.max(r.0.error));
        let lower = |which: usize, bound: f64| all.iter().filter(|r| r.1 == which && r.0.value < bound).count();
        let shift_agrees = (0..Self::PROBLEMS).all(|which| lower(which, self.shift) == self.below_shift[which]);
        if worst.is_nan() || worst > TOLERANCE || !shift_agrees {
            // Each panel divides errors by about a hundred.
            let panels = (worst / TOLERANCE).ln() / 4.6;
            return Some(Verdict::Wait(if panels.is_finite() { (panels.ceil() as usize).clamp(1, 6) } else { 2 }));
        }
        let cut = value(last) + 0.4 * (value(last + 1) - value(last));
        let found = all[..=last].iter().map(|r| (r.0.value, r.1)).collect();
        Some(Verdict::Settled { found, cut })
    }
}
