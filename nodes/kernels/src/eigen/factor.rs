//! Sparse LDL' factorisations of A - shift I: solves, and eigenvalue counts by inertia.

use super::EigenError;
use super::packed::Packed;
use super::problem::Problem;
use super::spare::Spare;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::cholesky::supernodal::SupernodalLdltRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, SymbolicSupernodalParams};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Par, Side, Spec};
use std::sync::Arc;

/// The part of a factorisation that all shifts share: ordering and fill.
pub(super) struct Factorizer {
    pattern: SymbolicSparseColMat<usize>,
    entries: Vec<f64>,
    diagonal: Vec<usize>,
    symbolic: SymbolicCholesky<usize>,
    area: f64,
    /// Memory of factors.
    spare: Arc<Spare<Vec<f64>>>,
}

impl Factorizer {
    pub fn new(problem: &Problem<'_>) -> Result<Self, EigenError> {
        let n = problem.n();
        let matrix = problem.stiffness;
        let rows: Vec<usize> = matrix.columns().iter().map(|&c| c as usize).collect();
        let diagonal = (0..n).map(|i| matrix.offsets()[i] + matrix.row(i).take_while(|e| e.0 < i).count()).collect();
        // By symmetry the compressed rows are compressed columns.
        let pattern = SymbolicSparseColMat::new_checked(n, n, matrix.offsets().to_vec(), None, rows);
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            // Merging small supernodes costs some fill and pays in every solve; measured on meshes of 1,000 to 170,000 vertices.
            supernodal_params: SymbolicSupernodalParams {
                relax: Some(&[(4, 0.5), (16, 0.2), (48, 0.05), (usize::MAX, 0.02)]),
            },
            ..Default::default()
        };
        let symbolic = factorize_symbolic_cholesky(pattern.as_ref(), Side::Lower, SymmetricOrdering::Amd, params)
            .map_err(|_| EigenError::Factorisation { shift: 0.0 })?;
        let (entries, spare) = (problem.scaled_entries(), Arc::new(Spare::new()));
        Ok(Self { pattern, entries, diagonal, symbolic, area: problem.area, spare })
    }

    /// The vertex that is eliminated at each step.
    pub fn order(&self) -> Vec<u32> {
        match self.symbolic.perm() {
            Some(permutation) => permutation.arrays().0.iter().map(|&v| v as u32).collect(),
            None => (0..self.symbolic.nrows() as u32).collect(),
        }
    }

    /// The factorisation of A - shift I, without pivoting: backward stable here unless the shift is very near an eigenvalue of a leading
    /// block, which residuals and counts would show.
    pub fn factor(&self, shift: f64) -> Result<Packed, EigenError> {
        let failed = EigenError::Factorisation { shift: shift / self.area };
        let values = self.numbers(shift).ok_or(failed.clone())?;
        let packed = match self.symbolic.raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => Packed::new(symbolic, values, &self.spare),
            SymbolicCholeskyRaw::Simplicial(symbolic) => {
                Packed::of_columns(symbolic.col_ptr(), symbolic.row_idx(), values, &self.spare)
            }
        };
        // Overflow shows as pivots that are not finite.
        if packed.is_sound() { Ok(packed) } else { Err(failed) }
    }

    fn numbers(&self, shift: f64) -> Option<Vec<f64>> {
        let mut entries = self.entries.clone();
        for &d in &self.diagonal {
            entries[d] -= shift;
        }
        let matrix = SparseColMatRef::new(self.pattern.as_ref(), &entries);
        // All of one length, and of any content: the factorisation clears it.
        let mut values = self.spare.take().unwrap_or_else(|| vec![0.0; self.symbolic.len_val()]);
        let scratch = self.symbolic.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Spec::default());
        let mut memory = MemBuffer::try_new(scratch).ok()?;
        let stack = MemStack::new(&mut memory);
        let plain = LdltRegularization::default();
        self.symbolic
            .factorize_numeric_ldlt(&mut values, matrix, Side::Lower, plain, Par::Seq, stack, Spec::default())
            .ok()?;
        Some(values)
    }

    /// The number of eigenvalues of A below `cut`: by Sylvester's law the number of negative pivots of A - cut I.
    ///
    /// A factorisation that breaks down is tried again at nearby cuts, which the caller places in a gap of this relative width.
    pub fn count_below(&self, cut: f64, gap: f64) -> Result<usize, EigenError> {
        for nudge in [0.0, 0.11, -0.13, 0.23] {
            if let Some(values) = self.numbers(cut * (1.0 + nudge * gap)) {
                let pivots = self.pivots(&values);
                self.spare.give(values);
                if pivots.iter().all(|p| p.is_finite() && *p != 0.0) {
                    return Ok(pivots.iter().filter(|p| **p < 0.0).count());
                }
            }
        }
        Err(EigenError::Factorisation { shift: cut / self.area })
    }

    /// The diagonal of D.
    fn pivots(&self, values: &[f64]) -> Vec<f64> {
        match self.symbolic.raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => {
                let factor = SupernodalLdltRef::new(symbolic, values);
                let block = |s: usize| {
                    let block = factor.supernode(s).val();
                    (0..block.ncols()).map(move |j| block[(j, j)])
                };
                (0..symbolic.n_supernodes()).flat_map(block).collect()
            }
            SymbolicCholeskyRaw::Simplicial(symbolic) => {
                symbolic.col_ptr()[..symbolic.nrows()].iter().map(|&start| values[start]).collect()
            }
        }
    }
}
