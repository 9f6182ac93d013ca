//! Known optima of QAPLIB instances, where the data set lies beside the repository (`../shared/data/qaplib` from the workspace root,
//! or from a directory above it).

#![expect(clippy::float_cmp, reason = "exact equality is what is claimed")]
#![expect(clippy::unwrap_used, clippy::disallowed_methods, reason = "a test file, no node")]

use salient_kernels::assignment::{Control, Limits, Problem, Solution, solve};
use std::path::{Path, PathBuf};
use std::time::Instant;

fn data() -> Option<PathBuf> {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2)?;
    let found = workspace.ancestors().skip(1).map(|up| up.join("shared/data/qaplib")).find(|p| p.is_dir());
    if found.is_none() {
        println!("SKIPPED: no ../shared/data/qaplib beside the workspace");
    }
    found
}

fn numbers(path: &Path) -> Vec<f64> {
    let text = std::fs::read_to_string(path).unwrap();
    text.split_whitespace().map(|word| word.parse().unwrap()).collect()
}

fn load(root: &Path, name: &str) -> (Problem, f64) {
    let all = numbers(&root.join(name).join(format!("{name}.txt")));
    let n = all[0] as usize;
    let problem = Problem::from_qaplib(n, &all[1..=n * n], &all[1 + n * n..]).unwrap();
    (problem, numbers(&root.join(name).join("solution.txt"))[1])
}

fn run(root: &Path, name: &str, limits: &Limits) -> (Solution, f64) {
    let (problem, optimum) = load(root, name);
    let start = Instant::now();
    let s = solve(&problem, limits, &Control::default()).unwrap();
    println!(
        "{name}: optimum {optimum} heuristic {} found {} bound {} root {} proved {} nodes {} {:.2} s",
        -s.heuristic_objective,
        -s.objective,
        -s.upper_bound,
        -s.root_bound,
        s.proved,
        s.nodes,
        start.elapsed().as_secs_f64()
    );
    (s, optimum)
}

#[test]
fn known_optima_are_found_and_never_excluded() {
    let Some(root) = data() else { return };
    for name in ["chr12a", "chr12b", "chr12c", "had12", "nug12", "tai12a", "rou12", "scr12"] {
        let (s, optimum) = run(&root, name, &Limits { node_limit: 1, root_rounds: 30, ..Limits::default() });
        assert_eq!(-s.objective, optimum, "{name}");
        assert!(-s.upper_bound <= optimum, "{name}");
    }
}

#[test]
fn known_optima_are_proved() {
    let Some(root) = data() else { return };
    for name in ["chr12a", "chr12b", "chr12c", "scr12"] {
        let (s, optimum) = run(&root, name, &Limits { node_limit: 100_000, starts: 1, ..Limits::default() });
        assert_eq!((-s.objective, -s.upper_bound, s.proved), (optimum, optimum, true), "{name}");
    }
}

#[test]
#[ignore = "a measurement: run in release with --nocapture; QAPLIB=name,... chooses"]
fn measure() {
    let Some(root) = data() else { return };
    let chosen = std::env::var("QAPLIB")
        .unwrap_or_else(|_| "chr12a,chr12b,chr12c,had12,nug12,tai12a,rou12,scr12,chr15a,scr15".into());
    let node_limit = std::env::var("NODES").map_or(200_000, |n| n.parse().unwrap());
    let node_rounds = std::env::var("SWEEPS").map_or(Limits::default().node_rounds, |n| n.parse().unwrap());
    for name in chosen.split(',') {
        run(&root, name, &Limits { node_limit, node_rounds, ..Limits::default() });
    }
}
