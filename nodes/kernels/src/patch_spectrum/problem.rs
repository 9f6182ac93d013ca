//! The patch's two problems: A y = lambda y, A = R^-1 M R^-1 with R = (S / area)^1/2, in elimination order.

use super::order::{Elimination, NONE, positions};
use crate::laplacian::Operator;

/// A of one problem: of all vertices (Neumann), or of the inner ones, the others being held at zero (Dirichlet).
pub(super) struct Problem {
    /// Whether all vertices are in it, so that `root` is the null vector, of norm 1.
    pub has_null: bool,
    pub diagonal: Vec<f64>,
    /// Below the diagonal by columns, in no order.
    pub starts: Vec<u32>,
    pub rows: Vec<u32>,
    pub entries: Vec<f64>,
    /// The diagonal of R.
    pub root: Vec<f64>,
    /// A times `root`: minus what the vertices left out pull, without cancellation.
    pub pull: Vec<f64>,
    /// The elimination tree and the counts of the factor's columns; of no use where [`Problem::in_any_order`] made it.
    pub parents: Vec<u32>,
    pub counts: Vec<u32>,
}

/// The problems of a patch: one, or with inner vertices and others two.
pub(super) fn problems(operator: &Operator, on_rim: &[bool]) -> Option<Vec<Problem>> {
    let all = Elimination::minimum_degree(&operator.stiffness)?;
    let inner = has_both(on_rim).then(|| all.without(&operator.stiffness, on_rim));
    Some(std::iter::once(all).chain(inner).map(|elimination| Problem::new(operator, elimination)).collect())
}

fn has_both(on_rim: &[bool]) -> bool {
    on_rim.contains(&true) && on_rim.contains(&false)
}

impl Problem {
    /// The same problems, for dense solvers.
    pub fn in_any_order(operator: &Operator, on_rim: &[bool]) -> Vec<Self> {
        let plain = |order| Self::new(operator, Elimination { order, parents: Vec::new(), counts: Vec::new() });
        let all = (0..on_rim.len() as u32).collect();
        let inner = has_both(on_rim).then(|| (0..on_rim.len() as u32).filter(|&v| !on_rim[v as usize]).collect());
        std::iter::once(all).chain(inner).map(plain).collect()
    }

    fn new(operator: &Operator, elimination: Elimination) -> Self {
        let (matrix, Elimination { order, parents, counts }) = (&operator.stiffness, elimination);
        let n = order.len();
        let (position, area) = (positions(matrix.n(), &order), operator.area());
        let root_of = |row: usize| (operator.mass[row] / area).sqrt();
        let roots: Vec<f64> = (0..matrix.n()).map(root_of).collect();
        let half = (matrix.columns().len() - matrix.n()) / 2;
        let mut problem = Self {
            has_null: n == matrix.n(),
            diagonal: Vec::with_capacity(n),
            starts: Vec::with_capacity(n + 1),
            rows: Vec::with_capacity(half),
            entries: Vec::with_capacity(half),
            root: order.iter().map(|&row| roots[row as usize]).collect(),
            pull: Vec::with_capacity(n),
            parents,
            counts,
        };
        problem.starts.push(0);
        for (at, &row) in order.iter().enumerate() {
            let (own, mut pull) = (roots[row as usize], 0.0);
            for (column, value) in matrix.row(row as usize) {
                let (other, to) = (roots[column], position[column]);
                if to == NONE {
                    pull -= value / own;
                } else if to as usize == at {
                    problem.diagonal.push(value / (own * own));
                } else if to as usize > at {
                    problem.rows.push(to);
                    problem.entries.push(value / (own * other));
                }
            }
            problem.pull.push(pull);
            problem.starts.push(problem.rows.len() as u32);
        }
        problem
    }

    /// The order of A.
    pub fn n(&self) -> usize {
        self.root.len()
    }

    /// Column j below the diagonal: row and entry.
    #[inline(always)]
    fn column(&self, j: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.starts[j] as usize..self.starts[j + 1] as usize;
        self.rows[range.clone()].iter().map(|&i| i as usize).zip(self.entries[range].iter().copied())
    }

    /// A in full.
    pub fn dense(&self) -> Vec<f64> {
        let n = self.n();
        let mut a = vec![0.0; n * n];
        for j in 0..n {
            a[j * n + j] = self.diagonal[j];
            for (i, entry) in self.column(j) {
                a[i * n + j] = entry;
                a[j * n + i] = entry;
            }
        }
        a
    }

    /// y'Ay / y'y from differences along edges: smooth vectors lose no digits to the cancellation in rows.
    pub fn rayleigh_quotient(&self, y: &[f64]) -> f64 {
        let v: Vec<f64> = y.iter().zip(&self.root).map(|(y, r)| y / r).collect();
        let mut energy = 0.0;
        for j in 0..self.n() {
            // To the vertices left out, where it is zero.
            energy += self.pull[j] * self.root[j] * v[j] * v[j];
            for (i, entry) in self.column(j) {
                energy -= entry * self.root[i] * self.root[j] * (v[i] - v[j]) * (v[i] - v[j]);
            }
        }
        energy / y.iter().map(|y| y * y).sum::<f64>()
    }

    /// The Frobenius norm of A.
    pub fn norm(&self) -> f64 {
        let squares = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
        (squares(&self.diagonal) + 2.0 * squares(&self.entries)).sqrt()
    }
}
