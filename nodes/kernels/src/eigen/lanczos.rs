//! Block Lanczos with full reorthogonalisation on the inverse of A - sigma I (Grimes, Lewis & Simon 1994), and refinement of its result.

use super::dense::{inner, product, symmetric_eigen};
use super::factor::Factor;
use super::problem::Problem;
use super::{EigenError, Hooks};
use crate::random::Random;
use faer::dyn_stack::MemBuffer;
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, MatMut, MatRef, Par, Side};

/// Ritz pairs of the inverse are accepted at this residual relative to their value. [`refine`] then brings the residual of A itself to about 1e-12.
const RITZ_TOLERANCE: f64 = 1e-8;

/// A column that shrinks by this factor under orthogonalisation lies in the span already: only rounding error is left of it.
const DEPENDENT: f64 = 1e-12;

pub(super) struct Run<'a> {
    pub problem: &'a Problem<'a>,
    pub factor: &'a Factor<'a>,
    /// Orthonormal columns already known, to stay away from.
    pub locked: MatRef<'a, f64>,
    /// How many eigenvectors are wanted, those nearest above sigma.
    pub want: usize,
    pub block_size: usize,
    pub seed: u64,
}

/// The growing Krylov basis and the projection of the inverse onto it.
struct Krylov<'a> {
    run: &'a Run<'a>,
    /// Orthonormal columns, of which the first `starts.last()` are in use.
    basis: Mat<f64>,
    /// Where each block begins, and the end of the last.
    starts: Vec<usize>,
    /// Diagonal blocks of the projection.
    diagonal: Vec<Mat<f64>>,
    /// Blocks below the diagonal: block j + 1 times `below[j]` is what was left of the inverse times block j.
    below: Vec<Mat<f64>>,
    random: Random,
    scratch: MemBuffer,
}

/// Approximate eigenvectors of A, orthonormal, by ascending eigenvalue; `want` of them unless the space has no more.
pub(super) fn lanczos(run: &Run<'_>, hooks: &dyn Hooks) -> Result<Mat<f64>, EigenError> {
    let mut krylov = Krylov::new(run);
    let mut next_check = 2 * run.want + 2 * run.block_size;
    loop {
        if hooks.cancelled() {
            return Err(EigenError::Cancelled);
        }
        hooks.progress((krylov.dimension() as f64 / (3 * run.want + 4 * run.block_size) as f64).min(0.9));
        let exhausted = krylov.extend() == 0;
        let dimension = krylov.starts[krylov.starts.len() - 2];
        if exhausted || dimension >= next_check {
            if let Some(vectors) = krylov.converged(exhausted)? {
                return Ok(vectors);
            }
            next_check = dimension + (dimension / 12).max(2 * run.block_size);
        }
    }
}

impl<'a> Krylov<'a> {
    fn new(run: &'a Run<'a>) -> Self {
        let n = run.problem.n();
        let width = run.block_size.min(n - run.problem.nullity() - run.locked.ncols());
        let capacity = (3 * run.want + 6 * run.block_size).min(n);
        let mut krylov = Self {
            run,
            basis: Mat::zeros(n, capacity.max(width)),
            starts: vec![0],
            diagonal: Vec::new(),
            below: Vec::new(),
            random: Random::from_state(run.seed),
            scratch: run.factor.scratch(run.block_size),
        };
        let mut block = Mat::from_fn(n, width, |_, _| krylov.random.signed());
        // One inverse step: the start is smooth, as the wanted vectors are.
        run.factor.solve(block.as_mut(), &mut krylov.scratch);
        krylov.orthonormalise(&mut block);
        krylov.append(&block);
        krylov
    }

    fn dimension(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }

    fn append(&mut self, block: &Mat<f64>) {
        let (from, n) = (self.dimension(), self.run.problem.n());
        let to = from + block.ncols();
        if to > self.basis.ncols() {
            self.basis.resize_with(n, (to + to / 4).min(n), |_, _| 0.0);
        }
        self.basis.as_mut().subcols_mut(from, block.ncols()).copy_from(block);
        self.starts.push(to);
    }

    /// One step of the recurrence; returns the width of the new block, 0 when the space is exhausted.
    fn extend(&mut self) -> usize {
        let last = self.starts.len() - 2;
        let (from, to) = (self.starts[last], self.starts[last + 1]);
        let mut block = self.basis.subcols(from, to - from).to_owned();
        self.run.factor.solve(block.as_mut(), &mut self.scratch);
        let scale = column_norms(block.as_ref());
        // The three-term recurrence first, so that the pass over the whole basis removes only rounding errors.
        let near = self.starts[last.saturating_sub(1)];
        let mut diagonal = Mat::zeros(to - from, to - from);
        for begin in [near, 0] {
            self.remove_known(block.as_mut());
            let part = self.basis.subcols(begin, to - begin);
            let along = inner(part, block.as_ref());
            subtract(block.as_mut(), part, along.as_ref());
            diagonal += along.subrows(from - begin, to - from);
        }
        let symmetric = Mat::from_fn(to - from, to - from, |i, j| 0.5 * (diagonal[(i, j)] + diagonal[(j, i)]));
        self.diagonal.push(symmetric);
        let known = self.run.problem.nullity() + self.run.locked.ncols();
        let width = (to - from).min(self.run.problem.n() - known - to);
        let below = self.factor_block(&mut block, &scale);
        self.below.push(below.subrows(0, width).to_owned());
        self.append(&block.subcols(0, width).to_owned());
        width
    }

    /// block = Q R with Q replacing the block and orthogonal to all that is known. Columns that depend on the others are replaced by
    /// random ones, with zeros in R: the recurrence then goes on in a part of the space not seen yet.
    fn factor_block(&mut self, block: &mut Mat<f64>, scale: &[f64]) -> Mat<f64> {
        let width = block.ncols();
        let mut r = Mat::<f64>::zeros(width, width);
        for j in 0..width {
            for _ in 0..2 {
                for i in 0..j {
                    let along = column_dot(block.as_ref(), i, j);
                    r[(i, j)] += along;
                    add_column(block, j, i, -along);
                }
            }
            let norm = column_dot(block.as_ref(), j, j).sqrt();
            if norm > DEPENDENT * scale[j] {
                r[(j, j)] = norm;
                scale_column(block, j, 1.0 / norm);
            } else if !self.replace_column(block, j) {
                block.col_mut(j).fill(0.0);
            }
        }
        // Where a column shrank much, what was left of the old basis in it grew: clean once more.
        let smallest = (0..width).fold(f64::INFINITY, |m, j| m.min(r[(j, j)] / scale[j]));
        if smallest < 1e-3 {
            self.clean(block);
        }
        r
    }

    /// Orthogonalises against everything known and inside the block, without recording coefficients.
    fn clean(&mut self, block: &mut Mat<f64>) {
        self.remove_known(block.as_mut());
        let used = self.basis.subcols(0, self.dimension());
        let along = inner(used, block.as_ref());
        subtract(block.as_mut(), used, along.as_ref());
        for j in 0..block.ncols() {
            for i in 0..j {
                let along = column_dot(block.as_ref(), i, j);
                add_column(block, j, i, -along);
            }
            let norm = column_dot(block.as_ref(), j, j).sqrt();
            if norm > 0.0 {
                scale_column(block, j, 1.0 / norm);
            }
        }
    }

    fn orthonormalise(&mut self, block: &mut Mat<f64>) {
        let scale = column_norms(block.as_ref());
        self.remove_known(block.as_mut());
        self.factor_block(block, &scale);
        self.clean(block);
    }

    /// Puts a random unit vector orthogonal to everything into a column; false if there is no room for one.
    fn replace_column(&mut self, block: &mut Mat<f64>, j: usize) -> bool {
        let n = block.nrows();
        let used = self.dimension();
        for _ in 0..3 {
            let mut fresh = Mat::from_fn(n, 1, |_, _| self.random.signed());
            let before = column_norms(fresh.as_ref())[0];
            for _ in 0..3 {
                self.remove_known(fresh.as_mut());
                for part in [self.basis.subcols(0, used), block.subcols(0, j)] {
                    let along = inner(part, fresh.as_ref());
                    subtract(fresh.as_mut(), part, along.as_ref());
                }
            }
            let norm = column_norms(fresh.as_ref())[0];
            if norm > 1e-6 * before {
                scale_column(&mut fresh, 0, 1.0 / norm);
                block.col_mut(j).copy_from(fresh.col(0));
                return true;
            }
        }
        false
    }

    fn remove_known(&self, mut block: MatMut<'_, f64>) {
        self.run.problem.project_out_kernel(block.as_mut());
        if self.run.locked.ncols() > 0 {
            let along = inner(self.run.locked, block.as_ref());
            subtract(block, self.run.locked, along.as_ref());
        }
    }

    /// The wanted Ritz vectors if their residuals are small, or in any case if the space is exhausted.
    fn converged(&self, exhausted: bool) -> Result<Option<Mat<f64>>, EigenError> {
        let blocks = self.diagonal.len();
        let m = self.starts[blocks];
        let mut projection = Mat::<f64>::zeros(m, m);
        for j in 0..blocks {
            let (at, width) = (self.starts[j], self.starts[j + 1] - self.starts[j]);
            projection.as_mut().submatrix_mut(at, at, width, width).copy_from(&self.diagonal[j]);
            if j + 1 < blocks {
                let below = &self.below[j];
                projection.as_mut().submatrix_mut(at + width, at, below.nrows(), width).copy_from(below);
            }
        }
        let (values, vectors) = symmetric_eigen(projection.as_ref())?;
        let take = self.run.want.min(m);
        // Largest inverse first: ascending eigenvalues of A.
        let order: Vec<usize> = (0..take).map(|i| m - 1 - i).collect();
        let last = &self.below[blocks - 1];
        let tail = vectors.subrows(m - last.ncols(), last.ncols());
        let settled = order.iter().all(|&c| {
            let residual = product(last.as_ref(), tail.subcols(c, 1));
            column_norms(residual.as_ref())[0] <= RITZ_TOLERANCE * values[c].abs()
        });
        let complete = settled && take == self.run.want;
        if complete || exhausted {
            let selected = Mat::from_fn(m, take, |i, c| vectors[(i, order[c])]);
            return Ok(Some(product(self.basis.subcols(0, m), selected.as_ref())));
        }
        Ok(None)
    }
}

/// One step of inverse iteration on a basis of approximate eigenvectors, Rayleigh-Ritz, and orthonormalisation. Components far up the
/// spectrum, which residuals of the inverse hardly show, are damped. Returns nothing if the columns are not independent.
pub(super) fn refine(problem: &Problem<'_>, factor: &Factor<'_>, y: &Mat<f64>) -> Result<Option<Mat<f64>>, EigenError> {
    let k = y.ncols();
    let mut z = y.clone();
    factor.solve(z.as_mut(), &mut factor.scratch(k));
    problem.project_out_kernel(z.as_mut());
    let t = inner(y.as_ref(), z.as_ref());
    let t = Mat::from_fn(k, k, |i, j| 0.5 * (t[(i, j)] + t[(j, i)]));
    let (values, vectors) = symmetric_eigen(t.as_ref())?;
    let rotation = Mat::from_fn(k, k, |i, j| vectors[(i, k - 1 - j)] / values[k - 1 - j]);
    Ok(orthonormalise(product(z.as_ref(), rotation.as_ref())))
}

/// Orthonormal columns with the same leading spans, by two Cholesky QR passes; nothing if the columns are dependent.
pub(super) fn orthonormalise(mut y: Mat<f64>) -> Option<Mat<f64>> {
    for _ in 0..2 {
        let gram = inner(y.as_ref(), y.as_ref());
        let cholesky = gram.llt(Side::Lower).ok()?;
        solve_lower_triangular_in_place(cholesky.L(), y.as_mut().transpose_mut(), Par::Seq);
    }
    Some(y)
}

fn subtract(target: MatMut<'_, f64>, part: MatRef<'_, f64>, along: MatRef<'_, f64>) {
    matmul(target, Accum::Add, part, along, -1.0, Par::Seq);
}

fn column_norms(m: MatRef<'_, f64>) -> Vec<f64> {
    (0..m.ncols()).map(|j| column_dot(m, j, j).sqrt()).collect()
}

fn column_dot(m: MatRef<'_, f64>, i: usize, j: usize) -> f64 {
    inner(m.subcols(i, 1), m.subcols(j, 1))[(0, 0)]
}

fn add_column(m: &mut Mat<f64>, to: usize, from: usize, factor: f64) {
    for i in 0..m.nrows() {
        let x = m[(i, from)];
        m[(i, to)] += factor * x;
    }
}

fn scale_column(m: &mut Mat<f64>, j: usize, factor: f64) {
    for i in 0..m.nrows() {
        m[(i, j)] *= factor;
    }
}
