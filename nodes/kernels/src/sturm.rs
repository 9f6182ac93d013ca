//! Eigenvalues of symmetric tridiagonal matrices by bisection: each is known by how many lie below it.
//!
//! One pass over a matrix counts the eigenvalues below many numbers at once, a number to a lane: the signs of the leading minors of T - x I change once for
//! each (Givens 1954; Wilkinson 1965). Unlike their ratios, the pivots, minors take no division, which is the slowest instruction there is by far; they are scaled
//! on the way. Only what is wanted is computed, no step waits for the one before but within a lane, and multiplicity does not matter.

use pulp::{Arch, Simd, WithSimd};

/// Numbers that go through a matrix as a row of lanes.
pub(crate) const LANES: usize = 8;

pub(crate) type Lanes = [f64; LANES];

/// Squares of entries beside the diagonal of a matrix of norm 1 to 2 are at least this, which changes eigenvalues by a hundredth of rounding: two minors in a row
/// are then never zero.
const LEAST_SQUARE: f64 = power_of_two(-120);

/// Steps between looks at how large minors are: they grow by less than 2^4 a step, and in two steps do not shrink by more than the least square.
const STEPS: usize = 8;

/// Minors outside this range are brought back, by these factors.
const RANGE: [f64; 2] = [power_of_two(-200), power_of_two(200)];
const FACTORS: [f64; 2] = [power_of_two(600), power_of_two(-300)];

const fn power_of_two(exponent: i64) -> f64 {
    f64::from_bits(((1023 + exponent) as u64) << 52)
}

/// A symmetric tridiagonal matrix.
pub(crate) struct Tridiagonal {
    /// Diagonal entries, each with minus the square of the entry beside it in the column before, of the matrix times `scale`.
    rows: Vec<(f64, f64)>,
    /// Bound of the eigenvalues' magnitudes.
    pub norm: f64,
    /// A power of two that makes the norm 1 to 2, unless it is nothing or infinite.
    scale: f64,
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
        let after = |i: usize| if i + 1 < diagonal.len() { off[i] } else { 0.0 };
        let radius = |i: usize| diagonal[i].abs() + before(i).abs() + after(i).abs();
        let largest = |most: f64, x: f64| if x > most || x.is_nan() { x } else { most };
        let norm = (0..diagonal.len()).map(radius).fold(0.0, largest);
        let exponent = 1023 - (norm.to_bits() >> 52) as i64;
        let scale = if norm.is_normal() && exponent > -1023 { power_of_two(exponent) } else { 1.0 };
        let row = |i: usize| (scale * diagonal[i], -(scale * before(i)).powi(2).max(LEAST_SQUARE));
        Self { rows: (0..diagonal.len()).map(row).collect(), norm, scale }
    }

    /// How many eigenvalues are below each number.
    pub fn below(&self, numbers: &[Lanes]) -> Vec<Lanes> {
        let mut counts = vec![[0.0; LANES]; numbers.len()];
        // Beyond the norm nothing changes.
        let numbers: Vec<Lanes> = numbers.iter().map(|x| x.map(|x| (self.scale * x).clamp(-4.0, 4.0))).collect();
        Arch::new().dispatch(Count { rows: &self.rows, numbers: &numbers, counts: &mut counts });
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
        // Several registers go through the matrix together, so that they do not wait for each other.
        while !numbers.is_empty() {
            let done = match numbers.len() {
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
fn count<S: Simd, const V: usize>(simd: S, all: &[(f64, f64)], numbers: &[S::f64s], counts: &mut [S::f64s]) -> usize {
    let [zero, one, sign] = [0.0, 1.0, -0.0].map(|x| simd.splat_f64s(x));
    let ([low, high], [up, down]) = (RANGE.map(|x| simd.splat_f64s(x)), FACTORS.map(|x| simd.splat_f64s(x)));
    let numbers: [S::f64s; V] = std::array::from_fn(|v| numbers[v]);
    // The last two minors, up to a common factor, and the sum of the signs of their products.
    let (mut before, mut last, mut signs) = ([zero; V], [one; V], [zero; V]);
    for rows in all.chunks(STEPS) {
        for &(diagonal, square) in rows {
            let (diagonal, square) = (simd.splat_f64s(diagonal), simd.splat_f64s(square));
            for v in 0..V {
                let shifted = simd.sub_f64s(diagonal, numbers[v]);
                let next = simd.mul_add_f64s(shifted, last[v], simd.mul_f64s(square, before[v]));
                let change = simd.and_f64s(simd.xor_f64s(next, last[v]), sign);
                signs[v] = simd.add_f64s(signs[v], simd.or_f64s(change, one));
                (before[v], last[v]) = (last[v], next);
            }
        }
        for v in 0..V {
            let size = simd.max_f64s(simd.abs_f64s(before[v]), simd.abs_f64s(last[v]));
            let factor = simd.select_f64s(simd.less_than_f64s(size, low), up, one);
            let factor = simd.select_f64s(simd.less_than_f64s(high, size), down, factor);
            (before[v], last[v]) = (simd.mul_f64s(before[v], factor), simd.mul_f64s(last[v], factor));
        }
    }
    let (rows, half) = (simd.splat_f64s(all.len() as f64), simd.splat_f64s(0.5));
    for (count, signs) in counts.iter_mut().zip(signs) {
        *count = simd.mul_f64s(half, simd.sub_f64s(rows, signs));
    }
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

    fn all_values(matrix: &Tridiagonal, n: usize) -> Vec<f64> {
        let bracket = |number: usize| Bracket { number: number as f64, low: -matrix.norm, high: matrix.norm };
        matrix.bisect((0..n).map(bracket).collect())
    }

    #[test]
    fn minors_neither_vanish_nor_overflow() {
        // One entry of norm; below it a zero diagonal and entries e beside it, whose eigenvalues are +-2 e cos: all minors but every other vanish at zero, and the
        // others shrink by e^2.
        for (e, n) in [(1.0, 400), (1e-3, 400), (1e-9, 400), (1e-15, 400), (1e-30, 400), (0.0, 400)] {
            let mut diagonal = vec![0.0; n + 1];
            diagonal[n] = 3.0;
            let mut off = vec![e; n];
            off[n - 1] = 0.0;
            let count =
                Tridiagonal::new(&diagonal, &off).below(&[[0.0, 1e-12 + 2.5 * e, 2.9, 3.1, -2.9, -1e300, 1e300, 9.0]])
                    [0];
            let (half, n) = (count[0], n as f64);
            assert!((e == 0.0 && half <= n) || half == 0.5 * n, "{e}: {half}");
            assert_eq!(count[1..], [n, n, n + 1.0, 0.0, 0.0, n + 1.0, n + 1.0], "{e}");
        }
        // All steps as large as they can be, with both signs.
        let wide = Tridiagonal::new(&[4.0; 500], &[-2.0; 500]);
        assert_eq!(
            wide.below(&[[-1e9, -4.0, 0.0, 8.0, 9.0, 1e9, 4.0, 3.0]])[0][..6],
            [0.0, 0.0, 0.0, 500.0, 500.0, 500.0]
        );
    }

    #[test]
    fn pairs_that_hardly_differ_and_the_scale() {
        // Wilkinson's W21+: 10.746194182903322 and 10.746194182903393 (Wilkinson 1965, p. 309).
        let diagonal: Vec<f64> = (-10..=10).map(|i: i32| f64::from(i.abs())).collect();
        let values = all_values(&Tridiagonal::new(&diagonal, &[1.0; 21]), 21);
        assert!(
            (values[19] - 10.746_194_182_903_322).abs() < 4e-15 && (values[20] - 10.746_194_182_903_393).abs() < 4e-15
        );
        let trace: f64 = values.iter().sum();
        assert!((trace - 110.0).abs() < 1e-13);
        // Powers of two change no bit.
        for factor in [power_of_two(-900), power_of_two(-3), power_of_two(900)] {
            let scaled: Vec<f64> = diagonal.iter().map(|x| factor * x).collect();
            let scaled = all_values(&Tridiagonal::new(&scaled, &[factor; 21]), 21);
            assert!(scaled.iter().zip(&values).all(|(x, y)| x.to_bits() == (factor * y).to_bits()));
        }
        let nothing = Tridiagonal::new(&[0.0; 3], &[0.0; 3]);
        assert_eq!(nothing.below(&[[-1e-9, 1e-9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])[0][..2], [0.0, 3.0]);
        let tiny = Tridiagonal::new(&[f64::MIN_POSITIVE / 8.0; 2], &[0.0; 2]);
        assert_eq!(tiny.below(&[[-1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])[0][..2], [0.0, 2.0]);
    }

    #[test]
    fn the_width_of_registers_changes_no_bit() {
        fn counts<S: Simd>(simd: S, rows: &[(f64, f64)], numbers: &[Lanes]) -> Vec<Lanes> {
            let mut counts = vec![[0.0; LANES]; numbers.len()];
            Count { rows, numbers, counts: &mut counts }.with_simd(simd);
            counts
        }
        let diagonal: Vec<f64> = (0..77).map(|i| f64::from(i * 37 % 19)).collect();
        let matrix = Tridiagonal::new(&diagonal, &[0.4; 77]);
        let numbers: Vec<Lanes> = (0..9).map(|i| std::array::from_fn(|q| 0.02 * (8 * i + q) as f64)).collect();
        let widest = counts(pulp::Scalar512b, &matrix.rows, &numbers);
        assert!(widest.concat().windows(2).any(|pair| pair[0] < pair[1]));
        assert!(counts(pulp::Scalar256b, &matrix.rows, &numbers) == widest);
        assert!(counts(pulp::Scalar, &matrix.rows, &numbers) == widest);
    }
}
