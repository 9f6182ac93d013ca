//! Whether pairs may be returned: residuals, orthogonality, and the sort that their final values give.

use super::basis::Null;
use super::factor::{BELOW, Factorizer};
use super::gauge::is_turned;
use super::panel::{Row, Rows, WIDTH};
use super::parts::{collect, locked};
use super::pool::Panel;
use super::problem::Problem;
use super::quality::Quality;
use super::spare::Spare;
use super::tiles::Triangle;
use super::vectors::{Moments, Vectors, by_vertex};
use super::{EigenError, Hooks, Phase, enter};
use std::ops::Range;
use std::sync::Mutex;

/// Inner products above this are removed: neighbours found by different slices, each accurate, are that nearly orthogonal only.
const REMOVED: f64 = 1e-11;

/// Parts of a Gram matrix that may be summed on different threads.
const GRAM_PARTS: usize = 4;

/// Panels that are examined side by side.
const TOGETHER: usize = 2;

/// Once some pairs have been corrected, those above are too until eight of them are this much better than they need be: rounding errors do not shrink evenly from
/// one pair to the next, and a single one that is missed costs another attempt.
const SAFE: f64 = 0.5;

/// What certifying needs beside the vectors.
pub(super) struct Columns<'a> {
    problem: &'a Problem<'a>,
    null: &'a Null,
    order: &'a [u32],
    hooks: &'a dyn Hooks,
    /// The diagonal of R^-1.
    scale: Vec<f64>,
    spare: Spare<Rows>,
}

/// What examining all pairs found.
pub(super) struct Findings {
    /// Rayleigh quotients, ascending.
    pub values: Vec<f64>,
    /// The largest residual of the first `wanted` pairs relative to their values.
    pub residual: f64,
    /// Whether those of all pairs are within bounds.
    pub fine: bool,
    /// The largest product with the null space.
    pub null: f64,
}

/// One column of a panel, and where it is to be written.
type Target<'a> = (usize, &'a mut [f64]);

impl<'a> Columns<'a> {
    pub fn new(problem: &'a Problem<'a>, null: &'a Null, order: &'a [u32], hooks: &'a dyn Hooks) -> Self {
        let scale = problem.root.iter().map(|r| 1.0 / r).collect();
        Self { problem, null, order, hooks, scale, spare: Spare::new() }
    }

    /// Computes Rayleigh quotients and residuals, and returns the vectors by vertex in the caller's units with their signs, column after column, ascending by
    /// Rayleigh quotient, in memory that begins with room for null vectors and ends anywhere.
    pub fn examine(
        &self,
        mut vectors: Vectors<'_>,
        wanted: usize,
        tolerance: f64,
    ) -> Result<(Vec<f64>, Findings), EigenError> {
        let (n, places) = (self.order.len(), vectors.places());
        let (mut results, mut null) = (Vec::<Quality>::with_capacity(vectors.values().len()), 0.0f64);
        while results.len() < vectors.values().len() {
            for (quality, product) in self.examine_some(&mut vectors, &places, results.len(), tolerance)? {
                results.push(quality);
                null = null.max(product);
            }
        }
        let (order, findings) = findings(&places, &results, null, wanted, tolerance);
        permute(vectors.columns_mut(n, 0..places.len()), n, &order);
        Ok((vectors.into_memory(), findings))
    }

    /// Examines some panels from this one on and writes their columns. They are copied by vertex first, all of them: their columns take their place.
    fn examine_some(
        &self,
        vectors: &mut Vectors<'_>,
        places: &[(usize, usize)],
        first: usize,
        tolerance: f64,
    ) -> Result<Vec<(Quality, f64)>, EigenError> {
        let panels = first..vectors.values().len().min(first + TOGETHER);
        let all = vectors.panels();
        let copies = self.map(panels.len(), &|i| self.by_vertex(all[first + i]))?;
        let copies: Vec<(Rows, Moments)> = copies.into_iter().collect::<Result<_, _>>()?;
        let values = vectors.values()[panels.clone()].to_vec();
        let [begin, end] = [panels.start, panels.end].map(|panel| places.partition_point(|place| place.0 < panel));
        let mut slots: Vec<Vec<Target<'_>>> = panels.map(|_| Vec::new()).collect();
        let columns = vectors.columns_mut(self.order.len(), begin..end).chunks_exact_mut(self.order.len());
        for (column, &(panel, q)) in columns.zip(&places[begin..end]) {
            slots[panel - first].push((q, column));
        }
        let slots: Vec<_> = slots.into_iter().map(Mutex::new).collect();
        let examined = self.map(copies.len(), &|i| {
            let (memory, moments) = &copies[i];
            let (v, targets) = (memory.as_slice(), &mut *locked(&slots[i]));
            let factors = self.factors(v, moments);
            let write = &mut |rows| write(v, &factors, &rows, targets);
            (self.problem.examine_and(v, &values[i], tolerance, write), moments.null)
        })?;
        for (memory, _) in copies {
            self.spare.give(memory);
        }
        Ok(examined)
    }

    /// A panel of R^-1 y by vertex, in memory whose rows are aligned to cache lines.
    fn by_vertex(&self, panel: &Panel) -> Result<(Rows, Moments), EigenError> {
        let fresh = || Rows::zeroed(self.order.len());
        let mut memory = self.spare.take().map_or_else(fresh, Ok)?;
        let moments = by_vertex(panel, self.order, &self.scale, self.null, memory.as_mut_slice());
        Ok((memory, moments))
    }

    /// What the columns of v are multiplied by: their signs, in the caller's units.
    fn factors(&self, v: &[Row], moments: &Moments) -> Row {
        let unit = 1.0 / self.problem.area.sqrt();
        std::array::from_fn(|q| {
            let turned = is_turned(moments.cubes[q], moments.magnitudes[q], v.iter().map(|row| row[q]));
            if turned { -unit } else { unit }
        })
    }

    /// One step of correction, y - F^-1 (A y - lambda y), for the lowest vectors, eight at a time, until the next eight need none, or for all that need it: bounds are relative to the
    /// values, rounding errors of an indefinite factorisation are not. The factor, of A less a shift below the spectrum, grows none; what is high above a
    /// pair vanishes under it, and most of the errors are. The values, one for each column that counts, become better too.
    pub fn polish(
        &self,
        panels: Vec<&mut Panel>,
        values: &mut [f64],
        all: bool,
        tolerance: f64,
        factorizer: &Factorizer,
    ) -> Result<(), EigenError> {
        let mut at_hand = None;
        for (panel, values) in panels.into_iter().zip(values.chunks_mut(WIDTH)) {
            let (memory, _) = self.by_vertex(panel)?;
            let v = memory.as_slice();
            let bound = if at_hand.is_some() { SAFE * tolerance } else { tolerance };
            let quality = self.problem.examine(v, &guesses(values), bound);
            if (0..values.len()).all(|q| quality.is_fine(q, bound)) {
                self.spare.give(memory);
                if all {
                    continue;
                }
                break;
            }
            let factor = match &mut at_hand {
                Some(factor) => factor,
                none => {
                    enter(self.hooks, Phase::Factorise)?;
                    none.insert(factorizer.factor(BELOW, self.hooks)?)
                }
            };
            enter(self.hooks, Phase::Certify)?;
            let mut correction = self.problem.residual_rows(&quality.values, v, self.order);
            self.spare.give(memory);
            factor.solve(self.hooks, &mut correction)?;
            for (row, x) in panel.as_flattened_mut().iter_mut().zip(&correction) {
                (0..values.len()).for_each(|q| row[q] -= x[q]);
            }
            values.copy_from_slice(&quality.values[..values.len()]);
        }
        Ok(())
    }

    /// The largest entry of |Y' Y - I| after removing what neighbouring slices left. What is to be done `aside` is done once, as a task like the parts of Y' Y.
    pub fn orthogonalise(&self, vectors: &mut Vectors<'_>, aside: &(dyn Fn() + Sync)) -> Result<f64, EigenError> {
        let (mut worst, mut aside) = (f64::INFINITY, aside);
        for _ in 0..3 {
            let panels = vectors.panels();
            let products = Products::of(&self.gram(&panels, aside)?, vectors);
            aside = &|| ();
            worst = products.kept + products.second;
            if !products.steps.is_empty() {
                vectors.subtract_multiples(&products.steps, self.hooks)?;
            }
            if products.second < 0.1 * REMOVED {
                break;
            }
        }
        Ok(worst)
    }

    /// Y' Y of all columns, and what is to be done aside.
    fn gram(&self, panels: &[&Panel], aside: &(dyn Fn() + Sync)) -> Result<Triangle, EigenError> {
        let runs = panels.first().map_or(0, |panel| panel.len());
        let share = runs.div_ceil(GRAM_PARTS).max(1);
        let parts = self.map(1 + runs.div_ceil(share), &|task| {
            let mut sum = Triangle::zeros(panels.len());
            match task.checked_sub(1) {
                Some(p) => sum.add_gram(panels, p * share..runs.min((p + 1) * share)),
                None => aside(),
            }
            sum
        })?;
        let mut total = Triangle::zeros(panels.len());
        for part in &parts {
            total.add(part);
        }
        Ok(total)
    }

    /// The largest residual of the null vectors over the first positive eigenvalue: rounding of the row sums.
    pub fn null_residual(&self, first: Option<f64>) -> f64 {
        let Some(first) = first else { return 0.0 };
        let mut squares = vec![0.0f64; self.null.count];
        for &(vertex, sum) in &self.problem.uneven {
            let (label, unit) = self.problem.null_entry(vertex);
            let residual = sum * unit / self.problem.root[vertex].powi(2);
            squares[label] += residual * residual;
        }
        squares.iter().fold(0.0f64, |worst, s| worst.max(s.sqrt())) / first
    }

    fn map<T: Send>(&self, count: usize, task: &(dyn Fn(usize) -> T + Sync)) -> Result<Vec<T>, EigenError> {
        collect(self.hooks, count, task)
    }
}

/// A panel's approximate eigenvalues, as far as there are any.
pub(super) fn guesses(values: &[f64]) -> Row {
    std::array::from_fn(|q| values.get(q).copied().unwrap_or(0.0))
}

/// Writes some rows of v to columns, with these factors.
fn write(v: &[Row], factors: &Row, rows: &Range<usize>, targets: &mut [Target<'_>]) {
    for (q, column) in targets {
        for (x, row) in column[rows.clone()].iter_mut().zip(&v[rows.clone()]) {
            *x = row[*q] * factors[*q] + 0.0; // no negative zeros in an artefact
        }
    }
}

/// The order of final values, and what the qualities of vectors at these places come to in that order.
fn findings(
    places: &[(usize, usize)],
    results: &[Quality],
    null: f64,
    wanted: usize,
    tolerance: f64,
) -> (Vec<usize>, Findings) {
    let value = |j: usize| results[places[j].0].values[places[j].1];
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by(|&a, &b| value(a).total_cmp(&value(b)).then(a.cmp(&b)));
    let mut findings = Findings { values: Vec::with_capacity(order.len()), residual: 0.0, fine: true, null };
    for (position, &j) in order.iter().enumerate() {
        let ((panel, q), value) = (places[j], value(j));
        findings.values.push(value);
        findings.fine &= results[panel].is_fine(q, tolerance);
        if position < wanted {
            findings.residual = findings.residual.max(results[panel].residuals[q] / value);
        }
    }
    (order, findings)
}

/// Inner products of vectors.
struct Products {
    /// Those to be removed: (higher, lower, product), or twice the same and half of what its square is too long by. Residuals are relative to the values, so the lower vector is the more accurate of the two, and all of the
    /// product is removed from the higher one.
    steps: Vec<(usize, usize, f64)>,
    /// The largest entry of |Y' Y - I| that stays.
    kept: f64,
    /// What removing the others adds to that at most.
    second: f64,
}

impl Products {
    /// With Y' Y = I + E and the removed products as entries of F, the new product is I + E - F - F' - F' E - E F + F' F + F' E F: the rest of E, and terms of
    /// second order, which norms of columns bound.
    fn of(gram: &Triangle, vectors: &Vectors<'_>) -> Self {
        let places: Vec<usize> = vectors.places().into_iter().map(|(panel, q)| panel * WIDTH + q).collect();
        let (mut kept, mut steps) = (0.0f64, Vec::new());
        let (mut all, mut removed) = (vec![0.0; places.len()], vec![0.0; places.len()]);
        for (i, &place) in places.iter().enumerate() {
            let row = gram.row(place);
            let own = row(place) - 1.0;
            let mut square = own * own;
            if own.abs() > REMOVED {
                steps.push((i, i, 0.5 * own));
                removed[i] += 0.25 * own * own;
            } else {
                kept = kept.max(own.abs());
            }
            for (j, &lower) in places[..i].iter().enumerate() {
                let product = row(lower);
                square += product * product;
                all[j] += product * product;
                if product.abs() > REMOVED {
                    steps.push((i, j, product));
                    removed[i] += product * product;
                } else if product.abs() > kept {
                    kept = product.abs();
                }
            }
            all[i] = square;
        }
        let largest = |squares: &[f64]| squares.iter().fold(0.0f64, |m, x| m.max(*x)).sqrt();
        let (e, f, whole) = (largest(&all), largest(&removed), all.iter().sum::<f64>().sqrt());
        Self { steps, kept, second: 2.0 * e * f + f * f * (1.0 + whole) }
    }
}

/// Puts column `order[i]` in place i, for all columns that are there.
fn permute(columns: &mut [f64], n: usize, order: &[usize]) {
    let mut order = order.to_vec();
    for start in 0..order.len() {
        let mut place = start;
        // Along a cycle: each column changes places with the one that belongs there.
        while order[place] != start {
            let next = order[place];
            let (low, high) = columns.split_at_mut(place.max(next) * n);
            low[place.min(next) * n..][..n].swap_with_slice(&mut high[..n]);
            order[place] = place;
            place = next;
        }
        order[place] = place;
    }
}

/// An uncertified result of which nothing more is known.
pub(super) const UNCERTIFIED: EigenError = EigenError::NotCertified { expected: 0, found: 0, residual: f64::NAN };

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eigen::pool::{Panels, Pool};
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
    fn columns_are_permuted_in_place() {
        for order in [vec![0, 1, 2, 3, 4], vec![3, 0, 1, 2, 4], vec![1, 0, 4, 2, 3]] {
            let mut columns: Vec<f64> = (0..15).map(|i| f64::from(i / 3)).collect();
            permute(&mut columns, 3, &order);
            let found: Vec<usize> = columns.iter().step_by(3).map(|x| *x as usize).collect();
            assert_eq!(found, order);
        }
    }

    #[test]
    fn products_are_removed_and_what_is_left_is_known() {
        let (vertices, faces) = rectangle();
        let operator = laplacian(&vertices, &faces, Area::Mixed, false).expect("a plane mesh");
        let exact = eigenpairs(&operator, 31, &Options::default(), &()).expect("certified");
        let problem = Problem::of(&operator);
        let factorizer = Factorizer::of(&problem);
        let (order, n) = (factorizer.order(), vertices.len());
        let (null, pool) = (problem.null(&order), Pool::new(n, 1));
        let columns = Columns::new(&problem, &null, &order, &());
        // Some of the later vectors hold a little of an earlier one; 1e-4 is too much for terms of first order.
        for (share, bound) in [(1e-8, 2e-11), (1e-4, 2e-11)] {
            let y = |vertex: usize, j: usize| exact.vectors[(j + 1) * n + vertex] * operator.mass[vertex].sqrt();
            let entry = |i: usize, j: usize| {
                let vertex = order[i] as usize;
                let mixed = if j % 3 == 2 { y(vertex, j / 2) } else { 0.0 };
                y(vertex, j) + share * mixed
            };
            let panels = Panels::filled(&pool, n, 30, entry).expect("small");
            let mut vectors = Vectors::of_all(&pool, panels, vec![1.0; 30]).expect("small");
            let gram = |vectors: &Vectors<'_>| {
                let gram = columns.gram(&vectors.panels(), &|| ()).expect("not cancelled");
                let error = |i: usize, j: usize| (gram.row(i.max(j))(i.min(j)) - f64::from(u8::from(i == j))).abs();
                (0..30).flat_map(|i| (0..30).map(move |j| (i, j))).map(|(i, j)| error(i, j)).fold(0.0, f64::max)
            };
            assert!(gram(&vectors) > 0.9 * share);
            let known = columns.orthogonalise(&mut vectors, &|| ()).expect("not cancelled");
            let measured = gram(&vectors);
            assert!(measured <= known + 1e-14 && known < bound, "{share}: {measured:e} {known:e}");
        }
    }

    #[test]
    fn rounding_errors_of_the_lowest_vectors_are_polished_away() {
        let (vertices, faces) = rectangle();
        let operator = laplacian(&vertices, &faces, Area::Mixed, false).expect("a plane mesh");
        let exact = eigenpairs(&operator, 25, &Options::default(), &()).expect("certified");
        let problem = Problem::of(&operator);
        let factorizer = Factorizer::of(&problem);
        let (order, n) = (factorizer.order(), vertices.len());
        let (null, pool) = (problem.null(&order), Pool::new(n, 1));
        let columns = Columns::new(&problem, &null, &order, &());
        // Errors as a factorisation with growth leaves them: noise of 1e-8 in the vectors.
        let mut random = Random::from_state(3);
        let noise: Vec<f64> = (0..24 * n).map(|_| 1e-8 * random.signed() / (n as f64).sqrt()).collect();
        let guesses: Vec<f64> = exact.values[1..].iter().map(|value| value * problem.area).collect();
        // In all of them, or in those that follow the first eight.
        let noisy = |from: usize| {
            let entry = |i: usize, j: usize| {
                let vertex = order[i] as usize;
                let y = exact.vectors[(j + 1) * n + vertex] * operator.mass[vertex].sqrt();
                if j < from { y } else { y + noise[j * n + i] }
            };
            Panels::filled(&pool, n, 24, entry).expect("small")
        };
        let polished = |from: usize, all: bool| {
            let (mut panels, mut values) = (noisy(from), guesses.clone());
            columns.polish(panels.all_mut(), &mut values, all, 1e-8, &factorizer).expect("not cancelled");
            panels
        };
        let residual = |panels: Panels<'_>| {
            let vectors = Vectors::of_all(&pool, panels, guesses.clone()).expect("small");
            columns.examine(vectors, 24, 1e-8).expect("not cancelled").1.residual
        };
        let [before, after] = [noisy(0), polished(0, false)].map(residual);
        assert!(before > 1e-6 && after < 0.05 * before, "{before} {after}");
        let [before, lowest, all] = [noisy(8), polished(8, false), polished(8, true)].map(residual);
        assert!(before > 1e-7 && lowest == before && all < 0.05 * before, "{before} {lowest} {all}");
    }
}
