//! Block Lanczos on (A - shift I)^-1. Bases are reorthogonalised in full; they stay in cache.

use super::factor::Factor;
use super::panel::{
    Block, Group, ROWS, Row, add_multiple, gram, groups, groups_mut, inner, multiply, size, subtract, to_groups,
    to_rows,
};
use super::problem::Problem;
use super::solve::solve;
use super::tridiagonal;
use crate::random::Random;
use crate::simd::vectorised;

/// A column that orthogonalisation shrinks by this factor is rounding error: the space is exhausted.
const EXHAUSTED: f64 = 1e-12;
/// Where it shrinks by this factor, another pass is due.
const SHRUNK: f64 = 1e-3;
/// A factorisation is used if it returns known solutions this well.
const ACCURACY: f64 = 1e-6;
/// Ritz values this near each other, relative to their distance from the shift, are bounded together.
const CLUSTER: f64 = 1e-3;

/// A Ritz value of A.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ritz {
    pub value: f64,
    /// Bound of its relative error.
    pub error: f64,
}

/// The run, with panels of B vectors.
pub(super) struct Lanczos<'a, const B: usize> {
    problem: &'a Problem,
    factor: &'a Factor,
    shift: f64,
    /// Relative error of a known solution.
    solve_error: f64,
    /// The panels one after the other.
    basis: &'a mut Vec<f64>,
    /// The present one by rows.
    rows: Vec<Row<B>>,
    /// Diagonal blocks of the projection, and the triangular blocks below them.
    diagonal: Vec<Block<B>>,
    below: Vec<Block<B>>,
}

impl<'a, const B: usize> Lanczos<'a, B> {
    /// A run from random vectors; `None` if the factorisation is not accurate.
    pub fn new(
        problem: &'a Problem,
        factor: &'a Factor,
        basis: &'a mut Vec<f64>,
        shift: f64,
        seed: u64,
    ) -> Option<Self> {
        let (rows, diagonal, below) = (vec![[0.0; B]; problem.n()], Vec::new(), Vec::new());
        basis.clear();
        let mut run = Self { problem, factor, shift, solve_error: 0.0, basis, rows, diagonal, below };
        run.solve_error = run.known_solution();
        if run.solve_error.is_nan() || run.solve_error > ACCURACY {
            return None;
        }
        let mut random = Random::new(&[seed]);
        for row in &mut run.rows {
            *row = std::array::from_fn(|_| random.signed());
        }
        let start = run.append();
        let scale = norms(&gram::<B>(start));
        orthonormalise(start, &scale);
        Some(run)
    }

    /// Panels so far.
    pub fn steps(&self) -> usize {
        self.diagonal.len()
    }

    /// What rounding may do to an eigenvalue, relative to it.
    pub fn rounding(&self, value: f64) -> f64 {
        self.solve_error * (value - self.shift).abs() / value
    }

    /// How well the factorisation returns a known solution, relative to it: the null vector, or what of it is in the problem.
    fn known_solution(&self) -> f64 {
        let Problem { root, pull, .. } = self.problem;
        let mut x: Vec<Row<1>> = root.iter().zip(pull).map(|(u, pull)| [pull - self.shift * u]).collect();
        solve(&self.problem.symbolic, self.factor, &mut x);
        let (mut error, mut size) = (0.0, 0.0);
        for (x, u) in x.iter().zip(root) {
            error += (x[0] - u) * (x[0] - u);
            size += u * u;
        }
        (error / size).sqrt()
    }

    /// Appends the rows to the basis, without the null vector: the new panel.
    fn append(&mut self) -> &mut [Group<B>] {
        remove_null(self.problem, &mut self.rows);
        let from = self.basis.len();
        self.basis.resize(from + size::<B>(self.rows.len()), 0.0);
        let panel = groups_mut(&mut self.basis[from..]);
        to_groups(&self.rows, panel);
        panel
    }

    /// One more panel.
    pub fn step(&mut self) {
        let (j, size) = (self.diagonal.len(), size::<B>(self.problem.n()));
        to_rows(groups(&self.basis[j * size..]), &mut self.rows);
        solve::<B>(&self.problem.symbolic, self.factor, &mut self.rows);
        self.append();
        let (done, w) = self.basis.split_at_mut((j + 1) * size);
        let (done, w): (Vec<&[Group<B>]>, _) = (done.chunks_exact(size).map(groups).collect(), groups_mut(w));
        let before = norms(&gram::<B>(w));
        // Against all: the recurrence alone, against the last two, loses orthogonality as soon as a value converges.
        let mut along = [[0.0; B]; B];
        let mut passes = 0;
        loop {
            let coefficients = inner(&done, w);
            subtract(w, &done, &coefficients);
            for i in 0..B {
                for l in 0..B {
                    along[i][l] += coefficients[j][i][l];
                }
            }
            passes += 1;
            let after = norms(&gram::<B>(w));
            if passes == 2 || (0..B).all(|l| after[l] >= SHRUNK * before[l]) {
                break;
            }
        }
        self.diagonal.push(along);
        self.below.push(orthonormalise(w, &before));
    }

    /// The operator on the basis, a band matrix in full.
    fn projection(&self) -> Vec<f64> {
        let (steps, m) = (self.steps(), self.steps() * B);
        let mut t = vec![0.0; m * m];
        for j in 0..steps {
            for i in 0..B {
                for k in 0..B {
                    let symmetric = 0.5 * (self.diagonal[j][i][k] + self.diagonal[j][k][i]);
                    t[(j * B + i) * m + j * B + k] = symmetric;
                    if j + 1 < steps {
                        let value = self.below[j][i][k];
                        t[((j + 1) * B + i) * m + j * B + k] = value;
                        t[(j * B + k) * m + (j + 1) * B + i] = value;
                    }
                }
            }
        }
        t
    }

    /// The Ritz values, ascending; only positive ones. `None` if the small problem fails.
    pub fn ritz(&self) -> Option<Vec<Ritz>> {
        let (steps, m) = (self.steps(), self.steps() * B);
        let mut t = self.projection();
        let mut tails: Vec<Vec<f64>> =
            (0..B).map(|i| (0..m).map(|c| f64::from(u8::from(c == m - B + i))).collect()).collect();
        let inverses = tridiagonal::eigenvalues(&mut t, m, &mut tails)?;
        let last = &self.below[steps - 1];
        let residual = |c: usize| {
            let component = |i: usize| (0..B).map(|k| last[i][k] * tails[k][c]).sum::<f64>();
            (0..B).map(|i| component(i).powi(2)).sum::<f64>()
        };
        let squares: Vec<f64> = (0..m).map(residual).collect();
        let mut all: Vec<Ritz> = (0..m)
            .filter_map(|c| {
                let inverse = inverses[c];
                let value = self.shift + 1.0 / inverse;
                let bound = error_bound(&inverses, &squares, c);
                // d(1 / x) = dx / x^2
                let error = bound / (inverse * inverse * value);
                (value > 0.0 && value.is_finite()).then_some(Ritz { value, error })
            })
            .collect();
        all.sort_by(|a, b| a.value.total_cmp(&b.value));
        Some(all)
    }

    /// The Rayleigh quotients of the `count` lowest positive Ritz values, from differences along edges. Where triangles are slivers, the
    /// entries of A are so large that their rounding hides low eigenvalues; these do not see it.
    pub fn rayleigh_quotients(&self, count: usize) -> Option<Vec<f64>> {
        let m = self.steps() * B;
        let mut rows: Vec<Vec<f64>> = (0..m).map(|i| (0..m).map(|c| f64::from(u8::from(c == i))).collect()).collect();
        let inverses = tridiagonal::eigenvalues(&mut self.projection(), m, &mut rows)?;
        let mut order: Vec<(f64, usize)> =
            inverses.iter().enumerate().map(|(c, inverse)| (self.shift + 1.0 / inverse, c)).collect();
        order.retain(|o| o.0 > 0.0 && o.0.is_finite());
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let quotient = |&(_, c): &(f64, usize)| {
            let coefficients: Vec<f64> = rows.iter().map(|row| row[c]).collect();
            let mut y = vec![0.0; self.problem.n()];
            let panels = self.basis.chunks_exact(size::<B>(y.len())).map(groups::<B>);
            for (q, s) in panels.zip(coefficients.chunks_exact(B)) {
                for (y, group) in y.chunks_mut(ROWS).zip(q) {
                    for (r, y) in y.iter_mut().enumerate() {
                        *y += s.iter().zip(group).map(|(s, x)| s * x[r]).sum::<f64>();
                    }
                }
            }
            self.problem.rayleigh_quotient(&y)
        };
        Some(order.iter().take(count).map(quotient).collect())
    }
}

/// Takes the null vector out, if there is one.
fn remove_null<const B: usize>(problem: &Problem, w: &mut [Row<B>]) {
    if !problem.has_null {
        return;
    }
    vectorised(
        #[inline(always)]
        || {
            let mut along = [0.0; B];
            for (row, u) in w.iter().zip(&problem.root) {
                add_multiple(&mut along, *u, row);
            }
            for (row, u) in w.iter_mut().zip(&problem.root) {
                add_multiple(row, -u, &along);
            }
        },
    );
}

/// Replaces the vectors by an orthonormal basis, by Cholesky QR, twice; returns the triangular factor. Vectors that are nothing but
/// rounding error, against their norms `before`, become zero: zero vectors stay zero and harm nobody.
fn orthonormalise<const B: usize>(w: &mut [Group<B>], before: &[f64; B]) -> Block<B> {
    let mut product: Option<Block<B>> = None;
    for pass in 0..2 {
        let gram = gram(w);
        let floor = if pass == 0 { before.map(|x| x * EXHAUSTED) } else { [0.0; B] };
        let (upper, inverse) = cholesky(&gram, &floor);
        multiply(w, &inverse);
        product = Some(product.map_or(upper, |former| block_product(&upper, &former)));
    }
    product.unwrap_or([[0.0; B]; B])
}

/// How far Ritz value `at` may be from an eigenvalue: its residual, or the residuals squared over the distance to the other Ritz
/// values (Kato and Temple), whichever is less. Clusters are taken as a whole.
fn error_bound(values: &[f64], squares: &[f64], at: usize) -> f64 {
    let near = |i: &usize| (values[*i] - values[at]).abs() <= CLUSTER * values[at].abs();
    let low = (0..at).rev().take_while(near).last().unwrap_or(at);
    let high = (at + 1..values.len()).take_while(near).last().unwrap_or(at);
    let square: f64 = squares[low..=high].iter().sum();
    let mut gap = f64::INFINITY;
    if low > 0 {
        gap = gap.min(values[at] - values[low - 1]);
    }
    if high + 1 < values.len() {
        gap = gap.min(values[high + 1] - values[at]);
    }
    // The rounding of the solves is in the Ritz values too.
    square.sqrt().min(square / gap) + f64::EPSILON * values[at].abs()
}

fn norms<const B: usize>(gram: &Block<B>) -> [f64; B] {
    std::array::from_fn(|l| gram[l][l].max(0.0).sqrt())
}

fn block_product<const B: usize>(x: &Block<B>, y: &Block<B>) -> Block<B> {
    std::array::from_fn(|i| std::array::from_fn(|l| (0..B).map(|k| x[i][k] * y[k][l]).sum()))
}

/// Upper triangular R with R'R = gram and its inverse; columns of norm at most `floor`, or dependent on the ones before, have zeros in both.
fn cholesky<const B: usize>(gram: &Block<B>, floor: &[f64; B]) -> (Block<B>, Block<B>) {
    let (mut upper, mut inverse) = ([[0.0; B]; B], [[0.0; B]; B]);
    for j in 0..B {
        for i in 0..j {
            let known: f64 = (0..i).map(|k| upper[k][i] * upper[k][j]).sum();
            let pivot = upper[i][i];
            upper[i][j] = if pivot > 0.0 { (gram[i][j] - known) / pivot } else { 0.0 };
        }
        let square = gram[j][j] - (0..j).map(|k| upper[k][j] * upper[k][j]).sum::<f64>();
        if square > 1e-13 * gram[j][j] && square > floor[j] * floor[j] {
            upper[j][j] = square.sqrt();
            inverse[j][j] = 1.0 / upper[j][j];
            for i in 0..j {
                let sum: f64 = (i..j).map(|k| inverse[i][k] * upper[k][j]).sum();
                inverse[i][j] = -sum * inverse[j][j];
            }
        }
    }
    (upper, inverse)
}
