//! The projected problem: eigenpairs of T next to the ends of its spectrum, which are those of A next to the shift.

use super::band::Tridiagonalised;
use super::dense::symmetric_eigen;
use super::departure::Recurrence;
use super::panel::{Row, WIDTH};
use super::parts::collect;
use super::reach::{Reach, Side};
use super::twisted::Twisted;
use super::{EigenError, Hooks};
use crate::sturm::{Bracket, Tridiagonal};
use faer::prelude::Reborrow;
use faer::{Mat, MatRef};

/// Vectors computed beyond those wanted below and above the shift: one shows that there are no others, more are needed where a gap is to be found.
const BEYOND: [usize; 2] = [2, 26];

/// Vectors of eigenvalues further apart than this share of the norm are orthogonal as they are, to about 1e-12.
const APART: f64 = 1e-4;

/// Products of vectors that are removed: what is left is as accurate, since values as near as that have such products. Larger ones are those of equal
/// eigenvalues, of which vectors may be the same.
const NEAR: f64 = 0.1;

/// Eigenpairs that are worth a thread: as many as go through the matrix at once.
const PART: usize = 64;

/// Some eigenpairs of T.
pub(super) struct Projected {
    pub values: Vec<f64>,
    /// A column for each value.
    pub vectors: Mat<f64>,
}

impl Projected {
    /// The eigenpairs that are to be judged.
    pub fn to_judge(recurrence: &Recurrence, reach: &Reach, shift: f64, hooks: &dyn Hooks) -> Result<Self, EigenError> {
        // Theta = 1 / (lambda - shift): from the lowest upwards one goes down from the shift, and from the highest downwards up from it.
        let (n, at) = (order(recurrence), |value: f64| 1.0 / (value - shift));
        let ends = |below: &dyn Fn(f64) -> usize| {
            let low = match reach.below {
                Side::Count(count) => count,
                Side::Until(value) => below(at(value)),
            };
            let high = match reach.above {
                Side::Count(count) => count,
                Side::Until(value) => n - below(at(value)),
            };
            [low + BEYOND[0], high + BEYOND[1]]
        };
        Self::ends(recurrence, &ends, hooks)
    }

    /// The eigenpairs of the largest magnitudes: of each sign at most so many.
    pub fn nearest(recurrence: &Recurrence, count: usize, hooks: &dyn Hooks) -> Result<Self, EigenError> {
        Self::ends(recurrence, &|_| [count; 2], hooks)
    }

    /// The lowest negative and the highest positive eigenvalues, with their vectors, as many as `ends` says. It may ask how many there are below a number.
    fn ends(recurrence: &Recurrence, ends: Ends<'_>, hooks: &dyn Hooks) -> Result<Self, EigenError> {
        if let Some(found) = Self::banded(recurrence, ends, hooks)? {
            return Ok(found);
        }
        let (values, vectors) = symmetric_eigen(recurrence.matrix().as_ref())?;
        let columns = columns(values.len(), &|x| values.partition_point(|value| *value < x), ends);
        let picked = Mat::from_fn(values.len(), columns.len(), |i, j| vectors[(i, columns[j])]);
        Ok(Self { values: columns.iter().map(|&column| values[column]).collect(), vectors: picked })
    }

    /// The same for a T that is a band matrix, and where no two of the eigenvalues are equal up to rounding; nothing elsewhere.
    fn banded(recurrence: &Recurrence, ends: Ends<'_>, hooks: &dyn Hooks) -> Result<Option<Self>, EigenError> {
        let n = order(recurrence);
        let Some(band) = recurrence.band() else { return Ok(None) };
        let form = Tridiagonalised::new(n, band);
        let sturm = Tridiagonal::new(&form.diagonal, &form.off);
        if !sturm.norm.is_finite() {
            return Ok(None);
        }
        let columns = columns(n, &|x| sturm.below(&[[x; WIDTH]])[0][0] as usize, ends);
        let parts: Vec<&[usize]> = columns.chunks(PART).collect();
        let parts = collect(hooks, parts.len(), &|p| Part::of(&form, &sturm, parts[p]))?;
        let (mut values, mut vectors) = (Vec::with_capacity(columns.len()), Mat::zeros(n, columns.len()));
        for part in parts {
            let own = MatRef::from_column_major_slice(&part.vectors, n, part.values.len());
            vectors.subcols_mut(values.len(), part.values.len()).copy_from(own);
            values.extend(part.values);
        }
        let orthogonal = orthogonalise(&values, &mut vectors, APART * sturm.norm);
        Ok(orthogonal.map(|()| Self { values, vectors }))
    }
}

/// Some eigenpairs.
struct Part {
    values: Vec<f64>,
    /// Unit vectors, one after the other.
    vectors: Vec<f64>,
}

impl Part {
    /// Those with these numbers.
    fn of(form: &Tridiagonalised, sturm: &Tridiagonal, numbers: &[usize]) -> Self {
        let n = form.diagonal.len();
        let bracket = |&number: &usize| Bracket { number: number as f64, low: -sturm.norm, high: sturm.norm };
        let values = sturm.bisect(numbers.iter().map(bracket).collect());
        let mut vectors = Vec::with_capacity(n * values.len());
        let (mut twisted, mut rows) = (Twisted::default(), vec![[0.0; WIDTH]; n + Tridiagonalised::PADDING]);
        for values in values.chunks(WIDTH) {
            let lanes: Row = std::array::from_fn(|q| values[q.min(values.len() - 1)]);
            twisted.vectors(&form.diagonal, &form.off, sturm.norm, &lanes, &mut rows[..n]);
            rows[n..].fill([0.0; WIDTH]);
            form.transform(&mut rows);
            (0..values.len()).for_each(|q| vectors.extend(rows[..n].iter().map(|row| row[q])));
        }
        Self { values, vectors }
    }
}

/// How many eigenpairs at the lower and at the upper end, from how many are below a number.
type Ends<'a> = &'a dyn Fn(&dyn Fn(f64) -> usize) -> [usize; 2];

/// The order of T.
fn order(recurrence: &Recurrence) -> usize {
    WIDTH * recurrence.diagonal.len()
}

/// Numbers of the eigenvalues to be computed, of so many: negative ones from the lowest, positive ones from the highest.
fn columns(all: usize, below: &dyn Fn(f64) -> usize, ends: Ends<'_>) -> Vec<usize> {
    let (negative, [low, high]) = (below(0.0), ends(below));
    (0..low.min(negative)).chain(all - high.min(all - negative)..all).collect()
}

/// Removes what unit vectors have of those before them whose values are not further apart than that; nothing if it is too much, or one is none.
fn orthogonalise(values: &[f64], vectors: &mut Mat<f64>, apart: f64) -> Option<()> {
    for j in 0..values.len() {
        let (before, rest) = vectors.as_mut().split_at_col_mut(j);
        let mut own = rest.col_mut(0);
        if own.rb().iter().any(|x| !x.is_finite()) {
            return None;
        }
        let near = (0..j).rev().take_while(|&i| values[j] - values[i] < apart);
        for i in near.clone() {
            let other = before.rb().col(i);
            let along = other.transpose() * own.rb();
            if along.abs() > NEAR {
                return None;
            }
            own -= along * other;
        }
        if near.count() > 0 {
            let norm = own.norm_l2();
            own /= faer::Scale(norm);
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eigen::dense::inner;
    use crate::eigen::panel::{Block, ZERO};
    use crate::random::Random;

    /// A recurrence of random blocks, the lower ones upper triangular, with a spectrum on both sides of zero.
    fn recurrence(blocks: usize) -> Recurrence {
        let mut random = Random::new(&[blocks as u64]);
        let mut recurrence = Recurrence::default();
        for _ in 0..blocks {
            let (mut diagonal, mut below): (Block, Block) = (ZERO, ZERO);
            for i in 0..WIDTH {
                for j in 0..=i {
                    diagonal[i][j] = random.signed();
                    diagonal[j][i] = diagonal[i][j];
                    below[j][i] = 0.3 * random.signed();
                }
            }
            recurrence.diagonal.push(diagonal);
            recurrence.below.push(below);
        }
        recurrence
    }

    #[test]
    fn pairs_at_the_ends_are_those_of_a_dense_decomposition() {
        for blocks in [1, 2, 7, 15] {
            let recurrence = recurrence(blocks);
            let matrix = recurrence.matrix();
            let (all, _) = symmetric_eigen(matrix.as_ref()).expect("converges");
            let (negative, n) = (all.partition_point(|x| *x < 0.0), all.len());
            for [low, high] in [[3, 1], [0, 2], [n, n]] {
                let found =
                    Projected::banded(&recurrence, &|_| [low, high], &()).expect("not cancelled").expect("distinct");
                let (low, high) = (low.min(negative), high.min(n - negative));
                let expected: Vec<f64> = all[..low].iter().chain(&all[n - high..]).copied().collect();
                assert_eq!(found.values.len(), expected.len());
                for (j, value) in found.values.iter().enumerate() {
                    assert!((value - expected[j]).abs() < 1e-13, "{blocks}: {j}");
                }
                assert_pairs(&recurrence, &found);
            }
        }
    }

    /// Residuals, and products of vectors.
    fn assert_pairs(recurrence: &Recurrence, found: &Projected) {
        let (matrix, n) = (recurrence.matrix(), order(recurrence));
        for (j, value) in found.values.iter().enumerate() {
            for i in 0..n {
                let product: f64 = (0..n).map(|l| matrix[(i, l)] * found.vectors[(l, j)]).sum();
                assert!((product - value * found.vectors[(i, j)]).abs() < 1e-13, "of {n}: ({i}, {j})");
            }
        }
        let gram = inner(found.vectors.as_ref(), found.vectors.as_ref());
        for (j, column) in gram.col_iter().enumerate() {
            let off = |(i, x): (usize, &f64)| (x - f64::from(u8::from(i == j))).abs();
            assert!(column.iter().enumerate().map(off).all(|off| off < 1e-12), "of {n}: {j}");
        }
    }

    #[test]
    fn vectors_of_nearly_equal_eigenvalues_are_orthogonal() {
        // Two equal blocks that hardly know of each other.
        let mut twice = recurrence(1);
        twice.diagonal.push(twice.diagonal[0]);
        twice.below = vec![twice.below[0].map(|row| row.map(|x| 1e-10 * x)), ZERO];
        let found = Projected::banded(&twice, &|_| [16; 2], &()).expect("not cancelled").expect("distinct");
        let gaps = found.values.windows(2).map(|pair| pair[1] - pair[0]);
        assert_eq!(gaps.filter(|gap| *gap < 1e-9).count(), 8);
        assert_pairs(&twice, &found);
    }

    #[test]
    fn what_is_to_be_judged_reaches_beyond_what_is_wanted() {
        let recurrence = recurrence(15);
        let (all, _) = symmetric_eigen(recurrence.matrix().as_ref()).expect("converges");
        let (negative, n) = (all.partition_point(|x| *x < 0.0), all.len());
        let numbers = |below: Side, above: Side| {
            let reach = Reach { below, above, expected: 10 };
            let found = Projected::to_judge(&recurrence, &reach, 100.0, &()).expect("converges").values;
            let low = found.iter().filter(|x| **x < 0.0).count();
            [low, found.len() - low]
        };
        assert_eq!(numbers(Side::Count(3), Side::Count(5)), [3 + BEYOND[0], 5 + BEYOND[1]]);
        assert_eq!(numbers(Side::Count(n), Side::Count(n)), [negative, n - negative]);
        // Theta below -1.5 and above 1.3.
        let [low, high] = [all.partition_point(|x| *x < -1.5), n - all.partition_point(|x| *x < 1.3)];
        assert!(low > 3 && low + BEYOND[0] < negative && high > 3 && high + BEYOND[1] < n - negative);
        let found = numbers(Side::Until(100.0 - 1.0 / 1.5), Side::Until(100.0 + 1.0 / 1.3));
        assert_eq!(found, [low + BEYOND[0], high + BEYOND[1]]);
    }

    #[test]
    fn equal_eigenvalues_and_couplings_are_left_to_the_dense_decomposition() {
        // Two equal blocks that do not know of each other.
        let mut twice = recurrence(1);
        twice.diagonal.push(twice.diagonal[0]);
        twice.below = vec![ZERO; 2];
        let mut coupled = recurrence(4);
        coupled.couplings.push((0, 3, coupled.diagonal[1]));
        for recurrence in [twice, coupled] {
            let n = order(&recurrence);
            assert!(Projected::banded(&recurrence, &|_| [n; 2], &()).expect("not cancelled").is_none());
            let found = Projected::nearest(&recurrence, n, &()).expect("converges");
            let (values, vectors) = symmetric_eigen(recurrence.matrix().as_ref()).expect("converges");
            assert!(found.values == values && found.vectors == vectors && values.len() == n);
        }
    }
}
