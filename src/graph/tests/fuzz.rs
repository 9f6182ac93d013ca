//! Whatever the text, there is a plan or an error, never a panic.

use proptest::prelude::*;
use salient_sdk::Registry;

use super::toys::{Folder, TOYS, sets_of};
use crate::graph::plan;

const GRAPH: &str = r#"// A comment with a "quotation mark.
(format: 1, params: {"files": files("*.txt"), "by": 1.5},
 over: {"shape": param("files"), "pair": pairs(of: "shape", as: ("query", "target"))}, nodes: {
    "é": source(path: each("shape"), scale: param("by")), /* another */
    "sub": graph(file: "sub.ron", x: "é"),
    "m": add(left: "sub@query", right: "sub@target", mode: Rounded),
    "r": sum(terms: all("m")),
}, show: ["r", "é[a]"], variants: {"v": set({"*/in": (offset: 2)}), "w": sweep({"m": (offset: [1, 2])})})"#;
const SUB: &str = r#"(format: 1, inputs: {"x": "number"}, nodes: {"in": add(left: "x")}, output: "in")"#;

fn folder(text: &[u8]) -> Folder {
    let folder = Folder::new(&[("sub.ron", SUB), ("a.txt", ""), ("b.txt", "")]);
    std::fs::write(folder.path().join("main.ron"), text).expect("a file");
    folder
}

/// Plans, and checks that every error has a place in its text.
fn survives(text: &[u8], set: &str) {
    let folder = folder(text);
    if let Err(report) = folder.try_plan(&sets_of(&[set])) {
        assert!(!report.is_empty());
        let json = report.json();
        for d in json.as_array().expect("an array") {
            assert!(d["start"].as_u64() <= d["end"].as_u64());
            assert!(d["message"].as_str().is_some_and(|m| !m.is_empty()));
        }
        assert!(!report.render(true).is_empty());
    }
}

#[test]
fn the_graph_itself_is_right() {
    folder(GRAPH.as_bytes()).plan();
}

#[test]
fn every_truncation() {
    for end in 0..GRAPH.len() {
        survives(&GRAPH.as_bytes()[..end], "by=1");
    }
}

#[test]
fn deep_nesting() {
    for (open, close) in [("(", ")"), ("[", "]"), ("{", "}"), ("Some(", ")"), ("(a:", ")")] {
        let text = open.repeat(50_000) + &close.repeat(50_000);
        survives(text.as_bytes(), "by=1");
        survives(format!("(format: 1, params: {{\"p\": {text}}})").as_bytes(), "by=1");
    }
    for depth in 100..140 {
        let text = "[".repeat(depth) + &"]".repeat(depth);
        survives(GRAPH.replace("1.5", &text).as_bytes(), "by=1");
    }
}

#[test]
fn a_folder_in_place_of_a_graph() {
    let folder = Folder::new(&[]);
    let registry = Registry::new(&[TOYS]).expect("distinct toys");
    let report = plan(folder.path(), &sets_of(&[]), &registry).err().expect("an error");
    assert_eq!(report.iter().next().map(|d| d.code), Some("unreadable"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn garbage(bytes in proptest::collection::vec(any::<u8>(), 0..200), set in ".{0,30}") {
        survives(&bytes, &set);
    }

    #[test]
    fn pieces_of_graphs(pieces in proptest::collection::vec((0..GRAPH.len(), 0..40_usize), 1..12)) {
        let bytes = GRAPH.as_bytes();
        let text: Vec<u8> = pieces
            .iter()
            .flat_map(|(start, len)| bytes[*start..(start + len).min(bytes.len())].to_vec())
            .collect();
        survives(&[b"(format: 1, nodes: {", text.as_slice()].concat(), "*.offset=1");
    }

    #[test]
    fn edits(at in 0..GRAPH.len(), len in 0..12_usize, new in "[\\(\\)\\[\\]{}\",:@/*a-c0-9é ]{0,6}") {
        let mut bytes = GRAPH.as_bytes().to_vec();
        let end = (at + len).min(bytes.len());
        bytes.splice(at..end, new.into_bytes());
        survives(&bytes, "v:m.offset=3");
    }
}
