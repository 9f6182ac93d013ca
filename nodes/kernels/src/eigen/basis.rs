//! The growing Krylov basis, and the passes over it.
//!
//! The basis is stored in runs of [`RUN`] vertices, and inside a run panel after panel: a pass reads memory from end to end while the eight
//! vectors worked on stay in the cache. The two passes that orthogonalise against the whole basis are bound by memory bandwidth.

use super::EigenError;
use super::panel::{Block, Row, Rows, Simd, WIDTH, ZERO, add_gram, multiply_right, subtract_product};
use super::vectors::Store;
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

/// Vertices per run: a panel of it is 16 KiB, a third of a first-level cache.
pub(super) const RUN: usize = 256;

/// Known null vectors in elimination order: label and entry of the unit indicator at each row.
pub(super) struct Null {
    pub labels: Vec<u32>,
    pub units: Vec<f64>,
    pub count: usize,
}

impl Null {
    #[inline(always)]
    fn rows(&self, run: usize) -> impl Iterator<Item = (&u32, &f64)> {
        let begin = (run * RUN).min(self.labels.len());
        let end = (begin + RUN).min(self.labels.len());
        self.labels[begin..end].iter().zip(&self.units[begin..end])
    }
}

/// Orthonormal panels, orthogonal to the null vectors.
pub(super) struct Basis<'a> {
    rows: Rows,
    runs: usize,
    /// Panels there is room for, and those in use.
    capacity: usize,
    count: usize,
    null: &'a Null,
    simd: Simd,
}

/// Products of the basis and of the null vectors with a panel.
pub(super) struct Along {
    basis: Vec<Block>,
    null: Vec<Row>,
}

/// Rows of a panel that the passes over a basis of n vertices work on: whole runs, zeros at the end.
pub(super) fn padded(n: usize) -> usize {
    n.div_ceil(RUN) * RUN
}

impl<'a> Basis<'a> {
    pub fn new(n: usize, capacity: usize, null: &'a Null) -> Result<Self, EigenError> {
        let runs = n.div_ceil(RUN);
        let rows = Rows::zeroed(runs * capacity * RUN).map_err(|_| EigenError::Memory)?;
        Ok(Self { rows, runs, capacity, count: 0, null, simd: Simd::new() })
    }

    pub fn count(&self) -> usize {
        self.count
    }

    /// The panels of one run, those in use.
    #[inline(always)]
    fn run(&self, run: usize) -> &[[Row; RUN]] {
        let (runs, _) = self.rows.as_slice().as_chunks::<RUN>();
        &runs[run * self.capacity..run * self.capacity + self.count]
    }

    /// Copies panel j.
    pub fn copy(&self, j: usize, to: &mut [Row]) {
        for (run, target) in to.as_chunks_mut::<RUN>().0.iter_mut().enumerate() {
            *target = self.run(run)[j];
        }
    }

    /// w -= V_(j-1) b' for the last panel j; then V_j' w.
    pub fn local(&self, w: &mut [Row], before: Option<&Block>) -> Block {
        let mut diagonal = ZERO;
        self.simd.run(
            #[inline(always)]
            || {
                for (run, w) in w.as_chunks_mut::<RUN>().0.iter_mut().enumerate() {
                    let panels = self.run(run);
                    if let Some(b) = before {
                        subtract_product(w, &panels[self.count - 2], b);
                    }
                    add_gram(&mut diagonal, &panels[self.count - 1], w);
                }
            },
        );
        diagonal
    }

    /// w -= V_j a for the last panel j, if given; then the products with everything known.
    pub fn along(&self, w: &mut [Row], diagonal: Option<&Block>) -> Along {
        let mut basis = vec![ZERO; self.count];
        let mut null = vec![[0.0; WIDTH]; self.null.count];
        self.simd.run(
            #[inline(always)]
            || {
                for (run, w) in w.as_chunks_mut::<RUN>().0.iter_mut().enumerate() {
                    let panels = self.run(run);
                    if let Some(a) = diagonal {
                        subtract_product(w, &panels[self.count - 1], a);
                    }
                    for ((&label, &unit), y) in self.null.rows(run).zip(w.iter()) {
                        let sum = &mut null[label as usize];
                        for q in 0..WIDTH {
                            sum[q] = unit.mul_add(y[q], sum[q]);
                        }
                    }
                    for (h, panel) in basis.iter_mut().zip(panels) {
                        add_gram(h, panel, w);
                    }
                }
            },
        );
        Along { basis, null }
    }

    /// Removes what [`Self::along`] found; returns w' w.
    pub fn remove(&self, w: &mut [Row], along: &Along) -> Block {
        let mut gram = ZERO;
        self.simd.run(
            #[inline(always)]
            || {
                for (run, w) in w.as_chunks_mut::<RUN>().0.iter_mut().enumerate() {
                    for ((&label, &unit), y) in self.null.rows(run).zip(w.iter_mut()) {
                        let part = &along.null[label as usize];
                        for q in 0..WIDTH {
                            y[q] = (-unit).mul_add(part[q], y[q]);
                        }
                    }
                    for (h, panel) in along.basis.iter().zip(self.run(run)) {
                        subtract_product(w, panel, h);
                    }
                    add_gram(&mut gram, w, w);
                }
            },
        );
        gram
    }

    /// w <- w h; returns the new w' w.
    pub fn multiply(&self, w: &mut [Row], h: &Block) -> Block {
        let mut gram = ZERO;
        self.simd.run(
            #[inline(always)]
            || {
                for w in w.as_chunks_mut::<RUN>().0 {
                    multiply_right(w, h);
                    add_gram(&mut gram, w, w);
                }
            },
        );
        gram
    }

    /// Appends the panel w h.
    pub fn append(&mut self, w: &mut [Row], h: &Block) -> Result<(), EigenError> {
        if self.count == self.capacity {
            self.grow()?;
        }
        let (capacity, count) = (self.capacity, self.count);
        let (panels, _) = self.rows.as_mut_slice().as_chunks_mut::<RUN>();
        self.simd.run(
            #[inline(always)]
            || {
                for (run, w) in w.as_chunks_mut::<RUN>().0.iter_mut().enumerate() {
                    multiply_right(w, h);
                    panels[run * capacity + count] = *w;
                }
            },
        );
        self.count += 1;
        Ok(())
    }

    fn grow(&mut self) -> Result<(), EigenError> {
        let capacity = self.capacity + self.capacity / 4 + 4;
        let mut rows = Rows::zeroed(self.runs * capacity * RUN).map_err(|_| EigenError::Memory)?;
        let (old, _) = self.rows.as_slice().as_chunks::<RUN>();
        let (new, _) = rows.as_mut_slice().as_chunks_mut::<RUN>();
        for run in 0..self.runs {
            new[run * capacity..][..self.count].copy_from_slice(&old[run * self.capacity..][..self.count]);
        }
        (self.rows, self.capacity) = (rows, capacity);
        Ok(())
    }

    /// V c; c has eight rows per panel.
    pub fn combine(&self, c: MatRef<'_, f64>) -> Result<Store, EigenError> {
        let (m, columns) = (self.count * WIDTH, c.ncols());
        let mut store = Store::zeroed(self.runs * RUN, columns)?;
        let mut rows = vec![0.0; RUN * m];
        for run in 0..self.runs {
            for (p, panel) in self.run(run).iter().enumerate() {
                for (row, x) in rows.chunks_exact_mut(m).zip(panel) {
                    row[p * WIDTH..(p + 1) * WIDTH].copy_from_slice(x);
                }
            }
            let left = MatRef::from_row_major_slice(&rows, RUN, m);
            let target = MatMut::from_column_major_slice_mut(store.run_mut(run), RUN, columns);
            matmul(target, Accum::Replace, left, c, 1.0, Par::Seq);
        }
        Ok(store)
    }
}
