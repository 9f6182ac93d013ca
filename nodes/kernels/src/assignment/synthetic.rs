//! Matching problems as the pipeline makes them, from a seed: for tests, benchmarks and comparisons with other solvers.

use super::problem::{Problem, ProblemBuilder, ProblemError};
use crate::random::Random;

/// Two sets of points in the unit square, of which a part is common; candidates by a random descriptor; scores of pairs
/// by how well they keep distances.
///
/// `h_ab = exp(-(d_ik - d_jl)^2 / 2 sigma^2)` for candidates `a = (i, j)` and `b = (k, l)`, kept where it is at least `floor`
/// and both distances are below `reach`, so that `H` is sparse.
#[derive(Clone, Debug, PartialEq)]
pub struct Synthetic {
    /// Points on the left.
    pub left: usize,
    /// Points on the right.
    pub right: usize,
    /// Share, in [0, 1], of the smaller side's points that have a true partner.
    pub common: f64,
    /// Each coordinate of a true partner is displaced by up to this much. At least 0.
    pub noise: f64,
    /// Candidates of each left point. A true partner is always among them.
    pub candidates: usize,
    /// Width of the kernel on differences of distance. Above 0.
    pub sigma: f64,
    /// Scores below this are dropped. In [0, 1].
    pub floor: f64,
    /// Pairs of points farther apart than this on either side have no score. Above 0.
    pub reach: f64,
    /// Subtracted from every kept pair score; above 0 it makes some negative.
    pub shift: f64,
    /// Seed of the points and descriptors.
    pub seed: u64,
}

impl Synthetic {
    /// `n` points a side, 70 % common, displaced by up to 5 %.
    #[must_use]
    pub fn hard(n: usize, seed: u64) -> Self {
        Self {
            left: n,
            right: n,
            common: 0.7,
            noise: 0.05,
            candidates: 6,
            sigma: 0.05,
            floor: 0.1,
            reach: 0.3,
            shift: 0.0,
            seed,
        }
    }

    /// `n` points a side, nothing in common.
    #[must_use]
    pub fn none(n: usize, seed: u64) -> Self {
        Self { common: 0.0, ..Self::hard(n, seed) }
    }

    /// Makes the problem. The shuffled partner of each left point comes with it, `None` if it has none.
    pub fn build(&self) -> Result<(Problem, Vec<Option<usize>>), ProblemError> {
        let mut random = Random::new(&[self.seed, self.left as u64, self.right as u64]);
        let left: Vec<[f64; 2]> = (0..self.left).map(|_| [random.unit(), random.unit()]).collect();
        let mut right: Vec<[f64; 2]> = (0..self.right).map(|_| [random.unit(), random.unit()]).collect();
        let place = random.permutation(self.right);
        let common = (self.common.clamp(0.0, 1.0) * self.left.min(self.right) as f64).floor() as usize;
        let mut truth = vec![None; self.left];
        for i in 0..common {
            let j = place[i] as usize;
            right[j] = left[i].map(|x| x + self.noise * random.signed());
            truth[i] = Some(j);
        }
        let mut builder = ProblemBuilder::new(self.left, self.right);
        let mut candidates = Vec::new();
        for (i, truth) in truth.iter().enumerate() {
            let mut ranked: Vec<(f64, usize)> =
                (0..self.right).map(|j| (random.unit() * if *truth == Some(j) { 0.05 } else { 1.0 }, j)).collect();
            ranked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            ranked.truncate(self.candidates);
            ranked.sort_unstable_by_key(|r| r.1);
            for (distance, j) in ranked {
                builder.candidate(i, j, (-4.0 * distance).exp())?;
                candidates.push((i, j));
            }
        }
        let distance = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
        for (a, &(i, j)) in candidates.iter().enumerate() {
            for (b, &(k, l)) in candidates.iter().enumerate().skip(a + 1) {
                if i == k || j == l {
                    continue;
                }
                let (d, e) = (distance(left[i], left[k]), distance(right[j], right[l]));
                let h = (-(d - e).powi(2) / (2.0 * self.sigma * self.sigma)).exp();
                if h >= self.floor && d < self.reach && e < self.reach {
                    builder.pair(a, b, h - self.shift)?;
                }
            }
        }
        Ok((builder.build()?, truth))
    }
}
