//! The eigensolver against spectra known in closed form.

mod common;
#[path = "common/solving.rs"]
mod solving;

use common::*;
use salient_kernels::eigen::{Method, Options, eigenpairs};
use solving::*;

#[test]
fn sphere_multiplets_converge_at_second_order() {
    let error = |level: usize| -> Vec<f64> {
        let operator = operator(&icosphere(level));
        let pairs = eigenpairs(&operator, 36, &sparse(), &()).expect("certified");
        assert_certified(&operator, &pairs, 1e-8);
        assert_eq!(pairs.certificate.method, Method::Lanczos);
        (1..6)
            .map(|l: usize| {
                let exact = (l * (l + 1)) as f64;
                let multiplet = &pairs.values[l * l..(l + 1) * (l + 1)];
                multiplet.iter().map(|v| (v / exact - 1.0).abs()).fold(0.0, f64::max)
            })
            .collect()
    };
    let (coarse, fine) = (error(3), error(4));
    for (l, (coarse, fine)) in coarse.iter().zip(&fine).enumerate() {
        let order = (coarse / fine).log2();
        // Degree 1 does better: coordinates are eigenfunctions of the polyhedron itself, nearly.
        let best = if l == 0 { 4.2 } else { 2.2 };
        assert!((1.8..best).contains(&order), "degree {}: errors {coarse:e} {fine:e}, order {order}", l + 1);
    }
    // 2562 vertices have edges of about 0.075: errors of order l (l + 1) h^2 / 12.
    assert!(fine[0] < 1e-6 && fine[4] < 2e-2, "{fine:?}");
}

#[test]
fn radius_scales_eigenvalues_by_its_inverse_square() {
    for mesh in [icosphere(3), union(&rough_patch(16, 14), &icosphere(2))] {
        let unit = eigenpairs(&operator(&mesh), 20, &sparse(), &()).expect("certified");
        for scale in [1e-6, 1e6] {
            let operator = operator(&scaled(&mesh, scale));
            let pairs = eigenpairs(&operator, 20, &sparse(), &()).expect("certified");
            assert_certified(&operator, &pairs, 1e-8);
            let expected: Vec<f64> = unit.values.iter().map(|v| v / (scale * scale)).collect();
            assert_close(&pairs.values, &expected, 1e-11);
        }
    }
}

#[test]
fn a_cut_through_a_multiplet_is_certified_above_it() {
    let operator = operator(&icosphere(3));
    // Degrees 0 to 2 have 1, 3 and 5; from degree 3 on the icosahedron's symmetry splits the multiplets.
    for k in [2, 3, 5, 7, 8] {
        let pairs = eigenpairs(&operator, k, &sparse(), &()).expect("certified");
        assert_certified(&operator, &pairs, 1e-8);
        let more = eigenpairs(&operator, 16, &sparse(), &()).expect("certified");
        assert_close(&pairs.values, &more.values[..k], 1e-11);
        let complete = [1, 4, 9, 16].into_iter().find(|c| *c >= k).expect("in range");
        assert_eq!(pairs.certificate.found, complete, "k = {k}");
        assert!(pairs.certificate.gap_above.expect("there is more") < 1e-2);
    }
    let whole = eigenpairs(&operator, 9, &sparse(), &()).expect("certified");
    assert!(whole.certificate.gap_above.expect("there is more") > 0.4);
}

#[test]
fn flat_tori_are_exact_with_all_multiplicities() {
    for (p, q, hx, hy, k) in [(30, 30, 0.1, 0.1, 60), (40, 12, 0.05, 0.3, 45), (24, 24, 1.0, 1.0, 57)] {
        let operator = flat_torus(p, q, hx, hy);
        let pairs = eigenpairs(&operator, k, &sparse(), &()).expect("certified");
        assert_certified(&operator, &pairs, 1e-8);
        assert!(pairs.values[0] == 0.0);
        assert_close(&pairs.values, &flat_torus_values(p, q, hx, hy)[..k], 1e-11);
    }
}

#[test]
fn tori_too_coarse_to_embed() {
    for (p, q) in [(1, 1), (2, 1), (2, 2), (3, 2), (4, 4), (7, 5)] {
        let operator = flat_torus(p, q, 1.0, 0.7);
        let pairs = eigenpairs(&operator, p * q, &Options::default(), &()).expect("certified");
        assert_close(&pairs.values, &flat_torus_values(p, q, 1.0, 0.7), 1e-12);
    }
}

#[test]
fn rectangles_are_exact() {
    let (p, q) = (40, 25);
    let operator = operator(&tensor_grid(&uniform(p, 2.0), &uniform(q, 1.0), |_, _| 0.0));
    let pairs = eigenpairs(&operator, 50, &sparse(), &()).expect("certified");
    assert_certified(&operator, &pairs, 1e-8);
    assert_close(&pairs.values, &rectangle_values(p, q, 2.0 / p as f64, 1.0 / q as f64, false)[..50], 1e-11);
}

/// Eigenvalues of the free interval with lumped masses on the given nodes.
fn interval_values(x: &[f64]) -> Vec<f64> {
    let n = x.len();
    let step = |i: usize| x[i + 1] - x[i];
    let mass = |i: usize| 0.5 * (if i > 0 { step(i - 1) } else { 0.0 } + if i + 1 < n { step(i) } else { 0.0 });
    let mut a = vec![vec![0.0; n]; n];
    for i in 0..n - 1 {
        let w = 1.0 / step(i);
        a[i][i] += w / mass(i);
        a[i + 1][i + 1] += w / mass(i + 1);
        a[i][i + 1] = -w / (mass(i) * mass(i + 1)).sqrt();
        a[i + 1][i] = a[i][i + 1];
    }
    jacobi_eigenvalues(a)
}

#[test]
fn slivers_of_aspect_one_million() {
    // On a grid of right triangles the operator is a tensor product: eigenvalues are sums of those of two intervals.
    let mut x = uniform(24, 1.0);
    x.insert(7, x[6] + 1e-6);
    x.insert(20, x[19] + 1e-5);
    let y = uniform(20, 0.9);
    let operator = operator(&tensor_grid(&x, &y, |_, _| 0.0));
    let (along, across) = (interval_values(&x), interval_values(&y));
    let mut expected: Vec<f64> = along.iter().flat_map(|a| across.iter().map(move |b| a + b)).collect();
    expected.sort_by(f64::total_cmp);
    for options in [sparse(), dense()] {
        let pairs = eigenpairs(&operator, 40, &options, &()).expect("certified");
        assert!(pairs.values[0] == 0.0);
        assert_close(&pairs.values[1..], &expected[1..40], 1e-8);
        assert_eq!(pairs.certificate.expected, pairs.certificate.found);
    }
}

#[test]
fn components_each_have_a_zero_and_identical_ones_all_copies() {
    // Nine equal spheres: every eigenvalue comes 9, 27, 45 times, more than a block has vectors.
    let mut mesh = icosphere(2);
    for i in 1..9 {
        let mut next = icosphere(2);
        next.0.iter_mut().for_each(|p| p[0] += 3.0 * f64::from(i));
        mesh = union(&mesh, &next);
    }
    let all = operator(&mesh);
    let one = eigenpairs(&operator(&icosphere(2)), 9, &dense(), &()).expect("certified");
    let pairs = eigenpairs(&all, 60, &sparse(), &()).expect("certified");
    assert_certified(&all, &pairs, 1e-8);
    let expected: Vec<f64> = one.values.iter().flat_map(|v| [*v; 9]).collect();
    assert_close(&pairs.values, &expected[..60], 1e-10);
    for component in 0..9 {
        let v = pairs.vector(component);
        let inside = 162 * component..162 * (component + 1);
        assert!(v.iter().enumerate().all(|(i, x)| (*x > 0.0) == inside.contains(&i)), "indicator {component}");
        let level = 1.0 / (all.area() / 9.0).sqrt();
        assert!(v[inside].iter().all(|x| (x - level).abs() < 1e-12 * level));
    }
}

#[test]
fn a_multiplet_far_wider_than_the_pairs_computed() {
    // Forty icosahedra: eigenvalues of multiplicity 40, 120, 200 and 120. Most of the spectrum is wanted, so the dense solver runs, and the
    // cut must be found beyond all copies.
    let mut mesh = icosphere(0);
    for _ in 1..40 {
        mesh = union(&mesh, &icosphere(0));
    }
    let all = operator(&mesh);
    for (k, complete) in [(20, 40), (40, 40), (41, 160), (130, 160), (161, 360), (365, 480)] {
        let pairs = eigenpairs(&all, k, &sparse(), &()).expect("certified");
        assert_certified(&all, &pairs, 1e-8);
        assert_eq!(pairs.certificate.found, complete, "k = {k}");
        assert_eq!(pairs.certificate.gap_above.expect("there is more") > 1e-2, k == complete);
    }
}
