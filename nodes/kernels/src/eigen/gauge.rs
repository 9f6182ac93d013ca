//! A deterministic sign for each eigenvector.

/// Sums of cubes below this share of their absolute sum count as zero.
const ODD: f64 = 1e-6;

/// Entries within this share of the largest count as equally large.
const TIE: f64 = 1e-6;

/// Turns v so that its mass-weighted sum of cubes is positive. The sum does not depend on how vertices are numbered or the shape is placed, and
/// depends on the mesh only as much as the function does. Where it vanishes, as for odd symmetric functions, the first of the
/// entries of largest magnitude becomes positive.
pub(super) fn fix_sign(v: &mut [f64], mass: &[f64]) {
    let (mut cubes, mut absolute) = (0.0, 0.0);
    for (x, s) in v.iter().zip(mass) {
        let cube = s * x * x * x;
        cubes += cube;
        absolute += cube.abs();
    }
    let negative = if f64::abs(cubes) > ODD * absolute {
        cubes < 0.0
    } else {
        let largest = v.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        v.iter().find(|x| x.abs() >= (1.0 - TIE) * largest).is_some_and(|x| *x < 0.0)
    };
    if negative {
        for x in v.iter_mut() {
            *x = 0.0 - *x;
        }
    }
}

#[cfg(test)]
mod tests {
    // Only signs change: exact.
    #![allow(clippy::float_cmp)]
    use super::fix_sign;

    #[test]
    fn cubes_decide_and_ties_fall_to_the_first_largest() {
        let mut v = [1.0, 1.0, -3.0];
        fix_sign(&mut v, &[1.0, 1.0, 1.0]);
        assert_eq!(v, [-1.0, -1.0, 3.0]);
        fix_sign(&mut v, &[100.0, 1.0, 1.0]); // the mass counts
        assert_eq!(v, [1.0, 1.0, -3.0]);
        let mut odd = [0.5, -2.0, 2.0, -0.5];
        fix_sign(&mut odd, &[1.0; 4]);
        assert_eq!(odd, [-0.5, 2.0, -2.0, 0.5]);
    }
}
