//! Every node stops soon after the run was stopped.
//!
//! The test counts questions, not time: a node that is told to stop at any of its questions asks hardly another one, and on larger input it
//! asks more often. How long the longest stretch between two questions is, in wall time and in processor time (which tells of a machine that
//! does other things as well), is measured by
//! `SALIENT_CANCEL_VERTICES=50000 cargo test --release -p salient-nodes --test pipeline cancel -- --nocapture`.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use salient_nodes::NODES;
use salient_sdk::memo::ItemKey;
use salient_sdk::testing::TestHost;
use salient_sdk::{AnyArtefact, Context, Host, Mesh, NodeError, PortValues};
use serde_json::Value;

/// Name, kind, params, wires.
type Step = (&'static str, &'static str, Vec<(&'static str, String)>, &'static [(&'static str, &'static str)]);

/// All kinds of nodes, on meshes of about `n` vertices.
fn steps(n: usize) -> Vec<Step> {
    let text = |x: &str| x.to_owned();
    let vertices = |n: usize| ("vertices", n.to_string());
    let features = ("count", text("20"));
    let many = ("count", text(if n < 10_000 { "40" } else { "200" }));
    vec![
        ("a", "synthesize", vec![vertices(n)], &[]),
        ("b", "synthesize", vec![vertices(n), ("pose", text("1"))], &[]),
        ("loaded", "load", vec![("path", text("\"a.off\"")), ("weld", text("Always"))], &[]),
        ("shuffled", "shuffle", vec![], &[("mesh", "b")]),
        ("small", "simplify", vec![vertices(n / 2)], &[("mesh", "a")]),
        ("piece", "cut", vec![("keep", text("0.5"))], &[("mesh", "a")]),
        ("la", "laplacian", vec![], &[("mesh", "a")]),
        ("delaunay", "laplacian", vec![("intrinsic_delaunay", text("true"))], &[("mesh", "a")]),
        ("lb", "laplacian", vec![], &[("mesh", "b")]),
        ("basis", "eigensolve", vec![("pairs", text("60"))], &[("operator", "la")]),
        ("basis_b", "eigensolve", vec![("pairs", text("60"))], &[("operator", "lb")]),
        ("smooth", "reconstruct", vec![("count", text("40"))], &[("mesh", "a"), ("basis", "basis")]),
        ("energy", "reconstruction_energy", vec![], &[("mesh", "a"), ("basis", "basis")]),
        ("energy_b", "reconstruction_energy", vec![], &[("mesh", "b"), ("basis", "basis_b")]),
        ("maxima", "maxima", vec![features.clone()], &[("mesh", "a"), ("energy", "energy")]),
        ("maxima_b", "maxima", vec![features], &[("mesh", "b"), ("energy", "energy_b")]),
        ("patches", "patch_extract", vec![], &[("mesh", "a"), ("maxima", "maxima")]),
        ("heat", "patch_extract", vec![("metric", text("Heat"))], &[("mesh", "a"), ("maxima", "maxima")]),
        ("exact", "patch_extract", vec![("metric", text("Exact"))], &[("mesh", "a"), ("maxima", "maxima")]),
        ("patches_b", "patch_extract", vec![], &[("mesh", "b"), ("maxima", "maxima_b")]),
        ("fa", "patch_spectrum", vec![], &[("patches", "patches")]),
        ("fb", "patch_spectrum", vec![], &[("patches", "patches_b")]),
        ("match", "iqp_match", vec![], &[("left", "fa"), ("right", "fb")]),
        ("many maxima", "maxima", vec![many.clone()], &[("mesh", "a"), ("energy", "energy")]),
        ("many maxima_b", "maxima", vec![many], &[("mesh", "b"), ("energy", "energy_b")]),
        ("many patches", "patch_extract", vec![], &[("mesh", "a"), ("maxima", "many maxima")]),
        ("many patches_b", "patch_extract", vec![], &[("mesh", "b"), ("maxima", "many maxima_b")]),
        ("many fa", "patch_spectrum", vec![], &[("patches", "many patches")]),
        ("many fb", "patch_spectrum", vec![], &[("patches", "many patches_b")]),
        ("many matches", "iqp_match", vec![("limit", text("Nodes(3)"))], &[("left", "many fa"), ("right", "many fb")]),
        ("stretched", "iqp_match", vec![("stretch", text("1.3"))], &[("left", "fa"), ("right", "fb")]),
        ("oriented", "orient_match", vec![], &[("match", "match"), ("left", "a"), ("right", "b")]),
        ("accuracy", "evaluate_match", vec![], &[("match", "match"), ("left", "a"), ("right", "b")]),
        (
            "repeat",
            "evaluate_repeatability",
            vec![("top", text("20"))],
            &[("left", "fa"), ("right", "fb"), ("left_mesh", "a"), ("right_mesh", "b")],
        ),
        ("object", "synthesize_object", vec![("model", text("\"chair-3\"")), vertices(n)], &[]),
        ("dna", "shape_dna", vec![("values", text("30"))], &[("basis", "basis")]),
        ("heat_0", "heat_signature", vec![], &[("basis", "basis")]),
        ("wave_0", "wave_signature", vec![], &[("basis", "basis")]),
        ("cat_0", "volume_signature", vec![], &[("mesh", "a")]),
        ("cat_1", "volume_signature", vec![], &[("mesh", "b")]),
        ("chair_0", "volume_signature", vec![], &[("mesh", "object")]),
        ("view", "view_signature", vec![], &[("mesh", "a")]),
        ("panorama", "panorama_signature", vec![], &[("mesh", "a")]),
        ("points", "point_signature", vec![], &[("basis", "basis")]),
        ("points_b", "point_signature", vec![], &[("basis", "basis_b")]),
        ("words", "vocabulary", vec![], &[("points", "points"), ("points", "points_b")]),
        ("bag", "bag_of_features", vec![], &[("points", "points"), ("vocabulary", "words")]),
        (
            "alike",
            "signature_similarity",
            vec![],
            &[("signatures", "cat_0"), ("signatures", "cat_1"), ("signatures", "chair_0")],
        ),
        ("fused", "fuse", vec![], &[("similarities", "alike"), ("similarities", "alike")]),
        ("network", "network_fusion", vec![], &[("similarities", "alike"), ("similarities", "alike")]),
        ("spread", "diffuse", vec![], &[("similarity", "alike")]),
        (
            "list",
            "shortlist",
            vec![("count", text("1"))],
            &[("signatures", "cat_0"), ("signatures", "cat_1"), ("signatures", "chair_0")],
        ),
        (
            "all",
            "match_all",
            vec![],
            &[("queries", "many fa"), ("queries", "many fb"), ("targets", "many fa"), ("targets", "many fb")],
        ),
        ("scored", "score", vec![], &[("scores", "all")]),
        ("why", "explain_match", vec![], &[("left", "fa"), ("right", "fb")]),
        ("ranked", "rank", vec![], &[("similarity", "alike")]),
        ("metrics", "retrieval_metrics", vec![("pattern", text("\"{class}_#\""))], &[("ranking", "ranked")]),
    ]
}

/// A host that counts the questions whether the run was stopped, and stops it at one of them.
struct Probe {
    host: TestHost,
    asked: AtomicUsize,
    stop_at: usize,
    begun: Instant,
    /// The longest stretches without a question, if they are measured.
    quiet: Option<Mutex<Quiet>>,
}

/// The last question, and the longest stretch without one: wall time, and processor time of the thread.
#[derive(Clone, Copy)]
struct Quiet {
    last: [Duration; 2],
    longest: [Duration; 2],
}

impl Quiet {
    fn new(origin: Instant) -> Self {
        Self { last: clocks(origin), longest: [Duration::ZERO; 2] }
    }

    fn note(&mut self, origin: Instant) {
        let now = clocks(origin);
        self.longest = [0, 1].map(|i: usize| self.longest[i].max(now[i].saturating_sub(self.last[i])));
        self.last = now;
    }
}

/// Wall time since a moment, and processor time of this thread since it began (zero where the system does not tell).
#[expect(clippy::disallowed_methods, reason = "a host, not a node")]
fn clocks(origin: Instant) -> [Duration; 2] {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split(' ').next().and_then(|first| first.parse().ok()).unwrap_or(0);
    [origin.elapsed(), Duration::from_nanos(nanoseconds)]
}

impl Probe {
    #[expect(clippy::disallowed_methods, reason = "a host, not a node")]
    fn new(file: &[u8], stop_at: usize, measured: bool) -> Self {
        let begun = Instant::now();
        let quiet = measured.then(|| Mutex::new(Quiet::new(begun)));
        let host = TestHost::with_workers(0).file("path", file);
        Self { host, asked: AtomicUsize::new(0), stop_at, begun, quiet }
    }

    fn note(&self) {
        if let Some(quiet) = &self.quiet {
            quiet.lock().unwrap().note(self.begun);
        }
    }

    fn asked(&self) -> usize {
        self.asked.load(Ordering::Relaxed)
    }
}

impl Host for Probe {
    fn read(&self, param: &str, beside: Option<&str>) -> Result<Arc<[u8]>, NodeError> {
        self.host.read(param, beside)
    }
    fn progress(&self, _: f64) {}
    fn cancelled(&self) -> bool {
        self.note();
        self.asked.fetch_add(1, Ordering::Relaxed) + 1 >= self.stop_at
    }
    fn record(&self, _: &str, _: Value) {}
    fn seconds(&self) -> f64 {
        self.host.seconds()
    }
    fn borrow_workers(&self, _: usize) -> usize {
        0
    }
    fn return_workers(&self, _: usize) {}
    fn recall(&self, _: &Value, _: &[ItemKey]) -> Result<Vec<Option<Vec<u8>>>, NodeError> {
        Ok(Vec::new())
    }
}

/// What came out so far.
struct Bench {
    made: BTreeMap<&'static str, Arc<dyn AnyArtefact>>,
    file: Vec<u8>,
    measured: bool,
}

impl Bench {
    fn run(&self, (_, kind, params, wires): &Step, stop_at: usize) -> (Result<Arc<dyn AnyArtefact>, NodeError>, Probe) {
        let node = NODES.iter().find(|n| n.kind() == *kind).unwrap();
        let fields: Vec<(&str, &str)> = params.iter().map(|(name, value)| (*name, value.as_str())).collect();
        let node = node.bind(&fields).unwrap();
        let mut inputs = PortValues::default();
        for (port, from) in *wires {
            inputs.push(port, from, self.made[from].clone());
        }
        let probe = Probe::new(&self.file, stop_at, self.measured);
        let output = node.run(&mut inputs, Context::new(&probe));
        probe.note();
        (output, probe)
    }

    fn keep(&mut self, name: &'static str, output: Arc<dyn AnyArtefact>) {
        if let Some(mesh) = output.surface().filter(|_| name == "a") {
            self.file = off(mesh);
        }
        self.made.insert(name, output);
    }
}

fn off(mesh: &Mesh) -> Vec<u8> {
    let mut text = format!("OFF\n{} {} 0\n", mesh.vertices.len(), mesh.faces.len());
    for [x, y, z] in &mesh.vertices {
        writeln!(text, "{x} {y} {z}").unwrap();
    }
    for [a, b, c] in &mesh.faces {
        writeln!(text, "3 {a} {b} {c}").unwrap();
    }
    text.into_bytes()
}

/// After the answer that the run was stopped, a node may ask once more, to learn why its kernel returned, and on the way out of loops.
const LAST_QUESTIONS: usize = 8;

#[test]
#[expect(clippy::disallowed_methods, reason = "a test may be told to measure")]
fn every_node_stops_soon() {
    let measured = std::env::var("SALIENT_CANCEL_VERTICES").ok().map(|n| n.parse::<usize>().unwrap());
    let mut bench = Bench { made: BTreeMap::new(), file: Vec::new(), measured: measured.is_some() };
    let mut driven = BTreeSet::new();
    for step in steps(measured.unwrap_or(500)) {
        let (name, kind) = (step.0, step.1);
        let (output, probe) = bench.run(&step, usize::MAX);
        let total = probe.asked();
        if let Some(quiet) = &probe.quiet {
            let [wall, cpu] = quiet.lock().unwrap().longest;
            println!(
                "{name:14} {kind:24} {total:6} questions, longest stretch {wall:8.1?}, {cpu:8.1?} of processor time"
            );
        } else {
            assert!(total > 0, "{name}: {kind} never asks whether it should stop");
            for at in BTreeSet::from([1, total / 2, total]) {
                let (stopped, probe) = bench.run(&step, at.max(1));
                let error =
                    stopped.err().unwrap_or_else(|| panic!("{name}: {kind} goes on after question {at} of {total}"));
                assert!(error.cancelled, "{name}: {kind} stopped at question {at} of {total} says: {}", error.message);
                assert!(probe.asked() <= at.max(1) + LAST_QUESTIONS, "{name}: {kind} asks {} times", probe.asked());
            }
        }
        driven.insert(kind);
        bench.keep(name, output.unwrap());
    }
    let missing: Vec<_> = NODES.iter().map(|n| n.kind()).filter(|kind| !driven.contains(kind)).collect();
    assert!(missing.is_empty(), "no step drives {missing:?}: add one to `steps`");
}
