//! LDL' factorisations of A - shift I, and panel solves with both problems at once.

use super::panel::{Row, add_multiple};
use super::problem::Doubled;
use crate::simd::vectorised;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::cholesky::supernodal::SupernodalLdltRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, SymbolicSupernodalParams};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Par, Side, Spec};

/// What all shifts share: the fill.
pub(super) struct Factoriser<'a> {
    problem: &'a Doubled,
    pattern: SymbolicSparseColMat<usize>,
    symbolic: SymbolicCholesky<usize>,
}

/// Eigenvalues below a shift, zero included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Counts {
    pub neumann: usize,
    pub dirichlet: usize,
}

/// The numbers of a factorisation, supernode by supernode.
pub(super) struct Numbers<'a> {
    factoriser: &'a Factoriser<'a>,
    values: Vec<f64>,
}

impl<'a> Factoriser<'a> {
    /// `None` if memory ran out.
    pub fn new(problem: &'a Doubled) -> Option<Self> {
        let n = problem.n();
        let pattern = |starts: &[usize], rows: &[usize]| {
            SymbolicSparseColMat::new_checked(n, n, starts.to_vec(), None, rows.to_vec())
        };
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            // Merging small supernodes costs some fill, and pays in every solve.
            supernodal_params: SymbolicSupernodalParams { relax: Some(&[(4, 0.5), (16, 0.2), (48, 0.05)]) },
            ..Default::default()
        };
        // faer 0.24 analyses the upper triangle when it does not permute, whatever the side.
        let upper = pattern(&problem.upper_starts, &problem.upper_rows);
        let symbolic =
            factorize_symbolic_cholesky(upper.as_ref(), Side::Upper, SymmetricOrdering::Identity, params).ok()?;
        Some(Self { problem, pattern: pattern(&problem.starts, &problem.rows), symbolic })
    }

    /// The factorisation of A - shift I without pivoting; `None` if it breaks down.
    pub fn factor(&'a self, shift: f64) -> Option<Numbers<'a>> {
        let entries = self.problem.shifted(shift);
        let matrix = SparseColMatRef::new(self.pattern.as_ref(), &entries);
        let mut values = vec![0.0; self.symbolic.len_val()];
        let scratch = self.symbolic.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Spec::default());
        let mut memory = MemBuffer::try_new(scratch).ok()?;
        let (plain, stack) = (LdltRegularization::default(), MemStack::new(&mut memory));
        self.symbolic
            .factorize_numeric_ldlt(&mut values, matrix, Side::Lower, plain, Par::Seq, stack, Spec::default())
            .ok()?;
        let numbers = Numbers { factoriser: self, values };
        // Overflow shows as pivots that are not finite.
        let sound = numbers.pivots().all(|p| p.is_finite() && p != 0.0);
        sound.then_some(numbers)
    }
}

impl Numbers<'_> {
    fn supernodes(&self) -> Option<SupernodalLdltRef<'_, usize, f64>> {
        match self.factoriser.symbolic.raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => Some(SupernodalLdltRef::new(symbolic, &self.values)),
            SymbolicCholeskyRaw::Simplicial(_) => None, // never, as supernodes are forced
        }
    }

    /// The diagonal of D in elimination order.
    fn pivots(&self) -> impl Iterator<Item = f64> {
        let factor = self.supernodes();
        let count = factor.map_or(0, |f| f.symbolic().n_supernodes());
        (0..count).filter_map(move |s| Some(factor?.supernode(s).val())).flat_map(|block| {
            let column = move |j: usize| block[(j, j)];
            (0..block.ncols()).map(column)
        })
    }

    /// How many eigenvalues of each problem are below the shift: by Sylvester's law of inertia the number of negative pivots, of
    /// all and of the leading block.
    pub fn counts(&self) -> Counts {
        let interior = self.factoriser.problem.interior;
        let mut counts = Counts { neumann: 0, dirichlet: 0 };
        for (i, pivot) in self.pivots().enumerate().filter(|(_, pivot)| *pivot < 0.0) {
            debug_assert!(pivot < 0.0);
            counts.neumann += 1;
            counts.dirichlet += usize::from(i < interior);
        }
        counts
    }

    /// Rearranged for panel solves.
    pub fn packed(&self) -> Packed {
        let interior = self.factoriser.problem.interior;
        let n = self.factoriser.problem.n();
        let mut packed =
            Packed { interior, nodes: Vec::new(), rows: Vec::new(), values: Vec::new(), inverse: vec![0.0; n] };
        let Some(factor) = self.supernodes() else { return packed };
        for s in 0..factor.symbolic().n_supernodes() {
            let node = factor.supernode(s);
            let (block, start) = (node.val(), node.start());
            let end = start + block.ncols();
            for j in 0..block.ncols() {
                packed.inverse[start + j] = 1.0 / block[(j, j)];
            }
            // A supernode on both sides of the divide becomes two.
            let divide = interior.clamp(start, end);
            for columns in [start..divide, divide..end].into_iter().filter(|c| !c.is_empty()) {
                let below = columns.end..end;
                packed.nodes.push(Node {
                    begin: columns.start,
                    end: columns.end,
                    rows: packed.rows.len(),
                    values: packed.values.len(),
                });
                packed.rows.extend(below.map(|r| r as u32).chain(node.pattern().iter().map(|&r| r as u32)));
                for r in columns.start - start..block.nrows() {
                    let entry = |c: usize| if r > c { block[(r, c)] } else { 0.0 };
                    packed.values.extend((columns.start - start..columns.end - start).map(entry));
                }
            }
        }
        packed
    }
}

struct Node {
    /// The columns.
    begin: usize,
    end: usize,
    /// Where its row indices and its values begin.
    rows: usize,
    values: usize,
}

/// A supernode of L, and the rows of a panel that it meets.
struct Parts<'a, const L: usize> {
    width: usize,
    /// The column after its last.
    end: usize,
    rows: &'a [u32],
    triangle: &'a [f64],
    below: &'a [f64],
    /// The panel's rows of its columns, and all after them.
    top: &'a mut [Row<L>],
    tail: &'a mut [Row<L>],
}

/// L by supernodes, each stored by rows: first the unit lower triangle, then a row for each later row that it touches.
pub(super) struct Packed {
    interior: usize,
    nodes: Vec<Node>,
    rows: Vec<u32>,
    values: Vec<f64>,
    /// Reciprocals of D.
    inverse: Vec<f64>,
}

impl Packed {
    /// Replaces x by the solution; the lanes of `inner` belong to the Dirichlet problem: they are zero on the boundary.
    pub fn solve<const L: usize>(&self, x: &mut [Row<L>], inner: std::ops::Range<usize>) {
        vectorised(
            #[inline(always)]
            || {
                for node in 0..self.nodes.len() {
                    self.forward(node, x);
                }
                for row in &mut x[self.interior..] {
                    row[inner.clone()].fill(0.0);
                }
                for (row, inverse) in x.iter_mut().zip(&self.inverse) {
                    for lane in row {
                        *lane *= inverse;
                    }
                }
                for node in (0..self.nodes.len()).rev() {
                    self.backward(node, x);
                }
            },
        );
    }

    #[inline(always)]
    fn parts<'a, const L: usize>(&'a self, at: usize, x: &'a mut [Row<L>]) -> Parts<'a, L> {
        let node = &self.nodes[at];
        let (rows, values) =
            self.nodes.get(at + 1).map_or((self.rows.len(), self.values.len()), |next| (next.rows, next.values));
        let width = node.end - node.begin;
        let (triangle, below) = self.values[node.values..values].split_at(width * width);
        let (head, tail) = x.split_at_mut(node.end);
        Parts {
            width,
            end: node.end,
            rows: &self.rows[node.rows..rows],
            triangle,
            below,
            top: &mut head[node.begin..],
            tail,
        }
    }

    #[inline(always)]
    fn forward<const L: usize>(&self, at: usize, x: &mut [Row<L>]) {
        let Parts { width, end, rows, triangle, below, top, tail } = self.parts(at, x);
        for r in 1..width {
            let (done, rest) = top.split_at_mut(r);
            let mut sum = rest[0];
            for (value, x) in triangle[r * width..r * width + r].iter().zip(done) {
                add_multiple(&mut sum, -value, x);
            }
            rest[0] = sum;
        }
        let top = &*top;
        let (quads, rest) = rows.as_chunks::<4>();
        for (q, quad) in quads.iter().enumerate() {
            let target = quad.map(|r| r as usize - end);
            let mut sums = target.map(|t| tail[t]);
            let lines: [&[f64]; 4] = std::array::from_fn(|r| &below[(4 * q + r) * width..][..width]);
            for (c, x) in top.iter().enumerate() {
                for r in 0..4 {
                    add_multiple(&mut sums[r], -lines[r][c], x);
                }
            }
            for r in 0..4 {
                tail[target[r]] = sums[r];
            }
        }
        for (r, &row) in rest.iter().enumerate() {
            let line = &below[(4 * quads.len() + r) * width..][..width];
            let mut sum = tail[row as usize - end];
            for (value, x) in line.iter().zip(top) {
                add_multiple(&mut sum, -value, x);
            }
            tail[row as usize - end] = sum;
        }
    }

    #[inline(always)]
    fn backward<const L: usize>(&self, at: usize, x: &mut [Row<L>]) {
        let Parts { width, end, rows, triangle, below, top, tail } = self.parts(at, x);
        let mut c = 0;
        while c + 4 <= width {
            let mut sums: [Row<L>; 4] = std::array::from_fn(|i| top[c + i]);
            for (&row, line) in rows.iter().zip(below.chunks_exact(width)) {
                let x = tail[row as usize - end];
                let line = &line[c..c + 4];
                for i in 0..4 {
                    add_multiple(&mut sums[i], -line[i], &x);
                }
            }
            top[c..c + 4].copy_from_slice(&sums);
            c += 4;
        }
        for c in c..width {
            let mut sum = top[c];
            for (&row, line) in rows.iter().zip(below.chunks_exact(width)) {
                add_multiple(&mut sum, -line[c], &tail[row as usize - end]);
            }
            top[c] = sum;
        }
        for c in (0..width).rev() {
            let (head, done) = top.split_at_mut(c + 1);
            let mut sum = head[c];
            for (i, x) in done.iter().enumerate() {
                add_multiple(&mut sum, -triangle[(c + 1 + i) * width + c], x);
            }
            head[c] = sum;
        }
    }
}
