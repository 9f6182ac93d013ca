//! A supernodal factor laid out for solves with a whole panel: rows of L contiguous, one pass over L for eight right-hand sides.

use super::panel::Row;
use super::spare::Spare;
use super::tiles::{parts, registers_mut};
use crate::multifrontal::{Eliminated, Keep, Symbolic};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;
use std::sync::Arc;

/// What all factors of a matrix share: their pattern and layout.
pub(super) struct Shape {
    symbolic: Symbolic,
    /// Where the entries of each supernode begin in [`Packed::values`], and their end.
    value_starts: Vec<usize>,
    /// Memory of factors.
    spare: Spare<Vec<f64>>,
}

impl Shape {
    pub fn new(symbolic: Symbolic) -> Self {
        let mut value_starts = vec![0];
        let mut end = 0;
        for node in &symbolic.nodes {
            end += node.width() * node.height();
            value_starts.push(end);
        }
        Self { symbolic, value_starts, spare: Spare::new() }
    }

    pub fn symbolic(&self) -> &Symbolic {
        &self.symbolic
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
    pub fn invert(&mut self, pivots: &[f64]) {
        self.inverse_pivots = pivots.iter().map(|p| 1.0 / p).collect();
    }

    /// The number of negative pivots.
    pub fn negative(&self) -> usize {
        self.inverse_pivots.iter().filter(|p| **p < 0.0).count()
    }

    /// x <- (L D L')^-1 x.
    pub fn solve(&self, x: &mut [Row]) {
        Arch::new().dispatch(Forward { packed: self, x: &mut *x });
        Arch::new().dispatch(Backward { packed: self, x });
    }

    /// The supernode's rows of x, those after it, and its parts of the factor: square, rows below, their entries.
    #[inline(always)]
    fn split<'a, T>(&'a self, s: usize, parts: usize, x: &'a mut [T]) -> Node<'a, T> {
        let Shape { symbolic, value_starts, .. } = &*self.shape;
        let node = &symbolic.nodes[s];
        let (begin, end, width) = (node.begin, node.end, node.width());
        let (head, after) = x.split_at_mut(end * parts);
        let (square, below) = self.values[value_starts[s]..value_starts[s + 1]].split_at(width * width);
        Node {
            width,
            end,
            own: &mut head[begin * parts..],
            after,
            square,
            below,
            rows: &symbolic.rows[node.below()],
            pivots: &self.inverse_pivots[begin..end],
        }
    }
}

/// x <- L^-1 x.
struct Forward<'a> {
    packed: &'a Packed,
    x: &'a mut [Row],
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let x = registers_mut::<S>(self.x);
        for s in 0..self.packed.shape.symbolic.nodes.len() {
            let mut node = self.packed.split(s, parts::<S>(), x);
            for part in 0..parts::<S>() {
                node.forward(simd, part);
            }
        }
    }
}

/// x <- L'^-1 D^-1 x.
struct Backward<'a> {
    packed: &'a Packed,
    x: &'a mut [Row],
}

impl WithSimd for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let x = registers_mut::<S>(self.x);
        for s in (0..self.packed.shape.symbolic.nodes.len()).rev() {
            let mut node = self.packed.split(s, parts::<S>(), x);
            for part in 0..parts::<S>() {
                node.backward(simd, part);
            }
        }
    }
}

/// A supernode, and x in registers, of which a row has several where they are short.
struct Node<'a, T> {
    width: usize,
    end: usize,
    own: &'a mut [T],
    after: &'a mut [T],
    square: &'a [f64],
    below: &'a [f64],
    rows: &'a [u32],
    pivots: &'a [f64],
}

impl<T: Copy> Node<'_, T> {
    #[inline(always)]
    fn forward<S: Simd<f64s = T>>(&mut self, simd: S, part: usize) {
        let mut begin = 0;
        while begin < self.width {
            begin += match self.width - begin {
                8.. => self.eliminate::<S, 8>(simd, part, begin),
                4.. => self.eliminate::<S, 4>(simd, part, begin),
                2.. => self.eliminate::<S, 2>(simd, part, begin),
                _ => self.eliminate::<S, 1>(simd, part, begin),
            };
        }
        let (fours, rest) = self.rows.as_chunks::<4>();
        let (twos, ones) = rest.as_chunks::<2>();
        let mut entries = self.below;
        for rows in fours {
            entries = self.scatter(simd, part, rows, entries);
        }
        for rows in twos {
            entries = self.scatter(simd, part, rows, entries);
        }
        for &row in ones {
            entries = self.scatter(simd, part, &[row], entries);
        }
    }

    /// Solves for R rows of the triangle from `begin` on, once those before are known. Returns R.
    #[inline(always)]
    fn eliminate<S: Simd<f64s = T>, const R: usize>(&mut self, simd: S, part: usize, begin: usize) -> usize {
        let (parts, width) = (parts::<S>(), self.width);
        let l: [&[f64]; R] = std::array::from_fn(|r| &self.square[(begin + r) * width..][..begin + R]);
        let (done, rest) = self.own.split_at_mut(begin * parts);
        let mut sums: [T; R] = std::array::from_fn(|r| rest[r * parts + part]);
        for (c, y) in done.chunks_exact(parts).enumerate() {
            let y = simd.neg_f64s(y[part]);
            for r in 0..R {
                sums[r] = simd.mul_add_f64s(simd.splat_f64s(l[r][c]), y, sums[r]);
            }
        }
        for c in 0..R {
            let y = simd.neg_f64s(sums[c]);
            for r in c + 1..R {
                sums[r] = simd.mul_add_f64s(simd.splat_f64s(l[r][begin + c]), y, sums[r]);
            }
        }
        for r in 0..R {
            rest[r * parts + part] = sums[r];
        }
        R
    }

    /// Subtracts the columns from R rows below, in R sums that do not wait for each other. Returns the entries of the rows after those.
    #[inline(always)]
    fn scatter<'e, S: Simd<f64s = T>, const R: usize>(
        &mut self,
        simd: S,
        part: usize,
        rows: &[u32; R],
        entries: &'e [f64],
    ) -> &'e [f64] {
        let (parts, width) = (parts::<S>(), self.width);
        let (now, later) = entries.split_at(R * width);
        let l: [&[f64]; R] = std::array::from_fn(|r| &now[r * width..][..width]);
        let at = rows.map(|row| (row as usize - self.end) * parts + part);
        let mut sums = at.map(|i| self.after[i]);
        for (c, y) in self.own.chunks_exact(parts).enumerate().take(width) {
            let y = simd.neg_f64s(y[part]);
            for r in 0..R {
                sums[r] = simd.mul_add_f64s(simd.splat_f64s(l[r][c]), y, sums[r]);
            }
        }
        for r in 0..R {
            self.after[at[r]] = sums[r];
        }
        later
    }

    #[inline(always)]
    fn backward<S: Simd<f64s = T>>(&mut self, simd: S, part: usize) {
        for (y, p) in self.own.chunks_exact_mut(parts::<S>()).zip(self.pivots) {
            y[part] = simd.mul_f64s(y[part], simd.splat_f64s(*p));
        }
        let mut end = self.width;
        while end > 0 {
            end -= match end {
                8.. => self.gather::<S, 8, 1>(simd, part, end),
                4.. => self.gather::<S, 4, 2>(simd, part, end),
                2.. => self.gather::<S, 2, 4>(simd, part, end),
                _ => self.gather::<S, 1, 4>(simd, part, end),
            };
        }
    }

    /// Solves for C columns before `end`, once those after are known: C products for each row loaded, U rows in flight so that sums do not wait for
    /// each other. Returns C.
    #[inline(always)]
    fn gather<S: Simd<f64s = T>, const C: usize, const U: usize>(&mut self, simd: S, part: usize, end: usize) -> usize {
        let (parts, width, begin) = (parts::<S>(), self.width, end - C);
        let row = |row: u32| self.after[(row as usize - self.end) * parts + part];
        let mut sums = [[simd.splat_f64s(0.0); C]; U];
        // From the last row to the first, as supernodes go by: memory is then read in one direction.
        let (groups, rest) = self.rows.as_chunks::<U>();
        let (entries, last) = self.below.split_at(groups.len() * U * width);
        for (&r, l) in rest.iter().zip(last.chunks_exact(width)).rev() {
            add_multiples(simd, &mut sums[0], &l[begin..], row(r));
        }
        for (group, now) in groups.iter().zip(entries.chunks_exact(U * width)).rev() {
            for u in (0..U).rev() {
                add_multiples(simd, &mut sums[u], &now[u * width + begin..], row(group[u]));
            }
        }
        let known = self.own[end * parts..].chunks_exact(parts).zip(self.square[end * width..].chunks_exact(width));
        for (y, l) in known.rev() {
            add_multiples(simd, &mut sums[0], &l[begin..], y[part]);
        }
        let mut own: [T; C] = std::array::from_fn(|c| {
            let sum = (1..U).fold(sums[0][c], |sum, u| simd.add_f64s(sum, sums[u][c]));
            simd.sub_f64s(self.own[(begin + c) * parts + part], sum)
        });
        for j in (0..C).rev() {
            let (l, y) = (&self.square[(begin + j) * width + begin..][..C], simd.neg_f64s(own[j]));
            for c in 0..j {
                own[c] = simd.mul_add_f64s(simd.splat_f64s(l[c]), y, own[c]);
            }
        }
        for c in 0..C {
            self.own[(begin + c) * parts + part] = own[c];
        }
        C
    }
}

/// sums + y l, for the first entries of l.
#[inline(always)]
fn add_multiples<S: Simd, const C: usize>(simd: S, sums: &mut [S::f64s; C], l: &[f64], y: S::f64s) {
    let l = &l[..C];
    for c in 0..C {
        sums[c] = simd.mul_add_f64s(simd.splat_f64s(l[c]), y, sums[c]);
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::eigen::factor::Factorizer;
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
        Forward { packed, x: &mut x }.with_simd(simd);
        Backward { packed, x: &mut x }.with_simd(simd);
        x
    }

    #[test]
    fn solves_leave_no_residual_and_the_width_of_registers_changes_no_bit() {
        let operator = sheet(34, 26);
        let problem = Problem::new(&operator.stiffness, &operator.mass).expect("a Laplacian");
        let factorizer = Factorizer::new(&problem).expect("small");
        let (order, shift) = (factorizer.order(), 320.0);
        let packed = factorizer.factor(shift, &()).expect("not singular");
        let widest = packed.shape.symbolic.nodes.iter().map(crate::multifrontal::Supernode::width).max();
        assert!(packed.negative() > 10 && widest > Some(16), "an indefinite factor with all sizes of supernodes");
        let mut random = Random::from_state(7);
        let right: Vec<Row> = order.iter().map(|_| std::array::from_fn(|_| random.signed())).collect();
        let mut x = right.clone();
        packed.solve(&mut x);
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
    }
}
