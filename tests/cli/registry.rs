//! What holds for every node and every graph of this repository, seen from the command line.

use crate::real::{PAIR, Real, creatures, graphs};
use crate::text;

#[test]
fn the_example_of_every_node_plans() {
    let real = Real::bare();
    real.write("mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    for node in salient_nodes::NODES {
        let example = node.example();
        let mut names = example.lines().rev().filter_map(|line| line.trim().strip_prefix('"')?.split('"').next());
        let last = names.next().unwrap_or_else(|| panic!("{}: {example}", node.kind()));
        real.write("example.ron", format!("(format: 1, nodes: {{{example}\n}}, show: [\"{last}\"])"));
        let output = real.call(&["check", "example.ron"]);
        assert!(output.status.success(), "{}: {}", node.kind(), text(&output.stderr));
        let plan = real.json(&["plan", "example.ron", "--json"]);
        let kinds: Vec<_> = plan["calls"].as_array().unwrap().iter().map(|call| &call["kind"]).collect();
        assert!(kinds.contains(&&node.kind().into()), "{}: {kinds:?}", node.kind());
    }
}

#[test]
fn every_node_is_documented_on_the_command_line() {
    let real = Real::bare();
    let overview = text(&real.ok(&["nodes"]));
    for node in salient_nodes::NODES {
        let line = overview.lines().find(|line| line.starts_with(&format!("{} ", node.kind())));
        assert!(line.is_some_and(|line| !line.ends_with("(eq")), "{line:?}");
        let document = text(&real.ok(&["nodes", node.kind()]));
        for name in node.ports().iter().map(|p| p.name).chain(node.params().iter().map(|p| p.name.as_str())) {
            assert!(document.contains(&format!("  {name}")), "{}: {name} is not in {document}", node.kind());
        }
        assert!(real.json(&["nodes", node.kind(), "--schema"]).is_object());
    }
}

#[test]
fn every_graph_plans() {
    let real = Real::bare();
    let cat = "my cat.off";
    real.write(cat, &creatures()[0]);
    let set = |node: &str| format!("--set={node}.path={cat:?}");
    let [a, b, template] = ["a", "b", "template"].map(set);
    let mut names = Vec::new();
    for graph in graphs() {
        let name = graph.file_name().unwrap().to_str().unwrap().to_owned();
        match name.as_str() {
            // Their meshes are the user's.
            PAIR => {
                real.ok(&["check", PAIR, &a, &b]);
                let plan = real.json(&["plan", PAIR, "--json", &a, &b]);
                assert_eq!(plan["calls"].as_array().unwrap().len(), 8, "both sides are one");
            }
            "explain.ron" | "literal.ron" | "corrected.ron" | "robust.ron" => {
                assert!(!real.ok(&["check", &name, &a, &b]).is_empty());
            }
            "evaluate_pair.ron" | "evaluate_part.ron" => {
                assert!(!real.ok(&["check", &name, &a, &b, &template]).is_empty());
            }
            "retrieval.ron" | "retrieval_paper.ron" | "retrieval_shortlist.ron" | "partial_retrieval.ron" => {
                real.write("other cat.off", &creatures()[1]);
                assert!(!real.ok(&["check", &name, "--set", "shapes=files(\"*cat.off\")"]).is_empty());
            }
            // A subgraph is called by others.
            "salient_features.ron" => {
                let stderr = real.fails(2, &["run", &name]);
                assert!(stderr.contains("the input `mesh` is open: this graph can only be called"), "{stderr}");
                assert!(text(&real.ok(&["check", &name])).contains("a graph to be called, with the input"));
                real.edit(&name, &[("pairs: 100", "pairs: 0")]);
                let stderr = real.fails(2, &["check", &name]);
                assert!(stderr.contains("`pairs` is 0"), "{stderr}");
                real.edit(&name, &[("pairs: 0", "pairs: 100")]);
            }
            _ => assert!(!real.ok(&["check", &name]).is_empty()),
        }
        names.push(name);
    }
    for expected in [
        "corrected",
        "evaluate_pair",
        "evaluate_part",
        "literal",
        "match_pair",
        "partial_match",
        "quickstart",
        "radius_variants",
        "readings",
        "reconstruction",
        "robust",
        "salient_features",
    ] {
        assert!(names.contains(&format!("{expected}.ron")), "{names:?}");
    }
}
