//! Numeric factorisation: fronts are assembled, eliminated in part, and what is left waits for the parent.

use super::dense::{CHUNK, Dense, padded};
use super::symbolic::triangle;
use super::{Lower, Supernode, Symbolic};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// The eliminated columns of a front.
pub(crate) struct Eliminated<'a> {
    /// The supernode that they belong to.
    pub node: &'a Supernode,
    /// L by columns, `pitch` entries apart, of which the first [`Supernode::height`] count: below the diagonal, since what is above it has no meaning, nor has the
    /// diagonal.
    pub columns: &'a [f64],
    pub pitch: usize,
}

/// A - shift I in elimination order, and the pattern of its factor.
#[derive(Clone, Copy)]
pub(crate) struct Shifted<'a> {
    pub symbolic: &'a Symbolic,
    pub lower: &'a Lower,
    pub shift: f64,
}

/// What takes the factor, supernode after supernode.
pub(crate) trait Keep {
    /// Called once for each supernode, in elimination order. Must be inlined for the vector instructions of the caller.
    fn keep(&mut self, front: &Eliminated<'_>);
}

/// Pivots are all that is wanted.
impl Keep for () {
    #[inline(always)]
    fn keep(&mut self, _: &Eliminated<'_>) {}
}

/// Memory for factorisations, kept from one to the next.
#[derive(Default)]
pub(crate) struct Fronts {
    front: Vec<f64>,
    /// Lower triangles, by columns, of what finished fronts leave behind.
    stack: Vec<f64>,
    /// The supernodes on the stack.
    waiting: Vec<usize>,
    multipliers: Vec<[f64; CHUNK]>,
    /// The diagonal of D.
    pub pivots: Vec<f64>,
}

/// A finished part of a factorisation: what its parents need.
#[derive(Default)]
pub(crate) struct Branch {
    nodes: Range<usize>,
    stack: Vec<f64>,
    waiting: Vec<usize>,
    pivots: Vec<f64>,
}

impl Fronts {
    /// Numbers that there is memory for.
    pub fn capacity(&self) -> usize {
        self.front.capacity() + self.stack.capacity()
    }

    /// Factors A - shift I. The number of negative pivots, which by Sylvester's law of inertia is that of eigenvalues below the shift; `None` if a pivot
    /// vanishes or overflows.
    pub fn factor(&mut self, matrix: &Shifted<'_>, keep: &mut impl Keep) -> Option<usize> {
        self.join(matrix, &[], keep)
    }

    /// The same for one of [`Symbolic::branches`] alone, in memory of another one that is done with.
    pub fn branch(
        &mut self,
        matrix: &Shifted<'_>,
        nodes: Range<usize>,
        keep: &mut impl Keep,
        memory: Branch,
    ) -> Option<Branch> {
        self.run(matrix, nodes.clone(), &[], keep)?;
        let mut branch = Branch { nodes, ..memory };
        branch.stack.clone_from(&self.stack);
        branch.waiting.clone_from(&self.waiting);
        branch.pivots.clone_from(&self.pivots);
        Some(branch)
    }

    /// The same as [`Fronts::factor`] where some branches are done. Only the others are kept.
    pub fn join(&mut self, matrix: &Shifted<'_>, branches: &[Branch], keep: &mut impl Keep) -> Option<usize> {
        self.run(matrix, 0..matrix.symbolic.nodes.len(), branches, keep)?;
        Some(self.pivots.iter().filter(|p| **p < 0.0).count())
    }

    fn run(
        &mut self,
        matrix: &Shifted<'_>,
        nodes: Range<usize>,
        branches: &[Branch],
        keep: &mut impl Keep,
    ) -> Option<()> {
        self.stack.clear();
        self.waiting.clear();
        self.pivots.clear();
        self.stack.reserve_exact(matrix.symbolic.stack);
        let largest = matrix.symbolic.nodes[nodes.clone()].iter().map(Supernode::height).max();
        let size = padded(largest.unwrap_or(0));
        // Fronts begin where a cache line does.
        let room = self.front.len().max(size * size + CHUNK);
        self.front.resize(room, 0.0);
        Arch::new().dispatch(Factorisation { fronts: self, matrix, nodes, branches, keep })
    }
}

struct Factorisation<'a, K> {
    fronts: &'a mut Fronts,
    matrix: &'a Shifted<'a>,
    nodes: Range<usize>,
    branches: &'a [Branch],
    keep: &'a mut K,
}

impl<K: Keep> WithSimd for Factorisation<'_, K> {
    type Output = Option<()>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Option<()> {
        let Self { fronts: Fronts { front, stack, waiting, multipliers, pivots }, matrix, nodes, branches, keep } =
            self;
        let symbolic = matrix.symbolic;
        let mut branches = branches.iter().peekable();
        let mut s = nodes.start;
        while s < nodes.end {
            if let Some(branch) = branches.next_if(|branch| branch.nodes.start == s) {
                stack.extend_from_slice(&branch.stack);
                waiting.extend_from_slice(&branch.waiting);
                pivots.extend_from_slice(&branch.pivots);
                s = branch.nodes.end;
                continue;
            }
            let node = &symbolic.nodes[s];
            let (height, pitch) = (node.height(), padded(node.height()));
            let begin = front.as_ptr().align_offset(64).min(CHUNK);
            let front = &mut front[begin..][..pitch * pitch];
            clear(front, pitch);
            add_entries(front, pitch, matrix, node);
            // The last child is on top of the stack.
            for child in waiting.drain(waiting.len() - node.children..).rev() {
                let places = &symbolic.in_parent[symbolic.nodes[child].below()];
                let top = stack.len() - triangle(places.len());
                add_child(front, pitch, places, &stack[top..]);
                stack.truncate(top);
            }
            Dense { front, pitch, multipliers }.eliminate(simd, node.width(), pivots)?;
            keep.keep(&Eliminated { node, columns: &front[..node.width() * pitch], pitch });
            for j in node.width()..height {
                stack.extend_from_slice(&front[j * pitch + j..j * pitch + height]);
            }
            waiting.push(s);
            s += 1;
        }
        Some(())
    }
}

/// Zeros in the lower triangle, and as far above it as chunks reach.
#[inline(always)]
fn clear(front: &mut [f64], pitch: usize) {
    for (j, column) in front.chunks_exact_mut(pitch).enumerate() {
        column.as_chunks_mut::<CHUNK>().0[j / CHUNK..].fill([0.0; CHUNK]);
    }
}

/// Adds the matrix's entries in a supernode's columns.
#[inline(always)]
fn add_entries(front: &mut [f64], pitch: usize, matrix: &Shifted<'_>, node: &Supernode) {
    let Shifted { symbolic, lower, shift } = matrix;
    for (at, column) in front.chunks_exact_mut(pitch).take(node.width()).enumerate() {
        let j = node.begin + at;
        column[at] = lower.diagonal[j] - shift;
        let entries = lower.starts[j] as usize..lower.starts[j + 1] as usize;
        for (&at, &entry) in symbolic.in_front[entries.clone()].iter().zip(&lower.entries[entries]) {
            column[at as usize] += entry;
        }
    }
}

/// Adds what a child left.
#[inline(always)]
fn add_child(front: &mut [f64], pitch: usize, places: &[u32], mut rest: &[f64]) {
    for (k, &column) in places.iter().enumerate() {
        let (now, later) = rest.split_at(places.len() - k);
        rest = later;
        let column = &mut front[column as usize * pitch..][..pitch];
        for (&at, &x) in places[k..].iter().zip(now) {
            column[at as usize] += x;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::symbolic::tests::matrix;
    use super::*;
    use crate::multifrontal::Elimination;
    use crate::random::Random;
    use crate::sparse::SymmetricCsr;
    use faer::{Mat, Side};

    /// L as a dense matrix.
    struct Full<'a>(Mat<f64>, &'a Symbolic);

    impl Keep for Full<'_> {
        fn keep(&mut self, front: &Eliminated<'_>) {
            let node = front.node;
            let rows = (node.begin..node.end).chain(self.1.rows[node.below()].iter().map(|&r| r as usize));
            for (at, row) in rows.enumerate() {
                for c in 0..node.width().min(at) {
                    self.0[(row, node.begin + c)] = front.columns[c * front.pitch + at];
                }
            }
        }
    }

    fn dense(lower: &Lower) -> Mat<f64> {
        let mut a = Mat::zeros(lower.n(), lower.n());
        for j in 0..lower.n() {
            a[(j, j)] = lower.diagonal[j];
            for (i, x) in lower.column(j) {
                (a[(i, j)], a[(j, i)]) = (x, x);
            }
        }
        a
    }

    fn check(matrix: &SymmetricCsr, shifts: &[f64], largest: usize) {
        let elimination = Elimination::minimum_degree(matrix).expect("memory");
        let mut random = Random::new(&[3]);
        let roots: Vec<f64> = (0..matrix.n()).map(|_| 0.8 + 0.4 * random.unit()).collect();
        let lower = Lower::scaled(matrix, &elimination, &roots);
        let symbolic = Symbolic::new(&elimination, &[(4, 0.5), (16, 0.2)]);
        let matrix = Shifted { symbolic: &symbolic, lower: &lower, shift: 0.0 };
        assert!(symbolic.nodes.iter().any(|node| node.height() >= largest));
        let a = dense(&lower);
        let values = a.self_adjoint_eigenvalues(Side::Lower).expect("converges");
        let mut fronts = Fronts::default();
        for &shift in shifts {
            let below = values.iter().filter(|v| **v < shift).count();
            assert_eq!(fronts.factor(&Shifted { shift, ..matrix }, &mut ()), Some(below), "below {shift}");
            let mut full = Full(Mat::identity(lower.n(), lower.n()), &symbolic);
            assert_eq!(fronts.factor(&Shifted { shift, ..matrix }, &mut full), Some(below));
            let scaled = Mat::from_fn(lower.n(), lower.n(), |i, j| full.0[(i, j)] * fronts.pivots[j]);
            let difference = scaled * full.0.transpose() - &a + Mat::<f64>::identity(lower.n(), lower.n()) * shift;
            let growth = full.0.norm_max() * full.0.norm_max() * (1.0 + a.norm_max());
            assert!(difference.norm_max() < 1e-12 * growth, "{} at {shift}", difference.norm_max());
        }
    }

    #[test]
    fn factors_are_those_of_the_matrix_and_count_its_eigenvalues() {
        check(&SymmetricCsr::graph_laplacian(1, std::iter::empty(), &[]), &[-1.0, 0.5], 1);
        check(&matrix(1, 0, 0), &[-0.5, 1.2], 1);
        check(&matrix(13, 0, 4), &[-0.1, 0.9, 4.3, 20.0], 8);
        // A separator of hundreds of rows.
        check(&matrix(20, 700, 2), &[-0.1, 3.7, 9.1], 150);
    }

    #[test]
    fn branches_change_no_bit() {
        let matrix = matrix(30, 20, 3);
        let elimination = Elimination::minimum_degree(&matrix).expect("memory");
        let lower = Lower::scaled(&matrix, &elimination, &vec![1.0; matrix.n()]);
        let symbolic = Symbolic::new(&elimination, &[(4, 0.5), (16, 0.2)]);
        let matrix = Shifted { symbolic: &symbolic, lower: &lower, shift: 1.7 };
        let (mut fronts, mut other) = (Fronts::default(), Fronts::default());
        let mut whole = Full(Mat::identity(lower.n(), lower.n()), &symbolic);
        let below = fronts.factor(&matrix, &mut whole);
        assert!(below > Some(100));
        for (share, least, count) in [(0.5, 0.0, 2), (0.1, 0.0, 8), (1.0, 0.0, 1), (0.1, 1e9, 0)] {
            let ranges = symbolic.branches(share, least);
            assert!(ranges.len() >= count && (count > 0 || ranges.is_empty()), "{} of {share}", ranges.len());
            assert!(ranges.is_sorted_by(|a, b| a.end <= b.start));
            let mut parts = Full(Mat::identity(lower.n(), lower.n()), &symbolic);
            // In any order, in used memory.
            let branches =
                ranges.into_iter().rev().map(|range| other.branch(&matrix, range, &mut parts, Branch::default()));
            let mut branches: Vec<Branch> = branches.collect::<Option<_>>().expect("no breakdown");
            branches.reverse();
            assert_eq!(other.join(&matrix, &branches, &mut parts), below);
            assert_eq!(other.pivots, fronts.pivots);
            assert!(parts.0 == whole.0);
        }
    }

    #[test]
    fn one_front_may_be_all_of_it() {
        let n = 141;
        let ends = (0..n).flat_map(|i| (0..i).map(move |j| (i, j)));
        let mut random = Random::new(&[n.into()]);
        let weights: Vec<f64> = ends.clone().map(|_| random.signed()).collect();
        check(&SymmetricCsr::graph_laplacian(n as usize, ends, &weights), &[-7.3, 0.4, 11.0], 141);
    }

    #[test]
    fn breakdown_is_told_and_what_was_computed_before_does_not_matter() {
        // Isolated rows have no entries: their pivot is minus the shift.
        let matrix = matrix(9, 0, 1);
        let elimination = Elimination::minimum_degree(&matrix).expect("memory");
        let lower = Lower::scaled(&matrix, &elimination, &vec![1.0; matrix.n()]);
        let symbolic = Symbolic::new(&elimination, &[]);
        let matrix = Shifted { symbolic: &symbolic, lower: &lower, shift: 0.0 };
        let mut fronts = Fronts::default();
        let below = fronts.factor(&Shifted { shift: 0.3, ..matrix }, &mut ());
        let pivots = fronts.pivots.clone();
        assert!(below > Some(2));
        assert_eq!(fronts.factor(&Shifted { shift: 0.0, ..matrix }, &mut ()), None);
        assert_eq!(fronts.factor(&Shifted { shift: f64::NAN, ..matrix }, &mut ()), None);
        assert_eq!(fronts.factor(&Shifted { shift: 0.3, ..matrix }, &mut ()), below);
        assert_eq!(fronts.pivots, pivots);
    }
}
