//! Census and repairs on meshes whose defects are known by construction.
#![allow(clippy::unwrap_used)] // Helpers of tests fail by panicking, as tests do.
#![allow(clippy::float_cmp)] // Values taken over unchanged are compared as such.

mod geom;

use geom::{cylinder, permuted, plane, sphere, torus};
use salient_kernels::topology::{self, census};
use std::f64::consts::PI;

#[test]
fn clean_surfaces_have_their_euler_characteristic() {
    for ((vertices, faces), euler, loops, boundary) in
        [(sphere(2), 2, 0, 0), (torus(12, 7), 0, 0, 0), (plane(5, 0.2), 1, 1, 20), (cylinder(9, 4, 2.0, 0.0), 0, 2, 18)]
    {
        let found = census(&vertices, &faces).unwrap();
        assert_eq!(
            (found.euler.as_slice(), found.boundary_loops, found.boundary_edges),
            (&[euler][..], loops, boundary)
        );
        assert_eq!(found.is_closed_manifold(), loops == 0);
        assert!(found.inconsistent_edges.is_empty() && found.duplicate_vertices.is_empty());
    }
}

#[test]
fn defects_are_found_where_they_were_put() {
    let (mut vertices, mut faces) = sphere(1);
    // A fin on edge 0 of face 0; a bow-tie at vertex 7; a zero-area face; a copy of vertex 3 (signed zeros count as equal).
    let n = vertices.len() as u32;
    vertices.extend([
        [3.0, 3.0, 3.0],
        [4.0, 0.0, 0.0],
        [4.0, 1.0, 0.0],
        vertices[3].map(|x| if x == 0.0 { -0.0 } else { x }),
    ]);
    let [a, b, _] = faces[0];
    faces.push([a, b, n]);
    faces.push([7, n + 1, n + 2]);
    faces.push([n + 1, n + 1, n + 2]);
    let found = census(&vertices, &faces).unwrap();
    assert_eq!(found.non_manifold_edges, [[a.min(b), a.max(b)]]);
    assert_eq!(found.non_manifold_vertices, [7]);
    assert_eq!(found.zero_area_faces, [faces.len() as u32 - 1]);
    assert_eq!(found.duplicate_vertices, [[n + 3, 3]]);
    assert_eq!(found.unreferenced_vertices, [n + 3]);
    assert_eq!(found.components.label.iter().max(), Some(&1));
    assert!(!found.is_closed_manifold());
}

#[test]
fn orientation_and_scale() {
    let (vertices, mut faces) = sphere(1);
    faces[5].swap(0, 1);
    assert_eq!(census(&vertices, &faces).unwrap().inconsistent_edges.len(), 3);
    // A needle is no zero-area face at any scale; an exactly flat one is.
    for scale in [1e-9, 1.0, 1e9] {
        let needle = [[0.0; 3], [scale, 0.0, 0.0], [0.5 * scale, 1e-9 * scale, 0.0], [2.0 * scale, 0.0, 0.0]];
        assert_eq!(census(&needle, &[[0, 1, 2], [0, 1, 3]]).unwrap().zero_area_faces, [1]);
    }
}

#[test]
fn touching_loops_are_counted_apart() {
    // Two triangles sharing a vertex: two boundary curves that meet in a point, and a vertex with two fans.
    let vertices = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [-1.0, -1.0, 0.0]];
    let found = census(&vertices, &[[0, 1, 2], [0, 3, 4]]).unwrap();
    assert_eq!((found.boundary_loops, found.boundary_edges, found.non_manifold_vertices), (2, 6, vec![0]));
    assert_eq!(found.components.vertices, [5]);
}

#[test]
fn repairs_say_where_vertices_came_from() {
    // Triangle soup of a sphere and a far smaller one: welding gives both back, closed.
    let ((big, big_faces), (small, small_faces)) = (sphere(2), sphere(0));
    let mut soup: Vec<[f64; 3]> = small_faces.iter().flatten().map(|&v| small[v as usize].map(|x| x * 0.1)).collect();
    soup.extend(big_faces.iter().flatten().map(|&v| big[v as usize]));
    let faces: Vec<[u32; 3]> = (0..soup.len() as u32 / 3).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect();
    let welded = topology::weld(&soup, &faces).unwrap();
    assert_eq!(welded.vertices.len(), 12 + big.len());
    assert!(welded.source.iter().zip(&welded.vertices).all(|(&s, p)| soup[s as usize] == *p));
    let found = census(&welded.vertices, &welded.faces).unwrap();
    assert_eq!((found.euler, found.boundary_edges), (vec![2, 2], 0));
    let largest = topology::largest_component(&welded.vertices, &welded.faces).unwrap();
    assert!(census(&largest.vertices, &largest.faces).unwrap().is_closed_manifold());
    assert_eq!(largest.source[0], 12);
    // Degenerate faces go, then the vertex that only they used.
    let (mut vertices, mut faces) = (largest.vertices.clone(), largest.faces.clone());
    vertices.insert(0, [9.0; 3]);
    faces.iter_mut().flatten().for_each(|v| *v += 1);
    faces.insert(3, [0, 1, 1]);
    let clean = topology::drop_degenerate(&vertices, &faces).unwrap();
    assert_eq!((clean.vertices.len(), clean.faces.len()), (vertices.len(), faces.len() - 1));
    let clean = topology::drop_unreferenced(&clean.vertices, &clean.faces).unwrap();
    assert_eq!((clean.vertices, clean.faces), (largest.vertices, largest.faces));
    assert_eq!(clean.source, (1..=big.len() as u32).collect::<Vec<_>>());
}

#[test]
fn area_and_box() {
    let mesh = sphere(4);
    let area = topology::surface_area(&mesh.0, &mesh.1).unwrap();
    assert!((area / (4.0 * PI) - 1.0).abs() < 0.01 && area < 4.0 * PI);
    let ((vertices, faces), _) = permuted(&mesh, 5);
    assert!((topology::surface_area(&vertices, &faces).unwrap() - area).abs() < 1e-10);
    let (low, high) = topology::bounding_box(&plane(4, 0.0).0).unwrap();
    assert_eq!((low, high), ([-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]));
    assert!(topology::bounding_box(&[]).is_none());
    assert!(census(&[], &[]).unwrap().euler.is_empty());
    assert!(topology::weld(&[[0.0; 3]], &[[0, 0, 9]]).is_err());
}
