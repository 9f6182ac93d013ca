//! A weighted graph laid on the mesh. Every link is the length of a curve on the surface, so that graph distances are never
//! below the exact ones.

use crate::adjacency::{self, Edges, MeshError};
use crate::vec3::{distance, distance2};

/// A link to a neighbour, 12 bytes: the length is split so that it needs no padding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Link {
    pub(super) vertex: u32,
    length: [u32; 2],
}

impl Link {
    const NONE: Self = Self { vertex: 0, length: [0; 2] };

    fn new(vertex: u32, length: f64) -> Self {
        let bits = length.to_bits();
        Self { vertex, length: [bits as u32, (bits >> 32) as u32] }
    }

    #[inline]
    pub(super) fn length(self) -> f64 {
        f64::from_bits(u64::from(self.length[0]) | u64::from(self.length[1]) << 32)
    }
}

/// A weighted undirected graph over the vertices of a mesh, in compressed rows: neighbour and length side by side.
#[derive(Debug, Clone, PartialEq)]
pub struct Graph {
    offsets: Vec<u32>,
    links: Vec<Link>,
    /// Mean and greatest finite length of a link.
    pub(super) mean: f64,
    pub(super) longest: f64,
}

impl Graph {
    /// The edges of a mesh. Refuses indices out of range and coordinates that are not finite.
    pub fn edges(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Self, MeshError> {
        Self::new(vertices, faces, false)
    }

    /// The edges of a mesh and, for each two triangles at an edge, the straight segment between their far corners after
    /// unfolding them into a plane, where it crosses that edge. Refuses what [`Graph::edges`] does.
    pub fn unfolded(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Self, MeshError> {
        Self::new(vertices, faces, true)
    }

    fn new(vertices: &[[f64; 3]], faces: &[[u32; 3]], unfolded: bool) -> Result<Self, MeshError> {
        adjacency::check_mesh(vertices, faces)?;
        let edges = adjacency::edges(vertices.len(), faces)?;
        let point = |v: u32| vertices[v as usize];
        let mut pairs: Vec<([u32; 2], f64)> = Vec::with_capacity(edges.ends.len() * if unfolded { 2 } else { 1 });
        pairs.extend(edges.ends.iter().map(|&[a, b]| ([a, b], distance(point(a), point(b)))));
        if unfolded {
            let known = edges.ends.len();
            for e in 0..known {
                if let Some([p, q]) = far_corners(faces, &edges, e) {
                    let [a, b] = edges.ends[e];
                    if let Some(length) = across(point(a), point(b), point(p), point(q)) {
                        pairs.push(([p, q], length));
                    }
                }
            }
        }
        Ok(Self::from_pairs(vertices.len(), &pairs))
    }

    /// Two counting sorts, by target and then by source, give rows in ascending order. Of several links between the same two vertices the shortest stays.
    pub(super) fn from_pairs(n: usize, pairs: &[([u32; 2], f64)]) -> Self {
        let mut offsets = vec![0u32; n + 1];
        for &([a, b], _) in pairs {
            offsets[a as usize + 1] += 1;
            offsets[b as usize + 1] += 1;
        }
        for v in 0..n {
            offsets[v + 1] += offsets[v];
        }
        let mut next = offsets.clone();
        let mut links = vec![Link::NONE; offsets[n] as usize];
        for &([a, b], length) in pairs {
            for (from, to) in [(a, b), (b, a)] {
                links[next[from as usize] as usize] = Link::new(to, length);
                next[from as usize] += 1;
            }
        }
        let mut kept = 0;
        for v in 0..n {
            let (start, end) = (offsets[v] as usize, offsets[v + 1] as usize);
            insertion_sort(&mut links[start..end]);
            let first = kept;
            offsets[v] = first as u32;
            for at in start..end {
                let link = links[at];
                if kept > first && links[kept - 1].vertex == link.vertex {
                    continue;
                }
                links[kept] = link;
                kept += 1;
            }
        }
        offsets[n] = kept as u32;
        links.truncate(kept);
        let lengths = links.iter().map(|l| l.length()).filter(|l| l.is_finite());
        let (sum, longest) = lengths.fold((0.0, 0f64), |(sum, most), l| (sum + l, most.max(l)));
        Self { mean: sum / links.len().max(1) as f64, longest, offsets, links }
    }

    /// Number of vertices, isolated ones included.
    #[must_use]
    pub fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Whether there are no vertices.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The neighbours of `v` and the lengths to them, by ascending index. Panics, as slices do, when there is no such vertex.
    #[inline]
    pub fn neighbours(&self, v: u32) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.links(v).iter().map(|link| (link.vertex, link.length()))
    }

    #[inline]
    pub(super) fn links(&self, v: u32) -> &[Link] {
        &self.links[self.offsets[v as usize] as usize..self.offsets[v as usize + 1] as usize]
    }
}

/// Rows have some six to twelve links: by neighbour, then by length.
fn insertion_sort(row: &mut [Link]) {
    let above = |x: Link, y: Link| x.vertex > y.vertex || (x.vertex == y.vertex && x.length() > y.length());
    for i in 1..row.len() {
        let link = row[i];
        let mut hole = i;
        while hole > 0 && above(row[hole - 1], link) {
            row[hole] = row[hole - 1];
            hole -= 1;
        }
        row[hole] = link;
    }
}

/// The corners opposite to an edge that has two triangles, if they are different vertices.
fn far_corners(faces: &[[u32; 3]], edges: &Edges, e: usize) -> Option<[u32; 2]> {
    let &[left, right] = edges.faces.row(e) else { return None };
    let [a, b] = edges.ends[e];
    let far = |face: u32| faces[face as usize].into_iter().find(|&v| v != a && v != b);
    let (p, q) = (far(left)?, far(right)?);
    (p != q).then_some([p, q])
}

/// Length of `pq` when the triangles `abp` and `abq` are unfolded about `ab` to either side, if the segment meets `ab`.
fn across(a: [f64; 3], b: [f64; 3], p: [f64; 3], q: [f64; 3]) -> Option<f64> {
    let base2 = distance2(a, b);
    if base2 <= 0.0 {
        return None;
    }
    let base = base2.sqrt();
    // Coordinates with `a` at the origin and `b` on the positive first axis; heights are counted away from `ab`.
    let flat = |c: [f64; 3]| {
        let along = (distance2(a, c) - distance2(b, c) + base2) / (2.0 * base);
        let height2 = distance2(a, c) - along * along;
        (along, height2.max(0.0).sqrt())
    };
    let ((px, py), (qx, qy)) = (flat(p), flat(q));
    let crossing = (px * qy + qx * py) / (py + qy);
    // Not a number when both heights are zero: then there is no shortcut either.
    if !(crossing >= 0.0 && crossing <= base) {
        return None;
    }
    let (dx, dy) = (px - qx, py + qy);
    Some((dx * dx + dy * dy).sqrt())
}
