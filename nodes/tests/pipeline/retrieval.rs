//! Retrieval from matches to figures, in memory.

use std::sync::Arc;

use salient_nodes::diffuse::{self, Diffuse};
use salient_nodes::explain_match::ExplainMatch;
use salient_nodes::fuse::{self, Fuse};
use salient_nodes::iqp_match::{self, Limit};
use salient_nodes::match_all::{self, MatchAll};
use salient_nodes::pair_scores::PairScores;
use salient_nodes::patch_spectrum::Features;
use salient_nodes::rank::{self, Rank, Ranking};
use salient_nodes::retrieval_metrics::{self, RetrievalMetrics};
use salient_nodes::score::{self, Of, Over, Score};
use salient_nodes::shape_dna::ShapeDna;
use salient_nodes::shortlist::{self, Shortlist};
use salient_nodes::signature::Signature;
use salient_nodes::signature_similarity::SignatureSimilarity;
use salient_nodes::similarity::Similarity;
use salient_nodes::spectral_signature::{self, HeatSignature, Pool, WaveSignature};
use salient_nodes::synthesize::{self, Species, Synthesize};
use salient_sdk::testing::TestHost;
use salient_sdk::{AnyArtefact, NodeError, PortValues, Table};

use crate::{basis, creature, defaults, features, matched, run, shuffled};

fn shapes() -> Vec<(&'static str, Arc<Features>)> {
    let of = |species, pose| {
        let params = synthesize::Params { species, pose, vertices: 700, ..defaults() };
        features(&run::<Synthesize>(&params, &[]).unwrap(), 14)
    };
    vec![
        ("cat_0", of(Species::Cat, 0)),
        ("cat_1", of(Species::Cat, 1)),
        ("giraffe_0", of(Species::Giraffe, 0)),
        ("giraffe_1", of(Species::Giraffe, 1)),
    ]
}

fn wired(shapes: &[(&'static str, Arc<Features>)], failed: &[&str]) -> PortValues {
    let mut values = PortValues::default();
    for port in ["queries", "targets"] {
        for (name, features) in shapes {
            values.push(port, name, features.clone());
        }
        for name in failed {
            values.push_missing(port, name);
        }
    }
    values
}

fn scores(host: &TestHost, shapes: &[(&'static str, Arc<Features>)], failed: &[&str]) -> Arc<PairScores> {
    Arc::new(host.run_wired::<MatchAll>(&defaults(), wired(shapes, failed)).unwrap())
}

fn scored(scores: &Arc<PairScores>, of: Of, over: Over) -> Arc<Similarity> {
    run::<Score>(&score::Params { of, over }, &[("scores", scores.clone())]).unwrap()
}

fn ranking(similarity: &Arc<Similarity>, top: Option<u32>) -> Arc<Ranking> {
    run::<Rank>(&rank::Params { top, own: false }, &[("similarity", similarity.clone())]).unwrap()
}

fn metrics(ranking: &Arc<Ranking>) -> Arc<retrieval_metrics::Metrics> {
    let params = retrieval_metrics::Params { pattern: Some("{class}_#".into()), ..defaults() };
    run::<RetrievalMetrics>(&params, &[("ranking", ranking.clone())]).unwrap()
}

#[test]
fn poses_are_found_whatever_the_order_and_failures_are_listed() {
    let shapes = shapes();
    let host = TestHost::with_workers(1);
    let forward = scores(&host, &shapes, &["broken"]);
    let found = metrics(&ranking(&scored(&forward, Of::Sum, Over::Themselves), None));
    assert_eq!(
        (found.overall.nn, found.overall.first_tier, found.overall.map, found.overall.queries),
        (1.0, 1.0, 1.0, 4)
    );
    assert_eq!(found.failed, ["broken"]);
    assert_eq!(found.confusion, [[2, 0], [0, 2]]);
    // In another order, with nothing remembered: the same lists of the same scores.
    let backward: Vec<_> = shapes.iter().rev().cloned().collect();
    let backward = scores(&TestHost::default(), &backward, &[]);
    let lists = |scores: &Arc<PairScores>| {
        let r = ranking(&scored(scores, Of::Sum, Over::Themselves), None);
        let mut lists: Vec<_> = (0..4)
            .map(|q| (r.queries[q].clone(), r.list(q).map(|(t, s)| (t.to_owned(), s)).collect::<Vec<_>>()))
            .collect();
        lists.sort_by(|a, b| a.0.cmp(&b.0));
        lists
    };
    assert_eq!(lists(&forward), lists(&backward));
}

#[test]
fn a_new_shape_costs_its_own_row() {
    let shapes = shapes();
    let host = TestHost::default();
    let count = |what: &str| host.recorded(what).unwrap().as_u64().unwrap();
    scores(&host, &shapes[..3], &[]);
    assert_eq!((count("pairs computed"), count("pairs remembered")), (3, 0));
    scores(&host, &shapes, &[]);
    assert_eq!((count("pairs computed"), count("pairs remembered")), (3, 3));
}

#[test]
fn a_shape_is_most_like_itself_and_the_quick_match_is_a_lower_bound() {
    let shapes = shapes();
    let scores = scores(&TestHost::default(), &shapes, &[]);
    let alike = scored(&scores, Of::Sum, Over::Themselves);
    let reading = match_all::Params::default().matching();
    for i in 0..4 {
        assert!((alike.row(i)[i] - 1.0).abs() < 1e-12);
        for j in 0..4 {
            assert_eq!(alike.row(i)[j].to_bits(), alike.row(j)[i].to_bits());
            assert!(alike.row(i)[j] <= 1.0 + 1e-12);
        }
    }
    for (i, j) in [(0, 1), (0, 2), (2, 3)] {
        let quick = scores.pairs[i * 4 + j];
        let proved =
            matched(&shapes[i].1, &shapes[j].1, &iqp_match::Params { limit: Limit::Nodes(50), ..reading.clone() });
        assert!(quick.objective <= proved.bound + 1e-9);
        assert!(quick.objective >= 0.9 * proved.objective, "{} of {}", quick.objective, proved.objective);
    }
    // What it is divided by is what matching the shape with itself gives.
    let itself = matched(&shapes[0].1, &shapes[0].1, &reading);
    assert!((itself.objective - scores.queries[0].own).abs() < 1e-9);
    let matches = scored(&scores, Of::Matched, Over::Larger);
    assert_eq!(matches.row(0)[0], 1.0);
    assert_eq!(
        matches.row(0)[1],
        f64::from(scores.pairs[1].matched) / f64::from(scores.queries[0].features.max(scores.queries[1].features))
    );
}

#[test]
fn an_explanation_adds_up_to_the_score() {
    let shapes = shapes();
    let scores = scores(&TestHost::default(), &shapes, &[]);
    let wires: [(&str, Arc<dyn AnyArtefact>); 2] = [("left", shapes[0].1.clone()), ("right", shapes[1].1.clone())];
    let why = run::<ExplainMatch>(&defaults(), &wires).unwrap();
    let pair = scores.pairs[1];
    assert_eq!(why.terms.len(), pair.matched as usize);
    assert!((why.objective - pair.objective).abs() < 1e-9 * pair.objective);
    assert!((why.score - scored(&scores, Of::Sum, Over::Themselves).row(0)[1]).abs() < 1e-12);
    let first = &why.terms[0];
    assert_eq!(first.left.descriptor, *shapes[0].1.descriptors[first.left.feature].as_ref().unwrap());
    assert_eq!(
        (first.left.descriptor.len(), first.right.vertex),
        (21, shapes[1].1.features[first.right.feature].vertex)
    );
    let Some(Table { columns, rows }) = salient_sdk::Artefact::table(&*why) else { panic!("no table") };
    assert!(columns.len() == 7 + 42 && rows.iter().all(|row| row.len() == columns.len()));
}

/// Signatures of a kind, each of one value.
fn signatures(kind: &str, names: &[&str], values: &[f64]) -> Vec<(String, Arc<Signature>)> {
    let one = |(name, x): (&&str, &f64)| {
        ((*name).to_owned(), Arc::new(Signature { kind: kind.into(), values: vec![*x, 1.0] }))
    };
    names.iter().zip(values).map(one).collect()
}

fn signed(names: &[&str], values: &[f64]) -> Arc<Similarity> {
    let mut port = PortValues::default();
    for (name, one) in signatures("x", names, values) {
        port.push("signatures", &name, one);
    }
    port.push_missing("signatures", "gone");
    Arc::new(TestHost::default().run_wired::<SignatureSimilarity>(&defaults(), port).unwrap())
}

fn fused(all: &[&Arc<Similarity>], weights: &[f64]) -> Result<Similarity, NodeError> {
    let mut port = PortValues::default();
    for s in all {
        port.push("similarities", "", Arc::clone(s) as Arc<dyn AnyArtefact>);
    }
    TestHost::default().run_wired::<Fuse>(&fuse::Params { weights: weights.to_vec(), ..defaults() }, port)
}

fn shortlisted(params: &shortlist::Params, of: &[(String, Arc<Signature>)], failed: &[&str]) -> Arc<Similarity> {
    let mut port = PortValues::default();
    for (name, signature) in of {
        port.push("signatures", name, signature.clone());
    }
    for name in failed {
        port.push_missing("signatures", name);
    }
    Arc::new(TestHost::with_workers(2).run_wired::<Shortlist>(params, port).unwrap())
}

#[test]
fn a_shortlist_is_what_a_full_comparison_puts_first() {
    // More shapes than a block, with ties; two kinds, of which one lacks a shape.
    let names: Vec<String> = (0..75).map(|i| format!("s{i:02}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let x: Vec<f64> = (0..75).map(|i| f64::from(i * 29 % 31)).collect();
    let y: Vec<f64> = (0..74).map(|i| 100.0 * f64::from(i * i % 17)).collect();
    let both = [signatures("x", &names, &x), signatures("y", &names[..74], &y)].concat();
    let weights = [1.0, 3.0];
    let list = shortlisted(&shortlist::Params { count: 7, weights: weights.to_vec() }, &both, &["gone"]);
    assert_eq!(list.missing, ["gone", "s74"]);
    // The same by two full tables.
    let full = Arc::new(fused(&[&signed(&names[..74], &x[..74]), &signed(&names[..74], &y)], &weights).unwrap());
    let best = ranking(&full, Some(7));
    let on = |q: usize, t: usize| best.order[q].contains(&(t as u32));
    for q in 0..74 {
        for t in 0..74 {
            let value = list.value(q, t);
            assert_eq!(value.is_some(), q == t || on(q, t) || on(t, q), "{q} {t}");
            assert!(value.is_none_or(|v| (v - full.row(q)[t]).abs() < 1e-12), "{q} {t}");
        }
    }
}

#[test]
fn what_follows_a_shortlist_is_as_of_all_pairs_but_only_there() {
    let shapes = shapes();
    let names = shapes.iter().map(|(name, _)| *name).collect::<Vec<_>>();
    let coarse = signatures("x", &names, &[0.0, 1.0, 5.0, 7.0]);
    let list = shortlisted(&shortlist::Params { count: 1, weights: vec![] }, &coarse, &[]);
    let mut values = wired(&shapes, &[]);
    values.push("shortlist", "", list.clone());
    let host = TestHost::default();
    let few = Arc::new(host.run_wired::<MatchAll>(&defaults(), values).unwrap());
    // Cats with cats, giraffes with giraffes.
    assert_eq!(host.recorded("pairs computed").unwrap(), 2);
    let few = scored(&few, Of::Sum, Over::Themselves);
    let all = scored(&scores(&TestHost::default(), &shapes, &[]), Of::Sum, Over::Themselves);
    let pairs: Vec<[usize; 2]> = (0..4).flat_map(|q| few.order().row(q).map(move |t| [q, t])).collect();
    assert_eq!(pairs, [[0, 0], [0, 1], [1, 0], [1, 1], [2, 2], [2, 3], [3, 2], [3, 3]]);
    assert!(pairs.iter().all(|[q, t]| few.value(*q, *t) == Some(all.row(*q)[*t])));
    // A shape that is not on the list is left out, and said to be.
    let mut port = PortValues::default();
    for (name, signature) in &coarse {
        port.push("signatures", name, signature.clone());
    }
    port.push("signatures", "late", coarse[0].1.clone());
    port.push("shortlist", "", list.clone());
    let by_x = Arc::new(TestHost::default().run_wired::<SignatureSimilarity>(&defaults(), port).unwrap());
    assert_eq!((by_x.missing.join(" "), by_x.value(0, 1), by_x.value(0, 2)), ("late".into(), Some(-1.0), None));
    // Fused with what is of the same pairs, and only with that; spread; ranked.
    assert!(fused(&[&few, &all], &[]).unwrap_err().help.unwrap().contains("shortlist"));
    let both = Arc::new(fused(&[&few, &by_x], &[]).unwrap());
    assert_eq!(both.compared, list.compared);
    let spread =
        run::<Diffuse>(&diffuse::Params { neighbours: 1, alpha: 0.5, ..defaults() }, &[("similarity", both)]).unwrap();
    assert_eq!(ranking(&spread, None).order, [[1], [0], [3], [2]]);
    let found = metrics(&ranking(&spread, None));
    assert_eq!((found.overall.recall, found.overall.map), (1.0, 1.0));
}

#[test]
fn fusing_is_free_of_units_and_leaves_out_what_one_lacks() {
    let names = ["a_1", "a_2", "b_1", "b_2"];
    let one = signed(&names, &[0.0, 1.0, 5.0, 7.0]);
    let thousand = signed(&names, &[0.0, 1000.0, 5000.0, 7000.0]);
    let both = fused(&[&one, &thousand], &[]).unwrap();
    let single = fused(&[&one], &[]).unwrap();
    assert!(both.values.iter().zip(&single.values).all(|(x, y)| (x - y).abs() < 1e-12));
    // Distances of 1, 5, 7, 4, 6 and 2 have the mean 25 / 6.
    assert!((single.row(0)[1] + 6.0 / 25.0).abs() < 1e-12);
    let short = fused(&[&one, &signed(&names[1..], &[0.0, 1.0, 2.0])], &[1.0, 0.0]).unwrap();
    assert_eq!((short.queries.join(" "), short.missing.join(" ")), ("a_2 b_1 b_2".into(), "a_1 gone".into()));
    assert!(fused(&[&one], &[0.0]).is_err() && fused(&[&one], &[1.0, 1.0]).is_err());
    let spread = run::<Diffuse>(&diffuse::Params { neighbours: 1, ..defaults() }, &[("similarity", one)]).unwrap();
    assert_eq!(metrics(&ranking(&spread, None)).overall.nn, 1.0);
}

#[test]
fn what_has_no_class_or_no_fellow_is_listed_and_a_single_class_refused() {
    let lonely = signed(&["a_1", "a_2", "b_1", "nameless"], &[0.0, 1.0, 5.0, 0.1]);
    let found = metrics(&ranking(&lonely, None));
    assert_eq!(
        (found.unlabelled.join(" "), found.alone.join(" "), found.failed.join(" ")),
        ("nameless".into(), "b_1".into(), "gone".into())
    );
    // The shape without a class is no wrong answer either.
    assert_eq!((found.overall.queries, found.overall.nn), (2, 1.0));
    let params = retrieval_metrics::Params { pattern: Some("{class}_#".into()), ..defaults() };
    let one_class = ranking(&signed(&["a_1", "a_2"], &[0.0, 1.0]), None);
    assert!(run::<RetrievalMetrics>(&params, &[("ranking", one_class)]).unwrap_err().message.contains("one class"));
}

#[test]
fn spectral_signatures_know_a_shape_in_other_numbering_and_size() {
    let mesh = creature(0, 800);
    let mut large = (*shuffled(&mesh, 5)).clone();
    large.vertices.iter_mut().for_each(|p| *p = p.map(|x| 9.0 * x));
    let (one, two) = (basis(&mesh, 60), basis(&Arc::new(large), 60));
    let close = |a: &Signature, b: &Signature| a.values.iter().zip(&b.values).all(|(x, y)| (x - y).abs() < 1e-6);
    let dna = |b: &Arc<_>| run::<ShapeDna>(&defaults(), &[("basis", Arc::clone(b) as _)]).unwrap();
    assert!(close(&dna(&one), &dna(&two)));
    let area: f64 = one.mass.iter().sum();
    assert!((dna(&one).values[0] - (one.values[1] * area).ln()).abs() < 1e-12);
    let heat = |b: &Arc<_>, pool| {
        let params = spectral_signature::Params { pool, ..defaults() };
        run::<HeatSignature>(&params, &[("basis", Arc::clone(b) as _)]).unwrap()
    };
    assert!(close(&heat(&one, Pool::Quantiles), &heat(&two, Pool::Quantiles)));
    let wave = |b: &Arc<_>| run::<WaveSignature>(&defaults(), &[("basis", Arc::clone(b) as _)]).unwrap();
    assert!(close(&wave(&one), &wave(&two)) && wave(&one).values.len() == 80);
    // The mean of the heat kernel over a shape is its trace over the area: eigenvalues alone.
    let trace: f64 = one.values[1..].iter().map(|x| (-0.006 * x * area).exp()).sum();
    assert!((heat(&one, Pool::Average).values[0] - trace.ln()).abs() < 1e-9);
}
