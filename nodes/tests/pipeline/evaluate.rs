//! Ground truth: synthesised, by index, by template; and nodes that carry it along.

use std::sync::Arc;

use salient_nodes::cut::{self, Cut};
use salient_nodes::evaluate_match::{self, EvaluateMatch, Evaluation, Mirror};
use salient_nodes::iqp_match::{Match, Pair};
use salient_nodes::simplify::{self, Simplify};
use salient_sdk::{AnyArtefact, Mesh, NodeError};

use crate::{creature, defaults, features, matched, run, shapes, shuffled};

pub fn pairs(of: impl Iterator<Item = (u32, u32)>) -> Arc<Match> {
    let pair = |(i, (left_vertex, right_vertex)): (usize, (u32, u32))| Pair {
        left: i,
        right: i,
        left_vertex,
        right_vertex,
        descriptor_distance: 0.0,
    };
    let pairs: Vec<Pair> = of.enumerate().map(pair).collect();
    let n = pairs.len();
    Arc::new(Match {
        pairs,
        objective: 1.0,
        bound: 1.0,
        gap: 0.0,
        proved: true,
        stopped: "proved".into(),
        heuristic: 1.0,
        features: [n, n],
        candidates: n,
        sigmas: [1.0; 3],
        stretch: 1.0,
        twin: None,
        others: Vec::new(),
        orientation: None,
    })
}

fn evaluate(
    m: &Arc<Match>,
    left: &Arc<Mesh>,
    right: &Arc<Mesh>,
    template: Option<&Arc<Mesh>>,
    mirror: Mirror,
) -> Result<Arc<Evaluation>, NodeError> {
    let mut wires: Vec<(&str, Arc<dyn AnyArtefact>)> =
        vec![("match", m.clone()), ("left", left.clone()), ("right", right.clone())];
    if let Some(template) = template {
        wires.push(("template", template.clone()));
    }
    run::<EvaluateMatch>(&evaluate_match::Params { mirror, ..defaults() }, &wires)
}

#[test]
fn errors_on_a_flat_square_are_the_distances_there() {
    // Side 1, so sqrt(area) = 1 and an error is a length; along an edge the path is exact.
    let square = shapes::square(25);
    let m = pairs([(0, 0), (0, 1), (0, 2), (0, 5), (0, 10)].into_iter());
    let e = evaluate(&m, &square, &square, None, Mirror::Never).unwrap();
    let errors: Vec<f64> = e.pairs.iter().map(|p| p.error.unwrap()).collect();
    for (found, expected) in errors.iter().zip([0.0, 0.04, 0.08, 0.2, 0.4]) {
        assert!((found - expected).abs() < 1e-12);
    }
    let plain = e.plain.clone().unwrap();
    assert_eq!((plain.within_5, plain.within_10, plain.within_25), (0.4, 0.6, 0.8));
    assert!((plain.median.unwrap() - 0.08).abs() < 1e-12);
    // One error of 0, one up to 4, 8 and 20 %; 40 % is off the curve. The area is the mean of what is left of 25 %.
    assert_eq!([0, 3, 4, 8, 19, 20, 25].map(|i| plain.curve[i]), [0.2, 0.2, 0.4, 0.6, 0.6, 0.8, 0.8]);
    assert!((plain.auc - (1.0 + 0.84 + 0.68 + 0.2 + 0.0) / 5.0).abs() < 1e-12);
    assert_eq!((e.truth.as_str(), e.symmetric.is_none()), ("shared_index", true));
}

#[test]
fn mirrored_matches_are_right_up_to_symmetry_and_only_there() {
    let square = shapes::square(10);
    let template = square.clone();
    let twin = |v: u32| (v / 11) * 11 + (10 - v % 11);
    let m = pairs((0..121).filter(|v| v % 11 < 4).map(|v| (v, twin(v))));
    let e = evaluate(&m, &square, &square, Some(&template), Mirror::Auto).unwrap();
    assert_eq!(e.mirror.as_deref(), Some("X"));
    assert_eq!(e.symmetric.clone().unwrap().within_5, 1.0);
    assert_eq!(e.plain.clone().unwrap().within_10, 0.0);
    assert_eq!(e.truth, "template");
}

#[test]
fn a_match_through_a_renumbering_is_scored_through_it() {
    let mesh = creature(1, 500);
    let other = shuffled(&mesh, 3);
    let source = other.source.clone().unwrap();
    let m = pairs((0..50).map(|j| (source[j as usize], j)));
    for mesh in [mesh.clone(), Arc::new(Mesh { reference: None, ..(*mesh).clone() })] {
        let e = evaluate(&m, &mesh, &other, None, Mirror::Never).unwrap();
        assert_eq!(e.plain.clone().unwrap().within_5, 1.0, "{}", e.truth);
    }
}

#[test]
fn meshes_of_different_resolution_are_compared_on_their_faces() {
    // The same square in 7 x 7 and in 24 x 24 cells: no vertex but the corners has a partner, yet every true place is known exactly.
    let (fine, coarse) = (shapes::square(24), shapes::square(7));
    let own = |m: &Arc<Mesh>| Arc::new(Mesh { reference: Some(m.vertices.clone()), ..(**m).clone() });
    let (fine, coarse) = (own(&fine), own(&coarse));
    let m = pairs((0..fine.vertices.len() as u32).map(|v| (v, 0)));
    let e = evaluate(&m, &fine, &coarse, None, Mirror::Never).unwrap();
    let at = |v: u32| fine.vertices[v as usize];
    for p in &e.pairs {
        let straight = at(p.left_vertex).iter().map(|x| x * x).sum::<f64>().sqrt();
        let error = p.error.unwrap();
        // Paths over the coarse mesh are up to 5.5 % longer, and interpolation adds up to a fraction of a cell.
        assert!(error > straight - 1e-9 && error < 1.055 * straight + 0.05, "{error} {straight}");
        let nearest = coarse.vertices[p.true_vertex.unwrap() as usize];
        assert!((0..2).all(|i| (nearest[i] - at(p.left_vertex)[i]).abs() <= 1.0 / 7.0));
    }
}

#[test]
fn meshes_without_a_common_truth_are_refused() {
    let (a, b) = (shapes::sphere(1), shapes::sphere(2));
    let error = evaluate(&pairs([(0, 0)].into_iter()), &a, &b, None, Mirror::Auto).unwrap_err();
    assert!(error.to_string().contains("no ground truth") && error.help.is_some());
    let error = evaluate(&pairs([(0, 5000)].into_iter()), &a, &b, None, Mirror::Auto).unwrap_err();
    assert!(error.to_string().contains("5000"));
}

#[test]
fn nothing_matched_has_no_figures() {
    let square = shapes::square(2);
    let e = evaluate(&pairs(std::iter::empty()), &square, &square, None, Mirror::Never).unwrap();
    assert!(e.plain.is_none() && e.matched == 0);
}

#[test]
fn a_piece_has_its_share_of_the_area_and_keeps_the_truth() {
    let whole = creature(0, 1500);
    for keep in [0.3, 0.7] {
        let params = cut::Params { keep, toward: [0.0, 0.0, 1.0] };
        let piece = run::<Cut>(&params, &[("mesh", whole.clone())]).unwrap();
        assert!((piece.area() / whole.area() - keep).abs() < 0.02, "{}", piece.area() / whole.area());
        for (v, old) in piece.source.clone().unwrap().iter().enumerate() {
            assert_eq!(piece.vertices[v], whole.vertices[*old as usize]);
            assert_eq!(piece.reference.as_ref().unwrap()[v], whole.reference.as_ref().unwrap()[*old as usize]);
        }
        let highest = |m: &Mesh| m.vertices.iter().map(|p| p[2]).fold(f64::MIN, f64::max);
        assert_eq!(highest(&piece), highest(&whole));
    }
}

#[test]
fn a_decimated_shape_keeps_its_area_and_the_truth() {
    let fine = creature(0, 1500);
    let coarse = run::<Simplify>(&simplify::Params { vertices: 700 }, &[("mesh", fine.clone())]).unwrap();
    assert_eq!(coarse.vertices.len(), 700);
    assert!((coarse.area() / fine.area() - 1.0).abs() < 0.02);
    let edge = (fine.area() / 700.0).sqrt();
    for (p, old) in coarse.vertices.iter().zip(coarse.source.as_ref().unwrap()) {
        let q = fine.vertices[*old as usize];
        let distance = (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>().sqrt();
        assert!(distance < 2.0 * edge);
    }
}

#[test]
fn two_poses_meshed_apart_match_where_they_should() {
    // The whole pipeline, at a size that tests can afford. Chance is below 5 % here.
    let (a, b) = (creature(0, 1200), creature(1, 1200));
    let m = matched(&features(&a, 40), &features(&b, 40), &defaults());
    let e = evaluate(&m, &a, &b, None, Mirror::Auto).unwrap();
    assert_eq!(e.mirror.as_deref(), Some("X"));
    let symmetric = e.symmetric.clone().unwrap();
    assert!(m.pairs.len() >= 30);
    assert!(symmetric.within_10 > 0.6, "{symmetric:?}");
}
