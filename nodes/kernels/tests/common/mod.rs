//! Procedural meshes and reference computations shared by the tests.
#![allow(dead_code)] // each test binary uses its part

use std::collections::BTreeMap;
use std::f64::consts::TAU;

pub type Mesh = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// The unit sphere: an icosahedron split `levels` times, 10 * 4^levels + 2 vertices.
pub fn icosphere(levels: usize) -> Mesh {
    let g = f64::midpoint(1.0, 5f64.sqrt());
    let mut points = Vec::new();
    for a in [-1.0, 1.0] {
        for b in [-g, g] {
            points.extend([[0.0, a, b], [a, b, 0.0], [b, 0.0, a]]);
        }
    }
    let distance = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    let mut faces = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                let edges = [(i, j), (j, k), (k, i)];
                if edges.iter().all(|&(a, b)| (distance(points[a], points[b]) - 2.0).abs() < 1e-9) {
                    faces.push([i as u32, j as u32, k as u32]);
                }
            }
        }
    }
    for _ in 0..levels {
        let mut middles = BTreeMap::new();
        let mut split = Vec::new();
        for &[a, b, c] in &faces {
            let mut middle = |a: u32, b: u32| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    let (p, q) = (points[a as usize], points[b as usize]);
                    points.push(std::array::from_fn(|i| f64::midpoint(p[i], q[i])));
                    points.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            split.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        faces = split;
    }
    for p in &mut points {
        let norm = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        *p = p.map(|x| x / norm);
    }
    (points, faces)
}

/// A height field over the product of two ascending lists of coordinates; cells are split along alternating diagonals.
pub fn tensor_grid(x: &[f64], y: &[f64], height: impl Fn(f64, f64) -> f64) -> Mesh {
    let points = y.iter().flat_map(|&y| x.iter().map(move |&x| (x, y))).map(|(x, y)| [x, y, height(x, y)]).collect();
    let mut faces = Vec::new();
    for j in 0..y.len() - 1 {
        for i in 0..x.len() - 1 {
            let a = (j * x.len() + i) as u32;
            let (b, c, d) = (a + 1, a + x.len() as u32, a + 1 + x.len() as u32);
            faces.extend(if (i + j) % 2 == 0 { [[a, b, d], [a, d, c]] } else { [[a, b, c], [b, d, c]] });
        }
    }
    (points, faces)
}

/// `cells + 1` equidistant coordinates from 0 to `length`.
pub fn uniform(cells: usize, length: f64) -> Vec<f64> {
    (0..=cells).map(|i| length * i as f64 / cells as f64).collect()
}

/// A torus of p x q vertices whose tube is modulated, so that no eigenvalue is multiple.
pub fn bumpy_torus(p: usize, q: usize) -> Mesh {
    let mut points = Vec::new();
    for j in 0..q {
        for i in 0..p {
            let (u, v) = (TAU * i as f64 / p as f64, TAU * j as f64 / q as f64);
            let tube = 0.4 * (1.0 + 0.2 * (3.0 * u).sin() * (2.0 * v).cos() + 0.1 * (u + v).cos());
            points.push([(1.0 + tube * v.cos()) * u.cos(), (1.0 + tube * v.cos()) * u.sin(), tube * v.sin()]);
        }
    }
    (points, periodic_faces(p, q, 0))
}

/// Faces of a p x q grid with both directions periodic; row j + 1 is joined to row j with a shift of `shear` columns.
pub fn periodic_faces(p: usize, q: usize, shear: usize) -> Vec<[u32; 3]> {
    let at = |i: usize, j: usize| ((j % q) * p + i % p) as u32;
    let mut faces = Vec::new();
    for j in 0..q {
        for i in 0..p {
            let (a, b) = (at(i, j), at(i + 1, j));
            let (d, c) = (at(i + shear, j + 1), at(i + shear + 1, j + 1));
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    faces
}

/// Edge lengths for [`periodic_faces`] on the flat torus of cells hx x hy, opposite each corner.
pub fn periodic_lengths(p: usize, q: usize, shear: usize, hx: f64, hy: f64) -> Vec<[f64; 3]> {
    let (ac, ad) = ((hx * (shear + 1) as f64).hypot(hy), (hx * shear as f64).hypot(hy));
    // Corners a, b, c: opposite a is b-c, parallel to a-d. Corners a, c, d: opposite a is c-d, of length hx.
    (0..p * q).flat_map(|_| [[ad, ac, hx], [hx, ad, ac]]).collect()
}

/// The exact eigenvalues of the p x q five-point stencil on the flat torus, ascending.
pub fn flat_torus_values(p: usize, q: usize, hx: f64, hy: f64) -> Vec<f64> {
    let one = |i: usize, n: usize, h: f64| (2.0 / h * (TAU * i as f64 / n as f64 / 2.0).sin()).powi(2);
    let mut values: Vec<f64> = (0..p).flat_map(|i| (0..q).map(move |j| one(i, p, hx) + one(j, q, hy))).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The exact eigenvalues of the five-point stencil on a rectangle, with free (from index 0) or fixed (from index 1) sides.
pub fn rectangle_values(p: usize, q: usize, hx: f64, hy: f64, fixed: bool) -> Vec<f64> {
    let one = |i: usize, n: usize, h: f64| (2.0 / h * (TAU * i as f64 / n as f64 / 4.0).sin()).powi(2);
    let range = |n: usize| if fixed { 1..n } else { 0..n + 1 };
    let mut values: Vec<f64> = range(p).flat_map(|i| range(q).map(move |j| one(i, p, hx) + one(j, q, hy))).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Two meshes side by side, as one.
pub fn union(a: &Mesh, b: &Mesh) -> Mesh {
    let offset = a.0.len() as u32;
    let points = a.0.iter().chain(&b.0).copied().collect();
    let faces = a.1.iter().copied().chain(b.1.iter().map(|f| f.map(|v| v + offset))).collect();
    (points, faces)
}

pub fn scaled(mesh: &Mesh, factor: f64) -> Mesh {
    (mesh.0.iter().map(|p| p.map(|x| factor * x)).collect(), mesh.1.clone())
}

/// Numbers in [-1/2, 1/2) that only look random.
pub fn noise(i: usize) -> f64 {
    let mut z = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((z ^ (z >> 32)) >> 11) as f64 / (1u64 << 53) as f64 - 0.5
}

/// A rectangle with jittered inner vertices and hills.
pub fn rough_patch(p: usize, q: usize) -> Mesh {
    let (mut points, faces) =
        tensor_grid(&uniform(p, 1.3), &uniform(q, 1.0), |x, y| 0.2 * (5.0 * x).sin() * (4.0 * y).cos());
    for (i, point) in points.iter_mut().enumerate() {
        point[0] += 0.5 * noise(3 * i) / p as f64;
        point[1] += 0.5 * noise(3 * i + 1) / q as f64;
        point[2] += 0.5 * noise(3 * i + 2) / q as f64;
    }
    (points, faces)
}

/// Eigenvalues, ascending, of a small symmetric matrix by cyclic Jacobi rotations: slow, simple, independent of the code under test.
pub fn jacobi_eigenvalues(mut a: Vec<Vec<f64>>) -> Vec<f64> {
    let n = a.len();
    for _ in 0..60 {
        for p in 0..n {
            for q in p + 1..n {
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = if theta == 0.0 { 1.0 } else { theta.signum() / (theta.abs() + theta.hypot(1.0)) };
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for row in &mut a {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                let (above, below) = a.split_at_mut(q);
                for (x, y) in above[p].iter_mut().zip(&mut below[0]) {
                    (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
                }
            }
        }
    }
    let mut values: Vec<f64> = (0..n).map(|i| a[i][i]).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Each value within `tolerance` of the expected one, relative to it.
#[track_caller]
pub fn assert_close(values: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(values.len(), expected.len());
    for (i, (a, b)) in values.iter().zip(expected).enumerate() {
        assert!(
            (a - b).abs() <= tolerance * b.abs(),
            "value {i}: {a} is not {b}, relative error {:e}",
            (a - b).abs() / b.abs()
        );
    }
}
