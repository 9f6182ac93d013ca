//! Right graphs.

use super::toys::{Folder, listing, nodes, param, variants_of};
use crate::graph::picture::{to_dot, to_mermaid};

const SUB: &str = r#"(format: 1, inputs: {"x": "number"}, params: {"by": 1.0}, nodes: {
    "once": add(left: "x", offset: param("by")),
    "twice": add(left: "once", offset: param("by")),
}, output: "twice")"#;

fn pair() -> Folder {
    let main = r#"// A comment.
(format: 1, /* another */ nodes: {
    "a": source(path: "a.txt"), // and one more
    "b": source(path: "b.txt"),
    "fa": graph(file: "sub.ron", x: "a"),
    "fb": graph(file: "sub.ron", x: "b", by: 2.5),
    "match": add(left: "fa", right: "fb"),
}, show: ["match"])"#;
    Folder::new(&[("main.ron", main), ("sub.ron", SUB), ("a.txt", ""), ("b.txt", "")])
}

#[test]
fn subgraphs_open_and_wires_pass_through() {
    let folder = pair();
    let plan = folder.plan();
    insta::assert_snapshot!(listing(&plan), @r#"
a = source() {"path":"a.txt","scale":0.0}
b = source() {"path":"b.txt","scale":0.0}
fa/once = add(left: a) {"mode":"Exact","offset":1.0,"table":null}
fa/twice fa = add(left: fa/once) {"mode":"Exact","offset":1.0,"table":null}
fb/once = add(left: b) {"mode":"Exact","offset":2.5,"table":null}
fb/twice fb = add(left: fb/once) {"mode":"Exact","offset":2.5,"table":null}
match = add(left: fa/twice, right: fb/twice) {"mode":"Exact","offset":0.0,"table":null}
"#);
    assert_eq!(plan.show.len(), 1);
    assert_eq!(plan.name(plan.show[0].call), "match");
    assert_eq!(plan.dag[plan.addresses["a"]].files["path"], folder.path().join("a.txt"));
    let read: Vec<_> = ["main.ron", "sub.ron"].map(|f| folder.path().join(f)).into();
    assert_eq!(plan.planned_from, read);
}

#[test]
fn a_wire_may_reach_into_a_subgraph() {
    let folder = pair();
    folder.write(
        "main.ron",
        r#"(format: 1, nodes: {
        "a": source(path: "a.txt"), "fa": graph(file: "sub.ron", x: "a"),
        "end": add(left: "fa/once"),
    }, show: ["end", "fa"])"#,
    );
    let plan = folder.plan();
    assert!(listing(&plan).contains("end = add(left: fa/once)"));
    assert_eq!(plan.show[1].call, plan.addresses["fa/twice"]);
}

#[test]
fn equal_calls_are_one() {
    // Written differently, but the same: order of fields, a default, a number, a path.
    let folder = nodes(
        r#""a": source(path: "a.txt", scale: 1.0), "b": source(scale: 1, path: "./a.txt"),
        "c": add(left: "a", offset: 0.0), "d": add(left: "b", mode: Exact)"#,
        "d",
    );
    let plan = folder.plan();
    assert_eq!(plan.dag.node_count(), 2, "{}", listing(&plan));
    assert_eq!(plan.dag[plan.addresses["c"]].addresses, ["c", "d"]);
}

#[test]
fn an_output_is_shown_where_nothing_else_is() {
    let folder = Folder::new(&[("main.ron", r#"(format: 1, nodes: {"a": say(), "b": say()}, output: "a")"#)]);
    assert_eq!(folder.plan().show[0].address, "a");
}

#[test]
fn a_port_for_many_takes_a_list_or_one() {
    let folder = nodes(
        r#""a": source(path: "a.txt"), "b": source(path: "b.txt"),
        "all": sum(terms: ["b", "a"]), "one": sum(terms: "a")"#,
        "all",
    );
    let text = listing(&folder.plan());
    assert!(text.contains("all = sum(terms[0]: b, terms[1]: a)"), "{text}");
    assert!(text.contains("one = sum(terms[0]: a)"), "{text}");
}

#[test]
fn files_of_a_subgraph_are_beside_it() {
    let folder = Folder::new(&[
        ("main.ron", r#"(format: 1, nodes: {"s": graph(file: "in/sub.ron", other: "a.txt")}, show: ["s"])"#),
        (
            "in/sub.ron",
            r#"(format: 1, params: {"other": "never.txt"}, nodes: {
                "own": source(path: "a.txt"), "given": source(path: param("other")),
                "end": add(left: "own", right: "given"),
            }, output: "end")"#,
        ),
        ("a.txt", ""),
        ("in/a.txt", ""),
    ]);
    let plan = folder.plan();
    let file = |address: &str| plan.dag[plan.addresses[address]].files["path"].clone();
    assert_eq!(file("s/own"), folder.path().join("in/a.txt"));
    assert_eq!(file("s/given"), folder.path().join("a.txt"));
}

fn variants() -> Folder {
    let folder = pair();
    folder.write(
        "variants.ron",
        r#"(format: 1, base: "main.ron", variants: {
            "paper": set({}),
            "rounded": set({"*/twice": (mode: Rounded)}),
            "offset": sweep({"*/twice": (offset: [1.0, 2.0]), "match": (offset: [3.0, 4.0])}),
            "both": zip({"fa/twice": (offset: [1, 2], mode: [Exact, Rounded])}),
            "by": sweep({"fa": (by: [7.0])}),
        }, show: ["match"])"#,
    );
    let text = std::fs::read_to_string(folder.path().join("variants.ron")).unwrap();
    std::fs::rename(folder.path().join("main.ron"), folder.path().join("base.ron")).unwrap();
    folder.write("main.ron", &text.replace("main.ron", "base.ron"));
    folder
}

#[test]
fn variants_share_what_is_equal() {
    let plan = variants().plan();
    insta::assert_snapshot!(plan.variants.join("\n"), @r"
paper
rounded
offset[*/twice.offset=1.0,match.offset=3.0]
offset[*/twice.offset=1.0,match.offset=4.0]
offset[*/twice.offset=2.0,match.offset=3.0]
offset[*/twice.offset=2.0,match.offset=4.0]
both[offset=1,mode=Exact]
both[offset=2,mode=Rounded]
by[by=7.0]
");
    // The sources and `once` are the same call in all variants but the last.
    let once = plan.addresses["paper:fa/once"];
    assert_eq!(once, plan.addresses["rounded:fa/once"]);
    assert_ne!(once, plan.addresses["by[by=7.0]:fa/once"]);
    assert_eq!(plan.addresses["paper:a"], plan.addresses["by[by=7.0]:a"]);
    assert_eq!(param(&plan, "rounded:fa", "mode"), "Rounded");
    assert_eq!(param(&plan, "offset[*/twice.offset=2.0,match.offset=3.0]:match", "offset"), 3.0);
    assert_eq!(param(&plan, "both[offset=2,mode=Rounded]:fa", "mode"), "Rounded");
    assert_eq!(plan.show.len(), plan.variants.len());
    assert_eq!(plan.show[0].address, "paper:match");
}

#[test]
fn variants_are_selected_by_name_or_group() {
    let folder = variants();
    let names = |wanted: &[&str]| folder.try_plan(&variants_of(wanted)).unwrap().variants;
    assert_eq!(names(&["rounded"]), ["rounded"]);
    assert_eq!(names(&["offset"]).len(), 4);
    assert_eq!(names(&["both[offset=1,mode=Exact]", "paper"]), ["paper", "both[offset=1,mode=Exact]"]);
    let errors = folder.errors_with(&variants_of(&["papre"]));
    assert_eq!(errors, ["unknown-variant @papre@ the graph has no variant `papre` | did you mean `paper`?"]);
}

#[test]
fn variants_may_have_nodes_of_their_own() {
    let folder = Folder::new(&[(
        "main.ron",
        r#"(format: 1, nodes: {"a": source(path: "main.ron", scale: 1)},
            variants: {"half": set({"a": (scale: 0.5)})}, show: ["a"])"#,
    )]);
    assert_eq!(param(&folder.plan(), "half:a", "scale"), 0.5);
}

#[test]
fn pictures() {
    let folder = nodes(r#""a": source(path: "a.txt"), "end": add(left: "a")"#, "end");
    let plan = folder.plan();
    insta::assert_snapshot!(to_dot(&plan), @r#"
digraph plan {
    rankdir=LR;
    node [shape=box, fontname="sans-serif"];
    n0 [label="a\nsource"];
    n1 [label="end\nadd", peripheries=2];
    n0 -> n1 [label="left"];
}
"#);
    insta::assert_snapshot!(to_mermaid(&plan), @r#"
flowchart LR
    n0["a<br/>source"]
    n1(["end<br/>add"])
    n0 -->|left| n1
"#);
}
