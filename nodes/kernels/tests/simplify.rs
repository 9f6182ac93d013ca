//! Decimation: topology, orientation, distance to the original, and independence of the unit of length.
#![allow(clippy::unwrap_used)] // Helpers of tests fail by panicking, as tests do.
#![allow(clippy::float_cmp)] // Values taken over unchanged are compared as such.

mod geom;

use geom::{Mesh, cylinder, permuted, plane, sphere, torus};
use salient_kernels::simplify::{Simplified, simplify};
use salient_kernels::topology::{census, surface_area};

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| a[k] - b[k])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

fn normal([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let (u, v) = (sub(b, a), sub(c, a));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// A sphere with smooth bumps: no symmetry, no flat part.
fn blob(levels: usize) -> Mesh {
    let (vertices, faces) = sphere(levels);
    let bump =
        |p: &[f64; 3]| 1.0 + 0.25 * (3.0 * p[0] + 1.0).sin() * (2.0 * p[1]).cos() + 0.1 * (5.0 * p[2] + 0.3).sin();
    (vertices.iter().map(|p| p.map(|x| x * bump(p))).collect(), faces)
}

fn run(mesh: &Mesh, target: usize) -> Simplified {
    let found = simplify(&mesh.0, &mesh.1, target).unwrap();
    let mut sources = found.source.clone();
    sources.sort_unstable();
    sources.dedup();
    assert_eq!(sources.len(), found.vertices.len());
    assert!(sources.iter().all(|&s| (s as usize) < mesh.0.len()));
    found
}

/// Squared distance from a point to a triangle (Ericson's regions, by projection and clamping of each edge).
fn to_triangle(p: [f64; 3], t: [[f64; 3]; 3]) -> f64 {
    let n = normal(t);
    let inside = (0..3).all(|k| {
        let (a, b) = (t[k], t[(k + 1) % 3]);
        dot(normal([a, b, p]), n) >= 0.0
    });
    if inside && dot(n, n) > 0.0 {
        return dot(sub(p, t[0]), n).powi(2) / dot(n, n);
    }
    let to_edge = |a: [f64; 3], b: [f64; 3]| {
        let (ab, ap) = (sub(b, a), sub(p, a));
        let s = (dot(ap, ab) / dot(ab, ab)).clamp(0.0, 1.0);
        let d = sub(ap, ab.map(|x| x * s));
        dot(d, d)
    };
    to_edge(t[0], t[1]).min(to_edge(t[1], t[2])).min(to_edge(t[2], t[0]))
}

fn greatest_distance(points: &[[f64; 3]], (vertices, faces): (&[[f64; 3]], &[[u32; 3]])) -> f64 {
    let nearest = |p: [f64; 3]| {
        faces.iter().map(|f| to_triangle(p, f.map(|v| vertices[v as usize]))).fold(f64::INFINITY, f64::min)
    };
    points.iter().map(|&p| nearest(p).sqrt()).fold(0.0, f64::max)
}

#[test]
fn closed_surfaces_keep_their_topology() {
    for (mesh, euler) in [(blob(3), 2), (torus(24, 14), 0)] {
        for target in [300, 120, 40] {
            let found = run(&mesh, target);
            assert!(found.reached && found.vertices.len() == target, "{}", found.vertices.len());
            let defects = census(&found.vertices, &found.faces).unwrap();
            assert!(defects.is_closed_manifold() && defects.euler == [euler]);
        }
    }
}

#[test]
fn the_surface_stays_near_and_no_face_is_flipped() {
    let mesh = blob(4);
    let before = surface_area(&mesh.0, &mesh.1).unwrap();
    for (target, far) in [(1000, 0.015), (250, 0.05)] {
        let found = run(&mesh, target);
        let original = greatest_distance(&mesh.0, (&found.vertices, &found.faces));
        let back = greatest_distance(&found.vertices, (&mesh.0, &mesh.1));
        println!("{target}: {original:.4} {back:.4}");
        assert!(original < far && back < far);
        assert!((surface_area(&found.vertices, &found.faces).unwrap() / before - 1.0).abs() < 2.0 * far);
        // The blob is star-shaped: outward faces look away from the origin.
        for f in &found.faces {
            let t = f.map(|v| found.vertices[v as usize]);
            assert!(dot(normal(t), t[0]) > 0.0);
        }
        // Sources are near: within about the new edge length.
        let spacing = (before / target as f64).sqrt();
        for (p, &s) in found.vertices.iter().zip(&found.source) {
            let d = sub(*p, mesh.0[s as usize]);
            assert!(dot(d, d).sqrt() < spacing, "{} {spacing}", dot(d, d).sqrt());
        }
    }
}

#[test]
fn the_unit_of_length_does_not_matter() {
    let mesh = blob(3);
    let one = run(&mesh, 150);
    for unit in [1e-6, 1e6, 1e-3 / 3.0] {
        let scaled = (mesh.0.iter().map(|p| p.map(|x| x * unit)).collect(), mesh.1.clone());
        let other = run(&scaled, 150);
        assert_eq!((&one.faces, &one.source), (&other.faces, &other.source));
        for (p, q) in one.vertices.iter().zip(&other.vertices) {
            assert!((0..3).all(|k| (p[k] - q[k] / unit).abs() < 1e-9));
        }
    }
    assert_eq!(one, run(&mesh, 150));
}

#[test]
fn flat_parts_cost_nothing_and_boundaries_stay() {
    let mesh = plane(20, 0.3);
    let found = run(&mesh, 60);
    assert!(found.reached);
    assert!((surface_area(&found.vertices, &found.faces).unwrap() - 4.0).abs() < 1e-3);
    let defects = census(&found.vertices, &found.faces).unwrap();
    assert_eq!((defects.euler.as_slice(), defects.boundary_loops), (&[1][..], 1));
    assert!(defects.non_manifold_edges.is_empty() && defects.inconsistent_edges.is_empty());
    assert!(found.vertices.iter().all(|p| p[2].abs() < 1e-12));
    for f in &found.faces {
        assert!(normal(f.map(|v| found.vertices[v as usize]))[2] > 0.0);
    }
    let tube = run(&cylinder(24, 12, 3.0, 0.1), 80);
    let defects = census(&tube.vertices, &tube.faces).unwrap();
    assert_eq!((defects.euler.as_slice(), defects.boundary_loops), (&[0][..], 2));
}

#[test]
fn there_is_a_floor() {
    let found = run(&sphere(2), 0);
    assert!(found.vertices.len() >= 4);
    assert_eq!(found.reached, found.vertices.len() == 4);
    assert!(census(&found.vertices, &found.faces).unwrap().is_closed_manifold());
    // Two components of a tetrahedron each cannot shrink: said, not forced.
    let tetrahedron = |x: f64| [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0], [x, 0.0, 1.0]];
    let faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
    let vertices = [tetrahedron(0.0), tetrahedron(5.0)].concat();
    let both: Vec<[u32; 3]> = faces.iter().copied().chain(faces.iter().map(|f| f.map(|v| v + 4))).collect();
    let found = run(&(vertices.clone(), both.clone()), 4);
    assert!(!found.reached && found.vertices == vertices && found.faces == both);
    // Nothing to do, nothing at all, nonsense.
    let mesh = sphere(1);
    assert_eq!(run(&mesh, 1000).vertices, mesh.0);
    assert!(run(&(vec![], vec![]), 10).reached);
    assert!(simplify(&[[f64::NAN; 3]], &[], 5).is_err());
    assert!(simplify(&[[0.0; 3]; 3], &[[0, 1, 1], [0, 1, 2]], 4).is_ok());
}

#[test]
fn broken_meshes_do_not_break_it() {
    // A fin, a bow-tie, a flipped face and a repeated face.
    let (mut vertices, mut faces) = sphere(3);
    let n = vertices.len() as u32;
    vertices.extend([[2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [3.0, 0.0, 0.0]]);
    let [a, b, _] = faces[10];
    faces.extend([[a, b, n], [7, n + 1, n + 2], faces[3]]);
    faces[20].swap(1, 2);
    let found = run(&(vertices, faces), 100);
    assert!(found.vertices.len() < 300);
    let (shuffled, _) = permuted(&blob(3), 3);
    assert!(run(&shuffled, 100).reached);
}
