//! Mirror twins, and which of two is the right one.

use std::sync::Arc;

use salient_nodes::evaluate_match::{self, EvaluateMatch};
use salient_nodes::iqp_match::Match;
use salient_nodes::orient_match::OrientMatch;
use salient_sdk::Mesh;

use crate::{creature, defaults, evaluate::pairs, features, matched, run, shuffled};

fn oriented(m: &Arc<Match>, left: &Arc<Mesh>, right: &Arc<Mesh>) -> Arc<Match> {
    let wires = [("match", m.clone() as _), ("left", left.clone() as _), ("right", right.clone() as _)];
    run::<OrientMatch>(&defaults(), &wires).unwrap()
}

/// The shape as a mirror shows it, faces still counterclockwise from outside.
fn reflected(mesh: &Arc<Mesh>) -> Arc<Mesh> {
    let vertices = mesh.vertices.iter().map(|p| [-p[0], p[1], p[2]]).collect();
    Arc::new(Mesh { vertices, faces: mesh.faces.iter().map(|f| [f[0], f[2], f[1]]).collect(), ..Mesh::default() })
}

#[test]
fn vertex_by_vertex_a_copy_keeps_orientation_and_a_reflection_reverses_it() {
    let mesh = creature(1, 600);
    let same = pairs((0..600).step_by(7).map(|v| (v, v)));
    let own = |right: &Arc<Mesh>| oriented(&same, &mesh, right).orientation.unwrap().own;
    assert!((own(&mesh) - 1.0).abs() < 1e-12);
    assert!((own(&reflected(&mesh)) + 1.0).abs() < 1e-12);
    assert_eq!(oriented(&pairs(std::iter::empty()), &mesh, &mesh).orientation.unwrap().own, 0.0);
}

#[test]
fn the_twin_is_the_mirror_image_and_the_right_one_of_the_two_is_chosen() {
    for pose in [0, 2] {
        let (a, b) = (creature(0, 1200), creature(pose, 1200));
        let b = shuffled(&b, 5);
        let found = matched(&features(&a, 40), &features(&b, 40), &defaults());
        let twin = found.twin.clone().unwrap();
        assert!(twin.objective > 0.9 * found.objective && twin.moved > 0.3, "{} {}", twin.objective, twin.moved);
        let chosen = oriented(&found, &a, &b);
        let o = chosen.orientation.unwrap();
        assert!(o.own > 0.5 && o.twin.unwrap() < -0.5, "{o:?}");
        let other = Arc::new(Match { pairs: chosen.twin.clone().unwrap().pairs, ..(*chosen).clone() });
        let scored = |m: &Arc<Match>| {
            let wires = [("match", m.clone() as _), ("left", a.clone() as _), ("right", b.clone() as _)];
            run::<EvaluateMatch>(&defaults::<evaluate_match::Params>(), &wires).unwrap()
        };
        let (right, mirrored) = (scored(&chosen), scored(&other));
        let (right, up) = (right.plain.clone().unwrap(), mirrored.symmetric.clone().unwrap());
        let plain = mirrored.plain.clone().unwrap();
        assert!(right.within_10 > 0.8, "{right:?}");
        assert!(up.within_10 > 0.8 && plain.within_10 < 0.7, "{up:?} {plain:?}");
    }
}

#[test]
fn an_exchange_keeps_the_bound_and_claims_no_proof() {
    let a = creature(0, 800);
    // Matched to its reflection, a symmetric shape's own vertex order is the mirrored match.
    let b = reflected(&a);
    let found = matched(&features(&a, 30), &features(&b, 30), &defaults());
    let chosen = oriented(&found, &a, &b);
    let o = chosen.orientation.unwrap();
    assert!(o.own > o.twin.unwrap());
    let apart = |p: &salient_nodes::iqp_match::Pair| {
        let (x, y) = (a.vertices[p.left_vertex as usize], b.vertices[p.right_vertex as usize]);
        (0..3).map(|i| (x[i] - y[i]).powi(2)).sum::<f64>().sqrt() / a.area().sqrt()
    };
    let right = chosen.pairs.iter().filter(|p| apart(p) < 0.1).count();
    assert!(right * 10 > chosen.pairs.len() * 8, "{right} of {}", chosen.pairs.len());
    assert!(o.exchanged && !chosen.proved && chosen.objective <= chosen.bound);
    assert_eq!(chosen.twin.clone().unwrap().pairs, found.pairs);
    assert!((chosen.gap - (chosen.bound - chosen.objective)).abs() < 1e-12);
    let twin = found.twin.as_ref().unwrap();
    assert_eq!((chosen.objective, chosen.heuristic), (twin.objective, twin.objective));
    assert_eq!(chosen.twin.as_ref().unwrap().objective, found.objective);
    // What lay apart from the mirrored match need not lie apart from the right one, and the other way round.
    for other in &chosen.others {
        let own = |left: usize| chosen.pairs.iter().find(|p| p.left == left);
        let both: Vec<_> = other.pairs.iter().filter_map(|p| Some((p, own(p.left)?))).collect();
        let straight = |p: u32, q: u32| {
            let (x, y) = (b.vertices[p as usize], b.vertices[q as usize]);
            (0..3).map(|i| (x[i] - y[i]).powi(2)).sum::<f64>().sqrt() / b.area().sqrt()
        };
        // What lies apart in space does so on the surface.
        let apart = both.iter().filter(|(p, own)| straight(p.right_vertex, own.right_vertex) > 0.2).count();
        let same = both.iter().filter(|(p, own)| p.right_vertex == own.right_vertex).count();
        let n = both.len() as f64;
        assert!(other.moved * n >= apart as f64 - 1e-9 && other.moved * n <= n - same as f64 + 1e-9);
    }
}
