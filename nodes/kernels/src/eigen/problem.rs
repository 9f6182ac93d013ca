//! The scaled problem A y = lambda y, A = R^-1 M R^-1 with R = (S / area)^1/2, whose eigenvalues are the original ones times the area.

use super::EigenError;
use crate::sparse::SymmetricCsr;
use faer::MatMut;
use faer::prelude::Reborrow;

/// The known null space: one indicator per connected component.
pub(crate) struct Kernel {
    labels: Vec<u32>,
    count: usize,
}

impl Kernel {
    /// The null space of a Laplacian; an error if a row does not sum to zero.
    pub(crate) fn of_components(stiffness: &SymmetricCsr) -> Result<Self, EigenError> {
        for i in 0..stiffness.n() {
            let magnitude: f64 = stiffness.row(i).map(|e| e.1.abs()).sum();
            if !magnitude.is_finite() {
                return Err(EigenError::NotFinite { vertex: i });
            }
            if stiffness.row_sum(i).abs() > 1e-12 * magnitude {
                return Err(EigenError::NotLaplacian { vertex: i });
            }
        }
        let (count, labels) = stiffness.components();
        Ok(Self { labels, count })
    }
}

pub(crate) struct Problem<'a> {
    pub(super) stiffness: &'a SymmetricCsr,
    pub(super) mass: &'a [f64],
    pub(super) area: f64,
    /// The diagonal of R.
    pub(super) root: Vec<f64>,
    pub(super) kernel: Option<Kernel>,
    /// Square roots of the components' shares of the area.
    component_roots: Vec<f64>,
    /// Row sums of M: zero with a kernel, the pull towards the fixed boundary otherwise.
    row_sums: Vec<f64>,
}

impl<'a> Problem<'a> {
    /// A symmetric stiffness matrix and as many positive masses. Without a kernel the matrix must be positive definite.
    pub(crate) fn new(
        stiffness: &'a SymmetricCsr,
        mass: &'a [f64],
        kernel: Option<Kernel>,
    ) -> Result<Self, EigenError> {
        if let Some(vertex) = mass.iter().position(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(EigenError::NotFinite { vertex });
        }
        let area: f64 = mass.iter().sum();
        let root: Vec<f64> = mass.iter().map(|s| (s / area).sqrt()).collect();
        let mut shares = vec![0.0; kernel.as_ref().map_or(0, |k| k.count)];
        let mut row_sums = vec![0.0; mass.len()];
        match &kernel {
            Some(kernel) => {
                for (&label, r) in kernel.labels.iter().zip(&root) {
                    shares[label as usize] += r * r;
                }
            }
            None => row_sums = (0..mass.len()).map(|i| stiffness.row_sum(i)).collect(),
        }
        let component_roots = shares.iter().map(|s: &f64| s.sqrt()).collect();
        Ok(Self { stiffness, mass, area, root, kernel, component_roots, row_sums })
    }

    pub(super) fn n(&self) -> usize {
        self.mass.len()
    }

    /// The dimension of the known null space.
    pub(super) fn nullity(&self) -> usize {
        self.component_roots.len()
    }

    /// Unit vector of a component, at a vertex: nonzero only inside the component.
    pub(super) fn null_entry(&self, vertex: usize) -> Option<(usize, f64)> {
        let label = self.kernel.as_ref()?.labels[vertex] as usize;
        Some((label, self.root[vertex] / self.component_roots[label]))
    }

    /// Removes the null space from every column.
    pub(super) fn project_out_kernel(&self, columns: MatMut<'_, f64>) {
        if self.kernel.is_none() {
            return;
        }
        let mut along = vec![0.0; self.nullity()];
        for column in columns.col_iter_mut() {
            along.fill(0.0);
            for (i, x) in column.rb().iter().enumerate() {
                if let Some((label, unit)) = self.null_entry(i) {
                    along[label] += unit * x;
                }
            }
            for (i, x) in column.iter_mut().enumerate() {
                if let Some((label, unit)) = self.null_entry(i) {
                    *x -= unit * along[label];
                }
            }
        }
    }

    /// Column indices, row by row, and the entries of A in the same order.
    pub(super) fn scaled_entries(&self) -> Vec<f64> {
        let mut values = Vec::with_capacity(self.stiffness.values().len());
        for i in 0..self.n() {
            values.extend(self.stiffness.row(i).map(|(j, m)| m / (self.root[i] * self.root[j])));
        }
        values
    }

    /// M v, from differences of neighbouring values: smooth vectors lose no digits to the cancellation in rows that sum to zero.
    fn apply_stiffness(&self, v: &[f64], row: usize) -> f64 {
        let differences: f64 = self.stiffness.row(row).map(|(j, m)| -m * (v[row] - v[j])).sum();
        differences + self.row_sums[row] * v[row]
    }

    /// The Rayleigh quotient of y as v = R^-1 y, i.e. an eigenvalue of A.
    pub(super) fn rayleigh_quotient(&self, v: &[f64]) -> f64 {
        let mut energy = 0.0;
        let mut norm = 0.0;
        for i in 0..self.n() {
            let edges: f64 = self.stiffness.row(i).map(|(j, m)| -m * (v[i] - v[j]) * (v[i] - v[j])).sum();
            energy += 0.5 * edges + self.row_sums[i] * v[i] * v[i];
            norm += (self.root[i] * v[i]).powi(2);
        }
        energy / norm
    }

    /// The norm of A y - lambda y, y = R v of unit norm, and what rounding alone may make it.
    pub(super) fn residual(&self, lambda: f64, v: &[f64]) -> (f64, f64) {
        let (mut norm, mut rounding) = (0.0, 0.0);
        for i in 0..self.n() {
            let r = self.root[i];
            let residual = (self.apply_stiffness(v, i) - lambda * r * r * v[i]) / r;
            let magnitude = self.stiffness.row(i).map(|(j, m)| (m * v[j]).abs()).sum::<f64>() / r;
            norm += residual * residual;
            rounding += magnitude * magnitude;
        }
        (norm.sqrt(), f64::EPSILON * rounding.sqrt())
    }
}
