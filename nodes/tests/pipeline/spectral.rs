//! Laplacian, eigenpairs, reconstruction and its energy.

use std::sync::Arc;

use salient_kernels::adjacency::one_ring;
use salient_nodes::eigensolve::{self, Eigensolve};
use salient_nodes::laplacian::{self, Area, Laplacian};
use salient_nodes::reconstruct::{self, Reconstruct};
use salient_nodes::reconstruction_energy::{self, ReconstructionEnergy};
use salient_sdk::Mesh;

use crate::{basis, creature, defaults, energy, maxima, operator, run, shapes};

#[test]
fn masses_sum_to_the_area_and_rows_to_zero_in_every_variant() {
    let mesh = creature(1, 600);
    for area in [Area::Mixed, Area::Barycentric] {
        for intrinsic_delaunay in [false, true] {
            let params = laplacian::Params { area, intrinsic_delaunay };
            let operator = run::<Laplacian>(&params, &[("mesh", mesh.clone())]).unwrap();
            assert!((operator.0.area() / mesh.area() - 1.0).abs() < 1e-12);
            assert!(operator.0.mass.iter().all(|s| *s > 0.0));
            let rows = (0..operator.0.stiffness.n()).map(|i| operator.0.stiffness.row_sum(i).abs());
            assert!(rows.fold(0.0, f64::max) < 1e-12);
        }
    }
}

#[test]
fn a_sphere_has_the_eigenvalues_of_a_sphere() {
    let basis = basis(&shapes::sphere(4), 25);
    let expected = (0..5).flat_map(|l| std::iter::repeat_n(f64::from(l * (l + 1)), (2 * l + 1) as usize));
    for (k, (found, expected)) in basis.values.iter().zip(expected).enumerate() {
        assert!((found - expected).abs() <= 0.01 * expected, "lambda_{k} is {found}, not {expected}");
    }
    assert_eq!(basis.values[0], 0.0);
    assert_eq!(basis.certificate.expected, basis.certificate.found);
}

#[test]
fn asking_for_more_pairs_than_vertices_says_how_many_there_are() {
    let sphere = shapes::sphere(0);
    let error = run::<Eigensolve>(&eigensolve::Params { pairs: 13 }, &[("operator", operator(&sphere))]).unwrap_err();
    assert!(error.to_string().contains("12"), "{error}");
    assert!(error.help.unwrap().contains("pairs: 12"));
}

#[test]
fn all_eigenfunctions_rebuild_the_shape_exactly() {
    let mesh = creature(0, 400);
    let n = mesh.vertices.len() as u32;
    let basis = basis(&mesh, n);
    let rebuild = |count| {
        run::<Reconstruct>(&reconstruct::Params { count }, &[("mesh", mesh.clone()), ("basis", basis.clone())]).unwrap()
    };
    let error = |rebuilt: &Mesh| {
        let differences = rebuilt.vertices.as_flattened().iter().zip(mesh.vertices.as_flattened());
        differences.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    assert!(error(&rebuild(n)) < 1e-9, "{}", error(&rebuild(n)));
    // Fewer eigenfunctions, a worse shape: the truncation is real.
    assert!(error(&rebuild(100)) > 1e-3 && error(&rebuild(5)) > error(&rebuild(100)));
}

#[test]
fn a_basis_of_another_mesh_is_refused() {
    let (a, b) = (shapes::sphere(1), shapes::sphere(2));
    let basis = basis(&a, 10);
    let params: reconstruction_energy::Params = defaults();
    let error = run::<ReconstructionEnergy>(&params, &[("mesh", b.clone()), ("basis", basis.clone())]).unwrap_err();
    assert!(error.to_string().contains("42") && error.to_string().contains("162"), "{error}");
    assert!(run::<Reconstruct>(&reconstruct::Params { count: 11 }, &[("mesh", a), ("basis", basis)]).is_err());
}

#[test]
fn the_energy_of_a_cluster_does_not_depend_on_its_basis() {
    // The first three functions of a sphere are its coordinates in some frame: over the cluster their
    // energy is the radius everywhere, whatever the frame; alone it depends on the frame.
    let sphere = shapes::sphere(3);
    let basis = basis(&sphere, 9);
    let whole = energy(&sphere, &basis);
    assert_eq!(&whole.first[..1], [1]);
    let radius = whole.cluster(0);
    assert!(radius.iter().all(|e| (e - 1.0).abs() < 1e-3), "{:?}", &radius[..3]);
    // Every other mode has coefficients of rounding size: the floor takes them for what they are.
    assert!(whole.first.len() > 1 && (1..whole.first.len()).all(|c| whole.cluster(c).iter().all(|e| *e == 0.0)));
    // And a constant energy has no strict maximum.
    let alone = reconstruction_energy::Params { cluster: 0.0, ..defaults() };
    let alone = run::<ReconstructionEnergy>(&alone, &[("mesh", sphere.clone()), ("basis", basis.clone())]).unwrap();
    let spread = alone.cluster(0).iter().fold(0.0_f64, |a, b| a.max(*b))
        - alone.cluster(0).iter().fold(1.0_f64, |a, b| a.min(*b));
    assert!(spread > 0.5, "{spread}");
}

#[test]
fn the_energy_is_the_norm_of_the_reconstruction_s_steps() {
    // E(., k) = |P(k + 1) - P(k)| where eigenvalues are simple.
    let mesh = creature(2, 500);
    let basis = basis(&mesh, 30);
    let energy = energy(&mesh, &basis);
    assert_eq!(energy.first.len(), 29, "this creature has simple eigenvalues");
    let rebuild = |count| {
        run::<Reconstruct>(&reconstruct::Params { count }, &[("mesh", mesh.clone()), ("basis", basis.clone())]).unwrap()
    };
    for c in [0, 7, 28] {
        let k = energy.first[c];
        let (before, after) = (rebuild(k), rebuild(k + 1));
        for (i, e) in energy.cluster(c).iter().enumerate() {
            let step: f64 = (0..3).map(|a| (after.vertices[i][a] - before.vertices[i][a]).powi(2)).sum();
            assert!((step.sqrt() - e).abs() < 1e-12);
        }
    }
}

#[test]
fn maxima_are_those_of_the_definition() {
    let mesh = creature(3, 500);
    let basis = basis(&mesh, 40);
    let energy = energy(&mesh, &basis);
    let all = maxima(&mesh, &energy, u32::MAX);
    assert_eq!(all.features.len(), all.found);
    // Straight from the definition, one comparison after the other.
    let ring = one_ring(mesh.vertices.len(), &mesh.faces).unwrap();
    let mut expected = Vec::new();
    for c in 0..energy.first.len() {
        for i in 0..mesh.vertices.len() {
            let e = energy.cluster(c)[i];
            let mut highest = f64::NEG_INFINITY;
            for level in [c.wrapping_sub(1), c, c + 1] {
                if level >= energy.first.len() {
                    continue;
                }
                if level != c {
                    highest = highest.max(energy.cluster(level)[i]);
                }
                for j in ring.row(i) {
                    highest = highest.max(energy.cluster(level)[*j as usize]);
                }
            }
            if e > highest {
                expected.push((i as u32, energy.first[c]));
            }
        }
    }
    let mut found: Vec<_> = all.features.iter().map(|f| (f.vertex, f.k)).collect();
    found.sort_unstable();
    expected.sort_unstable();
    assert!(!found.is_empty());
    assert_eq!(found, expected);
    // The selection is the head of the ranking.
    let best = maxima(&mesh, &energy, 7);
    assert_eq!(best.features, all.features[..7]);
    assert!(all.features.windows(2).all(|w| w[0].energy >= w[1].energy));
    assert_eq!(best.found, all.found);
}

#[test]
fn several_components_have_a_zero_eigenvalue_each_and_no_features_there() {
    let one = creature(0, 400);
    let n = one.vertices.len() as u32;
    let shifted = one.vertices.iter().map(|p| [p[0] + 5.0, p[1], p[2]]);
    let faces = one.faces.iter().map(|f| f.map(|v| v + n));
    let two = Arc::new(Mesh {
        vertices: one.vertices.iter().copied().chain(shifted).collect(),
        faces: one.faces.iter().copied().chain(faces).collect(),
        ..Mesh::default()
    });
    let basis = basis(&two, 22);
    assert_eq!(basis.values[..2], [0.0, 0.0]);
    assert!(basis.values[2] > 1e-6);
    let energy = energy(&two, &basis);
    assert_eq!(energy.first[0], 2);
    assert!(maxima(&two, &energy, 50).features.iter().all(|f| f.k >= 2));
}
