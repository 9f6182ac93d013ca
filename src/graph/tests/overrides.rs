//! `--set`.

use super::toys::{Folder, nodes, param, sets_of};
use crate::graph::overrides::matches;
use proptest::prelude::*;

fn folder() -> Folder {
    Folder::new(&[
        (
            "main.ron",
            r#"(format: 1, params: {"by": 3.0, "from": "a.txt"}, nodes: {
            "a": source(path: param("from")),
            "end": add(left: "a", offset: param("by")),
            "sub": graph(file: "sub.ron", x: "end"),
        }, show: ["sub"])"#,
        ),
        (
            "sub.ron",
            r#"(format: 1, inputs: {"x": "number"}, params: {"by": 1.0}, nodes: {
            "in": add(left: "x", offset: param("by")) }, output: "in")"#,
        ),
        ("other.ron", r#"(format: 1, inputs: {"x": "number"}, nodes: {"else": add(left: "x")}, output: "else")"#),
        ("a.txt", ""),
        ("b.txt", ""),
    ])
}

#[test]
fn a_param_of_a_node_a_subgraph_or_the_graph() {
    let folder = folder();
    let plan = |set: &str| folder.plan_with(&[set]);
    assert_eq!(param(&plan("by=4.5"), "end", "offset"), 4.5);
    assert_eq!(param(&plan("end.offset=5"), "end", "offset"), 5.0);
    assert_eq!(param(&plan("sub/in.mode = Rounded"), "sub/in", "mode"), "Rounded");
    assert_eq!(param(&plan("*in.offset=6"), "sub/in", "offset"), 6.0);
    assert_eq!(param(&plan("sub.by=7"), "sub/in", "offset"), 7.0);
    assert_eq!(param(&plan("sub.by=param(\"by\")"), "sub/in", "offset"), 3.0);
    // The last one wins.
    let both = folder.plan_with(&["end.offset=5", "*.offset=6"]);
    assert_eq!(param(&both, "end", "offset"), 6.0);
}

#[test]
fn paths_are_relative_to_the_working_directory() {
    let folder = folder();
    let manifest = "a.path=\"Cargo.toml\"";
    let plan = folder.plan_with(&[manifest]);
    assert_eq!(plan.dag[plan.addresses["a"]].files["path"], std::path::Path::new("Cargo.toml"));
    let errors = folder.errors_with(&sets_of(&["from=\"b.txt\""]));
    assert_eq!(errors.len(), 1, "{errors:?}");
    assert!(errors[0].starts_with("missing-file @\"b.txt\"@ the file b.txt does not exist"));
}

#[test]
fn another_file_for_a_subgraph() {
    let folder = folder();
    let other = folder.path().join("other.ron");
    let plan = folder.plan_with(&[&format!("sub.file=\"{}\"", other.display())]);
    assert!(plan.addresses.contains_key("sub/else"));
}

#[test]
fn set_wins_over_the_variant_and_may_name_one() {
    let folder = Folder::new(&[(
        "main.ron",
        r#"(format: 1, nodes: {"a": source(path: "main.ron", scale: 1)}, variants: {
            "two": set({"a": (scale: 2)}), "more": sweep({"a": (scale: [3, 4])}),
        }, show: ["a"])"#,
    )]);
    let all = folder.plan_with(&["a.scale=9"]);
    for address in ["two:a", "more[scale=3]:a", "more[scale=4]:a"] {
        assert_eq!(param(&all, address, "scale"), 9.0);
    }
    let some = folder.plan_with(&["more:a.scale=9", "more[scale=4]:a.scale=8"]);
    assert_eq!(param(&some, "two:a", "scale"), 2.0);
    assert_eq!(param(&some, "more[scale=3]:a", "scale"), 9.0);
    assert_eq!(param(&some, "more[scale=4]:a", "scale"), 8.0);
}

#[test]
fn variants_change_named_values_of_the_graph_and_with_them_its_axes() {
    let folder = Folder::new(&[
        (
            "base.ron",
            r#"(format: 1, params: {"by": 1.0, "shapes": files("*.txt")}, over: {"shape": param("shapes")}, nodes: {
            "a": source(path: each("shape")),
            "sum": sum(terms: all("a")),
            "end": add(left: "sum", offset: param("by")),
        }, show: ["end"])"#,
        ),
        (
            "main.ron",
            r#"(format: 1, base: "base.ron", variants: {
            "few": set({"shapes": files("a*.txt"), "a": (scale: 2)}),
            "one": set({"a[b]": (scale: 3)}),
            "by": sweep({"by": [2.0, 3.0], "end": (mode: [Exact, Rounded])}),
            "both": zip({"by": [4.0, 5.0], "shapes": [files("a*.txt"), files("b*.txt")]}),
        })"#,
        ),
        ("a1.txt", ""),
        ("a2.txt", ""),
        ("b.txt", ""),
    ]);
    let plan = folder.plan();
    assert_eq!(
        plan.variants,
        [
            "few",
            "one",
            "by[mode=Exact,by=2.0]",
            "by[mode=Exact,by=3.0]",
            "by[mode=Rounded,by=2.0]",
            "by[mode=Rounded,by=3.0]",
            "both[by=4.0,shapes=files(\"a*.txt\")]",
            "both[by=5.0,shapes=files(\"b*.txt\")]",
        ]
    );
    assert_eq!(param(&plan, "few:a[a2]", "scale"), 2.0);
    assert!(!plan.addresses.contains_key("few:a[b]"));
    assert_eq!((param(&plan, "one:a[b]", "scale"), param(&plan, "one:a[a1]", "scale")), (3.0.into(), 0.0.into()));
    assert_eq!(param(&plan, "by[mode=Rounded,by=3.0]:end", "offset"), 3.0);
    assert_eq!(param(&plan, "both[by=5.0,shapes=files(\"b*.txt\")]:end", "offset"), 5.0);
    assert_eq!(plan.addresses.keys().filter(|a| a.starts_with("both[by=5.0") && a.contains(":a[")).count(), 1);
    // What variants share is one call.
    assert_eq!(plan.addresses["one:a[a1]"], plan.addresses["by[mode=Exact,by=2.0]:a[a1]"]);
    // `--set` wins, and a base's variants are there beside one's own.
    let set = folder.plan_with(&["by=9.0"]);
    assert_eq!(param(&set, "by[mode=Exact,by=2.0]:end", "offset"), 9.0);
    std::fs::rename(folder.path().join("main.ron"), folder.path().join("mid.ron")).unwrap();
    folder.write(
        "main.ron",
        r#"(format: 1, base: "mid.ron", variants: {"low": set({"by": 0.5})}, show: ["sum", "end"])"#,
    );
    let deep = folder.plan();
    assert_eq!(deep.variants.len(), 9);
    assert_eq!(param(&deep, "low:end", "offset"), 0.5);
    assert_eq!(deep.show.iter().filter(|shown| shown.address.starts_with("few:")).count(), 2);
    folder.write("main.ron", r#"(format: 1, base: "base.ron", variants: {"w": set({"bye": 1.0})})"#);
    assert_eq!(folder.errors(), ["override-unmatched @\"bye\"@ the graph has no param `bye` | did you mean `by`?"]);
}

#[test]
fn wrong_sets_point_into_their_own_text() {
    let folder = folder();
    let one = |set: &str| {
        let errors = folder.errors_with(&sets_of(&[set]));
        assert_eq!(errors.len(), 1, "{errors:?}");
        errors[0].clone()
    };
    let report = folder.report(&sets_of(&["end.offset=-1"]));
    let json = report.json();
    assert_eq!(json[0]["file"], "--set");
    assert_eq!((json[0]["start"].as_u64(), json[0]["end"].as_u64()), (Some(11), Some(13)));
    insta::assert_snapshot!(
        [
            one("end.offset=-1"),
            one("edn.offset=1"),
            one("end.ofset=1"),
            one("end.left=\"a\""),
            one("*.left=\"a\""),
            one("bye=1"),
            one("end=1"),
            one("a.path=b.txt"),
            one("nothing"),
            one("nowhere:end.offset=1"),
        ]
        .join("\n"),
        @r#"
bad-param @-1@ `offset` is -1; it must be at least 0 | `offset` (number): What to add.
override-unmatched @edn@ no node matches `edn` | did you mean `end`?
unknown-param @ofset@ no node that matches `end` has a param `ofset`: `add` does not | did you mean `offset`?
override-wire @left@ `left` of `end` is a wire, which cannot be overridden | only params can be set; change the wire in the graph file
override-wire @left@ `left` of `*` is a wire, which cannot be overridden | only params can be set; change the wire in the graph file
override-unmatched @bye@ the graph has no param `bye` | did you mean `by`?
override-unmatched @end@ the graph has no param `end` | `end` is a node; set a param of it with --set end.PARAM=VALUE
syntax @.@ nothing may follow the value | the value is RON: text needs quotation marks, as in --set 'a.path="cat.off"'
bad-set @nothing@ this is not of the form NODE.PARAM=VALUE or PARAM=VALUE | for example --set 'fa/patches.radius=2.0'
unknown-variant @nowhere:end@ no variant that is planned matches `nowhere` | there are no variants planned here
"#
    );
}

#[test]
fn a_wrong_set_does_not_hide_errors_of_the_graph() {
    let folder = nodes(r#""a": sorce(path: "a.txt")"#, "a");
    let errors = folder.errors_with(&sets_of(&["a.path=\"x"]));
    assert_eq!(errors.len(), 2, "{errors:?}");
}

/// The plainest matcher there is.
fn slow(pattern: &[u8], text: &[u8]) -> bool {
    match (pattern.first(), text.first()) {
        (None, None) => true,
        (Some(b'*'), _) => slow(&pattern[1..], text) || (!text.is_empty() && slow(pattern, &text[1..])),
        (Some(p), Some(t)) => p == t && slow(&pattern[1..], &text[1..]),
        _ => false,
    }
}

proptest! {
    #[test]
    fn patterns_match_as_defined(pattern in "[ab*]{0,7}", text in "[ab]{0,8}") {
        prop_assert_eq!(matches(&pattern, &text), slow(pattern.as_bytes(), text.as_bytes()));
    }
}
