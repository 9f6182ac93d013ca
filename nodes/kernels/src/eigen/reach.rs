//! How far from its shift a Lanczos run must get, and whether it has.

/// A gap this wide, relative to the eigenvalue above it, is as good a place for a cut as any.
const WIDE: f64 = 1e-4;

/// A gap must be at least this wide for a cut, and is taken once so many pairs beyond the target show no wider one.
const NARROW: f64 = 1e-7;
const PATIENCE: usize = 24;

/// Pairs that only show where the next gap is may have this residual relative to their value.
const WEAK: f64 = 1e-6;

/// How far off residuals are when pairs are missing altogether.
const SOME: f64 = 30.0;

/// An approximate eigenvalue of A, the residual it will have, and its column in the projected problem.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ritz {
    pub value: f64,
    pub residual: f64,
    pub column: usize,
}

/// Which eigenvalues around the shift are wanted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    pub below: Side,
    pub above: Side,
    /// About how many pairs that will be.
    pub expected: usize,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Side {
    /// So many, nearest first.
    Count(usize),
    /// All up to a value.
    Until(f64),
}

/// What a look at the Ritz pairs says.
pub(super) enum Verdict {
    /// All that was wanted is there.
    Done(Chosen),
    /// All there is below the shift is accurate, but copies of multiple eigenvalues are missing: a fresh block is needed.
    Short,
    /// More steps are needed: by so much the largest residual among the wanted pairs is too large; some, if pairs are missing.
    NotYet(f64),
}

pub(super) struct Chosen {
    pub pairs: Vec<Ritz>,
    pub cut: f64,
    pub gap: f64,
}

impl Reach {
    /// Whether nothing wanted lies beyond what is below.
    pub fn is_lowest(&self) -> bool {
        matches!(self.below, Side::Count(_))
    }

    /// Judges ascending Ritz pairs: chosen are the wanted ones, those above up to the first gap past what was asked for.
    pub fn judge(&self, ritz: &[Ritz], shift: f64, tolerance: f64) -> Verdict {
        let split = ritz.partition_point(|r| r.value < shift);
        let (below, above) = ritz.split_at(split);
        // Ritz residuals are estimates; the margin keeps the computed ones within the tolerance.
        let off = |r: &Ritz| r.residual / (0.5 * tolerance * r.value);
        let accurate = |r: &Ritz| off(r) <= 1.0;
        let low = match self.below {
            Side::Count(count) => count,
            Side::Until(value) => below.iter().rev().take_while(|r| r.value > value).count(),
        };
        if low > below.len() {
            return if below.iter().all(accurate) { Verdict::Short } else { Verdict::NotYet(SOME) };
        }
        let target = match self.above {
            Side::Count(count) => count,
            Side::Until(value) => above.iter().take_while(|r| r.value <= value).count(),
        };
        // Until something lies beyond the window's edge, the edge was not reached.
        let reached = self.is_lowest() || low < below.len();
        let low = &below[below.len() - low..];
        if reached
            && low.iter().all(accurate)
            && let Some((high, cut, gap)) = upper_end(above, target, shift, &accurate)
        {
            return Verdict::Done(Chosen { pairs: low.iter().chain(&above[..high]).copied().collect(), cut, gap });
        }
        if !reached || target > above.len() {
            return Verdict::NotYet(SOME);
        }
        Verdict::NotYet(low.iter().chain(&above[..target]).map(off).fold(1.0, f64::max))
    }
}

/// The number of pairs above up to a gap past the target, the cut in it, and its width.
fn upper_end(above: &[Ritz], target: usize, shift: f64, accurate: &dyn Fn(&Ritz) -> bool) -> Option<(usize, f64, f64)> {
    let mut narrow: Option<(usize, f64, f64)> = None;
    // Residuals mostly grow away from the shift, but not always.
    if !above.get(..target)?.iter().all(accurate) {
        return None;
    }
    for count in target..above.len() {
        if count > target && !accurate(&above[count - 1]) {
            return None;
        }
        let next = &above[count];
        let last = if count == 0 { shift } else { above[count - 1].value };
        let gap = (next.value - last) / next.value;
        if gap <= NARROW {
            // Another copy of a multiple eigenvalue, so it seems: no place for a cut, and the next turn asks whether it is accurate.
            continue;
        }
        if next.residual > (WEAK * next.value).min(0.1 * gap * next.value) {
            return None;
        }
        let cut = 0.5 * (last + next.value);
        if gap > WIDE {
            return Some((count, cut, gap));
        }
        if gap > narrow.map_or(NARROW, |n| n.2) {
            narrow = Some((count, cut, gap));
        }
        if count > target + PATIENCE && narrow.is_some() {
            return narrow;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_above_the_shift_must_be_accurate() {
        let reach = Reach { below: Side::Count(1), above: Side::Count(3), expected: 4 };
        // Residuals usually grow outwards; here the second pair above the shift lags behind.
        let mut ritz: Vec<Ritz> =
            (1..9).map(|i| Ritz { value: 10.0 * f64::from(i), residual: 1e-9, column: 0 }).collect();
        let done = |ritz: &[Ritz]| reach.judge(ritz, 15.0, 1e-8);
        match done(&ritz) {
            Verdict::Done(chosen) => assert!(chosen.pairs.len() == 4 && chosen.cut == 45.0),
            Verdict::Short | Verdict::NotYet(_) => panic!("all are accurate"),
        }
        ritz[2].residual = 6e-7;
        match done(&ritz) {
            Verdict::NotYet(off) => assert!((off - 4.0).abs() < 1e-12, "{off}"),
            Verdict::Short | Verdict::Done(_) => panic!("one is not"),
        }
    }
}
