//! Symmetric sparse matrices, both triangles stored, and the graph they carry.

use crate::adjacency::ordered_pairs;
use std::fmt;

/// A symmetric sparse matrix in compressed sparse row form (by symmetry also its compressed column form).
///
/// Both triangles are stored, columns ascend inside a row, and the diagonal is always stored. Entries that happen to be zero stay
/// stored: they are edges of the mesh, and [`SymmetricCsr::components`] relies on them.
#[derive(Clone, Debug, PartialEq)]
pub struct SymmetricCsr {
    offsets: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

/// Why three arrays are not a symmetric matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SparseError {
    /// The arrays' lengths disagree, or the offsets do not ascend from 0 to the number of entries.
    Offsets,
    /// A column index of this row is out of range or not above the one before it.
    Columns {
        /// The offending row.
        row: usize,
    },
    /// The row has no diagonal entry.
    Diagonal {
        /// The offending row.
        row: usize,
    },
    /// An entry is NaN or infinite.
    NonFinite {
        /// The offending row.
        row: usize,
    },
    /// The entry above the diagonal differs from its mirror image, or has none.
    Asymmetric {
        /// The offending row.
        row: usize,
        /// The offending column.
        column: usize,
    },
}

impl fmt::Display for SparseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Offsets => write!(f, "row offsets do not fit the entries"),
            Self::Columns { row } => {
                write!(f, "columns of row {row} are out of range or not ascending")
            }
            Self::Diagonal { row } => write!(f, "row {row} has no diagonal entry"),
            Self::NonFinite { row } => write!(f, "row {row} has an entry that is not finite"),
            Self::Asymmetric { row, column } => {
                write!(f, "entry ({row}, {column}) differs from entry ({column}, {row})")
            }
        }
    }
}

impl std::error::Error for SparseError {}

impl SymmetricCsr {
    /// A matrix from its arrays, as read back from a file: `offsets` has one element more than there are rows.
    pub fn from_parts(offsets: Vec<usize>, columns: Vec<u32>, values: Vec<f64>) -> Result<Self, SparseError> {
        let ascending = offsets.windows(2).all(|w| w[0] <= w[1]);
        let ends = offsets.first() == Some(&0) && offsets.last() == Some(&columns.len());
        if !ascending || !ends || columns.len() != values.len() {
            return Err(SparseError::Offsets);
        }
        let matrix = Self { offsets, columns, values };
        for row in 0..matrix.n() {
            matrix.check_row(row)?;
        }
        // A second pass, because a mirror entry is found by bisection of a row known to ascend.
        for row in 0..matrix.n() {
            for (column, value) in matrix.row(row) {
                if matrix.get(column, row).map(f64::to_bits) != Some(value.to_bits()) {
                    return Err(SparseError::Asymmetric { row, column });
                }
            }
        }
        Ok(matrix)
    }

    fn check_row(&self, row: usize) -> Result<(), SparseError> {
        let range = self.offsets[row]..self.offsets[row + 1];
        let columns = &self.columns[range.clone()];
        if columns.windows(2).any(|w| w[0] >= w[1]) || columns.last().is_some_and(|&c| c as usize >= self.n()) {
            return Err(SparseError::Columns { row });
        }
        if columns.binary_search(&(row as u32)).is_err() {
            return Err(SparseError::Diagonal { row });
        }
        if self.values[range].iter().any(|v| !v.is_finite()) {
            return Err(SparseError::NonFinite { row });
        }
        Ok(())
    }

    /// The Laplacian of a weighted graph, its edges given by ends and weights: off-diagonal -w, diagonal the sum of the row's weights.
    ///
    /// Repeated edges add up, in the order given, on both sides of the diagonal: the result is exactly symmetric. Edges from a
    /// vertex to itself contribute nothing. Vertex indices must be below `n`, edges fewer than 2^32.
    pub(crate) fn graph_laplacian(
        n: usize,
        ends: impl Iterator<Item = (u32, u32)> + Clone,
        edge_weights: &[f64],
    ) -> Self {
        let (starts, mut ordered) = ordered_pairs(n, ends);
        // The sums, ascending by ends, over the pairs already read: entry `place` and what follows up to `above[row]`.
        let mut weights: Vec<f64> = Vec::with_capacity(ordered.len() / 2 + ordered.len() / 8 + 1);
        let (mut above, mut degree) = (vec![0u32; n + 1], vec![1u32; n]);
        for row in 0..n {
            let mut last = u64::MAX;
            for at in starts[row] as usize..starts[row + 1] as usize {
                let (column, weight) = (ordered[at] >> 32, edge_weights[ordered[at] as u32 as usize]);
                if column == last {
                    *weights.last_mut().expect("the group has begun") += weight;
                    continue;
                }
                last = column;
                ordered[weights.len()] = column;
                weights.push(weight);
                degree[row] += 1;
                degree[column as usize] += 1;
            }
            above[row + 1] = weights.len() as u32;
        }
        let mut offsets = vec![0usize; n + 1];
        for row in 0..n {
            offsets[row + 1] = offsets[row] + degree[row] as usize;
        }
        let entries = offsets[n];
        let mut matrix = Self { offsets, columns: vec![0; entries], values: vec![0.0; entries] };
        matrix.fill_laplacian(&ordered, &weights, &above);
        matrix
    }

    /// Row by row: what is below the diagonal came from the rows before, in ascending order; the diagonal and what is above follow.
    fn fill_laplacian(&mut self, columns: &[u64], weights: &[f64], above: &[u32]) {
        let mut next = self.offsets.clone();
        for row in 0..self.n() {
            let middle = next[row];
            // Values are stored from 0.0: no negative zeros.
            for (place, at) in (middle + 1..).zip(above[row] as usize..above[row + 1] as usize) {
                let (column, value) = (columns[at], 0.0 - weights[at]);
                (self.columns[place], self.values[place]) = (column as u32, value);
                let mirror = &mut next[column as usize];
                (self.columns[*mirror], self.values[*mirror]) = (row as u32, value);
                *mirror += 1;
            }
            let (start, end) = (self.offsets[row], self.offsets[row + 1]);
            let below = self.values[start..middle].iter().map(|v| -v);
            let diagonal: f64 = below.chain(self.values[middle + 1..end].iter().map(|v| -v)).sum();
            (self.columns[middle], self.values[middle]) = (row as u32, 0.0 + diagonal);
        }
    }

    /// The number of rows, and of columns.
    #[must_use]
    pub fn n(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Where each row begins in [`Self::columns`] and [`Self::values`]; length n + 1.
    #[must_use]
    pub fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// The column of every entry, row by row, ascending inside a row.
    #[must_use]
    pub fn columns(&self) -> &[u32] {
        &self.columns
    }

    /// The value of every entry, in the order of [`Self::columns`].
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The entries of a row as (column, value), columns ascending.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.offsets[row]..self.offsets[row + 1];
        self.columns[range.clone()].iter().map(|&c| c as usize).zip(self.values[range].iter().copied())
    }

    /// The stored entry at (row, column), if there is one.
    #[must_use]
    pub fn get(&self, row: usize, column: usize) -> Option<f64> {
        let range = self.offsets[row]..self.offsets[row + 1];
        let at = self.columns[range.clone()].binary_search(&(column as u32)).ok()?;
        Some(self.values[range.start + at])
    }

    /// The diagonal entry of a row.
    #[must_use]
    pub fn diagonal(&self, row: usize) -> f64 {
        self.get(row, row).unwrap_or(0.0)
    }

    /// The sum of a row: zero, up to rounding, for the Laplacian of a whole mesh.
    #[must_use]
    pub fn row_sum(&self, row: usize) -> f64 {
        // Off-diagonal entries first, in the order in which the diagonal was summed: for a Laplacian the result is exactly 0.
        let (mut diagonal, mut others) = (0.0, 0.0);
        for (column, value) in self.row(row) {
            let own = if column == row { value } else { 0.0 };
            (diagonal, others) = (diagonal + own, others + (value - own));
        }
        diagonal + others
    }

    /// The product with a vector of length n.
    #[must_use]
    pub fn multiply(&self, x: &[f64]) -> Vec<f64> {
        (0..self.n()).map(|i| self.row(i).map(|(j, v)| v * x[j]).sum()).collect()
    }

    /// The rows and columns listed in `keep` (ascending), renumbered by their place in that list.
    #[must_use]
    pub fn principal_submatrix(&self, keep: &[u32]) -> Self {
        let mut new_index = vec![u32::MAX; self.n()];
        for (new, &old) in keep.iter().enumerate() {
            new_index[old as usize] = new as u32;
        }
        let mut matrix = Self { offsets: vec![0], columns: Vec::new(), values: Vec::new() };
        for &old in keep {
            for (column, value) in self.row(old as usize).filter(|e| new_index[e.0] != u32::MAX) {
                matrix.columns.push(new_index[column]);
                matrix.values.push(value);
            }
            matrix.offsets.push(matrix.columns.len());
        }
        matrix
    }

    /// The connected component of every row, numbered by their smallest rows, and how many there are.
    #[must_use]
    pub fn components(&self) -> (usize, Vec<u32>) {
        let mut label = vec![u32::MAX; self.n()];
        let mut count = 0;
        let mut stack = Vec::new();
        for seed in 0..self.n() {
            if label[seed] != u32::MAX {
                continue;
            }
            label[seed] = count;
            stack.push(seed);
            while let Some(i) = stack.pop() {
                for (j, _) in self.row(i) {
                    if label[j] == u32::MAX {
                        label[j] = count;
                        stack.push(j);
                    }
                }
            }
            count += 1;
        }
        (count as usize, label)
    }
}

#[cfg(test)]
mod tests {
    // Small integers and halves: exact.
    #![allow(clippy::float_cmp)]
    use super::*;

    #[test]
    fn graph_laplacian_sums_repeated_edges_and_ignores_loops() {
        let ends = [(2, 0), (1, 1), (0, 2), (1, 2)];
        let m = SymmetricCsr::graph_laplacian(4, ends.into_iter(), &[1.5, 9.0, 0.25, -0.5]);
        assert_eq!(m.offsets(), &[0, 2, 4, 7, 8]);
        assert_eq!(m.columns(), &[0, 2, 1, 2, 0, 1, 2, 3]);
        assert_eq!(m.values(), &[1.75, -1.75, -0.5, 0.5, -1.75, 0.5, 1.25, 0.0]);
        assert_eq!(m.components(), (2, vec![0, 0, 0, 1]));
        assert_eq!(m.multiply(&[1.0, 0.0, 2.0, 5.0]), vec![-1.75, 1.0, 0.75, 0.0]);
    }

    #[test]
    fn from_parts_refuses_what_is_not_symmetric() {
        let ok = SymmetricCsr::from_parts(vec![0, 2, 4], vec![0, 1, 0, 1], vec![1.0, -1.0, -1.0, 1.0]);
        assert_eq!(ok.expect("symmetric").diagonal(1), 1.0);
        let bad = |o: &[usize], c: &[u32], v: &[f64]| {
            SymmetricCsr::from_parts(o.to_vec(), c.to_vec(), v.to_vec()).unwrap_err()
        };
        assert_eq!(
            bad(&[0, 2, 4], &[0, 1, 0, 1], &[1.0, -1.0, -2.0, 1.0]),
            SparseError::Asymmetric { row: 0, column: 1 }
        );
        assert_eq!(bad(&[0, 2, 3], &[0, 1, 1], &[1.0, -1.0, 1.0]), SparseError::Asymmetric { row: 0, column: 1 });
        assert_eq!(bad(&[0, 1, 2], &[0, 0], &[1.0, 1.0]), SparseError::Diagonal { row: 1 });
        assert_eq!(bad(&[0, 1], &[3], &[1.0]), SparseError::Columns { row: 0 });
        assert_eq!(bad(&[0, 1], &[0], &[f64::NAN]), SparseError::NonFinite { row: 0 });
        assert_eq!(bad(&[0, 2], &[0], &[1.0]), SparseError::Offsets);
        assert_eq!(bad(&[], &[], &[]), SparseError::Offsets);
    }

    #[test]
    fn principal_submatrix_keeps_the_kept_entries() {
        let m = SymmetricCsr::graph_laplacian(4, [(0, 1), (1, 2), (2, 3)].into_iter(), &[1.0, 2.0, 4.0]);
        let s = m.principal_submatrix(&[1, 2]);
        assert_eq!((s.n(), s.values()), (2, &[3.0, -2.0, -2.0, 6.0][..]));
        assert_eq!(s.row_sum(0), 1.0);
    }
}
