//! Spherical harmonics of a surface on concentric shells (Kazhdan, Funkhouser & Rusinkiewicz 2003).
//!
//! The area is moved to its centre, scaled to unit root mean square distance and spread over shells by distance. On each shell, the norm of its
//! part of each degree does not change when the shape is turned or mirrored.

use crate::stop::{NEVER, Pace, Stop};
use crate::vec3::{distance, norm, scale, sub};

/// Highest degree.
pub const DEGREES: usize = 12;
/// Shells, evenly spaced by distance from the centre.
pub const SHELLS: usize = 10;
/// Distance of the outermost shell, over the root mean square.
const REACH: f64 = 2.2;
/// Number of harmonics.
const WIDTH: usize = (DEGREES + 1) * (DEGREES + 1);
/// Points on the surface.
const POINTS: usize = 12_000;

/// Norms by shell, from inside to outside, and on each by degree, from 0 to [`DEGREES`].
#[must_use]
pub fn harmonics(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Vec<f64> {
    harmonics_until(vertices, faces, NEVER)
}

/// The same, until `stop`: incomplete then.
#[must_use]
pub fn harmonics_until(vertices: &[[f64; 3]], faces: &[[u32; 3]], stop: Stop) -> Vec<f64> {
    let points = super::samples(vertices, faces, POINTS);
    let middle = super::centre(&points);
    let rms = points.iter().map(|(p, w)| w * distance(*p, middle).powi(2)).sum::<f64>().sqrt();
    let mut sums = vec![[0.0; WIDTH]; SHELLS];
    let mut basis = [0.0; WIDTH];
    let pace = Pace::new(stop, 4096);
    for (p, weight) in points.iter().take_while(|_| !pace.ends()) {
        let p = scale(sub(*p, middle), 1.0 / rms.max(f64::MIN_POSITIVE));
        let r = norm(p);
        real_harmonics(if r > 1e-12 { scale(p, 1.0 / r) } else { [0.0, 0.0, 1.0] }, &mut basis);
        // Shared by the two nearest shells in proportion.
        let at = (r / REACH * SHELLS as f64 - 0.5).clamp(0.0, (SHELLS - 1) as f64);
        let low = at as usize;
        let share = at - low as f64;
        for (shell, part) in [(low, 1.0 - share), ((low + 1).min(SHELLS - 1), share)] {
            let w = weight * part;
            sums[shell].iter_mut().zip(&basis).for_each(|(s, y)| *s += w * y);
        }
    }
    let degree =
        |sums: &[f64; WIDTH], l: usize| sums[l * l..(l + 1) * (l + 1)].iter().map(|s| s * s).sum::<f64>().sqrt();
    sums.iter().flat_map(|shell| (0..=DEGREES).map(move |l| degree(shell, l))).collect()
}

/// Orthonormal real spherical harmonics of a unit vector times sqrt(4 pi), degree l at l² to l² + 2 l.
fn real_harmonics([x, y, z]: [f64; 3], out: &mut [f64]) {
    // P(l, m) without its factor sin^m, which goes into the polynomials c + i s = (x + i y)^m.
    let (mut c, mut s) = (1.0, 0.0);
    let mut diagonal: f64 = 1.0;
    for m in 0..=DEGREES {
        if m > 0 {
            (c, s) = (c * x - s * y, c * y + s * x);
            diagonal *= -((2 * m - 1) as f64);
        }
        let (mut before, mut now) = (0.0, diagonal);
        for l in m..=DEGREES {
            if l > m {
                let next = (z * (2 * l - 1) as f64 * now - (l + m - 1) as f64 * before) / (l - m) as f64;
                (before, now) = (now, next);
            }
            // (2 l + 1) (l - m)! / (l + m)!
            let ratio: f64 = (l - m + 1..=l + m).map(|k| 1.0 / k as f64).product();
            let factor = ((2 * l + 1) as f64 * ratio).sqrt();
            let root = if m == 0 { 1.0 } else { std::f64::consts::SQRT_2 };
            out[l * l + l + m] = factor * root * now * c;
            if m > 0 {
                out[l * l + l - m] = factor * root * now * s;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_degree_sums_to_2l_plus_1_by_the_addition_theorem() {
        let mut basis = [0.0; (DEGREES + 1) * (DEGREES + 1)];
        for p in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [2.0 / 7.0, -3.0 / 7.0, 6.0 / 7.0]] {
            real_harmonics(p, &mut basis);
            for l in 0..=DEGREES {
                let sum: f64 = basis[l * l..(l + 1) * (l + 1)].iter().map(|y| y * y).sum();
                assert!((sum - (2 * l + 1) as f64).abs() < 1e-10, "degree {l}: {sum}");
            }
        }
    }
}
