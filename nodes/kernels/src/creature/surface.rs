//! The implicit rest surface and the map from rest to pose.
//!
//! With `rho_b` the distance from the axis of bone `b` over its radius there, the surface is `sum_b rho_b^-8 = 1`: a smooth
//! union whose blends are short, so that limbs close to each other do not grow together.

use super::random::Random;
use super::skeleton::{Skeleton, Species};
use super::skin::Motion;
use crate::vec3::{add, dot, scale, sub};

/// Bones farther than this (in their radii) do not move a point.
const REACH: f64 = 3.0;

/// The surface of one individual at rest, symmetric about x = 0.
#[derive(Debug, Clone)]
pub struct RestSurface {
    pub(super) skeleton: Skeleton,
}

impl RestSurface {
    /// The surface of an individual: `seed` varies the proportions of the species.
    #[must_use]
    pub fn new(species: Species, seed: u64) -> Self {
        Self {
            skeleton: Skeleton::new(species, seed),
        }
    }

    /// For each bone its squared `rho`, the gradient of that, and its radius beside the point.
    fn rho2(&self, p: [f64; 3]) -> impl Iterator<Item = (f64, [f64; 3], f64)> + '_ {
        self.skeleton.bones.iter().map(move |bone| {
            let axis = sub(bone.end, bone.start);
            let length2 = dot(axis, axis);
            let along = dot(sub(p, bone.start), axis) / length2;
            let t = along.clamp(0.0, 1.0);
            let offset = sub(p, add(bone.start, scale(axis, t)));
            let taper = bone.radius[1] - bone.radius[0];
            let radius = bone.radius[0] + t * taper;
            let rho2 = dot(offset, offset) / (radius * radius);
            let mut gradient = scale(offset, 2.0 / (radius * radius));
            if t == along {
                // The radius changes along the bone; the foot point itself is stationary.
                gradient = sub(
                    gradient,
                    scale(axis, 2.0 * rho2 * taper / (radius * length2)),
                );
            }
            (rho2.max(1e-12), gradient, radius)
        })
    }

    /// The level of the field: 0 on the surface, negative inside, and about the distance in local radii nearby.
    #[must_use]
    pub fn level(&self, p: [f64; 3]) -> f64 {
        self.level_and_gradient(p).0
    }

    fn level_and_gradient(&self, p: [f64; 3]) -> (f64, [f64; 3]) {
        let (mut sum, mut gradient) = (0.0, [0.0; 3]);
        for (rho2, direction, _) in self.rho2(p) {
            let inverse = 1.0 / rho2;
            let term = (inverse * inverse) * (inverse * inverse);
            sum += term;
            gradient = add(gradient, scale(direction, term * inverse));
        }
        // d(sum^(-1/8)) = sum^(-9/8) / 8 * sum_b 4 rho^-10 d(rho^2).
        let level = 1.0 / sum.sqrt().sqrt().sqrt();
        (level - 1.0, scale(gradient, 0.5 * level / sum))
    }

    /// The surface point that Newton steps along the gradient lead to from `p`. For points near the surface, about the nearest one.
    #[must_use]
    pub fn project(&self, mut p: [f64; 3]) -> [f64; 3] {
        for _ in 0..20 {
            let (level, gradient) = self.level_and_gradient(p);
            let slope2 = dot(gradient, gradient);
            if level.abs() < 1e-10 || slope2 <= 0.0 {
                break;
            }
            // Steps are bounded by half a radius: far inside a bone the field is steeper than its linearisation.
            p = sub(p, scale(gradient, level.clamp(-0.5, 0.5) / slope2));
        }
        p
    }

    /// The box about the surface.
    pub(super) fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for bone in &self.skeleton.bones {
            for (end, radius) in [bone.start, bone.end].into_iter().zip(bone.radius) {
                for k in 0..3 {
                    low[k] = low[k].min(end[k] - 1.4 * radius);
                    high[k] = high[k].max(end[k] + 1.4 * radius);
                }
            }
        }
        (low, high)
    }

    /// The least radius of a bone: what a grid must resolve.
    pub(super) fn thinnest(&self) -> f64 {
        self.skeleton
            .bones
            .iter()
            .flat_map(|b| b.radius)
            .fold(f64::INFINITY, f64::min)
    }

    /// Where a rest point goes when the bones move, and how thick the body is there (a radius). Near a joint, motions and
    /// radii of its bones are blended smoothly.
    pub(super) fn posed(&self, motions: &[Motion], p: [f64; 3]) -> ([f64; 3], f64) {
        let mut weights = Vec::with_capacity(motions.len());
        let (mut sum, mut thickness) = (0.0, 0.0);
        for (rho2, _, radius) in self.rho2(p) {
            let reach = (1.0 / rho2 - 1.0 / (REACH * REACH)).max(0.0);
            let weight = reach * reach;
            weights.push(weight);
            sum += weight;
            thickness += weight * radius;
        }
        (
            Motion::blend(motions, &weights).apply(p),
            thickness / sum.max(f64::MIN_POSITIVE),
        )
    }

    /// A random rotation (unit quaternion) and offset of a grid.
    pub(super) fn grid_frame(random: &mut Random) -> ([f64; 4], [f64; 3]) {
        let offset = [random.unit(), random.unit(), random.unit()];
        loop {
            let q = [
                random.signed(),
                random.signed(),
                random.signed(),
                random.signed(),
            ];
            let length2 = q.iter().map(|x| x * x).sum::<f64>();
            if (0.01..=1.0).contains(&length2) {
                return (q.map(|x| x / length2.sqrt()), offset);
            }
        }
    }
}
