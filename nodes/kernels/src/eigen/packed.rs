//! A supernodal factor laid out for solves with a whole panel: rows of L contiguous, one pass over L for eight right-hand sides.

use super::panel::{Row, WIDTH};
use super::parts::{each, locked};
use super::spare::Spare;
use super::supernode::{Below, Node};
use super::tiles::{parts, registers_mut};
use super::tree::{Segment, Tree};
use super::{EigenError, Hooks};
use crate::multifrontal::{Eliminated, Keep, Symbolic};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;
use std::sync::{Arc, Mutex};

/// What all factors of a matrix share: their pattern and layout.
pub(super) struct Shape {
    symbolic: Symbolic,
    /// Where the entries of each supernode begin in [`Packed::values`], and their end.
    value_starts: Vec<usize>,
    /// What solves can go through at the same time.
    tree: Tree,
    /// Memory of factors, and for rows of the top.
    spare: Spare<Vec<f64>>,
    tops: Spare<Vec<Row>>,
}

impl Shape {
    pub fn new(symbolic: Symbolic) -> Self {
        let mut value_starts = vec![0];
        let mut end = 0;
        for node in &symbolic.nodes {
            end += node.width() * node.height();
            value_starts.push(end);
        }
        let tree = Tree::new(&symbolic);
        Self { symbolic, value_starts, tree, spare: Spare::new(), tops: Spare::new() }
    }

    pub fn symbolic(&self) -> &Symbolic {
        &self.symbolic
    }

    /// Gives spare memory back to the allocator.
    pub fn release(&self) {
        self.spare.clear();
        self.tops.clear();
    }

    /// Entries of a factor.
    fn entries(&self) -> usize {
        self.value_starts.last().copied().unwrap_or(0)
    }
}

/// L and D^-1 of an LDL' factorisation, in elimination order.
pub(crate) struct Packed {
    shape: Arc<Shape>,
    /// Per supernode: its unit lower triangle as a full square, then the rows below, row by row. What is not below the diagonal is never read.
    values: Vec<f64>,
    inverse_pivots: Vec<f64>,
}

impl Drop for Packed {
    fn drop(&mut self) {
        self.shape.spare.give(std::mem::take(&mut self.values));
    }
}

/// Where supernodes go, one after the other: pieces of a factor's values, the first one last.
pub(super) struct Pieces<'a>(Vec<&'a mut [f64]>);

impl Keep for Pieces<'_> {
    #[inline(always)]
    fn keep(&mut self, front: &Eliminated<'_>) {
        let (width, height, pitch) = (front.node.width(), front.node.height(), front.pitch);
        while self.0.pop_if(|piece| piece.is_empty()).is_some() {}
        let Some(piece) = self.0.pop() else { return };
        let (values, rest) = piece.split_at_mut(width * height);
        self.0.push(rest);
        let mut c = 0;
        while c < width {
            let columns = &front.columns[c * pitch..];
            c += match width - c {
                8.. => interleave::<8>(columns, pitch, values, width, c),
                4.. => interleave::<4>(columns, pitch, values, width, c),
                2.. => interleave::<2>(columns, pitch, values, width, c),
                _ => interleave::<1>(columns, pitch, values, width, c),
            };
        }
    }
}

/// Writes C columns into rows of a wider matrix, from column `first` on. Returns C.
#[inline(always)]
fn interleave<const C: usize>(columns: &[f64], pitch: usize, values: &mut [f64], width: usize, first: usize) -> usize {
    let height = values.len() / width;
    let columns: [&[f64]; C] = std::array::from_fn(|i| &columns[i * pitch..][..height]);
    for (r, row) in values.chunks_exact_mut(width).enumerate() {
        let row = &mut row[first..first + C];
        for i in 0..C {
            row[i] = columns[i][r];
        }
    }
    C
}

impl Packed {
    /// Room for a factor.
    pub fn new(shape: &Arc<Shape>) -> Self {
        // All of one length, and of any content.
        let values = shape.spare.take().unwrap_or_else(|| vec![0.0; shape.entries()]);
        Self { shape: Arc::clone(shape), values, inverse_pivots: Vec::new() }
    }

    /// Where the supernodes of each of some ranges go, and where the others do.
    pub fn pieces(&mut self, ranges: &[Range<usize>]) -> (Vec<Pieces<'_>>, Pieces<'_>) {
        let (mut within, mut between) = (Vec::new(), Vec::new());
        let (mut rest, mut at) = (self.values.as_mut_slice(), 0);
        for range in ranges {
            let [begin, end] = [range.start, range.end].map(|s| self.shape.value_starts[s]);
            let (before, others) = rest.split_at_mut(begin - at);
            let (own, after) = others.split_at_mut(end - begin);
            between.push(before);
            within.push(Pieces(vec![own]));
            (rest, at) = (after, end);
        }
        between.push(rest);
        between.reverse();
        (within, Pieces(between))
    }

    /// Takes the diagonal of D.
    pub fn invert(&mut self, pivots: Vec<f64>) {
        self.inverse_pivots = pivots.into_iter().map(|p| 1.0 / p).collect();
    }

    /// The number of negative pivots.
    pub fn negative(&self) -> usize {
        self.inverse_pivots.iter().filter(|p| **p < 0.0).count()
    }

    /// x <- (L D L')^-1 x, on the threads that the hooks lend: groups of subtrees, then what is above them, then the groups again.
    pub fn solve(&self, hooks: &dyn Hooks, x: &mut [Row]) -> Result<(), EigenError> {
        let Tree { groups, segments, .. } = &self.shape.tree;
        if *groups == 0 {
            self.solve_top(segments.iter(), x);
            return Ok(());
        }
        let mut pieces = self.deal(x);
        let mut above = pieces.pop().unwrap_or_default();
        let count: usize = above.iter().map(|(_, rows)| rows.len()).sum();
        let mut memory = self.shape.tops.take().unwrap_or_default();
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
        each(hooks, *groups, &|group| {
            let part = &mut *locked(&parts[group]);
            part.top.copy_from_slice(top);
            for (segment, x) in part.segments.iter_mut().rev() {
                Arch::new().dispatch(Backward { packed: self, segment, x, top: part.top });
            }
        })?;
        drop(parts);
        for (segment, rows) in &mut above {
            rows.copy_from_slice(&top[segment.place..][..rows.len()]);
        }
        self.shape.tops.give(memory);
        Ok(())
    }

    /// The rows of x that belong to each group, and those of the top.
    fn deal<'a>(&'a self, mut x: &'a mut [Row]) -> Vec<Vec<Piece<'a>>> {
        let mut pieces: Vec<Vec<Piece<'_>>> = (0..=self.shape.tree.groups).map(|_| Vec::new()).collect();
        for segment in &self.shape.tree.segments {
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
        let Shape { symbolic, value_starts, tree, .. } = &*self.shape;
        let node = &symbolic.nodes[s];
        let (width, pivots) = (node.width(), &self.inverse_pivots[node.begin..node.end]);
        let begin = node.begin - at.columns.start + at.place;
        let (head, after) = x.split_at_mut((begin + width) * parts);
        let (square, below) = self.values[value_starts[s]..value_starts[s + 1]].split_at(width * width);
        let (near, far) = tree.rows(symbolic, s);
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
pub(super) mod tests {
    use super::*;
    use crate::eigen::factor::Factorizer;
    use crate::eigen::parts::tests::Backwards;
    use crate::eigen::problem::Problem;
    use crate::laplacian::{Area, Operator, laplacian};
    use crate::random::Random;

    /// A bumpy sheet of p x q vertices.
    pub fn sheet(p: u32, q: u32) -> Operator {
        let height = |i: u32, j: u32| 0.3 * (0.7 * f64::from(i)).sin() * (0.4 * f64::from(j)).cos();
        let points = (0..p).flat_map(|i| (0..q).map(move |j| [f64::from(i), f64::from(j), height(i, j)]));
        let squares = (0..p - 1).flat_map(|i| (0..q - 1).map(move |j| i * q + j));
        let faces = squares.flat_map(|a| [[a, a + q, a + q + 1], [a, a + q + 1, a + 1]]);
        laplacian(&points.collect::<Vec<_>>(), &faces.collect::<Vec<_>>(), Area::Mixed, false).expect("a plane mesh")
    }

    fn solved<S: Simd>(simd: S, packed: &Packed, right: &[Row]) -> Vec<Row> {
        let mut x = right.to_vec();
        let segment = &packed.shape.tree.segments[0];
        Forward { packed, segment, x: &mut x, top: &mut [] }.with_simd(simd);
        Backward { packed, segment, x: &mut x, top: &mut [] }.with_simd(simd);
        x
    }

    #[test]
    fn solves_leave_no_residual_and_the_width_of_registers_changes_no_bit() {
        let operator = sheet(34, 26);
        let problem = Problem::of(&operator);
        let factorizer = Factorizer::of(&problem);
        let (order, shift) = (factorizer.order(), 320.0);
        let packed = factorizer.factor(shift, &()).expect("not singular");
        let widest = packed.shape.symbolic.nodes.iter().map(crate::multifrontal::Supernode::width).max();
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
        in_groups_the_solution_is_the_same(&packed, &right, &x);
    }

    fn in_groups_the_solution_is_the_same(packed: &Packed, right: &[Row], whole: &[Row]) {
        assert_eq!(packed.shape.tree.groups, 0);
        let largest = whole.as_flattened().iter().fold(0.0f64, |m, x| m.max(x.abs()));
        for groups in 2..5 {
            let symbolic = packed.shape.symbolic.clone();
            let shape = Shape { tree: Tree::with_groups(&symbolic, groups), ..Shape::new(symbolic) };
            let (values, inverse_pivots) = (packed.values.clone(), packed.inverse_pivots.clone());
            let packed = Packed { shape: Arc::new(shape), values, inverse_pivots };
            let owned = |group: usize| packed.shape.tree.segments.iter().filter(move |segment| segment.owner == group);
            let columns = |group: usize| owned(group).map(|segment| segment.columns.len()).sum::<usize>();
            assert!((0..groups).all(|group| columns(group) > right.len() / (3 * groups)), "no small group");
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
