//! The lowest eigenvalues of several symmetric tridiagonal matrices together, by bisection.

use crate::sturm::{Bracket, LANES, Tridiagonal};

/// Numbers tried at first.
const GRID: usize = 4 * LANES;

/// The `count` lowest eigenvalues of all matrices together, ascending, without the first ones of each matrix: as many as the number beside it.
/// They are positive. `scale` is about the last. `None` if there are not so many, or if an entry is not finite.
pub(super) fn lowest(matrices: &[(Tridiagonal, usize)], count: usize, scale: f64) -> Option<Vec<f64>> {
    if !matrices.iter().all(|m| m.0.norm.is_finite()) {
        return None;
    }
    let mut top = scale;
    let bound = 2.0 * matrices.iter().map(|m| m.0.norm).fold(scale, f64::max);
    while top <= bound {
        let grid: Vec<f64> = (1..=GRID).map(|g| top * g as f64 / GRID as f64).collect();
        let below: Vec<Vec<f64>> = matrices.iter().map(|m| m.0.below(grid.as_chunks().0).concat()).collect();
        let positive = |m: usize, g: usize| (below[m][g] - matrices[m].1 as f64).max(0.0);
        let all = |g: &usize| (0..matrices.len()).map(|m| positive(m, *g)).sum::<f64>() >= count as f64;
        if let Some(cut) = (0..GRID).find(all) {
            let mut values = Vec::with_capacity(count + count / 2);
            for (m, (matrix, zeros)) in matrices.iter().enumerate() {
                let bracket = |number: usize| {
                    let at = below[m].iter().position(|b| *b > number as f64).unwrap_or(cut);
                    let low = if at == 0 { 0.0 } else { grid[at - 1] };
                    Bracket { number: number as f64, low, high: grid[at] }
                };
                let brackets = (*zeros..below[m][cut] as usize).map(bracket).collect();
                values.extend(matrix.bisect(brackets));
            }
            values.sort_by(f64::total_cmp);
            values.truncate(count);
            return Some(values);
        }
        top *= 2.0;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// -1, 2, -1: eigenvalues 2 - 2 cos(k pi / (n + 1)).
    fn second_differences(n: usize) -> Tridiagonal {
        Tridiagonal::new(&vec![2.0; n], &vec![-1.0; n])
    }

    fn known(n: usize, k: usize) -> f64 {
        2.0 - 2.0 * (k as f64 * std::f64::consts::PI / (n + 1) as f64).cos()
    }

    #[test]
    fn values_of_one_matrix_are_those_known() {
        for n in [1, 2, 7, 8, 33, 100] {
            for scale in [1e-3, 1.0, 50.0] {
                let values = lowest(&[(second_differences(n), 0)], n, scale).expect("n values");
                let expected: Vec<f64> = (1..=n).map(|k| known(n, k)).collect();
                assert!(values.iter().zip(&expected).all(|(x, y)| (x - y).abs() < 4e-15), "{n}: {values:?}");
            }
        }
        assert_eq!(lowest(&[(second_differences(5), 1)], 5, 1.0), None);
    }

    #[test]
    fn several_matrices_are_merged_with_multiplicity() {
        let matrices = [(second_differences(20), 1), (second_differences(9), 0), (second_differences(9), 0)];
        let values = lowest(&matrices, 12, 0.3).expect("twelve values");
        let mut expected: Vec<f64> =
            (2..=20).map(|k| known(20, k)).chain((1..=9).flat_map(|k| [known(9, k); 2])).collect();
        expected.sort_by(f64::total_cmp);
        assert!(values.len() == 12 && values.iter().zip(&expected).all(|(x, y)| (x - y).abs() < 4e-15), "{values:?}");
    }

    #[test]
    fn matrices_that_split_and_those_that_are_broken() {
        // Zeros beside the diagonal, and a number that is an eigenvalue and a pivot of zero on the grid.
        let split = Tridiagonal::new(&[3.0, 1.0, 1.0, 2.0, 1.0], &[0.0; 5]);
        let values = lowest(&[(split, 0)], 5, 4.0).expect("five values");
        assert!(values.iter().zip([1.0, 1.0, 1.0, 2.0, 3.0]).all(|(x, y)| (x - y).abs() < 1e-15), "{values:?}");
        assert_eq!(lowest(&[(Tridiagonal::new(&[1.0, f64::NAN], &[0.0; 2]), 0)], 1, 1.0), None);
        assert_eq!(lowest(&[], 1, 1.0), None);
    }
}
