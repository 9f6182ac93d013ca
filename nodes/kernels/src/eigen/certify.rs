//! Whether pairs may be returned: residuals, orthogonality, and the sort that their final values give.

use super::basis::Null;
use super::gauge::fix_sign;
use super::lanczos::Pair;
use super::panel::{Simd, WIDTH};
use super::problem::Problem;
use super::{EigenError, Hooks};
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::{Accum, Mat, MatRef, Par};
use std::sync::{Mutex, PoisonError};

/// A residual this many times what rounding the entries of M may cause is as small as it can be.
const ROUNDING: f64 = 16.0;

/// Inner products above this are removed: neighbours found by different slices, each accurate, are that nearly orthogonal only.
const REMOVED: f64 = 1e-12;

/// Vertices per block of a Gram matrix, and parts that may be summed on different threads.
const GRAM_ROWS: usize = 512;
const GRAM_PARTS: usize = 8;

/// Columns in elimination order with the order itself.
pub(super) struct Columns<'a> {
    pub problem: &'a Problem<'a>,
    pub null: &'a Null,
    pub order: &'a [u32],
    pub hooks: &'a dyn Hooks,
}

/// What examining all pairs found.
pub(super) struct Findings {
    /// The largest residual of the first `wanted` pairs relative to their values.
    pub residual: f64,
    /// Whether those of all pairs are within bounds.
    pub fine: bool,
}

impl Columns<'_> {
    /// Replaces values by Rayleigh quotients and sorts by them.
    pub fn examine(&self, pairs: &mut Vec<Pair>, wanted: usize, tolerance: f64) -> Findings {
        let groups: Vec<&[Pair]> = pairs.chunks(WIDTH).collect();
        let results = self.map(groups.len(), &|g| {
            let quality = self.problem.examine(Simd::new(), &self.vertex_panel(groups[g]));
            (0..groups[g].len())
                .map(|q| (quality.values[q], quality.residuals[q], quality.rounding[q]))
                .collect::<Vec<_>>()
        });
        let quality: Vec<(f64, f64, f64)> = results.into_iter().flatten().collect();
        for (pair, q) in pairs.iter_mut().zip(&quality) {
            pair.value = q.0;
        }
        let mut order: Vec<usize> = (0..pairs.len()).collect();
        order.sort_by(|&a, &b| quality[a].0.total_cmp(&quality[b].0).then(a.cmp(&b)));
        let mut slots: Vec<Option<Pair>> = std::mem::take(pairs).into_iter().map(Some).collect();
        pairs.extend(order.iter().filter_map(|&i| slots[i].take()));
        let mut findings = Findings { residual: 0.0, fine: true };
        for (position, &i) in order.iter().enumerate() {
            let (value, norm, rounding) = quality[i];
            findings.fine &= value > 0.0 && norm <= (tolerance * value).max(ROUNDING * rounding) && norm.is_finite();
            if position < wanted {
                findings.residual = findings.residual.max(norm / value);
            }
        }
        findings
    }

    /// v = R^-1 y for up to eight columns, by vertex.
    fn vertex_panel(&self, group: &[Pair]) -> Vec<[f64; WIDTH]> {
        let mut panel = vec![[0.0; WIDTH]; self.order.len()];
        for (i, &vertex) in self.order.iter().enumerate() {
            let row = &mut panel[vertex as usize];
            let root = self.problem.root[vertex as usize];
            for (x, pair) in row.iter_mut().zip(group) {
                *x = pair.column[i] / root;
            }
        }
        panel
    }

    /// The largest entry of |Y' Y - I|, the null space included, after removing what neighbouring slices left.
    pub fn orthogonalise(&self, pairs: &mut [Pair]) -> f64 {
        let mut worst = f64::INFINITY;
        for _ in 0..3 {
            let gram = self.gram(pairs);
            worst = self.null_products(pairs);
            let mut changed = false;
            for j in 0..pairs.len() {
                let norm = gram[(j, j)];
                worst = worst.max((norm - 1.0).abs());
                for i in j + 1..pairs.len() {
                    let product = gram[(i, j)];
                    worst = worst.max(product.abs());
                    if product.abs() > REMOVED {
                        symmetric_step(pairs, i, j, 0.5 * product);
                        changed = true;
                    }
                }
                if (norm - 1.0).abs() > REMOVED {
                    let scale = 1.0 / norm.sqrt();
                    pairs[j].column.iter_mut().for_each(|x| *x *= scale);
                    changed = true;
                }
            }
            if !changed {
                break;
            }
        }
        worst
    }

    /// Y' Y, its lower triangle.
    fn gram(&self, pairs: &[Pair]) -> Mat<f64> {
        let (n, k) = (self.order.len(), pairs.len());
        let part = n.div_ceil(GRAM_PARTS).next_multiple_of(GRAM_ROWS);
        let parts = self.map(n.div_ceil(part), &|p| {
            let mut sum = Mat::<f64>::zeros(k, k);
            let mut block = vec![0.0; GRAM_ROWS * k];
            for begin in (p * part..n.min((p + 1) * part)).step_by(GRAM_ROWS) {
                let rows = GRAM_ROWS.min(n - begin);
                for (target, pair) in block.chunks_exact_mut(rows).zip(pairs) {
                    target.copy_from_slice(&pair.column[begin..begin + rows]);
                }
                let y = MatRef::from_column_major_slice(&block[..rows * k], rows, k);
                let (lower, whole) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
                matmul(sum.as_mut(), lower, Accum::Add, y.transpose(), whole, y, whole, 1.0, Par::Seq);
            }
            sum
        });
        parts.into_iter().reduce(|a, b| a + b).unwrap_or_else(|| Mat::zeros(k, k))
    }

    /// The largest product of a column with a null vector.
    fn null_products(&self, pairs: &[Pair]) -> f64 {
        let products = self.map(pairs.len(), &|j| {
            let mut sums = vec![0.0; self.null.count];
            for ((&label, unit), x) in self.null.labels.iter().zip(&self.null.units).zip(&pairs[j].column) {
                sums[label as usize] += unit * x;
            }
            sums.iter().fold(0.0f64, |m, x| m.max(x.abs()))
        });
        products.into_iter().fold(0.0, f64::max)
    }

    /// The largest residual of the null vectors over the first positive eigenvalue: rounding of the row sums.
    pub fn null_residual(&self, first: Option<f64>) -> f64 {
        let Some(first) = first else { return 0.0 };
        let mut squares = vec![0.0f64; self.null.count];
        for i in 0..self.problem.n() {
            if let Some((label, unit)) = self.problem.null_entry(i) {
                let residual = self.problem.stiffness.row_sum(i) * unit / self.problem.root[i].powi(2);
                squares[label] += residual * residual;
            }
        }
        squares.iter().fold(0.0f64, |worst, s| worst.max(s.sqrt())) / first
    }

    /// Eigenvectors by vertex in the caller's units with their signs, column after column into `target`. The pairs are used up on the way: not
    /// all vectors are in memory twice.
    pub fn write(&self, pairs: Vec<Pair>, target: &mut [f64]) {
        let n = self.order.len();
        let scale = 1.0 / self.problem.area.sqrt();
        let slots: Vec<Mutex<Option<(Pair, &mut [f64])>>> =
            pairs.into_iter().zip(target.chunks_exact_mut(n)).map(|slot| Mutex::new(Some(slot))).collect();
        self.hooks.each(slots.len(), &|j| {
            let slot = slots[j].lock().unwrap_or_else(PoisonError::into_inner).take();
            if let Some((pair, target)) = slot {
                for (x, &vertex) in pair.column.iter().zip(self.order) {
                    // + 0.0: no negative zeros in an artefact
                    target[vertex as usize] = x / self.problem.root[vertex as usize] * scale + 0.0;
                }
                fix_sign(target, self.problem.mass);
            }
        });
    }

    fn map<T: Send>(&self, count: usize, task: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
        let slots: Vec<Mutex<Option<T>>> = (0..count).map(|_| Mutex::new(None)).collect();
        self.hooks.each(count, &|i| {
            let result = task(i);
            *slots[i].lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
        });
        slots.into_iter().filter_map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
    }
}

/// Takes half of the product from each, which keeps both as near as can be to what they were (Löwdin 1950, to first order).
fn symmetric_step(pairs: &mut [Pair], i: usize, j: usize, half: f64) {
    let (head, tail) = pairs.split_at_mut(i);
    for (x, y) in tail[0].column.iter_mut().zip(&mut head[j].column) {
        (*x, *y) = (*x - half * *y, *y - half * *x);
    }
}

/// An uncertified result of which nothing more is known.
pub(super) const UNCERTIFIED: EigenError = EigenError::NotCertified { expected: 0, found: 0, residual: f64::NAN };
