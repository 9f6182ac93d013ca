//! Block Lanczos with full reorthogonalisation on B = (A - sigma I)^-1, for the eigenvalues on both sides of sigma (Grimes, Lewis & Simon 1994).
//!
//! Ritz vectors are purified (Ericsson & Ruhe 1980): y + W s / theta, W the next block, is B y / theta without another solve, and the residual of A itself
//! is then exactly that of B over theta^2.

use super::basis::{Basis, Null, padded};
use super::dense::symmetric_eigen;
use super::packed::Packed;
use super::panel::{Block, Row, Rows, WIDTH, ZERO, cholesky, inverse, product, symmetrised, transposed};
use super::reach::{Chosen, Reach, Ritz, Verdict};
use super::vectors::Store;
use super::{EigenError, Hooks, Phase};
use crate::random::Random;
use faer::Mat;

/// Blocks that follow a restart before convergence is looked at: fewer would not show what the new block has found.
const SETTLING: usize = 6;

/// A block that shrinks by this factor under orthogonalisation lay in the span already: only rounding errors are left of it.
const DEPENDENT: f64 = 1e-13;

pub(super) struct Run<'a> {
    pub n: usize,
    pub shift: f64,
    /// Eigenvalues below the shift beyond the null space, by inertia.
    pub count_below: usize,
    pub factor: &'a Packed,
    pub null: &'a Null,
    pub reach: Reach,
    /// Accepted residual relative to the eigenvalue.
    pub tolerance: f64,
    /// How often a fresh random block joins: each finds up to eight more copies of multiple eigenvalues.
    pub restarts: usize,
    pub seed: u64,
}

/// Eigenpairs of A found by one run, ascending; vectors of unit norm in elimination order.
pub(super) struct Found {
    pub values: Vec<f64>,
    pub vectors: Store,
    /// A gap above the last pair.
    pub cut: f64,
    /// Relative width of that gap.
    pub gap: f64,
    /// The shift.
    pub shift: f64,
    /// Eigenvalues below the shift beyond the null space, by inertia.
    pub count_below: usize,
}

struct Krylov<'a> {
    run: &'a Run<'a>,
    basis: Basis<'a>,
    w: Rows,
    /// Diagonal blocks of the projection of B, and those below: V_(j+1) below[j] is what was left of B V_j.
    diagonal: Vec<Block>,
    below: Vec<Block>,
    /// Where a fresh block replaced what was left of B V_j: j, and the Gram matrix of what was dropped.
    dropped: Vec<(usize, Block)>,
    random: Random,
    /// No check for convergence before so many blocks.
    next_check: usize,
}

/// Finds the pairs that `run.reach` asks for.
pub(super) fn lanczos(run: &Run<'_>, hooks: &dyn Hooks, step: &dyn Fn()) -> Result<Found, EigenError> {
    let mut krylov = Krylov::new(run)?;
    let limit = (run.n - run.null.count) / WIDTH;
    let mut wait = 1;
    loop {
        if hooks.cancelled() {
            return Err(EigenError::Cancelled);
        }
        let blocks = krylov.diagonal.len();
        if blocks >= limit {
            return Err(EigenError::Exhausted);
        }
        krylov.extend(false, hooks)?;
        step();
        if krylov.diagonal.len() < krylov.next_check {
            continue;
        }
        hooks.phase(Phase::Projected);
        let (projected, verdict) = krylov.judge()?;
        match verdict {
            Verdict::Done(chosen) if krylov.dropped.len() >= run.restarts => {
                hooks.phase(Phase::Vectors);
                return krylov.found(&projected, &chosen);
            }
            Verdict::Done(_) | Verdict::Short => krylov.extend(true, hooks)?,
            Verdict::NotYet => {
                krylov.next_check = blocks + 1 + wait;
                wait += 1;
            }
        }
    }
}

/// Blocks that convergence takes, measured: with pairs on both sides of the shift up to the end of the spectrum on one of them, or up to a window's edge.
pub(super) fn expected_blocks(pairs: usize, from_bottom: bool) -> usize {
    let vectors = if from_bottom { 1.75 * pairs as f64 + 60.0 } else { 2.05 * pairs as f64 + 90.0 };
    (vectors / WIDTH as f64).ceil() as usize
}

/// Eigenvalues and vectors of the projection of B.
struct Projected {
    values: Vec<f64>,
    vectors: Mat<f64>,
}

impl<'a> Krylov<'a> {
    fn new(run: &'a Run<'a>) -> Result<Self, EigenError> {
        let first_check = expected_blocks(run.reach.expected, run.reach.is_lowest());
        let mut krylov = Self {
            run,
            basis: Basis::new(run.n, first_check + first_check / 6 + 4, run.null)?,
            w: Rows::zeroed(padded(run.n)).map_err(|_| EigenError::Memory)?,
            diagonal: Vec::new(),
            below: Vec::new(),
            dropped: Vec::new(),
            random: Random::from_state(run.seed),
            next_check: first_check,
        };
        krylov.fresh_block(true)?;
        Ok(krylov)
    }

    /// One step of the recurrence: B times the last panel, orthonormalised against everything known, becomes the next one; or a fresh
    /// block does, if that is wanted or nothing is left.
    fn extend(&mut self, fresh: bool, hooks: &dyn Hooks) -> Result<(), EigenError> {
        let last = self.basis.count() - 1;
        hooks.phase(Phase::Solve);
        let w = self.w.as_mut_slice();
        self.basis.copy(last, w);
        self.run.factor.solve(&mut w[..self.run.n]);
        hooks.phase(Phase::Orthogonalise);
        // The three-term recurrence first, so that the pass over the whole basis removes only rounding errors.
        let before = (last > 0).then(|| transposed(&self.below[last - 1]));
        let diagonal = symmetrised(&self.basis.local(w, before.as_ref()));
        let along = self.basis.along(w, Some(&diagonal));
        let gram = self.basis.remove(w, &along);
        self.diagonal.push(diagonal);
        let size = largest(&diagonal).max(before.as_ref().map_or(0.0, largest));
        let left = (0..WIDTH).map(|i| gram[i][i]).fold(0.0, f64::max).sqrt();
        let below = if !fresh && left > DEPENDENT * size { self.append(&gram)? } else { None };
        if let Some(below) = below {
            self.below.push(below);
            return Ok(());
        }
        self.dropped.push((last, gram));
        self.below.push(ZERO);
        self.next_check = self.next_check.max(self.diagonal.len() + SETTLING);
        self.fresh_block(false)
    }

    /// Cholesky QR, twice, of w with this Gram matrix; appends Q and returns R. Nothing if the columns are dependent.
    fn append(&mut self, gram: &Block) -> Result<Option<Block>, EigenError> {
        let Some(first) = cholesky(gram) else { return Ok(None) };
        let w = self.w.as_mut_slice();
        let again = self.basis.multiply(w, &inverse(&first));
        let Some(second) = cholesky(&again) else { return Ok(None) };
        self.basis.append(w, &inverse(&second))?;
        Ok(Some(product(&second, &first)))
    }

    /// Appends a random block, orthogonal to all that is known.
    fn fresh_block(&mut self, smooth: bool) -> Result<(), EigenError> {
        for _ in 0..3 {
            let w = self.w.as_mut_slice();
            for row in &mut w[..self.run.n] {
                *row = std::array::from_fn(|_| self.random.signed());
            }
            w[self.run.n..].fill([0.0; WIDTH]);
            if smooth {
                // One step of B: the start is smooth, as the wanted vectors are.
                self.run.factor.solve(&mut w[..self.run.n]);
            }
            let mut gram = ZERO;
            for _ in 0..2 {
                let along = self.basis.along(w, None);
                gram = self.basis.remove(w, &along);
            }
            if self.append(&gram)?.is_some() {
                return Ok(());
            }
        }
        Err(EigenError::Exhausted)
    }

    /// Solves the projected problem, and judges it.
    fn judge(&self) -> Result<(Projected, Verdict), EigenError> {
        let blocks = self.diagonal.len();
        let m = blocks * WIDTH;
        let mut projection = Mat::<f64>::zeros(m, m);
        for j in 0..blocks {
            for p in 0..WIDTH {
                for q in 0..WIDTH {
                    projection[(j * WIDTH + p, j * WIDTH + q)] = self.diagonal[j][p][q];
                    if j + 1 < blocks {
                        projection[((j + 1) * WIDTH + p, j * WIDTH + q)] = self.below[j][p][q];
                    }
                }
            }
        }
        let (values, vectors) = symmetric_eigen(projection.as_ref())?;
        let ritz = self.ritz(&values, &vectors);
        let verdict = self.run.reach.judge(&ritz, self.run.shift, self.run.tolerance);
        Ok((Projected { values, vectors }, verdict))
    }

    /// All Ritz pairs with positive eigenvalues of A, ascending, with the residuals that purification will leave.
    fn ritz(&self, values: &[f64], vectors: &Mat<f64>) -> Vec<Ritz> {
        let last = self.below.len() - 1;
        let rest = product(&transposed(&self.below[last]), &self.below[last]);
        let square = |gram: &Block, block: usize, column: usize| -> f64 {
            let s: Row = std::array::from_fn(|p| vectors[(block * WIDTH + p, column)]);
            (0..WIDTH).map(|p| s[p] * (0..WIDTH).map(|q| gram[p][q] * s[q]).sum::<f64>()).sum()
        };
        let mut ritz: Vec<Ritz> = Vec::with_capacity(values.len());
        for (column, &theta) in values.iter().enumerate() {
            let value = self.run.shift + 1.0 / theta;
            if value > 0.0 && value.is_finite() {
                let dropped: f64 = self.dropped.iter().map(|(block, gram)| square(gram, *block, column)).sum();
                let residual = (square(&rest, last, column) + dropped).max(0.0).sqrt() / (theta * theta);
                ritz.push(Ritz { value, residual, column });
            }
        }
        ritz.sort_by(|a, b| a.value.total_cmp(&b.value).then(a.column.cmp(&b.column)));
        ritz
    }

    /// Purified Ritz vectors of unit norm.
    fn found(&self, projected: &Projected, chosen: &Chosen) -> Result<Found, EigenError> {
        let m = self.diagonal.len() * WIDTH;
        let last = &self.below[self.below.len() - 1];
        let mut c = Mat::<f64>::zeros(m + WIDTH, chosen.pairs.len());
        for (j, ritz) in chosen.pairs.iter().enumerate() {
            let theta = projected.values[ritz.column];
            let s = |i: usize| projected.vectors[(i, ritz.column)];
            let mut norm = 1.0;
            for p in 0..WIDTH {
                let next: f64 = (0..WIDTH).map(|q| last[p][q] * s(m - WIDTH + q)).sum::<f64>() / theta;
                c[(m + p, j)] = next;
                norm += next * next;
            }
            let scale = 1.0 / norm.sqrt();
            for i in 0..m {
                c[(i, j)] = s(i) * scale;
            }
            for p in 0..WIDTH {
                c[(m + p, j)] *= scale;
            }
        }
        Ok(Found {
            values: chosen.pairs.iter().map(|r| r.value).collect(),
            vectors: self.basis.combine(c.as_ref())?,
            cut: chosen.cut,
            gap: chosen.gap,
            shift: self.run.shift,
            count_below: self.run.count_below,
        })
    }
}

fn largest(block: &Block) -> f64 {
    block.as_flattened().iter().fold(0.0, |m, x| m.max(x.abs()))
}
