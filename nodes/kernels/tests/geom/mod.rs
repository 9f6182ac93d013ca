//! Meshes of known shape for the geometry tests.
#![allow(dead_code)] // Each test binary uses some of them.

pub type Mesh = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// A deterministic stream of numbers in [0, 1).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() * n as f64) as usize
    }
}

/// The square [-1, 1]^2 in n x n cells with alternating diagonals; inner vertices moved by up to `jitter` cells.
pub fn plane(n: usize, jitter: f64) -> Mesh {
    let mut random = Random(n as u64);
    let cell = 2.0 / n as f64;
    let mut vertices = Vec::new();
    for j in 0..=n {
        for i in 0..=n {
            let free = |k: usize| if k == 0 || k == n { 0.0 } else { jitter };
            let x = (i as f64 + free(i) * (2.0 * random.next() - 1.0)) * cell - 1.0;
            let y = (j as f64 + free(j) * (2.0 * random.next() - 1.0)) * cell - 1.0;
            vertices.push([x, y, 0.0]);
        }
    }
    let at = |i: usize, j: usize| (j * (n + 1) + i) as u32;
    let mut faces = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if (i * 7 + j * 3 + i * j) % 2 == 0 {
                faces.extend([[a, b, c], [a, c, d]]);
            } else {
                faces.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
    (vertices, faces)
}

/// The unit sphere: an icosahedron subdivided `levels` times.
pub fn sphere(levels: usize) -> Mesh {
    let g = f64::midpoint(1.0, 5f64.sqrt());
    let mut vertices: Vec<[f64; 3]> = Vec::new();
    for (s, t) in [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
        vertices.extend([[0.0, s, t * g], [s, t * g, 0.0], [t * g, 0.0, s]]);
    }
    let d2 = |p: [f64; 3], q: [f64; 3]| (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>();
    let mut faces = Vec::new();
    for a in 0..12u32 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let [p, q, r] = [a, b, c].map(|v| vertices[v as usize]);
                if [d2(p, q), d2(q, r), d2(p, r)].iter().all(|d| (d - 4.0).abs() < 1e-9) {
                    let det = p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0])
                        + p[2] * (q[0] * r[1] - q[1] * r[0]);
                    faces.push(if det > 0.0 { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    for _ in 0..levels {
        let edges = salient_kernels::adjacency::edges(vertices.len(), &faces).unwrap();
        let base = vertices.len() as u32;
        for &[a, b] in &edges.ends {
            let (p, q) = (vertices[a as usize], vertices[b as usize]);
            vertices.push([0, 1, 2].map(|k| f64::midpoint(p[k], q[k])));
        }
        let split = |f: usize| {
            let [a, b, c] = faces[f];
            let [x, y, z] = edges.face_edges[f].map(|e| base + e);
            [[a, x, z], [x, b, y], [z, y, c], [x, y, z]]
        };
        faces = (0..faces.len()).flat_map(split).collect();
    }
    for p in &mut vertices {
        let n = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        *p = p.map(|x| x / n);
    }
    (vertices, faces)
}

/// The open cylinder of radius 1 along z from 0 to `height`: `around` x `along` cells, rows jittered along z and angle.
pub fn cylinder(around: usize, along: usize, height: f64, jitter: f64) -> Mesh {
    let mut random = Random(3);
    let mut vertices = Vec::new();
    for j in 0..=along {
        for i in 0..around {
            let free = if j == 0 || j == along { 0.0 } else { jitter };
            let angle = (i as f64 + 0.5 * (j % 2) as f64 + free * (2.0 * random.next() - 1.0)) / around as f64
                * std::f64::consts::TAU;
            let z = (j as f64 + free * (2.0 * random.next() - 1.0)) * height / along as f64;
            vertices.push([angle.cos(), angle.sin(), z]);
        }
    }
    let at = |i: usize, j: usize| (j * around + i % around) as u32;
    let mut faces = Vec::new();
    for j in 0..along {
        for i in 0..around {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
            faces.extend(if j % 2 == 0 { [[a, b, c], [b, d, c]] } else { [[a, d, c], [a, b, d]] });
        }
    }
    (vertices, faces)
}

/// The torus of radii 1 and 0.4 in n x m cells.
pub fn torus(n: usize, m: usize) -> Mesh {
    let mut vertices = Vec::new();
    for i in 0..n {
        for j in 0..m {
            let (u, v) = (i as f64 / n as f64 * std::f64::consts::TAU, j as f64 / m as f64 * std::f64::consts::TAU);
            let r = 1.0 + 0.4 * v.cos();
            vertices.push([r * u.cos(), r * u.sin(), 0.4 * v.sin()]);
        }
    }
    let at = |i: usize, j: usize| ((i % n) * m + j % m) as u32;
    let cell = |i: usize, j: usize| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    let faces = (0..n).flat_map(|i| (0..m).flat_map(move |j| cell(i, j))).collect();
    (vertices, faces)
}

/// `distances` from twelve vertices over the exact ones beyond `near`, minus one.
pub fn relative_errors(
    vertices: &[[f64; 3]],
    near: f64,
    exact: impl Fn([f64; 3], [f64; 3]) -> f64,
    mut distances: impl FnMut(u32) -> Vec<f64>,
) -> Vec<f64> {
    let (mut random, mut errors) = (Random(11), Vec::new());
    for _ in 0..12 {
        let source = random.below(vertices.len());
        for (p, d) in vertices.iter().zip(distances(source as u32)) {
            let exact = exact(vertices[source], *p);
            if exact > near {
                errors.push(d / exact - 1.0);
            }
        }
    }
    assert!(errors.len() > 1000);
    errors
}

/// A ball's vertices by (distance, index).
pub fn sorted(ball: &[(u32, f64)]) -> Vec<(u32, f64)> {
    let mut all = ball.to_vec();
    all.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    all
}

/// The vertices no farther than `radius`, by (distance, index).
pub fn within(distances: &[f64], radius: f64) -> Vec<(u32, f64)> {
    let all: Vec<(u32, f64)> = (0u32..).zip(distances.iter().copied()).filter(|e| e.1 <= radius).collect();
    sorted(&all)
}

/// A random reordering of the vertices, and the new index of each old vertex.
pub fn permuted((vertices, faces): &Mesh, seed: u64) -> (Mesh, Vec<u32>) {
    let mut random = Random(seed);
    let mut new_of: Vec<u32> = (0..vertices.len() as u32).collect();
    for i in (1..new_of.len()).rev() {
        new_of.swap(i, random.below(i + 1));
    }
    let mut moved = vec![[0.0; 3]; vertices.len()];
    for (old, &new) in new_of.iter().enumerate() {
        moved[new as usize] = vertices[old];
    }
    let faces = faces.iter().rev().map(|f| f.map(|v| new_of[v as usize])).collect();
    ((moved, faces), new_of)
}
