//! LDL' factorisations of A - shift I by fronts (Duff & Reid 1983): dense elimination of a supernode's columns at a time.
//!
//! Nothing is pivoted. What a front leaves behind waits on a stack until the parent's front takes it up.

use super::problem::Problem;
use super::symbolic::{CHUNK, Supernode, Symbolic, padded};
use crate::simd::vectorised;

type Chunk = [f64; CHUNK];

/// Rows of a factor that go through a solve together.
pub(super) const TOGETHER: usize = 4;

/// L and D^-1, laid out for solves.
#[derive(Default)]
pub(super) struct Factor {
    /// Per supernode and group of up to [`TOGETHER`] columns: the rows from the group's first column on, as many entries to a row as the
    /// group has columns. In the rows of the columns themselves only what is below the diagonal counts.
    pub values: Vec<f64>,
    pub inverse_pivots: Vec<f64>,
}

/// Memory for factorisations, kept from one to the next.
#[derive(Default)]
pub(super) struct Fronts {
    front: Vec<Chunk>,
    /// Lower triangles, by columns, of what finished fronts leave behind.
    stack: Vec<f64>,
    /// The supernodes on the stack.
    waiting: Vec<usize>,
    multipliers: Vec<f64>,
    pivots: Vec<f64>,
}

impl Factor {
    /// Numbers that it has memory for.
    pub fn capacity(&self) -> usize {
        self.values.capacity() + self.inverse_pivots.capacity()
    }

    /// Factors A - shift I; the number of eigenvalues below the shift, or `None` if it breaks down.
    pub fn compute(
        &mut self,
        symbolic: &Symbolic,
        problem: &Problem,
        shift: f64,
        fronts: &mut Fronts,
    ) -> Option<usize> {
        self.values.clear();
        self.values.reserve(symbolic.values);
        fronts.run(symbolic, problem, shift, Some(&mut self.values))?;
        self.inverse_pivots.clear();
        self.inverse_pivots.extend(fronts.pivots.iter().map(|p| 1.0 / p));
        Some(fronts.negative())
    }
}

impl Fronts {
    /// Numbers that there is memory for.
    pub fn capacity(&self) -> usize {
        CHUNK * self.front.capacity() + self.stack.capacity()
    }

    /// The number of eigenvalues below a shift, or `None` if its factorisation breaks down.
    pub fn count(&mut self, symbolic: &Symbolic, problem: &Problem, shift: f64) -> Option<usize> {
        self.run(symbolic, problem, shift, None)?;
        Some(self.negative())
    }

    /// The number of negative pivots: by Sylvester's law of inertia that of eigenvalues below the shift, zero included.
    fn negative(&self) -> usize {
        self.pivots.iter().filter(|p| **p < 0.0).count()
    }

    /// All pivots, and L if there is a place for it; `None` if it breaks down.
    fn run(
        &mut self,
        symbolic: &Symbolic,
        problem: &Problem,
        shift: f64,
        mut values: Option<&mut Vec<f64>>,
    ) -> Option<()> {
        self.stack.clear();
        self.waiting.clear();
        self.pivots.clear();
        self.front.resize(symbolic.largest / CHUNK, [0.0; CHUNK]);
        vectorised(
            #[inline(always)]
            || {
                for s in 0..symbolic.nodes.len() {
                    let (width, height) = (symbolic.nodes[s].width(), symbolic.height(s));
                    self.assemble(symbolic, problem, s, shift);
                    self.eliminate(width, height)?;
                    if let Some(values) = &mut values {
                        self.keep(width, height, values);
                    }
                    self.stack_rest(width, height);
                    self.waiting.push(s);
                }
                Some(())
            },
        )
    }

    /// The supernode's front: its entries of the matrix, and what its children left.
    #[inline(always)]
    fn assemble(&mut self, symbolic: &Symbolic, problem: &Problem, s: usize, shift: f64) {
        let Supernode { begin, end, children, .. } = symbolic.nodes[s];
        let height = symbolic.height(s);
        let pitch = padded(height);
        let chunks = &mut self.front[..height * pitch / CHUNK];
        for (j, column) in chunks.chunks_exact_mut(pitch / CHUNK).enumerate() {
            column[j / CHUNK..].fill([0.0; CHUNK]);
        }
        let front = chunks.as_flattened_mut();
        for (j, column) in front.chunks_exact_mut(pitch).take(end - begin).enumerate() {
            column[j] = problem.diagonal[begin + j] - shift;
            let entries = problem.starts[begin + j] as usize..problem.starts[begin + j + 1] as usize;
            for (&at, &entry) in symbolic.in_front[entries.clone()].iter().zip(&problem.entries[entries]) {
                column[at as usize] += entry;
            }
        }
        // The last child is on top of the stack.
        for child in self.waiting.drain(self.waiting.len() - children..).rev() {
            let places = &symbolic.in_parent[symbolic.range(child)];
            let size = places.len() * (places.len() + 1) / 2;
            let top = self.stack.len() - size;
            let mut rest = &self.stack[top..];
            for (k, &column) in places.iter().enumerate() {
                let (now, later) = rest.split_at(places.len() - k);
                rest = later;
                let column = &mut front[column as usize * pitch..][..pitch];
                for (&at, &x) in places[k..].iter().zip(now) {
                    column[at as usize] += x;
                }
            }
            self.stack.truncate(top);
        }
    }

    /// Eliminates the first `width` columns of a front; `None` if a pivot vanishes or overflows.
    #[inline(always)]
    fn eliminate(&mut self, width: usize, height: usize) -> Option<()> {
        let pitch = padded(height) / CHUNK;
        // The multiples of earlier columns that are subtracted from a column: what is left of its row, times the pivots.
        let (first, multipliers) = (self.pivots.len(), &mut self.multipliers);
        for j in 0..height {
            let known = j.min(width);
            let (done, rest) = self.front.split_at_mut(j * pitch);
            multipliers.clear();
            for (c, pivot) in self.pivots[first..first + known].iter().enumerate() {
                multipliers.push(done[c * pitch + j / CHUNK][j % CHUNK] * pivot);
            }
            let from = j / CHUNK;
            let target = &mut rest[from..pitch];
            subtract_columns(target, done, pitch, from, multipliers);
            if j < width {
                let pivot = target[0][j % CHUNK];
                let inverse = 1.0 / pivot;
                if !inverse.is_finite() || inverse == 0.0 {
                    return None;
                }
                self.pivots.push(pivot);
                for x in target.as_flattened_mut() {
                    *x *= inverse;
                }
            }
        }
        Some(())
    }

    /// Appends the eliminated columns in the order of solves.
    #[inline(always)]
    fn keep(&self, width: usize, height: usize, values: &mut Vec<f64>) {
        let (front, pitch) = (self.front.as_flattened(), padded(height));
        let mut c = 0;
        while c < width {
            let columns = &front[c * pitch + c..];
            c += match width - c {
                TOGETHER.. => interleave::<TOGETHER>(columns, pitch, height - c, values),
                2.. => interleave::<2>(columns, pitch, height - c, values),
                _ => interleave::<1>(columns, pitch, height - c, values),
            };
        }
    }

    #[inline(always)]
    fn stack_rest(&mut self, width: usize, height: usize) {
        let (front, pitch) = (self.front.as_flattened(), padded(height));
        for j in width..height {
            self.stack.extend_from_slice(&front[j * pitch + j..j * pitch + height]);
        }
    }
}

/// Appends C columns of this height row by row; C.
#[inline(always)]
fn interleave<const C: usize>(columns: &[f64], pitch: usize, height: usize, values: &mut Vec<f64>) -> usize {
    let from = values.len();
    values.resize(from + C * height, 0.0);
    let columns: [&[f64]; C] = std::array::from_fn(|i| &columns[i * pitch..][..height]);
    for (r, row) in values[from..].as_chunks_mut::<C>().0.iter_mut().enumerate() {
        for i in 0..C {
            row[i] = columns[i][r];
        }
    }
    C
}

/// Subtracts multiples of columns from a column, from chunk `from` on.
#[inline(always)]
fn subtract_columns(target: &mut [Chunk], columns: &[Chunk], pitch: usize, from: usize, multipliers: &[f64]) {
    let mut at = 0;
    while at < target.len() {
        let (rest, begin) = (&mut target[at..], from + at);
        at += match rest.len() {
            4.. => subtract::<4>(rest, columns, pitch, begin, multipliers),
            2.. => subtract::<2>(rest, columns, pitch, begin, multipliers),
            _ => subtract::<1>(rest, columns, pitch, begin, multipliers),
        };
    }
}

/// The same for C chunks, which stay in registers; C.
#[inline(always)]
fn subtract<const C: usize>(
    target: &mut [Chunk],
    columns: &[Chunk],
    pitch: usize,
    begin: usize,
    multipliers: &[f64],
) -> usize {
    let mut sums = [[0.0; CHUNK]; C];
    sums.copy_from_slice(&target[..C]);
    for (multiplier, column) in multipliers.iter().zip(columns.chunks_exact(pitch)) {
        let column = &column[begin..begin + C];
        for c in 0..C {
            for l in 0..CHUNK {
                sums[c][l] = (-multiplier).mul_add(column[c][l], sums[c][l]);
            }
        }
    }
    target[..C].copy_from_slice(&sums);
    C
}
