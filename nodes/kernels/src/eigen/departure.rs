//! Where a Krylov basis departs from the three-term recurrence.
//!
//! Orthogonalising against the whole basis only now and then (Simon 1984) removes products that have grown from rounding errors to about
//! 1e-7. What was removed is known, so the relation stays exact: B V = V (T + N) + rest, N made of those products. Eigenvalues of T are then
//! those of the projection of B up to rounding, and eigenvectors of T + N, to first order in N, give Ritz vectors that are as orthogonal, and
//! as accurate, as if every step had been orthogonalised in full.

use super::panel::{Block, WIDTH, ZERO, add, product, subtract, transposed};
use super::parts::{each, locked};
use super::{EigenError, Hooks, dense};
use crate::simd::vectorised;
use faer::linalg::matmul::matmul;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, Mat, MatMut, MatRef, Par, Scale};
use std::ops::AddAssign;
use std::sync::Mutex;

/// Mixing of two eigenvectors by more than this is not of first order. Their eigenvalues are then equal up to rounding, and any mixture is as good.
const SMALL: f64 = 1e-4;

/// Eigenvectors that are worth a thread.
const PART: usize = 32;

/// The recurrence as far as it goes: T, symmetric, in blocks.
#[derive(Default)]
pub(super) struct Recurrence {
    /// Diagonal blocks of the projection of B, and those below: V_(j+1) below[j] is what was left of B V_j.
    pub diagonal: Vec<Block>,
    pub below: Vec<Block>,
    /// Blocks further away from the diagonal, by row and column: products with what fresh blocks have replaced.
    pub couplings: Vec<(usize, usize, Block)>,
}

impl Recurrence {
    /// T.
    pub fn matrix(&self) -> Mat<f64> {
        let blocks = self.diagonal.len();
        let mut matrix = Mat::<f64>::zeros(blocks * WIDTH, blocks * WIDTH);
        let mut set = |row: usize, column: usize, block: &Block| {
            for p in 0..WIDTH {
                for q in 0..WIDTH {
                    matrix[(row * WIDTH + p, column * WIDTH + q)] = block[p][q];
                    matrix[(column * WIDTH + q, row * WIDTH + p)] = block[p][q];
                }
            }
        };
        for j in 0..blocks {
            set(j, j, &self.diagonal[j]);
            if j + 1 < blocks {
                set(j + 1, j, &self.below[j]);
            }
        }
        for (row, column, block) in &self.couplings {
            set(*row, *column, block);
        }
        matrix
    }

    /// Entries of T by row and column, at and below the diagonal, at most eight rows below it; nothing if there are couplings.
    pub fn band(&self) -> Option<impl Fn(usize, usize) -> f64> {
        self.couplings.is_empty().then_some(|i: usize, j: usize| {
            let block = if i / WIDTH == j / WIDTH { &self.diagonal[i / WIDTH] } else { &self.below[j / WIDTH] };
            block[i % WIDTH][j % WIDTH]
        })
    }

    /// Row i of T c.
    fn times(&self, c: &[Block], i: usize) -> Block {
        let mut row = ZERO;
        if i > 0 && i <= c.len() {
            add(&mut row, &product(&self.below[i - 1], &c[i - 1]));
        }
        if i < c.len() {
            add(&mut row, &product(&self.diagonal[i], &c[i]));
        }
        if i + 1 < c.len() {
            add(&mut row, &product(&transposed(&self.below[i]), &c[i + 1]));
        }
        row
    }
}

/// N, by columns of blocks.
#[derive(Default)]
pub(super) struct Departure {
    columns: Vec<(usize, Vec<Block>)>,
}

impl Departure {
    /// Notes that the last V_j of the recurrence lost V c, and what is left of B V_j, before it became V_(j+1), lost V d: `removed` holds blocks of c
    /// and d of the first panels, two less than there are at most.
    pub fn note(&mut self, removed: &[[Block; 2]], recurrence: &Recurrence) {
        if removed.is_empty() {
            return;
        }
        let j = recurrence.diagonal.len() - 1;
        let c: Vec<Block> = removed.iter().map(|r| r[0]).collect();
        self.columns.push((j - 1, c.iter().map(|c| product(c, &recurrence.below[j - 1])).collect()));
        let column = (0..=removed.len()).map(|i| {
            let mut entry = ZERO;
            if let Some([c, d]) = removed.get(i) {
                add(&mut entry, d);
                add(&mut entry, &product(c, &recurrence.diagonal[j]));
            }
            subtract(&mut entry, &recurrence.times(&c, i));
            entry
        });
        self.columns.push((j, column.collect()));
    }

    /// Eigenvectors number `chosen` of T + N, to first order in N, from the eigenpairs of T that are nearest to the shift. Below and beside them there is room
    /// for a block of rows and for whole blocks of columns: zeros.
    pub fn correct(
        &self,
        values: &[f64],
        vectors: MatRef<'_, f64>,
        chosen: &[usize],
        hooks: &dyn Hooks,
    ) -> Result<Mat<f64>, EigenError> {
        let m = vectors.nrows();
        let mut room = Mat::zeros(m + WIDTH, chosen.len().next_multiple_of(WIDTH));
        for (j, &column) in chosen.iter().enumerate() {
            room.col_mut(j).subrows_mut(0, m).copy_from(vectors.col(column));
        }
        if self.columns.is_empty() {
            return Ok(room);
        }
        let blocks = self.blocks(m);
        let (mut parts, mut rest) = (Vec::new(), room.submatrix_mut(0, 0, m, chosen.len()));
        for chosen in chosen.chunks(PART) {
            let (own, others) = rest.split_at_col_mut(chosen.len());
            parts.push(Mutex::new(Part { departure: self, blocks: blocks.as_ref(), values, vectors, chosen, own }));
            rest = others;
        }
        each(hooks, parts.len(), &|i| locked(&parts[i]).correct())?;
        drop(parts);
        Ok(room)
    }

    /// The columns of N that are not zero.
    fn blocks(&self, m: usize) -> Mat<f64> {
        let mut matrix = Mat::<f64>::zeros(m, self.columns.len() * WIDTH);
        for (c, (_, blocks)) in self.columns.iter().enumerate() {
            for p in 0..WIDTH {
                let rows = matrix.col_as_slice_mut(c * WIDTH + p).as_chunks_mut::<WIDTH>().0;
                rows.iter_mut().zip(blocks).for_each(|(row, block)| *row = block.map(|row| row[p]));
            }
        }
        matrix
    }
}

/// Some of the eigenvectors that are to be corrected.
struct Part<'a> {
    departure: &'a Departure,
    blocks: MatRef<'a, f64>,
    values: &'a [f64],
    vectors: MatRef<'a, f64>,
    chosen: &'a [usize],
    /// Them, as they are before that.
    own: MatMut<'a, f64>,
}

impl Part<'_> {
    fn correct(&mut self) {
        let Self { departure, blocks, values, vectors, chosen, own } = self;
        let mut own = own.as_mut();
        let mut along = Mat::<f64>::zeros(blocks.ncols(), chosen.len());
        for (c, (column, _)) in departure.columns.iter().enumerate() {
            along.subrows_mut(c * WIDTH, WIDTH).copy_from(own.rb().subrows(column * WIDTH, WIDTH));
        }
        // N s, and its products with the vectors at hand. Beyond these eigenvalues are small: there (theta - T)^-1 is about 1 / theta.
        let departed = dense::product(*blocks, along.as_ref());
        let mut mixed = dense::inner(*vectors, departed.as_ref());
        for (j, &column) in chosen.iter().enumerate() {
            let (inverse, mixed) = (1.0 / values[column], mixed.col_as_slice_mut(j));
            vectorised(
                #[inline(always)]
                || {
                    for (x, value) in mixed.iter_mut().zip(*values) {
                        let difference = values[column] - value;
                        let small = x.abs() < SMALL * difference.abs();
                        *x *= if small { 1.0 / difference } else { 0.0 } - inverse;
                    }
                },
            );
            own.rb_mut().col_mut(j).add_assign(Scale(inverse) * departed.col(j));
        }
        matmul(own.rb_mut(), Accum::Add, *vectors, mixed.as_ref(), 1.0, Par::Seq);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn corrected_vectors_are_those_of_the_departed_recurrence() {
        let mut random = Random::new(&[9]);
        let (blocks, scale) = (12, 1e-6);
        let mut block =
            |scale: f64| -> Block { std::array::from_fn(|_| std::array::from_fn(|_| scale * random.signed())) };
        // Eigenvalues shrink towards the end, as those of Krylov spaces do.
        let mut recurrence = Recurrence::default();
        for j in 0..blocks {
            let size = 0.5f64.powi(j);
            let diagonal = block(size);
            recurrence.diagonal.push(std::array::from_fn(|p| std::array::from_fn(|q| diagonal[p][q] + diagonal[q][p])));
            recurrence.below.push(block(0.1 * size));
        }
        let t = recurrence.matrix();
        let (values, vectors) = dense::symmetric_eigen(t.as_ref()).expect("converges");
        let m = values.len();
        let departure =
            Departure { columns: [0, 1].map(|column| (column, (0..5).map(|_| block(scale)).collect())).into() };
        let mut departed = t.clone();
        for (column, blocks) in &departure.columns {
            for (i, block) in blocks.iter().enumerate() {
                for (p, q) in (0..WIDTH).flat_map(|p| (0..WIDTH).map(move |q| (p, q))) {
                    departed[(i * WIDTH + p, column * WIDTH + q)] += block[p][q];
                }
            }
        }
        // The nearest to the shift have the largest magnitudes; the last of 40 is a tenth to a hundredth of them.
        let mut order: Vec<usize> = (0..m).collect();
        order.sort_by(|&a, &b| values[b].abs().total_cmp(&values[a].abs()));
        let known: Vec<f64> = order[..40].iter().map(|&i| values[i]).collect();
        let columns = Mat::from_fn(m, 40, |i, j| vectors[(i, order[j])]);
        let residual = |s: MatRef<'_, f64>, j: usize| {
            let product: Vec<f64> = (0..m).map(|i| (0..m).map(|l| departed[(i, l)] * s[(l, j)]).sum()).collect();
            let [along, norm] = [0, 1].map(|n| (0..m).map(|i| [product[i], s[(i, j)]][n] * s[(i, j)]).sum::<f64>());
            (0..m).map(|i| (product[i] - along / norm * s[(i, j)]).powi(2)).sum::<f64>().sqrt()
        };
        let chosen: Vec<usize> = (0..10).collect();
        let corrected = departure.correct(&known, columns.as_ref(), &chosen, &()).expect("not cancelled");
        for j in chosen {
            let (before, after) = (residual(columns.as_ref(), j), residual(corrected.as_ref(), j));
            assert!(before > 0.1 * scale && after < 0.05 * before, "{j}: {before:e} {after:e}");
        }
    }
}
