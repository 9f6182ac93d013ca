//! Arithmetic on panels: n x 8 matrices stored row by row, so that one SIMD register (or two) holds a row.
//!
//! Functions here are written as plain loops over arrays of eight, which the compiler turns into the widest instructions that
//! [`vectorised`](crate::simd::vectorised) finds on the processor. The order of every sum is fixed by the code, not by the number of threads.

use super::EigenError;
use bytemuck::allocation::try_zeroed_vec;

/// Vectors per panel. Measured: 4 ties for small k, 16 and 32 need too many vectors.
pub(crate) const WIDTH: usize = 8;

/// One row of a panel.
pub(crate) type Row = [f64; WIDTH];

/// A small matrix: row i belongs to vector i of the left panel.
pub(crate) type Block = [Row; WIDTH];

pub(crate) const ZERO: Block = [[0.0; WIDTH]; WIDTH];

/// Rows, aligned to cache lines. They come from the allocator, which keeps what is freed (see [`freed`](crate::freed)). No huge pages: where a guest's free memory
/// goes back to its host they took up to 6 ms per MB, small ones 0.6, and passes are no faster.
pub(crate) struct Rows {
    memory: Vec<f64>,
    /// Numbers before them that are not theirs.
    front: usize,
}

impl Rows {
    /// So many rows of zeros.
    pub fn zeroed(count: usize) -> Result<Self, EigenError> {
        Self::zeroed_after(0, count)
    }

    /// The same in memory that begins with room for so many numbers. Pages that are new to the process stay untouched.
    pub fn zeroed_after(front: usize, count: usize) -> Result<Self, EigenError> {
        // Wherever cache lines begin, so many whole rows follow and no more.
        let room = front + count * WIDTH + WIDTH - 1;
        let memory = try_zeroed_vec(room).map_err(|()| EigenError::Memory)?;
        Ok(Self { memory, front })
    }

    pub fn as_slice(&self) -> &[Row] {
        self.memory[self.begin()..].as_chunks().0
    }

    pub fn as_mut_slice(&mut self) -> &mut [Row] {
        let begin = self.begin();
        self.memory[begin..].as_chunks_mut().0
    }

    /// The memory that the rows lie in, from before them.
    pub fn memory_mut(&mut self) -> &mut [f64] {
        &mut self.memory
    }

    pub fn into_memory(self) -> Vec<f64> {
        self.memory
    }

    /// Where the first cache line after the front begins: rows that lie across two are slow to load.
    fn begin(&self) -> usize {
        let after = &self.memory[self.front..];
        self.front + after.as_ptr().align_offset(size_of::<Row>()).min(after.len())
    }
}

/// y -= l x.
#[inline(always)]
pub(crate) fn subtract_multiple(y: &mut Row, l: f64, x: &Row) {
    for q in 0..WIDTH {
        y[q] = (-l).mul_add(x[q], y[q]);
    }
}

pub(crate) fn add(a: &mut Block, b: &Block) {
    for (x, y) in a.as_flattened_mut().iter_mut().zip(b.as_flattened()) {
        *x += y;
    }
}

pub(crate) fn subtract(a: &mut Block, b: &Block) {
    for (x, y) in a.as_flattened_mut().iter_mut().zip(b.as_flattened()) {
        *x -= y;
    }
}

/// Frobenius norm.
pub(crate) fn norm(a: &Block) -> f64 {
    a.as_flattened().iter().map(|x| x * x).sum::<f64>().sqrt()
}

pub(crate) fn transposed(a: &Block) -> Block {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

pub(crate) fn symmetrised(a: &Block) -> Block {
    std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (a[i][j] + a[j][i])))
}

pub(crate) fn product(a: &Block, b: &Block) -> Block {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..WIDTH).map(|k| a[i][k] * b[k][j]).sum()))
}

/// The upper triangular R with g = R' R; nothing unless g is positive definite well above rounding.
pub(crate) fn cholesky(g: &Block) -> Option<Block> {
    let mut r = ZERO;
    for j in 0..WIDTH {
        for i in 0..=j {
            let known: f64 = (0..i).map(|k| r[k][i] * r[k][j]).sum();
            let rest = g[i][j] - known;
            if i < j {
                r[i][j] = rest / r[i][i];
            } else if rest > 1e-13 * g[j][j] && rest.is_finite() {
                r[j][j] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(r)
}

/// The inverse of an upper triangular matrix.
pub(crate) fn inverse(r: &Block) -> Block {
    let mut inverse = ZERO;
    for j in 0..WIDTH {
        inverse[j][j] = 1.0 / r[j][j];
        for i in (0..j).rev() {
            let sum: f64 = (i + 1..=j).map(|k| r[i][k] * inverse[k][j]).sum();
            inverse[i][j] = -sum / r[i][i];
        }
    }
    inverse
}
