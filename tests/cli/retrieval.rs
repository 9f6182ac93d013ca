//! A small database through the graphs that people run: folders, labels, failures, new shapes.

use std::fs;

use serde_json::Value;

use crate::real::Real;
use crate::text;

const SET: [&str; 2] = ["--set", "shapes=files(\"db/*/*.off\")"];

/// Three cats, three giraffes and a file that is no mesh, in folders by class; few eigenpairs and features.
fn database() -> Real {
    let real = Real::bare();
    real.edit("salient_features.ron", &[("pairs: 100", "pairs: 40"), ("\"features\": 50", "\"features\": 12")]);
    let call = |species: &str, pose: u32| {
        format!("\"{species}{pose}\": synthesize(species: {species}, pose: {pose}, vertices: 600)")
    };
    let all: Vec<String> = (0..3).flat_map(|pose| [call("Cat", pose), call("Giraffe", pose)]).collect();
    real.write("make.ron", format!("(format: 1, nodes: {{{}}}, show: [\"Cat0\"])", all.join(", ")));
    for species in ["Cat", "Giraffe"] {
        for pose in 0..3 {
            let (node, file) = (format!("{species}{pose}"), format!("db/{species}/{species}{pose}.off"));
            real.ok(&["get", "make.ron", &node, "-o", &file]);
        }
    }
    real
}

fn metrics(real: &Real, more: &[&str]) -> Value {
    let args = [&["get", "retrieval.ron", "metrics", "--format", "json"], &SET[..], more].concat();
    real.json(&args)
}

#[test]
fn a_database_is_ranked_and_a_new_shape_costs_its_own_row() {
    let real = database();
    let found = metrics(&real, &[]);
    for key in ["nn", "first_tier", "second_tier", "e", "dcg", "map"] {
        assert!(found[key].as_f64().is_some_and(|x| (0.0..=1.0).contains(&x)), "{key}: {found}");
        assert!(found["per_class"]["Giraffe"][key].is_number());
    }
    assert_eq!(found["nn"], 1.0);
    assert_eq!(found["precision_recall"].as_array().unwrap().len(), 11);
    assert_eq!((&found["per_class"]["Cat"]["queries"], &found["failed"]), (&3.into(), &Value::Array(Vec::new())));
    // Classes by a table or by names are the same classes.
    let lines = ["Cat", "Giraffe"].map(|c| [0, 1, 2].map(|i| format!("{c}{i}.off,{c}\n")).concat());
    real.write("labels.csv", format!("id,class\n{}", lines.concat()));
    assert_eq!(metrics(&real, &["--set", "labels=\"labels.csv\""]), found);
    assert_eq!(metrics(&real, &["--set", "pattern=\"{class}#\""]), found);
    let stderr = real.fails(1, &["get", "retrieval.ron", "metrics", "--set", "shapes=files(\"db/Cat/*.off\")"]);
    assert!(stderr.contains("all shapes are of one class, `Cat`"), "{stderr}");
    // One more shape: its own features, its own row of matches.
    fs::copy(real.path("db/Cat/Cat2.off"), real.path("db/Cat/Cat3.off")).unwrap();
    let line = real.read("db/Cat/Cat3.off");
    real.write("db/Cat/Cat3.off", line.replacen("0.", "0.0", 1));
    let events = real.events(&[&["retrieval.ron"], &SET[..]].concat());
    let finished =
        |kind: &str| events.iter().filter(|e| e["event"] == "finished" && e["kind"] == kind).collect::<Vec<_>>();
    assert_eq!((finished("eigensolve").len(), finished("patch_spectrum").len()), (1, 1));
    let figures = &finished("match_all")[0]["figures"];
    assert_eq!((&figures["pairs computed"], &figures["pairs remembered"]), (&6.into(), &15.into()));
}

#[test]
fn a_broken_shape_is_listed_and_the_rest_ranked() {
    let real = database();
    real.write("db/Cat/broken.off", "OFF\n3 1 0\n0 0 0\n");
    let output = real.call(&[&["run", "retrieval.ron"], &SET[..]].concat());
    assert_eq!(output.status.code(), Some(1));
    let stdout = text(&output.stdout);
    assert!(stdout.contains("1: broken") && stdout.contains("6 of 2 classes"), "{stdout}");
    // `get` has what it was asked for, and the failure is in it.
    assert_eq!(metrics(&real, &[])["failed"], serde_json::json!(["broken"]));
    let explained = ["--set", "a.path=\"db/Cat/Cat0.off\"", "--set", "b.path=\"db/Cat/Cat1.off\""];
    let why = real.json(&[&["get", "explain.ron", "why"], &explained[..]].concat());
    assert_eq!(why["terms"][0]["left"]["descriptor"].as_array().unwrap().len(), 21);
    // Parts against the whole.
    fs::remove_file(real.path("db/Cat/broken.off")).unwrap();
    let partial = real.json(&[&["get", "partial_retrieval.ron", "metrics", "--set", "keep=0.8"], &SET[..]].concat());
    assert_eq!((&partial["queries"], &partial["per_class"]["Cat"]["queries"]), (&6.into(), &3.into()));
    assert!(partial["nn"].as_f64().unwrap() >= 0.5, "{partial}");
}

#[test]
fn numbered_files_take_their_classes_from_a_table_and_defects_do_not_flood() {
    let real = Real::bare();
    // As a benchmark comes: 1.off, 2.off .. in one folder, surfaces with holes, and a table that the user writes, with semicolons and no header.
    let graph = "(format: 1, params: {\"shapes\": files(\"*.off\")}, over: {\"shape\": param(\"shapes\")}, nodes: {
        \"mesh\": load(path: each(\"shape\")), \"v\": volume_signature(mesh: \"mesh\"),
        \"list\": shortlist(signatures: all(\"v\"), count: 6), \"ranking\": rank(similarity: \"list\"),
        \"metrics\": retrieval_metrics(ranking: \"ranking\", labels: \"classes.csv\")}, show: [\"metrics\"])";
    real.write("small.ron", graph);
    let mut table = String::new();
    for i in 1..15 {
        let (class, height) = if i <= 7 { ("flat", 0.1) } else { ("tall", 3.0) };
        let height = height + 0.01 * f64::from(i % 7);
        let faces = "3 0 1 2\n3 0 1 3\n3 1 2 3\n";
        real.write(&format!("{i}.off"), format!("OFF\n4 3 0\n0 0 0\n1 0 0\n0 1 0\n0 0 {height}\n{faces}"));
        table.extend([&i.to_string(), ";", class, "\n"]);
    }
    real.write("classes.csv", table);
    let found = real.json(&["get", "small.ron", "metrics", "--format", "json"]);
    assert_eq!(
        (&found["nn"], &found["first_tier"], &found["per_class"]["tall"]["queries"]),
        (&1.0.into(), &1.0.into(), &7.into())
    );
    let shown = text(&real.ok(&["run", "small.ron"]));
    let lines = shown.lines().filter(|line| line.contains("boundary edge")).count();
    assert!(lines < 14 && shown.contains("more such lines"), "{shown}");
    // Lists one after the other, for a table as well as for numpy.
    let list = text(&real.ok(&["get", "small.ron", "list", "--format", "csv"]));
    let (first, rows) = (list.lines().next().unwrap(), list.lines().count() - 1);
    assert!(first == "query,target,value" && (14 * 7..14 * 14).contains(&rows), "{first} {rows}");
}
