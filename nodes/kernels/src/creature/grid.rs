//! Marching tetrahedra on a turned grid: a closed manifold, whatever the field.

use crate::creature::skin::rotate;
use crate::stop::{Pace, Stop};
use crate::vec3::{add, dot, lerp, normal, scale, sub};

const NONE: u32 = u32::MAX;

/// Levels are evaluated in blocks of so many points a side.
const SIDE: usize = 8;

/// Layers of edges that are kept: those that begin at either end of a layer of cubes.
const EDGE_LAYERS: usize = 2;

/// A grid of cubes, each cut into the six tetrahedra along one diagonal. A thin shape in a large box would have more points than fit into
/// memory, so only two layers of blocks are held, in turn.
struct Grid {
    size: [usize; 3],
    origin: [f64; 3],
    cell: f64,
    turn: [f64; 4],
    /// At the points of `2 SIDE` layers: point `n` is at `n` modulo the length.
    level: Vec<f64>,
}

/// A mesh under construction; `on_edge` holds the vertex of each grid edge, seven edges starting at each grid point, of [`EDGE_LAYERS`] layers in
/// turn.
struct Output {
    vertices: Vec<[f64; 3]>,
    faces: Vec<[u32; 3]>,
    on_edge: Vec<u32>,
}

/// Meshes the zero level of `level` within the box `low`..`high`, outside which it must be positive, as it must be
/// in balls (centre, radius) that are `clear`. The grid has the given
/// cell, and is turned by a unit quaternion and moved by a fraction of a cell. Incomplete if stopped.
pub(crate) fn march(
    level: impl Fn([f64; 3]) -> f64,
    clear: impl Fn([f64; 3], f64) -> bool,
    (low, high): ([f64; 3], [f64; 3]),
    cell: f64,
    (turn, offset): ([f64; 4], [f64; 3]),
    stop: Stop,
) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let pace = Pace::new(stop, 1);
    let clear = |p, r| pace.ends() || clear(p, r);
    let mut grid = Grid::new((low, high), cell, (turn, offset));
    let edges = 7 * grid.layer();
    let mut out = Output { vertices: Vec::new(), faces: Vec::new(), on_edge: vec![NONE; EDGE_LAYERS * edges] };
    grid.fill(0, &level, clear);
    for k in 0..grid.size[2] - 1 {
        if pace.ends() {
            break;
        }
        // Cubes reach into the next layer.
        if (k + 1) % SIDE == 0 {
            grid.fill((k + 1) / SIDE, &level, clear);
        }
        let next = (k + 1) % EDGE_LAYERS * edges;
        out.on_edge[next..next + edges].fill(NONE);
        for j in 0..grid.size[1] - 1 {
            for i in 0..grid.size[0] - 1 {
                grid.cube([i, j, k], &mut out);
            }
        }
    }
    (out.vertices, out.faces)
}

impl Grid {
    fn new((low, high): ([f64; 3], [f64; 3]), cell: f64, (turn, offset): ([f64; 4], [f64; 3])) -> Self {
        // The box of the box's corners in the turned frame, and a cell to spare on each side.
        let back = [turn[0], -turn[1], -turn[2], -turn[3]];
        let (mut from, mut to) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for corner in 0..8 {
            let pick = |k: usize| {
                if corner >> k & 1 == 0 { low[k] } else { high[k] }
            };
            let p = rotate(back, [pick(0), pick(1), pick(2)]);
            for k in 0..3 {
                from[k] = from[k].min(p[k]);
                to[k] = to[k].max(p[k]);
            }
        }
        let origin = [0, 1, 2].map(|k| from[k] - (1.0 + offset[k]) * cell);
        let size = [0, 1, 2].map(|k| ((to[k] - origin[k]) / cell) as usize + 3);
        Self { size, origin, cell, turn, level: vec![1.0; 2 * SIDE * size[0] * size[1]] }
    }

    /// Number of points in a layer.
    fn layer(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Evaluates the level in a layer of blocks, in place of the last but one; blocks that are clear of the surface are just outside.
    fn fill(&mut self, slab: usize, level: impl Fn([f64; 3]) -> f64, clear: impl Fn([f64; 3], f64) -> bool) {
        let half = 0.5 * (SIDE - 1) as f64;
        let reach = 3f64.sqrt() * half * self.cell;
        let held = SIDE * self.layer();
        let from = slab % 2 * held;
        self.level[from..from + held].fill(1.0);
        let blocks = [self.size[0].div_ceil(SIDE), self.size[1].div_ceil(SIDE)];
        for block in 0..blocks[0] * blocks[1] {
            let first = [block % blocks[0], block / blocks[0], slab].map(|b| b * SIDE);
            if clear(self.place(first.map(|b| b as f64 + half)), reach) {
                continue;
            }
            let last = [0, 1, 2].map(|k| (first[k] + SIDE).min(self.size[k]));
            for z in first[2]..last[2] {
                for y in first[1]..last[1] {
                    for x in first[0]..last[0] {
                        let n = self.index([x, y, z]);
                        let at = n % self.level.len();
                        self.level[at] = level(self.point(n));
                    }
                }
            }
        }
    }

    /// The level at a point of the layers that are held.
    fn level(&self, n: usize) -> f64 {
        self.level[n % self.level.len()]
    }

    /// The point at grid coordinates.
    fn place(&self, at: [f64; 3]) -> [f64; 3] {
        rotate(self.turn, add(self.origin, scale(at, self.cell)))
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.size[1] + j) * self.size[0] + i
    }

    fn point(&self, n: usize) -> [f64; 3] {
        let (i, rest) = (n % self.size[0], n / self.size[0]);
        let (j, k) = (rest % self.size[1], rest / self.size[1]);
        self.place([i as f64, j as f64, k as f64])
    }

    fn cube(&self, at: [usize; 3], out: &mut Output) {
        let corner = |bits: usize| self.index([at[0] + (bits & 1), at[1] + (bits >> 1 & 1), at[2] + (bits >> 2 & 1)]);
        let inside = (0..8).filter(|&bits| self.level(corner(bits)) < 0.0).count();
        if inside == 0 || inside == 8 {
            return;
        }
        // Each tetrahedron walks from corner 0 to corner 7 along the three axes in one order.
        for [first, second] in [[1, 3], [1, 5], [2, 3], [2, 6], [4, 5], [4, 6]] {
            self.tetrahedron([0, first, second, 7].map(|bits| (bits, corner(bits))), out);
        }
    }

    fn tetrahedron(&self, corners: [(usize, usize); 4], out: &mut Output) {
        let is_inside = |c: &(usize, usize)| self.level(c.1) < 0.0;
        let (mut inner, mut outer) = (Vec::with_capacity(4), Vec::with_capacity(4));
        for c in corners {
            if is_inside(&c) {
                inner.push(c);
            } else {
                outer.push(c);
            }
        }
        let mut cut = |a: (usize, usize), b: (usize, usize)| self.cut(a, b, out);
        let ring: Vec<u32> = match (inner.as_slice(), outer.as_slice()) {
            (&[a], &[x, y, z]) => vec![cut(a, x), cut(a, y), cut(a, z)],
            (&[a, b, c], &[x]) => vec![cut(a, x), cut(b, x), cut(c, x)],
            (&[a, b], &[x, y]) => vec![cut(a, x), cut(a, y), cut(b, y), cut(b, x)],
            _ => return,
        };
        let outward = sub(self.point(outer[0].1), self.point(inner[0].1));
        let [p, q, r] = [0, 1, 2].map(|k| out.vertices[ring[k] as usize]);
        let flip = dot(normal(p, q, r), outward) < 0.0;
        for k in 2..ring.len() {
            let face = [ring[0], ring[k - 1], ring[k]];
            out.faces.push(if flip { [face[0], face[2], face[1]] } else { face });
        }
    }

    /// The vertex where the level changes sign along a grid edge, kept off its ends so that no two coincide.
    fn cut(&self, a: (usize, usize), b: (usize, usize), out: &mut Output) -> u32 {
        let (low, high) = if a.0 < b.0 { (a, b) } else { (b, a) };
        // The difference of corner bits, 1 to 7, names the edge's direction.
        let slot = (low.1 * 7 + (high.0 - low.0) - 1) % out.on_edge.len();
        if out.on_edge[slot] == NONE {
            out.on_edge[slot] = out.vertices.len() as u32;
            let (x, y) = (self.level(low.1), self.level(high.1));
            let t = (x / (x - y)).clamp(0.1, 0.9);
            out.vertices.push(lerp(self.point(low.1), self.point(high.1), t));
        }
        out.on_edge[slot]
    }
}
