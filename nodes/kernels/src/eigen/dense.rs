//! Dense symmetric eigendecompositions, sequential, and small dense helpers.

use super::EigenError;
use super::packed::Packed;
use super::panel::WIDTH;
use super::problem::Problem;
use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, MatMut, MatRef, Par, Side, Spec};

/// Eigenvalues, ascending, and eigenvectors of a symmetric matrix of which the lower triangle is read.
pub(super) fn symmetric_eigen(matrix: MatRef<'_, f64>) -> Result<(Vec<f64>, Mat<f64>), EigenError> {
    let n = matrix.nrows();
    let mut vectors = Mat::zeros(n, n);
    let mut values = Diag::zeros(n);
    let scratch = self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, Spec::default());
    let mut memory = MemBuffer::try_new(scratch).map_err(|_| EigenError::Dense)?;
    let stack = MemStack::new(&mut memory);
    self_adjoint_evd(matrix, values.as_mut(), Some(vectors.as_mut()), Par::Seq, stack, Spec::default())
        .map_err(|_| EigenError::Dense)?;
    let values: Vec<f64> = (0..n).map(|i| values.column_vector()[i]).collect();
    if values.iter().all(|v| v.is_finite()) { Ok((values, vectors)) } else { Err(EigenError::Dense) }
}

/// A as a dense matrix, its known null space lifted above the rest of the spectrum.
pub(super) fn lifted(problem: &Problem<'_>) -> Mat<f64> {
    let n = problem.n();
    let mut a = Mat::<f64>::zeros(n, n);
    let entries = problem.scaled_entries();
    let mut bound = 0.0f64;
    for i in 0..n {
        let range = problem.stiffness.offsets()[i]..problem.stiffness.offsets()[i + 1];
        let mut radius = 0.0;
        for (&j, &value) in problem.stiffness.columns()[range.clone()].iter().zip(&entries[range]) {
            a[(i, j as usize)] = value;
            radius += value.abs();
        }
        bound = bound.max(radius); // Gershgorin
    }
    for j in 0..n {
        for i in 0..n {
            let ((p, x), (q, y)) = (problem.null_entry(i), problem.null_entry(j));
            if p == q {
                a[(i, j)] += 2.0 * bound * x * y;
            }
        }
    }
    a
}

/// x' y.
pub(super) fn inner(x: MatRef<'_, f64>, y: MatRef<'_, f64>) -> Mat<f64> {
    let mut product = Mat::zeros(x.ncols(), y.ncols());
    matmul(product.as_mut(), Accum::Replace, x.transpose(), y, 1.0, Par::Seq);
    product
}

/// x y.
pub(super) fn product(x: MatRef<'_, f64>, y: MatRef<'_, f64>) -> Mat<f64> {
    let mut product = Mat::zeros(x.nrows(), y.ncols());
    matmul(product.as_mut(), Accum::Replace, x, y, 1.0, Par::Seq);
    product
}

/// One step of inverse iteration on a basis of approximate eigenvectors, Rayleigh-Ritz, and orthonormalisation: a dense decomposition is accurate
/// relative to the largest eigenvalue only. Returns nothing if the columns are not independent.
pub(super) fn refine(
    problem: &Problem<'_>,
    factor: &Packed,
    order: &[u32],
    y: &Mat<f64>,
) -> Result<Option<Mat<f64>>, EigenError> {
    let k = y.ncols();
    let mut z = y.clone();
    solve_columns(factor, order, z.as_mut())?;
    problem.project_out_kernel(z.as_mut());
    let t = inner(y.as_ref(), z.as_ref());
    let t = Mat::from_fn(k, k, |i, j| 0.5 * (t[(i, j)] + t[(j, i)]));
    let (values, vectors) = symmetric_eigen(t.as_ref())?;
    let rotation = Mat::from_fn(k, k, |i, j| vectors[(i, k - 1 - j)] / values[k - 1 - j]);
    Ok(orthonormalise(product(z.as_ref(), rotation.as_ref())))
}

fn solve_columns(factor: &Packed, order: &[u32], mut x: MatMut<'_, f64>) -> Result<(), EigenError> {
    let mut panel = vec![[0.0; WIDTH]; order.len()];
    for begin in (0..x.ncols()).step_by(WIDTH) {
        let width = WIDTH.min(x.ncols() - begin);
        for (row, &v) in panel.iter_mut().zip(order) {
            for (q, entry) in row.iter_mut().enumerate().take(width) {
                *entry = x[(v as usize, begin + q)];
            }
        }
        factor.solve(&(), &mut panel)?;
        for (row, &v) in panel.iter().zip(order) {
            for (q, entry) in row.iter().enumerate().take(width) {
                x[(v as usize, begin + q)] = *entry;
            }
        }
    }
    Ok(())
}

/// Orthonormal columns with the same leading spans, by two Cholesky QR passes; nothing if the columns are dependent.
pub(super) fn orthonormalise(mut y: Mat<f64>) -> Option<Mat<f64>> {
    for _ in 0..2 {
        let gram = inner(y.as_ref(), y.as_ref());
        let cholesky = gram.llt(Side::Lower).ok()?;
        solve_lower_triangular_in_place(cholesky.L(), y.as_mut().transpose_mut(), Par::Seq);
    }
    Some(y)
}
