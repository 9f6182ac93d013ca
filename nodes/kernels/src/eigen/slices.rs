//! The wanted part of the spectrum in slices: each around a shift of its own, independent of the others, joined at cuts in gaps.

use super::basis::Null;
use super::certify::Columns;
use super::factor::Factorizer;
use super::lanczos::{Found, Run, Window, lanczos};
use super::packed::Packed;
use super::parts::{collect, locked};
use super::pool::Pool;
use super::reach::{Reach, Side};
use super::scratch::{Kept, Scratch};
use super::slicing::Slicing;
use super::vectors::{Store, Vectors};
use super::{EigenError, Hooks, Options, Phase, enter};
use std::f64::consts::PI;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What the slices share.
pub(super) struct Spectrum<'a> {
    pub factorizer: &'a Factorizer,
    pub null: &'a Null,
    pub pool: &'a Pool,
    pub columns: &'a Columns<'a>,
    pub n: usize,
    /// Eigenvalues wanted beyond the null space.
    pub wanted: usize,
    pub slicing: Slicing,
    pub options: &'a Options,
    pub hooks: &'a dyn Hooks,
}

/// The smallest eigenpairs beyond the null space, as far as they were found.
pub(super) struct Union<'a> {
    pub vectors: Vectors<'a>,
    pub cut: f64,
    /// Relative width of the gap that the cut is in.
    pub gap: f64,
    /// Whether there is no eigenvalue above the cut.
    pub last: bool,
}

/// A window of the spectrum that ends where the next one begins: its shift, about how many pairs, and the factorisation if it is at hand.
struct Slice {
    begin: f64,
    shift: f64,
    pairs: usize,
    factor: Mutex<Option<Packed>>,
}

/// Where the shift is best in the lowest window, by the share of its eigenvalues that are below: those end with the spectrum, and converge sooner than
/// others that are as far. Measured with 100 pairs on five meshes: 30 to 31 blocks with 53 to 60 below, 32 to 33 with 50, 33 to 34 with 65.
const LOWEST: f64 = 0.56;

/// The uppermost shift may miss its place by this share of a window.
const OFF: f64 = 0.08;

/// How an attempt differs from the first one.
#[derive(Clone, Copy)]
pub(super) struct Attempt {
    pub number: usize,
    pub restarts: usize,
}

/// One attempt at the whole. Slices are found side by side, or if memory is short one after the other, and all but the lowest go to scratch files, if
/// there are any.
pub(super) fn union<'a>(
    spectrum: &Spectrum<'a>,
    scratch: Option<&'a Scratch<'a>>,
    attempt: Attempt,
) -> Result<Union<'a>, EigenError> {
    let slices = plan(spectrum, attempt)?;
    let count = slices.len();
    let blocks: usize = (0..count).map(|slice| spectrum.slicing.blocks(slice)).sum();
    let done = AtomicUsize::new(0);
    let step = || {
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        spectrum.hooks.progress(0.05 + 0.8 * (done as f64 / blocks as f64).min(1.0));
    };
    let run = |i: usize| {
        let Found { vectors, window } = run_slice(spectrum, &slices, i, attempt, &step)?;
        let away = scratch.filter(|_| i > 0);
        let kept = if let Some(scratch) = away { scratch.put(&vectors)? } else { Kept::Here(vectors) };
        Ok((kept, window))
    };
    // The uppermost slice first: its factorisation is at hand.
    let mut found: Vec<_> = if spectrum.slicing.is_frugal {
        (0..count).rev().map(run).collect::<Result<_, _>>()?
    } else {
        collect(spectrum.hooks, count, &|task| run(count - 1 - task))?.into_iter().collect::<Result<_, _>>()?
    };
    found.reverse();
    spectrum.pool.clear();
    if spectrum.slicing.is_frugal {
        spectrum.factorizer.release();
    }
    join(spectrum, found)
}

/// Windows by Weyl's law as the count at the uppermost shift corrects it, and a shift in each.
fn plan(spectrum: &Spectrum<'_>, attempt: Attempt) -> Result<Vec<Slice>, EigenError> {
    let (count, slicing) = (spectrum.slicing.count(), spectrum.slicing);
    let wanted = spectrum.wanted as f64;
    let share = slicing.pairs(count - 1);
    let nudge = [1.0, 0.93, 1.06, 0.97][attempt.number % 4];
    let aim = nudge * if count == 1 { LOWEST * wanted } else { wanted - 0.5 * share };
    // Area 1: eigenvalue number j is about 4 pi j.
    let mut top = 4.0 * PI * aim.max(1.0);
    let mut tries = 0;
    let (factor, below) = loop {
        enter(spectrum.hooks, Phase::Factorise)?;
        let factor = spectrum.factorizer.factor(top, spectrum.hooks)?;
        let below = factor.negative().saturating_sub(spectrum.null.count) as f64;
        if (below - aim).abs() <= (OFF * share).max(4.0) || tries == 4 {
            break (factor, below);
        }
        tries += 1;
        top *= (aim / below.max(1.0)).clamp(0.05, 20.0);
    };
    // The uppermost window of several reaches as far below its shift as above it; the others share the rest.
    let edge = (2.0 * below - wanted).clamp(0.0, below);
    let value = |number: f64| top * number / below.max(1.0);
    let pair = edge / (wanted - share).max(1.0);
    let mut end = 0.0;
    let slices = (0..count).map(|i| {
        let (begin, width) = (end, pair * slicing.pairs(i));
        end += width;
        let middle = if i == 0 { LOWEST } else { 0.5 };
        let (shift, pairs) =
            if i + 1 == count { (top, wanted - begin) } else { (value(begin + middle * width), width) };
        Slice { begin: value(begin), shift, pairs: pairs as usize, factor: Mutex::new(None) }
    });
    let slices: Vec<Slice> = slices.collect();
    *locked(&slices[count - 1].factor) = Some(factor);
    Ok(slices)
}

fn run_slice<'a>(
    spectrum: &Spectrum<'a>,
    slices: &[Slice],
    i: usize,
    attempt: Attempt,
    step: &dyn Fn(),
) -> Result<Found<'a>, EigenError> {
    let slice = &slices[i];
    let at_hand = locked(&slice.factor).take();
    let factor = if let Some(factor) = at_hand {
        factor
    } else {
        enter(spectrum.hooks, Phase::Factorise)?;
        spectrum.factorizer.factor(slice.shift, spectrum.hooks)?
    };
    let own = factor.negative().saturating_sub(spectrum.null.count);
    let below = if i == 0 { Side::Count(own) } else { Side::Until(slice.begin) };
    let above = match slices.get(i + 1) {
        Some(next) => Side::Until(next.begin),
        None => Side::Count(spectrum.wanted.saturating_sub(own)),
    };
    let run = Run {
        n: spectrum.n,
        shift: slice.shift,
        count_below: own,
        factor: &factor,
        null: spectrum.null,
        pool: spectrum.pool,
        place: spectrum.slicing.place(i),
        reach: Reach { below, above, expected: slice.pairs },
        tolerance: spectrum.options.tolerance,
        restarts: attempt.restarts,
        seed: 1 + (attempt.number * 64 + i) as u64,
    };
    if spectrum.slicing.is_frugal {
        spectrum.factorizer.release();
        if i == 0 {
            // Its basis begins where the result will be.
            spectrum.pool.clear();
        }
    }
    let Found { mut vectors, mut window } = lanczos(&run, spectrum.hooks, step)?;
    drop(factor);
    if i == 0 || window.is_doubtful {
        enter(spectrum.hooks, Phase::Certify)?;
        let (values, all) = (&mut window.values, window.is_doubtful);
        let (tolerance, factorizer) = (spectrum.options.tolerance, spectrum.factorizer);
        spectrum.columns.polish(vectors.all_mut(), values, all, tolerance, factorizer)?;
    }
    Ok(Found { vectors, window })
}

/// Joins neighbours at the lower one's cut.
fn join<'a>(spectrum: &Spectrum<'a>, found: Vec<(Kept<'a>, Window)>) -> Result<Union<'a>, EigenError> {
    let (cut, gap) = found.last().map_or((0.0, 0.0), |(_, window)| (window.cut, window.gap));
    let mut values: Vec<f64> = Vec::new();
    let mut stores = Vec::new();
    let mut from = 0.0;
    for (panels, window) in found {
        let mut columns = Vec::new();
        for (column, &value) in window.values.iter().enumerate().filter(|v| *v.1 > from) {
            values.push(value);
            columns.push(column);
        }
        stores.push(Store { panels, values: window.values, columns });
        // The shift has its own count: what is missing or double is noticed where it happens.
        let below = values.iter().filter(|v| **v < window.shift).count();
        if below != window.count_below {
            return Err(EigenError::NotCertified {
                expected: window.count_below + spectrum.null.count,
                found: below + spectrum.null.count,
                residual: f64::NAN,
            });
        }
        from = window.cut;
    }
    Ok(Union { vectors: Vectors::new(spectrum.pool, stores)?, cut, gap, last: false })
}
