//! What the eigensolver's tests share.
#![allow(dead_code)] // each test binary uses its part

use crate::common::{Mesh, periodic_faces, periodic_lengths};
use salient_kernels::eigen::{Eigenpairs, Options};
use salient_kernels::laplacian::{Area, Operator, laplacian, laplacian_from_lengths};

pub fn operator(mesh: &Mesh) -> Operator {
    laplacian(&mesh.0, &mesh.1, Area::Mixed, false).expect("a good mesh")
}

pub fn flat_torus(p: usize, q: usize, hx: f64, hy: f64) -> Operator {
    let lengths = periodic_lengths(p, q, 0, hx, hy);
    laplacian_from_lengths(p * q, &periodic_faces(p, q, 0), &lengths, Area::Mixed, false).expect("a good mesh")
}

pub fn sparse() -> Options {
    Options { dense_limit: 0, ..Options::default() }
}

pub fn dense() -> Options {
    Options { dense_limit: usize::MAX, ..Options::default() }
}

/// Recomputes the certificate's claims from the operator, independently of the solver's scaling.
#[track_caller]
pub fn assert_certified(operator: &Operator, pairs: &Eigenpairs, residual_tolerance: f64) {
    let (n, k) = (operator.mass.len(), pairs.values.len());
    assert_eq!((pairs.n, pairs.vectors.len()), (n, n * k));
    let first = pairs.values.iter().copied().find(|v| *v > 0.0).unwrap_or(1.0);
    for j in 0..k {
        let (lambda, v) = (pairs.values[j], pairs.vector(j));
        assert!(j == 0 || pairs.values[j - 1] <= lambda);
        let mv = operator.stiffness.multiply(v);
        let squared: f64 = (0..n).map(|i| (mv[i] - lambda * operator.mass[i] * v[i]).powi(2) / operator.mass[i]).sum();
        assert!(
            squared.sqrt() <= residual_tolerance * lambda.max(first),
            "residual {j}: {:e} of {lambda}",
            squared.sqrt()
        );
        for i in 0..=j {
            let product: f64 = (0..n).map(|p| operator.mass[p] * v[p] * pairs.vector(i)[p]).sum();
            let identity = if i == j { 1.0 } else { 0.0 };
            assert!((product - identity).abs() < 1e-11, "orthogonality {i} {j}: {product}");
        }
        let cubes: f64 = v.iter().zip(&operator.mass).map(|(x, s)| s * x * x * x).sum();
        let absolute: f64 = v.iter().zip(&operator.mass).map(|(x, s)| s * x.abs().powi(3)).sum();
        assert!(cubes > -1e-6 * absolute, "sign of {j}");
    }
    let certificate = &pairs.certificate;
    assert_eq!(certificate.expected, certificate.found);
    assert!(certificate.found >= k && pairs.values.iter().all(|v| *v < certificate.cut));
    assert!(certificate.max_orthogonality_error < 1e-11);
}
