//! Elimination of the first columns of a dense symmetric matrix.
//!
//! Columns go in panels of eight. Every entry is updated by one column after the other, in ascending order and by one fused operation each: neither the
//! blocking nor the width of registers changes a bit.

use pulp::Simd;

/// Columns of a panel, and rows of a chunk: fronts are padded to multiples of it.
pub(super) const CHUNK: usize = 8;

/// Eliminated columns whose multiples are subtracted from all later ones in one pass over these.
const BLOCK: usize = 64;

type Chunk = [f64; CHUNK];

/// Entries from one column of a front of this height to the next, and the number of columns that there is room for.
pub(super) fn padded(height: usize) -> usize {
    height.next_multiple_of(CHUNK)
}

/// Registers in a chunk.
#[inline(always)]
fn parts<S: Simd>() -> usize {
    CHUNK / S::F64_LANES
}

/// A symmetric matrix, its lower triangle by columns; what is above the diagonal in the chunks of the diagonal is written, but never read into what is below.
pub(super) struct Dense<'a> {
    pub front: &'a mut [f64],
    /// Entries from a column to the next, and the number of columns.
    pub pitch: usize,
    /// Memory.
    pub multipliers: &'a mut Vec<Chunk>,
}

impl Dense<'_> {
    /// Turns the first `width` columns into those of L, appends their pivots, and leaves the Schur complement in the others. `None` if a pivot vanishes or overflows.
    #[inline(always)]
    pub fn eliminate<S: Simd>(&mut self, simd: S, width: usize, pivots: &mut Vec<f64>) -> Option<()> {
        let first = pivots.len();
        for begin in (0..width).step_by(BLOCK) {
            let end = width.min(begin + BLOCK);
            for panel in (begin..self.pitch).step_by(CHUNK) {
                let known = begin..panel.min(end);
                self.update(simd, panel, known.start, &pivots[first + known.start..first + known.end]);
                if panel < end {
                    self.factor_panel(simd, panel, CHUNK.min(end - panel), pivots)?;
                }
            }
        }
        Some(())
    }

    /// Subtracts multiples of the columns that have these pivots from the panel that begins at a column.
    #[inline(always)]
    fn update<S: Simd>(&mut self, simd: S, panel: usize, from: usize, pivots: &[f64]) {
        let pitch = self.pitch;
        let (done, rest) = self.front.split_at_mut(panel * pitch);
        let done = &done[from * pitch..][..pivots.len() * pitch];
        // Minus what is left of the panel's rows times the pivots.
        self.multipliers.clear();
        for (column, pivot) in done.chunks_exact(pitch).zip(pivots) {
            let rows = &column[panel..panel + CHUNK];
            self.multipliers.push(std::array::from_fn(|r| -(rows[r] * pivot)));
        }
        let registers = S::as_mut_simd_f64s(&mut rest[..CHUNK * pitch]).0;
        let (begin, end) = (panel / CHUNK * parts::<S>(), pitch / CHUNK * parts::<S>());
        let mut update =
            Update { panel: registers, columns: S::as_simd_f64s(done).0, pitch: end, multipliers: self.multipliers };
        let mut at = begin;
        while at < end {
            at += match end - at {
                3.. => update.rows::<S, 3>(simd, at),
                2 => update.rows::<S, 2>(simd, at),
                _ => update.rows::<S, 1>(simd, at),
            };
        }
    }

    /// Eliminates the first columns of the panel that begins at a column.
    #[inline(always)]
    fn factor_panel<S: Simd>(&mut self, simd: S, panel: usize, columns: usize, pivots: &mut Vec<f64>) -> Option<()> {
        let pitch = self.pitch;
        let target = &mut self.front[panel * pitch..][..CHUNK * pitch];
        let mut inverses = [0.0; CHUNK];
        let mut multipliers = [[0.0; CHUNK]; CHUNK];
        for c in 0..columns {
            let (head, rest) = target.split_at_mut((c + 1) * pitch);
            let column = &mut head[c * pitch + panel..][..CHUNK];
            let pivot = column[c];
            let inverse = 1.0 / pivot;
            if !inverse.is_finite() || inverse == 0.0 {
                return None;
            }
            pivots.push(pivot);
            inverses[c] = inverse;
            for r in 0..CHUNK {
                column[r] *= inverse;
                multipliers[c][r] = -(column[r] * pivot);
            }
            for (j, later) in (c + 1..CHUNK).zip(rest.chunks_exact_mut(pitch)) {
                let later = &mut later[panel..panel + CHUNK];
                for r in 0..CHUNK {
                    later[r] = multipliers[c][j].mul_add(column[r], later[r]);
                }
            }
        }
        let parts = parts::<S>();
        let (target, begin, pitch) =
            (S::as_mut_simd_f64s(target).0, (panel / CHUNK + 1) * parts, pitch / CHUNK * parts);
        for at in begin..pitch {
            match columns {
                1 => eliminate_row::<S, 1>(simd, target, pitch, at, &inverses, &multipliers),
                2 => eliminate_row::<S, 2>(simd, target, pitch, at, &inverses, &multipliers),
                3 => eliminate_row::<S, 3>(simd, target, pitch, at, &inverses, &multipliers),
                4 => eliminate_row::<S, 4>(simd, target, pitch, at, &inverses, &multipliers),
                5 => eliminate_row::<S, 5>(simd, target, pitch, at, &inverses, &multipliers),
                6 => eliminate_row::<S, 6>(simd, target, pitch, at, &inverses, &multipliers),
                7 => eliminate_row::<S, 7>(simd, target, pitch, at, &inverses, &multipliers),
                _ => eliminate_row::<S, 8>(simd, target, pitch, at, &inverses, &multipliers),
            }
        }
        Some(())
    }
}

/// The first C columns of a panel below its triangle, for one register of rows.
#[inline(always)]
fn eliminate_row<S: Simd, const C: usize>(
    simd: S,
    panel: &mut [S::f64s],
    pitch: usize,
    at: usize,
    inverses: &Chunk,
    multipliers: &[Chunk; CHUNK],
) {
    let mut x: [S::f64s; CHUNK] = std::array::from_fn(|j| panel[j * pitch + at]);
    for c in 0..C {
        x[c] = simd.mul_f64s(x[c], simd.splat_f64s(inverses[c]));
        for j in c + 1..CHUNK {
            x[j] = simd.mul_add_f64s(simd.splat_f64s(multipliers[c][j]), x[c], x[j]);
        }
    }
    for j in 0..CHUNK {
        panel[j * pitch + at] = x[j];
    }
}

/// Multiples of columns that are added to those of a panel, in registers of rows.
struct Update<'a, T> {
    panel: &'a mut [T],
    columns: &'a [T],
    pitch: usize,
    multipliers: &'a [Chunk],
}

impl<T: Copy> Update<'_, T> {
    /// For R registers of rows. Returns R.
    #[inline(always)]
    fn rows<S: Simd<f64s = T>, const R: usize>(&mut self, simd: S, at: usize) -> usize {
        if parts::<S>() == 1 {
            self.tile::<S, R, CHUNK>(simd, at, 0);
        } else {
            // Fewer registers.
            self.tile::<S, R, { CHUNK / 2 }>(simd, at, 0);
            self.tile::<S, R, { CHUNK / 2 }>(simd, at, CHUNK / 2);
        }
        R
    }

    /// The same for C columns of the panel, from `first` on.
    #[inline(always)]
    fn tile<S: Simd<f64s = T>, const R: usize, const C: usize>(&mut self, simd: S, at: usize, first: usize) {
        let Self { panel, columns, pitch, multipliers } = self;
        let mut sums: [[T; R]; C] =
            std::array::from_fn(|c| std::array::from_fn(|r| panel[(first + c) * *pitch + at + r]));
        for (multiplier, column) in multipliers.iter().zip(columns.chunks_exact(*pitch)) {
            let column: [T; R] = std::array::from_fn(|r| column[at + r]);
            for c in 0..C {
                let multiplier = simd.splat_f64s(multiplier[first + c]);
                for r in 0..R {
                    sums[c][r] = simd.mul_add_f64s(multiplier, column[r], sums[c][r]);
                }
            }
        }
        for c in 0..C {
            for r in 0..R {
                panel[(first + c) * *pitch + at + r] = sums[c][r];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use pulp::{Arch, WithSimd};

    /// A random matrix with a heavy diagonal of both signs, padded with zeros.
    fn random_front(size: usize) -> Vec<f64> {
        let (pitch, mut random) = (padded(size), Random::new(&[size as u64]));
        let mut front = vec![0.0; pitch * pitch];
        for j in 0..size {
            for i in j..size {
                front[j * pitch + i] = random.signed();
            }
            front[j * pitch + j] += if j % 3 == 0 { -30.0 } else { 30.0 };
        }
        front
    }

    /// The same by the definition, one column after the other.
    fn plain(front: &mut [f64], pitch: usize, width: usize) -> Vec<f64> {
        let mut pivots = Vec::new();
        for c in 0..width {
            let pivot = front[c * pitch + c];
            for i in c..pitch {
                front[c * pitch + i] *= 1.0 / pivot;
            }
            for j in c + 1..pitch {
                let multiplier = -(front[c * pitch + j] * pivot);
                for i in j..pitch {
                    front[j * pitch + i] = multiplier.mul_add(front[c * pitch + i], front[j * pitch + i]);
                }
            }
            pivots.push(pivot);
        }
        pivots
    }

    struct Elimination<'a>(&'a mut [f64], usize, usize);

    impl WithSimd for Elimination<'_> {
        type Output = Option<Vec<f64>>;

        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let Self(front, pitch, width) = self;
            let mut pivots = Vec::new();
            Dense { front, pitch, multipliers: &mut Vec::new() }.eliminate(simd, width, &mut pivots)?;
            Some(pivots)
        }
    }

    #[test]
    fn neither_blocks_nor_the_width_of_registers_change_a_bit() {
        for (size, width) in
            [(1, 1), (5, 2), (8, 8), (9, 8), (23, 7), (40, 17), (64, 64), (73, 65), (150, 129), (213, 80)]
        {
            let (front, pitch) = (random_front(size), padded(size));
            let mut expected = front.clone();
            let pivots = plain(&mut expected, pitch, width);
            let check = |run: &dyn Fn(Elimination<'_>) -> Option<Vec<f64>>| {
                let mut found = front.clone();
                assert_eq!(run(Elimination(&mut found, pitch, width)).as_ref(), Some(&pivots));
                for j in 0..size {
                    let below = j * pitch + j..j * pitch + size;
                    assert_eq!(found[below.clone()], expected[below], "column {j} of {size}, {width} eliminated");
                }
            };
            check(&|e| Arch::new().dispatch(e));
            check(&|e| e.with_simd(pulp::Scalar512b));
            check(&|e| e.with_simd(pulp::Scalar256b));
            check(&|e| e.with_simd(pulp::Scalar));
        }
    }

    #[test]
    fn pivots_that_vanish_or_overflow_are_told() {
        for (at, pivot) in [(0, 0.0), (3, f64::INFINITY), (17, f64::NAN)] {
            let (mut front, pitch) = (vec![0.0; 24 * 24], 24);
            (0..20).for_each(|j| front[j * pitch + j] = 1.0);
            front[at * pitch + at] = pivot;
            assert_eq!(Arch::new().dispatch(Elimination(&mut front, pitch, 20)), None);
            assert_eq!(plain(&mut front, pitch, at).len(), at);
        }
    }
}
