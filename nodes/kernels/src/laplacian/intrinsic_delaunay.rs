//! The intrinsic Delaunay triangulation by edge flips on edge lengths (Bobenko & Springborn 2007).
//!
//! Half-edge `3 f + i` is the side of face `f` opposite its corner `i`, running from corner `i + 1` to corner `i + 2`. Flipped triangulations may
//! join two vertices by several edges, or a vertex to itself; half-edges, unlike vertex pairs, tell those apart.

use super::LaplacianError;
use super::triangle::Triangle;
use crate::stop::{Pace, Stop};

const NONE: u32 = u32::MAX;

/// An edge is flipped only if its cotangent sum is below minus this share of the summands, so that cocircular quads end the flips.
const TOLERANCE: f64 = 1e-10;

/// Faces, and the lengths of their sides by opposite corner.
type Triangulation = (Vec<[u32; 3]>, Vec<[f64; 3]>);

struct Mesh {
    corners: Vec<u32>,
    lengths: Vec<f64>,
    twins: Vec<u32>,
}

fn next(h: u32) -> u32 {
    h - h % 3 + (h + 1) % 3
}

/// The faces and lengths of the intrinsic Delaunay triangulation of the same surface on the same vertices. Boundary edges stay.
pub(crate) fn flip_to_delaunay(
    faces: &[[u32; 3]],
    lengths: &[[f64; 3]],
    stop: Stop,
) -> Result<Triangulation, LaplacianError> {
    let pace = Pace::new(stop, 4096);
    let mut mesh = Mesh::new(faces, lengths)?;
    let count = mesh.corners.len();
    // A stack of half-edges to examine, smallest on top; any order ends in the same triangulation but for cocircular quads.
    let mut stack: Vec<u32> =
        (0..count as u32).rev().filter(|&h| mesh.twins[h as usize] != NONE && h < mesh.twins[h as usize]).collect();
    let mut flips = 0;
    let limit = 1000 + 200 * count;
    while let Some(h) = stack.pop() {
        if pace.ends() {
            return Err(LaplacianError::Cancelled);
        }
        if mesh.is_delaunay(h) {
            continue;
        }
        if flips == limit {
            return Err(LaplacianError::DelaunayStalled { flips });
        }
        flips += 1;
        stack.extend(mesh.flip(h));
    }
    let triples = |h: usize| [h, h + 1, h + 2];
    let faces = (0..count).step_by(3).map(|h| triples(h).map(|i| mesh.corners[i])).collect();
    let lengths = (0..count).step_by(3).map(|h| triples(h).map(|i| mesh.lengths[i])).collect();
    Ok((faces, lengths))
}

impl Mesh {
    fn new(faces: &[[u32; 3]], lengths: &[[f64; 3]]) -> Result<Self, LaplacianError> {
        let mut mesh = Self { corners: faces.concat(), lengths: lengths.concat(), twins: pair_half_edges(faces)? };
        mesh.orient()?;
        Ok(mesh)
    }

    fn tail(&self, h: u32) -> u32 {
        self.corners[next(h) as usize]
    }

    /// Turns faces over until twins run in opposite directions, starting from the first face of each component.
    fn orient(&mut self) -> Result<(), LaplacianError> {
        let count = self.corners.len() / 3;
        let mut seen = vec![false; count];
        let mut stack = Vec::new();
        for seed in 0..count {
            if !std::mem::replace(&mut seen[seed], true) {
                stack.push(seed);
            }
            while let Some(face) = stack.pop() {
                for h in 3 * face as u32..3 * face as u32 + 3 {
                    let twin = self.twins[h as usize];
                    if twin == NONE {
                        continue;
                    }
                    let other = twin as usize / 3;
                    let agree = self.tail(h) != self.tail(twin);
                    if !agree && seen[other] {
                        return Err(LaplacianError::NotOrientable { face: other });
                    }
                    if !agree {
                        self.turn_over(other);
                    }
                    if !std::mem::replace(&mut seen[other], true) {
                        stack.push(other);
                    }
                }
            }
        }
        Ok(())
    }

    /// Swaps the last two corners of a face, and with them the sides opposite.
    fn turn_over(&mut self, face: usize) {
        let (a, b) = (3 * face + 1, 3 * face + 2);
        self.corners.swap(a, b);
        self.lengths.swap(a, b);
        self.twins.swap(a, b);
        for h in [a, b] {
            if self.twins[h] != NONE {
                let twin = self.twins[h] as usize;
                self.twins[twin] = h as u32;
            }
        }
    }

    fn sides(&self, h: u32) -> [f64; 3] {
        [h, next(h), next(next(h))].map(|s| self.lengths[s as usize])
    }

    /// Whether the angles opposite an inner edge sum to at most pi. Boundary edges are, having nothing to flip.
    fn is_delaunay(&self, h: u32) -> bool {
        let twin = self.twins[h as usize];
        // A face glued to itself along two sides: the angles are those at the base of an isosceles triangle.
        if twin == NONE || twin / 3 == h / 3 {
            return true;
        }
        let cotangent = |side: u32| Triangle::from_lengths(self.sides(side)).map(|t| t.cotangents[0]);
        match (cotangent(h), cotangent(twin)) {
            (Some(a), Some(b)) => a + b >= -TOLERANCE * (a.abs() + b.abs()),
            _ => true, // flat: the caller finds the face and names it
        }
    }

    /// Replaces the edge of an inner half-edge by the other diagonal of its quad; returns the quad's four sides.
    ///
    /// Faces (p, a, b) and (q, b, a) about the edge a-b become (p, a, q) and (q, b, p).
    fn flip(&mut self, h: u32) -> [u32; 4] {
        let twin = self.twins[h as usize];
        let (bp, pa) = (next(h), next(next(h)));
        let (aq, qb) = (next(twin), next(next(twin)));
        let [p, a, b, q] = [h, bp, pa, twin].map(|s| self.corners[s as usize]);
        let diagonal = self.other_diagonal(h, twin);
        let (f, g) = (h - h % 3, twin - twin % 3);
        // Old half-edge -> new one, for the quad's sides; a side's twin may itself be one of them.
        let moved = [(aq, f), (pa, f + 2), (bp, g), (qb, g + 2)];
        let renumber = |old: u32| moved.iter().find(|m| m.0 == old).map_or(old, |m| m.1);
        let sides = moved
            .map(|(old, new)| (new, self.lengths[old as usize], renumber_twin(self.twins[old as usize], renumber)));
        for (new, length, other) in sides {
            self.lengths[new as usize] = length;
            self.twins[new as usize] = other;
            if other != NONE {
                self.twins[other as usize] = new;
            }
        }
        for (face, corners) in [(f, [p, a, q]), (g, [q, b, p])] {
            self.corners[face as usize..face as usize + 3].copy_from_slice(&corners);
        }
        for (side, other) in [(f + 1, g + 1), (g + 1, f + 1)] {
            self.lengths[side as usize] = diagonal;
            self.twins[side as usize] = other;
        }
        moved.map(|m| m.1)
    }

    /// The distance between the apexes of two faces laid flat side by side.
    fn other_diagonal(&self, h: u32, twin: u32) -> f64 {
        let ([l, bp, pa], [_, aq, qb]) = (self.sides(h), self.sides(twin));
        // a at the origin, b at (l, 0), p above, q below.
        let apex = |from_a: f64, from_b: f64, area: f64| {
            (0.5 * (l + (from_a - from_b) * (from_a + from_b) / l), 2.0 * area / l)
        };
        let area = |side: u32| Triangle::from_lengths(self.sides(side)).map_or(0.0, |t| t.area);
        let (p, q) = (apex(pa, bp, area(h)), apex(aq, qb, area(twin)));
        (p.0 - q.0).hypot(p.1 + q.1)
    }
}

fn renumber_twin(twin: u32, renumber: impl Fn(u32) -> u32) -> u32 {
    if twin == NONE { NONE } else { renumber(twin) }
}

/// The half-edge on the other side of each edge, or `NONE` on the boundary.
fn pair_half_edges(faces: &[[u32; 3]]) -> Result<Vec<u32>, LaplacianError> {
    let mut edges: Vec<(u32, u32, u32)> = Vec::with_capacity(3 * faces.len());
    for (f, corners) in faces.iter().enumerate() {
        for i in 0..3 {
            let (a, b) = (corners[(i + 1) % 3], corners[(i + 2) % 3]);
            edges.push((a.min(b), a.max(b), (3 * f + i) as u32));
        }
    }
    edges.sort_unstable();
    let mut twins = vec![NONE; edges.len()];
    for group in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        match *group {
            [_] => {}
            [x, y] => {
                twins[x.2 as usize] = y.2;
                twins[y.2 as usize] = x.2;
            }
            _ => {
                return Err(LaplacianError::NonManifoldEdge { vertices: [group[0].0, group[0].1], faces: group.len() });
            }
        }
    }
    Ok(twins)
}
