//! Bags of features, and similarities made one.

use std::sync::Arc;

use salient_nodes::bag_of_features::BagOfFeatures;
use salient_nodes::diffuse::{self, Diffuse, Links};
use salient_nodes::eigensolve::Eigenpairs;
use salient_nodes::fuse::{self, Fuse, Scale};
use salient_nodes::network_fusion::{self, NetworkFusion};
use salient_nodes::point_signature::{self, PointSignature, Points};
use salient_nodes::signature::Signature;
use salient_nodes::similarity::Similarity;
use salient_nodes::spectral_signature::Kernel;
use salient_nodes::vocabulary::{self, MakeVocabulary, Vocabulary};
use salient_sdk::testing::TestHost;
use salient_sdk::{Artefact, NodeError, PortValues};

use crate::{basis, creature, defaults, run, shuffled};

fn points(basis: &Arc<Eigenpairs>, kernel: Kernel, count: u32) -> Arc<Points> {
    let params = point_signature::Params { kernel, points: count, ..defaults() };
    run::<PointSignature>(&params, &[("basis", Arc::clone(basis) as _)]).unwrap()
}

fn words(of: &[&Arc<Points>], shapes: u32) -> Result<Vocabulary, NodeError> {
    let mut port = PortValues::default();
    for (i, points) in of.iter().enumerate() {
        port.push("points", &i.to_string(), Arc::clone(points) as _);
    }
    TestHost::default().run_wired::<MakeVocabulary>(&vocabulary::Params { words: 20, shapes, ..defaults() }, port)
}

fn bag(points: &Arc<Points>, words: &Arc<Vocabulary>) -> Result<Arc<Signature>, NodeError> {
    run::<BagOfFeatures>(&defaults(), &[("points", Arc::clone(points) as _), ("vocabulary", Arc::clone(words) as _)])
}

#[test]
fn points_have_the_heat_kernel_of_their_vertex() {
    let basis = basis(&creature(0, 800), 60);
    let all = points(&basis, Kernel::Heat, 100_000);
    let area: f64 = basis.mass.iter().sum();
    assert_eq!((all.vertices.len(), all.width()), (basis.mass.len(), 16));
    // The first time is 0.006 of the area; the constant eigenfunction does not count.
    for (v, value) in all.values.iter().step_by(16).enumerate() {
        let at = |k: usize| (-0.006 * area * basis.values[k]).exp() * basis.vector(k)[v].powi(2) * area;
        assert!((value - (1..60).map(at).sum::<f64>().max(0.01).ln()).abs() < 1e-9);
    }
    let few = points(&basis, Kernel::Heat, 50);
    assert!(few.vertices.len() <= 50 && (few.shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    let at = few.vertices[7] as usize;
    assert_eq!(few.values[7 * 16..8 * 16], all.values[at * 16..(at + 1) * 16]);
    assert!(Points { shares: vec![1.0], ..(*few).clone() }.json()["shares"].as_array().unwrap().len() == 1);
}

#[test]
fn words_do_not_depend_on_the_order_of_shapes_nor_on_all_of_them() {
    let of = |pose| points(&basis(&creature(pose, 500), 40), Kernel::Wave, 100);
    let shapes = [of(0), of(1), of(2)];
    let [a, b, c] = &shapes;
    let both = words(&[a, b, c], 2).unwrap();
    assert_eq!(both, words(&[c, a, b, a], 2).unwrap());
    // Two of three were chosen, so without the third nothing changes.
    let without: Vec<Vocabulary> = [[a, b], [a, c], [b, c]].iter().map(|pair| words(pair, 2).unwrap()).collect();
    assert_eq!(without.iter().filter(|v| **v == both).count(), 1);
    assert_eq!(both.words.centres.len(), 20 * 16);
}

#[test]
fn a_bag_knows_a_shape_in_another_numbering_and_refuses_other_words() {
    let mesh = creature(0, 800);
    let (one, two, other) = (basis(&mesh, 60), basis(&shuffled(&mesh, 5), 60), basis(&creature(3, 800), 60));
    let all = |b| points(b, Kernel::Wave, 100_000);
    let words = Arc::new(words(&[&all(&one), &all(&other)], 10).unwrap());
    let bags = [&one, &two, &other].map(|b| bag(&all(b), &words).unwrap());
    for bag in &bags {
        assert!((bag.values.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-12);
    }
    let apart =
        |i: usize, j: usize| bags[i].values.iter().zip(&bags[j].values).map(|(x, y)| (x - y).abs()).sum::<f64>();
    assert!(apart(0, 1) < 1e-6 && apart(0, 2) > 0.01, "{} {}", apart(0, 1), apart(0, 2));
    assert!(bag(&points(&one, Kernel::Heat, 100), &words).unwrap_err().message.contains("heat"));
}

/// Shapes on a line: how near they are.
fn line(at: &[f64]) -> Arc<Similarity> {
    let names: Vec<String> = (0..at.len()).map(|i| format!("shape {i}")).collect();
    let values = at.iter().flat_map(|x| at.iter().map(move |y| 0.0 - (x - y).abs())).collect();
    let (queries, targets) = (names.clone(), names);
    Arc::new(Similarity { measure: "place".into(), queries, targets, values, compared: None, missing: Vec::new() })
}

fn wired(all: &[&Arc<Similarity>]) -> PortValues {
    let mut port = PortValues::default();
    for s in all {
        port.push("similarities", "", Arc::clone(s) as _);
    }
    port
}

const ONE: [f64; 6] = [0.0, 1.0, 1.5, 5.0, 7.0, 7.2];
const TWO: [f64; 6] = [0.0, 3.0, 0.5, 8.0, 20.0, 9.0];

type Square = [[f64; 6]; 6];

fn square(f: impl Fn(usize, usize) -> f64) -> Square {
    std::array::from_fn(|i| std::array::from_fn(|j| f(i, j)))
}

/// exp(-d² / s s) for the mean distance s to the two nearest.
fn weights(at: &[f64; 6]) -> Square {
    let reach = at.map(|x| {
        let mut away = at.map(|y| (x - y).abs());
        away.sort_by(f64::total_cmp);
        f64::midpoint(away[1], away[2])
    });
    square(|i, j| (-(at[i] - at[j]).powi(2) / (reach[i] * reach[j])).exp())
}

#[test]
fn by_neighbours_a_measure_counts_where_something_is_near() {
    let params = fuse::Params { weights: vec![3.0, 1.0], scale: Scale::Neighbours, neighbours: 2 };
    let fused = TestHost::default().run_wired::<Fuse>(&params, wired(&[&line(&ONE), &line(&TWO)])).unwrap();
    let (one, two) = (weights(&ONE), weights(&TWO));
    for i in 0..6 {
        for j in 0..6 {
            assert!((fused.row(i)[j] - 0.75 * one[i][j] - 0.25 * two[i][j]).abs() < 1e-12, "{i} {j}");
        }
    }
}

/// One round of network fusion with two neighbours, by whole matrices.
fn fused(measures: &[[f64; 6]]) -> Square {
    let product = |a: &Square, b: &Square| square(|i, j| (0..6).map(|k| a[i][k] * b[k][j]).sum());
    let other = |i: usize, row: &[f64; 6], j: usize| if i == j { 0.0 } else { row[j] };
    let rows = |w: &Square| w.map(|row| row.iter().sum::<f64>());
    let networks: Vec<(Square, Square)> = measures
        .iter()
        .map(|at| {
            let w = weights(at);
            let w = square(|i, j| other(i, &w[i], j));
            let (sums, unit) = (rows(&w), |i: usize, j: usize| f64::from(u8::from(i == j)));
            let p = square(|i, j| w[i][j] / (2.0 * sums[i]) + 0.5 * unit(i, j));
            let kept = square(|i, j| {
                let greater = (0..6).filter(|k| w[i][*k] > w[i][j]).count();
                if greater < 2 { w[i][j] } else { 0.0 }
            });
            let sums = rows(&kept);
            (p, square(|i, j| kept[i][j] / sums[i]))
        })
        .collect();
    let next = networks.iter().enumerate().map(|(m, (_, s))| {
        let rest: Vec<&Square> = networks.iter().enumerate().filter(|(o, _)| *o != m).map(|(_, (p, _))| p).collect();
        let mean = square(|i, j| rest.iter().map(|p| p[i][j]).sum::<f64>() / rest.len() as f64);
        let q = product(&product(s, &mean), &square(|i, j| s[j][i]));
        let sums = rows(&q);
        let q = square(|i, j| q[i][j] / (2.0 * sums[i]) + if i == j { 0.5 } else { 0.0 });
        square(|i, j| f64::midpoint(q[i][j], q[j][i]))
    });
    let all: Vec<Square> = next.collect();
    square(|i, j| all.iter().map(|q| q[i][j]).sum::<f64>() / all.len() as f64)
}

#[test]
fn networks_learn_from_each_other_as_whole_matrices_do() {
    let three = [3.0, 2.0, 1.0, 9.0, 4.0, 11.0];
    let lines = [line(&ONE), line(&TWO), line(&three)];
    let params = network_fusion::Params { neighbours: 2, rounds: 1 };
    let run = |workers| {
        let host = TestHost::with_workers(workers);
        host.run_wired::<NetworkFusion>(&params, wired(&[&lines[0], &lines[1], &lines[2]])).unwrap()
    };
    let found = run(0);
    let expected = fused(&[ONE, TWO, three]);
    for i in 0..6 {
        for j in 0..6 {
            assert!(
                (found.row(i)[j] - expected[i][j]).abs() < 1e-12,
                "{i} {j}: {} {}",
                found.row(i)[j],
                expected[i][j]
            );
        }
    }
    assert_eq!(found, run(3));
    let alone = TestHost::default().run_wired::<NetworkFusion>(&params, wired(&[&lines[0]]));
    assert!(alone.unwrap_err().message.contains("two"));
}

#[test]
fn given_links_are_the_similarity_and_local_is_a_factor() {
    let plain = {
        let params = fuse::Params { scale: Scale::Neighbours, neighbours: 2, ..defaults() };
        Arc::new(TestHost::default().run_wired::<Fuse>(&params, wired(&[&line(&ONE)])).unwrap())
    };
    let params = diffuse::Params { neighbours: 5, links: Links::Given, ..defaults() };
    let spread = run::<Diffuse>(&params, &[("similarity", plain.clone())]).unwrap();
    // With all as neighbours, P is W over the roots of its row sums.
    let w = weights(&ONE);
    let w = square(|i, j| if i == j { 0.0 } else { w[i][j] });
    let degree = w.map(|row| row.iter().sum::<f64>().sqrt());
    for i in 0..6 {
        for k in 0..6 {
            let product: f64 = (0..6).map(|j| w[k][j] / (degree[k] * degree[j]) * spread.row(i)[j]).sum();
            let unit = if i == k { 0.2 } else { 0.0 };
            assert!((spread.row(i)[k] - 0.8 * product - unit).abs() < 1e-10);
        }
    }
    let both = run::<Diffuse>(&params, &[("similarity", plain.clone()), ("local", plain.clone())]).unwrap();
    for ((x, y), near) in both.values.iter().zip(&spread.values).zip(&plain.values) {
        assert!((x - y.max(1e-9) * near).abs() < 1e-15);
    }
    let negative = run::<Diffuse>(&params, &[("similarity", line(&ONE))]).unwrap_err();
    assert!(negative.help.unwrap().contains("Distances"));
    let local = run::<Diffuse>(&defaults(), &[("similarity", plain), ("local", line(&ONE))]).unwrap_err();
    assert!(local.message.contains("local"));
}
