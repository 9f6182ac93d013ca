//! Shapes with known spectra and areas.

use std::sync::Arc;

use salient_sdk::Mesh;

/// A sphere of radius 1: an icosahedron subdivided `levels` times.
pub fn sphere(levels: usize) -> Arc<Mesh> {
    let g = f64::midpoint(1.0, 5.0_f64.sqrt());
    let mut vertices: Vec<[f64; 3]> = Vec::new();
    for s in [-1.0, 1.0] {
        for t in [-g, g] {
            vertices.extend([[0.0, s, t], [s, t, 0.0], [t, 0.0, s]]);
        }
    }
    // Faces of the icosahedron: triples at mutual distance 2, turned outwards.
    let near = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>() < 4.1;
    let mut faces = Vec::new();
    for a in 0..12_usize {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let [p, q, r] = [vertices[a], vertices[b], vertices[c]];
                if near(p, q) && near(q, r) && near(p, r) {
                    let det = p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0])
                        + p[2] * (q[0] * r[1] - q[1] * r[0]);
                    faces.push(if det > 0.0 { [a, b, c] } else { [a, c, b] }.map(|i| i as u32));
                }
            }
        }
    }
    for _ in 0..levels {
        subdivide(&mut vertices, &mut faces);
    }
    for p in &mut vertices {
        let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        *p = p.map(|x| x / length);
    }
    Arc::new(Mesh { vertices, faces, ..Mesh::default() })
}

fn subdivide(vertices: &mut Vec<[f64; 3]>, faces: &mut Vec<[u32; 3]>) {
    let mut middles = std::collections::BTreeMap::new();
    let mut finer = Vec::new();
    for f in faces.iter() {
        let middle: [u32; 3] = std::array::from_fn(|i| {
            let (a, b) = (f[i], f[(i + 1) % 3]);
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let (p, q) = (vertices[a as usize], vertices[b as usize]);
                vertices.push(std::array::from_fn(|k| 0.5 * (p[k] + q[k])));
                vertices.len() as u32 - 1
            })
        });
        let [x, y, z] = middle;
        finer.extend([[f[0], x, z], [f[1], y, x], [f[2], z, y], [x, y, z]]);
    }
    *faces = finer;
}

/// A flat square of side 1 with n x n cells.
pub fn square(n: u32) -> Arc<Mesh> {
    let at = |i: u32| f64::from(i) / f64::from(n);
    let vertices = (0..=n).flat_map(|j| (0..=n).map(move |i| [at(i), at(j), 0.0])).collect();
    let cell = |i: u32, j: u32| {
        let v = j * (n + 1) + i;
        [[v, v + 1, v + n + 2], [v, v + n + 2, v + n + 1]]
    };
    let faces = (0..n).flat_map(|j| (0..n).flat_map(move |i| cell(i, j))).collect();
    Arc::new(Mesh { vertices, faces, ..Mesh::default() })
}
