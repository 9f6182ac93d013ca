//! The correspondence of features.

use salient_nodes::cut::{self, Cut};
use salient_nodes::iqp_match::{self, Kernel, Limit, Unit};

use crate::{creature, defaults, features, matched, run, shuffled};

#[test]
fn a_shape_matches_its_renumbered_self_vertex_by_vertex() {
    let mesh = creature(1, 800);
    let other = shuffled(&mesh, 9);
    let source = other.source.clone().unwrap();
    let m = matched(&features(&mesh, 30), &features(&other, 30), &defaults());
    assert_eq!(m.pairs.len(), 30);
    // The optimum may be the mirror image, which is as good; descriptors then still agree closely.
    let right = m.pairs.iter().filter(|p| source[p.right_vertex as usize] == p.left_vertex).count();
    assert!(right == 30, "{right} of 30");
    assert!(m.proved && m.gap <= 1e-9 * m.objective);
}

#[test]
fn the_bound_holds_and_the_gap_is_their_difference() {
    let (a, b) = (features(&creature(0, 800), 30), features(&creature(4, 800), 30));
    let mut bounds = Vec::new();
    for nodes in [0, 1, 50] {
        let m = matched(&a, &b, &iqp_match::Params { limit: Limit::Nodes(nodes), ..defaults() });
        assert!(m.objective <= m.bound && (m.gap - (m.bound - m.objective)).abs() < 1e-9);
        assert!(m.heuristic <= m.objective + 1e-9);
        assert!(m.proved == (m.stopped == "proved"));
        bounds.push((m.objective, m.bound));
    }
    let best = bounds.iter().map(|b| b.0).fold(0.0, f64::max);
    assert!(bounds.iter().all(|b| b.1 >= best - 1e-9));
}

#[test]
fn the_objective_is_the_one_of_the_paper() {
    // Recomputed here from the pairs alone: x' H x counts each pair twice, plus beta C x.
    let (a, b) = (features(&creature(0, 800), 20), features(&creature(1, 800), 20));
    let params = iqp_match::Params { beta: 3.0, unmatched: 0.25, ..defaults() };
    let m = matched(&a, &b, &params);
    let [sd, sg, ss] = m.sigmas;
    let kernel = |d: f64, sigma: f64| (-0.5 * (d / sigma).powi(2)).exp();
    let relative = |f: &salient_nodes::patch_spectrum::Features, i: usize, p: usize| {
        f.distance(i, p).unwrap() / (f.features[i].scale * f.features[p].scale).sqrt()
    };
    let ratio = |f: &salient_nodes::patch_spectrum::Features, i: usize, p: usize| {
        (f.features[i].scale / f.features[p].scale).ln()
    };
    let mut objective = 0.0;
    for x in &m.pairs {
        objective += 3.0 * kernel(x.descriptor_distance, sd);
        for y in m.pairs.iter().filter(|y| y.left != x.left) {
            let g = relative(&a, x.left, y.left) - relative(&b, x.right, y.right);
            let s = ratio(&a, x.left, y.left) - ratio(&b, x.right, y.right);
            objective += kernel(g, sg) * kernel(s, ss);
        }
    }
    objective -= 0.25 * (40 - 2 * m.pairs.len()) as f64;
    assert!((objective - m.objective).abs() < 1e-8 * objective, "{objective} {}", m.objective);
}

#[test]
fn rewarding_unmatched_features_rejects_weak_matches() {
    // A piece has features that the whole lacks, and the other way round.
    let (whole, moved) = (creature(0, 800), creature(3, 800));
    let piece = run::<Cut>(&cut::Params { keep: 0.6, ..defaults() }, &[("mesh", moved)]).unwrap();
    let (a, b) = (features(&piece, 40), features(&whole, 40));
    let shared = iqp_match::Params { unit: Unit::Length, sigma_geodesic: Some(0.05), ..defaults() };
    let with = |unmatched| matched(&a, &b, &iqp_match::Params { unmatched, ..shared.clone() }).pairs.len();
    let counts: Vec<usize> = [0.0, -2.0, -3.0, -4.0, -100.0].map(with).to_vec();
    assert!(counts.is_sorted_by(|a, b| a >= b), "{counts:?}");
    assert!(counts.iter().any(|n| (1..counts[0]).contains(n)), "{counts:?}");
    assert_eq!(counts.last(), Some(&0));
}

#[test]
fn matching_is_one_to_one_and_the_printed_sign_prefers_mismatch() {
    let (a, b) = (features(&creature(0, 800), 25), features(&creature(1, 800), 25));
    let decaying = matched(&a, &b, &defaults());
    let printed = matched(&a, &b, &iqp_match::Params { kernel: Kernel::AsPrinted, ..defaults() });
    for m in [&decaying, &printed] {
        let unique = |side: fn(&iqp_match::Pair) -> usize| {
            let mut all: Vec<_> = m.pairs.iter().map(side).collect();
            all.sort_unstable();
            all.dedup();
            all.len()
        };
        assert_eq!(unique(|p| p.left), m.pairs.len());
        assert_eq!(unique(|p| p.right), m.pairs.len());
    }
    let mean = |m: &iqp_match::Match| m.pairs.iter().map(|p| p.descriptor_distance).sum::<f64>() / m.pairs.len() as f64;
    assert!(mean(&printed) > mean(&decaying));
}

#[test]
fn a_time_limit_returns_what_was_found() {
    let (a, b) = (features(&creature(0, 600), 15), features(&creature(5, 600), 15));
    let m = matched(&a, &b, &iqp_match::Params { limit: Limit::Seconds(1e-6), ..defaults() });
    assert!(m.objective <= m.bound);
    assert!(m.proved || m.stopped == "seconds");
}
