//! Eigenvectors of symmetric tridiagonal matrices by twisted factorisations (Fernando 1997; Dhillon & Parlett 2004), eight at a time.
//!
//! F - x I = L D L' from the top and U D U' from the bottom meet where the vector is largest: there it is 1, and the two factors give the rest by one
//! product and one division an entry. Vectors of values that are closer than rounding are not told apart.

use super::panel::{Row, WIDTH};
use super::tiles::{parts, registers, registers_mut};
use pulp::{Arch, Simd, WithSimd};

/// Memory for pivots, from one call to the next.
#[derive(Default)]
pub(super) struct Twisted {
    from_top: Vec<Row>,
    from_bottom: Vec<Row>,
}

impl Twisted {
    /// Writes unit vectors of these eigenvalues to rows, one per row of the matrix; `off[i]` is between i and i + 1.
    pub fn vectors(&mut self, diagonal: &[f64], off: &[f64], norm: f64, values: &Row, rows: &mut [Row]) {
        self.from_top.resize(diagonal.len(), [0.0; WIDTH]);
        self.from_bottom.resize(diagonal.len(), [0.0; WIDTH]);
        // Pivots are not smaller than that: an eigenvalue moves by less than rounding.
        let least = f64::EPSILON * f64::EPSILON * norm.max(f64::MIN_POSITIVE);
        Arch::new().dispatch(Vectors { memory: self, diagonal, off, least, values, rows });
    }
}

struct Vectors<'a> {
    memory: &'a mut Twisted,
    diagonal: &'a [f64],
    off: &'a [f64],
    least: f64,
    values: &'a Row,
    rows: &'a mut [Row],
}

impl WithSimd for Vectors<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { memory, diagonal, off, least, values, rows } = self;
        let mut lanes = Lanes {
            simd,
            diagonal,
            off,
            least: simd.splat_f64s(least),
            from_top: registers_mut::<S>(&mut memory.from_top),
            from_bottom: registers_mut::<S>(&mut memory.from_bottom),
            rows: registers_mut::<S>(rows),
            part: 0,
        };
        for (part, value) in registers::<S>(&[*values]).iter().enumerate() {
            lanes.part = part;
            let twist = lanes.factor(*value);
            lanes.fill(twist);
        }
    }
}

/// One register of each row.
struct Lanes<'a, S: Simd> {
    simd: S,
    diagonal: &'a [f64],
    off: &'a [f64],
    least: S::f64s,
    from_top: &'a mut [S::f64s],
    from_bottom: &'a mut [S::f64s],
    rows: &'a mut [S::f64s],
    part: usize,
}

impl<S: Simd> Lanes<'_, S> {
    /// Factors F - value I from both ends; the row where they meet, as a number.
    #[inline(always)]
    fn factor(&mut self, value: S::f64s) -> S::f64s {
        let (simd, n) = (self.simd, self.diagonal.len());
        let mut pivot = simd.splat_f64s(1.0);
        for i in 0..n {
            let off = if i > 0 { self.off[i - 1] } else { 0.0 };
            let shifted = simd.sub_f64s(simd.splat_f64s(self.diagonal[i]), value);
            pivot = self.pivot(shifted, off, pivot);
            self.from_top[i * parts::<S>() + self.part] = pivot;
        }
        let (mut smallest, mut twist) = (simd.splat_f64s(f64::INFINITY), simd.splat_f64s(0.0));
        for i in (0..n).rev() {
            let at = i * parts::<S>() + self.part;
            let off = if i + 1 < n { self.off[i] } else { 0.0 };
            let shifted = simd.sub_f64s(simd.splat_f64s(self.diagonal[i]), value);
            pivot = self.pivot(shifted, off, pivot);
            self.from_bottom[at] = pivot;
            // The pivot that is left where both meet at i.
            let gap = simd.abs_f64s(simd.sub_f64s(simd.add_f64s(pivot, self.from_top[at]), shifted));
            let better = simd.less_than_f64s(gap, smallest);
            smallest = simd.select_f64s(better, gap, smallest);
            twist = simd.select_f64s(better, simd.splat_f64s(i as f64), twist);
        }
        twist
    }

    #[inline(always)]
    fn pivot(&self, shifted: S::f64s, off: f64, before: S::f64s) -> S::f64s {
        let simd = self.simd;
        let pivot = simd.sub_f64s(shifted, simd.div_f64s(simd.splat_f64s(off * off), before));
        let tiny = simd.less_than_f64s(simd.abs_f64s(pivot), self.least);
        simd.select_f64s(tiny, self.least, pivot)
    }

    /// The vectors from where the factors meet, upwards and downwards, then divided by their norms.
    #[inline(always)]
    fn fill(&mut self, twist: S::f64s) {
        let (simd, n) = (self.simd, self.diagonal.len());
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        let (mut z, mut square) = (zero, zero);
        for i in (0..n).rev() {
            let (at, here) = (i * parts::<S>() + self.part, simd.splat_f64s(i as f64));
            z = simd.div_f64s(simd.mul_f64s(simd.splat_f64s(-self.off[i]), z), self.from_top[at]);
            z = simd.select_f64s(simd.equal_f64s(twist, here), one, z);
            z = simd.select_f64s(simd.less_than_f64s(twist, here), zero, z);
            self.rows[at] = z;
            square = simd.mul_add_f64s(z, z, square);
        }
        let mut z = zero;
        for i in 0..n {
            let (at, here) = (i * parts::<S>() + self.part, simd.splat_f64s(i as f64));
            let off = if i > 0 { -self.off[i - 1] } else { 0.0 };
            let below = simd.less_than_f64s(twist, here);
            let next = simd.div_f64s(simd.mul_f64s(simd.splat_f64s(off), z), self.from_bottom[at]);
            z = simd.select_f64s(below, next, self.rows[at]);
            self.rows[at] = z;
            square = simd.select_f64s(below, simd.mul_add_f64s(z, z, square), square);
        }
        let scale = simd.div_f64s(one, simd.sqrt_f64s(square));
        for i in 0..n {
            let at = i * parts::<S>() + self.part;
            self.rows[at] = simd.mul_f64s(self.rows[at], scale);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn vectors_of_second_differences_are_sines() {
        for n in [1, 2, 5, 30, 201] {
            let (diagonal, mut off) = (vec![2.0; n], vec![-1.0; n]);
            off[n - 1] = 0.0;
            let angle = |q: usize| (q * n / WIDTH + 1) as f64 * PI / (n + 1) as f64;
            let values: Row = std::array::from_fn(|q| 2.0 - 2.0 * angle(q).cos());
            let mut rows = vec![[0.0; WIDTH]; n];
            Twisted::default().vectors(&diagonal, &off, 4.0, &values, &mut rows);
            for q in 0..WIDTH {
                let expected = |i: usize| (2.0 / (n + 1) as f64).sqrt() * ((i + 1) as f64 * angle(q)).sin();
                let sign = if rows[0][q] > 0.0 { 1.0 } else { -1.0 };
                for (i, row) in rows.iter().enumerate() {
                    assert!((sign * row[q] - expected(i)).abs() < 1e-12, "{n}: {q}, {i}: {}", row[q]);
                }
            }
        }
    }

    #[test]
    fn a_matrix_that_splits_has_its_vectors() {
        // Blocks 5, (0 1; 1 0), 3.
        let (diagonal, off) = ([5.0, 0.0, 0.0, 3.0], [0.0, 1.0, 0.0, 0.0]);
        let mut rows = vec![[0.0; WIDTH]; 4];
        Twisted::default().vectors(&diagonal, &off, 5.0, &[-1.0, 1.0, 3.0, 5.0, -1.0, 1.0, 3.0, 5.0], &mut rows);
        let root = 0.5f64.sqrt();
        let expected = [[0.0, root, root, 0.0], [0.0, root, root, 0.0], [0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]];
        for (q, expected) in expected.iter().enumerate() {
            for (row, x) in rows.iter().zip(expected) {
                assert!((row[q].abs() - x).abs() < 1e-15, "{q}: {rows:?}");
            }
        }
    }
}
