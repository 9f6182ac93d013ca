//! A folder for the real command: two meshes of creatures, the graphs that people run, a cache of its own.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use serde_json::Value;
use tempfile::TempDir;

use crate::{files, text};

/// The graph of two meshes in the lab.
pub const PAIR: &str = "match_pair.ron";

/// What makes `quickstart.ron` small.
pub const SMALL: [&str; 8] =
    ["--set", "a.vertices=700", "--set", "b.vertices=700", "--set", "*/basis.pairs=40", "--set", "*/maxima.count=12"];

pub struct Real {
    dir: TempDir,
}

impl Real {
    /// `match_pair.ron` reads `a.off` and `b.off`, with 40 eigenpairs and 12 features of each; the other graphs are as
    /// they are.
    pub fn new() -> Self {
        let real = Self::bare();
        for (name, off) in ["a.off", "b.off"].iter().zip(creatures()) {
            real.write(name, off);
        }
        real.edit(PAIR, &[("a.obj", "a.off"), ("b.obj", "b.off")]);
        real.edit("salient_features.ron", &[("pairs: 100", "pairs: 40"), ("\"features\": 50", "\"features\": 12")]);
        real
    }

    /// The graphs alone.
    pub fn bare() -> Self {
        let real = Self { dir: tempfile::tempdir().unwrap() };
        for graph in graphs() {
            fs::copy(&graph, real.path(graph.file_name().unwrap().to_str().unwrap())).unwrap();
        }
        real
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).unwrap();
    }

    pub fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    /// Replaces each of these texts, which must be there.
    pub fn edit(&self, name: &str, changes: &[(&str, &str)]) {
        let mut content = self.read(name);
        for (before, now) in changes {
            assert!(content.contains(before), "{name} has no `{before}`");
            content = content.replace(before, now);
        }
        self.write(name, content);
    }

    pub fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_salient"));
        command.args(args).current_dir(self.dir.path()).env("SALIENT_CACHE", self.path("cache"));
        command
    }

    pub fn call(&self, args: &[&str]) -> Output {
        let output = self.command(args).output().unwrap();
        assert!(!text(&output.stderr).contains("panicked"), "{args:?}: {}", text(&output.stderr));
        output
    }

    pub fn ok(&self, args: &[&str]) -> Vec<u8> {
        let output = self.call(args);
        assert!(output.status.success(), "{args:?}: {}", text(&output.stderr));
        output.stdout
    }

    /// A call that must end with this exit code; what it says on standard error, in single spaces and without frames.
    pub fn fails(&self, code: i32, args: &[&str]) -> String {
        let output = self.call(args);
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{args:?}: {stderr}");
        stderr.replace('│', " ").split_whitespace().collect::<Vec<_>>().join(" ")
    }

    pub fn json(&self, args: &[&str]) -> Value {
        serde_json::from_slice(&self.ok(args)).unwrap()
    }

    /// The events of a run that must succeed.
    pub fn events(&self, args: &[&str]) -> Vec<Value> {
        let lines = text(&self.ok(&[&["run", "--json"], args].concat()));
        lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    /// The addresses of the calls that a run executed, in alphabetical order.
    pub fn executed(&self, args: &[&str]) -> Vec<String> {
        let events = self.events(args);
        let started = events.iter().filter(|event| event["event"] == "started");
        let mut nodes: Vec<_> = started.map(|event| event["node"].as_str().unwrap().to_owned()).collect();
        nodes.sort();
        nodes
    }

    /// How many calls of each kind a run executed.
    pub fn stages(&self, args: &[&str]) -> BTreeMap<String, usize> {
        let mut stages = BTreeMap::new();
        for event in self.events(args).iter().filter(|event| event["event"] == "started") {
            *stages.entry(event["kind"].as_str().unwrap().to_owned()).or_default() += 1;
        }
        stages
    }
}

/// The graphs that people run.
pub fn graphs() -> Vec<PathBuf> {
    let mut graphs = files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("graphs"));
    graphs.sort();
    graphs
}

/// Two poses as OFF, made by the command once for all tests of a process.
pub fn creatures() -> &'static [String; 2] {
    static CREATURES: OnceLock<[String; 2]> = OnceLock::new();
    CREATURES.get_or_init(|| {
        let real = Real::bare();
        real.write(
            "make.ron",
            r#"(format: 1, nodes: {"a": synthesize(vertices: 700), "b": synthesize(pose: 1, vertices: 700)}, show: ["a", "b"])"#,
        );
        ["a", "b"].map(|name| text(&real.ok(&["get", "make.ron", name, "--format", "off"])))
    })
}

/// The vertices and faces of an OFF file, as lines.
pub fn lines(off: &str) -> (Vec<String>, Vec<String>) {
    let mut lines = off.lines();
    assert_eq!(lines.next(), Some("OFF"));
    let vertices: usize = lines.next().unwrap().split(' ').next().unwrap().parse().unwrap();
    let lines: Vec<_> = lines.map(str::to_owned).collect();
    (lines[..vertices].to_vec(), lines[vertices..].to_vec())
}

/// An OFF file of these lines.
pub fn off(vertices: &[String], faces: &[String]) -> String {
    let (v, f) = (vertices.len(), faces.len());
    [format!("OFF\n{v} {f} 0"), vertices.join("\n"), faces.join("\n"), String::new()].join("\n")
}

/// The numbers of a line.
pub fn numbers<T: std::str::FromStr<Err: std::fmt::Debug>>(line: &str) -> Vec<T> {
    line.split(' ').map(|x| x.parse().unwrap()).collect()
}
