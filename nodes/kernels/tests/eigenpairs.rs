//! The eigensolver against exact spectra, a dense solver, and its own promises.

mod common;

use common::*;
use salient_kernels::eigen::{EigenError, Eigenpairs, Hooks, Method, Options, eigenpairs};
use salient_kernels::laplacian::{Area, Operator, laplacian, laplacian_from_lengths};
use salient_kernels::sparse::SymmetricCsr;
use std::cell::{Cell, RefCell};

fn operator(mesh: &Mesh) -> Operator {
    laplacian(&mesh.0, &mesh.1, Area::Mixed, false).expect("a good mesh")
}

fn flat_torus(p: usize, q: usize, hx: f64, hy: f64) -> Operator {
    let lengths = periodic_lengths(p, q, 0, hx, hy);
    laplacian_from_lengths(
        p * q,
        &periodic_faces(p, q, 0),
        &lengths,
        Area::Mixed,
        false,
    )
    .expect("a good mesh")
}

fn sparse() -> Options {
    Options {
        dense_limit: 0,
        ..Options::default()
    }
}

fn dense() -> Options {
    Options {
        dense_limit: usize::MAX,
        ..Options::default()
    }
}

/// Recomputes the certificate's claims from the operator, independently of the solver's scaling.
#[track_caller]
fn assert_certified(operator: &Operator, pairs: &Eigenpairs, residual_tolerance: f64) {
    let (n, k) = (operator.mass.len(), pairs.values.len());
    assert_eq!((pairs.n, pairs.vectors.len()), (n, n * k));
    let first = pairs
        .values
        .iter()
        .copied()
        .find(|v| *v > 0.0)
        .unwrap_or(1.0);
    for j in 0..k {
        let (lambda, v) = (pairs.values[j], pairs.vector(j));
        assert!(j == 0 || pairs.values[j - 1] <= lambda);
        let mv = operator.stiffness.multiply(v);
        let squared: f64 = (0..n)
            .map(|i| (mv[i] - lambda * operator.mass[i] * v[i]).powi(2) / operator.mass[i])
            .sum();
        assert!(
            squared.sqrt() <= residual_tolerance * lambda.max(first),
            "residual {j}: {:e} of {lambda}",
            squared.sqrt()
        );
        for i in 0..=j {
            let product: f64 = (0..n)
                .map(|p| operator.mass[p] * v[p] * pairs.vector(i)[p])
                .sum();
            let identity = if i == j { 1.0 } else { 0.0 };
            assert!(
                (product - identity).abs() < 1e-11,
                "orthogonality {i} {j}: {product}"
            );
        }
        let cubes: f64 = v
            .iter()
            .zip(&operator.mass)
            .map(|(x, s)| s * x * x * x)
            .sum();
        let absolute: f64 = v
            .iter()
            .zip(&operator.mass)
            .map(|(x, s)| s * x.abs().powi(3))
            .sum();
        assert!(cubes > -1e-6 * absolute, "sign of {j}");
    }
    let certificate = &pairs.certificate;
    assert_eq!(certificate.expected, certificate.found);
    assert!(certificate.found >= k && pairs.values.iter().all(|v| *v < certificate.cut));
    assert!(certificate.max_orthogonality_error < 1e-11);
}

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
                multiplet
                    .iter()
                    .map(|v| (v / exact - 1.0).abs())
                    .fold(0.0, f64::max)
            })
            .collect()
    };
    let (coarse, fine) = (error(3), error(4));
    for (l, (coarse, fine)) in coarse.iter().zip(&fine).enumerate() {
        let order = (coarse / fine).log2();
        // Degree 1 does better: coordinates are eigenfunctions of the polyhedron itself, nearly.
        let best = if l == 0 { 4.2 } else { 2.2 };
        assert!(
            (1.8..best).contains(&order),
            "degree {}: errors {coarse:e} {fine:e}, order {order}",
            l + 1
        );
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
        let complete = [1, 4, 9, 16]
            .into_iter()
            .find(|c| *c >= k)
            .expect("in range");
        assert_eq!(pairs.certificate.found, complete, "k = {k}");
        assert!(pairs.certificate.gap_above.expect("there is more") < 1e-2);
    }
    let whole = eigenpairs(&operator, 9, &sparse(), &()).expect("certified");
    assert!(whole.certificate.gap_above.expect("there is more") > 0.4);
}

#[test]
fn flat_tori_are_exact_with_all_multiplicities() {
    for (p, q, hx, hy, k) in [
        (30, 30, 0.1, 0.1, 60),
        (40, 12, 0.05, 0.3, 45),
        (24, 24, 1.0, 1.0, 57),
    ] {
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
    assert_close(
        &pairs.values,
        &rectangle_values(p, q, 2.0 / p as f64, 1.0 / q as f64, false)[..50],
        1e-11,
    );
}

/// Eigenvalues of the free interval with lumped masses on the given nodes.
fn interval_values(x: &[f64]) -> Vec<f64> {
    let n = x.len();
    let step = |i: usize| x[i + 1] - x[i];
    let mass = |i: usize| {
        0.5 * (if i > 0 { step(i - 1) } else { 0.0 } + if i + 1 < n { step(i) } else { 0.0 })
    };
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
    let mut expected: Vec<f64> = along
        .iter()
        .flat_map(|a| across.iter().map(move |b| a + b))
        .collect();
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
    let mut mesh = icosphere(1);
    for i in 1..9 {
        let mut next = icosphere(1);
        next.0.iter_mut().for_each(|p| p[0] += 3.0 * f64::from(i));
        mesh = union(&mesh, &next);
    }
    let all = operator(&mesh);
    let one = eigenpairs(&operator(&icosphere(1)), 9, &dense(), &()).expect("certified");
    let pairs = eigenpairs(&all, 60, &sparse(), &()).expect("certified");
    assert_certified(&all, &pairs, 1e-8);
    let expected: Vec<f64> = one.values.iter().flat_map(|v| [*v; 9]).collect();
    assert_close(&pairs.values, &expected[..60], 1e-10);
    assert!(
        pairs.certificate.rounds > 1,
        "a block of 8 cannot find 27 copies at once"
    );
    for component in 0..9 {
        let v = pairs.vector(component);
        let inside = 42 * component..42 * (component + 1);
        assert!(
            v.iter()
                .enumerate()
                .all(|(i, x)| (*x > 0.0) == inside.contains(&i)),
            "indicator {component}"
        );
        let level = 1.0 / (all.area() / 9.0).sqrt();
        assert!(v[inside].iter().all(|x| (x - level).abs() < 1e-12 * level));
    }
}

#[test]
fn fewer_pairs_than_components() {
    let mesh = union(&icosphere(2), &union(&rough_patch(9, 8), &icosphere(1)));
    let operator = operator(&mesh);
    for k in 1..5 {
        let pairs = eigenpairs(&operator, k, &sparse(), &()).expect("certified");
        assert_certified(&operator, &pairs, 1e-8);
        assert_eq!(pairs.values.iter().filter(|v| **v == 0.0).count(), k.min(3));
    }
}

#[test]
fn random_meshes_agree_with_the_dense_solver() {
    for (p, q, k) in [(20, 17, 30), (25, 20, 50), (50, 9, 25), (31, 23, 101)] {
        for intrinsic in [false, true] {
            let mesh = rough_patch(p, q);
            let operator =
                laplacian(&mesh.0, &mesh.1, Area::Mixed, intrinsic).expect("a good mesh");
            let lanczos = eigenpairs(&operator, k, &sparse(), &()).expect("certified");
            let full = eigenpairs(&operator, k, &dense(), &()).expect("certified");
            assert_eq!(
                (lanczos.certificate.method, full.certificate.method),
                (Method::Lanczos, Method::Dense)
            );
            assert_certified(&operator, &lanczos, 1e-8);
            assert_certified(&operator, &full, 1e-8);
            assert_close(&lanczos.values, &full.values, 1e-11);
            // Eigenvalues are simple here, so vectors agree too, with their signs, unless the sign is a close call.
            for j in 0..k {
                let pair = (lanczos.vector(j), full.vector(j));
                let product: f64 = (0..lanczos.n)
                    .map(|i| operator.mass[i] * pair.0[i] * pair.1[i])
                    .sum();
                let gap = (0..k)
                    .filter(|i| *i != j)
                    .map(|i| (full.values[i] / full.values[j].max(1e-3) - 1.0).abs());
                if gap.fold(1.0, f64::min) > 1e-4 && j + 1 < k {
                    assert!((product - 1.0).abs() < 1e-7, "vector {j}: {product}");
                }
            }
        }
    }
}

#[test]
fn every_k_up_to_n() {
    let operator = operator(&rough_patch(5, 4));
    let all = eigenpairs(&operator, 30, &dense(), &()).expect("certified");
    assert_eq!(
        (all.certificate.expected, all.certificate.gap_above),
        (30, None)
    );
    for k in 1..=30 {
        let pairs = eigenpairs(&operator, k, &sparse(), &()).expect("certified");
        assert_certified(&operator, &pairs, 1e-8);
        assert_close(&pairs.values, &all.values[..k], 1e-12);
    }
    assert_eq!(
        eigenpairs(&operator, 31, &sparse(), &()).unwrap_err(),
        EigenError::TooMany {
            wanted: 31,
            available: 30
        }
    );
    assert_eq!(
        eigenpairs(&operator, 0, &sparse(), &()).unwrap_err(),
        EigenError::NoneWanted
    );
}

#[test]
fn repeats_are_bit_identical() {
    let operator = operator(&rough_patch(30, 20));
    for options in [sparse(), dense()] {
        let bits = |pairs: &Eigenpairs| -> Vec<u64> {
            pairs
                .values
                .iter()
                .chain(&pairs.vectors)
                .map(|x| x.to_bits())
                .collect()
        };
        let first = eigenpairs(&operator, 40, &options, &()).expect("certified");
        assert_eq!(
            bits(&first),
            bits(&eigenpairs(&operator, 40, &options, &()).expect("certified"))
        );
        assert!(
            first
                .vectors
                .iter()
                .all(|x| x.to_bits() != (-0.0f64).to_bits())
        );
    }
}

#[test]
fn signs_do_not_depend_on_vertex_order() {
    let mesh = bumpy_torus(30, 14);
    let n = mesh.0.len() as u32;
    let renumber = |v: u32| (v * 11 + 5) % n; // 11 and 420 are coprime
    let mut points = vec![[0.0; 3]; n as usize];
    for v in 0..n {
        points[renumber(v) as usize] = mesh.0[v as usize];
    }
    let other = (points, mesh.1.iter().map(|f| f.map(renumber)).collect());
    let (a, b) = (operator(&mesh), operator(&other));
    let (a, b) = (
        eigenpairs(&a, 25, &sparse(), &()).expect("certified"),
        eigenpairs(&b, 25, &sparse(), &()).expect("certified"),
    );
    assert_close(&b.values, &a.values, 1e-11);
    let largest = a.vectors.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    for j in 0..25 {
        let difference = (0..n)
            .map(|v| (a.vector(j)[v as usize] - b.vector(j)[renumber(v) as usize]).abs())
            .fold(0.0, f64::max);
        assert!(difference < 1e-6 * largest, "vector {j}: {difference}");
    }
}

struct CountDown {
    left: Cell<usize>,
    seen: RefCell<Vec<f64>>,
}

impl Hooks for CountDown {
    fn progress(&self, fraction: f64) {
        self.seen.borrow_mut().push(fraction);
    }

    fn cancelled(&self) -> bool {
        let left = self.left.get();
        self.left.set(left.saturating_sub(1));
        left == 0
    }
}

#[test]
fn cancelling_stops_at_any_poll_and_progress_rises_to_one() {
    let operator = operator(&rough_patch(25, 20));
    let run = |left: usize| {
        let hooks = CountDown {
            left: Cell::new(left),
            seen: RefCell::default(),
        };
        let result = eigenpairs(&operator, 40, &sparse(), &hooks);
        (result, hooks.left.get(), hooks.seen.into_inner())
    };
    let (result, left, seen) = run(10_000);
    assert!(result.is_ok());
    assert!(
        seen.windows(2).all(|w| w[0] <= w[1])
            && seen.first() == Some(&0.0)
            && seen.last() == Some(&1.0),
        "{seen:?}"
    );
    let polls = 10_000 - left;
    assert!(polls >= 100 / 8, "one poll a block at least: {polls}");
    for left in 0..polls {
        assert_eq!(
            run(left).0.unwrap_err(),
            EigenError::Cancelled,
            "poll {left}"
        );
    }
}

#[test]
fn bad_operators_are_refused() {
    let good = operator(&icosphere(1));
    let solve = |operator: &Operator| eigenpairs(operator, 4, &sparse(), &()).unwrap_err();
    let short = Operator {
        mass: vec![1.0; 5],
        ..good.clone()
    };
    assert_eq!(
        solve(&short),
        EigenError::MassLength {
            rows: 42,
            masses: 5
        }
    );
    for bad in [0.0, -1.0, f64::NAN] {
        let mut mass = good.mass.clone();
        mass[7] = bad;
        assert_eq!(
            solve(&Operator {
                mass,
                ..good.clone()
            }),
            EigenError::NotFinite { vertex: 7 }
        );
    }
    let shifted =
        SymmetricCsr::from_parts(vec![0, 2, 4], vec![0, 1, 0, 1], vec![1.0, -1.0, -1.0, 1.5])
            .expect("symmetric");
    assert_eq!(
        solve(&Operator {
            stiffness: shifted,
            mass: vec![1.0; 2]
        }),
        EigenError::NotLaplacian { vertex: 1 }
    );
    let wrong = Options {
        tolerance: 0.0,
        ..Options::default()
    };
    assert_eq!(
        eigenpairs(&good, 4, &wrong, &()).unwrap_err(),
        EigenError::Option { name: "tolerance" }
    );
    let wrong = Options {
        block_size: 0,
        ..Options::default()
    };
    assert_eq!(
        eigenpairs(&good, 4, &wrong, &()).unwrap_err(),
        EigenError::Option { name: "block_size" }
    );
}

#[test]
fn indefinite_matrices_are_never_certified() {
    // A path with one strongly negative weight has a negative eigenvalue, so the smallest pairs are not what a Laplacian's would be.
    let n = 60;
    let weight = |i: usize| if i == 30 { -5.0 } else { 1.0 };
    let (mut offsets, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
    for i in 0..n {
        let left = if i > 0 { weight(i - 1) } else { 0.0 };
        let right = if i + 1 < n { weight(i) } else { 0.0 };
        for (j, value) in [
            (i.wrapping_sub(1), -left),
            (i, left + right),
            (i + 1, -right),
        ] {
            if j < n {
                columns.push(j as u32);
                values.push(value);
            }
        }
        offsets.push(columns.len());
    }
    let stiffness = SymmetricCsr::from_parts(offsets, columns, values).expect("symmetric");
    let operator = Operator {
        stiffness,
        mass: vec![1.0; n],
    };
    for options in [sparse(), dense()] {
        assert!(matches!(
            eigenpairs(&operator, 5, &options, &()),
            Err(EigenError::NotCertified { .. })
        ));
    }
}

#[test]
fn block_size_does_not_change_the_spectrum() {
    let operator = flat_torus(20, 20, 0.2, 0.2);
    for block_size in [1, 3, 16, 64] {
        let options = Options {
            block_size,
            ..sparse()
        };
        let pairs = eigenpairs(&operator, 21, &options, &()).expect("certified");
        assert_close(
            &pairs.values,
            &flat_torus_values(20, 20, 0.2, 0.2)[..21],
            1e-11,
        );
    }
}
