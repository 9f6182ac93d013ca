//! Approximate eigenvectors of all slices, in elimination order, and arithmetic on them run by run.

use super::EigenError;
use super::basis::{Null, RUN};
use super::panel::{Row, Rows, WIDTH};
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::{Accum, Mat, MatRef, Par};

/// Columns of n entries, stored in runs of [`RUN`] rows, and inside a run column after column; the last run is padded with zeros.
pub(super) struct Store {
    rows: Rows,
    columns: usize,
    runs: usize,
}

impl Store {
    pub fn zeroed(n: usize, columns: usize) -> Result<Self, EigenError> {
        let runs = n.div_ceil(RUN);
        let rows = Rows::zeroed(runs * columns * RUN / WIDTH).map_err(|_| EigenError::Memory)?;
        Ok(Self { rows, columns, runs })
    }

    /// All columns of one run, one after the other.
    pub fn run_mut(&mut self, run: usize) -> &mut [f64] {
        let length = self.columns * RUN;
        &mut self.rows.as_mut_slice().as_flattened_mut()[run * length..(run + 1) * length]
    }

    fn piece(&self, run: usize, column: usize) -> &[f64] {
        let begin = (run * self.columns + column) * RUN;
        &self.rows.as_slice().as_flattened()[begin..begin + RUN]
    }
}

/// A selection of the columns of several stores.
pub(super) struct Vectors {
    stores: Vec<Store>,
    /// Store and column of each vector.
    index: Vec<(usize, usize)>,
    runs: usize,
}

impl Vectors {
    pub fn new(stores: Vec<Store>, index: Vec<(usize, usize)>) -> Self {
        let runs = stores.iter().map(|s| s.runs).max().unwrap_or(0);
        Self { stores, index, runs }
    }

    pub fn len(&self) -> usize {
        self.index.len()
    }

    pub fn runs(&self) -> usize {
        self.runs
    }

    /// The vectors in another order, or some of them.
    pub fn select(&mut self, order: &[usize]) {
        self.index = order.iter().map(|&j| self.index[j]).collect();
    }

    /// The entries of vector j in one run, zeros after the last row.
    pub fn piece(&self, run: usize, j: usize) -> &[f64] {
        let (store, column) = self.index[j];
        self.stores[store].piece(run, column)
    }

    /// Adds Y' Y over some runs to the lower triangle.
    pub fn add_gram(&self, runs: std::ops::Range<usize>, gram: &mut Mat<f64>) {
        let k = self.len();
        let mut block = vec![0.0; RUN * k];
        for run in runs {
            for (j, target) in block.chunks_exact_mut(RUN).enumerate() {
                target.copy_from_slice(self.piece(run, j));
            }
            let y = MatRef::from_column_major_slice(&block, RUN, k);
            let (lower, whole) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
            matmul(gram.as_mut(), lower, Accum::Add, y.transpose(), whole, y, whole, 1.0, Par::Seq);
        }
    }

    /// The product of vector j with each null vector, the largest magnitude.
    pub fn null_product(&self, j: usize, null: &Null) -> f64 {
        let mut sums = vec![0.0; null.count];
        let pieces = (0..self.runs).flat_map(|run| self.piece(run, j));
        for ((&label, unit), x) in null.labels.iter().zip(&null.units).zip(pieces) {
            sums[label as usize] += unit * x;
        }
        sums.iter().fold(0.0f64, |m, x| m.max(x.abs()))
    }

    /// Applies, in order, y_to -= factor y_from.
    pub fn subtract(&mut self, steps: &[(usize, usize, f64)]) {
        let mut from = [0.0; RUN];
        for run in 0..self.runs {
            for &(to, source, factor) in steps {
                from.copy_from_slice(self.piece(run, source));
                let (store, column) = self.index[to];
                let target = &mut self.stores[store].run_mut(run)[column * RUN..(column + 1) * RUN];
                for (x, y) in target.iter_mut().zip(&from) {
                    *x -= factor * y;
                }
            }
        }
    }

    /// Up to eight vectors from `begin` on as a panel whose row `order[i]` is row i times the scale there.
    pub fn panel(&self, begin: usize, order: &[u32], scale: &[f64]) -> Vec<Row> {
        let mut panel = vec![[0.0; WIDTH]; order.len()];
        let width = WIDTH.min(self.len() - begin);
        for (run, order) in order.chunks(RUN).enumerate() {
            let mut pieces = [&[][..]; WIDTH];
            for (q, piece) in pieces.iter_mut().enumerate() {
                *piece = self.piece(run, begin + q.min(width - 1));
            }
            for (i, &vertex) in order.iter().enumerate() {
                let s = scale[vertex as usize];
                panel[vertex as usize] = std::array::from_fn(|q| pieces[q][i] * s);
            }
        }
        panel
    }
}
