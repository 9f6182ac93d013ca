//! The command line: here with toy nodes (`examples/own_nodes.rs`), in the modules with the real ones.
#![allow(clippy::unwrap_used)]

mod bad_calls;
mod bad_meshes;
mod compare;
mod compare_real;
mod drawings;
mod executed;
mod kills;
mod notebook;
mod real;
mod registry;
mod report;
mod retrieval;
mod values;
mod watch;
mod watch_files;

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

/// The toy command. Cargo builds examples before it runs all tests of a package.
fn binary() -> PathBuf {
    let mut path = std::env::current_exe().unwrap();
    path.pop();
    path.pop();
    path.push("examples/own_nodes");
    assert!(path.exists(), "missing; run `cargo build --example own_nodes` first");
    path
}

struct Desk {
    dir: TempDir,
}

impl Desk {
    /// A folder with a graph whose third node takes `millis`.
    fn new(millis: u32) -> Self {
        let desk = Self { dir: tempfile::tempdir().unwrap() };
        desk.write("a.txt", "1\n-2\n?\n5\n");
        desk.write(
            "g.ron",
            &format!(
                "(format: 1, nodes: {{\n    \"a\": read(path: \"a.txt\"),\n    \
                 \"double\": scale(x: \"a\", factor: 2.0),\n    \
                 \"slow\": slow(x: \"double\", millis: {millis}),\n    \
                 \"total\": sum(terms: \"slow\"),\n    \"tri\": triangle(),\n\
                 }}, show: [\"total\", \"double\"])\n"
            ),
        );
        desk
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(binary());
        command.args(args).current_dir(self.dir.path()).env("SALIENT_CACHE", self.path("cache"));
        command
    }

    fn call(&self, args: &[&str]) -> Output {
        self.command(args).output().unwrap()
    }

    fn ok(&self, args: &[&str]) -> String {
        let output = self.call(args);
        assert!(output.status.success(), "{args:?}: {}", text(&output.stderr));
        text(&output.stdout)
    }

    fn events(&self, args: &[&str]) -> Vec<Value> {
        let lines = self.ok(args);
        lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    fn executed(&self) -> Vec<String> {
        let events = self.events(&["run", "g.ron", "--json"]);
        let started = events.iter().filter(|e| e["event"] == "started");
        started.map(|e| e["node"].as_str().unwrap().to_owned()).collect()
    }

    /// Starts a run and waits until the slow node reports progress.
    fn start(&self) -> (Child, BufReader<std::process::ChildStdout>) {
        let mut command = self.command(&["run", "g.ron", "--json"]);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        while !line.contains("\"progress\"") {
            line.clear();
            assert!(lines.read_line(&mut line).unwrap() > 0, "the run ended early");
        }
        (child, lines)
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn files(dir: &Path) -> Vec<PathBuf> {
    fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().path()).collect()
}

#[test]
fn results_on_standard_output_and_all_else_on_standard_error() {
    let desk = Desk::new(1);
    let output = desk.call(&["run", "g.ron"]);
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(
        text(&output.stdout),
        "total (sum)\n  count   1\n  values  [8.0]\n  ! a: duplicate vertex × 1, first at 2\n\
         double (scale)\n  count   3\n  values  [2.0, -4.0, 10.0]\n  ! a: duplicate vertex × 1, first at 2\n"
    );
    let stderr = text(&output.stderr);
    assert!(stderr.contains("computed slow (slow)"), "{stderr}");
    assert!(stderr.contains("4 nodes: 0 from the cache, 4 computed"), "{stderr}");
    let again = desk.call(&["run", "g.ron"]);
    assert_eq!(again.stdout, output.stdout);
    assert!(text(&again.stderr).contains("4 from the cache, 0 computed"));
}

#[test]
fn json_lines_end_with_the_results() {
    let desk = Desk::new(1);
    let events = desk.events(&["run", "g.ron", "--json", "--jobs", "1"]);
    assert_eq!(events[0]["event"], "run_started");
    assert_eq!(events[0]["calls"], 4);
    let finished = &events[events.len() - 2];
    assert_eq!((&finished["event"], &finished["computed"]), (&"run_finished".into(), &4.into()));
    let results = events.last().unwrap();
    assert_eq!(results["event"], "results");
    assert_eq!(results["results"][0]["summary"]["values"], "[8.0]");
    assert_eq!(results["results"][0]["defects"][0]["node"], "a");
    let figures = events.iter().find(|e| e["event"] == "finished" && e["node"] == "a").unwrap();
    assert_eq!(figures["figures"]["lines"], 3);
}

#[test]
fn overrides_and_edits_recompute_what_they_touch() {
    let desk = Desk::new(1);
    desk.ok(&["run", "g.ron"]);
    assert!(desk.executed().is_empty());
    let changed = desk.ok(&["run", "g.ron", "--set", "double.factor=3"]);
    assert!(changed.contains("[12.0]"), "{changed}");
    desk.write("a.txt", "7\n");
    assert_eq!(desk.executed(), ["a", "double", "slow", "total"]);
}

#[test]
fn the_name_of_a_node_at_a_port_of_many_is_no_input() {
    let desk = Desk::new(1);
    desk.ok(&["run", "g.ron"]);
    let graph = fs::read_to_string(desk.path("g.ron")).unwrap();
    desk.write("g.ron", &graph.replace("\"slow\"", "\"renamed\""));
    assert!(desk.executed().is_empty());
    desk.write("g.ron", &graph.replace("terms: \"slow\"", "terms: [\"slow\", \"double\"]"));
    assert_eq!(desk.executed(), ["total"]);
}

#[test]
fn plan_tells_what_would_be_computed_and_why() {
    let desk = Desk::new(1);
    let fresh = desk.ok(&["plan", "g.ron", "--why", "total"]);
    assert!(fresh.contains("never computed"), "{fresh}");
    desk.ok(&["run", "g.ron"]);
    assert!(desk.ok(&["plan", "g.ron"]).ends_with("4 nodes: 4 hit\n"));
    assert_eq!(desk.ok(&["plan", "g.ron", "--why", "total"]), "total is in the cache\n");
    desk.write("a.txt", "7\n");
    let plan = desk.ok(&["plan", "g.ron"]);
    assert!(plan.contains("3 depends on a miss, 1 miss"), "{plan}");
    let why = desk.ok(&["plan", "g.ron", "--why", "total", "--set", "double.factor=3"]);
    let lines: Vec<_> = why.lines().skip(1).map(str::trim).collect();
    assert!(lines[0].ends_with("from slow changed or may change:"), "{why}");
    assert!(lines.contains(&"param `factor` was 2.0, is 3.0"), "{why}");
    assert!(lines.last().unwrap().ends_with("a.txt (param `path`) changed"), "{why}");
    let json: Value = serde_json::from_str(&desk.ok(&["plan", "g.ron", "--json"])).unwrap();
    assert_eq!(json["calls"][0]["verdict"], "miss");
    // Nothing was executed by planning.
    assert_eq!(desk.executed(), ["a", "double", "slow", "total"]);
    // What an edit brought back is back.
    desk.write("a.txt", "1\n-2\n?\n5\n");
    assert!(desk.ok(&["plan", "g.ron"]).ends_with("4 nodes: 4 hit\n"));
}

#[test]
fn plan_names_evicted_outputs_that_are_needed() {
    let desk = Desk::new(1);
    desk.ok(&["run", "g.ron"]);
    for folder in files(&desk.path("cache/objects")) {
        fs::remove_dir_all(folder).unwrap();
    }
    let plan = desk.ok(&["plan", "g.ron"]);
    assert!(plan.contains("4 evicted"), "{plan}");
    let why = desk.ok(&["plan", "g.ron", "--why", "a"]);
    assert!(why.contains("removed from the cache"), "{why}");
    // `slow` hands on what `double` made: one object serves both, and if `double` was first to bring it back,
    // `slow` need not run.
    let executed = desk.executed();
    for node in ["a", "double", "total"] {
        assert!(executed.iter().any(|name| name == node), "{executed:?}");
    }
}

#[test]
fn get_writes_whole_files_in_the_format_of_their_extension() {
    let desk = Desk::new(1);
    desk.ok(&["get", "g.ron", "tri", "-o", "out/tri.obj"]);
    let obj = fs::read_to_string(desk.path("out/tri.obj")).unwrap();
    assert!(obj.starts_with("v 0 0 0\nv 1 0 0\n") && obj.ends_with("f 1 2 3\n"), "{obj}");
    let csv = desk.ok(&["get", "g.ron", "double", "--format", "csv"]);
    assert_eq!(csv, "value\n2\n-4\n10\n");
    let json: Value = serde_json::from_str(&desk.ok(&["get", "g.ron", "total", "-o", "-"])).unwrap();
    assert_eq!(json["values"][0], 8.0);
    for name in ["t.npz", "t.safetensors", "t.ply", "t.off", "t.json"] {
        desk.ok(&["get", "g.ron", "tri", "-o", name]);
        assert!(fs::metadata(desk.path(name)).unwrap().len() > 40, "{name}");
    }
    let refused = desk.call(&["get", "g.ron", "total", "-o", "total.ply"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("json, csv, npz, safetensors"));
    assert!(!desk.path("total.ply").exists());
    let unknown = desk.call(&["get", "g.ron", "total", "-o", "total.xyz"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(text(&unknown.stderr).contains("--format"));
    let device = desk.call(&["get", "g.ron", "total", "-o", "/dev/full", "--format", "json"]);
    assert_eq!(device.status.code(), Some(1));
    assert!(text(&device.stderr).contains("cannot write /dev/full"), "{}", text(&device.stderr));
}

#[test]
fn out_writes_each_result() {
    let desk = Desk::new(1);
    desk.ok(&["run", "g.ron", "--out", "results"]);
    let mut names: Vec<_> = files(&desk.path("results"))
        .iter()
        .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    names.sort();
    let expected = ["double.json", "double.safetensors", "total.json", "total.safetensors"];
    assert_eq!(names, expected);
}

#[test]
fn exit_codes() {
    let desk = Desk::new(1);
    let code = |args: &[&str]| desk.call(args).status.code().unwrap();
    assert_eq!(code(&["run"]), 2);
    assert_eq!(code(&["run", "none.ron"]), 2);
    assert_eq!(code(&["get", "g.ron", "totla"]), 2);
    assert_eq!(code(&["nodes", "scael"]), 2);
    assert_eq!(code(&["run", "g.ron", "--jobs", "0"]), 2);
    assert_eq!(code(&["--help"]), 0);
    assert_eq!(code(&["run", "g.ron", "--cache", "a.txt"]), 1);
    desk.write("a.txt", "what\n");
    let failed = desk.call(&["run", "g.ron"]);
    assert_eq!(failed.status.code(), Some(1));
    let stderr = text(&failed.stderr);
    assert!(stderr.contains("failed a (read) on a.txt: `what` is not a number\n  help: write one"), "{stderr}");
    assert!(stderr.contains("1 failed, 3 skipped"), "{stderr}");
    desk.write("bad.ron", "(format: 1, nodes: {\n    \"a\": raed(path: \"a.txt\"),\n}, show: [\"a\"])\n");
    assert_eq!(code(&["check", "g.ron"]), 0);
    assert_eq!(code(&["check", "g.ron", "bad.ron"]), 2);
    let json = desk.call(&["check", "g.ron", "bad.ron", "--json"]);
    let json: Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!((&json[0]["ok"], &json[1]["ok"]), (&true.into(), &false.into()));
    assert!(json[1]["diagnostics"].to_string().contains("raed"), "{json}");
}

#[test]
fn suggestions_for_misspelt_names() {
    let desk = Desk::new(1);
    assert!(text(&desk.call(&["nodes", "scael"]).stderr).contains("did you mean `scale`?"));
    let get = desk.call(&["get", "g.ron", "totla"]);
    assert!(text(&get.stderr).contains("did you mean `total`?"));
}

#[test]
fn documentation_comes_from_the_registry() {
    let desk = Desk::new(1);
    assert!(desk.ok(&["nodes"]).contains("scale     -> numbers  Multiplies\n"));
    let doc = desk.ok(&["nodes", "scale"]);
    assert!(doc.contains("factor: number, -10 to 10, default 2.0\n      What to multiply by"), "{doc}");
    let schema: Value = serde_json::from_str(&desk.ok(&["nodes", "scale", "--schema"])).unwrap();
    assert_eq!(schema["properties"]["factor"]["maximum"], 10.0);
    assert!(desk.ok(&["graph", "g.ron", "--format", "mermaid"]).starts_with("flowchart LR\n"));
    assert!(desk.ok(&["graph", "g.ron"]).contains("double\\nscale"));
    assert!(desk.ok(&["completions", "bash"]).contains("complete"));
}

#[test]
fn cache_commands() {
    let desk = Desk::new(1);
    desk.ok(&["run", "g.ron"]);
    let stat: Value = serde_json::from_str(&desk.ok(&["cache", "stat", "--json"])).unwrap();
    assert_eq!((&stat["records"], &stat["runs"]), (&4.into(), &1.into()));
    assert!(desk.ok(&["cache", "verify"]).starts_with("3 outputs, 4 records and 0 packs are whole"));
    let gc = desk.ok(&["cache", "gc", "--max-size", "0", "--max-age", "1d"]);
    assert!(gc.contains("were kept"), "{gc}");
    assert!(desk.executed().is_empty());
    desk.ok(&["cache", "clear"]);
    assert_eq!(desk.executed().len(), 4);
}

#[test]
fn a_closed_pipe_is_no_panic() {
    let desk = Desk::new(1);
    for args in [&["run", "g.ron"][..], &["run", "g.ron", "--json"], &["nodes"], &["plan", "g.ron"]] {
        let mut command = desk.command(args);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let mut stderr = String::new();
        child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(0), "{args:?}: {stderr}");
        assert!(!stderr.contains("panicked"), "{args:?}: {stderr}");
    }
}

#[test]
fn an_interrupt_stops_cleanly_and_keeps_what_is_finished() {
    let desk = Desk::new(60_000);
    let (mut child, mut lines) = desk.start();
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    let mut rest = String::new();
    lines.read_to_string(&mut rest).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(rest.contains("\"cancelled\":2"), "{rest}");
    let graph = fs::read_to_string(desk.path("g.ron")).unwrap();
    desk.write("g.ron", &graph.replace("60000", "1"));
    assert_eq!(desk.executed(), ["slow", "total"]);
}

#[test]
fn a_killed_run_leaves_a_sound_cache() {
    let desk = Desk::new(60_000);
    let (mut child, _lines) = desk.start();
    child.kill().unwrap();
    child.wait().unwrap();
    let graph = fs::read_to_string(desk.path("g.ron")).unwrap();
    desk.write("g.ron", &graph.replace("60000", "1"));
    assert_eq!(desk.executed(), ["slow", "total"]);
    assert!(desk.ok(&["cache", "verify"]).contains("0 damaged files"));
    // The dead process does not count as one that uses the cache.
    let stat: Value = serde_json::from_str(&desk.ok(&["cache", "stat", "--json"])).unwrap();
    assert_eq!(stat["running"], serde_json::json!([]));
}

#[test]
fn processes_share_a_cache() {
    let desk = Desk::new(30);
    let children: Vec<_> = (0..4)
        .map(|_| {
            let mut command = desk.command(&["run", "g.ron"]);
            command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
        })
        .collect();
    let outputs: Vec<_> = children.into_iter().map(|child| child.wait_with_output().unwrap()).collect();
    for output in &outputs {
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert_eq!(output.stdout, outputs[0].stdout);
    }
    assert!(desk.executed().is_empty());
}
