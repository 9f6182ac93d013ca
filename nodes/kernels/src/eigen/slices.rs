//! The wanted part of the spectrum in slices: each around a shift of its own, independent of the others, joined at cuts in gaps.

use super::basis::Null;
use super::certify::collect;
use super::factor::Factorizer;
use super::lanczos::{Found, Run, expected_blocks, lanczos};
use super::packed::Packed;
use super::reach::{Reach, Side};
use super::vectors::Vectors;
use super::{EigenError, Hooks, Options, Phase};
use std::f64::consts::PI;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// What the slices share.
pub(super) struct Spectrum<'a> {
    pub factorizer: &'a Factorizer,
    pub null: &'a Null,
    pub n: usize,
    /// Eigenvalues wanted beyond the null space.
    pub wanted: usize,
    pub options: &'a Options,
    pub hooks: &'a dyn Hooks,
}

/// The smallest eigenpairs beyond the null space, as far as they were found.
pub(super) struct Union {
    pub vectors: Vectors,
    pub cut: f64,
    /// Eigenvalues below the cut by inertia, null space included.
    pub expected: usize,
    /// Whether there is no eigenvalue above the cut.
    pub last: bool,
}

/// A shift, and the factorisation if it is at hand.
struct Slice {
    shift: f64,
    factor: Mutex<Option<Packed>>,
}

/// Pairs from which on a second slice costs no more than one: it saves as much orthogonalisation as it costs solves, halves the memory for
/// the basis, and can run on a thread of its own. Measured at 12,000 to 190,000 vertices, where one to four slices are within 5 % of each other for 300 pairs.
const SLICE_PAIRS: usize = 140;

/// Slices of more than this share of the spectrum do not pay: at 1,000 vertices they are three times slower.
const SLICE_SHARE: usize = 20;

/// How many slices, from n and the number of pairs alone.
pub(super) fn slice_count(n: usize, wanted: usize) -> usize {
    (wanted / SLICE_PAIRS).min(n / (SLICE_PAIRS * SLICE_SHARE)).max(1)
}

/// How an attempt differs from the first one.
#[derive(Clone, Copy)]
pub(super) struct Attempt {
    pub number: usize,
    pub restarts: usize,
}

/// One attempt at the whole.
pub(super) fn union(spectrum: &Spectrum<'_>, attempt: Attempt) -> Result<Union, EigenError> {
    let slices = plan(spectrum, attempt)?;
    let count = slices.len();
    let blocks = count * expected_blocks(spectrum.wanted / count, count == 1);
    let done = AtomicUsize::new(0);
    let step = || {
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        spectrum.hooks.progress(0.05 + 0.8 * (done as f64 / blocks as f64).min(1.0));
    };
    let found = collect(spectrum.hooks, count, &|task| {
        // The uppermost slice first: its factorisation is at hand.
        run_slice(spectrum, &slices, count - 1 - task, attempt, &step)
    })?;
    join(spectrum, found.into_iter().rev().collect::<Result<_, _>>()?)
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Shifts by Weyl's law, corrected by the count at the uppermost.
fn plan(spectrum: &Spectrum<'_>, attempt: Attempt) -> Result<Vec<Slice>, EigenError> {
    let count = slice_count(spectrum.n, spectrum.wanted);
    let wanted = spectrum.wanted as f64;
    let place = |i: usize| (i as f64 + 0.5) / count as f64;
    let nudge = [1.0, 0.93, 1.06, 0.97][attempt.number % 4];
    // Area 1: eigenvalue number j is about 4 pi j.
    let mut top = 4.0 * PI * wanted.max(1.0) * place(count - 1) * nudge;
    let aim = wanted * place(count - 1);
    let mut tries = 0;
    let factor = loop {
        spectrum.hooks.phase(Phase::Factorise);
        let factor = spectrum.factorizer.factor(top)?;
        let below = factor.negative().saturating_sub(spectrum.null.count);
        let off = (below as f64 - aim).abs();
        if off <= (0.4 * wanted / count as f64).max(4.0) || tries == 4 {
            break factor;
        }
        tries += 1;
        top *= (aim / (below as f64).max(1.0)).clamp(0.05, 20.0);
    };
    let shift = |i: usize| top * place(i) / place(count - 1);
    let slices: Vec<Slice> = (0..count).map(|i| Slice { shift: shift(i), factor: Mutex::new(None) }).collect();
    *lock(&slices[count - 1].factor) = Some(factor);
    Ok(slices)
}

fn run_slice(
    spectrum: &Spectrum<'_>,
    slices: &[Slice],
    i: usize,
    attempt: Attempt,
    step: &dyn Fn(),
) -> Result<Found, EigenError> {
    let slice = &slices[i];
    let at_hand = lock(&slice.factor).take();
    let factor = if let Some(factor) = at_hand {
        factor
    } else {
        spectrum.hooks.phase(Phase::Factorise);
        spectrum.factorizer.factor(slice.shift)?
    };
    let own = factor.negative().saturating_sub(spectrum.null.count);
    let middle = |j: usize| 0.5 * (slices[j].shift + slices[j + 1].shift);
    let last = slices.len() - 1;
    let share = spectrum.wanted / slices.len();
    let below = if i == 0 { Side::Count(own) } else { Side::Until(middle(i - 1)) };
    let above = if i == last { Side::Count(spectrum.wanted.saturating_sub(own)) } else { Side::Until(middle(i)) };
    let half = share / 2;
    let expected =
        (if i == 0 { own } else { half }) + if i == last { spectrum.wanted.saturating_sub(own) } else { half };
    let run = Run {
        n: spectrum.n,
        shift: slice.shift,
        count_below: own,
        factor: &factor,
        null: spectrum.null,
        reach: Reach { below, above, expected },
        tolerance: spectrum.options.tolerance,
        restarts: attempt.restarts,
        seed: 1 + (attempt.number * 64 + i) as u64,
    };
    lanczos(&run, spectrum.hooks, step)
}

/// Joins neighbours at the lower one's cut, and counts below the uppermost cut.
fn join(spectrum: &Spectrum<'_>, found: Vec<Found>) -> Result<Union, EigenError> {
    let (cut, gap) = found.last().map_or((0.0, 0.0), |f| (f.cut, f.gap));
    let mut values: Vec<f64> = Vec::with_capacity(spectrum.wanted + 16);
    let (mut stores, mut index) = (Vec::new(), Vec::new());
    let mut from = 0.0;
    for (s, slice) in found.into_iter().enumerate() {
        for (column, &value) in slice.values.iter().enumerate().filter(|v| *v.1 > from) {
            values.push(value);
            index.push((s, column));
        }
        stores.push(slice.vectors);
        // The shift has its own count: what is missing or double is noticed where it happens.
        let below = values.iter().filter(|v| **v < slice.shift).count();
        if below != slice.count_below {
            let null = spectrum.null.count;
            return Err(EigenError::NotCertified {
                expected: slice.count_below + null,
                found: below + null,
                residual: f64::NAN,
            });
        }
        from = slice.cut;
    }
    spectrum.hooks.phase(Phase::Count);
    let expected = spectrum.factorizer.count_below(cut, gap)?;
    Ok(Union { vectors: Vectors::new(stores, index), cut, expected, last: false })
}
