//! `salient watch` as a process, with real files: what is computed again, and when results are announced.
//!
//! Tests wait for lines of `--json`, with a deadline that only a hang exceeds.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::{Desk, text};

/// Longer than anything takes on the slowest machine.
const DEADLINE: Duration = Duration::from_secs(120);

/// A watch that is going on; killed at the end.
pub struct Watching {
    child: Child,
    lines: Receiver<Value>,
}

impl Desk {
    /// Replaces a file at once, so that nobody sees it empty.
    pub fn save(&self, name: &str, text: &str) {
        self.write("being saved", text);
        std::fs::rename(self.path("being saved"), self.path(name)).unwrap();
    }

    /// Watches a graph.
    pub fn watch(&self, args: &[&str]) -> Watching {
        let mut command = self.command(&[&["watch", "--json"], args].concat());
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in stdout.lines().map_while(Result::ok) {
                let event = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line}"));
                if sender.send(event).is_err() {
                    return;
                }
            }
        });
        Watching { child, lines }
    }
}

impl Watching {
    /// Events up to the first for which `wanted` holds.
    pub fn until(&self, wanted: impl Fn(&Value) -> bool) -> Vec<Value> {
        let (mut events, start) = (Vec::new(), Instant::now());
        loop {
            let left = DEADLINE.saturating_sub(start.elapsed());
            let event = self.lines.recv_timeout(left).unwrap_or_else(|e| panic!("{e} after {events:#?}"));
            let done = wanted(&event);
            events.push(event);
            if done {
                return events;
            }
        }
    }

    /// Events up to the announcement of this value.
    pub fn until_value(&self, node: &str, value: &str) -> Vec<Value> {
        self.until(|event| values(event).iter().any(|(name, is)| name == node && is == value))
    }

    /// Events up to the next time that there is nothing to do.
    pub fn until_idle(&self) -> Vec<Value> {
        self.until(|event| event["event"] == "watching")
    }

    pub fn until_event(&self, kind: &str) -> Vec<Value> {
        self.until(|event| event["event"] == kind)
    }

    /// Ctrl-C; returns all that was said from then on, the exit code, and standard error.
    pub fn interrupt(mut self) -> (Vec<Value>, Option<i32>, String) {
        let pid = self.child.id().to_string();
        assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
        let rest = self.lines.iter().collect();
        let mut stderr = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
        (rest, self.child.wait().unwrap().code(), stderr)
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The values that a `results` event announces, by node.
pub fn values(event: &Value) -> Vec<(String, String)> {
    let results = event["results"].as_array().map(Vec::as_slice).unwrap_or_default();
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    results.iter().map(|result| (text(&result["node"]), text(&result["summary"]["values"]))).collect()
}

/// The nodes that were executed.
pub fn started(events: &[Value]) -> Vec<String> {
    let started = events.iter().filter(|event| event["event"] == "started");
    let mut names: Vec<_> = started.map(|event| event["node"].as_str().unwrap().to_owned()).collect();
    names.sort();
    names
}

pub fn count(events: &[Value], kind: &str) -> usize {
    events.iter().filter(|event| event["event"] == kind).count()
}

const CHAIN: &str = "(format: 1, nodes: {\n    \"a\": read(path: \"a.txt\"),\n    \
    \"double\": scale(x: \"a\", factor: 2.0),\n    \"total\": sum(terms: \"double\"),\n}, show: [\"total\"])\n";

#[test]
fn edits_of_the_graph_recompute_what_they_touch() {
    let desk = Desk::new(1);
    desk.save("a.txt", "1\n2\n");
    desk.save("g.ron", CHAIN);
    let watch = desk.watch(&["g.ron"]);
    assert_eq!(started(&watch.until_value("total", "[6.0]")), ["a", "double", "total"]);
    let idle = watch.until_idle().pop().unwrap();
    assert_eq!((&idle["files"], &idle["folders"]), (&2.into(), &1.into()));
    // Of a param.
    desk.save("g.ron", &CHAIN.replace("2.0", "3.0"));
    assert_eq!(started(&watch.until_value("total", "[9.0]")), ["double", "total"]);
    // Cosmetic, and back to what was computed before.
    desk.save("g.ron", &CHAIN.replace("2.0", "2").replace("nodes", "/* no change */ nodes"));
    let events = watch.until_value("total", "[6.0]");
    assert_eq!((started(&events), count(&events, "broken")), (vec![], 0));
    // Of the wires.
    desk.save("g.ron", &CHAIN.replace("terms: \"double\"", "terms: [\"double\", \"a\"]"));
    assert_eq!(started(&watch.until_value("total", "[9.0]")), ["total"]);
    // Of an input file.
    desk.save("a.txt", "1\n3\n");
    assert_eq!(started(&watch.until_value("total", "[12.0]")), ["a", "double", "total"]);
}

#[test]
fn edits_of_subgraphs_bases_and_variants_are_seen() {
    let desk = Desk::new(1);
    desk.save("a.txt", "1\n2\n");
    let sub = "(format: 1, inputs: {\"x\": \"numbers\"}, nodes: {\"s\": scale(x: \"x\", factor: 2.0)}, output: \"s\")";
    desk.save("sub.ron", sub);
    desk.write(
        "base.ron",
        "(format: 1, nodes: {\"a\": read(path: \"a.txt\"), \"f\": graph(file: \"sub.ron\", x: \"a\"),\n\
         \"total\": sum(terms: \"f\")}, show: [\"total\"])",
    );
    desk.save("v.ron", "(format: 1, base: \"base.ron\", variants: {\"v\": set({\"*/s\": (factor: 4.0)})})");
    let plain = desk.watch(&["base.ron", "--set", "a.path=\"a.txt\""]);
    let variant = desk.watch(&["v.ron", "--variant", "v"]);
    plain.until_value("total", "[6.0]");
    variant.until_value("v:total", "[12.0]");
    desk.save("sub.ron", &sub.replace("scale(x: \"x\", factor: 2.0)", "sign(x: \"x\")"));
    assert_eq!(started(&plain.until_value("total", "[2.0]")).last().unwrap(), "total");
    // In the variant, nothing has the param any more.
    let broken = variant.until_event("broken").pop().unwrap();
    assert_eq!(broken["diagnostics"][0]["code"], "unknown-param", "{broken}");
    desk.save("v.ron", "(format: 1, base: \"base.ron\", variants: {\"v\": set({\"a\": (path: \"b.txt\")})})");
    desk.write("b.txt", "5\n5\n5\n");
    variant.until_value("v:total", "[3.0]");
}

#[test]
fn a_broken_graph_shows_its_diagnostics_and_the_last_results_stand() {
    let desk = Desk::new(1);
    desk.save("a.txt", "1\n2\n");
    desk.save("g.ron", &CHAIN.replace("scale(", "scael("));
    let watch = desk.watch(&["g.ron"]);
    let events = watch.until_idle();
    assert_eq!(count(&events, "run_started"), 0);
    let broken = &events[0];
    assert_eq!(broken["diagnostics"][0]["code"], "unknown-kind", "{broken}");
    assert!(broken["text"].as_str().unwrap().contains("did you mean `scale`?"), "{broken}");
    desk.save("g.ron", CHAIN);
    watch.until_value("total", "[6.0]");
    // Half a file, no file, an empty file.
    desk.save("g.ron", &CHAIN[..CHAIN.len() / 2]);
    watch.until_event("broken");
    std::fs::remove_file(desk.path("g.ron")).unwrap();
    watch.until(|event| event["event"] == "broken" && event["diagnostics"].to_string().contains("cannot read"));
    desk.save("g.ron", "");
    watch.until_event("broken");
    desk.save("g.ron", CHAIN);
    assert!(started(&watch.until_value("total", "[6.0]")).is_empty());
    // A file of a node that is gone is an error of the graph; other files are as they were.
    std::fs::remove_file(desk.path("a.txt")).unwrap();
    let events = watch.until_event("broken");
    assert!(events.iter().any(|event| event["removed"] == serde_json::json!(["a.txt"])), "{events:?}");
    desk.save("a.txt", "1\n2\n");
    assert!(started(&watch.until_value("total", "[6.0]")).is_empty());
}

/// With a node that takes longer than anybody waits here, and reports progress every two seconds.
fn endless() -> String {
    CHAIN.replace("scale(x: \"a\", factor: 2.0)", "slow(x: \"a\", millis: 200000)")
}

#[test]
fn a_newer_edit_stops_what_it_supersedes() {
    let desk = Desk::new(1);
    desk.save("a.txt", "1\n2\n");
    desk.save("g.ron", &endless());
    let watch = desk.watch(&["g.ron"]);
    let runs = |event: &Value| event["event"] == "started" && event["node"] == "double";
    // By the graph.
    watch.until(runs);
    desk.save("g.ron", &endless().replace("200000", "1"));
    let events = watch.until_value("total", "[3.0]");
    assert!(events.iter().any(|event| event["event"] == "changed" && event["running"] == true), "{events:?}");
    assert!(events.iter().any(|event| event["event"] == "run_finished" && event["cancelled"] == 2), "{events:?}");
    assert_eq!(started(&events), ["double", "total"]);
    // By a file.
    desk.save("g.ron", &endless());
    watch.until(runs);
    desk.save("a.txt", "1\n4\n");
    let events = watch.until(runs);
    assert_eq!((started(&events), count(&events, "results")), (vec!["a".to_owned(), "double".to_owned()], 0));
    // By an edit that breaks the graph, it is not stopped; the next one stops it.
    desk.save("g.ron", &endless()[..60]);
    let events = watch.until_event("broken");
    assert_eq!(count(&events, "run_finished"), 0);
    let events = watch.until_event("progress");
    assert_eq!(count(&events, "run_finished") + count(&events, "run_started"), 0);
    desk.save("g.ron", &endless().replace("200000", "2"));
    assert_eq!(started(&watch.until_value("total", "[5.0]")), ["double", "total"]);
}

#[test]
fn nodes_that_are_still_wanted_finish_in_spite_of_an_edit() {
    let desk = Desk::new(1);
    desk.save("a.txt", "1\n2\n");
    desk.write("b.txt", "1\n");
    let graph = |factor: u32| {
        format!(
            "(format: 1, nodes: {{\"a\": read(path: \"a.txt\"), \"slow\": slow(x: \"a\", millis: 3000),\n\
             \"b\": read(path: \"b.txt\"), \"after\": scale(x: \"slow\", factor: {factor}),\n\
             \"total\": sum(terms: [\"after\", \"b\"])}}, show: [\"total\"])"
        )
    };
    desk.save("g.ron", &graph(1));
    let watch = desk.watch(&["g.ron"]);
    let mut events = watch.until_event("progress");
    // An edit behind it, and one beside it.
    desk.save("g.ron", &graph(2));
    desk.write("b.txt", "2\n");
    events.extend(watch.until_value("total", "[8.0]"));
    let slow = started(&events).into_iter().filter(|name| name == "slow").count();
    assert_eq!(slow, 1, "{events:?}");
}

#[test]
fn ctrl_c_ends_it_cleanly() {
    let desk = Desk::new(1);
    desk.save("a.txt", "1\n2\n");
    desk.save("g.ron", CHAIN);
    let watch = desk.watch(&["g.ron"]);
    watch.until_idle();
    let (rest, code, stderr) = watch.interrupt();
    assert_eq!((rest.len(), code), (0, Some(130)), "{stderr}");
    assert!(stderr.contains("what was finished is kept"), "{stderr}");
    // In the middle of a run.
    desk.save("g.ron", &endless());
    let watch = desk.watch(&["g.ron"]);
    watch.until_event("progress");
    let (rest, code, _) = watch.interrupt();
    assert_eq!((count(&rest, "run_finished"), count(&rest, "results"), code), (1, 0, Some(130)));
    let stat: Value = serde_json::from_str(&desk.ok(&["cache", "stat", "--json"])).unwrap();
    assert_eq!((&stat["running"], &stat["temporaries"]), (&serde_json::json!([]), &0.into()));
}

#[test]
fn a_failed_node_is_tried_again_when_its_file_is_mended() {
    let desk = Desk::new(1);
    desk.save("a.txt", "1\n2");
    desk.write("b.txt", "3\n");
    let graph = "(format: 1, nodes: {\"a\": read(path: \"a.txt\"), \"b\": read(path: \"b.txt\"),\n\
        \"x\": sum(terms: \"a\"), \"y\": sum(terms: \"b\")}, show: [\"x\", \"y\"])";
    desk.save("g.ron", graph);
    let watch = desk.watch(&["g.ron"]);
    watch.until_value("x", "[3.0]");
    // Half-written: the rest stands.
    desk.save("a.txt", "1\n2\nthr");
    let events = watch.until_value("y", "[3.0]");
    let failed = events.iter().find(|event| event["event"] == "failed").unwrap();
    assert!(failed["message"].as_str().unwrap().contains("`thr` is not a number"), "{failed}");
    assert_eq!(values(events.last().unwrap()).len(), 1);
    desk.save("a.txt", "1\n2\n4\n");
    assert_eq!(started(&watch.until_value("x", "[7.0]")), ["a", "x"]);
}

#[test]
fn people_are_told_what_changed_and_only_new_results() {
    let desk = Desk::new(1);
    desk.save("a.txt", "1\n2\n");
    desk.save("g.ron", &CHAIN.replace("show: [\"total\"]", "show: [\"total\", \"a\"]"));
    let mut command = desk.command(&["watch", "g.ron"]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut wait = || {
        let (mut all, mut line) = (String::new(), String::new());
        while !line.starts_with("watching g.ron: 2 files") {
            line.clear();
            assert!(stderr.read_line(&mut line).unwrap() > 0, "it ended: {all}");
            all.push_str(&line);
        }
        all
    };
    wait();
    desk.save("g.ron", &CHAIN.replace("show: [\"total\"]", "show: [\"total\", \"a\"]").replace("2.0", "5.0"));
    let told = wait();
    for part in ["changed: g.ron\n", "computed double (scale)", "1 result as before", "1 from the cache, 2 computed"] {
        assert!(told.contains(part), "{part}: {told}");
    }
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    let mut stdout = String::new();
    child.stdout.take().unwrap().read_to_string(&mut stdout).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(stdout.matches("total (sum)").count(), 2, "{stdout}");
    assert_eq!(stdout.matches("a (read)").count(), 1, "{stdout}");
    let refused = desk.call(&["watch", "g.ron", "--poll", "0"]);
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused.stderr));
}
