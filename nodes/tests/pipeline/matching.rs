//! The correspondence of features.

use salient_nodes::cut::{self, Cut};
use salient_nodes::iqp_match::{self, Compare, Kernel, Limit, Match, Scales, Unit};
use salient_nodes::patch_spectrum::Features;

use crate::{creature, defaults, features, matched, run, shuffled};

/// The reading of `corrected.ron`.
fn corrected() -> iqp_match::Params {
    iqp_match::Params {
        candidates: 3,
        unit: Unit::Scale,
        compare: Compare::Difference,
        scales: Scales::Relative,
        sigma_geodesic: None,
        sigma_scale: None,
        agreement: 0.0,
        ..defaults()
    }
}

#[test]
fn a_shape_matches_its_renumbered_self_vertex_by_vertex() {
    let mesh = creature(1, 800);
    let other = shuffled(&mesh, 9);
    let source = other.source.clone().unwrap();
    let m = matched(&features(&mesh, 30), &features(&other, 30), &corrected());
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
        let m = matched(&a, &b, &iqp_match::Params { limit: Limit::Nodes(nodes), ..corrected() });
        assert!(m.objective <= m.bound && (m.gap - (m.bound - m.objective)).abs() < 1e-9);
        assert!(m.heuristic <= m.objective + 1e-9);
        assert!(m.proved == (m.stopped == "proved"));
        bounds.push((m.objective, m.bound));
    }
    let best = bounds.iter().map(|b| b.0).fold(0.0, f64::max);
    assert!(bounds.iter().all(|b| b.1 >= best - 1e-9));
}

/// x' H x + beta C x - cost, from the pairs alone: `alone` of each pair, `together` of each ordered two.
fn recomputed(m: &Match, cost: f64, alone: impl Fn(usize, usize) -> f64, together: impl Fn([usize; 4]) -> f64) -> f64 {
    let mut sum = -cost * (m.features[0] + m.features[1] - 2 * m.pairs.len()) as f64;
    for x in &m.pairs {
        sum += alone(x.left, x.right);
        for y in m.pairs.iter().filter(|y| y.left != x.left) {
            sum += together([x.left, x.right, y.left, y.right]);
        }
    }
    sum
}

fn descriptor_distance(a: &Features, b: &Features, i: usize, j: usize) -> f64 {
    let (x, y) = (a.descriptors[i].as_ref().unwrap(), b.descriptors[j].as_ref().unwrap());
    x.iter().zip(y).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn the_corrected_objective_is_the_one_of_the_paper() {
    let (a, b) = (features(&creature(0, 800), 20), features(&creature(1, 800), 20));
    let m = matched(&a, &b, &iqp_match::Params { beta: 3.0, unmatched: 0.25, ..corrected() });
    let [sd, sg, ss] = m.sigmas;
    let kernel = |d: f64, sigma: f64| (-0.5 * (d / sigma).powi(2)).exp();
    let relative = |f: &Features, i: usize, p: usize| {
        f.distance(i, p).unwrap() / (f.features[i].scale * f.features[p].scale).sqrt()
    };
    let ratio = |f: &Features, i: usize, p: usize| (f.features[i].scale / f.features[p].scale).ln();
    let alone = |i, j| 3.0 * kernel(descriptor_distance(&a, &b, i, j), sd);
    let together = |[i, j, p, q]: [usize; 4]| {
        kernel(relative(&a, i, p) - relative(&b, j, q), sg) * kernel(ratio(&a, i, p) - ratio(&b, j, q), ss)
    };
    let objective = recomputed(&m, 0.25, alone, together);
    assert!((objective - m.objective).abs() < 1e-8 * objective, "{objective} {}", m.objective);
}

#[test]
fn the_default_objective_is_the_documented_one() {
    let (a, b) = (features(&creature(0, 800), 20), features(&creature(1, 800), 20));
    let m = matched(&a, &b, &iqp_match::Params { unmatched: -0.5, ..defaults() });
    let (root_a, root_b) = (a.area.sqrt(), b.area.sqrt());
    let alone = |i: usize, j: usize| {
        let d = descriptor_distance(&a, &b, i, j) / m.sigmas[0];
        let s = ((a.features[i].scale / root_a) / (b.features[j].scale / root_b)).ln() / 0.15;
        assert!(s.abs() <= 3.0);
        (-0.5 * (d * d + s * s)).exp()
    };
    let together = |[i, j, p, q]: [usize; 4]| {
        let (x, y) = (a.distance(i, p).unwrap() / root_a, b.distance(j, q).unwrap() / root_b);
        (-0.5 * (((x + 0.15) / (y + 0.15)).ln() / 0.15).powi(2)).exp() - 0.7
    };
    for m in [m.pairs.clone(), m.twin.clone().unwrap().pairs]
        .into_iter()
        .zip([m.objective, m.twin.clone().unwrap().objective])
    {
        let (pairs, expected) = m;
        let whole = Match { pairs, ..(*matched(&a, &b, &defaults())).clone() };
        let objective = recomputed(&whole, -0.5, alone, together);
        assert!((objective - expected).abs() < 1e-8 * objective.abs(), "{objective} {expected}");
    }
}

#[test]
fn the_factor_between_two_units_is_found() {
    let (a, b) = (creature(0, 800), creature(1, 800));
    let large = |factor: f64| {
        let vertices = b.vertices.iter().map(|p| p.map(|x| factor * x)).collect();
        features(&std::sync::Arc::new(salient_sdk::Mesh { vertices, ..(*b).clone() }), 30)
    };
    let a = features(&a, 30);
    let params = |stretch| iqp_match::Params { unit: Unit::Length, stretch, ..defaults() };
    let here = matched(&a, &large(1.0), &params(1.0));
    for factor in [1.5, 0.7] {
        let found = matched(&a, &large(factor), &params(2.0));
        assert!((found.stretch / factor).ln().abs() < 0.07, "{} {factor}", found.stretch);
        assert!(found.objective > 0.95 * here.objective);
        // Without the search, scales and distances disagree.
        assert!(matched(&a, &large(factor), &params(1.0)).objective < 0.7 * here.objective);
    }
}

#[test]
fn rewarding_unmatched_features_rejects_weak_matches() {
    // A piece has features that the whole lacks, and the other way round.
    let (whole, moved) = (creature(0, 800), creature(3, 800));
    let piece = run::<Cut>(&cut::Params { keep: 0.6, ..defaults() }, &[("mesh", moved)]).unwrap();
    let (a, b) = (features(&piece, 40), features(&whole, 40));
    let shared = iqp_match::Params { unit: Unit::Length, sigma_geodesic: Some(0.05), ..corrected() };
    let with = |unmatched| matched(&a, &b, &iqp_match::Params { unmatched, ..shared.clone() }).pairs.len();
    let counts: Vec<usize> = [0.0, -2.0, -3.0, -4.0, -100.0].map(with).to_vec();
    assert!(counts.is_sorted_by(|a, b| a >= b), "{counts:?}");
    assert!(counts.iter().any(|n| (1..counts[0]).contains(n)), "{counts:?}");
    assert_eq!(counts.last(), Some(&0));
}

#[test]
fn matching_is_one_to_one_and_the_printed_sign_prefers_mismatch() {
    let (a, b) = (features(&creature(0, 800), 25), features(&creature(1, 800), 25));
    let decaying = matched(&a, &b, &corrected());
    let printed = matched(&a, &b, &iqp_match::Params { kernel: Kernel::AsPrinted, ..corrected() });
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
    let m = matched(&a, &b, &iqp_match::Params { limit: Limit::Seconds(1e-6), ..corrected() });
    assert!(m.objective <= m.bound);
    assert!(m.proved || m.stopped == "seconds");
}

#[test]
fn candidates_that_contradict_the_rest_are_left_out() {
    // A piece against the whole: where the paper's reading matches nearly all, the default keeps what is consistent.
    let (whole, moved) = (creature(0, 800), creature(3, 800));
    let piece = run::<Cut>(&cut::Params { keep: 0.5, ..defaults() }, &[("mesh", moved)]).unwrap();
    let (a, b) = (features(&piece, 40), features(&whole, 40));
    let counts = [0.0, 0.3, 0.6, 0.9].map(|agreement| {
        matched(&a, &b, &iqp_match::Params { agreement, stretch: 1.5, limit: Limit::Nodes(0), ..defaults() })
            .pairs
            .len()
    });
    assert!(counts.is_sorted_by(|a, b| a >= b) && counts[3] < counts[0] / 2, "{counts:?}");
}

#[test]
fn params_that_contradict_each_other_are_refused() {
    use salient_sdk::Node;
    let wrong = |params| iqp_match::IqpMatch::check(&params).into_iter().map(|(name, _)| name).collect::<Vec<_>>();
    assert_eq!(wrong(iqp_match::Params { unit: Unit::Scale, ..defaults() }), ["scales"]);
    assert_eq!(wrong(iqp_match::Params { stretch: 2.0, ..corrected() }), ["stretch"]);
    assert_eq!(wrong(iqp_match::Params { limit: Limit::Seconds(0.0), ..defaults() }), ["limit"]);
    assert!(wrong(defaults()).is_empty() && wrong(corrected()).is_empty());
}
