//! Wrong graphs: each error has its place and its hint.

use super::toys::{Folder, nodes};

/// The single error of a graph whose nodes are these.
fn one(text: &str) -> String {
    let errors = nodes(text, "a").errors();
    assert_eq!(errors.len(), 1, "{errors:#?}");
    errors[0].clone()
}

/// The single error of a graph file.
fn file(text: &str) -> String {
    let errors = Folder::new(&[("main.ron", text), ("a.txt", "")]).errors();
    assert_eq!(errors.len(), 1, "{errors:#?}");
    errors[0].clone()
}

const SUB: &str = r#"(format: 1, inputs: {"x": "number"}, params: {"by": 1.0},
    nodes: {"in": add(left: "x", offset: param("by"))}, output: "in")"#;

/// The single error of a call of `sub.ron` with this text.
fn sub(call: &str, text: &str) -> String {
    let main = format!(r#"(format: 1, nodes: {{"a": source(path: "a.txt"), "w": say(), "s": {call}}}, show: ["a"])"#);
    let folder = Folder::new(&[("main.ron", &main), ("sub.ron", text), ("a.txt", "")]);
    let errors = folder.errors();
    assert_eq!(errors.len(), 1, "{errors:#?}");
    errors[0].clone()
}

#[test]
fn calls() {
    let a = r#""a": source(path: "a.txt")"#;
    insta::assert_snapshot!(
        [
            one(r#""a": sorce(path: "a.txt")"#),
            one(r#""a": source(pth: "x", path: "a.txt")"#),
            one(r#""a": source()"#),
            one(r#""a": source(path: "c.txt")"#),
            one(r#""a": source(path: "a.txt", scale: 11)"#),
            one(r#""a": source(path: "a.txt", scale: "big")"#),
            one(r#""a": source(path: 3)"#),
            one(r#""a": source(path: "a.txt", path: "a.txt")"#),
            one(r#""a": source(path: param("p"))"#),
            one(r#""a": source("a.txt")"#),
            one(r#""a": source"#),
            one(&format!(r#"{a}, "a": say()"#)),
            one(&format!(r#"{a}, "b/c": say()"#)),
            one(&format!(r#"{a}, "b": add(left: "aa")"#)),
            one(&format!(r#"{a}, "b": add(left: "w"), "w": say()"#)),
            one(&format!(r#"{a}, "b": add()"#)),
            one(&format!(r#"{a}, "b": add(left: 3)"#)),
            one(&format!(r#"{a}, "b": add(left: ["a"])"#)),
            one(&format!(r#"{a}, "b": add(left: param("x"))"#)),
            one(&format!(r#"{a}, "b": add(left: "a", mode: Ruonded)"#)),
            one(&format!(r#"{a}, "b": add(left: "a", mode: Rounded, table: "t.csv")"#)),
        ]
        .join("\n"),
        @r#"
unknown-kind @sorce@ there is no kind of node `sorce` | did you mean `source`?
unknown-field @pth@ `source` has no port or param `pth` | did you mean `path`?
missing-param @source@ `source` needs the param `path` | add `path: ..`: file, The file to read.
missing-file @"c.txt"@ the file c.txt does not exist | did you mean `a.txt`?
bad-param @11@ `scale` is 11; it must be from 0 to 10 | `scale` (number): What to multiply by.
bad-param @"big"@ `scale`: expected float | `scale` (number): What to multiply by.
bad-param @3@ `path`: expected string | `path` (file): The file to read.
duplicate @path@ there are two fields `path` | remove or rename one of them
unknown-param @"p"@ the graph has no param `p` | there are no params of the graph here
syntax @source("a.txt")@ a node is written as a call of its kind | for example `load(path: "cat.off")`; each field has a name
syntax @source@ a node is written as a call of its kind | for example `load(path: "cat.off")`; each field has a name
duplicate @"a"@ there are two nodes `a` | remove or rename one of them
bad-name @"b/c"@ `b/c` cannot be the name of a node | names are made of letters, digits, `_` and `-`
unknown-node @"aa"@ there is no node `aa` | did you mean `a`?
wrong-type @"w"@ `left` of `add` takes `number`, but this is `words` | nodes here that make `number`: `a`
missing-input @add@ the input `left` of `add` is not wired | add `left: ".."`, the name of a node that makes `number`
bad-wire @3@ a port is wired to a node | write the name of a node: `"mesh"`, `"mesh@query"` or `all("mesh")`
bad-wire @["a"]@ `left` takes one wire, not a list | write the name of one node
bad-wire @param("x")@ a param cannot be wired to a port | write the name of a node: `"mesh"`, `"mesh@query"` or `all("mesh")`
bad-param @Ruonded@ `mode`: unexpected variant named `Ruonded` in enum `Mode`, expected either `Exact` or `Rounded` instead | did you mean `Rounded`?
missing-file @"t.csv"@ the file t.csv does not exist |
"#
    );
}

#[test]
fn cycles() {
    insta::assert_snapshot!(
        [
            one(r#""a": add(left: "a")"#),
            one(r#""a": add(left: "c"), "b": add(left: "a"), "c": add(left: "b"), "d": add(left: "a")"#),
        ]
        .join("\n"),
        @r#"
cycle @"a"@ these nodes feed each other: a -> a | one of these wires has to go
cycle @"c"@ these nodes feed each other: a -> b -> c -> a | one of these wires has to go
"#
    );
    let through = Folder::new(&[
        ("sub.ron", SUB),
        ("main.ron", r#"(format: 1, nodes: {"a": graph(file: "sub.ron", x: "b"), "b": add(left: "a")}, show: ["b"])"#),
    ]);
    insta::assert_snapshot!(through.errors().join("\n"), @r#"cycle @"x"@ these nodes feed each other: a/in -> b -> a/in | one of these wires has to go"#);
    let pass = Folder::new(&[
        ("sub.ron", r#"(format: 1, inputs: {"x": "number"}, nodes: {}, output: "x")"#),
        ("main.ron", r#"(format: 1, nodes: {"a": graph(file: "sub.ron", x: "a")}, show: ["a"])"#),
    ]);
    insta::assert_snapshot!(pass.errors().join("\n"), @r#"cycle @"x"@ this wire leads back to itself |"#);
}

#[test]
fn files() {
    insta::assert_snapshot!(
        [
            file(""),
            file("{}"),
            file("(format: 1, nodes: {\"a\": say(}, show: [\"a\"])"),
            file("(format: 1, nodes: {\"a\": say() \"b\": say()}, show: [\"a\"])"),
            file("(format: 1, nodes: {\"a: say()}, show: [\"a\"])"),
            file("#![enable(unwrap_newtypes)]\n(format: 1, nodes: {\"a\": say()}, show: [\"a\"])"),
            file("(format: 2, nodes: {\"a\": say()}, show: [\"a\"])"),
            file("(nodes: {\"a\": say()}, show: [\"a\"])"),
            file("(format: 1, node: {}, nodes: {\"a\": say()}, show: [\"a\"])"),
            file("(format: 1, format: 1, nodes: {\"a\": say()}, show: [\"a\"])"),
            file("(format: 1, nodes: {\"a\": say()})"),
            file("(format: 1, nodes: {\"a\": say()}, show: [])"),
            file("(format: 1, nodes: {\"a\": say()}, show: \"a\")"),
            file("(format: 1, nodes: {\"a\": say()}, show: [\"b\"])"),
            file("(format: 1, nodes: {\"a\": say()}, show: [\"a\", \"a\"])"),
            file("(format: 1, nodes: {a: say()}, show: [\"a\"])").replace('\n', " "),
            file("(format: 1, params: {\"p\": 1, \"p\": 2}, nodes: {\"a\": say()}, show: [\"a\"])"),
            file("(format: 1, params: {\"p\": param(\"p\")}, nodes: {\"a\": source(path: param(\"p\"))}, show: [\"a\"])"),
            file("(format: 1, nodes: {\"a\": say()}, show: [\"a\"], base: \"no.ron\")"),
            file("(format: 1, nodes: {\"a\": say()}, show: [\"a\"], base: \"main.ron\")"),
            file("(format: 1, nodes: {\"a\": say()}, show: [\"a\"], variants: {\"v\": sett({})})"),
            file("(format: 1, nodes: {\"a\": say()}, show: [\"a\"], variants: {\"v\": set({\"b\": (x: 1)})})"),
            file("(format: 1, nodes: {\"a\": say()}, show: [\"a\"], variants: {\"v\": set({\"a\": (x: 1)})})"),
            file("(format: 1, nodes: {\"a\": say()}, show: [\"a\"], variants: {\"v\": sweep({\"a\": (x: 1)})})"),
        ]
        .join("\n"),
        @r#"
syntax @@ the text ends where a value or a closing bracket should be | 
syntax @{}@ a graph file is a record in round brackets | begin with `(format: 1, nodes: {`
syntax @}@ unexpected char '}' | 
syntax @"@ a comma or a closing bracket is missing here | 
syntax @a@ a colon is missing here | 
syntax @#![enable(unwrap_newtypes)]@ graph files take no RON extensions | delete this line; `implicit_some` is always on
format @2@ format 2 is not known to this version | the format of graphs is 1
format @(@ the graph does not say which format it is in | begin with `(format: 1,`
unknown-field @node@ a graph has no field `node` | did you mean `nodes`?
duplicate @format@ there are two fields `format` | remove or rename one of them
nothing-shown @(@ the graph shows nothing, so there is nothing to do | say which results are wanted: `show: [".."]`
nothing-shown @(@ the graph shows nothing, so there is nothing to do | say which results are wanted: `show: [".."]`
syntax @"a"@ what is shown is a list of names | for example `show: ["match"]`
unknown-node @"b"@ there is no node `b` | the nodes are `a`
duplicate @"a"@ `a` is shown twice | remove one of them
syntax @a@ a name here is written in quotation marks | write "a"
duplicate @"p"@ there are two params `p` | remove or rename one of them
cycle @param("p")@ this param is made of itself | 
unreadable @"no.ron"@ cannot read the graph no.ron: No such file or directory (os error 2) | 
recursion @"main.ron"@ this file uses itself: main.ron -> main.ron | a graph cannot contain itself
syntax @sett({})@ a variant is `set({..})`, `sweep({..})` or `zip({..})` | for example `set({"*/patches": (radius: 2.0)})`, or `sweep` or `zip` with lists of values
override-unmatched @"b"@ no node matches `b` | the nodes are `a`
unknown-param @x@ no node that matches `a` has a param `x`: `say` does not | there are no params here
bad-sweep @1@ a list of values is expected here | for example `x: [1.0, 2.0]`
"#
    );
}

#[test]
fn subgraphs() {
    let good = r#"graph(file: "sub.ron", x: "a")"#;
    insta::assert_snapshot!(
        [
            sub(r#"graph(file: "sub.ron")"#, SUB),
            sub(r#"graph(file: "sub.ron", x: "w")"#, SUB),
            sub(r#"graph(file: "sub.ron", x: "b")"#, SUB),
            sub(r#"graph(file: "sub.ron", x: "a", bye: 1)"#, SUB),
            sub(r#"graph(file: "sub.ron", x: "a", by: "b")"#, SUB),
            sub(r#"graph(file: "sup.ron", x: "a")"#, SUB),
            sub(r#"graph(x: "a")"#, SUB),
            sub(good, "(format: 1, inputs: {\"x\": \"number\"}"),
            sub(good, &SUB.replace("output", "show").replace("\"in\")", "[\"in\"])")),
            sub(good, &SUB.replace("output: \"in\"", "output: \"out\"")),
            sub(good, &SUB.replace("\"x\": \"number\"", "\"x\": \"numbre\"")),
            sub(r#"graph(file: "sub.ron", x: "a", y: "a")"#, &SUB.replace("\"x\": \"number\"", "\"x\": \"number\", \"y\": \"number\"")),
            sub(good, &SUB.replace("left: \"x\"", "left: \"y\"")),
            sub(good, r#"(format: 1, inputs: {"x": "number"}, nodes: {"in": graph(file: "sub.ron", x: "x")}, output: "in")"#),
            sub(good, r#"(format: 1, inputs: {"x": "number"}, nodes: {"in": graph(file: "main.ron", x: "x")}, output: "in")"#),
        ]
        .join("\n"),
        @r#"
missing-input @graph@ the input `x` is not wired | add `x: ".."`, the name of a node that makes `number`
wrong-type @"w"@ the input `x` takes `number`, but this is `words` | nodes here that make `number`: `a`
unknown-node @"b"@ there is no node `b` | the nodes are `a`, `s`, `w`
unknown-field @bye@ sub.ron has no input or param `bye` | did you mean `by`?
bad-param @"b"@ `offset`: expected float | `offset` (number): What to add.
unreadable @"sup.ron"@ cannot read the graph sup.ron: No such file or directory (os error 2) | 
missing-param @graph@ the subgraph call does not name its file | add `file: "sub.ron"`
syntax @}@ a comma or a closing bracket is missing here | 
bad-subgraph @"sub.ron"@ sub.ron has no output | name its result there: `output: ".."`
unknown-node @"out"@ there is no node `out` | the nodes are `in`, `x`
unknown-type @"numbre"@ no node makes a `numbre` | did you mean `number`?
unused-input @"y"@ nothing is wired to the input `y` | wire it to a node, or remove it
unknown-node @"y"@ there is no node `y` | the nodes are `in`, `x`
recursion @"sub.ron"@ this file uses itself: main.ron -> sub.ron -> sub.ron | a graph cannot contain itself
recursion @"main.ron"@ this file uses itself: main.ron -> sub.ron -> main.ron | a graph cannot contain itself
"#
    );
    let unused = Folder::new(&[
        (
            "main.ron",
            r#"(format: 1, nodes: {"a": source(path: "main.ron"), "s": graph(file: "sub.ron", x: "a")}, show: ["s"])"#,
        ),
        ("sub.ron", r#"(format: 1, inputs: {"x": "number"}, nodes: {"in": say()}, output: "in")"#),
    ]);
    insta::assert_snapshot!(unused.errors().join("\n"), @r#"unused-input @"x"@ nothing is wired to the input `x` | wire it to a node, or remove it"#);
    let open = Folder::new(&[("main.ron", SUB)]);
    insta::assert_snapshot!(open.errors().join("\n"), @r#"open-input @"x"@ the input `x` is open: this graph can only be called | call it with `graph(file: ..)`"#);
}

#[test]
fn all_errors_at_once_in_order_and_each_once() {
    let folder = Folder::new(&[
        (
            "main.ron",
            "(format: 1, nodes: {\n    \"a\": source(path: \"no.txt\", scale: 99),\n    \"é\": sum(term: \"a\"),\n    \"f\": graph(file: \"sub.ron\", x: \"a\"),\n    \"g\": graph(file: \"sub.ron\", x: \"a\"),\n}, show: [\"z\"])",
        ),
        ("sub.ron", &SUB.replace("offset: ", "ofset: ")),
    ]);
    insta::assert_snapshot!(folder.errors().join("\n"), @r#"
missing-file @"no.txt"@ the file no.txt does not exist | 
bad-param @99@ `scale` is 99; it must be from 0 to 10 | `scale` (number): What to multiply by.
missing-input @sum@ the input `terms` of `sum` is not wired | add `terms: ".."`, the name of a node that makes `number`
unknown-field @term@ `sum` has no port or param `term` | did you mean `terms`?
unknown-node @"z"@ there is no node `z` | the nodes are `a`, `f`, `g`, `é`
unknown-field @ofset@ `add` has no port or param `ofset` | did you mean `offset`?
"#);
    let report = folder.report(&crate::graph::Overrides::default());
    let json = report.json();
    let keys: Vec<&String> = json[0].as_object().unwrap().keys().collect();
    assert_eq!(keys, ["code", "column", "end", "file", "hint", "line", "message", "start"]);
    let place = |i: usize| ["start", "end", "line", "column"].map(|k| json[i][k].as_u64().unwrap());
    assert_eq!(place(0)[2..], [2, 23]);
    // Columns count characters: the name of the third line's node has two bytes.
    assert!(json.as_array().unwrap().iter().any(|d| d["line"] == 3 && d["column"] == 14));
}

#[test]
fn errors_are_shown_with_their_text() {
    let folder = nodes(r#""a": sorce(path: "a.txt")"#, "a");
    let report = folder.report(&crate::graph::Overrides::default());
    let text = report.render(false).replace(&folder.path().display().to_string(), "");
    insta::assert_snapshot!(text, @r#"
unknown-kind

  × there is no kind of node `sorce`
   ╭─[/main.ron:1:26]
 1 │ (format: 1, nodes: {"a": sorce(path: "a.txt")}, show: ["a"])
   ·                          ─────
   ╰────
  help: did you mean `source`?
"#);
}
