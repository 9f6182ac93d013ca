//! Rigid motions as dual quaternions, and their blending (Kavan et al. 2007): no collapse at bent joints.

use crate::vec3::{add, cross, dot, scale, sub};

/// A rigid motion: rotation by the unit quaternion `real` (w, x, y, z), then the translation held in `dual`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion {
    real: [f64; 4],
    dual: [f64; 4],
}

fn multiply(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let (va, vb) = ([a[1], a[2], a[3]], [b[1], b[2], b[3]]);
    let v = add(add(scale(vb, a[0]), scale(va, b[0])), cross(va, vb));
    [a[0] * b[0] - dot(va, vb), v[0], v[1], v[2]]
}

/// Rotates `p` by a unit quaternion.
pub(crate) fn rotate(q: [f64; 4], p: [f64; 3]) -> [f64; 3] {
    let v = [q[1], q[2], q[3]];
    let t = scale(cross(v, p), 2.0);
    add(add(p, scale(t, q[0])), cross(v, t))
}

impl Motion {
    pub(super) const IDENTITY: Self = Self { real: [1.0, 0.0, 0.0, 0.0], dual: [0.0; 4] };

    /// The turn by `angle` radians about the coordinate axis through `center`.
    pub(super) fn turn(axis: usize, angle: f64, center: [f64; 3]) -> Self {
        let (sin, cos) = (0.5 * angle).sin_cos();
        let mut real = [cos, 0.0, 0.0, 0.0];
        real[axis + 1] = sin;
        let shift = sub(center, rotate(real, center));
        let dual = multiply([0.0, shift[0], shift[1], shift[2]], real).map(|x| 0.5 * x);
        Self { real, dual }
    }

    /// This motion after `first`.
    pub(super) fn after(&self, first: &Self) -> Self {
        let (p, q) = (multiply(self.real, first.dual), multiply(self.dual, first.real));
        Self { real: multiply(self.real, first.real), dual: [0, 1, 2, 3].map(|k| p[k] + q[k]) }
    }

    /// The image of a point.
    pub(super) fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        let [w, x, y, z] = self.real;
        let shift = multiply(self.dual, [w, -x, -y, -z]);
        add(rotate(self.real, p), scale([shift[1], shift[2], shift[3]], 2.0))
    }

    /// The blend of motions by weights, not all zero; the identity if none has weight.
    pub(super) fn blend(motions: &[Self], weights: &[f64]) -> Self {
        let (mut real, mut dual) = ([0.0; 4], [0.0; 4]);
        for (motion, &weight) in motions.iter().zip(weights) {
            // A quaternion and its negative are one rotation; turns stay below half a circle, so the real part tells them apart.
            let weight = if motion.real[0] < 0.0 { -weight } else { weight };
            for k in 0..4 {
                real[k] += weight * motion.real[k];
                dual[k] += weight * motion.dual[k];
            }
        }
        let length = real.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length <= 0.0 {
            return Self::IDENTITY;
        }
        // Scaling both parts is enough: the stray component of `dual` along `real` drops out when applied.
        Self { real: real.map(|x| x / length), dual: dual.map(|x| x / length) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vec3::distance;

    #[test]
    fn turns_compose_and_fix_their_centre() {
        let c = [0.3, -1.0, 2.0];
        let (a, b) = (Motion::turn(0, 0.7, c), Motion::turn(2, -1.1, [1.0, 0.0, 0.5]));
        assert!(distance(a.apply(c), c) < 1e-14);
        let p = [0.9, 0.1, -0.4];
        assert!(distance(a.after(&b).apply(p), a.apply(b.apply(p))) < 1e-14);
        // A quarter turn about x through the origin takes y to z.
        let quarter = Motion::turn(0, std::f64::consts::FRAC_PI_2, [0.0; 3]);
        assert!(distance(quarter.apply([0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]) < 1e-14);
    }

    #[test]
    fn blends_are_rigid_and_between() {
        let c = [0.5, 0.5, 0.0];
        let half = Motion::blend(&[Motion::IDENTITY, Motion::turn(1, 1.0, c)], &[0.3, 0.3]);
        let p = [2.0, -1.0, 0.7];
        assert!(distance(half.apply(p), Motion::turn(1, 0.5, c).apply(p)) < 1e-12);
        let q = [0.1, 0.2, 0.3];
        assert!((distance(half.apply(p), half.apply(q)) - distance(p, q)).abs() < 1e-12);
        assert!(distance(Motion::blend(&[half], &[0.0]).apply(p), p) < 1e-15);
    }
}
