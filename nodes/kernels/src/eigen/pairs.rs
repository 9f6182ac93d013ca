//! Approximate eigenpairs, how good they are, and where a cut above them can be placed.

use super::dense::inner;
use super::problem::Problem;
use faer::Mat;

/// A gap this wide, relative to the eigenvalue above it, is as good a place for the cut as any.
const WIDE: f64 = 1e-4;

/// A gap must be at least this wide for a cut.
const NARROW: f64 = 1e-8;

/// A residual this many times what rounding the entries of M may cause is as small as it can be.
const ROUNDING: f64 = 16.0;

/// Pairs of the scaled problem beyond its null space, values ascending: orthonormal columns y, and v = R^-1 y.
pub(super) struct Pairs {
    pub values: Vec<f64>,
    pub y: Mat<f64>,
    pub v: Mat<f64>,
}

impl Pairs {
    /// Rayleigh quotients of orthonormal columns, sorted.
    pub fn sorted(problem: &Problem<'_>, y: &Mat<f64>) -> Self {
        let n = y.nrows();
        let v = Mat::from_fn(n, y.ncols(), |i, j| y[(i, j)] / problem.root[i]);
        let quotient = |j: usize| problem.rayleigh_quotient(v.col_as_slice(j));
        let mut order: Vec<(f64, usize)> = (0..y.ncols()).map(|j| (quotient(j), j)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Self {
            values: order.iter().map(|o| o.0).collect(),
            y: Mat::from_fn(n, y.ncols(), |i, j| y[(i, order[j].1)]),
            v: Mat::from_fn(n, y.ncols(), |i, j| v[(i, order[j].1)]),
        }
    }

    /// The largest residual of the first `wanted` pairs, relative to their values, and whether those of *all* pairs are within bounds.
    pub fn worst_residual(&self, problem: &Problem<'_>, wanted: usize, tolerance: f64) -> (f64, bool) {
        let (mut worst, mut fine) = (0.0f64, true);
        for (j, &value) in self.values.iter().enumerate() {
            let (norm, rounding) = problem.residual(value, self.v.col_as_slice(j));
            fine &= value > 0.0 && norm <= (tolerance * value).max(ROUNDING * rounding) && norm.is_finite();
            if j < wanted {
                worst = worst.max(norm / value);
            }
        }
        (worst, fine)
    }

    /// The largest residual of the null vectors over the first positive eigenvalue: rounding of the row sums.
    pub fn null_residual(&self, problem: &Problem<'_>) -> f64 {
        let Some(&first) = self.values.first() else {
            return 0.0;
        };
        let mut squares = vec![0.0f64; problem.nullity()];
        for i in 0..problem.n() {
            if let Some((label, unit)) = problem.null_entry(i) {
                squares[label] += (problem.stiffness.row_sum(i) * unit / problem.root[i].powi(2)).powi(2);
            }
        }
        squares.iter().fold(0.0f64, |worst, s| worst.max(s.sqrt())) / first
    }

    /// The largest entry of |Y' Y - I|, the null space included.
    pub fn orthogonality_error(&self, problem: &Problem<'_>) -> f64 {
        let gram = inner(self.y.as_ref(), self.y.as_ref());
        let mut worst = 0.0f64;
        for i in 0..gram.nrows() {
            for j in 0..gram.ncols() {
                let identity = if i == j { 1.0 } else { 0.0 };
                worst = worst.max((gram[(i, j)] - identity).abs());
            }
        }
        // Against the null space: what projecting it out once more changes.
        let mut change = self.y.clone();
        problem.project_out_kernel(change.as_mut());
        change -= &self.y;
        let norm = |j: usize| change.col_as_slice(j).iter().map(|x| x * x).sum::<f64>().sqrt();
        (0..change.ncols()).fold(worst, |worst, j| worst.max(norm(j)))
    }
}

/// A place in a gap of the spectrum, above the first `position` values; `width` is the gap's, relative to the value above.
pub(super) struct Cut {
    pub position: usize,
    pub value: f64,
    pub width: f64,
}

/// The first wide gap above the wanted pairs, else the widest there is, else, if the values are all there are, the end; else nothing.
pub(super) fn place_cut(values: &[f64], wanted: usize, available: usize) -> Option<Cut> {
    if values.len() < wanted {
        return None;
    }
    let mut best: Option<Cut> = None;
    for position in wanted..values.len() {
        let below = if position == 0 { 0.0 } else { values[position - 1] };
        let above = values[position];
        let width = (above - below) / above;
        if width > best.as_ref().map_or(NARROW, |b| b.width) {
            best = Some(Cut { position, value: 0.5 * (below + above), width });
        }
        if width > WIDE {
            break;
        }
    }
    // No gap, but nothing above either: any cut above the last.
    let all = values.len() == available;
    let above_all = || Cut { position: available, value: 2.0 * values.last().copied().unwrap_or(1.0), width: 0.5 };
    best.or_else(|| all.then(above_all))
}
