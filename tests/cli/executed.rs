//! Which nodes of the real pipeline execute after which edit.

use std::fs;

use crate::real::{PAIR, Real, SMALL, creatures, lines, numbers, off};
use crate::{files, text};

/// All of a branch and the match.
const BRANCH_A: [&str; 8] =
    ["a", "fa/basis", "fa/energy", "fa/features", "fa/laplacian", "fa/maxima", "fa/patches", "match"];

#[test]
fn a_param_recomputes_its_stage_and_what_follows() {
    let real = Real::new();
    assert_eq!(real.executed(&[PAIR]).len(), 15);
    assert!(real.executed(&[PAIR]).is_empty());
    let wider = [PAIR, "--set", "*/patches.radius=2.0"];
    assert_eq!(real.executed(&wider), ["fa/features", "fa/patches", "fb/features", "fb/patches", "match"]);
    assert!(real.executed(&wider).is_empty());
    // The same by editing the file, and written otherwise.
    real.edit("salient_features.ron", &[("radius: 1.7", "radius: 2")]);
    assert!(real.executed(&[PAIR]).is_empty());
    assert_eq!(real.executed(&[PAIR, "--set", "match.candidates=5"]), ["match"]);
}

#[test]
fn more_features_compute_only_the_new_patches() {
    let real = Real::new();
    let figures = |count: &str| {
        let set = format!("*/maxima.count={count}");
        let events = real.events(&[PAIR, "--set", &set]);
        let finished = |e: &&serde_json::Value| e["event"] == "finished" && e["node"] == "fa/features";
        let figures = events.iter().find(finished).unwrap()["figures"].clone();
        ["patches computed", "patches remembered"].map(|name| figures[name].as_u64().unwrap())
    };
    let [all, none] = figures("10");
    assert_eq!((all, none), (10, 0));
    let [new, known] = figures("18");
    assert!(new + known == 18 && (1..=10).contains(&known) && known >= 8, "{new} + {known}");
}

#[test]
fn cosmetic_edits_of_the_graphs_recompute_nothing() {
    let real = Real::new();
    real.ok(&["run", PAIR]);
    real.write(
        "other name.ron",
        r#"// Renamed, reordered, with comments, without what was only for the eye.
        (format: 1, show: ["pairing"], nodes: {
            "pairing": iqp_match(right: "two", left: "one"), /* wired the other way round */
            "two": graph(mesh: "second", file: "subgraph.ron"),
            "one": graph(mesh: "first", file: "subgraph.ron"),
            "second": load(path: "./b.off"), "first": load(path: "a.off", weld: Auto),
        })"#,
    );
    real.write(
        "subgraph.ron",
        r#"(format: 1, inputs: {"mesh": "mesh"}, nodes: {
            "descriptors": patch_spectrum(values: 21, patches: "discs"),
            "discs": patch_extract(radius: 1.70, maxima: "points", mesh: "mesh"),
            "points": maxima(count: 12, mesh: "mesh", energy: "E"),
            "E": reconstruction_energy(basis: "V", mesh: "mesh"),
            "V": eigensolve(pairs: 40, operator: "M"),
            "M": laplacian(mesh: "mesh", area: Mixed),
        }, output: "descriptors")"#,
    );
    assert!(real.executed(&["other name.ron"]).is_empty());
}

#[test]
fn touched_moved_and_renamed_meshes_recompute_nothing() {
    let real = Real::new();
    real.ok(&["run", PAIR]);
    real.write("a.off", &creatures()[0]);
    assert!(real.executed(&[PAIR]).is_empty());
    fs::create_dir(real.path("elsewhere")).unwrap();
    fs::rename(real.path("a.off"), real.path("elsewhere/kitten.off")).unwrap();
    real.edit(PAIR, &[("a.off", "elsewhere/kitten.off")]);
    assert!(real.executed(&[PAIR]).is_empty());
    // What is equal on both sides is computed once.
    assert_eq!(real.executed(&[PAIR, "--set", r#"b.path="elsewhere/kitten.off""#]), ["match"]);
}

#[test]
fn one_vertex_recomputes_its_branch_and_a_comment_its_mesh_alone() {
    let real = Real::new();
    real.ok(&["run", PAIR]);
    let (mut vertices, faces) = lines(&creatures()[0]);
    real.write("a.off", off(&vertices, &faces).replacen("OFF\n", "OFF\n# a comment\n", 1));
    assert_eq!(real.executed(&[PAIR]), ["a"]);
    let (left, right) = (numbers::<f64>(&vertices[99]), numbers::<f64>(&vertices[101]));
    let moved: Vec<_> = left.iter().zip(right).map(|(x, y)| (0.5 * (x + y)).to_string()).collect();
    vertices[100] = moved.join(" ");
    real.write("a.off", off(&vertices, &faces));
    assert_eq!(real.executed(&[PAIR]), BRANCH_A);
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let (one, two) = (Real::new(), Real::new());
    one.ok(&["run", PAIR, "--jobs", "1", "--out", "results"]);
    two.ok(&["run", PAIR, "--jobs", "2", "--out", "results"]);
    let mut results = files(&one.path("results"));
    results.sort();
    assert_eq!(results.len(), 6);
    for file in results {
        let name = file.file_name().unwrap().to_str().unwrap();
        assert!(fs::read(&file).unwrap() == fs::read(two.path("results").join(name)).unwrap(), "{name}");
    }
    for node in ["a", "fa/laplacian", "fa/basis", "fa/energy", "fa/maxima", "fb/patches", "fb/features", "match"] {
        let get = ["get", PAIR, node, "--format", "safetensors", "--jobs"];
        let bytes = one.ok(&[&get[..], &["1"]].concat());
        assert!(bytes == two.ok(&[&get[..], &["2"]].concat()), "{node}");
    }
    // Every object of one cache is in the other under the same name, which is its hash.
    let objects = |real: &Real| {
        let folders = files(&real.path("cache/objects"));
        let paths = folders.iter().flat_map(|f| files(f));
        let mut names: Vec<_> = paths.map(|path| path.file_name().unwrap().to_owned()).collect();
        names.sort();
        names
    };
    assert_eq!(objects(&one), objects(&two));
    assert_eq!(objects(&one).len(), 15);
}

#[test]
fn the_quickstart_runs_and_the_second_time_all_is_there() {
    let real = Real::bare();
    let first = real.ok(&["run", "quickstart.ron"]);
    let shown = text(&first);
    for what in ["fa (patch_spectrum)\n", "match (iqp_match)\n", "  objective", "  up to symmetry"] {
        assert!(shown.contains(what), "{shown}");
    }
    let second = real.call(&["run", "quickstart.ron"]);
    assert!(second.stdout == first);
    assert!(text(&second.stderr).contains("17 nodes: 17 from the cache, 0 computed"), "{}", text(&second.stderr));
}

#[test]
fn variants_share_what_they_have_in_common() {
    let real = Real::bare();
    let stages = |graph| {
        let stages = real.stages(&[&[graph][..], &SMALL].concat());
        stages.into_iter().map(|(kind, count)| format!("{kind} {count}")).collect::<Vec<_>>()
    };
    // One radius of the sweep is the paper's.
    assert_eq!(
        stages("radius_variants.ron"),
        [
            "eigensolve 4",
            "evaluate_match 4",
            "iqp_match 4",
            "laplacian 4",
            "maxima 4",
            "orient_match 4",
            "patch_extract 8",
            "patch_spectrum 8",
            "reconstruction_energy 4",
            "synthesize 2",
        ]
    );
    assert!(stages("radius_variants.ron").is_empty());
    // Of the readings, the paper's own numbers and all up to the energy are there by now.
    let readings = stages("readings.ron");
    let at_most = |kind: &str| readings.iter().filter(|s| s.starts_with(kind)).count();
    assert_eq!(at_most("synthesize") + at_most("laplacian") + at_most("eigensolve"), 0, "{readings:?}");
    assert!(readings.contains(&"reconstruction_energy 2".to_owned()), "{readings:?}");
    assert!(readings.contains(&"patch_extract 2".to_owned()), "{readings:?}");
    assert!(readings.contains(&"iqp_match 2".to_owned()), "{readings:?}");
}
