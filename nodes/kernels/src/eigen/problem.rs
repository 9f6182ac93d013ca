//! The scaled problem A y = lambda y, A = R^-1 M R^-1 with R = (S / area)^1/2, whose eigenvalues are the original ones times the area.

use super::EigenError;
use super::basis::Null;
use super::panel::{Row, WIDTH};
use crate::simd::vectorised;
use crate::sparse::SymmetricCsr;
use faer::MatMut;
use faer::prelude::Reborrow;

/// A residual this many times what rounding the entries of M may cause is as small as it can be.
const ROUNDING: f64 = 16.0;

pub(crate) struct Problem<'a> {
    pub(super) stiffness: &'a SymmetricCsr,
    pub(super) mass: &'a [f64],
    pub(super) area: f64,
    /// The diagonal of R.
    pub(super) root: Vec<f64>,
    /// The connected component of each vertex: their indicators span the null space.
    labels: Vec<u32>,
    /// Square roots of the components' shares of the area.
    component_roots: Vec<f64>,
}

impl<'a> Problem<'a> {
    /// A symmetric stiffness matrix whose rows sum to zero, and as many positive masses.
    pub(crate) fn new(stiffness: &'a SymmetricCsr, mass: &'a [f64]) -> Result<Self, EigenError> {
        for vertex in 0..stiffness.n() {
            let magnitude: f64 = stiffness.row(vertex).map(|e| e.1.abs()).sum();
            if !magnitude.is_finite() {
                return Err(EigenError::NotFinite { vertex });
            }
            if stiffness.row_sum(vertex).abs() > 1e-12 * magnitude {
                return Err(EigenError::NotLaplacian { vertex });
            }
        }
        if let Some(vertex) = mass.iter().position(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(EigenError::NotFinite { vertex });
        }
        let area: f64 = mass.iter().sum();
        let root: Vec<f64> = mass.iter().map(|s| (s / area).sqrt()).collect();
        let (components, labels) = stiffness.components();
        let mut shares = vec![0.0f64; components];
        for (&label, r) in labels.iter().zip(&root) {
            shares[label as usize] += r * r;
        }
        let component_roots = shares.into_iter().map(f64::sqrt).collect();
        Ok(Self { stiffness, mass, area, root, labels, component_roots })
    }

    pub(super) fn n(&self) -> usize {
        self.mass.len()
    }

    /// The dimension of the null space: the number of components.
    pub(super) fn nullity(&self) -> usize {
        self.component_roots.len()
    }

    /// Unit vector of a component, at a vertex: nonzero only inside the component.
    pub(super) fn null_entry(&self, vertex: usize) -> (usize, f64) {
        let label = self.labels[vertex] as usize;
        (label, self.root[vertex] / self.component_roots[label])
    }

    /// The null space by rows in elimination order.
    pub(super) fn null(&self, order: &[u32]) -> Null {
        let entry = |v: &u32| {
            let (label, unit) = self.null_entry(*v as usize);
            (label as u32, unit)
        };
        let (labels, units) = order.iter().map(entry).unzip();
        Null { labels, units, count: self.nullity() }
    }

    /// Removes the null space from every column.
    pub(super) fn project_out_kernel(&self, columns: MatMut<'_, f64>) {
        let mut along = vec![0.0; self.nullity()];
        for column in columns.col_iter_mut() {
            along.fill(0.0);
            for (i, x) in column.rb().iter().enumerate() {
                let (label, unit) = self.null_entry(i);
                along[label] += unit * x;
            }
            for (i, x) in column.iter_mut().enumerate() {
                let (label, unit) = self.null_entry(i);
                *x -= unit * along[label];
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
    pub(super) fn examine(&self, v: &[Row]) -> Quality {
        vectorised(
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
                energy[q] += 0.5 * edges[q];
                norm[q] += (r * x[q]) * (r * x[q]);
            }
        }
        std::array::from_fn(|q| energy[q] / norm[q])
    }

    /// A y - lambda y for eight approximate eigenvectors v = R^-1 y, at the vertices in this order.
    pub(super) fn residual_rows(&self, lambda: &Row, v: &[Row], order: &[u32]) -> Vec<Row> {
        vectorised(
            #[inline(always)]
            || order.iter().map(|&vertex| self.residual(lambda, v, vertex as usize).0).collect(),
        )
    }

    /// Row i of A y - lambda y, and of |A| |y|.
    #[inline(always)]
    fn residual(&self, lambda: &Row, v: &[Row], i: usize) -> (Row, Row) {
        let (mut product, mut magnitude) = ([0.0; WIDTH], [0.0; WIDTH]);
        for (j, m) in self.stiffness.row(i) {
            for q in 0..WIDTH {
                product[q] = (-m).mul_add(v[i][q] - v[j][q], product[q]);
                magnitude[q] += (m * v[j][q]).abs();
            }
        }
        let r = self.root[i];
        let residual = |q: usize| (product[q] - lambda[q] * r * r * v[i][q]) / r;
        (std::array::from_fn(residual), magnitude.map(|x| x / r))
    }

    /// The norms of A y - lambda y, and what rounding alone may make them.
    #[inline(always)]
    fn residuals(&self, lambda: &Row, v: &[Row]) -> (Row, Row) {
        let (mut norm, mut rounding) = ([0.0; WIDTH], [0.0; WIDTH]);
        for i in 0..v.len() {
            let (residual, magnitude) = self.residual(lambda, v, i);
            for q in 0..WIDTH {
                norm[q] = residual[q].mul_add(residual[q], norm[q]);
                rounding[q] = magnitude[q].mul_add(magnitude[q], rounding[q]);
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

impl Quality {
    /// Whether vector q is a positive pair's to this relative tolerance, or as far as rounding allows.
    pub fn is_fine(&self, q: usize, tolerance: f64) -> bool {
        let (value, residual) = (self.values[q], self.residuals[q]);
        value > 0.0 && residual <= (tolerance * value).max(ROUNDING * self.rounding[q]) && residual.is_finite()
    }
}
