//! Isotropic remeshing (Botsch & Kobbelt 2004) of a posed surface: split, collapse, flip, relax.
//!
//! Every vertex is a point of the rest surface together with its image in the pose. Lengths, areas and angles are those of
//! the pose; new points are made at rest, projected, and posed. So the ground truth is exact by construction.

use super::skin::Motion;
use super::surface::RestSurface;
use crate::stop::{Pace, Stop};
use crate::surgery::Surgery;
use crate::vec3::{add, distance2, dot, lerp, norm, normal, scale, sub};

/// No operation turns a face by more than this cosine, or leaves it flatter than this (height over longest edge).
const TURN: f64 = 0.5;
const FLATTEST: f64 = 0.15;

/// A mesh on a posed surface.
pub(super) struct Remesher<'a> {
    surface: &'a RestSurface,
    motions: &'a [Motion],
    mesh: Surgery,
    rest: Vec<[f64; 3]>,
    posed: Vec<[f64; 3]>,
    /// Radius of the limb at each vertex.
    thickness: Vec<f64>,
    /// Edges are shortened in proportion where limbs are thinner than this.
    thick: f64,
    /// Once it ends, every loop does, and what comes out is of no use.
    pace: Pace<'a>,
}

/// A point of the surface.
struct Place {
    rest: [f64; 3],
    posed: [f64; 3],
    thickness: f64,
}

/// Faces, and the vertices at rest and in the pose.
pub(super) struct Remeshed {
    pub(super) rest: Vec<[f64; 3]>,
    pub(super) posed: Vec<[f64; 3]>,
    pub(super) faces: Vec<[u32; 3]>,
}

impl<'a> Remesher<'a> {
    /// Starts from a mesh near the rest surface.
    pub(super) fn new(
        surface: &'a RestSurface,
        motions: &'a [Motion],
        vertices: &[[f64; 3]],
        faces: &[[u32; 3]],
        stop: Stop<'a>,
    ) -> Self {
        let pace = Pace::new(stop, 512);
        let near = |&p: &[f64; 3]| if pace.ends() { p } else { surface.project(p) };
        let rest: Vec<[f64; 3]> = vertices.iter().map(near).collect();
        let moved = |&p: &[f64; 3]| if pace.ends() { (p, 1.0) } else { surface.posed(motions, p) };
        let (posed, thickness) = rest.iter().map(moved).unzip();
        Self { surface, motions, mesh: Surgery::new(vertices.len(), faces), rest, posed, thickness, thick: 0.0, pace }
    }

    /// Remeshes to `count` vertices of about equal spacing.
    pub(super) fn run(mut self, count: usize) -> Remeshed {
        let live = self.mesh.faces.iter().zip(&self.mesh.alive).filter(|(_, alive)| **alive);
        let area: f64 = live.map(|(f, _)| norm(self.normal(*f)) / 2.0).sum();
        // A vertex of a regular triangulation has two triangles of area sqrt(3)/4 L^2.
        let mut edge = (area / (count as f64 * 0.75f64.sqrt())).sqrt();
        // At least about eight edges around a limb.
        self.thick = 1.25 * edge;
        for round in 0..6 {
            self.split_long(4.0 / 3.0 * edge, usize::MAX);
            // From a fine grid, growing limits collapse evenly instead of eating one region first.
            for limit in [0.4, 0.6, 0.8] {
                self.collapse_short(limit * edge, 4.0 / 3.0 * edge, 0);
            }
            self.flip();
            self.relax();
            if round > 0 {
                edge *= (self.count() as f64 / count as f64).sqrt().clamp(0.8, 1.25);
            }
        }
        for _ in 0..3 {
            self.split_long(0.0, count);
            self.collapse_short(f64::INFINITY, f64::INFINITY, count);
            self.flip();
            self.relax();
        }
        let (kept, faces) = self.mesh.finish();
        let take = |points: &[[f64; 3]]| kept.iter().map(|&v| points[v as usize]).collect();
        Remeshed { rest: take(&self.rest), posed: take(&self.posed), faces }
    }

    fn count(&self) -> usize {
        self.mesh.star.iter().filter(|s| !s.is_empty()).count()
    }

    fn normal(&self, face: [u32; 3]) -> [f64; 3] {
        let [a, b, c] = face.map(|v| self.posed[v as usize]);
        normal(a, b, c)
    }

    /// Squared length of an edge, magnified where limbs are thin.
    fn length2(&self, a: u32, b: u32) -> f64 {
        let (a, b) = (a as usize, b as usize);
        self.sized(distance2(self.posed[a], self.posed[b]), self.thickness[a], self.thickness[b])
    }

    fn sized(&self, length2: f64, r: f64, s: f64) -> f64 {
        let magnified = |radius: f64| (self.thick / radius).max(1.0);
        length2 * magnified(r) * magnified(s)
    }

    /// The edges whose squared magnified length is in `range`, ascending.
    fn by_length(&self, range: std::ops::Range<f64>) -> Vec<(f64, [u32; 2])> {
        if self.pace.ends_now() {
            return Vec::new();
        }
        let all = self.mesh.edges();
        if self.pace.ends_now() {
            return Vec::new();
        }
        let measured = all.into_iter().map(|[a, b]| (self.length2(a, b), [a, b]));
        let mut edges: Vec<(f64, [u32; 2])> = measured.filter(|(length2, _)| range.contains(length2)).collect();
        if self.pace.ends_now() {
            return Vec::new();
        }
        edges.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        edges
    }

    /// The surface point near the middle of an edge, at rest and posed.
    fn middle(&self, a: u32, b: u32) -> Place {
        self.place(lerp(self.rest[a as usize], self.rest[b as usize], 0.5))
    }

    fn place(&self, near: [f64; 3]) -> Place {
        let rest = self.surface.project(near);
        let (posed, thickness) = self.surface.posed(self.motions, rest);
        Place { rest, posed, thickness }
    }

    fn put(&mut self, v: u32, place: &Place) {
        self.rest[v as usize] = place.rest;
        self.posed[v as usize] = place.posed;
        self.thickness[v as usize] = place.thickness;
    }

    /// Splits edges longer than `limit`, the longest first, while there are fewer than `most` vertices.
    fn split_long(&mut self, limit: f64, most: usize) {
        let room = most.saturating_sub(self.count());
        let long = self.by_length(limit * limit..f64::INFINITY);
        for (_, [a, b]) in long.into_iter().rev().take(room) {
            if self.pace.ends() {
                break;
            }
            let place = self.middle(a, b);
            self.mesh.split(a, b);
            self.rest.push(place.rest);
            self.posed.push(place.posed);
            self.thickness.push(place.thickness);
        }
    }

    /// Collapses edges shorter than `limit`, the shortest first, where no edge becomes longer than `longest`, while there are
    /// more than `least` vertices.
    fn collapse_short(&mut self, limit: f64, longest: f64, least: usize) {
        let mut count = self.count();
        for (_, [a, b]) in self.by_length(0.0..limit * limit) {
            if count <= least || self.pace.ends() {
                break;
            }
            // Both may have moved or gone since the edges were listed; `can_collapse` sees to edges that are gone.
            if self.length2(a, b) >= limit * limit || !self.mesh.can_collapse(a, b) {
                continue;
            }
            let place = self.middle(a, b);
            let reach2 = |w: u32| {
                let length2 = distance2(place.posed, self.posed[w as usize]);
                self.sized(length2, place.thickness, self.thickness[w as usize])
            };
            let too_long = |v: u32| self.mesh.ring(v).0.into_iter().any(|w| reach2(w) > longest * longest);
            let fits =
                |v: u32, other: u32| self.mesh.move_keeps_normals(&self.posed, v, other, place.posed, TURN, FLATTEST);
            if too_long(a) || too_long(b) || !fits(a, b) || !fits(b, a) {
                continue;
            }
            self.mesh.collapse(a, b);
            self.put(a, &place);
            count -= 1;
        }
    }

    /// Flips edges whose opposite angles sum to more than half a circle, where the surface is not too bent for it.
    fn flip(&mut self) {
        for _ in 0..4 {
            let mut flipped = false;
            if self.pace.ends_now() {
                return;
            }
            for [a, b] in self.mesh.edges() {
                if self.pace.ends() {
                    return;
                }
                if self.wants_flip(a, b) {
                    flipped |= self.mesh.flip(a, b);
                }
            }
            if !flipped {
                break;
            }
        }
    }

    fn wants_flip(&self, a: u32, b: u32) -> bool {
        let [left, right] = self.mesh.sides(a, b)[..] else {
            return false;
        };
        let at = |v: u32| self.posed[v as usize];
        let cotangent = |far: u32| {
            let (u, v) = (sub(at(a), at(far)), sub(at(b), at(far)));
            dot(u, v) / norm(normal(at(far), at(a), at(b)))
        };
        if cotangent(left.far) + cotangent(right.far) >= -1e-9 {
            return false;
        }
        let corners = self.mesh.faces[left.face as usize];
        let put = |old: u32, new: u32| corners.map(|v| if v == old { new } else { v });
        let before = add(self.normal(corners), self.normal(self.mesh.faces[right.face as usize]));
        let after = [self.normal(put(b, right.far)), self.normal(put(a, right.far))];
        after.iter().all(|&n| dot(n, before) > 0.8 * norm(n) * norm(before))
    }

    /// Moves each vertex to the area-weighted centroid of its faces, on the surface.
    fn relax(&mut self) {
        for v in 0..self.mesh.star.len() as u32 {
            if self.pace.ends() {
                break;
            }
            let (mut sum, mut weight) = ([0.0; 3], 0.0);
            for &f in &self.mesh.star[v as usize] {
                let face = self.mesh.faces[f as usize];
                let area = norm(self.normal(face));
                let [a, b, c] = face.map(|v| self.rest[v as usize]);
                sum = add(sum, scale(add(add(a, b), c), area / 3.0));
                weight += area;
            }
            if weight <= 0.0 {
                continue;
            }
            let place = self.place(scale(sum, 1.0 / weight));
            if self.mesh.move_keeps_normals(&self.posed, v, u32::MAX, place.posed, TURN, FLATTEST) {
                self.put(v, &place);
            }
        }
    }
}
