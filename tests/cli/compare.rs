//! `salient compare` and `salient runs` on toys.

use serde_json::{Value, json};

use crate::{Desk, text};

/// Variants of a graph of five nodes, one of which fails for a file that is no number.
fn desk() -> Desk {
    let desk = Desk::new(1);
    desk.write(
        "v.ron",
        "(format: 1, base: \"g.ron\", variants: {\n    \"plain\": set({}),\n    \
         \"factor\": sweep({\"double\": (factor: [3.0, 4.0])}),\n    \"same\": set({\"double\": (factor: 2)}),\n})\n",
    );
    desk
}

fn names(list: &Value, key: &str) -> Vec<String> {
    list.as_array().unwrap().iter().map(|it| it[key].as_str().unwrap().to_owned()).collect()
}

#[test]
fn variants_part_at_the_param_that_differs() {
    let desk = desk();
    let found: Value = serde_json::from_str(&desk.ok(&["compare", "v.ron", "--json"])).unwrap();
    assert_eq!(names(&found["sides"], "name"), ["plain", "factor[factor=3.0]", "factor[factor=4.0]", "same"]);
    assert_eq!(found["pairs"].as_array().unwrap().len(), 6);
    let pair = |left: &str, right: &str| {
        let mut all = found["pairs"].as_array().unwrap().iter();
        all.find(|pair| pair["left"] == left && pair["right"] == right).unwrap().clone()
    };
    let three = pair("plain", "factor[factor=3.0]");
    assert_eq!(
        three["diverging"],
        json!([{
            "node": "double", "kind": "scale", "effect": true,
            "causes": [{"cause": "param", "name": "factor", "before": 2.0, "now": 3.0}],
        }])
    );
    // `a` is the same; what follows the factor differs, in the order of the graph.
    assert_eq!(
        (names(&three["nodes"], "node"), &three["equal"]),
        (vec!["double".into(), "slow".into(), "total".into()], &json!(1))
    );
    let total = &three["nodes"][2]["differences"][0];
    assert_eq!(
        (&total["figure"], &total["values"], &total["size"]),
        (&"total".into(), &json!([8.0, 12.0]), &json!(4.0 / 12.0))
    );
    let same = pair("plain", "same");
    assert_eq!((&same["diverging"], &same["nodes"], &same["equal"]), (&json!([]), &json!([]), &json!(4)));
    // One column for each, in its own words.
    let row =
        found["figures"].as_array().unwrap().iter().find(|row| row["node"] == "total" && row["figure"] == "values");
    let values: Vec<_> = row.unwrap()["values"].as_array().unwrap().iter().map(|cell| cell["value"].clone()).collect();
    assert_eq!(values, ["[8.0]", "[12.0]", "[16.0]", "[8.0]"]);
    let scale = found["stages"].as_array().unwrap().iter().find(|row| row["kind"] == "scale").unwrap();
    assert!(
        scale["costs"]
            .as_array()
            .unwrap()
            .iter()
            .all(|c| c["calls"] == 1 && c["held_bytes"].as_u64() > c["output_bytes"].as_u64())
    );
    assert_eq!(found["sides"][0]["defects"][0]["node"], "a");
}

#[test]
fn the_text_names_the_node_its_cause_and_what_follows() {
    let desk = desk();
    let text = desk.ok(&["compare", "v.ron", "--variants", "plain,factor[factor=3.0]"]);
    assert!(text.contains("plain -> factor[factor=3.0]\n  first diverge at double (scale)\n    param `factor` was 2.0, is 3.0\n  3 outputs differ, 1 are the same\n  double (scale)\n    total  8 -> 12 (+50.00 %)\n"), "{text}");
    assert!(text.contains("! a: duplicate vertex × 1, first at 2\n"), "{text}");
    assert!(text.contains("seconds\n"), "{text}");
    // A name with a comma in it, and nodes that part alike.
    desk.write(
        "axis.ron",
        "(format: 1, over: {\"shape\": files(\"?.txt\")}, nodes: {\"a\": read(path: each(\"shape\")), \
         \"f\": scale(x: \"a\"), \"g\": slow(x: \"f\", millis: 1)}, show: [\"g\"], \
         variants: {\"plain\": set({}), \"k\": sweep({\"f\": (factor: [3.0]), \"g\": (tag: [1])})})\n",
    );
    for name in ["b.txt", "c.txt", "d.txt"] {
        desk.write(name, "3\n");
    }
    desk.write("e.txt", "4\n");
    let axis = desk.ok(&["compare", "axis.ron", "--variants", "plain,k[factor=3.0,tag=1]"]);
    let alike = "  first diverge at f[a], f[b], f[c] and 2 more (scale)\n    param `factor` was 2.0, is 3.0\n  and at g[a], g[b], g[c] and 2 more (slow)\n";
    assert!(axis.contains(alike), "{axis}");
    let against = desk.ok(&["compare", "v.ron", "--against", "same"]);
    assert_eq!(against.matches("same -> ").count(), 3, "{against}");
    assert!(against.contains("same -> plain\n  no difference: 4 outputs the same\n"), "{against}");
    let unknown = desk.call(&["compare", "v.ron", "--against", "smae"]);
    assert_eq!(unknown.status.code(), Some(2));
}

#[test]
fn csv_has_a_line_for_each_figure_and_difference() {
    let desk = desk();
    let table = desk.ok(&["compare", "v.ron", "--variant", "plain,same", "--csv"]);
    let lines: Vec<_> = table.lines().collect();
    assert_eq!(lines[0], "column,node,kind,figure,value");
    assert!(lines.contains(&"plain,total,sum,values,[8.0]") && lines.contains(&"same,,scale,calls,1"), "{table}");
    let differences = desk.ok(&["compare", "v.ron", "--variant", "plain,factor", "--csv=differences"]);
    let line = "plain,factor[factor=4.0],total,sum,total,0.5,8,16,8 -> 16 (+100.00 %)";
    assert!(differences.lines().any(|it| it == line), "{differences}");
}

#[test]
fn a_graph_is_compared_with_its_last_run() {
    let desk = desk();
    let alone = desk.call(&["compare", "g.ron"]);
    assert_eq!(alone.status.code(), Some(2));
    assert!(text(&alone.stderr).contains("nothing to compare with"), "{}", text(&alone.stderr));
    assert_eq!(desk.ok(&["runs"]), "no run is remembered\n");
    desk.ok(&["run", "g.ron"]);
    assert!(desk.ok(&["compare", "g.ron"]).contains("last run -> now\n  no difference: 4 outputs the same\n"));
    desk.write("a.txt", "1\n-2\n5\n7\n");
    let changed = desk.ok(&["compare", "g.ron"]);
    assert!(
        changed.contains("first diverge at a (read)\n    the content of a.txt (param `path`) changed\n"),
        "{changed}"
    );
    assert!(changed.contains("total  8 -> 22 (+175.00 %)"), "{changed}");
    // Renaming, rewiring, and a node of another kind.
    let graph = std::fs::read_to_string(desk.path("g.ron")).unwrap();
    desk.write("g.ron", &graph.replace("\"slow\": slow(x: \"double\", millis: 1)", "\"slow\": sign(x: \"a\")"));
    let kind = desk.ok(&["compare", "g.ron"]);
    assert!(kind.contains("first diverge at slow (slow)\n    it was a `slow`, is a `sign`\n"), "{kind}");
    assert!(kind.contains("port `x` was fed by double, is fed by a"), "{kind}");
}

#[test]
fn two_graphs_and_two_runs() {
    let desk = desk();
    let graph = std::fs::read_to_string(desk.path("g.ron")).unwrap();
    desk.write("h.ron", &graph.replace("factor: 2.0", "factor: -1.0").replace("\"slow\"", "\"idle\""));
    let found: Value = serde_json::from_str(&desk.ok(&["compare", "g.ron", "h.ron", "--json"])).unwrap();
    let pair = &found["pairs"][0];
    assert_eq!((&pair["left"], &pair["right"]), (&"g.ron".into(), &"h.ron".into()));
    assert_eq!((&pair["only_left"], &pair["only_right"]), (&json!(["slow"]), &json!(["idle"])));
    assert_eq!(pair["diverging"][0]["node"], "double");
    let runs: Value = serde_json::from_str(&desk.ok(&["runs", "--json"])).unwrap();
    assert_eq!(runs.as_array().unwrap().len(), 2);
    let [h, g] = [0, 1].map(|i| runs[i]["run"].as_str().unwrap().to_owned());
    let again: Value = serde_json::from_str(&desk.ok(&["compare", "--run", &g, "--run", &h[..5], "--json"])).unwrap();
    assert_eq!(again["pairs"][0]["diverging"], pair["diverging"]);
    assert_eq!(again["pairs"][0]["nodes"], pair["nodes"]);
    // The graph now against an older run of itself.
    let now = desk.ok(&["compare", "g.ron", "--set", "double.factor=5", "--run", "last"]);
    assert!(now.contains(&format!("run {g} -> now\n  first diverge at double (scale)\n")), "{now}");
    for wrong in [
        &["compare", "--run", "zz", "--run", &g][..],
        &["compare", "--run", &g],
        &["compare"],
        &["runs", "--run", "last~9"],
    ] {
        assert_eq!(desk.call(wrong).status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn runs_say_what_was_computed_and_why() {
    let desk = desk();
    assert_eq!(desk.ok(&["runs"]), "no run is remembered\n");
    desk.ok(&["run", "g.ron"]);
    desk.write("a.txt", "1\n-2\n5\n7\n");
    desk.ok(&["run", "g.ron"]);
    desk.ok(&["run", "v.ron"]);
    let all = desk.ok(&["runs"]);
    assert_eq!(all.lines().count(), 4, "{all}");
    assert!(all.lines().nth(1).unwrap().contains("v.ron"), "{all}");
    assert_eq!(desk.ok(&["runs", "g.ron"]).lines().count(), 3);
    let why = desk.ok(&["runs", "g.ron", "--why", "total"]);
    let lines: Vec<_> = why.lines().map(str::trim).collect();
    assert_eq!(lines[0], "total was computed:");
    assert!(lines[1].starts_with("input `terms` [0] from slow changed") || lines[1].contains("from slow"), "{why}");
    assert!(lines.last().unwrap().ends_with("a.txt (param `path`) changed"), "{why}");
    let first = desk.ok(&["runs", "g.ron", "--run", "last~1", "--why", "total"]);
    assert!(first.contains("never computed"), "{first}");
    let shown = desk.ok(&["runs", "g.ron", "--run", "last"]);
    assert!(shown.contains("4 nodes: 0 from the cache, 4 computed") && shown.contains("computed total\n"), "{shown}");
    let json: Value = serde_json::from_str(&desk.ok(&["runs", "g.ron", "--run", "last", "--json"])).unwrap();
    let double = json["calls"].as_array().unwrap().iter().find(|call| call["node"] == "double").unwrap().clone();
    assert_eq!((&double["params"], &double["inputs"][0]["from"]), (&json!({"factor": 2.0}), &"a".into()));
    assert_eq!(desk.call(&["runs", "--why", "nothing"]).status.code(), Some(2));
}

/// `working_bytes` of the stage `slow` in the two columns of a comparison.
fn working(desk: &Desk, args: &[&str]) -> [Option<u64>; 2] {
    let found: Value = serde_json::from_str(&desk.ok(args)).unwrap();
    let slow = found["stages"].as_array().unwrap().iter().find(|row| row["kind"] == "slow").unwrap().clone();
    [0, 1].map(|side: usize| slow["costs"][side]["working_bytes"].as_u64())
}

#[test]
fn memory_at_work_is_told_of_calls_that_worked_alone() {
    if !std::path::Path::new("/proc/self/clear_refs").exists() {
        println!("skipped: this system does not tell");
        return;
    }
    let desk = desk();
    desk.write(
        "w.ron",
        "(format: 1, base: \"g.ron\", variants: {\n\"little\": set({}), \"much\": set({\"slow\": (memory: 80)})})\n",
    );
    let call = ["compare", "w.ron", "--json"];
    let [little, much] = working(&desk, &[&call[..], &["--jobs", "1"]].concat()).map(Option::unwrap);
    assert!(little < 20 << 20 && (79 << 20..100 << 20).contains(&much), "{little} {much}");
    // It stays known while the output is.
    assert_eq!(working(&desk, &call), [Some(little), Some(much)]);
    let shown = desk.ok(&["runs", "--run", "last"]);
    assert!(shown.contains("at work") && shown.contains("MB"), "{shown}");
    let table = desk.ok(&["compare", "w.ron", "--csv"]);
    assert!(table.contains(&format!("much,,slow,working_bytes,{much}")), "{table}");
    // Two at once: whose memory it was cannot be told.
    let graph = "(format: 1, nodes: {\"a\": read(path: \"a.txt\"), \"s\": slow(x: \"a\", millis: 400, tag: 7), \
        \"t\": slow(x: \"a\", millis: 400, tag: 8)}, show: [\"s\", \"t\"])";
    desk.write("two.ron", graph);
    desk.ok(&["run", "two.ron", "--jobs", "2"]);
    assert_eq!(working(&desk, &["compare", "two.ron", "--json"]), [None, None]);
}

#[test]
fn a_failing_variant_is_a_column_of_its_own() {
    let desk = desk();
    desk.write("b.txt", "what\n");
    desk.write(
        "w.ron",
        "(format: 1, base: \"g.ron\", variants: {\"good\": set({}), \"bad\": set({\"a\": (path: \"b.txt\")})})\n",
    );
    let output = desk.call(&["compare", "w.ron"]);
    assert_eq!(output.status.code(), Some(1));
    let out = text(&output.stdout);
    assert!(
        out.contains("first diverge at a (read)\n    param `path` names b.txt, whose content is not that of a.txt\n"),
        "{out}"
    );
    assert!(out.contains("failed: `what` is not a number (bad)"), "{out}");
    assert!(out.contains("was skipped because of: bad:a (bad)"), "{out}");
}

#[test]
fn what_failed_is_listed_at_the_end() {
    let desk = Desk::new(1);
    desk.write(
        "many.ron",
        "(format: 1, over: {\"shape\": files(\"m*.txt\")}, nodes: {\"a\": read(path: each(\"shape\")), \
         \"f\": scale(x: \"a\"), \"all\": sum(terms: all(\"f\"))}, show: [\"f\", \"all\"])\n",
    );
    for i in 0..12 {
        desk.write(&format!("m{i:02}.txt"), &if i == 5 { "broken\n".to_owned() } else { format!("{i}\n") });
    }
    let output = desk.call(&["run", "many.ron"]);
    assert_eq!(output.status.code(), Some(1));
    let stderr = text(&output.stderr);
    let end = "1 node failed:\n  a[m05] (read) on m05.txt: `broken` is not a number\n    help: write one\n    2 nodes not tried because of it\n";
    assert!(stderr.ends_with(end), "{stderr}");
    assert_eq!(text(&output.stdout).matches("(scale)").count(), 11);
    let again = desk.call(&["run", "many.ron", "--json"]);
    assert_eq!(again.status.code(), Some(1));
    let events: Vec<Value> = text(&again.stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let started: Vec<_> = events.iter().filter(|e| e["event"] == "started").map(|e| e["node"].clone()).collect();
    assert_eq!(started, ["a[m05]"]);
    assert_eq!(events.last().unwrap()["failures"][0]["skipped"], 2);
    let fast = desk.call(&["run", "many.ron", "--fail-fast", "--jobs", "1"]);
    assert_eq!(fast.status.code(), Some(1));
    // What failed is not one of the outputs that are the same, and that it failed is all there is to say.
    desk.call(&["run", "many.ron"]);
    let same = text(&desk.call(&["compare", "many.ron"]).stdout);
    assert!(same.ends_with("  no difference: 22 outputs the same, 3 failed on both sides\n"), "{same}");
    let why = desk.ok(&["plan", "many.ron", "--why", "a[m05]"]);
    assert_eq!(why.lines().skip(1).collect::<Vec<_>>(), ["  it failed last time: `broken` is not a number"]);
}

#[test]
fn long_lists_are_cut_to_what_matters() {
    let desk = Desk::new(1);
    desk.write(
        "many.ron",
        "(format: 1, over: {\"shape\": files(\"m*.txt\")}, nodes: {\"a\": read(path: each(\"shape\")), \
         \"all\": sum(terms: all(\"a\"))}, show: [\"all\"])\n",
    );
    for i in 0..20 {
        desk.write(&format!("m{i:02}.txt"), &format!("{i}\n"));
    }
    let plan = desk.ok(&["plan", "many.ron"]);
    // In the order of the file, twelve of a kind.
    assert!(plan.starts_with("miss               a[m00]  read"), "{plan}");
    assert!(plan.contains("a[m11]") && !plan.contains("\nmiss               a[m12]"), "{plan}");
    assert!(plan.ends_with("and 8 more of read: miss\n\n21 nodes: 1 depends on a miss, 20 miss\n"), "{plan}");
    desk.ok(&["run", "many.ron"]);
    std::fs::remove_file(desk.path("m03.txt")).unwrap();
    desk.write("m30.txt", "30\n");
    desk.write("m31.txt", "31\n");
    let why = desk.ok(&["plan", "many.ron", "--why", "all"]);
    assert!(why.ends_with("  port `terms` is fed also by a[m30], a[m31], no longer by a[m03]\n"), "{why}");
}
