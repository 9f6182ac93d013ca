//! Axes: files, lists, pairs, gathering, names of instances.

use super::toys::{Folder, listing, param, sets_of};

fn retrieval(files: &[&str], extra: &str) -> Folder {
    let main = format!(
        r#"(format: 1, params: {{"shapes": files("in/*.txt")}},
        over: {{"shape": param("shapes"), "pair": pairs(of: "shape", as: ("query", "target"))}},
        nodes: {{
            "mesh": source(path: each("shape")),
            "features": add(left: "mesh"),
            "match": add(left: "features@query", right: "features@target"),
            "ranking": sum(terms: all("match")),
            {extra}
        }}, show: ["ranking"])"#
    );
    let mut all = vec![("main.ron", main.as_str())];
    all.extend(files.iter().map(|f| (*f, "")));
    Folder::new(&all)
}

#[test]
fn files_pairs_and_gathering() {
    let folder = retrieval(&["in/b.txt", "in/c.txt", "in/a.txt", "in/.hidden.txt"], "");
    let plan = folder.plan();
    insta::assert_snapshot!(listing(&plan), @r#"
mesh[a] = source() {"path":"in/a.txt","scale":0.0}
mesh[b] = source() {"path":"in/b.txt","scale":0.0}
mesh[c] = source() {"path":"in/c.txt","scale":0.0}
features[a] = add(left: mesh[a]) {"mode":"Exact","offset":0.0,"table":null}
features[b] = add(left: mesh[b]) {"mode":"Exact","offset":0.0,"table":null}
features[c] = add(left: mesh[c]) {"mode":"Exact","offset":0.0,"table":null}
match[a,b] = add(left: features[a], right: features[b]) {"mode":"Exact","offset":0.0,"table":null}
match[a,c] = add(left: features[a], right: features[c]) {"mode":"Exact","offset":0.0,"table":null}
match[b,c] = add(left: features[b], right: features[c]) {"mode":"Exact","offset":0.0,"table":null}
ranking = sum(terms[a,b]: match[a,b], terms[a,c]: match[a,c], terms[b,c]: match[b,c]) {}
"#);
    assert!(plan.planned_from.contains(&folder.path().join("in")));
    assert_eq!(plan.dag[plan.addresses["mesh[b]"]].files["path"], folder.path().join("in/b.txt"));
}

#[test]
fn instances_are_shown_one_by_one_or_each() {
    let folder = retrieval(&["in/a.txt", "in/b.txt"], "");
    let text = std::fs::read_to_string(folder.path().join("main.ron")).unwrap();
    folder.write("main.ron", &text.replace("[\"ranking\"]", "[\"mesh\", \"features[b]\"]"));
    let shown: Vec<String> = folder.plan().show.into_iter().map(|s| s.address).collect();
    assert_eq!(shown, ["mesh[a]", "mesh[b]", "features[b]"]);
    folder.write("main.ron", &text.replace("[\"ranking\"]", "[\"mesh[c]\"]"));
    let errors = folder.errors();
    assert_eq!(errors, ["unknown-node @\"mesh[c]\"@ `mesh` has no instance `c` | the instances are `a`, `b`"]);
}

#[test]
fn an_axis_of_values_and_a_constant() {
    let folder = Folder::new(&[
        (
            "main.ron",
            r#"(format: 1, over: {"by": [1.0, 2.5], "mode": [Exact, Rounded]}, nodes: {
            "a": source(path: "a.txt"),
            "plus": add(left: "a", offset: each("by")),
            "again": add(left: "plus", right: "a"),
            "other": add(left: "a", mode: each("mode")),
        }, show: ["again"])"#,
        ),
        ("a.txt", ""),
    ]);
    let plan = folder.plan();
    assert_eq!(param(&plan, "plus[2.5]", "offset"), 2.5);
    assert_eq!(param(&plan, "other[Rounded]", "mode"), "Rounded");
    assert!(listing(&plan).contains("again[2.5] = add(left: plus[2.5], right: a)"));
}

#[test]
fn an_axis_of_listed_files_is_named_by_stems() {
    let folder = Folder::new(&[
        (
            "main.ron",
            r#"(format: 1, over: {"shape": ["in/a.txt", "in/b.c.txt"]}, nodes: {
            "mesh": source(path: each("shape")) }, show: ["mesh"])"#,
        ),
        ("in/a.txt", ""),
        ("in/b.c.txt", ""),
    ]);
    let plan = folder.plan();
    assert_eq!(plan.addresses.keys().collect::<Vec<_>>(), ["mesh[a]", "mesh[b.c]"]);
    assert_eq!(param(&folder.plan_with(&["mesh[b.c].scale=2"]), "mesh[b.c]", "scale"), 2.0);
}

#[test]
fn equal_stems_take_the_folder_or_are_refused() {
    let folder = retrieval(&["in/x.txt", "cats/a.txt", "dogs/a.txt", "dogs/b.txt"], "");
    let set = format!("shapes=files(\"{}/*s/*.txt\")", folder.path().display());
    let plan = folder.plan_with(&[&set]);
    for address in ["mesh[cats/a]", "mesh[dogs/a]", "mesh[b]", "match[cats/a,dogs/a]"] {
        assert!(plan.addresses.contains_key(address), "{address}");
    }
    folder.write("in/x.text", "");
    let set = format!("shapes=files(\"{}/in/x.*\")", folder.path().display());
    let errors = folder.errors_with(&sets_of(&[&set]));
    assert_eq!(errors.len(), 1, "{errors:?}");
    assert!(errors[0].contains("would both be named `in/x`"), "{errors:?}");
}

#[test]
fn a_subgraph_is_repeated_with_its_input() {
    let folder = retrieval(&["in/a.txt", "in/b.txt"], r#""s": graph(file: "sub.ron", x: "mesh"),"#);
    folder.write(
        "sub.ron",
        r#"(format: 1, inputs: {"x": "number"}, nodes: {"in": add(left: "x", mode: Rounded)}, output: "in")"#,
    );
    let plan = folder.plan();
    assert_eq!(plan.addresses["s/in[b]"], plan.addresses["s[b]"]);
    let some = folder.plan_with(&["s/in[a].offset=3"]);
    assert_eq!(param(&some, "s[a]", "offset"), 3.0);
    assert_eq!(param(&some, "s[b]", "offset"), 0.0);
}

#[test]
fn folders_with_special_characters_are_taken_as_they_are() {
    let folder = Folder::new(&[
        (
            "[x]/sub.ron",
            r#"(format: 1, over: {"s": files("*.txt")}, nodes: {"m": source(path: each("s")), "t": sum(terms: all("m"))}, output: "t")"#,
        ),
        ("[x]/a.txt", ""),
        ("main.ron", r#"(format: 1, nodes: {"g": graph(file: "[x]/sub.ron")}, show: ["g"])"#),
    ]);
    assert!(folder.plan().addresses.contains_key("g/m[a]"));
}

#[test]
fn wrong_axes() {
    let one = |extra: &str| {
        let errors = retrieval(&["in/a.txt", "in/b.txt"], extra).errors();
        assert_eq!(errors.len(), 1, "{errors:?}");
        errors[0].clone()
    };
    insta::assert_snapshot!(
        [
            one(r#""x": source(path: each("shap")),"#),
            one(r#""x": add(left: "features@query", right: "features"),"#),
            one(r#""x": add(left: "features@qery"),"#),
            one(r#""x": sum(terms: "match"),"#),
            one(r#""x": add(left: all("match")),"#),
            one(r#""x": sum(terms: all("ranking")),"#),
            one(r#""x": add(left: "ranking@query"),"#),
            one(r#""x": sum(terms: all("features@query")),"#),
            one(r#""x": source(path: files("in/*.txt")),"#),
            one(r#""x": add(left: each("shape")),"#),
        ]
        .join("\n"),
        @r#"
unknown-axis @"shap"@ the graph has no axis `shap` | did you mean `shape`?
two-axes @"features"@ a node is repeated along one axis, but here along `pair` and `shape` | say which of the pair with `@query` or `@target`
unknown-axis @qery@ no axis of pairs calls a side `qery` | did you mean `query`?
bad-axis @"match"@ `match` is repeated along `pair`, and `terms` takes many | gather the instances with all("match")
bad-axis @all("match")@ `left` takes one wire, not all instances | wire "match": the node is then repeated along its axis
bad-axis @all("ranking")@ `ranking` is not repeated along an axis | wire it without `all(..)`
bad-axis @"ranking@query"@ this node is not repeated along the axis `shape` | wire it without `@`: it is the same for all pairs
bad-wire @all("features@query")@ this picks instances that are picked already | `all(..)` and `@` cannot be combined
bad-param @files("in/*.txt")@ `files(..)` is not a value | name the files as an axis, `over: {"shape": files(..)}`, and take `each("shape")`
bad-wire @each("shape")@ an axis cannot be wired to a port | write the name of a node: `"mesh"`, `"mesh@query"` or `all("mesh")`
"#
    );
}

#[test]
fn wrong_lists() {
    let one = |over: &str| {
        let text = format!(r#"(format: 1, over: {{{over}}}, nodes: {{"a": say()}}, show: ["a"])"#);
        let errors = Folder::new(&[("main.ron", &text)]).errors();
        assert_eq!(errors.len(), 1, "{errors:?}");
        errors[0].clone()
    };
    insta::assert_snapshot!(
        [
            one(r#""s": files("*.off")"#),
            one(r#""s": files("a***b")"#),
            one(r#""s": []"#),
            one(r#""s": ["a", "a"]"#),
            one(r#""s": ["a,b"]"#),
            one(r#""s": 1.0"#),
            one(r#""s": param("t")"#),
            one(r#""s": ["a"], "p": pairs(of: "s", as: ("x", "y"))"#),
            one(r#""s": ["a", "b"], "p": pairs(of: "s", as: ("x", "x"))"#),
            one(r#""s": ["a", "b"], "p": pairs(of: "t", as: ("x", "y"))"#),
            one(r#""s": ["a", "b"], "p": pairs(of: "s")"#),
        ]
        .join("\n"),
        @r#"
no-files @"*.off"@ no file matches `*.off` | looked in .
bad-axis @"a***b"@ this is not a pattern of files: wildcards are either regular `*` or recursive `**` | 
bad-axis @[]@ an axis needs at least one item | 
duplicate @"a"@ `a` is on the axis twice | 
bad-name @"a,b"@ `a,b` cannot name an instance | rename it without commas and square brackets
bad-axis @1.0@ an axis is a list, `files(..)` or `pairs(..)` | for example `files("shapes/*.off")` or `[1.0, 1.7]`
unknown-param @"t"@ the graph has no param `t` | there are no params of the graph here
bad-axis @"s"@ an axis of one item has no pairs | 
duplicate @"x"@ the two of a pair need different names | 
unknown-axis @"t"@ there is no axis `t` to make pairs of | the axes are `s`
bad-axis @pairs(of: "s")@ `pairs` needs an axis and two names | for example `pairs(of: "shape", as: ("query", "target"))`
"#
    );
}

#[test]
fn two_plain_axes_need_pairs() {
    let folder = Folder::new(&[(
        "main.ron",
        r#"(format: 1, over: {"a": [1, 2], "b": [3, 4]}, nodes: {
            "x": add(left: "y", offset: each("a")), "y": source(path: "main.ron", scale: each("b")),
        }, show: ["x"])"#,
    )]);
    insta::assert_snapshot!(folder.errors().join("\n"), @r#"two-axes @"y"@ a node is repeated along one axis, but here along `a` and `b` | gather one of them with `all("..")`, or make pairs of one axis with `pairs(of: .., as: (.., ..))`"#);
}

#[test]
fn large_plans_have_one_call_for_each_pair() {
    let shapes: Vec<String> = (0..400).map(|i| i.to_string()).collect();
    let folder = Folder::new(&[(
        "main.ron",
        &format!(
            r#"(format: 1, over: {{"s": [{}], "p": pairs(of: "s", as: ("q", "t"))}}, nodes: {{
            "m": add(left: "o", offset: each("s")), "o": source(path: "main.ron"),
            "x": add(left: "m@q", right: "m@t"), "r": sum(terms: all("x")) }}, show: ["r"])"#,
            shapes.join(", ")
        ),
    )]);
    let plan = folder.plan();
    assert_eq!(plan.dag.node_count(), 1 + 400 + 400 * 399 / 2 + 1);
    assert_eq!(plan.dag.edge_count(), 400 + 3 * (400 * 399 / 2));
}

#[test]
fn plans_beyond_all_measure_are_refused() {
    let items: Vec<String> = (0..3000).map(|i| i.to_string()).collect();
    let text = format!(
        r#"(format: 1, over: {{"s": [{}], "p": pairs(of: "s", as: ("q", "t"))}}, nodes: {{
        "m": add(left: "o", offset: each("s")), "o": source(path: "main.ron"),
        "x": add(left: "m@q", right: "m@t") }}, show: ["x"])"#,
        items.join(", ")
    );
    let code = |folder: &Folder| folder.errors()[0].split(' ').next().map(str::to_owned);
    assert_eq!(code(&Folder::new(&[("main.ron", &text)])).as_deref(), Some("too-large"));

    // Each file calls the next one twice.
    let folder = Folder::new(&[("f40.ron", r#"(format: 1, nodes: {"l": say()}, output: "l")"#)]);
    for i in 0..40 {
        let (name, next) = (format!("f{i}.ron"), i + 1);
        let text = format!(
            r#"(format: 1, nodes: {{"l": graph(file: "f{next}.ron"), "r": graph(file: "f{next}.ron")}}, output: "l")"#
        );
        folder.write(if i == 0 { "main.ron" } else { &name }, &text);
    }
    assert_eq!(code(&folder).as_deref(), Some("too-large"));
}

#[test]
fn folders_are_of_an_axis() {
    let folder = retrieval(
        &["in/a.txt", "in/b.txt"],
        "\"x\": source(path: folders(\"shap\")), \"y\": source(path: folders(1)),",
    );
    let errors = folder.errors();
    assert!(errors[0].contains("the graph has no axis `shap`") && errors[0].contains("shape"), "{errors:?}");
    assert!(errors[1].contains("`folders` takes one axis"), "{errors:?}");
}
