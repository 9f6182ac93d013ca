//! Solids by their signed distance (negative inside; exact or a lower bound near the surface), and bodies made of them.

use crate::creature::rotate;
use crate::vec3::{add, dot, norm, scale, sub};

/// A direction as a unit quaternion that turns z to it.
fn turn_to(axis: [f64; 3]) -> [f64; 4] {
    let a = scale(axis, 1.0 / norm(axis).max(f64::MIN_POSITIVE));
    // Half way between z and the axis; opposite to z, any turn by half a circle about x.
    let q = [1.0 + a[2], -a[1], a[0], 0.0];
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length < 1e-6 { [0.0, 1.0, 0.0, 0.0] } else { q.map(|x| x / length) }
}

/// One convex or ring-shaped piece.
#[derive(Clone, Debug)]
pub(super) enum Solid {
    /// Balls along a segment, of radii that change evenly.
    Cone { from: [f64; 3], to: [f64; 3], radius: [f64; 2] },
    /// A box with rounded edges, its z along `axis`.
    Block { centre: [f64; 3], axis: [f64; 3], half: [f64; 3], round: f64 },
    /// An ellipsoid, its z along `axis`.
    Egg { centre: [f64; 3], axis: [f64; 3], half: [f64; 3] },
    /// A torus about `axis`.
    Ring { centre: [f64; 3], axis: [f64; 3], radius: f64, thick: f64 },
    /// A cylinder about `axis`.
    Can { centre: [f64; 3], axis: [f64; 3], radius: f64, half: f64 },
}

impl Solid {
    fn distance(&self, p: [f64; 3]) -> f64 {
        let local = |centre: [f64; 3], axis: [f64; 3]| {
            let q = turn_to(axis);
            rotate([q[0], -q[1], -q[2], -q[3]], sub(p, centre))
        };
        match *self {
            Self::Cone { from, to, radius: [r, s] } => {
                let (along, off) = (sub(to, from), sub(p, from));
                let t = (dot(off, along) / dot(along, along).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                norm(sub(off, scale(along, t))) - (r + t * (s - r))
            }
            Self::Block { centre, axis, half, round } => {
                let x = local(centre, axis);
                let over: [f64; 3] = std::array::from_fn(|k| x[k].abs() - half[k] + round);
                let inside = over[0].max(over[1]).max(over[2]).min(0.0);
                norm(over.map(|o| o.max(0.0))) + inside - round
            }
            Self::Egg { centre, axis, half } => {
                let x = local(centre, axis);
                let (one, two): ([f64; 3], [f64; 3]) =
                    (std::array::from_fn(|k| x[k] / half[k]), std::array::from_fn(|k| x[k] / (half[k] * half[k])));
                let k = norm(one);
                if k < 1e-9 { -half[0].min(half[1]).min(half[2]) } else { k * (k - 1.0) / norm(two) }
            }
            Self::Ring { centre, axis, radius, thick } => {
                let [x, y, z] = local(centre, axis);
                (x.hypot(y) - radius).hypot(z) - thick
            }
            Self::Can { centre, axis, radius, half } => {
                let [x, y, z] = local(centre, axis);
                let (r, h) = (x.hypot(y) - radius, z.abs() - half);
                r.max(0.0).hypot(h.max(0.0)) + r.max(h).min(0.0)
            }
        }
    }

    /// A ball about it.
    fn ball(&self) -> ([f64; 3], f64) {
        match *self {
            Self::Cone { from, to, radius: [r, s] } => {
                (scale(add(from, to), 0.5), 0.5 * norm(sub(to, from)) + r.max(s))
            }
            Self::Block { centre, half, .. } | Self::Egg { centre, half, .. } => (centre, norm(half)),
            Self::Ring { centre, radius, thick, .. } => (centre, radius + thick),
            Self::Can { centre, radius, half, .. } => (centre, radius.hypot(half)),
        }
    }
}

/// Solids that flow into each other, less others.
#[derive(Clone, Debug, Default)]
pub(super) struct Body {
    pub solids: Vec<Solid>,
    pub holes: Vec<Solid>,
    /// Over what distance solids flow into each other.
    pub blend: f64,
}

impl Body {
    pub fn cone(&mut self, from: [f64; 3], to: [f64; 3], r: f64, s: f64) {
        self.solids.push(Solid::Cone { from, to, radius: [r, s] });
    }

    pub fn block(&mut self, centre: [f64; 3], half: [f64; 3], round: f64) {
        self.solids.push(Solid::Block { centre, axis: [0.0, 0.0, 1.0], half, round });
    }

    pub fn egg(&mut self, centre: [f64; 3], half: [f64; 3]) {
        self.solids.push(Solid::Egg { centre, axis: [0.0, 0.0, 1.0], half });
    }

    pub fn ring(&mut self, centre: [f64; 3], axis: [f64; 3], radius: f64, thick: f64) {
        self.solids.push(Solid::Ring { centre, axis, radius, thick });
    }

    pub fn can(&mut self, centre: [f64; 3], axis: [f64; 3], radius: f64, half: f64) {
        self.solids.push(Solid::Can { centre, axis, radius, half });
    }

    /// A limb through points, its radius changing evenly from `r` to `s`.
    pub fn limb(&mut self, points: &[[f64; 3]], r: f64, s: f64) {
        let count = points.len().saturating_sub(1).max(1) as f64;
        for (i, pair) in points.windows(2).enumerate() {
            let at = |i: usize| r + (s - r) * i as f64 / count;
            self.cone(pair[0], pair[1], at(i), at(i + 1));
        }
    }

    /// Signed distance, about.
    pub fn level(&self, p: [f64; 3]) -> f64 {
        let mut level = f64::INFINITY;
        for solid in &self.solids {
            // What is farther than the blend from both surfaces cannot change the minimum.
            let (centre, radius) = solid.ball();
            if norm(sub(p, centre)) - radius > level.max(0.0) + self.blend {
                continue;
            }
            let d = solid.distance(p);
            let h = (self.blend - (level - d).abs()).max(0.0) / self.blend.max(f64::MIN_POSITIVE);
            level = level.min(d) - if h.is_finite() { h * h * self.blend / 4.0 } else { 0.0 };
        }
        self.holes.iter().fold(level, |level, hole| level.max(-hole.distance(p)))
    }

    /// The box about the surface.
    pub fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for (centre, radius) in self.solids.iter().map(Solid::ball) {
            for k in 0..3 {
                low[k] = low[k].min(centre[k] - radius - self.blend);
                high[k] = high[k].max(centre[k] + radius + self.blend);
            }
        }
        (low, high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_vanish_on_the_surface_and_grow_by_one() {
        let axis = [1.0, -2.0, 2.0];
        let unit = scale(axis, 1.0 / 3.0);
        let centre = [0.3, 0.2, -0.1];
        let block = Solid::Block { centre, axis, half: [1.0, 2.0, 3.0], round: 0.2 };
        let can = Solid::Can { centre, axis, radius: 0.5, half: 3.0 };
        let egg = Solid::Egg { centre, axis, half: [1.0, 2.0, 3.0] };
        let cone = Solid::Cone { from: centre, to: add(centre, unit), radius: [1.0, 2.0] };
        for solid in [block, can, egg, cone] {
            for t in [-0.01, 0.0, 0.02] {
                assert!((solid.distance(add(centre, scale(unit, 3.0 + t))) - t).abs() < 1e-3, "{solid:?}");
            }
        }
        let ring = Solid::Ring { centre, axis, radius: 2.0, thick: 0.5 };
        assert!((ring.distance(centre) - 1.5).abs() < 1e-12);
        assert!((ring.distance(add(centre, scale(unit, 2.0))) - (8f64.sqrt() - 0.5)).abs() < 1e-12);
    }
}
