//! Exact geodesic distances on a polyhedral surface: the continuous Dijkstra method of Mitchell, Mount & Papadimitriou (1987).
//!
//! A shortest path is straight when the triangles it crosses are laid flat, and bends at most at vertices whose angles exceed a full turn and at
//! boundary vertices. *Windows* carry distances across edges, nearest first; an edge keeps the lower envelope of its windows
//! ([`envelope`]), and vertices where paths may bend send out windows of their own. Windows are also dropped by the
//! rules of Xin & Wang (2009), and an edge's list is closed as soon as no window can improve it, so that memory follows the wave front.
//!
//! All is computed from edge lengths. Where three faces meet in an edge a window enters both others. Every distance is that of an actual path,
//! or of one within rounding of it. Intervals below 1e-8 of an edge are passed over, which may lengthen a path by as much.

mod envelope;
mod surface;
mod window;

use super::dijkstra::Ball;
use super::queue::Queue;
use crate::adjacency::MeshError;
use crate::stop::{NEVER, Pace, Stop};
use envelope::Envelope;
use surface::{Side, Surface};
use window::Cone;

/// Items of the queue: vertices, edges to be closed, windows.
const CLOSE: u32 = 1 << 30;
const WINDOW: u32 = 1 << 31;

/// A mesh made ready for exact distances.
#[derive(Debug, Clone)]
pub struct Polyhedron(Surface);

impl Polyhedron {
    /// Prepares a mesh. Refuses indices out of range, coordinates that are not finite, and more than 2^28 vertices or faces.
    pub fn new(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Self, MeshError> {
        if vertices.len().max(faces.len()) > 1 << 28 {
            return Err(MeshError::TooLarge);
        }
        Ok(Self(Surface::new(vertices, faces)?))
    }

    /// Number of vertices.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.bends.len()
    }

    /// Whether there are no vertices.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.bends.is_empty()
    }
}

/// What is known of a vertex, if `stamp` is of this query: `4 * epoch + state`.
#[derive(Debug, Clone, Copy, Default)]
struct Label {
    distance: f64,
    stamp: u32,
}

const REACHED: u32 = 0;
const WANTED: u32 = 1;
const SETTLED: u32 = 2;

/// Workspace of exact searches: allocated once, reused for any number of queries on one mesh.
#[derive(Debug, Clone, Default)]
pub struct ExactSearch {
    labels: Vec<Label>,
    epoch: u32,
    envelope: Envelope,
    queue: Queue,
    settled: Vec<(u32, f64)>,
    wanted: usize,
    inside: usize,
}

impl ExactSearch {
    /// An empty workspace; it grows on first use.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Distances of all vertices from the nearest source; infinite where no path leads. Sources out of range are ignored.
    pub fn distances(&mut self, polyhedron: &Polyhedron, sources: &[u32]) -> Vec<f64> {
        self.distances_until(polyhedron, sources, NEVER)
    }

    /// The same, until `stop`: what was not reached is then infinite or too far.
    pub fn distances_until(&mut self, polyhedron: &Polyhedron, sources: &[u32], stop: Stop) -> Vec<f64> {
        self.search(&polyhedron.0, sources, f64::INFINITY, &[], stop);
        (0..polyhedron.len() as u32).map(|v| self.distance(v)).collect()
    }

    /// The vertices within `radius` of the nearest source, and all their neighbours, at a cost set by what is visited.
    pub fn ball(&mut self, polyhedron: &Polyhedron, sources: &[u32], radius: f64) -> Ball<'_> {
        self.ball_until(polyhedron, sources, radius, NEVER)
    }

    /// The same, until `stop`: the ball then is too small.
    pub fn ball_until(&mut self, polyhedron: &Polyhedron, sources: &[u32], radius: f64, stop: Stop) -> Ball<'_> {
        self.search(&polyhedron.0, sources, radius, &[], stop);
        let (inside, rim) = self.settled.split_at(self.inside);
        Ball { radius, inside, rim }
    }

    /// Distances of `targets` from the nearest source; the search ends when all of them are known.
    pub fn to(&mut self, polyhedron: &Polyhedron, sources: &[u32], targets: &[u32]) -> Vec<f64> {
        self.to_until(polyhedron, sources, targets, NEVER)
    }

    /// The same, until `stop`: what was not reached is then infinite.
    pub fn to_until(&mut self, polyhedron: &Polyhedron, sources: &[u32], targets: &[u32], stop: Stop) -> Vec<f64> {
        self.search(&polyhedron.0, sources, -1.0, targets, stop);
        let settled = |&v: &u32| self.labels.get(v as usize).is_some_and(|l| l.stamp == 4 * self.epoch + SETTLED);
        targets.iter().map(|v| if settled(v) { self.distance(*v) } else { f64::INFINITY }).collect()
    }

    fn distance(&self, v: u32) -> f64 {
        match self.labels[v as usize] {
            label if label.stamp >= 4 * self.epoch => label.distance,
            _ => f64::INFINITY,
        }
    }

    fn start(&mut self, surface: &Surface, sources: &[u32], targets: &[u32]) {
        self.queue.clear();
        self.settled.clear();
        self.envelope.start(surface.length.len());
        (self.wanted, self.inside) = (0, 0);
        self.epoch += 1;
        if self.epoch > u32::MAX / 4 || self.labels.len() != surface.bends.len() {
            self.labels.clear();
            self.labels.resize(surface.bends.len(), Label::default());
            self.epoch = 1;
        }
        for &v in targets {
            self.want(v);
        }
        for &v in sources {
            self.relax(v, 0.0);
        }
    }

    /// Asks for a vertex to be settled before the search ends.
    fn want(&mut self, v: u32) {
        let base = 4 * self.epoch;
        let Some(label) = self.labels.get_mut(v as usize) else { return };
        if label.stamp < base {
            *label = Label { distance: f64::INFINITY, stamp: base + REACHED };
        }
        if label.stamp == base + REACHED {
            label.stamp = base + WANTED;
            self.wanted += 1;
        }
    }

    /// A path of this length leads to a vertex.
    fn relax(&mut self, v: u32, distance: f64) {
        let base = 4 * self.epoch;
        let Some(label) = self.labels.get_mut(v as usize) else { return };
        if label.stamp < base {
            *label = Label { distance: f64::INFINITY, stamp: base + REACHED };
        }
        if distance < label.distance && label.stamp != base + SETTLED {
            label.distance = distance;
            self.queue.push(distance, v);
        }
    }

    fn search(&mut self, surface: &Surface, sources: &[u32], radius: f64, targets: &[u32], stop: Stop) {
        let pace = Pace::new(stop, 4096);
        self.start(surface, sources, targets);
        while let Some((key, item)) = self.queue.pop() {
            if pace.ends() {
                break;
            }
            // Not a number counts as nothing within.
            let within = key <= radius;
            if !within && self.wanted == 0 {
                break;
            }
            if item & WINDOW != 0 {
                if let Some(window) = self.envelope.take(item & !WINDOW, key, &mut self.queue, WINDOW) {
                    for side in surface.sides(window.edge).iter().filter(|s| s.face != window.from) {
                        self.propagate(surface, window.edge, window.cone, side);
                    }
                }
            } else if item & CLOSE != 0 {
                self.envelope.close(item & !CLOSE);
            } else if self.labels[item as usize].stamp != 4 * self.epoch + SETTLED {
                self.settle(surface, item, key, within);
            }
        }
    }

    fn settle(&mut self, surface: &Surface, v: u32, distance: f64, within: bool) {
        let label = &mut self.labels[v as usize];
        self.wanted -= usize::from(label.stamp == 4 * self.epoch + WANTED);
        label.stamp = 4 * self.epoch + SETTLED;
        self.settled.push((v, distance));
        self.inside += usize::from(within);
        for (next, length) in surface.graph.neighbours(v) {
            self.relax(next, distance + length);
            if within {
                self.want(next);
            }
        }
        if surface.bends[v as usize] || distance == 0.0 {
            for (edge, side) in surface.opposite(v) {
                let [x, y] = side.apex;
                let cone = Cone { start: 0.0, end: surface.length[edge as usize], x, y, offset: distance };
                self.offer(surface, edge, side.face, cone);
            }
        }
        for &edge in surface.spokes.row(v as usize) {
            // From here on, whatever crosses the edge is farther than the way along it.
            if !self.envelope.is_closed(edge) {
                self.queue.push(distance + surface.length[edge as usize], edge | CLOSE);
            }
        }
    }

    /// Follows a window of `edge` through the triangle on `side`.
    fn propagate(&mut self, surface: &Surface, edge: u32, cone: Cone, side: &Side) {
        let (base, [ax, ay]) = (surface.length[edge as usize], side.apex);
        let ends = surface.ends[edge as usize];
        let views = [(cone, [ax, ay]), (cone.mirrored(base), [base - ax, ay])];
        for (k, (cone, apex)) in views.into_iter().enumerate() {
            let onward = side.onward[k];
            let Some(child) = cone.turned(apex, onward.length) else { continue };
            // The other end of the base, as the child's edge sees it: a path from there may make the child useless.
            let other = Cone {
                x: base * apex[0] / onward.length,
                y: base * apex[1] / onward.length,
                offset: self.distance(ends[1 - k]),
                ..child
            };
            if other.at(child.start) <= child.at(child.start) {
                continue;
            }
            let child = if onward.outward { child } else { child.mirrored(onward.length) };
            self.offer(surface, onward.edge, side.face, child);
        }
    }

    /// A window has reached an edge.
    fn offer(&mut self, surface: &Surface, edge: u32, from: u32, cone: Cone) {
        let length = surface.length[edge as usize];
        let [first, second] = surface.ends[edge as usize];
        let (at_start, at_end) = (cone.at(cone.start), cone.at(cone.end));
        self.relax(first, at_start + cone.start);
        self.relax(second, at_end + (length - cone.end));
        if surface.sides(edge).len() < 2 || self.envelope.is_closed(edge) {
            return;
        }
        // All of it is farther than the way along the edge from one of its ends.
        let beaten =
            self.distance(first) + cone.end <= at_end || self.distance(second) + (length - cone.start) <= at_start;
        if !beaten && cone.start < cone.end && at_start.is_finite() && at_end.is_finite() {
            self.envelope.insert(edge, from, cone, length, &mut self.queue, WINDOW);
        }
    }
}
