//! Elimination orders that keep factors sparse, and their trees.

use crate::sparse::SymmetricCsr;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;

/// No row.
pub(crate) const NONE: u32 = u32::MAX;

/// An elimination order with its tree: children before parents, subtrees contiguous, so that columns of like pattern are neighbours.
pub(crate) struct Elimination {
    /// The rows of the matrix in the order of their elimination.
    pub order: Vec<u32>,
    /// The place of each row of the matrix in the order; [`NONE`] where it is not in it.
    pub position: Vec<u32>,
    /// The parent of each position: the first later one that its elimination touches (Liu 1990); or [`NONE`].
    pub parents: Vec<u32>,
    /// Entries of each column of the factor, the diagonal included.
    pub counts: Vec<u32>,
}

impl Elimination {
    /// All rows, by approximate minimum degree; `None` if memory ran out.
    pub fn minimum_degree(matrix: &SymmetricCsr) -> Option<Self> {
        let n = matrix.n();
        let starts: Vec<u32> = matrix.offsets().iter().map(|&at| u32::try_from(at).ok()).collect::<Option<_>>()?;
        let (mut order, mut inverse) = (vec![0u32; n], vec![0u32; n]);
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &starts, None, matrix.columns());
        let mut memory = MemBuffer::try_new(amd::order_scratch::<u32>(n, matrix.columns().len())).ok()?;
        amd::order(&mut order, &mut inverse, pattern, amd::Control::default(), MemStack::new(&mut memory)).ok()?;
        Some(Self::new(matrix, order))
    }

    /// The same without some rows: what is left fills in no more than it did.
    pub fn without(&self, matrix: &SymmetricCsr, left_out: &[bool]) -> Self {
        Self::new(matrix, self.order.iter().copied().filter(|&row| !left_out[row as usize]).collect())
    }

    /// Rows in this order, without a tree.
    pub fn plain(rows: usize, order: Vec<u32>) -> Self {
        Self { position: positions(rows, &order), order, parents: Vec::new(), counts: Vec::new() }
    }

    /// An order that fills in as much as this one does.
    fn new(matrix: &SymmetricCsr, order: Vec<u32>) -> Self {
        let given = Self::plain(matrix.n(), order);
        let parents = given.tree(matrix);
        let by_position = postorder(&parents);
        let mut renamed = vec![0; parents.len()];
        for (new, &old) in by_position.iter().enumerate() {
            renamed[old as usize] = new as u32;
        }
        let parent = |old: u32| renamed.get(parents[old as usize] as usize).copied().unwrap_or(NONE);
        let mut elimination =
            Self::plain(matrix.n(), by_position.iter().map(|&old| given.order[old as usize]).collect());
        elimination.parents = by_position.iter().map(|&old| parent(old)).collect();
        elimination.counts = elimination.column_counts(matrix);
        elimination
    }

    /// Positions of what the row at a position is coupled to.
    pub fn neighbours(&self, matrix: &SymmetricCsr, at: u32) -> impl Iterator<Item = u32> {
        matrix.row(self.order[at as usize] as usize).map(|(column, _)| self.position[column])
    }

    /// Parents: paths already known are cut short (Liu 1986).
    fn tree(&self, matrix: &SymmetricCsr) -> Vec<u32> {
        let n = self.order.len();
        let (mut parents, mut ancestors) = (vec![NONE; n], vec![NONE; n]);
        for k in 0..n as u32 {
            for neighbour in self.neighbours(matrix, k) {
                let mut i = neighbour;
                while i < k {
                    let next = std::mem::replace(&mut ancestors[i as usize], k);
                    if next == NONE {
                        parents[i as usize] = k;
                    }
                    i = next;
                }
            }
        }
        parents
    }

    /// Row i of the factor has an entry in every column on the paths from the entries of the matrix's row up to i. Each leaf of that subtree adds
    /// one to all counts on its way up, but where it meets the path of the leaf before (Gilbert, Ng & Peyton 1994).
    fn column_counts(&self, matrix: &SymmetricCsr) -> Vec<u32> {
        let n = self.order.len();
        // The first position in the subtree of each, and sums over subtrees give the counts.
        let mut first: Vec<u32> = (0..n as u32).collect();
        for j in 0..n {
            if self.parents[j] != NONE {
                let parent = self.parents[j] as usize;
                first[parent] = first[parent].min(first[j]);
            }
        }
        let mut changes: Vec<i32> = (0..n).map(|j| i32::from(first[j] as usize == j)).collect();
        let mut last_leaf = vec![NONE; n];
        let mut ancestors: Vec<u32> = (0..n as u32).collect();
        for j in 0..n as u32 {
            let parent = self.parents[j as usize];
            if parent != NONE {
                changes[parent as usize] -= 1;
            }
            for i in self.neighbours(matrix, j).filter(|&i| i > j && i != NONE) {
                let before = last_leaf[i as usize];
                // Otherwise a leaf of that row is below j.
                if before == NONE || first[j as usize] > before {
                    last_leaf[i as usize] = j;
                    changes[j as usize] += 1;
                    if before != NONE {
                        changes[root(&mut ancestors, before) as usize] -= 1;
                    }
                }
            }
            if parent != NONE {
                ancestors[j as usize] = parent;
            }
        }
        for j in 0..n {
            if self.parents[j] != NONE {
                changes[self.parents[j] as usize] += changes[j];
            }
        }
        changes.into_iter().map(|count| count as u32).collect()
    }
}

/// The uppermost known ancestor; paths are cut short.
fn root(ancestors: &mut [u32], from: u32) -> u32 {
    let mut top = from;
    while ancestors[top as usize] != top {
        top = ancestors[top as usize];
    }
    let mut i = from;
    while i != top {
        i = std::mem::replace(&mut ancestors[i as usize], top);
    }
    top
}

/// The position of each row in an order, [`NONE`] where it is not in it.
fn positions(rows: usize, order: &[u32]) -> Vec<u32> {
    let mut position = vec![NONE; rows];
    for (at, &row) in order.iter().enumerate() {
        position[row as usize] = at as u32;
    }
    position
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
