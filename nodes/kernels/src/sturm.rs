//! Eigenvalues of symmetric tridiagonal matrices by bisection: each is known by how many lie below it.
//!
//! One pass over a matrix counts the eigenvalues below many numbers at once, a number to a lane (Sturm's sequences, by the pivots of T - x I).
//! Only what is wanted is computed, no step waits for the one before but within a lane, and multiplicity does not matter.

use pulp::{Arch, Simd, WithSimd};

/// Numbers that go through a matrix as a row of lanes.
pub(crate) const LANES: usize = 8;

pub(crate) type Lanes = [f64; LANES];

/// Squares of entries beside the diagonal are at least this: a pivot of zero then gives infinity, not 0 / 0.
const LEAST_SQUARE: f64 = 1e-290;

/// A symmetric tridiagonal matrix.
pub(crate) struct Tridiagonal {
    /// Diagonal entries, each with the square of the entry beside it in the column before.
    rows: Vec<(f64, f64)>,
    /// Bound of the eigenvalues' magnitudes.
    pub norm: f64,
}

/// An eigenvalue by its number, counted from the lowest, and where it is.
#[derive(Clone, Copy, Default)]
pub(crate) struct Bracket {
    pub number: f64,
    pub low: f64,
    pub high: f64,
}

impl Tridiagonal {
    /// From the diagonal and what is beside it: `off[i]` between i and i + 1.
    pub fn new(diagonal: &[f64], off: &[f64]) -> Self {
        let before = |i: usize| if i == 0 { 0.0 } else { off[i - 1] };
        let row = |i: usize| (diagonal[i], (before(i) * before(i)).max(LEAST_SQUARE));
        let after = |i: usize| if i + 1 < diagonal.len() { off[i] } else { 0.0 };
        let radius = |i: usize| diagonal[i].abs() + before(i).abs() + after(i).abs();
        let largest = |most: f64, x: f64| if x > most || x.is_nan() { x } else { most };
        Self { rows: (0..diagonal.len()).map(row).collect(), norm: (0..diagonal.len()).map(radius).fold(0.0, largest) }
    }

    /// How many eigenvalues are below each number.
    pub fn below(&self, numbers: &[Lanes]) -> Vec<Lanes> {
        let mut counts = vec![[0.0; LANES]; numbers.len()];
        Arch::new().dispatch(Count { rows: &self.rows, numbers, counts: &mut counts });
        counts
    }

    /// Halves the brackets, all of which are as wide, until they are as narrow as rounding allows; their middles.
    pub fn bisect(&self, mut brackets: Vec<Bracket>) -> Vec<f64> {
        let wanted = brackets.len();
        brackets.resize(wanted.next_multiple_of(LANES), Bracket::default());
        let middle = |b: &Bracket| 0.5 * (b.low + b.high);
        while brackets.first().is_some_and(|b| b.high - b.low > f64::EPSILON * self.norm.max(b.high)) {
            let numbers: Vec<f64> = brackets.iter().map(middle).collect();
            let counts = self.below(numbers.as_chunks().0);
            for ((bracket, at), count) in brackets.iter_mut().zip(numbers).zip(counts.into_iter().flatten()) {
                let above = count > bracket.number;
                bracket.low = if above { bracket.low } else { at };
                bracket.high = if above { at } else { bracket.high };
            }
        }
        brackets[..wanted].iter().map(middle).collect()
    }
}

struct Count<'a> {
    rows: &'a [(f64, f64)],
    numbers: &'a [Lanes],
    counts: &'a mut [Lanes],
}

impl WithSimd for Count<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let mut numbers = S::as_simd_f64s(self.numbers.as_flattened()).0;
        let mut counts = S::as_mut_simd_f64s(self.counts.as_flattened_mut()).0;
        // Several registers go through the matrix together, so that divisions overlap.
        while !numbers.is_empty() {
            let done = match numbers.len() {
                8.. => count::<S, 8>(simd, self.rows, numbers, counts),
                4.. => count::<S, 4>(simd, self.rows, numbers, counts),
                2.. => count::<S, 2>(simd, self.rows, numbers, counts),
                _ => count::<S, 1>(simd, self.rows, numbers, counts),
            };
            (numbers, counts) = (&numbers[done..], &mut counts[done..]);
        }
    }
}

/// Counts for the first V registers; V.
#[inline(always)]
fn count<S: Simd, const V: usize>(simd: S, rows: &[(f64, f64)], numbers: &[S::f64s], counts: &mut [S::f64s]) -> usize {
    let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
    let numbers: [S::f64s; V] = std::array::from_fn(|v| numbers[v]);
    let (mut pivots, mut sums) = ([one; V], [zero; V]);
    for &(diagonal, square) in rows {
        let (diagonal, square) = (simd.splat_f64s(diagonal), simd.splat_f64s(square));
        for v in 0..V {
            let shifted = simd.sub_f64s(diagonal, numbers[v]);
            pivots[v] = simd.sub_f64s(shifted, simd.div_f64s(square, pivots[v]));
            let one_more = simd.select_f64s(simd.less_than_f64s(pivots[v], zero), one, zero);
            sums[v] = simd.add_f64s(sums[v], one_more);
        }
    }
    counts[..V].copy_from_slice(&sums);
    V
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_by_number_are_those_known() {
        // -1, 2, -1: eigenvalues 2 - 2 cos(k pi / (n + 1)).
        for n in [1, 2, 9, 70, 131] {
            let matrix = Tridiagonal::new(&vec![2.0; n], &vec![-1.0; n]);
            let known = |k: usize| 2.0 - 2.0 * (k as f64 * std::f64::consts::PI / (n + 1) as f64).cos();
            let bracket = |number: usize| Bracket { number: number as f64, low: -4.0, high: 4.0 };
            let numbers: Vec<usize> = (0..n).step_by(1 + n / 40).collect();
            let values = matrix.bisect(numbers.iter().map(|&number| bracket(number)).collect());
            assert_eq!(values.len(), numbers.len());
            for (value, number) in values.iter().zip(numbers) {
                assert!((value - known(number + 1)).abs() < 4e-15, "{n}: {number}");
            }
            let counts = matrix.below(&[[-1.0, 5.0, 2.1, 1.9, -5.0, 9.0, 0.0, 4.0]])[0];
            let expected = [-1.0, 5.0, 2.1, 1.9].map(|x| (1..=n).filter(|&k| known(k) < x).count() as f64);
            assert_eq!(counts[..4], expected);
        }
    }
}
