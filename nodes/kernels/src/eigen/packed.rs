//! A supernodal factor laid out for solves with a whole panel: rows of L contiguous, one pass over L for eight right-hand sides.

use super::panel::{Row, WIDTH};
use super::parts::{each, locked};
use super::spare::Spare;
use super::supernode::{Below, Node};
use super::tiles::{parts, registers_mut};
use super::tree::{Segment, Tree};
use super::{EigenError, Hooks};
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use pulp::{Arch, Simd, WithSimd};
use std::sync::{Arc, Mutex};

/// L and D^-1 of an LDL' factorisation, in elimination order.
pub(crate) struct Packed {
    /// First column of each supernode, then n.
    columns: Vec<u32>,
    /// Where the rows below each supernode begin in the tree's, and its entries in `values`.
    row_starts: Vec<usize>,
    value_starts: Vec<usize>,
    tree: Tree,
    /// Per supernode: its unit lower triangle as a full square, then the rows below, row by row.
    values: Vec<f64>,
    inverse_pivots: Vec<f64>,
    spare: Arc<Spare<Vec<f64>>>,
    /// Memory for rows of the top.
    tops: Spare<Vec<Row>>,
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
        let tree = Tree::new(&columns, &row_starts, rows);
        Self {
            columns,
            row_starts,
            value_starts,
            tree,
            values,
            inverse_pivots,
            spare: Arc::clone(spare),
            tops: Spare::new(),
        }
    }

    /// The same of a factor without supernodes, which small or very sparse matrices have: each column its pivot, then the entries below.
    pub fn of_columns(starts: &[usize], rows: &[usize], values: Vec<f64>, spare: &Arc<Spare<Vec<f64>>>) -> Self {
        let n = starts.len() - 1;
        let columns: Vec<u32> = (0..=n as u32).collect();
        // Without the diagonal.
        let row_starts: Vec<usize> = starts.iter().enumerate().map(|(j, start)| start - j).collect();
        let below = starts.windows(2).flat_map(|column| &rows[column[0] + 1..column[1]]);
        Self {
            tree: Tree::new(&columns, &row_starts, below.map(|&r| r as u32).collect()),
            columns,
            row_starts,
            value_starts: starts.to_vec(),
            inverse_pivots: starts[..n].iter().map(|&start| 1.0 / values[start]).collect(),
            values,
            spare: Arc::clone(spare),
            tops: Spare::new(),
        }
    }

    /// The number of negative pivots.
    pub fn negative(&self) -> usize {
        self.inverse_pivots.iter().filter(|p| **p < 0.0).count()
    }

    /// Whether no pivot vanished or overflowed.
    pub fn is_sound(&self) -> bool {
        self.inverse_pivots.iter().all(|p| p.is_finite() && *p != 0.0)
    }

    /// x <- (L D L')^-1 x, on the threads that the hooks lend: groups of subtrees, then what is above them, then the groups again.
    pub fn solve(&self, hooks: &dyn Hooks, x: &mut [Row]) -> Result<(), EigenError> {
        let Tree { groups, segments, .. } = &self.tree;
        if *groups == 0 {
            self.solve_top(segments.iter(), x);
            return Ok(());
        }
        let mut pieces = self.deal(x);
        let mut above = pieces.pop().unwrap_or_default();
        let count: usize = above.iter().map(|(_, rows)| rows.len()).sum();
        let mut memory = self.tops.take().unwrap_or_default();
        memory.resize((groups + 1) * count, [0.0; WIDTH]);
        let (top, tops) = memory.split_at_mut(count);
        for (segment, rows) in &above {
            top[segment.place..][..rows.len()].copy_from_slice(rows);
        }
        let parts = pieces.into_iter().zip(tops.chunks_mut(count));
        let parts: Vec<_> = parts.map(|(segments, top)| Mutex::new(Part { segments, top })).collect();
        each(hooks, *groups, &|group| {
            let part = &mut *locked(&parts[group]);
            part.top.fill([0.0; WIDTH]);
            for (segment, x) in &mut part.segments {
                Arch::new().dispatch(Forward { packed: self, segment, x, top: part.top });
            }
        })?;
        for part in &parts {
            let sums = top.as_flattened_mut().iter_mut();
            sums.zip(locked(part).top.as_flattened()).for_each(|(sum, x)| *sum += x);
        }
        self.solve_top(above.iter().map(|(segment, _)| *segment), top);
        each(hooks, *groups, &|task| {
            // What was worked on last is still in the cache.
            let part = &mut *locked(&parts[groups - 1 - task]);
            part.top.copy_from_slice(top);
            for (segment, x) in part.segments.iter_mut().rev() {
                Arch::new().dispatch(Backward { packed: self, segment, x, top: part.top });
            }
        })?;
        drop(parts);
        for (segment, rows) in &mut above {
            rows.copy_from_slice(&top[segment.place..][..rows.len()]);
        }
        self.tops.give(memory);
        Ok(())
    }

    /// The rows of x that belong to each group, and those of the top.
    fn deal<'a>(&'a self, mut x: &'a mut [Row]) -> Vec<Vec<Piece<'a>>> {
        let mut pieces: Vec<Vec<Piece<'_>>> = (0..=self.tree.groups).map(|_| Vec::new()).collect();
        for segment in &self.tree.segments {
            let (rows, rest) = x.split_at_mut(segment.columns.len());
            pieces[segment.owner].push((segment, rows));
            x = rest;
        }
        pieces
    }

    /// Solves for x, the rows of the top.
    fn solve_top<'a>(&self, segments: impl DoubleEndedIterator<Item = &'a Segment> + Clone, x: &mut [Row]) {
        for segment in segments.clone() {
            Arch::new().dispatch(Forward { packed: self, segment, x: &mut *x, top: &mut [] });
        }
        for segment in segments.rev() {
            Arch::new().dispatch(Backward { packed: self, segment, x: &mut *x, top: &mut [] });
        }
    }

    /// The supernode's rows of x and its parts of the factor, for x and the top as its segment has them.
    #[inline(always)]
    fn node<'a, T>(&'a self, s: usize, at: &Segment, parts: usize, x: &'a mut [T], top: &'a mut [T]) -> Node<'a, T> {
        let (begin, end) = (self.columns[s] as usize, self.columns[s + 1] as usize);
        let width = end - begin;
        let pivots = &self.inverse_pivots[begin..end];
        let begin = begin - at.columns.start + at.place;
        let (head, after) = x.split_at_mut((begin + width) * parts);
        let values = &self.values[self.value_starts[s]..self.value_starts[s + 1]];
        let (square, below) = values.split_at(width * width);
        let rows = &self.tree.rows[self.row_starts[s]..self.row_starts[s + 1]];
        let (near, far) = rows.split_at(self.tree.inner(s, rows.len()));
        let (near_entries, far_entries) = below.split_at(near.len() * width);
        Node {
            width,
            own: &mut head[begin * parts..],
            square,
            pivots,
            near: Below { rows: near, entries: near_entries, x: after, begin: begin + width },
            far: Below { rows: far, entries: far_entries, x: top, begin: 0 },
        }
    }
}

/// A segment and its rows of x.
type Piece<'a> = (&'a Segment, &'a mut [Row]);

/// What a group works on.
struct Part<'a> {
    segments: Vec<Piece<'a>>,
    /// First what is to be added to the rows of the top, then these rows.
    top: &'a mut [Row],
}

/// x <- L^-1 x.
struct Forward<'a> {
    packed: &'a Packed,
    segment: &'a Segment,
    x: &'a mut [Row],
    top: &'a mut [Row],
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (x, top) = (registers_mut::<S>(self.x), registers_mut::<S>(self.top));
        for s in self.segment.nodes.clone() {
            let mut node = self.packed.node(s, self.segment, parts::<S>(), x, top);
            for part in 0..parts::<S>() {
                node.forward(simd, part);
            }
        }
    }
}

/// x <- L'^-1 D^-1 x.
struct Backward<'a> {
    packed: &'a Packed,
    segment: &'a Segment,
    x: &'a mut [Row],
    top: &'a mut [Row],
}

impl WithSimd for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (x, top) = (registers_mut::<S>(self.x), registers_mut::<S>(self.top));
        for s in self.segment.nodes.clone().rev() {
            let mut node = self.packed.node(s, self.segment, parts::<S>(), x, top);
            for part in 0..parts::<S>() {
                node.backward(simd, part);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eigen::factor::Factorizer;
    use crate::eigen::problem::Problem;
    use crate::laplacian::{Area, laplacian};
    use crate::random::Random;

    /// A bumpy sheet of 34 x 26 vertices.
    fn sheet() -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let height = |i: u32, j: u32| 0.3 * (0.7 * f64::from(i)).sin() * (0.4 * f64::from(j)).cos();
        let points = (0..34).flat_map(|i| (0..26).map(move |j| [f64::from(i), f64::from(j), height(i, j)]));
        let squares = (0..33).flat_map(|i| (0..25).map(move |j| i * 26 + j));
        let faces = squares.flat_map(|a| [[a, a + 26, a + 27], [a, a + 27, a + 1]]);
        (points.collect(), faces.collect())
    }

    fn solved<S: Simd>(simd: S, packed: &Packed, right: &[Row]) -> Vec<Row> {
        let mut x = right.to_vec();
        let segment = &packed.tree.segments[0];
        Forward { packed, segment, x: &mut x, top: &mut [] }.with_simd(simd);
        Backward { packed, segment, x: &mut x, top: &mut [] }.with_simd(simd);
        x
    }

    #[test]
    fn solves_leave_no_residual_and_the_width_of_registers_changes_no_bit() {
        let (vertices, faces) = sheet();
        let operator = laplacian(&vertices, &faces, Area::Mixed, false).expect("a plane mesh");
        let problem = Problem::new(&operator.stiffness, &operator.mass).expect("a Laplacian");
        let factorizer = Factorizer::new(&problem).expect("small");
        let (order, shift) = (factorizer.order(), 320.0);
        let packed = factorizer.factor(shift).expect("not singular");
        let widest = packed.columns.windows(2).map(|c| c[1] - c[0]).max();
        assert!(packed.negative() > 10 && widest > Some(16), "an indefinite factor with all sizes of supernodes");
        let mut random = Random::from_state(7);
        let right: Vec<Row> = order.iter().map(|_| std::array::from_fn(|_| random.signed())).collect();
        let mut x = right.clone();
        packed.solve(&(), &mut x).expect("not cancelled");
        let mut place = vec![0; order.len()];
        order.iter().enumerate().for_each(|(i, &vertex)| place[vertex as usize] = i);
        let largest = x.as_flattened().iter().fold(0.0f64, |m, x| m.max(x.abs()));
        for (vertex, &i) in place.iter().enumerate() {
            for q in 0..right[i].len() {
                let entry = |(j, m): (usize, f64)| m / (problem.root[vertex] * problem.root[j]) * x[place[j]][q];
                let product: f64 = operator.stiffness.row(vertex).map(entry).sum();
                let residual = product - shift * x[i][q] - right[i][q];
                assert!(residual.abs() < 1e-9 * (1.0 + shift * largest), "vertex {vertex}: {residual:e}");
            }
        }
        assert!(solved(pulp::Scalar512b, &packed, &right) == x && solved(pulp::Scalar256b, &packed, &right) == x);
        assert!(solved(pulp::Scalar, &packed, &right) == x);
        in_groups_the_solution_is_the_same(packed, &right, &x);
    }

    /// Runs tasks from the last to the first.
    struct Backwards;

    impl Hooks for Backwards {
        fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
            (0..count).rev().for_each(task);
        }
    }

    fn in_groups_the_solution_is_the_same(mut packed: Packed, right: &[Row], whole: &[Row]) {
        assert_eq!(packed.tree.groups, 0);
        let rows = packed.tree.rows.clone();
        let largest = whole.as_flattened().iter().fold(0.0f64, |m, x| m.max(x.abs()));
        for groups in 2..5 {
            packed.tree = Tree::with_groups(&packed.columns, &packed.row_starts, &rows, groups);
            let owned = |group: usize| packed.tree.segments.iter().filter(move |segment| segment.owner == group);
            let columns = |group: usize| owned(group).map(|segment| segment.columns.len()).sum::<usize>();
            assert!((0..groups).all(|group| columns(group) > right.len() / (2 * groups)), "groups of like size");
            assert!((1..right.len() / 3).contains(&columns(groups)), "a small top");
            let [mut x, mut y] = [right.to_vec(), right.to_vec()];
            packed.solve(&(), &mut x).expect("not cancelled");
            packed.solve(&Backwards, &mut y).expect("not cancelled");
            assert!(x == y);
            for (x, y) in x.as_flattened().iter().zip(whole.as_flattened()) {
                assert!((x - y).abs() < 1e-11 * largest, "{groups} groups: {x} {y}");
            }
        }
    }
}
