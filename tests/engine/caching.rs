//! What is computed again, and what is not.

use std::fs;
use std::path::Path;
use std::time::SystemTime;

use salient::engine::Event;

use crate::lab::{Graph, Lab, files};
use crate::toy::{Bad, Scale, Sign, Slow, Sum, Wide};

/// `a -> double -> sign -> total`, with `b` beside it.
fn chain(a: &Path, b: &Path, factor: &str) -> Graph {
    let mut graph = Graph::new();
    let a = graph.read("a", a);
    let b = graph.read("b", b);
    let double = graph.call("double", &Scale::<1>, &[("factor", factor)], &[("x", a)]);
    let sign = graph.call("sign", &Sign, &[], &[("x", double)]);
    graph.call("total", &Sum, &[], &[("terms", sign), ("terms", b)]);
    graph.show(&["total"])
}

fn setup() -> (Lab, Graph) {
    let lab = Lab::new();
    let (a, b) = (lab.file("a.txt", "1\n-2\n5\n"), lab.file("b.txt", "10\n"));
    let graph = chain(&a, &b, "2.0");
    (lab, graph)
}

#[test]
fn a_second_run_executes_nothing() {
    let (lab, graph) = setup();
    let first = lab.run(&graph);
    assert_eq!(first.executed, ["a", "b", "double", "sign", "total"]);
    assert_eq!(first.values["total"], [11.0]);
    let second = lab.run(&graph);
    assert_eq!(second.executed, [""; 0]);
    assert_eq!(second.values, first.values);
    assert_eq!((second.outcome.totals.hits, second.outcome.totals.computed), (5, 0));
}

#[test]
fn only_what_is_shown_is_computed() {
    let (lab, mut graph) = setup();
    graph.plan.show.clear();
    let ran = lab.run(&graph.show(&["double"]));
    assert_eq!(ran.executed, ["a", "double"]);
}

#[test]
fn an_output_that_comes_out_as_before_stops_propagation() {
    let (lab, graph) = setup();
    lab.run(&graph);
    lab.file("a.txt", "3\n-4\n6\n");
    let ran = lab.run(&graph);
    assert_eq!(ran.executed, ["a", "double", "sign"]);
    assert_eq!(ran.values["total"], [11.0]);
}

#[test]
fn cosmetic_changes_execute_nothing() {
    let (lab, graph) = setup();
    lab.run(&graph);
    let (a, b) = (lab.dir.path().join("a.txt"), lab.dir.path().join("b.txt"));
    // The spelling of a param, and a default written out.
    assert_eq!(lab.run(&chain(&a, &b, " 2 // two\n")).executed, [""; 0]);
    // Moved files, and touched ones.
    let moved = lab.file("elsewhere/c.TXT", &fs::read_to_string(&a).unwrap());
    assert_eq!(lab.run(&chain(&moved, &b, "2.0")).executed, [""; 0]);
    fs::File::options().write(true).open(&a).unwrap().set_modified(SystemTime::UNIX_EPOCH).unwrap();
    assert_eq!(lab.run(&graph).executed, [""; 0]);
    // Other names and another order of calls.
    let mut other = Graph::new();
    let y = other.read("y", &b);
    let x = other.read("x", &a);
    let d = other.call("d", &Scale::<1>, &[], &[("x", x)]);
    let s = other.call("sign", &Sign, &[], &[("x", d)]);
    other.call("t", &Sum, &[], &[("terms", s), ("terms", y)]);
    other.plan.dag.node_weight_mut(y).unwrap().addresses = vec!["b".into()];
    assert_eq!(lab.run(&other.show(&["t"])).executed, [""; 0]);
}

#[test]
fn another_extension_is_another_file() {
    let (lab, graph) = setup();
    lab.run(&graph);
    let other = lab.file("a.csv", "1\n-2\n5\n");
    let ran = lab.run(&chain(&other, &lab.dir.path().join("b.txt"), "2.0"));
    assert_eq!(ran.executed, ["a"]);
}

#[test]
fn a_param_recomputes_what_follows_it() {
    let (lab, graph) = setup();
    lab.run(&graph);
    let (a, b) = (lab.dir.path().join("a.txt"), lab.dir.path().join("b.txt"));
    let ran = lab.run(&chain(&a, &b, "-2.0"));
    assert_eq!(ran.executed, ["double", "sign", "total"]);
    assert_eq!(ran.values["total"], [9.0]);
    // The former outputs are still there.
    assert_eq!(lab.run(&graph).executed, [""; 0]);
}

#[test]
fn a_new_version_of_a_node_recomputes_it() {
    let lab = Lab::new();
    let a = lab.file("a.txt", "1\n2\n");
    let build = |new: bool| {
        let mut graph = Graph::new();
        let a = graph.read("a", &a);
        let node: &'static dyn salient_sdk::AnyNode = if new { &Scale::<2> } else { &Scale::<1> };
        let double = graph.call("double", node, &[], &[("x", a)]);
        graph.call("sign", &Sign, &[], &[("x", double)]);
        graph.show(&["sign"])
    };
    lab.run(&build(false));
    assert_eq!(lab.run(&build(true)).executed, ["double"]);
    assert_eq!(lab.run(&build(true)).executed, [""; 0]);
}

#[test]
fn an_evicted_intermediate_is_computed_only_if_needed() {
    let (lab, graph) = setup();
    let first = lab.run(&graph);
    for address in ["a", "double", "sign"] {
        fs::remove_file(lab.object(&first, &graph, address)).unwrap();
    }
    assert_eq!(lab.run(&graph).executed, [""; 0]);
    // A new factor needs `a` again, but not the others as they were.
    let (a, b) = (lab.dir.path().join("a.txt"), lab.dir.path().join("b.txt"));
    let ran = lab.run(&chain(&a, &b, "-3.0"));
    assert_eq!(ran.executed, ["a", "double", "sign", "total"]);
    assert_eq!(ran.values["total"], [9.0]);
}

#[test]
fn evicted_results_are_computed_back_to_what_is_left() {
    let (mut lab, graph) = setup();
    let first = lab.run(&graph);
    for address in ["double", "sign", "total"] {
        fs::remove_file(lab.object(&first, &graph, address)).unwrap();
    }
    for jobs in [1, 4] {
        lab.options.jobs = jobs;
        let ran = lab.run(&graph);
        assert_eq!(ran.executed, ["double", "sign", "total"]);
        assert_eq!(ran.values, first.values);
        assert_eq!(lab.run(&graph).executed, [""; 0]);
        for address in ["double", "sign", "total"] {
            fs::remove_file(lab.object(&first, &graph, address)).unwrap();
        }
    }
}

#[test]
fn corrupt_objects_are_computed_again_and_never_served() {
    let (lab, graph) = setup();
    let first = lab.run(&graph);
    let intact = lab.objects();
    for damage in [&b""[..], b"garbage", &[0; 400]] {
        fs::write(lab.object(&first, &graph, "total"), damage).unwrap();
        fs::write(lab.object(&first, &graph, "sign"), damage).unwrap();
        let ran = lab.run(&graph);
        assert_eq!(ran.executed, ["sign", "total"]);
        assert_eq!(ran.corrupt(), 2);
        assert_eq!(ran.values, first.values);
        assert_eq!(lab.objects(), intact);
    }
}

#[test]
fn one_flipped_bit_is_found() {
    let (lab, graph) = setup();
    let first = lab.run(&graph);
    let path = lab.object(&first, &graph, "total");
    let mut bytes = fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&path, bytes).unwrap();
    let ran = lab.run(&graph);
    assert_eq!((ran.executed, ran.values), (vec!["total".to_owned()], first.values));
}

#[test]
fn corrupt_records_are_ignored() {
    let (lab, graph) = setup();
    let first = lab.run(&graph);
    let records = files(&lab.dir.path().join("cache/records"));
    assert_eq!(records.len(), 5);
    // Garbage, and a whole record under another's key.
    let other = fs::read(&records[0]).unwrap();
    for record in &records {
        fs::write(record, &other).unwrap();
    }
    let ran = lab.run(&graph);
    assert_eq!((ran.executed.len(), ran.corrupt()), (4, 4));
    assert_eq!(ran.values, first.values);
    for record in &records {
        fs::write(record, "{\"check\":1}").unwrap();
    }
    let ran = lab.run(&graph);
    assert_eq!((ran.executed.len(), ran.corrupt()), (5, 5));
    assert_eq!(lab.run(&graph).executed, [""; 0]);
}

#[test]
fn discovered_reads_are_part_of_what_an_output_depends_on() {
    let lab = Lab::new();
    let a = lab.file("one/a.txt", "1\ninclude more.txt\nmaybe opt.txt\n");
    lab.file("one/more.txt", "5\n");
    let build = |a: &Path| {
        let mut graph = Graph::new();
        graph.read("a", a);
        graph.show(&["a"])
    };
    let first = lab.run(&build(&a));
    assert_eq!(first.values["a"], [1.0, 5.0, 0.0]);
    assert_eq!(lab.run(&build(&a)).executed, [""; 0]);
    lab.file("one/more.txt", "6\n");
    let ran = lab.run(&build(&a));
    assert_eq!((ran.executed.len(), &ran.values["a"]), (1, &vec![1.0, 6.0, 0.0]));
    // What was absent and now is there, and back to the first state: both are remembered.
    lab.file("one/opt.txt", "");
    assert_eq!(lab.run(&build(&a)).values["a"], [1.0, 6.0, 1.0]);
    lab.file("one/more.txt", "5\n");
    fs::remove_file(lab.dir.path().join("one/opt.txt")).unwrap();
    let ran = lab.run(&build(&a));
    assert_eq!((ran.executed.len(), &ran.values["a"]), (0, &first.values["a"]));
    // Both files moved to another folder.
    let moved = lab.file("two/b.txt", "1\ninclude more.txt\nmaybe opt.txt\n");
    lab.file("two/more.txt", "5\n");
    assert_eq!(lab.run(&build(&moved)).executed, [""; 0]);
    // Beside the other file lies another `more.txt`.
    lab.file("two/more.txt", "7\n");
    assert_eq!(lab.run(&build(&moved)).values["a"], [1.0, 7.0, 0.0]);
}

#[test]
fn downstream_sees_what_a_later_run_reads() {
    let lab = Lab::new();
    let mut graph = Graph::new();
    let zero = graph.call("zero", &Bad, &[], &[]);
    graph.call("sign", &Sign, &[], &[("x", zero)]);
    let graph = graph.show(&["sign"]);
    // signum(-0.0) is -1, but the artefact holds 0.0.
    assert_eq!(lab.run(&graph).values["sign"], [1.0]);
}

#[test]
fn equal_calls_in_flight_execute_once() {
    let lab = Lab::new();
    let (a, b) = (lab.file("a.txt", "1\n"), lab.file("b.txt", "1\n"));
    let mut graph = Graph::new();
    let a = graph.read("a", &a);
    let b = graph.read("b", &b);
    graph.call("one", &Slow, &[("millis", "60")], &[("x", a)]);
    graph.call("two", &Slow, &[("millis", "60")], &[("x", b)]);
    let ran = lab.run(&graph.show(&["one", "two"]));
    assert_eq!(ran.executed.len(), 2, "{:?}", ran.executed);
    assert_eq!((&ran.values["one"], &ran.values["two"]), (&vec![1.0], &vec![1.0]));
    assert_eq!(ran.outcome.totals.hits, 2);
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_workers() {
    let lines: Vec<_> = (1..200).map(|i| (1.0 / f64::from(i)).to_string()).collect();
    let text = lines.join("\n");
    let mut all = Vec::new();
    for jobs in [1, 2, 8] {
        let mut lab = Lab::new();
        lab.options.jobs = jobs;
        let a = lab.file("a.txt", &text);
        let mut graph = Graph::new();
        let a = graph.read("a", &a);
        let mut terms = Vec::new();
        for i in 0..6 {
            let factor = format!("{i}.7");
            let x = graph.call(&format!("s{i}"), &Scale::<1>, &[("factor", &factor)], &[("x", a)]);
            terms.push(("terms", graph.call(&format!("w{i}"), &Wide, &[], &[("x", x)])));
        }
        graph.call("total", &Sum, &[], &terms);
        let ran = lab.run(&graph.show(&["total"]));
        assert!(ran.outcome.complete());
        all.push((lab.objects(), ran.values));
    }
    assert!(all[0] == all[1] && all[0] == all[2]);
    assert_eq!(all[0].0.len(), 14);
}

#[test]
fn a_memory_budget_of_nothing_still_works() {
    let (mut lab, graph) = setup();
    lab.options.memory = 0;
    let ran = lab.run(&graph);
    assert_eq!(ran.executed, ["a", "b", "double", "sign", "total"]);
    assert_eq!(ran.values["total"], [11.0]);
    assert_eq!(lab.run(&graph).values, ran.values);
}

#[test]
fn an_impure_node_is_reported_and_its_new_output_used() {
    let (lab, graph) = setup();
    lab.run(&graph);
    // As if `double` had been recorded with another output by a host that computes differently.
    let cache = lab.cache();
    let ran = lab.run(&graph);
    let double = graph.plan.addresses["double"];
    let mut record = ran.outcome.states[&double].record().unwrap().clone();
    record.digest = salient::engine::Digest::of(b"not there");
    cache.put_record(&record).unwrap();
    let ran = lab.run(&graph);
    // `sign` has another input, misses, needs `double`, and then finds its former output.
    assert_eq!(ran.executed, ["double"]);
    assert!(ran.events.iter().any(|e| matches!(e, Event::Irreproducible { node, .. } if node == "double")));
    assert_eq!(ran.values["total"], [11.0]);
    assert_eq!(lab.run(&graph).executed, [""; 0]);
}

#[test]
fn a_call_with_the_key_of_its_input_does_not_wait_for_itself() {
    for jobs in [1, 2] {
        let mut lab = Lab::new();
        lab.options.jobs = jobs;
        let a = lab.file("a.txt", "3\n");
        let mut graph = Graph::new();
        let a = graph.read("a", &a);
        let one = graph.call("one", &Sign, &[], &[("x", a)]);
        let two = graph.call("two", &Sign, &[], &[("x", one)]);
        graph.call("three", &Sign, &[], &[("x", two)]);
        let graph = graph.show(&["three"]);
        let first = lab.run(&graph);
        assert_eq!(first.executed, ["a", "one", "two"]);
        fs::remove_file(lab.object(&first, &graph, "two")).unwrap();
        assert_eq!(lab.run(&graph).values, first.values);
    }
}
