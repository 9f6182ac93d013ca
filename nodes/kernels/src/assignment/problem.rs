//! The problem statement: candidates, scores, costs; validated on entry.

use std::fmt;

/// Why a problem was refused.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum ProblemError {
    /// A left or right feature index is not below the number of features of its side.
    FeatureOutOfRange {
        /// `"left"` or `"right"`.
        side: &'static str,
        /// The index given.
        index: usize,
        /// The number of features on that side.
        count: usize,
    },
    /// A pair term names a candidate that has not been added.
    CandidateOutOfRange {
        /// The index given.
        index: usize,
        /// The number of candidates so far.
        count: usize,
    },
    /// The same (left, right) pair was added as a candidate twice.
    DuplicateCandidate {
        /// The left feature.
        left: usize,
        /// The right feature.
        right: usize,
    },
    /// A pair term was given twice, in either order; it would be ambiguous whether it should be summed.
    DuplicatePair {
        /// The lower candidate index.
        a: usize,
        /// The higher candidate index.
        b: usize,
    },
    /// A pair term of a candidate with itself; that belongs in the candidate's own score.
    SelfPair {
        /// The candidate.
        a: usize,
    },
    /// A pair term between candidates that share a feature. They exclude each other, so the term can never count;
    /// it is refused because it shows that the caller built `H` from the wrong pairs.
    ExclusivePair {
        /// One candidate.
        a: usize,
        /// The other.
        b: usize,
    },
    /// A score or cost is NaN or infinite.
    NonFinite {
        /// What the value was given as.
        what: &'static str,
    },
    /// A cost list or matrix has the wrong number of values.
    WrongLength {
        /// What was given.
        what: &'static str,
        /// Its number of values.
        found: usize,
        /// The number it needs.
        expected: usize,
    },
    /// The scores are finite, but their sum is not; or there are more than `u32::MAX` candidates or pair terms.
    TooLarge,
}

impl fmt::Display for ProblemError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FeatureOutOfRange { side, index, count } => {
                write!(f, "{side} feature {index} does not exist: there are {count}")
            }
            Self::CandidateOutOfRange { index, count } => {
                write!(f, "candidate {index} does not exist: there are {count}")
            }
            Self::DuplicateCandidate { left, right } => {
                write!(f, "candidate ({left}, {right}) is given twice")
            }
            Self::DuplicatePair { a, b } => {
                write!(f, "the pair term of candidates {a} and {b} is given twice")
            }
            Self::SelfPair { a } => write!(f, "candidate {a} is paired with itself; its own score is its linear score"),
            Self::ExclusivePair { a, b } => {
                write!(f, "candidates {a} and {b} share a feature, so their pair term can never count")
            }
            Self::NonFinite { what } => write!(f, "{what} is not a finite number"),
            Self::WrongLength { what, found, expected } => write!(f, "{what} has {found} values, expected {expected}"),
            Self::TooLarge => f.write_str("the scores or the number of terms are too large to be summed"),
        }
    }
}

impl std::error::Error for ProblemError {}

/// Collects a [`Problem`] term by term.
#[derive(Debug, Clone)]
pub struct ProblemBuilder {
    n_left: usize,
    n_right: usize,
    candidates: Vec<(usize, usize)>,
    linear: Vec<f64>,
    pairs: Vec<(usize, usize, f64)>,
    left_cost: Vec<f64>,
    right_cost: Vec<f64>,
    must_match_all: bool,
}

impl ProblemBuilder {
    /// A problem over `n_left` and `n_right` features, without candidates, whose unmatched costs are 0.
    #[must_use]
    pub fn new(n_left: usize, n_right: usize) -> Self {
        Self {
            n_left,
            n_right,
            candidates: Vec::new(),
            linear: Vec::new(),
            pairs: Vec::new(),
            left_cost: vec![0.0; n_left],
            right_cost: vec![0.0; n_right],
            must_match_all: false,
        }
    }

    /// Adds the candidate pair (`left`, `right`) with linear score `c_a`, of either sign, and returns its index `a`
    /// (0, 1, ... in the order added). A duplicate is found by [`Self::build`].
    pub fn candidate(&mut self, left: usize, right: usize, score: f64) -> Result<usize, ProblemError> {
        check_index("left", left, self.n_left)?;
        check_index("right", right, self.n_right)?;
        check_finite("a candidate's score", score)?;
        self.candidates.push((left, right));
        self.linear.push(score);
        Ok(self.candidates.len() - 1)
    }

    /// Adds the score `h_ab`, of either sign, earned when candidates `a` and `b` are both chosen. Each unordered pair is given once
    /// (the upper triangle) and counts once. A pair given twice is found by [`Self::build`].
    pub fn pair(&mut self, a: usize, b: usize, score: f64) -> Result<(), ProblemError> {
        let count = self.candidates.len();
        for index in [a, b] {
            if index >= count {
                return Err(ProblemError::CandidateOutOfRange { index, count });
            }
        }
        if a == b {
            return Err(ProblemError::SelfPair { a });
        }
        let ((i, j), (k, l)) = (self.candidates[a], self.candidates[b]);
        if i == k || j == l {
            return Err(ProblemError::ExclusivePair { a, b });
        }
        check_finite("a pair score", score)?;
        if score != 0.0 {
            self.pairs.push((a.min(b), a.max(b), score));
        }
        Ok(())
    }

    /// The cost of leaving any one feature, of either side, unmatched; subtracted from the objective for each. A negative cost is a reward.
    pub fn unmatched_cost(&mut self, cost: f64) -> Result<(), ProblemError> {
        check_finite("the unmatched cost", cost)?;
        self.left_cost.fill(cost);
        self.right_cost.fill(cost);
        Ok(())
    }

    /// Unmatched costs feature by feature: `n_left` and `n_right` values.
    pub fn unmatched_costs(&mut self, left: &[f64], right: &[f64]) -> Result<(), ProblemError> {
        for (what, given, own) in [
            ("left unmatched costs", left, &mut self.left_cost),
            ("right unmatched costs", right, &mut self.right_cost),
        ] {
            if given.len() != own.len() {
                return Err(ProblemError::WrongLength { what, found: given.len(), expected: own.len() });
            }
            for &value in given {
                check_finite(what, value)?;
            }
            own.copy_from_slice(given);
        }
        Ok(())
    }

    /// Requires every feature of the smaller side (of the left side when equal, hence of both) to be matched.
    pub fn must_match_all(&mut self, yes: bool) {
        self.must_match_all = yes;
    }

    /// Checks what can only be seen as a whole, and makes the problem.
    pub fn build(self) -> Result<Problem, ProblemError> {
        let mut sorted = self.candidates.clone();
        sorted.sort_unstable();
        if let Some(twice) = sorted.windows(2).find(|w| w[0] == w[1]) {
            return Err(ProblemError::DuplicateCandidate { left: twice[0].0, right: twice[0].1 });
        }
        let mut pairs = self.pairs;
        pairs.sort_unstable_by_key(|&(a, b, _)| (a, b));
        if let Some(twice) = pairs.windows(2).find(|w| (w[0].0, w[0].1) == (w[1].0, w[1].1)) {
            return Err(ProblemError::DuplicatePair { a: twice[0].0, b: twice[0].1 });
        }
        let counts = [self.n_left, self.n_right, self.candidates.len(), pairs.len()];
        if counts.iter().any(|&n| n > u32::MAX as usize / 2) {
            return Err(ProblemError::TooLarge);
        }
        let (row, col, val) = symmetric_csr(self.candidates.len(), &pairs);
        let problem = Problem {
            n_left: self.n_left,
            n_right: self.n_right,
            candidates: self.candidates,
            linear: self.linear,
            row,
            col,
            val,
            left_cost: self.left_cost,
            right_cost: self.right_cost,
            must_match_all: self.must_match_all,
        };
        problem.can_be_summed().then_some(problem).ok_or(ProblemError::TooLarge)
    }
}

fn check_index(side: &'static str, index: usize, count: usize) -> Result<(), ProblemError> {
    if index < count { Ok(()) } else { Err(ProblemError::FeatureOutOfRange { side, index, count }) }
}

fn check_finite(what: &'static str, value: f64) -> Result<(), ProblemError> {
    if value.is_finite() { Ok(()) } else { Err(ProblemError::NonFinite { what }) }
}

/// Both triangles, columns ascending in each row; `pairs` is sorted by (a, b) with a < b.
fn symmetric_csr(n: usize, pairs: &[(usize, usize, f64)]) -> (Vec<usize>, Vec<u32>, Vec<f64>) {
    let mut row = vec![0; n + 1];
    for &(a, b, _) in pairs {
        row[a + 1] += 1;
        row[b + 1] += 1;
    }
    for a in 0..n {
        row[a + 1] += row[a];
    }
    let (mut next, mut col, mut val) = (row.clone(), vec![0; 2 * pairs.len()], vec![0.0; 2 * pairs.len()]);
    // Lower entries first: sorted by a, they fill each row b in ascending order, and all lie before its upper entries.
    for flip in [true, false] {
        for &(a, b, h) in pairs {
            let (r, c) = if flip { (b, a) } else { (a, b) };
            col[next[r]] = c as u32;
            val[next[r]] = h;
            next[r] += 1;
        }
    }
    (row, col, val)
}

/// A validated problem; see the [module](super) for its objective.
#[derive(Debug, Clone)]
pub struct Problem {
    pub(super) n_left: usize,
    pub(super) n_right: usize,
    pub(super) candidates: Vec<(usize, usize)>,
    pub(super) linear: Vec<f64>,
    /// Symmetric CSR over candidates: `h_ab` stands in row `a` and in row `b`, and counts once.
    pub(super) row: Vec<usize>,
    pub(super) col: Vec<u32>,
    pub(super) val: Vec<f64>,
    pub(super) left_cost: Vec<f64>,
    pub(super) right_cost: Vec<f64>,
    pub(super) must_match_all: bool,
}

impl Problem {
    /// The quadratic assignment problem of QAPLIB: minimise `sum_ij A[i][j] B[p(i)][p(j)]` over permutations `p`, with both
    /// matrices `n` x `n` in row order. Every left feature is matched, and the objective is **minus** the QAPLIB cost.
    pub fn from_qaplib(n: usize, a: &[f64], b: &[f64]) -> Result<Self, ProblemError> {
        for (what, m) in [("A", a), ("B", b)] {
            if m.len() != n * n {
                return Err(ProblemError::WrongLength { what, found: m.len(), expected: n * n });
            }
            for &v in m {
                check_finite(what, v)?;
            }
        }
        let mut builder = ProblemBuilder::new(n, n);
        builder.must_match_all(true);
        for i in 0..n {
            for k in 0..n {
                builder.candidate(i, k, -a[i * n + i] * b[k * n + k])?;
            }
        }
        for i in 0..n {
            for j in i + 1..n {
                for k in 0..n {
                    for l in (0..n).filter(|&l| l != k) {
                        let cost = a[i * n + j] * b[k * n + l] + a[j * n + i] * b[l * n + k];
                        builder.pair(i * n + k, j * n + l, -cost)?;
                    }
                }
            }
        }
        builder.build()
    }

    /// The numbers of left and right features.
    #[must_use]
    pub fn features(&self) -> (usize, usize) {
        (self.n_left, self.n_right)
    }

    /// The candidates (left, right), in the order they were added.
    #[must_use]
    pub fn candidates(&self) -> &[(usize, usize)] {
        &self.candidates
    }

    /// The score of each candidate alone.
    #[must_use]
    pub fn scores(&self) -> &[f64] {
        &self.linear
    }

    /// The same problem with other scores of the candidates alone.
    pub fn with_scores(&self, scores: Vec<f64>) -> Result<Self, ProblemError> {
        if scores.len() != self.linear.len() {
            let (found, expected) = (scores.len(), self.linear.len());
            return Err(ProblemError::WrongLength { what: "scores", found, expected });
        }
        scores.iter().try_for_each(|&score| check_finite("a candidate's score", score))?;
        let problem = Self { linear: scores, ..self.clone() };
        problem.can_be_summed().then_some(problem).ok_or(ProblemError::TooLarge)
    }

    /// The candidates that candidate `a` has a pair score with, ascending, and that score.
    pub fn pair_scores(&self, a: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.row[a]..self.row[a + 1];
        self.col[range.clone()].iter().map(|&b| b as usize).zip(self.val[range].iter().copied())
    }

    /// No sum of terms leaves the range of doubles. `val` has each pair twice.
    fn can_be_summed(&self) -> bool {
        let single = self.linear.iter().chain(&self.left_cost).chain(&self.right_cost);
        let total = single.map(|v| v.abs()).sum::<f64>() + self.val.iter().map(|h| 0.5 * h.abs()).sum::<f64>();
        (4.0 * total).is_finite()
    }

    /// Candidate indices by (left, right).
    pub(super) fn in_order(&self, mut candidates: Vec<usize>) -> Vec<usize> {
        candidates.sort_unstable_by_key(|&a| self.candidates[a]);
        candidates
    }

    /// The objective of a set of candidates: the exact sum of its terms, rounded once, so that the order of terms makes no difference.
    /// `None` if an index is out of range, two of them share a feature, or [`ProblemBuilder::must_match_all`] is violated.
    #[must_use]
    pub fn objective(&self, chosen: &[usize]) -> Option<f64> {
        let (mut left, mut right) = (vec![false; self.n_left], vec![false; self.n_right]);
        let mut used = vec![false; self.candidates.len()];
        for &a in chosen {
            let &(i, j) = self.candidates.get(a)?;
            if left[i] || right[j] {
                return None;
            }
            (left[i], right[j], used[a]) = (true, true, true);
        }
        if self.must_match_all && chosen.len() < self.n_left.min(self.n_right) {
            return None;
        }
        let mut terms = Vec::new();
        for &a in chosen {
            terms.push(self.linear[a]);
            let later =
                (self.row[a]..self.row[a + 1]).filter(|&e| used[self.col[e] as usize] && self.col[e] as usize > a);
            terms.extend(later.map(|e| self.val[e]));
        }
        for (matched, costs) in [(&left, &self.left_cost), (&right, &self.right_cost)] {
            terms.extend(matched.iter().zip(costs).filter(|(m, _)| !**m).map(|(_, &cost)| -cost));
        }
        Some(exact_sum(&terms))
    }
}

/// The sum rounded once to nearest, ties to even (Shewchuk 1997: a list of partial sums that do not overlap).
fn exact_sum(terms: &[f64]) -> f64 {
    let mut parts: Vec<f64> = Vec::new();
    for &term in terms {
        let mut x = term;
        let mut kept = 0;
        for at in 0..parts.len() {
            let y = parts[at];
            let sum = x + y;
            let bigger = if x.abs() >= y.abs() { (x, y) } else { (y, x) };
            let lost = bigger.1 - (sum - bigger.0);
            if lost != 0.0 {
                parts[kept] = lost;
                kept += 1;
            }
            x = sum;
        }
        parts.truncate(kept);
        parts.push(x);
    }
    round_parts(&parts)
}

/// Parts ascend in magnitude; only the first that do not vanish beside the rest decide the rounding.
fn round_parts(parts: &[f64]) -> f64 {
    let mut rest = parts.iter().rev();
    let Some(&first) = rest.next() else { return 0.0 };
    let mut high = first;
    let mut low = 0.0;
    for &part in rest.by_ref() {
        let sum = high + part;
        low = part - (sum - high);
        high = sum;
        if low != 0.0 {
            break;
        }
    }
    // Halfway between two numbers: what follows decides.
    if let Some(&next) = rest.next()
        && (low < 0.0 && next < 0.0 || low > 0.0 && next > 0.0)
    {
        let twice = 2.0 * low;
        let moved = high + twice;
        if moved - high == twice {
            high = moved;
        }
    }
    // Adding zero makes a negative zero positive.
    high + 0.0
}

#[cfg(test)]
mod tests {
    use super::exact_sum;
    use crate::random::Random;

    #[test]
    fn sums_are_rounded_once_in_any_order() {
        assert_eq!(exact_sum(&[1e100, 1.0, -1e100]), 1.0);
        assert_eq!(exact_sum(&[1.0, 2.0_f64.powi(-53), 2.0_f64.powi(-120)]), 1.0 + f64::EPSILON);
        assert_eq!(exact_sum(&[1.0, 2.0_f64.powi(-53), -2.0_f64.powi(-120)]), 1.0);
        assert_eq!(exact_sum(&[]).to_bits(), 0);
        let mut random = Random::from_state(1);
        for _ in 0..2000 {
            // Integers times powers of two, so that the sum is exact in i128.
            let scaled: Vec<i128> = (0..20)
                .map(|_| i128::from(random.bits() >> 11) << random.below(40))
                .enumerate()
                .map(|(k, v)| if k % 2 == 0 { v } else { -v })
                .collect();
            let terms: Vec<f64> = scaled.iter().map(|&v| v as f64).collect();
            let sum: i128 = scaled.iter().sum();
            // The cast of an integer rounds to nearest.
            assert_eq!(exact_sum(&terms), sum as f64);
            let mut reversed = terms;
            reversed.reverse();
            assert_eq!(exact_sum(&reversed), sum as f64);
        }
    }
}
