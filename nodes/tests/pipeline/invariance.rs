//! Feature points and descriptors do not depend on where the shape is, how large, or how numbered.

use std::sync::Arc;

use salient_nodes::patch_spectrum::Features;
use salient_sdk::Mesh;

use crate::{creature, features, shuffled};

fn moved(mesh: &Mesh, map: impl Fn([f64; 3]) -> [f64; 3]) -> Arc<Mesh> {
    Arc::new(Mesh { vertices: mesh.vertices.iter().map(|p| map(*p)).collect(), ..mesh.clone() })
}

/// Same features by `vertex` of `a` -> of `b`, in the same order, and the same descriptors.
fn assert_same(a: &Features, b: &Features, vertex: impl Fn(u32) -> u32, tolerance: f64) {
    let points =
        |f: &Features, map: &dyn Fn(u32) -> u32| f.features.iter().map(|f| (map(f.vertex), f.k)).collect::<Vec<_>>();
    assert_eq!(points(a, &vertex), points(b, &|v| v));
    for (x, y) in a.descriptors.iter().zip(&b.descriptors) {
        match (x, y) {
            (Ok(x), Ok(y)) => {
                let error = x.iter().zip(y).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
                assert!(error < tolerance, "descriptors differ by {error:e}");
            }
            (x, y) => assert_eq!(x.is_err(), y.is_err()),
        }
    }
}

#[test]
fn under_rotation_and_translation() {
    let mesh = creature(1, 800);
    // A rotation about (1, 2, 3) by an angle that is no multiple of anything, and a long way to go.
    let (axis, angle) = ([1.0, 2.0, 3.0].map(|x: f64| x / 14.0_f64.sqrt()), 0.7_f64);
    let turn = |p: [f64; 3]| {
        let along = (0..3).map(|i| axis[i] * p[i]).sum::<f64>();
        let cross = [axis[1] * p[2] - axis[2] * p[1], axis[2] * p[0] - axis[0] * p[2], axis[0] * p[1] - axis[1] * p[0]];
        std::array::from_fn(|i| {
            p[i] * angle.cos() + cross[i] * angle.sin() + axis[i] * along * (1.0 - angle.cos()) + [30.0, -20.0, 70.0][i]
        })
    };
    let (here, there) = (features(&mesh, 40), features(&moved(&mesh, turn), 40));
    assert_same(&here, &there, |v| v, 1e-7);
}

#[test]
fn under_scale_over_twelve_orders_of_magnitude() {
    let mesh = creature(1, 800);
    let here = features(&mesh, 40);
    for scale in [1e-6, 1e6] {
        let there = features(&moved(&mesh, |p| p.map(|x| x * scale)), 40);
        assert_same(&here, &there, |v| v, 1e-7);
        for (a, b) in here.features.iter().zip(&there.features) {
            assert!((b.scale / (a.scale * scale) - 1.0).abs() < 1e-8);
            assert!((b.energy / (a.energy * scale) - 1.0).abs() < 1e-8);
        }
    }
}

#[test]
fn under_renumbering_of_vertices_and_faces() {
    let mesh = creature(1, 800);
    let other = shuffled(&mesh, 5);
    let source = other.source.clone().unwrap();
    let mut position = vec![0; source.len()];
    for (new, old) in source.iter().enumerate() {
        position[*old as usize] = new as u32;
    }
    assert_same(&features(&mesh, 40), &features(&other, 40), |v| position[v as usize], 1e-7);
}
