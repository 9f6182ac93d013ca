//! Elimination orders that keep factors sparse, and their trees.

use crate::sparse::SymmetricCsr;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;

/// No row.
pub(super) const NONE: u32 = u32::MAX;

/// An elimination order with its tree: children before parents, subtrees contiguous, so that columns of like pattern are neighbours.
pub(super) struct Elimination {
    /// The rows of the matrix in the order of their elimination.
    pub order: Vec<u32>,
    /// The parent of each position: the first later one that its elimination touches (Liu 1990); or [`NONE`].
    pub parents: Vec<u32>,
    /// Entries of each column of the factor, the diagonal included.
    pub counts: Vec<u32>,
}

impl Elimination {
    /// All rows, by approximate minimum degree; `None` if memory ran out.
    pub fn minimum_degree(matrix: &SymmetricCsr) -> Option<Self> {
        let n = matrix.n();
        let (mut starts, mut columns) = (Vec::with_capacity(n + 1), Vec::with_capacity(matrix.columns().len()));
        starts.push(0usize);
        for row in 0..n {
            columns.extend(matrix.row(row).map(|e| e.0));
            starts.push(columns.len());
        }
        let (mut order, mut inverse) = (vec![0usize; n], vec![0usize; n]);
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &starts, None, &columns);
        let mut memory = MemBuffer::try_new(amd::order_scratch::<usize>(n, columns.len())).ok()?;
        amd::order(&mut order, &mut inverse, pattern, amd::Control::default(), MemStack::new(&mut memory)).ok()?;
        Some(Self::new(matrix, &order.into_iter().map(|row| row as u32).collect::<Vec<u32>>()))
    }

    /// The same without some rows: what is left fills in no more than it did.
    pub fn without(&self, matrix: &SymmetricCsr, left_out: &[bool]) -> Self {
        let order: Vec<u32> = self.order.iter().copied().filter(|&row| !left_out[row as usize]).collect();
        Self::new(matrix, &order)
    }

    fn new(matrix: &SymmetricCsr, order: &[u32]) -> Self {
        let n = order.len();
        let (parents, counts) = tree(matrix, order);
        let by_position = postorder(&parents);
        let mut renamed = vec![0; n];
        for (new, &old) in by_position.iter().enumerate() {
            renamed[old as usize] = new as u32;
        }
        let parent = |old: u32| renamed.get(parents[old as usize] as usize).copied().unwrap_or(NONE);
        Self {
            order: by_position.iter().map(|&old| order[old as usize]).collect(),
            parents: by_position.iter().map(|&old| parent(old)).collect(),
            counts: by_position.iter().map(|&old| counts[old as usize]).collect(),
        }
    }
}

/// The position of each row in an order, [`NONE`] where it is not in it.
pub(super) fn positions(rows: usize, order: &[u32]) -> Vec<u32> {
    let mut position = vec![NONE; rows];
    for (at, &row) in order.iter().enumerate() {
        position[row as usize] = at as u32;
    }
    position
}

/// Parents and counts: row k of the factor has an entry in every column on the paths from the entries of the matrix's row up to k.
fn tree(matrix: &SymmetricCsr, order: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let n = order.len();
    let position = positions(matrix.n(), order);
    let (mut parents, mut counts, mut seen) = (vec![NONE; n], vec![1; n], vec![NONE; n]);
    for k in 0..n as u32 {
        seen[k as usize] = k;
        for (column, _) in matrix.row(order[k as usize] as usize) {
            let mut i = position[column];
            while i < k && seen[i as usize] != k {
                seen[i as usize] = k;
                counts[i as usize] += 1;
                if parents[i as usize] == NONE {
                    parents[i as usize] = k;
                }
                i = parents[i as usize];
            }
        }
    }
    (parents, counts)
}

/// Positions with children before parents and every subtree contiguous.
fn postorder(parents: &[u32]) -> Vec<u32> {
    let n = parents.len();
    let (mut first, mut next) = (vec![NONE; n], vec![NONE; n]);
    for i in (0..n).rev().filter(|&i| parents[i] != NONE) {
        let parent = parents[i] as usize;
        next[i] = first[parent];
        first[parent] = i as u32;
    }
    let (mut order, mut stack) = (Vec::with_capacity(n), Vec::new());
    for root in (0..n).filter(|&i| parents[i] == NONE) {
        stack.push(root as u32);
        while let Some(&top) = stack.last() {
            let child = first[top as usize];
            if child == NONE {
                order.push(top);
                stack.pop();
            } else {
                first[top as usize] = next[child as usize];
                stack.push(child);
            }
        }
    }
    order
}
