//! The patch's two problems in one matrix: A y = lambda y, A = R^-1 M R^-1 with R = (S / area)^1/2, in elimination order.

use super::order::{elimination_order, inner_first};
use crate::laplacian::Operator;

/// A of the Neumann problem; that of the Dirichlet problem is its leading block.
pub(super) struct Doubled {
    /// Order of the Dirichlet problem: the number of inner vertices.
    pub interior: usize,
    /// The lower triangle by columns, the diagonal first in each.
    pub starts: Vec<usize>,
    pub rows: Vec<usize>,
    /// The pattern of the upper triangle by columns, the diagonal last in each.
    pub upper_starts: Vec<usize>,
    pub upper_rows: Vec<usize>,
    entries: Vec<f64>,
    /// The diagonal of R: the Neumann problem's null vector, of norm 1.
    pub root: Vec<f64>,
}

impl Doubled {
    /// `interior` lists the inner vertices, ascending. With `fill` the order is one that keeps factors sparse, else any with inner
    /// vertices first. `None` if memory ran out.
    pub fn new(operator: &Operator, interior: &[u32], fill: bool) -> Option<Self> {
        let matrix = &operator.stiffness;
        let n = matrix.n();
        let order = if fill { elimination_order(matrix, interior)? } else { inner_first(n, interior) };
        let mut position = vec![0u32; n];
        for (at, &row) in order.iter().enumerate() {
            position[row as usize] = at as u32;
        }
        let area = operator.area();
        let root: Vec<f64> = order.iter().map(|&row| (operator.mass[row as usize] / area).sqrt()).collect();
        // Half of the entries and the diagonal are in either triangle.
        let half = usize::midpoint(matrix.columns().len(), n);
        let mut problem = Self {
            interior: interior.len(),
            starts: Vec::with_capacity(n + 1),
            rows: Vec::with_capacity(half),
            upper_starts: Vec::with_capacity(n + 1),
            upper_rows: Vec::with_capacity(half),
            entries: Vec::with_capacity(half),
            root,
        };
        problem.starts.push(0);
        problem.upper_starts.push(0);
        let mut column: Vec<(u32, f64)> = Vec::new();
        for at in 0..n {
            column.clear();
            column.extend(matrix.row(order[at] as usize).map(|(j, value)| (position[j], value)));
            column.sort_unstable_by_key(|e| e.0);
            let above = column.partition_point(|e| (e.0 as usize) < at);
            problem.upper_rows.extend(column[..=above].iter().map(|e| e.0 as usize));
            problem.upper_starts.push(problem.upper_rows.len());
            for &(row, value) in &column[above..] {
                problem.rows.push(row as usize);
                problem.entries.push(value / (problem.root[at] * problem.root[row as usize]));
            }
            problem.starts.push(problem.rows.len());
        }
        Some(problem)
    }

    /// Order of the Neumann problem.
    pub fn n(&self) -> usize {
        self.root.len()
    }

    /// The entries of A - shift I.
    pub fn shifted(&self, shift: f64) -> Vec<f64> {
        let mut entries = self.entries.clone();
        for &diagonal in &self.starts[..self.n()] {
            entries[diagonal] -= shift;
        }
        entries
    }

    /// The leading block of A of the given order, in full.
    pub fn dense(&self, order: usize) -> Vec<f64> {
        let mut a = vec![0.0; order * order];
        for j in 0..order {
            for p in self.starts[j]..self.starts[j + 1] {
                let i = self.rows[p];
                if i < order {
                    a[i * order + j] = self.entries[p];
                    a[j * order + i] = self.entries[p];
                }
            }
        }
        a
    }

    /// y'Ay / y'y from differences along edges: smooth vectors lose no digits to the cancellation in rows. A Dirichlet vector is zero on
    /// the boundary.
    pub fn rayleigh_quotient(&self, y: &[f64]) -> f64 {
        let v: Vec<f64> = y.iter().zip(&self.root).map(|(y, r)| y / r).collect();
        let mut energy = 0.0;
        for j in 0..self.n() {
            for p in self.starts[j] + 1..self.starts[j + 1] {
                let i = self.rows[p];
                energy -= self.entries[p] * self.root[i] * self.root[j] * (v[i] - v[j]) * (v[i] - v[j]);
            }
        }
        energy / y.iter().map(|y| y * y).sum::<f64>()
    }

    /// The Frobenius norm of A.
    pub fn norm(&self) -> f64 {
        let mut sum = 0.0;
        for j in 0..self.n() {
            let column = &self.entries[self.starts[j]..self.starts[j + 1]];
            sum += 2.0 * column.iter().map(|x| x * x).sum::<f64>() - column[0] * column[0];
        }
        sum.sqrt()
    }

    /// What the Dirichlet matrix makes of the leading part of the null vector: minus the pull of the boundary, without cancellation.
    pub fn boundary_pull(&self) -> Vec<f64> {
        let mut pull = vec![0.0; self.interior];
        for (j, pull) in pull.iter_mut().enumerate() {
            for p in self.starts[j]..self.starts[j + 1] {
                if self.rows[p] >= self.interior {
                    *pull -= self.entries[p] * self.root[self.rows[p]];
                }
            }
        }
        pull
    }
}
