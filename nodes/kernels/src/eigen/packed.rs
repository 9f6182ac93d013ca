//! A supernodal factor laid out for solves with a whole panel: rows of L contiguous, one pass over L for eight right-hand sides.

use super::panel::{Row, WIDTH, subtract_multiple};
use super::spare::Spare;
use crate::simd::vectorised;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use std::sync::Arc;

/// L and D^-1 of an LDL' factorisation, in elimination order.
pub(crate) struct Packed {
    /// First column of each supernode, then n.
    columns: Vec<u32>,
    /// Where the rows below each supernode begin in `rows`, and its entries in `values`.
    row_starts: Vec<usize>,
    value_starts: Vec<usize>,
    rows: Vec<u32>,
    /// Per supernode: its unit lower triangle as a full square, then the rows below, row by row.
    values: Vec<f64>,
    inverse_pivots: Vec<f64>,
    spare: Arc<Spare<Vec<f64>>>,
}

impl Drop for Packed {
    fn drop(&mut self) {
        self.spare.give(std::mem::take(&mut self.values));
    }
}

impl Packed {
    /// Takes over the values of a factor, whose supernodes lie column by column. They go to `spare` in the end.
    pub fn new(
        symbolic: &SymbolicSupernodalCholesky<usize>,
        mut values: Vec<f64>,
        spare: &Arc<Spare<Vec<f64>>>,
    ) -> Self {
        let (mut columns, mut row_starts, mut rows) = (Vec::new(), vec![0], Vec::new());
        let mut inverse_pivots = Vec::with_capacity(symbolic.nrows());
        let value_starts = symbolic.col_ptr_for_val().to_vec();
        let mut block = Vec::new();
        for s in 0..symbolic.n_supernodes() {
            let node = symbolic.supernode(s);
            columns.push(node.start() as u32);
            rows.extend(node.pattern().iter().map(|&r| r as u32));
            row_starts.push(rows.len());
            let values = &mut values[value_starts[s]..value_starts[s + 1]];
            let width = symbolic.supernode_end()[s] - symbolic.supernode_begin()[s];
            let height = values.len() / width;
            inverse_pivots.extend((0..width).map(|j| 1.0 / values[j * height + j]));
            // What is above the diagonal is never read.
            block.clear();
            block.extend_from_slice(values);
            for (i, row) in values.chunks_exact_mut(width).enumerate() {
                for (x, column) in row.iter_mut().zip(block.chunks_exact(height)) {
                    *x = column[i];
                }
            }
        }
        columns.push(symbolic.nrows() as u32);
        Self { columns, row_starts, value_starts, rows, values, inverse_pivots, spare: Arc::clone(spare) }
    }

    /// The same of a factor without supernodes, which small or very sparse matrices have: each column its pivot, then the entries below.
    pub fn of_columns(starts: &[usize], rows: &[usize], values: Vec<f64>, spare: &Arc<Spare<Vec<f64>>>) -> Self {
        let n = starts.len() - 1;
        let mut packed = Self {
            columns: (0..=n as u32).collect(),
            row_starts: vec![0],
            value_starts: starts.to_vec(),
            rows: Vec::with_capacity(rows.len()),
            inverse_pivots: starts[..n].iter().map(|&start| 1.0 / values[start]).collect(),
            values,
            spare: Arc::clone(spare),
        };
        for column in starts.windows(2) {
            packed.rows.extend(rows[column[0] + 1..column[1]].iter().map(|&r| r as u32));
            packed.row_starts.push(packed.rows.len());
        }
        packed
    }

    /// The number of negative pivots.
    pub fn negative(&self) -> usize {
        self.inverse_pivots.iter().filter(|p| **p < 0.0).count()
    }

    /// Whether no pivot vanished or overflowed.
    pub fn is_sound(&self) -> bool {
        self.inverse_pivots.iter().all(|p| p.is_finite() && *p != 0.0)
    }

    /// x <- (L D L')^-1 x.
    pub fn solve(&self, x: &mut [Row]) {
        vectorised(
            #[inline(always)]
            || {
                let count = self.columns.len() - 1;
                for s in 0..count {
                    self.forward(s, x);
                }
                for s in (0..count).rev() {
                    self.backward(s, x);
                }
            },
        );
    }

    /// The supernode's rows of x, those after it, and its parts of the factor: square, rows below, their entries.
    #[inline(always)]
    fn split<'a>(&'a self, s: usize, x: &'a mut [Row]) -> Node<'a> {
        let (begin, end) = (self.columns[s] as usize, self.columns[s + 1] as usize);
        let width = end - begin;
        let (head, after) = x.split_at_mut(end);
        let values = &self.values[self.value_starts[s]..self.value_starts[s + 1]];
        let (square, below) = values.split_at(width * width);
        let rows = &self.rows[self.row_starts[s]..self.row_starts[s + 1]];
        Node {
            width,
            end,
            own: &mut head[begin..],
            after,
            square,
            below,
            rows,
            pivots: &self.inverse_pivots[begin..end],
        }
    }

    #[inline(always)]
    fn forward(&self, s: usize, x: &mut [Row]) {
        let Node { width, end, own, after, square, below, rows, .. } = self.split(s, x);
        for i in 1..width {
            let (done, rest) = own.split_at_mut(i);
            let mut sum = rest[0];
            for (l, y) in square[i * width..i * width + i].iter().zip(done.iter()) {
                subtract_multiple(&mut sum, *l, y);
            }
            rest[0] = sum;
        }
        let own = &*own;
        let (rows4, rows1) = rows.as_chunks::<4>();
        let mut entries = below;
        for targets in rows4 {
            let (four, rest) = entries.split_at(4 * width);
            entries = rest;
            let at = targets.map(|r| r as usize - end);
            let mut sums = at.map(|r| after[r]);
            let (l0, l1) = four.split_at(2 * width);
            let ((l0, l1), (l2, l3)) = (l0.split_at(width), l1.split_at(width));
            for ((((y, a), b), c), d) in own.iter().zip(l0).zip(l1).zip(l2).zip(l3) {
                subtract_multiple(&mut sums[0], *a, y);
                subtract_multiple(&mut sums[1], *b, y);
                subtract_multiple(&mut sums[2], *c, y);
                subtract_multiple(&mut sums[3], *d, y);
            }
            for r in 0..4 {
                after[at[r]] = sums[r];
            }
        }
        for &target in rows1 {
            let (one, rest) = entries.split_at(width);
            entries = rest;
            let sum = &mut after[target as usize - end];
            for (y, l) in own.iter().zip(one) {
                subtract_multiple(sum, *l, y);
            }
        }
    }

    #[inline(always)]
    fn backward(&self, s: usize, x: &mut [Row]) {
        let Node { width, end, own, after, square, below, rows, pivots } = self.split(s, x);
        for (y, p) in own.iter_mut().zip(pivots) {
            for q in 0..WIDTH {
                y[q] *= p;
            }
        }
        let mut begin = 0;
        while begin < width {
            begin += match width - begin {
                8.. => gather::<8, 1>(own, after, end, rows, below, width, begin),
                4.. => gather::<4, 2>(own, after, end, rows, below, width, begin),
                2.. => gather::<2, 4>(own, after, end, rows, below, width, begin),
                _ => gather::<1, 4>(own, after, end, rows, below, width, begin),
            };
        }
        for j in (0..width).rev() {
            let (rest, done) = own.split_at_mut(j + 1);
            let mut sum = rest[j];
            for (i, y) in done.iter().enumerate() {
                subtract_multiple(&mut sum, square[(j + 1 + i) * width + j], y);
            }
            rest[j] = sum;
        }
    }
}

struct Node<'a> {
    width: usize,
    end: usize,
    own: &'a mut [Row],
    after: &'a mut [Row],
    square: &'a [f64],
    below: &'a [f64],
    rows: &'a [u32],
    pivots: &'a [f64],
}

/// Subtracts the rows below from C columns of a supernode at once: C products for each row loaded, U rows in flight so that sums do not wait
/// for each other. Returns C.
#[inline(always)]
fn gather<const C: usize, const U: usize>(
    own: &mut [Row],
    after: &[Row],
    end: usize,
    rows: &[u32],
    below: &[f64],
    width: usize,
    begin: usize,
) -> usize {
    let mut sums = [[[0.0; WIDTH]; C]; U];
    let (groups, rest) = rows.as_chunks::<U>();
    let mut entries = below;
    for group in groups {
        let (now, later) = entries.split_at(U * width);
        entries = later;
        for u in 0..U {
            let y = &after[group[u] as usize - end];
            let l = &now[u * width + begin..u * width + begin + C];
            for c in 0..C {
                subtract_multiple(&mut sums[u][c], l[c], y);
            }
        }
    }
    for (&row, l) in rest.iter().zip(entries.chunks_exact(width)) {
        let y = &after[row as usize - end];
        for c in 0..C {
            subtract_multiple(&mut sums[0][c], l[begin + c], y);
        }
    }
    for c in 0..C {
        for sum in &sums {
            for q in 0..WIDTH {
                own[begin + c][q] += sum[c][q];
            }
        }
    }
    C
}
