//! Sparse LDL' factorisations of A - shift I by fronts (Duff & Reid 1983), for the eigensolver and for patch spectra.
//!
//! A is ordered by minimum degree. Columns of the factor with nearly the same pattern are supernodes; each is eliminated in a dense matrix, its
//! front. Nothing is pivoted. What a front leaves behind waits on a stack until the parent's front takes it up; what it has
//! eliminated goes to a [`Keep`], in whatever layout solves want, or nowhere if only the inertia is asked for.

mod dense;
mod fronts;
mod order;
mod symbolic;

pub(crate) use fronts::{Eliminated, Fronts, Keep};
pub(crate) use order::{Elimination, NONE};
pub(crate) use symbolic::{Supernode, Symbolic};

use crate::sparse::SymmetricCsr;

/// A symmetric matrix in elimination order: the diagonal, and below it columns, their rows in no order.
#[derive(Default)]
pub(crate) struct Lower {
    pub diagonal: Vec<f64>,
    pub starts: Vec<u32>,
    pub rows: Vec<u32>,
    pub entries: Vec<f64>,
}

impl Lower {
    /// The rows and columns of `matrix` that are in the order, divided by `roots` from both sides.
    pub fn scaled(matrix: &SymmetricCsr, elimination: &Elimination, roots: &[f64]) -> Self {
        let n = elimination.order.len();
        let half = matrix.columns().len().saturating_sub(matrix.n()) / 2;
        let mut lower = Self {
            diagonal: Vec::with_capacity(n),
            starts: Vec::with_capacity(n + 1),
            rows: Vec::with_capacity(half),
            entries: Vec::with_capacity(half),
        };
        lower.starts.push(0);
        for (at, &row) in elimination.order.iter().enumerate() {
            let own = roots[row as usize];
            for (column, value) in matrix.row(row as usize) {
                let to = elimination.position[column];
                if to as usize == at {
                    lower.diagonal.push(value / (own * own));
                } else if to != NONE && to as usize > at {
                    lower.rows.push(to);
                    lower.entries.push(value / (own * roots[column]));
                }
            }
            lower.starts.push(lower.rows.len() as u32);
        }
        lower
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
