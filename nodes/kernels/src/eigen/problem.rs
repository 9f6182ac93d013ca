//! The scaled problem A y = lambda y, A = R^-1 M R^-1 with R = (S / area)^1/2, whose eigenvalues are the original ones times the area.

use super::EigenError;
use super::basis::Null;
use crate::laplacian::Operator;
use crate::sparse::SymmetricCsr;
use faer::MatMut;
use faer::prelude::Reborrow;

pub(crate) struct Problem<'a> {
    pub(super) stiffness: &'a SymmetricCsr,
    pub(super) mass: &'a [f64],
    pub(super) area: f64,
    /// The diagonal of R.
    pub(super) root: Vec<f64>,
    /// Rows of M that do not sum to exactly zero, and their sums.
    pub(super) uneven: Vec<(usize, f64)>,
    /// The connected component of each vertex: their indicators span the null space.
    labels: Vec<u32>,
    /// Square roots of the components' shares of the area.
    component_roots: Vec<f64>,
}

/// What the problem is scaled by, and what was found when its entries were checked.
pub(super) struct Scale {
    area: f64,
    root: Vec<f64>,
    uneven: Vec<(usize, f64)>,
}

impl Scale {
    /// Of a symmetric stiffness matrix whose rows sum to zero, and as many positive masses.
    pub fn new(stiffness: &SymmetricCsr, mass: &[f64]) -> Result<Self, EigenError> {
        let mut uneven = Vec::new();
        for vertex in 0..stiffness.n() {
            let magnitude: f64 = stiffness.row(vertex).map(|e| e.1.abs()).sum();
            if !magnitude.is_finite() {
                return Err(EigenError::NotFinite { vertex });
            }
            let sum = stiffness.row_sum(vertex);
            if sum.abs() > 1e-12 * magnitude {
                return Err(EigenError::NotLaplacian { vertex });
            }
            if sum.abs() > 0.0 {
                uneven.push((vertex, sum));
            }
        }
        if let Some(vertex) = mass.iter().position(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(EigenError::NotFinite { vertex });
        }
        let area: f64 = mass.iter().sum();
        let root = mass.iter().map(|s| (s / area).sqrt()).collect();
        Ok(Self { area, root, uneven })
    }
}

impl<'a> Problem<'a> {
    /// The number of components, and that of each vertex, are those of the stiffness matrix.
    pub(super) fn new(operator: &'a Operator, scale: Scale, (components, labels): (usize, Vec<u32>)) -> Self {
        let Scale { area, root, uneven } = scale;
        let mut shares = vec![0.0f64; components];
        for (&label, r) in labels.iter().zip(&root) {
            shares[label as usize] += r * r;
        }
        let component_roots = shares.into_iter().map(f64::sqrt).collect();
        let Operator { stiffness, mass, .. } = operator;
        Self { stiffness, mass, area, root, uneven, labels, component_roots }
    }

    #[cfg(test)]
    pub(super) fn of(operator: &'a Operator) -> Self {
        let scale = Scale::new(&operator.stiffness, &operator.mass).expect("a Laplacian");
        Self::new(operator, scale, operator.stiffness.components())
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
}
