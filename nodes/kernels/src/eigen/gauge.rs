//! A deterministic sign for each eigenvector.

/// Sums of cubes below this share of their absolute sum count as zero.
const ODD: f64 = 1e-6;

/// Entries within this share of the largest count as equally large.
const TIE: f64 = 1e-6;

/// Whether v is to be turned so that its mass-weighted sum of cubes is positive. The sum does not depend on how vertices are numbered or the shape is placed, and
/// depends on the mesh only as much as the function does. Where it vanishes next to the sum of magnitudes, as for odd symmetric functions, the first of the
/// entries of largest magnitude becomes positive.
pub(super) fn is_turned(cubes: f64, magnitudes: f64, v: impl Iterator<Item = f64> + Clone) -> bool {
    if f64::abs(cubes) > ODD * magnitudes {
        return cubes < 0.0;
    }
    let largest = v.clone().fold(0.0f64, |m, x| m.max(x.abs()));
    v.into_iter().find(|x| x.abs() >= (1.0 - TIE) * largest).is_some_and(|x| x < 0.0)
}

#[cfg(test)]
mod tests {
    use super::is_turned;

    fn turned(v: &[f64], mass: &[f64]) -> bool {
        let cubes = v.iter().zip(mass).map(|(x, s)| s * x * x * x);
        is_turned(cubes.clone().sum(), cubes.map(f64::abs).sum(), v.iter().copied())
    }

    #[test]
    fn cubes_decide_and_ties_fall_to_the_first_largest() {
        assert!(turned(&[1.0, 1.0, -3.0], &[1.0, 1.0, 1.0]));
        assert!(!turned(&[-1.0, -1.0, 3.0], &[1.0, 1.0, 1.0]));
        assert!(turned(&[-1.0, -1.0, 3.0], &[100.0, 1.0, 1.0])); // the mass counts
        assert!(turned(&[0.5, -2.0, 2.0, -0.5], &[1.0; 4]));
        assert!(!turned(&[-0.5, 2.0, -2.0, 0.5], &[1.0; 4]));
    }
}
