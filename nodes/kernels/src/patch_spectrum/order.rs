//! An elimination order that serves both problems at once: inner vertices first, boundary vertices last.
//!
//! The Dirichlet matrix is then the leading block of the Neumann matrix, and its factor the leading block of the factor. What this
//! costs in fill is less than a second ordering and factorisation would.

use crate::sparse::SymmetricCsr;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;

const NONE: u32 = u32::MAX;

/// Vertices 0..n, `interior` (ascending) before the others.
pub(super) fn inner_first(n: usize, interior: &[u32]) -> Vec<u32> {
    let mut order = interior.to_vec();
    order.extend(others(n, interior));
    order
}

fn others(n: usize, interior: &[u32]) -> Vec<u32> {
    let mut inside = vec![false; n];
    for &i in interior {
        inside[i as usize] = true;
    }
    (0..n as u32).filter(|&i| !inside[i as usize]).collect()
}

/// The rows of a symmetric matrix in elimination order, `interior` (ascending) before the others; `None` if memory ran out.
pub(super) fn elimination_order(matrix: &SymmetricCsr, interior: &[u32]) -> Option<Vec<u32>> {
    let boundary = others(matrix.n(), interior);
    let mut order = minimum_degree(matrix, interior)?;
    order.extend(minimum_degree(matrix, &boundary)?);
    let parents = elimination_tree(matrix, &order);
    Some(postorder(&parents, interior.len()).into_iter().map(|i| order[i as usize]).collect())
}

/// The vertices of an induced subgraph by approximate minimum degree.
fn minimum_degree(matrix: &SymmetricCsr, vertices: &[u32]) -> Option<Vec<u32>> {
    let mut local = vec![NONE; matrix.n()];
    for (new, &old) in vertices.iter().enumerate() {
        local[old as usize] = new as u32;
    }
    let (mut starts, mut columns) = (vec![0usize], Vec::with_capacity(7 * vertices.len()));
    for &old in vertices {
        columns.extend(matrix.row(old as usize).map(|e| local[e.0]).filter(|&j| j != NONE).map(|j| j as usize));
        starts.push(columns.len());
    }
    let m = vertices.len();
    let (mut order, mut inverse) = (vec![0usize; m], vec![0usize; m]);
    let pattern = SymbolicSparseColMatRef::new_checked(m, m, &starts, None, &columns);
    let mut memory = MemBuffer::try_new(amd::order_scratch::<usize>(m, columns.len())).ok()?;
    amd::order(&mut order, &mut inverse, pattern, amd::Control::default(), MemStack::new(&mut memory)).ok()?;
    Some(order.into_iter().map(|i| vertices[i]).collect())
}

/// The parent of each position of an elimination order: the first later row that its elimination touches (Liu 1990).
fn elimination_tree(matrix: &SymmetricCsr, order: &[u32]) -> Vec<u32> {
    let n = order.len();
    let mut position = vec![0u32; n];
    for (at, &row) in order.iter().enumerate() {
        position[row as usize] = at as u32;
    }
    let (mut parents, mut ancestors) = (vec![NONE; n], vec![NONE; n]);
    for k in 0..n as u32 {
        for (column, _) in matrix.row(order[k as usize] as usize) {
            let mut i = position[column];
            while i < k {
                // Paths are shortened on the way, or this would take quadratic time.
                let next = std::mem::replace(&mut ancestors[i as usize], k);
                if next == NONE {
                    parents[i as usize] = k;
                    break;
                }
                i = next;
            }
        }
    }
    parents
}

/// Positions with every subtree contiguous, so that columns of like pattern are neighbours; the first `leading` stay first.
fn postorder(parents: &[u32], leading: usize) -> Vec<u32> {
    let n = parents.len();
    let (mut first, mut next) = (vec![NONE; n], vec![NONE; n]);
    let mut order = Vec::with_capacity(n);
    let mut stack = Vec::new();
    for part in [0..leading, leading..n] {
        // A leading position whose parent is not leading is a root among its own.
        let is_root = |i: usize| parents[i] == NONE || (parents[i] as usize) >= part.end;
        for i in part.clone().rev().filter(|&i| !is_root(i)) {
            let parent = parents[i] as usize;
            next[i] = first[parent];
            first[parent] = i as u32;
        }
        for root in part.clone().filter(|&i| is_root(i)) {
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
    }
    order
}
