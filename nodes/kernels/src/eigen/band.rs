//! Symmetric band matrices in tridiagonal form, by reflections of eight rows that chase what they leave beyond the band to its end (Murata &
//! Horikoshi 1975; Bischof, Lang & Sun 2000).

use super::panel::{Row, WIDTH};
use super::tiles::{parts, registers, registers_mut};
use pulp::{Arch, Simd, WithSimd};

/// Entries kept of a column, from the diagonal on: the band, and what is chased down it.
const KEPT: usize = 2 * WIDTH;

type Column = [f64; KEPT];

/// T = Q F Q' with T of half-bandwidth eight, F tridiagonal, Q a product of reflections.
pub(super) struct Tridiagonalised {
    pub diagonal: Vec<f64>,
    /// `off[i]` of F between i and i + 1; zero at the end.
    pub off: Vec<f64>,
    reflections: Vec<Reflection>,
}

/// I - scale v v' on eight rows.
struct Reflection {
    begin: usize,
    scale: f64,
    v: Row,
}

impl Tridiagonalised {
    /// From the order n of T and its entries by row and column, at and below the diagonal.
    pub fn new(n: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        let inside = |i: usize, j: usize| if i < n && i - j <= WIDTH { entry(i, j) } else { 0.0 };
        // Zeros after the end, so that all blocks are whole.
        let columns = (0..n + KEPT).map(|j| std::array::from_fn(|d| inside(j + d, j)));
        let mut columns: Vec<Column> = columns.collect();
        let mut reflections = Vec::with_capacity(n * (n + KEPT) / (2 * WIDTH));
        Arch::new().dispatch(Chase { n, columns: &mut columns, reflections: &mut reflections });
        let (diagonal, off) = columns[..n].iter().map(|column| (column[0], column[1])).unzip();
        Self { diagonal, off, reflections }
    }

    /// Rows of zeros that [`Self::transform`] wants after those of T.
    pub const PADDING: usize = WIDTH;

    /// x <- Q x.
    pub fn transform(&self, x: &mut [Row]) {
        Arch::new().dispatch(Transform { reflections: &self.reflections, x });
    }
}

struct Chase<'a> {
    n: usize,
    columns: &'a mut [Column],
    reflections: &'a mut Vec<Reflection>,
}

impl WithSimd for Chase<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for j in 0..self.n.saturating_sub(2) {
            let [_, x @ ..] = &mut self.columns[j];
            let mut next = reflect(simd, &mut x[..WIDTH]);
            for begin in (j + 1..self.n).step_by(WIDTH) {
                let (scale, v) = next;
                let (block, _) = self.columns[begin..].as_chunks_mut::<WIDTH>();
                both_sides(simd, &mut block[0], scale, &v);
                next = below(simd, &mut block[0], scale, &v);
                self.reflections.push(Reflection { begin, scale, v });
            }
        }
    }
}

struct Transform<'a> {
    reflections: &'a [Reflection],
    x: &'a mut [Row],
}

impl WithSimd for Transform<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (x, parts) = (registers_mut::<S>(self.x), parts::<S>());
        for Reflection { begin, scale, v } in self.reflections.iter().rev() {
            let rows = &mut x[begin * parts..(begin + WIDTH) * parts];
            for part in 0..parts {
                let mut y: [S::f64s; WIDTH] = std::array::from_fn(|r| rows[r * parts + part]);
                let mut sums = [simd.splat_f64s(0.0); 2];
                for r in 0..WIDTH {
                    sums[r % 2] = simd.mul_add_f64s(simd.splat_f64s(v[r]), y[r], sums[r % 2]);
                }
                let along = simd.mul_f64s(simd.splat_f64s(-scale), simd.add_f64s(sums[0], sums[1]));
                for r in 0..WIDTH {
                    y[r] = simd.mul_add_f64s(simd.splat_f64s(v[r]), along, y[r]);
                    rows[r * parts + part] = y[r];
                }
            }
        }
    }
}

/// x'y, summed in one order for any width of a register.
#[inline(always)]
fn dot<S: Simd>(simd: S, x: &[f64], y: &Row) -> f64 {
    let mut p = [0.0; WIDTH];
    let products = S::as_mut_simd_f64s(&mut p).0.iter_mut();
    for (p, (x, y)) in products.zip(S::as_simd_f64s(x).0.iter().zip(registers::<S>(&[*y]))) {
        *p = simd.mul_f64s(*x, *y);
    }
    ((p[0] + p[4]) + (p[1] + p[5])) + ((p[2] + p[6]) + (p[3] + p[7]))
}

/// y += a x.
#[inline(always)]
fn add<S: Simd>(simd: S, y: &mut [f64], a: f64, x: &Row) {
    let a = simd.splat_f64s(a);
    for (y, x) in S::as_mut_simd_f64s(y).0.iter_mut().zip(registers::<S>(&[*x])) {
        *y = simd.mul_add_f64s(a, *x, *y);
    }
}

/// Takes eight numbers to the first of them: scale and v of the reflection, the scale 0 if they are there already.
#[inline(always)]
fn reflect<S: Simd>(simd: S, x: &mut [f64]) -> (f64, Row) {
    let first = x[0];
    let mut v: Row = std::array::from_fn(|r| if r == 0 { 0.0 } else { x[r] });
    let rest = dot(simd, &v, &v);
    if rest == 0.0 {
        return (0.0, v);
    }
    let norm = first.mul_add(first, rest).sqrt();
    let pivot = if first > 0.0 { -norm } else { norm };
    v[0] = first - pivot;
    x.fill(0.0);
    x[0] = pivot;
    (-1.0 / (pivot * v[0]), v)
}

/// H D H for the block on the diagonal of these columns.
#[inline(always)]
fn both_sides<S: Simd>(simd: S, columns: &mut [Column; WIDTH], scale: f64, v: &Row) {
    let mut d = [[0.0; WIDTH]; WIDTH];
    for c in 0..WIDTH {
        for r in c..WIDTH {
            d[c][r] = columns[c][r - c];
            d[r][c] = d[c][r];
        }
    }
    // D - v w' - w v' with w = p - (scale p'v / 2) v, p = scale D v.
    let mut w = [0.0; WIDTH];
    for c in 0..WIDTH {
        add(simd, &mut w, scale * v[c], &d[c]);
    }
    let half = -0.5 * scale * dot(simd, &w, v);
    add(simd, &mut w, half, v);
    for c in 0..WIDTH {
        add(simd, &mut d[c], -w[c], v);
        add(simd, &mut d[c], -v[c], &w);
        columns[c][..WIDTH - c].copy_from_slice(&d[c][c..]);
    }
}

/// B H for the block below that one, then what takes the first column of B to one entry, from the left: scale and v of that.
#[inline(always)]
fn below<S: Simd>(simd: S, columns: &mut [Column; WIDTH], scale: f64, v: &Row) -> (f64, Row) {
    let mut y = [0.0; WIDTH];
    for c in 0..WIDTH {
        let column: Row = std::array::from_fn(|r| columns[c][WIDTH - c + r]);
        add(simd, &mut y, -scale * v[c], &column);
    }
    for c in 0..WIDTH {
        add(simd, &mut columns[c][WIDTH - c..KEPT - c], v[c], &y);
    }
    let (scale, v) = reflect(simd, &mut columns[0][WIDTH..]);
    for (c, column) in columns.iter_mut().enumerate().skip(1) {
        let column = &mut column[WIDTH - c..KEPT - c];
        let along = -scale * dot(simd, column, &v);
        add(simd, column, along, &v);
    }
    (scale, v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn a_band_matrix_is_rebuilt() {
        let mut random = Random::new(&[5]);
        for n in [1, 2, 3, 8, 9, 16, 17, 40, 64, 71] {
            let mut band = vec![0.0; n * n];
            for i in 0..n {
                for j in i.saturating_sub(WIDTH)..=i {
                    // Some columns need no reflection.
                    let entry = if j % 7 == 3 && i > j + 1 { 0.0 } else { random.signed() };
                    band[i * n + j] = entry;
                    band[j * n + i] = entry;
                }
            }
            let form = Tridiagonalised::new(n, |i, j| band[i * n + j]);
            assert_eq!(form.off[n - 1], 0.0);
            for begin in (0..n).step_by(WIDTH) {
                let unit = |i: usize, q: usize| f64::from(u8::from(i == begin + q && i < n));
                let mut q: Vec<Row> = (0..n + WIDTH).map(|i| std::array::from_fn(|l| unit(i, l))).collect();
                let mut fx = q.clone();
                for i in 0..n {
                    for l in 0..WIDTH {
                        let before = if i > 0 { form.off[i - 1] * q[i - 1][l] } else { 0.0 };
                        fx[i][l] = before + form.diagonal[i] * q[i][l] + form.off[i] * q[i + 1][l];
                    }
                }
                form.transform(&mut q);
                form.transform(&mut fx);
                // T Q = Q F.
                for i in 0..n {
                    for l in 0..WIDTH {
                        let product: f64 = (0..n).map(|j| band[i * n + j] * q[j][l]).sum();
                        assert!((product - fx[i][l]).abs() < 1e-14 * (n + 9) as f64, "{n}: ({i}, {})", begin + l);
                    }
                }
                assert!(q[n..].iter().flatten().all(|x| *x == 0.0));
            }
        }
    }
}
