//! Block Lanczos on B = (A - sigma I)^-1, for the eigenvalues on both sides of sigma (Grimes, Lewis & Simon 1994), with bases that are kept
//! semi-orthogonal: a panel is orthogonalised against all others only when its product with a sketch of them is too large.
//!
//! Ritz vectors are purified (Ericsson & Ruhe 1980): y + W s / theta, W the next block, is B y / theta without another solve, and the residual of A itself
//! is then exactly that of B over theta^2.

use super::basis::{Along, Basis, Near, Null};
use super::departure::{Departure, Recurrence};
use super::packed::Packed;
use super::panel::{Block, Row, WIDTH, ZERO, cholesky, inverse, norm, product, subtract, symmetrised, transposed};
use super::pool::{Panels, Place, Pool};
use super::projected::Projected;
use super::reach::{Chosen, Reach, Ritz, Verdict};
use super::{EigenError, Hooks, Phase, enter};
use crate::random::Random;
use crate::simd::vectorised;
use faer::Mat;

/// Blocks that follow a restart before convergence is looked at: fewer would not show what the new block has found.
const SETTLING: usize = 6;

/// Products with the basis that a new panel may keep. They grow by a factor of some hundreds from one step to the next; what enters the results is
/// their square. Measured: residuals are the same from 1e-8 to 1e-6, and too large at 1e-5.
const LOSS: f64 = 1e-7;

/// So many Ritz vectors are locked once there are so many blocks. Measured: 16 save 2 to 3 % of all at 43,000 and 100,000 vertices, where passes over the basis
/// wait for memory, and cost 3 % at 5,000 and 10,000; with none, products must be removed a half more often.
const LOCKED: usize = 8;
const LOCKED_FROM: usize = 8;

/// Products as large as this are not corrections any more: panels are then orthogonalised with no regard to the recurrence.
const TOTAL: f64 = 0.1;

/// Condition of a block, in the Frobenius norm, from which on one Cholesky QR does not make it orthonormal to 1e-12. That of an orthonormal one is 8.
const UNEVEN: f64 = 64.0;

/// How often B is applied to the random start. Wanted vectors are large in the result, others are not, and so many blocks less are needed in the basis:
/// as many solves, but nothing else. More than that drowns the outermost vectors in rounding errors of those next to the shift. Measured with 100 pairs at 5,000
/// to 43,000 vertices: 1, 3, 4, 5, 6 times, 30 to 31, 28, 27 to 28, 27, 27 blocks.
const POWERS: usize = 4;

/// Residuals shrink by about this factor with each block, measured; what is foreseen from that is at most so many blocks.
const DECAY: f64 = 4.0;
const LEAP: f64 = 12.0;

/// Checks in a row at which all wanted pairs are accurate and yet there is no gap above them, before a fresh block joins.
const STALLED: usize = 3;

/// Coefficients of Ritz vectors below this are left out: they are rounding errors, as most of those are that pairs near the shift have in the last blocks.
/// Measured: with 1e-14 residuals of 1e-11 become 1e-10.
const ROUNDED: f64 = 1e-15;

/// A block that shrinks by this factor under orthogonalisation lay in the span already: only rounding errors are left of it.
const DEPENDENT: f64 = 1e-13;

pub(super) struct Run<'r, 'a> {
    pub n: usize,
    pub shift: f64,
    /// Eigenvalues below the shift beyond the null space, by inertia.
    pub count_below: usize,
    pub factor: &'r Packed,
    pub null: &'a Null,
    pub pool: &'a Pool,
    pub place: Place,
    pub reach: Reach,
    /// Accepted residual relative to the eigenvalue.
    pub tolerance: f64,
    /// How often a fresh random block joins: each finds up to eight more copies of multiple eigenvalues.
    pub restarts: usize,
    pub seed: u64,
}

/// Eigenpairs of A found by one run, ascending; vectors of unit norm in elimination order.
pub(super) struct Found<'a> {
    pub vectors: Panels<'a>,
    pub window: Window,
}

/// What a run has found out of the spectrum around its shift.
pub(super) struct Window {
    /// The eigenvalues, ascending.
    pub values: Vec<f64>,
    /// A gap above the last one.
    pub cut: f64,
    /// Relative width of that gap.
    pub gap: f64,
    /// The shift.
    pub shift: f64,
    /// Eigenvalues below the shift beyond the null space, by inertia.
    pub count_below: usize,
    /// Whether blocks were dropped: what has not been found again of them is a difference, and residuals are known to its rounding errors only.
    pub is_doubtful: bool,
}

struct Krylov<'r, 'a> {
    run: &'r Run<'r, 'a>,
    hooks: &'a dyn Hooks,
    basis: Basis<'a>,
    recurrence: Recurrence,
    departure: Departure,
    /// Where a fresh block replaced what was left of B V_j: j, and the Gram matrix of what was dropped and has not been found again.
    dropped: Vec<(usize, Block)>,
    random: Random,
    /// No check for convergence before so many blocks.
    next_check: usize,
}

/// Finds the pairs that `run.reach` asks for.
pub(super) fn lanczos<'a>(run: &Run<'_, 'a>, hooks: &'a dyn Hooks, step: &dyn Fn()) -> Result<Found<'a>, EigenError> {
    let mut krylov = Krylov::new(run, hooks)?;
    let limit = (run.n - run.null.count) / WIDTH;
    let mut stalled = 0;
    loop {
        let blocks = krylov.recurrence.diagonal.len();
        if blocks >= limit {
            return Err(EigenError::Exhausted);
        }
        krylov.extend(false)?;
        step();
        if krylov.recurrence.diagonal.len() < krylov.next_check {
            continue;
        }
        enter(hooks, Phase::Projected)?;
        let (projected, verdict) = krylov.judge()?;
        match verdict {
            Verdict::Done(chosen) if krylov.dropped.len() >= run.restarts => {
                enter(hooks, Phase::Vectors)?;
                return krylov.found(&projected, &chosen);
            }
            Verdict::Done(_) | Verdict::Short => krylov.extend(true)?,
            Verdict::NotYet(off) if off <= 1.0 && stalled == STALLED => {
                // Copies of a multiple eigenvalue keep turning up where the gap should be.
                stalled = 0;
                krylov.extend(true)?;
            }
            Verdict::NotYet(off) => {
                stalled = if off <= 1.0 { stalled + 1 } else { 0 };
                krylov.next_check = blocks + 1 + stalled.max((off.ln() / DECAY.ln()).ceil().min(LEAP) as usize);
            }
        }
    }
}

/// Vectors that convergence takes by the number of pairs, measured.
pub(super) struct Growth {
    pub slope: f64,
    pub start: f64,
}

/// With pairs on both sides of the shift, up to the end of the spectrum on one of them.
pub(super) const FROM_BOTTOM: Growth = Growth { slope: 1.65, start: 60.0 };

/// Up to a window's edges.
pub(super) const WINDOW: Growth = Growth { slope: 1.95, start: 104.0 };

/// Blocks that so many pairs take. One too many costs less than another look at the projected problem where n is small.
pub(super) fn expected_blocks(pairs: usize, from_bottom: bool) -> usize {
    let Growth { slope, start } = if from_bottom { FROM_BOTTOM } else { WINDOW };
    ((slope * pairs as f64 + start) / WIDTH as f64).ceil() as usize
}

impl<'r, 'a> Krylov<'r, 'a> {
    fn new(run: &'r Run<'r, 'a>, hooks: &'a dyn Hooks) -> Result<Self, EigenError> {
        let first_check = expected_blocks(run.reach.expected, run.reach.is_lowest());
        let mut krylov = Self {
            run,
            hooks,
            basis: Basis::new(run.pool, run.place, run.null, hooks)?,
            recurrence: Recurrence::default(),
            departure: Departure::default(),
            dropped: Vec::new(),
            random: Random::from_state(run.seed),
            next_check: first_check,
        };
        krylov.fresh_block(POWERS)?;
        Ok(krylov)
    }

    /// One step of the recurrence: B times the last panel, orthonormalised against everything known, becomes the next one; or a fresh
    /// block does, if that is wanted or nothing is left.
    fn extend(&mut self, fresh: bool) -> Result<(), EigenError> {
        let last = self.basis.count() - 1;
        self.apply()?;
        let before = (last > 0).then(|| transposed(&self.recurrence.below[last - 1]));
        let diagonal = symmetrised(&self.basis.diagonal()?);
        let near = self.basis.recur(&diagonal, before.as_ref())?;
        self.recurrence.diagonal.push(diagonal);
        let size = largest(&diagonal).max(before.as_ref().map_or(0.0, largest));
        let below = if fresh || !self.dropped.is_empty() { None } else { self.append_nearly_orthogonal(&near)? };
        let below = match below {
            Some(below) => Some(below),
            None => self.append_in_full(&near, fresh, size)?,
        };
        if let Some(below) = below {
            self.recurrence.below.push(below);
            return Ok(());
        }
        self.recurrence.below.push(ZERO);
        self.next_check = self.next_check.max(self.recurrence.diagonal.len() + SETTLING);
        self.fresh_block(0)
    }

    /// Appends w, which the recurrence has left almost orthogonal to the basis, and returns its R; nothing if it is not.
    fn append_nearly_orthogonal(&mut self, near: &Near) -> Result<Option<Block>, EigenError> {
        let Some(first) = cholesky(&near.gram) else { return Ok(None) };
        let scale = inverse(&first);
        let loss = norm(&product(&near.sketch, &scale));
        if loss > TOTAL {
            return Ok(None);
        }
        if loss <= LOSS && norm(&first) * norm(&scale) < UNEVEN {
            self.basis.append(Some(near), &scale)?;
            return Ok(Some(first));
        }
        let mut along = Along { panels: Vec::new() };
        if loss > LOSS {
            along = self.basis.along(true, Some(&scale))?;
            self.departure.note(&along.panels, &self.recurrence);
        }
        let again = self.basis.remove(near, &along, Some(&scale))?;
        let below = self.append_scaled(&first, &again)?;
        if loss > LOSS && !self.basis.is_locked() && self.recurrence.diagonal.len() >= LOCKED_FROM {
            self.lock()?;
        }
        Ok(below)
    }

    /// Locks the Ritz vectors nearest the shift: products with them grow fastest, and most of what solves round is along them.
    fn lock(&mut self) -> Result<(), EigenError> {
        let Projected { values, vectors } = Projected::nearest(&self.recurrence, LOCKED, self.hooks)?;
        let mut nearest: Vec<usize> = (0..values.len()).collect();
        nearest.sort_by(|&a, &b| values[b].abs().total_cmp(&values[a].abs()).then(a.cmp(&b)));
        let c = Mat::from_fn(vectors.nrows(), LOCKED, |i, j| vectors[(i, nearest[j])]);
        self.basis.lock(c.as_ref())
    }

    /// Orthogonalises w against everything known. Appends it and returns its R, or nothing if it is to be replaced or nothing is left of it.
    fn append_in_full(&mut self, near: &Near, fresh: bool, size: f64) -> Result<Option<Block>, EigenError> {
        let along = self.basis.along(true, None)?;
        let last = self.recurrence.diagonal.len() - 1;
        if self.dropped.is_empty() {
            self.departure.note(&along.panels, &self.recurrence);
        }
        for (block, rest) in &mut self.dropped {
            // What was dropped turns up again here.
            let found = if *block + 1 == last { near.last[1] } else { along.panels[*block][1] };
            self.recurrence.couplings.push((*block, last, found));
            subtract(rest, &product(&found, &transposed(&found)));
        }
        let gram = self.basis.remove(near, &along, None)?;
        let left = (0..WIDTH).map(|i| gram[i][i]).fold(0.0, f64::max).sqrt();
        let below = if !fresh && left > DEPENDENT * size { self.append(&gram)? } else { None };
        if below.is_none() {
            self.dropped.push((last, gram));
        }
        Ok(below)
    }

    /// Cholesky QR, twice, of w with this Gram matrix; appends Q and returns R. Nothing if the columns are dependent.
    fn append(&mut self, gram: &Block) -> Result<Option<Block>, EigenError> {
        let Some(first) = cholesky(gram) else { return Ok(None) };
        let again = self.basis.multiply(&inverse(&first))?;
        self.append_scaled(&first, &again)
    }

    /// The second half of that: w was divided by `first`, and has the Gram matrix `again`.
    fn append_scaled(&mut self, first: &Block, again: &Block) -> Result<Option<Block>, EigenError> {
        let Some(second) = cholesky(again) else { return Ok(None) };
        self.basis.append(None, &inverse(&second))?;
        Ok(Some(product(&second, first)))
    }

    /// Appends a random block to which B was applied so often, orthogonal to all that is known.
    fn fresh_block(&mut self, powers: usize) -> Result<(), EigenError> {
        for _ in 0..3 {
            for row in self.basis.work(self.run.n) {
                *row = std::array::from_fn(|_| self.random.signed());
            }
            for _ in 0..powers {
                self.apply()?;
                // Columns are kept apart, as all of them turn to what is next to the shift.
                let Some(r) = cholesky(&self.basis.near()?.gram) else { break };
                self.basis.multiply(&inverse(&r))?;
            }
            self.remove_known()?;
            let gram = self.remove_known()?;
            if self.append(&gram)?.is_some() {
                return Ok(());
            }
        }
        Err(EigenError::Exhausted)
    }

    /// w <- B w.
    fn apply(&mut self) -> Result<(), EigenError> {
        enter(self.hooks, Phase::Solve)?;
        self.run.factor.solve(self.hooks, self.basis.work(self.run.n))?;
        enter(self.hooks, Phase::Orthogonalise)
    }

    /// Removes all that is known from w; returns w' w.
    fn remove_known(&mut self) -> Result<Block, EigenError> {
        let (near, along) = (self.basis.near()?, self.basis.along(false, None)?);
        self.basis.remove(&near, &along, None)
    }

    /// Solves the projected problem, and judges it.
    fn judge(&self) -> Result<(Projected, Verdict), EigenError> {
        let projected = Projected::to_judge(&self.recurrence, &self.run.reach, self.run.shift, self.hooks)?;
        let verdict = self.run.reach.judge(&self.ritz(&projected), self.run.shift, self.run.tolerance);
        Ok((projected, verdict))
    }

    /// The Ritz pairs with positive eigenvalues of A, ascending, with the residuals that purification will leave.
    fn ritz(&self, projected: &Projected) -> Vec<Ritz> {
        let Projected { values, vectors } = projected;
        let last = self.recurrence.below.len() - 1;
        let rest = product(&transposed(&self.recurrence.below[last]), &self.recurrence.below[last]);
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
    fn found(self, projected: &Projected, chosen: &Chosen) -> Result<Found<'a>, EigenError> {
        let m = self.recurrence.diagonal.len() * WIDTH;
        let last = &self.recurrence.below[self.recurrence.below.len() - 1];
        let columns: Vec<usize> = chosen.pairs.iter().map(|r| r.column).collect();
        let mut c = self.departure.correct(&projected.values, projected.vectors.as_ref(), &columns, self.hooks)?;
        for (j, &column) in columns.iter().enumerate() {
            let s = c.col_as_slice_mut(j);
            let mut norm = 1.0;
            for p in 0..WIDTH {
                let rest: f64 = (0..WIDTH).map(|q| last[p][q] * s[m - WIDTH + q]).sum();
                s[m + p] = rest / projected.values[column];
                norm += s[m + p] * s[m + p];
            }
            let scale = 1.0 / norm.sqrt();
            vectorised(
                #[inline(always)]
                || s.iter_mut().for_each(|x| *x = if (*x * scale).abs() > ROUNDED { *x * scale } else { 0.0 }),
            );
        }
        let window = Window {
            values: chosen.pairs.iter().map(|r| r.value).collect(),
            cut: chosen.cut,
            gap: chosen.gap,
            shift: self.run.shift,
            count_below: self.run.count_below,
            is_doubtful: !self.dropped.is_empty(),
        };
        Ok(Found { vectors: self.basis.combine(c.as_ref())?, window })
    }
}

fn largest(block: &Block) -> f64 {
    block.as_flattened().iter().fold(0.0, |m, x| m.max(x.abs()))
}
