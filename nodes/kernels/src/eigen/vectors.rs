//! Approximate eigenvectors of all slices, in elimination order, and arithmetic on them run by run.

use super::EigenError;
use super::basis::Null;
use super::panel::{Row, WIDTH};
use super::pool::{Panel, Panels, Pool, RUN};
use crate::simd::vectorised;
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, MatMut, MatRef, Par};

/// Some of the columns of several stores, in any order. They lie eight to a panel, where the bases were: new pages are dear.
pub(super) struct Vectors<'a> {
    stores: Vec<Panels<'a>>,
    /// Panel, counted through all stores, times eight and column there of each vector.
    index: Vec<usize>,
}

impl<'a> Vectors<'a> {
    /// The columns of each store that are named with it, store by store.
    pub fn new(stores: Vec<(Panels<'a>, Vec<usize>)>) -> Self {
        let (mut index, mut begin) = (Vec::new(), 0);
        for (store, columns) in &stores {
            index.extend(columns.iter().map(|column| begin + column));
            begin += store.count() * WIDTH;
        }
        Self { stores: stores.into_iter().map(|s| s.0).collect(), index }
    }

    /// Columns with these entries by row in elimination order.
    pub fn with(
        pool: &'a Pool,
        n: usize,
        columns: usize,
        entry: impl Fn(usize, usize) -> f64,
    ) -> Result<Self, EigenError> {
        let mut store = Panels::new(pool);
        for p in 0..columns.div_ceil(WIDTH) {
            store.grow()?;
            let Some((_, panel)) = store.split() else { continue };
            for (i, row) in panel.as_flattened_mut().iter_mut().enumerate() {
                let inside = |j: usize| i < n && j < columns;
                *row = std::array::from_fn(|q| p * WIDTH + q).map(|j| if inside(j) { entry(i, j) } else { 0.0 });
            }
        }
        Ok(Self::new(vec![(store, (0..columns).collect())]))
    }

    pub fn len(&self) -> usize {
        self.index.len()
    }

    pub fn runs(&self) -> usize {
        self.panels().first().map_or(0, |panel| panel.len())
    }

    /// All panels, which may hold more columns than are selected.
    pub fn panels(&self) -> Vec<&Panel> {
        self.stores.iter().flat_map(Panels::all).collect()
    }

    /// The vectors in another order, or some of them.
    pub fn select(&mut self, order: &[usize]) {
        self.index = order.iter().map(|&j| self.index[j]).collect();
    }

    /// Adds Y' Y over some runs to the lower triangle.
    pub fn add_gram(&self, runs: std::ops::Range<usize>, gram: &mut Mat<f64>) {
        let (k, panels) = (self.len(), self.panels());
        let mut block = vec![0.0; RUN * k];
        for run in runs {
            gather(&panels, &self.index, run, &mut block);
            let y = MatRef::from_column_major_slice(&block, RUN, k);
            let (lower, whole) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
            triangular::matmul(gram.as_mut(), lower, Accum::Add, y.transpose(), whole, y, whole, 1.0, Par::Seq);
        }
    }

    /// Applies y_to -= factor y_from to the former vectors, all at once.
    pub fn subtract_multiples(&mut self, steps: &[(usize, usize, f64)]) {
        let mut from: Vec<usize> = steps.iter().map(|s| s.1).collect();
        let mut to: Vec<usize> = steps.iter().map(|s| s.0).collect();
        for places in [&mut from, &mut to] {
            places.sort_unstable();
            places.dedup();
        }
        let mut factors = Mat::<f64>::zeros(from.len(), to.len());
        for (target, source, factor) in steps {
            factors[(from.partition_point(|j| j < source), to.partition_point(|j| j < target))] = *factor;
        }
        let [from, to] = [from, to].map(|places| places.iter().map(|&j| self.index[j]).collect::<Vec<_>>());
        let (mut block, mut product) = (vec![0.0; RUN * from.len()], vec![0.0; RUN * to.len()]);
        for run in 0..self.runs() {
            gather(&self.panels(), &from, run, &mut block);
            let y = MatRef::from_column_major_slice(&block, RUN, from.len());
            let target = MatMut::from_column_major_slice_mut(&mut product, RUN, to.len());
            matmul(target, Accum::Replace, y, factors.as_ref(), 1.0, Par::Seq);
            let mut panels: Vec<&mut Panel> = self.stores.iter_mut().flat_map(Panels::all_mut).collect();
            for (column, &place) in product.chunks_exact(RUN).zip(&to) {
                for (row, x) in panels[place / WIDTH][run].iter_mut().zip(column) {
                    row[place % WIDTH] -= x;
                }
            }
        }
    }

    /// Subtracts the columns of a panel, by row in elimination order, from up to eight vectors from `begin` on.
    pub fn subtract(&mut self, begin: usize, panel: &[Row]) {
        let mut targets: Vec<&mut Panel> = self.stores.iter_mut().flat_map(Panels::all_mut).collect();
        for (q, &place) in self.index[begin..].iter().take(WIDTH).enumerate() {
            for (row, x) in targets[place / WIDTH].as_flattened_mut().iter_mut().zip(panel) {
                row[place % WIDTH] -= x[q];
            }
        }
    }

    /// Up to eight vectors from `begin` on as a panel whose row `order[i]` is row i times the scale there.
    pub fn panel(&self, begin: usize, order: &[u32], scale: &[f64]) -> Vec<Row> {
        let panels = self.panels();
        let places: [usize; WIDTH] = std::array::from_fn(|q| self.index[(begin + q).min(self.len() - 1)]);
        let sources = places.map(|place| panels[place / WIDTH].as_flattened());
        let mut panel = vec![[0.0; WIDTH]; order.len()];
        for (i, &vertex) in order.iter().enumerate() {
            let s = scale[vertex as usize];
            panel[vertex as usize] = std::array::from_fn(|q| sources[q][i][places[q] % WIDTH] * s);
        }
        panel
    }
}

/// Some vectors, by their places, in one run, column after column.
fn gather(panels: &[&Panel], places: &[usize], run: usize, block: &mut [f64]) {
    for (target, place) in block.chunks_exact_mut(RUN).zip(places) {
        for (x, row) in target.iter_mut().zip(&panels[place / WIDTH][run]) {
            *x = row[place % WIDTH];
        }
    }
}

/// The product of a panel with the null vectors, the largest magnitude.
pub(super) fn null_product(panel: &Panel, null: &Null) -> f64 {
    let mut sums = vec![[0.0; WIDTH]; null.count];
    vectorised(
        #[inline(always)]
        || {
            for (run, rows) in panel.iter().enumerate() {
                null.add_product(run, rows, &mut sums);
            }
        },
    );
    sums.as_flattened().iter().fold(0.0f64, |m, x| m.max(x.abs()))
}
