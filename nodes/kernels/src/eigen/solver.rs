//! From a problem to certified pairs: the method, the attempts, the certificate.

use super::basis::Null;
use super::certify::{Columns, UNCERTIFIED};
use super::cut::place_cut;
use super::dense::{lifted, orthonormalise, refine, symmetric_eigen};
use super::factor::{BELOW, Factorizer, Pattern};
use super::lanczos::expected_blocks;
use super::panel::WIDTH;
use super::parts::three;
use super::pool::{Panels, Pool};
use super::problem::{Problem, Scale};
use super::scratch::Scratch;
use super::slices::{Attempt, Spectrum, Union, union};
use super::slicing::Slicing;
use super::vectors::Vectors;
use super::{Certificate, EigenError, Eigenpairs, Hooks, Method, Options, Phase, enter};
use crate::laplacian::Operator;
use crate::sparse::SymmetricCsr;
use std::fs::File;
use std::io;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// Accepted departure of V' S V from the identity.
const ORTHOGONALITY: f64 = 1e-10;

/// Attempts before giving up, each with other shifts and, if pairs were missing, more fresh blocks.
const ATTEMPTS: usize = 6;

/// See [`super::eigenpairs`].
pub(crate) fn solve(
    operator: &Operator,
    k: usize,
    options: &Options,
    hooks: &dyn Hooks,
) -> Result<Eigenpairs, EigenError> {
    check(operator, k, options)?;
    let hooks = &Forward { hooks, reached: AtomicU64::new(0) };
    hooks.progress(0.0);
    enter(hooks, Phase::Order)?;
    let Operator { stiffness, mass, .. } = operator;
    // Another thread begins with the last, and whichever is done first does what is left.
    let (pattern, scale, begun) = three(
        hooks,
        || Pattern::new(stiffness),
        || Scale::new(stiffness, mass),
        || begin(stiffness, k, options, hooks),
    )?;
    let (scale, Begun { components, slicing, pool }) = (scale?, begun?);
    let problem = Problem::new(operator, scale, components);
    let pattern = pattern.ok_or(EigenError::Factorisation { shift: 0.0 })?;
    let factorizer = Factorizer::new(&problem, pattern);
    let order = factorizer.order();
    let null = problem.null(&order);
    let solver = Solver {
        problem: &problem,
        factorizer: &factorizer,
        order: &order,
        null: &null,
        pool: &pool,
        columns: &Columns::new(&problem, &null, &order, hooks),
        slicing,
        k,
        options,
        hooks,
    };
    let found = solver.attempts()?;
    hooks.progress(1.0);
    Ok(found)
}

/// What is known, and had, before there is an order.
struct Begun {
    components: (usize, Vec<u32>),
    slicing: Slicing,
    pool: Pool,
}

fn begin(stiffness: &SymmetricCsr, k: usize, options: &Options, hooks: &dyn Hooks) -> Result<Begun, EigenError> {
    let components = stiffness.components();
    let (n, wanted) = (stiffness.n(), k.saturating_sub(components.0));
    let slicing = Slicing::new(n, wanted, options);
    let pool = Pool::new(n, k - wanted);
    // Several slices have work for other threads while they touch their memory.
    if is_sparse(n, wanted, slicing, options) && slicing.count() == 1 {
        pool.prepare(slicing.place(0), 1 + expected_blocks(wanted, true), || !hooks.cancelled())?;
    }
    Ok(Begun { components, slicing, pool })
}

/// Keeps progress from falling back when a further attempt begins.
struct Forward<'a> {
    hooks: &'a dyn Hooks,
    reached: AtomicU64,
}

impl Hooks for Forward<'_> {
    fn progress(&self, fraction: f64) {
        // Bits of positive numbers are ordered as the numbers are.
        let before = self.reached.fetch_max(fraction.to_bits(), Ordering::Relaxed);
        self.hooks.progress(fraction.max(f64::from_bits(before)));
    }

    fn cancelled(&self) -> bool {
        self.hooks.cancelled()
    }

    fn scratch(&self) -> io::Result<Option<File>> {
        self.hooks.scratch()
    }

    fn phase(&self, phase: Phase) {
        self.hooks.phase(phase);
    }

    fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        self.hooks.each(count, task);
    }
}

fn check(operator: &Operator, k: usize, options: &Options) -> Result<(), EigenError> {
    let (rows, masses) = (operator.stiffness.n(), operator.mass.len());
    if masses != rows {
        return Err(EigenError::MassLength { rows, masses });
    }
    if k == 0 {
        return Err(EigenError::NoneWanted);
    }
    if k > rows {
        return Err(EigenError::TooMany { wanted: k, available: rows });
    }
    if !(options.tolerance > 0.0 && options.tolerance <= 1e-2) {
        return Err(EigenError::Option { name: "tolerance" });
    }
    Ok(())
}

/// Whether Lanczos is to be tried: not where Krylov spaces are most of the whole one, or pairs most of all. Measured at 1,093 vertices: 700 pairs take 0.14 s
/// by Lanczos and 0.49 densely; of 900, Lanczos needs several attempts.
fn is_sparse(n: usize, wanted: usize, slicing: Slicing, options: &Options) -> bool {
    let krylov = WIDTH * slicing.blocks(0);
    n > options.dense_limit && 4 * krylov <= 3 * n && 3 * wanted <= 2 * n
}

struct Solver<'a> {
    problem: &'a Problem<'a>,
    factorizer: &'a Factorizer,
    order: &'a [u32],
    null: &'a Null,
    pool: &'a Pool,
    columns: &'a Columns<'a>,
    slicing: Slicing,
    k: usize,
    options: &'a Options,
    hooks: &'a dyn Hooks,
}

impl<'a> Solver<'a> {
    /// Eigenvalues wanted beyond the null space.
    fn wanted(&self) -> usize {
        self.k.saturating_sub(self.null.count)
    }

    fn attempts(&self) -> Result<Eigenpairs, EigenError> {
        if !is_sparse(self.problem.n(), self.wanted(), self.slicing, self.options) {
            return self.certified(self.dense()?, Method::Dense, 0);
        }
        let mut attempt = Attempt { number: 0, restarts: 0 };
        loop {
            let error = match self.attempt(attempt) {
                Err(error @ (EigenError::Cancelled | EigenError::Memory | EigenError::Scratch { .. })) => {
                    return Err(error);
                }
                Err(EigenError::Exhausted) => return self.certified(self.dense()?, Method::Dense, 0),
                Err(error) => error,
                Ok(found) => return Ok(found),
            };
            attempt.number += 1;
            if attempt.number == ATTEMPTS {
                return Err(error);
            }
            if let EigenError::NotCertified { expected, found, .. } = error
                && expected > found
            {
                attempt.restarts = 2 * attempt.restarts + (expected - found).div_ceil(WIDTH);
            }
        }
    }

    fn attempt(&self, attempt: Attempt) -> Result<Eigenpairs, EigenError> {
        let spectrum = Spectrum {
            factorizer: self.factorizer,
            null: self.null,
            pool: self.pool,
            columns: self.columns,
            n: self.problem.n(),
            wanted: self.wanted(),
            slicing: self.slicing,
            options: self.options,
            hooks: self.hooks,
        };
        let scratch = if self.slicing.is_frugal { Scratch::new(self.hooks)? } else { None };
        self.certified(union(&spectrum, scratch.as_ref(), attempt)?, Method::Lanczos, attempt.number + 1)
    }

    /// The lowest pairs of a full decomposition, up to the first gap above the wanted ones.
    fn dense(&self) -> Result<Union<'a>, EigenError> {
        let (n, wanted) = (self.problem.n(), self.wanted());
        let available = n - self.null.count;
        enter(self.hooks, Phase::Projected)?;
        let (mut values, vectors) = symmetric_eigen(lifted(self.problem).as_ref())?;
        values.truncate(available);
        let cut = place_cut(&values, wanted, available).ok_or(UNCERTIFIED)?;
        let start = vectors.subcols(0, (cut.position + 1).min(available)).to_owned();
        let mut y = orthonormalise(start).ok_or(UNCERTIFIED)?;
        if y.ncols() > 0 {
            let factor = self.factorizer.factor(BELOW, self.hooks)?;
            for _ in 0..2 {
                if self.hooks.cancelled() {
                    return Err(EigenError::Cancelled);
                }
                y = refine(self.problem, &factor, self.order, &y)?.ok_or(UNCERTIFIED)?;
            }
        }
        values.truncate(cut.position);
        let mut panels = Panels::filled(self.pool, n, values.len(), |i, j| y[(self.order[i] as usize, j)])?;
        self.columns.polish(panels.all_mut(), &mut values, false, self.options.tolerance, self.factorizer)?;
        let vectors = Vectors::of_all(self.pool, panels, values)?;
        Ok(Union { vectors, cut: cut.value, gap: cut.width, last: cut.position == available })
    }

    fn certified(&self, union: Union<'_>, method: Method, rounds: usize) -> Result<Eigenpairs, EigenError> {
        let Union { mut vectors, cut, gap, last } = union;
        let found = self.null.count + vectors.len();
        let expected = OnceLock::new();
        let count = || {
            expected.get_or_init(|| {
                enter(self.hooks, Phase::Count)?;
                let expected = self.factorizer.count_below(cut, gap, self.hooks);
                enter(self.hooks, Phase::Certify)?;
                expected
            });
        };
        enter(self.hooks, Phase::Certify)?;
        let orthogonality = self.columns.orthogonalise(&mut vectors, &count)?;
        // All that were found: only the final values tell which are wanted.
        let (vectors, findings) = self.columns.examine(vectors, self.wanted(), self.options.tolerance)?;
        let orthogonality = orthogonality.max(findings.null);
        let expected = expected.into_inner().unwrap_or(Err(EigenError::Cancelled))?;
        let uncertified = EigenError::NotCertified { expected, found, residual: findings.residual };
        // Final values, not those that the cut was placed by: each pair then stands for an eigenvalue of its own below the cut.
        let below = findings.values.last().is_none_or(|last| *last < cut);
        if expected != found || !below || !findings.fine || orthogonality > ORTHOGONALITY {
            return Err(uncertified);
        }
        let certificate = Certificate {
            method,
            cut: cut / self.problem.area,
            expected,
            found,
            max_residual: findings.residual.max(self.columns.null_residual(findings.values.first().copied())),
            max_orthogonality_error: orthogonality,
            rounds,
            gap_above: self.gap_above(&findings.values, cut, last),
        };
        Ok(self.finish(vectors, &findings.values, certificate))
    }

    /// From the last pair asked for to the next, relative to that.
    fn gap_above(&self, values: &[f64], cut: f64, last: bool) -> Option<f64> {
        let value = |i: usize| {
            if i < self.null.count { Some(0.0) } else { values.get(i - self.null.count).copied() }
        };
        let own = value(self.k - 1)?;
        // Beyond the pairs computed, the next one is as far above the cut as the last one is below it.
        let next = value(self.k).or_else(|| (!last).then_some(2.0 * cut - own))?;
        Some(if next > 0.0 { (next - own) / next } else { 0.0 })
    }

    /// The null space first, in the caller's units, and no more pairs than were asked for.
    fn finish(&self, mut vectors: Vec<f64>, positive: &[f64], certificate: Certificate) -> Eigenpairs {
        let (n, k, problem) = (self.problem.n(), self.k, self.problem);
        let null = self.null.count.min(k);
        vectors.truncate(n * k);
        vectors.shrink_to_fit();
        vectors[..n * null].fill(0.0);
        for i in 0..n {
            let (label, unit) = problem.null_entry(i);
            if label < null {
                vectors[label * n + i] = unit / problem.root[i] / problem.area.sqrt();
            }
        }
        let mut values = vec![0.0; null];
        values.extend(positive[..k - null].iter().map(|x| x / problem.area));
        Eigenpairs { values, vectors, n, certificate }
    }
}
