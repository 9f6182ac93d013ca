//! Panels: B vectors of n numbers. Solves take them row by row; a basis keeps them in groups of eight rows, vector by vector in a group, so that
//! products between panels need neither broadcasts nor remainders: rows past the last are zero.

use pulp::{Arch, Simd, WithSimd};

/// Rows of a group.
pub(super) const ROWS: usize = 8;

/// One row of a panel.
pub(super) type Row<const B: usize> = [f64; B];
/// Eight rows, by vectors.
pub(super) type Group<const B: usize> = [[f64; ROWS]; B];
/// Coefficients between two panels: entry (i, l) between vector i of the one and vector l of the other.
pub(super) type Block<const B: usize> = [[f64; B]; B];

/// Groups of a panel that stay in the nearest cache while others pass by.
const NEAR: usize = 64;

/// sum + x y for a number x.
#[inline(always)]
pub(super) fn add_multiple<const B: usize>(sum: &mut Row<B>, x: f64, y: &Row<B>) {
    for l in 0..B {
        sum[l] = x.mul_add(y[l], sum[l]);
    }
}

/// Numbers of a panel of this many rows, kept in groups.
pub(super) fn size<const B: usize>(rows: usize) -> usize {
    B * rows.next_multiple_of(ROWS)
}

/// The numbers of a panel as groups.
pub(super) fn groups<const B: usize>(numbers: &[f64]) -> &[Group<B>] {
    numbers.as_chunks().0.as_chunks().0
}

/// The same to be written to.
pub(super) fn groups_mut<const B: usize>(numbers: &mut [f64]) -> &mut [Group<B>] {
    numbers.as_chunks_mut().0.as_chunks_mut().0
}

/// Regroups rows.
pub(super) fn to_groups<const B: usize>(rows: &[Row<B>], panel: &mut [Group<B>]) {
    for (group, rows) in panel.iter_mut().zip(rows.chunks(ROWS)) {
        *group = [[0.0; ROWS]; B];
        for (r, row) in rows.iter().enumerate() {
            for l in 0..B {
                group[l][r] = row[l];
            }
        }
    }
}

/// The rows of groups.
pub(super) fn to_rows<const B: usize>(panel: &[Group<B>], rows: &mut [Row<B>]) {
    for (group, rows) in panel.iter().zip(rows.chunks_mut(ROWS)) {
        for (r, row) in rows.iter_mut().enumerate() {
            for l in 0..B {
                row[l] = group[l][r];
            }
        }
    }
}

/// A vector's rows in a group, as registers.
#[inline(always)]
fn registers<S: Simd>(rows: &[f64; ROWS]) -> &[S::f64s] {
    S::as_simd_f64s(rows).0
}

/// q' w for every panel q of a basis.
pub(super) fn inner<const B: usize>(basis: &[&[Group<B>]], w: &[Group<B>]) -> Vec<Block<B>> {
    let mut sums = vec![[[[0.0; ROWS]; B]; B]; basis.len()];
    Arch::new().dispatch(Inner { basis, w, sums: &mut sums });
    let total = |s: [f64; ROWS]| ((s[0] + s[4]) + (s[1] + s[5])) + ((s[2] + s[6]) + (s[3] + s[7]));
    sums.iter().map(|block| block.map(|row| row.map(total))).collect()
}

/// The products of all rows with the same number modulo [`ROWS`]. Written out for registers, since the compiler would not keep the sums in them.
struct Inner<'a, const B: usize> {
    basis: &'a [&'a [Group<B>]],
    w: &'a [Group<B>],
    sums: &'a mut [[Group<B>; B]],
}

impl<const B: usize> WithSimd for Inner<'_, B> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (at, w) in self.w.chunks(NEAR).enumerate() {
            for (q, sums) in self.basis.iter().zip(&mut *self.sums) {
                for part in 0..ROWS / S::F64_LANES {
                    let mut sum: [[S::f64s; B]; B] =
                        std::array::from_fn(|i| std::array::from_fn(|l| registers::<S>(&sums[i][l])[part]));
                    for (q, w) in q[at * NEAR..].iter().zip(w) {
                        let w: [S::f64s; B] = std::array::from_fn(|l| registers::<S>(&w[l])[part]);
                        for i in 0..B {
                            let q = registers::<S>(&q[i])[part];
                            for l in 0..B {
                                sum[i][l] = simd.mul_add_f64s(q, w[l], sum[i][l]);
                            }
                        }
                    }
                    for i in 0..B {
                        for l in 0..B {
                            S::as_mut_simd_f64s(&mut sums[i][l]).0[part] = sum[i][l];
                        }
                    }
                }
            }
        }
    }
}

/// w' w.
pub(super) fn gram<const B: usize>(w: &[Group<B>]) -> Block<B> {
    inner(&[w], w)[0]
}

/// w - q c for every panel q of a basis with its coefficients c.
pub(super) fn subtract<const B: usize>(w: &mut [Group<B>], basis: &[&[Group<B>]], coefficients: &[Block<B>]) {
    Arch::new().dispatch(Subtract { w, basis, coefficients });
}

struct Subtract<'a, const B: usize> {
    w: &'a mut [Group<B>],
    basis: &'a [&'a [Group<B>]],
    coefficients: &'a [Block<B>],
}

impl<const B: usize> WithSimd for Subtract<'_, B> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (at, w) in self.w.chunks_mut(NEAR).enumerate() {
            for (q, c) in self.basis.iter().zip(self.coefficients) {
                let c: [[S::f64s; B]; B] = c.map(|row| row.map(|x| simd.splat_f64s(-x)));
                for (w, q) in w.iter_mut().zip(&q[at * NEAR..]) {
                    for part in 0..ROWS / S::F64_LANES {
                        let mut sum: [S::f64s; B] = std::array::from_fn(|l| registers::<S>(&w[l])[part]);
                        for i in 0..B {
                            let q = registers::<S>(&q[i])[part];
                            for l in 0..B {
                                sum[l] = simd.mul_add_f64s(c[i][l], q, sum[l]);
                            }
                        }
                        for l in 0..B {
                            S::as_mut_simd_f64s(&mut w[l]).0[part] = sum[l];
                        }
                    }
                }
            }
        }
    }
}

/// w c, in place.
pub(super) fn multiply<const B: usize>(w: &mut [Group<B>], c: &Block<B>) {
    Arch::new().dispatch(Multiply { w, c });
}

struct Multiply<'a, const B: usize> {
    w: &'a mut [Group<B>],
    c: &'a Block<B>,
}

impl<const B: usize> WithSimd for Multiply<'_, B> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let c: [[S::f64s; B]; B] = self.c.map(|row| row.map(|x| simd.splat_f64s(x)));
        for w in self.w {
            for part in 0..ROWS / S::F64_LANES {
                let old: [S::f64s; B] = std::array::from_fn(|l| registers::<S>(&w[l])[part]);
                for l in 0..B {
                    let mut sum = simd.mul_f64s(c[0][l], old[0]);
                    for i in 1..B {
                        sum = simd.mul_add_f64s(c[i][l], old[i], sum);
                    }
                    S::as_mut_simd_f64s(&mut w[l]).0[part] = sum;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Rows that do not fill their last group.
    fn random(seed: u64, rows: usize) -> Vec<Row<3>> {
        let mut random = Random::new(&[seed]);
        (0..rows).map(|_| std::array::from_fn(|_| random.signed())).collect()
    }

    fn grouped(rows: &[Row<3>]) -> Vec<Group<3>> {
        let mut groups = vec![[[f64::NAN; ROWS]; 3]; rows.len().div_ceil(ROWS)];
        to_groups(rows, &mut groups);
        groups
    }

    #[test]
    fn products_are_those_of_the_rows() {
        for n in [1, 8, 13, ROWS * NEAR + 5] {
            let rows = [random(1, n), random(2, n), random(3, n)];
            let [p, q, w] = [0, 1, 2].map(|i| grouped(&rows[i]));
            let coefficients = inner(&[&p, &q], &w);
            for (block, rows_of) in coefficients.iter().zip(&rows) {
                for i in 0..3 {
                    for l in 0..3 {
                        let sum: f64 = rows_of.iter().zip(&rows[2]).map(|(x, y)| x[i] * y[l]).sum();
                        assert!((block[i][l] - sum).abs() < 1e-13 * n as f64, "{n}");
                    }
                }
            }
            let (mut rest, mut found) = (w.clone(), rows[2].clone());
            subtract(&mut rest, &[&p, &q], &coefficients);
            multiply(&mut rest, &coefficients[0]);
            to_rows(&rest, &mut found);
            for (at, row) in found.iter().enumerate() {
                let less = |l: usize| {
                    let part = |b: usize| (0..3).map(|i| rows[b][at][i] * coefficients[b][i][l]).sum::<f64>();
                    rows[2][at][l] - part(0) - part(1)
                };
                for l in 0..3 {
                    let expected: f64 = (0..3).map(|i| less(i) * coefficients[0][i][l]).sum();
                    assert!((row[l] - expected).abs() < 1e-12 * (n * n) as f64, "{n}");
                }
            }
        }
    }
}
