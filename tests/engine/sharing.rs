//! Several runs on one cache, unusable caches, and collection.

use std::fs::{self, File};
use std::path::Path;
use std::time::{Duration, SystemTime};

use salient::engine::upkeep::Limits;
use salient::engine::{Cache, Cancel, Event, Options, run};

use crate::lab::{Graph, Lab, files};
use crate::toy::{Scale, Sign, Slow, Sum};

fn wide(lab: &Lab) -> Graph {
    let a = lab.file("a.txt", "1\n2\n");
    let mut graph = Graph::new();
    let a = graph.read("a", &a);
    let mut terms = Vec::new();
    for i in 1..13 {
        let tag = i.to_string();
        terms.push(("terms", graph.call(&format!("s{i}"), &Slow, &[("millis", "3"), ("tag", &tag)], &[("x", a)])));
    }
    graph.call("total", &Sum, &[], &terms);
    graph.show(&["total"])
}

#[test]
fn each_item_is_done_to_its_end_before_the_next_is_begun() {
    let mut lab = Lab::new();
    lab.options.jobs = 1;
    let mut graph = Graph::new();
    let mut terms = Vec::new();
    // Written stage by stage, as the planner numbers the instances of an axis.
    let reads: Vec<_> = (0..4)
        .map(|i| graph.read(&format!("read{i}"), &lab.file(&format!("{i}.txt"), &format!("{}\n", 2 * i + 3))))
        .collect();
    for (i, read) in reads.into_iter().enumerate() {
        let once = graph.call(&format!("once{i}"), &Scale::<1>, &[("factor", "2.0")], &[("x", read)]);
        terms.push(("terms", graph.call(&format!("twice{i}"), &Scale::<1>, &[("factor", "2.0")], &[("x", once)])));
    }
    graph.call("total", &Sum, &[], &terms);
    let ran = lab.run(&graph.show(&["total"]));
    let begun = |event: &Event| match event {
        Event::Started { node, .. } => Some(node.clone()),
        _ => None,
    };
    let order: Vec<String> = ran.events.iter().filter_map(begun).collect();
    let expected = (0..4).flat_map(|i| ["read", "once", "twice"].map(|stage| format!("{stage}{i}")));
    assert_eq!(order, expected.chain(["total".into()]).collect::<Vec<_>>());
}

#[test]
fn several_runs_share_a_cache_without_locks() {
    let lab = Lab::new();
    let graph = wide(&lab);
    std::thread::scope(|scope| {
        let handles: Vec<_> = (0..4).map(|_| scope.spawn(|| lab.run(&graph).values)).collect();
        for handle in handles {
            assert_eq!(handle.join().unwrap()["total"], [192.0]);
        }
    });
    assert_eq!(lab.run(&graph).executed, [""; 0]);
    let verified = lab.cache().verify().unwrap();
    assert_eq!((verified.objects, verified.records), (14, 14));
    assert!(verified.corrupt.is_empty() && verified.evicted == 0);
    assert!(files(&lab.dir.path().join("cache/tmp")).is_empty());
    assert!(files(&lab.dir.path().join("cache/running")).is_empty());
}

#[test]
fn a_collector_beside_a_run_does_no_harm() {
    let lab = Lab::new();
    let graph = wide(&lab);
    let limits = Limits { max_size: Some(0), grace: Duration::ZERO, ..Limits::default() };
    std::thread::scope(|scope| {
        let runs = scope.spawn(|| (0..5).map(|_| lab.run(&graph).values).collect::<Vec<_>>());
        while !runs.is_finished() {
            lab.cache().gc(limits).unwrap();
        }
        for values in runs.join().unwrap() {
            assert_eq!(values["total"], [192.0]);
        }
    });
}

#[test]
fn an_unusable_cache_says_so() {
    let lab = Lab::new();
    let in_place = lab.file("file", "not a folder");
    let error = Cache::open(&in_place).unwrap_err();
    assert!(error.message.contains("file") && error.help.contains("--cache"), "{error}");
    let foreign = lab.file("foreign/version", "salient cache 0\n");
    let error = Cache::open(foreign.parent().unwrap()).unwrap_err();
    assert!(error.message.contains("salient cache 0"), "{error}");
    // The folder of objects turns out to be a file in mid-run.
    let cache = lab.cache();
    let objects = cache.root().join("objects");
    fs::remove_dir(&objects).unwrap();
    fs::write(&objects, "").unwrap();
    let graph = wide(&lab);
    let wanted = [graph.plan.show[0].call];
    let error =
        run(&graph.plan, &wanted, &cache, Options::default(), &Cancel::new(), &mut |_| {}).map(|_| ()).unwrap_err();
    assert!(error.message.contains("cannot write"), "{error}");
}

fn age(path: &Path, hours: u64) {
    let at = SystemTime::now() - Duration::from_secs(hours * 3600);
    File::options().write(true).open(path).unwrap().set_modified(at).unwrap();
}

fn old_chain() -> (Lab, Graph) {
    let lab = Lab::new();
    let a = lab.file("a.txt", "1\n2\n");
    let mut graph = Graph::new();
    let a = graph.read("a", &a);
    let s = graph.call("s", &Scale::<1>, &[], &[("x", a)]);
    graph.call("t", &Sign, &[], &[("x", s)]);
    (lab, graph.show(&["t"]))
}

#[test]
fn collection_by_size_takes_the_longest_unused_first() {
    let (lab, graph) = old_chain();
    let ran = lab.run(&graph);
    let path = |name| lab.object(&ran, &graph, name);
    age(&path("a"), 30);
    age(&path("s"), 20);
    age(&path("t"), 10);
    let size = |name| fs::metadata(path(name)).unwrap().len();
    let limit = size("t") + size("s");
    let limits = Limits { max_size: Some(limit), ..Limits::default() };
    let report = lab.cache().gc(limits).unwrap();
    assert_eq!((report.objects, report.records, report.left), (1, 0, limit));
    assert!(!path("a").exists() && path("s").exists() && path("t").exists());
    assert_eq!(lab.run(&graph).executed, [""; 0]);
}

#[test]
fn collection_by_age_spares_what_was_just_used() {
    let (lab, graph) = old_chain();
    let ran = lab.run(&graph);
    for path in files(&lab.dir.path().join("cache")) {
        age(&path, 100);
    }
    age(&lab.object(&ran, &graph, "t"), 0);
    let stale = lab.file("cache/tmp/left", "x");
    age(&stale, 25);
    let fresh = lab.file("cache/tmp/now", "x");
    let limits = Limits { max_age: Some(Duration::from_secs(24 * 3600)), max_size: Some(0), ..Limits::default() };
    let report = lab.cache().gc(limits).unwrap();
    assert_eq!((report.objects, report.records, report.temporaries), (2, 3, 1));
    assert!(report.protected > 0 && report.left == report.protected);
    assert!(!stale.exists() && fresh.exists());
}

#[test]
fn what_a_living_run_used_is_not_collected() {
    let (lab, graph) = old_chain();
    let ran = lab.run(&graph);
    for path in files(&lab.dir.path().join("cache/objects")) {
        age(&path, 10);
    }
    // A run that began 20 hours ago, on whatever host, and still touches its file.
    let since = SystemTime::now() - Duration::from_secs(20 * 3600);
    let millis = since.duration_since(SystemTime::UNIX_EPOCH).unwrap().as_millis();
    let live = serde_json::json!({"pid": 1, "host": "elsewhere", "since": millis as u64});
    let beat = lab.file("cache/running/x", &salient::engine::record::seal(&live).unwrap());
    let limits = Limits { max_size: Some(0), ..Limits::default() };
    assert_eq!(lab.cache().gc(limits).unwrap().objects, 0);
    assert!(lab.cache().clear().unwrap_err().message.contains("in use"));
    // It has not touched its file for long: it died.
    age(&beat, 1);
    assert_eq!(lab.cache().gc(limits).unwrap().objects, 3);
    assert!(!beat.exists());
    assert_eq!(lab.run(&graph).values, ran.values);
    lab.cache().clear().unwrap();
    assert_eq!(lab.cache().stat().unwrap(), salient::engine::upkeep::Stat::default());
}

#[test]
fn verification_finds_damage() {
    let (lab, graph) = old_chain();
    let ran = lab.run(&graph);
    fs::write(lab.object(&ran, &graph, "a"), "x").unwrap();
    fs::remove_file(lab.object(&ran, &graph, "s")).unwrap();
    let record = files(&lab.dir.path().join("cache/records")).remove(0);
    fs::write(&record, "x").unwrap();
    let verified = lab.cache().verify().unwrap();
    assert_eq!((verified.objects, verified.records, verified.corrupt.len()), (1, 2, 2));
    assert!(lab.cache().verify().unwrap().corrupt.is_empty());
}
