//! Geodesic distances by Dijkstra's algorithm over a weighted graph laid on the mesh.
//!
//! Every graph edge is the length of a curve on the surface, so that graph distances are never below the exact ones.

use crate::adjacency::{self, Csr, MeshError};
use crate::vec3::{distance, distance2};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Which curves the graph is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Metric {
    /// Mesh edges only: what Hu & Hua (2009) use. Typically 6-10 % too long on irregular meshes.
    Edges,
    /// Mesh edges and, for each pair of triangles sharing an edge, the straight segment between their far corners after
    /// unfolding them into a plane, where that segment crosses the shared edge. Typically 2-5 % too long.
    #[default]
    Unfolded,
}

/// A weighted undirected graph over the vertices of a mesh, in compressed rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Graph {
    links: Csr,
    weights: Vec<f64>,
}

impl Graph {
    /// Lays the graph of `metric` on a mesh. Refuses indices out of range and coordinates that are not finite.
    pub fn new(
        vertices: &[[f64; 3]],
        faces: &[[u32; 3]],
        metric: Metric,
    ) -> Result<Self, MeshError> {
        adjacency::check_mesh(vertices, faces)?;
        let edges = adjacency::edges(vertices.len(), faces)?;
        let point = |v: u32| vertices[v as usize];
        let mut links: Vec<(u32, u32, f64)> = Vec::with_capacity(edges.ends.len() * 4);
        let mut link = |a: u32, b: u32, length: f64| links.extend([(a, b, length), (b, a, length)]);
        for (e, &[a, b]) in edges.ends.iter().enumerate() {
            link(a, b, distance(point(a), point(b)));
            let (Metric::Unfolded, &[left, right]) = (metric, edges.faces.row(e)) else {
                continue;
            };
            let far = |face: u32| faces[face as usize].into_iter().find(|&v| v != a && v != b);
            if let (Some(p), Some(q)) = (far(left), far(right))
                && p != q
                && let Some(length) = unfolded(point(a), point(b), point(p), point(q))
            {
                link(p, q, length);
            }
        }
        // Two corners may be joined by an edge and by shortcuts: the shortest stays.
        links.sort_unstable_by(|x, y| (x.0, x.1).cmp(&(y.0, y.1)).then(x.2.total_cmp(&y.2)));
        links.dedup_by_key(|link| (link.0, link.1));
        let mut offsets = vec![0; vertices.len() + 1];
        for &(a, ..) in &links {
            offsets[a as usize + 1] += 1;
        }
        for v in 0..vertices.len() {
            offsets[v + 1] += offsets[v];
        }
        let targets = links.iter().map(|l| l.1).collect();
        let weights = links.iter().map(|l| l.2).collect();
        Ok(Self {
            links: Csr { offsets, targets },
            weights,
        })
    }

    /// Number of vertices, isolated ones included.
    #[must_use]
    pub fn len(&self) -> usize {
        self.links.len()
    }

    /// Whether there are no vertices.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.links.is_empty()
    }

    /// The neighbours of `v` and the lengths to them, by ascending index.
    pub fn neighbours(&self, v: u32) -> impl Iterator<Item = (u32, f64)> + '_ {
        let range = self.links.offsets[v as usize]..self.links.offsets[v as usize + 1];
        self.links.targets[range.clone()]
            .iter()
            .copied()
            .zip(self.weights[range].iter().copied())
    }
}

/// Length of `pq` when the triangles `abp` and `abq` are unfolded about `ab` to either side, if the segment meets `ab`.
fn unfolded(a: [f64; 3], b: [f64; 3], p: [f64; 3], q: [f64; 3]) -> Option<f64> {
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

/// Heap entry: nearest first, then lowest index.
#[derive(Debug, Clone, Copy)]
struct Entry {
    distance: f64,
    vertex: u32,
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        other
            .distance
            .total_cmp(&self.distance)
            .then(other.vertex.cmp(&self.vertex))
    }
}
impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Entry {}

/// The vertices about a source: see [`Dijkstra::ball`].
#[derive(Debug, Clone, Copy)]
pub struct Ball<'a> {
    /// The bounding distance asked for.
    pub radius: f64,
    /// The vertices no farther than `radius` with their distances, ascending by (distance, index).
    pub inside: &'a [(u32, f64)],
    /// Farther vertices that were settled too, ascending. All graph neighbours of inside vertices are here or inside.
    pub rim: &'a [(u32, f64)],
}

/// Workspace of Dijkstra's algorithm: allocated once per graph size, reused for any number of queries.
#[derive(Debug, Clone, Default)]
pub struct Dijkstra {
    distance: Vec<f64>,
    state: Vec<State>,
    touched: Vec<u32>,
    heap: BinaryHeap<Entry>,
    settled: Vec<(u32, f64)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum State {
    #[default]
    Far,
    /// Reached, but not next to a vertex within the radius.
    Reached,
    /// Next to a vertex within the radius: must be settled before a ball is complete.
    Wanted,
    Settled,
}

impl Dijkstra {
    /// An empty workspace; it grows on first use.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    fn start(&mut self, graph: &Graph, sources: &[u32]) {
        for &v in &self.touched {
            self.distance[v as usize] = f64::INFINITY;
            self.state[v as usize] = State::Far;
        }
        self.touched.clear();
        self.heap.clear();
        self.settled.clear();
        self.distance.resize(graph.len(), f64::INFINITY);
        self.state.resize(graph.len(), State::Far);
        for &vertex in sources.iter().filter(|&&v| (v as usize) < graph.len()) {
            if self.state[vertex as usize] == State::Far {
                self.distance[vertex as usize] = 0.0;
                self.state[vertex as usize] = State::Reached;
                self.touched.push(vertex);
                self.heap.push(Entry {
                    distance: 0.0,
                    vertex,
                });
            }
        }
    }

    /// Distances of all vertices from the nearest source; infinite where no path leads. Sources out of range are ignored.
    pub fn distances(&mut self, graph: &Graph, sources: &[u32]) -> Vec<f64> {
        self.ball(graph, sources, f64::INFINITY);
        self.distance.clone()
    }

    /// Visits the vertices within `radius` of the nearest source, and their neighbours, at a cost set by the visited
    /// vertices alone. Sources out of range are ignored; a radius that is negative or not a number visits nothing.
    pub fn ball(&mut self, graph: &Graph, sources: &[u32], radius: f64) -> Ball<'_> {
        self.start(graph, sources);
        let mut wanted = 0usize;
        let mut inside = 0;
        while let Some(Entry { distance, vertex }) = self.heap.pop() {
            let state = self.state[vertex as usize];
            if state == State::Settled {
                continue;
            }
            let within = distance <= radius;
            if !within && wanted == 0 {
                break;
            }
            wanted -= usize::from(state == State::Wanted);
            self.state[vertex as usize] = State::Settled;
            self.settled.push((vertex, distance));
            inside += usize::from(within);
            for (next, length) in graph.neighbours(vertex) {
                let (through, slot) = (distance + length, next as usize);
                let known = self.state[slot];
                if known == State::Settled {
                    continue;
                }
                if known == State::Far {
                    self.touched.push(next);
                    self.state[slot] = State::Reached;
                }
                if within && known != State::Wanted {
                    self.state[slot] = State::Wanted;
                    wanted += 1;
                }
                if through < self.distance[slot] {
                    self.distance[slot] = through;
                    self.heap.push(Entry {
                        distance: through,
                        vertex: next,
                    });
                }
            }
        }
        let (inside, rim) = self.settled.split_at(inside);
        Ball {
            radius,
            inside,
            rim,
        }
    }
}
