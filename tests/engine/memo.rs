//! Items that are computed once, whatever the execution they are part of.

use std::fs;
use std::time::{Duration, SystemTime};

use salient::engine::upkeep::Limits;
use salient::engine::{Event, State};
use salient_sdk::AnyNode;

use crate::lab::{Graph, Lab, Ran, files};
use crate::toy::Roots;

fn graph(lab: &Lab, numbers: &[f64], node: &'static dyn AnyNode, params: &[(&str, &str)]) -> Graph {
    let lines: Vec<String> = numbers.iter().map(f64::to_string).collect();
    let file = lab.file("a.txt", &lines.join("\n"));
    let mut graph = Graph::new();
    let a = graph.read("a", &file);
    graph.call("roots", node, params, &[("x", a)]);
    graph.show(&["roots"])
}

/// How many roots the last execution computed, and how many were remembered.
fn figures(ran: &Ran) -> (u64, u64) {
    let figures = ran.events.iter().find_map(|event| match event {
        Event::Finished { node, figures, .. } if node == "roots" => Some(figures.clone()),
        _ => None,
    });
    let figures = figures.expect("roots executed");
    (figures["roots computed"].as_u64().unwrap(), figures["roots remembered"].as_u64().unwrap())
}

fn squares(n: u32) -> Vec<f64> {
    (1..=n).map(|i| f64::from(i * i) + 0.25).collect()
}

#[test]
fn eighty_items_of_which_fifty_are_known_compute_thirty() {
    for jobs in [1, 4] {
        let mut lab = Lab::new();
        lab.options.jobs = jobs;
        let run = |n| lab.run(&graph(&lab, &squares(n), &Roots::<1>, &[]));
        assert_eq!(figures(&run(50)), (50, 0));
        let known = run(80);
        assert_eq!(figures(&known), (30, 50));
        // Without the memo the very same bytes come out.
        let fresh = Lab::new();
        let anew = fresh.run(&graph(&fresh, &squares(80), &Roots::<1>, &[]));
        assert_eq!(figures(&anew), (80, 0));
        let digest = |ran: &Ran| ran.outcome.states.values().filter_map(State::record).map(|r| r.digest).max();
        assert_eq!((digest(&known), &known.values), (digest(&anew), &anew.values));
    }
}

#[test]
fn only_what_the_value_depends_on_counts() {
    let lab = Lab::new();
    let run = |node, params: &[(&str, &str)]| figures(&lab.run(&graph(&lab, &squares(6), node, params)));
    assert_eq!(run(&Roots::<1>, &[]), (6, 0));
    assert_eq!(run(&Roots::<1>, &[("plus", "1.0")]), (0, 6));
    assert_eq!(run(&Roots::<1>, &[("degree", "3.0")]), (6, 0));
    assert_eq!(run(&Roots::<2>, &[]), (6, 0));
    assert_eq!(run(&Roots::<2>, &[("plus", "2.0")]), (0, 6));
}

#[test]
fn a_damaged_pack_is_computed_again() {
    let lab = Lab::new();
    let first = lab.run(&graph(&lab, &squares(5), &Roots::<1>, &[]));
    let packs = files(&lab.dir.path().join("cache/memo"));
    assert_eq!(packs.len(), 1);
    let mut bytes = fs::read(&packs[0]).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&packs[0], bytes).unwrap();
    let ran = lab.run(&graph(&lab, &squares(5), &Roots::<1>, &[("plus", "1.0")]));
    assert_eq!((figures(&ran), ran.corrupt()), ((5, 0), 1));
    let expected: Vec<f64> = first.values["roots"].iter().map(|x| x + 1.0).collect();
    assert_eq!(ran.values["roots"], expected);
    assert_eq!(lab.cache().verify().unwrap().memos, 1);
}

#[test]
fn failures_are_not_kept_and_what_was_done_before_one_is() {
    let mut lab = Lab::new();
    lab.options.jobs = 1;
    let ran = lab.run(&graph(&lab, &[4.0, 9.0, 0.0, 13.0, 16.0], &Roots::<1>, &[]));
    assert_eq!(ran.failures()[0].1, "13 is unlucky");
    // Two are known; the zero had nothing worth keeping.
    assert_eq!(figures(&lab.run(&graph(&lab, &[4.0, 9.0, 0.0, 16.0], &Roots::<1>, &[]))), (2, 2));
}

#[test]
fn packs_are_collected_like_outputs() {
    let lab = Lab::new();
    lab.run(&graph(&lab, &squares(5), &Roots::<1>, &[]));
    let pack = files(&lab.dir.path().join("cache/memo")).remove(0);
    let stat = lab.cache().stat().unwrap();
    assert_eq!((stat.memos, stat.memo_bytes), (1, fs::metadata(&pack).unwrap().len()));
    let all = Limits { max_size: Some(0), ..Limits::default() };
    assert_eq!(lab.cache().gc(all).unwrap().memos, 0, "it was used just now");
    let old = SystemTime::now() - Duration::from_secs(48 * 3600);
    fs::File::options().write(true).open(&pack).unwrap().set_modified(old).unwrap();
    // Use keeps it young.
    lab.run(&graph(&lab, &squares(5), &Roots::<1>, &[("plus", "1.0")]));
    let aged = Limits { max_age: Some(Duration::from_secs(24 * 3600)), ..Limits::default() };
    assert_eq!(lab.cache().gc(aged).unwrap().memos, 0);
    fs::File::options().write(true).open(&pack).unwrap().set_modified(old).unwrap();
    assert_eq!(lab.cache().gc(aged).unwrap().memos, 1);
    assert_eq!(figures(&lab.run(&graph(&lab, &squares(5), &Roots::<1>, &[("plus", "2.0")]))), (5, 0));
    assert_eq!(lab.cache().clear().unwrap().memos, 1);
}
