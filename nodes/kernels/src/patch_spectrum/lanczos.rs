//! Block Lanczos on (A - shift I)^-1, for the Neumann and the Dirichlet problem side by side in the lanes of one panel.
//!
//! Both share the factorisation, so one pass over it advances both. Bases are reorthogonalised in full; they stay in cache.

use super::factor::Packed;
use super::panel::{Block, Row, add_multiple, inner, multiply, subtract};
use super::problem::Doubled;
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

/// The run: L lanes, B to a problem; with L = B there is no Dirichlet problem.
pub(super) struct Lanczos<'a, const L: usize, const B: usize> {
    problem: &'a Doubled,
    factor: &'a Packed,
    shift: f64,
    /// Relative error of known solutions.
    solve_error: f64,
    basis: Vec<Vec<Row<L>>>,
    /// Diagonal blocks of the projections, and the triangular blocks below them.
    diagonal: Vec<Block<L, B>>,
    below: Vec<Block<L, B>>,
}

impl<'a, const L: usize, const B: usize> Lanczos<'a, L, B> {
    /// A run from random vectors; `None` if the factorisation is not accurate.
    pub fn new(problem: &'a Doubled, factor: &'a Packed, shift: f64, seed: u64) -> Option<Self> {
        let (basis, diagonal, below) = (Vec::new(), Vec::new(), Vec::new());
        let mut run = Self { problem, factor, shift, solve_error: 0.0, basis, diagonal, below };
        run.solve_error = run.known_solutions();
        if run.solve_error.is_nan() || run.solve_error > ACCURACY {
            return None;
        }
        let mut random = Random::new(&[seed]);
        let mut start: Vec<Row<L>> = problem.root.iter().map(|_| std::array::from_fn(|_| random.signed())).collect();
        for row in &mut start[problem.interior..] {
            row[Self::inner_lanes()].fill(0.0);
        }
        run.remove_null(&mut start);
        let scale = norms::<L, B>(&inner::<L, B>(&start, &start));
        Self::orthonormalise(&mut start, &scale);
        run.basis.push(start);
        Some(run)
    }

    fn inner_lanes() -> std::ops::Range<usize> {
        B..L
    }

    /// Panels so far.
    pub fn steps(&self) -> usize {
        self.diagonal.len()
    }

    /// What rounding may do to an eigenvalue, relative to it.
    pub fn rounding(&self, value: f64) -> f64 {
        self.solve_error * (value - self.shift).abs() / value
    }

    /// How well the factorisation returns two known solutions, relative to them: the null vector, and its leading part.
    fn known_solutions(&self) -> f64 {
        let (root, interior) = (&self.problem.root, self.problem.interior);
        let pull = self.problem.boundary_pull();
        let mut x: Vec<Row<L>> = root.iter().map(|u| [-self.shift * u; L]).collect();
        for (row, pull) in x.iter_mut().zip(&pull) {
            for lane in &mut row[Self::inner_lanes()] {
                *lane += pull;
            }
        }
        self.factor.solve(&mut x, Self::inner_lanes());
        let mut errors = [0.0; L];
        let mut sizes = [0.0; L];
        for (i, (row, u)) in x.iter().zip(root).enumerate() {
            for l in 0..L {
                let known = if l < B || i < interior { *u } else { 0.0 };
                errors[l] += (row[l] - known) * (row[l] - known);
                sizes[l] += known * known;
            }
        }
        let relative = |l: usize| if sizes[l] > 0.0 { (errors[l] / sizes[l]).sqrt() } else { 0.0 };
        (0..L).map(relative).fold(0.0, |m, x| if x > m || x.is_nan() { x } else { m })
    }

    /// Takes the constants out of the Neumann lanes.
    fn remove_null(&self, w: &mut [Row<L>]) {
        vectorised(
            #[inline(always)]
            || {
                let mut along = [0.0; L];
                for (row, u) in w.iter().zip(&self.problem.root) {
                    add_multiple(&mut along, *u, row);
                }
                let mut negated = along.map(|x| -x);
                negated[Self::inner_lanes()].fill(0.0);
                for (row, u) in w.iter_mut().zip(&self.problem.root) {
                    add_multiple(row, *u, &negated);
                }
            },
        );
    }

    /// One more panel.
    pub fn step(&mut self) {
        let j = self.diagonal.len();
        let mut w = self.basis[j].clone();
        self.factor.solve(&mut w, Self::inner_lanes());
        self.remove_null(&mut w);
        let before = norms::<L, B>(&inner::<L, B>(&w, &w));
        // Against all: the recurrence alone, against the last two, loses orthogonality as soon as a value converges.
        let mut along = [[0.0; L]; B];
        let mut passes = 0;
        loop {
            let coefficients: Vec<Block<L, B>> = self.basis.iter().map(|q| inner::<L, B>(q, &w)).collect();
            for (q, c) in self.basis.iter().zip(&coefficients) {
                subtract::<L, B>(&mut w, q, c);
            }
            for i in 0..B {
                for l in 0..L {
                    along[i][l] += coefficients[j][i][l];
                }
            }
            passes += 1;
            let after = norms::<L, B>(&inner::<L, B>(&w, &w));
            if passes == 2 || (0..L).all(|l| after[l] >= SHRUNK * before[l]) {
                break;
            }
        }
        self.diagonal.push(along);
        self.below.push(Self::orthonormalise(&mut w, &before));
        self.basis.push(w);
    }

    /// Replaces each problem's vectors by an orthonormal basis, by Cholesky QR, twice; returns the triangular factor. Vectors that
    /// are nothing but rounding error, against their norms `before`, become zero: zero vectors stay zero and harm nobody.
    fn orthonormalise(w: &mut [Row<L>], before: &[f64; L]) -> Block<L, B> {
        let mut product: Option<Block<L, B>> = None;
        for pass in 0..2 {
            let gram = inner::<L, B>(w, w);
            let floor = if pass == 0 { before.map(|x| x * EXHAUSTED) } else { [0.0; L] };
            let (upper, inverse) = cholesky::<L, B>(&gram, &floor);
            multiply::<L, B>(w, &inverse);
            product = Some(product.map_or(upper, |former| block_product::<L, B>(&upper, &former)));
        }
        product.unwrap_or([[0.0; L]; B])
    }

    /// The operator on a problem's basis, a band matrix in full.
    fn projection(&self, which: usize) -> Vec<f64> {
        let (steps, m, lane) = (self.steps(), self.steps() * B, which * B);
        let mut t = vec![0.0; m * m];
        for j in 0..steps {
            for i in 0..B {
                for k in 0..B {
                    let symmetric = 0.5 * (self.diagonal[j][i][lane + k] + self.diagonal[j][k][lane + i]);
                    t[(j * B + i) * m + j * B + k] = symmetric;
                    if j + 1 < steps {
                        let value = self.below[j][i][lane + k];
                        t[((j + 1) * B + i) * m + j * B + k] = value;
                        t[(j * B + k) * m + (j + 1) * B + i] = value;
                    }
                }
            }
        }
        t
    }

    /// The Ritz values of a problem (0: Neumann, 1: Dirichlet), ascending; only positive ones. `None` if the small problem fails.
    pub fn ritz(&self, which: usize) -> Option<Vec<Ritz>> {
        let (steps, m, lane) = (self.steps(), self.steps() * B, which * B);
        let mut t = self.projection(which);
        let mut tails: Vec<Vec<f64>> =
            (0..B).map(|i| (0..m).map(|c| f64::from(u8::from(c == m - B + i))).collect()).collect();
        let inverses = tridiagonal::eigenvalues(&mut t, m, &mut tails)?;
        let last = &self.below[steps - 1];
        let residual = |c: usize| {
            let component = |i: usize| (0..B).map(|k| last[i][lane + k] * tails[k][c]).sum::<f64>();
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
}

impl<const L: usize, const B: usize> Lanczos<'_, L, B> {
    /// The Rayleigh quotients of a problem's `count` lowest positive Ritz values, from differences along edges. Where triangles are
    /// slivers, the entries of A are so large that their rounding hides low eigenvalues; these do not see it.
    pub fn rayleigh_quotients(&self, which: usize, count: usize) -> Option<Vec<f64>> {
        let m = self.steps() * B;
        let mut rows: Vec<Vec<f64>> = (0..m).map(|i| (0..m).map(|c| f64::from(u8::from(c == i))).collect()).collect();
        let inverses = tridiagonal::eigenvalues(&mut self.projection(which), m, &mut rows)?;
        let mut order: Vec<(f64, usize)> =
            inverses.iter().enumerate().map(|(c, inverse)| (self.shift + 1.0 / inverse, c)).collect();
        order.retain(|o| o.0 > 0.0 && o.0.is_finite());
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let quotient = |&(_, c): &(f64, usize)| {
            let coefficients: Vec<f64> = rows.iter().map(|row| row[c]).collect();
            let mut y = vec![0.0; self.problem.n()];
            for (q, s) in self.basis.iter().zip(coefficients.chunks_exact(B)) {
                for (y, row) in y.iter_mut().zip(q) {
                    *y += s.iter().zip(&row[which * B..]).map(|(s, x)| s * x).sum::<f64>();
                }
            }
            self.problem.rayleigh_quotient(&y)
        };
        Some(order.iter().take(count).map(quotient).collect())
    }
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

fn norms<const L: usize, const B: usize>(gram: &Block<L, B>) -> [f64; L] {
    std::array::from_fn(|l| gram[l % B][l].max(0.0).sqrt())
}

fn block_product<const L: usize, const B: usize>(x: &Block<L, B>, y: &Block<L, B>) -> Block<L, B> {
    std::array::from_fn(|i| std::array::from_fn(|l| (0..B).map(|k| x[i][l / B * B + k] * y[k][l]).sum()))
}

/// Upper triangular R with R'R = gram and its inverse, within each problem; columns of norm at most `floor`, or dependent on
/// the ones before, have zeros in both.
fn cholesky<const L: usize, const B: usize>(gram: &Block<L, B>, floor: &[f64; L]) -> (Block<L, B>, Block<L, B>) {
    let (mut upper, mut inverse) = ([[0.0; L]; B], [[0.0; L]; B]);
    for base in (0..L).step_by(B) {
        for j in 0..B {
            let lane = base + j;
            for i in 0..j {
                let known: f64 = (0..i).map(|k| upper[k][base + i] * upper[k][lane]).sum();
                let pivot = upper[i][base + i];
                upper[i][lane] = if pivot > 0.0 { (gram[i][lane] - known) / pivot } else { 0.0 };
            }
            let square = gram[j][lane] - (0..j).map(|k| upper[k][lane] * upper[k][lane]).sum::<f64>();
            if square > 1e-13 * gram[j][lane] && square > floor[lane] * floor[lane] {
                upper[j][lane] = square.sqrt();
                inverse[j][lane] = 1.0 / upper[j][lane];
                for i in 0..j {
                    let sum: f64 = (i..j).map(|k| inverse[i][base + k] * upper[k][lane]).sum();
                    inverse[i][lane] = -sum * inverse[j][lane];
                }
            }
        }
    }
    (upper, inverse)
}
