//! The implicit rest surface and the map from rest to pose.
//!
//! With `rho_b` the distance from the axis of bone `b` over its radius there, the surface is `sum_b rho_b^-8 = 1`: a smooth
//! union whose blends are short, so that limbs close to each other do not grow together.

use super::skeleton::{Bone, Skeleton, Species};
use super::skin::Motion;
use crate::vec3::{add, dot, scale, sub};

/// Bones farther than this (in their radii) do not move a point.
const REACH: f64 = 3.0;

/// More than the eighth root of the number of bones.
const BULGE: f64 = 1.5;

/// The surface of one individual at rest, symmetric about x = 0.
#[derive(Debug, Clone)]
pub struct RestSurface {
    pub(super) skeleton: Skeleton,
    axes: Vec<Axis>,
}

/// A bone with what the field needs of it again and again.
#[derive(Debug, Clone, Copy)]
struct Axis {
    start: [f64; 3],
    direction: [f64; 3],
    inverse_length2: f64,
    radius: f64,
    taper: f64,
}

/// A point seen from a bone: the foot point's place on it (not clamped), the offset from there, and the radius there.
struct View {
    along: f64,
    offset: [f64; 3],
    radius: f64,
    /// `rho^-2`.
    nearness: f64,
}

impl Axis {
    fn new(bone: &Bone) -> Self {
        let direction = sub(bone.end, bone.start);
        Self {
            start: bone.start,
            direction,
            inverse_length2: 1.0 / dot(direction, direction),
            radius: bone.radius[0],
            taper: bone.radius[1] - bone.radius[0],
        }
    }

    fn view(&self, p: [f64; 3]) -> View {
        let from = sub(p, self.start);
        let along = dot(from, self.direction) * self.inverse_length2;
        let t = along.clamp(0.0, 1.0);
        let offset = sub(from, scale(self.direction, t));
        let radius = self.radius + t * self.taper;
        // Bounded on the axis itself, where the field has its pole.
        let nearness = radius * radius / dot(offset, offset).max(1e-12 * radius * radius);
        View { along, offset, radius, nearness }
    }

    /// Gradient of `rho^2`.
    fn slope(&self, view: &View) -> [f64; 3] {
        let across = scale(view.offset, 2.0 / (view.radius * view.radius));
        if !(0.0..=1.0).contains(&view.along) {
            return across;
        }
        // The radius changes along the bone; the foot point itself is stationary.
        let along = 2.0 * self.taper * self.inverse_length2 / (view.radius * view.nearness);
        sub(across, scale(self.direction, along))
    }
}

impl RestSurface {
    /// The surface of an individual: `seed` varies the proportions of the species.
    #[must_use]
    pub fn new(species: Species, seed: u64) -> Self {
        let skeleton = Skeleton::new(species, seed);
        let axes = skeleton.bones.iter().map(Axis::new).collect();
        Self { skeleton, axes }
    }

    /// The level of the field: 0 on the surface, negative inside, and about the distance in local radii nearby.
    #[must_use]
    pub fn level(&self, p: [f64; 3]) -> f64 {
        let term = |axis: &Axis| {
            let nearness = axis.view(p).nearness;
            (nearness * nearness) * (nearness * nearness)
        };
        let sum: f64 = self.axes.iter().map(term).sum();
        1.0 / sum.sqrt().sqrt().sqrt() - 1.0
    }

    fn level_and_gradient(&self, p: [f64; 3]) -> (f64, [f64; 3]) {
        /// A bone farther than eight radii adds less than 1e-8 of the gradient: Newton's method does without.
        const FAR: f64 = 1.0 / 64.0;
        let (mut sum, mut gradient) = (0.0, [0.0; 3]);
        for axis in &self.axes {
            let view = axis.view(p);
            let term = (view.nearness * view.nearness) * (view.nearness * view.nearness);
            sum += term;
            if view.nearness > FAR {
                gradient = add(gradient, scale(axis.slope(&view), term * view.nearness));
            }
        }
        // d(sum^(-1/8)) = sum^(-9/8) / 8 * sum_b 4 rho^-10 d(rho^2).
        let level = 1.0 / sum.sqrt().sqrt().sqrt();
        (level - 1.0, scale(gradient, 0.5 * level / sum))
    }

    /// Whether the ball about `center` is outside the surface. Where `n` bones meet, the surface bulges to at most
    /// `n^(1/8)` of their radii.
    pub(super) fn clear(&self, center: [f64; 3], ball: f64) -> bool {
        self.axes.iter().all(|axis| {
            let reach = ball + BULGE * axis.radius.max(axis.radius + axis.taper);
            let offset = axis.view(center).offset;
            dot(offset, offset) > reach * reach
        })
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
                    low[k] = low[k].min(end[k] - BULGE * radius);
                    high[k] = high[k].max(end[k] + BULGE * radius);
                }
            }
        }
        (low, high)
    }

    /// The least radius of a bone: what a grid must resolve.
    pub(super) fn thinnest(&self) -> f64 {
        self.skeleton.bones.iter().flat_map(|b| b.radius).fold(f64::INFINITY, f64::min)
    }

    /// Where a rest point goes when the bones move, and how thick the body is there (a radius). Near a joint, motions and
    /// radii of its bones are blended smoothly.
    pub(super) fn posed(&self, motions: &[Motion], p: [f64; 3]) -> ([f64; 3], f64) {
        let mut weights = Vec::with_capacity(motions.len());
        let (mut sum, mut thickness) = (0.0, 0.0);
        for view in self.axes.iter().map(|axis| axis.view(p)) {
            let reach = (view.nearness - 1.0 / (REACH * REACH)).max(0.0);
            let weight = reach * reach;
            weights.push(weight);
            sum += weight;
            thickness += weight * view.radius;
        }
        (Motion::blend(motions, &weights).apply(p), thickness / sum.max(f64::MIN_POSITIVE))
    }
}
