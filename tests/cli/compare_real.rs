//! `salient compare` on the stages, checked against what `get` gives of each variant.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use serde_json::Value;

use crate::real::{Real, SMALL};
use crate::text;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// The difference of one figure of a node in the only pair.
fn difference<'a>(found: &'a Value, node: &str, figure: &str) -> &'a Value {
    let nodes = found["pairs"][0]["nodes"].as_array().unwrap();
    let node = nodes.iter().find(|it| it["node"] == node).unwrap_or_else(|| panic!("{node} does not differ"));
    let all = node["differences"].as_array().unwrap();
    all.iter().find(|it| it["figure"] == figure).unwrap_or_else(|| panic!("no {figure} in {node}"))
}

#[test]
fn differences_are_those_between_the_outputs_themselves() {
    let real = Real::bare();
    let graph = "radius_variants.ron";
    let json = |args: &[&str]| real.json(&[args, &SMALL[..]].concat());
    let found = json(&["compare", graph, "--variants", "paper,barycentric", "--json"]);
    let roots = found["pairs"][0]["diverging"].as_array().unwrap();
    let nodes: Vec<_> = roots.iter().map(|it| it["node"].as_str().unwrap()).collect();
    assert_eq!(nodes, ["fa/laplacian", "fb/laplacian"]);
    assert_eq!(roots[0]["causes"][0]["now"], "Barycentric");
    let get = |variant: &str, node: &str| json(&["get", graph, &format!("{variant}:{node}")]);
    let both = |node: &str| [get("paper", node), get("barycentric", node)];

    // Eigenvalues: the largest relative change, by hand.
    let [a, b] = both("fa/basis").map(|basis| numbers(&basis["values"]));
    let change = |k: usize| (a[k] - b[k]).abs() / a[k].max(b[k]);
    let largest = (1..a.len()).max_by(|i, j| change(*i).total_cmp(&change(*j))).unwrap();
    let told = difference(&found, "fa/basis", "eigenvalues");
    assert_eq!(
        (told["details"]["index"].as_u64(), told["size"].as_f64()),
        (Some(largest as u64), Some(change(largest)))
    );

    // Features: on one mesh, kept ones are at equal vertices; the scales change by less than 1 % here.
    let [a, b] = both("fa/maxima").map(|maxima| -> BTreeSet<(u64, u64)> {
        let all = maxima["features"].as_array().unwrap().clone();
        all.iter().map(|f| (f["vertex"].as_u64().unwrap(), f["k"].as_u64().unwrap())).collect()
    });
    let lost: Vec<_> = a.difference(&b).copied().collect();
    let gained: Vec<_> = b.difference(&a).copied().collect();
    let told = difference(&found, "fa/maxima", "features");
    let list = |key: &str| -> Vec<(u64, u64)> {
        let all = told["details"][key].as_array().unwrap();
        let mut all: Vec<_> = all.iter().map(|f| (f["vertex"].as_u64().unwrap(), f["k"].as_u64().unwrap())).collect();
        all.sort_unstable();
        all
    };
    assert!(!lost.is_empty() && (list("lost"), list("gained")) == (lost.clone(), gained), "{told}");
    let [mesh, _] = both("a");
    let position = &mesh["vertices"][lost[0].0 as usize];
    let placed = told["details"]["lost"].as_array().unwrap().iter().find(|f| f["vertex"] == lost[0].0).unwrap();
    assert_eq!(&placed["position"], position);

    // Matches and objective.
    let [a, b] = both("match");
    let ends = |of: &Value| -> Vec<(u64, u64)> {
        let pairs = of["pairs"].as_array().unwrap().clone();
        pairs.iter().map(|p| (p["left_vertex"].as_u64().unwrap(), p["right_vertex"].as_u64().unwrap())).collect()
    };
    let told = difference(&found, "match", "matches");
    // A vertex may carry several features, so pairs of vertices are counted.
    let mut left = ends(&b);
    let kept =
        ends(&a).iter().filter(|p| left.iter().position(|q| q == *p).map(|at| left.remove(at)).is_some()).count();
    assert_eq!(told["details"]["kept"], kept);
    let told = difference(&found, "match", "objective");
    assert_eq!(numbers(&told["values"]), [&a, &b].map(|m| m["objective"].as_f64().unwrap()));

    // Descriptors of the kept features are near each other, and accuracy has its columns.
    let told = difference(&found, "fa/features", "descriptors");
    assert!(told["size"].as_f64().unwrap() < told["details"]["largest"].as_f64().unwrap(), "{told}");
    let right = found["figures"].as_array().unwrap().iter().find(|row| row["figure"] == "up to symmetry").unwrap();
    assert_eq!(right["values"].as_array().unwrap().len(), 2);
    assert!(found["stages"].as_array().unwrap().iter().any(|row| row["kind"] == "eigensolve"));
}

#[test]
fn a_renumbered_mesh_keeps_its_features_by_position() {
    let real = Real::bare();
    let graph = |name: &str, mesh: &str| {
        let text = format!(
            "(format: 1, nodes: {{\"made\": synthesize(vertices: 700), {mesh} \
             \"fa\": graph(file: \"salient_features.ron\", mesh: \"mesh\")}}, show: [\"fa/maxima\"])"
        );
        real.write(name, text);
    };
    graph("one.ron", "\"mesh\": simplify(mesh: \"made\", vertices: 650),");
    graph(
        "two.ron",
        "\"plain\": simplify(mesh: \"made\", vertices: 650), \"mesh\": shuffle(mesh: \"plain\", seed: 5),",
    );
    let small = ["--set", "*/basis.pairs=30", "--set", "*/maxima.count=10"];
    let found = real.json(&[&["compare", "one.ron", "two.ron", "--json"], &small[..]].concat());
    assert_eq!(found["pairs"][0]["diverging"][0]["causes"][0]["cause"], "kind");
    let maxima = found["pairs"][0]["nodes"].as_array().unwrap().iter().find(|it| it["node"] == "fa/maxima").unwrap();
    // Every feature is found again, though every vertex has another number.
    let figures: Vec<_> = maxima["differences"].as_array().unwrap().iter().map(|it| it["figure"].clone()).collect();
    assert!(!figures.contains(&"features".into()), "{maxima}");
}

/// Signatures of four cats in two poses each by one of two alignments, ranked and judged. Poses are what these signatures
/// confuse, so that the rankings differ from the nearest on.
fn ranked(real: &Real) {
    let shapes = (0..4).flat_map(|seed| [(seed, 0), (seed, 3)]);
    let mut nodes = String::new();
    let mut wires = Vec::new();
    let mut folders = Vec::new();
    for (i, (seed, pose)) in shapes.enumerate() {
        let _ = writeln!(
            nodes,
            "\"m{i}\": synthesize(seed: {seed}, pose: {pose}, vertices: 500),\n\"s{i}\": view_signature(mesh: \"m{i}\"),"
        );
        wires.push(format!("\"s{i}\""));
        folders.push(format!("(\"{i}\", \"cat {seed}\")"));
    }
    let graph = format!(
        "(format: 1, nodes: {{{nodes} \"alike\": signature_similarity(signatures: [{}]), \"ranking\": rank(similarity: \"alike\"), \
         \"metrics\": retrieval_metrics(ranking: \"ranking\", folders: [{}])}}, show: [\"metrics\", \"ranking\"])",
        wires.join(", "),
        folders.join(", ")
    );
    real.write("ranked.ron", graph);
    let variants = "\"area\": set({}), \"normals\": set({\"s*\": (align: Normals)})";
    real.write("aligned.ron", format!("(format: 1, base: \"ranked.ron\", variants: {{{variants}}})"));
}

#[test]
fn ranks_and_figures_of_retrieval_are_compared() {
    let real = Real::bare();
    ranked(&real);
    let found = real.json(&["compare", "aligned.ron", "--json"]);
    let both = |node: &str| ["area", "normals"].map(|v| real.json(&["get", "aligned.ron", &format!("{v}:{node}")]));
    let [a, b] = both("ranking").map(|ranking| -> Vec<Vec<String>> {
        let list = |list: &Value| {
            let all = list["ranked"].as_array().unwrap().iter();
            all.map(|entry| entry["target"].as_str().unwrap().to_owned()).collect()
        };
        ranking["lists"].as_array().unwrap().iter().map(list).collect()
    });
    // Nearest, and the largest movement, by hand; lists of seven are all top.
    let nearest = a.iter().zip(&b).filter(|(a, b)| a[0] != b[0]).count();
    assert!(nearest > 0, "{a:?} {b:?}");
    let told = difference(&found, "ranking", "nearest");
    assert_eq!((told["size"].as_f64(), &told["details"]["queries"]), (Some(nearest as f64), &8.into()));
    let moved = |(a, b): (&Vec<String>, &Vec<String>)| {
        let ranks = a.iter().enumerate().map(|(i, name)| i.abs_diff(b.iter().position(|other| other == name).unwrap()));
        ranks.max().unwrap()
    };
    let largest = a.iter().zip(&b).map(moved).max().unwrap();
    let told = difference(&found, "ranking", "ranks");
    let first = &told["details"]["movements"][0];
    let apart = first["before"].as_u64().unwrap().abs_diff(first["now"].as_u64().unwrap());
    assert_eq!((told["size"].as_f64(), apart), (Some(largest as f64), largest as u64));
    // Figures: those that differ, with both values.
    let [a, b] = both("metrics");
    let mut differing = 0;
    for (figure, key) in [("NN", "nn"), ("first tier", "first_tier"), ("DCG", "dcg"), ("mAP", "map")] {
        if a[key] != b[key] {
            let told = difference(&found, "metrics", figure);
            assert_eq!(told["values"], serde_json::json!([a[key], b[key]]), "{figure}");
            differing += 1;
        }
    }
    assert!(differing > 0, "{a} {b}");
    let lines = text(&real.ok(&["compare", "aligned.ron", "--csv=differences"]));
    assert!(lines.contains("area,normals,ranking,rank,nearest,"), "{lines}");
    let told = text(&real.ok(&["compare", "aligned.ron"]));
    assert!(told.contains(&format!("another for {nearest} of 8 queries")), "{told}");
}
