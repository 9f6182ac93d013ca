//! Processes killed at random moments: what they leave behind is sound, and what they had finished is not done again.
//!
//! `SALIENT_KILLS=500` tries so many moments, `SALIENT_FUZZ_SEED` others.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::process::Stdio;
use std::time::Duration;

use serde_json::Value;

use super::{Desk, watch::values};

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Some thirty nodes of a few milliseconds each, in three layers.
fn graph(tag: u64) -> String {
    let mut nodes = String::from("\"a\": read(path: \"a.txt\"),\n");
    for i in 0..12 {
        let time = 1 + i % 4;
        let _ = writeln!(nodes, "\"s{i}\": slow(x: \"a\", millis: {time}, tag: {}),", tag * 100 + i);
        let _ = writeln!(nodes, "\"t{i}\": slow(x: \"s{i}\", millis: {time}, tag: 1),");
    }
    let terms: Vec<_> = (0..12).map(|i| format!("\"t{i}\"")).collect();
    format!("(format: 1, nodes: {{\n{nodes}\"total\": sum(terms: [{}])}}, show: [\"total\"])", terms.join(", "))
}

fn total(tag: u64) -> String {
    // a is 2; each of twelve terms is a + tag + 1.
    let sum: u64 = (0..12).map(|i| 2 + tag * 100 + i + 1).sum();
    format!("[{sum}.0]")
}

/// Names of the nodes with an event of this kind.
fn names(events: &[Value], kind: &str) -> BTreeSet<String> {
    let of_kind = events.iter().filter(|event| event["event"] == kind);
    of_kind.map(|event| event["node"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn kills_at_random_moments_leave_a_sound_cache() {
    let desk = Desk::new(1);
    desk.write("a.txt", "2\n");
    let mut seed = number("SALIENT_FUZZ_SEED", 1);
    for round in 0..number("SALIENT_KILLS", 12) {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        desk.write("g.ron", &graph(round));
        let command = if seed >> 63 == 0 { "run" } else { "watch" };
        let mut killed = desk.command(&[command, "g.ron", "--json"]);
        let mut child = killed.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        // The moment is what is tried here, not something that is waited for.
        std::thread::sleep(Duration::from_micros((seed >> 33) % 60_000));
        child.kill().unwrap();
        let output = child.wait_with_output().unwrap();
        let said: Vec<Value> =
            String::from_utf8_lossy(&output.stdout).lines().map_while(|line| serde_json::from_str(line).ok()).collect();
        let verified = desk.ok(&["cache", "verify"]);
        assert!(verified.contains("0 damaged files"), "{round}: {verified}");
        let events = desk.events(&["run", "g.ron", "--json"]);
        assert_eq!(values(events.last().unwrap())[0].1, total(round), "{round}");
        let (again, finished) = (names(&events, "started"), names(&said, "finished"));
        assert!(again.is_disjoint(&finished), "{round}: {again:?} {finished:?}");
    }
    let stat: Value = serde_json::from_str(&desk.ok(&["cache", "stat", "--json"])).unwrap();
    assert_eq!(stat["running"], serde_json::json!([]));
}
