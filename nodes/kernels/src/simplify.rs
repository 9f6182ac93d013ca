//! Decimation by quadric error metrics: Garland & Heckbert (1997), with boundary quadrics, link condition and flip check.
//!
//! All arithmetic is on coordinates centred and scaled to a unit box, so that the result does not depend on the unit of
//! length. Equal costs are resolved by vertex number.

use crate::adjacency::{self, MeshError};
use crate::heap::Heap;
use crate::stop::{NEVER, Pace, Stop};
use crate::surgery::Surgery;
use crate::topology::bounding_box;
use crate::vec3::{add, cross, distance2, dot, lerp, norm, normal, scale, sub};

/// Weight of a boundary edge's plane against a face's, both per squared length.
const BOUNDARY: f64 = 100.0;
/// Pull of a merged vertex towards its edge's middle, relative to the quadric: it settles flat regions, where all positions cost nothing.
const PULL: f64 = 1e-3;
/// Cost of an edge's length to the fourth power, relative to a quadric's area times squared distance: in flat regions short edges go first.
const SHORT: f64 = 1e-6;
/// No collapse turns a face by more than this cosine, and none leaves a face flatter than `FLATTEST` (height over longest edge).
const TURN: f64 = 0.3;
const FLATTEST: f64 = 0.02;

/// A decimated mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Simplified {
    /// Vertex positions; no longer those of original vertices.
    pub vertices: Vec<[f64; 3]>,
    /// Faces over `vertices`, oriented as before.
    pub faces: Vec<[u32; 3]>,
    /// For each vertex the nearest among the original vertices that were merged into it. No two share one.
    pub source: Vec<u32>,
    /// Whether the number asked for was reached. If not, no further collapse would have kept topology and orientation.
    pub reached: bool,
}

/// A quadratic form `x' A x - 2 b' x + c`: squared distances to planes, summed with weights.
#[derive(Clone, Copy, Default)]
struct Quadric {
    /// `A`: xx, xy, xz, yy, yz, zz.
    a: [f64; 6],
    b: [f64; 3],
    c: f64,
}

impl Quadric {
    /// The plane through `p` with unit normal `n`.
    fn plane(n: [f64; 3], p: [f64; 3], weight: f64) -> Self {
        let offset = dot(n, p);
        let a = [n[0] * n[0], n[0] * n[1], n[0] * n[2], n[1] * n[1], n[1] * n[2], n[2] * n[2]];
        Self { a: a.map(|x| weight * x), b: scale(n, weight * offset), c: weight * offset * offset }
    }

    fn sum(mut self, other: &Self) -> Self {
        self.a.iter_mut().zip(&other.a).for_each(|(x, y)| *x += y);
        self.b = add(self.b, other.b);
        self.c += other.c;
        self
    }

    fn at(&self, x: [f64; 3]) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let ax = [dot([xx, xy, xz], x), dot([xy, yy, yz], x), dot([xz, yz, zz], x)];
        (dot(x, ax) - 2.0 * dot(self.b, x) + self.c).max(0.0)
    }

    /// The minimum of the form plus [`PULL`] times its trace times the squared distance to `middle`.
    fn best(&self, middle: [f64; 3]) -> [f64; 3] {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let pull = PULL * (xx + yy + zz);
        let rows = [[xx + pull, xy, xz], [xy, yy + pull, yz], [xz, yz, zz + pull]];
        let right = add(self.b, scale(middle, pull));
        let det = dot(rows[0], cross(rows[1], rows[2]));
        if det.abs() <= f64::MIN_POSITIVE {
            return middle;
        }
        // Cramer's rule: the matrix is symmetric, so rows are columns.
        [
            dot(right, cross(rows[1], rows[2])) / det,
            dot(rows[0], cross(right, rows[2])) / det,
            dot(rows[0], cross(rows[1], right)) / det,
        ]
    }
}

/// A collapse on offer in one integer that orders as offers do: its cost, the lower and the higher end, and how often both had changed when it
/// was made. Costs are rounded to single precision, so that equal ones compare equal whatever the unit of length; being positive, their bits
/// order as they do.
fn offer(cost: f32, low: u32, high: u32, changes: u32) -> u128 {
    u128::from(cost.to_bits()) << 96 | u128::from(low) << 64 | u128::from(high) << 32 | u128::from(changes)
}

struct Decimation {
    mesh: Surgery,
    points: Vec<[f64; 3]>,
    quadrics: Vec<Quadric>,
    /// Counts the changes of each vertex.
    version: Vec<u32>,
    /// Original vertices merged into each vertex, as linked lists: the next one, and the last.
    next: Vec<u32>,
    last: Vec<u32>,
    heap: Heap,
    /// Memory of [`Decimation::merge`].
    ring: Vec<u32>,
}

/// Reduces a mesh to `target` vertices (at least 4), or as near as topology and orientation allow.
///
/// Boundaries stay in place as far as possible and each component keeps its topology. Vertices that no face names are dropped.
/// Refuses indices out of range and coordinates that are not finite.
pub fn simplify(vertices: &[[f64; 3]], faces: &[[u32; 3]], target: usize) -> Result<Simplified, MeshError> {
    simplify_until(vertices, faces, target, NEVER)
}

/// The same, until `stop`: the result then is decimated so far and not `reached`.
pub fn simplify_until(
    vertices: &[[f64; 3]],
    faces: &[[u32; 3]],
    target: usize,
    stop: Stop,
) -> Result<Simplified, MeshError> {
    adjacency::check_mesh(vertices, faces)?;
    let target = target.max(4);
    let (low, high) = bounding_box(vertices).unwrap_or_default();
    let center = lerp(low, high, 0.5);
    let extent = norm(sub(high, low));
    let unit = if extent > 0.0 && extent.is_finite() { extent } else { 1.0 };
    let scaled: Vec<[f64; 3]> = vertices.iter().map(|&p| scale(sub(p, center), 1.0 / unit)).collect();
    let pace = Pace::new(stop, 1024);
    let mut work = Decimation::new(scaled.clone(), faces, &pace);
    let mut count = work.mesh.star.iter().filter(|s| !s.is_empty()).count();
    // An offer refused once may become possible when its surroundings change: go round until nothing does.
    while count > target {
        let before = count;
        work.fill(&pace);
        count = work.run(count, target, &pace);
        if count == before {
            break;
        }
    }
    let (kept, faces) = work.mesh.finish();
    let mut result = Simplified { vertices: Vec::new(), faces, source: Vec::new(), reached: count <= target };
    for &v in &kept {
        // An untouched vertex keeps its coordinates to the last bit.
        let touched = work.version[v as usize] > 0;
        let position = if touched { add(scale(work.points[v as usize], unit), center) } else { vertices[v as usize] };
        result.vertices.push(position);
        result.source.push(work.nearest_member(v, &scaled));
    }
    Ok(result)
}

impl Decimation {
    fn new(points: Vec<[f64; 3]>, faces: &[[u32; 3]], pace: &Pace) -> Self {
        let n = points.len();
        let mesh = Surgery::new(n, faces);
        let mut quadrics = vec![Quadric::default(); n];
        for (corners, _) in faces.iter().zip(&mesh.alive).filter(|(_, alive)| **alive) {
            if pace.ends() {
                break;
            }
            let [a, b, c] = corners.map(|v| points[v as usize]);
            let doubled = normal(a, b, c);
            let size = norm(doubled);
            if size <= 0.0 {
                continue;
            }
            let unit = scale(doubled, 1.0 / size);
            let plane = Quadric::plane(unit, a, size / 2.0);
            for &v in corners {
                quadrics[v as usize] = quadrics[v as usize].sum(&plane);
            }
            for k in 0..3 {
                let (u, v) = (corners[k], corners[(k + 1) % 3]);
                if mesh.sides_at(u, v) == 1 {
                    let (p, q) = (points[u as usize], points[v as usize]);
                    let along = sub(q, p);
                    let wall = cross(along, unit);
                    let length = norm(wall);
                    if length > 0.0 {
                        let plane = Quadric::plane(scale(wall, 1.0 / length), p, BOUNDARY * length * length);
                        for w in [u, v] {
                            quadrics[w as usize] = quadrics[w as usize].sum(&plane);
                        }
                    }
                }
            }
        }
        let members: Vec<u32> = (0..n as u32).collect();
        Self {
            mesh,
            points,
            quadrics,
            version: vec![0; n],
            next: vec![u32::MAX; n],
            last: members,
            heap: Heap::default(),
            ring: Vec::new(),
        }
    }

    fn fill(&mut self, pace: &Pace) {
        self.heap.clear();
        for [a, b] in self.mesh.edges() {
            if pace.ends() {
                break;
            }
            self.offer(a, b);
        }
    }

    fn position(&self, a: u32, b: u32) -> ([f64; 3], f64) {
        let quadric = self.quadrics[a as usize].sum(&self.quadrics[b as usize]);
        let (p, q) = (self.points[a as usize], self.points[b as usize]);
        let place = quadric.best(lerp(p, q, 0.5));
        let length2 = distance2(p, q);
        (place, quadric.at(place) + SHORT * length2 * length2)
    }

    fn offer(&mut self, a: u32, b: u32) {
        let (low, high) = (a.min(b), a.max(b));
        let cost = self.position(low, high).1 as f32;
        self.heap.push(offer(cost, low, high, self.changes(low, high)));
    }

    /// Collapses until the target or the end of the offers; the vertices left.
    fn run(&mut self, mut count: usize, target: usize, pace: &Pace) -> usize {
        while count > target && !pace.ends() {
            let Some(offer) = self.heap.pop() else {
                break;
            };
            let (a, b) = ((offer >> 64) as u32, (offer >> 32) as u32);
            if self.changes(a, b) != offer as u32 || !self.mesh.can_collapse(a, b) {
                continue;
            }
            let (place, _) = self.position(a, b);
            let fits = |v: u32, other: u32| self.mesh.move_keeps_normals(&self.points, v, other, place, TURN, FLATTEST);
            if !fits(a, b) || !fits(b, a) {
                continue;
            }
            self.merge(a, b, place);
            count -= 1;
        }
        count
    }

    /// How often the ends of an edge have changed: the same only as long as neither does.
    fn changes(&self, a: u32, b: u32) -> u32 {
        self.version[a as usize] + self.version[b as usize]
    }

    fn merge(&mut self, a: u32, b: u32, place: [f64; 3]) {
        self.mesh.collapse(a, b);
        self.points[a as usize] = place;
        self.quadrics[a as usize] = self.quadrics[a as usize].sum(&self.quadrics[b as usize]);
        self.version[a as usize] += 1;
        self.version[b as usize] += 1;
        self.next[self.last[a as usize] as usize] = b;
        self.last[a as usize] = self.last[b as usize];
        let mut ring = std::mem::take(&mut self.ring);
        self.mesh.write_ring(a, &mut ring);
        for &v in &ring {
            self.offer(a, v);
        }
        self.ring = ring;
    }

    /// Of the original vertices merged into `v`, the one nearest to where it is now; the lowest among equals. Distances are
    /// compared in single precision, as costs are: the middle of an edge is as far from either end.
    fn nearest_member(&self, v: u32, originals: &[[f64; 3]]) -> u32 {
        let mut best = (f32::INFINITY, v);
        let mut member = v;
        while member != u32::MAX {
            let found = (distance2(self.points[v as usize], originals[member as usize]) as f32, member);
            if found < best {
                best = found;
            }
            member = self.next[member as usize];
        }
        best.1
    }
}
