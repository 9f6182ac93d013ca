//! What is remembered of runs: their plans, what was executed and why, and what it cost.

use salient::engine::forecast::{Forecast, Verdict};
use salient::engine::history::{RunOutcome, RunRecord};
use salient::engine::why::{Cause, why};
use salient_sdk::AnyNode;
use serde_json::json;

use crate::lab::{Graph, Lab};
use crate::toy::{Fail, Product, Scale, ScaleRows, Sign, Slow, Sum};

/// `a -> double -> sign -> total`.
fn chain(lab: &Lab, node: &'static dyn AnyNode, factor: &str) -> Graph {
    let path = lab.dir.path().join("a.txt");
    let mut graph = Graph::new();
    let a = graph.read("a", &path);
    let double = graph.call("double", node, &[("factor", factor)], &[("x", a)]);
    let sign = graph.call("sign", &Sign, &[], &[("x", double)]);
    graph.call("total", &Sum, &[], &[("terms", sign)]);
    graph.show(&["total"])
}

/// The latest run, read back from the cache.
fn last(lab: &Lab) -> RunRecord {
    lab.cache().runs(None).unwrap()[0].read().unwrap()
}

fn causes(run: &RunRecord, address: &str) -> Vec<Cause> {
    run.body.why(run.body.addresses()[address])
}

fn outcome(run: &RunRecord, address: &str) -> RunOutcome {
    run.body.calls[run.body.addresses()[address]].outcome
}

#[test]
fn a_run_is_remembered_with_its_plan() {
    let lab = Lab::new();
    lab.file("a.txt", "1\n-2\n?\n");
    let graph = chain(&lab, &Scale::<1>, "2.0");
    let ran = lab.run(&graph);
    let run = last(&lab);
    assert_eq!(run, ran.outcome.record);
    assert_eq!(run.summary.totals.computed, 4);
    assert_eq!(run.body.shown, [("total".to_owned(), 3)]);
    // The ingredients made again from the record of the run have the keys that the outputs were kept under.
    for (i, call) in run.body.calls.iter().enumerate() {
        assert_eq!(Some(run.body.ingredients(i).key()), call.key, "{call:?}");
        assert_eq!(lab.cache().records(&call.key.unwrap()).unwrap().0[0].digest, call.digest.unwrap());
    }
    assert_eq!(run.body.calls[0].defects.len(), 1);
    let stage = run.summary.stages["scale"];
    assert_eq!((stage.calls, stage.computed, stage.outputs), (1, 1, 1));
    assert!(stage.bytes > 0 && stage.output_seconds > 0.0);
    lab.run(&graph);
    let again = last(&lab).summary;
    assert_eq!((again.totals.hits, again.stages["scale"].computed), (4, 0));
    assert_eq!(again.stages["scale"].output_seconds, stage.output_seconds);
}

#[test]
fn every_cause_is_in_the_record_of_the_run() {
    let lab = Lab::new();
    lab.file("a.txt", "1\n-2\n");
    lab.run(&chain(&lab, &Scale::<1>, "2.0"));
    assert_eq!(causes(&last(&lab), "double"), [Cause::NeverComputed]);

    // A param, and what follows it: `sign` comes out as before, so `total` is a hit.
    lab.run(&chain(&lab, &Scale::<1>, "3.0"));
    let run = last(&lab);
    let factor = Cause::Param { name: "factor".into(), before: Some(json!(2.0)), now: Some(json!(3.0)) };
    assert_eq!(causes(&run, "double"), std::slice::from_ref(&factor));
    let [Cause::Input { port, from, because, .. }] = &causes(&run, "sign")[..] else { panic!("{run:?}") };
    assert_eq!((port.as_str(), from.as_str(), because.as_slice()), ("x", "double", &[factor][..]));
    assert_eq!(outcome(&run, "total"), RunOutcome::Hit);

    // A file, followed through the nodes between.
    lab.file("a.txt", "-1\n-2\n");
    lab.run(&chain(&lab, &Scale::<1>, "3.0"));
    let run = last(&lab);
    let mut found = causes(&run, "total");
    for from in ["sign", "double", "a"] {
        let [Cause::Input { from: named, because, .. }] = &found[..] else { panic!("{found:?}") };
        assert_eq!(named, from);
        found = because.clone();
    }
    assert!(matches!(&found[..], [Cause::File { param, .. }] if param == "path"), "{found:?}");

    // A version, and a format.
    lab.run(&chain(&lab, &Scale::<2>, "3.0"));
    assert_eq!(causes(&last(&lab), "double"), [Cause::Version { before: 1, now: 2 }]);
    lab.run(&chain(&lab, &Scale::<1>, "3.0"));
    assert_eq!(outcome(&last(&lab), "double"), RunOutcome::Hit);
    let mut rows = Graph::new();
    let a = rows.read("a", &lab.dir.path().join("a.txt"));
    rows.call("double", &ScaleRows, &[("factor", "3.0")], &[("x", a)]);
    let rows = rows.show(&["double"]);
    let cache = lab.cache();
    let wanted = [rows.plan.addresses["double"]];
    let forecast = Forecast::new(&rows.plan, &wanted, &cache).unwrap();
    let format = [Cause::Format { before: 1, now: 2 }];
    assert_eq!(why(&rows.plan, &forecast, wanted[0], &cache).unwrap().causes, format);
    let (options, cancel) = (lab.options, salient::engine::Cancel::new());
    salient::engine::run(&rows.plan, &wanted, &cache, options, &cancel, &mut |_| ()).unwrap();
    assert_eq!(causes(&last(&lab), "double"), format);

    // Another kind of node of the same name.
    let mut other = Graph::new();
    let a = other.read("a", &lab.dir.path().join("a.txt"));
    other.call("double", &Sign, &[], &[("x", a)]);
    lab.run(&other.show(&["double"]));
    assert_eq!(causes(&last(&lab), "double"), [Cause::Kind { before: "scale".into(), now: "sign".into() }]);
}

#[test]
fn collected_outputs_are_named_with_who_needed_them() {
    let lab = Lab::new();
    lab.file("a.txt", "1\n-2\n");
    let graph = chain(&lab, &Scale::<1>, "2.0");
    let ran = lab.run(&graph);
    for address in ["a", "double"] {
        std::fs::remove_file(lab.object(&ran, &graph, address)).unwrap();
    }
    lab.run(&graph);
    assert!(last(&lab).body.calls.iter().all(|call| call.why.is_empty()), "nothing needed them");
    let key = ran.outcome.record.body.calls[2].key.unwrap();
    let records = crate::lab::files(&lab.dir.path().join("cache/records"));
    let gone = records.iter().find(|path| path.to_string_lossy().contains(&key.to_string())).unwrap();
    std::fs::remove_file(gone).unwrap();
    lab.run(&graph);
    let run = last(&lab);
    assert_eq!(causes(&run, "sign"), [Cause::RecordGone]);
    assert_eq!(causes(&run, "double"), [Cause::Evicted { needed_by: "sign".into() }]);
    assert_eq!(causes(&run, "a"), [Cause::Evicted { needed_by: "double".into() }]);
}

#[test]
fn failures_and_unreadable_files_are_remembered() {
    let lab = Lab::new();
    lab.file("a.txt", "1\n");
    let build = |fails: bool| {
        let mut graph = Graph::new();
        let a = graph.read("a", &lab.dir.path().join("a.txt"));
        let node: &'static dyn AnyNode = if fails { &Fail } else { &Sign };
        let x = graph.call("x", node, &[], &[("x", a)]);
        graph.call("after", &Sign, &[], &[("x", x)]);
        graph.show(&["after"])
    };
    lab.run(&build(true));
    let run = last(&lab);
    assert_eq!((outcome(&run, "x"), outcome(&run, "after")), (RunOutcome::Failed, RunOutcome::Skipped));
    let call = |address: &str| run.body.calls[run.body.addresses()[address]].clone();
    assert_eq!(call("x").message.as_deref(), Some("it is the wrong number"));
    assert_eq!(call("after").message.as_deref(), Some("x"));
    lab.run(&build(true));
    assert_eq!(causes(&last(&lab), "x"), [Cause::FailedBefore { message: "it is the wrong number".into() }]);
}

#[test]
fn costs_are_known_from_other_graphs_by_key_and_by_kind() {
    let lab = Lab::new();
    lab.file("a.txt", "1\n");
    let build = |file: &str, name: &str, tag: &str| {
        let mut graph = Graph::new();
        graph.plan.file = file.into();
        let a = graph.read("a", &lab.dir.path().join("a.txt"));
        graph.call(name, &Slow, &[("millis", "40"), ("tag", tag)], &[("x", a)]);
        graph.show(&[name])
    };
    let first = build("one.ron", "slow", "1");
    let ran = lab.run(&first);
    let slow = ran.outcome.states[&first.plan.addresses["slow"]].record().unwrap().seconds;
    let prospect = |graph: &Graph| {
        let wanted: Vec<_> = graph.plan.show.iter().map(|shown| shown.call).collect();
        Forecast::new(&graph.plan, &wanted, &lab.cache()).unwrap().calls[&wanted[0]].clone()
    };
    // Another graph, another name: the kind tells. Its record gone, the key does.
    let other = prospect(&build("two.ron", "other", "2"));
    assert_eq!((other.verdict, other.seconds), (Verdict::Miss, Some(slow)));
    let second = build("two.ron", "other", "3");
    lab.run(&second);
    std::fs::remove_dir_all(lab.dir.path().join("cache/records")).unwrap();
    let again = prospect(&build("three.ron", "again", "1"));
    // `a` has to be read first, so its key is not known yet; the mean of the kind is.
    assert!(matches!(again.verdict, Verdict::DependsOnMiss { .. }));
    assert!(again.seconds.unwrap() >= 0.04, "{again:?}");
    lab.run(&{
        let mut graph = Graph::new();
        graph.plan.file = "only.ron".into();
        graph.read("a", &lab.dir.path().join("a.txt"));
        graph.show(&["a"])
    });
    let known = prospect(&build("three.ron", "again", "1"));
    assert_eq!((known.verdict, known.seconds), (Verdict::Miss, Some(slow)));
}

#[test]
fn one_of_forty_fails_alone_and_a_rerun_tries_only_it() {
    let lab = Lab::new();
    let build = || {
        let mut graph = Graph::new();
        let shapes: Vec<_> = (0..40)
            .map(|i| {
                let a = graph.read(&format!("a{i}"), &lab.dir.path().join(format!("{i}.txt")));
                graph.call(&format!("f{i}"), &Scale::<1>, &[], &[("x", a)])
            })
            .collect();
        let mut names: Vec<String> = Vec::new();
        for (i, pair) in shapes.windows(2).enumerate() {
            names.push(format!("m{i}"));
            graph.call(&names[i], &Product, &[], &[("left", pair[0]), ("right", pair[1])]);
        }
        graph.show(&names.iter().map(String::as_str).collect::<Vec<_>>())
    };
    // Equal files would make equal outputs; each must be its own to be counted.
    for i in 0..40 {
        lab.file(&format!("{i}.txt"), &if i == 7 { "broken\n".to_owned() } else { format!("{i}\n") });
    }
    let ran = lab.run(&build());
    let totals = ran.outcome.totals;
    assert_eq!((totals.failed, totals.skipped, totals.computed), (1, 3, 39 + 39 + 37));
    assert_eq!(ran.failures()[0].0, "a7");
    assert_eq!(lab.run(&build()).executed, ["a7"]);
    lab.file("7.txt", "7\n");
    assert_eq!(lab.run(&build()).executed, ["a7", "f7", "m6", "m7"]);
}

#[test]
fn the_first_failure_may_stop_the_run() {
    let mut lab = Lab::new();
    lab.options.jobs = 2;
    lab.file("a.txt", "1\n");
    let mut graph = Graph::new();
    let a = graph.read("a", &lab.dir.path().join("a.txt"));
    graph.call("bad", &Fail, &[], &[("x", a)]);
    let mut slow = a;
    let mut names = vec!["bad".to_owned()];
    for i in 0..20 {
        names.push(format!("slow{i}"));
        slow = graph.call(&names[i + 1], &Slow, &[("millis", "30"), ("tag", "1")], &[("x", slow)]);
    }
    let graph = graph.show(&names.iter().map(String::as_str).collect::<Vec<_>>());
    lab.options.fail_fast = true;
    let fast = lab.run(&graph).outcome;
    assert_eq!(fast.totals.failed, 1);
    assert!(fast.totals.cancelled >= 15, "{:?}", fast.totals);
    assert!(!fast.cancelled && !fast.complete());
    lab.options.fail_fast = false;
    let patient = lab.run(&graph).outcome;
    assert_eq!((patient.totals.failed, patient.totals.cancelled), (1, 0));
}
