//! How good approximate eigenpairs are.
//!
//! Rows of A sum to almost nothing, so products with it are taken from differences of neighbouring values: smooth vectors lose no digits.

use super::panel::{Row, WIDTH};
use super::problem::Problem;
use super::tiles::{parts, registers};
use crate::simd::vectorised;
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// A residual this many times what rounding the entries of M may cause is as small as it can be.
const ROUNDING: f64 = 16.0;

/// A squared residual this much smaller than the one it was computed from is computed again.
const CANCELLED: f64 = 1e-6;

/// Eigenvalues and residuals of the vectors of a panel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quality {
    /// Rayleigh quotients.
    pub values: Row,
    /// Norms of A y - lambda y over that of y.
    pub residuals: Row,
    /// What rounding alone may make them; zero where they are within the tolerance.
    pub rounding: Row,
}

impl Quality {
    /// Whether vector q is a positive pair's to this relative tolerance, or as far as rounding allows.
    pub fn is_fine(&self, q: usize, tolerance: f64) -> bool {
        let (value, residual) = (self.values[q], self.residuals[q]);
        value > 0.0 && residual <= (tolerance * value).max(ROUNDING * self.rounding[q]) && residual.is_finite()
    }
}

/// What is to be done for some rows while others are examined.
pub(super) type Aside<'a> = &'a mut dyn FnMut(Range<usize>);

/// So many rows at once.
const ROWS: usize = 64;

impl Problem<'_> {
    /// The quality of eight approximate eigenvectors v = R^-1 y, of about unit norm in y, whose eigenvalues are about the guesses. Guesses that are far off cost
    /// a second pass, not accuracy.
    pub(super) fn examine(&self, v: &[Row], guesses: &Row, tolerance: f64) -> Quality {
        self.examine_and(v, guesses, tolerance, &mut |_| ())
    }

    /// The same, and something else for every few rows: memory then works while numbers are added, and the other way round.
    pub(super) fn examine_and(&self, v: &[Row], guesses: &Row, tolerance: f64, aside: Aside<'_>) -> Quality {
        let sums = self.sums(v, guesses, aside);
        let values: Row = std::array::from_fn(|q| 0.5 * sums.edges[q] / sums.norm[q]);
        let mut squares = sums.squared_residuals(guesses, &values);
        if (0..WIDTH).any(|q| squares[q] < CANCELLED * sums.residual[q]) {
            squares = self.sums(v, &values, &mut |_| ()).residual;
        }
        let residuals = std::array::from_fn(|q| (squares[q] / sums.norm[q]).sqrt());
        let large = (0..WIDTH).any(|q| residuals[q] > tolerance * values[q]);
        let rounding = if large { self.rounding(v) } else { [0.0; WIDTH] };
        Quality { values, residuals, rounding }
    }

    fn sums(&self, v: &[Row], guesses: &Row, aside: Aside<'_>) -> Sums {
        Arch::new().dispatch(Pass { problem: self, v, guesses, aside })
    }

    /// A y - lambda y for eight approximate eigenvectors v = R^-1 y, at the vertices in this order.
    pub(super) fn residual_rows(&self, lambda: &Row, v: &[Row], order: &[u32]) -> Vec<Row> {
        vectorised(
            #[inline(always)]
            || order.iter().map(|&vertex| self.residual(lambda, v, vertex as usize)).collect(),
        )
    }

    #[inline(always)]
    fn residual(&self, lambda: &Row, v: &[Row], i: usize) -> Row {
        let mut product = [0.0; WIDTH];
        for (j, m) in self.stiffness.row(i) {
            for q in 0..WIDTH {
                product[q] = (-m).mul_add(v[i][q] - v[j][q], product[q]);
            }
        }
        let r = self.root[i];
        std::array::from_fn(|q| (product[q] - lambda[q] * r * r * v[i][q]) / r)
    }

    /// What rounding the entries of M and the products with them may make the norms of residuals: norms of |A| |y|.
    fn rounding(&self, v: &[Row]) -> Row {
        let mut squares = [0.0; WIDTH];
        vectorised(
            #[inline(always)]
            || {
                for (i, r) in self.root.iter().enumerate() {
                    let mut magnitude = [0.0; WIDTH];
                    for (j, m) in self.stiffness.row(i) {
                        for q in 0..WIDTH {
                            magnitude[q] += (m * v[j][q]).abs();
                        }
                    }
                    for q in 0..WIDTH {
                        squares[q] += (magnitude[q] / r) * (magnitude[q] / r);
                    }
                }
            },
        );
        squares.map(|x| f64::EPSILON * x.sqrt())
    }
}

/// What one pass over the matrix sums up, with r = A y - mu y for the guess mu.
#[derive(Default, PartialEq)]
struct Sums {
    /// y' y.
    norm: Row,
    /// 2 y' A y: every edge counts from both its ends.
    edges: Row,
    /// y' r.
    along: Row,
    /// r' r.
    residual: Row,
}

impl Sums {
    /// Of A y - lambda y.
    fn squared_residuals(&self, guesses: &Row, values: &Row) -> Row {
        std::array::from_fn(|q| {
            let off = values[q] - guesses[q];
            (self.residual[q] - 2.0 * off * self.along[q] + off * off * self.norm[q]).max(0.0)
        })
    }
}

struct Pass<'a> {
    problem: &'a Problem<'a>,
    v: &'a [Row],
    guesses: &'a Row,
    aside: Aside<'a>,
}

impl WithSimd for Pass<'_> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> Sums {
        let mut sums = Sums::default();
        for part in 0..parts::<S>() {
            let lanes = part * S::F64_LANES..(part + 1) * S::F64_LANES;
            let found = self.part(simd, part);
            let targets = [&mut sums.norm, &mut sums.edges, &mut sums.along, &mut sums.residual];
            for (target, sum) in targets.into_iter().zip(found) {
                simd.partial_store_f64s(&mut target[lanes.clone()], sum);
            }
        }
        sums
    }
}

impl Pass<'_> {
    /// The sums of some lanes, in the order of the fields.
    #[inline(always)]
    fn part<S: Simd>(&mut self, simd: S, part: usize) -> [S::f64s; 4] {
        let (parts, matrix, zero) = (parts::<S>(), self.problem.stiffness, simd.splat_f64s(0.0));
        let v = registers::<S>(self.v);
        let guess = registers::<S>(std::slice::from_ref(self.guesses))[part];
        let mut sums = [zero; 4];
        for (i, (range, &root)) in matrix.offsets().windows(2).zip(&self.problem.root).enumerate() {
            if part == 0 && i % ROWS == 0 {
                (self.aside)(i..self.v.len().min(i + ROWS));
            }
            let x = v[i * parts + part];
            let (mut product, mut edges) = (zero, zero);
            let range = range[0]..range[1];
            for (&j, &m) in matrix.columns()[range.clone()].iter().zip(&matrix.values()[range]) {
                let difference = simd.sub_f64s(v[j as usize * parts + part], x);
                let pull = simd.mul_f64s(simd.splat_f64s(m), difference);
                product = simd.add_f64s(product, pull);
                edges = simd.negate_mul_add_f64s(pull, difference, edges);
            }
            let y = simd.mul_f64s(simd.splat_f64s(root), x);
            let r = simd.mul_f64s(simd.splat_f64s(1.0 / root), product);
            let r = simd.negate_mul_add_f64s(guess, y, r);
            let square = simd.mul_f64s(y, y);
            sums[0] = simd.add_f64s(sums[0], square);
            sums[1] = simd.add_f64s(sums[1], edges);
            sums[2] = simd.mul_add_f64s(y, r, sums[2]);
            sums[3] = simd.mul_add_f64s(r, r, sums[3]);
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laplacian::Operator;
    use crate::random::Random;
    use crate::sparse::SymmetricCsr;

    const N: u32 = 400;

    /// A ring with chords of uneven weights.
    fn ring() -> Operator {
        let mut random = Random::from_state(2);
        let ends: Vec<(u32, u32)> = (0..N).flat_map(|i| [(i, (i + 1) % N), (i, (i + 7) % N)]).collect();
        let weights: Vec<f64> = ends.iter().map(|_| 0.1 + random.unit()).collect();
        let mass = (0..N).map(|_| 0.5 + random.unit()).collect();
        Operator { stiffness: SymmetricCsr::graph_laplacian(N as usize, ends.into_iter(), &weights), mass }
    }

    /// Eight eigenvectors v = R^-1 y with noise of so much, and their eigenvalues.
    fn noisy(problem: &Problem<'_>, noise: f64) -> (Vec<Row>, Row) {
        let a = crate::eigen::dense::lifted(problem);
        let (values, vectors) = crate::eigen::dense::symmetric_eigen(a.as_ref()).expect("small");
        let mut random = Random::from_state(4);
        let mut entry = |i: usize, q: usize| (vectors[(i, q)] + noise * random.signed()) / problem.root[i];
        let v = (0..N as usize).map(|i| std::array::from_fn(|q| entry(i, q))).collect();
        (v, std::array::from_fn(|q| values[q]))
    }

    #[test]
    fn guesses_that_are_off_change_neither_values_nor_residuals() {
        let operator = ring();
        let problem = Problem::of(&operator);
        let order: Vec<u32> = (0..N).collect();
        for noise in [1e-2, 1e-6, 1e-10, 0.0] {
            let (v, exact) = noisy(&problem, noise);
            for factor in [1.0, 1.0 + 1e-9, 1.001, 0.5, 30.0, 0.0] {
                let quality = problem.examine(&v, &exact.map(|x| x * factor), 1e-8);
                let rows = problem.residual_rows(&quality.values, &v, &order);
                for q in 0..WIDTH {
                    // Plain sums: Rayleigh quotients of M and the mass, then the norm of what is left.
                    let square: f64 = (0..v.len()).map(|i| (problem.root[i] * v[i][q]).powi(2)).sum();
                    let row = |i: usize| operator.stiffness.row(i).map(|(j, m)| m * v[j][q]).sum::<f64>();
                    let value = (0..v.len()).map(|i| v[i][q] * row(i)).sum::<f64>() / square;
                    let residual = (rows.iter().map(|row| row[q] * row[q]).sum::<f64>() / square).sqrt();
                    assert!((quality.values[q] - value).abs() < 1e-12 * value, "{noise} {factor} {q}");
                    let difference = (quality.residuals[q] - residual).abs();
                    assert!(difference < 1e-6 * residual + 1e-13 * value, "{noise} {factor} {q}: {difference:e}");
                    assert!(quality.is_fine(q, 1e-8) == (residual <= 1e-8 * value || noise == 0.0));
                }
            }
        }
    }

    #[test]
    fn rounding_is_known_where_residuals_are_large() {
        let operator = ring();
        let problem = Problem::of(&operator);
        let (v, exact) = noisy(&problem, 0.0);
        let small = problem.examine(&v, &exact, 1e-8);
        assert!(small.rounding.iter().all(|x| x.abs() < f64::MIN_POSITIVE));
        let strict = problem.examine(&v, &exact, 1e-300);
        for q in 0..WIDTH {
            let magnitude =
                |i: usize| operator.stiffness.row(i).map(|(j, m)| (m * v[j][q]).abs()).sum::<f64>() / problem.root[i];
            let norm = (0..v.len()).map(|i| magnitude(i).powi(2)).sum::<f64>().sqrt();
            assert!((strict.rounding[q] / (f64::EPSILON * norm) - 1.0).abs() < 1e-12);
            assert!(strict.is_fine(q, 1e-300));
        }
    }

    #[test]
    fn the_width_of_registers_changes_no_bit() {
        fn sums<S: Simd>(simd: S, problem: &Problem<'_>, v: &[Row], guesses: &Row) -> Sums {
            let mut next = 0;
            let aside: Aside<'_> = &mut |rows| {
                assert_eq!(rows.start, next);
                next = rows.end;
            };
            let sums = Pass { problem, v, guesses, aside }.with_simd(simd);
            assert_eq!(next, v.len());
            sums
        }
        let operator = ring();
        let problem = Problem::of(&operator);
        let (v, guesses) = noisy(&problem, 1e-6);
        let native = problem.sums(&v, &guesses, &mut |_| ());
        assert!(sums(pulp::Scalar, &problem, &v, &guesses) == native);
        assert!(sums(pulp::Scalar256b, &problem, &v, &guesses) == native);
    }
}
