//! The patch's two problems: A y = lambda y, A = R^-1 M R^-1 with R = (S / area)^1/2, in elimination order.

use crate::laplacian::Operator;
use crate::multifrontal::{Elimination, Fronts, Lower, NONE, Shifted, Symbolic};

/// Measured: how far supernodes are merged.
const RELAXED: [(usize, f64); 3] = [(4, 0.5), (16, 0.2), (48, 0.05)];

/// A of one problem: of all vertices (Neumann), or of the inner ones, the others being held at zero (Dirichlet).
pub(super) struct Problem {
    /// Whether all vertices are in it, so that `root` is the null vector, of norm 1.
    pub has_null: bool,
    pub lower: Lower,
    /// Without supernodes where [`Problem::in_any_order`] made it.
    pub symbolic: Symbolic,
    /// The diagonal of R.
    pub root: Vec<f64>,
    /// A times `root`: minus what the vertices left out pull, without cancellation.
    pub pull: Vec<f64>,
}

/// The problems of a patch: one, or with inner vertices and others two.
pub(super) fn problems(operator: &Operator, on_rim: &[bool]) -> Option<Vec<Problem>> {
    let all = Elimination::minimum_degree(&operator.stiffness)?;
    let inner = has_both(on_rim).then(|| all.without(&operator.stiffness, on_rim));
    Some(std::iter::once(all).chain(inner).map(|elimination| Problem::new(operator, &elimination)).collect())
}

fn has_both(on_rim: &[bool]) -> bool {
    on_rim.contains(&true) && on_rim.contains(&false)
}

impl Problem {
    /// The same problems, for dense solvers.
    pub fn in_any_order(operator: &Operator, on_rim: &[bool]) -> Vec<Self> {
        let plain = |order| Self::new(operator, &Elimination::plain(&operator.stiffness, order));
        let all = (0..on_rim.len() as u32).collect();
        let inner = has_both(on_rim).then(|| (0..on_rim.len() as u32).filter(|&v| !on_rim[v as usize]).collect());
        std::iter::once(all).chain(inner).map(plain).collect()
    }

    fn new(operator: &Operator, elimination: &Elimination) -> Self {
        let (matrix, order, area) = (&operator.stiffness, &elimination.order, operator.area());
        let root: Vec<f64> = order.iter().map(|&row| (operator.mass[row as usize] / area).sqrt()).collect();
        let lower = Lower::scaled(matrix, elimination, &root);
        let has_null = order.len() == matrix.n();
        let mut pull = vec![0.0; order.len()];
        if !has_null {
            for ((pull, own), &row) in pull.iter_mut().zip(&root).zip(order) {
                let left_out = matrix.row(row as usize).filter(|e| elimination.position[e.0] == NONE);
                *pull -= left_out.map(|(_, value)| value / own).sum::<f64>();
            }
        }
        let symbolic = Symbolic::new(elimination, &RELAXED);
        Self { has_null, lower, symbolic, root, pull }
    }

    /// The order of A.
    pub fn n(&self) -> usize {
        self.lower.n()
    }

    /// The number of eigenvalues below a shift, or `None` if its factorisation breaks down.
    pub fn count_below(&self, shift: f64, fronts: &mut Fronts) -> Option<usize> {
        fronts.factor(&self.shifted(shift), &mut ())
    }

    /// A - shift I.
    pub fn shifted(&self, shift: f64) -> Shifted<'_> {
        Shifted { symbolic: &self.symbolic, lower: &self.lower, shift }
    }

    /// A in full.
    pub fn dense(&self) -> Vec<f64> {
        let n = self.n();
        let mut a = vec![0.0; n * n];
        for j in 0..n {
            a[j * n + j] = self.lower.diagonal[j];
            for (i, entry) in self.lower.column(j) {
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
            for (i, entry) in self.lower.column(j) {
                energy -= entry * self.root[i] * self.root[j] * (v[i] - v[j]) * (v[i] - v[j]);
            }
        }
        energy / y.iter().map(|y| y * y).sum::<f64>()
    }

    /// The Frobenius norm of A.
    pub fn norm(&self) -> f64 {
        let squares = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
        (squares(&self.lower.diagonal) + 2.0 * squares(&self.lower.entries)).sqrt()
    }
}
