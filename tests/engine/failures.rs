//! Failures stop what rests on them, and nothing else.

use std::sync::atomic::Ordering;

use salient::engine::{Event, State};

use crate::lab::{Graph, Lab};
use crate::toy::{Bad, Fail, MOODY, Moody, Panics, Rest, Scale, Sign, Slow, Sum};

fn broken(lab: &Lab, node: &'static dyn salient_sdk::AnyNode) -> Graph {
    let a = lab.file("a.txt", "1\n");
    let mut graph = Graph::new();
    let a = graph.read("a", &a);
    let bad = graph.call("bad", node, &[], &[("x", a)]);
    let after = graph.call("after", &Sign, &[], &[("x", bad)]);
    graph.call("last", &Sum, &[], &[("terms", after), ("terms", a)]);
    let well = graph.call("well", &Scale::<1>, &[], &[("x", a)]);
    graph.call("fine", &Sign, &[], &[("x", well)]);
    graph.show(&["last", "fine"])
}

#[test]
fn a_failure_skips_what_rests_on_it_and_nothing_else() {
    let lab = Lab::new();
    let graph = broken(&lab, &Fail);
    let ran = lab.run(&graph);
    assert_eq!(ran.failures(), [("bad".into(), "it is the wrong number".into())]);
    let because = |name: &str| (name.to_owned(), "bad".to_owned());
    assert_eq!(ran.skipped(), [because("after"), because("last")]);
    assert_eq!(ran.values.keys().collect::<Vec<_>>(), ["fine"]);
    assert!(!ran.outcome.complete());
    // A failure is not kept: it is tried again, and nothing else.
    assert_eq!(lab.run(&graph).executed, ["bad"]);
}

#[test]
fn a_port_for_survivors_does_without_what_failed() {
    let lab = Lab::new();
    let (a, b) = (lab.file("a.txt", "1\n"), lab.file("b.txt", "not a number\n"));
    let mut graph = Graph::new();
    let (a, b) = (graph.read("a", &a), graph.read("b", &b));
    let sign = graph.call("sign", &Sign, &[], &[("x", b)]);
    let rest = graph.call("rest", &Rest, &[], &[("terms", a), ("terms", b), ("terms", sign)]);
    graph.call("last", &Scale::<1>, &[], &[("x", rest)]);
    let graph = graph.show(&["last"]);
    let ran = lab.run(&graph);
    assert_eq!(ran.values["last"], [2.0, 4.0]);
    assert_eq!((ran.failures().len(), ran.skipped()), (1, vec![("sign".into(), "b".into())]));
    assert!(!ran.outcome.complete());
    // The failure is tried again; what was made without it is as good as before.
    assert_eq!(lab.run(&graph).executed, ["b"]);
    // Once it works, its consumers take it.
    lab.file("b.txt", "-3\n");
    let ran = lab.run(&graph);
    assert_eq!(ran.executed, ["b", "last", "rest", "sign"]);
    assert_eq!(ran.values["last"], [-6.0, 0.0]);
    // And what was made without it is still known.
    lab.file("b.txt", "not a number\n");
    assert_eq!((lab.run(&graph).executed, lab.run(&graph).values["last"].clone()), (vec!["b".into()], vec![2.0, 4.0]));
}

#[test]
fn a_panic_is_the_failure_of_its_node() {
    let lab = Lab::new();
    let ran = lab.run(&broken(&lab, &Panics));
    let (node, message) = &ran.failures()[0];
    assert_eq!(node, "bad");
    assert!(message.contains("`panics` panicked: index 1 is bad"), "{message}");
    assert_eq!(ran.values["fine"], [1.0]);
    let help = ran.events.iter().find_map(|event| match event {
        Event::Failed { help, .. } => help.clone(),
        _ => None,
    });
    assert!(help.unwrap().contains("report"));
}

#[test]
fn an_output_that_cannot_be_written_is_a_failure() {
    let lab = Lab::new();
    let mut graph = Graph::new();
    graph.call("nan", &Bad, &[("nan", "true")], &[]);
    let ran = lab.run(&graph.show(&["nan"]));
    let message = &ran.failures()[0].1;
    assert!(message.contains("values") && message.contains("NaN"), "{message}");
    assert!(lab.objects().is_empty());
}

#[test]
fn a_missing_file_is_named() {
    let lab = Lab::new();
    let mut graph = Graph::new();
    graph.read("a", &lab.dir.path().join("none.txt"));
    let graph = graph.show(&["a"]);
    let ran = lab.run(&graph);
    assert!(ran.failures()[0].1.contains("none.txt"), "{:?}", ran.failures());
    lab.file("none.txt", "1\n");
    assert_eq!(lab.run(&graph).executed, ["a"]);
}

#[test]
fn an_evicted_input_that_now_fails_skips_only_who_needs_it() {
    let lab = Lab::new();
    let a = lab.file("a.txt", "1\n");
    let build = |factor: &str| {
        let mut graph = Graph::new();
        let a = graph.read("a", &a);
        let moody = graph.call("moody", &Moody, &[], &[("x", a)]);
        graph.call("sign", &Sign, &[], &[("x", moody)]);
        for name in ["one", "two"] {
            let x = graph.call(name, &Scale::<1>, &[("factor", factor)], &[("x", moody)]);
            graph.call(&format!("{name}/after"), &Sum, &[], &[("terms", x)]);
            graph.plan.dag[x].addresses[0].push('/');
        }
        graph.call("three", &Scale::<1>, &[("factor", "7")], &[("x", moody)]);
        graph.show(&["sign", "one/after", "two/after", "three"])
    };
    let first = lab.run(&build("2"));
    assert_eq!(first.values["two/after"], [4.0]);
    std::fs::remove_file(lab.object(&first, &build("2"), "moody")).unwrap();
    MOODY.store(true, Ordering::SeqCst);
    let ran = lab.run(&build("3"));
    assert_eq!(ran.failures(), [("moody".into(), "not today".into())]);
    let skipped: Vec<_> = ran.skipped().into_iter().map(|(node, _)| node).collect();
    assert_eq!(skipped, ["one/", "one/after", "two/", "two/after"]);
    // These were found without it.
    assert_eq!(ran.values.keys().collect::<Vec<_>>(), ["sign", "three"]);
    MOODY.store(false, Ordering::SeqCst);
    let ran = lab.run(&build("3"));
    assert_eq!(ran.executed.len(), 3, "{:?}", ran.executed);
    assert_eq!(ran.values["two/after"], [6.0]);
}

#[test]
fn a_cancelled_run_keeps_what_it_finished() {
    let lab = Lab::new();
    let a = lab.file("a.txt", "1\n");
    let mut graph = Graph::new();
    let a = graph.read("a", &a);
    let quick = graph.call("quick", &Sign, &[], &[("x", a)]);
    let slow = graph.call("slow", &Slow, &[("millis", "20000")], &[("x", quick)]);
    graph.call("after", &Sign, &[], &[("x", slow)]);
    let graph = graph.show(&["after"]);
    let begun = |event: &Event| matches!(event, Event::Progress { node, .. } if node == "slow");
    let ran = lab.run_until(&graph, begun);
    assert!(ran.outcome.cancelled && ran.failures().is_empty() && ran.skipped().is_empty());
    assert_eq!(ran.outcome.states[&slow], State::Cancelled);
    assert_eq!(ran.outcome.totals.cancelled, 2);
    let ran = lab.run_until(&graph, begun);
    assert_eq!(ran.executed, ["slow"]);
}
