//! From approximate vectors to certified pairs: refinement, the cut, the count, deflated rounds for what was missed.

use super::dense::{lifted, symmetric_eigen};
use super::factor::{Factor, Factorizer};
use super::gauge::fix_sign;
use super::lanczos::{Run, lanczos, orthonormalise, refine};
use super::pairs::{Cut, Pairs, place_cut};
use super::problem::Problem;
use super::{Certificate, EigenError, Eigenpairs, Hooks, Method, Options};
use faer::Mat;
use std::cell::Cell;
use std::f64::consts::PI;

/// Shifts tried in turn, in units of the first eigenvalue that Weyl's law expects of a surface of unit area.
const SHIFTS: [f64; 3] = [-1.0, -0.3, -3.7];

/// Accepted departure of V' S V from the identity.
const ORTHOGONALITY: f64 = 1e-10;

/// Deflated rounds per attempt: enough for eight times as many copies of one eigenvalue.
const ROUNDS: usize = 40;

/// When vectors turn out dependent, or no cut exists, there is nothing to count.
const UNCERTIFIED: EigenError = EigenError::NotCertified { expected: 0, found: 0, residual: f64::NAN };

/// See [`super::eigenpairs`]; without a kernel, all eigenvalues count as positive.
pub(crate) fn solve(
    problem: &Problem<'_>,
    k: usize,
    options: &Options,
    hooks: &dyn Hooks,
) -> Result<Eigenpairs, EigenError> {
    check(problem, k, options)?;
    let hooks = &Forward { hooks, reached: Cell::new(0.0) };
    hooks.progress(0.0);
    if hooks.cancelled() {
        return Err(EigenError::Cancelled);
    }
    let nullity = problem.nullity();
    let available = problem.n() - nullity;
    let factorizer = Factorizer::new(problem)?;
    let wanted = k.saturating_sub(nullity);
    let mut attempt =
        Attempt { problem, factorizer: &factorizer, options, hooks, k, wanted, extra: 6 + wanted / 16, number: 0 };
    loop {
        match attempt.run() {
            Ok((pairs, certificate)) => {
                hooks.progress(1.0);
                return Ok(finish(problem, k, &pairs, certificate));
            }
            // A cluster reaches beyond the pairs computed; with all of them there always is a cut.
            Err(Failure::NoGap) if attempt.extra < available => {
                attempt.extra = (4 * attempt.extra).min(available);
            }
            Err(Failure::NoGap) => return Err(UNCERTIFIED),
            Err(Failure::Uncertified(error)) => {
                attempt.number += 1;
                if matches!(error, EigenError::Cancelled) || attempt.number == SHIFTS.len() {
                    return Err(error);
                }
            }
        }
    }
}

/// Keeps progress from falling back when a further round or attempt begins.
struct Forward<'a> {
    hooks: &'a dyn Hooks,
    reached: Cell<f64>,
}

impl Hooks for Forward<'_> {
    fn progress(&self, fraction: f64) {
        self.reached.set(self.reached.get().max(fraction));
        self.hooks.progress(self.reached.get());
    }

    fn cancelled(&self) -> bool {
        self.hooks.cancelled()
    }
}

fn check(problem: &Problem<'_>, k: usize, options: &Options) -> Result<(), EigenError> {
    if k == 0 {
        return Err(EigenError::NoneWanted);
    }
    if k > problem.n() {
        return Err(EigenError::TooMany { wanted: k, available: problem.n() });
    }
    if !(options.tolerance > 0.0 && options.tolerance <= 1e-2) {
        return Err(EigenError::Option { name: "tolerance" });
    }
    if !(1..=64).contains(&options.block_size) {
        return Err(EigenError::Option { name: "block_size" });
    }
    Ok(())
}

/// Why an attempt came to nothing.
enum Failure {
    /// No gap in the spectrum to place the cut in.
    NoGap,
    /// Something else, which another shift may mend.
    Uncertified(EigenError),
}

impl From<EigenError> for Failure {
    fn from(error: EigenError) -> Self {
        Self::Uncertified(error)
    }
}

struct Attempt<'a> {
    problem: &'a Problem<'a>,
    factorizer: &'a Factorizer,
    options: &'a Options,
    hooks: &'a dyn Hooks,
    /// Eigenpairs asked for, and those among them beyond the null space.
    k: usize,
    wanted: usize,
    /// Pairs computed beyond those, to find a gap.
    extra: usize,
    number: usize,
}

impl Attempt<'_> {
    fn run(&self) -> Result<(Pairs, Certificate), Failure> {
        let shift = 4.0 * PI * SHIFTS[self.number];
        let factor = self.factorizer.factor(shift)?;
        let available = self.problem.n() - self.problem.nullity();
        let want = (self.wanted + self.extra).min(available);
        let dense = self.problem.n() <= self.options.dense_limit || 3 * want > self.problem.n();
        let start = if dense { self.dense(want)? } else { self.lanczos(&factor, &Mat::new(), want, 0)? };
        let mut pairs = self.refined(&factor, start)?;
        let mut worst = (0, 0);
        for round in 1..ROUNDS {
            let cut = place_cut(&pairs.values, self.wanted, available).ok_or(Failure::NoGap)?;
            let expected = self.factorizer.count_below(cut.value, cut.width)?;
            let found = self.problem.nullity() + cut.position;
            worst = (expected, found);
            if expected == found {
                return self.certify(
                    pairs,
                    &cut,
                    expected,
                    if dense { Method::Dense } else { Method::Lanczos },
                    round - usize::from(dense),
                );
            }
            if expected < found {
                break; // a duplicate or a spurious value: start again elsewhere
            }
            let more = (expected - found + 2).min(available - pairs.values.len());
            if more == 0 {
                break;
            }
            let fresh = self.lanczos(&factor, &pairs.y, more, round)?;
            pairs = self.refined(&factor, side_by_side(&pairs.y, &fresh))?;
        }
        let residual = pairs.worst_residual(self.problem, self.wanted, self.options.tolerance).0;
        Err(EigenError::NotCertified { expected: worst.0, found: worst.1, residual }.into())
    }

    /// The lowest vectors of a full decomposition, past the first gap above the wanted ones.
    fn dense(&self, want: usize) -> Result<Mat<f64>, EigenError> {
        let (mut values, vectors) = symmetric_eigen(lifted(self.problem).as_ref())?;
        let available = self.problem.n() - self.problem.nullity();
        values.truncate(available);
        let past_gap = place_cut(&values, self.wanted, available).map_or(available, |cut| cut.position + 1);
        Ok(vectors.subcols(0, want.max(past_gap).min(available)).to_owned())
    }

    fn lanczos(
        &self,
        factor: &Factor<'_>,
        locked: &Mat<f64>,
        want: usize,
        round: usize,
    ) -> Result<Mat<f64>, EigenError> {
        if want == 0 {
            return Ok(Mat::zeros(self.problem.n(), 0));
        }
        let run = Run {
            problem: self.problem,
            factor,
            locked: locked.as_ref(),
            want,
            block_size: self.options.block_size,
            seed: 1 + (self.number * ROUNDS + round) as u64,
        };
        lanczos(&run, self.hooks)
    }

    /// Refines until residuals are small or stop falling.
    fn refined(&self, factor: &Factor<'_>, start: Mat<f64>) -> Result<Pairs, EigenError> {
        if start.ncols() == 0 {
            return Ok(Pairs { values: Vec::new(), v: start.clone(), y: start });
        }
        let mut y = orthonormalise(start).ok_or(UNCERTIFIED)?;
        for _ in 0..4 {
            if self.hooks.cancelled() {
                return Err(EigenError::Cancelled);
            }
            y = refine(self.problem, factor, &y)?.ok_or(UNCERTIFIED)?;
            let pairs = Pairs::sorted(self.problem, &y);
            if pairs.worst_residual(self.problem, self.wanted, self.options.tolerance).1 {
                return Ok(pairs);
            }
        }
        Ok(Pairs::sorted(self.problem, &y))
    }

    fn certify(
        &self,
        pairs: Pairs,
        cut: &Cut,
        expected: usize,
        method: Method,
        rounds: usize,
    ) -> Result<(Pairs, Certificate), Failure> {
        let found = self.problem.nullity() + cut.position;
        let (residual, fine) = pairs.worst_residual(self.problem, self.wanted, self.options.tolerance);
        let orthogonality = pairs.orthogonality_error(self.problem);
        if !fine || orthogonality > ORTHOGONALITY {
            return Err(EigenError::NotCertified { expected, found, residual }.into());
        }
        // The spectrum around the last pair asked for, zeros included.
        let nullity = self.problem.nullity();
        let value = |i: usize| {
            if i < nullity { Some(0.0) } else { pairs.values.get(i - nullity).copied() }
        };
        let gap_above = value(self.k).zip(value(self.k - 1)).map(
            |(next, last)| {
                if next > 0.0 { (next - last) / next } else { 0.0 }
            },
        );
        let certificate = Certificate {
            method,
            cut: cut.value / self.problem.area,
            expected,
            found,
            max_residual: residual.max(pairs.null_residual(self.problem)),
            max_orthogonality_error: orthogonality,
            rounds,
            gap_above,
        };
        Ok((pairs, certificate))
    }
}

fn side_by_side(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(a.nrows(), a.ncols() + b.ncols(), |i, j| if j < a.ncols() { a[(i, j)] } else { b[(i, j - a.ncols())] })
}

/// Back to the caller's units, null space first.
fn finish(problem: &Problem<'_>, k: usize, pairs: &Pairs, certificate: Certificate) -> Eigenpairs {
    let n = problem.n();
    let null = problem.nullity().min(k);
    let mut vectors = vec![0.0; n * k];
    for i in 0..n {
        if let Some((label, unit)) = problem.null_entry(i)
            && label < null
        {
            vectors[label * n + i] = unit / problem.root[i] / problem.area.sqrt();
        }
    }
    let mut values = vec![0.0; null];
    for j in 0..k - null {
        values.push(pairs.values[j] / problem.area);
        let target = &mut vectors[(null + j) * n..(null + j + 1) * n];
        for (x, v) in target.iter_mut().zip(pairs.v.col_as_slice(j)) {
            *x = v / problem.area.sqrt() + 0.0; // + 0.0: no negative zeros in an artefact
        }
        fix_sign(target, problem.mass);
    }
    Eigenpairs { values, vectors, n, certificate }
}
