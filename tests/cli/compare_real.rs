//! `salient compare` on the stages, checked against what `get` gives of each variant.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::real::{Real, SMALL};

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
