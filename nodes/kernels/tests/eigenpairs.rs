//! What the eigensolver promises whatever the mesh: agreement with a dense solver, determinism, cancellation, refusals.

mod common;
#[path = "common/solving.rs"]
mod solving;

use common::*;
use salient_kernels::eigen::{EigenError, Eigenpairs, Hooks, Method, Options, eigenpairs};
use salient_kernels::laplacian::{Area, Operator, laplacian};
use salient_kernels::sparse::SymmetricCsr;
use solving::*;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

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
    for (p, q, k) in [(20, 17, 30), (25, 20, 50), (50, 9, 25)] {
        for intrinsic in [false, true] {
            let mesh = rough_patch(p, q);
            let operator = laplacian(&mesh.0, &mesh.1, Area::Mixed, intrinsic).expect("a good mesh");
            let lanczos = eigenpairs(&operator, k, &sparse(), &()).expect("certified");
            let full = eigenpairs(&operator, k, &dense(), &()).expect("certified");
            assert_eq!((lanczos.certificate.method, full.certificate.method), (Method::Lanczos, Method::Dense));
            assert_certified(&operator, &lanczos, 1e-8);
            assert_certified(&operator, &full, 1e-8);
            assert_close(&lanczos.values, &full.values, 1e-11);
            // Eigenvalues are simple here, so vectors agree too, with their signs, unless the sign is a close call.
            for j in 0..k {
                let pair = (lanczos.vector(j), full.vector(j));
                let product: f64 = (0..lanczos.n).map(|i| operator.mass[i] * pair.0[i] * pair.1[i]).sum();
                let gap = (0..k).filter(|i| *i != j).map(|i| (full.values[i] / full.values[j].max(1e-3) - 1.0).abs());
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
    assert_eq!((all.certificate.expected, all.certificate.gap_above), (30, None));
    for k in 1..=30 {
        let pairs = eigenpairs(&operator, k, &sparse(), &()).expect("certified");
        assert_certified(&operator, &pairs, 1e-8);
        assert_close(&pairs.values, &all.values[..k], 1e-12);
    }
    assert_eq!(
        eigenpairs(&operator, 31, &sparse(), &()).unwrap_err(),
        EigenError::TooMany { wanted: 31, available: 30 }
    );
    assert_eq!(eigenpairs(&operator, 0, &sparse(), &()).unwrap_err(), EigenError::NoneWanted);
}

#[test]
fn repeats_are_bit_identical() {
    let operator = operator(&rough_patch(30, 20));
    for options in [sparse(), dense()] {
        let bits = |pairs: &Eigenpairs| -> Vec<u64> {
            pairs.values.iter().chain(&pairs.vectors).map(|x| x.to_bits()).collect()
        };
        let first = eigenpairs(&operator, 40, &options, &()).expect("certified");
        assert_eq!(bits(&first), bits(&eigenpairs(&operator, 40, &options, &()).expect("certified")));
        assert!(first.vectors.iter().all(|x| x.to_bits() != (-0.0f64).to_bits()));
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
        let difference =
            (0..n).map(|v| (a.vector(j)[v as usize] - b.vector(j)[renumber(v) as usize]).abs()).fold(0.0, f64::max);
        assert!(difference < 1e-6 * largest, "vector {j}: {difference}");
    }
}

struct CountDown {
    left: AtomicUsize,
    seen: Mutex<Vec<f64>>,
}

impl Hooks for CountDown {
    fn progress(&self, fraction: f64) {
        self.seen.lock().expect("no panics").push(fraction);
    }

    fn cancelled(&self) -> bool {
        let down = |left: usize| Some(left.saturating_sub(1));
        self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, down) == Ok(0)
    }
}

#[test]
fn cancelling_stops_at_any_poll_and_progress_rises_to_one() {
    let operator = operator(&rough_patch(40, 30));
    let run = |left: usize| {
        let hooks = CountDown { left: AtomicUsize::new(left), seen: Mutex::default() };
        let result = eigenpairs(&operator, 40, &sparse(), &hooks);
        (result, hooks.left.into_inner(), hooks.seen.into_inner().expect("no panics"))
    };
    let (result, left, seen) = run(10_000);
    assert!(result.is_ok());
    assert!(
        seen.windows(2).all(|w| w[0] <= w[1]) && seen.first() == Some(&0.0) && seen.last() == Some(&1.0),
        "{seen:?}"
    );
    let polls = 10_000 - left;
    assert!(polls >= 100 / 8, "one poll a block at least: {polls}");
    for left in (0..polls).step_by(4).chain([polls - 1]) {
        assert_eq!(run(left).0.unwrap_err(), EigenError::Cancelled, "poll {left}");
    }
}

#[test]
fn bad_operators_are_refused() {
    let good = operator(&icosphere(1));
    let solve = |operator: &Operator| eigenpairs(operator, 2, &sparse(), &()).unwrap_err();
    let short = Operator { mass: vec![1.0; 5], ..good.clone() };
    assert_eq!(solve(&short), EigenError::MassLength { rows: 42, masses: 5 });
    for bad in [0.0, -1.0, f64::NAN] {
        let mut mass = good.mass.clone();
        mass[7] = bad;
        assert_eq!(solve(&Operator { mass, ..good.clone() }), EigenError::NotFinite { vertex: 7 });
    }
    let shifted =
        SymmetricCsr::from_parts(vec![0, 2, 4], vec![0, 1, 0, 1], vec![1.0, -1.0, -1.0, 1.5]).expect("symmetric");
    assert_eq!(solve(&Operator { stiffness: shifted, mass: vec![1.0; 2] }), EigenError::NotLaplacian { vertex: 1 });
    let wrong = Options { tolerance: 0.0, ..Options::default() };
    assert_eq!(eigenpairs(&good, 4, &wrong, &()).unwrap_err(), EigenError::Option { name: "tolerance" });
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
        for (j, value) in [(i.wrapping_sub(1), -left), (i, left + right), (i + 1, -right)] {
            if j < n {
                columns.push(j as u32);
                values.push(value);
            }
        }
        offsets.push(columns.len());
    }
    let stiffness = SymmetricCsr::from_parts(offsets, columns, values).expect("symmetric");
    let operator = Operator { stiffness, mass: vec![1.0; n] };
    for options in [sparse(), dense()] {
        let result = eigenpairs(&operator, 5, &options, &());
        assert!(matches!(result, Err(EigenError::NotCertified { .. })), "{:?}", result.map(|p| p.certificate));
    }
}
