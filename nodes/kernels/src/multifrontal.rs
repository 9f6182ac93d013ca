//! Sparse LDL' factorisations of A - shift I by fronts (Duff & Reid 1983), for the eigensolver and for patch spectra.
//!
//! A is ordered by minimum degree. Columns of the factor with nearly the same pattern are supernodes; each is eliminated in a dense matrix, its
//! front. Nothing is pivoted. What a front leaves behind waits on a stack until the parent's front takes it up; what it has
//! eliminated goes to a [`Keep`], in whatever layout solves want, or nowhere if only the inertia is asked for.

mod dense;
mod fronts;
mod order;
mod symbolic;

pub(crate) use fronts::{Branch, Eliminated, Fronts, Keep, Shifted};
pub(crate) use order::{Elimination, NONE};
pub(crate) use symbolic::{Supernode, Symbolic};

use crate::sparse::SymmetricCsr;

/// A symmetric matrix in elimination order: the diagonal, and below it columns, their rows ascending.
pub(crate) struct Lower {
    pub diagonal: Vec<f64>,
    pub starts: Vec<u32>,
    pub rows: Vec<u32>,
    pub entries: Vec<f64>,
}

impl Lower {
    /// The rows and columns of `matrix` that are in the order, divided by `roots` from both sides, which are in the order too.
    pub fn scaled(matrix: &SymmetricCsr, elimination: &Elimination, roots: &[f64]) -> Self {
        let (places, values) = (&elimination.entries, matrix.values());
        let mut entries = Vec::with_capacity(places.rows.len());
        for (j, own) in roots.iter().enumerate() {
            let column = places.rows[places.column(j)].iter().zip(&places.sources[places.column(j)]);
            entries.extend(column.map(|(&i, &source)| values[source as usize] / (own * roots[i as usize])));
        }
        let diagonal = places.diagonal.iter().zip(roots).map(|(&source, own)| values[source as usize] / (own * own));
        Self { diagonal: diagonal.collect(), starts: places.column_starts.clone(), rows: places.rows.clone(), entries }
    }

    /// The order of the matrix.
    pub fn n(&self) -> usize {
        self.diagonal.len()
    }

    /// Column j below the diagonal: row and entry.
    #[inline(always)]
    pub fn column(&self, j: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.starts[j] as usize..self.starts[j + 1] as usize;
        self.rows[range.clone()].iter().map(|&i| i as usize).zip(self.entries[range].iter().copied())
    }
}
