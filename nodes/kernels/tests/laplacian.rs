//! The cotangent Laplacian: invariants, exact stencils, intrinsic Delaunay flips, refusals.

mod common;

use common::*;
use salient_kernels::laplacian::{Area, LaplacianError, Operator, laplacian, laplacian_from_lengths};

fn mesh_area((points, faces): &Mesh) -> f64 {
    let area = |f: &[u32; 3]| {
        let [a, b, c] = f.map(|v| points[v as usize]);
        let (u, v): ([f64; 3], [f64; 3]) = (std::array::from_fn(|i| b[i] - a[i]), std::array::from_fn(|i| c[i] - a[i]));
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        0.5 * n.iter().map(|x| x * x).sum::<f64>().sqrt()
    };
    faces.iter().map(area).sum()
}

#[track_caller]
fn assert_invariants(operator: &Operator, area: f64, tolerance: f64) {
    let m = &operator.stiffness;
    for i in 0..m.n() {
        for (j, value) in m.row(i) {
            assert_eq!(m.get(j, i).map(f64::to_bits), Some(value.to_bits()), "symmetry at {i}, {j}");
        }
        assert!(m.row_sum(i) == 0.0, "row {i} sums to {}", m.row_sum(i));
        assert!(operator.mass[i] > 0.0);
    }
    assert!((operator.area() - area).abs() <= tolerance * area, "{} is not {area}", operator.area());
}

#[test]
fn invariants_hold_on_every_kind_of_mesh() {
    let sliver = tensor_grid(&[0.0, 1e-6, 0.5, 1.0], &uniform(7, 1.0), |_, _| 0.0);
    for mesh in
        [icosphere(2), bumpy_torus(24, 10), rough_patch(13, 9), union(&icosphere(1), &rough_patch(5, 4)), sliver]
    {
        for scale in [1e-6, 1.0, 1e6] {
            let mesh = scaled(&mesh, scale);
            for area in [Area::Mixed, Area::Barycentric] {
                for intrinsic in [false, true] {
                    let operator = laplacian(&mesh.0, &mesh.1, area, intrinsic).expect("a good mesh");
                    assert_invariants(&operator, mesh_area(&mesh), 1e-10);
                }
            }
        }
    }
}

#[test]
fn cotangents_and_areas_of_one_triangle_by_hand() {
    // The corners' scalar products are 4, 12 and 6, the cross product 12.
    let points = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [1.0, 3.0, 0.0]];
    let operator = laplacian(&points, &[[0, 1, 2]], Area::Mixed, false).expect("one triangle");
    let cot = [4.0 / 12.0, 12.0 / 12.0, 6.0 / 12.0];
    let at = |i, j| operator.stiffness.get(i, j).expect("dense");
    assert_close(&[at(1, 2), at(0, 2), at(0, 1)], &[-cot[0] / 2.0, -cot[1] / 2.0, -cot[2] / 2.0], 1e-15);
    // Voronoi cells: squared edges 18, 10, 16 opposite the corners.
    let expected = [(10.0 + 16.0 * 0.5) / 8.0, (16.0 * 0.5 + 18.0 / 3.0) / 8.0, (18.0 / 3.0 + 10.0) / 8.0];
    assert_close(&operator.mass, &expected, 1e-15);
    let obtuse = laplacian(&[[0.0; 3], [4.0, 0.0, 0.0], [1.0, 1.0, 0.0]], &[[0, 1, 2]], Area::Mixed, false)
        .expect("one triangle");
    assert_close(&obtuse.mass, &[0.5, 0.5, 1.0], 1e-15);
    let thirds = laplacian(&points, &[[0, 1, 2]], Area::Barycentric, false).expect("one triangle");
    assert_close(&thirds.mass, &[2.0, 2.0, 2.0], 1e-15);
}

#[test]
fn linear_functions_are_harmonic_in_the_plane() {
    let (points, faces) = rough_patch(12, 9);
    let flat: Vec<[f64; 3]> = points.iter().map(|p| [p[0], p[1], 0.0]).collect();
    for intrinsic in [false, true] {
        let operator = laplacian(&flat, &faces, Area::Mixed, intrinsic).expect("a good mesh");
        let f: Vec<f64> = flat.iter().map(|p| 2.0 * p[0] - 3.0 * p[1]).collect();
        let mf = operator.stiffness.multiply(&f);
        for j in 1..9 {
            for i in 1..12 {
                assert!(mf[j * 13 + i].abs() < 1e-12, "vertex {i}, {j}: {}", mf[j * 13 + i]);
            }
        }
        // Dirichlet energy of a linear function is the squared slope times the area.
        let energy: f64 = f.iter().zip(&mf).map(|(a, b)| a * b).sum();
        assert_close(&[energy], &[13.0 * operator.area()], 1e-12);
    }
}

#[test]
fn flips_undo_any_shear_of_a_flat_torus() {
    // However sheared, the intrinsic Delaunay triangulation of the square lattice has the five-point stencil; passing there, two vertices
    // are joined by several edges.
    for (p, q, shear) in [(9, 7, 3), (11, 3, 4), (13, 5, 5), (23, 4, 10)] {
        let faces = periodic_faces(p, q, shear);
        let lengths = periodic_lengths(p, q, shear, 1.0, 1.0);
        let flipped = laplacian_from_lengths(p * q, &faces, &lengths, Area::Mixed, true).expect("a good mesh");
        assert_invariants(&flipped, (p * q) as f64, 1e-12);
        assert_close(&flipped.mass, &vec![1.0; p * q], 1e-9);
        for j in 0..q {
            for i in 0..p {
                let row: f64 = flipped.stiffness.row(j * p + i).map(|e| e.1.abs()).sum();
                assert!((row - 8.0).abs() < 1e-8, "vertex {i}, {j}: {row}");
                assert!((flipped.stiffness.diagonal(j * p + i) - 4.0).abs() < 1e-8);
            }
        }
    }
}

#[test]
fn delaunay_weights_are_never_negative() {
    for mesh in [rough_patch(20, 15), bumpy_torus(40, 7)] {
        let plain = laplacian(&mesh.0, &mesh.1, Area::Mixed, false).expect("a good mesh");
        let flipped = laplacian(&mesh.0, &mesh.1, Area::Mixed, true).expect("a good mesh");
        // Boundary edges may stay negative: they cannot be flipped. Inner ones have two faces.
        let boundary = |i: usize, j: usize| {
            let has = |f: &&[u32; 3]| f.contains(&(i as u32)) && f.contains(&(j as u32));
            mesh.1.iter().filter(has).count() == 1
        };
        let positive = |operator: &Operator| {
            let entries =
                (0..operator.stiffness.n()).flat_map(|i| operator.stiffness.row(i).map(move |(j, v)| (i, j, v)));
            entries.filter(|&(i, j, v)| i != j && v > 1e-9 && !boundary(i, j)).count()
        };
        assert!(positive(&plain) > 0, "the mesh should need flips");
        assert_eq!(positive(&flipped), 0);
    }
}

#[test]
fn orientation_does_not_matter() {
    let (points, mut faces) = bumpy_torus(20, 9);
    let before = laplacian(&points, &faces, Area::Mixed, true).expect("a good mesh");
    for face in faces.iter_mut().step_by(3) {
        face.swap(0, 2);
    }
    let after = laplacian(&points, &faces, Area::Mixed, true).expect("faces are turned over");
    assert_close(&after.mass, &before.mass, 1e-12);
    for i in 0..points.len() {
        assert_close(&[after.stiffness.diagonal(i)], &[before.stiffness.diagonal(i)], 1e-12);
    }
}

#[test]
fn bad_meshes_are_refused_by_index() {
    let square = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 1.0]];
    let refused = |points: &[[f64; 3]], faces: &[[u32; 3]], intrinsic| {
        laplacian(points, faces, Area::Mixed, intrinsic).unwrap_err()
    };
    for intrinsic in [false, true] {
        assert_eq!(refused(&square, &[], intrinsic), LaplacianError::Empty);
        assert_eq!(refused(&square, &[[0, 1, 2]], intrinsic), LaplacianError::UnreferencedVertex { vertex: 3 });
        assert_eq!(
            refused(&square, &[[0, 1, 4], [0, 1, 9]], intrinsic),
            LaplacianError::IndexOutOfRange { face: 1, vertex: 9 }
        );
        assert_eq!(refused(&square, &[[0, 1, 4], [0, 2, 2]], intrinsic), LaplacianError::RepeatedVertex { face: 1 });
        let flat = [[0.0; 3], [1.0; 3], [2.0; 3]];
        assert_eq!(refused(&flat, &[[0, 1, 2]], intrinsic), LaplacianError::ZeroAreaFace { face: 0 });
        let infinite = [[0.0; 3], [1.0, f64::INFINITY, 0.0], [2.0; 3]];
        assert_eq!(refused(&infinite, &[[0, 1, 2]], intrinsic), LaplacianError::NonFinite { vertex: 1 });
    }
    let fan = [[0, 1, 2], [0, 1, 3], [1, 0, 4]];
    assert_eq!(refused(&square, &fan, true), LaplacianError::NonManifoldEdge { vertices: [0, 1], faces: 3 });
    let plain = laplacian(&square, &fan, Area::Mixed, false).expect("fine without flips");
    assert_invariants(&plain, mesh_area(&(square.clone(), fan.to_vec())), 1e-14);
    let lengths = laplacian_from_lengths(3, &[[0, 1, 2]], &[], Area::Mixed, false);
    assert_eq!(lengths, Err(LaplacianError::LengthCount { faces: 1, lengths: 0 }));
    let impossible = laplacian_from_lengths(3, &[[0, 1, 2]], &[[1.0, 1.0, 3.0]], Area::Mixed, false);
    assert_eq!(impossible, Err(LaplacianError::ZeroAreaFace { face: 0 }));
}

#[test]
fn a_moebius_band_has_no_delaunay_orientation() {
    // Five triangles i, i+1, i+2 modulo 5.
    let points: Vec<[f64; 3]> = (0..5).map(|i| [noise(3 * i), noise(3 * i + 1), noise(3 * i + 2)]).collect();
    let faces: Vec<[u32; 3]> = (0..5).map(|i| [i, (i + 1) % 5, (i + 2) % 5]).collect();
    assert!(matches!(laplacian(&points, &faces, Area::Mixed, true), Err(LaplacianError::NotOrientable { .. })));
    assert!(laplacian(&points, &faces, Area::Mixed, false).is_ok());
}
