//! Elimination orders that keep factors sparse, and their trees.

use crate::sparse::SymmetricCsr;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;
use std::ops::Range;

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
    /// The matrix in this order, below its diagonal.
    pub entries: Entries,
}

/// The places of a symmetric matrix's entries, by positions in an order.
#[derive(Default)]
pub(crate) struct Entries {
    /// Where the diagonal is among the matrix's values.
    pub diagonal: Vec<u32>,
    /// Below the diagonal, row by row: columns.
    pub row_starts: Vec<u32>,
    pub columns: Vec<u32>,
    /// The same column by column: rows, ascending, and the places among the matrix's values.
    pub column_starts: Vec<u32>,
    pub rows: Vec<u32>,
    pub sources: Vec<u32>,
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
        Some(Self::new(matrix, &order))
    }

    /// The same without some rows: what is left fills in no more than it did.
    pub fn without(&self, matrix: &SymmetricCsr, left_out: &[bool]) -> Self {
        let order: Vec<u32> = self.order.iter().copied().filter(|&row| !left_out[row as usize]).collect();
        Self::new(matrix, &order)
    }

    /// Rows in this order, without a tree.
    pub fn plain(matrix: &SymmetricCsr, order: Vec<u32>) -> Self {
        let position = positions(matrix.n(), &order);
        let (_, later) = tree(matrix, &order, &position);
        let entries = Entries::new(matrix, &order, &position, later.into_iter());
        Self { entries, position, order, parents: Vec::new(), counts: Vec::new() }
    }

    /// An order that fills in as much as this one does.
    fn new(matrix: &SymmetricCsr, order: &[u32]) -> Self {
        let mut position = positions(matrix.n(), order);
        let (parents, later) = tree(matrix, order, &position);
        let by_position = postorder(&parents);
        let mut renamed = vec![0; parents.len()];
        for (new, &old) in by_position.iter().enumerate() {
            renamed[old as usize] = new as u32;
        }
        let order: Vec<u32> = by_position.iter().map(|&old| order[old as usize]).collect();
        for (at, &row) in order.iter().enumerate() {
            position[row as usize] = at as u32;
        }
        let parent = |old: u32| renamed.get(parents[old as usize] as usize).copied().unwrap_or(NONE);
        let parents: Vec<u32> = by_position.iter().map(|&old| parent(old)).collect();
        // The smaller one of two positions that share an entry is still before the other.
        let later = by_position.iter().map(|&old| later[old as usize]);
        let entries = Entries::new(matrix, &order, &position, later);
        Self { counts: column_counts(&entries, &parents), order, position, parents, entries }
    }
}

/// The place in the order of each of n rows.
fn positions(n: usize, order: &[u32]) -> Vec<u32> {
    let mut position = vec![NONE; n];
    for (at, &row) in order.iter().enumerate() {
        position[row as usize] = at as u32;
    }
    position
}

/// A row of a matrix: places among the values, and columns.
fn entries_of(matrix: &SymmetricCsr, row: u32) -> impl ExactSizeIterator<Item = (u32, u32)> + '_ {
    let range = matrix.offsets()[row as usize]..matrix.offsets()[row as usize + 1];
    (range.start as u32..range.end as u32).zip(matrix.columns()[range].iter().copied())
}

/// Parents in this order, and how many later positions each shares an entry with. Paths already known are cut short (Liu 1986).
fn tree(matrix: &SymmetricCsr, order: &[u32], position: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let n = order.len();
    let (mut parents, mut ancestors, mut later) = (vec![NONE; n], vec![NONE; n], Vec::with_capacity(n));
    let mut before = Vec::new();
    for (k, &row) in (0..).zip(order) {
        let entries = entries_of(matrix, row);
        before.resize(before.len().max(entries.len()), 0);
        // Written before it is known whether it counts: nobody can foresee it.
        let (mut end, mut after) = (0, 0);
        for (_, column) in entries {
            let column = position[column as usize];
            before[end] = column;
            end += usize::from(column < k);
            after += u32::from(column > k && column != NONE);
        }
        later.push(after);
        for &column in &before[..end] {
            let mut i = column;
            while i < k {
                let next = std::mem::replace(&mut ancestors[i as usize], k);
                if next == NONE {
                    parents[i as usize] = k;
                }
                i = next;
            }
        }
    }
    (parents, later)
}

impl Entries {
    /// Rows in this order, each of which shares entries with so many later ones.
    fn new(matrix: &SymmetricCsr, order: &[u32], position: &[u32], later: impl Iterator<Item = u32>) -> Self {
        let n = order.len();
        // Where the column before goes on, while it is filled.
        let mut column_starts = Vec::with_capacity(n + 2);
        column_starts.extend([0, 0]);
        let mut count = 0;
        for later in later {
            count += later;
            column_starts.push(count);
        }
        let entries = count as usize;
        let (mut diagonal, mut row_starts) = (Vec::with_capacity(n), Vec::with_capacity(n + 1));
        let (mut columns, mut rows, mut sources) = (Vec::with_capacity(entries), vec![0; entries], vec![0; entries]);
        let mut before = Vec::new();
        for (k, &row) in (0..).zip(order) {
            row_starts.push(columns.len() as u32);
            let entries = entries_of(matrix, row);
            before.resize(before.len().max(entries.len()), (0, 0));
            let (mut end, mut own) = (0, 0);
            for (source, column) in entries {
                let column = position[column as usize];
                before[end] = (column, source);
                end += usize::from(column < k);
                own = if column == k { source } else { own };
            }
            diagonal.push(own);
            for &(column, source) in &before[..end] {
                let at = &mut column_starts[column as usize + 1];
                (rows[*at as usize], sources[*at as usize]) = (k, source);
                *at += 1;
                columns.push(column);
            }
        }
        row_starts.push(columns.len() as u32);
        column_starts.truncate(n + 1);
        Self { diagonal, row_starts, columns, column_starts, rows, sources }
    }

    /// Where a column's rows are.
    #[inline(always)]
    pub fn column(&self, j: usize) -> Range<usize> {
        self.column_starts[j] as usize..self.column_starts[j + 1] as usize
    }

    /// The columns of a row.
    pub fn row(&self, i: u32) -> &[u32] {
        &self.columns[self.row_starts[i as usize] as usize..self.row_starts[i as usize + 1] as usize]
    }
}

/// Entries of each column of the factor. Row i has one in every column on the paths from the entries of the matrix's row up to i: each leaf of that
/// subtree adds one to all counts on its way up, but for those above where it meets the path of the leaf before (Gilbert, Ng & Peyton 1994).
fn column_counts(entries: &Entries, parents: &[u32]) -> Vec<u32> {
    let n = parents.len();
    // The first position in the subtree of each. Sums over subtrees of what follows give the counts.
    let mut first: Vec<u32> = (0..n as u32).collect();
    let mut changes = vec![1i32; n];
    for (j, &parent) in parents.iter().enumerate().filter(|p| *p.1 != NONE) {
        first[parent as usize] = first[parent as usize].min(first[j]);
        changes[parent as usize] = 0;
    }
    let mut last_leaf = vec![NONE; n];
    let mut ancestors: Vec<u32> = (0..n as u32).collect();
    for (j, &parent) in parents.iter().enumerate() {
        for &i in &entries.rows[entries.column(j)] {
            let before = last_leaf[i as usize];
            // Otherwise a leaf of that row is below j.
            if before == NONE || first[j] > before {
                last_leaf[i as usize] = j as u32;
                changes[j] += 1;
                if before != NONE {
                    changes[root(&mut ancestors, before) as usize] -= 1;
                }
            }
        }
        if parent != NONE {
            changes[parent as usize] -= 1;
            ancestors[j] = parent;
        }
    }
    for (j, &parent) in parents.iter().enumerate().filter(|p| *p.1 != NONE) {
        changes[parent as usize] += changes[j];
    }
    changes.into_iter().map(|count| count as u32).collect()
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
