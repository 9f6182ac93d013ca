//! Rankings: a query and what was found.

use serde_json::{Value, json};

use crate::Desk;

const GRAPH: &str = r#"(format: 1, nodes: {
    "a": synthesize(vertices: 500, pose: 0), "b": synthesize(vertices: 500, pose: 1),
    "c": synthesize(species: Horse, vertices: 500, pose: 0), "d": synthesize(species: Horse, vertices: 500, pose: 1),
    "sa": volume_signature(mesh: "a"), "sb": volume_signature(mesh: "b"),
    "sc": volume_signature(mesh: "c"), "sd": volume_signature(mesh: "d"),
    "similarity": signature_similarity(signatures: ["sa", "sb", "sc", "sd"]),
    "ranking": rank(similarity: "similarity"),
    "metrics": retrieval_metrics(ranking: "ranking", folders: [("0", "cat"), ("1", "cat"), ("2", "horse"), ("3", "horse")]),
}, show: ["ranking", "metrics"])"#;

#[test]
fn a_query_and_the_first_that_were_found_are_shown_with_their_classes() {
    let desk = Desk::new();
    std::fs::write(desk.path("ranks.ron"), GRAPH).unwrap();
    let Some(window) = desk.report(&["run", "ranks.ron"]) else { return };
    let ranking = desk.salient(&["get", "ranks.ron", "ranking"]).output().unwrap().stdout;
    let ranking: Value = serde_json::from_slice(&ranking).unwrap();
    let class = |name: &str| if ["0", "1"].contains(&name) { "cat" } else { "horse" };
    for query in 0..4 {
        assert_eq!(window.js("return salient.state.query", &[]), json!(query));
        let panels = window.js(
            "return salient.panels().map((it) => [it.title, salient.scene().surfaces[it.surface].name, it.caption.innerText, it.verdict])",
            &[],
        );
        let names: Vec<&str> = ranking["lists"][query]["ranked"]
            .as_array()
            .unwrap()
            .iter()
            .map(|it| it["target"].as_str().unwrap())
            .collect();
        assert_eq!((names.len(), panels.as_array().unwrap().len()), (3, 4));
        assert_eq!(panels[0][0], json!(format!("query {query}")));
        for (rank, name) in names.iter().enumerate() {
            let panel = &panels[rank + 1];
            assert_eq!(panel[0], json!(format!("{}. {name}", rank + 1)));
            // Wires in a list are labelled by their place: signature 0 is of mesh a.
            assert_eq!(panel[1], json!(["a", "b", "c", "d"][name.parse::<usize>().unwrap()]));
            let right = class(name) == class(&query.to_string());
            assert!(panel[2].as_str().unwrap().contains(class(name)), "{panel}");
            assert_eq!(panel[3], json!(if right { "right" } else { "wrong" }));
        }
        assert!(window.drawn().iter().all(|panel| panel.pixels > 500.0));
        window.key("#stage", "n");
    }
    let charts = window.text("charts");
    for title in ["Precision and recall", "Class of the nearest shape", "mAP"] {
        assert!(charts.contains(title), "{title} is not in {charts}");
    }
    assert_eq!(window.complaints(), Vec::<String>::new());
}
