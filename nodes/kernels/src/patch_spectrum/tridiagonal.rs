//! Eigenvalues of small dense symmetric matrices, with chosen rows of the matrix of eigenvectors: Householder's reduction to
//! tridiagonal form and the implicit QL iteration.

use crate::simd::vectorised;

/// Iterations per eigenvalue; two are usual.
const MAX_ITERATIONS: usize = 60;

/// Eigenvalues, ascending, of a symmetric matrix of order n, row-major, of which the lower triangle is read; `None` if they do not
/// converge.
///
/// Each of `rows`, of length n, is multiplied by the matrix of eigenvectors: unit vector i becomes the i-th components of all
/// eigenvectors, in the order of the values. The matrix is overwritten.
pub(super) fn eigenvalues(a: &mut [f64], n: usize, rows: &mut [Vec<f64>]) -> Option<Vec<f64>> {
    if n == 0 {
        return Some(Vec::new());
    }
    let (mut diagonal, mut off) = reduce(a, n, rows);
    ql(&mut diagonal, &mut off, rows)?;
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| diagonal[i].total_cmp(&diagonal[j]));
    for row in rows {
        *row = order.iter().map(|&i| row[i]).collect();
    }
    let sorted: Vec<f64> = order.iter().map(|&i| diagonal[i]).collect();
    sorted.iter().all(|x| x.is_finite()).then_some(sorted)
}

/// The tridiagonal matrix with the same eigenvalues: its diagonal, and what is beside it, `off[i]` between i and i + 1. `rows` as above.
pub(super) fn reduce(a: &mut [f64], n: usize, rows: &mut [Vec<f64>]) -> (Vec<f64>, Vec<f64>) {
    if n == 0 {
        return (Vec::new(), Vec::new());
    }
    vectorised(
        #[inline(always)]
        || tridiagonalise(a, n, rows),
    )
}

#[inline(always)]
fn dot(x: &[f64], y: &[f64]) -> f64 {
    let (mut sums, n) = ([0.0; 8], x.len().min(y.len()));
    let ((x8, x_rest), (y8, y_rest)) = (x[..n].as_chunks::<8>(), y[..n].as_chunks::<8>());
    for (x, y) in x8.iter().zip(y8) {
        for l in 0..8 {
            sums[l] = x[l].mul_add(y[l], sums[l]);
        }
    }
    let rest: f64 = x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum();
    ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7])) + rest
}

/// line'v, while `sums` gains the line times `factor`: one pass over a row of the lower triangle serves the upper one too.
#[inline(always)]
fn dot_and_add(line: &[f64], v: &[f64], factor: f64, sums: &mut [f64]) -> f64 {
    let (line8, line_rest) = line.as_chunks::<8>();
    let (v8, v_rest) = v.as_chunks::<8>();
    let (sums8, sums_rest) = sums.as_chunks_mut::<8>();
    let mut dots = [0.0; 8];
    for ((line, v), sums) in line8.iter().zip(v8).zip(sums8) {
        for l in 0..8 {
            dots[l] = line[l].mul_add(v[l], dots[l]);
            sums[l] = factor.mul_add(line[l], sums[l]);
        }
    }
    let mut rest = 0.0;
    for ((line, v), sum) in line_rest.iter().zip(v_rest).zip(sums_rest) {
        rest = line.mul_add(*v, rest);
        *sum = factor.mul_add(*line, *sum);
    }
    ((dots[0] + dots[4]) + (dots[1] + dots[5])) + ((dots[2] + dots[6]) + (dots[3] + dots[7])) + rest
}

/// The diagonal, and what is beside it: `off[i]` between i and i + 1, with a zero at the end.
///
/// Columns are eliminated from the last, so that what is left is the leading block, in rows that begin where memory rows begin.
#[inline(always)]
fn tridiagonalise(a: &mut [f64], n: usize, rows: &mut [Vec<f64>]) -> (Vec<f64>, Vec<f64>) {
    let (mut diagonal, mut off) = (vec![0.0; n], vec![0.0; n]);
    let (mut v, mut p) = (vec![0.0; n], vec![0.0; n]);
    for k in (1..n).rev() {
        diagonal[k] = a[k * n + k];
        v[..k].copy_from_slice(&a[k * n..k * n + k]);
        let (v, p) = (&mut v[..k], &mut p[..k]);
        // The reflection I - scale v v' takes row k to its last entry.
        let rest = dot(&v[..k - 1], &v[..k - 1]);
        if rest == 0.0 {
            off[k - 1] = v[k - 1];
            continue;
        }
        let norm = (rest + v[k - 1] * v[k - 1]).sqrt();
        let pivot = if v[k - 1] > 0.0 { -norm } else { norm };
        off[k - 1] = pivot;
        v[k - 1] -= pivot;
        let scale = -1.0 / (pivot * v[k - 1]);
        // A - v w' - w v' with w = p - (scale p'v / 2) v, p = scale A v; only the lower triangle is there.
        for i in 0..k {
            let line = &a[i * n..i * n + i];
            p[i] = a[i * n + i].mul_add(v[i], dot_and_add(line, &v[..i], v[i], &mut p[..i]));
        }
        for p in p.iter_mut() {
            *p *= scale;
        }
        let half = 0.5 * scale * dot(p, v);
        for (p, v) in p.iter_mut().zip(&*v) {
            *p -= half * v;
        }
        for i in 0..k {
            let (vi, wi) = (-v[i], -p[i]);
            for (a, (v, w)) in a[i * n..=i * n + i].iter_mut().zip(v.iter().zip(&*p)) {
                *a = vi.mul_add(*w, wi.mul_add(*v, *a));
            }
        }
        for row in &mut *rows {
            let along = -scale * dot(&row[..k], v);
            for (x, v) in row[..k].iter_mut().zip(&*v) {
                *x = along.mul_add(*v, *x);
            }
        }
    }
    diagonal[0] = a[0];
    (diagonal, off)
}

/// Wilkinson's implicit QL: the diagonal becomes the eigenvalues, unordered.
fn ql(d: &mut [f64], e: &mut [f64], rows: &mut [Vec<f64>]) -> Option<()> {
    let n = d.len();
    for l in 0..n {
        for iteration in 0.. {
            // The first negligible entry at or after l splits the matrix.
            let split = |m: &usize| e[*m].abs() <= f64::EPSILON * (d[*m].abs() + d[*m + 1].abs());
            let m = (l..n - 1).find(split).unwrap_or(n - 1);
            if m == l {
                break;
            }
            if iteration == MAX_ITERATIONS {
                return None;
            }
            let half = (d[l + 1] - d[l]) / (2.0 * e[l]);
            let root = half.hypot(1.0);
            let mut g = d[m] - d[l] + e[l] / (half + if half >= 0.0 { root } else { -root });
            let (mut s, mut c, mut p) = (1.0, 1.0, 0.0);
            let mut through = true;
            for i in (l..m).rev() {
                let (f, b) = (s * e[i], c * e[i]);
                let r = f.mul_add(f, g * g).sqrt();
                e[i + 1] = r;
                if r == 0.0 {
                    d[i + 1] -= p;
                    through = false; // the chase met a zero: the matrix splits here
                    break;
                }
                (s, c) = (f / r, g / r);
                let shifted = d[i + 1] - p;
                let turned = (d[i] - shifted) * s + 2.0 * c * b;
                p = s * turned;
                d[i + 1] = shifted + p;
                g = c * turned - b;
                for row in &mut *rows {
                    let (x, y) = (row[i], row[i + 1]);
                    (row[i], row[i + 1]) = (c * x - s * y, s * x + c * y);
                }
            }
            if through {
                d[l] -= p;
                e[l] = g;
            }
            e[m] = 0.0;
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn values_and_vectors_rebuild_the_matrix() {
        let mut random = Random::new(&[3]);
        for n in [0, 1, 2, 3, 9, 24, 41] {
            let mut a = vec![0.0; n * n];
            for i in 0..n {
                for j in 0..=i {
                    a[i * n + j] = random.signed();
                    a[j * n + i] = a[i * n + j];
                }
            }
            let mut rows: Vec<Vec<f64>> =
                (0..n).map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect()).collect();
            let values = eigenvalues(&mut a.clone(), n, &mut rows).expect("converges");
            assert!(values.is_sorted());
            for i in 0..n {
                for j in 0..n {
                    let entry: f64 = (0..n).map(|c| rows[i][c] * values[c] * rows[j][c]).sum();
                    assert!((entry - a[i * n + j]).abs() < 1e-13 * (n + 1) as f64, "{n}: ({i}, {j})");
                }
            }
        }
    }

    #[test]
    fn matrices_that_split_are_solved_too() {
        // Diagonal, with zeros, and two equal blocks.
        let mut diagonal = vec![0.0; 25];
        for (i, x) in [3.0, 0.0, -1.0, 3.0].into_iter().enumerate() {
            diagonal[i * 6] = x;
        }
        assert_eq!(eigenvalues(&mut diagonal, 5, &mut []), Some(vec![-1.0, 0.0, 0.0, 3.0, 3.0]));
        let mut blocks = vec![0.0; 16];
        for (i, j) in [(0, 1), (1, 0), (2, 3), (3, 2)] {
            blocks[i * 4 + j] = 1.0;
        }
        let values = eigenvalues(&mut blocks, 4, &mut []).expect("converges");
        assert!(values.iter().zip([-1.0, -1.0, 1.0, 1.0]).all(|(x, y)| (x - y).abs() < 1e-15), "{values:?}");
        assert_eq!(eigenvalues(&mut [f64::NAN; 4], 2, &mut []), None);
    }
}
