//! Whether pairs may be returned: residuals, orthogonality, and the sort that their final values give.

use super::basis::Null;
use super::gauge::fix_sign;
use super::packed::Packed;
use super::panel::WIDTH;
use super::problem::Problem;
use super::vectors::{Vectors, null_product};
use super::{EigenError, Hooks, Phase, enter};
use faer::Mat;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Inner products above this are removed: neighbours found by different slices, each accurate, are that nearly orthogonal only.
const REMOVED: f64 = 1e-11;

/// Parts of a Gram matrix that may be summed on different threads.
const GRAM_PARTS: usize = 4;

/// What certifying needs beside the vectors.
pub(super) struct Columns<'a> {
    pub problem: &'a Problem<'a>,
    pub null: &'a Null,
    pub order: &'a [u32],
    pub hooks: &'a dyn Hooks,
}

/// What examining all pairs found.
pub(super) struct Findings {
    /// Rayleigh quotients, ascending.
    pub values: Vec<f64>,
    /// The largest residual of the first `wanted` pairs relative to their values.
    pub residual: f64,
    /// Whether those of all pairs are within bounds.
    pub fine: bool,
}

impl Columns<'_> {
    /// Computes Rayleigh quotients and residuals, and sorts by the former.
    pub fn examine(&self, vectors: &mut Vectors<'_>, wanted: usize, tolerance: f64) -> Result<Findings, EigenError> {
        let scale = self.inverse_root();
        let results = self.map(vectors.len().div_ceil(WIDTH), &|g| {
            self.problem.examine(&vectors.panel(g * WIDTH, self.order, &scale))
        })?;
        let quality = |j: usize| {
            let (group, q) = (&results[j / WIDTH], j % WIDTH);
            (group.values[q], group.residuals[q], group.is_fine(q, tolerance))
        };
        let mut order: Vec<usize> = (0..vectors.len()).collect();
        order.sort_by(|&a, &b| quality(a).0.total_cmp(&quality(b).0).then(a.cmp(&b)));
        vectors.select(&order);
        let mut findings = Findings { values: Vec::with_capacity(order.len()), residual: 0.0, fine: true };
        for (position, &j) in order.iter().enumerate() {
            let (value, norm, fine) = quality(j);
            findings.values.push(value);
            findings.fine &= fine;
            if position < wanted {
                findings.residual = findings.residual.max(norm / value);
            }
        }
        Ok(findings)
    }

    fn inverse_root(&self) -> Vec<f64> {
        self.problem.root.iter().map(|r| 1.0 / r).collect()
    }

    /// One step of correction, y - F^-1 (A y - lambda y), for the lowest vectors, eight at a time, until the next eight need none: bounds are relative to the
    /// values, rounding errors of an indefinite factorisation are not. The factor, of A plus some multiple of I, grows none; what is high above a
    /// pair vanishes under it, and most of the errors are.
    pub fn polish(
        &self,
        vectors: &mut Vectors<'_>,
        tolerance: f64,
        factor: impl Fn() -> Result<Packed, EigenError>,
    ) -> Result<(), EigenError> {
        let scale = self.inverse_root();
        let mut at_hand = None;
        for begin in (0..vectors.len()).step_by(WIDTH) {
            let panel = vectors.panel(begin, self.order, &scale);
            let quality = self.problem.examine(&panel);
            if (0..WIDTH).all(|q| quality.is_fine(q, tolerance)) {
                break;
            }
            let factor = match &mut at_hand {
                Some(factor) => factor,
                none => none.insert(factor()?),
            };
            enter(self.hooks, Phase::Certify)?;
            let mut correction = self.problem.residual_rows(&quality.values, &panel, self.order);
            factor.solve(&mut correction);
            vectors.subtract(begin, &correction);
        }
        Ok(())
    }

    /// The largest entry of |Y' Y - I|, the null space included, after removing what neighbouring slices left.
    pub fn orthogonalise(&self, vectors: &mut Vectors<'_>) -> Result<f64, EigenError> {
        let panels = vectors.panels();
        let null = self.map(panels.len(), &|p| null_product(panels[p], self.null))?;
        let null = null.into_iter().fold(0.0, f64::max);
        let mut worst = f64::INFINITY;
        for _ in 0..3 {
            let gram = self.gram(vectors)?;
            worst = null;
            let mut steps = Vec::new();
            for j in 0..vectors.len() {
                worst = worst.max((gram[(j, j)] - 1.0).abs());
                for i in j + 1..vectors.len() {
                    worst = worst.max(gram[(i, j)].abs());
                    // Residuals are relative to the values, so the lower vector is the more accurate of the two, and all of the
                    // product is removed from the higher one.
                    if gram[(i, j)].abs() > REMOVED {
                        steps.push((i, j, gram[(i, j)]));
                    }
                }
            }
            if steps.is_empty() {
                break;
            }
            vectors.subtract_multiples(&steps);
        }
        Ok(worst)
    }

    /// Y' Y, its lower triangle.
    fn gram(&self, vectors: &Vectors<'_>) -> Result<Mat<f64>, EigenError> {
        let k = vectors.len();
        let share = vectors.runs().div_ceil(GRAM_PARTS).max(1);
        let parts = self.map(vectors.runs().div_ceil(share), &|p| {
            let mut sum = Mat::<f64>::zeros(k, k);
            vectors.add_gram(p * share..vectors.runs().min((p + 1) * share), &mut sum);
            sum
        })?;
        Ok(parts.into_iter().reduce(|a, b| a + b).unwrap_or_else(|| Mat::zeros(k, k)))
    }

    /// The largest residual of the null vectors over the first positive eigenvalue: rounding of the row sums.
    pub fn null_residual(&self, first: Option<f64>) -> f64 {
        let Some(first) = first else { return 0.0 };
        let mut squares = vec![0.0f64; self.null.count];
        for i in 0..self.problem.n() {
            let (label, unit) = self.problem.null_entry(i);
            let residual = self.problem.stiffness.row_sum(i) * unit / self.problem.root[i].powi(2);
            squares[label] += residual * residual;
        }
        squares.iter().fold(0.0f64, |worst, s| worst.max(s.sqrt())) / first
    }

    /// The first eigenvectors by vertex in the caller's units with their signs, column after column, as many as `target` has room for.
    pub fn write(&self, vectors: &Vectors<'_>, target: &mut [f64]) -> Result<(), EigenError> {
        let n = self.order.len();
        let unit = self.problem.area.sqrt();
        let scale: Vec<f64> = self.problem.root.iter().map(|r| 1.0 / (r * unit)).collect();
        let slots: Vec<Mutex<&mut [f64]>> = target.chunks_mut(WIDTH * n).map(Mutex::new).collect();
        each(self.hooks, slots.len(), &|g| {
            let panel = vectors.panel(g * WIDTH, self.order, &scale);
            let mut target = slots[g].lock().unwrap_or_else(PoisonError::into_inner);
            for (q, column) in target.chunks_exact_mut(n).enumerate() {
                for (x, row) in column.iter_mut().zip(&panel) {
                    *x = row[q] + 0.0; // no negative zeros in an artefact
                }
                fix_sign(column, self.problem.mass);
            }
        })
    }

    fn map<T: Send>(&self, count: usize, task: &(dyn Fn(usize) -> T + Sync)) -> Result<Vec<T>, EigenError> {
        collect(self.hooks, count, task)
    }
}

/// All tasks, on the threads that the hooks lend; cancelled if one was left out.
pub(super) fn each(hooks: &dyn Hooks, count: usize, task: &(dyn Fn(usize) + Sync)) -> Result<(), EigenError> {
    let done = AtomicUsize::new(0);
    hooks.each(count, &|i| {
        task(i);
        done.fetch_add(1, Ordering::Relaxed);
    });
    if done.into_inner() == count { Ok(()) } else { Err(EigenError::Cancelled) }
}

/// The results of all tasks, in order.
pub(super) fn collect<T: Send>(
    hooks: &dyn Hooks,
    count: usize,
    task: &(dyn Fn(usize) -> T + Sync),
) -> Result<Vec<T>, EigenError> {
    let slots: Vec<Mutex<Option<T>>> = (0..count).map(|_| Mutex::new(None)).collect();
    each(hooks, count, &|i| {
        let result = task(i);
        *slots[i].lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
    })?;
    Ok(slots.into_iter().filter_map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner)).collect())
}

/// An uncertified result of which nothing more is known.
pub(super) const UNCERTIFIED: EigenError = EigenError::NotCertified { expected: 0, found: 0, residual: f64::NAN };

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eigen::factor::Factorizer;
    use crate::eigen::pool::Pool;
    use crate::eigen::{Options, eigenpairs};
    use crate::laplacian::{Area, laplacian};
    use crate::random::Random;

    /// A rectangle of 40 x 30 squares, each cut in two.
    fn rectangle() -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let vertex = |i: u32, j: u32| i * 31 + j;
        let points = (0..=40).flat_map(|i| (0..=30).map(move |j| [0.1 * f64::from(i), 0.1 * f64::from(j), 0.0]));
        let squares = (0..40).flat_map(|i| (0..30).map(move |j| (i, j)));
        let faces = squares.flat_map(|(i, j)| {
            let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
            [[a, b, c], [a, c, d]]
        });
        (points.collect(), faces.collect())
    }

    #[test]
    fn rounding_errors_of_the_lowest_vectors_are_polished_away() {
        let (vertices, faces) = rectangle();
        let operator = laplacian(&vertices, &faces, Area::Mixed, false).expect("a plane mesh");
        let exact = eigenpairs(&operator, 25, &Options::default(), &()).expect("certified");
        let problem = Problem::new(&operator.stiffness, &operator.mass).expect("a Laplacian");
        let factorizer = Factorizer::new(&problem).expect("small");
        let (order, n) = (factorizer.order(), vertices.len());
        let (null, pool) = (problem.null(&order), Pool::new(n));
        let columns = Columns { problem: &problem, null: &null, order: &order, hooks: &() };
        // Errors as a factorisation with growth leaves them: noise of 1e-8 in the vectors.
        let mut random = Random::from_state(3);
        let noise: Vec<f64> = (0..24 * n).map(|_| 1e-8 * random.signed() / (n as f64).sqrt()).collect();
        let entry = |i: usize, j: usize| {
            let vertex = order[i] as usize;
            let y = exact.vectors[(j + 1) * n + vertex] * operator.mass[vertex].sqrt();
            y + noise[j * n + i]
        };
        let mut vectors = Vectors::with(&pool, n, 24, entry).expect("small");
        let before = columns.examine(&mut vectors, 24, 1e-8).expect("not cancelled");
        columns.polish(&mut vectors, 1e-8, || factorizer.factor(-12.0)).expect("not cancelled");
        let after = columns.examine(&mut vectors, 24, 1e-8).expect("not cancelled");
        assert!(
            before.residual > 1e-6 && after.residual < 0.05 * before.residual,
            "{} {}",
            before.residual,
            after.residual
        );
    }
}
