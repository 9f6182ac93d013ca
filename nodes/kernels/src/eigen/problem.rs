//! The scaled problem A y = lambda y, A = R^-1 M R^-1 with R = (S / area)^1/2, whose eigenvalues are the original ones times the area.

use super::EigenError;
use super::basis::Null;
use super::panel::{Row, Simd, WIDTH};
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

    /// The null space by rows in elimination order.
    pub(super) fn null(&self, order: &[u32]) -> Null {
        let entry = |v: &u32| self.null_entry(*v as usize);
        let (labels, units) = order.iter().filter_map(entry).map(|(label, unit)| (label as u32, unit)).unzip();
        Null { labels, units, count: self.nullity() }
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

    /// How good eight approximate eigenvectors v = R^-1 y of unit norm in y are.
    pub(super) fn examine(&self, simd: Simd, v: &[Row]) -> Quality {
        simd.run(
            #[inline(always)]
            || {
                let values = self.rayleigh_quotients(v);
                let (residuals, rounding) = self.residuals(&values, v);
                Quality { values, residuals, rounding }
            },
        )
    }

    /// Rayleigh quotients, i.e. eigenvalues of A, from differences of neighbouring values: smooth vectors lose no digits to the
    /// cancellation in rows that sum to zero.
    #[inline(always)]
    fn rayleigh_quotients(&self, v: &[Row]) -> Row {
        let (mut energy, mut norm) = ([0.0; WIDTH], [0.0; WIDTH]);
        for (i, x) in v.iter().enumerate() {
            let mut edges = [0.0; WIDTH];
            for (j, m) in self.stiffness.row(i) {
                for q in 0..WIDTH {
                    let difference = x[q] - v[j][q];
                    edges[q] = (-m * difference).mul_add(difference, edges[q]);
                }
            }
            let r = self.root[i];
            for q in 0..WIDTH {
                energy[q] += (self.row_sums[i] * x[q]).mul_add(x[q], 0.5 * edges[q]);
                norm[q] += (r * x[q]) * (r * x[q]);
            }
        }
        std::array::from_fn(|q| energy[q] / norm[q])
    }

    /// The norms of A y - lambda y, and what rounding alone may make them.
    #[inline(always)]
    fn residuals(&self, lambda: &Row, v: &[Row]) -> (Row, Row) {
        let (mut norm, mut rounding) = ([0.0; WIDTH], [0.0; WIDTH]);
        for (i, x) in v.iter().enumerate() {
            let (mut product, mut magnitude) = ([0.0; WIDTH], [0.0; WIDTH]);
            for (j, m) in self.stiffness.row(i) {
                for q in 0..WIDTH {
                    product[q] = (-m).mul_add(x[q] - v[j][q], product[q]);
                    magnitude[q] += (m * v[j][q]).abs();
                }
            }
            let r = self.root[i];
            for q in 0..WIDTH {
                let residual = (product[q] + self.row_sums[i] * x[q] - lambda[q] * r * r * x[q]) / r;
                let magnitude = magnitude[q] / r;
                norm[q] = residual.mul_add(residual, norm[q]);
                rounding[q] = magnitude.mul_add(magnitude, rounding[q]);
            }
        }
        (norm.map(f64::sqrt), rounding.map(|x| f64::EPSILON * x.sqrt()))
    }
}

/// Eigenvalues, residuals and their rounding errors for the vectors of a panel.
pub(super) struct Quality {
    pub values: Row,
    pub residuals: Row,
    pub rounding: Row,
}
