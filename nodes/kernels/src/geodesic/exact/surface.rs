//! What the exact search knows of a mesh: edge lengths, and each triangle laid flat against each of its sides.

use crate::adjacency::{self, Csr, MeshError};
use crate::geodesic::graph::Graph;
use crate::vec3::distance;
use std::f64::consts::{PI, TAU};

/// Shortest paths bend at a vertex only if the angles about it exceed a full turn, or half a turn on a boundary; by more than this, so that
/// flat vertices do not count. What lies in the shadow of a flatter saddle is off by that much at most.
const BEND: f64 = 1e-10;

/// An edge as seen from a triangle next to the one at hand.
#[derive(Debug, Clone, Copy)]
pub(super) struct Onward {
    pub(super) edge: u32,
    /// Whether the edge's own direction runs towards the apex.
    pub(super) outward: bool,
    pub(super) length: f64,
}

/// A triangle laid flat on one side: the side from (0, 0) to (length, 0) in the edge's own direction, the apex above it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side {
    pub(super) face: u32,
    pub(super) apex: [f64; 2],
    /// The edges to the apex from the side's first and second end.
    pub(super) onward: [Onward; 2],
}

/// Intrinsic geometry of a mesh, for exact geodesics.
#[derive(Debug, Clone)]
pub(super) struct Surface {
    /// End points of each edge, lower index first: the edge's own direction.
    pub(super) ends: Vec<[u32; 2]>,
    pub(super) length: Vec<f64>,
    /// Where the sides of each edge begin; one more entry than edges.
    offsets: Vec<usize>,
    sides: Vec<Side>,
    /// Of each vertex the edges opposite to it, each with its place in `sides`.
    opposite: Csr,
    /// The edge of each entry of `sides`.
    edge_of: Vec<u32>,
    /// Whether shortest paths may bend there: saddles, boundaries, and wherever the surface is not a manifold.
    pub(super) bends: Vec<bool>,
    /// The mesh edges as a graph.
    pub(super) graph: Graph,
    /// The edges at each vertex.
    pub(super) spokes: Csr,
}

impl Surface {
    /// Faces that name a vertex twice are passed over; their edges remain as paths.
    pub(super) fn new(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Self, MeshError> {
        let graph = Graph::edges(vertices, faces)?;
        let edges = adjacency::edges(vertices.len(), faces)?;
        let length: Vec<f64> =
            edges.ends.iter().map(|&[a, b]| distance(vertices[a as usize], vertices[b as usize])).collect();
        let proper = |f: usize| !edges.face_edges[f].contains(&adjacency::NO_EDGE);
        let mut surface = Self {
            offsets: vec![0; length.len() + 1],
            sides: Vec::with_capacity(3 * faces.len()),
            edge_of: Vec::with_capacity(3 * faces.len()),
            opposite: Csr::default(),
            bends: Vec::new(),
            spokes: adjacency::spokes(vertices.len(), &edges.ends),
            ends: edges.ends,
            length,
            graph,
        };
        let mut apexes = Vec::with_capacity(3 * faces.len());
        for e in 0..surface.length.len() {
            for &f in edges.faces.row(e).iter().filter(|&&f| proper(f as usize)) {
                let face_edges = edges.face_edges[f as usize];
                let k = face_edges.iter().position(|&x| x as usize == e).unwrap_or(0);
                let apex = faces[f as usize][(k + 2) % 3];
                let others = [face_edges[(k + 1) % 3], face_edges[(k + 2) % 3]];
                surface.sides.push(surface.side(f, e, apex, others));
                surface.edge_of.push(e as u32);
                apexes.push(apex);
            }
            surface.offsets[e + 1] = surface.sides.len();
        }
        surface.opposite = Csr::bucket(vertices.len(), apexes.iter().copied().zip(0u32..));
        surface.bends = surface.bending(vertices.len());
        Ok(surface)
    }

    /// Face `face` laid flat on edge `e`; `others` are its two other edges in any order.
    fn side(&self, face: u32, e: usize, apex: u32, others: [u32; 2]) -> Side {
        let [first, second] = self.ends[e];
        let joins = |edge: u32, v: u32| self.ends[edge as usize] == [v.min(apex), v.max(apex)];
        let [near, far] = if joins(others[0], first) { others } else { [others[1], others[0]] };
        let onward = |edge: u32, from: u32| Onward { edge, outward: from < apex, length: self.length[edge as usize] };
        let (l, a, b) = (self.length[e], self.length[near as usize], self.length[far as usize]);
        // Factored so that nearly equal lengths do not cancel. An edge without length has no direction: its apex stands above.
        let along = if l > 0.0 { 0.5 * (l + (a - b) * ((a + b) / l)) } else { 0.0 };
        let height = ((a - along) * (a + along)).max(0.0).sqrt();
        Side { face, apex: [along, height], onward: [onward(near, first), onward(far, second)] }
    }

    /// The triangles at an edge, laid flat.
    pub(super) fn sides(&self, edge: u32) -> &[Side] {
        &self.sides[self.offsets[edge as usize]..self.offsets[edge as usize + 1]]
    }

    /// The edges that see a vertex as their apex.
    pub(super) fn opposite(&self, vertex: u32) -> impl Iterator<Item = (u32, &Side)> + '_ {
        self.opposite.row(vertex as usize).iter().map(|&s| (self.edge_of[s as usize], &self.sides[s as usize]))
    }

    fn bending(&self, n: usize) -> Vec<bool> {
        let mut angle = vec![0.0f64; n];
        for (v, angle) in angle.iter_mut().enumerate() {
            for &s in self.opposite.row(v) {
                let ([x, y], base) = (self.sides[s as usize].apex, self.length[self.edge_of[s as usize] as usize]);
                // Between the directions from the apex to the side's two ends.
                *angle += (y * base).atan2(y * y - x * (base - x));
            }
        }
        let mut bends: Vec<bool> = angle.iter().map(|a| *a > TAU + BEND).collect();
        for (e, ends) in self.ends.iter().enumerate() {
            let faces = self.sides(e as u32).len();
            if faces != 2 {
                for v in ends.map(|v| v as usize) {
                    bends[v] |= faces != 1 || angle[v] > PI + BEND;
                }
            }
        }
        // Two fans that meet in a point only: a path may pass from one fan to the other.
        for (bends, v) in bends.iter_mut().zip(0u32..) {
            *bends |= self.fans(v) > 1;
        }
        bends
    }

    /// How many runs of faces joined across edges there are about a vertex.
    fn fans(&self, v: u32) -> usize {
        let spokes = self.spokes.row(v as usize);
        let mut of: Vec<usize> = (0..spokes.len()).collect();
        let mut count = spokes.len();
        for &s in self.opposite.row(v as usize) {
            let [a, b] = self.sides[s as usize].onward.map(|o| spokes.iter().position(|&e| e == o.edge));
            let (Some(a), Some(b)) = (a, b) else { continue };
            if of[a] != of[b] {
                let (from, to) = (of[a], of[b]);
                of.iter_mut().filter(|x| **x == from).for_each(|x| *x = to);
                count -= 1;
            }
        }
        count
    }
}
