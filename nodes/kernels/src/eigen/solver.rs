//! From approximate vectors to certified pairs: refinement, the cut, the count, deflated rounds for what was missed.

use super::dense::{inner, lifted, symmetric_eigen, symmetric_eigenvalues};
use super::factor::{Factor, Factorizer};
use super::gauge::fix_sign;
use super::lanczos::{Run, lanczos, orthonormalise, refine};
use super::problem::Problem;
use super::{Certificate, EigenError, Eigenpairs, Hooks, Method, Options};
use faer::Mat;
use std::cell::Cell;
use std::f64::consts::PI;

/// Shifts tried in turn, in units of the first eigenvalue that Weyl's law expects of a surface of unit area.
const SHIFTS: [f64; 3] = [-1.0, -0.3, -3.7];

/// A gap this wide, relative to the eigenvalue above it, is as good a place for the cut as any.
const WIDE: f64 = 1e-4;

/// A gap must be at least this wide for a cut.
const NARROW: f64 = 1e-8;

/// Accepted departure of V' S V from the identity.
const ORTHOGONALITY: f64 = 1e-10;

/// Deflated rounds per attempt: enough for eight times as many copies of one eigenvalue.
const ROUNDS: usize = 40;

/// Pairs of the scaled problem with ascending values, columns as R^-1 y.
struct Pairs {
    values: Vec<f64>,
    y: Mat<f64>,
    v: Mat<f64>,
}

struct Cut {
    position: usize,
    value: f64,
    width: f64,
}

/// See [`super::eigenpairs`]; without a kernel, all eigenvalues count as positive.
pub(crate) fn solve(
    problem: &Problem<'_>,
    k: usize,
    options: &Options,
    hooks: &dyn Hooks,
) -> Result<Eigenpairs, EigenError> {
    check(problem, k, options)?;
    let hooks = &Forward {
        hooks,
        reached: Cell::new(0.0),
    };
    hooks.progress(0.0);
    if hooks.cancelled() {
        return Err(EigenError::Cancelled);
    }
    let nullity = problem.nullity();
    let available = problem.n() - nullity;
    let factorizer = Factorizer::new(problem)?;
    let mut failure = EigenError::NotCertified {
        expected: 0,
        found: 0,
        residual: f64::NAN,
    };
    let wanted = k.saturating_sub(nullity);
    let mut attempt = Attempt {
        problem,
        factorizer: &factorizer,
        options,
        hooks,
        wanted,
        extra: 6 + wanted / 16,
        number: 0,
    };
    for number in 0..SHIFTS.len() {
        attempt.number = number;
        match attempt.run() {
            Ok((pairs, certificate)) => {
                hooks.progress(1.0);
                return Ok(finish(problem, k, &pairs, certificate));
            }
            Err(EigenError::Cancelled) => return Err(EigenError::Cancelled),
            Err(error) => failure = error,
        }
        // A cluster may reach beyond the pairs computed.
        attempt.extra = (4 * attempt.extra).min(available);
    }
    Err(failure)
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
        return Err(EigenError::TooMany {
            wanted: k,
            available: problem.n(),
        });
    }
    if !(options.tolerance > 0.0 && options.tolerance <= 1e-2) {
        return Err(EigenError::Option { name: "tolerance" });
    }
    if !(1..=64).contains(&options.block_size) {
        return Err(EigenError::Option { name: "block_size" });
    }
    Ok(())
}

struct Attempt<'a> {
    problem: &'a Problem<'a>,
    factorizer: &'a Factorizer,
    options: &'a Options,
    hooks: &'a dyn Hooks,
    /// Eigenpairs wanted beyond the null space.
    wanted: usize,
    /// Pairs computed beyond those, to find a gap.
    extra: usize,
    number: usize,
}

impl Attempt<'_> {
    fn run(&self) -> Result<(Pairs, Certificate), EigenError> {
        let shift = 4.0 * PI * SHIFTS[self.number];
        let factor = self.factorizer.factor(shift)?;
        let available = self.problem.n() - self.problem.nullity();
        let want = (self.wanted + self.extra).min(available);
        let dense = self.problem.n() <= self.options.dense_limit || 3 * want > self.problem.n();
        let start = if dense {
            self.dense(want)?
        } else {
            self.lanczos(&factor, &Mat::new(), want, 0)?
        };
        let mut pairs = self.refined(&factor, start)?;
        let mut worst = (0, 0);
        for round in 1..ROUNDS {
            let Some(cut) = place_cut(&pairs.values, self.wanted, available) else {
                break;
            };
            let expected = self.factorizer.count_below(cut.value, cut.width)?;
            let found = self.problem.nullity() + cut.position;
            worst = (expected, found);
            if expected == found {
                return self.certify(
                    pairs,
                    &cut,
                    expected,
                    if dense {
                        Method::Dense
                    } else {
                        Method::Lanczos
                    },
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
        let residual = self.worst_residual(&pairs).0;
        Err(EigenError::NotCertified {
            expected: worst.0,
            found: worst.1,
            residual,
        })
    }

    fn dense(&self, want: usize) -> Result<Mat<f64>, EigenError> {
        let (_, vectors) = symmetric_eigen(lifted(self.problem).as_ref())?;
        Ok(vectors.subcols(0, want).to_owned())
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
        let uncertified = EigenError::NotCertified {
            expected: 0,
            found: 0,
            residual: f64::NAN,
        };
        if start.ncols() == 0 {
            return Ok(Pairs {
                values: Vec::new(),
                v: start.clone(),
                y: start,
            });
        }
        let mut y = orthonormalise(start).ok_or(uncertified.clone())?;
        for _ in 0..4 {
            if self.hooks.cancelled() {
                return Err(EigenError::Cancelled);
            }
            y = refine(self.problem, factor, &y)?.ok_or(uncertified.clone())?;
            let pairs = sorted_pairs(self.problem, &y);
            if self.worst_residual(&pairs).1 {
                return Ok(pairs);
            }
        }
        Ok(sorted_pairs(self.problem, &y))
    }

    /// The largest relative residual of the wanted pairs and those just above, and whether all are within bounds.
    fn worst_residual(&self, pairs: &Pairs) -> (f64, bool) {
        let (mut worst, mut fine) = (0.0f64, true);
        for (j, &value) in pairs.values.iter().enumerate() {
            let (norm, rounding) = self.problem.residual(value, column(&pairs.v, j));
            if norm > (self.options.tolerance * value).max(16.0 * rounding)
                || !norm.is_finite()
                || value <= 0.0
            {
                fine = false;
            }
            if j < self.wanted {
                worst = worst.max(norm / value);
            }
        }
        (worst, fine)
    }

    fn certify(
        &self,
        pairs: Pairs,
        cut: &Cut,
        expected: usize,
        method: Method,
        rounds: usize,
    ) -> Result<(Pairs, Certificate), EigenError> {
        let found = self.problem.nullity() + cut.position;
        let (residual, fine) = self.worst_residual(&pairs);
        let orthogonality = self.orthogonality_error(&pairs);
        if !fine || orthogonality > ORTHOGONALITY {
            return Err(EigenError::NotCertified {
                expected,
                found,
                residual,
            });
        }
        let relative_gap = |next: f64| match self.wanted {
            0 => 1.0,
            k => (next - pairs.values[k - 1]) / next,
        };
        let certificate = Certificate {
            method,
            cut: cut.value / self.problem.area,
            expected,
            found,
            max_residual: residual.max(self.null_residual(&pairs)),
            max_orthogonality_error: orthogonality,
            rounds,
            gap_above: pairs
                .values
                .get(self.wanted)
                .map(|&next| relative_gap(next)),
        };
        Ok((pairs, certificate))
    }

    /// The largest residual of the null vectors over the first positive eigenvalue: rounding of the row sums.
    fn null_residual(&self, pairs: &Pairs) -> f64 {
        let Some(&first) = pairs.values.first() else {
            return 0.0;
        };
        let mut squares = vec![0.0; self.problem.nullity()];
        for i in 0..self.problem.n() {
            if let Some((label, unit)) = self.problem.null_entry(i) {
                let value = unit / self.problem.root[i];
                squares[label] +=
                    (self.problem.stiffness.row_sum(i) * value / self.problem.root[i]).powi(2);
            }
        }
        squares
            .iter()
            .fold(0.0f64, |m: f64, s: &f64| m.max(s.sqrt()))
            / first
    }

    fn orthogonality_error(&self, pairs: &Pairs) -> f64 {
        let gram = inner(pairs.y.as_ref(), pairs.y.as_ref());
        let mut worst = 0.0f64;
        for i in 0..gram.nrows() {
            for j in 0..gram.ncols() {
                let identity = if i == j { 1.0 } else { 0.0 };
                worst = worst.max((gram[(i, j)] - identity).abs());
            }
        }
        // Against the null space: what projecting it out once more changes.
        let mut projected = pairs.y.clone();
        self.problem.project_out_kernel(projected.as_mut());
        for j in 0..projected.ncols() {
            let change: f64 = (0..projected.nrows())
                .map(|i| (projected[(i, j)] - pairs.y[(i, j)]).powi(2))
                .sum();
            worst = worst.max(change.sqrt());
        }
        worst
    }
}

/// The first wide gap at or above the wanted pairs, else the widest there is, else nothing.
fn place_cut(values: &[f64], wanted: usize, available: usize) -> Option<Cut> {
    if values.len() < wanted {
        return None;
    }
    if values.len() == available {
        // All of them: any cut above the last.
        let last = values.last().copied().unwrap_or(1.0);
        return Some(Cut {
            position: available,
            value: 2.0 * last,
            width: 0.5,
        });
    }
    let mut best: Option<Cut> = None;
    for position in wanted..values.len() {
        let below = if position == 0 {
            0.0
        } else {
            values[position - 1]
        };
        let above = values[position];
        let width = (above - below) / above;
        if width > best.as_ref().map_or(NARROW, |b| b.width) {
            best = Some(Cut {
                position,
                value: 0.5 * (below + above),
                width,
            });
        }
        if width > WIDE {
            break;
        }
    }
    best
}

fn column(m: &Mat<f64>, j: usize) -> &[f64] {
    m.col_as_slice(j)
}

fn side_by_side(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(a.nrows(), a.ncols() + b.ncols(), |i, j| {
        if j < a.ncols() {
            a[(i, j)]
        } else {
            b[(i, j - a.ncols())]
        }
    })
}

fn sorted_pairs(problem: &Problem<'_>, y: &Mat<f64>) -> Pairs {
    let n = y.nrows();
    let v = Mat::from_fn(n, y.ncols(), |i, j| y[(i, j)] / problem.root[i]);
    let mut order: Vec<(f64, usize)> = (0..y.ncols())
        .map(|j| (problem.rayleigh_quotient(column(&v, j)), j))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    Pairs {
        values: order.iter().map(|o| o.0).collect(),
        y: Mat::from_fn(n, y.ncols(), |i, j| y[(i, order[j].1)]),
        v: Mat::from_fn(n, y.ncols(), |i, j| v[(i, order[j].1)]),
    }
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
        for (x, v) in target.iter_mut().zip(column(&pairs.v, j)) {
            *x = v / problem.area.sqrt() + 0.0; // + 0.0: no negative zeros in an artefact
        }
        fix_sign(target, problem.mass);
    }
    Eigenpairs {
        values,
        vectors,
        n,
        certificate,
    }
}

/// All positive eigenvalues, ascending, by the dense solver.
pub(crate) fn dense_values(problem: &Problem<'_>) -> Result<Vec<f64>, EigenError> {
    let mut values = symmetric_eigenvalues(lifted(problem).as_ref())?;
    values.truncate(problem.n() - problem.nullity());
    Ok(values.iter().map(|x| x / problem.area).collect())
}
