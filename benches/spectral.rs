//! Assembly, ordering, factorisation and eigenpairs. `cargo bench --bench spectral [FILTER]`.

mod shapes;

use divan::{Bencher, black_box};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, SymbolicSupernodalParams};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Par, Side, Spec};
use salient_kernels::eigen::{Options, eigenpairs};
use salient_kernels::laplacian::{Area, Operator, laplacian};
use shapes::{operator, real, refined};

fn main() {
    divan::main();
}

const SIZES: [&str; 5] = ["1k", "5k", "10k", "43k", "173k"];

#[divan::bench(args = SIZES, sample_count = 10)]
fn assembly(bencher: Bencher, size: &str) {
    let mesh = refined(size);
    bencher.bench(|| laplacian(black_box(&mesh.vertices), &mesh.faces, Area::Mixed, false));
}

#[divan::bench(args = SIZES, sample_count = 5)]
fn assembly_intrinsic_delaunay(bencher: Bencher, size: &str) {
    let mesh = refined(size);
    bencher.bench(|| laplacian(black_box(&mesh.vertices), &mesh.faces, Area::Mixed, true));
}

/// The pattern as faer takes it: by symmetry, compressed rows are compressed columns.
fn pattern(operator: &Operator) -> SymbolicSparseColMat<usize> {
    let m = &operator.stiffness;
    let rows = m.columns().iter().map(|&c| c as usize).collect();
    SymbolicSparseColMat::new_checked(m.n(), m.n(), m.offsets().to_vec(), None, rows)
}

/// With supernodes merged as in the kernel.
fn symbolic(pattern: &SymbolicSparseColMat<usize>) -> SymbolicCholesky<usize> {
    let params = CholeskySymbolicParams {
        supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
        supernodal_params: SymbolicSupernodalParams {
            relax: Some(&[(4, 0.5), (16, 0.2), (48, 0.05), (usize::MAX, 0.02)]),
        },
        ..Default::default()
    };
    factorize_symbolic_cholesky(pattern.as_ref(), Side::Lower, SymmetricOrdering::Amd, params).expect("memory")
}

/// faer's AMD, which the kernel uses, and symbolic factorisation, which it does not.
#[divan::bench(args = SIZES, sample_count = 5)]
fn ordering(bencher: Bencher, size: &str) {
    let pattern = pattern(&operator(&refined(size)));
    bencher.bench(|| symbolic(black_box(&pattern)));
}

/// faer's numeric LDL' of M + 1e-3 diag(M), for comparison with that of the kernel.
#[divan::bench(args = SIZES, sample_count = 5)]
fn factorisation(bencher: Bencher, size: &str) {
    let operator = operator(&refined(size));
    let pattern = pattern(&operator);
    let symbolic = symbolic(&pattern);
    let mut entries = operator.stiffness.values().to_vec();
    for i in 0..operator.stiffness.n() {
        let start = operator.stiffness.offsets()[i];
        let at = operator.stiffness.row(i).position(|(j, _)| j == i).expect("every row has its diagonal");
        entries[start + at] *= 1.001;
    }
    let matrix = SparseColMatRef::new(pattern.as_ref(), &entries);
    let mut values = vec![0.0; symbolic.len_val()];
    let mut memory = MemBuffer::new(symbolic.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Spec::default()));
    bencher.bench_local(|| {
        let (plain, stack) = (LdltRegularization::default(), MemStack::new(&mut memory));
        symbolic
            .factorize_numeric_ldlt(&mut values, matrix, Side::Lower, plain, Par::Seq, stack, Spec::default())
            .map(|_| ())
            .expect("a positive definite matrix");
    });
}

fn solve(bencher: Bencher, operator: &Operator, k: usize) {
    bencher.bench(|| eigenpairs(black_box(operator), k, &Options::default(), &()).expect("certified pairs"));
}

#[divan::bench(args = [("1k", 100), ("1k", 300), ("5k", 100), ("5k", 300), ("10k", 100), ("10k", 300), ("43k", 100)], sample_count = 3)]
fn eigensolve(bencher: Bencher, (size, k): (&str, usize)) {
    solve(bencher, &operator(&refined(size)), k);
}

#[divan::bench(args = [("43k", 300), ("173k", 100), ("10k", 1000)], sample_count = 1, sample_size = 1)]
fn eigensolve_large(bencher: Bencher, (size, k): (&str, usize)) {
    solve(bencher, &operator(&refined(size)), k);
}

#[divan::bench(args = ["quadrupeds/Horse/Horse__Attack_Headbutt_33.off", "cheburashka_poses/cheburashka-01.obj", "cow_poses/cow-1.obj"], sample_count = 3)]
fn eigensolve_real(bencher: Bencher, file: &str) {
    if let Some(mesh) = real(file) {
        solve(bencher, &operator(&mesh), 100);
    }
}
